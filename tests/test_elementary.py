"""The integer elementary functions: accuracy, special cases, same bits everywhere, no library."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cffi
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.emit.elementary import ACCURACY_ULP, coefficients, exponent_q27, source_paths

HEADER, SOURCE, TABLES = source_paths()
WARNINGS = [
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wshadow",
    "-Wpedantic",
    "-Wdouble-promotion",
    "-Wfloat-equal",
    "-Werror",
]
EXPONENTS = (
    2.77,
    0.77,
    1.0,
    2.0,
    0.5,
    -1.0,
    1.0 / 3.0,
    -0.5,
    3.7,
    -4.4,
    15.99,
    -15.99,
    0.01,
    2.0**-27,
    0.0,
)
BINARY = {"powk", "pow", "atan2"}
NAN = 0x7FC00000
INF = 0x7F800000
ONE = 0x3F800000
SIGN = 0x80000000
SPECIAL_BITS = np.array(
    [
        *(
            0,
            1,
            2,
            3,
            0x7FFFFF,
            0x7FFFFE,
            0x800000,
            0x800001,
            0x7F7FFFFF,
            0x7F7FFFFE,
            INF,
            0x7F800001,
            NAN,
            0x7FFFFFFF,
        ),
        *(
            ONE - 2,
            ONE - 1,
            ONE,
            ONE + 1,
            ONE + 2,
            0x3F000000,
            0x3EFFFFFF,
            0x40000000,
            0x40400000,
            0x3FC00000,
        ),
        *(
            0x3F7DFFFF,
            0x3F7E0000,
            0x3F81FFFF,
            0x3F820000,
            0x3FB504F3,
            0x3FB504F4,
            0x30000000,
            0x2FFFFFFF,
            0x37000000,
        ),
        *(
            0x36FFFFFF,
            0x38000000,
            0x37FFFFFF,
            0x32000000,
            0x31FFFFFF,
            0x41200000,
            0x411FFFFF,
            0x43000000,
            0x42FFFFFF,
        ),
        *(
            0x42B17217,
            0x42B17218,
            0x42CFF1B4,
            0x42CFF1B5,
            0x42AEAC4F,
            0x42AEAC50,
            0x3FC90FDB,
            0x40490FDB,
            0x3F490FDB,
        ),
        *(
            0x3EAAAAAB,
            0x417FFFFF,
            0x41800000,
            0x4B7FFFFF,
            0x4B800000,
            0x4B800001,
            0x461C4000,
            0x5F3759DF,
            0x3F7FFFFF,
        ),
    ],
    dtype=np.uint32,
)


def tool(name: str) -> str:
    """Return the path of a tool; without it skip, or fail where tools are required."""
    path = shutil.which(name)
    if path is None:
        message = f"{name} is not installed"
        if os.environ.get("ESEA_REQUIRE_TOOLS") == "1":
            pytest.fail(f"{message} and ESEA_REQUIRE_TOOLS=1")
        pytest.skip(message)
    return path


def run(command: Sequence[str | Path], **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a command that has to succeed."""
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=False, **options
    )
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}"
    return done


def declarations() -> str:
    """Return the header's prototypes as the preprocessor leaves them."""
    text = run([tool("gcc"), "-E", "-P", HEADER]).stdout
    found = re.findall(r"^float esea_f32_[^;]*;", text, flags=re.MULTILINE)
    assert set(re.findall(r"esea_f32_(\w+)", "\n".join(found))) == set(ACCURACY_ULP)
    return "\n".join(found)


def driver() -> str:
    """Write C that applies each exported function to arrays."""
    parts = ['#include "esea_f32.h"', "#include <stddef.h>"]
    for name, arguments in re.findall(r"esea_f32_(\w+)\(([^)]*)\)", declarations()):
        types = [re.sub(r"\w+$", "", argument.strip()).strip() for argument in arguments.split(",")]
        parameters = ", ".join(f"const {kind} *a{at}" for at, kind in enumerate(types))
        values = ", ".join(f"a{at}[i]" for at in range(len(types)))
        prototype = f"void array_{name}({parameters}, float *out, size_t n)"
        parts.append(
            f"{prototype};\n{prototype}\n"
            f"{{ for (size_t i = 0; i < n; i++) out[i] = esea_f32_{name}({values}); }}"
        )
    return "\n".join(parts) + "\n"


