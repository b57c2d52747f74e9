/* License: MIT. */
#include "store.h"

#include <string.h>

#define MAGIC 0x45534131u /* "ESA1" */
#define WHOLE 0x600DC0DEu /* written last */
#define BLANK 0xFFFFFFFFu

typedef struct {
    uint32_t magic, layout, bytes, device, sequence;
    uint32_t crc; /* of the above and the set */
} head_t;

#define CHUNK 64u

static uint32_t unit_of(const esea_flash_t *flash)
{
    return flash->unit_bytes > 0u ? flash->unit_bytes : (uint32_t)sizeof(uint32_t);
}

/* What a part of a slot fills: whole units, for one that is not erased may not be written again. */
static uint32_t units(const esea_flash_t *flash, uint32_t bytes)
{
    return (bytes + unit_of(flash) - 1u) & ~(unit_of(flash) - 1u);
}

/* A slot: head, set, last word, each in units of its own. */
static uint32_t set_at(const esea_flash_t *flash)
{
    return units(flash, (uint32_t)sizeof(head_t));
}

static uint32_t slot_bytes(const esea_flash_t *flash, uint32_t bytes)
{
    return set_at(flash) + units(flash, bytes) + units(flash, (uint32_t)sizeof(uint32_t));
}

/* CRC-32 (IEEE 802.3), to be started with all ones and inverted at the end. */
static uint32_t crc_over(uint32_t crc, const void *from, size_t count)
{
    static const uint32_t of[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
    };
    const uint8_t *at = from;

    for (; count > 0u; --count, ++at) {
        crc = crc >> 4 ^ of[(crc ^ *at) & 0xFu];
        crc = crc >> 4 ^ of[(crc ^ (uint32_t)*at >> 4) & 0xFu];
    }
    return crc;
}

static uint32_t crc_of_head(const head_t *head)
{
    return crc_over(BLANK, head, offsetof(head_t, crc));
}

static uint32_t slots(const esea_flash_t *flash)
{
    const uint32_t unit = unit_of(flash);

    if (unit > ESEA_FLASH_UNIT_MOST || (unit & (unit - 1u)) != 0u)
        return 0u; /* no power of two: nothing is kept */
    return flash->area_bytes / slot_bytes(flash, (uint32_t)sizeof(esea_store_set_t));
}

/* The checksum of a set as it stands in flash, of whatever length its head says. */
static uint32_t crc_in_flash(const esea_flash_t *flash, uint32_t area, uint32_t at, const head_t *head)
{
    uint8_t bytes[CHUNK];
    uint32_t crc = crc_of_head(head), done, n;

    for (done = 0u; done < head->bytes; done += n) {
        n = head->bytes - done < CHUNK ? head->bytes - done : CHUNK;
        flash->read(area, at + set_at(flash) + done, bytes, n);
        crc = crc_over(crc, bytes, n);
    }
    return ~crc;
}

/* Whether a whole set stands in a slot; of another layout, it fills as much as its head says. */
static bool look(const esea_flash_t *flash, uint32_t area, uint32_t slot, head_t *head)
{
    const uint32_t at = slot * slot_bytes(flash, (uint32_t)sizeof(esea_store_set_t));
    const uint32_t room = (flash->area_bytes - at - slot_bytes(flash, 0u)) & ~(unit_of(flash) - 1u);
    uint32_t last;

    flash->read(area, at, head, sizeof *head);
    if (head->magic != MAGIC || head->bytes > room)
        return false;
    flash->read(area, at + set_at(flash) + units(flash, head->bytes), &last, sizeof last);
    return last == WHOLE && crc_in_flash(flash, area, at, head) == head->crc;
}

static void clear(esea_store_t *store)
{
    memset(&store->set, 0, sizeof store->set);
}

