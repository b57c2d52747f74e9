/* Single-precision numbers in units to raw numbers and back, for the edge of a q31 program: its link,
 * its log.  The control code itself computes in whole numbers only.  On a processor without an FPU
 * each of these calls the compiler's helpers, some hundred instructions.
 *
 * n is the number of fraction bits, 0 to 31.  Both scalings are exact.  Into raw numbers: to the
 * nearest, half away from zero, as ESEA_Q31_FROM; a number that does not fit, and NaN, becomes
 * INT32_MIN, which no port takes as valid.  Back: to the nearest float, which has 24 bits. */
#ifndef ESEA_Q31_UNITS_H
#define ESEA_Q31_UNITS_H

#include <stdint.h>

static inline int32_t esea_q31_from_float(float x, int n)
{
    const float y = x * (float)(UINT32_C(1) << n);
    int32_t whole;
    float rest;

    if (!(y < 2147483648.0f && y > -2147483648.0f))
        return INT32_MIN;
    whole = (int32_t)y;
    rest = y - (float)whole; /* exact, for the whole part has no more bits than y */
    return whole + (rest >= 0.5f) - (rest <= -0.5f);
}

static inline float esea_q31_to_float(int32_t raw, int n)
{
    return (float)raw * (1.0f / (float)(UINT32_C(1) << n));
}

#endif
