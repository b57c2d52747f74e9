/* Fixed-point arithmetic of the q31 format: the same bits on every processor and compiler.
 *
 * A value is a whole number of units of 2^-f; f, its format, is fixed when the code is generated and
 * written beside every field.  q31 values are 32 bits wide, q63 values 64; which value has which is
 * the range plan's choice (docs/fixed-point.md).
 *
 * Rounding: to the nearest unit, half a unit upwards (towards +infinity); quotients as their
 * function says.  Overflow: none of these functions checks; the generator has shown, by
 * interval arithmetic on whole numbers, that no argument it passes can overflow, whatever bit
 * pattern stands in an input or a state.  Saturation: only where it is written in the code.
 *
 * Needs two's complement, 32-bit int, and a right shift that keeps the sign (every compiler for
 * every processor this is for; the typedef below refuses any other).  Re-entrant, no state, no heap,
 * no float operation.  A Cortex-M0 calls the compiler's integer helpers for 64-bit products and shifts,
 * a Cortex-M3 only for the quotient in the hyperbolic tangent. */
#ifndef ESEA_Q31_H
#define ESEA_Q31_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef char esea_q31_needs_a_shift_that_keeps_the_sign[((-3) >> 1) == -2 ? 1 : -1];

/* Bit ``at`` of a status word, where it is set. */
static inline uint32_t esea_bit(bool set, uint32_t at)
{
    return set ? ((uint32_t)1 << at) : (uint32_t)0;
}

/* x / 2^s rounded, 1 <= s <= 31. */
static inline int32_t esea_q31_round(int32_t x, int s)
{
    return (x >> s) + ((x >> (s - 1)) & 1);
}

/* x / 2^s rounded, 1 <= s <= 62; x + 2^(s - 1) must fit. */
static inline int64_t esea_q63_round(int64_t x, int s)
{
    return (x + (INT64_C(1) << (s - 1))) >> s;
}

/* Cores that multiply 32 by 32 bits to 32 only: a 64-bit product would be a call of the library,
 * which multiplies 64 by 64. */
#if defined(__ARM_ARCH_6M__) && !defined(ESEA_Q31_NARROW)
#define ESEA_Q31_NARROW
#endif

#ifdef ESEA_Q31_NARROW
/* High word of a b, and the low one: four products of 16 bits; nothing overflows 32. */
static inline int32_t esea_q31_product(int32_t a, int32_t b, uint32_t *low)
{
    const uint32_t last = ((uint32_t)a & 0xFFFFu) * ((uint32_t)b & 0xFFFFu);
    const int32_t first = (a >> 16) * (int32_t)((uint32_t)b & 0xFFFFu) + (int32_t)(last >> 16);
    const int32_t second = (b >> 16) * (int32_t)((uint32_t)a & 0xFFFFu) + (first & 0xFFFF);
    *low = ((uint32_t)second << 16) | (last & 0xFFFFu);
    return (a >> 16) * (b >> 16) + (first >> 16) + (second >> 16);
}

static inline int64_t esea_q31_wide(int32_t a, int32_t b)
{
    uint32_t low;
    const int32_t high = esea_q31_product(a, b, &low);
    return high * (INT64_C(1) << 32) + low;
}

/* a b / 2^s rounded, 1 <= s <= 62. */
static inline int32_t esea_q31_mul(int32_t a, int32_t b, int s)
{
    uint32_t low, half;
    int32_t high = esea_q31_product(a, b, &low);
    if (s > 32)
        return (high + (1 << (s - 33))) >> (s - 32);
    half = UINT32_C(1) << (s - 1);
    high += (low > UINT32_MAX - half) ? 1 : 0;
    low += half;
    if (s == 32)
        return high;
    if (s == 1)
        return (int32_t)((high * (INT64_C(1) << 32) + low) >> 1);
    return high * (int32_t)(UINT32_C(1) << (32 - s)) + (int32_t)(low >> s);
}
#else
static inline int64_t esea_q31_wide(int32_t a, int32_t b) { return (int64_t)a * b; }

/* a b / 2^s rounded, 1 <= s <= 62. */
static inline int32_t esea_q31_mul(int32_t a, int32_t b, int s)
{
    return (int32_t)(((int64_t)a * b + (INT64_C(1) << (s - 1))) >> s);
}
#endif

/* a b / 2^s rounded, 1 <= s <= 94; the result must fit. */
static inline int64_t esea_q63_mul_q31(int64_t a, int32_t b, int s)
{
    const int64_t high = (a >> 32) * b;
    const int64_t low = (a & INT64_C(0xFFFFFFFF)) * b;
    if (s <= 32)
        return high * (INT64_C(1) << (32 - s)) + ((low + (INT64_C(1) << (s - 1))) >> s);
    return (high + (low >> 32) + (INT64_C(1) << (s - 33))) >> (s - 32);
}

