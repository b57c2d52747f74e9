"""Double precision: for the host, equal to CasADi's own C bit for bit."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import casadi as ca
import numpy as np

from esea_gen.emit.formats.floating import FloatingFormat
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.system import System

_CALLS = frozenset({"sqrt", "exp", "log", "tanh", "pow"})


class F64(FloatingFormat):
    name = "f64"
    c_type = "double"
    dtype = np.dtype(np.float64)
    epsilon = 2.0**-53
    needs_libm = True
    libraries = " -lm"
    joins_words = False  # CasADi adds them up as numbers

    def passes(self, kernel: Kernel) -> Kernel:
        return kernel

    def _literal(self, value: float) -> str:
        text = repr(float(value))
        return text if "." in text or "e" in text else text + ".0"

    def _call(self, node: Node, args: Sequence[str], kernel: Kernel) -> str | None:
        return f"{node.op}({', '.join(args)})" if node.op in _CALLS else None

    def sources(self) -> tuple[Path, ...]:
        return ()

    def casadi_c(self, system: System) -> dict[str, str]:
        return casadi_c(system)


def casadi_c(system: System) -> dict[str, str]:
    stem = f"esea_{system.name}_casadi"
    generator = ca.CodeGenerator(
        f"{stem}.c", {"with_header": True, "prefix": f"{stem}_", "casadi_int": "int"}
    )
    for block in system.kinds:
        # A Program has no step in one piece; its kernels stand for it.
        whole = block.kind == "block"
        steps = {"step": block.step} if whole else cast(Any, block).kernels
        for verb, function in {"prepare": block.prepare, "init": block.init, **steps}.items():
            if verb == "prepare" and not block.tunables:
                continue
            generator.add(_renamed(function, f"{stem}_{block.name}_{verb}"))
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(folder + "/")
        return {
            f"reference/{stem}{ending}": (Path(folder) / f"{stem}{ending}").read_text(
                encoding="utf-8"
            )
            for ending in (".c", ".h")
        }


def _renamed(function: ca.Function, name: str) -> ca.Function:
    arguments = function.sx_in()
    return ca.Function(
        name, arguments, function.call(arguments), function.name_in(), function.name_out()
    )


FORMAT = F64()
