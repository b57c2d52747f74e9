/* License: MIT. */
#include "blackbox.h"

#include <stddef.h>
#include <string.h>

#define FROZEN 0x46524F5Au
#define RUNNING 0x52554E53u
#define SEED 2166136261u /* FNV-1a, over words where speed counts */
#define PRIME 16777619u

static uint32_t over_words(uint32_t sum, const void *from, size_t bytes)
{
    const uint8_t *at = from;
    uint32_t word;

    for (; bytes >= sizeof word; bytes -= sizeof word, at += sizeof word) {
        memcpy(&word, at, sizeof word);
        sum = (sum ^ word) * PRIME;
        sum ^= sum >> 15; /* so that the highest bits tell, too */
    }
    return sum;
}

/* Of the device, its code, and the records. */
static uint32_t layout_now(void)
{
    const char *text = ESEA_LINK_CONTENT_HASH;
    uint32_t sum = SEED ^ (uint32_t)sizeof(esea_blackbox_record_t) ^ (ESEA_BLACKBOX_RECORDS << 8);

    for (; *text != '\0'; ++text)
        sum = (sum ^ (uint32_t)(uint8_t)*text) * PRIME;
    return sum;
}

static uint32_t check_of_head(const esea_blackbox_t *box)
{
    return over_words(SEED, box, offsetof(esea_blackbox_t, check));
}

static uint32_t check_of(const esea_blackbox_t *box, const esea_blackbox_record_t *record)
{
    const size_t head = offsetof(esea_blackbox_record_t, serial);

    return over_words(box->layout ^ box->epoch, (const uint8_t *)record + head, sizeof *record - head);
}

static bool valid(const esea_blackbox_t *box, uint32_t place)
{
    return box->records[place].check == check_of(box, &box->records[place]);
}

static void seal(esea_blackbox_t *box, uint32_t state, uint32_t fault, uint32_t tick)
{
    box->frozen = state;
    box->fault = fault;
    box->tick = tick;
    box->check = check_of_head(box);
}

/* Finds the newest record, and how many lie before it without a gap. */
static void find_records(esea_blackbox_t *box)
{
    uint32_t newest = ESEA_BLACKBOX_RECORDS, place;

    box->count = 0u;
    for (place = 0u; place < ESEA_BLACKBOX_RECORDS; ++place)
        if (valid(box, place) &&
            (newest == ESEA_BLACKBOX_RECORDS ||
             (uint16_t)(box->records[place].serial - box->records[newest].serial) < 0x8000u))
            newest = place;
    if (newest == ESEA_BLACKBOX_RECORDS)
        return;
    box->serial = (uint16_t)(box->records[newest].serial + 1u);
    box->next = (newest + 1u) % ESEA_BLACKBOX_RECORDS;
    for (place = newest; box->count < ESEA_BLACKBOX_RECORDS; ++box->count) {
        if (!valid(box, place) || (uint16_t)(box->records[place].serial + box->count + 1u) != box->serial)
            break;
        place = (place + ESEA_BLACKBOX_RECORDS - 1u) % ESEA_BLACKBOX_RECORDS;
    }
}

void esea_blackbox_start(esea_blackbox_t *box, uint32_t fault)
{
    const esea_blackbox_record_t *newest;

    if (box->layout != layout_now() || box->check != check_of_head(box)) {
        esea_blackbox_release(box);
        return;
    }
    find_records(box);
    if (esea_blackbox_frozen(box))
        return;
    newest = &box->records[(box->next + ESEA_BLACKBOX_RECORDS - 1u) % ESEA_BLACKBOX_RECORDS];
    if (box->count > 0u && (fault != 0u || (newest->flags & ESEA_BLACKBOX_ON) != 0u))
        seal(box, FROZEN, fault, newest->tick);
    else
        esea_blackbox_release(box);
}

void esea_blackbox_want(esea_blackbox_record_t *record, const esea_link_wanted_t *wanted)
{
    float values[sizeof *wanted / sizeof(float)];

    memcpy(values, wanted, sizeof values);
#if ESEA_LINK_AXES > 0
    record->flags = (uint8_t)(record->flags | (wanted->mode < 3u ? wanted->mode : 3u) |
                              (wanted->stop != 0u ? 4u : 0u) | (wanted->rearm < 7u ? wanted->rearm : 7u) << 3);
#endif
    memcpy(record->desired, values + ESEA_BLACKBOX_PACKED, sizeof record->desired);
}

void esea_blackbox_add(esea_blackbox_t *box, esea_blackbox_record_t *record)
{
    if (esea_blackbox_frozen(box))
        return;
    record->serial = box->serial;
    record->check = check_of(box, record);
    box->records[box->next] = *record;
    box->serial = (uint16_t)(box->serial + 1u);
    box->next = (box->next + 1u) % ESEA_BLACKBOX_RECORDS;
    if (box->count < ESEA_BLACKBOX_RECORDS)
        ++box->count;
}

void esea_blackbox_freeze(esea_blackbox_t *box, uint32_t fault, uint32_t tick)
{
    if (!esea_blackbox_frozen(box))
        seal(box, FROZEN, fault, tick);
}

void esea_blackbox_release(esea_blackbox_t *box)
{
    box->layout = layout_now();
    box->epoch = box->epoch + 1u;
    box->next = box->count = 0u;
    box->serial = 0u;
    seal(box, RUNNING, 0u, 0u);
}

bool esea_blackbox_frozen(const esea_blackbox_t *box)
{
    return box->frozen == FROZEN;
}

uint32_t esea_blackbox_count(const esea_blackbox_t *box)
{
    return esea_blackbox_frozen(box) ? box->count : 0u;
}

bool esea_blackbox_read(const esea_blackbox_t *box, uint32_t index, esea_blackbox_record_t *record)
{
    uint32_t place;

    if (index >= esea_blackbox_count(box))
        return false;
    place = (box->next + ESEA_BLACKBOX_RECORDS - box->count + index) % ESEA_BLACKBOX_RECORDS;
    *record = box->records[place];
    return valid(box, place);
}
