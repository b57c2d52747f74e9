"""What a few functions of C compute, read as formulas, against what the compiler makes of them."""

from __future__ import annotations

import itertools
import subprocess

import cffi
import numpy as np
import pytest

from esea_gen.verify.c_values import BOOL, INT, LONG, REAL, UINT, RefusedError
from esea_gen.verify.emitted_c import Reader, preprocessed
from esea_gen.verify.smt import Script

from .conftest import require_tool
from .smt_terms import Terms

HEAD = """
#include <stdint.h>
#include <stdbool.h>
typedef int32_t number_t;
typedef struct { float a; number_t n[3]; bool on; uint32_t big; } inner_t;
typedef struct { inner_t in; float b; } box_t;
"""
BODY = """
static number_t twice(number_t x) { return x + x; }
static int64_t wide(int32_t x, int32_t y) { return (int64_t)x * y; }
int32_t early(int32_t x, int32_t y) {
    if (x > 0) {
        if (y == 3) return -7;
        x += 2;
    } else
        x = y;
    { int32_t z = x & 15; x -= z; }
    return x * 3 - (y << 2);
}
float choose(float a, float b, int32_t c) {
    const float m = a < b ? a : b;
    const float k = 0.1f;
    if (c)
        return c && !(m > 1.5f) ? -m : __builtin_fabsf(b) + k;
    return a / b * 2 - +k;
}
uint32_t bits(uint32_t a, uint32_t b) {
    a ^= b;
    a |= 0x10u;
    a &= ~b;
    return (a >> 3 | 010) * 0xFFFFFFFF - (a != b) - (a >= b) * 2;
}
int64_t big(int32_t x, uint32_t y) {
    return wide(x, twice(x)) + (int64_t)y - 5L + 4000000000 - 0x80000000 * 1 + (x > y);
}
int32_t truth(int32_t x, float f) { return (x || f) + (x && f) * 2 + !x * 4 + (bool)f * 8; }
int32_t shifted(int32_t x) {
    return (x >> 3) + (int32_t)((uint32_t)x >> 3) - ~x + (-x) + (x <= -3) - (x >= 9);
}
void told(int32_t x, int32_t *y, float *z) {
    *y = x;
    if (x < 0)
        *y = -x;
    else {
        *y += 1;
    }
    *z = (float)*y;
    (void)x;
    ;
}
void step(const box_t *in, box_t *state, float *more) {
    if (in->in.on)
        state->in.n[1 + 1] = in->in.n[0] + state->in.n[2];
    state->b = in->b + in->in.a;
    state->in.on = in->in.big > 3;
    told(in->in.n[1], &state->in.n[0], &state->in.a);
    *more = state->b;
}
"""
WHOLE = [0, 1, 3, 4, 9, 17, -1, -3, -4, -(2**31), 2**31 - 1]
FLOATS = [0.0, 1.5, -2.25, 0.3, 1e20, -0.0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    require_tool("gcc")
    path = tmp_path_factory.mktemp("c")
    (path / "tried.c").write_text(HEAD + BODY)
    return path


@pytest.fixture(scope="module")
def compiled(folder):
    library = folder / "tried.so"
    flags = ["-std=c99", "-O1", "-fwrapv", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, "-o", library, folder / "tried.c"], check=True)
    ffi = cffi.FFI()
    ffi.cdef(
        """
        typedef struct { float a; int32_t n[3]; _Bool on; uint32_t big; } inner_t;
        typedef struct { inner_t in; float b; } box_t;
        int32_t early(int32_t x, int32_t y); float choose(float a, float b, int32_t c);
        uint32_t bits(uint32_t a, uint32_t b); int64_t big(int32_t x, uint32_t y);
        int32_t truth(int32_t x, float f); int32_t shifted(int32_t x);
        void told(int32_t x, int32_t *y, float *z);
        void step(const box_t *in, box_t *state, float *more);
        """
    )
    return ffi, ffi.dlopen(str(library))


def word(value: int, bits: int = 32) -> tuple[int, int]:
    return value % 2**bits, bits


