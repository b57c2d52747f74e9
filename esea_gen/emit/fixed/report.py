"""Range report of a device in q31: values of every Block, and the remedy where one overflows.

Every value's range, format, unit and headroom, as table and picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from esea_gen.emit.fixed.errors import any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import BlockPlan
from esea_gen.emit.fixed.search import coarse_values
from esea_gen.emit.fixed.values import LoweringError
from esea_gen.emit.spans import RangeError
from esea_gen.emit.step_errors import Bound
from esea_gen.files import plain
from esea_gen.language.program import Program
from esea_gen.language.system import System

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COARSE_BITS = 6  # a value that loses so many bits is named among what to look at first
SHOWN = 4  # so many of a Block are named there
MOST_NAMES = 210  # values of a Block whose names fit below a panel
KINDS = {"in": "input", "state": "state", "out": "output", "coeffs": "coefficient"}
PORT, NARROW, WIDE, ROOM = "0.1", "#3b6ea5", "#c8553d", "0.88"

EXPLODED = (
    "where a range explodes: clip the value in the Block (every format then has that clip); or say",
    "in Block.define(facts=...) what algebra knows of it; or narrow the port's range in the device",
    "file; a quotient of two that grow together is better taken of values that do not.",
)


@dataclass(frozen=True)
class RangeRow:
    """A port or value of a Block, with the keys that its JSON has."""

    name: str
    kind: str  # ``input``, ``state``, ``output``, ``coefficient`` or ``value``
    raw: tuple[int, int]
    # Of a port as declared; of a value what any bit pattern of inputs and states can make it.
    range: tuple[float, float]
    unit: str  # of a port
    bits: int
    fraction_bits: int
    one_unit: float
    headroom_bits: float  # that the range leaves of the width
    why_64_bits: str = ""
    costs: str = ""  # of a value with 32 bits, what its range costs

    def line(self, width: int) -> str:
        form = f"Q{self.bits - 1 - self.fraction_bits}.{self.fraction_bits}"
        wide = ".3g" if self.bits == 64 else ""
        raw = f"{self.raw[0]:{wide}} to {self.raw[1]:{wide}}"
        span = f"{self.range[0]:.4g} to {self.range[1]:.4g}"
        span += f" {self.unit}" if self.unit else ""
        note = self.why_64_bits or self.costs
        return (
            f"  {self.name:{width}} {self.kind:11} {form:>7} {raw:>24} {span:>25} "
            f"{self.one_unit:9.2e} {self.bits:4d} {self.headroom_bits:5.1f}"
        ) + (f"  {note}" if note else "")


def range_rows(plan: BlockPlan) -> Iterator[RangeRow]:
    """Ports first, then the step's values in order; conditions left out."""

    def room(ends: tuple[int, int], bits: int) -> float:
        return bits - 1 - math.log2(max(abs(ends[0]), abs(ends[1]), 1))

    for group, kind in KINDS.items():
        for f in plan.fields[group]:
            if not f.word:
                raw, unit = (f.low, f.high), "" if f.port.unit == "1" else f.port.unit
                ends = f.low * f.lsb, f.high * f.lsb
                yield RangeRow(f.name, kind, raw, ends, unit, 32, f.fraction, f.lsb, room(raw, 32))
    coarse = coarse_values(plan)
    for s in plan.step.steps:
        v, bits = plan.step.values[s.node] if s.node >= 0 else None, s.expr.bits
        if v is None or bits in (1, -32) or s.expr.op == "read":
            continue
        raw, ends = (s.expr.low, s.expr.high), (float(v.low), float(v.high))
        why = plan.why_wide.get(s.node, "ends in comparisons: kept exact") if bits == 64 else ""
        size = bits, v.fraction, float(2.0**-v.fraction), room(raw, bits)
        yield RangeRow(s.name, "value", raw, ends, "", *size, why, coarse.get(s.node, ""))


