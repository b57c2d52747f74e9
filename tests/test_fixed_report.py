"""The range report: rows, texts and bars of a small Block, every number worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from matplotlib import pyplot
from matplotlib.colors import to_rgba

from esea_gen.emit.error_bounds import Bound
from esea_gen.emit.fixed import report
from esea_gen.emit.fixed.plan import BlockPlan, Planner
from esea_gen.emit.fixed.report import BlockRanges, RangeReport, range_report
from esea_gen.emit.fixed.table import NARROW, ROOM, WIDE, RangeRow, draw_headroom, range_rows
from esea_gen.emit.fixed.values import LoweringError
from esea_gen.emit.ranges import RangeError
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task


def block(factor: float = 0.25) -> Block:
    """y = gain x / 4 + 1, n' = x."""

    def step(c, s, u, _guard, label):
        y = label("part_Nm", c.gain * u.x_rad * factor) + 1
        return {"n": u.x_rad / 4}, {"y_Nm": y, "status": flag_word([y > 1])}

    return Block.define(
        "quarter",
        "A quarter of it",
        period_s=0.001,
        tunables=(Tunable("gain", 1.0, 1.0, 2.0, "gain"),),
        coefficients=(Port("gain", 0.5, 2.0, "gain"),),
        prepare=lambda t: {"gain": t.gain * 1.0},
        state=(Port("n", -0.25, 0.25, "quarter"),),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(
            Port("y_Nm", -2.0, 2.0, "output"),
            Port("status", 0, 1, "flags", flags=(Flag("MORE", "more than one"),)),
        ),
        step=step,
    )


@pytest.fixture(scope="module")
def plan() -> BlockPlan:
    return Planner(block()).plan()


def test_rows_are_ports_then_values(plan):
    rows = range_rows(plan)
    kinds = ["input", "state", "output", "coefficient"]
    assert [r.kind for r in rows[:4]] == kinds
    assert {r.kind for r in rows[4:]} == {"value"}
    x, n, y, gain = rows[:4]
    # 1 needs 2^30 of 2^31 - 1: one bit is left; 2 with its sign the same, of coarser units.
    assert (x.name, x.low, x.high, x.fraction, x.raw_low, x.raw_high) == (
        "x_rad", -1.0, 1.0, 30, -(2**30), 2**30,
    )  # fmt: skip
    assert (x.form, x.unit, x.physical, x.bits, x.headroom_bits) == (
        "Q1.30", 2.0**-30, "rad", 32, 1.0,
    )  # fmt: skip
    # No finer than 31 bits behind the point, though a quarter would leave room for two more.
    assert (n.fraction, n.form, n.headroom_bits, n.physical) == (31, "Q0.31", 2.0, "")
    assert (y.fraction, y.form, y.headroom_bits, y.physical) == (29, "Q2.29", 1.0, "Nm")
    assert (gain.fraction, gain.low, gain.high, gain.headroom_bits) == (29, 1.0, 2.0, 1.0)
    assert not any(r.why for r in rows)
    part = next(r for r in rows[4:] if r.name.startswith("part_q"))
    # Any bits of x are -2 to 2; times 2 is 4, of which a quarter is a shift of the point.
    assert (part.low, part.bits) == (-1.0, 32)
    assert part.high == pytest.approx(1.0, rel=1e-8)
    assert part.headroom_bits == pytest.approx(
        31 - math.log2(max(abs(part.raw_low), abs(part.raw_high))), abs=1e-12
    )
    assert part.raw_low * part.unit == pytest.approx(part.low, abs=1e-12)
    assert part.raw_high * part.unit == pytest.approx(part.high, abs=1e-12)
    # The word's condition is no row, and what was read has one name alone.
    assert len({r.name for r in rows}) == len(rows)
    assert not any("more" in r.name for r in rows)


def test_a_wide_value_says_why():
    planner = Planner(block())
    node = next(i for i, (name, _) in planner.labels.items() if name == "part_Nm")
    for why, told in (({node: "asked for"}, "asked for"), ({}, "ends in comparisons: kept exact")):
        wide = [r for r in range_rows(planner.plan({node}, why)) if r.bits == 64]
        assert {r.why for r in wide} == {told}
        assert any(r.name.startswith("part_q") for r in wide)


