"""Body of a Program: exits, bounds of loops and indices, mismatched ports."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.language.builder import Builder, declare_ports
from esea_gen.language.ports import Port
from esea_gen.language.program import Program
from esea_gen.language.statements import Ix, Memory, ProgramError, Ref

X, Y = Port("x", -9.0, 9.0, "in", 3), Port("y", -1e4, 1e4, "out", 4)


def body(**ports) -> Builder:
    """A builder with x of three elements and y of four."""
    b = Builder()
    declare_ports(b, "in", ports.get("inputs", (X,)))
    declare_ports(b, "out", (Y,))
    declare_ports(b, "state", ports.get("state", ()))
    return b


def made(b: Builder, **more) -> Program:
    arguments = {"inputs": (X,), "outputs": (Y,)} | more
    return Program.define("p", "made up", period_s=0.1, builder=b, **arguments)


def put(b: Builder, place, value: float = 0.0, plus=()):
    """Put a number, and what is read, into a place."""
    b.call(f"put{value:g}", [*plus], [place], lambda *v: sum(v, ca.SX(value)))


def y_of(b: Builder, *x: float) -> list[float]:
    return made(b).simulator().step(x=np.array(x or (1.0, 2.0, 3.0)))["y"].tolist()


# -- what the builder writes down ------------------------------------------------------------------


def test_passes_beyond_what_is_stated_are_told():
    for most, total, words in (
        (2, None, "loop i2: 3 passes, bound 2"),
        (3, 5, "loop i2: 6 passes in a step, stated 5"),
    ):
        b = body()
        with b.part("step"), b.loop(0, 4) as i, b.loop(0, i, most, total=total):
            put(b, b.memory["out.y"][0])
        with pytest.raises(ProgramError, match=words):
            y_of(b)


def test_an_exit_leaves_the_innermost_loop_at_once():
    b = body()
    y, x = b.memory["out.y"], b.memory["in.x"]
    with b.part("step"):
        put(b, y[0])
        put(b, y[1])
        with b.loop(0, 3) as i:
            with b.loop(0, 9):
                b.exit_if(x[i])
                put(b, y[0], 1.0, [y[0]])
                with b.when(x[2]):
                    b.exit_if(y[0])
            put(b, y[1], 1.0, [y[1]])
        put(b, y[2], 5.0)
        put(b, y[3], 6.0)
    # Where x is not 0 none, else all nine; the outer loop goes on.
    assert y_of(b, 1.0, 0.0, 0.0) == [18.0, 3.0, 5.0, 6.0]
    assert y_of(b, 0.0, -1.0, 0.0) == [18.0, 3.0, 5.0, 6.0]
    assert y_of(b, 0.0, 1.0, 0.5) == [1.0, 3.0, 5.0, 6.0]


def test_places_outside_an_array_are_told():
    for place, words in (
        (lambda a, i: a[i + 1], r"a\[3\.\.3\] of 3"),
        (lambda a, i: a[i - 1], r"a\[-1\.\.-1\] of 3"),
        (lambda a, i: a[i:2:2], r"a\[1\.\.3\] of 3"),
    ):
        for reads in (True, False):
            b = body()
            a, y = b.array("a", 3), b.memory["out.y"]
            with b.part("step"), b.loop(0, 3) as i:
                ref = place(a, i)
                if reads:
                    b.call("read", [ref], [y[0]], lambda v: v[0])
                else:
                    b.call("write", [], [ref], lambda n=ref.length: ca.DM.zeros(n))
            with pytest.raises(ProgramError, match=words):
                y_of(b)


def broken(change) -> Program:
    b = body()
    y = b.memory["out.y"]
    b.table("t", [1.0])
    b.index_table("n", [1])
    with b.part("step"):
        put(b, y[0])
    change(b)
    return made(b)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda b: b.memory.pop("in.x"), "p: no array for port x"),
        (lambda b: b.memory.update({"in.x": Memory("in.x", 2, "in", X)}), "p: no array for port x"),
        (lambda b: b.memory.update({"out.y": Memory("y", 4, "in", Y)}), "p: no array for port y"),
        (lambda b: b.parts.update(other=b.parts.pop("step")), "p: no part 'step'"),
        *(
            (lambda b, n=n: put_into(b, b.memory[n][0]), f"p: put0 writes to {n}")
            for n in ("in.x", "t", "n")
        ),
        (lambda b: put_into(b, Ref("gone", Ix(0), 1)), "p: no array gone"),
        (lambda b: put_into(b, b.memory["out.y"][0], [Ref("lost", Ix(0), 1)]), "p: no array lost"),
    ],
)
def test_a_body_that_does_not_fit_its_ports_is_refused(change, words):
    with pytest.raises(ProgramError, match=words):
        broken(change)


def put_into(b: Builder, place: Ref, plus=()) -> None:
    with b.part("deep"), b.loop(0, 2), b.when((0, "<", 1)):
        put(b, place, 0.0, plus)
