"""What the search for a plan goes by: each list of values, on a few nodes written down by hand."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.fixed import search
from esea_gen.emit.fixed.errors import any_bound, block_bound, step_bound
from esea_gen.emit.fixed.plan import Planner
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.block import Block, Solved
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word


def made(step, *, state=(), outputs=None, **more) -> Block:
    return Block.define(
        "made",
        "made up",
        period_s=0.001,
        state=state,
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=outputs or (Port("y", -1.0, 1.0, "output"),),
        step=step,
        **more,
    )


def held(bits: int = 32, low: int = -9, high: int = 9, fraction: int = 20) -> SimpleNamespace:
    """What a value is lowered to."""
    expr = SimpleNamespace(bits=bits, low=low, high=high)
    return SimpleNamespace(
        expr=expr,
        fraction=fraction,
        low=Fraction(low, 2**fraction),
        high=Fraction(high, 2**fraction),
    )


def planned(*nodes: tuple[Node, SimpleNamespace | None], results=(), **more) -> SimpleNamespace:
    kernel = Kernel("f", tuple(n for n, _ in nodes), results)
    step = SimpleNamespace(kernel=kernel, values=[v for _, v in nodes])
    return SimpleNamespace(step=step, **more)


IN, ONE = (Node("input"), held(fraction=30)), (Node("const", value=1.0), held(fraction=30))


# -- how far above the aim -------------------------------------------------------------------------


def test_the_worst_output_beside_its_own_aim():
    outputs = (
        Port("a", -4.0, 2.0, "larger below"),
        Port("b", -1.0, 8.0, "larger above", finer=3.0),
        Port("c", 0.0, 0.5, "small"),
        Port("status", 0, 1, "word", flags=(Flag("ON", "on"),)),
    )
    block = SimpleNamespace(outputs=outputs)
    # 5e-5 of 4, a third of that of 8, 5e-5 of a half.
    aims = {"a": 2e-4, "b": 4e-4 / 3, "c": 2.5e-5}
    for name, aim in aims.items():
        errors = dict.fromkeys(aims, 1e-9) | {name: 7 * aim}
        assert search._shortfall(block, errors) == pytest.approx(7.0)
    assert search._shortfall(SimpleNamespace(outputs=outputs[3:]), {}) == 0.0


# -- values that may need more ---------------------------------------------------------------------


def test_significant_bits_are_those_of_the_smallest_magnitude():
    x = (Node("input"), held(low=1, high=7))
    plan = planned(
        x,
        (Node("neg", (0,)), held(low=5369, high=10**9)),
        (Node("neg", (0,)), held(low=-(10**9), high=-3)),
        (Node("neg", (0,)), held(64, 5, 9)),
        (Node("neg", (0,)), None),
        (Node("neg", (0,)), held(low=-1, high=5)),
        (Node("neg", (0,)), held(low=-1, high=5)),
        (Node("neg", (0,)), held(low=0, high=5)),
        (Node("neg", (0,)), held(low=-5, high=0)),
        (Node("sign", (0,)), held(low=1, high=1)),
        (Node("neg", (0,)), held(low=1, high=1)),
        (Node("sign", (0,)), held(low=-1, high=1)),
        (Node("neg", (0,)), held(low=0, high=5)),
        (Node("neg", (0,)), held(low=-5, high=0)),
        facts={5: (0.1, 0.2), 7: (0.1, 0.2), 8: (-0.2, -0.1), 3: (0.1, 0.2)},
    )
    # Of what holds zero though algebra knows better, none.
    assert search._small_ends(plan) == {1: 13, 2: 2, 5: 0, 7: 0, 8: 0, 10: 1}


def clip_of(first: int, limit: int, op: str = "fmin", turned: bool = False) -> Node:
    return Node(op, (limit, first) if turned else (first, limit))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("op", ["fmin", "fmax"])
def test_what_a_clip_gives_back(op, turned):
    # A limit of 1 has 30 bits behind the point; of -1 31.
    for limit, bits in ((1.0, 30), (-1.0, 31), (0.25, 32), (100.0, 24)):
        const = (Node("const", value=limit), held())
        for value, lost in (
            (held(fraction=bits - 1), 1),
            (held(fraction=bits - 9), 9),
            (held(fraction=bits), 0),
            (held(64, fraction=bits - 9), 0),
            (None, 0),
        ):
            plan = planned(
                IN, const, (Node("neg", (0,)), value), (clip_of(2, 1, op, turned), held())
            )
            said = f"its range before the clip takes {lost} bits that the clip gives back"
            assert search._clipped(plan) == ({2: said} if lost else {})
        # What was read has the format of its port.
        plan = planned(
            (Node("input"), held(fraction=3)), const, (clip_of(0, 1, op, turned), held())
        )
        assert search._clipped(plan) == {}


def test_what_a_clipped_choice_chooses_from_and_the_first_half_of_a_clip():
    nodes = [
        IN,
        ONE,
        (Node("le", (0, 1)), held(1)),
        (Node("mul", (0, 0)), held(fraction=25)),
        (Node("neg", (0,)), held(fraction=28)),
        (Node("if_else_zero", (2, 4)), held(fraction=27)),
        (Node("select", (2, 3, 5)), held(fraction=24)),
        (Node("fmin", (6, 1)), held(fraction=29)),
        (Node("const", value=-1.0), held()),
        (Node("fmax", (7, 8)), held(fraction=31)),
        (Node("add", (3, 4)), held(fraction=3)),
        (Node("fmin", (10, 4)), held(fraction=20)),  # of two that vary: no clip
    ]
    lost = {i: int(w.split()[6]) for i, w in search._clipped(planned(*nodes)).items()}
    assert lost == {6: 6, 3: 5, 5: 3, 4: 2}
    # Of -1, with 31 bits, the half before it keeps 29.
    both = {i: int(w.split()[6]) for i, w in search._clipped(planned(*nodes), inner=True).items()}
    assert both == lost | {7: 2}
    # Into a choice that is fine itself nobody looks.
    nodes[6] = (nodes[6][0], held(fraction=30))
    assert search._clipped(planned(*nodes)) == {}


def test_terms_of_a_wide_sum_are_wide():
    kernel = Kernel(
        "f",
        (
            Node("input"),
            Node("const", value=2.0),
            Node("mul", (0, 1)),
            Node("le", (0, 1)),
            Node("neg", (2,)),
            Node("add", (2, 4)),
            Node("sub", (0, 2)),
            Node("add", (3, 1)),
            Node("mul", (4, 4)),
        ),
        (),
    )
    said = "is a term of v{}, which is held in 64 bits"
    for wide, more in (
        ({5: "why"}, {2: said.format(5), 4: said.format(5)}),
        ({6: "why"}, {2: said.format(6)}),
        ({7: "why"}, {}),
        ({8: "why"}, {}),
        ({5: "why", 4: "own"}, {2: said.format(5)}),
    ):
        assert search._with_terms(kernel, wide) == wide | more


def test_what_leads_to_a_root():
    power = [(Node("const", value=v), held()) for v in (0.3, 1.0, 0.0, 2.0)]
    leads, steep = (
        "leads to a root, which magnifies its rounding near zero",
        "is a root, steep near zero",
    )
    plan = planned(
        IN,
        *power,
        (Node("mul", (0, 0)), held()),
        (Node("exp", (5,)), held()),
        (Node("sub", (5, 6)), held()),
        (Node("fabs", (7,)), held()),
        (Node("sqrt", (8,)), held()),
        (Node("neg", (0,)), held()),
        (Node("if_else_zero", (11 - 1, 10)), None),
        (Node("add", (10, 11)), held()),
        (Node("pow", (12, 1)), held()),
        (Node("pow", (6, 2)), held()),
        (Node("twice", (0,)), held()),
        (Node("pow", (15, 3)), held()),
        (Node("pow", (5, 4)), held()),
    )
    # A root has no entry of its own but as a power, between 0 and 1, ends not among them.
    assert search._flat_roots(plan) == dict.fromkeys((5, 7, 8, 10, 12), leads) | {13: steep}


def test_every_operation_that_is_followed_to_a_root():
    for op, count in (("add", 2), ("sub", 2), ("neg", 1), ("fabs", 1), ("mul", 2),
                      ("if_else_zero", 2), ("twice", 0), ("div", 0), ("select", 0)):  # fmt: skip
        plan = planned(
            IN,
            (Node("neg", (0,)), held()),
            (Node("neg", (0,)), held()),
            (Node(op, (1, 2)[: max(count, 1)]), held()),
            (Node("sqrt", (3,)), held()),
        )
        assert set(search._flat_roots(plan)) == (set(range(1, count + 1)) | {3} if count else set())


def test_how_much_coarser_than_the_port_it_leads_to():
    def field(fraction: int, **port) -> SimpleNamespace:
        return SimpleNamespace(fraction=fraction, port=SimpleNamespace(flags=(), **port))

    word = SimpleNamespace(fraction=31, port=SimpleNamespace(flags=(1,)))
    plan = planned(
        IN,
        ONE,
        (Node("le", (0, 1)), held(1, fraction=0)),
        (Node("mul", (0, 0)), held(fraction=20)),
        (Node("exp", (0,)), held(fraction=2)),
        (Node("add", (3, 4)), held(fraction=27)),
        (Node("neg", (3,)), held(fraction=28)),
        (Node("select", (2, 5, 6)), held(fraction=26)),
        (Node("twice", (6,)), held(64, fraction=24)),
        (Node("fmin", (8, 1)), held(fraction=30)),
        (Node("sub", (0, 0)), held(fraction=1)),
        (Node("fabs", (10,)), held(fraction=1)),
        (Node("if_else_zero", (2, 1)), None),
        results=((7,), (9,), (11,), (2, 12), (10,)),
        fields={
            "state": (field(27), field(30)),
            "out": (field(25), field(31), word),
        },
    )
    found = {i: int(w.split()[0]) for i, w in search.coarse_values(plan).items()}
    # The choice is beside 27, its arms as well; the double and what it doubles beside 30, by which
    # the negative loses 2 and the product, the finest wish of all, 10.
    assert found == {7: 1, 6: 2, 3: 10}
    assert search.coarse_values(plan)[7] == "1 bits coarser than the port that it leads to"


# -- state errors that are a bound -----------------------------------------------------------------


def test_errors_in_the_order_of_the_states():
    assert search._split([1, 2, 3, 4, 5, 6], [2, 1, 3]) == [[1, 2], [3], [4, 5, 6]]


def turned() -> Block:
    """a' = a / 2 + b, b' = b / 4 and x, c' = -c / 2."""

    def step(c, s, u, g, label):
        a, b = s.p[0], s.p[1]
        return (
            {"p": [0.5 * a + b, 0.25 * b + 0.01 * u.x_rad], "q": -0.5 * s.q},
            {"y": 0.125 * a + 0.25 * s.q},
        )

    state = (Port("p", -1, 1, "pair", 2, repair="block"), Port("q", -1, 1, "own", repair="block"))
    return made(step, state=state)


