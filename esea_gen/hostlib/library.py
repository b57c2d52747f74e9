"""Compile a rendered System for the host and call it.

cffi works in ABI mode: no Python headers are needed, and its declarations are read from the emitted
header by the C preprocessor, never typed again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.loaded import LoadedC
from esea_gen.hostlib.runner import CBoard, CRunner
from esea_gen.language.block import Block
from esea_gen.language.system import System


class HostLibrary(LoadedC):
    """A System's generated C, compiled for the host.

    Parameters
    ----------
    system : System
        What was rendered.
    renderer : Renderer
        Its renderer.
    flags : sequence of str
        Compiler flags beside the project's own (sanitizers, coverage).
    """

    def board(self, tunables: Mapping[str, Mapping[str, float]] | None = None) -> CBoard:
        """The System as firmware runs it, all tasks on one state.

        Parameters
        ----------
        tunables : mapping, optional
            ``{instance: {tunable: value}}`` other than the defaults.
        """
        return CBoard(self, tunables)

    def block(self, name: str) -> CRunner:
        """A compiled Block.

        Parameters
        ----------
        name : str
            The Block's name.
        """
        block: Block = next(b for b in self.system.kinds if b.name == name)
        groups = ("in", block.inputs), ("out", block.outputs), ("state", block.state)
        fields = ([self.block_field(block, g, p) for p in ports] for g, ports in groups)
        return CRunner(self, name, block, *fields)

    def task(self, name: str) -> CRunner:
        """A compiled task.

        Parameters
        ----------
        name : str
            The task's name.
        """
        system, task = self.system, self.system.task(name)
        groups = (system.task_inputs(task), system.task_outputs(task))
        inputs, outputs = ([self.external_field(x) for x in group] for group in groups)
        return CRunner(self, name, system, inputs, outputs, ())


def compile_system(system: System, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a System that need not belong to a device.

    Parameters
    ----------
    system : System
        Any System.
    real : str
        Number format.
    flags : sequence of str
        Compiler flags beside the project's own.
    """
    return HostLibrary(system, Renderer(system, FORMATS[real], "-", "-", system.name), flags)


def compile_device(device: Device, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a device's C, the bytes that ``esea-gen build`` writes.

    Parameters
    ----------
    device : Device
        The device.
    real : str
        Number format.
    flags : sequence of str
        Compiler flags beside the project's own.
    """
    digest = format_hash(device, real)
    renderer = Renderer(device.system, FORMATS[real], digest, "-", device.title)
    return HostLibrary(device.system, renderer, flags)
