/* Empty drivers of the MPS2.  So every measurement is NaN, which the control code refuses, and the motor's
 * command goes nowhere.
 *
 * License: MIT. */
#include "cortex_m.h"

void esea_board_drivers(esea_port_t *port)
{
    (void)port;
}