ROWS = (
    RangeRow("x_rad", "input", -1.0, 1.0, 32, 30, 1.0, -(2**30), 2**30, "rad"),
    RangeRow("a_q40", "value", -2.0, 3.0, 64, 40, 20.5, -(2**41), 3 * 2**40, why="is a root"),
    RangeRow("b_q10", "value", 0.0, 5.0, 32, 10, 18.0, 0, 5120, note="7 bits coarser"),
    RangeRow("c_q12", "value", 0.0, 5.0, 32, 12, 16.0, 0, 20480, note="5 bits coarser"),
    RangeRow("d_q8", "value", 0.0, 5.0, 32, 8, 20.0, 0, 1280, note="12 bits coarser"),
    RangeRow("e_q6", "value", 0.0, 5.0, 32, 6, 20.0, 0, 320, note="6 bits coarser"),
    RangeRow("t_q40", "value", -2.0, 3.0, 64, 40, 20.5, -1, 1,
             why="ends in comparisons: kept exact"),
)  # fmt: skip
BOUND = Bound("q31", math.inf, {"y_Nm": 1e-4}, {}, "fixed point", ("v7 = le",))


@pytest.fixture(scope="module")
def shown(plan) -> BlockRanges:
    return BlockRanges("quarter", plan, ROWS, BOUND, "")


def test_what_is_looked_at_first(shown):
    # What is wide for its own sake, then what loses six bits and more, worst first.
    assert shown.looked_at == [
        ("a_q40", "64 bits: is a root"),
        ("d_q8", "12 bits coarser"),
        ("b_q10", "7 bits coarser"),
        ("e_q6", "6 bits coarser"),
    ]


def test_a_block_as_json(shown, plan):
    found = shown.to_dict()
    assert found["proven_error"] == {
        "steps": None,
        "method": "fixed point",
        "outputs": {"y_Nm": 1e-4},
        "percent_of_range": {"y_Nm": pytest.approx(0.005)},  # of 2 Nm
        "assumptions": ["v7 = le"],
    }
    assert (found["lowered"], found["refusal"], len(found["values"])) == (True, "", len(ROWS))
    assert found["values"][1] == {
        "name": "a_q40",
        "kind": "value",
        "raw": [-(2**41), 3 * 2**40],
        "range": [-2.0, 3.0],
        "unit": "",
        "bits": 64,
        "fraction_bits": 40,
        "one_unit": 2.0**-40,
        "headroom_bits": 20.5,
        "why_64_bits": "is a root",
        "costs": "",
    }
    one = Bound("q31", 1, {"y_Nm": 1e-4}, {}, "one step", ())
    assert BlockRanges("q", plan, ROWS, one, "").to_dict()["proven_error"]["steps"] == 1
    refused = BlockRanges("q", None, (), None, "holds zero").to_dict()
    assert (refused["lowered"], refused["refusal"]) == (False, "holds zero")
    assert (refused["proven_error"], refused["values"]) == (None, [])


def test_a_block_as_text(shown, plan):
    head, titles, *rest = shown.lines()
    assert head == "quarter"
    assert titles.split() == ["kind", "format", "raw", "range", "range", "one", "unit", "bits",
                              "room"]  # fmt: skip
    assert rest[0].split() == ["x_rad", "input", "Q1.30", "-1073741824", "to", "1073741824", "-1",
                               "to", "1", "rad", "9.31e-10", "32", "1.0"]  # fmt: skip
    assert rest[1].split() == ["a_q40", "value", "Q23.40", "-2.2e+12", "to", "3.3e+12", "-2", "to",
                               "3", "9.09e-13", "64", "20.5", "is", "a", "root"]  # fmt: skip
    assert rest[2].endswith("18.0  7 bits coarser")
    assert rest[len(ROWS) :] == [
        "  proven error for any number of steps (fixed point):",
        "    y_Nm: 1.00e-04 Nm, 0.005 % of its range",
        "    taken as equal: v7 = le",
    ]
    one = Bound("q31", 1, {"y_Nm": 0.02}, {}, "one step", ())
    last = BlockRanges("q", plan, ROWS, one, "no more").lines()
    assert last[1] == "  no more"
    assert last[-2:] == ["  proven error of one step (one step):",
                         "    y_Nm: 2.00e-02 Nm, 1 % of its range"]  # fmt: skip
    assert BlockRanges("q", None, (), None, "refused").lines() == ["q", "  refused"]


