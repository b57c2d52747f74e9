/* Elementary functions in single precision: the same bits on every processor, compiler and
 * optimisation level.
 *
 * Why: libraries differ in the last bits, so a controller tested on a PC with its libm is not the
 * one on the board. These functions use no float operation at all: they take a float apart, compute
 * in 32 and 64-bit integers and round once. Contraction to fused multiply-add, excess precision,
 * flush-to-zero and rounding modes therefore change nothing.
 *
 * Defined for every bit pattern, subnormal arguments and results included. A NaN argument gives
 * NaN, except where IEEE 754 defines a number (pow(x, 0) = pow(1, y) = 1); every NaN returned is
 * 0x7FC00000. No floating-point exception flag is raised and errno is left alone.
 *
 * Re-entrant: no state, no heap, no table in RAM. No loops: the time varies only by branches. Needs
 * no library where the processor multiplies 32 x 32 to 64 bits (Cortex-M3 and up, Cortex-A); on a
 * Cortex-M0 the compiler's integer helpers __aeabi_lmul, __aeabi_llsl and __aeabi_llsr.
 *
 * "Error" is the largest distance to the exact result in units in the last place (ULP) over the
 * stated domain; 0.5 is the least possible. "Cost" is instructions from entry to return on a
 * Cortex-M4F, GCC 12.2 -O2, the most over a dozen ordinary arguments, counted in an emulator:
 * instructions, neither time nor cycles. */
#ifndef ESEA_F32_H
#define ESEA_F32_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* x to a constant power; y_q27 is the exponent in units of 2^-27, -16 <= y < 16. An integer,
 * because an exponent rounded to float would alone cost up to 7 ULP. The integer is itself off by
 * up to 2^-28, which costs 0.043 ULP for each factor of 2 that x is away from 1.
 * Domain: x >= 0, and -0 counts as 0; negative x gives NaN. powk(0, y) and powk(inf, y) are 0 or
 * inf by the sign of y; powk(x, 0) = 1 for every x, NaN included.
 * For y >= 0.05 the result never decreases as x increases: one step of x then moves the exact
 * result further than twice what the error exceeds one half.
 * Error: esea_f32_powk 0.51 ULP of the power with the exponent as given. Cost: 69 instructions. */
float esea_f32_powk(float x, int32_t y_q27);

/* x to the power y for |y| < 16, as in IEEE 754: negative x needs an integer y, whose parity gives
 * the sign.
 * Beyond: |y| >= 16 gives NaN, unless IEEE 754 has an answer without computing (x is 0, +-1 or
 * infinite, or y is infinite). The limit is where log2(x) would need more bits to keep this error.
 * Error: esea_f32_pow 0.51 ULP. Cost: 138 instructions. */
float esea_f32_pow(float x, float y);

/* e to the x. Infinity above 88.72283, zero below -103.97208.
 * Error: esea_f32_exp 0.51 ULP. Cost: 69 instructions. */
float esea_f32_exp(float x);

/* e to the x, less 1, with full relative accuracy around 0 and -0 for -0; -1 below -17.33.
 * Error: esea_f32_expm1 0.52 ULP. Cost: 96 instructions. */
float esea_f32_expm1(float x);

/* Natural logarithm, with full relative accuracy around 1. log(+-0) = -inf; negative x gives NaN.
 * Error: esea_f32_log 0.51 ULP. Cost: 113 instructions. */
float esea_f32_log(float x);

/* Natural logarithm of 1 + x, with full relative accuracy around 0. log1p(-1) = -inf; NaN below.
 * Error: esea_f32_log1p 0.51 ULP. Cost: 133 instructions. */
float esea_f32_log1p(float x);

/* Hyperbolic tangent; odd, never beyond +-1.
 * Error: esea_f32_tanh 0.52 ULP. Cost: 141 instructions. */
float esea_f32_tanh(float x);

/* Real cube root; odd.
 * Error: esea_f32_cbrt 0.51 ULP. Cost: 81 instructions. */
float esea_f32_cbrt(float x);

/* Square root, correctly rounded: the bits of a hardware square root. sqrt(-0) = -0; negative x
 * gives NaN. Error: esea_f32_sqrt 0.5 ULP. Cost: 56 instructions. */
float esea_f32_sqrt(float x);

/* Sine and cosine of x_rad, for every finite argument: the reduction carries 2/pi to 256 bits, so a
 * large argument is as accurate as a small one. Infinity gives NaN. Error: esea_f32_sin 0.51 ULP.
 * Cost: 131 instructions. */
float esea_f32_sin(float x_rad);

/* See esea_f32_sin.
 * Error: esea_f32_cos 0.51 ULP. Cost: 128 instructions. */
float esea_f32_cos(float x_rad);

/* Angle of the point (x, y) in rad, -pi to pi; signed zeros and infinities as in C99 annex F.
 * Error: esea_f32_atan2 0.52 ULP. Cost: 192 instructions. */
float esea_f32_atan2(float y, float x);

#ifdef __cplusplus
}
#endif

#endif
