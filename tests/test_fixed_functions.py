"""Integer functions of the q31 format: C equals Python, and the stated errors hold."""

from __future__ import annotations

import math
import subprocess
from fractions import Fraction

import cffi
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from esea_gen.emit.fixed import functions
from esea_gen.hostlib.codec import Field, to_raw
from esea_gen.hostlib.compiler import CFLAGS, compile_sources
from esea_gen.language.ports import Port
from tests.conftest import require_tool

INT32 = st.integers(-(2**31), 2**31 - 1)
INT62 = st.integers(-(2**62) + 1, 2**62 - 1)

WRAPPERS = """
#include "esea_q31.h"
#include "esea_q31_units.h"
int32_t t_from_float(float x, int n) { return esea_q31_from_float(x, n); }
float t_to_float(int32_t raw, int n) { return esea_q31_to_float(raw, n); }
int32_t t_round32(int32_t x, int s) { return esea_q31_round(x, s); }
int64_t t_round64(int64_t x, int s) { return esea_q63_round(x, s); }
int32_t t_mul(int32_t a, int32_t b, int s) { return esea_q31_mul(a, b, s); }
int64_t t_wide(int32_t a, int32_t b) { return esea_q31_wide(a, b); }
int64_t t_mul_q31(int64_t a, int32_t b, int s) { return esea_q63_mul_q31(a, b, s); }
int64_t t_mul64(int64_t a, int64_t b, int s) { return esea_q63_mul(a, b, s); }
int32_t t_from(double x, int n) { return ESEA_Q31_FROM(x, n); }
double t_to(int32_t raw, int n) { return ESEA_Q31_TO(raw, n); }
"""
DECLARATIONS = """
int32_t t_round32(int32_t, int); int64_t t_round64(int64_t, int);
int32_t t_mul(int32_t, int32_t, int); int64_t t_mul_q31(int64_t, int32_t, int);
int64_t t_mul64(int64_t, int64_t, int); int64_t t_wide(int32_t, int32_t);
int32_t t_from(double, int); double t_to(int32_t, int);
int32_t t_from_float(float, int); float t_to_float(int32_t, int);
int64_t esea_q63_divide(int64_t, int64_t, int, int64_t, int64_t);
int64_t esea_q63_pow(int64_t, int, int32_t, int, int64_t);
int32_t esea_q31_pow(int32_t, int, int32_t, int, int32_t);
int64_t esea_q63_exp(int32_t, int, int, int64_t);
int64_t esea_q63_log(int64_t, int, int);
int32_t esea_q31_sqrt(int64_t, int);
int32_t esea_q31_tanh(int32_t, int);
"""


# As compiled here, and as on a core without counting of zeros, or without a 64-bit product.
PORTABLE = [(), ("-DESEA_Q31_PORTABLE_CLZ",), ("-DESEA_Q31_NARROW",)]


@pytest.fixture(scope="module", params=PORTABLE)
def lib(request):
    require_tool("gcc")
    files = {p.name: p.read_text() for p in functions.source_files()} | {"t.c": WRAPPERS}
    ffi = cffi.FFI()
    ffi.cdef(DECLARATIONS)
    return ffi.dlopen(str(compile_sources(files, request.param)))


@pytest.mark.ci
@given(
    x=st.one_of(st.floats(width=32), st.floats(-4, 4, width=32), st.integers(-(2**31), 2**31 - 1)),
    n=st.integers(0, 31),
)
@example(x=0.49999997, n=0)  # a sum with 0.5 would round it up
@example(x=-8388607.5, n=0)
@example(x=2147483520.0, n=0)  # the largest that fits
@example(x=-2147483648.0, n=0)
@example(x=1e-45, n=31)
@settings(max_examples=400)
def test_single_precision_to_raw_numbers_and_back(lib, x, n):
    x = float(np.float32(x))
    scaled = Fraction(x) * 2**n if math.isfinite(x) else Fraction(2**40)
    nearest = math.floor(abs(scaled) + Fraction(1, 2)) * (1 if scaled >= 0 else -1)
    raw = nearest if abs(scaled) < 2**31 - 1 else -(2**31)
    assert lib.t_from_float(x, n) == raw == lib.t_from(x, n)
    assert lib.t_to_float(raw, n) == float(np.float32(raw / 2**n))


@given(st.floats(), st.integers(-4, 31))
@example(0.5, 0)
@example(-0.5, 0)
@example(2147483647.0, 0)
@example(-2147483646.5, 0)
@example(math.nan, 3)
def test_a_number_by_itself_becomes_the_raw_one_that_it_is_in_a_column(x, n):
    assert Field("x", Port("x", -1, 1, "any"), n).encode(x) == to_raw([x], n)[0]


