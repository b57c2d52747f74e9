"""Lowering a whole kernel: names, checked inputs, status words, ports, what is kept."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.lowering import Kept, lower, names_in, rewrite
from esea_gen.emit.fixed.plan import run_lowered
from esea_gen.emit.fixed.values import LoweredKernel, Source, Target
from esea_gen.emit.walker import Kernel, Node

W = 2**31
X, Y, Z = (Node("input", source=(k, 0)) for k in range(3))


def source(argument: int, element: int) -> Source:
    assert element == 0
    name = ("theta_rad", "tau_Nm", "gain")[argument]
    return Source(name, f"in->{name}", 28, -(2**28), 2**27, f"{name} of it", argument == 2)


def lowered(nodes, results, targets=None, **more) -> LoweredKernel:
    targets = targets or [[Target(f"y{k}", 20)] for k in range(len(results))]
    return lower(Kernel("f", tuple(nodes), results), source, targets, block="tried", **more)


def steps(made: LoweredKernel) -> list[str]:
    return [f"{ex.C_TYPES[s.expr.bits]} {s.name} = {ex.bare_text(s.expr)}" for s in made.steps]


# x, y; x < y; x + y; x - y; the one or the other; not x < y; as numbers.
CHOICE = (X, Y, Node("lt", (0, 1)), Node("add", (0, 1)), Node("sub", (0, 1)),
          Node("select", (2, 3, 4)))  # fmt: skip


def test_numbers_are_named_with_their_format_and_conditions_where_they_are_used_twice():
    head = ["int32_t theta_q28 = in->theta_rad", "int32_t tau_q28 = in->tau_Nm"]
    sums = ["int32_t v3_q28 = theta_q28 + tau_q28", "int32_t v4_q28 = theta_q28 - tau_q28"]
    assert steps(lowered(CHOICE, ((5,),))) == [
        *head,
        *sums,
        "int32_t v5_q20 = (theta_q28 < tau_q28) "
        "? esea_q31_round(v3_q28, 8) : esea_q31_round(v4_q28, 8)",
    ]
    # Used again, or with a label, it is a step.
    twice = (*CHOICE, Node("if_else_zero", (2, 0)))
    assert [s.split(" = ")[0] for s in steps(lowered(twice, ((5,), (6,))))] == [
        "int32_t theta_q28", "int32_t tau_q28", "bool v2", "int32_t v3_q28", "int32_t v4_q28",
        "int32_t v5_q20", "int32_t v6_q20",
    ]  # fmt: skip
    made = lowered(
        CHOICE, ((5,),), labels={2: ("below", "whether"), 3: ("sum_Nm", "both")}, others={4: "rest"}
    )
    assert [(s.name, s.comment, s.node) for s in made.steps] == [
        ("theta_q28", "", 0),
        ("tau_q28", "", 1),
        ("below", "whether", 2),
        ("sum_q28", "both", 3),
        ("rest_q28", "", 4),
        ("v5_q20", "", 5),
    ]
    # A name that is taken is not given again.
    made = lowered(CHOICE, ((5,),), labels={3: ("sum_Nm", ""), 4: ("sum_rad", "")})
    names = [s.name for s in made.steps]
    assert names[2] == "sum_q28"
    assert len(set(names)) == 5
    # What no result needs has no step.
    assert [s.name for s in lowered(CHOICE, ((3,),)).steps] == ["theta_q28", "tau_q28", "v3_q28"]
    assert names_in(made.steps[-1].expr) == {"theta_q28", "tau_q28", *names[2:4]}


def test_the_check_of_a_coefficient_sees_it_as_it_is_and_all_else_sees_it_cut():
    low, high = "(-268435456)", "134217728"
    nodes = (X, Z, Node("const", value=0.5), Node("le", (1, 2)), Node("mul", (0, 1)),
             Node("le", (1, 0)))  # fmt: skip
    made = lowered(nodes, ((4,), (3,), (5,)), [[Target(n, 28)] for n in "abc"], checks={3})
    text = dict(line.split(" = ") for line in steps(made))
    assert text["int32_t gain_held_q28"] == "in->gain"
    assert text["int32_t gain_q28"] == f"esea_q31_max(esea_q31_min(gain_held_q28, {high}), {low})"
    assert text["int32_t v4_q30"] == "esea_q31_mul(theta_q28, gain_q28, 26)"
    told = [v and (ex.bare_text(v.expr)) for v in made.values]
    assert told[3] == "gain_held_q28 <= 134217728"
    assert told[5] == "gain_q28 <= theta_q28"
    (held,) = (s.expr for s in made.steps if s.name == "gain_held_q28")
    assert (held.low, held.high) == (-W, W - 1)


CHECK = (Z, Node("const", value=-1.0), Node("le", (1, 0)), Node("const", value=0.25),
         Node("le", (0, 3)), Node("and", (2, 4)), Node("const", value=0.125),
         Node("select", (5, 0, 6)), Node("select", (2, 0, 6)))  # fmt: skip


def test_a_choice_by_a_check_holds_what_is_in_memory_against_it():
    # -1 to 0.5 may be in memory, anything is; taken from -1 to 1/4, else 1/8.
    given = [-W, -(2**28) - 1, -(2**28), 5, 2**26, 2**26 + 1, 2**27, 2**27 + 1, W - 1]
    places = {"in->gain": np.array(given, object)}
    for result, high in ((7, 2**26), (8, W - 1)):
        made = lowered(CHECK, ((result,),), [[Target("y", 28)]], checks={2})
        wanted = [min(v, 2**27) if -(2**28) <= v <= high else 2**25 for v in given]
        ((found,),) = run_lowered(made, places, len(given))
        assert [int(v) for v in found] == wanted
    # As a result it is cut, too.
    made = lowered(CHECK[:3], ((0,),), [[Target("y", 28)]], checks={2})
    assert made.results == ((ex.named("gain_q28", ex.read("", 32, -(2**28), 2**27)),),)


def word(*flags: tuple[int, float], of: int) -> tuple[Node, ...]:
    """A status word of conditions, as flag_word builds it, from node ``of`` on."""
    nodes: list[Node] = []
    total = None
    for condition, value in flags:
        nodes += [Node("const", value=value), Node("if_else_zero", (condition, of + len(nodes)))]
        part = of + len(nodes) - 1
        if total is not None:
            nodes.append(Node("add", (total, part)))
            part = of + len(nodes) - 1
        total = part
    return tuple(nodes)


def test_a_status_word_is_one_step_named_without_a_format():
    conditions = (X, Y, Node("lt", (0, 1)), Node("le", (1, 0)), Node("or", (2, 3)))
    nodes = (*conditions, *word((2, 1.0), (4, 8.0), (3, 2.0), of=5))
    last = len(nodes) - 1
    targets = [[Target("status", 0, word=True)]]
    made = lowered(nodes, ((last,),), targets, words=(0,), others={last: "status"})
    assert steps(made) == [
        "int32_t theta_q28 = in->theta_rad",
        "int32_t tau_q28 = in->tau_Nm",
        "bool v2 = theta_q28 < tau_q28",
        "bool v3 = tau_q28 <= theta_q28",
        "uint32_t status = esea_bit(v2, 0u) | esea_bit(v2 || v3, 3u) | esea_bit(v3, 1u)",
    ]
    assert ex.bare_text(made.results[0][0]) == "status"
    assert (made.results[0][0].high, made.conversions) == (11, ((0.0,),))


@pytest.mark.parametrize("op", ["and", "or"])
def test_conditions_are_joined_as_they_stand(op):
    nodes = (X, Y, Node("lt", (0, 1)), Node("le", (0, 1)), Node("not", (3,)), Node(op, (2, 4)))
    made = lowered((*nodes, Node("if_else_zero", (5, 0))), ((6,),), [[Target("y", 28)]])
    sign = {"and": "&&", "or": "||"}[op]
    asked = f"(theta_q28 < tau_q28) {sign} (!(theta_q28 <= tau_q28))"
    assert steps(made)[-1] == f"int32_t v6_q28 = ({asked}) ? theta_q28 : 0"


CHAIN = (X, Y, Z, Node("lt", (0, 1)), Node("fmin", (1, 2)), Node("select", (3, 0, 4)),
         Node("fmax", (5, 1)), Node("mul", (6, 0)), Node("fmin", (7, 2)))  # fmt: skip


def fractions(made: LoweredKernel) -> dict[int, int]:
    return {i: v.fraction for i, v in enumerate(made.values) if v is not None}


def test_nothing_on_its_way_to_a_port_is_finer_than_the_port():
    # The greater of (the one or the lesser): all three; a product is no choice.
    made = lowered(CHAIN, ((6,),), [[Target("y", 20)]])
    assert [fractions(made)[i] for i in (4, 5, 6)] == [20, 20, 20]
    # By way of two ports the coarser counts, whichever comes first.
    for first, second in ((20, 24), (24, 20)):
        made = lowered(CHAIN, ((6,), (4,)), [[Target("a", first)], [Target("b", second)]])
        assert fractions(made)[4] == 20
        assert fractions(made)[6] == first
        made = lowered(CHAIN, ((4,), (6,)), [[Target("a", first)], [Target("b", second)]])
        assert fractions(made)[4] == 20
        assert fractions(made)[6] == second
    made = lowered(CHAIN, ((8,),), [[Target("y", 20)]])
    assert [fractions(made)[i] for i in (4, 5, 6, 7, 8)] == [28, 28, 28, 30, 20]


def test_a_range_of_a_port_is_kept_whatever_the_value():
    nodes = (X, Y, Node("add", (0, 1)))
    full = (-(2**21), 2**20 + 1)  # a unit for the rounding of 32 bits
    for low, high, told in (
        (-W, W - 1, full),
        (-7, W - 1, (-7, full[1])),
        (-W, 9, (full[0], 9)),
    ):
        made = lowered(nodes, ((2,),), [[Target("y", 20, low, high)]])
        (e,) = made.results[0]
        assert (e.low, e.high, e.bits) == (*told, 32)
        assert made.saturations == (() if told == full else ("y",))
        assert made.conversions == ((2.0**-21,),)
    # As fine as 31 bits: cut at the word, or at the port's ends, or both.
    targets = [[Target("fine", 31)], [Target("too", 31, -5, 9)], [Target("both", 31, -5, W - 1)]]
    made = lowered(nodes, ((2,), (0,), (2,)), targets)
    assert made.saturations == ("fine", "too", "both", "both")
    assert [(e.low, e.high) for (e,) in made.results] == [(-W, W - 1), (-5, 9), (-5, W - 1)]
    assert ex.bare_text(made.results[0][0]) == (
        "(int32_t)esea_q63_max(esea_q63_min(((int64_t)v2_q28) * INT64_C(8), "
        "INT64_C(2147483647)), INT64_C(-2147483648))"
    )
    made = lowered((Node("const", value=0.3),), ((0,),), [[Target("y", 2)]])
    assert (made.results[0][0], made.conversions[0][0]) == (ex.literal(1), pytest.approx(0.05))


def test_what_is_kept_is_what_would_come_out_anew():
    nodes = (X, Y, Node("mul", (0, 1)), Node("add", (2, 0)), Node("const", value=0.3),
             Node("mul", (3, 4)), Node("fabs", (5,)), Node("tanh", (3,)))  # fmt: skip
    kept = Kept()
    chosen = [(), (2,), (3,), (2, 3), (5, 3), (), (2, 6), (6,), (2, 3, 5, 6), (2,)]
    for wide in chosen:
        given = {"wide": set(wide), "facts": {3: (-0.5, 0.25)}}
        again = lowered(nodes, ((6,), (7,)), kept=kept, **given)
        plain = lowered(nodes, ((6,), (7,)), **given)
        assert steps(again) == steps(plain)
        assert (again.results, again.values) == (plain.results, plain.values)
    # No node is lowered twice with operands of the same kind.
    assert {node for node, *_ in kept.values} == {2, 3, 5, 6, 7}
    assert len(kept.values) < len(chosen) * 5
    size = len(kept.values)
    lowered(nodes, ((6,), (7,)), kept=kept, wide={2, 3}, facts={3: (-0.5, 0.25)})
    assert len(kept.values) == size


def test_one_over_a_value_becomes_a_quotient_and_all_else_stays():
    nodes = (X, Node("inv", (0,)), Y, Node("const", value=2.5), Node("sub", (2, 1)),
             Node("inv", (4,)), Node("select", (0, 3, 5)))  # fmt: skip
    made = rewrite(Kernel("g", nodes, ((6, 1), (4,))))
    assert made.nodes == (
        X, Node("const", value=1.0), Node("div", (1, 0)), Y, Node("const", value=2.5),
        Node("sub", (3, 2)), Node("const", value=1.0), Node("div", (6, 5)),
        Node("select", (0, 4, 7)),
    )  # fmt: skip
    assert (made.name, made.results) == ("g", ((8, 2), (5,)))
