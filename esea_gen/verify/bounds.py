"""Limits of a Block's float32: full scales, derived bounds, the limit of its residual."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from esea_gen.device import Device
from esea_gen.emit.error_bounds import block_bound
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.spans import RangeError
from esea_gen.emit.step_errors import Bound, started_flags, state_jacobian, state_matrix
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.component import Component
from esea_gen.language.ports import Array, Flag
from esea_gen.language.stream import Stream
from esea_gen.verify.executor import step_arguments
from esea_gen.verify.one_step import ExactStep, StepJudge, StepRule
from esea_gen.verify.verdict import ONE_STEP

PORT_RANGES, DOMAIN = "port ranges", "identified domain"
# Of full scale: what float32 may do to the sensed torque inside the identified domain.
MOST_TORQUE_SHARE = 0.01


def full_scales(device: Device, block: Component) -> dict[str, float]:
    """Full scale of each output and state of a Block."""
    actuator = device.file.actuator
    out = {}
    for p in (*block.outputs, *block.state):
        if p.flags:
            continue
        scale = max(abs(p.low), abs(p.high))
        if p.unit == "Nm":
            scale = min(scale, device.tau_full_scale_Nm)
            # The thesis's symbols: u_... are torques at the motor shaft, tau_... at the joint.
            if actuator is not None and p.name.startswith("u_"):
                scale = min(scale, actuator.u_max_Nm.value)
        out[p.name] = scale
    return out


def operating_ranges(device: Device, block: Block) -> dict[str, tuple[float, float]]:
    """The identified domain as ranges of a Block's inputs and states, for its tighter bound."""
    d = device.file.domain
    theta, omega = d.theta_max_rad.value, d.omega_max_rad_s.value
    ranges = {
        "u_theta_rad": theta,
        "s_theta_prev_rad": theta,
        "u_omega_rad_s": omega,
        "s_tau_r_Nm": device.tau_full_scale_Nm,
    }
    names = {f"u_{p.name}" for p in block.inputs} | {f"s_{p.name}" for p in block.state}
    return {k: (-v, v) for k, v in ranges.items() if k in names}


def residual_flag(block: Block) -> Flag | None:
    """The flag by which a Block says that its residual is too large."""
    outputs = {p.name for p in block.outputs}
    if [p.name for p in block.inputs] != ["tau_Nm"] or not outputs >= {
        *("theta_rad", "omega_mid_rad_s", "residual_Nm")
    }:
        return None
    port = block.status_port
    for flag in port.flags if port else ():
        if flag.name == "NOT_CONVERGED" and flag.compares == ("residual_Nm",):
            return flag
    return None


def forward_residual(
    device: Device, block: Block, stream: Stream, outputs: Mapping[str, Array]
) -> tuple[float, float]:
    """Difference of the torque at an inverse's set-points from the request: reported, computed."""
    port = block.status_port
    assert port is not None
    bits = {f.name: 1 << i for i, f in enumerate(port.flags)}
    status = outputs[port.name].astype(np.int64)
    valid = status & bits["INPUT_INVALID"] == 0
    free = valid & (status & bits["REQUEST_CLAMPED"] == 0)
    said = np.abs(outputs["residual_Nm"].astype(np.float64))[free]
    computed = np.zeros(0)
    if not stream.injections and np.any(valid):
        # Before its first valid request the inverse has no memory; the sensor starts with it.
        start = int(np.argmax(valid))
        y, _ = device.sensor.simulator().run(
            {
                "theta_rad": outputs["theta_rad"][start:],
                "omega_rad_s": outputs["omega_mid_rad_s"][start:],
            }
        )
        missed = np.abs(y["tau_Nm"] - stream.inputs["tau_Nm"][start:])
        computed = missed[free[start:]]
    return float(np.max(said, initial=0.0)), float(np.max(computed, initial=0.0))


