"""Formats of ports and values, lowering and its messages: small cases worked out by hand."""

from __future__ import annotations

import math
import operator
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.lowering import lower, names_in, rewrite
from esea_gen.emit.fixed.plan import (
    FieldPlan,
    Planner,
    coefficients_raw,
    defined,
    lowered_values,
    port_fraction,
    raw_places,
    run_lowered,
)
from esea_gen.emit.fixed.values import (
    NARROW_LIMIT,
    WIDE_LIMIT,
    LoweringError,
    Source,
    Target,
    best_fraction,
    is_power,
    last_raw,
    local_name,
    stem,
    stored,
    threshold,
    two,
)
from esea_gen.emit.walker import Kernel, Node, fuse_selects, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
WORD = 2**31

# -- numbers and names -----------------------------------------------------------------------------


def test_the_finest_format_of_a_range_is_the_last_that_holds_it():
    limit = WORD - 1
    for value in (1, 3, Fraction(1, 3), Fraction(4, 7), Fraction(1, 10**6), limit, WORD, 8 * limit):
        for low, high in ((0, value), (-value, 0), (-value, value), (-value / 7, value)):
            f = best_fraction(Fraction(low), Fraction(high))
            fits = [
                high * two(k) <= limit and -low * two(k) <= limit + 1 for k in (f, f + 1)
            ]  # one more below zero
            assert fits == [True, False], (low, high)
    assert best_fraction(Fraction(-1), Fraction(0)) == 31
    assert best_fraction(Fraction(0), Fraction(1)) == 30
    assert best_fraction(Fraction(0), Fraction(1), 2**61 - 1) == 60
    assert best_fraction(Fraction(0), Fraction(0)) == 30
    assert best_fraction(Fraction(0), Fraction(1, 2**80)) == 90  # no format is finer
    # The words of C; of 64 bits two are left for rounding and for the sum of two.
    assert (NARROW_LIMIT, WIDE_LIMIT) == (2**31 - 1, 2**61 - 1)
    assert [two(k) for k in (3, 0, -2)] == [8, 1, Fraction(1, 4)]


def test_names_lose_their_unit_and_gain_their_format():
    for name, base in (
        ("theta_rad", "theta"),
        ("omega_rad_s", "omega"),
        ("tau_Nm", "tau"),
        ("gain", "gain"),
        ("_rad", "_rad"),  # nothing would be left
    ):
        assert stem(name) == base
    assert local_name("theta_rad", 28) == "theta_q28"
    assert local_name("theta_rad_used", 0) == "theta_used_q0"
    assert local_name("theta", -3) == "theta_qm3"


def test_powers_of_two_and_errors_of_stored_numbers():
    powers = (1, 2, -4, Fraction(1, 2), Fraction(-1, 8), 2**70)
    others = (0, 3, -6, Fraction(1, 3), Fraction(3, 4), Fraction(4, 3), 2**70 + 1)
    assert all(is_power(Fraction(c)) for c in powers)
    assert not any(is_power(Fraction(c)) for c in others)
    assert stored(0.0, 1e-9) == {1: 1e-9}
    assert stored(2e-9, 0.0) == {0: 2e-9}


@pytest.mark.parametrize("c", [Fraction(3, 4), Fraction(1, 3), Fraction(-1, 3), Fraction(0)])
def test_the_last_raw_number_for_which_a_comparison_holds(c):
    raws = range(-40, 41)
    holds = {
        (True, False): lambda v: v <= c,
        (True, True): lambda v: v < c,
        (False, False): lambda v: v >= c,
        (False, True): lambda v: v > c,
    }
    for (upper, strict), test in holds.items():
        for fraction in (0, 2, 4):
            inside = [r for r in raws if test(Fraction(r, 2**fraction))]
            found = last_raw(c, fraction, strict, upper)
            assert found == (max(inside) if upper else min(inside))


def test_a_threshold_beyond_the_type_keeps_its_number():
    x = ex.read("x", 32, -WORD, WORD - 1)
    for raw, bits in ((WORD - 1, 32), (-WORD, 32), (WORD, 64), (-WORD - 1, 64)):
        t = threshold(raw, x)
        assert (t.op, t.bits, t.low, t.high, t.data) == ("literal", bits, raw, raw, (raw,))
    assert ex.compare("le", x, threshold(WORD, x)) == ex.literal(1, 1)


# -- lowering --------------------------------------------------------------------------------------


