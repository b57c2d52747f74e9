/* Further drivers beside the program's own: empty, unless a file of this name replaces it.
 *
 * License: MIT. */
#include "port.h"

void esea_board_drivers(esea_port_t *port)
{
    (void)port;
}