class Library:
    """The compiled functions, on NumPy arrays."""

    def __init__(self, folder: Path, compiler: str, options: Sequence[str]) -> None:
        source = folder / "driver.c"
        source.write_text(driver())
        path = folder / f"lib{len(list(folder.iterdir()))}.so"
        run(
            [
                tool(compiler),
                "-std=c99",
                *options,
                "-shared",
                "-fPIC",
                f"-I{HEADER.parent}",
                SOURCE,
                source,
                "-o",
                path,
            ]
        )
        self._ffi = cffi.FFI()
        self._ffi.cdef(
            declarations()
            + "\n"
            + "\n".join(re.findall(r"^void array_.*;$", driver(), flags=re.MULTILINE))
        )
        self.raw = self._ffi.dlopen(str(path))

    def __call__(self, name: str, *arrays: Any) -> np.ndarray:
        """Apply a function elementwise; integer arrays pass as int32, the others as float32."""
        broad = np.broadcast_arrays(*arrays)
        passed = [
            np.ascontiguousarray(a, dtype=np.int32 if a.dtype.kind == "i" else np.float32)
            for a in broad
        ]
        out = np.empty(passed[0].shape, dtype=np.float32)
        kinds = [("int32_t *" if a.dtype == np.int32 else "float *", a) for a in passed]
        pointers = [self._ffi.cast(kind, a.ctypes.data) for kind, a in kinds]
        getattr(self.raw, f"array_{name}")(
            *pointers, self._ffi.cast("float *", out.ctypes.data), out.size
        )
        return out


