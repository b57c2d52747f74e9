/* Rainflow counting into the stored use of a coupling; see rainflow.c.
 *
 * License: MIT. */
#ifndef ESEA_RAINFLOW_H
#define ESEA_RAINFLOW_H

#include <stdbool.h>
#include <stdint.h>

#include "store.h"

#define ESEA_LIFE_STEPS 32u /* of a class */
#define ESEA_LIFE_TOP (ESEA_LIFE_CLASSES * ESEA_LIFE_STEPS / 2u) /* steps of the largest deflection */

/* A deflection, at most ESEA_LIFE_TOP steps to either side.  Whether it went on or turned. */
bool esea_rainflow_take(esea_store_life_t *life, int32_t x);

/* Half cycles by class, as if the history ended now. */
void esea_rainflow_halves(const esea_store_life_t *life, uint32_t *halves);

#endif