def derive_bounds(device: Device, block: Block) -> dict[str, Bound]:
    """A Block's float32 bounds against float64: over its ports' ranges, and over the domain."""
    if residual_flag(block) is not None:
        return {}
    out: dict[str, Bound] = {}
    for name, ranges in ((PORT_RANGES, {}), (DOMAIN, operating_ranges(device, block))):
        if out and not ranges:  # nothing that the domain narrows
            out[name] = out[PORT_RANGES]
            continue
        single, double = (block_bound(block, FORMATS[real], ranges) for real in ("f32", "f64"))
        out[name] = single.with_errors_of(double)
    return out


def bounds_or_rule(device: Device, block: Block) -> tuple[dict[str, Bound], StepJudge | None]:
    """How a Block's float32 is judged: a bound for any number of steps, of one step, or none."""
    try:
        bounds = derive_bounds(device, block)
    except RangeError:
        bounds = None
    if bounds is not None and _torque_share(device, block, bounds) <= MOST_TORQUE_SHARE:
        assumes = any(b.method == "linear" for b in bounds.values())
        return bounds, StepRule(block) if assumes else None
    try:
        rule = StepRule(block)
    except RangeError as error:
        if block.name != device.sensor.name:
            return {}, ExactStep(block)
        raise UserError(
            f"{device.origin}: no finite float32 bound can be derived for {block.name}, not even "
            f"of one step ({error}).",
            "Narrow the ranges under [limits], or raise the offsets eps1 and eps2; --real f64 "
            "verifies the float64 C alone.",
        ) from error
    share = _torque_share(device, block, {ONE_STEP: rule.bound})
    if share > MOST_TORQUE_SHARE:
        raise UserError(
            f"{device.origin}: the float32 bound derived for {block.name}.tau_Nm is "
            f"{100 * share:.3g} % of full scale, above its limit {100 * MOST_TORQUE_SHARE:g} %: "
            "C with errors that large would pass.",
            "Narrow the ranges under [limits] or [domain], or raise the offsets eps1 and eps2; "
            "--real f64 verifies the float64 C alone.",
        )
    return {ONE_STEP: rule.bound}, rule


def _torque_share(device: Device, block: Block, bounds: Mapping[str, Bound]) -> float:
    # Of full scale, inside the identified domain where it is known apart; 0 for another Block.
    if block.name != device.sensor.name or not bounds:
        return 0.0
    inside = bounds.get(DOMAIN) or next(iter(bounds.values()))
    return inside.outputs["tau_Nm"] / device.tau_full_scale_Nm


def steps_beyond(block: Block, bound: Bound, stream: Stream, states: Mapping[str, Array]) -> int:
    """Steps of a run that violate a linear bound's assumption: one matrix of the state throughout.

    Where a clip of a state acts or an invalid input is bridged, another matrix acts.
    """
    matrix = state_matrix(block) if bound.method == "linear" else None
    if matrix is None:
        return 0
    given = step_arguments(block, stream, states, FORMATS["f64"])
    mapped = state_jacobian(block).map(stream.steps)
    found = np.asarray(mapped(*[ca.DM(a.T) for a in given]), dtype=float)
    each = found.reshape(len(matrix), stream.steps, len(matrix)).transpose(1, 0, 2)
    flags = started_flags(block)
    each[:, flags, :] = 0.0
    each[:, :, flags] = 0.0
    near = np.abs(each - matrix) <= 1e-9 * np.max(np.abs(matrix), initial=1e-300)
    same = np.all(near, axis=(1, 2))
    afresh = ~np.any(each, axis=(1, 2))
    # Before the first valid sample the state is what it was made, without an error.
    for k, p in enumerate(block.state):
        if p.name == "primed":
            before = given[len(block.coefficients) + k][:, 0]
            afresh |= ~np.logical_or.accumulate(before != 0)
    return int(np.count_nonzero(~same & ~afresh))


def broken(bound: Bound, steps: int) -> str:
    """Message of a run that violates its bound's assumption without being declared rough."""
    assumed = "; ".join(bound.assumptions)
    return f"{steps} steps break what the bound assumes ({assumed})"


UNTRIED = "no stream meets the assumptions of its bound: the bound was not tested"
