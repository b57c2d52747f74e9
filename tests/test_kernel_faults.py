"""Faults of a kernel and what is proven of them: each by the numbers that it gives.

Of every operation, each fault beside what it should compute; of values that are said to be one,
that they are so for all numbers, and of forms that are one by algebra, that it is said.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel, Node
from esea_gen.verify.executor import evaluate
from esea_gen.verify.intervals import Interval, computed_intervals
from esea_gen.verify.mutation.edits import Edit, describe, kernel_edits
from esea_gen.verify.mutation.normal import Numbering

from .kernel_trees import INPUTS, built, kernel_of, trees

F32, F64 = FORMATS["f32"], FORMATS["f64"]


POINTS = np.array([[2.5, -0.75, 4.0, 0.0], [-0.75, 2.5, 1.0, 3.0], [1.0, 1.0, 0.5, 7.0]])
LESS = ("lt", "x", "y")


def up(value: float, kind=np.float64) -> float:
    """One unit in the last place further from zero."""
    return float(np.nextafter(kind(value), kind(math.copysign(np.inf, value))))


def percent(value: float) -> float:
    return value * 1.01


# Operation, its tree, and by fault what x, y and z then give.
FAULTS = [
    (("add", "x", "y"), {"+ to -": lambda x, y, z: x - y}),
    (
        ("sub", "x", "y"),
        {"- to +": lambda x, y, z: x + y, "operands swapped": lambda x, y, z: y - x},
    ),
    (("mul", "x", "y"), {"* to /": lambda x, y, z: x / y}),
    (
        ("div", "x", "y"),
        {"/ to *": lambda x, y, z: x * y, "operands swapped": lambda x, y, z: y / x},
    ),
    (LESS, {"< to <=": lambda x, y, z: x <= y, "< to >=": lambda x, y, z: x >= y}),
    (
        ("le", "x", "y"),
        {"<= to <": lambda x, y, z: x < y, "<= to >=": lambda x, y, z: x >= y},
    ),
    (("eq", "x", "y"), {"== to !=": lambda x, y, z: x != y}),
    (("ne", "x", "y"), {"!= to ==": lambda x, y, z: x == y}),
    (
        ("fmin", "x", "y"),
        {
            "fmin to fmax": lambda x, y, z: max(x, y),
            "fmin dropped": lambda x, y, z: x,
            "fmin always clips": lambda x, y, z: y,
        },
    ),
    (
        ("fmax", "x", "y"),
        {
            "fmax to fmin": lambda x, y, z: min(x, y),
            "fmax dropped": lambda x, y, z: x,
            "fmax always clips": lambda x, y, z: y,
        },
    ),
    (("fabs", "x"), {"fabs dropped": lambda x, y, z: x}),
    (("neg", "x"), {"minus sign dropped": lambda x, y, z: x}),
    (("sign", "x"), {}),
    (("sqrt", "z"), {}),
    (("sq", "x"), {"* to /": lambda x, y, z: x / x}),
    (
        ("twice", "x"),
        {
            "* to /": lambda x, y, z: 2 / x,
            "constant off by 1 %": lambda x, y, z: percent(2) * x,
            "constant off by 1 ulp": lambda x, y, z: up(2) * x,
        },
    ),
    (
        ("inv", "x"),
        {
            "/ to *": lambda x, y, z: x,
            "constant off by 1 %": lambda x, y, z: percent(1) / x,
            "constant off by 1 ulp": lambda x, y, z: up(1) / x,
        },
    ),
    (
        ("mul", "x", -0.5),
        {
            "* to /": lambda x, y, z: x / -0.5,
            "constant off by 1 %": lambda x, y, z: percent(-0.5) * x,
            "constant off by 1 ulp": lambda x, y, z: up(-0.5) * x,
            "sign of a constant": lambda x, y, z: 0.5 * x,
        },
    ),
    (
        ("sub", 0.0, "x"),
        {
            "- to +": lambda x, y, z: x,
            "operands swapped": lambda x, y, z: x,
            "constant off by one": lambda x, y, z: 1 - x,
        },
    ),
    (
        ("pow", "z", 0.75),
        {
            "constant off by 1 %": lambda x, y, z: z ** percent(0.75),
            "constant off by 1 ulp": lambda x, y, z: z ** up(0.75),
        },
    ),
]


def found_faults(tree, fmt=F64) -> dict[str, list[float]]:
    """By kind, what the last operation's faults give at the points."""
    kernel = kernel_of(tree)
    site = kernel.results[0][0]
    found = {}
    for edit in kernel_edits(kernel, fmt, ()):
        assert edit.site == site
        changed, _ = edit.apply(kernel)
        assert edit.kind not in found
        values = evaluate(changed, fmt, [POINTS.astype(fmt.dtype)])
        found[edit.kind] = values[changed.results[0][0]].tolist()
    return found


