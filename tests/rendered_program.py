"""A Program alone as C files, for tests and measurements of it."""

from __future__ import annotations

from typing import Any

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.language.program import Program
from esea_gen.language.system import System, Task


class ProgramRenderer(Renderer):
    """Renders a System of one Program: its C files only, no example and no C of CasADi's."""

    def files(self) -> dict[str, str]:
        return self.own_files() | {path.name: path.read_text() for path in self.fmt.sources()}


def program_system(program: Program, device: str = "program") -> System:
    """A System of one Program: every input and output external."""
    name = program.name
    blocks: Any = {name: program}
    return System(
        device,
        program.period_s,
        blocks,
        (Task("control", (name,)),),
        {},
        {p.name: (f"{name}.{p.name}",) for p in program.inputs},
        {p.name: f"{name}.{p.name}" for p in program.outputs},
    )


def render_program(program: Program, real: str, device: str = "program") -> ProgramRenderer:
    """Renderer of a System of one Program."""
    return ProgramRenderer(program_system(program, device), FORMATS[real], "-", "-", program.title)