def test_what_an_error_of_each_element_sums_up_to():
    # Of 1 / (1 - A): 2 of a, and of b 4 / 3, of which a gets twice as much; 2 of c.
    wanted = [[2, 0, 0], [8 / 3, 4 / 3, 0], [0, 0, 2]]
    assert np.array(search._memory(turned())) == pytest.approx(np.array(wanted), rel=2e-6)


def memory(pole: float) -> Planner:
    def step(c, s, u, g, label):
        new = pole * s.m + (1 - pole) * clip(1e4 * u.x_rad, -1, 1)
        return {"m": new, "n": 0.25 * new}, {"y": 0.5 * s.m + s.n}

    state = tuple(Port(n, -1, 1, "memory", repair="block") for n in "mn")
    return Planner(made(step, state=state))


def test_errors_stay_a_bound_where_no_step_makes_them_larger():
    planner = memory(0.5)
    bound = block_bound(planner.plan())
    errors = [[bound.states[n]] for n in "mn"]
    reached = search._shortfall(planner.block, bound.outputs)

    def still(scale, ceiling, forgets=True) -> bool:
        given = [[e * k] for (e,), k in zip(errors, scale, strict=True)]
        plan = search._still_bounded(planner, {}, given, ceiling, forgets)
        return plan is not None and plan.wide == frozenset()

    assert still((1.01, 1.01), 1.02 * reached)
    assert not still((1.01, 1.01), 1.005 * reached)
    # A hundredth less of any of them is none.
    for scale in ((0.97, 1.01), (1.01, 0.97), (0.97, 0.97)):
        assert not still(scale, 9 * reached)
    # Of one step from the same memory nothing is asked but the outputs.
    one = step_bound(planner.plan())
    own = search._shortfall(planner.block, one.outputs)
    assert own < reached
    assert still((0.0, 0.0), own, forgets=False)
    assert not still((0.0, 0.0), 0.999 * own, forgets=False)
    assert not still((0.0, 0.0), 9 * own)
    # What cannot be lowered, or has no bound, is none.
    big = {i: "why" for i, n in enumerate(planner.kernel.nodes) if n.op == "mul"}
    assert search._still_bounded(planner, big, errors, 9 * reached, True) is not None


