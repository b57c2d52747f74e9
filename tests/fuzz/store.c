/* libFuzzer on the parameter store: any content of the flash is opened without harm, and what is saved
 * after it is there.  Half of the inputs get a checksum that fits, so that what lies behind it is reached.
 *
 *   clang -g -O1 -fsanitize=fuzzer,address,undefined -Ifirmware/port -Ifirmware/app tests/fuzz/store.c \
 *       firmware/app/store.c -o /tmp/fuzz_store && /tmp/fuzz_store -max_len=6100 -max_total_time=60
 *
 * License: MIT. */
#include <stdlib.h>
#include <string.h>

#include "store.h"

#define AREA 6016u /* two sets, and a little */

static uint8_t cells[ESEA_STORE_AREAS][AREA];

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
    for (i = 0u; i < count; ++i)
        cells[area][at + i] &= bytes[i];
    return true;
}

static bool flash_erase(uint32_t area)
{
    must(area < ESEA_STORE_AREAS);
    memset(cells[area], 0xFF, AREA);
    return true;
}

/* Bit by bit, not as store.c has it. */
static uint32_t crc_of(const uint8_t *bytes, size_t count, uint32_t crc)
{
    int bit;

    while (count-- > 0u)
        for (crc ^= *bytes++, bit = 0; bit < 8; ++bit)
            crc = crc >> 1 ^ ((crc & 1u) != 0u ? 0xEDB88320u : 0u);
    return crc;
}

/* Makes the head of area 0 right, for the size that it says. */
static void seal(void)
{
    static const uint32_t magic = 0x45534131u, last = 0x600DC0DEu;
    uint32_t bytes, crc;

    memcpy(cells[0], &magic, sizeof magic);
    memcpy(&bytes, cells[0] + 8, sizeof bytes);
    if (bytes > AREA - 28u)
        return;
    memcpy(cells[0] + 24u + bytes, &last, sizeof last);
    crc = ~crc_of(cells[0] + 24, bytes, crc_of(cells[0], 20u, 0xFFFFFFFFu));
    memcpy(cells[0] + 20, &crc, sizeof crc);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const esea_flash_t flash = { AREA, flash_read, flash_write, flash_erase };
    static const esea_store_parameter_t saved[2] = { { 7u, 0.5f }, { 9u, -1.0f } };
    static esea_store_parameter_t loaded[ESEA_STORE_PARAMETERS];
    static esea_store_t store, again;
    const size_t half = size / 2u < AREA ? size / 2u : AREA;

    memset(cells, 0xFF, sizeof cells);
    if (size > 1u) {
        memcpy(cells[0], data + 1, half > 0u ? half - 1u : 0u);
        memcpy(cells[1], data + half, half);
        if ((data[0] & 1u) != 0u)
            seal();
    }
    store.status = esea_store_open(&store, &flash, "elbow_drive");
    must(esea_store_load(&store, loaded, ESEA_STORE_PARAMETERS) <= ESEA_STORE_PARAMETERS);
    (void)esea_store_encoder(&store, 4711u);
    must(store.status == ESEA_STORE_LOADED || store.set.parameters == 0u);
    must(esea_store_save(&store, saved, 2u));
    must(esea_store_open(&again, &flash, "elbow_drive") == ESEA_STORE_LOADED);
    must(esea_store_load(&again, loaded, ESEA_STORE_PARAMETERS) == 2u);
    must(memcmp(loaded, saved, sizeof saved) == 0);
    return 0;
}
