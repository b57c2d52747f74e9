"""Single precision for boards with an FPU: the same bits on all of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from esea_gen.emit.elementary import exponent_q27, source_paths
from esea_gen.emit.formats.floating import FloatingFormat
from esea_gen.emit.walker import Kernel, Node, UnsupportedOperationError, calls_first, fuse_selects

# From the project's own float-only file, the same on all targets.
_CALLS = {
    "sqrt": "esea_f32_sqrt",
    "exp": "esea_f32_exp",
    "log": "esea_f32_log",
    "tanh": "esea_f32_tanh",
}


class F32(FloatingFormat):
    name = "f32"
    c_type = "float"
    dtype = np.dtype(np.float32)
    epsilon = 2.0**-24
    needs_libm = False
    libraries = ""
    joins_words = True

    def passes(self, kernel: Kernel) -> Kernel:
        return calls_first(fuse_selects(kernel))

    def _literal(self, value: float) -> str:
        with np.errstate(over="ignore"):
            single = np.float32(value)
        if not np.isfinite(single) or (single == 0 and value != 0):
            raise UnsupportedOperationError(f"constant {value!r} is outside float32's range")
        text = np.format_float_scientific(single, unique=True, trim="0")
        if 1e-4 <= abs(float(single)) < 1e7 or single == 0:
            text = np.format_float_positional(single, unique=True, trim="0")
        return text + "f"

    def _call(self, node: Node, args: Sequence[str], kernel: Kernel) -> str | None:
        if node.op in _CALLS:
            return f"{_CALLS[node.op]}({args[0]})"
        return self._power(node, args, kernel) if node.op == "pow" else None

    def _power(self, node: Node, args: Sequence[str], kernel: Kernel) -> str:
        exponent = kernel.nodes[node.args[1]]
        if exponent.op != "const":
            return f"esea_f32_pow({args[0]}, {args[1]})"
        # A constant exponent goes in as a fixed-point number: rounded to float it would cost ULPs.
        try:
            q27 = exponent_q27(exponent.value)
        except ValueError as error:
            raise UnsupportedOperationError(f"{kernel.name}: {error}") from None
        return f"esea_f32_powk({args[0]}, INT32_C({q27}) /* {exponent.value!r} */)"

    def sources(self) -> tuple[Path, ...]:
        return source_paths()


FORMAT = F32()
