"""What is said to be impossible, or to follow, against all that random numbers do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, Tunable
from esea_gen.verify.coverage import SIDES
from esea_gen.verify.executor import emitted_kernel, evaluate
from esea_gen.verify.intervals import Interval, computed_intervals
from esea_gen.verify.unreachable import guarded_ranges, imply, why_impossible
from tests.kernel_trees import INPUTS, built, trees

F32 = FORMATS["f32"]
ENDS = {"x": (-2.0, 3.0), "y": (-1.0, 1.0), "z": (0.0, 4.0), "n": (0.0, 3.0)}
B, C = ("lt", "x", "y"), ("le", "z", "n")


def sides_taken(op: str, args: list[np.ndarray], value: np.ndarray) -> list[np.ndarray]:
    """As the names of the sides say."""
    x, y = args[0], args[-1]
    p, q = x != 0, y != 0
    return {
        "fmin": lambda: [x < y, y < x],
        "fmax": lambda: [x > y, y > x],
        "fabs": lambda: [x < 0, x > 0],
        "sign": lambda: [x < 0, x > 0],
        "and": lambda: [p & q, ~p & q, p & ~q],
        "or": lambda: [~p & ~q, p & ~q, ~p & q],
        "if_else_zero": lambda: [p, ~p],
        "select": lambda: [p, ~p],
    }.get(op, lambda: [value != 0, value == 0])()


@pytest.mark.ci
@settings(max_examples=25)
@given(st.lists(st.one_of(trees(), trees(truth=True)), min_size=2, max_size=4))
def test_nothing_that_happens_was_called_impossible(made):
    nodes, places = built(*made)
    kernel = Kernel("k", tuple(nodes), tuple((p,) for p in places))
    rng = np.random.default_rng(2)
    columns = [rng.uniform(*ENDS[name], 80) for name in INPUTS]
    for k, name in enumerate(INPUTS):  # ends and equal ones among them
        columns[k][:40] = rng.choice([*ENDS[name], 0.0, 0.5, 1.0], 40)
    values = [v.astype(float) for v in evaluate(kernel, F32, [np.float32(columns).T])]
    intervals = computed_intervals(kernel, F32, [[Interval(*ENDS[n]) for n in INPUTS]])
    ranges = dict(enumerate(intervals))
    for i, node in enumerate(kernel.nodes):
        assert np.all((values[i] >= intervals[i].low) & (values[i] <= intervals[i].high))
        if node.op in SIDES:
            taken = sides_taken(node.op, [values[a] for a in node.args], values[i])
            for side, hit in zip(SIDES[node.op], taken, strict=True):
                if hit.any():
                    assert why_impossible(kernel, ranges, i, side) == ""
        if node.boolean:
            for truth in (True, False):
                rows = values[i] == truth
                for j, value in imply(kernel, i, truth).items():
                    assert np.all(values[j][rows] == np.float32(value)), (i, truth, j)


ALL, POSITIVE, NEGATIVE = Interval(-1, 1), Interval(0, 2), Interval(-2, 0)
LOW, HIGH, NAN = Interval(-3, 1), Interval(1, 4), Interval(1, 4, True)
ZERO, ONE, EITHER = Interval(0, 0), Interval(1, 1), Interval(0, 1)


@pytest.mark.parametrize(
    ("op", "ranges", "sides"),
    [
        ("fabs", (ALL,), {}),
        ("fabs", (POSITIVE,), {"negative": "the value lies in [0, 2]"}),
        ("sign", (NEGATIVE,), {"positive": "the value lies in [-2, 0]"}),
        ("not", (ZERO,), {"false": "the operand is always false"}),
        ("not", (ONE,), {"true": "the operand is always true"}),
        ("not", (EITHER,), {}),
        ("if_else_zero", (ZERO, ALL), {"true": "the condition is always false"}),
        ("if_else_zero", (Interval(-2, -2), ALL), {"false": "the condition is always true"}),
        ("select", (ONE, ALL, ALL), {"false": "the condition is always true"}),
        ("select", (EITHER, ALL, ALL), {}),
        ("fmin", (LOW, HIGH), {"second is less": ""}),
        ("fmin", (HIGH, LOW), {"first is less": ""}),
        ("fmax", (LOW, HIGH), {"first is greater": ""}),
        ("fmax", (HIGH, LOW), {"second is greater": ""}),
        ("fmin", (ALL, POSITIVE), {}),
        ("lt", (HIGH, LOW), {"true": ""}),
        ("lt", (LOW, HIGH), {}),
        ("lt", (Interval(-3, 0.5), HIGH), {"false": ""}),
        ("le", (LOW, HIGH), {"false": ""}),
        ("le", (HIGH, LOW), {}),
        ("le", (Interval(1.5, 4), LOW), {"true": ""}),
        ("le", (LOW, NAN), {}),
        ("lt", (NAN, LOW), {"true": ""}),
        ("lt", (Interval(-3, 0.5, True), HIGH), {}),
        ("eq", (LOW, Interval(5, 6)), {}),
        ("and", (ONE, EITHER), {"only first false": "the first operand is always true"}),
        (
            *("and", (EITHER, ZERO)),
            {
                "both true": "the second operand is always false",
                "only first false": "the second operand is always false",
            },
        ),
        (
            *("or", (EITHER, ONE)),
            {
                "both false": "the second operand is always true",
                "only first true": "the second operand is always true",
            },
        ),
        (
            *("or", (ZERO, EITHER)),
            {"only first true": "the first operand is always false"},
        ),
    ],
)
def test_sides_that_ranges_leave_out(op, ranges, sides):
    nodes = [Node("input", source=(0, k)) for k in range(len(ranges))]
    kernel = Kernel("k", (*nodes, Node(op, tuple(range(len(ranges))))), ((len(ranges),),))
    given = dict(enumerate(ranges))
    found = {s: why_impossible(kernel, given, len(ranges), s) for s in SIDES[op]}
    x, y = ranges[0], ranges[-1]
    apart = f"the first lies in [{x.low:g}, {x.high:g}], the second in [{y.low:g}, {y.high:g}]"
    assert {s: t for s, t in found.items() if t} == {s: t or apart for s, t in sides.items()}
    # Of what nothing is known nothing is left out.
    assert not any(why_impossible(kernel, {}, len(ranges), s) for s in SIDES[op])


@pytest.mark.parametrize(
    ("tree", "side", "words"),
    [
        (("and", B, ("not", B)), "both true", "first operand being true makes the second false"),
        (("and", B, B), "only first false", "first operand being false makes the second false"),
        (("and", B, B), "only second false", "first operand being true makes the second true"),
        (
            ("or", B, ("and", B, C)),
            "only second true",
            "first operand being false makes the second",
        ),
        (
            ("or", ("and", B, C), B),
            "only first true",
            "first operand being true makes the second t",
        ),
        (("or", B, ("or", C, B)), "only first true", "first operand being true makes the second"),
        (("or", B, ("not", B)), "both false", "first operand being false makes the second true"),
        (("and", B, C), "both true", ""),
        (("or", ("and", B, C), B), "only second true", ""),
    ],
)
def test_sides_that_logic_leaves_out(tree, side, words):
    kernel = Kernel("k", tuple(shared(tree)), ((0,),))
    node = len(kernel.nodes) - 1
    found = why_impossible(kernel, {}, node, side)
    assert words in found
    assert bool(found) == bool(words)


def shared(*made) -> list[Node]:
    """Nodes of trees, equal ones once."""
    nodes: list[Node] = [Node("input", source=(0, k)) for k in range(4)]

    def put(tree) -> int:
        if isinstance(tree, str):
            return INPUTS.index(tree)
        if isinstance(tree, tuple):
            new = Node(tree[0], tuple(put(t) for t in tree[1:]))
        else:
            new = Node("const", value=float(tree))
        if new not in nodes:
            nodes.append(new)
        return nodes.index(new)

    for t in made:
        put(t)
    return nodes


@pytest.mark.parametrize(
    ("given_", "truth", "follows", "value"),
    [
        (("not", B), True, B, 0.0),
        (B, False, ("not", B), 1.0),
        (("and", B, C), True, C, 1.0),
        (("or", B, C), False, C, 0.0),
        (("if_else_zero", B, C), True, B, 1.0),
        (("select", B, C, 0), True, B, 1.0),
        (B, True, ("or", C, B), 1.0),
        (B, False, ("and", C, B), 0.0),
        (B, False, ("or", B, ("not", ("not", B))), 0.0),
        (B, True, ("and", B, ("not", ("not", B))), 1.0),
        (B, True, ("select", B, 2, 3), 2.0),
        (B, False, ("select", B, 2, 3), 3.0),
        (B, False, ("if_else_zero", B, "x"), 0.0),
        (B, True, ("add", ("select", B, 0, 3), ("if_else_zero", B, 2)), 2.0),
        (B, True, ("lt", ("select", B, 2, 3), 2.5), 1.0),
        (B, False, ("le", ("select", B, 2, 3), 2.5), 0.0),
        (B, False, ("eq", 3, ("select", B, 2, 3)), 1.0),
        (B, True, ("ne", 3, ("select", B, 2, 3)), 1.0),
        (("lt", ("select", B, 2, "x"), 1), True, B, 0.0),
        (("lt", 1, ("select", B, "x", 0)), True, B, 1.0),
        (("lt", 1, ("if_else_zero", B, "x")), True, B, 1.0),
        (("eq", ("if_else_zero", B, "x"), 0), False, B, 1.0),
        (("le", ("select", B, 2, "x"), 2), False, B, 0.0),
    ],
)
def test_what_follows(given_, truth, follows, value):
    nodes = shared(given_, follows)
    kernel = Kernel("k", tuple(nodes), ((0,),))
    at = nodes.index(shared_node(nodes, follows))
    start = nodes.index(shared_node(nodes, given_))
    assert imply(kernel, start, truth)[at] == value
    # Of what hangs on nothing of it nothing follows.
    more = shared(given_, follows, ("lt", "y", "n"))
    known = imply(Kernel("k", tuple(more), ((0,),)), start, truth)
    for loose in ("x", ("lt", "y", "n")):
        assert more.index(shared_node(more, loose)) not in known


def shared_node(nodes: list[Node], tree) -> Node:
    """The node of a tree that is among nodes."""
    if isinstance(tree, str):
        return nodes[INPUTS.index(tree)]
    if not isinstance(tree, tuple):
        return Node("const", value=float(tree))
    return Node(tree[0], tuple(nodes.index(shared_node(nodes, t)) for t in tree[1:]))


def test_what_the_guard_lets_pass():
    def step(c, s, u, guard, label):
        raw = label("raw", u.x_rad * 1.0 + c.gain)
        return {"pair": [s.pair[1], u.x_rad]}, {
            "y_rad": label("used", 2 * u.x_rad + c.gain) + 0 * raw,
            "z_rad": label("far", s.pair[0] + 1),
        }

    block = Block.define(
        *("seen", "made up"),
        period_s=1e-3,
        tunables=(Tunable("gain", 1.0, 0.5, 2.0, "gain"),),
        coefficients=(Port("gain", 0.5, 2.0, "gain"),),
        prepare=lambda t: {"gain": 1 * t.gain},
        state=(Port("pair", -1.0, 3.0, "two", 2),),
        inputs=(Port("x_rad", -2.0, 4.0, "x"),),
        outputs=(Port("y_rad", -99, 99, "y"), Port("z_rad", -99, 99, "z")),
        step=step,
    )
    kernel, names = emitted_kernel(block, F32)
    at = {name: i for i, (name, _) in names.items()}
    found = guarded_ranges(block, kernel, F32)
    assert found[at["used"]] == Interval(2 * -2 + 0.5, 2 * 4 + 2)
    # Of a vector the sum of magnitudes is looked at: twice the larger end and a thousandth.
    most = float(np.float32(1.001 * 2 * 3))
    far = found[at["far"]]
    assert (far.low, far.high) == (
        float(np.float32(1) - np.float32(most)),
        float(np.float32(1) + np.float32(most)),
    )
    # What comes in, before its guard, may be anything; the guard's own answer either.
    inputs = [i for i, n in enumerate(kernel.nodes) if n.op == "input" and n.source[0] > 0]
    assert not set(inputs) & set(found)
    gain = next(i for i, n in enumerate(kernel.nodes) if n.op == "input" and n.source[0] == 0)
    assert found[gain] == Interval(0.5, 2.0)
    assert not found[at["inputs_ok"]].settled
    assert not found[at["state_ok"]].settled
