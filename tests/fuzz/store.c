/* libFuzzer on the parameter store: any content of the flash is opened without harm, what is saved after it is
 * there, and a power cut at any byte of the next write or erasure leaves that or what was to follow.  Half of
 * the inputs get a checksum that fits, so that what lies behind it is reached.  Small sets make it fast:
 * -DESEA_STORE_PARAMETERS=4u -DESEA_STORE_ENCODERS=2u.
 *
 * License: MIT. */
#include <stdlib.h>
#include <string.h>

#include "store.h"

#define AREA ((uint32_t)(2u * (28u + sizeof(esea_store_set_t)) + 40u)) /* two slots, and a little */

static uint8_t cells[ESEA_STORE_AREAS][AREA];
static uint32_t left; /* bytes that are written, and areas erased, until the power goes */
static uint8_t half;  /* what remains of the byte or the area at which it goes */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void must(bool holds)
{
    if (!holds)
        abort();
}

static void flash_read(uint32_t area, uint32_t at, void *to, size_t count)
{
    must(area < ESEA_STORE_AREAS && at <= AREA && count <= AREA - at);
    memcpy(to, cells[area] + at, count);
}

static bool flash_write(uint32_t area, uint32_t at, const void *from, size_t count)
{
    const uint8_t *bytes = from;
    size_t i;

    must(area < ESEA_STORE_AREAS && at % 4u == 0u && count % 4u == 0u && at <= AREA && count <= AREA - at);
    for (i = 0u; i < count && left > 0u; ++i, --left)
        cells[area][at + i] &= left > 1u ? bytes[i] : bytes[i] | half;
    return left > 0u;
}

static bool flash_erase(uint32_t area)
{
    must(area < ESEA_STORE_AREAS);
    if (left > 0u)
        memset(cells[area], 0xFF, left > 1u ? AREA : AREA * half / 256u);
    left -= left > 0u;
    return left > 0u;
}

/* Bit by bit, not as store.c has it; its branches tell the fuzzer nothing. */
__attribute__((no_sanitize("coverage"))) static uint32_t crc_of(const uint8_t *bytes, size_t count, uint32_t crc)
{
    int bit;

    while (count-- > 0u)
        for (crc ^= *bytes++, bit = 0; bit < 8; ++bit)
            crc = crc >> 1 ^ ((crc & 1u) != 0u ? 0xEDB88320u : 0u);
    return crc;
}

/* Makes the head of area 0 right, for the size that it says; layout, size and device too where `kind` asks. */
static void seal(uint8_t kind)
{
    static const uint32_t magic = 0x45534131u, last = 0x600DC0DEu, layout = ESEA_STORE_LAYOUT;
    static const uint32_t whole = (uint32_t)sizeof(esea_store_set_t);
    const uint32_t device = ~crc_of((const uint8_t *)"elbow_drive", 11u, 0xFFFFFFFFu);
    uint32_t bytes, crc;

    memcpy(cells[0], &magic, sizeof magic);
    if ((kind & 2u) != 0u)
        memcpy(cells[0] + 4, &layout, sizeof layout);
    if ((kind & 4u) != 0u)
        memcpy(cells[0] + 8, &whole, sizeof whole);
    if ((kind & 8u) != 0u)
        memcpy(cells[0] + 12, &device, sizeof device);
    memcpy(&bytes, cells[0] + 8, sizeof bytes);
    if (bytes > AREA - 28u)
        return;
    memcpy(cells[0] + 24u + bytes, &last, sizeof last);
    crc = ~crc_of(cells[0] + 24, bytes, crc_of(cells[0], 20u, 0xFFFFFFFFu));
    memcpy(cells[0] + 20, &crc, sizeof crc);
}

/* What was loaded stands in a slot under a checksum that fits. */
static void check_loaded(const esea_store_t *store)
{
    const uint8_t *const slot = cells[store->area] + store->slot * (28u + sizeof store->set);
    const uint32_t crc = ~crc_of(slot + 24, sizeof store->set, crc_of(slot, 20u, 0xFFFFFFFFu));

    must(memcmp(slot + 20, &crc, sizeof crc) == 0 && memcmp(slot + 24, &store->set, sizeof store->set) == 0);
}

/* Saves other parameters while the power goes: then these stand there, or the ones before. */
static void cut(esea_store_t *store, const esea_flash_t *flash, uint32_t at, const esea_store_parameter_t *before)
{
    static const esea_store_parameter_t after = { 7u, 2.5f };
    esea_store_parameter_t loaded[2];
    esea_store_t again;
    uint32_t i, saves = 1u + at % 3u;
    bool done = true;

    for (i = 1u; i < saves; ++i)
        must(esea_store_save(store, before, 2u)); /* the areas fill, one is erased */
    left = 1u + at / 3u % ((uint32_t)sizeof(esea_store_set_t) + 40u);
    done = esea_store_save(store, &after, 1u);
    left = UINT32_MAX;
    must(esea_store_open(&again, flash, "elbow_drive") == ESEA_STORE_LOADED);
    if (esea_store_load(&again, loaded, 2u) == 1u) {
        must(memcmp(loaded, &after, sizeof after) == 0);
    } else {
        must(!done && again.set.parameters == 2u && memcmp(loaded, before, sizeof loaded) == 0);
    }
}

static void encoders(esea_store_t *store, const uint8_t *data)
{
    const esea_store_encoder_t encoder = { data[0] % 8u, (float)data[1] };
    const bool fitted = esea_store_put_encoder(store, &encoder);
    const esea_store_encoder_t *const found = esea_store_encoder(store, encoder.serial);

    must(fitted ? found != NULL && found->zero_rad == encoder.zero_rad : found == NULL);
    if (data[2] % 4u == 0u) {
        must(esea_store_forget_encoder(store, encoder.serial) == fitted);
        must(esea_store_encoder(store, encoder.serial) == NULL);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const esea_flash_t flash = { AREA, flash_read, flash_write, flash_erase, 4u };
    static const esea_store_parameter_t saved[2] = { { 7u, 0.5f }, { 9u, -1.0f } };
    static esea_store_parameter_t loaded[ESEA_STORE_PARAMETERS];
    static esea_store_t store, again;
    const size_t content = size > 4u ? (size - 4u) / 2u : 0u;

    left = UINT32_MAX;
    memset(cells, 0xFF, sizeof cells);
    if (content > 0u) {
        memcpy(cells[0], data + 4, content < AREA ? content : AREA);
        memcpy(cells[1], data + 4 + content, content < AREA ? content : AREA);
        if ((data[0] & 1u) != 0u)
            seal(data[0]);
        if ((data[0] & 16u) != 0u)
            cells[0][(data[1] + 256u * data[2]) % AREA] ^= data[3];
    }
    store.status = esea_store_open(&store, &flash, "elbow_drive");
    must(store.set.parameters <= ESEA_STORE_PARAMETERS);
    if (store.status == ESEA_STORE_LOADED)
        check_loaded(&store);
    else
        must(store.set.parameters == 0u);
    if (size > 4u)
        encoders(&store, data + 1);
    must(esea_store_save(&store, saved, 2u));
    must(esea_store_open(&again, &flash, "elbow_drive") == ESEA_STORE_LOADED);
    must(esea_store_load(&again, loaded, ESEA_STORE_PARAMETERS) == 2u);
    must(memcmp(loaded, saved, sizeof saved) == 0);
    if (size > 4u) {
        half = data[3];
        cut(&again, &flash, data[1] + 256u * data[2], saved);
    }
    return 0;
}
