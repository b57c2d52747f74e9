/* C leaves open which zero fmin(0, -0) is, and a compiler that swaps the operands changes it.  CasADi's
 * own C compares instead where there is no C99; so it does here, and so does the f64 format.  For every
 * other pair of numbers both are the same value.  Included before CasADi's C, on the host only. */
#ifndef CASADI_TIES_H
#define CASADI_TIES_H
#include <math.h>

#define fmin(x, y) ((x) < (y) ? (x) : (y))
#define fmax(x, y) ((x) > (y) ? (x) : (y))

#endif
