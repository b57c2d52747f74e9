/* What the value analysis is asked of the store: every function, any number of times in any order, over a flash
 * that gives any bytes at each reading and fails when it likes.  A flash of two slots and a little more; what is
 * asked outside an area breaks an assertion.  In three parts, of which one takes the next by its contract:
 * all that others may call; with ESEA_EVA_SLOT what reads a slot, for each of them; with ESEA_EVA_SUM the sum of
 * what stands in flash, for every length that leaves room for the last word.
 *
 * License: MIT. */
#include "__fc_builtin.h"

#ifndef ESEA_EVA_UNIT
#define ESEA_EVA_UNIT 4u
#endif
/* As store.c should have it, not taken from there; the contracts name these. */
#define UNITS(bytes) (((uint32_t)(bytes) + ESEA_EVA_UNIT - 1u) / ESEA_EVA_UNIT * ESEA_EVA_UNIT)
#define SET_AT UNITS(sizeof(head_t))
#define SLOT_BYTES (SET_AT + UNITS(sizeof(esea_store_set_t)) + UNITS(sizeof(uint32_t)))
#define AREA (2u * SLOT_BYTES + 40u)

#include "store.c"

#define ANY(x) Frama_C_make_unknown((char *)&(x), sizeof(x))
#define EITHER() (Frama_C_interval(0, 1) != 0)
#define ANY32() Frama_C_unsigned_int_interval(0u, UINT32_MAX)

static void flash_read(uint32_t area, uint32_t at, void *to, size_t count)
{
    /*@ assert read_inside: area < 2 && at <= AREA && count <= AREA - at; */
    Frama_C_make_unknown(to, count);
}

static bool flash_write(uint32_t area, uint32_t at, const void *from, size_t count)
{
    /*@ assert write_inside: area < 2 && at <= AREA && count <= AREA - at; */
    /*@ assert whole_units: at % ESEA_EVA_UNIT == 0 && count % ESEA_EVA_UNIT == 0; */
    /*@ assert written_there: \valid_read((char const *)from + (0 .. count - 1)); */
    (void)from;
    return EITHER();
}

static bool flash_erase(uint32_t area)
{
    /*@ assert area_there: area < 2; */
    (void)area;
    return EITHER();
}

static const esea_flash_t flash = { AREA, flash_read, flash_write, flash_erase, ESEA_EVA_UNIT };

#ifdef ESEA_EVA_SUM
int main(void)
{
    head_t head;
    uint32_t slot;

    ANY(head);
    /*@ loop unroll 2; */
    for (slot = 0u; slot < 2u; ++slot)
        /*@ loop unroll 4000; */
        for (head.bytes = 0u; slot * SLOT_BYTES + SET_AT + head.bytes + 4u <= AREA; ++head.bytes)
            (void)crc_in_flash(&flash, (uint32_t)Frama_C_interval(0, 1), slot * SLOT_BYTES, &head);
    return 0;
}
#elif defined(ESEA_EVA_SLOT)
int main(void)
{
    static esea_store_set_t set;
    uint8_t bytes[CHUNK];
    uint32_t area, slot, n;
    head_t head;

    ANY(set);
    ANY(bytes);
    /*@ loop unroll 65; */
    for (n = 0u; n <= CHUNK; ++n)
        (void)crc_over(ANY32(), bytes, n);
    (void)crc_over(ANY32(), &set, sizeof set);
    /*@ loop unroll 2; */
    for (area = 0u; area < 2u; ++area)
        /*@ loop unroll 2; */
        for (slot = 0u; slot < 2u; ++slot) {
            (void)look(&flash, area, slot, &head);
            (void)blank(&flash, area, slot);
        }
    return 0;
}
#else
int main(void)
{
    static esea_store_t store; /* opened before all else, as start.c does */
    esea_store_parameter_t parameters[ESEA_STORE_PARAMETERS];
    esea_store_encoder_t encoder;

    store.status = esea_store_open(&store, &flash, "elbow_drive");
    while (EITHER()) {
        const uint32_t capacity = Frama_C_unsigned_int_interval(0u, ESEA_STORE_PARAMETERS); /* assumed */

        ANY(parameters);
        ANY(encoder);
        ANY(store.set.encoder); /* what keep.c writes itself */
        ANY(store.set.fitted);
        ANY(store.set.use);
        ANY(store.set.key);
        switch (Frama_C_interval(0, 6)) {
        case 0:
            store.status = esea_store_open(&store, &flash, "elbow_drive");
            break;
        case 1:
            (void)esea_store_commit(&store);
            break;
        case 2:
            (void)esea_store_save(&store, parameters, ANY32());
            break;
        case 3:
            (void)esea_store_load(&store, parameters, capacity);
            break;
        case 4:
            (void)esea_store_put_encoder(&store, &encoder);
            break;
        case 5:
            (void)esea_store_forget_encoder(&store, ANY32());
            break;
        default:
            (void)esea_store_encoder(&store, ANY32());
            break;
        }
        /*@ assert parameters_fit: store.set.parameters <= ESEA_STORE_PARAMETERS; */
    }
    return 0;
}
#endif
