"""Fields in q31: named as their ports, each with a macro that says its format."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.values import FieldPlan
from esea_gen.emit.naming import Naming
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import External, Signal, System, Task


def quantity(value: float, unit: str) -> str:
    return f"{value:.3g}" + ("" if unit == "1" else f" {unit}")


def format_text(f: FieldPlan) -> str:
    """Format of a field, and the value of one raw count."""
    form = "whole number" if f.fraction == 0 else f"Q{31 - f.fraction}.{f.fraction}"
    return f"{form}, one unit is {quantity(f.lsb, f.port.unit)}"


def field_text(f: FieldPlan, group: str) -> str:
    """Header text of a field's numbers: raw range, unit, behaviour outside."""
    if f.whole:
        return ""
    text = f"raw {f.low} to {f.high}, {format_text(f)}"
    behaviour = {
        "params": "outside: refused",
        "coeffs": "cut to it by prepare",
        "state": "cannot overflow",
        "in": "",
        "out": "cannot overflow",
    }[group]
    if f.checked:
        low, high = f.port_range
        behaviour += f"; outside {low} to {high}: found by the step"
    if group == "state" and isinstance(f.port, Port) and f.port.size == 1:
        behaviour += "; outside: corrupt"
    return text + (f"; {behaviour}" if behaviour else "")


class FixedNaming(Naming):
    """Fields that carry raw numbers, each in a format of its own."""

    def __init__(self, system: System) -> None:
        super().__init__(system, "int32_t", np.dtype(np.int32))

    def _end(self, signal: Signal, group: str) -> FieldPlan:
        return plan_block(self.system.blocks[signal.instance]).field(group, signal.port)

    def external_field(self, external: External) -> FieldPlan:
        group = "in" if external in self.system.inputs else "out"
        return self._end(external.signals[0], group)

    def _macro(self, *parts: str) -> str:
        return "_".join(("esea", self.system.name, *parts, "fraction")).upper()

    def _external_macro(self, external: External) -> str:
        group = "in" if external in self.system.inputs else "out"
        task = self.system.task_of(external.signals[0].instance)
        return self._macro(task.name, group, external.name)

    def _scale(self, macro: str, f: FieldPlan) -> str:
        form = f"({f.fraction})" if f.fraction < 0 else f.fraction
        return f"#define {macro} {form} /* {format_text(f)} */"

    def block_scales(self, block: Block, group: str) -> tuple[str, ...]:
        return tuple(
            self._scale(self._macro(block.name, group, f.name), f)
            for f in plan_block(block).fields[group]
            if not f.whole
        )

    def task_scales(self, task: Task, group: str) -> tuple[str, ...]:
        of_task = self.system.task_inputs if group == "in" else self.system.task_outputs
        return tuple(
            self._scale(self._external_macro(x), self.external_field(x))
            for x in of_task(task)
            if not x.port.whole
        )

    def latch_scales(self) -> tuple[str, ...]:
        return tuple(
            self._scale(self._macro("latches", x.name), self._end(x.source, "out"))
            for x in self.system.latches
            if not x.port.whole
        )

    def external_scale(self, external: External) -> str:
        return "" if external.port.whole else self._external_macro(external)

    def text(self, block: Block | None, group: str, port: Any) -> str:
        if block is None:
            return ""
        text = field_text(plan_block(block).field(group, port.name), group)
        return f"; {text}" if text else ""

    def convert(self, text: str, source: Signal | None, block: Block, port: Port) -> str:
        if source is None:
            return text
        made, wanted = self._end(source, "out"), plan_block(block).field("in", port.name)
        moved = wanted.fraction - made.fraction
        if moved < 0:
            return f"esea_q31_round({text}, {-moved})"
        if moved > 0:
            return f"esea_q31_saturate({text} * (INT64_C(1) << {moved}))"
        return text

    def number(self, block: Block, group: str, name: str, value: float) -> float:
        return plan_block(block).field(group, name).raw(value)

    def tunable(self, block: Block, name: str, value: float) -> float:
        # NaN and what does not fit becomes INT32_MIN, which prepare refuses.
        scaled = value * 2.0 ** plan_block(block).field("params", name).fraction
        return math.floor(scaled + 0.5) if -(2.0**31) < scaled < 2.0**31 - 1 else -(2**31)

    def fraction(self, block: Block, group: str, name: str) -> int | None:
        return plan_block(block).field(group, name).fraction

    def external_fraction(self, external: External) -> int | None:
        return None if external.port.whole else self.external_field(external).fraction

    def from_units(self, external: External, text: str) -> str:
        if external.port.whole:
            return super().from_units(external, text)
        return f"ESEA_Q31_FROM({text}, {self.external_scale(external)})"

    def to_units(self, external: External, text: str) -> str:
        if external.port.whole:
            return text
        return f"ESEA_Q31_TO({text}, {self.external_scale(external)})"

    def stored(self, external: External, value: Any) -> npt.NDArray[Any]:
        if external.port.whole:
            return super().stored(external, value)
        scaled = np.asarray(value, np.float64) * 2.0 ** self.external_field(external).fraction
        return scaled.astype(np.int32)