/* a b / 2^s rounded, 33 <= s <= 126 but not 64; |a|, |b| < 2^62, the result must fit. */
static inline int64_t esea_q63_mul(int64_t a, int64_t b, int s)
{
    const int64_t a1 = a >> 32, a0 = a & INT64_C(0xFFFFFFFF);
    const int64_t b1 = b >> 32, b0 = b & INT64_C(0xFFFFFFFF);
    const uint64_t last = (uint64_t)a0 * (uint64_t)b0;
    const int64_t first = a1 * b0 + (int64_t)(last >> 32);
    const int64_t second = a0 * b1 + (first & INT64_C(0xFFFFFFFF));
    const int64_t high = a1 * b1 + (first >> 32) + (second >> 32);
    if (s < 64) {
        const uint64_t low = ((uint64_t)(second & INT64_C(0xFFFFFFFF)) << 32) | (last & 0xFFFFFFFFu);
        return high * (INT64_C(1) << (64 - s)) + (int64_t)((low >> s) + ((low >> (s - 1)) & 1u));
    }
    return (high + (INT64_C(1) << (s - 65))) >> (s - 64);
}

static inline int32_t esea_q31_min(int32_t x, int32_t y) { return y < x ? y : x; }
static inline int32_t esea_q31_max(int32_t x, int32_t y) { return y > x ? y : x; }
static inline int64_t esea_q63_min(int64_t x, int64_t y) { return y < x ? y : x; }
static inline int64_t esea_q63_max(int64_t x, int64_t y) { return y > x ? y : x; }
static inline int32_t esea_q31_abs(int32_t x) { return x < 0 ? -x : x; }
static inline int64_t esea_q63_abs(int64_t x) { return x < 0 ? -x : x; }

/* The nearest of 32 bits, on the way into a field's format.  Where a port feeds another, the end lies
 * outside the port's range, so that what does not fit is an invalid input. */
static inline int32_t esea_q31_saturate(int64_t x)
{
    return x > INT32_MAX ? INT32_MAX : x < INT32_MIN ? INT32_MIN : (int32_t)x;
}

/* n 2^k / d, cut to [low, high]; d is not 0, n and d are not INT64_MIN, -127 <= k <= 127.
 * Error: 2^-30 of the result, and half a unit. */
int64_t esea_q63_divide(int64_t n, int64_t d, int k, int64_t low, int64_t high);

/* x^y in units of 2^-f, at most top; x >= 0 in units of 2^-xf, y in units of 2^-27, above 0 where x
 * can be 0.  Error: below 2^-30 of the result for |y| <= 4, and half a unit; y is off by 2^-28. */
int64_t esea_q63_pow(int64_t x, int xf, int32_t y_q27, int f, int64_t top);
int32_t esea_q31_pow(int32_t x, int xf, int32_t y_q27, int f, int32_t top);

/* e^x in units of 2^-f, at most top; x in units of 2^-xf, 1 <= xf <= 62.
 * Error: below 2^-30 of the result, and half a unit. */
int64_t esea_q63_exp(int32_t x, int xf, int f, int64_t top);

/* Natural logarithm of x > 0 in units of 2^-f, f <= 52; x in units of 2^-xf.
 * Error: below 2^-32 of log2(x), 2^-33, and half a unit. */
int64_t esea_q63_log(int64_t x, int xf, int f);

/* Square root of x 2^k, 0 <= x 2^k < 2^62, rounded down: error below one unit. */
int32_t esea_q31_sqrt(int64_t x, int k);

/* Hyperbolic tangent in units of 2^-30; x in units of 2^-xf, 2 <= xf <= 62.  Error: 2^-28. */
int32_t esea_q31_tanh(int32_t x, int xf);

/* For hosts with double; of the emitted files only the example uses them.  n is the number of fraction
 * bits, 0 to 31.  A number that does not fit, and NaN, becomes INT32_MIN, which no port takes as
 * valid. */
#define ESEA_Q31_UNITS(n)   ((double)(INT64_C(1) << (n)))
#define ESEA_Q31_TO(raw, n) ((double)(raw) / ESEA_Q31_UNITS(n))
#define ESEA_Q31_FROM(x, n)                                                                        \
    ((x) * ESEA_Q31_UNITS(n) < 2147483647.0 && (x) * ESEA_Q31_UNITS(n) > -2147483647.0             \
         ? (int32_t)((x) * ESEA_Q31_UNITS(n) + ((x) < 0 ? -0.5 : 0.5))                              \
         : INT32_MIN)

#ifdef __cplusplus
}
#endif

#endif