def test_a_device_as_text(shown, plan):
    one = Bound("q31", 1, {"y_Nm": 0.02}, {}, "one step", ())
    more = tuple(
        RangeRow(f"w{k}", "value", 0.0, 1.0, 64, 40, 1.0, 0, 1, why="is wide") for k in range(6)
    )
    report = RangeReport(
        "made",
        (
            shown,
            BlockRanges("lost", None, (), None, "holds zero"),
            BlockRanges("adds", plan, more, one, ""),
        ),
        ("loops",),
    )
    lines = report.table()
    end = lines[lines.index("not covered, a program of loops: loops") :]
    assert end[:3] == [
        "not covered, a program of loops: loops",
        "cannot be lowered: lost",
        "does not forget its errors, bound of one step: adds",
    ]
    first = end.index("to look at first:")
    assert end[first + 1 : first + 10] == [
        *(f"  quarter, {name}: {why}" for name, why in shown.looked_at),
        *(f"  adds, w{k}: 64 bits: is wide" for k in range(4)),
        "  adds: and 2 more, marked above",
    ]
    assert end[first + 10] == ""
    assert end[first + 11].startswith("where a range explodes:")
    assert lines[0] == "quarter"
    assert report.to_dict()["not_covered"] == ["loops"]
    assert list(report.to_dict()["blocks"]) == ["quarter", "lost", "adds"]
    # What cannot be lowered is told what would do.
    lost = RangeReport("made", (BlockRanges("lost", None, (), None, "holds zero"),)).table()
    assert any(line.startswith("where a range explodes:") for line in lost)
    # Nothing to say of what is small and whole.
    quiet = RangeReport("made", (BlockRanges("b", plan, ROWS[:1], BOUND, ""),)).table()
    assert not any(w in "\n".join(quiet) for w in ("look at", "explodes", "forget", "covered"))


def test_the_picture_of_a_report(shown):
    report = RangeReport("made", (shown, BlockRanges("lost", None, (), None, "holds zero")))
    figure = report.figure()
    assert tuple(figure.get_size_inches()) == (16, pytest.approx(0.6 + 2.1 * 2))
    drawn, refused = figure.axes
    (said,) = refused.texts
    assert (said.get_text(), said.get_position(), said.get_wrap()) == ("holds zero", (0, 0.6), True)
    # One below the other.
    grid = drawn.get_subplotspec().get_gridspec()
    assert (grid.nrows, grid.ncols) == (2, 1)
    assert (drawn.get_subplotspec().num1, refused.get_subplotspec().num1) == (0, 1)
    assert (refused.get_title(loc="left"), refused.axison) == ("lost", False)
    assert drawn.get_title(loc="left") == "quarter"
    assert not drawn.spines["top"].get_visible()
    assert drawn.spines["left"].get_visible()
    (legend,) = figure.legends
    assert not legend.get_frame_on()
    assert [t.get_text() for t in legend.get_texts()] == [
        "port", "value, 32 bits", "value, 64 bits", "headroom",
    ]  # fmt: skip
    assert [p.get_facecolor() for p in legend.get_patches()] == [
        to_rgba(c) for c in ("0.1", NARROW, WIDE, ROOM)
    ]
    assert figure.get_suptitle() == "made: bits used in q31"
    (title,) = figure.texts
    assert (title.get_position()[0], title.get_horizontalalignment()) == (0.01, "left")
    assert len(RangeReport("made", report.blocks[:1]).figure().axes) == 1


@pytest.mark.parametrize("wide", [False, True])
def test_bars_are_the_bits_used_and_the_bits_left(wide):
    planner = Planner(block())
    node = next(i for i, (name, _) in planner.labels.items() if name == "part_Nm")
    plan = planner.plan({node}, {node: "asked for"}) if wide else planner.plan()
    rows = range_rows(plan)
    figure, axes = pyplot.subplots()
    draw_headroom(plan, axes)
    bars = axes.patches
    used, left = bars[: len(rows)], bars[len(rows) :]
    assert [b.get_height() for b in used] == [r.bits - 1 - r.headroom_bits for r in rows]
    assert [b.get_height() for b in left] == [r.headroom_bits for r in rows]
    for k, (u, over, r) in enumerate(zip(used, left, rows, strict=True)):
        assert u.get_x() + u.get_width() / 2 == over.get_x() + over.get_width() / 2 == k
        assert u.get_width() == over.get_width() == 0.8
        assert u.get_height() == over.get_y()
        colour = "0.1" if r.kind != "value" else WIDE if r.bits == 64 else NARROW
        assert u.get_facecolor() == to_rgba(colour)
        assert over.get_facecolor() == to_rgba(ROOM)
    assert [t.get_text() for t in axes.get_xticklabels()] == [r.name for r in rows]
    assert list(axes.get_yticks()) == ([0, 15, 31, 63] if wide else [0, 15, 31])
    assert axes.get_xlim() == (-1, len(rows))
    assert (axes.get_ylabel(), axes.get_title(loc="left")) == ("bits", "quarter")
    pyplot.close(figure)


