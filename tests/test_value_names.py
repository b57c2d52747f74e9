"""Names of a kernel's values by the ports that they come from and go to, on kernels by hand."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from esea_gen.emit.local_names import meanings
from esea_gen.emit.walker import Kernel, Node


def port(name: str, size: int = 1, *flags: str) -> SimpleNamespace:
    return SimpleNamespace(name=name, size=size, flags=[SimpleNamespace(name=f) for f in flags])


# One coefficient, a state of one number and one of two, then inputs; a vector and a word go out.
BLOCK = SimpleNamespace(
    coefficients=(port("c"), port("pair", 2)),
    state=(port("a"), port("b", 2)),
    outputs=(port("y", 2), port("status", 1, "LOW", "HIGH")),
    flag_results=(3,),
)
C, A, B0, B1, U = range(5)
INPUTS = [Node("input", source=s) for s in ((0, 0), (2, 0), (3, 0), (3, 1), (4, 0))]
STATE_OK = 5
OK = {STATE_OK: ("state_ok", "")}


class Nodes:
    """Nodes in order, each with the number that it gets."""

    def __init__(self) -> None:
        self.all = [*INPUTS, Node("lt", (U, C))]

    def __call__(self, op: str, *args: int, value: float = 0.0) -> int:
        self.all.append(Node(op, args, value))
        return len(self.all) - 1

    def names(self, results, labels=OK, function="step", base=str) -> dict[int, str]:
        kernel = Kernel("f", tuple(self.all), tuple(results))
        return meanings(BLOCK, function, kernel, labels, base)


def test_results_are_named_by_where_they_go():
    n = Nodes()
    values = [n("neg", k % 5) for k in range(6)]
    one, two = n("const", value=1.0), n("const", value=2.0)
    low, high = n("le", U, A), n("eq", A, C)
    word = n("add", n("if_else_zero", low, one), n("if_else_zero", high, two))
    results = ((values[0],), tuple(values[1:3]), tuple(values[3:5]), (word,))
    ends = ("a_next", "b_next_0", "b_next_1", "y_out_0", "y_out_1")
    expected = dict(zip(values, ends, strict=False))
    expected |= {word: "status", low: "low", high: "high"}
    assert n.names(results) == expected
    shouted = {
        k: v if v in ("status", "low", "high") else f"{v[0].upper()}{v[1:]}"
        for k, v in expected.items()
    }
    assert n.names(results, base=str.upper) == shouted
    # The first of two places, and an output before a state.
    results = ((values[0],), (values[1], values[1]), (values[0], values[2]), (word,))
    found = n.names(results)
    assert {k: found.get(k) for k in values[:4]} == {
        values[0]: "y_out_0", values[1]: "b_next_0", values[2]: "y_out_1", values[3]: None,
    }  # fmt: skip
    # A flag before an output.
    found = n.names(((values[0],), (values[1], values[2]), (low, values[3]), (word,)))
    assert (found[low], found[values[3]]) == ("low", "y_out_1")


def test_a_bit_without_a_flag_has_no_name():
    n = Nodes()
    a, b, c = (n(op, U, A) for op in ("le", "eq", "ne"))
    first, second, third = (
        n("if_else_zero", x, n("const", value=v)) for x, v in ((a, 1.0), (b, 2.0), (c, 4.0))
    )
    word = n("add", n("add", first, second), third)
    found = n.names(((A,), (B0, B1), (C, U), (word,)))
    assert (found[a], found[b], found.get(c)) == ("low", "high", None)


def test_of_prepare_and_init_results_have_the_ports_names():
    n = Nodes()
    values = [n("neg", k) for k in range(3)]
    found = n.names(((values[0],), (values[1], values[2])), {}, "prepare")
    assert found == dict(zip(values, ("c", "pair_0", "pair_1"), strict=True))
    found = n.names(((values[0],), (values[1], values[2])), {}, "init", lambda p: f"{p}_q7")
    assert found == dict(zip(values, ("a_q7", "b_q7_0", "b_q7_1"), strict=True))


def test_a_state_as_its_guard_lets_it_through():
    n = Nodes()
    other = n("le", U, C)
    both = n("and", other, STATE_OK)
    more = n("and", both, other)
    used = [
        n("select", STATE_OK, A, C),
        n("if_else_zero", both, B0),
        n("select", STATE_OK, B1, C),
    ]
    for op, *args in (
        ("select", other, A, C),  # another condition
        ("select", more, A, C),
        ("select", STATE_OK, C, A),  # no state but what replaces it
        ("select", STATE_OK, U, A),  # an input
        ("select", STATE_OK, other, A),
        ("add", STATE_OK, A),
        ("or", other, STATE_OK),
    ):
        n(op, *args)
    n("select", len(n.all) - 1, A, C)  # the last one is no guard: it holds where either does
    word = n("const", value=0.0)
    results = ((C,), (C, C), (C, C), (word,))
    names = ("a_used", "b_used_0", "b_used_1")
    found = {k: v for k, v in n.names(results).items() if k not in (C, word)}
    assert found == dict(zip(used, names, strict=True))
    found = n.names(results, base=lambda p: f"{p}{p}")
    assert [found[k] for k in used] == ["aa_used", "bb_used_0", "bb_used_1"]
    # As a result it keeps this name.
    assert n.names(((used[0],), (C, C), (used[1], C), (word,)))[used[0]] == "a_used"
    # Without the guard's label there are none.
    assert not {"a_used", "b_used_0"} & set(
        n.names(results, labels={STATE_OK: ("ok", "")}).values()
    )


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("inverse", "of", "named"), [
    ("not", STATE_OK, "sum"), ("not", STATE_OK + 1, "arm"), ("neg", STATE_OK, "arm"),
])  # fmt: skip
def test_the_sum_of_two_arms_has_the_name_of_the_first(turned, inverse, of, named):
    n = Nodes()
    n("le", U, C)
    arm = n("if_else_zero", STATE_OK, B1)
    rest = n("if_else_zero", n(inverse, of), C)
    total = n("add", *((rest, arm) if turned else (arm, rest)))
    word = n("const", value=0.0)
    found = n.names(((U,), (U, U), (U, U), (word,)))
    place = {"sum": total, "arm": arm}[named]
    assert {k for k, v in found.items() if v == "b_used_1"} == {place}


def test_the_sum_of_two_states_has_neither_name():
    n = Nodes()
    first, second = n("if_else_zero", STATE_OK, A), n("if_else_zero", STATE_OK, B0)
    total = n("add", first, second)
    outer = n("add", first, n("neg", U))
    word = n("const", value=0.0)
    found = n.names(((U,), (U, U), (U, U), (word,)))
    assert (found[first], found[second]) == ("a_used", "b_used_0")
    assert total not in found
    assert outer not in found
