"""Range report of a Block: every value's range, format, unit and headroom, as table and picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from esea_gen.emit.fixed.plan import BlockPlan
from esea_gen.emit.fixed.search import coarse_values


@dataclass(frozen=True)
class RangeRow:
    name: str
    kind: str  # ``input``, ``state``, ``output``, ``coefficient`` or ``value``
    low: float
    high: float
    bits: int
    fraction: int
    headroom_bits: float  # bits that the range leaves of the width
    raw_low: int  # the same range in whole numbers
    raw_high: int
    physical: str = ""  # unit of a port; empty for a value
    why: str = ""
    note: str = ""  # of a value with 32 bits, what its range costs

    @property
    def form(self) -> str:
        return f"Q{self.bits - 1 - self.fraction}.{self.fraction}"

    @property
    def unit(self) -> float:
        return float(2.0**-self.fraction)


def range_rows(plan: BlockPlan) -> list[RangeRow]:
    kinds = {"in": "input", "state": "state", "out": "output", "coeffs": "coefficient"}
    rows = []
    for group, kind in kinds.items():
        for f in plan.fields[group]:
            if getattr(f.port, "flags", ()):
                continue
            room = _headroom(f.low, f.high, 32)
            low, high = f.low * f.lsb, f.high * f.lsb
            unit = "" if f.port.unit == "1" else f.port.unit
            rows.append(
                RangeRow(f.name, kind, low, high, 32, f.fraction, room, f.low, f.high, unit)
            )
    coarse = coarse_values(plan)
    for s in plan.step.steps:
        v = plan.step.values[s.node] if s.node >= 0 else None
        if v is None or s.expr.bits in (1, -32) or s.expr.op == "read":
            continue
        rows.append(
            RangeRow(
                s.name,
                "value",
                float(v.low),
                float(v.high),
                s.expr.bits,
                v.fraction,
                _headroom(s.expr.low, s.expr.high, s.expr.bits),
                s.expr.low,
                s.expr.high,
                why=plan.why_wide.get(s.node, "ends in comparisons: kept exact")
                if s.expr.bits == 64
                else "",
                note=coarse.get(s.node, ""),
            )
        )
    return rows


def _headroom(low: int, high: int, bits: int) -> float:
    return bits - 1 - math.log2(max(abs(low), abs(high), 1))


MOST_NAMES = 210
COLOURS = {"input": "0.1", "state": "0.1", "output": "0.1", "coefficient": "0.1"}
NARROW, WIDE, ROOM = "#3b6ea5", "#c8553d", "0.88"


def draw_headroom(plan: BlockPlan, axes: Any) -> None:
    rows: Sequence[RangeRow] = range_rows(plan)
    places = range(len(rows))
    used = [r.bits - 1 - r.headroom_bits for r in rows]
    colours = [COLOURS.get(r.kind, NARROW if r.bits == 32 else WIDE) for r in rows]
    axes.bar(places, used, color=colours, width=0.8)
    axes.bar(places, [r.headroom_bits for r in rows], bottom=used, color=ROOM, width=0.8)
    # With more values than names fit, the ports and what needs a look keep theirs.
    named = [i for i, r in enumerate(rows) if len(rows) <= MOST_NAMES or r.kind != "value" or r.why]
    axes.set_xticks(named, [rows[i].name for i in named], fontsize=5, rotation=90)
    axes.tick_params(axis="x", length=1, pad=1)
    axes.set_yticks((0, 15, 31, 63) if any(r.bits == 64 for r in rows) else (0, 15, 31))
    axes.set_xlim(-1, len(rows))
    axes.set_ylabel("bits")
    axes.set_title(plan.block.name, loc="left", fontsize=9)


__all__ = [
    "NARROW",
    "ROOM",
    "WIDE",
    "RangeRow",
    "draw_headroom",
    "range_rows",
]
