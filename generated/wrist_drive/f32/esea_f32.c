/* Elementary functions in integer arithmetic; esea_f32.h is the manual, coefficients.py derives the
 * constants.
 *
 * Qn counts units of 2^-n. A float is taken apart into sign, exponent and significand, the value is
 * carried in 32 and 64-bit integers with a few guard bits, and one rounding at the end puts the
 * float together. No float operation occurs, so neither contraction nor excess precision nor a
 * rounding mode can change a bit. */
#include "esea_f32.h"

#include "esea_f32_tables.h"

#define SIGN_BIT         0x80000000u
#define INFINITY_BITS    0x7F800000u
#define NAN_BITS         0x7FC00000u
#define ONE_BITS         0x3F800000u
#define HIDDEN_BIT       0x00800000u
#define SIGNIFICAND_MASK 0x007FFFFFu

/* A union and not memcpy: a freestanding build would call the function, in the hottest place there
 * is. C99 defines the reading, and GCC and Clang define it for C++ as well. */
typedef union {
    float value;
    uint32_t bits;
} float_bits_t;

static uint32_t to_bits(float x)
{
    float_bits_t both;
    both.value = x;
    return both.bits;
}

static float from_bits(uint32_t bits)
{
    float_bits_t both;
    both.bits = bits;
    return both.value;
}

/* Two's complement reading of an unsigned word; compilers reduce it to nothing, and unlike a cast
 * it is defined. */
static int32_t as_signed(uint32_t u)
{
    return u <= 0x7FFFFFFFu ? (int32_t)u : -(int32_t)(0xFFFFFFFFu - u) - 1;
}

static int64_t as_signed_64(uint64_t u)
{
    return u <= (UINT64_MAX >> 1) ? (int64_t)u : -(int64_t)(UINT64_MAX - u) - 1;
}

/* High word of the signed product, rounded down: one SMMUL on a Cortex-M4. */
static int32_t high_signed(int32_t a, int32_t b)
{
    return as_signed((uint32_t)((uint64_t)((int64_t)a * b) >> 32));
}

