/* The motor's drive of a board with Linux: a moteus behind an fdcanusb adapter (a serial port) or SocketCAN.
 *
 * License: MIT. */
#ifndef ESEA_DRIVE_H
#define ESEA_DRIVE_H

#include <stdbool.h>
#include <stdio.h>

#include "port.h"

/* Opens the drive, checks its settings and fills in the port's drivers; `rotor_side`: there is no encoder on the motor
 * side of the coupling.  False, with the reason and the remedy on standard error: not to be used. */
bool drive_open(esea_port_t *port, const char *address, bool rotor_side);

/* What the drive has told last, and what was lost. */
void drive_print(FILE *to);

#endif
