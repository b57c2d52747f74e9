/* Empty drivers of a board with Linux, whose hardware is read by a separate program (on a myRIO by its FPGA).
 * So every measurement is NaN, which the control code refuses, and the motor cannot be switched
 * on.  A file of this name in its place fills in `sample`, `motor`, `stop_open` and `trouble`.
 *
 * License: MIT. */
#include "port.h"

void esea_board_drivers(esea_port_t *port)
{
    (void)port;
}
