"""Tables of the elementary functions against the functions themselves, number by number."""

from __future__ import annotations

import math
import re
from fractions import Fraction

import mpmath
import pytest
from mpmath import mpf

from esea_gen.emit.elementary import EXPONENT_FRACTION_BITS, coefficients, exponent_q27

HALF = Fraction(1, 2)


@pytest.fixture(autouse=True)
def digits():
    with mpmath.workdps(110):
        yield


def nearest(value) -> int:
    return int(mpmath.floor(value + mpf(0.5)))


def test_a_number_in_fixed_point_is_the_nearest():
    for value, bits, bias, raw in (
        (mpf(1) / 3, 4, 0.0, 5),
        (mpf(-1) / 3, 4, 0.0, -5),
        (mpf(5) / 16, 4, 0.5, 6),  # 5.5 to the even one
        (mpf(5) / 16, 4, -0.75, 4),
        (mpf(3), 0, 0.0, 3),
    ):
        assert coefficients.fixed(value, bits, bias) == raw


def test_a_fit_returns_the_polynomial_from_its_constant_up():
    found, error = coefficients.fit(lambda t: 3 - 2 * t + 5 * t**2, -1, 1, 2)
    assert [float(c) for c in found] == pytest.approx([3, -2, 5])
    assert error < 1e-40
    # Of t^2 by a straight line the best is 1/2, off by 1/2.
    found, error = coefficients.fit(lambda t: t**2, -1, 1, 1)
    assert [float(c) for c in found] == pytest.approx([0.5, 0.0], abs=1e-9)
    assert float(error) == pytest.approx(0.5, rel=1e-6)


def test_singularities_are_filled_and_squares_taken_back():
    f = coefficients.near_zero(lambda t: mpmath.sin(t) / t, mpf(1))
    assert f(mpf(0)) == 1
    assert f(mpf(2)) == mpmath.sin(2) / 2
    g = coefficients.even(lambda x: mpmath.sin(x) / x, mpf(1))
    assert g(mpf(0)) == 1
    assert g(mpf(4)) == mpmath.sin(2) / 2


def test_short_reciprocals_of_the_significands():
    found = coefficients.reciprocals()
    assert len(found) == 64
    assert (found[0], found[-1]) == (2048, 1024)  # exactly 1 and a half
    for k, r in enumerate(found[1:-1], 1):
        middle = 1 + Fraction(2 * k + 1, 128)
        assert abs(r - 2048 / middle) <= HALF
    low, high = coefficients.reduced_range()
    ends = [
        (1 + Fraction(k + d, 64)) * Fraction(r, 2048) - 1
        for k, r in enumerate(found)
        for d in (0, 1)
    ]
    assert (low, high) == (float(min(ends)), float(max(ends)))
    assert max(-low, high) <= 2.0**-6


def test_reciprocals_that_leave_too_much_are_refused(monkeypatch):
    # A first interval of 1/32, of which nothing is taken off, goes beyond 1/64.
    monkeypatch.setattr(coefficients, "LOG2_INTERVALS", 32)
    with pytest.raises(ValueError, match=r"reduced argument .* leaves \+-2\*\*-6"):
        coefficients.reduced_range()


def test_logarithms_of_the_table():
    rows = coefficients.log2_table()
    for word, reciprocal in zip(rows, coefficients.reciprocals(), strict=True):
        assert word & 0xFFF == reciprocal
        exact = -mpmath.log(mpf(reciprocal) / 2048, 2) % 1
        assert abs(mpf(word >> 12) / 2**52 - exact) <= mpf(2) ** -53
    assert rows[0] >> 12 == rows[-1] >> 12 == 0  # log2 of 1 and of 2, modulo one
    assert max(rows) < 2**64


def test_powers_of_two_of_the_table():
    found = coefficients.exp2_table()
    assert len(found) == 32
    for k, raw in enumerate(found):
        exact = mpf(2) ** ((k + mpf(0.5)) / 32) * 2**31
        # Half a unit for what the sum's shift cuts off, and for the fraction's own cut to 32 bits,
        # 2^-33 of it on average, ln 2 2^-33 of the value.
        centred = exact * (1 + mpmath.log(2) * mpf(2) ** -33) + mpf(0.5)
        assert abs(raw - centred) <= mpf(0.5)
        assert 2**31 <= raw < 2**32


