"""Comparison of the C of a Block or Program with its reference on one stream."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.step_errors import Bound
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.program import Program
from esea_gen.language.stream import Stream
from esea_gen.verify.bounds import (
    PORT_RANGES,
    broken,
    forward_residual,
    full_scales,
    operating_ranges,
    residual_flag,
    steps_beyond,
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
from esea_gen.verify.streams import inside, streams
from esea_gen.verify.verdict import (
    EXACT,
    EXACT_PROGRAM,
    EXACT_STEP,
    LASTING,
    RESIDUAL,
    STATED,
    Comparison,
)

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
        result.problems.append("the state was judged corrupt although nothing changed it")
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
            _limit_error(result, p.name, c - expected[p.name])


def _limit_error(result: Comparison, name: str, difference: Array) -> None:
    error, limit = float(np.max(np.abs(difference), initial=0.0)), result.limits[name]
    # A state and an output may share a name: keep the worse.
    result.errors[name] = max(error, result.errors.get(name, 0.0))
    if not error <= limit:  # a NaN is above every limit
        result.problems.append(f"{name}: error {error:.3g} above {limit:.3g}")


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
    port: Port, expected: Mapping[str, Any], got: Mapping[str, Any], limits: Mapping[str, float]
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


# A comparison in a Program's loop decides how often it is passed: one that rounding turns turns
# all that follows, so no bound can be derived in f32.  There it may report more, never less.
# The executor takes some 30 ms a step of the elbow's controller.
STEPS = 40
# Largest seen over 3200 steps of the elbow's controller on these streams: 1.2e-4.
CLOSENESS = 1e-3


def program_streams(program: Program, seed: int = 1, steps: int = STEPS) -> list[Stream]:
    """The streams of a Program: a Block's, shorter."""
    return streams(program, seed, steps)


def compare_program(
    device: Device, program: Program, library: HostLibrary, stream: Stream, expected: Run
) -> Comparison:
    got = run_c(library.block(program.name), stream)
    scale = full_scales(device, program)
    exact = library.real == "f64"
    judged = [p for p in program.outputs if not p.flags and p.unit != "1"]
    result = Comparison(
        program.name,
        stream.name,
        library.real,
        stream.steps,
        {},
        {p.name: 0.0 if exact else CLOSENESS * scale[p.name] for p in judged},
        rule=EXACT_PROGRAM if exact else STATED,
    )
    result.problems += not_finite((*program.outputs, *program.state), got[0] | got[1])
    for p in judged:
        _limit_error(result, p.name, np.asarray(got[0][p.name], float) - expected[0][p.name])
    for p in program.outputs:
        if p.flags:
            said = got[0][p.name].astype(np.int64)
            owed = expected[0][p.name].astype(np.int64)
            less = (owed & ~said) != 0
            more = (said & ~owed) != 0
            result.status_differences += int(np.sum(less | more if exact else less))
            result.turned += 0 if exact else int(np.sum(more))
    if exact:
        result.bit_identical = all(
            np.asarray(c[p.name], float).tobytes() == np.asarray(e[p.name], float).tobytes()
            for c, e, ports in zip(got, expected, (program.outputs, program.state), strict=True)
            for p in ports
            # Where a work array was put in from outside, the executor has another one until it is
            # written; what a step computes from it is compared all the same.
            if not stream.injections or p in program.outputs or p in program.carried
        )
    names = ([p.name for p in ports] for ports in (program.outputs, program.carried))
    result.problems += changed_by_restore(library.block(program.name), stream, got, *names)
    return result