def test_a_plan_that_is_tried_knows_its_bound():
    planner = memory(0.5)
    tried = search._try(planner, {})
    bound = any_bound(planner.plan())
    assert (tried.states, tried.forgets, tried.linear) == (bound.states, True, False)
    assert tried.score == search._shortfall(planner.block, bound.outputs)
    assert tried.rank == (False, tried.score)
    # What does not forget starts from no error; it comes after all that forgets.
    planner = Planner(
        made(
            lambda c, s, u, g, label: ({"m": clip(s.m + 0.3 * u.x_rad, -1, 1)}, {"y": 0.3 * s.m}),
            state=(Port("m", -1, 1, "memory", repair="block"),),
        )
    )
    tried = search._try(planner, {})
    assert (tried.states, tried.forgets, tried.linear) == ({"m": 0.0}, False, False)
    assert tried.score == search._shortfall(planner.block, step_bound(planner.plan()).outputs)
    assert tried.rank == (True, tried.score)
    # Nor has it a score where no bound is found at all.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "any_bound", refuse)
        tried = search._try(planner, {})
    assert (tried.score, tried.states, tried.forgets, tried.linear) == (math.inf, {}, False, False)


def refuse(*_given):
    raise search.RangeError("none")


def test_what_cannot_be_lowered_is_refused_unless_it_was_only_tried():
    def unlowered(wide=(), why=None):
        raise search.LoweringError("no", "fix")

    planner = SimpleNamespace(plan=unlowered)
    assert search._try(planner, {3: "why"}) is None
    with pytest.raises(search.LoweringError):
        search._try(planner, {})


