"""C names of fields in q31: the port's, with its format in the place of the unit."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.emit.fixed.kept import plan_block, raw_tunable
from esea_gen.emit.fixed.plan import FieldPlan, field_name
from esea_gen.emit.fixed.render import field_text
from esea_gen.emit.naming import Naming
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import External, Latch, Signal, System


class FixedNaming(Naming):
    """Fields that carry raw numbers, each in a format of its own."""

    def __init__(self, system: System) -> None:
        super().__init__(system, "int32_t", np.dtype(np.int32))

    def field(self, block: Block, group: str, port: Any) -> str:
        """Name of a Block's field."""
        return plan_block(block).field(group, port.name).name

    def _end(self, signal: Signal, group: str) -> FieldPlan:
        return plan_block(self.system.blocks[signal.instance]).field(group, signal.port)

    def external_field(self, external: External) -> FieldPlan:
        """Format of an external value.

        return: of the first port that it feeds, or of the one that it comes from.
        """
        group = "in" if external in self.system.inputs else "out"
        return self._end(external.signals[0], group)

    def external(self, external: External) -> str:
        """Name of an external value's field."""
        f = self.external_field(external)
        return field_name(external.name, f.fraction, f.name == f.port.name)

    def latch(self, latch: Latch) -> str:
        """Name of a latch's field."""
        f = self._end(latch.source, "out")
        return field_name(latch.name, f.fraction, f.name == f.port.name)

    def text(self, block: Block | None, group: str, port: Any) -> str:
        """Raw range, unit and overflow behaviour."""
        if block is None:
            return ""
        text = field_text(plan_block(block).field(group, port.name), group)
        return f"; {text}" if text else ""

    def convert(self, text: str, source: Signal | None, block: Block, port: Port) -> str:
        """A raw number in the format of the port that it feeds."""
        if source is None:
            return text
        made, wanted = self._end(source, "out"), plan_block(block).field("in", port.name)
        moved = wanted.fraction - made.fraction
        if moved < 0:
            return f"esea_q31_round({text}, {-moved})"
        if moved > 0:
            return f"esea_q31_saturate({text} * (INT64_C(1) << {moved}))"
        return text

    def literal(self, value: float) -> str:
        """C literal of a raw number."""
        return f"{value:.0f}"

    def whole(self, text: str, block: Block, port: Port) -> str:
        """A small whole number in the raw format of an input port."""
        return f"(int32_t)({text} << {plan_block(block).field('in', port.name).fraction})"

    def number(self, block: Block, group: str, name: str, value: float) -> float:
        """Raw number of a value inside the port's range."""
        return plan_block(block).field(group, name).raw(value)

    def tunable(self, block: Block, name: str, value: float) -> tuple[str, float]:
        """C field and raw number of any value."""
        return raw_tunable(block, name, value)

    def fraction(self, block: Block, group: str, name: str) -> int | None:
        """Fraction bits of a Block's field."""
        return plan_block(block).field(group, name).fraction

    def external_fraction(self, external: External) -> int | None:
        """Fraction bits of an external value's field; None for a status word."""
        return None if external.port.flags else self.external_field(external).fraction

    def from_units(self, external: External, text: str) -> str:
        """C expression of the raw number nearest to a double."""
        return f"ESEA_Q31_FROM({text}, {self.external_field(external).fraction})"

    def to_units(self, external: External, text: str) -> str:
        """C expression of a raw number as a double."""
        if external.port.flags:
            return text
        return f"ESEA_Q31_TO({text}, {self.external_field(external).fraction})"

    def stored(self, external: External, value: Any) -> npt.NDArray[Any]:
        """Raw number of a value that one stands for exactly."""
        if external.port.flags:
            return super().stored(external, value)
        scaled = np.asarray(value, np.float64) * 2.0 ** self.external_field(external).fraction
        return scaled.astype(np.int32)
