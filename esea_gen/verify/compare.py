"""Comparison of one Block's C with its reference on one stream."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.step_errors import Bound
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import Stream
from esea_gen.verify.assumed import broken, steps_beyond
from esea_gen.verify.bounds import (
    PORT_RANGES,
    forward_residual,
    full_scales,
    operating_ranges,
    residual_flag,
)
from esea_gen.verify.one_step import StepJudge, StepRule, drift
from esea_gen.verify.runs import (
    CasadiOracle,
    Run,
    changed_by_restore,
    not_finite,
    run_c,
    run_symbolic,
)
from esea_gen.verify.streams import inside
from esea_gen.verify.verdict import EXACT, EXACT_STEP, LASTING, RESIDUAL, Comparison

F64_TOLERANCE = 1e-12
# Share of full scale to which a float32 Block that is judged by its residual must stay with the
# symbolic one.  Stated, not derived: over the streams the elbow's inverse stays within 3e-4.
RESIDUAL_CLOSENESS = 1e-3


def compare(
    device: Device,
    block: Block,
    library: HostLibrary,
    stream: Stream,
    bounds: dict[str, Bound],
    oracle: CasadiOracle | None,
    rule: StepJudge | None = None,
    expected: Run | None = None,
) -> Comparison:
    wanted = expected or run_symbolic(block, stream)
    got = run_c(library.block(block.name), stream)
    lasting, beyond = bounds.get(PORT_RANGES), 0
    if library.real == "f32" and lasting is not None:
        beyond = steps_beyond(block, lasting, stream, wanted[1])
        rule = (rule or StepRule(block)) if beyond else None
    kind, limits = _limits(device, block, library.real, stream, bounds, rule, wanted[1])
    if rule is not None and kind == rule.kind:
        result = _compare_steps(rule, stream, wanted, got)
    else:
        whose = block.name, stream.name, library.real
        result = Comparison(*whose, stream.steps, {}, limits, rule=kind)
        _compare_values(block, wanted, got, result)
    result.beyond = beyond
    if beyond and lasting is not None and not stream.rough:
        result.problems.append(broken(lasting, beyond))
    _judge_residual(device, block, stream, got[0], result)
    if not stream.injections and _repaired(block, got[0]):
        result.problems.append("the state was judged corrupt although nobody touched it")
    if oracle is not None:
        result.bit_identical = _same_bits(block, oracle, stream, got)
    names = ([p.name for p in ports] for ports in (block.outputs, block.state))
    result.problems += changed_by_restore(library.block(block.name), stream, got, *names)
    return result


def _limits(
    device: Device,
    block: Block,
    real: str,
    stream: Stream,
    bounds: dict[str, Bound],
    rule: StepJudge | None,
    states: dict[str, Array],
) -> tuple[str, dict[str, float]]:
    # The rule by which a stream is judged, and what each port's error must not exceed.
    scale = full_scales(device, block)
    if real == "f64":
        return EXACT, {k: F64_TOLERANCE * v for k, v in scale.items()}
    if rule is not None:
        return rule.kind, rule.limits
    if residual_flag(block) is not None:
        return RESIDUAL, {k: RESIDUAL_CLOSENESS * v for k, v in scale.items()}
    ranges = operating_ranges(device, block)
    within = (
        not stream.injections
        and inside(stream, {k[2:]: v for k, v in ranges.items() if k.startswith("u_")})
        and all(
            bool(np.all(np.abs(states[k[2:]]) <= v[1]))
            for k, v in ranges.items()
            if k.startswith("s_")
        )
    )
    bound = bounds["identified domain" if within else PORT_RANGES]
    return LASTING, bound.states | bound.outputs


def _compare_values(block: Block, wanted: Run, got: Run, result: Comparison) -> None:
    limits = result.limits
    for ports, expected, found in zip((block.outputs, block.state), wanted, got, strict=True):
        for p in ports:
            if p.flags:
                result.status_differences += unexplained(p, expected, found, limits)
                continue
            c = np.asarray(found[p.name], dtype=np.float64)
            if said := not_finite([p], found):
                result.problems += said
                continue
            error = float(np.max(np.abs(c - expected[p.name]), initial=0.0))
            # A state and an output may share a name: keep the worse.
            result.errors[p.name] = max(error, result.errors.get(p.name, 0.0))
            if error > limits[p.name]:
                result.problems.append(f"{p.name}: error {error:.3g} above {limits[p.name]:.3g}")


def _compare_steps(rule: StepJudge, stream: Stream, expected: Run, got: Run) -> Comparison:
    result = rule.compare(stream, *got)
    for a, b in zip(expected, got, strict=True):
        for name, value in drift(rule.block, a, b).items():
            result.drift[name] = max(value, result.drift.get(name, 0.0))
    if rule.kind == EXACT_STEP:  # against the model, where no step has a bound
        words = {p.name for p in rule.block.outputs if p.flags}
        result.errors = {k: v for k, v in result.drift.items() if k not in words}
    for ports, part in zip((rule.block.outputs, rule.block.state), got, strict=True):
        result.problems += not_finite(ports, part)
    return result


def _repaired(block: Block, outputs: dict[str, Array]) -> bool:
    # A clip a hair beyond a guard would restart the Block every time it acts.
    port = block.status_port
    names = [f.name for f in port.flags] if port else []
    if port is None or "STATE_REPAIRED" not in names:
        return False
    return bool(np.any(outputs[port.name].astype(np.int64) >> names.index("STATE_REPAIRED") & 1))


def _judge_residual(
    device: Device, block: Block, stream: Stream, outputs: dict[str, Array], result: Comparison
) -> None:
    judge = residual_flag(block)
    if judge is None:
        return
    for way, size in zip(
        ("by its own output", "by the symbolic sensor"),
        forward_residual(device, block, stream, outputs),
        strict=True,
    ):
        result.residual = (max(size, (result.residual or (0.0,))[0]), judge.threshold)
        # A NaN is above every limit.
        if not size <= judge.threshold:
            result.problems.append(f"residual, {way}: {size:.3g} Nm above {judge.threshold:.3g} Nm")


def unexplained(
    port: Port,
    expected: Mapping[str, Any],
    got: Mapping[str, Any],
    limits: Mapping[str, float],
) -> int:
    """Steps whose status word differs more than rounding explains."""
    difference = expected[port.name].astype(np.int64) ^ got[port.name].astype(np.int64)
    wrong = np.zeros(len(difference), dtype=bool)
    for i, flag in enumerate(port.flags):
        near = np.zeros(len(difference), dtype=bool)
        for name in flag.compares:
            near |= np.abs(np.abs(expected[name]) - flag.threshold) <= limits[name]
        wrong |= ((difference >> i) & 1 == 1) & ~near
    return int(wrong.sum())


def _same_bits(block: Block, oracle: CasadiOracle, stream: Stream, got: Run) -> bool:
    simulator = block.simulator()
    coefficients = list(simulator.coefficients.values())
    wanted = oracle.run(block, coefficients, list(simulator.state.values()), stream)
    return all(
        found[p.name].astype(np.float64).tobytes() == expected[p.name].tobytes()
        for found, expected, ports in zip(got, wanted, (block.outputs, block.state), strict=True)
        for p in ports
    )
