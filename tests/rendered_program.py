"""A Program alone as C files, for tests and measurements of it."""

from __future__ import annotations

from typing import Any

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.library import block_system


class ProgramRenderer(Renderer):
    """Renders a System of one Program: its C files only, no example and no C of CasADi's."""

    def files(self) -> dict[str, str]:
        return self.own_files() | {path.name: path.read_text() for path in self.fmt.sources()}


def render_program(program: Any, real: str) -> ProgramRenderer:
    """Renderer of a System of one Program."""
    return ProgramRenderer(block_system(program), FORMATS[real], "-", "-", program.title)
