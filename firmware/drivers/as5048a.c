/* License: MIT. */
#include "as5048a.h"

#include <string.h>

/* Commands to read, with bit 15 for even parity. */
#define ASK_ANGLE 0xFFFFu
#define ASK_MAGNITUDE 0x7FFEu
#define ASK_DIAGNOSTICS 0x7FFDu
#define ASK_CLEAR 0x4001u /* reads the error register, which clears it */

#define ANSWER_ERROR 0x4000u
#define ANSWER_DATA 0x3FFFu
#define GAIN 0xFFu
#define COMPENSATED 0x100u /* "OCF": always set once the chip is ready */
#define CORDIC_OVERFLOW 0x200u
#define TOO_STRONG 0x400u
#define TOO_WEAK 0x800u
#define NEVER_SET 0x3000u

static bool odd(uint32_t word)
{
    word ^= word >> 8;
    word ^= word >> 4;
    word ^= word >> 2;
    word ^= word >> 1;
    return (word & 1u) != 0u;
}

/* Sends a command; brings the answer to the one before. */
static uint32_t exchange(const esea_as5048a_config_t *config, const esea_hardware_t *hardware, uint32_t command,
        uint32_t *answer)
{
    const uint8_t out[2] = { (uint8_t)(command >> 8), (uint8_t)(command & 0xFFu) };
    uint8_t in[2] = { 0u, 0u };

    if (!hardware->spi(config->line, out, in, sizeof in))
        return ESEA_FRAME_NO_ANSWER;
    *answer = (uint32_t)in[0] << 8 | in[1];
    if (*answer == 0xFFFFu)
        return ESEA_FRAME_NO_ANSWER;
    if (odd(*answer))
        return ESEA_FRAME_PARITY;
    return (*answer & ANSWER_ERROR) != 0u ? ESEA_FRAME_ERROR_FLAG : 0u;
}

/* The answer to what the tick before asked last; none of these is ever 0, as a dead bus is. */
static uint32_t take(esea_as5048a_t *sensor, const esea_as5048a_config_t *config, uint32_t wrong, uint32_t answer)
{
    const uint32_t data = answer & ANSWER_DATA;

    if (sensor->asked == 0u)
        return 0u;
    if (sensor->asked == ASK_CLEAR)
        wrong &= ~ESEA_FRAME_ERROR_FLAG; /* still that of before */
    if (wrong == 0u && data == 0u)
        wrong = ESEA_FRAME_NO_ANSWER;
    if (wrong != 0u) {
        if (sensor->asked == ASK_DIAGNOSTICS) { /* nothing is known of the magnet until they come */
            sensor->told = ESEA_FRAME_NOT_READY;
            sensor->magnitude_next = false;
        }
        return wrong;
    }
    if (sensor->asked == ASK_CLEAR) {
        sensor->errors = data;
    } else if (sensor->asked == ASK_MAGNITUDE) {
        sensor->magnitude = data;
        sensor->weak = data < config->magnitude_least;
    } else {
        sensor->gain = data & GAIN;
        sensor->told = ((data & NEVER_SET) != 0u ? ESEA_FRAME_NO_ANSWER : 0u) |
                       ((data & COMPENSATED) == 0u ? ESEA_FRAME_NOT_READY : 0u) |
                       ((data & CORDIC_OVERFLOW) != 0u ? ESEA_FRAME_OVERFLOW : 0u) |
                       ((data & TOO_STRONG) != 0u ? ESEA_FRAME_FIELD_STRONG : 0u) |
                       ((data & TOO_WEAK) != 0u ? ESEA_FRAME_FIELD_WEAK : 0u);
    }
    return 0u;
}

void esea_as5048a_start(esea_as5048a_t *sensor)
{
    memset(sensor, 0, sizeof *sensor);
    sensor->told = ESEA_FRAME_NOT_READY;
}

esea_angle_t esea_as5048a_read(esea_as5048a_t *sensor, const esea_as5048a_config_t *config,
        const esea_hardware_t *hardware)
{
    esea_angle_t angle;
    uint32_t answer = 0u, wrong;

    wrong = exchange(config, hardware, ASK_ANGLE, &answer);
    wrong = take(sensor, config, wrong, answer);

    if (sensor->clear || (wrong & ESEA_FRAME_ERROR_FLAG) != 0u) {
        sensor->asked = ASK_CLEAR;
    } else {
        sensor->asked = sensor->magnitude_next ? ASK_MAGNITUDE : ASK_DIAGNOSTICS;
        sensor->magnitude_next = !sensor->magnitude_next;
    }
    answer = 0u;
    wrong |= exchange(config, hardware, sensor->asked, &answer);
    sensor->clear = sensor->asked != ASK_CLEAR && (wrong & ESEA_FRAME_ERROR_FLAG) != 0u;

    wrong |= sensor->told | (sensor->weak ? ESEA_FRAME_FIELD_WEAK : 0u);
    if (wrong != 0u && sensor->bad != UINT32_MAX)
        ++sensor->bad;
    angle.count = (answer & ANSWER_DATA) >> (14u - config->bits);
    angle.frame_error = wrong;
    return angle;
}