@pytest.mark.parametrize(("tree", "faults"), FAULTS, ids=[str(t[0]) for t, _ in FAULTS])
def test_every_fault_of_an_operation_by_what_it_gives(tree, faults):
    kernel = kernel_of(tree)
    sound = evaluate(kernel, F64, [POINTS])[kernel.results[0][0]].tolist()
    expected = {k: [f(*p[:3]) for p in POINTS.tolist()] for k, f in faults.items()}
    if tree[0] not in ("lt", "le", "eq", "ne", "neg"):
        expected["result negated"] = [-v for v in sound]
    assert found_faults(tree) == expected


def test_faults_of_an_exponent_are_of_the_number_that_f32_raises_to():
    found = found_faults(("pow", "z", 0.75), F32)
    assert set(found) == {"exponent off by 1 %", "exponent off by 2^-27", "result negated"}
    kernel = kernel_of(("pow", "z", 0.75))
    raw = 0.75 * 2**27
    for edit in kernel_edits(kernel, F32, ()):
        if edit.helpers and edit.kind.startswith("exponent"):
            by_hand = raw + 1 if "2^-27" in edit.kind else round(raw * 1.01)
            assert edit.helpers[0].value == by_hand / 2**27
    assert found["exponent off by 1 %"] == pytest.approx(
        [z**0.7575 for z in POINTS[:, 2].tolist()], rel=1e-6
    )


def site_faults(kernel: Kernel, site: int, **more) -> dict[str, Kernel]:
    edits = [e for e in kernel_edits(kernel, F64, more.pop("groups", ()), **more) if e.site == site]
    assert len({e.kind for e in edits}) == len(edits)
    return {e.kind: e.apply(kernel)[0] for e in edits}


def at_points(kernel: Kernel) -> list[float]:
    values = evaluate(kernel, F64, [POINTS])
    return [float(v) for v in values[kernel.results[0][0]]]


def test_choices_logic_and_other_conditions():
    x, y, z, n = POINTS.T
    both = ("and", LESS, ("le", "x", "n"))
    kernel = kernel_of(("select", LESS, "y", "z"), ("if_else_zero", both, "x"))
    first, second = (r[0] for r in kernel.results)
    found = {k: at_points(v) for k, v in site_faults(kernel, first).items()}
    right = np.where(x < y, y, z)
    assert found == {
        "select arms swapped": np.where(x < y, z, y).tolist(),
        "select always first": y.tolist(),
        "select always second": z.tolist(),
        "result negated": (-right).tolist(),
    }
    swapped = Kernel("k", kernel.nodes, ((second,),))
    found = {k: at_points(v) for k, v in site_faults(swapped, second).items()}
    true = (x < y) & (x <= n)
    assert found == {
        "select arms swapped": np.where(true, 0, x).tolist(),
        "select always first": x.tolist(),
        "select always second": [0.0, 0.0, 0.0],
        "condition of another select": np.where(x < y, x, 0).tolist(),
        "result negated": np.where(true, -x, 0).tolist(),
    }
    for op, other in (("and", "or"), ("or", "and")):
        kernel = kernel_of((op, LESS, ("le", "x", "n")))
        (kind,) = site_faults(kernel, kernel.results[0][0])
        assert kind == {"and": "&& to ||", "or": "|| to &&"}[op]
        changed = site_faults(kernel, kernel.results[0][0])[kind]
        assert changed.nodes[changed.results[0][0]].op == other
    kernel = kernel_of(("not", LESS))
    assert {k: at_points(v) for k, v in site_faults(kernel, kernel.results[0][0]).items()} == {
        "! dropped": [float(t) for t in x < y]
    }


