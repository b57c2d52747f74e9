"""C names of a System's fields, and how a number in units becomes one of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.emit.printed import field_type
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import External, Signal, System, Task


class Naming:
    """Fields that have their ports' names and units."""

    def __init__(self, system: System, c_type: str, dtype: np.dtype[Any]) -> None:
        self.system, self.c_type, self.dtype = system, c_type, dtype

    def text(self, block: Block | None, group: str, port: Any) -> str:
        """Header's addition to a port's description."""
        return ""

    def convert(self, text: str, source: Signal | None, block: Block, port: Port) -> str:
        """A value, as C text, in the format of the port that it feeds."""
        return text

    def watched(self, text: str, port: Port) -> str:
        """A value of the watch, as C text, for the port it feeds; a flag it never sets is 0."""
        if port.kind == "flag":
            return f"{text} == 1u ? 1u : 0u"
        return text

    def number(self, block: Block, group: str, name: str, value: float) -> float:
        """Number in a Block's field for a value inside the port's range, in its unit."""
        return value

    def tunable(self, block: Block, name: str, value: float) -> float:
        """Number in a tunable's field for any value in its unit."""
        return value

    def fraction(self, block: Block, group: str, name: str) -> int | None:
        """Fraction bits of a Block's field; None where it is in units."""
        return None

    def external_fraction(self, external: External) -> int | None:
        """Fraction bits of an external value's field; None where it is in units."""
        return None

    def block_scales(self, block: Block, group: str) -> tuple[str, ...]:
        return ()

    def task_scales(self, task: Task, group: str) -> tuple[str, ...]:
        return ()

    def latch_scales(self) -> tuple[str, ...]:
        return ()

    def external_scale(self, external: External) -> str:
        """C expression of the fraction bits of an external value's field; empty in units."""
        return ""

    def from_units(self, external: External, text: str) -> str:
        """C expression of a double in the external value's unit as a number of its field."""
        return f"({field_type(external.port, self.c_type)}){text}"

    def to_units(self, external: External, text: str) -> str:
        """C expression of the field's number in the external value's unit."""
        return text

    def stored(self, external: External, value: Any) -> npt.NDArray[Any]:
        """Number in the field, for a value in units with an exact representation."""
        return np.asarray(value, np.uint32 if external.port.whole else self.dtype)