@pytest.fixture(scope="module")
def lib(tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Compile the functions at -O2."""
    return Library(tmp_path_factory.mktemp("elementary"), "gcc", ["-O2", *WARNINGS])


def floats(bits: Any) -> np.ndarray:
    """Read bit patterns as float32."""
    return np.asarray(bits, dtype=np.uint32).view(np.float32)


def bits_of(values: Any) -> np.ndarray:
    """Return the bit patterns of float32 values."""
    return np.asarray(values, dtype=np.float32).view(np.uint32)


# Exact values are float64, whose functions are good to about one unit in their own last place, here
# 2^-29 ULP; a test below checks that against mpmath.
def exact(name: str, *arguments: Any) -> np.ndarray:
    """Return the exact values as float64; powk takes its exponent as the integer."""
    with np.errstate(all="ignore"):
        x = np.asarray(arguments[0], dtype=np.float64)
        if name == "powk":
            return np.power(x, np.asarray(arguments[1], dtype=np.float64) / 2.0**27)
        if name == "pow":
            return np.power(x, np.asarray(arguments[1], dtype=np.float64))
        if name == "atan2":
            return np.arctan2(x, np.asarray(arguments[1], dtype=np.float64))
        return np.asarray(getattr(np, name)(x))


def errors_ulp(result: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return errors in ULP of float32; infinite where the class of value differs."""
    with np.errstate(all="ignore"):
        exponent = np.where(wanted == 0.0, -149, np.frexp(wanted)[1] - 24)
        ulp = np.ldexp(1.0, np.maximum(exponent, -149))
        error = np.abs(result.astype(np.float64) - wanted) / ulp
        # Infinity is right from half a unit above the largest float on; an ULP there is 2^104.
        infinite = np.isinf(result)
        error = np.where(
            infinite,
            np.where(np.abs(wanted) >= 2.0**128 - 2.0**103 - 2.0**97, 0.0, np.inf),
            error,
        )
        error = np.where(infinite & (np.sign(result) != np.sign(wanted)), np.inf, error)
        both = np.isnan(result) & np.isnan(wanted)
        error = np.where(both, 0.0, error)
    return np.where(np.isnan(error), np.inf, error)


def unary_inputs(name: str, count: int, seed: int) -> np.ndarray:
    """Mix special, boundary, random and dense arguments of a function of one variable."""
    rng = np.random.default_rng(seed)
    low, high = {
        "exp": (-105.0, 90.0),
        "expm1": (-20.0, 90.0),
        "tanh": (-10.5, 10.5),
        "sin": (-1.0e4, 1.0e4),
        "cos": (-1.0e4, 1.0e4),
        "log": (0.25, 4.0),
        "log1p": (-1.0, 4.0),
        "cbrt": (-30.0, 30.0),
        "sqrt": (0.0, 30.0),
    }[name]
    dense = ONE - 40000 + np.arange(80000, dtype=np.uint32)
    near_half = 0x3F000000 - 20000 + np.arange(40000, dtype=np.uint32)
    return np.concatenate(
        [
            floats(SPECIAL_BITS),
            floats(SPECIAL_BITS | np.uint32(SIGN)),
            floats(rng.integers(0, 2**32, count, dtype=np.uint32)),
            rng.uniform(low, high, count).astype(np.float32),
            (rng.uniform(-1.0, 1.0, count) * 2.0 ** rng.uniform(-30, 2, count)).astype(np.float32),
            floats(dense),
            floats(near_half),
            floats(dense | np.uint32(SIGN)),
        ]
    )


def powers(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw positive bases of all magnitudes, and exponents Q4.27 with mostly finite results."""
    rng = np.random.default_rng(seed)
    x = floats(rng.integers(1, INF, count, dtype=np.uint32))
    y = np.where(
        rng.random(count) < 0.5, rng.uniform(-16.0, 16.0, count), rng.uniform(-1.5, 1.5, count)
    )
    near = (1.0 + rng.uniform(-0.5, 1.0, count)).astype(np.float32)
    x = np.where(rng.random(count) < 0.4, near, x)
    return x, np.clip(np.rint(y * 2.0**27), -(2**31), 2**31 - 1).astype(np.int32)


def arctangents(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw pairs of all magnitudes and signs, half of them of similar size."""
    rng = np.random.default_rng(seed)
    y, x = (floats(rng.integers(0, 2**32, count, dtype=np.uint32)) for _ in range(2))
    with np.errstate(all="ignore"):
        ratio = (
            y.astype(np.float64) * 2.0 ** rng.uniform(-8, 8, count) * rng.choice([-1.0, 1.0], count)
        )
        near = ratio.clip(-1.0e38, 1.0e38).astype(np.float32)
    return y, np.where(rng.random(count) < 0.6, near, x)


def measured(lib: Library, name: str, count: int = 100_000, seed: int = 1) -> float:
    """Return the largest error found on samples."""
    arguments: tuple[np.ndarray, ...]
    if name == "powk":
        x, y = powers(count, seed)
        rng = np.random.default_rng(seed + 1)
        hot_x = (rng.uniform(0.0, 1.0, count) * 2.0 ** rng.uniform(-40, 4, count)).astype(
            np.float32
        )
        hot_y = rng.choice(
            np.array([exponent_q27(value) for value in EXPONENTS], dtype=np.int32), count
        )
        arguments = (np.concatenate([x, hot_x]), np.concatenate([y, hot_y]))
    elif name == "pow":
        x, y = powers(count, seed)
        rng = np.random.default_rng(seed + 1)
        tiny = (rng.uniform(-1.0, 1.0, count) * 2.0 ** rng.uniform(-45, 4, count)).astype(
            np.float32
        )
        whole = rng.integers(-15, 16, count).astype(np.float32)
        smaller = np.clip(y / 2.0**27, -15.99999, 15.99999).astype(np.float32)
        arguments = (np.concatenate([x, x, -x]), np.concatenate([smaller, tiny, whole]))
    elif name == "atan2":
        arguments = arctangents(2 * count, seed)
    else:
        arguments = (unary_inputs(name, count, seed),)
    return float(errors_ulp(lib(name, *arguments), exact(name, *arguments)).max())


@pytest.mark.parametrize("name", ACCURACY_ULP)
def test_error_stays_within_the_documented_one(lib: Library, name: str) -> None:
    assert measured(lib, name) <= ACCURACY_ULP[name]


def test_the_exact_values_are_exact_enough(lib: Library) -> None:
    # float64 stands for the exact value above; even a thousandth of an ULP would hide nothing.
    one = {
        name: getattr(mpmath, name)
        for name in ("exp", "expm1", "log", "log1p", "tanh", "sqrt", "sin", "cos")
    }
    one["cbrt"] = lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x))
    with mpmath.workdps(40):
        for name, function in one.items():
            x = unary_inputs(name, 200, 7)[::401]
            wanted = exact(name, x)
            for value, expected in zip(x.tolist(), wanted.tolist(), strict=True):
                if math.isfinite(expected) and expected != 0.0:
                    assert abs(function(mpmath.mpf(value)) - expected) <= 2.0**-51 * abs(
                        expected
                    ), (name, value)
        for name, (x, y) in {"powk": powers(300, 7), "atan2": arctangents(300, 7)}.items():
            wanted = exact(name, x, y)
            for a, b, expected in zip(x.tolist(), y.tolist(), wanted.tolist(), strict=True):
                if not math.isfinite(expected) or abs(expected) < 2.0**-1000:
                    continue
                if name == "powk":
                    true = mpmath.power(mpmath.mpf(a), mpmath.ldexp(mpmath.mpf(b), -27))
                else:
                    true = mpmath.atan2(mpmath.mpf(a), mpmath.mpf(b))
                assert abs(true - expected) <= 2.0**-51 * abs(expected), (name, a, b)