ESEA_STORE_STATUS esea_store_open(esea_store_t *store, const esea_flash_t *flash, const char *device)
{
    head_t head, newest;
    uint32_t area, slot;

    memset(store, 0, sizeof *store);
    memset(&newest, 0, sizeof newest);
    store->flash = flash;
    store->device = ~crc_over(BLANK, device, strlen(device));
    for (area = 0u; area < ESEA_STORE_AREAS; ++area)
        for (slot = 0u; slot < slots(flash); ++slot)
            if (look(flash, area, slot, &head) &&
                (!store->found || (head.sequence - newest.sequence) - 1u < 0x7FFFFFFFu)) {
                newest = head;
                store->found = true;
                store->area = area;
                store->slot = slot;
            }
    if (!store->found)
        return ESEA_STORE_EMPTY;
    store->sequence = newest.sequence;
    if (newest.layout != ESEA_STORE_LAYOUT || newest.bytes != sizeof store->set) {
        store->slot = slots(flash); /* its slots may lie otherwise: the next goes to the other area */
        return ESEA_STORE_OTHER_LAYOUT;
    }
    if (newest.device != store->device)
        return ESEA_STORE_OTHER_DEVICE;
    flash->read(store->area, store->slot * slot_bytes(flash, newest.bytes) + set_at(flash), &store->set,
            sizeof store->set);
    if (store->set.parameters > ESEA_STORE_PARAMETERS) {
        clear(store);
        return ESEA_STORE_OTHER_LAYOUT;
    }
    return ESEA_STORE_LOADED;
}

static bool blank(const esea_flash_t *flash, uint32_t area, uint32_t slot)
{
    const uint32_t all = slot_bytes(flash, (uint32_t)sizeof(esea_store_set_t));
    uint8_t bytes[CHUNK];
    uint32_t done, n, i;

    for (done = 0u; done < all; done += n) {
        n = all - done < CHUNK ? all - done : CHUNK;
        flash->read(area, slot * all + done, bytes, n);
        for (i = 0u; i < n; ++i)
            if (bytes[i] != 0xFFu)
                return false;
    }
    return true;
}

/* Where the next set goes: behind the newest unless `aside`, or at the start of the other area, which is erased. */
static bool make_room(const esea_store_t *store, bool aside, uint32_t *area, uint32_t *slot)
{
    const uint32_t all = slots(store->flash);

    *area = store->found ? store->area : ESEA_STORE_AREAS - 1u;
    for (*slot = store->found && !aside ? store->slot + 1u : all; *slot < all; ++*slot)
        if (blank(store->flash, *area, *slot))
            return true;
    *area = (*area + 1u) % ESEA_STORE_AREAS;
    *slot = 0u;
    return store->flash->erase(*area) && blank(store->flash, *area, *slot);
}

/* One part of a slot; behind it the last unit is filled up with what an erased one holds. */
static bool put(const esea_flash_t *flash, uint32_t area, uint32_t at, const void *from, uint32_t count)
{
    const uint32_t whole = count & ~(unit_of(flash) - 1u);
    uint8_t unit[ESEA_FLASH_UNIT_MOST];

    if (whole > 0u && !flash->write(area, at, from, whole))
        return false;
    if (whole == count)
        return true;
    memset(unit, 0xFF, sizeof unit);
    memcpy(unit, (const uint8_t *)from + whole, count - whole);
    return flash->write(area, at + whole, unit, unit_of(flash));
}

static bool put_set(const esea_store_t *store, const head_t *head, uint32_t area, uint32_t slot)
{
    static const uint32_t last = WHOLE;
    const esea_flash_t *const flash = store->flash;
    const uint32_t at = slot * slot_bytes(flash, head->bytes), behind = at + set_at(flash);
    head_t written;

    return put(flash, area, at, head, (uint32_t)sizeof *head) && put(flash, area, behind, &store->set, head->bytes) &&
           put(flash, area, behind + units(flash, head->bytes), &last, (uint32_t)sizeof last) &&
           look(flash, area, slot, &written);
}

