/* Drivers beside those that the program plays: none, unless a file of this name takes its place.
 *
 * License: MIT. */
#include "port.h"

void esea_board_drivers(esea_port_t *port)
{
    (void)port;
}
