/* Key frames: all that the next ticks come from, so that a log with a gap can be computed on.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

/* The next tick begins with one: what is sent of another is abandoned, the host sees it by its tick.  From
 * the main loop, with interrupts held off where the control code's params have just changed. */
void esea_key_ask(esea_app_t *app)
{
    app->key.waits = false;
    app->key.asked = true;
}

/* At the start of a tick, before its release; not while a slower task is at work on the state. */
void esea_key_take(esea_app_t *app, uint32_t tick)
{
    esea_key_t *const key = &app->key;
    uint32_t number;

    if (key->interval == 0u || key->waits || (!key->asked && tick - key->tick < key->interval))
        return;
    for (number = 0u; number < ESEA_LINK_TASKS; ++number)
        if (app->tasks[number].due)
            return;
    esea_link_key(&app->control, key->words);
    key->tick = tick;
    key->sent = 0u;
    key->asked = false;
    key->waits = true;
}

/* At most one message of the one that waits; false when none does. */
bool esea_key_send(esea_app_t *app)
{
    esea_key_t *const key = &app->key;
    const uint32_t left = ESEA_LINK_KEY_WORDS - key->sent;
    mavlink_esea_key_t fields;

    if (!key->waits)
        return false;
    memset(&fields, 0, sizeof fields);
    fields.sequence = key->tick;
    fields.first = key->sent;
    fields.total = ESEA_LINK_KEY_WORDS;
    memcpy(fields.words, &key->words[key->sent],
            (left < ESEA_LINK_KEY_PART ? left : ESEA_LINK_KEY_PART) * sizeof fields.words[0]);
    ESEA_SEND(app, esea_key, fields);
    key->sent += ESEA_LINK_KEY_PART;
    if (key->sent >= ESEA_LINK_KEY_WORDS)
        key->waits = false;
    return true;
}
