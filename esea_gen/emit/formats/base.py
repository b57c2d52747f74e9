"""What a number format says of itself: all that rendering, loading and running C ask it for."""

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
    """A number format.

    c_type, dtype: of a number, in C and in numpy.
    epsilon: largest rounding error, relative to the number; of whole numbers to the field's range.
    default: whether it is built where no format is named, and covered by a device's content hash.
    floating: whether it has NaN and infinity, and error bounds that ``emit.error_bounds`` derives.
    needs_libm: whether the emitted C links the platform's libm.
    verified_by: command that compares its C with the symbolic Blocks.
    compiler_flags, libraries: what a compiler's command line needs beside ``-std=c99 -O2``.
    header: support header with its conversions; empty where none are needed.
    operations: what ``esea_<device>_real.h`` holds: the operations that kernels call.
    notes: what a device's header says of compiling and of its numbers, one string a line.
    example_share: of an output's range, what the example program takes for rounding.
    """

    name: ClassVar[str]
    c_type: ClassVar[str]
    dtype: ClassVar[np.dtype[Any]]
    epsilon: ClassVar[float]
    default: ClassVar[bool]
    floating: ClassVar[bool]
    needs_libm: ClassVar[bool]
    verified_by: ClassVar[str]
    compiler_flags: ClassVar[str]
    libraries: ClassVar[str]
    header: ClassVar[str]
    operations: ClassVar[str]
    notes: ClassVar[tuple[str, ...]]
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