def kernel_of(*expressions) -> Kernel:
    return rewrite(fuse_selects(walk(ca.Function("f", [X, Y], list(expressions)))))


def lowered_of(kernel: Kernel, given, targets=None, **more):
    """Lowered with inputs of these fractions and raw ends."""

    def source(argument: int, _element: int) -> Source:
        return Source(f"x{argument}", f"in->x{argument}", *given[argument], f"port{argument}")

    targets = targets or [[Target(f"y{k}", 20)] for k in range(len(kernel.results))]
    return lower(kernel, source, targets, block="tried", **more)


def run(lowered, x, y=None) -> list[list[int]]:
    columns = [np.array(v, object) for v in (x, y if y is not None else [0] * len(x))]
    places = {f"in->x{k}": c for k, c in enumerate(columns)}
    return [[int(v) for v in r[0]] for r in run_lowered(lowered, places, len(x))]


HALF = (28, -(2**27), 2**27)  # -0.5 to 0.5
ALL = (28, -WORD, WORD - 1)


def test_a_result_is_rounded_to_its_port_and_cut_at_its_ends():
    kernel = kernel_of(X)
    for fraction, x, wanted in (
        (26, [-6, -5, 5, 6, 7], [-1, -1, 1, 2, 2]),  # by four, halves upwards
        (30, [-3, 5], [-12, 20]),
    ):
        lowered = lowered_of(kernel, [HALF], [[Target("y", fraction)]])
        assert run(lowered, x)[0] == wanted
        assert lowered.conversions == ((2.0 ** -(fraction + 1) if fraction < 28 else 0.0,),)
        assert lowered.saturations == ()
    # As much as 8 in units of 2^-29 has no place in 32 bits: cut, and told.
    lowered = lowered_of(kernel, [ALL], [[Target("y", 29)]])
    assert run(lowered, [-WORD, WORD - 1, 9])[0] == [-WORD, WORD - 1, 18]
    assert lowered.saturations == ("y",)
    lowered = lowered_of(kernel, [HALF], [[Target("y", 28, -7, 9)]])
    assert run(lowered, [-8, -7, 9, 10])[0] == [-7, -7, 9, 9]
    assert lowered.saturations == ("y",)
    assert (lowered.results[0][0].low, lowered.results[0][0].high) == (-7, 9)


def test_a_sign_turned_and_a_sign_taken():
    x = [-(2**27), -1, 0, 1, 2**27]
    lowered = lowered_of(kernel_of(-X, ca.sign(X)), [HALF], [[Target("a", 28)], [Target("b", 0)]])
    assert run(lowered, x) == [[-v for v in x], [-1, -1, 0, 1, 1]]
    (taken,) = (v for v in lowered.values if v is not None and (v.low, v.high) == (-1, 1))
    assert (taken.fraction, taken.local) == (0, 0.0)

    # The least number of a word has no negative in it: 64 bits, cut at the port alone.
    lowered = lowered_of(kernel_of(-X), [ALL], [[Target("a", 28)]])
    assert run(lowered, [-WORD, WORD - 1, 5])[0] == [WORD - 1, 1 - WORD, -5]
    assert lowered.saturations == ("a",)
    assert run(lowered_of(kernel_of(-X), [(28, 1 - WORD, 9)]), [1 - WORD])[0] == [2**23]


INSIDE = [-(2**25) - 1, -(2**25), 0, 2**26, 2**26 + 1]  # round -0.125 and 0.25


@pytest.mark.parametrize(
    ("condition", "low", "high", "wanted"),
    [
        (ca.logic_and(X <= 0.25, X >= -0.125), -(2**25), 2**26, [0, 1, 1, 1, 0]),
        (ca.logic_and(X > -0.125, X < 0.25), 1 - 2**25, 2**26 - 1, [0, 0, 1, 0, 0]),
        (X <= 0.25, -WORD, 2**26, [1, 1, 1, 1, 0]),
        (X >= -0.125, -(2**25), WORD - 1, [0, 1, 1, 1, 1]),
        (ca.logic_and(X < 0.25, ca.logic_and(X <= 0.5, X > -0.125)), 1 - 2**25, 2**26 - 1,
         [0, 0, 1, 0, 0]),
        (ca.logic_or(X <= 0.25, X >= 0.5), -WORD, WORD - 1, [1, 1, 1, 1, 0]),
        (ca.logic_and(X <= 0.25, Y > 0.25), -WORD, 2**26, [0] * 5),
        (ca.logic_and(X <= 0.25, Y < 0.25), -WORD, 2**26, [1, 1, 1, 1, 0]),
    ],
)  # fmt: skip
def test_a_choice_knows_what_its_condition_says_of_what_it_chooses(condition, low, high, wanted):
    kernel = kernel_of(ca.if_else(condition, X, 0))
    lowered = lowered_of(kernel, [ALL, ALL], [[Target("y", 28)]])
    value = lowered.values[kernel.results[0][0]]
    assert (value.low, value.high) == (Fraction(low, 2**28), Fraction(high, 2**28))
    assert run(lowered, INSIDE)[0] == [v * w for v, w in zip(INSIDE, wanted, strict=True)]