def test_status_words_results_and_fields():
    # A word of two bits: a bit moves, a flag is dropped; no bit is off by a last place.
    bits = ("add", ("if_else_zero", LESS, 1), ("if_else_zero", ("lt", "y", "x"), 4))
    kernel = kernel_of(bits)
    word = kernel.results[0][0]
    low, high = kernel.nodes[word].args
    x, y = POINTS[:, 0], POINTS[:, 1]
    edits = list(kernel_edits(kernel, F64, (), words=(0,)))
    dropped = [at_points(e.apply(kernel)[0]) for e in edits if e.kind == "status flag dropped"]
    assert dropped == [np.where(x < y, 1.0, 0).tolist(), np.where(y < x, 4.0, 0).tolist()]
    assert [e.site for e in edits if e.kind == "status flag dropped"] == [word, word]
    moved = {e.site: at_points(e.apply(kernel)[0]) for e in edits if e.kind == "status bit moved"}
    assert moved == {
        low: (np.where(x < y, 2.0, 0) + np.where(y < x, 4.0, 0)).tolist(),
        high: (np.where(x < y, 1.0, 0) + np.where(y < x, 8.0, 0)).tolist(),
    }
    assert "result negated" not in {e.kind for e in edits}
    assert "+ to -" not in {e.kind for e in edits}
    # As no word it is a sum like any other.
    assert {e.kind for e in kernel_edits(kernel, F64, ()) if e.site == word} == {
        *("+ to -", "result negated")
    }
    # A choice of 0 moves to 1.
    kernel = kernel_of(("select", LESS, 0, 2))
    edits = [e for e in kernel_edits(kernel, F64, ()) if e.kind == "status bit moved"]
    assert [e.helpers[0].value for e in edits] == [1.0, 4.0]
    # Constants that are results, each result by itself.
    nodes, (c,) = built(-0.25)
    kernel = Kernel("k", tuple(nodes), ((c, 0), (c,)))
    found = [(e.kind, e.result, e.apply(kernel)[0]) for e in kernel_edits(kernel, F64, ())]
    assert [(k, r) for k, r, _ in found] == [
        (k, r)
        for r in ((0, 0), (1, 0))
        for k in ("constant off by 1 %", "constant off by 1 ulp", "sign of a constant")
    ]
    for _, (k, e), changed in found:
        values = evaluate(changed, F64, [POINTS])
        given_ = [[float(values[i][0]) for i in r] for r in changed.results]
        given_[k][e] = -0.25
        assert given_ == [[-0.25, 2.5], [-0.25]]
    # A field is read from the next one of its struct, round and round; alone in one it is not.
    kernel = kernel_of(("sub", "x", "z"))
    groups = [((0, 0), (0, 1), (0, 2)), ((0, 3),)]
    wrong = [e for e in kernel_edits(kernel, F64, groups) if "field" in e.kind]
    assert [(e.site, e.now.source) for e in wrong] == [(0, (0, 1)), (1, (0, 2)), (2, (0, 0))]
    assert at_points(wrong[0].apply(kernel)[0]) == (POINTS[:, 1] - POINTS[:, 2]).tolist()
    pairs = kernel_edits(kernel, F64, [((0, 0), (0, 1)), ((0, 2),)])
    wrong_of_two = [(e.site, e.now.source) for e in pairs if "field" in e.kind]
    assert wrong_of_two == [(0, (0, 1)), (1, (0, 0))]
    # An element is read once: what is read already is used again.
    changed, place = wrong[2].apply(kernel)
    assert place[2] == place[0]
    assert sum(n.op == "input" for n in changed.nodes) == 3


