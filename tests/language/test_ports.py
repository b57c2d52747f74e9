"""What crosses a Block's border and how a Block starts: by the definitions, worked out by hand."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.language.block import Block, Simulator, Solved
from esea_gen.language.component import check_ports
from esea_gen.language.ports import (
    Constant,
    Flag,
    Port,
    Tunable,
    clip,
    f32_inside,
    flag_word,
    in_range,
    port_ok,
    threshold,
    unit_of,
)

UNITS = {
    "rad": "rad",
    "deg": "deg",
    "rad_s": "rad/s",
    "rad_s2": "rad/s^2",
    "rad_s3": "rad/s^3",
    "Nm": "Nm",
    "Nm_rad": "Nm/rad",
    "Nm_rad3": "Nm/rad^3",
    "Nms_rad": "Nm s/rad",
    "Nm_s": "Nm/s",
    "Nm_s2": "Nm/s^2",
    "Nm_s_rad": "Nm/(rad s)",
    "1_rad": "1/rad",
    "1_s": "1/s",
    "1_s2": "1/s^2",
    "s": "s",
    "Hz": "Hz",
    "bits": "bit",
    "kgm2": "kg m^2",
    "J": "J",
    "W": "W",
    "C": "degC",
    "per_K": "1/K",
}


@pytest.mark.parametrize(("suffix", "unit"), UNITS.items())
def test_a_name_ends_in_its_unit(suffix, unit):
    name = f"some_{suffix}"
    assert unit_of(name) == unit
    assert Port(name, 0, 1, "made up").unit == unit
    assert Tunable(name, 0, 0, 1, "made up").unit == unit
    assert Constant(name, 1.0, "made up", "assumed").unit == unit
    assert unit_of(f"{name}_more") == "1"
    word = Port(name, 0, 1, "made up", flags=(Flag("BAD", "made up"),))
    assert word.unit == "bits"


@settings(max_examples=40)
@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ends_are_the_nearest_float32_numbers_inside(low, width):
    high = low + width
    found = f32_inside(low, high)
    port = Port("x", low, high, "made up") if found[0] < found[1] else None
    if port:
        assert (port.low, port.high) == found
    for end, given_end, way in zip(found, (low, high), (-1, 1), strict=True):
        assert float(np.float32(end)) == end
        assert way * end <= way * given_end
        beyond = float(np.nextafter(np.float32(end), np.float32(way * np.inf)))
        assert way * beyond > way * given_end
    assert threshold(width) == f32_inside(0.0, width)[1]


def test_a_bound_that_somebody_names_is_the_bound():
    # 0.1 lies below the least float32 inside, 0.7 above the greatest; both by less than a unit.
    t = Tunable("x", 0.1, 0.1, 0.7, "made up")
    low, high = f32_inside(0.1, 0.7)
    assert (t.low, t.default, t.high) == (low, low, high)
    assert low > 0.1
    assert high < 0.7
    assert (t.taken(0.1), t.taken(0.7)) == (low, high)
    for value in (low, high, 0.4, 0.0999999, 0.7000002, -1.0, 5.0):
        assert t.taken(value) == value
    unit = float(np.spacing(np.float32(low)))
    assert t.taken(low - unit) == low
    assert t.taken(low - 1.01 * unit) == low - 1.01 * unit
    unit = float(np.spacing(np.float32(high)))
    assert t.taken(high + unit) == high
    assert t.taken(high + 1.01 * unit) == high + 1.01 * unit
    assert math.isnan(t.taken(math.nan))
    assert Tunable("x", -0.7, -0.7, -0.1, "made up").taken(-0.1) == -low
    for default in (0.05, 0.8, math.nan):
        with pytest.raises(ValueError, match=r"tunable x: default \S+ outside \[0\.1"):
            Tunable("x", default, 0.1, 0.7, "made up")


def number(expression, *pairs) -> list[float]:
    """An expression at some values of its symbol."""
    (x,) = ca.symvar(expression)
    f = ca.Function("f", [x], [expression])
    return [float(f(v)) for v in pairs]


def test_a_value_is_plausible_inside_its_range():
    x = ca.SX.sym("x")
    tried = (-2.0, -1.0, 0.0, 3.0, 3.5, math.nan, math.inf, -math.inf)
    assert number(in_range(x, -1.0, 3.0), *tried) == [0, 1, 1, 1, 0, 0, 0, 0]
    assert number(port_ok(x, Port("p", -1.0, 3.0, "made up")), *tried) == [0, 1, 1, 1, 0, 0, 0, 0]
    assert number(clip(x, -1.0, 3.0), *tried[:5]) == [-1, -1, 0, 3, 3]


@pytest.mark.parametrize(("low", "high"), [(-1.0, 2.0), (-2.0, 1.0)])
def test_a_vector_by_the_sum_of_its_magnitudes(low, high):
    port, v = Port("p", low, high, "made up", 3), ca.SX.sym("v", 3)
    f = ca.Function("f", [v], [port_ok(v, port)])
    # Three times the larger magnitude, and a thousandth.
    most = float(np.float32(6.006))
    above = float(np.nextafter(np.float32(most), np.float32(7)))
    for value, ok in (
        ([0.0, 0.0, 0.0], 1),
        ([2.0, -2.0, 2.0], 1),
        ([most, 0.0, 0.0], 1),
        ([0.0, -most, 0.0], 1),
        ([0.0, 0.0, above], 0),
        ([-3.0, 3.0, 0.1], 0),
        ([0.0, math.nan, 0.0], 0),
        ([0.0, 0.0, -math.inf], 0),
        ([math.nan, 0.0, 0.0], 0),
    ):
        assert float(f(value)) == ok, value


def test_flags_stand_in_a_word_first_one_lowest():
    bits = ca.SX.sym("b", 24)
    word = ca.Function("f", [bits], [flag_word(bits[i] for i in range(24))])
    for k in range(24):
        one = np.zeros(24)
        one[k] = 1
        assert float(word(one)) == 2**k
    assert float(word(np.ones(24))) == 2**24 - 1
    with pytest.raises(ValueError, match="at most 24 flags"):
        flag_word([ca.SX(1)] * 25)
    assert float(flag_word([])) == 0


TAKEN = """
int,xor,co_await,char8_t,typeof,_Bool,_x,a__b,NAN,INFINITY,EOF,errno,assert,I,abs,B0,F,PI,DEC,bit,
round,sq,radians,word,min,1x,theta-rad,größe,,a b"""


@pytest.mark.parametrize("name", TAKEN.replace("\n", "").split(","))
@pytest.mark.parametrize(
    "define",
    [
        lambda n: Port(n, 0, 1, "meaning"),
        lambda n: Tunable(n, 0.5, 0, 1, "meaning", "source", "assumed"),
        lambda n: check_ports(n, 1e-3),
    ],
    ids=["port", "tunable", "block"],
)
def test_a_name_that_c_or_arduino_has_taken_is_rejected(define, name):
    """And the name that the message proposes is none of them."""
    with pytest.raises(ValueError, match=r"(port|tunable|block) name ") as told:
        define(name)
    define(str(told.value).rpartition("take ")[2].split("'")[1])


# -- the guard, and what a Block refuses -----------------------------------------------------------


def guarded(**more) -> Block:
    """Keeps the last valid x and the sum of y; tells what the guard found."""

    def step(c, s, u, guard, label):
        label("kept", u.x_rad, "what is used")
        return (
            {"last_rad": u.x_rad, "sum": s.sum + u.y[0] - u.y[1], "own": s.own + 1},
            {
                "x_rad": u.x_rad,
                "pair": [u.y[1], u.y[0]],
                "status": flag_word([ca.logic_not(guard.inputs_ok), ca.logic_not(guard.state_ok)]),
            },
        )

    flags = (Flag("INPUT_INVALID", "bad input"), Flag("STATE_REPAIRED", "bad state"))
    return Block.define(
        "guarded",
        "made up",
        period_s=1e-3,
        state=(
            Port("last_rad", -1, 1, "last valid", init=0.5),
            Port("sum", -8, 8, "sum", init=1.0),
            Port("own", 0, 9, "mended by the step", init=3.0, repair="block"),
        ),
        inputs=(
            Port("x_rad", -1, 1, "held", on_invalid="last_rad"),
            Port("y", -2, 2, "replaced", 2, on_invalid=0.25),
        ),
        outputs=(
            Port("x_rad", -1, 1, "used"),
            Port("pair", -2, 2, "used, the other way round", 2),
            Port("status", 0, 3, "status", flags=flags),
        ),
        **{"step": step} | more,
    )


def test_the_guard_holds_replaces_and_starts_afresh():
    block = guarded()
    assert [(n, c) for n, c in block.labels if n not in ("kept", "inputs_ok")] == [
        ("state_ok", "Guard: a corrupt state starts the block afresh."),
        ("x_rad_ok", ""),
        ("x_rad_used", "Guard: an invalid input is replaced."),
        ("y_ok", ""),
    ]
    assert dict(block.labels)["kept"] == "what is used"
    assert list(block.flag_results) == [3 + 2]
    assert block.status_port is block.outputs[2]
    assert list(block.kernels) == ["step"]
    s = block.simulator()
    assert isinstance(s, Simulator)
    nan = math.nan
    for x, y, used, pair, word, after in (
        (0.25, [1.0, 0.5], 0.25, [0.5, 1.0], 0, (0.25, 1.5, 4)),
        (nan, [1.0, 0.5], 0.25, [0.5, 1.0], 1, (0.25, 2.0, 5)),
        (1.5, [9.0, 0.0], 0.25, [0.25, 0.25], 1, (0.25, 2.0, 6)),
        (-1.0, [-2.0, 2.0], -1.0, [2.0, -2.0], 0, (-1.0, -2.0, 7)),
    ):
        out = s.step(x_rad=x, y=np.array(y))
        assert (out["x_rad"], out["pair"].tolist(), out["status"]) == (used, pair, word)
        assert type(out["x_rad"]) is float
        assert type(out["status"]) is int
        assert tuple(float(v[0]) for v in s.state.values()) == after
    # One state outside: those that the guard mends begin again, the Block's own goes on.
    s.state = {"sum": np.array([9.0])}
    out = s.step(x_rad=2.0, y=np.zeros(2))
    assert (out["x_rad"], out["status"]) == (0.5, 3)
    assert {n: v.tolist() for n, v in s.state.items()} == {
        **{"last_rad": [0.5], "sum": [1.0], "own": [8.0]}
    }
    s.reset()
    assert {n: v.tolist() for n, v in s.state.items()} == {
        **{"last_rad": [0.5], "sum": [1.0], "own": [3.0]}
    }
    # What is read is a copy; a whole run gives columns of the ports' shapes.
    s.state["sum"][:] = 7.0
    y, after = s.run({"x_rad": [0.5, nan], "y": [[1.0, 0.0], [0.0, 2.0]]})
    assert {n: v.tolist() for n, v in y.items()} == {
        **{"x_rad": [0.5, 0.5], "pair": [[0.0, 1.0], [2.0, 0.0]], "status": [0.0, 1.0]}
    }
    assert {n: v.tolist() for n, v in after.items()} == {
        **{"last_rad": [0.5, 0.5], "sum": [2.0, 0.0], "own": [4.0, 5.0]}
    }
    with pytest.raises(TypeError, match=r"guarded.step takes .'x_rad', 'y'., got .'x_rad'."):
        s.step(x_rad=0.0)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"facts": {"other": (0, 1)}}, r"block guarded: facts of values .*: \['other'\]"),
        ({"solved": {"kept": Solved("kept", 1.0, 1.0)}}, "kept needs a fact and kept a label"),
        (
            {"facts": {"kept": (0, 1)}, "solved": {"kept": Solved("gone", 1.0, 1.0)}},
            "kept needs a fact and gone a label",
        ),
        *(
            (
                {"facts": {"kept": (0, 1)}, "solved": {"kept": Solved("y_ok", *numbers)}},
                "the slope of y_ok must be above 0",
            )
            for numbers in ((1.0, 0.0), (-1e-9, 1.0), (1.0, 1.0, -1e-9), (1.0, math.nan))
        ),
        ({"split": {"s_x_rad": (0.5,)}}, r"splits of what is no .*: \['s_x_rad'\]"),
    ],
)
def test_what_a_block_refuses(more, words):
    with pytest.raises(ValueError, match=words):
        guarded(**more)


def test_what_is_set_is_known_and_inside():
    block = Block.define(
        "set",
        "made up",
        period_s=1e-3,
        state=(),
        inputs=(Port("x", -1, 1, "x"),),
        outputs=(Port("y", -9, 9, "y"),),
        tunables=(Tunable("a", 2.0, 0.1, 4.0, "a"), Tunable("b", 1.0, -1.0, 1.0, "b")),
        coefficients=(Port("c", -9, 9, "c"), Port("d", -9, 9, "d", 2)),
        prepare=lambda t: {"c": t.a + t.b, "d": [t.a, t.b]},
        step=lambda c, s, u, guard, label: ({}, {"y": c.c * u.x + c.d[0] - c.d[1]}),
    )
    assert block.status_port is None
    assert block.default_tunables() == {"a": 2.0, "b": 1.0}
    assert block.taken_tunables(None) == {"a": 2.0, "b": 1.0}
    low = f32_inside(0.1, 4.0)[0]
    assert block.taken_tunables({"b": -1, "a": 0.1}) == {"a": low, "b": -1.0}
    assert block.taken_tunables({"b": 1, "a": 4}) == {"a": 4.0, "b": 1.0}
    with pytest.raises(ValueError, match=r"block set has no tunable e; it has \['a', 'b'\]"):
        block.taken_tunables({"e": 1.0})
    for value in (4.1, 0.05, math.nan):
        with pytest.raises(ValueError, match=r"a = \S+ is outside \[0\.1\d*, 4\.0\]"):
            block.taken_tunables({"a": value})
    s = block.simulator({"a": 3.0})
    assert {n: v.tolist() for n, v in s.coefficients.items()} == {"c": [4.0], "d": [3.0, 1.0]}
    assert s.step(x=0.5) == {"y": 0.5 * 4 + 3 - 1}
    s.coefficients["c"][:] = 9.0  # a copy
    s.coefficients = {"d": [1.0, 0.5], "no such": 3.0}
    assert s.step(x=1.0) == {"y": 4 + 1 - 0.5}
