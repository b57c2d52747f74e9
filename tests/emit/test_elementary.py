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
import numpy as np
import pytest

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
EXPONENTS = (2.77, 0.77, 1.0, 2.0, 0.5, -1.0, 1 / 3, -0.5, 3.7, -4.4)
EXPONENTS += (15.99, -15.99, 0.01, 2.0**-27, 0.0)
BINARY = {"powk", "pow", "atan2"}
NAN = 0x7FC00000
INF = 0x7F800000
ONE = 0x3F800000
SIGN = 0x80000000
# Zeros, ends and neighbours of them, powers of two, values where a function turns or ends.
SPECIAL = """
    00000000 00000001 00000002 00000003 007FFFFF 007FFFFE 00800000 00800001 7F7FFFFF
    7F7FFFFE 7F800000 7F800001 7FC00000 7FFFFFFF 3F7FFFFE 3F7FFFFF 3F800000 3F800001
    3F800002 3F000000 3EFFFFFF 40000000 40400000 3FC00000 3F7DFFFF 3F7E0000 3F81FFFF
    3F820000 3FB504F3 3FB504F4 30000000 2FFFFFFF 37000000 36FFFFFF 38000000 37FFFFFF
    32000000 31FFFFFF 41200000 411FFFFF 43000000 42FFFFFF 42B17217 42B17218 42CFF1B4
    42CFF1B5 42AEAC4F 42AEAC50 3FC90FDB 40490FDB 3F490FDB 3EAAAAAB 417FFFFF 41800000
    4B7FFFFF 4B800000 4B800001 461C4000 5F3759DF 3F7FFFFF
"""
SPECIAL_BITS = np.array([int(x, 16) for x in SPECIAL.split()], np.uint32)


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
            infinite, np.where(np.abs(wanted) >= 2.0**128 - 2.0**103 - 2.0**97, 0.0, np.inf), error
        )
        error = np.where(infinite & (np.sign(result) != np.sign(wanted)), np.inf, error)
        error = np.where(np.isnan(result) & np.isnan(wanted), 0.0, error)
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


def test_header_states_the_accuracy_that_is_tested() -> None:
    stated = dict(re.findall(r"Error: esea_f32_(\w+) ([0-9.]+) ULP", HEADER.read_text()))
    assert {name: float(value) for name, value in stated.items()} == ACCURACY_ULP


def test_tables_are_what_the_derivation_renders() -> None:
    assert TABLES.read_text() == coefficients.render()


def test_constant_exponent_conversion() -> None:
    assert exponent_q27(2.77) == round(2.77 * 2**27)
    assert exponent_q27(-16.0) == -(2**31)
    for value in (16.0, -16.1, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"Q4\.27"):
            exponent_q27(value)


# Same bits everywhere: one program hashes the results for arguments that it makes itself.