def test_a_fault_in_words():
    kernel = kernel_of(("mul", ("add", "x", "y"), 0.5))
    total, product = kernel.results[0][0] - 2, kernel.results[0][0]
    said = [describe(kernel, {total: "total"}, e) for e in kernel_edits(kernel, F64, ())]
    sum_ = "total = add(argument 0[0], argument 0[1])"
    assert said[:2] == [
        f"{sum_}  ->  sub(argument 0[0], argument 0[1])",
        f"{sum_}  ->  neg(add(argument 0[0], argument 0[1]))",
    ]
    assert said[2] == f"v{product} = mul(total, 0.5)  ->  div(total, 0.5)"
    assert said[3] == f"v{product} = mul(total, 0.5)  ->  mul(total, 0.505)"
    alone = Edit("", 0, 1, result=(1, 2))
    assert describe(kernel, {1: "y"}, alone) == "result 1[2] = argument 0[0]  ->  y"


# -- values that are one ---------------------------------------------------------------------------

ENDS = {"x": (-8.0, 8.0), "y": (-8.0, 8.0), "z": (0.0, 4.0), "n": (0.0, 20.0)}
B = LESS
ALIKE = [
    *((("add", "x", "y"), ("add", "y", "x")), (("mul", "x", "y"), ("mul", "y", "x"))),
    *((("sub", "x", "y"), ("add", "x", ("neg", "y"))), (("sq", "x"), ("mul", "x", "x"))),
    *((("twice", "x"), ("mul", "x", 2)), (("inv", "x"), ("div", 1, "x"))),
    *(("x", ("mul", "x", 1)), ("x", ("mul", 1, "x")), ("x", ("div", "x", 1))),
    *(("x", ("neg", ("neg", "x"))), (-3, ("neg", 3))),
    (("neg", ("mul", "x", "y")), ("mul", ("neg", "x"), "y")),
    (("mul", "x", "y"), ("mul", ("neg", "x"), ("neg", "y"))),
    (("neg", ("div", "x", "y")), ("div", "x", ("neg", "y"))),
    (("fabs", "x"), ("fabs", ("neg", ("fabs", "x")))),
    *((B, ("not", ("not", B))), (B, ("and", B, B)), (B, ("or", B, B))),
    *((B, ("and", 1, B)), (B, ("or", B, 0)), (0, ("and", B, 0)), (1, ("or", 1, B))),
    *((0, ("not", 3)), (1, ("not", 0))),
    (("and", B, ("eq", "x", "z")), ("and", ("eq", "x", "z"), B)),
    *(("x", ("select", B, "x", "x")), ("x", ("select", 2, "x", "y"))),
    ("y", ("select", 0, "x", "y")),
    (("select", B, "x", "y"), ("select", ("not", B), "y", "x")),
    (("select", B, "x", "z"), ("select", B, ("select", B, "x", "y"), "z")),
    (("select", B, "x", "z"), ("select", B, "x", ("select", B, "y", "z"))),
    (("if_else_zero", B, "x"), ("select", B, "x", 0)),
    (("select", "x", "y", "z"), ("select", ("fabs", ("neg", "x")), "y", "z")),
    *(("x", ("fmin", "x", "x")), ("x", ("fmin", "x", 8)), ("x", ("fmin", "x", 9))),
    *(("x", ("fmax", "x", -8)), ("x", ("fmax", "x", -9)), ("z", ("fmin", "z", 4))),
    (
        ("add", ("select", B, "x", 0), ("select", B, 0, "z")),
        ("add", ("select", B, 0, "z"), ("select", B, "x", 0)),
    ),
    *(
        (1, ("lt", 1, 2)),
        (0, ("lt", 2, 2)),
        (1, ("le", 2, 2)),
        (1, ("eq", 2, 2)),
        (0, ("ne", 2, 2)),
    ),
    *((1, ("lt", "x", 9)), (0, ("le", "x", -9)), (0, ("eq", "x", 9)), (1, ("ne", 9, "x"))),
    *((0, ("lt", 9, "x")), (1, ("le", -8.5, "x"))),
    (("select", B, 1, 0), ("lt", ("select", B, 1, 2), 1.5)),
    (("select", B, 0, 1), ("lt", ("select", B, 2, 1), 1.5)),
    (("select", B, 0, 1), ("le", 1.5, ("select", B, 1, 2))),
    (("select", B, 1, 0), ("eq", ("select", B, 1, 2), 1)),
    (("select", B, 1, 0), ("lt", -1.5, ("neg", ("select", B, 1, 2)))),
    (("select", B, ("lt", 1, "y"), 0), ("lt", 1, ("select", B, "y", 0))),
    *((("lt", -1, "x"), ("lt", ("neg", "x"), 1)), (("lt", "x", -1), ("lt", 1, ("neg", "x")))),
    (("eq", "x", -1), ("eq", ("neg", "x"), 1)),
    *((("lt", "x", 0), ("lt", ("mul", "x", 2), 0)), (("lt", 0, "x"), ("lt", ("mul", "x", -2), 0))),
    *((("le", 0, "x"), ("le", 0, ("mul", 1, "x"))), (("eq", "x", 0), ("eq", ("fabs", "x"), 0))),
    *((("lt", "n", 2.5), ("le", "n", 2)), (("lt", "n", 2.5), ("lt", "n", 3))),
    *((("lt", "n", 2.5), ("le", "n", 2.9)), (("lt", 2.5, "n"), ("le", 3, "n"))),
    *((("lt", 2, "n"), ("le", 2.1, "n")), (("not", ("lt", "n", 3)), ("lt", 2, "n"))),
    *((0, ("eq", "n", 2.5)), (1, ("ne", "n", 2.5))),
    *(
        (("lt", "n", 3), ("lt", ("add", "n", 0.5), 3)),
        (("lt", 2, "n"), ("le", 3, ("add", 0.5, "n"))),
    ),
    (("pow", "z", 0.75), ("pow", "z", 0.75)),
    (("lt", "x", 0), ("lt", ("mul", "x", 1.5), 0)),
    (
        ("select", B, 0, ("lt", "z", 1)),
        ("lt", ("add", ("select", B, 2, 0), ("select", B, 0, "z")), 1),
    ),
    (
        ("select", B, ("lt", ("add", "z", 2), 4), ("lt", ("add", "z", 3), 4)),
        ("lt", ("add", "z", ("select", B, 2, 3)), 4),
    ),
]
OTHERS = [
    *((("sub", "x", "y"), ("sub", "y", "x")), (("div", "x", "y"), ("div", "y", "x"))),
    *((("fmin", "x", "y"), ("fmin", "y", "x")), (B, ("le", "x", "y")), (B, ("lt", "y", "x"))),
    (("add", "x", ("add", "y", "z")), ("add", ("add", "x", "y"), "z")),
    *((("select", B, "x", "y"), ("select", B, "y", "x")), ("x", ("fmin", "x", 7.5))),
    *(("x", ("fmax", "x", -7.5)), ("z", ("fmax", "z", 0)), ("x", ("fabs", "x"))),
    *((("lt", "x", 0), ("lt", ("mul", "x", 0.5), 0)), (("lt", "x", 0), ("lt", 0, "x"))),
    *((("lt", "n", 2.5), ("lt", "n", 3.5)), (("lt", "n", 2.5), ("le", "n", 3))),
    *((("lt", "x", 2.5), ("lt", "x", 3)), (("lt", ("add", "n", 1), 3), ("le", ("add", "n", 1), 3))),
    *((("pow", "z", 0.75), ("pow", "z", 0.75 + 2.0**-27)), (B, ("select", B, "x", "y"))),
    *((("and", B, "n"), ("or", B, "n")), (("div", 1, "x"), "x"), (("not", "x"), "x")),
    (("select", B, "x", ("select", B, "y", "z")), ("select", B, "x", "y")),
    tuple((op, ("select", B, "x", 0), ("select", B, 0, "z")) for op in ("add", "mul")),
    tuple(("add", ("select", B, "x", 0), ("select", c, 0, "z")) for c in (B, ("lt", "x", "z"))),
    (
        ("lt", ("add", ("select", B, 2, 0), ("select", B, 0, "z")), 1),
        ("lt", ("add", ("select", B, 2, 0.5), ("select", B, 0, "z")), 1),
    ),
]