def number(found) -> float:
    """As Python has it; words with a sign."""
    if isinstance(found, tuple):
        value, bits = found
        return value - 2**bits if value >> bits - 1 else value
    return float(found)


@pytest.mark.parametrize(
    ("name", "kinds", "made"),
    [
        ("early", {"x": INT, "y": INT}, INT),
        ("choose", {"a": REAL, "b": REAL, "c": INT}, REAL),
        ("bits", {"a": UINT, "b": UINT}, UINT),
        ("big", {"x": INT, "y": UINT}, LONG),
        ("truth", {"x": INT, "f": REAL}, INT),
        ("shifted", {"x": INT}, INT),
    ],
)
def test_a_function_of_numbers_is_what_the_compiler_makes_of_it(
    folder, compiled, name, kinds, made
):
    script = Script()
    reader = Reader(folder / "tried.c", script)
    unknown, values = reader.result(name)
    assert unknown == {n: f"|{n}|" for n in kinds}
    assert list(values) == ["return"]
    assert values["return"].type == made
    term = reader.term(values["return"])
    _, library = compiled
    values_ = {INT: WHOLE, UINT: [v % 2**32 for v in WHOLE], REAL: FLOATS}
    for given in itertools.product(*(values_[k] for k in kinds.values())):
        words = {
            n: np.float32(v) if k == REAL else word(v)
            for (n, k), v in zip(kinds.items(), given, strict=True)
        }
        found = number(Terms(script.lines, words)(term))
        expected = getattr(library, name)(*given)
        if made == UINT:
            found %= 2**32
        assert found == expected or (np.isnan(found) and np.isnan(expected)), given


def test_what_is_written_through_pointers(folder, compiled):
    script = Script()
    reader = Reader(folder / "tried.c", script)
    unknown, values = reader.result("told")
    assert list(unknown) == ["x"]
    assert list(values) == ["y", "z"]
    terms = {n: reader.term(v) for n, v in values.items()}
    ffi, library = compiled
    y, z = ffi.new("int32_t *"), ffi.new("float *")
    for x in WHOLE:
        library.told(x, y, z)
        at = Terms(script.lines, {"x": word(x)})
        assert (number(at(terms["y"])), number(at(terms["z"]))) == (y[0], z[0])


def test_structs_by_their_fields(folder, compiled):
    script = Script()
    reader = Reader(folder / "tried.c", script)
    memory = reader.call("step", frozenset({"in", "state"}))
    parts = ["a", "n[0]", "n[1]", "n[2]", "on", "big"]
    kinds = [REAL, INT, INT, INT, BOOL, UINT]
    for struct in ("in", "state"):
        assert {k: v for k, v in reader.fields.items() if k.startswith(f"{struct}.")} == {
            **{f"{struct}.in.{p}": k for p, k in zip(parts, kinds, strict=True)},
            f"{struct}.b": REAL,
        }
    written = reader.terms(memory)
    assert not [place for place in written if "#" in place]
    ffi, library = compiled
    given, state, more = ffi.new("box_t *"), ffi.new("box_t *"), ffi.new("float *")
    for on, n, most in itertools.product((False, True), WHOLE, (3, 4, 2**32 - 1)):
        given.b, getattr(given, "in").a = 0.7, -0.3
        inner, kept = getattr(given, "in"), getattr(state, "in")
        inner.on, inner.big = on, most
        inner.n[0], inner.n[1], kept.n[2] = 5, n, 100
        known = {
            **{"in.b": np.float32(0.7), "in.in.a": np.float32(-0.3), "in.in.on": on},
            **{"in.in.big": word(most), "in.in.n[0]": word(5), "in.in.n[1]": word(n)},
            "state.in.n[2]": word(100),
        }
        library.step(given, state, more)
        at = Terms(script.lines, known)
        found = {p: at(t) for p, t in written.items()}
        assert number(found["state.in.n[2]"]) == kept.n[2] == (105 if on else 100)
        assert number(found["state.in.n[0]"]) == kept.n[0]
        assert number(found["state.in.a"]) == kept.a
        assert found["state.in.on"] == kept.on
        assert number(found["state.b"]) == state.b
        assert number(found["more"]) == more[0]
    with pytest.raises(RefusedError, match=r"state.in.n\[2\] is read before it is written"):
        Reader(folder / "tried.c", Script()).call("step", frozenset({"in"}))