def test_error_measure_sees_errors() -> None:
    wanted = np.array([1.0, 0.0, 1.0, 2.0**-149, 3.0e38, 4.0e38, 4.0e38, np.nan, 1.0, -np.inf])
    result = np.array(
        [1.0, 2.0**-149, 1.0 + 2.0**-23, 0.0, np.inf, np.inf, -np.inf, np.nan, np.nan, np.inf],
        dtype=np.float32,
    )
    expected = [0.0, 1.0, 1.0, 1.0, np.inf, 0.0, np.inf, 0.0, np.inf, np.inf]
    assert errors_ulp(result, wanted).tolist() == expected


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in ACCURACY_ULP if name not in BINARY])
def test_error_exhaustively(lib: Library, name: str) -> None:
    worst = 0.0
    for top in range(256):
        x = floats((top << 24) + np.arange(1 << 24, dtype=np.uint32))
        worst = max(worst, float(errors_ulp(lib(name, x), exact(name, x)).max()))
    assert worst <= ACCURACY_ULP[name]


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [2.77, 0.77, -4.4, 15.99])
def test_powk_over_every_significand(lib: Library, exponent: float) -> None:
    y = np.array(exponent_q27(exponent), dtype=np.int32)
    for binade in (0, 0x3D800000, 0x3F000000, ONE, 0x40000000):
        x = floats(binade + np.arange(1 << 23, dtype=np.uint32))
        assert errors_ulp(lib("powk", x, y), exact("powk", x, y)).max() <= ACCURACY_ULP["powk"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["powk", "pow", "atan2"])
def test_error_of_two_arguments_on_many_samples(lib: Library, name: str) -> None:
    for seed in range(20):
        assert measured(lib, name, 1_000_000, 100 + seed) <= ACCURACY_ULP[name]


def test_special_values(lib: Library) -> None:
    def same(name: str, *arguments: Any, expected: Sequence[int]) -> None:
        assert [f"{value:08X}" for value in bits_of(lib(name, *arguments))] == [
            f"{value:08X}" for value in expected
        ]

    x = floats([0, SIGN, INF, SIGN | INF, NAN, 0x7F800001, 0xFFFFFFFF, ONE, SIGN | ONE])
    nans = [NAN] * 3
    same("exp", x, expected=[ONE, ONE, INF, 0, *nans, 0x402DF854, 0x3EBC5AB2])
    same("expm1", x, expected=[0, SIGN, INF, SIGN | ONE, *nans, 0x3FDBF0A9, 0xBF21D2A7])
    same("log", x, expected=[SIGN | INF, SIGN | INF, INF, NAN, *nans, 0, NAN])
    same("log1p", x, expected=[0, SIGN, INF, NAN, *nans, 0x3F317218, SIGN | INF])
    same("tanh", x, expected=[0, SIGN, ONE, SIGN | ONE, *nans, 0x3F42F7D6, 0xBF42F7D6])
    same("cbrt", x, expected=[0, SIGN, INF, SIGN | INF, *nans, ONE, SIGN | ONE])
    same("sqrt", x, expected=[0, SIGN, INF, NAN, *nans, ONE, NAN])
    same("sin", x, expected=[0, SIGN, NAN, NAN, *nans, 0x3F576AA4, 0xBF576AA4])
    same("cos", x, expected=[ONE, ONE, NAN, NAN, *nans, 0x3F0A5140, 0x3F0A5140])