def floor_shift(value: int, shift: int) -> int:
    return (value + (1 << (shift - 1))) >> shift


@pytest.mark.ci
@given(st.data())
@settings(max_examples=400)
def test_arithmetic_core_is_exact_round_half_up(lib, data):
    draw = data.draw
    a, b, wide, wide2 = draw(INT32), draw(INT32), draw(INT62), draw(INT62)
    s = draw(st.integers(1, 31))
    assert lib.t_round32(a, s) == floor_shift(a, s)
    assert lib.t_round64(wide, s) == floor_shift(wide, s)
    assert lib.t_wide(a, b) == a * b
    for shift in (s, 2 * s):
        product = floor_shift(a * b, shift)
        if abs(product) < 2**31:
            assert lib.t_mul(a, b, shift) == product
    s = draw(st.integers(1, 94))
    product = floor_shift(wide * b, s)
    if abs(product) < 2**62:
        assert lib.t_mul_q31(wide, b, s) == product
    s = draw(st.integers(33, 126).filter(lambda k: k != 64))
    product = floor_shift(wide * wide2, s)
    if abs(product) < 2**62:
        assert lib.t_mul64(wide, wide2, s) == product


@pytest.mark.ci
@given(st.data())
@settings(max_examples=300)
def test_functions_equal_their_python(lib, data):
    draw = data.draw
    x, wide = draw(INT32), draw(INT62)
    f, xf = draw(st.integers(0, 40)), draw(st.integers(2, 40))
    y = draw(st.integers(1, 2**29))
    top = draw(st.integers(0, 2**61))
    narrow = min(top, 2**31 - 1)
    assert lib.esea_q63_pow(wide, xf, y, f, top) == functions.power(wide, xf, y, f, top)
    assert lib.esea_q31_pow(x, xf, y, f, narrow) == functions.power(x, xf, y, f, narrow)
    assert lib.esea_q63_exp(x, xf, f, top) == functions.exponential(x, xf, f, top)
    assert lib.esea_q63_log(wide, xf, f) == functions.logarithm(wide, xf, f)
    assert lib.esea_q31_tanh(x, xf) == functions.tangent(x, xf)
    k = draw(st.integers(-20, 62 - max(wide, 1).bit_length()))
    assert lib.esea_q31_sqrt(wide, k) == functions.root(wide, k)
    d = draw(INT62)
    k = draw(st.integers(-90, 90))
    low, high = -draw(st.integers(0, 2**61)), draw(st.integers(0, 2**61))
    assert lib.esea_q63_divide(wide, d, k, low, high) == functions.divide(wide, d, k, low, high)


def test_where_a_result_has_no_place_it_is_the_end():
    # 2^z in units of 2^-f: nothing below half a unit, the top beyond 2^62.
    one = 1 << 20
    for x, f, expected in ((one, 0, 1), (one, 30, 2**30), (one, 61, 2**61), (one, 63, 2**62)):
        assert functions.power(x, 20, 2**27, f, 2**62) == expected
    assert functions.power(1, 20, 2**27, 19, 9) == 1  # half a unit is one
    assert functions.power(1, 20, 2**27, 18, 9) == 0
    assert functions.power(0, 20, 2**27, 18, 9) == functions.power(-5, 20, 2**27, 18, 9) == 0
    assert functions.exponential(-101 << 20, 20, 60, 5) == 0
    assert functions.exponential(101 << 20, 20, 0, 5) == 5
    assert functions.divide(1, 0, 0, -9, 9) == functions.divide(0, 1, 0, -9, 9) == 0
    assert functions.divide(7, 2, 0, -9, 9) == 4  # a half goes away from zero
    assert functions.divide(-7, 2, 0, -9, 9) == -4
    assert functions.divide(-7, 2, 1, -6, 9) == -6
    assert functions.divide(1, 3, 100, -9, 9) == 9
    ends = -(2**63), 2**63 - 1
    assert functions.divide(5, 3, 100, *ends) == -functions.divide(-5, 3, 100, *ends) == ends[1]
    assert functions.root(2**62, 0) == 2**31 - 1
    assert functions.root(99, 0) == 9


def test_conversion_macros_refuse_what_is_no_number(lib):
    for bad in (math.nan, math.inf, -math.inf, 1e30, -1e30, 1.0):
        assert lib.t_from(bad, 31) == -(2**31)
    assert lib.t_from(0.5, 31) == 2**30
    assert lib.t_to(-(2**30), 31) == -0.5