bool esea_store_commit(esea_store_t *store)
{
    head_t head = { MAGIC, ESEA_STORE_LAYOUT, (uint32_t)sizeof store->set, store->device, store->sequence + 1u, 0u };
    uint32_t area, slot;
    bool good;

    if (store->set.use.saves != UINT32_MAX)
        ++store->set.use.saves;
    head.crc = ~crc_over(crc_of_head(&head), &store->set, sizeof store->set);
    if (slots(store->flash) == 0u || !make_room(store, false, &area, &slot))
        return false;
    good = put_set(store, &head, area, slot);
    /* A unit that a power cut left half written may look erased and take nothing: then the other area. */
    if (!good && slot > 0u)
        good = make_room(store, true, &area, &slot) && put_set(store, &head, area, slot);
    if (!good)
        return false;
    store->status = ESEA_STORE_LOADED; /* what is in memory is the newest set */
    store->found = true;
    store->area = area;
    store->slot = slot;
    store->sequence = head.sequence;
    return true;
}

bool esea_store_save(esea_store_t *store, const esea_store_parameter_t *parameters, uint32_t count)
{
    uint32_t i, k;

    if (count > ESEA_STORE_PARAMETERS)
        return false;
    for (i = 0u; i < count; ++i) {
        if (parameters[i].value - parameters[i].value != 0.0f) /* NaN, infinity */
            return false;
        for (k = 0u; k < i; ++k)
            if (parameters[k].id == parameters[i].id)
                return false;
    }
    memset(store->set.parameter, 0, sizeof store->set.parameter);
    if (count > 0u)
        memcpy(store->set.parameter, parameters, count * sizeof *parameters);
    store->set.parameters = count;
    return esea_store_commit(store);
}

uint32_t esea_store_load(const esea_store_t *store, esea_store_parameter_t *parameters, uint32_t capacity)
{
    const uint32_t count = store->set.parameters < capacity ? store->set.parameters : capacity;

    if (count > 0u)
        memcpy(parameters, store->set.parameter, count * sizeof *parameters);
    return count;
}

const esea_store_encoder_t *esea_store_encoder(const esea_store_t *store, uint32_t serial)
{
    uint32_t i;

    for (i = 0u; i < ESEA_STORE_ENCODERS && serial != 0u; ++i)
        if (store->set.encoder[i].serial == serial)
            return &store->set.encoder[i];
    return NULL;
}

static bool is_fitted(const esea_store_t *store, uint32_t serial)
{
    uint32_t i;

    for (i = 0u; i < ESEA_STORE_ENCODERS; ++i)
        if (store->set.fitted[i] == serial)
            return true;
    return false;
}

bool esea_store_put_encoder(esea_store_t *store, const esea_store_encoder_t *encoder)
{
    uint32_t place = ESEA_STORE_ENCODERS, i;

    if (encoder->serial == 0u || encoder->zero_rad - encoder->zero_rad != 0.0f)
        return false;
    for (i = ESEA_STORE_ENCODERS; i > 0u; --i)
        if (store->set.encoder[i - 1u].serial == 0u)
            place = i - 1u;
    for (i = 0u; i < ESEA_STORE_ENCODERS && place == ESEA_STORE_ENCODERS; ++i)
        if (!is_fitted(store, store->set.encoder[i].serial))
            place = i;
    for (i = ESEA_STORE_ENCODERS; i > 0u; --i) /* the first, which is what is found */
        if (store->set.encoder[i - 1u].serial == encoder->serial)
            place = i - 1u;
    if (place == ESEA_STORE_ENCODERS)
        return false;
    store->set.encoder[place] = *encoder;
    return true;
}

bool esea_store_forget_encoder(esea_store_t *store, uint32_t serial)
{
    bool any = false;
    uint32_t i;

    for (i = 0u; i < ESEA_STORE_ENCODERS && serial != 0u; ++i)
        if (store->set.encoder[i].serial == serial) {
            memset(&store->set.encoder[i], 0, sizeof store->set.encoder[i]);
            any = true;
        }
    return any;
}
