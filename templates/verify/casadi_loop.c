/* A whole stream through one of CasADi's own functions, for the host: what Python would do step by
 * step.  Compiled beside CasADi's C, never shipped.
 *
 * `arguments` and `results` point to cells that the caller holds: coefficients, then state, then
 * inputs; next state, then outputs.  Only the state and the inputs are written here.  `in`, `out`
 * and `trace` hold one row a step, ports one after the other. */
#include <stddef.h>
#include <string.h>

typedef int (*step_t)(const double **, double **, int *, double *, int);

void esea_casadi_run(step_t step, const double **arguments, double **results, int *iw, double *w,
        double *state, const double *next, size_t states, double *input, size_t inputs,
        const double *output, size_t outputs, const double *in, double *out, double *trace,
        size_t steps)
{
    size_t k;
    for (k = 0; k < steps; ++k) {
        memcpy(input, in + k * inputs, inputs * sizeof *input);
        step(arguments, results, iw, w, 0);
        memcpy(state, next, states * sizeof *state);
        memcpy(trace + k * states, next, states * sizeof *next);
        memcpy(out + k * outputs, output, outputs * sizeof *output);
    }
}
