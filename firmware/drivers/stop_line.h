/* Emergency stop, a contact that is normally closed and pulls its pin high.  Open, a broken wire too, is
 * stop at once; closed counts after a while without bounce.
 *
 * License: MIT. */
#ifndef ESEA_STOP_LINE_H
#define ESEA_STOP_LINE_H

#include "hardware.h"

typedef struct {
    uint32_t pin;
    uint32_t closed_ticks; /* that it must be closed in a row */
} esea_stop_line_config_t;

typedef struct {
    uint32_t closed;
} esea_stop_line_t;

/* Once a tick. */
void esea_stop_line_look(esea_stop_line_t *line, const esea_stop_line_config_t *config,
        const esea_hardware_t *hardware);

/* At any time; looks at the pin again. */
bool esea_stop_line_open(const esea_stop_line_t *line, const esea_stop_line_config_t *config,
        const esea_hardware_t *hardware);

#endif
