/* AS5048A by SPI: 14 bits a turn.  An answer comes one frame after its question, so each tick has two
 * frames: the first asks for the angle and brings what the tick before asked last; the second brings the
 * angle and asks for diagnostics and magnitude in turn, or clears an error.
 *
 * Detected: a stuck bus, a frame of wrong parity or an error flag, in the tick; the chip's report on its
 * magnet, within 3 ticks.  A frame with an even number of wrong bits is not detected.
 *
 * License: MIT. */
#ifndef ESEA_AS5048A_H
#define ESEA_AS5048A_H

#include "hardware.h"

typedef struct {
    uint32_t line;            /* of the bus */
    uint32_t bits;            /* of the count that is given, 8 to 14: the lowest are dropped */
    uint32_t magnitude_least; /* below: the magnet is too weak */
} esea_as5048a_config_t;

typedef struct {
    uint32_t asked; /* the command whose answer comes next; 0: none that is known */
    bool magnitude_next, clear;
    bool weak;        /* of the last magnitude */
    uint32_t told;    /* by the last diagnostics, as bits of a frame error */
    /* For those who look after the machine. */
    uint32_t gain, magnitude; /* gain: 0 for a strong magnet, 255 for a weak one */
    uint32_t errors;          /* of the last clearing: 1 framing, 2 command, 4 parity */
    uint32_t bad;             /* ticks without an angle to believe; stays at its maximum */
} esea_as5048a_t;

void esea_as5048a_start(esea_as5048a_t *sensor);

/* Once a tick. */
esea_angle_t esea_as5048a_read(esea_as5048a_t *sensor, const esea_as5048a_config_t *config,
        const esea_hardware_t *hardware);

#endif
