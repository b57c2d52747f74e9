/* License: MIT. */
#include "biss.h"

#include <string.h>

#define CRC_BITS 6u
#define CRC_POLYNOMIAL 0x43u /* x^6 + x + 1 */

typedef struct {
    const uint8_t *bytes;
    uint32_t at, end; /* bits */
} reader_t;

static uint32_t peek(const reader_t *reader, uint32_t at)
{
    return (uint32_t)reader->bytes[at / 8u] >> (7u - at % 8u) & 1u;
}

/* Passes over bits of a value; false when nothing else follows. */
static bool pass(reader_t *reader, uint32_t value)
{
    while (reader->at < reader->end && peek(reader, reader->at) == value)
        ++reader->at;
    return reader->at < reader->end;
}

static uint32_t take(reader_t *reader, uint32_t bits)
{
    uint32_t value = 0u;

    for (; bits > 0u; --bits)
        value = value << 1 | peek(reader, reader->at++);
    return value;
}

/* Remainder over position and the two bits after it, inverted as it is sent. */
static uint32_t crc_of(reader_t reader, uint32_t bits)
{
    uint32_t crc = 0u;

    for (; bits > 0u; --bits) {
        crc = crc << 1 ^ peek(&reader, reader.at++) << CRC_BITS;
        if ((crc & 1u << CRC_BITS) != 0u)
            crc ^= CRC_POLYNOMIAL;
    }
    return ~crc & ((1u << CRC_BITS) - 1u);
}

static uint32_t parse(esea_biss_t *sensor, const esea_biss_config_t *config, reader_t *reader, uint32_t *position)
{
    uint32_t expected, good, warned;

    /* The line rests high, falls while the encoder converts, rises for the start bit. */
    if (!pass(reader, 1u) || !pass(reader, 0u))
        return ESEA_FRAME_NO_ANSWER;
    reader->at += 2u; /* the start, and a bit of the bus's own registers */
    if (reader->at + config->position_bits + 2u + CRC_BITS > reader->end)
        return ESEA_FRAME_NO_ANSWER;
    expected = crc_of(*reader, config->position_bits + 2u);
    *position = take(reader, config->position_bits);
    good = take(reader, 1u);
    warned = take(reader, 1u) ^ 1u; /* both bits are 0 when they have something to say */
    if (take(reader, CRC_BITS) != expected)
        return ESEA_FRAME_PARITY;
    if (warned != 0u && sensor->warnings != UINT32_MAX)
        ++sensor->warnings;
    return good != 0u ? 0u : ESEA_FRAME_ERROR_FLAG;
}

esea_angle_t esea_biss_read(esea_biss_t *sensor, const esea_biss_config_t *config,
        const esea_hardware_t *hardware)
{
    uint8_t out[ESEA_BISS_BYTES_MOST], in[ESEA_BISS_BYTES_MOST];
    reader_t reader = { in, 0u, 8u * config->bytes };
    esea_angle_t angle = { 0u, ESEA_FRAME_NO_ANSWER };
    uint32_t position = 0u;

    memset(out, 0, sizeof out);
    memset(in, 0, sizeof in);
    if (hardware->spi(config->line, out, in, config->bytes))
        angle.frame_error = parse(sensor, config, &reader, &position);
    angle.count = position >> (config->position_bits - config->bits);
    if (angle.frame_error != 0u && sensor->bad != UINT32_MAX)
        ++sensor->bad;
    return angle;
}