def test_a_constant_result_and_its_error():
    lowered = lowered_of(kernel_of(ca.SX(0.3)), [HALF], [[Target("y", 20)]])
    raw = round(0.3 * 2**20)
    assert run(lowered, [0])[0] == [raw]
    assert lowered.conversions[0][0] == pytest.approx(abs(raw / 2**20 - 0.3), rel=1e-9)


def test_a_memory_that_is_only_chosen_passes_unrounded_in_any_format():
    # A clip at 0.3 could be held in finer units than the port's; the way back would round.
    for expression in (ca.fmin(X, 0.3), ca.if_else(Y > 0, X, 0.3), ca.fmax(ca.fmin(X, 0.4), -0.3)):
        lowered = lowered_of(kernel_of(expression), [(20, -(2**18), 2**18), HALF])
        x = [-(2**18), -77, 0, 12345, 2**18]
        found = run(lowered, x, [1] * 5)[0]
        inside = [k for k, v in enumerate(x) if abs(v) < 0.3 * 2**20]
        assert [found[k] for k in inside] == [x[k] for k in inside]
        assert lowered.conversions[0][0] == 0.0
    # Half of it is wanted finer: the port that is coarser rules what both share.
    kernel = kernel_of(ca.fmin(X, Y), ca.fmin(X, Y))
    lowered = lowered_of(kernel, [ALL, HALF], [[Target("a", 28)], [Target("b", 24)]])
    assert lowered.values[kernel.results[0][0]].fraction == 24


def test_what_ends_in_comparisons_alone_keeps_every_bit():
    # x + y of 4 and 8 would lose two bits in 32; its comparison must not.
    given = [(30, -WORD, WORD - 1), (28, -WORD, WORD - 1)]
    kernel = kernel_of(X + Y > 0.25)
    lowered = lowered_of(kernel, given, [[Target("y", 0)]])
    (i,) = (k for k, n in enumerate(kernel.nodes) if n.op == "add")
    assert (lowered.values[i].expr.bits, lowered.values[i].fraction) == (64, 30)
    edge = 2**28  # 0.25, in units of 2^-30
    assert run(lowered, [edge, edge + 1, edge - 3], [0, 0, 1])[0] == [0, 1, 1]
    # Wanted as a number as well it is one of 32 bits.
    kernel = kernel_of(X + Y > 0.25, X + Y)
    lowered = lowered_of(kernel, given)
    (i,) = (k for k, n in enumerate(kernel.nodes) if n.op == "add")
    assert (lowered.values[i].expr.bits, lowered.values[i].fraction) == (32, 27)
    # Nor is it where the last operation of all takes it as a number.
    last = lowered_of(kernel_of(0.7 * (X + Y)), given)
    assert [v.expr.bits for v in last.values if v is not None] == [32] * 4
    # Rounded to 2^-27 from 2^-28, or from 2^-30 before that: at most half a unit each.
    assert 2.0**-29 <= lowered.values[i].local <= 3 * 2.0**-28


@pytest.mark.parametrize("wide", [False, True])
def test_a_sum_is_computed_in_the_width_that_it_has(wide):
    kernel = kernel_of(X + Y)
    (i,) = kernel.results[0]
    lowered = lowered_of(kernel, [HALF, HALF], wide={i} if wide else ())
    (step,) = (s for s in lowered.steps if s.node == i)
    # Halves of 28 bits behind the point fit as they are; 64 bits take each in turn.
    assert (step.expr.op, step.expr.bits) == ("add", 64 if wide else 32)
    assert {a.op for a in step.expr.args} == ({"cast"} if wide else {"ref"})
    assert lowered.values[i].local == 0.0