# -- the way to a solved value ---------------------------------------------------------------------


def test_a_residual_that_its_range_alone_keeps_small_is_not_looked_at():
    from .test_fixed_search import solved

    # 1.25 times 0.8, and an input of any bits, up to 2.
    for most in (3.0, 9.0):
        plan = search.search(Planner(solved(most)))
        assert plan.wide == frozenset()
        assert any_bound(plan).outputs["y"] == pytest.approx(most / 1.25)


@pytest.mark.parametrize(("share", "wide"), [(0.25, False), (0.26, True), (1.7, True)])
def test_the_way_is_wide_where_more_than_a_quarter_of_a_residual_is_left(share, wide, monkeypatch):
    from .test_fixed_search import solved

    planner = Planner(solved(1e-2))
    plan = planner.plan({2: "own"}, {2: "own"})
    monkeypatch.setattr(search, "_probe", lambda _plan: share)
    found = search._with_way(planner, plan)
    said = f"leads to a solved value whose residual would fill {round(100 * share)} %"
    assert (found.wide != plan.wide) is wide
    if wide:
        assert set(found.why_wide.values()) == {said, "own"}
        assert found.why_wide[2] == "own" or 2 not in found.why_wide


def test_a_block_that_solves_nothing_is_not_run(monkeypatch):
    monkeypatch.setattr(search, "_probe", refuse)
    planner = memory(0.5)
    plan = planner.plan()
    assert search._with_way(planner, plan) is plan


def test_words_and_conditions_are_never_wide():
    def step(c, s, u, g, label):
        steep = clip(1e6 * u.x_rad, -1, 1)
        return {}, {"y": ca.if_else(u.x_rad > 0, steep, 0.5), "status": flag_word([steep > 0.5])}

    outputs = (
        Port("y", -1.0, 1.0, "output"),
        Port("status", 0, 1, "word", flags=(Flag("ON", "on"),)),
    )
    planner = Planner(made(step, outputs=outputs))
    plan = search.search(planner)
    assert plan.wide
    assert not any(planner.kernel.nodes[i].boolean for i in plan.wide)
    assert not any(planner.kernel.nodes[i].op in ("input", "const") for i in plan.wide)


