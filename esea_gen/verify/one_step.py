"""One step of the C against the symbolic step from the same state and decisions.

An integral accumulates every rounding error, so only the error that one step adds can be bounded.
Where rounding changes a decision, its operands must be nearer than their derived errors allow. A
quotient of two small numbers leaves not even that: such a Block's steps are the executor's.
"""

from __future__ import annotations

from typing import ClassVar

import casadi as ca
import numpy as np

from esea_gen.emit.error_bounds import node_errors, step_bound
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import Stream
from esea_gen.verify.executor import coefficients_of, emitted_kernel, evaluate, step_arguments
from esea_gen.verify.verdict import EXACT_STEP, ONE_STEP, Comparison

DECIDING = frozenset({"lt", "le", "eq", "ne"})


def _results(
    block: Block, outputs: dict[str, Array], states: dict[str, Array]
) -> list[tuple[Port, Array]]:
    # In the order of the kernel's.
    both = (block.state, states), (block.outputs, outputs)
    return [(p, values[p.name]) for ports, values in both for p in ports]


class ExactStep:
    """Each step against the executor in float32, bit for bit: for a Block without any bound."""

    kind = EXACT_STEP
    limits: ClassVar[dict[str, float]] = {}

    def __init__(self, block: Block) -> None:
        self.block = block

    def compare(
        self, stream: Stream, outputs: dict[str, Array], states: dict[str, Array]
    ) -> Comparison:
        """Hold every step of a run of the C against the executor's from the same memory."""
        found = Comparison(
            self.block.name, stream.name, "f32", stream.steps, {}, {}, rule=self.kind
        )
        single = FORMATS["f32"]
        kernel, _ = emitted_kernel(self.block, single)
        values = evaluate(kernel, single, step_arguments(self.block, stream, states, single))
        results = _results(self.block, outputs, states)
        for (p, value), nodes in zip(results, kernel.results, strict=True):
            own = np.stack([values[i].astype(np.float64) for i in nodes], axis=1)
            c = np.asarray(value, np.float64).reshape(stream.steps, p.size)
            if np.any(c != own):  # NaN differs too
                found.problems.append(f"{p.name}: differs from the executor's step")
        return found


class StepRule:
    """The bound of one step of a Block, and the comparison with it."""

    kind = ONE_STEP

    def __init__(self, block: Block) -> None:
        self.block = block
        single, double = FORMATS["f32"], FORMATS["f64"]
        self.bound = step_bound(block, single).with_errors_of(step_bound(block, double))
        self.limits = self.bound.states | self.bound.outputs
        self.kernel, self.errors = node_errors(block, single)
        _, errors = node_errors(block, double)
        self.errors = [a + b for a, b in zip(self.errors, errors, strict=True)]
        self.decisions = [i for i, n in enumerate(self.kernel.nodes) if n.op in DECIDING]
        # The same kernel with its decisions given, as one more argument.
        self.arguments = len(block.coefficients) + len(block.state) + len(block.inputs)
        place = {i: k for k, i in enumerate(self.decisions)}
        self.told = Kernel(
            self.kernel.name,
            tuple(
                Node("input", source=(self.arguments, place[i])) if i in place else n
                for i, n in enumerate(self.kernel.nodes)
            ),
            self.kernel.results,
        )
        self._coefficients = coefficients_of(block, double, {})

    def compare(
        self, stream: Stream, outputs: dict[str, Array], states: dict[str, Array]
    ) -> Comparison:
        """Hold every step of a run of the C against the symbolic step from the same memory."""
        names = self.block.name, stream.name, "f32"
        found = Comparison(*names, stream.steps, {}, self.limits, rule=self.kind)
        single = FORMATS["f32"]
        given = step_arguments(self.block, stream, states, single)
        values = evaluate(self.kernel, single, given)
        chosen = np.stack([values[i] for i in self.decisions], axis=1).astype(float)
        # From here on float64, on the same numbers; but its own coefficients.
        double = [np.tile(c, (stream.steps, 1)) for c in self._coefficients] + [
            a.astype(np.float64) for a in given[len(self.block.coefficients) :]
        ]
        told = evaluate(self.told, FORMATS["f64"], [*double, chosen])
        turned = self._turned(told, chosen, found)
        found.turned = int(turned.sum())
        # CasADi's own evaluation of the step, for all steps at once.
        mapped = self.block.step.map(stream.steps).call([ca.DM(a.T) for a in double])
        expected = [np.asarray(r, dtype=float).T for r in mapped]
        results = _results(self.block, outputs, states)
        limits = [self.bound.states, self.bound.outputs]
        for k, ((p, value), nodes) in enumerate(zip(results, self.kernel.results, strict=True)):
            # CasADi's own value where all decisions are its own; else the told one.
            own = np.where(turned[:, None], np.stack([told[i] for i in nodes], axis=1), expected[k])
            c = np.asarray(value, np.float64).reshape(stream.steps, p.size)
            if p.flags:
                wrong = int(np.count_nonzero(c != own))
                if wrong:
                    found.problems.append(f"{p.name}: {wrong} steps differ")
                continue
            error = float(np.max(np.abs(c - own), initial=0.0))
            limit = limits[k >= len(self.block.state)][p.name]
            found.errors[p.name] = max(error, found.errors.get(p.name, 0.0))
            if not error <= limit:  # NaN is above every limit
                found.problems.append(f"{p.name}: one step adds {error:.3g}, above {limit:.3g}")
        return found

    def _turned(self, told: list[Array], chosen: Array, found: Comparison) -> Array:
        compare = {"lt": np.less, "le": np.less_equal, "eq": np.equal, "ne": np.not_equal}
        any_turned = np.zeros(len(chosen), dtype=bool)
        for k, i in enumerate(self.decisions):
            a, b = self.kernel.nodes[i].args
            x, y = told[a].astype(float), told[b].astype(float)
            differs = compare[self.kernel.nodes[i].op](x, y) != (chosen[:, k] != 0)
            if not np.any(differs):
                continue
            any_turned |= differs
            reach = self.errors[a] + self.errors[b]
            apart = float(np.max(np.abs(x - y)[differs]))
            if not apart <= reach:
                found.problems.append(
                    f"v{i} ({self.kernel.nodes[i].op}) differs although its operands are "
                    f"{apart:.3g} apart, above their derived error {reach:.3g}"
                )
        return any_turned


StepJudge = StepRule | ExactStep


def drift(block: Block, expected: dict[str, Array], got: dict[str, Array]) -> dict[str, float]:
    """Difference of two freely running states or outputs; reported, not bounded."""
    out: dict[str, float] = {}
    for p in (*block.state, *block.outputs):
        if p.name not in expected:
            continue
        a, b = (np.asarray(x[p.name], dtype=np.float64) for x in (expected, got))
        out[p.name] = float(np.mean(a != b) if p.flags else np.max(np.abs(a - b), initial=0.0))
    return out
