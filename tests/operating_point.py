"""Effect of rounding on a Program's result at one operating point, to first order.

With decisions known the body is a line of operations z_i: |dy| <= sum_i |dy/dz_i| u |z_i| (Higham,
Accuracy and Stability of Numerical Algorithms, 2002, ch. 3.3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.emit.elementary import ACCURACY_ULP
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel, Node, UnsupportedOperationError, walk
from esea_gen.language.builder import array_name
from esea_gen.language.program import Program, ProgramSimulator
from esea_gen.language.statements import Call, Ref

F32 = FORMATS["f32"]
U = 2.0**-24
# Of larger and smaller of two numbers that are compared; nearer ones may turn in float32.
NEAR = 1e-4


@dataclass(frozen=True)
class PointBound:
    """Errors at one operating point, to first order."""

    exact: dict[str, Any]
    errors: dict[str, float]
    operations: int
    near: int


class PointAnalysis(ProgramSimulator):
    """A Program's executor that keeps every operation of a step."""

    def __init__(self, program: Program, tunables: Mapping[str, float] | None = None) -> None:
        self._kernels: dict[int, Kernel] = {}
        self._line = _Line()
        self._at: dict[str, list[int]] = {}  # by array: operations that its elements come from
        super().__init__(program, tunables)
        self._values = program.taken_tunables(tunables)

    def bound(self, **inputs: Any) -> PointBound:
        """One step and its error, from the state as it is set."""
        out = self.step(**inputs)
        errors = {}
        for p in self.program.outputs:
            if not p.flags:
                ends = self._at[array_name("out", p.name)]
                errors[p.name] = max(self._line.error(k) for k in ends)
        return PointBound(out, errors, len(self._line.values), self._line.near)

    def _advance(self) -> None:
        line = self._line = _Line()
        prepared: dict[str, list[int]] = {}
        if self._values:
            given = [[line.given(v, float(np.float32(v)))] for v in self._values.values()]
            made = line.run(F32.passes(walk(self.program.prepare)), given)
            names = [array_name("coeffs", p.name) for p in self.program.coefficients]
            prepared = dict(zip(names, made, strict=True))
        for name, memory in self.program.memory.items():
            if memory.region == "index":
                continue
            values = self.arrays[name]
            stored = memory.values["f32"] if memory.region == "table" else values
            self._at[name] = prepared.get(name) or [
                line.given(float(v), float(np.float32(s)))
                for v, s in zip(values, stored, strict=True)
            ]
        super()._advance()

    def _call(self, s: Call) -> Callable[[dict[str, int]], None]:
        run = super()._call(s)
        key = id(s.kernel)
        if key not in self._kernels:
            self._kernels[key] = F32.passes(walk(s.kernel))
        kernel = self._kernels[key]

        def places(ref: Ref, env: dict[str, int]) -> range:
            k = ref.start.value(env, self.tables)
            return range(k, k + ref.stride * ref.length, ref.stride)

        def call(env: dict[str, int]) -> None:
            given = [[self._at[f.array][i] for i in places(f, env)] for f in s.args]
            where = [places(f, env) for f in s.results]
            made = self._line.run(kernel, given)
            run(env)
            for f, places_of, ends in zip(s.results, where, made, strict=True):
                for i, k in zip(places_of, ends, strict=True):
                    self._at[f.array][i] = k

        return call