@pytest.mark.parametrize("value", [0.0, 1.0, -2.5])
def test_a_condition_that_is_a_number_chooses_for_good(value):
    nodes = (Node("input"), Node("input", source=(1, 0)), Node("const", value=value))
    kernel = Kernel("f", (*nodes, Node("select", (2, 0, 1))), ((3,),))
    lowered = lowered_of(kernel, [HALF, (28, -9, 9)], [[Target("y", 28)]])
    assert run(lowered, [5, -2], [9, -9])[0] == ([5, -2] if value else [9, -9])
    assert lowered.values[3].high == (Fraction(1, 2) if value else Fraction(9, 2**28))


def test_steps_are_named_once_and_none_is_left_over():
    kernel = kernel_of(3.1 * X + 0.7 * X * Y, X + Y)
    (a,) = kernel.results[0]
    lowered = lowered_of(kernel, [HALF, HALF], labels={a: ("sum_Nm", "what it is")})
    names = [s.name for s in lowered.steps]
    assert len(set(names)) == len(names)
    assert "sum_q28" in names or any(n.startswith("sum_q") for n in names)
    (said,) = (s for s in lowered.steps if s.name.startswith("sum_q"))
    assert (said.comment, said.node) == ("what it is", a)
    used = {n for s in lowered.steps for n in names_in(s.expr)}
    used |= {n for r in lowered.results for e in r for n in names_in(e)}
    assert used == set(names)
    # Each stands after all that it refers to.
    for k, s in enumerate(lowered.steps):
        assert names_in(s.expr) <= set(names[:k])
    assert [s.node for s in lowered.steps if s.name.startswith("x")] == [
        k for k, n in enumerate(kernel.nodes) if n.op == "input"
    ]


def test_a_checked_number_is_cut_for_all_but_its_check():
    kernel = kernel_of(ca.if_else(X <= 0.5, X * Y, 0.25))
    check = next(k for k, n in enumerate(kernel.nodes) if n.op == "le")

    def source(argument: int, _element: int) -> Source:
        return Source(f"x{argument}", f"in->x{argument}", *HALF, "p", argument == 0)

    lowered = lower(kernel, source, [[Target("y", 28)]], checks={check}, block="tried")
    x = [2**27, 2**27 + 1, WORD - 1, -(2**26)]
    # Beyond one half the check finds it; what it lets by is multiplied as it is.
    assert run(lowered, x, [2**27] * 4)[0] == [2**26, 2**26, 2**26, -(2**25)]
    assert {s.name for s in lowered.steps} >= {"x0_held_q28", "x0_q28"}
    trusted = lowered_of(kernel, [HALF, HALF], [[Target("y", 28)]])
    assert not any("held" in s.name for s in trusted.steps)


@pytest.mark.parametrize(("a", "b"), [(0.25, 0.5), (0.5, 0.25), (-0.5, -0.5)])
@pytest.mark.parametrize(
    ("op", "holds"),
    [("lt", operator.lt), ("le", operator.le), ("eq", operator.eq), ("ne", operator.ne)],
)
def test_two_numbers_are_compared_for_good(a, b, op, holds):
    numbers = (Node("const", value=a), Node("const", value=b), Node(op, (2, 3)))
    nodes = (Node("input"), Node("input", source=(1, 0)), *numbers, Node("select", (4, 0, 1)))
    lowered = lowered_of(Kernel("f", nodes, ((5,),)), [HALF, (28, -9, 9)], [[Target("y", 28)]])
    assert run(lowered, [5, -2], [9, -9])[0] == ([5, -2] if holds(a, b) else [9, -9])
    condition = lowered.values[4]
    assert (condition.expr.op, condition.expr.bits, condition.fraction) == ("literal", 1, 0)
    assert (condition.expr.low, condition.expr.high) == (int(holds(a, b)),) * 2


def test_one_over_x_is_a_quotient():
    kernel = rewrite(walk(ca.Function("f", [X], [1 / X + X])))
    ops = [n.op for n in kernel.nodes]
    assert ops == ["input", "const", "div", "add"]
    one, quotient = kernel.nodes[1], kernel.nodes[2]
    assert (one.value, quotient.args) == (1.0, (1, 0))
    assert sorted(kernel.nodes[3].args) == [0, 2]
    assert kernel.results == ((3,),)


@pytest.mark.parametrize(
    ("expression", "given", "words"),
    [
        (X / Y, [HALF, HALF], "the divisor's range [-0.5, 0.5] holds zero"),
        (X / Y, [HALF, HALF], "operation 'div' (value v2, of port0, port1) cannot be lowered"),
    ],
)
def test_a_refusal_names_where_and_why(expression, given, words):
    with pytest.raises(LoweringError) as told:
        lowered_of(kernel_of(expression), given)
    assert words in str(told.value)


