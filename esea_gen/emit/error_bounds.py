"""Error bounds of a Block in a floating-point format: where a stated float32 bound comes from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from esea_gen.emit.elementary import ACCURACY_ULP, EXPONENT_FRACTION_BITS, exponent_q27
from esea_gen.emit.spans import Known, RangeError, Rounding, Span, propagate, span
from esea_gen.emit.step_errors import (
    BEYOND,
    Bound,
    ComputedStep,
    Ranges,
    StepErrors,
    bound_of,
    step_bound_of,
)
from esea_gen.emit.walker import Kernel, fuse_selects, labelled_kernel, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Array

if TYPE_CHECKING:  # the q31 format is planned with these errors
    from esea_gen.emit.formats.base import Format

# Largest error of the platform's float64 libm, in units in the last place (glibc documents 1).
LIBM_ULP = 1.0


class FloatRounding(Rounding):
    """The standard model of floating-point arithmetic, with a term for underflow.

    Sums, products and choices of whole numbers below the format's largest (2^24 in f32) are exact.
    """

    keeps_whole = True
    _EXACT = frozenset({"neg", "fabs", "twice", "fmin", "fmax", "select", "if_else_zero"})
    _KEEPS_WHOLE = _EXACT | {"add", "sub", "mul", "sq"}

    def __init__(self, kernel: Kernel, fmt: Format) -> None:
        super().__init__(kernel)
        self.fmt, self.u = fmt, fmt.epsilon
        self.tiny = float(np.finfo(fmt.dtype).smallest_subnormal)
        self.most = 1 / self.u  # all whole numbers up to here are numbers of the format

    def constant(self, value: float, boxes: int) -> Span:
        """As the format stores it."""
        stored = float(self.fmt.dtype.type(value))
        x = span(value, value, abs(stored - value), boxes)
        x.whole = value == math.floor(value) and abs(value) <= self.most
        x.reach = stored, stored
        return x

    def exponent_error(self, exponent: float) -> float:
        """Error of the integer that represents it in f32."""
        if self.fmt.needs_libm:
            return 0.0
        return abs(exponent_q27(exponent) * 2.0**-EXPONENT_FRACTION_BITS - exponent)

    def finished(self, i: int, operands: Sequence[Span], x: Span) -> Span:
        """Rounded, unless the operation is exact."""
        op = self.kernel.nodes[i].op
        if op in ("sqrt", "pow") and np.any(operands[0].low < 0):
            raise RangeError(f"{self.kernel.name}: {op} of a range that reaches below zero")
        numbers = operands
        if op in ("select", "if_else_zero"):
            taken = operands[0]
            numbers = [
                *(operands[1:2] if np.any(taken.high != 0) else ()),
                *(operands[2:] if np.any(taken.low != 1) else ()),
            ]
        whole = op in self._KEEPS_WHOLE and all(v.whole for v in numbers)
        if whole and np.all(x.magnitude <= self.most):
            return Span(x.low, x.high, 0 * x.a, 0 * x.r, whole=True)
        if op == "sign":
            return Span(x.low, x.high, x.a, x.r, whole=not np.any(x.a))
        if op in self._EXACT:
            return Span(x.low, x.high, x.a, x.r, self._reach(op, operands))
        function = op in ("exp", "log", "sqrt", "tanh", "pow")
        # One unit in the last place is at most 2 u relative.
        ulp = (
            LIBM_ULP if self.fmt.needs_libm else ACCURACY_ULP.get("powk" if op == "pow" else op, 0)
        )
        u = 2 * ulp * self.u if function else self.u
        # Rounding keeps the sign of a sum of exact numbers and, as there are subnormal ones, makes
        # it zero only where it is.
        signed = op in ("add", "sub") and all(v.exact for v in numbers)
        a, r = x.a * (1 + u) + self.tiny, x.r * (1 + u) + u
        return Span(x.low, x.high, a, r, signed=signed)

    def _reach(self, op: str, v: Sequence[Span]) -> tuple[Array, Array] | None:
        # Of a choice the computed value is one of the operands', cut or not.
        if op == "neg":
            return -v[0].seen[1], -v[0].seen[0]
        if op in ("fabs", "twice"):
            return None
        if op in ("fmin", "fmax"):
            f = np.minimum if op == "fmin" else np.maximum
            return f(v[0].seen[0], v[1].seen[0]), f(v[0].seen[1], v[1].seen[1])
        none = np.zeros_like(v[1].low)
        (xl, xh), (yl, yh) = v[1].seen, v[2].seen if op == "select" else (none, none)
        first, second = v[0].low == 1, v[0].high == 0
        low = np.where(first, xl, np.where(second, yl, np.minimum(xl, yl)))
        return low, np.where(first, xh, np.where(second, yh, np.maximum(xh, yh)))

    def settled(self, i: int, operands: Sequence[Span]) -> bool:
        """Of exact numbers; or the sign of a number that has the exact one's."""
        nodes = [self.kernel.nodes[k] for k in self.kernel.nodes[i].args]
        pairs = zip(operands, nodes[::-1], strict=True)
        zero = any(x.signed and n.op == "const" and n.value == 0 for x, n in pairs)
        return zero or super().settled(i, operands)


