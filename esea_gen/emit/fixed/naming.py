"""C names of fields, in all number formats: a port's own, or in q31 with its format as suffix."""

from __future__ import annotations

from typing import Any

from esea_gen.emit.fixed.plan import FieldPlan, field_name
from esea_gen.emit.fixed.render import field_text
from esea_gen.emit.fixed.search import plan_block
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import External, Latch, Signal, System


class Naming:
    """Names of a System's C fields.

    fixed: whether fields carry their q31 format.
    """

    def __init__(self, system: System, fixed: bool) -> None:
        self.system, self.fixed = system, fixed

    def field(self, block: Block, group: str, port: Any) -> str:
        """Name of a Block's field.

        group: struct: ``params``, ``coeffs``, ``state``, ``in`` or ``out``.
        """
        return plan_block(block).field(group, port.name).name if self.fixed else str(port.name)

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
        if not self.fixed:
            return external.name
        f = self.external_field(external)
        return field_name(external.name, f.fraction, f.name == f.port.name)

    def latch(self, latch: Latch) -> str:
        """Name of a latch's field."""
        if not self.fixed:
            return latch.name
        f = self._end(latch.source, "out")
        return field_name(latch.name, f.fraction, f.name == f.port.name)

    def text(self, block: Block | None, group: str, port: Any) -> str:
        """What a q31 header adds to a port's description.

        return: raw range, unit and overflow behaviour; empty in other formats.
        """
        if not self.fixed or block is None:
            return ""
        text = field_text(plan_block(block).field(group, port.name), group)
        return f"; {text}" if text else ""

    def convert(self, text: str, source: Signal | None, block: Block, port: Port) -> str:
        """A value in the format of the port that it feeds.

        source: output that it comes from; None for an external input, which has the port's format.
        """
        if not self.fixed or source is None:
            return text
        made, wanted = self._end(source, "out"), plan_block(block).field("in", port.name)
        moved = wanted.fraction - made.fraction
        if moved < 0:
            return f"esea_q31_round({text}, {-moved})"
        if moved > 0:
            return f"esea_q31_saturate({text} * (INT64_C(1) << {moved}))"
        return text
