"""A member of the elastomer family as a Block, and the Block of its unit terms, which fits it.

Both are the same step.  The first has the weights folded in, and terms of one operator merged; the
second gives one output for each term, of which the weights are solved for.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import (
    Constant,
    Equation,
    Flag,
    Port,
    Tunable,
    around,
    clip,
    status_port,
    threshold,
)
from esea_gen.model.family import FittedMember, Member, Start
from esea_gen.model.family_step import ROOM, FamilyStep, merged_elements, unit_elements
from esea_gen.model.symbolic import equations

# Tunable of every Block that has a member with a factor of temperature.
TEMPERATURE = "temperature_C"
# Coefficient of every Block that has a member with a factor of temperature.
FACTOR = "temperature_factor"
# Its range is this much wider than what arithmetic without rounding can reach.
FACTOR_ROOM = 1e-4
# Of the Block of unit terms: x, far beyond any recording.
UNIT_REACH = 16.0


def unit_terms(member: Member, period_s: float) -> Block:
    """A member's terms, each with weight 1, from which its weights are solved."""
    steps = FamilyStep(
        unit_elements(member),
        scale_rad=1.0,
        theta_lim=UNIT_REACH,
        period_s=period_s,
        start="virgin",
    )
    count = len(member.terms)

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        state, parts = steps.run(s, u.theta_rad, guard, label)
        columns = [ca.SX(0)] * count
        for p in parts:
            for weight, softening, column in p.element.gains:
                columns[column] = columns[column] + weight * p.value * p.factors[softening]
        return state, {"terms_Nm": ca.vertcat(*columns)}

    reach = 4 * max(1.0, *(e.most(UNIT_REACH) * len(steps.elements) for e in steps.elements))
    return Block.define(
        "terms",
        f"Unit terms of {member.name}",
        period_s=period_s,
        state=steps.state(),
        inputs=(around("theta_rad", UNIT_REACH, "x", on_invalid="theta_prev_rad"),),
        outputs=(around("terms_Nm", reach, "terms of weight 1", count),),
        step=step,
    )


def torque_limit(device: DeviceData, fitted: FittedMember) -> float:
    """The device's limit, or the model's largest torque: the inverse is of an unclipped torque."""
    reach = fitted.most_Nm(device.file.limits.theta_rad.value)
    return threshold(max(device.file.limits.tau_Nm.value, ROOM * reach))


def family_step(
    device: DeviceData,
    fitted: FittedMember,
    start: Start,
    derived: bool = False,
    period_s: float | None = None,
) -> FamilyStep:
    """The step of a fitted member: where sensor, inverse and prediction have it from."""
    return FamilyStep(
        merged_elements(fitted),
        scale_rad=fitted.scale_rad,
        theta_lim=threshold(device.file.limits.theta_rad.value),
        period_s=device.period_s if period_s is None else period_s,
        start=start,
        derived=derived,
    )


def temperature_parts(device: DeviceData, fitted: FittedMember) -> dict[str, Any]:
    """Parts of a Block for the rubber's temperature."""
    t = fitted.temperature
    if t is None:
        return {}
    known = device.file.family and device.file.family.temperature
    source = known.reference_C.source if known else "identified"
    status = known.reference_C.status if known else "identified"
    effect = "softens" if t.per_K < 0 else "stiffens"
    text = f"the rubber's temperature: higher {effect} the torque model"
    least, most = (f * (1 + side * FACTOR_ROOM) for f, side in zip(t.ends, (-1, 1), strict=True))
    return {
        "tunables": (Tunable(TEMPERATURE, t.reference_C, t.low_C, t.high_C, text, source, status),),
        "coefficients": (Port(FACTOR, least, most, "by temperature, of all but the offset"),),
        "prepare": lambda tunables: {FACTOR: t.at(getattr(tunables, TEMPERATURE))},
    }


