"""Interface of a number format for rendering, loading and running C."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from esea_gen.emit.naming import Naming
from esea_gen.emit.printed import EmittedBlock
from esea_gen.emit.walker import Kernel
from esea_gen.language.block import Block
from esea_gen.language.system import System


class Format(ABC):
    name: ClassVar[str]
    c_type: ClassVar[str]  # of a number, in C and in numpy
    dtype: ClassVar[np.dtype[Any]]
    epsilon: ClassVar[float]  # largest rounding error, relative to the number
    # Built where no format is named, and covered by a device's content hash.
    default: ClassVar[bool]
    # Has NaN and infinity, and error bounds that emit.error_bounds derives.
    floating: ClassVar[bool]
    needs_libm: ClassVar[bool]  # whether the emitted C links the platform's libm
    verified_by: ClassVar[str]  # command that compares its C with the symbolic Blocks
    compiler_flags: ClassVar[str]  # what a compiler's command line needs beside ``-std=c99 -O2``
    libraries: ClassVar[str]
    header: ClassVar[str]  # support header with its conversions; empty where none are needed
    # Of an output's range: what the example program takes for rounding.
    example_share: ClassVar[float]

    @abstractmethod
    def passes(self, kernel: Kernel) -> Kernel:
        """Rewrite a kernel for this format."""

    @abstractmethod
    def literal(self, value: float) -> str:
        """Shortest C literal of a number as this format stores it."""

    @abstractmethod
    def emit(self, block: Block) -> EmittedBlock:
        """Print a straight-line Block's kernels."""

    @abstractmethod
    def naming(self, system: System) -> Naming:
        """Names and conversions of a System's fields."""

    @abstractmethod
    def sources(self) -> tuple[Path, ...]:
        """Headers and sources that travel with the emitted C."""

    def casadi_c(self, system: System) -> dict[str, str]:
        """C by another generator that ships beside ours, to compare with; by relative path."""
        return {}

    def templates(self, prefix: str) -> dict[str, str]:
        """Templates of this format's own files, by file name."""
        return {}

    def link_header(self, prefix: str) -> str:
        """Header that binds the device's C to its messages."""
        return f"{prefix}_link.h"