def test_powk_special_values(lib: Library) -> None:
    x = floats([0, SIGN, INF, SIGN | INF, NAN, SIGN | ONE, SIGN | 1, ONE])
    for y, expected in (
        (exponent_q27(2.77), [0, 0, INF, NAN, NAN, NAN, NAN, ONE]),
        (1, [0, 0, INF, NAN, NAN, NAN, NAN, ONE]),
        (exponent_q27(-0.5), [INF, INF, 0, NAN, NAN, NAN, NAN, ONE]),
        (-(2**31), [INF, INF, 0, NAN, NAN, NAN, NAN, ONE]),
        (0, [ONE] * 8),
    ):
        assert bits_of(lib("powk", x, np.array(y, dtype=np.int32))).tolist() == expected


def test_powk_is_exact_where_the_result_is(lib: Library) -> None:
    x = np.arange(1, 257, dtype=np.float32)
    for y in (1, 2, 3):
        assert np.array_equal(lib("powk", x, np.array(y << 27, dtype=np.int32)), x**y)
    assert np.array_equal(lib("powk", x**2, np.array(1 << 26, dtype=np.int32)), x)
    assert np.array_equal(lib("cbrt", x**3), x)
    assert np.array_equal(lib("sqrt", x**2), x)


def test_pow_follows_ieee_754_inside_its_domain(lib: Library) -> None:
    values = floats(np.concatenate([SPECIAL_BITS, SPECIAL_BITS | np.uint32(SIGN)]))
    extra = np.array(
        [-15, -4, -3, -2, -1, -0.5, -(2.0**-30), 2.0**-30, 0.5, 1, 2, 3, 4, 15], dtype=np.float32
    )
    values = np.concatenate([values, extra])
    x, y = (grid.ravel() for grid in np.meshgrid(values, values))
    with np.errstate(all="ignore"):
        wanted = exact("pow", x, y)
        outside = (np.abs(y) >= 16) & np.isfinite(y) & (np.abs(x) != 1) & np.isfinite(x) & (x != 0)
    result = lib("pow", x, y)
    assert np.all(bits_of(result[outside]) == NAN)
    inside = ~outside
    assert errors_ulp(result[inside], wanted[inside]).max() <= ACCURACY_ULP["pow"]
    zero = inside & (result == 0)
    assert np.array_equal(np.signbit(result[zero]), np.signbit(wanted[zero]))


def test_atan2_follows_annex_f(lib: Library) -> None:
    values = floats(np.concatenate([SPECIAL_BITS, SPECIAL_BITS | np.uint32(SIGN)]))
    y, x = (grid.ravel() for grid in np.meshgrid(values, values))
    result, wanted = lib("atan2", y, x), exact("atan2", y, x)
    assert errors_ulp(result, wanted).max() <= ACCURACY_ULP["atan2"]
    number = ~np.isnan(result)
    assert np.array_equal(np.signbit(result[number]), np.signbit(wanted[number]))


def test_tiny_arguments_keep_their_sign_and_value(lib: Library) -> None:
    tiny = floats([1, SIGN | 1, 0x00800000, 0x80800000, 0x007FFFFF])
    for name in ("sin", "tanh", "expm1", "log1p"):
        assert np.array_equal(bits_of(lib(name, tiny)), bits_of(tiny))


@settings(max_examples=300)
@given(
    first=st.integers(min_value=1, max_value=INF - 300),
    exponent=st.floats(min_value=0.05, max_value=15.99),
)
def test_powk_never_decreases(lib: Library, first: int, exponent: float) -> None:
    x = floats(first + np.arange(300, dtype=np.uint32))
    result = lib("powk", x, np.array(exponent_q27(exponent), dtype=np.int32))
    assert np.all(result[1:] >= result[:-1])


@settings(max_examples=200)
@given(first=st.integers(min_value=0, max_value=INF - 300), name=st.sampled_from(["tanh", "cbrt"]))
def test_odd_functions_are_odd(lib: Library, first: int, name: str) -> None:
    x = floats(first + np.arange(300, dtype=np.uint32))
    assert np.array_equal(bits_of(lib(name, -x)), bits_of(-lib(name, x)))


def test_header_states_the_accuracy_that_is_tested() -> None:
    stated = dict(re.findall(r"Error: esea_f32_(\w+) ([0-9.]+) ULP", HEADER.read_text()))
    assert {name: float(value) for name, value in stated.items()} == ACCURACY_ULP


def test_tables_are_what_the_derivation_renders() -> None:
    assert TABLES.read_text() == coefficients.render()
    assert coefficients.main(["--check"]) == 0


