"""Relations of drive, coupling, limits and rates: errors and warnings."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator

from esea_gen.devices.fields import DeviceFile
from esea_gen.errors import UserError

# Control rate over the resonance of motor and load on the coupling.  A loop sampled less than six
# times its bandwidth is late by more than 60 deg; the published predictive control has 8.3, and 20
# is the usual recommendation.
LEAST_SAMPLES, GOOD_SAMPLES, ADVISED_SAMPLES = 6.0, 8.0, 20.0
MOST_TRIPS = 10.0  # torque of the motor at the joint over the one that trips
LEAST_ACCELERATION_RAD_S2 = 10.0  # a slow reach of a person takes as much
# Swing of the load side on the coupling, held at its motor side.  In simulation a drive of 3 Hz
# follows with its output fixed; one of 4.5 Hz errs twice as much or trips, one of 6 Hz trips.
MOST_SWING_HZ = 3.5
ALIKE = 2.0  # factor within which full scale and the rubber's own torque agree


# Copper, and the share of the torque that is left at the largest temperature: it must cool there.
COPPER_1_K, COPPER_C, LEAST_SHARE, LEAST_HEATING_K = 3.93e-3, 25.0, 0.05, 5.0


def check_drive(file: DeviceFile) -> Iterator[UserError]:
    """Reject impossible drives."""
    a, safety, control = file.actuator, file.safety, file.timing.control_rate_Hz
    if a is None or file.joint is None:
        return
    n, inertia = a.gear_ratio.value, a.J_kgm2.value
    if a.rotor_kgm2 is not None and inertia < (least := a.rotor_kgm2.value * n * n) * (1 - 1e-3):
        yield UserError(
            f"actuator.J_kgm2 = {inertia:g} is below what the rotor alone makes at the joint, "
            f"rotor_kgm2 = {a.rotor_kgm2.value:g} times gear_ratio = {n:g} squared = {least:g}.",
            f"Give J_kgm2 = {least:.3g} or more, or correct the ratio.",
        )
    top_Nm = n * (safety or a).u_max_Nm.value
    if top_Nm <= a.fc_Nm.value:
        yield UserError(
            f"actuator.fc_Nm = {a.fc_Nm.value:g} is not below the largest torque at the joint, "
            f"gear_ratio = {n:g} times safety.u_max_Nm = {top_Nm:g}: the motor cannot turn.",
            "Lower fc_Nm, or raise gear_ratio or u_max_Nm.",
        )
    resonance = resonance_Hz(file)
    if control is not None and (rate := control.value) < LEAST_SAMPLES * resonance:
        yield UserError(
            f"timing.control_rate_Hz = {rate:g} Hz is {rate / resonance:.2g} times the resonance "
            f"of motor and load on the coupling ({resonance:.3g} Hz), below its limit "
            f"{LEAST_SAMPLES:g}: no controller can damp it.",
            f"Give {ADVISED_SAMPLES * resonance:.3g} Hz or more.",
        )
    yield from _check_heating(file)


def _check_heating(file: DeviceFile) -> Iterator[UserError]:
    t, safety = file.motor_thermal, file.safety
    if t is None or safety is None:
        return
    k_t, ohm, u_Nm = t.k_t_Nm_A.value, t.resistance_Ohm.value, safety.u_max_Nm.value
    full_K = ohm * (u_Nm / k_t) ** 2 * (t.winding_case_K_W.value + t.case_ambient_K_W.value)
    given = f"motor_thermal.k_t_Nm_A = {k_t:g} and resistance_Ohm = {ohm:g}:"
    if full_K < LEAST_HEATING_K:
        yield UserError(
            f"{given} the largest torque, safety.u_max_Nm = {u_Nm:g} at {u_Nm / k_t:.3g} A, heats "
            f"the winding by {full_K:.2g} K, below its limit {LEAST_HEATING_K:g}: the section "
            "would protect nothing.",
            "Is k_t typed in mNm/A? Give Nm/A, or leave the section out.",
        )
    room_K = t.max_C.value - t.ambient_C.value
    hot = 1 + COPPER_1_K * (t.max_C.value - COPPER_C)
    if (least_K := LEAST_SHARE**2 * hot * full_K) > room_K:
        yield UserError(
            f"{given} {100 * LEAST_SHARE:g} % of safety.u_max_Nm = {u_Nm:g} heats the winding by "
            f"{least_K:.3g} K, above max_C less ambient_C ({room_K:g} K): it would never cool.",
            "Is resistance typed in mOhm? Give Ohm; check k_t_Nm_A and the thermal resistances.",
        )


def tell_of_drive(origin: str, file: DeviceFile) -> None:
    """Warn of unwise values."""
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
    if a is None or safety is None or file.joint is None:
        return
    full, trip, n, inertia = (
        q.value for q in (d.tau_full_scale_Nm, safety.tau_max_Nm, a.gear_ratio, a.J_kgm2)
    )
    if file.elastomer is not None:
        spring, most = (spring_Nm(file, x.value) for x in (d.theta_max_rad, file.limits.theta_rad))
        if not 1 / ALIKE <= full / spring <= ALIKE:
            yield (
                f"domain: tau_full_scale_Nm = {full:g}, but the spring gives {spring:.3g} Nm at "
                "theta_max_rad: errors in % of full scale mislead. Correct one of them."
            )
        if most < trip:
            yield (
                f"safety: tau_max_Nm = {trip:g} never trips: the spring gives {most:.3g} Nm at "
                "limits.theta_rad. Lower it below that."
            )
        k1, Jh = file.elastomer.k1_Nm_rad.value, file.joint.Jh_kgm2.value
        if (swing := math.sqrt(k1 / Jh) / (2 * math.pi)) > MOST_SWING_HZ:
            least = k1 / (2 * math.pi * MOST_SWING_HZ) ** 2
            yield (
                f"joint: Jh_kgm2 = {Jh:g} swings on the coupling at {swing:.2g} Hz, above "
                f"{MOST_SWING_HZ:g}: sliding mode and cascade control swing where the output is "
                f"held fast, predictive control above 6 Hz. Give {least:.2g} or more: the "
                "controllers' number may be larger than the limb's."
            )
    if trip < full:
        yield (
            f"safety: tau_max_Nm = {trip:g} trips below full scale, domain.tau_full_scale_Nm = "
            f"{full:g}. Raise it, or expect trips in normal use."
        )
    if (top := n * safety.u_max_Nm.value) < full:
        yield (
            f"actuator: gear_ratio = {n:g} times safety.u_max_Nm is {top:.3g} Nm at the joint, "
            f"below domain.tau_full_scale_Nm = {full:g}: larger desired torques are not reached. "
            "Raise either, or reduce the desired torque."
        )
    if top > MOST_TRIPS * trip:
        yield (
            f"actuator: gear_ratio = {n:g} times safety.u_max_Nm is {top:.3g} Nm at the joint, "
            f"above {MOST_TRIPS:g} times safety.tau_max_Nm = {trip:g}. Lower safety.u_max_Nm."
        )
    corner_Hz, resonance = 1 / (2 * math.pi * a.tau_c_s.value), resonance_Hz(file)
    if corner_Hz < 0.5 * resonance:
        yield (
            f"actuator: tau_c_s = {a.tau_c_s.value:g} lets the motor follow up to {corner_Hz:.2g} "
            f"Hz, below half the coupling's resonance ({resonance:.3g} Hz). Check both."
        )
    if (reach := n * a.u_max_Nm.value / inertia) < LEAST_ACCELERATION_RAD_S2:
        yield (
            f"actuator: J_kgm2 = {inertia:g} with gear_ratio = {n:g} lets the motor accelerate the "
            f"joint by {reach:.2g} rad/s^2, below {LEAST_ACCELERATION_RAD_S2:g}. J goes with the "
            f"ratio squared: here it is a rotor of {inertia / n**2:.2g} kgm^2. Check both."
        )
    rate = file.timing.control_rate_Hz
    if rate is not None and LEAST_SAMPLES <= rate.value / resonance < GOOD_SAMPLES:
        yield (
            f"timing: control_rate_Hz = {rate.value:g} is {rate.value / resonance:.2g} times the "
            f"resonance of motor and load on the coupling ({resonance:.3g} Hz). "
            f"{ADVISED_SAMPLES * resonance:.3g} Hz or more damp it better."
        )