@dataclass(frozen=True)
class BlockRanges:
    name: str
    plan: BlockPlan | None  # None when it cannot be lowered
    rows: tuple[RangeRow, ...]
    bound: Bound | None
    refusal: str  # why it cannot be lowered, or has no proven error, and what would do

    @property
    def looked_at(self) -> list[tuple[str, str]]:
        """Values whose range costs most: name and cost."""
        wide = [(r.name, r.why_64_bits) for r in self.rows if r.why_64_bits]
        found = [(n, f"64 bits: {w}") for n, w in wide if not w.startswith("ends in comparisons")]
        lost = [(int(r.costs.split()[0]), r) for r in self.rows if r.costs]
        worst = sorted((x for x in lost if x[0] >= COARSE_BITS), key=lambda x: -x[0])
        return found + [(r.name, r.costs) for _, r in worst]

    def _proven(self) -> dict[str, tuple[float, float]]:
        # Of each output that is a number: the error, and its percentage of the range.
        if self.bound is None or self.plan is None:
            return {}
        sizes = {p.name: max(abs(p.low), abs(p.high)) for p in self.plan.block.outputs}
        return {n: (e, 100 * e / sizes[n]) for n, e in self.bound.outputs.items()}

    def to_dict(self) -> dict[str, Any]:
        bound = None
        if self.bound is not None:
            bound = {
                "steps": None if math.isinf(self.bound.steps) else self.bound.steps,
                "method": self.bound.method,
                "outputs": self.bound.outputs,
                "percent_of_range": {n: share for n, (_, share) in self._proven().items()},
                "assumptions": list(self.bound.assumptions),
            }
        return {
            "lowered": self.plan is not None,
            "refusal": self.refusal,
            "proven_error": bound,
            "values": plain(self.rows),
        }

    def lines(self) -> Iterator[str]:
        yield self.name
        if self.refusal:
            yield f"  {self.refusal}"
        if self.plan is None:
            return
        width = max(len(r.name) for r in self.rows)
        yield (
            f"  {'':{width}} {'kind':11} {'format':>7} {'raw range':>24} {'range':>25} "
            f"{'one unit':>9} {'bits':>4} {'room':>5}"
        )
        yield from (r.line(width) for r in self.rows)
        if self.bound is None:
            return
        when = "for any number of steps" if math.isinf(self.bound.steps) else "of one step"
        yield f"  proven error {when} ({self.bound.method}):"
        units = {p.name: "" if p.unit == "1" else f" {p.unit}" for p in self.plan.block.outputs}
        for name, (error, share) in self._proven().items():
            yield f"    {name}: {error:.2e}{units[name]}, {share:.2g} % of its range"
        yield from (f"    taken as equal: {a}" for a in self.bound.assumptions)

    def draw(self, axes: Axes) -> None:
        """Used share of every port's and value's width, or the reason why there is no plan."""
        axes.set_title(self.name, loc="left", fontsize=9)
        if self.plan is None:
            axes.set_axis_off()
            axes.text(0.0, 0.6, self.refusal, wrap=True, va="center", fontsize=8)
            return
        rows, places = self.rows, range(len(self.rows))
        used = [r.bits - 1 - r.headroom_bits for r in rows]
        colours = [PORT if r.kind != "value" else NARROW if r.bits == 32 else WIDE for r in rows]
        axes.bar(places, used, color=colours, width=0.8)
        axes.bar(places, [r.headroom_bits for r in rows], bottom=used, color=ROOM, width=0.8)
        # With more values than names fit, the ports and what needs a look keep theirs.
        few = len(rows) <= MOST_NAMES
        named = [i for i, r in enumerate(rows) if few or r.kind != "value" or r.why_64_bits]
        axes.set_xticks(named, [rows[i].name for i in named], fontsize=5, rotation=90)
        axes.tick_params(axis="x", length=1, pad=1)
        axes.set_yticks((0, 15, 31, 63) if any(r.bits == 64 for r in rows) else (0, 15, 31))
        axes.set_xlim(-1, len(rows))
        axes.set_ylabel("bits")
        axes.spines[["top", "right"]].set_visible(False)


@dataclass(frozen=True)
class RangeReport:
    device: str
    blocks: tuple[BlockRanges, ...]
    not_covered: tuple[str, ...] = ()  # Programs, whose loops no range plan follows

    def to_dict(self) -> dict[str, Any]:
        blocks = {b.name: b.to_dict() for b in self.blocks}
        return {"device": self.device, "blocks": blocks, "not_covered": list(self.not_covered)}

    def table(self) -> list[str]:
        """Table of every Block, then the most costly values."""
        out = [line for b in self.blocks for line in [*b.lines(), ""]]
        refused = [b.name for b in self.blocks if b.plan is None]
        unbounded = [b.name for b in self.blocks if b.bound and not math.isinf(b.bound.steps)]
        for said, names in (
            ("not covered, a program of loops", self.not_covered),
            ("cannot be lowered", refused),
            ("does not forget its errors, bound of one step", unbounded),
        ):
            out += [f"{said}: {', '.join(names)}"] if names else []
        worst = [b for b in self.blocks if b.looked_at]
        out += ["to look at first:"] if worst else []
        for b in worst:
            out += [f"  {b.name}, {value}: {why}" for value, why in b.looked_at[:SHOWN]]
            more = len(b.looked_at) - SHOWN
            out += [f"  {b.name}: and {more} more, marked above"] if more > 0 else []
        return out + (["", *EXPLODED] if worst or refused else [])

    def figure(self) -> Figure:
        """Bits that every port and value uses, one panel a Block."""
        from matplotlib.figure import Figure
        from matplotlib.patches import Patch

        figure = Figure(figsize=(16, 0.6 + 2.1 * len(self.blocks)), layout="constrained")
        panels = figure.subplots(len(self.blocks), 1, squeeze=False)[:, 0]
        for block, axes in zip(self.blocks, panels, strict=True):
            block.draw(axes)
        colours = {"port": PORT, "value, 32 bits": NARROW, "value, 64 bits": WIDE, "headroom": ROOM}
        handles = [Patch(color=c, label=name) for name, c in colours.items()]
        figure.legend(
            handles=handles, loc="outside upper right", ncols=4, fontsize=8, frameon=False
        )
        figure.suptitle(f"{self.device}: bits used in q31", x=0.01, ha="left", fontsize=11)
        return figure


def range_report(
    name: str, system: System, progress: Callable[[str], None] | None = None
) -> RangeReport:
    """Ranges, formats and proven errors of a System's Blocks.

    A Block that cannot be lowered stands in it with the reason; a Program only by name.
    """
    found, programs = [], []
    for block in system.kinds:
        if isinstance(block, Program):
            programs.append(block.name)
            continue
        if progress:
            progress(f"ranges of {block.name}")
        try:
            plan = plan_block(block)
        except LoweringError as error:
            found.append(BlockRanges(block.name, None, (), None, str(error)))
            continue
        bound, refusal = None, ""
        try:
            bound = any_bound(plan)
        except RangeError as error:
            refusal = f"no proven error: {error}"
        found.append(BlockRanges(block.name, plan, tuple(range_rows(plan)), bound, refusal))
    return RangeReport(name, tuple(found), tuple(programs))
