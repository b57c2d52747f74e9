"""Fields of a plan: what prepare can make of each coefficient, places, switches and checks."""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.fixed.plan import (
    FieldPlan,
    Planner,
    coefficients_raw,
    defined,
    lowered_values,
    raw_places,
    run_lowered,
)
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word

WORD = 2**31


def prepared(checked: bool = False) -> Block:
    """y = d x, of coefficients of every kind."""

    def step(c, s, u, guard, label):
        ok = ca.logic_and(c.d >= -0.75, c.d <= 2) if checked else 1
        return {}, {"y_rad": ca.if_else(ok, c.d, 0) * u.x_rad[2] + c.pair[1] + c.part}

    return Block.define(
        "prepared",
        "Prepared",
        period_s=0.001,
        tunables=(
            Tunable("t", 1.0, 0.5, 1.5, "tunes"),
            Tunable("r", -0.75, -2.0, 1.0, "tunes too"),
            Tunable("w", 0.25, 0.125, 0.3, "of no short binary fraction"),
        ),
        coefficients=(
            Port("pair", -9.0, 9.0, "two", 2),
            Port("fixed", 0.0, 1.0, "a number"),
            Port("d", -1.0, 2.0, "cut on both sides"),
            Port("lower", -1.0, 99.0, "cut below"),
            Port("upper", -99.0, 1.5, "cut above"),
            Port("part", -1.0, 1.0, "of a product"),
        ),
        prepare=lambda t: {
            "pair": [2 * t.t, t.r - 4],
            "fixed": 0.375,
            "d": 3 * t.r,
            "lower": 2 * t.r,
            "upper": 2 * t.r - t.t / 2,
            "part": t.w * -0.7,
        },
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input", 3),),
        outputs=(Port("y_rad", -9.0, 9.0, "output"),),
        step=step,
    )


@pytest.fixture(scope="module")
def plan():
    return Planner(prepared()).plan()


def test_a_coefficients_format_is_of_what_prepare_makes_inside_its_port(plan):
    found = {f.name: (f.fraction, f.low, f.high) for f in plan.fields["coeffs"]}
    # 1 to 3 and -6 to -3 together; a number alone, 31 bits at most; -6 to 3 inside -1 to 2.
    assert found["pair"] == (28, -6 * 2**28, 3 * 2**28)
    assert found["fixed"] == (31, 3 * 2**28, 3 * 2**28)
    assert found["d"] == (29, -(2**29), 2**30)
    # -4 to 2 above -1; -4.75 to 1.75 below 1.5.
    assert found["lower"] == (29, -(2**29), 2**30)
    fraction, low, high = found["upper"]
    assert (fraction, high) == (28, 3 * 2**27)
    assert low == pytest.approx(-4.75 * 2**28, abs=2)
    # Outwards to the next raw number.
    fraction, low, high = found["part"]
    # The last in single precision that is no more than 0.3.
    three = Fraction(float(np.nextafter(np.float32(0.3), np.float32(0))))
    assert fraction == 31
    assert (low, high) == (
        pytest.approx(float(-three * Fraction(0.7) * WORD), abs=3),
        pytest.approx(-0.0875 * WORD, abs=3),
    )
    assert low <= -three * Fraction(0.7) * WORD
    assert high >= -0.0875 * WORD
    assert [f.size for f in plan.fields["coeffs"]] == [2, 1, 1, 1, 1, 1]
    assert {f.name: (f.fraction, f.low, f.high) for f in plan.fields["params"]} == {
        "t": (30, 2**29, 3 * 2**29),
        "r": (30, -WORD, 2**30),
        "w": (31, 2**28, math.floor(three * WORD)),
    }


@pytest.mark.parametrize(
    ("given", "values"),
    [
        ({}, [2.0, -4.75, 0.375, -1.0, -1.0, -2.0, -0.175]),
        ({"r": 1.0, "t": 1.5}, [3.0, -3.0, 0.375, 2.0, 2.0, 1.25, -0.175]),
        ({"r": 0.5, "w": 0.125}, [2.0, -3.5, 0.375, 1.5, 1.0, 0.5, -0.0875]),
    ],
)
def test_what_prepare_makes_is_cut_to_its_ports(plan, given, values):
    raw = [v for row in coefficients_raw(plan, given) for v in row]
    fractions = [f.fraction for f in plan.fields["coeffs"] for _ in range(f.size)]
    made = [v * 2.0**-f for v, f in zip(raw, fractions, strict=True)]
    assert made == pytest.approx(values, abs=2.0**-28)


def test_coefficients_of_a_block_without_tunables_are_none():
    block = Block.define(
        "plain",
        "Plain",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(Port("y_rad", -1.0, 1.0, "output"),),
        step=lambda c, s, u, g, label: ({}, {"y_rad": 0.5 * u.x_rad}),
    )
    plan = Planner(block).plan()
    assert (plan.prepare, plan.fields["coeffs"], coefficients_raw(plan)) == (None, (), [])


def test_what_a_step_checks_itself_may_be_anything_before(plan):
    checked = Planner(prepared(checked=True))
    held = {f.name: f.checked for f in checked.fields["coeffs"]}
    assert held == {n: n == "d" for n in ("pair", "fixed", "d", "lower", "upper", "part")}
    assert checked.checks
    assert {checked.kernel.nodes[i].op for i in checked.checks} == {"le"}
    assert Planner(prepared()).checks == frozenset()
    names = {s.name for s in checked.plan().step.steps}
    assert "d_held_q29" in names
    assert not any("held" in s.name for s in plan.step.steps)


