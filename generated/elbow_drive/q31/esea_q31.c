/* Elementary functions of the q31 format; esea_q31.h is the manual.
 *
 * All stand on two cores: log2 of a 32-bit significand and 2^fraction, with the tables and
 * polynomials of the single-precision functions (coefficients.py derives them to 110 digits).  The
 * errors of the cores were measured over every argument there is (tests/test_fixed_functions.py). */
#include "esea_q31.h"

#include "esea_f32_tables.h"

#define HALF_BITS 0x80000000u
#define LN_2_Q32  INT64_C(0xB17217F8)

/* Conversions written so that none is left to the compiler. */
static int32_t as_signed(uint32_t u)
{
    return (int32_t)((int64_t)(u ^ HALF_BITS) - INT64_C(0x80000000));
}

static int32_t high_signed(int32_t a, int32_t b)
{
#ifdef ESEA_Q31_NARROW
    uint32_t low;
    return esea_q31_product(a, b, &low);
#else
    return (int32_t)(((int64_t)a * b) >> 32);
#endif
}

static uint64_t product(uint32_t a, uint32_t b)
{
#ifdef ESEA_Q31_NARROW
    const uint32_t last = (a & 0xFFFFu) * (b & 0xFFFFu);
    const uint32_t first = (a >> 16) * (b & 0xFFFFu) + (last >> 16);
    const uint32_t second = (b >> 16) * (a & 0xFFFFu) + (first & 0xFFFFu);
    const uint32_t high = (a >> 16) * (b >> 16) + (first >> 16) + (second >> 16);
    return ((uint64_t)high << 32) | (second << 16) | (last & 0xFFFFu);
#else
    return (uint64_t)a * b;
#endif
}

/* a b below 2^64, and so is b times the high word of a. */
static uint64_t longer_product(uint64_t a, uint32_t b)
{
#ifdef ESEA_Q31_NARROW
    return ((uint64_t)((uint32_t)(a >> 32) * b) << 32) + product((uint32_t)a, b);
#else
    return a * b;
#endif
}

/* Of a nonzero word. The built-in is one instruction where there is one; a Cortex-M0 would call a
 * library for it. */
#if (defined(__ARM_FEATURE_CLZ) || defined(__x86_64__) || defined(__aarch64__)) &&                 \
    !defined(ESEA_Q31_PORTABLE_CLZ)
static uint32_t leading_zeros(uint32_t u)
{
    return (uint32_t)__builtin_clz(u);
}
#else
static uint32_t leading_zeros(uint32_t u)
{
    uint32_t count = 0u;
    if ((u & 0xFFFF0000u) == 0u) {
        count += 16u;
        u <<= 16;
    }
    if ((u & 0xFF000000u) == 0u) {
        count += 8u;
        u <<= 8;
    }
    if ((u & 0xF0000000u) == 0u) {
        count += 4u;
        u <<= 4;
    }
    if ((u & 0xC0000000u) == 0u) {
        count += 2u;
        u <<= 2;
    }
    return count + ((u & HALF_BITS) == 0u ? 1u : 0u);
}
#endif

static uint32_t leading_zeros_64(uint64_t u)
{
    const uint32_t high = (uint32_t)(u >> 32);
    return high != 0u ? leading_zeros(high) : 32u + leading_zeros((uint32_t)u);
}

/* log2(significand / 2^31) as Q64 modulo one, 2^31 <= significand. */
static uint64_t log2_fraction(uint32_t significand)
{
    const uint64_t row = LOG2_TABLE[(significand >> 25) & 63u];
    const uint64_t scaled = product(significand, (uint32_t)row & 0xFFFu);
    /* Q42 rounded to Q34; the integer part, 2^34, falls off. */
    const int32_t r = as_signed((uint32_t)((scaled + 128u) >> 8));
    int32_t p = LOG2_3;
    p = LOG2_2 + high_signed(r, p);
    p = LOG2_1 + high_signed(r, p);
    p = LOG2_0 + high_signed(r, p);
    return row + (uint64_t)esea_q31_wide(r, p);
}