def test_seeds_of_a_root_and_digits_of_two_over_pi():
    found = coefficients.reciprocal_root_table()
    assert len(found) == 48
    for k, raw in zip(range(16, 64), found, strict=True):
        exact = 2**16 / math.sqrt((k + 0.5) / 16)
        assert abs(raw - min(exact, 65535)) <= 0.5
    # As published with every implementation of Payne and Hanek's reduction.
    digits = "A2F9836E 4E441529 FC2757D1 F534DDC0 DB629599 3C439041 FE5163AB DEBBC561"
    assert coefficients.two_over_pi_words() == [0, 0, *(int(w, 16) for w in digits.split())]


FUNCTIONS = {
    "LOG2": (lambda r: mpmath.log1p(r) / (r * mpmath.log(2)), None, "30 28 26 24"),
    "LOG": (lambda r: (mpmath.log1p(r) - r) / r**2, None, "31 26 21 16"),
    "EXP2": (lambda t: (2**t - 1) / t, (-1 / 64, 1 / 64), "28 23 18"),
    "RECIPROCAL": (lambda r: 1 / (1 + r), None, "30 25 20 15 10"),
    "EXPM1": (lambda x: (mpmath.exp(x) - 1 - x) / x**2, (-0.5, 0.5), "31 " * 7),
    "TANH": (lambda s: (1 - mpmath.tanh(s**0.5) / s**0.5) / s, (0, 0.25), "32 " * 6),
    "SIN": (lambda s: mpmath.sin(s**0.5 * mpmath.pi / 2) / s**0.5, (0, 0.25), "31 32 32 32 32"),
    "COS": (lambda s: (1 - mpmath.cos(s**0.5 * mpmath.pi / 2)) / s, (0, 0.25), "31 " * 5),
    "ATAN": (lambda s: (1 - mpmath.atan(s**0.5) / s**0.5) / s, (0, 1), "32 " * 12),
}
ALTERNATING = {"TANH", "SIN", "COS", "ATAN"}


def test_polynomials_are_near_their_functions():
    found = {name: (text, integers) for name, text, integers in coefficients.polynomials()}
    assert list(found) == list(FUNCTIONS)
    reduced = tuple(map(float, coefficients.reduced_range()))
    for name, (function, interval, formats) in FUNCTIONS.items():
        text, integers = found[name]
        bits = [int(b) for b in formats.split()]
        assert len(integers) == len(bits)
        low, high = interval or reduced
        stated = re.search(r"fit error 2\^(-?[\d.]+)$", text)
        assert stated is not None
        fit = 2.0 ** float(stated[1])
        said = f"all Q{bits[0]}" if len(set(bits)) == 1 else ", ".join(f"Q{b}" for b in bits)
        assert f";\n * {said}; fit error" in text
        signs = [(-1) ** k if name in ALTERNATING else 1 for k in range(len(bits))]
        real = [mpf(s * i) / 2**b for s, i, b in zip(signs, integers, bits, strict=True)]
        # Half a unit of each coefficient, one of the constant that carries a shift's bias too.
        most = max(abs(low), abs(high))
        slack = 2.0 ** -bits[0] + sum(0.5 * 2.0**-b * most**k for k, b in enumerate(bits) if k)
        worst = mpf(0)
        for k in range(1, 80):
            at = mpf(low) + (mpf(high) - low) * k / 80
            if at != 0:
                worst = max(worst, abs(mpmath.polyval(real[::-1], at) - function(at)))
        assert worst <= 1.1 * fit + slack, name
        assert worst >= 0.02 * fit or worst <= slack, name


# At zero, and what is added to the constant before it is rounded, in units of its last place.
AT_ZERO = {
    "LOG2": (lambda: 1 / mpmath.log(2), 0.5),
    "LOG": (lambda: mpf(-1) / 2, 0.0),
    "EXP2": (lambda: mpmath.log(2), 0.0),
    "RECIPROCAL": (lambda: mpf(1), 0.0),
    "EXPM1": (lambda: mpf(1) / 2, 0.0),
    "TANH": (lambda: mpf(1) / 3, 0.0),
    "SIN": (lambda: mpmath.pi / 2, -0.5),
    "COS": (lambda: mpmath.pi**2 / 8, 0.0),
    "ATAN": (lambda: mpf(1) / 3, 0.0),
}


def chebyshev(function, low, high, count: int) -> list:
    """Coefficients, from the constant up, of the interpolation at the Chebyshev points."""
    nodes = [mpmath.cos(mpmath.pi * (k + mpf(0.5)) / count) for k in range(count)]
    middle, half = (mpf(high) + mpf(low)) / 2, (mpf(high) - mpf(low)) / 2
    at = [middle + half * n for n in nodes]
    return list(mpmath.lu_solve(
        mpmath.matrix([[x**k for k in range(count)] for x in at]),
        mpmath.matrix([function(x) for x in at]),
    ))  # fmt: skip


