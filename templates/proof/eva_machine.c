/* What the value analysis is asked of the state machine: any number of events, known and unknown, in any order,
 * from any bits in the state, with any guards.  Assumed: the guards are truth values, which C's bool is.
 *
 * License: MIT. */
#include "__fc_builtin.h"

#include <stdint.h>

#include "machine.h"

#define EITHER() (Frama_C_interval(0, 1) != 0)
#define ANY32() Frama_C_unsigned_int_interval(0u, UINT32_MAX)

int main(void)
{
    ESEA_STATE state = (ESEA_STATE)ANY32();

    while (EITHER()) {
        const esea_guards_t guards = {
            .drive = EITHER(), /* assumed */
            .encoders = EITHER(), /* assumed */
            .referenced = EITHER(), /* assumed */
            .stop_clear = EITHER(), /* assumed */
            .link_live = EITHER(), /* assumed */
            .mode_off = EITHER(), /* assumed */
            .released = EITHER(), /* assumed */
            .clearable = EITHER(), /* assumed */
        };

        (void)esea_machine_take(&state, (ESEA_EVENT)ANY32(), &guards);
        /*@ assert state_known: 0 <= state <= 11; */
    }
    return 0;
}