def test_a_report_of_a_system():
    def system(of: Block) -> System:
        return System(
            "made",
            0.001,
            {"quarter": of},
            (Task("run", ("quarter",)),),
            {},
            {"x_rad": ("quarter.x_rad",)},
            {"y_Nm": "quarter.y_Nm"},
        )

    said: list[str] = []
    (found,) = range_report("made", system(block()), said.append).blocks
    assert said == ["ranges of quarter"]
    assert (found.name, found.refusal) == ("quarter", "")
    assert found.bound is not None
    assert math.isinf(found.bound.steps)
    # x is exact, and so is a gain of 1: the sum of the product and 1 is half a unit off or two.
    assert 0 <= found.bound.outputs["y_Nm"] <= 2.0**-28
    assert list(found.rows) == range_rows(found.plan)


@pytest.mark.parametrize(("size", "said"), [(1, "of x_rad_used)"), (2, "of inputs_ok, x_rad[1])")])
def test_a_refusal_names_the_label_or_the_element_of_a_vector(size, said):
    refused = Block.define(
        "inverse",
        "One over it",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input", size, on_invalid=0.5),),
        outputs=(Port("y", -2.0, 2.0, "output"),),
        step=lambda c, s, u, g, label: ({}, {"y": 1 / u.x_rad[size - 1]}),
    )
    with pytest.raises(LoweringError, match="holds zero") as told:
        Planner(refused).plan()
    assert said in str(told.value)


def test_an_error_is_a_share_of_the_larger_end_whichever_it_is():
    outputs = (
        Port("a_Nm", -4.0, 2.0, "larger below"),
        Port("b", -1.0, 8.0, "larger above"),
        Port("flags", 0, 1, "word", flags=(Flag("ON", "on"),)),
    )
    bound = Bound("q31", math.inf, {"a_Nm": 0.02, "b": 0.02}, {}, "linear", ("one", "two"))
    plan = SimpleNamespace(block=SimpleNamespace(outputs=outputs))
    block = BlockRanges("made", plan, ROWS[:1], bound, "")
    assert block.to_dict()["proven_error"]["percent_of_range"] == {
        "a_Nm": pytest.approx(0.5),
        "b": pytest.approx(0.25),
    }
    assert block.lines()[3:] == [
        "  proven error for any number of steps (linear):",
        "    a_Nm: 2.00e-02 Nm, 0.5 % of its range",
        "    b: 2.00e-02, 0.25 % of its range",
        "    taken as equal: one",
        "    taken as equal: two",
    ]
    # Neither without a bound nor without a plan is there an error to tell.
    for other in (
        BlockRanges("q", plan, ROWS[:1], None, ""),
        BlockRanges("q", None, (), bound, ""),
    ):
        assert other.to_dict()["proven_error"] is None
        assert not any("proven" in line for line in other.lines())


@pytest.mark.parametrize("count", [3, 4, 5, 7])
def test_four_values_of_a_block_are_named_first(plan, count):
    rows = tuple(
        RangeRow(f"w{k}", "value", 0.0, 1.0, 64, 40, 1.0, 0, 1, why="is wide") for k in range(count)
    )
    lines = RangeReport("made", (BlockRanges("b", plan, rows, BOUND, ""),)).table()
    start = lines.index("to look at first:") + 1
    named = [f"  b, w{k}: 64 bits: is wide" for k in range(min(count, 4))]
    more = [f"  b: and {count - 4} more, marked above"] if count > 4 else []
    assert lines[start:-3] == [*named, *more, ""]
    assert lines[-3:] == [
        "where a range explodes: clip the value in the Block (every format then has that clip); or "
        "say",
        "in Block.define(facts=...) what algebra knows of it; or narrow the port's range in the "
        "device",
        "file; a quotient of two that grow together is better taken of values that do not.",
    ]


def test_what_cannot_be_lowered_and_what_has_no_bound_say_why(monkeypatch):
    def planned(of: Block) -> BlockPlan:
        if of.name == "quarter":
            return Planner(of).plan()
        raise LoweringError("no such rule", "do otherwise")

    def unbounded(plan: BlockPlan) -> Bound:
        raise RangeError(f"{plan.block.name} grows")

    monkeypatch.setattr(report, "plan_block", planned)
    monkeypatch.setattr(report, "any_bound", unbounded)
    other = replace(block(), name="other")
    kinds = SimpleNamespace(kinds=[other, block()])
    refused, found = range_report("made", kinds).blocks
    assert (refused.plan, refused.rows, refused.bound) == (None, (), None)
    assert refused.refusal.startswith("no such rule")
    assert (found.bound, found.refusal) == (None, "no proven error: quarter grows")
    assert list(found.rows) == range_rows(found.plan)
    lines = found.lines()
    assert lines[:2] == ["quarter", "  no proven error: quarter grows"]
    assert len(lines) == 3 + len(found.rows)