class _Line:
    """The operations of a step in order, each with its value, its slopes and its own rounding."""

    def __init__(self) -> None:
        self.values: list[float] = []
        self.slopes: list[tuple[tuple[int, float], ...]] = []
        self.rounding: list[float] = []
        self.near = 0

    def add(
        self, value: float, slopes: tuple[tuple[int, float], ...] = (), rounding: float = 0.0
    ) -> int:
        self.values.append(value)
        self.slopes.append(slopes)
        self.rounding.append(rounding)
        return len(self.values) - 1

    def given(self, value: float, stored: float) -> int:
        """A number from outside, which float32 may hold only nearly."""
        return self.add(value, (), abs(stored - value))

    def run(self, kernel: Kernel, given: list[list[int]]) -> list[list[int]]:
        """The operations of a kernel; its results' places."""
        place: list[int] = []
        for node in kernel.nodes:
            if node.op == "input":
                place.append(given[node.source[0]][node.source[1]])
            elif node.op == "const":
                place.append(self.given(node.value, float(np.float32(node.value))))
            else:
                place.append(self._operation(node, [place[a] for a in node.args]))
        return [[place[i] for i in r] for r in kernel.results]

    def error(self, end: int) -> float:
        """Largest error of a value, to first order."""
        weight = np.zeros(end + 1)
        weight[end] = 1.0
        total = 0.0
        for i in range(end, -1, -1):
            w = weight[i]
            if w == 0.0:
                continue
            total += abs(w) * self.rounding[i]
            for k, slope in self.slopes[i]:
                weight[k] += w * slope
        return total

    def _operation(self, node: Node, at: list[int]) -> int:
        op, v = node.op, [self.values[k] for k in at]
        if op in _ROUNDED:
            value, slopes = _ROUNDED[op](*v)
            own = 0.0 if self._without_rounding(op, value, at) else U * abs(value)
            return self.add(value, tuple(zip(at, slopes, strict=True)), own)
        if op in _FUNCTIONS:
            value, slope = _FUNCTIONS[op](*v)
            own = 2 * ACCURACY_ULP["powk" if op == "pow" else op] * U * abs(value)
            return self.add(value, ((at[0], slope),), own)
        if op in _CHOSEN:
            value, which, sign = _CHOSEN[op](v)
            return self.add(value, ((at[which], sign),) if which >= 0 else ())
        if op in _DECIDED:
            if op in ("lt", "le", "eq", "ne"):
                self._look(at, v)
            return self.add(float(_DECIDED[op](*v)))
        raise UnsupportedOperationError(f"no rule for the rounding of '{op}'", "Add one.")

    def _without_rounding(self, op: str, value: float, at: list[int]) -> bool:
        stored = [self.values[k] for k in at if self._stored(k)]
        if op == "mul" and any(math.frexp(abs(x))[0] == 0.5 for x in stored):
            return True  # by a power of two
        return len(stored) == len(at) and float(np.float32(value)) == value

    def _stored(self, k: int) -> bool:
        # A number that float32 holds as it is.
        return self.rounding[k] == 0.0 and not self.slopes[k]

    def _look(self, at: list[int], v: list[float]) -> None:
        exact = all(self._stored(k) for k in at)
        if not exact and abs(v[0] - v[1]) <= NEAR * max(abs(v[0]), abs(v[1])):
            self.near += 1


def _quotient(x: float, y: float) -> tuple[float, tuple[float, float]]:
    return x / y, (1 / y, -x / (y * y))


def _root(x: float) -> tuple[float, float]:
    y = math.sqrt(x)
    return y, 0.5 / y if y else 0.0


def _hyperbolic(x: float) -> tuple[float, float]:
    y = math.tanh(x)
    return y, 1 - y * y


# Value and slopes of operations that round; of functions in the first argument only.
_ROUNDED: dict[str, Callable[..., tuple[float, tuple[float, ...]]]] = {
    "add": lambda x, y: (x + y, (1.0, 1.0)),
    "sub": lambda x, y: (x - y, (1.0, -1.0)),
    "mul": lambda x, y: (x * y, (y, x)),
    "sq": lambda x: (x * x, (2 * x,)),
    "div": _quotient,
    "inv": lambda x: (1 / x, (-1 / (x * x),)),
}
_FUNCTIONS: dict[str, Callable[..., tuple[float, float]]] = {
    "exp": lambda x: (math.exp(x), math.exp(x)),
    "log": lambda x: (math.log(x), 1 / x),
    "sqrt": _root,
    "tanh": _hyperbolic,
    "pow": lambda x, c: (x**c, c * x ** (c - 1) if x > 0 else 0.0),
}
# Value, which operand it is (or -1) and with which sign.
_CHOSEN: dict[str, Callable[[list[float]], tuple[float, int, float]]] = {
    "neg": lambda v: (-v[0], 0, -1.0),
    "twice": lambda v: (2 * v[0], 0, 2.0),
    "fabs": lambda v: (abs(v[0]), 0, math.copysign(1.0, v[0])),
    "fmin": lambda v: (v[0], 0, 1.0) if v[0] <= v[1] else (v[1], 1, 1.0),
    "fmax": lambda v: (v[0], 0, 1.0) if v[0] >= v[1] else (v[1], 1, 1.0),
    "select": lambda v: (v[1], 1, 1.0) if v[0] else (v[2], 2, 1.0),
    "if_else_zero": lambda v: (v[1], 1, 1.0) if v[0] else (0.0, -1, 0.0),
}
_DECIDED: dict[str, Callable[..., bool | float]] = {
    "sign": lambda x: float((x > 0) - (x < 0)),
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: x == y,
    "ne": lambda x, y: x != y,
    "not": lambda x: not x,
    "and": lambda x, y: bool(x) and bool(y),
    "or": lambda x, y: bool(x) or bool(y),
}
