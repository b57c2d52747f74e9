"""Fixed point for boards without an FPU: kernels printed from a range plan (``emit.fixed``)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from esea_gen.emit.fixed.expression import C_TYPES, Expr, bare_text, c_text
from esea_gen.emit.fixed.functions import source_files
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.lowering import rewrite
from esea_gen.emit.fixed.naming import FixedNaming
from esea_gen.emit.fixed.values import LoweredKernel
from esea_gen.emit.formats.base import Format
from esea_gen.emit.printed import EmittedBlock, PrintedKernel, Statement
from esea_gen.emit.walker import Kernel, fuse_selects
from esea_gen.language.block import Block
from esea_gen.language.system import System


def _pointers(e: Expr) -> set[str]:
    if e.op == "read":
        return {e.name.removeprefix("(int32_t)").split("->")[0]}
    return {p for a in e.args for p in _pointers(a)}


def print_lowered(lowered: LoweredKernel) -> PrintedKernel:
    statements = tuple(
        Statement(C_TYPES[s.expr.bits], s.name, bare_text(s.expr), s.comment) for s in lowered.steps
    )
    used = {p for s in lowered.steps for p in _pointers(s.expr)}
    return PrintedKernel(
        statements,
        tuple(tuple(c_text(e) for e in r) for r in lowered.results),
        frozenset(range(len(used))),
    )


class Q31(Format):
    name = "q31"
    c_type = "int32_t"
    dtype = np.dtype(np.int32)
    epsilon = 2.0**-31
    default = False
    floating = False
    needs_libm = False
    verified_by = "esea-gen fixed"
    compiler_flags = ""
    libraries = ""
    header = "esea_q31.h"
    example_share = 5e-5

    def passes(self, kernel: Kernel) -> Kernel:
        return rewrite(fuse_selects(kernel))

    def literal(self, value: float) -> str:
        return str(int(value))

    def emit(self, block: Block) -> EmittedBlock:
        plan = plan_block(block)
        return EmittedBlock(
            block,
            print_lowered(plan.prepare) if plan.prepare else None,
            print_lowered(plan.init),
            print_lowered(plan.step),
        )

    def naming(self, system: System) -> FixedNaming:
        return FixedNaming(system)

    def sources(self) -> tuple[Path, ...]:
        return source_files()

    def templates(self, prefix: str) -> dict[str, str]:
        return {
            f"{prefix}_units.h": "device/esea_units.h.j2",
            self.link_header(prefix): "device/esea_units_link.h.j2",
        }

    def link_header(self, prefix: str) -> str:
        return f"{prefix}_units_link.h"


FORMAT = Q31()