def test_polynomials_are_fits_over_the_whole_of_their_intervals():
    found = {name: integers for name, _, integers in coefficients.polynomials()}
    ends = [
        (1 + mpf(k + d) / 64) * mpf(r) / 2048 - 1
        for k, r in enumerate(coefficients.reciprocals())
        for d in (0, 1)
    ]
    for name, (function, interval, formats) in FUNCTIONS.items():
        low, high = interval or (min(ends), max(ends))
        limit, bias = AT_ZERO[name]
        bits = [int(b) for b in formats.split()]

        def filled(t, function=function, limit=limit):
            return function(t) if abs(t) > 1e-40 else limit()

        real = chebyshev(filled, low, high, len(bits))
        signs = [-1 if name in ALTERNATING and k % 2 else 1 for k in range(len(bits))]
        exact = [s * r * 2**b for s, r, b in zip(signs, real, bits, strict=True)]
        exact[0] += bias
        assert [int(mpmath.nint(e)) for e in exact] == found[name], name


def test_the_bias_of_a_constant_is_of_its_last_place():
    plain = coefficients.polynomial("A", "", mpmath.exp, (mpf(0), mpf(1)), (20, 20, 20))
    moved = coefficients.polynomial("A", "", mpmath.exp, (mpf(0), mpf(1)), (20, 20, 20), bias=3.0)
    turned = coefficients.polynomial(
        "A", "", mpmath.exp, (mpf(0), mpf(1)), (20, 20, 20), alternating=True
    )
    assert [m - p for m, p in zip(moved[2], plain[2], strict=True)] == [3, 0, 0]
    assert turned[2] == [plain[2][0], -plain[2][1], plain[2][2]]
    assert plain[2][0] == pytest.approx(2**20, rel=0.02)


def test_lines_of_a_table():
    assert coefficients.rows([1, 2, 3, 4, 5], "{:02X}", 2) == [
        "    01, 02,",
        "    03, 04,",
        "    05,",
    ]


def test_exponents_in_27_bits():
    assert EXPONENT_FRACTION_BITS == 27
    assert exponent_q27(0.5) == 2**26
    assert exponent_q27(-16.0) == -(2**31)
    assert exponent_q27(16 - 2.0**-27) == 2**31 - 1
    assert exponent_q27(2.0**-28 * 1.5) == 1  # nearest
    for beyond in (16.0, 16 - 2.0**-29, -16.0 - 1e-9, 20.5, math.nan):
        with pytest.raises(ValueError, match=r"does not fit Q4\.27"):
            exponent_q27(beyond)


def test_the_header_has_all_of_it():
    text = coefficients.render()
    tables = {
        name: [int(v, 16) for v in re.findall(r"0x([0-9A-F]+)", body)]
        for name, body in re.findall(r"(\w+)\[\d+\] = \{(.*?)\};", text, flags=re.DOTALL)
    }
    assert tables == {
        "LOG2_TABLE": coefficients.log2_table(),
        "EXP2_TABLE": coefficients.exp2_table(),
        "ROOT_TABLE": coefficients.reciprocal_root_table(),
        "TWO_OVER_PI": coefficients.two_over_pi_words(),
    }
    sizes = {n: int(k) for n, k in re.findall(r"(\w+)\[(\d+)\] = ", text)}
    assert sizes == {n: len(v) for n, v in tables.items()}
    defined = {
        n: int(re.search(r"-?(0x[0-9A-F]+|\d+)", re.sub(r"U?INT64_C", "", v))[0], 0)
        for n, v in re.findall(r"#define (\w+) (\S.*)", text)
    }
    log2_e = defined["LOG2_E_HIGH"] * 2**32 + defined["LOG2_E_LOW"]
    for raw, bits, exact in (
        (log2_e, 63, 1 / mpmath.log(2)),
        (defined["LN_2_Q64"], 64, mpmath.log(2)),
        (defined["LN_2_Q56"], 56, mpmath.log(2)),
        (defined["PI_Q61"], 61, mpmath.pi),
    ):
        assert abs(raw - exact * 2**bits) <= mpf(0.5)
    for name, _, integers in coefficients.polynomials():
        assert [defined[f"{name}_{k}"] for k in range(len(integers))] == integers
    # Beyond the largest int a constant is unsigned, and one below zero stands in brackets.
    for value in re.findall(r"#define [A-Z0-9]+_\d (.*)", text):
        plain = int(value.strip("()").rstrip("u"), 0)
        assert value.endswith("u") == (plain >= 2**31)
        assert value.startswith("(") == (plain < 0)
