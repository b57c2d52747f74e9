"""Range report of a device: what every Block holds in q31, and what to do where it cannot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from esea_gen.emit.error_bounds import Bound
from esea_gen.emit.fixed.errors import any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import BlockPlan
from esea_gen.emit.fixed.table import NARROW, ROOM, WIDE, RangeRow, draw_headroom, range_rows
from esea_gen.emit.fixed.values import LoweringError
from esea_gen.emit.ranges import RangeError
from esea_gen.language.program import Program
from esea_gen.language.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COARSE_BITS = 6
"""A value that loses this many bits and more is named among what to look at first."""

SHOWN = 4
"""So many of a Block are named there."""

EXPLODED = (
    "where a range explodes: clip the value in the Block (every format then has that clip); or say",
    "in Block.define(facts=...) what algebra knows of it; or narrow the port's range in the device",
    "file; a quotient of two that grow together is better taken of values that do not.",
)


@dataclass(frozen=True)
class BlockRanges:
    name: str
    plan: BlockPlan | None
    rows: tuple[RangeRow, ...]
    bound: Bound | None
    refusal: str  # why it cannot be lowered, or has no proven error, and what would do

    @property
    def looked_at(self) -> list[tuple[str, str]]:
        held = [r for r in self.rows if r.why and not r.why.startswith("ends in comparisons")]
        found = [(r.name, f"64 bits: {r.why}") for r in held]
        lost = [(int(r.note.split()[0]), r) for r in self.rows if r.note]
        worst = sorted((x for x in lost if x[0] >= COARSE_BITS), key=lambda x: -x[0])
        return found + [(r.name, r.note) for _, r in worst]

    def to_dict(self) -> dict[str, Any]:
        bound = None
        if self.bound is not None and self.plan is not None:
            ends = {p.name: max(abs(p.low), abs(p.high)) for p in self.plan.block.outputs}
            bound = {
                "steps": None if math.isinf(self.bound.steps) else self.bound.steps,
                "method": self.bound.method,
                "outputs": self.bound.outputs,
                "percent_of_range": {n: 100 * e / ends[n] for n, e in self.bound.outputs.items()},
                "assumptions": list(self.bound.assumptions),
            }
        return {
            "lowered": self.plan is not None,
            "refusal": self.refusal,
            "proven_error": bound,
            "values": [
                {
                    "name": r.name,
                    "kind": r.kind,
                    "raw": [r.raw_low, r.raw_high],
                    "range": [r.low, r.high],
                    "unit": r.physical,
                    "bits": r.bits,
                    "fraction_bits": r.fraction,
                    "one_unit": r.unit,
                    "headroom_bits": r.headroom_bits,
                    "why_64_bits": r.why,
                    "costs": r.note,
                }
                for r in self.rows
            ],
        }

    def lines(self) -> list[str]:
        out = [f"{self.name}"]
        if self.refusal:
            out.append(f"  {self.refusal}")
        if self.plan is None:
            return out
        width = max(len(r.name) for r in self.rows)
        out.append(
            f"  {'':{width}} {'kind':11} {'format':>7} {'raw range':>24} {'range':>25} "
            f"{'one unit':>9} {'bits':>4} {'room':>5}"
        )
        for r in self.rows:
            raw = f"{r.raw_low} to {r.raw_high}"
            if r.bits == 64:
                raw = f"{r.raw_low:.3g} to {r.raw_high:.3g}"
            span = f"{r.low:.4g} to {r.high:.4g}" + (f" {r.physical}" if r.physical else "")
            note = f"  {r.why or r.note}" if r.why or r.note else ""
            out.append(
                f"  {r.name:{width}} {r.kind:11} {r.form:>7} {raw:>24} {span:>25} "
                f"{r.unit:9.2e} {r.bits:4d} {r.headroom_bits:5.1f}{note}"
            )
        if self.bound is not None:
            when = "for any number of steps" if math.isinf(self.bound.steps) else "of one step"
            out.append(f"  proven error {when} ({self.bound.method}):")
            for p in self.plan.block.outputs:
                if not p.flags:
                    e = self.bound.outputs[p.name]
                    share = 100 * e / max(abs(p.low), abs(p.high))
                    unit = "" if p.unit == "1" else f" {p.unit}"
                    out.append(f"    {p.name}: {e:.2e}{unit}, {share:.2g} % of its range")
            out += [f"    taken as equal: {a}" for a in self.bound.assumptions]
        return out


@dataclass(frozen=True)
class RangeReport:
    device: str
    blocks: tuple[BlockRanges, ...]
    not_covered: tuple[str, ...] = ()  # Programs, whose loops no range plan follows

    def to_dict(self) -> dict[str, Any]:
        return {
            "device": self.device,
            "blocks": {b.name: b.to_dict() for b in self.blocks},
            "not_covered": list(self.not_covered),
        }

    def table(self) -> list[str]:
        out = [line for b in self.blocks for line in [*b.lines(), ""]]
        refused = [b.name for b in self.blocks if b.plan is None]
        if self.not_covered:
            out.append(f"not covered, a program of loops: {', '.join(self.not_covered)}")
        if refused:
            out.append(f"cannot be lowered: {', '.join(refused)}")
        unbounded = [b.name for b in self.blocks if b.bound and not math.isinf(b.bound.steps)]
        if unbounded:
            out.append(f"does not forget its errors, bound of one step: {', '.join(unbounded)}")
        worst = [b for b in self.blocks if b.looked_at]
        if worst:
            out.append("to look at first:")
        for b in worst:
            out += [f"  {b.name}, {value}: {why}" for value, why in b.looked_at[:SHOWN]]
            more = len(b.looked_at) - SHOWN
            out += [f"  {b.name}: and {more} more, marked above"] if more > 0 else []
        if worst or refused:
            out += ["", *EXPLODED]
        return out

    def figure(self) -> Figure:
        from matplotlib.figure import Figure
        from matplotlib.patches import Patch

        figure = Figure(figsize=(16, 0.6 + 2.1 * len(self.blocks)), layout="constrained")
        panels = figure.subplots(len(self.blocks), 1, squeeze=False)[:, 0]
        for block, axes in zip(self.blocks, panels, strict=True):
            if block.plan is not None:
                draw_headroom(block.plan, axes)
                for side in ("top", "right"):
                    axes.spines[side].set_visible(False)
                continue
            axes.set_axis_off()
            axes.set_title(block.name, loc="left", fontsize=9)
            axes.text(0.0, 0.6, block.refusal, wrap=True, va="center", fontsize=8)
        figure.legend(
            handles=[
                Patch(color="0.1", label="port"),
                Patch(color=NARROW, label="value, 32 bits"),
                Patch(color=WIDE, label="value, 64 bits"),
                Patch(color=ROOM, label="headroom"),
            ],
            loc="outside upper right",
            ncols=4,
            fontsize=8,
            frameon=False,
        )
        figure.suptitle(f"{self.device}: bits used in q31", x=0.01, ha="left", fontsize=11)
        return figure


def range_report(
    name: str, system: System, progress: Callable[[str], None] | None = None
) -> RangeReport:
    say = progress or (lambda _: None)
    found = []
    programs = tuple(b.name for b in system.kinds if isinstance(b, Program))
    for block in (b for b in system.kinds if b.name not in programs):
        say(f"ranges of {block.name}")
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
    return RangeReport(name, tuple(found), programs)


__all__ = ["BlockRanges", "RangeReport", "range_report"]
