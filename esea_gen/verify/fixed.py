"""The q31 C against its executor, bit for bit, and against the symbolic Block."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.device import Device
from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.errors import Propagation, any_bound, step_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import (
    BlockPlan,
    coefficients_raw,
    defined,
    lowered_values,
    raw_places,
    run_lowered,
)
from esea_gen.emit.fixed.values import FieldPlan
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.spans import COMPARES, RangeError
from esea_gen.emit.step_errors import BEYOND, Bound
from esea_gen.emit.walker import Kernel
from esea_gen.errors import UserError
from esea_gen.hostlib.codec import INVALID, from_raw, to_raw, to_whole
from esea_gen.hostlib.library import CRunner
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import Stream
from esea_gen.verify.bounds import broken, full_scales, steps_beyond
from esea_gen.verify.compare import unexplained
from esea_gen.verify.executor import KernelTrajectory, evaluate, expected_counters
from esea_gen.verify.runs import changed_by_restore, run_c, run_symbolic
from esea_gen.verify.verdict import LASTING, ONE_STEP, Comparison

Raw = np.ndarray[Any, np.dtype[Any]]


def _columns(fields: Sequence[FieldPlan], results: list[list[ex.Array]]) -> dict[str, Raw]:
    out = {}
    for f, r in zip(fields, results, strict=True):
        word = f.word
        table = np.stack([np.asarray(e, dtype=np.int64) for e in r], axis=1)
        column = table.astype(np.uint32 if word else np.int32)
        out[f.port.name] = column[:, 0] if f.port.size == 1 else column
    return out


class RawExecutor:
    """Runs a planned Block in Python integers, with the bits of its C."""

    def __init__(self, plan: BlockPlan, tunables: Mapping[str, float] | None = None) -> None:
        self.plan = plan
        self.coefficients = coefficients_raw(plan, tunables)

    def _fixed(self, count: int) -> dict[str, ex.Array]:
        tiled = [[c] * count for c in self.coefficients]
        return raw_places("coeffs", self.plan.fields["coeffs"], tiled)

    def places(
        self, states: Mapping[str, Raw], inputs: Mapping[str, Raw]
    ) -> tuple[dict[str, ex.Array], int]:
        """Raw numbers of many steps, under the names by which the C reads them."""
        count = len(next(iter((states or inputs).values())))
        fields = self.plan.fields
        places = self._fixed(count)
        places |= raw_places(
            "state", fields["state"], [states[f.port.name] for f in fields["state"]]
        )
        places |= raw_places("in", fields["in"], [inputs[f.port.name] for f in fields["in"]])
        return places, count

    def initial(self) -> dict[str, Raw]:
        return _columns(self.plan.fields["state"], run_lowered(self.plan.init, self._fixed(1), 1))

    def steps(
        self, states: Mapping[str, Raw], inputs: Mapping[str, Raw]
    ) -> tuple[dict[str, Raw], dict[str, Raw]]:
        """Many steps at once, each from a state of its own."""
        return self.stepped(*self.places(states, inputs))

    def stepped(
        self, places: Mapping[str, ex.Array], count: int
    ) -> tuple[dict[str, Raw], dict[str, Raw]]:
        """As :meth:`steps`, from the result of :meth:`places`."""
        fields = self.plan.fields
        results = run_lowered(self.plan.step, places, count)
        split = len(fields["state"])
        return _columns(fields["out"], results[split:]), _columns(fields["state"], results[:split])


def _raw(f: FieldPlan, values: Any) -> Array:
    if isinstance(f.port, Port) and f.port.kind != "quantity":
        return to_whole(values, f.port.integer)
    return to_raw(values, f.fraction)


def raw_stream(plan: BlockPlan, stream: Stream) -> dict[str, Raw]:
    return {f.port.name: _raw(f, stream.inputs[f.port.name]) for f in plan.fields["in"]}


def seen_stream(plan: BlockPlan, stream: Stream) -> Stream:
    """A stream as the board sees it: every sample a whole number of units, or NaN."""

    def held(f: FieldPlan, values: Any) -> Array:
        return from_raw(_raw(f, values), f.fraction)

    inputs = {}
    for f in plan.fields["in"]:
        raw = _raw(f, stream.inputs[f.port.name])
        inputs[f.port.name] = np.where(raw == INVALID, np.nan, from_raw(raw, f.fraction))
    # A state has no mark for what is not a number: it is the number that its bits say.
    known = {f.port.name: f for f in plan.fields["state"]}
    injections = {
        k: {n: held(known[n], v) if n in known else v for n, v in values.items()}
        for k, values in stream.injections.items()
    }
    return Stream(stream.name, inputs, injections)


def states_before(plan: BlockPlan, stream: Stream, states: Mapping[str, Raw]) -> dict[str, Raw]:
    """The state that each step of a recorded run started from."""
    first = RawExecutor(plan).initial()
    before = {}
    for f in plan.fields["state"]:
        name = f.port.name
        before[name] = np.concatenate([first[name], states[name][:-1]])
        for k, values in stream.injections.items():
            if name in values:
                raw = _raw(f, values[name])
                before[name][k] = raw.reshape(before[name][k].shape)
    return before


@dataclass(frozen=True)
class SingleSteps:
    """Every step of a recorded run in exact arithmetic, from the state that the C had."""

    outputs: dict[str, Array]
    states: dict[str, Array]
    turned: Raw
    unexplained: Raw


def single_steps(
    plan: BlockPlan,
    stream: Stream,
    before: Mapping[str, Raw],
    computed: Mapping[str, ex.Array] | None = None,
) -> SingleSteps:
    if computed is None:
        computed, _ = RawExecutor(plan).places(before, raw_stream(plan, stream))
    block, kernel = plan.block, plan.step.kernel
    seen = seen_stream(plan, stream)
    arguments = [
        np.tile(np.asarray(c, dtype=np.float64).reshape(1, -1), (stream.steps, 1))
        for c in block.simulator().coefficients.values()
    ]
    for f in plan.fields["state"]:
        arguments.append(from_raw(before[f.port.name], f.fraction).reshape(stream.steps, -1))
    for f in plan.fields["in"]:
        arguments.append(seen.inputs[f.port.name].reshape(stream.steps, -1))
    mapped = block.step.map(stream.steps).call([ca.DM(a.T) for a in arguments])
    columns = [np.asarray(m, dtype=np.float64).T for m in mapped]
    flat = [c[:, 0] if c.shape[1] == 1 else c for c in columns]
    names = [p.name for p in block.state], [p.name for p in block.outputs]
    split = len(names[0])
    values = lowered_values(plan.step, computed, stream.steps)
    turned, unexplained = _turned(plan, arguments, values, stream.steps, kernel)
    return SingleSteps(
        dict(zip(names[1], flat[split:], strict=True)),
        dict(zip(names[0], flat[:split], strict=True)),
        turned,
        unexplained,
    )


def _turned(
    plan: BlockPlan,
    arguments: Sequence[Array],
    computed: Mapping[int, ex.Array],
    count: int,
    kernel: Kernel,
) -> tuple[Raw, Raw]:
    # Decisions that exact and computed arithmetic take differently.  One is explained when, among
    # the comparisons that it is made of, one differs whose values are closer than their errors.
    exact = evaluate(kernel, FORMATS["f64"], arguments)
    step = Propagation(plan, {}, {}, BEYOND)
    errors, followed = step.node_errors(step.zero), step.followed
    turned: Raw = np.zeros(count, dtype=bool)
    unexplained: Raw = np.zeros(count, dtype=bool)
    close: dict[int, Raw] = {}
    used = {a for n in kernel.nodes if not n.boolean for a in n.args}
    used |= {i for r in kernel.results for i in r}
    for i, node in enumerate(kernel.nodes):
        # How a solved value was found does not matter: its residual is judged, not its way.
        if not node.boolean or i not in followed:
            continue
        if node.op in COMPARES:
            a, b = (np.asarray(exact[k], dtype=np.float64) for k in node.args)
            room = sum(errors[k] for k in node.args) * (1 + 1e-9) + 1e-12 * np.abs(a)
            with np.errstate(invalid="ignore"):
                close[i] = np.abs(a - b) <= room
            if i in computed:  # what both take alike explains nothing
                close[i] &= exact[i] != (computed[i] != 0)
        else:
            close[i] = np.zeros(count, dtype=bool)
            for k in node.args:  # a number counts as true where it is not 0
                if k in close:
                    close[i] |= close[k]
                elif k in computed:
                    differs = (exact[k] != 0) != (computed[k] != 0)
                    close[i] |= differs & (np.abs(exact[k]) <= errors[k])
        if i in used and i in computed:
            differs = exact[i] != (computed[i] != 0)
            unexplained |= differs & ~close[i] & ~turned
            turned |= differs
    return turned, unexplained


def first_difference(
    plan: BlockPlan, runner: CRunner, stream: Stream
) -> tuple[str, dict[str, Raw], dict[str, Raw], dict[str, ex.Array]]:
    """Where the compiled Block first differs from the executor in any bit."""
    executor = RawExecutor(plan)
    outputs, states = run_c(runner, stream, raw=True)
    before = states_before(plan, stream, states)
    places, count = executor.places(before, raw_stream(plan, stream))
    computed = defined(plan.step, places, count)
    expected_y, expected_s = executor.stepped(computed, count)
    expected_s |= expected_counters(plan.block, stream, expected_y)
    expected = KernelTrajectory(stream, expected_y, expected_s)
    return expected.first_difference(outputs, states), outputs, states, computed


def compare_fixed(
    device: Device, plan: BlockPlan, runner: CRunner, stream: Stream, bound: Bound
) -> Comparison:
    block = plan.block
    runner.reset()
    difference, raw_y, raw_s, computed = first_difference(plan, runner, stream)
    counted: Raw = np.ones(stream.steps, dtype=bool)
    beyond, claimed = 0, bound
    if math.isinf(bound.steps):
        seen = seen_stream(plan, stream)
        expected_y, expected_s = run_symbolic(block, seen)
        beyond = steps_beyond(block, bound, seen, expected_s)
        if beyond:
            bound = step_bound(plan)
    limits = bound.states | bound.outputs
    if not math.isinf(bound.steps):
        steps = single_steps(plan, stream, states_before(plan, stream, raw_s), computed)
        expected_y, expected_s, counted = steps.outputs, steps.states, ~steps.turned
    rule = LASTING if math.isinf(bound.steps) else ONE_STEP
    result = Comparison(
        block.name, stream.name, "q31", stream.steps, {}, limits, rule=rule, beyond=beyond
    )
    if beyond and not stream.rough:
        result.problems.append(broken(claimed, beyond))
    if difference:
        result.problems.append(difference)
    if not math.isinf(bound.steps):
        result.turned = int(steps.turned.sum())
        if steps.unexplained.any():
            k = int(np.argmax(steps.unexplained))
            result.problems.append(f"a decision at step {k} that rounding does not explain")
    scale = full_scales(device, block)
    got: dict[str, Raw] = {}
    for group, expected, raw in (("out", expected_y, raw_y), ("state", expected_s, raw_s)):
        for f in plan.fields[group]:
            name = f.port.name
            if f.word:
                got[name] = raw[name]
                continue
            value = from_raw(raw[name], f.fraction)
            error = float(np.max(np.abs(value - expected[name])[counted], initial=0.0))
            result.errors[name] = max(error, result.errors.get(name, 0.0))
            # Exact arithmetic is float64 itself: its own rounding is allowed for.
            if error > limits[name] + 1e-12 * scale.get(name, 1.0):
                result.problems.append(f"{name}: error {error:.3g} above {limits[name]:.3g}")
    judged = {n: v[counted] for n, v in expected_y.items()}
    said = {n: v[counted] for n, v in got.items()}
    status = sum(unexplained(p, judged, said, limits) for p in block.outputs if p.flags)
    if status:
        result.problems.append(f"{status} steps with an unexplained status word")
    runner.reset()
    result.problems += changed_by_restore(runner, stream, (raw_y, raw_s), raw_y, raw_s, raw=True)
    return result


def bounds_of(device: Device) -> dict[str, Bound]:
    """Derived q31 bounds of a device's Blocks over their ports' ranges."""
    found = {}
    for block in device.system.kinds:
        try:
            found[block.name] = any_bound(plan_block(block))
        except RangeError as error:
            raise UserError(
                f"{device.origin}: no error of {block.name} in q31 can be proven ({error}).",
                "Narrow the ranges under [limits]; a rubber whose bent springs soften by strain "
                "needs more of a linear spring. Or use --real f32.",
            ) from error
    return found
