/* Signatures of commands: a board with a key accepts only commands signed with it.  The signatures are
 * MAVLink's own; a stop needs no signature.
 *
 * Timestamps are the board's count, not a time: each frame's must be above that of the frame before.  Every start
 * of a paired board begins above all accepted ones, so that recorded frames are void.  The range of a start is
 * reserved in the store before the first frame is accepted.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

#define LAST 0xFFFFFFFFFFFFu        /* a timestamp has 48 bits: a million starts */
#define RESERVE 0x10000000u         /* timestamps that a start may use: 15 days at 200 a second */
#define MOST_AHEAD 6000000u         /* above the last that was taken */

/* From the timestamp on, if that is in the store. */
static void set_aside(esea_signing_t *signing, bool kept)
{
    signing->most = kept && signing->key.timestamp < LAST - RESERVE ? signing->key.timestamp + RESERVE - 1u : 0u;
}

void esea_signing_start(esea_app_t *app)
{
    const esea_store_t *const store = app->port->store;
    esea_signing_t *const signing = &app->signing;

    if (store == NULL)
        return;
    signing->key.timestamp = ((uint64_t)store->set.key.stamp[1] << 32 | store->set.key.stamp[0]) + RESERVE;
    signing->paired = esea_kept_key(app, signing->key.secret_key, &signing->most);
    if (!signing->paired)
        return;
    set_aside(signing, esea_keep_key(app, signing->key.secret_key, signing->key.timestamp));
    if (signing->most > 0u)
        app->use_changed = false; /* the start was counted by the same write */
    else
        esea_send_text(app, MAV_SEVERITY_WARNING, "the memory failed: only a stop is taken", "");
}

void esea_signing_up(esea_app_t *app)
{
    esea_signing_t *const signing = &app->signing;

    if (!signing->paired || app->port->store == NULL || signing->most == 0u || esea_state_drives(app->state) ||
            signing->most - signing->key.timestamp > RESERVE / 2u)
        return;
    set_aside(signing, esea_keep_key(app, signing->key.secret_key, signing->key.timestamp));
}

void esea_signing_setup(esea_app_t *app, const mavlink_message_t *message)
{
    static const uint8_t none[MAVLINK_MSG_SETUP_SIGNING_FIELD_SECRET_KEY_LEN];
    esea_signing_t *const signing = &app->signing;
    mavlink_setup_signing_t asked;
    bool on, kept;

    mavlink_msg_setup_signing_decode(message, &asked);
    if (!esea_meant(asked.target_system, asked.target_component))
        return;
    on = memcmp(asked.secret_key, none, sizeof none) != 0;
    if (esea_state_drives(app->state) || (!on && !signing->paired)) {
        esea_send_text(app, MAV_SEVERITY_WARNING, "key refused in state ",
                esea_link_state_name((uint32_t)app->state));
        return;
    }
    memcpy(signing->key.secret_key, asked.secret_key, sizeof signing->key.secret_key);
    signing->paired = on;
    kept = esea_keep_key(app, signing->key.secret_key, signing->key.timestamp);
    set_aside(signing, true); /* where it is not kept, neither is the key */
    esea_send_text(app, MAV_SEVERITY_INFO, on ? "paired" : "no longer paired", kept ? "" : ", until power-off");
}

bool esea_signing_good(esea_app_t *app, const mavlink_message_t *message)
{
    esea_signing_t *const signing = &app->signing;
    const mavlink_signing_streams_t before = signing->streams;
    const uint64_t last = signing->key.timestamp;

    if (!signing->paired)
        return true;
    if ((message->incompat_flags & MAVLINK_IFLAG_SIGNED) == 0u ||
            !mavlink_signature_check(&signing->key, &signing->streams, message))
        return false;
    if (signing->key.timestamp <= signing->most && signing->key.timestamp - last <= MOST_AHEAD)
        return true;
    signing->streams = before; /* who has another idea of the time locks nobody out */
    signing->key.timestamp = last;
    signing->key.last_status = MAVLINK_SIGNING_STATUS_OLD_TIMESTAMP;
    return false;
}

void esea_refuse(esea_app_t *app, const mavlink_message_t *message, const char *why, bool late)
{
    const bool command = message->msgid == MAVLINK_MSG_ID_COMMAND_LONG;
    const bool parameter = message->msgid == MAVLINK_MSG_ID_PARAM_SET;
    const uint32_t now_ms = esea_now_ms(app);
    mavlink_param_set_t asked;

    /* Rate-limit the texts: refused commands may come in quick succession. */
    if (!command && !parameter && message->msgid != MAVLINK_MSG_ID_ESEA_STREAM &&
            message->msgid != MAVLINK_MSG_ID_SETUP_SIGNING) {
        if (!late || now_ms - app->refused_ms < 1000u)
            return;
        app->refused_ms = now_ms;
    }
    esea_send_text(app, MAV_SEVERITY_WARNING, "refused: ", why); /* before the answer, which then is understood */
    if (command)
        esea_send_ack(app, message, mavlink_msg_command_long_get_command(message), MAV_RESULT_DENIED, late);
    if (!parameter)
        return;
    mavlink_msg_param_set_decode(message, &asked);
    esea_parameters_error(app, message, asked.param_id, -1, MAV_PARAM_ERROR_PERMISSION_DENIED);
}

void esea_signing_refuse(esea_app_t *app, const mavlink_message_t *message)
{
    esea_signing_t *const signing = &app->signing;

    if ((message->incompat_flags & MAVLINK_IFLAG_SIGNED) == 0u)
        esea_count(&signing->unsigned_refused);
    else if (signing->key.last_status == MAVLINK_SIGNING_STATUS_BAD_SIGNATURE)
        esea_count(&signing->bad);
    else
        esea_count(&signing->replayed);
    esea_refuse(app, message, "this board is paired, sign with its key", false);
}
