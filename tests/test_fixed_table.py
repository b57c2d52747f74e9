"""Rows and bars of the range report at their edges: no range at all, many values, notes."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import pytest
from matplotlib import pyplot

from esea_gen.emit.fixed import table
from esea_gen.emit.fixed.plan import Planner
from esea_gen.emit.fixed.table import RangeRow, draw_headroom, range_rows
from esea_gen.emit.formats.q31 import FORMAT as Q31
from esea_gen.language.block import Block
from esea_gen.language.ports import Port

from .test_fixed_report import block


def nothing() -> Block:
    """y = x + min(x, 0) of an x that no bit pattern brings below 0."""
    return Block.define(
        "nothing",
        "Nothing",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(Port("y", -4.0, 4.0, "output"),),
        step=lambda c, s, u, g, label: (
            {},
            {"y": 0.3 * label("none_rad", ca.fmin(ca.fabs(u.x_rad), 0)) + u.x_rad},
        ),
    )


def test_a_value_that_is_always_zero_leaves_its_whole_width():
    rows = {r.name.rpartition("_q")[0]: r for r in range_rows(Planner(nothing()).plan())}
    none = rows["none"]
    assert (none.raw_low, none.raw_high, none.low, none.high) == (0, 0, 0.0, 0.0)
    assert none.headroom_bits == none.bits - 1


def test_a_block_is_printed_in_three_parts_and_without_tunables_in_two():
    for made, parts in ((block(), 1), (nothing(), 0)):
        printed = Q31.emit(made)
        assert printed.block is made
        assert (printed.prepare is not None) == bool(parts)
        inits, steps = printed.init.results, printed.step.results
        assert [len(r) for r in inits] == [1] * parts  # of one state, or of none
        assert [len(r) for r in steps] == [1] * (parts + len(made.outputs))


@pytest.mark.parametrize(
    ("low", "high", "bits", "left"),
    [(0, 0, 32, 31.0), (-1, 1, 32, 31.0), (-8, 2, 32, 28.0), (-2, 8, 32, 28.0), (0, 2**40, 64, 23)],
)
def test_headroom_is_what_the_larger_end_leaves(low, high, bits, left):
    assert table._headroom(low, high, bits) == left


def test_a_note_stands_beside_its_value(monkeypatch):
    planner = Planner(block())
    node = next(i for i, (name, _) in planner.labels.items() if name == "part_Nm")
    monkeypatch.setattr(table, "coarse_values", lambda plan: {node: "7 bits coarser"})
    notes = {r.name.rpartition("_q")[0]: r.note for r in range_rows(planner.plan())}
    assert notes.pop("part") == "7 bits coarser"
    assert set(notes.values()) == {""}


@pytest.mark.parametrize(("most", "all_named"), [(4, False), (5, True)])
def test_of_many_values_those_are_named_that_need_a_look(monkeypatch, most, all_named):
    def row(name: str, kind: str, why: str = "") -> RangeRow:
        return RangeRow(name, kind, -1.0, 1.0, 32, 30, 1.0, -(2**30), 2**30, why=why)

    rows = [row("a", "input"), row("b", "value"), row("c", "value", "is a root"),
            row("d", "coefficient"), row("e", "value")]  # fmt: skip
    monkeypatch.setattr(table, "range_rows", lambda plan: rows)
    monkeypatch.setattr(table, "MOST_NAMES", most)
    figure, axes = pyplot.subplots()
    draw_headroom(Planner(block()).plan(), axes)
    named = {int(t.get_position()[0]): t.get_text() for t in axes.get_xticklabels()}
    assert named == (
        {0: "a", 1: "b", 2: "c", 3: "d", 4: "e"} if all_named else {0: "a", 2: "c", 3: "d"}
    )
    ticks = axes.xaxis.get_major_ticks()
    assert {(t.tick1line.get_markersize(), t.get_pad()) for t in ticks} == {(1, 1)}
    pyplot.close(figure)


def test_values_of_a_step_from_its_first_node_on_but_no_conditions_words_and_reads(monkeypatch):
    def step(node: int, name: str, op: str, bits: int) -> SimpleNamespace:
        return SimpleNamespace(node=node, name=name, expr=SimpleNamespace(
            op=op, bits=bits, low=-(2**20) - node, high=2**10))  # fmt: skip

    steps = [
        step(0, "first_q4", "mul", 32),
        step(1, "read_q4", "read", 32),
        step(2, "less", "le", 1),
        step(3, "word", "flags", -32),
        step(-1, "helper", "mul", 32),  # stands for no value
        step(4, "lost_q4", "mul", 32),
        step(5, "wide_q40", "mul", 64),
        step(6, "exact_q40", "mul", 64),
    ]
    values = {s.node: SimpleNamespace(low=-3, high=7 + s.node, fraction=4) for s in steps}
    values[4] = None
    plan = SimpleNamespace(
        fields=dict.fromkeys(("in", "state", "out", "coeffs"), ()),
        step=SimpleNamespace(steps=steps, values=values),
        why_wide={0: "of another width", 5: "is a root"},
    )
    monkeypatch.setattr(table, "coarse_values", lambda p: {0: "8 bits coarser"})
    first, wide, exact = range_rows(plan)
    assert first == RangeRow(
        "first_q4", "value", -3.0, 7.0, 32, 4, 11.0, -(2**20), 2**10, note="8 bits coarser"
    )
    assert (wide.name, wide.high, wide.why, wide.note) == ("wide_q40", 12.0, "is a root", "")
    assert (exact.name, exact.why) == ("exact_q40", "ends in comparisons: kept exact")
    assert wide.headroom_bits == pytest.approx(43, abs=1e-4)
