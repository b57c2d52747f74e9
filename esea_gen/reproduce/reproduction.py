"""Studies that recompute what was published, with the emitted C or on the published recordings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, Generic, Protocol, TypeVar

from matplotlib.figure import Figure

from esea_gen.errors import UserError
from esea_gen.studies.registry import Study


class Outcome(Protocol):
    """What any study comes to; its JSON is ``to_dict()``, or its fields."""

    def table(self) -> list[str]: ...

    def figure(self) -> Figure: ...


Made = TypeVar("Made", bound=Outcome)


class Reproduction(Study, Generic[Made]):
    """A published table or figure made again."""

    recordings: ClassVar[bool] = False

    def run(self, say: Callable[[str], None], folder: Path | None) -> Made:
        raise UserError(f"study {self.name}: has no method run.", "Write it: what is recomputed.")

    def reproduced(self, outcome: Made) -> bool:
        return True
