/* License: MIT. */
#include "stop_line.h"

void esea_stop_line_look(esea_stop_line_t *line, const esea_stop_line_config_t *config,
        const esea_hardware_t *hardware)
{
    if (!hardware->get_pin(config->pin))
        line->closed = 0u;
    else if (line->closed < config->closed_ticks)
        ++line->closed;
}

bool esea_stop_line_open(const esea_stop_line_t *line, const esea_stop_line_config_t *config,
        const esea_hardware_t *hardware)
{
    return line->closed < config->closed_ticks || !hardware->get_pin(config->pin);
}