class _FamilySensor:
    def __init__(self, device: DeviceData, fitted: FittedMember, start: Start) -> None:
        limits, domain = device.file.limits, device.file.domain
        self.h, self.fitted = device.period_s, fitted
        self.theta_lim = threshold(limits.theta_rad.value)
        self.omega_lim = threshold(limits.omega_rad_s.value)
        self.tau_lim = torque_limit(device, fitted)
        self.steps = family_step(device, fitted, start)
        self.state = self.steps.state()
        self.full_scale = threshold(domain.tau_full_scale_Nm.value)
        self.theta_most = threshold(domain.theta_max_rad.value)
        self.omega_most = threshold(domain.omega_max_rad_s.value)
        self.name = "sensor"
        self.title = f"Elastomer torque sensor: {fitted.member.title}"
        self.constants = family_constants(device, fitted)
        self.equations = _equations(fitted)
        text = "deflection: motor-side minus load-side angle"
        rate = "deflection rate in the middle of the step"
        self.inputs = (
            around("theta_rad", self.theta_lim, text, on_invalid="theta_prev_rad"),
            around("omega_rad_s", self.omega_lim, rate, on_invalid=0.0),
        )
        part, tau, full = "part of the torque on the load", self.tau_lim, self.full_scale
        self.outputs = (
            around("tau_Nm", tau, "interaction torque on the load"),
            around("tau_spring_Nm", tau, f"springs and offset: {part}"),
            around("tau_rate_Nm", tau, f"Maxwell branches: {part}"),
            around("tau_hysteresis_Nm", tau, f"stop and slip operators: {part}"),
            status_port(
                "status of this sample",
                "an input was NaN or outside its physical range",
                "the state was corrupt; the model was restarted",
                Flag("THETA_OUTSIDE", "|deflection| is outside the identified domain"),
                Flag("RATE_OUTSIDE", "|deflection rate| is outside the identified domain"),
                Flag("TORQUE_OUTSIDE", "|torque| is above full scale", False, ("tau_Nm",), full),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        state, sums = self.steps.torque(s, u.theta_rad, guard, label, factor_in(c))
        sums = {k: label(f"tau_{k}_Nm", v, f"{k}: sum of its terms") for k, v in sums.items()}
        tau = label("tau_Nm", sums["spring"] + sums["rate"] + sums["hysteresis"], "torque")
        status = guard.status(
            ca.fabs(u.theta_rad) > self.theta_most,
            ca.fabs(u.omega_rad_s) > self.omega_most,
            ca.fabs(tau) > self.full_scale,
        )
        most = self.tau_lim
        outputs = {f"tau_{k}_Nm": clip(v, -most, most) for k, v in sums.items()}
        return state, outputs | {"tau_Nm": clip(tau, -most, most), "status": status}


def family_sensor(device: DeviceData, fitted: FittedMember, start: Start = "virgin") -> Block:
    """A fitted member as a torque sensor Block, with the ports of the thesis' one."""
    return Block.of(_FamilySensor(device, fitted, start), **temperature_parts(device, fitted))


def factor_in(c: SimpleNamespace) -> Any:
    """The factor of temperature among coefficients; None for a member without one."""
    return getattr(c, FACTOR, None)


def family_constants(device: DeviceData, fitted: FittedMember) -> tuple[Constant, ...]:
    """A member's numbers, as Block constants: of the device file where it holds them."""
    family = device.file.family
    if family is None:  # fitted, and not yet in a file
        scale = Constant("scale_rad", fitted.scale_rad, "largest trained deflection", "identified")
        weights = (
            Constant(f"w{i}_Nm", w, t.text, "identified") for i, (w, t) in enumerate(fitted.used, 1)
        )
        return (scale, *weights)
    found = [family.scale_rad.constant("scale_rad")]
    for known, term in zip(family.terms, fitted.member.terms, strict=True):
        q = known.weight_Nm
        if q.value:
            said = f"{term.text}; {q.source}"
            found.append(Constant(f"w{len(found)}_Nm", q.value, said, q.status))
    t = family.temperature
    if t is None:
        return tuple(found)
    return (*found, t.reference_C.constant("reference_C"), t.per_K.constant("per_K"))


EQUATIONS = """
    [family] | tau | {factor} * Sum(w_i * d_i * z_i, (i, 1, N)) | every weight 0 or above
    [rise] | q | x / (1 + Abs(x) / a) | a rise that bends; others are x, x^3, x^5
    [maxwell] | F | (1 - a - b) * F{{k-1}} + a * q + b * q{{k-1}} | z = q - F
    [stop] | F | Max(Min(F{{k-1}}, q + r), q - r) | z = q - F
    [slip] | z' | 1 - z * sign(q - q{{k-1}}) / L | over q; Dahl
    [strain] | d | 1 / (1 + m / a) | m: largest |x| before this step
    [path] | d | exp(-s / L) | s: path before this step
"""
WARM = """
    [temperature] | g | 1 + c_T * (T - T_0) | \
        factor of all terms but the offset; c_T: per_K, T_0: reference_C
"""


def _equations(fitted: FittedMember) -> tuple[Equation, ...]:
    if fitted.temperature is None:
        return equations(EQUATIONS.format(factor="1"))
    return equations(EQUATIONS.format(factor="g") + WARM)
