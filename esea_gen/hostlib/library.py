"""Compile a rendered System for the host and call it.

cffi works in ABI mode: no Python headers are needed, and its declarations are read from the emitted
header by the C preprocessor, never typed again.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.codec import block_field, external_field, struct_dtype
from esea_gen.hostlib.compiler import compile_sources, declared
from esea_gen.hostlib.runner import CBoard, CRunner
from esea_gen.language.block import Block
from esea_gen.language.system import System


class HostLibrary:
    """A System's generated C, compiled for the host.

    Parameters
    ----------
    system : System
    renderer : Renderer
    flags : sequence of str
        Compiler flags beside the project's own (sanitizers, coverage).
    """

    def __init__(self, system: System, renderer: Renderer, flags: Sequence[str] = ()) -> None:
        self.system = system
        self.real = renderer.fmt.name
        self.prefix = renderer.prefix
        self.naming = renderer.naming
        self.files = renderer.files()
        driver = renderer.render("hostlib/driver.c.j2")
        files = {n: t for n, t in self.files.items() if not n.startswith("reference/")}
        link = ("-lm",) if renderer.fmt.needs_libm else ()
        self.path = compile_sources(files | {"driver.c": driver}, flags, link)
        # The driver's loops are declared by their own text: bodies are cut at the first brace.
        prototypes = re.sub(r"\)\s*\n\{.*?\n\}", ");", driver, flags=re.DOTALL)
        self.ffi = declared(self.files[f"{self.prefix}.h"] + prototypes)
        self.lib: Any = self.ffi.dlopen(str(self.path))
        self._init = renderer.init_name

    def function(self, name: str) -> Any:
        """A function of the C by the name that its header gives it.

        Parameters
        ----------
        name : str
            With the prefix.
        """
        return getattr(self.lib, self._init if name == f"{self.prefix}_init" else name)

    def dtype(self, c_type: str) -> np.dtype[Any]:
        """numpy type of a C struct, field for field.

        Parameters
        ----------
        c_type : str
            Its name in the header.
        """
        return struct_dtype(self.ffi, c_type)

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
        """
        block: Block = next(b for b in self.system.kinds if b.name == name)
        groups = ("in", block.inputs), ("out", block.outputs), ("state", block.state)
        fields = ([block_field(self.naming, block, g, p) for p in ports] for g, ports in groups)
        return CRunner(self, name, block, *fields)

    def task(self, name: str) -> CRunner:
        """A compiled task.

        Parameters
        ----------
        name : str
        """
        system, task = self.system, self.system.task(name)
        groups = (system.task_inputs(task), system.task_outputs(task))
        inputs, outputs = ([external_field(self.naming, x) for x in group] for group in groups)
        return CRunner(self, name, system, inputs, outputs, ())


def compile_system(system: System, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a System that need not belong to a device.

    Parameters
    ----------
    system : System
    real : str
    flags : sequence of str
        Compiler flags beside the project's own.
    """
    return HostLibrary(system, Renderer(system, FORMATS[real], "-", "-", system.name), flags)


def compile_device(device: Device, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a device's C, the bytes that ``esea-gen build`` writes.

    Parameters
    ----------
    device : Device
    real : str
    flags : sequence of str
        Compiler flags beside the project's own.
    """
    digest = format_hash(device, real)
    renderer = Renderer(device.system, FORMATS[real], digest, "-", device.title)
    return HostLibrary(device.system, renderer, flags)