/* 2^(fraction / 2^32) as Q31, 2^31 <= result < 2^32. */
static uint32_t exp2_fraction(uint32_t fraction)
{
    const int32_t t = as_signed((fraction << 5) ^ HALF_BITS); /* Q37, from the interval's middle */
    const uint32_t middle = EXP2_TABLE[fraction >> 27];
    int32_t p = EXP2_2;
    p = EXP2_1 + high_signed(t, p);
    p = EXP2_0 + high_signed(t, p);
    p = high_signed(t, p); /* Q33 */
    return middle + (uint32_t)high_signed((int32_t)(middle >> 1), p);
}

/* Fraction and whole part of y log2(significand 2^(exponent - 31)). */
static uint32_t scaled_log2(uint32_t significand, int32_t exponent, int32_t y_q27, int32_t *whole)
{
    const uint64_t fraction = log2_fraction(significand);
    /* Signed digits of 32 bits keep every product signed 32 x 32: carry what the lower lacks. */
    const uint32_t high = (uint32_t)(fraction >> 32) + ((uint32_t)fraction >> 31);
    const int64_t sum =
        esea_q31_wide(y_q27, as_signed(high)) + high_signed(y_q27, as_signed((uint32_t)fraction));
    const int64_t z = (sum >> 32) + esea_q31_wide(y_q27, exponent + (int32_t)(high >> 31)); /* Q27 */
    *whole = (int32_t)(z >> 27);
    return ((uint32_t)(uint64_t)z << 5) | ((uint32_t)(uint64_t)sum >> 27);
}

/* m 2^-shift rounded, at most top. */
static int64_t place(uint32_t m, int32_t shift, int64_t top)
{
    int64_t value;
    if (shift > 32) {
        return 0;
    }
    if (shift < -30) {
        return top;
    }
    value = shift > 0 ? (int64_t)(((uint64_t)m + (UINT64_C(1) << (shift - 1))) >> shift)
                      : (int64_t)((uint64_t)m << -shift);
    return value < top ? value : top;
}

int64_t esea_q63_pow(int64_t x, int xf, int32_t y_q27, int f, int64_t top)
{
    uint32_t zeros;
    uint32_t significand;
    int32_t whole;
    uint32_t fraction;
    if (x <= 0) {
        return 0;
    }
    zeros = leading_zeros_64((uint64_t)x);
    /* The bits below the significand are dropped: 2^-31 of x. */
    significand = (uint32_t)(((uint64_t)x << zeros) >> 32);
    fraction = scaled_log2(significand, 63 - (int32_t)zeros - xf, y_q27, &whole);
    return place(exp2_fraction(fraction), 31 - f - whole, top);
}

int32_t esea_q31_pow(int32_t x, int xf, int32_t y_q27, int f, int32_t top)
{
    uint32_t zeros;
    uint32_t m;
    int32_t whole;
    int32_t shift;
    uint32_t value;
    if (x <= 0) {
        return 0;
    }
    zeros = leading_zeros((uint32_t)x);
    m = exp2_fraction(
        scaled_log2((uint32_t)x << zeros, 31 - (int32_t)zeros - xf, y_q27, &whole));
    shift = 31 - f - whole;
    if (shift > 32) {
        return 0;
    }
    if (shift > 31) {
        return top < 1 ? top : 1;
    }
    if (shift < 1) {
        return top;
    }
    value = (m >> shift) + ((m >> (shift - 1)) & 1u);
    return value < (uint32_t)top ? (int32_t)value : top;
}

int64_t esea_q63_exp(int32_t x, int xf, int f, int64_t top)
{
    /* x log2(e), Q(xf + 31), cut to Q32: the table is centred for that. */
    const int64_t z = ((int64_t)x * (int64_t)LOG2_E_HIGH + (((int64_t)x * (int64_t)LOG2_E_LOW) >> 32)) >>
                      (xf - 1);
    const int64_t whole = z >> 32;
    if (whole < -100) {
        return 0;
    }
    if (whole > 100) {
        return top;
    }
    return place(exp2_fraction((uint32_t)(uint64_t)z), 31 - f - (int32_t)whole, top);
}