def test_log2_and_exp2_cores_keep_their_stated_error():
    rng = np.random.default_rng(3)
    edges = [2**31 + k * 2**25 + d for k in range(64) for d in (0, 1, 2**24, 2**25 - 1)]
    worst = 0.0
    for s in [*edges, *map(int, rng.integers(2**31, 2**32, 20000))]:
        gap = functions.log2_fraction(s) * 2.0**-64 - math.log2(s / 2**31)
        worst = max(worst, abs(gap - round(gap)))
    assert 2.0**-36 < worst <= functions.LOG2_ERROR
    worst = 0.0
    edges = [k * 2**27 + d for k in range(32) for d in (0, 1, 2**26, 2**27 - 1)]
    for x in [*edges, *map(int, rng.integers(0, 2**32, 20000))]:
        m = functions.exp2_fraction(x) * 2.0**-31
        worst = max(worst, *(abs(m / 2 ** ((x + d) * 2.0**-32) - 1) for d in (0, 1)))
    assert 2.0**-33 < worst <= functions.EXP2_ERROR


@given(INT62.filter(bool), INT62.filter(bool), st.integers(-60, 60))
@settings(max_examples=500)
def test_divide_keeps_its_error(n, d, k):
    exact = Fraction(n, d) * Fraction(2) ** k
    got = functions.divide(n, d, k, -(2**62), 2**62)
    if abs(exact) < 2**61:
        assert abs(got - exact) <= abs(exact) * Fraction(functions.DIVIDE_ERROR) + Fraction(1, 2)


@given(st.integers(1, 2**31 - 1), st.floats(0.05, 4.0))
@settings(max_examples=400)
def test_power_keeps_its_error(x, y):
    y_q27 = round(y * 2**27)
    exact = (x * 2.0**-31) ** (y_q27 * 2.0**-27)
    got = functions.power(x, 31, y_q27, 30, 2**30) * 2.0**-30
    assert abs(got - exact) <= 2.0**-29 * exact + 2.0**-31


@given(st.integers(-(2**31), 2**31 - 1))
@settings(max_examples=300)
def test_the_other_functions_keep_their_errors(x):
    value = x * 2.0**-28
    exact = math.exp(min(value, 7.0))
    if value <= 7.0:
        got = functions.exponential(x, 28, 20, 2**40) * 2.0**-20
        assert abs(got - exact) <= exact * 2.0**-30 + 2.0**-21
    assert abs(functions.tangent(x, 28) * 2.0**-30 - math.tanh(value)) <= 2.0**-28
    if x > 0:
        assert abs(functions.logarithm(x, 28, 25) * 2.0**-25 - math.log(value)) <= 2.0**-25
        assert 0 <= math.sqrt(x * 2.0**28) - functions.root(x, 28) < 1


EXHAUSTIVE = r"""
#include <stdio.h>
#include <math.h>
#include "esea_q31.c"
int main(void)
{
    double a = 0, b = 0;
    uint64_t x;
    for (x = 1ull << 31; x < 1ull << 32; ++x) {
        double d = (double)log2_fraction((uint32_t)x) * 0x1p-64 - (log2((double)x) - 31.0);
        d = fabs(d - rint(d));
        a = d > a ? d : a;
    }
    for (x = 0; x < 1ull << 32; ++x) {
        const uint32_t m = exp2_fraction((uint32_t)x);
        const double r = m * 0x1p-31 / exp2((double)x * 0x1p-32);
        const double p = fabs(r - 1), q = fabs(r * (1 - 0x1p-32 * 0.6931471805599453) - 1);
        if (m < 0x80000000u)
            return 1;
        b = p > b ? p : b;
        b = q > b ? q : b;
    }
    printf("%.17g %.17g\n", a, b);
    return 0;
}
"""


@pytest.mark.slow
def test_cores_over_every_argument(tmp_path):
    gcc = require_tool("gcc")
    for p in functions.source_files():
        (tmp_path / p.name).write_text(p.read_text())
    (tmp_path / "all.c").write_text(EXHAUSTIVE)
    flags = [*CFLAGS, "-fno-math-errno", f"-I{tmp_path}", str(tmp_path / "all.c"), "-lm"]
    subprocess.run([gcc, *flags, "-o", str(tmp_path / "all")], check=True)
    said = subprocess.run([str(tmp_path / "all")], capture_output=True, text=True, check=True)
    log2, exp2 = map(float, said.stdout.split())
    assert 0.9 * functions.LOG2_ERROR < log2 <= functions.LOG2_ERROR
    assert 0.9 * functions.EXP2_ERROR < exp2 <= functions.EXP2_ERROR
