"""Compile a rendered System for the host and call it.

cffi works in ABI mode: no Python headers are needed, and its declarations are read from the emitted
header by the C preprocessor, never typed again.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import cffi
import numpy as np

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.codec import Codec
from esea_gen.hostlib.compiler import compile_sources, declarations
from esea_gen.hostlib.runner import CBoard, CRunner
from esea_gen.language.block import Block
from esea_gen.language.system import System


class HostLibrary:
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

    def __init__(self, system: System, renderer: Renderer, flags: Sequence[str] = ()) -> None:
        self.system = system
        self.real = renderer.fmt.name
        self.prefix = renderer.prefix
        self.codec = Codec(renderer.naming)
        self.files = renderer.files()
        driver = renderer.render("hostlib/driver.c.j2")
        files = {n: t for n, t in self.files.items() if not n.startswith("reference/")}
        link = ("-lm",) if renderer.fmt.needs_libm else ()
        self.path = compile_sources(files | {"driver.c": driver}, flags, link)
        self.ffi = cffi.FFI()
        # The driver's loops are declared by their own text: bodies are cut at the first brace.
        prototypes = re.sub(r"\)\s*\n\{.*?\n\}", ");", driver, flags=re.DOTALL)
        self.ffi.cdef(declarations(self.files[f"{self.prefix}.h"] + prototypes), override=True)
        self.lib: Any = self.ffi.dlopen(str(self.path))
        self._dtypes: dict[str, np.dtype[Any]] = {}

    def dtype(self, c_type: str) -> np.dtype[Any]:
        """numpy type of a C struct, field for field.

        Parameters
        ----------
        c_type : str
            Name of the struct's type.

        Returns
        -------
        numpy.dtype
            With the C's offsets and size.
        """
        if c_type not in self._dtypes:
            self._dtypes[c_type] = self._convert(self.ffi.typeof(c_type))
        return self._dtypes[c_type]

    def _convert(self, ctype: Any) -> np.dtype[Any]:
        primitive = {"double": "f8", "float": "f4", "uint32_t": "u4", "int32_t": "i4"}
        if ctype.kind == "primitive":
            return np.dtype(primitive[ctype.cname])
        if ctype.kind == "array":
            return np.dtype((self._convert(ctype.item), (ctype.length,)))
        fields = ctype.fields
        return np.dtype(
            {
                "names": [n for n, _ in fields],
                "formats": [self._convert(f.type) for _, f in fields],
                "offsets": [f.offset for _, f in fields],
                "itemsize": self.ffi.sizeof(ctype),
            }
        )

    def board(self, tunables: Mapping[str, Mapping[str, float]] | None = None) -> CBoard:
        """The System as firmware runs it, all tasks on one state.

        Parameters
        ----------
        tunables : mapping, optional
            ``{instance: {tunable: value}}`` other than the defaults.

        Returns
        -------
        CBoard
            Freshly initialised.
        """
        return CBoard(self, tunables)

    def block(self, name: str) -> CRunner:
        """A compiled Block.

        Parameters
        ----------
        name : str
            The Block's name.

        Returns
        -------
        CRunner
            Freshly initialised.
        """
        block: Block = next(b for b in self.system.kinds if b.name == name)
        groups = ("in", block.inputs), ("out", block.outputs), ("state", block.state)
        fields = ([self.codec.field(block, g, p) for p in ports] for g, ports in groups)
        return CRunner(self, name, block, *fields)

    def task(self, name: str) -> CRunner:
        """A compiled task.

        Parameters
        ----------
        name : str
            The task's name.

        Returns
        -------
        CRunner
            Freshly initialised, with a state of its own.
        """
        system, task = self.system, self.system.task(name)
        groups = (system.task_inputs(task), system.task_outputs(task))
        inputs, outputs = ([self.codec.external(x) for x in group] for group in groups)
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

    Returns
    -------
    HostLibrary
        Loaded.
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

    Returns
    -------
    HostLibrary
        Loaded.
    """
    digest = format_hash(device, real)
    renderer = Renderer(device.system, FORMATS[real], digest, "-", device.title)
    return HostLibrary(device.system, renderer, flags)
