/* Processor functions for the drivers: one struct of functions, so that they run against models of
 * the chips on any computer.  Lines, channels and pins are numbers defined by the board.
 *
 * License: MIT. */
#ifndef ESEA_HARDWARE_H
#define ESEA_HARDWARE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    /* Selects a chip, exchanges bytes with it, lets go of it.  False when the bus does not end in time;
     * it never waits without end. */
    bool (*spi)(uint32_t line, const uint8_t *out, uint8_t *in, size_t count);
    void (*put_pin)(uint32_t pin, bool high);
    bool (*get_pin)(uint32_t pin);
    /* Duty in ten-thousandths of the period. */
    void (*pwm)(uint32_t channel, uint32_t duty);
    /* False when the conversion does not end in time. */
    bool (*adc)(uint32_t channel, uint32_t *counts);
} esea_hardware_t;

/* What an encoder's driver gives: the raw count, and what is wrong with it. */
typedef struct {
    uint32_t count;
    uint32_t frame_error; /* bits below; 0 for a frame that can be believed */
} esea_angle_t;

/* As FrameError in esea_gen/model/encoder.py. */
#define ESEA_FRAME_PARITY 1u     /* parity or CRC does not fit */
#define ESEA_FRAME_ERROR_FLAG 2u /* the chip says that something was wrong */
#define ESEA_FRAME_FIELD_WEAK 4u
#define ESEA_FRAME_FIELD_STRONG 8u
#define ESEA_FRAME_OVERFLOW 16u
#define ESEA_FRAME_NOT_READY 32u /* has not told that it is settled */
#define ESEA_FRAME_NO_ANSWER 64u /* nothing came, or what this chip cannot say */

#endif