static uint32_t high_unsigned(uint32_t a, uint32_t b)
{
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

/* High half of the 128-bit product; up to two units small because the lowest partial product is
 * left out. */
static uint64_t high_unsigned_64(uint64_t a, uint64_t b)
{
    const uint32_t a1 = (uint32_t)(a >> 32);
    const uint32_t a0 = (uint32_t)a;
    const uint32_t b1 = (uint32_t)(b >> 32);
    const uint32_t b0 = (uint32_t)b;
    return (uint64_t)a1 * b1 + high_unsigned(a1, b0) + high_unsigned(a0, b1);
}

/* Of a nonzero word. The built-in is one instruction where there is one; a Cortex-M0 would call a
 * library for it. */
#if (defined(__ARM_FEATURE_CLZ) || defined(__x86_64__) || defined(__aarch64__)) &&                 \
    !defined(ESEA_F32_PORTABLE_CLZ)
static uint32_t leading_zeros(uint32_t u)
{
    return (uint32_t)__builtin_clz(u);
}
#else
static uint32_t leading_zeros(uint32_t u)
{
    uint32_t count = 0;
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
    return count + ((u & SIGN_BIT) == 0u ? 1u : 0u);
}
#endif

static uint32_t leading_zeros_64(uint64_t u)
{
    const uint32_t high = (uint32_t)(u >> 32);
    return high != 0u ? leading_zeros(high) : 32u + leading_zeros((uint32_t)u);
}

/* Positive finite nonzero bits to value = significand * 2^(exponent - 23), 2^23 <= significand <
 * 2^24. */
static uint32_t take_apart(uint32_t bits, int32_t *exponent)
{
    uint32_t significand = bits;
    *exponent = (int32_t)(bits >> 23) - 127;
    if (bits < HIDDEN_BIT) {
        const uint32_t shift = leading_zeros(bits) - 8u;
        significand <<= shift;
        *exponent = -126 - (int32_t)shift;
    }
    return (significand & SIGNIFICAND_MASK) | HIDDEN_BIT;
}

/* Bits of m * 2^(exponent - 31) outside the normal range, 2^31 <= m < 2^32. */
static uint32_t round_extreme(int32_t exponent, uint32_t m)
{
    uint32_t shift;
    if (exponent > 127) {
        return INFINITY_BITS;
    }
    if (exponent < -150) {
        return 0u;
    }
    shift = (uint32_t)(-118 - exponent);
    return (uint32_t)(((uint64_t)m + (UINT64_C(1) << (shift - 1u))) >> shift);
}

/* Bits of v * 2^exponent rounded once. A significand that rounds up to 2 carries into the exponent
 * as it should. */
static uint32_t round_64(uint64_t v, int32_t exponent)
{
    uint32_t zeros;
    int32_t normal;
    if (v == 0u) {
        return 0u;
    }
    zeros = leading_zeros_64(v);
    v <<= zeros;
    normal = exponent + 63 - (int32_t)zeros;
    if (normal > 127) {
        return INFINITY_BITS;
    }
    if (normal >= -126) {
        return ((uint32_t)(normal + 126) << 23) + (uint32_t)(v >> 40) + (uint32_t)((v >> 39) & 1u);
    }
    if (normal < -150) {
        return 0u;
    }
    v >>= (uint32_t)(-87 - normal); /* 40 - 1 - 126 - normal: leaves one bit below the last */
    return (uint32_t)((v + 1u) >> 1);
}

/* log2(significand / 2^23) as Q64 modulo one, error about 2^-36.
 * The short reciprocal makes significand * reciprocal - 1 exact in 32 bits: the integer part, 2^34,
 * falls off. The reciprocal's bits stay in the sum as noise of 2^-52. */
static uint64_t log2_fraction(uint32_t significand)
{
    const uint64_t row = LOG2_TABLE[(significand >> 17) & 63u];
    const int32_t r = as_signed(significand * ((uint32_t)row & 0xFFFu)); /* Q34 */
    int32_t p = LOG2_3;
    p = LOG2_2 + high_signed(r, p);
    p = LOG2_1 + high_signed(r, p);
    p = LOG2_0 + high_signed(r, p);
    return row + (uint64_t)((int64_t)r * p);
}

/* 2^(fraction / 2^32) as Q31, 2^31 <= result < 2^32. */
static uint32_t exp2_fraction(uint32_t fraction)
{
    /* Q37, from the middle of the interval. */
    const int32_t t = as_signed((fraction << 5) ^ SIGN_BIT);
    const uint32_t middle = EXP2_TABLE[fraction >> 27];
    int32_t p = EXP2_2;
    p = EXP2_1 + high_signed(t, p);
    p = EXP2_0 + high_signed(t, p);
    p = high_signed(t, p); /* Q33 */
    return middle + (uint32_t)high_signed((int32_t)(middle >> 1), p);
}

/* y * log2(x) as two's complement Q59: upper part, Q27, returned, the low 32 bits in *low. */
static int64_t scaled_log2(uint32_t significand, int32_t exponent, int32_t y_q27, uint32_t *low)
{
    const uint64_t fraction = log2_fraction(significand);
    /* Signed digits of 32 bits keep every product signed 32 x 32: carry what the lower lacks. */
    const uint32_t high = (uint32_t)(fraction >> 32) + ((uint32_t)fraction >> 31);
    const int32_t whole = exponent + (int32_t)(high >> 31);
    int64_t sum = (int64_t)y_q27 * as_signed(high);
    sum += high_signed(y_q27, as_signed((uint32_t)fraction));
    *low = (uint32_t)sum;
    return (int64_t)as_signed((uint32_t)((uint64_t)sum >> 32)) + (int64_t)y_q27 * whole;
}

/* Zero, infinity, negative, NaN. */
static uint32_t powk_special(uint32_t bits, int32_t y_q27)
{
    if (y_q27 == 0) {
        return ONE_BITS;
    }
    if (bits == 0u || bits == SIGN_BIT) {
        return y_q27 > 0 ? 0u : INFINITY_BITS;
    }
    if (bits == INFINITY_BITS) {
        return y_q27 > 0 ? INFINITY_BITS : 0u;
    }
    return NAN_BITS;
}

float esea_f32_powk(float x, int32_t y_q27)
{
    uint32_t bits = to_bits(x);
    int32_t exponent = -127;
    uint32_t low;
    uint32_t fraction;
    uint32_t m;
    int64_t z;
    if (bits - HIDDEN_BIT >= INFINITY_BITS - HIDDEN_BIT) {
        uint32_t shift;
        if (bits - 1u >= HIDDEN_BIT - 1u) {
            return from_bits(powk_special(bits, y_q27));
        }
        shift = leading_zeros(bits) - 8u;
        bits <<= shift;
        exponent -= (int32_t)shift;
    }
    exponent += (int32_t)(bits >> 23);
    z = scaled_log2((bits & SIGNIFICAND_MASK) | HIDDEN_BIT, exponent, y_q27, &low);
    fraction = ((uint32_t)(uint64_t)z << 5) | (low >> 27);
    exponent = as_signed((uint32_t)((uint64_t)z >> 27));
    m = exp2_fraction(fraction);
    if ((uint32_t)exponent + 126u >= 254u) {
        return from_bits(round_extreme(exponent, m));
    }
    return from_bits((((uint32_t)exponent + 126u) << 23) + (m >> 8) + ((m >> 7) & 1u));
}

/* Bits of 2^(z / 2^55), z from -2^63 to 2^63 given with 2^63 added. */
static uint32_t exp2_biased(uint64_t z_biased)
{
    const int32_t exponent = (int32_t)(z_biased >> 55) - 256;
    const uint32_t m = exp2_fraction((uint32_t)(z_biased >> 23));
    if ((uint32_t)exponent + 126u >= 254u) {
        return round_extreme(exponent, m);
    }
    return (((uint32_t)exponent + 126u) << 23) + (m >> 8) + ((m >> 7) & 1u);
}

/* 0: not an integer, 1: odd, 2: even; for 0 < |y| < 2^24. */
static uint32_t integer_kind(uint32_t y_magnitude)
{
    const uint32_t biased = y_magnitude >> 23;
    const uint32_t significand = (y_magnitude & SIGNIFICAND_MASK) | HIDDEN_BIT;
    uint32_t unit;
    if (biased < 127u) {
        return 0u;
    }
    unit = HIDDEN_BIT >> (biased - 127u);
    if ((significand & (unit - 1u)) != 0u) {
        return 0u;
    }
    return (significand & unit) != 0u ? 1u : 2u;
}

float esea_f32_pow(float x, float y)
{
    const uint32_t x_bits = to_bits(x);
    const uint32_t y_bits = to_bits(y);
    const uint32_t y_magnitude = y_bits & ~SIGN_BIT;
    const int y_negative = (y_bits & SIGN_BIT) != 0u;
    uint32_t magnitude = x_bits & ~SIGN_BIT;
    uint32_t sign = 0u;
    int32_t exponent;
    int32_t y_exponent;
    int32_t y_significand;
    uint32_t significand;
    uint32_t low;
    uint32_t shift;
    uint64_t z;
    if (y_magnitude == 0u || x_bits == ONE_BITS) {
        return from_bits(ONE_BITS);
    }
    if (magnitude > INFINITY_BITS || y_magnitude > INFINITY_BITS) {
        return from_bits(NAN_BITS);
    }
    if ((x_bits & SIGN_BIT) != 0u) {
        /* From 2^24 on every float is an even integer, infinity included. */
        const uint32_t kind = y_magnitude < 0x4B800000u ? integer_kind(y_magnitude) : 2u;
        if (kind == 1u) {
            sign = SIGN_BIT;
        }
        if (magnitude == ONE_BITS && kind != 0u) {
            return from_bits(sign | ONE_BITS);
        }
        if (kind == 0u && magnitude != 0u && magnitude != INFINITY_BITS) {
            return from_bits(NAN_BITS);
        }
    }
    if (magnitude == 0u) {
        return from_bits(sign | (y_negative ? INFINITY_BITS : 0u));
    }
    if (magnitude == INFINITY_BITS) {
        return from_bits(sign | (y_negative ? 0u : INFINITY_BITS));
    }
    if (y_magnitude == INFINITY_BITS) {
        return from_bits((magnitude > ONE_BITS) == !y_negative ? INFINITY_BITS : 0u);
    }
    if (y_magnitude >= 0x41800000u) {
        return from_bits(NAN_BITS);
    }
    significand = take_apart(magnitude, &exponent);
    /* All 24 bits of y take part, however small it is: multiply as if 8 <= |y| < 16, then shift. */
    y_significand = (int32_t)(take_apart(y_magnitude, &y_exponent) << 7);
    z = (uint64_t)scaled_log2(significand, exponent, y_negative ? -y_significand : y_significand,
                              &low);
    shift = (uint32_t)(3 - y_exponent);
    if (shift > 40u) {
        return from_bits(sign | ONE_BITS);
    }
    /* Q27 and 32 more bits to Q51 with an offset of 2^12 that keeps the shift unsigned. */
    z = (z << 24) + (low >> 8) + (UINT64_C(1) << 63);
    z = (z >> shift) - (UINT64_C(1) << (63u - shift));
    if (as_signed_64(z) >= (int64_t)256 << 51 || as_signed_64(z) < -((int64_t)256 << 51)) {
        return from_bits(sign | ((z >> 63) != 0u ? 0u : INFINITY_BITS));
    }
    return from_bits(sign | exp2_biased((z << 4) + (UINT64_C(1) << 63)));
}

/* |x| log2(e) as Q55, 2^-32 <= |x| < 128. */
static uint64_t times_log2_e(uint32_t magnitude)
{
    int32_t exponent;
    const uint32_t significand = take_apart(magnitude, &exponent) << 8;
    const uint64_t product =
        (uint64_t)significand * LOG2_E_HIGH + high_unsigned(significand, LOG2_E_LOW); /* Q62 */
    return product >> (uint32_t)(7 - exponent);
}

float esea_f32_exp(float x)
{
    const uint32_t bits = to_bits(x);
    const uint32_t magnitude = bits & ~SIGN_BIT;
    const uint64_t zero = UINT64_C(1) << 63;
    uint64_t z;
    if (magnitude >= 0x43000000u) { /* 128 */
        if (magnitude > INFINITY_BITS) {
            return from_bits(NAN_BITS);
        }
        return from_bits((bits & SIGN_BIT) != 0u ? 0u : INFINITY_BITS);
    }
    if (magnitude < 0x32000000u) { /* 2^-27 */
        return from_bits(ONE_BITS);
    }
    z = times_log2_e(magnitude);
    return from_bits(exp2_biased((bits & SIGN_BIT) != 0u ? zero - z : zero + z));
}

/* Positive float below one as Q32; below 2^-33 nothing is left. */
static uint32_t to_q32(uint32_t significand, int32_t exponent)
{
    const int32_t shift = -9 - exponent; /* Q(23 - exponent) to Q32 */
    if (shift <= 0) {
        return significand << (uint32_t)(-shift);
    }
    return shift < 24 ? significand >> (uint32_t)shift : 0u;
}

float esea_f32_expm1(float x)
{
    const uint32_t bits = to_bits(x);
    const uint32_t sign = bits & SIGN_BIT;
    const uint32_t magnitude = bits & ~SIGN_BIT;
    int32_t exponent;
    uint64_t z;
    uint64_t v;
    uint32_t m;
    if (magnitude <
        0x3F000000u) { /* 1/2: x (1 + x/2 + ...), relative accuracy however small x is */
        uint32_t significand;
        int32_t t;
        int32_t p = EXPM1_6;
        if (magnitude < 0x30000000u) { /* 2^-31 */
            return x;
        }
        significand = take_apart(magnitude, &exponent);
        t = (int32_t)to_q32(significand, exponent);
        if (sign != 0u) {
            t = -t;
        }
        p = EXPM1_5 + high_signed(t, p);
        p = EXPM1_4 + high_signed(t, p);
        p = EXPM1_3 + high_signed(t, p);
        p = EXPM1_2 + high_signed(t, p);
        p = EXPM1_1 + high_signed(t, p);
        p = EXPM1_0 + high_signed(t, p);
        /* t p is Q63 and below 0.3; 1 + t p as Q39 leaves room for the 24 bits of x. */
        v = (UINT64_C(1) << 63) + (uint64_t)((int64_t)t * p);
        return from_bits(sign | round_64((v >> 24) * significand, exponent - 62));
    }
    if (magnitude >= 0x43000000u) {
        if (magnitude > INFINITY_BITS) {
            return from_bits(NAN_BITS);
        }
        return from_bits(sign != 0u ? SIGN_BIT | ONE_BITS : INFINITY_BITS);
    }
    z = times_log2_e(magnitude);
    if (sign != 0u) {
        z = (UINT64_C(1) << 63) - z;
        exponent = 256 - (int32_t)(z >> 55); /* at least 1 */
        m = exp2_fraction((uint32_t)(z >> 23));
        if (exponent > 60) {
            return from_bits(SIGN_BIT | ONE_BITS);
        }
        v = (UINT64_C(1) << 63) - (((uint64_t)m << 32) >> (uint32_t)exponent);
        return from_bits(SIGN_BIT | round_64(v, -63));
    }
    exponent = (int32_t)(z >> 55);
    m = exp2_fraction((uint32_t)(z >> 23));
    v = (uint64_t)m << 31; /* Q62 */
    if (exponent <= 62) {
        v -= UINT64_C(1) << (uint32_t)(62 - exponent);
    }
    return from_bits(round_64(v, exponent - 62));
}

/* log(2^exponent d / 2^33) as two's complement Q56; 1 <= d / 2^33 < 2. */
static uint64_t log_q56(uint64_t d, int32_t exponent)
{
    const uint32_t index = (uint32_t)(d >> 27) & 63u;
    const uint64_t row = LOG2_TABLE[index];
    const uint64_t product = d * ((uint32_t)row & 0xFFFu); /* Q44 */
    const int32_t r = as_signed((uint32_t)(product >> 7)); /* Q37 */
    const int32_t whole =
        exponent + (int32_t)((index + 1u) >> 6); /* the last row's one is stored as zero */
    int32_t p = LOG_3;
    uint64_t sum;
    p = LOG_2 + high_signed(r, p);
    p = LOG_1 + high_signed(r, p);
    p = LOG_0 + high_signed(r, p);
    p = high_signed(r, p); /* Q36; log(1 + r) = r + r p */
    sum = (uint64_t)((int64_t)r * p) + (UINT64_C(1) << 63);
    sum = (sum >> 17) - (UINT64_C(1) << 46);
    /* Around an argument of 1 everything below is exactly zero but r, which therefore keeps its
     * relative accuracy. */
    sum += (product << 12) - (UINT64_C(1) << 56);
    sum += (uint64_t)(whole * LN_2_Q56);
    return sum + (high_unsigned_64(row & ~UINT64_C(0xFFF), LN_2_Q64) >> 8);
}

static float round_log(uint64_t sum)
{
    if ((sum >> 63) != 0u) {
        return from_bits(SIGN_BIT | round_64(0u - sum, -56));
    }
    return from_bits(round_64(sum, -56));
}

float esea_f32_log(float x)
{
    const uint32_t bits = to_bits(x);
    int32_t exponent;
    uint32_t significand;
    if (bits - 1u >= INFINITY_BITS - 1u) {
        if ((bits & ~SIGN_BIT) == 0u) {
            return from_bits(SIGN_BIT | INFINITY_BITS);
        }
        return from_bits(bits == INFINITY_BITS ? INFINITY_BITS : NAN_BITS);
    }
    significand = take_apart(bits, &exponent);
    return round_log(log_q56((uint64_t)significand << 10, exponent));
}

float esea_f32_log1p(float x)
{
    const uint32_t bits = to_bits(x);
    const uint32_t sign = bits & SIGN_BIT;
    const uint32_t magnitude = bits & ~SIGN_BIT;
    int32_t exponent;
    uint32_t significand;
    uint64_t d;
    if (magnitude < 0x30000000u) { /* 2^-31 */
        return x;
    }
    if (magnitude >= INFINITY_BITS || (sign != 0u && magnitude >= ONE_BITS)) {
        if (bits == (SIGN_BIT | ONE_BITS)) {
            return from_bits(SIGN_BIT | INFINITY_BITS);
        }
        return from_bits(bits == INFINITY_BITS ? INFINITY_BITS : NAN_BITS);
    }
    significand = take_apart(magnitude, &exponent);
    if (exponent < -7) { /* x (1 + p(x)): 1 + x would lose the end of x */
        int32_t r = (int32_t)((significand << 7) >> (uint32_t)(-7 - exponent)); /* Q37 */
        int32_t p = LOG_3;
        if (sign != 0u) {
            r = -r;
        }
        p = LOG_2 + high_signed(r, p);
        p = LOG_1 + high_signed(r, p);
        p = LOG_0 + high_signed(r, p);
        p = high_signed(r, p); /* Q36 */
        d = (UINT64_C(1) << 39) + (uint64_t)((int64_t)p * 8);
        return from_bits(sign | round_64(d * significand, exponent - 62));
    }
    /* 1 + x, exact from 2^-10 to 2^10 and better than 2^-33 beyond. */
    if (exponent >= 0) {
        d = (uint64_t)significand << 10;
        d += exponent <= 33 ? UINT64_C(1) << (uint32_t)(33 - exponent) : 0u;
        if (d >= UINT64_C(1) << 34) {
            d >>= 1;
            exponent += 1;
        }
    } else {
        const uint64_t part = ((uint64_t)significand << 10) >> (uint32_t)(-exponent);
        uint32_t zeros = 0u;
        d = UINT64_C(1) << 33;
        if (sign != 0u) {
            d -= part;
            zeros = leading_zeros_64(d) - 30u;
            d <<= zeros;
        } else {
            d += part;
        }
        exponent = -(int32_t)zeros;
    }
    return round_log(log_q56(d, exponent));
}

/* 2^33 / d as Q49, 1 <= d / 2^33 < 2. */
static uint64_t reciprocal(uint64_t d)
{
    const uint32_t c = (uint32_t)LOG2_TABLE[(uint32_t)(d >> 27) & 63u] & 0xFFFu;
    const int32_t r = as_signed((uint32_t)((d * c) >> 7)); /* Q37 of d c - 1 */
    int32_t p = RECIPROCAL_4;
    uint64_t w;
    p = RECIPROCAL_3 + high_signed(r, p);
    p = RECIPROCAL_2 + high_signed(r, p);
    p = RECIPROCAL_1 + high_signed(r, p);
    p = RECIPROCAL_0 + high_signed(r, p);
    /* 1 - r p = 1 / (1 + r); the offset keeps the shift unsigned. */
    w = (UINT64_C(1) << 63) - (uint64_t)((int64_t)r * p); /* Q67 of -r p, below 2^62 */
    w = (w >> 29) - (UINT64_C(1) << 34) + (UINT64_C(1) << 38);
    return w * c;
}

float esea_f32_tanh(float x)
{
    const uint32_t bits = to_bits(x);
    const uint32_t sign = bits & SIGN_BIT;
    const uint32_t magnitude = bits & ~SIGN_BIT;
    int32_t exponent;
    uint32_t m;
    uint32_t shift;
    uint64_t z;
    uint64_t ratio;
    if (magnitude < 0x3F000000u) { /* 1/2: x (1 - x^2 (1/3 - ...)) */
        uint32_t significand;
        uint32_t t;
        uint32_t s;
        uint32_t p = TANH_5;
        if (magnitude < 0x37000000u) { /* 2^-17 */
            return x;
        }
        significand = take_apart(magnitude, &exponent);
        t = to_q32(significand, exponent);
        s = high_unsigned(t, t);
        p = TANH_4 - high_unsigned(s, p);
        p = TANH_3 - high_unsigned(s, p);
        p = TANH_2 - high_unsigned(s, p);
        p = TANH_1 - high_unsigned(s, p);
        p = TANH_0 - high_unsigned(s, p);
        p = (uint32_t)(((uint64_t)s * p) >> 29); /* Q35, below 0.09 */
        return from_bits(sign | round_64((UINT64_C(0x800000000) - p) * significand, exponent - 58));
    }
    if (magnitude > INFINITY_BITS) {
        return from_bits(NAN_BITS);
    }
    if (magnitude >= 0x41200000u) { /* 10 */
        return from_bits(sign | ONE_BITS);
    }
    /* 1 - 2 u / (1 + u), u = exp(-2 |x|) = m 2^(-31 - shift), shift >= 2 */
    z = (UINT64_C(1) << 63) - 2u * times_log2_e(magnitude);
    shift = 256u - (uint32_t)(z >> 55);
    m = exp2_fraction((uint32_t)(z >> 23));
    ratio = reciprocal((UINT64_C(1) << 33) + (m >> (shift - 2u)));
    ratio = ((ratio >> 17) * m) >> (shift - 1u); /* Q63 of the fraction */
    return from_bits(sign | round_64((UINT64_C(1) << 63) - ratio, -63));
}

float esea_f32_cbrt(float x)
{
    const uint32_t bits = to_bits(x);
    const uint32_t magnitude = bits & ~SIGN_BIT;
    int32_t exponent;
    uint32_t significand;
    uint32_t third;
    uint32_t rest;
    uint64_t fraction;
    uint32_t m;
    if (magnitude == 0u || magnitude == INFINITY_BITS) {
        return x;
    }
    if (magnitude > INFINITY_BITS) {
        return from_bits(NAN_BITS);
    }
    significand = take_apart(magnitude, &exponent);
    /* log2 = 3 third + rest + fraction; multiplying by 21846 / 65536 divides numbers this small
     * without a library. */
    rest = (uint32_t)(exponent + 300);
    third = (rest * 21846u) >> 16;
    rest -= 3u * third;
    fraction = high_unsigned_64(((uint64_t)rest << 62) + (log2_fraction(significand) >> 2),
                                UINT64_C(0xAAAAAAAAAAAAAAAB));
    m = exp2_fraction((uint32_t)(fraction >> 31));
    return from_bits((bits & SIGN_BIT) | (((third + 26u) << 23) + (m >> 8) + ((m >> 7) & 1u)));
}

float esea_f32_sqrt(float x)
{
    const uint32_t bits = to_bits(x);
    int32_t exponent;
    uint32_t significand;
    uint32_t a;
    uint32_t seed;
    uint32_t y;
    uint32_t s;
    uint32_t rest;
    uint64_t square;
    if (bits - 1u >= INFINITY_BITS - 1u) {
        return (bits & ~SIGN_BIT) == 0u || bits == INFINITY_BITS ? x : from_bits(NAN_BITS);
    }
    significand = take_apart(bits, &exponent);
    exponent += 256;
    a = significand << (7u + ((uint32_t)exponent & 1u)); /* Q30, 1 <= a < 4 */
    /* Two Newton steps for y = 1 / sqrt(a). The exact step ends below the root; its inner
     * truncations, less than two units, are taken off so that y and s are never too large and every
     * remainder is positive. */
    seed = ROOT_TABLE[(a >> 26) - 16u];
    y = (uint32_t)(((uint64_t)seed * (0xC0000000u - high_unsigned(a, seed * seed))) >>
                   16); /* Q31 */
    y = (uint32_t)(((uint64_t)y * (0x2FFFFFFEu - high_unsigned(a, high_unsigned(y, y)))) >>
                   29);                      /* Q31 */
    s = (uint32_t)(((uint64_t)a * y) >> 38); /* Q23 */
    square = (uint64_t)a << 16;              /* Q46 */
    rest = (uint32_t)(square - (uint64_t)s * s);
    s += (uint32_t)(((uint64_t)rest * y) >> 55);
    /* The remainder decides the last bit and the rounding: nothing here is approximate. */
    rest = (uint32_t)(square - (uint64_t)s * s);
    if (rest > 2u * s) {
        rest -= 2u * s + 1u;
        s += 1u;
    }
    if (rest > s) {
        s += 1u;
    }
    return from_bits((((uint32_t)exponent / 2u - 2u) << 23) + s);
}

/* |x| / (pi/2) modulo 4 as Q62, 2^-15 <= |x| < infinity: a window of 96 bits of 2/pi, whose earlier
 * bits would only add multiples of four. */
static uint64_t quarter_turns(uint32_t magnitude)
{
    int32_t exponent;
    const uint32_t significand = take_apart(magnitude, &exponent);
    const uint32_t start = (uint32_t)(exponent + 39);
    const uint32_t *word = &TWO_OVER_PI[start >> 5];
    const uint32_t left = start & 31u;
    const uint32_t w2 = (uint32_t)(((((uint64_t)word[0] << 32) | word[1]) << left) >> 32);
    const uint32_t w1 = (uint32_t)(((((uint64_t)word[1] << 32) | word[2]) << left) >> 32);
    const uint32_t w0 = (uint32_t)(((((uint64_t)word[2] << 32) | word[3]) << left) >> 32);
    return ((uint64_t)(significand * w2) << 32) + (uint64_t)significand * w1 +
           high_unsigned(significand, w0);
}

/* Bits of sin((turns + quadrants) pi/2), turns as Q62 modulo 4. */
static uint32_t sine_bits(uint64_t turns, uint32_t quadrants)
{
    const uint32_t nearest = (uint32_t)((turns + (UINT64_C(1) << 61)) >> 62);
    const uint32_t quadrant = nearest + quadrants;
    uint32_t sign = (quadrant & 2u) << 30;
    uint64_t f = turns - ((uint64_t)nearest << 62);
    uint32_t s;
    uint32_t p;
    if ((f >> 63) != 0u) {
        f = 0u - f;
        sign ^= (quadrant & 1u) != 0u ? 0u : SIGN_BIT;
    }
    s = (uint32_t)(f >> 30);
    s = high_unsigned(s, s);
    if ((quadrant & 1u) != 0u) {
        p = COS_3 - high_unsigned(s, COS_4);
        p = COS_2 - high_unsigned(s, p);
        p = COS_1 - high_unsigned(s, p);
        p = COS_0 - high_unsigned(s, p);
        return sign | round_64((UINT64_C(1) << 63) - (uint64_t)s * p, -63);
    }
    p = SIN_3 - high_unsigned(s, SIN_4);
    p = SIN_2 - high_unsigned(s, p);
    p = SIN_1 - high_unsigned(s, p);
    p = SIN_0 - (uint32_t)(((uint64_t)s * p) >> 33);
    s = leading_zeros_64(f);
    f = ((f << s) >> 32) * p;
    return sign | round_64(f, -61 - (int32_t)s);
}

float esea_f32_sin(float x)
{
    const uint32_t bits = to_bits(x);
    const uint32_t magnitude = bits & ~SIGN_BIT;
    if (magnitude < 0x38000000u) { /* 2^-15 */
        return x;
    }
    if (magnitude >= INFINITY_BITS) {
        return from_bits(NAN_BITS);
    }
    return from_bits((bits & SIGN_BIT) ^ sine_bits(quarter_turns(magnitude), 0u));
}

float esea_f32_cos(float x)
{
    const uint32_t magnitude = to_bits(x) & ~SIGN_BIT;
    if (magnitude < 0x38000000u) {
        return from_bits(ONE_BITS);
    }
    if (magnitude >= INFINITY_BITS) {
        return from_bits(NAN_BITS);
    }
    return from_bits(sine_bits(quarter_turns(magnitude), 1u));
}

/* atan(low / high) for 0 < low <= high, finite: result / 2^(63 + *halvings). */
static uint64_t arc(uint32_t low, uint32_t high, uint32_t *halvings)
{
    int32_t low_exponent;
    int32_t high_exponent;
    const uint64_t low_significand = take_apart(low, &low_exponent);
    const uint64_t high_significand = take_apart(high, &high_exponent);
    const uint32_t k = (uint32_t)(high_exponent - low_exponent);
    const uint64_t t =
        low_significand * (reciprocal(high_significand << 10) >> 9); /* Q63 of the ratio 2^k */
    uint64_t wide;
    uint32_t s;
    uint32_t p = ATAN_11;
    *halvings = k;
    if (k > 17u) {
        return t;
    }
    wide = t >> (31u + k);
    s = wide > 0xFFFFFFFFu ? 0xFFFFFFFFu : (uint32_t)wide;
    s = high_unsigned(s, s);
    p = ATAN_10 - high_unsigned(s, p);
    p = ATAN_9 - high_unsigned(s, p);
    p = ATAN_8 - high_unsigned(s, p);
    p = ATAN_7 - high_unsigned(s, p);
    p = ATAN_6 - high_unsigned(s, p);
    p = ATAN_5 - high_unsigned(s, p);
    p = ATAN_4 - high_unsigned(s, p);
    p = ATAN_3 - high_unsigned(s, p);
    p = ATAN_2 - high_unsigned(s, p);
    p = ATAN_1 - high_unsigned(s, p);
    p = ATAN_0 - high_unsigned(s, p);
    p = high_unsigned(s, p);
    return t - ((t >> 32) * p + high_unsigned((uint32_t)t, p));
}

float esea_f32_atan2(float y, float x)
{
    const uint32_t sign = to_bits(y) & SIGN_BIT;
    const uint32_t y_magnitude = to_bits(y) & ~SIGN_BIT;
    const uint32_t x_magnitude = to_bits(x) & ~SIGN_BIT;
    const int backward = (to_bits(x) & SIGN_BIT) != 0u;
    uint32_t k = 0u;
    uint64_t a = 0u; /* angle to the nearer axis, Q(63 + k) */
    if (y_magnitude > INFINITY_BITS || x_magnitude > INFINITY_BITS) {
        return from_bits(NAN_BITS);
    }
    if (y_magnitude == x_magnitude && y_magnitude != 0u) {
        a = PI_Q61; /* pi/4 as Q63, infinities included */
    } else if (y_magnitude < x_magnitude) {
        if (y_magnitude != 0u && x_magnitude != INFINITY_BITS) {
            a = arc(y_magnitude, x_magnitude, &k);
        }
    } else if (x_magnitude != 0u && y_magnitude != INFINITY_BITS) {
        a = arc(x_magnitude, y_magnitude, &k);
    }
    if (y_magnitude <= x_magnitude && !backward) {
        return from_bits(sign | round_64(a, -63 - (int32_t)k));
    }
    a = k < 60u ? a >> (k + 2u) : 0u; /* Q61 */
    if (y_magnitude <= x_magnitude) {
        a = PI_Q61 - a;
    } else {
        a = backward ? PI_Q61 / 2u + a : PI_Q61 / 2u - a;
    }
    return from_bits(sign | round_64(a, -61));
}