@pytest.mark.ci
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("int32_t f(int32_t x) { for (;;) x = 1; return x; }", "a For"),
        ("int32_t f(int32_t x) { while (x) x = 1; return x; }", "a While"),
        ("double f(int32_t x) { return 1.0f; }", "type 'double'"),
        ("float f(float x) { return x + 0.5; }", "the constant 0.5"),
        ("float f(float x) { return x + 0x1p3f; }", "the number 0x1p3f"),
        ("float f(float x) { return g(x); }", "the function 'g', whose body is not in the text"),
        ("int32_t f(float x) { return (int32_t)x; }", "a float becomes an integer"),
        ("int32_t f(int32_t x) { int32_t y; return x + y; }", "y is read before it is written"),
        ("int32_t f(int32_t x) { int32_t y[2]; y[x] = 1; return x; }", "a place in memory"),
        ("int32_t f(int32_t x) { if (x) return 1; x = 2; }", "a value is returned on one way only"),
        ("int32_t f(int32_t x) { return x++; }", "the operator 'p\\+\\+'"),
        ("int32_t f(int32_t x) { return x / 2; }", "'/' of integers"),
        ("int32_t f(int32_t x) { return x << 32; }", "a shift beyond the type's width"),
        ("int32_t f(int32_t x) { return x + 'a'; }", "the constant 'a'"),
        ("float f(float x) { return ~x; }", "the operator '~'"),
        ("int32_t h(int32_t x) { return x; }", "the function 'f' is not in the text"),
    ],
)
def test_what_is_not_understood_is_refused(tmp_path, text, words):
    require_tool("gcc")
    path = tmp_path / "one.c"
    path.write_text(HEAD + text)
    with pytest.raises(RefusedError, match=words):
        Reader(path, Script()).result("f")


CONSTANTS = [
    # Text, value, whether it has a sign, whether it has 64 bits.
    ("7", 7, True, False),
    ("0x7FFFFFFF", 2**31 - 1, True, False),
    ("2147483648", 2**31, True, True),
    ("0x80000000", 2**31, False, False),
    ("010", 8, True, False),
    ("0", 0, True, False),
    ("5u", 5, False, False),
    ("5L", 5, True, True),
    ("5uL", 5, False, True),
    ("0xFFu", 255, False, False),
    ("0x1FFFFFFFF", 2**33 - 1, True, True),
    ("4294967296u", 2**32, False, True),
]


def test_a_constant_has_the_type_that_c_gives_it(tmp_path):
    require_tool("gcc")
    path = tmp_path / "one.c"
    lines = [
        f"int64_t value{k}(int32_t x) {{ return {text}; }}\n"
        f"int32_t below{k}(int32_t x) {{ return {text} * 0 - 1 < 0; }}\n"
        f"int32_t wide{k}(int32_t x) {{ return ({text} * 0 + 2147483647u) * 4 > 4294967295u; }}\n"
        for k, (text, *_) in enumerate(CONSTANTS)
    ]
    path.write_text(HEAD + "".join(lines))
    script = Script()
    reader = Reader(path, script)
    for k, (text, *expected) in enumerate(CONSTANTS):
        made = [reader.result(f"{n}{k}")[1]["return"] for n in ("value", "below", "wide")]
        terms = [reader.term(v) for v in made]
        at = Terms(script.lines, {"x": word(0)})
        assert [number(at(t)) for t in terms] == expected, text


def test_what_the_preprocessor_refuses(tmp_path):
    require_tool("gcc")
    path = tmp_path / "one.c"
    path.write_text("#ifdef WRONG\n#error wrong\n#endif\n#include <stdint.h>\nint kept;\n")
    assert "kept" in preprocessed(path)
    with pytest.raises(RuntimeError, match=r"the preprocessor refused one.c"):
        preprocessed(path, ["WRONG"])
