/* BiSS-C, point to point, sensor mode: an absolute encoder of 8 to 24 bits with error and warning bit and
 * a CRC of six bits, clocked by an SPI whose clock rests high.
 *
 * Chosen beside the AS5048A, not quadrature with index: it is absolute within a turn at power-up, so that
 * nothing need move a limb to find an index, and a frame carries its own check; a lost quadrature edge
 * shows only at the next index.
 *
 * Found in the tick: a stuck bus, up to two wrong bits, any burst of up to six; of other corrupt frames
 * one in 64 passes.
 *
 * License: MIT. */
#ifndef ESEA_BISS_H
#define ESEA_BISS_H

#include "hardware.h"

#define ESEA_BISS_BYTES_MOST 16u

typedef struct {
    uint32_t line;          /* of the bus */
    uint32_t position_bits; /* that the encoder sends */
    uint32_t bits;          /* of the count that is given: the lowest are dropped */
    uint32_t bytes;         /* to be clocked: waiting, position and 10 bits more must fit */
} esea_biss_config_t;

typedef struct {
    uint32_t warnings; /* frames with the warning bit; stays at its maximum, as the next */
    uint32_t bad;      /* frames that were not to be believed */
} esea_biss_t;

/* Once a tick. */
esea_angle_t esea_biss_read(esea_biss_t *sensor, const esea_biss_config_t *config,
        const esea_hardware_t *hardware);

#endif