def numbered(*trees, fmt=F32) -> tuple[Numbering, list[int]]:
    nodes, places = built(*trees)
    kernel = Kernel("k", tuple(nodes), tuple((p,) for p in places))
    ends = [[Interval(*ENDS[name]) for name in INPUTS]]
    ranges = dict(enumerate(computed_intervals(kernel, fmt, ends)))
    found = Numbering(kernel, fmt, ranges, frozenset({3}))
    return found, [found.numbers[p] for p in places]


@pytest.mark.parametrize(("one", "other"), ALIKE, ids=str)
def test_what_is_one_by_algebra_has_one_number(one, other):
    _, (a, b) = numbered(one, other)
    assert a == b
    _, (b, a) = numbered(other, one)
    assert a == b
    # And of another kernel, of whose conditions nothing is known beforehand.
    for first, second in ((one, other), (other, one)):
        own, (number,) = numbered(first)
        nodes, (place,) = built(second)
        numbers: list[int] = []
        for i in range(len(nodes)):
            numbers.append(own.number(nodes, i, numbers, {}))
        assert numbers[place] == number


@pytest.mark.parametrize(("one", "other"), OTHERS, ids=str)
def test_what_may_differ_has_two(one, other):
    _, (a, b) = numbered(one, other)
    assert a != b