@pytest.mark.parametrize(("after", "seen"), [(46.5, True), (47.5, False)])
def test_a_residual_is_looked_at_over_48_steps_of_one_memory(after, seen):
    # A count of the steps, in 64ths; two elements and another input that grow alike.
    most = 2e-5

    def step(c, s, u, g, label):
        x, z = u.x_rad, u.z_rad
        y = label("y_rad", 1e5 * x - 99999.2 * x)
        off = 1.25 * y - x
        alike = ca.logic_and(ca.fabs(z[0] - 0.5 * x) < 1e-6, ca.fabs(z[1] - c.half * x) < 1e-6)
        there = ca.logic_and(s.count[1] > after / 64, s.flat < -0.75)
        told = ca.if_else(ca.logic_and(there, alike), off, 0.0)
        told = label("residual", told)
        after_it = {"flat": -0.875, "count": [s.flat, s.count[1] + 1 / 64]}
        return after_it, {"y": y, "status": flag_word([ca.fabs(told) > most])}

    block = Block.define(
        "solved",
        "Solved",
        period_s=0.001,
        tunables=(Tunable("half", 0.5, 0.25, 0.75, "half"),),
        coefficients=(Port("half", 0.25, 0.75, "half"),),
        prepare=lambda t: {"half": 1 * t.half},
        state=(
            Port("flat", -1.0, 1.0, "memory", repair="block"),
            Port("count", -1.0, 1.0, "memory", 2, repair="block"),
        ),
        inputs=(Port("x_rad", -1.0, 1.0, "input"), Port("z_rad", -0.5, 0.5, "half of it", 2)),
        outputs=(
            Port("y", -1.0, 1.0, "solution"),
            Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
        ),
        step=step,
        facts={"y_rad": (-0.8, 0.8)},
        solved={"y_rad": Solved("residual", most, 1.25, 0.0, {"flat": 0.0, "count": 0.0})},
    )
    share = search._probe(Planner(block).plan())
    assert (share > 1) is seen
    assert (share == 0) is not seen


@pytest.mark.parametrize("of_state", [False, True])
def test_inputs_of_the_run_grow_and_where_nothing_solves_it_is_not_judged(monkeypatch, of_state):
    # Ten times what is allowed, from some input or some step on: the way is not to blame.
    def step(c, s, u, g, label):
        y = label("y_rad", 0.8 * u.x_rad)
        where = s.count > 7.5 / 64 if of_state else u.x_rad > 0.03
        off = label("residual", ca.if_else(where, 0.1, 1.25 * y - u.x_rad))
        out = {"y": y, "status": flag_word([ca.fabs(off) > 1e-2])}
        return {"count": s.count + 1 / 64}, out

    block = Block.define(
        "solved",
        "Solved",
        period_s=0.001,
        state=(Port("count", -1.0, 1.0, "memory", repair="block"),),
        inputs=(Port("x_rad", -4.0, 0.75, "input"), Port("z_rad", -1.0, 1.0, "more", 2)),
        outputs=(
            Port("y", -1.0, 1.0, "solution"),
            Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
        ),
        step=step,
        facts={"y_rad": (-0.8, 0.8)},
        solved={"y_rad": Solved("residual", 1e-2, 1.25, 0.0, {"count": 0.0})},
    )
    plan, given, places = Planner(block).plan(), [], search.raw_places

    def noted(pointer, fields, columns):
        found = places(pointer, fields, columns)
        if pointer == "in":
            given.append([int(v) for (v,) in found.values()])
        return found

    monkeypatch.setattr(search, "raw_places", noted)
    assert search._probe(plan) < 1e-3
    # From a thousandth of the upper end by two decades, 0.4 rad each step.
    waves = [math.sin(0.4 * k) * 10 ** (k / 24 - 3) for k in range(48)]
    x, z = (f.fraction for f in plan.fields["in"])
    assert given == [
        [pytest.approx(w * 0.75 * 2**x, abs=1), *[pytest.approx(w * 2**z, abs=1)] * 2]
        for w in waves
    ]
