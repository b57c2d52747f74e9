/* The state machine: where an event leads from a state.  esea_gen/emit/states.toml has it as a table.
 *
 * License: MIT. */
#ifndef ESEA_MACHINE_H
#define ESEA_MACHINE_H

#include "states.h"

/* Take an event.  Return false if it is refused; the state then stays.  An unknown state becomes
 * FAULT. */
bool esea_machine_take(ESEA_STATE *state, ESEA_EVENT event, const esea_guards_t *guards);

#endif