def test_a_refusal_names_the_labels_that_are_nearest():
    kernel = kernel_of((X + Y) / (X * Y))
    add, mul, div = (next(k for k, n in enumerate(kernel.nodes) if n.op == op)
                     for op in ("add", "mul", "div"))  # fmt: skip
    near = {add: ("total", ""), mul: ("area", "")}
    for labels, words in (
        (near, f"(value v{div}, of area, total)"),
        ({add: ("total", "")}, f"(value v{div}, of port0, port1, total)"),
        ({**near, div: ("ratio", "")}, f"(value v{div}, ratio)"),
    ):
        with pytest.raises(LoweringError, match="block tried: operation 'div'") as told:
            lowered_of(kernel, [HALF, HALF], labels=labels)
        assert words in str(told.value)


def test_an_operation_without_a_rule_and_a_bare_reciprocal_are_refused():
    for op, words in (("atan", "there is no rule for it"), ("inv", "reached the lowering")):
        kernel = Kernel("f", (Node("input"), Node(op, (0,))), ((1,),))
        with pytest.raises(LoweringError, match=words):
            lowered_of(kernel, [HALF])
    kernel = Kernel("f", (Node("input"), Node("const"), Node("div", (0, 1))), ((2,),))
    with pytest.raises(LoweringError, match="the divisor is zero"):
        lowered_of(kernel, [HALF])
    kernel = Kernel("f", (Node("input"),), ((0,),))
    with pytest.raises(LoweringError, match="status word y is not built by flag_word"):
        lowered_of(kernel, [HALF], [[Target("y", 0, word=True)]])


SEVEN = float(np.float32(0.7))  # in single precision, just below 0.7