def test_what_settled_a_value_is_told():
    for tree, words in (
        (("fmin", "x", 9), "the clip at 9 never acts: its operand lies in [-8, 8]"),
        (("fmax", "z", -1), "the clip at -1 never acts: its operand lies in [0, 4]"),
        (("lt", "x", 9), "a condition is always true"),
        (("lt", 9, "x"), "a condition is always false"),
        (("fabs", ("neg", "x")), "only the magnitude is used"),
        (("not", ("neg", "x")), "only whether it is zero is looked at"),
        (("lt", ("mul", "x", 2), 0), "only its sign, or whether it is zero, is looked at"),
        (("lt", "n", 2), "a whole number is compared"),
        (("fmin", "x", "y"), None),
    ):
        found, _ = numbered(tree)
        assert list(found.reasons[max(found.reasons)]) == ([words] if words else [])
    # Without the kernel's own conditions being settled, the intervals that lie apart are told.
    found, _ = numbered("x")
    why: dict[str, None] = {}
    nodes = [*built("x")[0], Node("const", value=9.0), Node("lt", (0, 4))]
    numbers = [*found.numbers[:4], found.constant(9.0)]
    assert found.number(nodes, 5, numbers, why) == found.constant(1.0)
    assert list(why) == ["the values compared lie in [-8, 8] and [9, 9]"]


@pytest.mark.ci
@settings(max_examples=30)
@given(st.lists(st.one_of(trees(), trees(truth=True)), min_size=2, max_size=5))
def test_values_of_one_number_are_equal_whatever_comes_in(made):
    nodes, places = built(*made)
    kernel = Kernel("k", tuple(nodes), tuple((p,) for p in places))
    ends = [[Interval(*ENDS[name]) for name in INPUTS]]
    ranges = dict(enumerate(computed_intervals(kernel, F32, ends)))
    found = Numbering(kernel, F32, ranges, frozenset({3}))
    rng = np.random.default_rng(1)
    columns = [rng.uniform(*ENDS[name], 60) for name in INPUTS]
    columns[3] = np.rint(columns[3])
    for k in range(3):  # ends, zeros, halves and equal ones among them
        columns[k][:20] = rng.choice([*ENDS[INPUTS[k]], 0, 0.5, 1, 2.5, 3], 20)
    values = evaluate(kernel, F32, [np.float32(columns).T])
    seen = {}
    for i, number in enumerate(found.numbers):
        value = values[i].astype(np.float32)
        np.testing.assert_array_equal(value, seen.setdefault(number, value))
        constant = found.forms[number]
        if constant.op == "const":
            np.testing.assert_array_equal(value, np.float32(float.fromhex(constant.value)))