# -- places ----------------------------------------------------------------------------------------


def test_places_are_the_cs_own_expressions_element_by_element():
    three = FieldPlan(Port("x_rad", -1, 1, "input", 3), 30, -(2**30), 2**30)
    one = FieldPlan(Port("z_rad", -1, 1, "input"), 30, -(2**30), 2**30)
    word = FieldPlan(Port("w", 0, 1, "word", flags=(Flag("ON", "on"),)), 0, 0, 1)
    places = raw_places("in", (three, one, word), [[[1, 2, 3], [4, 5, 6]], [7, 8], [0, 1]])
    assert {k: v.tolist() for k, v in places.items()} == {
        "in->x_rad[0]": [1, 4],
        "in->x_rad[1]": [2, 5],
        "in->x_rad[2]": [3, 6],
        "in->z_rad": [7, 8],
        "(int32_t)in->w": [0, 1],
    }
    assert all(type(x) is int for v in places.values() for x in v)
    assert one.raw(0.25 + 2.0**-31) == 2**28 + 1


def test_every_element_is_read_from_its_own_place(plan):
    places = raw_places("coeffs", plan.fields["coeffs"], [[c] for c in coefficients_raw(plan)])
    x = [[2**28, -(2**27), 2**29], [0, 0, -(2**30)]]
    every = {k: np.repeat(v, 2) for k, v in places.items()}
    every |= raw_places("in", plan.fields["in"], [x])
    ((y,),) = run_lowered(plan.step, every, 2)
    unit = plan.field("out", "y_rad").lsb
    # -1 times the third element, and the second of the pair, and -0.7 quarters.
    assert (y * unit).tolist() == pytest.approx([-0.5 - 4.925, 1 - 4.925], abs=1e-7)
    # What is defined already is not evaluated again.
    values = defined(plan.step, every, 2)
    name = plan.step.steps[-1].name
    changed = values | {name: values[name] + 1}
    assert (defined(plan.step, changed, 2)[name] == values[name] + 1).all()
    found = lowered_values(plan.step, values, 2)
    assert len(found) >= len({s.node for s in plan.step.steps})


def test_a_switch_is_a_whole_number_and_a_share_is_not():
    def step(c, s, u, guard, label):
        on = u.x_rad > 0
        return (
            {"on": on, "share": u.x_rad / 4 + 0.5, "both": [on, u.x_rad > 0.5], "some": [on, 0.5]},
            {"out": ca.logic_not(on), "wide": on, "part": 0.5 * s.share,
             "flags": flag_word([on])},
        )  # fmt: skip

    block = Block.define(
        "switches",
        "Switches",
        period_s=0.001,
        state=(
            Port("on", 0, 1, "was on"),
            Port("share", 0, 1, "share"),
            Port("both", 0, 1, "two", 2),
            Port("some", 0, 1, "two", 2),
        ),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(
            Port("out", 0, 1, "is off"),
            Port("wide", 0, 2, "is on, of two"),
            Port("part", 0, 1, "share"),
            Port("flags", 0, 1, "word", flags=(Flag("ON", "on"),)),
        ),
        step=step,
    )
    plan = Planner(block).plan()
    found = {f.name: f.fraction for g in ("state", "out") for f in plan.fields[g]}
    assert found == {
        "on": 0, "share": 30, "both": 0, "some": 30, "out": 0, "wide": 29, "part": 30, "flags": 0,
    }  # fmt: skip
    places = raw_places("state", plan.fields["state"], [[1], [7], [[1, 0]], [[1, 0]]])
    results = run_lowered(plan.step, places | raw_places("in", plan.fields["in"], [[2**28]]), 1)
    assert [[int(e[0]) for e in r] for r in results] == [
        [1], [2**29 + 2**26], [1, 0], [2**30, 2**29], [0], [2**29], [pytest.approx(3.5, abs=0.5)],
        [1],
    ]  # fmt: skip


def test_names_and_facts_stay_with_their_values_where_one_over_x_becomes_two():
    def step(c, s, u, guard, label):
        first = label("first", 1 / (u.x_rad + 2))
        second = label("second", 0.25 / label("shift", u.x_rad + 3) + first * first)
        return {}, {"y": label("twice", second * 1.5) + 1 / (second + 1)}

    block = Block.define(
        "quotients",
        "Quotients",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(Port("y", -4.0, 4.0, "output"),),
        step=step,
        facts={"first": (0.3, 1.0), "twice": (-1.5, 1.5)},
    )
    planner = Planner(block)
    nodes = planner.kernel.nodes
    assert not any(n.op == "inv" for n in nodes)
    assert sum(n.op == "div" for n in nodes) == 3
    place = {name: i for i, (name, _) in planner.labels.items()}
    assert {n: nodes[place[n]].op for n in ("first", "second", "shift", "twice")} == {
        "first": "div", "second": "add", "shift": "add", "twice": "mul",
    }  # fmt: skip
    assert planner.facts == {place["first"]: (0.3, 1.0), place["twice"]: (-1.5, 1.5)}
    one = nodes[nodes[place["first"]].args[0]]
    assert (one.op, one.value) == ("const", 1.0)