int64_t esea_q63_log(int64_t x, int xf, int f)
{
    uint32_t zeros;
    uint64_t fraction;
    int64_t exponent;
    int64_t z;
    if (x <= 0) {
        x = 1;
    }
    zeros = leading_zeros_64((uint64_t)x);
    fraction = log2_fraction((uint32_t)(((uint64_t)x << zeros) >> 32));
    exponent = 63 - (int64_t)zeros - xf;
    z = exponent * (INT64_C(1) << 54) + (int64_t)(fraction >> 10); /* log2(x), Q54 */
    z = (z >> 32) * LN_2_Q32 + (((z & INT64_C(0xFFFFFFFF)) * (LN_2_Q32 >> 1)) >> 31); /* Q54 */
    return esea_q63_round(z, 54 - f);
}

int32_t esea_q31_sqrt(int64_t x, int k)
{
    uint64_t rest = x <= 0 ? 0u : k >= 0 ? (uint64_t)x << k : (uint64_t)x >> -k;
    uint64_t root = 0u;
    uint64_t bit = UINT64_C(1) << 60;
    while (bit != 0u) {
        if (rest >= root + bit) {
            rest -= root + bit;
            root = (root >> 1) + bit;
        } else {
            root >>= 1;
        }
        bit >>= 2;
    }
    return root < (uint64_t)INT32_MAX ? (int32_t)root : INT32_MAX;
}

int32_t esea_q31_tanh(int32_t x, int xf)
{
    const int64_t one = INT64_C(1) << 31;
    const int32_t minus = x < 0 ? x : -x;
    const int64_t t = esea_q63_exp(minus, xf - 1, 31, one); /* e^(-2 |x|) */
    const int32_t y = (int32_t)(((one - t) * (INT64_C(1) << 30) + one / 2) / (one + t));
    return x < 0 ? -y : y;
}

/* 2^33 / d as Q49, 2^33 <= d < 2^34. */
static uint64_t reciprocal(uint64_t d)
{
    const uint32_t c = (uint32_t)LOG2_TABLE[(uint32_t)(d >> 27) & 63u] & 0xFFFu;
    const int32_t r = as_signed((uint32_t)(longer_product(d, c) >> 7)); /* Q37 of d c - 1 */
    int32_t p = RECIPROCAL_4;
    uint64_t w;
    p = RECIPROCAL_3 + high_signed(r, p);
    p = RECIPROCAL_2 + high_signed(r, p);
    p = RECIPROCAL_1 + high_signed(r, p);
    p = RECIPROCAL_0 + high_signed(r, p);
    /* 1 - r p = 1 / (1 + r); the offset keeps the shift unsigned. */
    w = (UINT64_C(1) << 63) - (uint64_t)esea_q31_wide(r, p); /* Q67 of -r p, below 2^62 */
    w = (w >> 29) - (UINT64_C(1) << 34) + (UINT64_C(1) << 38);
    return longer_product(w, c);
}

int64_t esea_q63_divide(int64_t n, int64_t d, int k, int64_t low, int64_t high)
{
    const int negative = (n < 0) != (d < 0);
    const uint64_t u = (uint64_t)(n < 0 ? -n : n);
    const uint64_t v = (uint64_t)(d < 0 ? -d : d);
    uint64_t q;
    uint32_t un;
    uint32_t vn;
    int shift;
    int64_t value = 0;
    if (u != 0u && v != 0u) {
        un = leading_zeros_64(u);
        vn = leading_zeros_64(v);
        /* Both to 32 bits: the dividend cut, the divisor's reciprocal rounded. */
        q = longer_product((reciprocal((v << vn) >> 30) + 0x10000u) >> 17, (uint32_t)((u << un) >> 32));
        /* q is above 2^62. */
        shift = 63 + (int)un - (int)vn - k;
        if (shift < 2) {
            value = INT64_MAX;
        } else if (shift < 64) {
            value = (int64_t)((q >> shift) + ((q >> (shift - 1)) & 1u));
        } else if (shift == 64) {
            value = (int64_t)(q >> 63);
        }
    }
    if (negative) {
        value = -value;
    }
    return value < low ? low : value > high ? high : value;
}
