"""Relations of drive, coupling, limits and rates: what cannot be, and what is unwise."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator

from esea_gen.devices.fields import DeviceFile
from esea_gen.devices.numbers import Quantity, numbers_of
from esea_gen.errors import UserError

# Control rate over the resonance of motor and load on the coupling.  A loop sampled less than six
# times its bandwidth is late by more than 60 deg; 20 is the usual recommendation.
LEAST_SAMPLES, GOOD_SAMPLES = 6.0, 20.0
LEAST_ACCELERATION_RAD_S2 = 10.0  # a slow reach of a person takes as much
ALIKE = 2.0  # factor within which full scale and the rubber's own torque agree


def check_drive(file: DeviceFile) -> Iterator[UserError]:
    """What no drive can be."""
    v = _values(file)
    a = file.actuator
    if a is None or file.joint is None:
        return
    n, inertia = a.gear_ratio.value, a.J_kgm2.value
    if a.rotor_kgm2 is not None and inertia < (least := a.rotor_kgm2.value * n * n) * (1 - 1e-6):
        yield UserError(
            f"actuator.J_kgm2 = {inertia:g} is below what the rotor alone makes at the joint, "
            f"rotor_kgm2 = {a.rotor_kgm2.value:g} times gear_ratio = {n:g} squared = {least:g}.",
            f"Give J_kgm2 = {least:.3g} or more, or correct the ratio.",
        )
    top_Nm = n * v.get("safety.u_max_Nm", a.u_max_Nm.value)
    if top_Nm <= a.fc_Nm.value:
        yield UserError(
            f"actuator.fc_Nm = {a.fc_Nm.value:g} is not below the largest torque at the joint, "
            f"gear_ratio = {n:g} times safety.u_max_Nm = {top_Nm:g}: the motor cannot turn.",
            "Correct one of them.",
        )
    rate, resonance = v.get("timing.control_rate_Hz"), resonance_Hz(file)
    if rate is not None and rate < LEAST_SAMPLES * resonance:
        yield UserError(
            f"timing.control_rate_Hz = {rate:g} Hz is {rate / resonance:.2g} times the resonance "
            f"of motor and load on the coupling ({resonance:.3g} Hz), below its limit "
            f"{LEAST_SAMPLES:g}: no controller can damp it.",
            f"Give {GOOD_SAMPLES * resonance:.3g} Hz or more.",
        )


def tell_of_drive(origin: str, file: DeviceFile) -> None:
    """Warn of what is unwise."""
    for text in _unwise(file):
        warnings.warn(f"{origin}: {text}", stacklevel=2)


def resonance_Hz(file: DeviceFile) -> float:
    """Motor's and load's inertia against each other on the coupling at its stiffest."""
    a, joint, d, e = file.actuator, file.joint, file.domain, file.elastomer
    assert a is not None
    assert joint is not None
    stiffness = d.tau_full_scale_Nm.value / d.theta_max_rad.value
    if e is not None:
        slope = e.k1_Nm_rad.value + 3 * e.k3_Nm_rad3.value * d.theta_max_rad.value**2
        stiffness = max(stiffness, slope)
    mobility = 1 / a.J_kgm2.value + 1 / joint.Jh_kgm2.value
    return math.sqrt(stiffness * mobility) / (2 * math.pi)


def spring_Nm(file: DeviceFile, theta_rad: float) -> float:
    """Torque of the published model's spring alone."""
    e = file.elastomer
    assert e is not None
    x = max(0.0, theta_rad - (e.dead_zone_rad.value if e.dead_zone_rad else 0.0))
    return e.k1_Nm_rad.value * x + e.k3_Nm_rad3.value * x**3


def _unwise(file: DeviceFile) -> Iterator[str]:
    a, safety, d = file.actuator, file.safety, file.domain
    full, wide = d.tau_full_scale_Nm.value, d.theta_max_rad.value
    if a is None or safety is None or file.joint is None:
        return
    if file.elastomer is not None:
        spring = spring_Nm(file, wide)
        if not 1 / ALIKE <= full / spring <= ALIKE:
            yield (
                f"domain: tau_full_scale_Nm = {full:g}, but the rubber's spring gives "
                f"{spring:.3g} Nm at theta_max_rad = {wide:g}: errors in % of full scale mislead. "
                "Correct the one that is another rubber's."
            )
        if (most := spring_Nm(file, file.limits.theta_rad.value)) < safety.tau_max_Nm.value:
            yield (
                f"safety: tau_max_Nm = {safety.tau_max_Nm.value:g} never trips: the rubber's "
                f"spring gives {most:.3g} Nm at the largest plausible deflection, "
                f"limits.theta_rad = {file.limits.theta_rad.value:g}. Lower it below {most:.2g}."
            )
    if safety.tau_max_Nm.value < full:
        yield (
            f"safety: tau_max_Nm = {safety.tau_max_Nm.value:g} trips below full scale, "
            f"domain.tau_full_scale_Nm = {full:g}. Raise it, or expect trips in normal use."
        )
    n = a.gear_ratio.value
    if (top := n * safety.u_max_Nm.value) < full:
        yield (
            f"actuator: gear_ratio = {n:g} times safety.u_max_Nm = {safety.u_max_Nm.value:g} is "
            f"{top:.3g} Nm at the joint, below domain.tau_full_scale_Nm = {full:g}: larger desired "
            "torques are not reached. Raise the ratio or the motor's torque, or desire less."
        )
    inertia = a.J_kgm2.value
    if (reach := n * a.u_max_Nm.value / inertia) < LEAST_ACCELERATION_RAD_S2:
        yield (
            f"actuator: J_kgm2 = {inertia:g} with gear_ratio = {n:g} lets the motor accelerate the "
            f"joint by {reach:.2g} rad/s^2, below {LEAST_ACCELERATION_RAD_S2:g}. J is the rotor's "
            f"inertia times the ratio squared: here a rotor of {inertia / n**2:.2g} kgm^2. "
            "Check both."
        )
    rate, resonance = file.timing.control_rate_Hz, resonance_Hz(file)
    if rate is not None and LEAST_SAMPLES <= rate.value / resonance < GOOD_SAMPLES:
        yield (
            f"timing: control_rate_Hz = {rate.value:g} is {rate.value / resonance:.2g} times the "
            f"resonance of motor and load on the coupling ({resonance:.3g} Hz). "
            f"{GOOD_SAMPLES * resonance:.3g} Hz or more damp it better."
        )


def _values(file: DeviceFile) -> dict[str, float]:
    return {k: q.value for k, q, _ in numbers_of(file) if isinstance(q, Quantity)}