# -- plans -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high", "fraction", "ends"),
    [
        (-1.0, 1.0, 30, (-(2**30), 2**30)),
        (0.0, 0.5, 31, (0, 2**30)),  # 31 at most
        (-1.0, 0.0, 31, (-WORD, 0)),
        (0.0, 1000.0, 21, (0, 1000 * 2**21)),
        (0.0, 0.7, 31, (0, math.floor(Fraction(SEVEN) * WORD))),
        (-0.7, 0.0, 31, (math.ceil(Fraction(-SEVEN) * WORD), 0)),
        (0.0, 1e10, -3, (0, 10**10 // 8)),
    ],
)
def test_a_ports_format_leaves_room_for_its_range(low, high, fraction, ends):
    port = Port("x_rad", low, high, "any", 3)
    assert port_fraction(port) == fraction
    f = FieldPlan(port, fraction, *ends)
    assert (f.name, f.size, f.lsb) == ("x_rad", 3, 2.0**-fraction)
    assert f.port_range == ends
    # The nearest, a half upwards, no further than its ends.
    one, at = f.lsb, ends[0] + 7
    assert [f.raw((at + d) * one) for d in (0, 0.49, 0.5, -0.5)] == [at, at, at + 1, at]
    assert (f.raw(high + 9 * one), f.raw(low - 9 * one)) == (ends[1], ends[0])


def test_a_range_beyond_the_word_is_cut_to_it():
    f = FieldPlan(Port("x_rad", -4.0, 4.0, "any"), 31, 0, 1)
    assert f.port_range == (-WORD, WORD - 1)


def small() -> Block:
    """y = gain (x + x') + m, m' = y / 4, with a switch and a status word."""

    def step(c, s, u, guard, label):
        total = label("total_rad", c.gain * (u.x_rad[0] + u.x_rad[1]))
        y = total + s.m_rad
        on = ca.logic_or(s.on > 0, y > 0.5)
        return (
            {"m_rad": y / 4, "on": on},
            {"y_rad": y, "status": flag_word([on, ca.logic_not(guard.inputs_ok)])},
        )

    return Block.define(
        "small",
        "A gain with a memory",
        period_s=0.001,
        tunables=(Tunable("half_gain", 1.0, 0.5, 1.5, "half of the gain"),),
        coefficients=(Port("gain", 0.0, 100.0, "gain"),),
        prepare=lambda t: {"gain": 2 * t.half_gain},
        state=(Port("m_rad", -1.0, 1.0, "memory"), Port("on", 0, 1, "was large")),
        inputs=(Port("x_rad", -0.05, 0.05, "input", 2, on_invalid=0.0),),
        outputs=(
            Port("y_rad", -1.5, 1.5, "output"),
            Port("status", 0, 3, "flags", flags=(Flag("ON", "on"), Flag("BAD", "bad"))),
        ),
        step=step,
    )


@pytest.fixture(scope="module")
def plan():
    return Planner(small()).plan()


def test_fields_of_a_plan(plan):
    found = {
        g: [(f.name, f.fraction, f.low, f.high, f.size) for f in fields]
        for g, fields in plan.fields.items()
    }
    twentieth = math.floor(Fraction(float(np.float32(0.05))) * WORD)
    assert found["params"] == [("half_gain", 30, 2**29, 3 * 2**29, 1)]
    # 1 to 3 is what prepare can make of 0.5 to 1.5, far inside the port's own 0 to 100.
    assert found["coeffs"] == [("gain", 29, 2**29, 3 * 2**29, 1)]
    assert found["state"] == [("m_rad", 30, -(2**30), 2**30, 1), ("on", 0, 0, 1, 1)]
    ((name, fraction, low, high, size),) = found["in"]
    assert (name, fraction, size) == ("x_rad", 31, 2)
    assert (low, high) == (-high, pytest.approx(twentieth, abs=200))
    assert found["out"][0] == ("y_rad", 30, -3 * 2**29, 3 * 2**29, 1)
    assert found["out"][1][1] == 0
    assert plan.field("state", "on").fraction == 0
    assert plan.field("out", "y_rad").size == 1
    assert not any(f.checked for fields in plan.fields.values() for f in fields)
    assert plan.wide == frozenset()
    assert {name for name, _ in plan.labels.values()} >= {"total_rad"}


@pytest.mark.parametrize(
    ("given", "gain"), [(None, 2.0), ({"half_gain": 0.75}, 1.5), ({"half_gain": 1.5}, 3.0)]
)
def test_prepared_coefficients(plan, given, gain):
    assert coefficients_raw(plan, given) == [[round(gain * 2**29)]]


def test_a_step_by_hand(plan):
    """Two elements, a memory, a switch and a word, in raw numbers."""
    f = plan.fields
    x, m, on = [[2**26, 2**25], [-3, 5]], [2**28, -(2**29)], [0, 1]
    places = raw_places("coeffs", f["coeffs"], [coefficients_raw(plan)[0] * 2])
    places |= raw_places("state", f["state"], [m, on]) | raw_places("in", f["in"], [x])
    assert set(places) == {
        "coeffs->gain",
        "state->m_rad",
        "state->on",
        "in->x_rad[0]",
        "in->x_rad[1]",
    }
    results = run_lowered(plan.step, places, 2)
    y = [2.0 * (a + b) / 2**31 + c / 2**30 for (a, b), c in zip(x, m, strict=True)]
    found = [[int(v) for v in r[0]] for r in results]
    # Two elements of +-1 and a gain of 3, whatever the bits, leave 28 behind the point.
    assert found[0] == pytest.approx([v / 4 * 2**30 for v in y], abs=2)
    assert found[1] == [int(y[0] > 0.5), 1]
    assert found[2] == pytest.approx([v * 2**30 for v in y], abs=6)
    assert found[3] == [int(y[0] > 0.5), 1]
    assert {"m_now_q30", "on_now_q0", "gain_q29", "x_0_q31"} <= {s.name for s in plan.step.steps}
    # Defined once, and no place is lost; every value that is needed has its number.
    values = defined(plan.step, places, 2)
    assert set(places) < set(values)
    assert set(values) - set(places) == {s.name for s in plan.step.steps}
    by_node = lowered_values(plan.step, values, 2)
    node = next(i for i, (name, _) in plan.labels.items() if name == "total_rad")
    total = plan.step.values[node]
    assert total is not None
    wanted = [2.0 * (a + b) / 2**31 for a, b in x]
    assert [int(v) * 2.0**-total.fraction for v in by_node[node]] == pytest.approx(
        wanted, abs=2.0**-28
    )


def test_a_plan_with_wide_values_says_which_and_why(plan):
    planner = Planner(small())
    node = next(i for i, (name, _) in planner.labels.items() if name == "total_rad")
    wide = planner.plan({node}, {node: "asked for"})
    assert (wide.wide, dict(wide.why_wide)) == (frozenset({node}), {node: "asked for"})
    assert wide.step.values[node].expr.bits == 64
    assert plan.step.values[node].expr.bits == 32
    assert dict(plan.why_wide) == {}