def test_stale_tables_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / TABLES.name
    monkeypatch.setattr(coefficients, "TABLES_PATH", copy)
    copy.write_text(TABLES.read_text().replace("LOG2_0 1", "LOG2_0 2"))
    assert coefficients.main(["--check"]) == 1
    assert "--write" in capsys.readouterr().err
    assert coefficients.main(["--write"]) == 0
    assert copy.read_bytes() == TABLES.read_bytes()


def test_a_missing_tool_skips_unless_required(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ESEA_REQUIRE_TOOLS", raising=False)
    with pytest.raises(pytest.skip.Exception, match="not installed"):
        tool("no-such-tool")
    monkeypatch.setenv("ESEA_REQUIRE_TOOLS", "1")
    with pytest.raises(pytest.fail.Exception, match="ESEA_REQUIRE_TOOLS"):
        tool("no-such-tool")


def test_constant_exponent_conversion() -> None:
    assert exponent_q27(2.77) == round(2.77 * 2**27)
    assert exponent_q27(-16.0) == -(2**31)
    for value in (16.0, -16.1, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"Q4\.27"):
            exponent_q27(value)


# Same bits everywhere: one program hashes the results for arguments that it makes itself.
CHECKSUM = """
#include "esea_f32.h"
uint32_t checksum(void);
static uint32_t state;
static uint32_t next(void)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return state;
}
static float as_float(uint32_t bits)
{
    union { uint32_t bits; float value; } u;
    u.bits = bits;
    return u.value;
}
/* Sign and significand of u, one of the exponents from the given one on. */
static float near_one(uint32_t u, uint32_t lowest, uint32_t mask)
{
    return as_float((u & 0x80FFFFFFu) + lowest + ((u >> 24) & mask) * 0x01000000u);
}
static uint32_t mix(uint32_t hash, float x)
{
    union { uint32_t bits; float value; } u;
    u.value = x;
    return (hash ^ u.bits) * 16777619u;
}
uint32_t checksum(void)
{
    uint32_t hash = 2166136261u;
    uint32_t i;
    state = 2463534242u;
    for (i = 0; i < COUNT; i++) {
        /* Every fourth argument is anything, the others make ordinary results. */
        const uint32_t a = next();
        const uint32_t b = next();
        const uint32_t y = next();
        const float x = i % 4u == 0u ? as_float(a) : near_one(a, 0x37800000u, 0xFu);
        const float z = i % 4u == 0u ? as_float(b) : near_one(b, 0x3C000000u, 0x3u);
        const float size = x < 0.0f ? -x : x;
        union { uint32_t bits; int32_t value; } exponent;
        exponent.bits = y;
        hash = mix(hash, esea_f32_powk(x, exponent.value));
        hash = mix(hash, esea_f32_powk(size, exponent.value));
        exponent.bits = y >> 4;
        hash = mix(hash, esea_f32_powk(size, exponent.value));
        hash = mix(hash, esea_f32_pow(x, z));
        hash = mix(hash, esea_f32_pow(size, z));
        hash = mix(hash, esea_f32_exp(z));
        hash = mix(hash, esea_f32_expm1(z));
        hash = mix(hash, esea_f32_log(size));
        hash = mix(hash, esea_f32_log1p(x));
        hash = mix(hash, esea_f32_tanh(z));
        hash = mix(hash, esea_f32_cbrt(x));
        hash = mix(hash, esea_f32_sqrt(size));
        hash = mix(hash, esea_f32_sin(x));
        hash = mix(hash, esea_f32_cos(x));
        hash = mix(hash, esea_f32_atan2(x, z));
    }
    return hash;
}
"""
HOSTED = """
#include <stdint.h>
#include <stdio.h>
uint32_t checksum(void);
int main(void) { printf("%08X", (unsigned)checksum()); return 0; }
"""
# A vector table and semihosting: nothing of a C library. Coprocessors 10 and 11 are the FPU;
# without one the write is lost.
BARE = """
#include <stdint.h>
uint32_t checksum(void);
static void call(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}
void entry(void)
{
    char text[9];
    uint32_t hash;
    int i;
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20;
    __asm volatile("dsb");
    __asm volatile("isb");
    hash = checksum();
    for (i = 0; i < 8; i++) text[i] = "0123456789ABCDEF"[(hash >> (28 - 4 * i)) & 15u];
    text[8] = 0;
    call(4, text);
    call(0x18, (void *)0x20026);
    for (;;) { }
}
__attribute__((section(".vectors"), used))
static void *const vectors[2] = {(void *)0x20003000, (void *)entry};
"""
LINKER = """
ENTRY(entry)
SECTIONS {
    . = 0; .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) }
    . = 0x20000000; .bss : { *(.bss*) *(.data*) }
}
"""
COUNT = 40_000
VARIANTS = {
    "gcc -O0": ("gcc", ["-std=c99", "-O0"]),
    "gcc -O3 fast-math": ("gcc", ["-std=gnu99", "-O3", "-ffast-math", "-funroll-loops"]),
    "gcc fma": ("gcc", ["-std=gnu99", "-O2", "-mfma", "-ffp-contract=fast"]),
    "gcc without clz": ("gcc", ["-std=c99", "-Os", "-DESEA_F32_PORTABLE_CLZ"]),
    "g++": ("g++", ["-x", "c++", "-std=c++11", "-O2", "-Wno-old-style-cast"]),
    "clang -O0": ("clang", ["-std=c99", "-O0"]),
    "clang -O3 fast-math": ("clang", ["-std=c99", "-O3", "-ffast-math"]),
}
M4F = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
BOARDS = {
    "M4F": ("mps2-an386", M4F),
    "M7": ("mps2-an500", ["-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"]),
    "M3": ("mps2-an385", ["-mcpu=cortex-m3", "-mthumb", "-mfloat-abi=soft"]),
    "M0": ("microbit", ["-mcpu=cortex-m0", "-mthumb", "-mfloat-abi=soft"]),
}


def checksum_sources(folder: Path, main: str) -> list[str | Path]:
    """Write the checksum program; returns what a compiler needs to build it."""
    program = folder / "checksum.c"
    program.write_text(CHECKSUM.replace("COUNT", f"{COUNT}u"))
    start = folder / "start.c"
    start.write_text(main)
    return [f"-I{HEADER.parent}", SOURCE, program, start]


@pytest.fixture(scope="module")
def host_checksum(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the checksum of the ordinary host build."""
    folder = tmp_path_factory.mktemp("checksum")
    run([tool("gcc"), "-std=c99", "-O2", *checksum_sources(folder, HOSTED), "-o", folder / "host"])
    checksum = run([folder / "host"]).stdout
    assert re.fullmatch("[0-9A-F]{8}", checksum)
    return checksum


@pytest.mark.ci
@pytest.mark.parametrize("variant", VARIANTS)
def test_compilers_and_options_change_no_bit(
    tmp_path: Path, host_checksum: str, variant: str
) -> None:
    if variant == "gcc fma" and " fma " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no fused multiply-add")
    compiler, options = VARIANTS[variant]
    run([tool(compiler), *options, *checksum_sources(tmp_path, HOSTED), "-o", tmp_path / "host"])
    assert run([tmp_path / "host"]).stdout == host_checksum


def test_cortex_a9_gives_the_same_bits(tmp_path: Path, host_checksum: str) -> None:
    compiler, emulator = tool("arm-linux-gnueabi-gcc"), tool("qemu-arm")
    options = [
        "-std=gnu99",
        "-O2",
        "-mcpu=cortex-a9",
        "-mfpu=vfpv3",
        "-mfloat-abi=softfp",
        "-static",
    ]
    run([compiler, *options, *checksum_sources(tmp_path, HOSTED), "-o", tmp_path / "a9"])
    assert run([emulator, "-cpu", "cortex-a9", tmp_path / "a9"]).stdout == host_checksum


@pytest.mark.ci
@pytest.mark.parametrize("board", BOARDS)
def test_microcontrollers_give_the_same_bits(
    tmp_path: Path, host_checksum: str, board: str
) -> None:
    compiler, emulator = tool("arm-none-eabi-gcc"), tool("qemu-system-arm")
    machine, options = BOARDS[board]
    script, image = tmp_path / "bare.ld", tmp_path / "bare.elf"
    script.write_text(LINKER)
    flags = ["-std=gnu99", "-O2", "-ffreestanding", "-nostdlib", "-nostartfiles", f"-T{script}"]
    run([compiler, *options, *flags, *checksum_sources(tmp_path, BARE), "-lgcc", "-o", image])
    semihosting = ["-nographic", "-semihosting-config", "enable=on,target=native"]
    done = run(
        [emulator, "-M", machine, *semihosting, "-kernel", image],
        stdin=subprocess.DEVNULL,
        timeout=60,
    )
    # Semihosting writes to standard error.
    assert host_checksum in done.stdout + done.stderr


@pytest.mark.ci
@pytest.mark.parametrize(
    ("compiler", "options"),
    [
        ("gcc", ["-std=c99"]),
        ("g++", ["-x", "c++", "-std=c++11"]),
        ("clang", ["-std=c99"]),
        ("clang++", ["-x", "c++", "-std=c++11"]),
        ("arm-none-eabi-gcc", ["-std=c99", *M4F]),
        ("arm-none-eabi-gcc", ["-std=c99", "-mcpu=cortex-m3", "-mthumb"]),
    ],
)
def test_compiles_clean_and_needs_nothing(
    tmp_path: Path, compiler: str, options: list[str]
) -> None:
    path, prefix = tool(compiler), "arm-none-eabi-" if compiler.startswith("arm") else ""
    for level in ("-O0", "-O2", "-Os"):
        compiled = tmp_path / "esea_f32.o"
        run([path, *options, level, "-ffreestanding", *WARNINGS, "-c", SOURCE, "-o", compiled])
        symbols = [
            line.split() for line in run([tool(f"{prefix}nm"), compiled]).stdout.splitlines()
        ]
        # No library, so in particular no double arithmetic; nothing writable; nothing unprefixed.
        assert [name for *_, kind, name in symbols if kind in "Uu"] == []
        assert [name for *_, kind, name in symbols if kind in "DdBbC"] == []
        exported = {name for *_, kind, name in symbols if kind in "TRVW"}
        assert exported == {f"esea_f32_{name}" for name in ACCURACY_ULP}


def test_no_undefined_behaviour(tmp_path: Path) -> None:
    compiler = tool("gcc")
    sanitize = ["-std=c99", "-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    values = ", ".join(f"0x{value:X}u" for value in SPECIAL_BITS)
    calls = "\n".join(
        f"            total += bits(esea_f32_{name}(x));"
        for name in ACCURACY_ULP
        if name not in BINARY
    )
    pairs = "\n".join(
        f"            total += bits(esea_f32_{name}(x, y));" for name in ("pow", "atan2")
    )
    main = f"""
#include <stdint.h>
#include <stdio.h>
#include "esea_f32.h"
uint32_t checksum(void);
static const uint32_t special[] = {{{values}}};
static uint32_t bits(float x) {{ union {{ float x; uint32_t u; }} b; b.x = x; return b.u; }}
static float value(unsigned i) {{ union {{ float x; uint32_t u; }} b;
    b.u = special[i % {len(SPECIAL_BITS)}u];
    if (i >= {len(SPECIAL_BITS)}u) b.u |= 0x80000000u;
    return b.x; }}
int main(void)
{{
    uint32_t total = checksum();
    for (unsigned i = 0; i < {2 * len(SPECIAL_BITS)}u; i++) {{
        const float x = value(i);
        for (unsigned k = 0; k < {2 * len(SPECIAL_BITS)}u; k++) {{
            const float y = value(k);
{calls}
{pairs}
            total += bits(esea_f32_powk(x, INT32_MIN + (int32_t)k));
            total += bits(esea_f32_powk(x, INT32_MAX - (int32_t)k));
            total += bits(esea_f32_powk(x, (int32_t)k - 50));
        }}
    }}
    printf("%08X", (unsigned)total);
    return 0;
}}
"""
    sources = checksum_sources(tmp_path, main)
    run([compiler, *sanitize, *sources, "-o", tmp_path / "clean"])
    run([tmp_path / "clean"])
    # Armed? The same program with one product in 32 bits has to stop.
    broken = tmp_path / "broken.c"
    right = "((int64_t)a * b)"
    assert SOURCE.read_text().count(right) == 1
    broken.write_text(SOURCE.read_text().replace(right, "(a * b)"))
    run(
        [
            compiler,
            *sanitize,
            *[broken if part == SOURCE else part for part in sources],
            "-o",
            tmp_path / "faulty",
        ]
    )
    done = subprocess.run([tmp_path / "faulty"], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "signed integer overflow" in done.stderr