def _float_coefficients(block: Block, fmt: Format) -> list[list[tuple[float, float]]]:
    """Coefficients at the default tunables, and their errors as the C prepares them."""
    if not block.tunables:
        return []
    values = [t.default for t in block.tunables]
    prepared = [
        np.asarray(c, dtype=float).ravel() for c in block.prepare.call([ca.DM(v) for v in values])
    ]
    kernel = fuse_selects(walk(block.prepare))
    spans, _ = propagate(FloatRounding(kernel, fmt), [[span(v, v, 0.0, 1)] for v in values])
    return [
        [(float(x), float(spans[i].error[0])) for x, i in zip(c, r, strict=True)]
        for c, r in zip(prepared, kernel.results, strict=True)
    ]


def _float_step(
    block: Block, fmt: Format, ranges: Ranges | None = None, room: float = 0.0
) -> StepErrors:
    kernel, labels = labelled_kernel(block, fuse_selects)
    computed = ComputedStep(
        block,
        FloatRounding(kernel, fmt),
        {node: name for node, name, _ in labels},
        {node: block.facts[name] for node, name, _ in labels if name in block.facts},
        lambda: _float_coefficients(block, fmt),
        [[0.0] * len(r) for r in kernel.results],
    )
    return StepErrors(computed, ranges, room)


def block_bound(block: Block, fmt: Format, ranges: Ranges | None = None) -> Bound:
    """:func:`bound_of` in a floating-point format.

    ranges: ``{"u_theta_rad": (low, high), "s_tau_r_Nm": ...}``: inputs and states that stay inside
        these ranges instead of their ports'.
    """
    return bound_of(_float_step(block, fmt, ranges), fmt.name)


def step_bound(block: Block, fmt: Format, ranges: Ranges | None = None) -> Bound:
    """:func:`step_bound_of` in a floating-point format."""
    return step_bound_of(_float_step(block, fmt, ranges, BEYOND), fmt.name)


def node_errors(block: Block, fmt: Format) -> tuple[Kernel, list[float]]:
    """Largest |error| of every value of a step, from the same memory, its decisions the same."""
    step = _float_step(block, fmt, None, BEYOND)
    return step.kernel, step.node_errors(step.zero)


def whole_nodes(block: Block, kernel: Kernel, fmt: Format) -> frozenset[int]:
    """Values of a step that are integers if all counts are integers.

    return: nodes of ``kernel``; empty when the analysis finds no finite range for one.
    """
    everything = Kernel(kernel.name, kernel.nodes, (tuple(range(len(kernel.nodes))),))
    try:
        once = _float_step(block, fmt, None, BEYOND)
        rounding = FloatRounding(fuse_selects(everything), fmt)
        once.computed = replace(once.computed, rounding=rounding)
        once.facts, once.known = {}, Known()
        values, _ = once.values(once.zero)
    except RangeError:
        return frozenset()
    return frozenset(i for i, v in enumerate(values) if v.whole)
