"""Stability of sliding mode inside its boundary layer, as a linear sampled loop.

Moving and with the output fixed, every part of the loop is linear: drive and coupling (5.1, 5.2),
Butterworth filter, disturbance observer (5.5), law, lead, period and release of the control task.
One control period is one matrix; a mode that grows there swings until the motor's limit stops it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.devices.fields import SlidingMode
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.model.rubber import stiffness_range_Nm_rad
from esea_gen.model.sections import section_of
from esea_gen.observe import drive_of

Array = npt.NDArray[np.float64]

LEAST_DAMPING = 0.02
# Above, the loop swings with the shipped motor's lag (docs/sliding-mode.md), and a slope near the
# control rate is not followed at all.
LAMBDA_LOW_1_S, LAMBDA_HIGH_1_S, LAMBDA_SHARE = 1.0, 25.0, 0.125
SLOW_HZ = 0.5
"""Below, a mode is the integral's or an estimate's creep and no swing."""
LOOP_STATES = [
    "theta",
    "omega",
    "u_a",
    "theta_last",
    "z0",
    "z1",
    "z2",
    "z3",
    "omega_last",
    "passive",
]
LOOP_STATES += ["u_held", "u_a_model", "d4", "integral", "u_pending", "u_now"]


def sliding_mode_numbers(device: DeviceData) -> SlidingMode:
    found: SlidingMode = section_of(device, "sliding_mode", "sliding mode control needs it")
    return found


@dataclass(frozen=True)
class LoopMode:
    damping: float
    frequency_Hz: float


# The switching gain's part that grows with the wanted acceleration (5.20) counts as if it always
# pushed on: the law then acts on J + J_unc.
def least_damped(device: DeviceData, lead: float, lambda_1_s: float | None = None) -> LoopMode:
    """The least damped mode inside the layer, of the coupling's least and largest stiffness."""
    soft, stiff = stiffness_range_Nm_rad(device)
    slope = sliding_mode_numbers(device).lambda_1_s.value if lambda_1_s is None else lambda_1_s
    modes = [_worst(device, lead, slope, k) for k in (soft, stiff)]
    return min(modes, key=lambda m: m.damping)


def slope_range(device: DeviceData, h: float) -> tuple[float, float]:
    """Least and largest lambda that is followed (1/s), with the device's own inside."""
    asked = sliding_mode_numbers(device).lambda_1_s.value
    low, high = LAMBDA_LOW_1_S, min(LAMBDA_HIGH_1_S, LAMBDA_SHARE / h)
    if low <= asked <= high:
        return low, high
    # A higher rate helps only up to where the motor's lag sets the limit.
    by_rate = high < asked <= LAMBDA_HIGH_1_S
    need = math.ceil(asked / LAMBDA_SHARE)
    raise UserError(
        f"{device.origin}: sliding_mode.lambda_1_s = {asked:g} 1/s is outside "
        f"{low:g} to {high:g} 1/s, what "
        + (
            f"timing.control_rate_Hz = {1 / h:g} Hz allows."
            if by_rate
            else "the motor's lag allows: the loop swings, or does not follow."
        ),
        f"Give a value inside{f', or raise the rate to {need} Hz or more' if by_rate else ''}.",
    )


def check_loop(device: DeviceData, lead: float) -> None:
    """Refuse a device file whose loop swings."""
    found = least_damped(device, lead)
    if found.damping >= LEAST_DAMPING:
        return
    slope = sliding_mode_numbers(device).lambda_1_s.value
    low, high = 1.0, slope
    if slope > low and least_damped(device, lead, low).damping >= LEAST_DAMPING:
        for _ in range(12):
            middle = math.sqrt(low * high)
            fits = least_damped(device, lead, middle).damping >= LEAST_DAMPING
            low, high = (middle, high) if fits else (low, middle)
        fix = f"Lower sliding_mode.lambda_1_s from {slope:g} to {0.99 * low:.3g} 1/s or less"
    else:
        fix = "No slope from 1 1/s on is damped with these"
    swings = "grows" if found.damping < 0 else "hardly dies away"
    raise UserError(
        f"{device.origin}: the loop inside the boundary layer has a mode at "
        f"{found.frequency_Hz:.2g} Hz with damping {found.damping:.2g}, below {LEAST_DAMPING:g}: a "
        f"swing {swings}.  It comes from sliding_mode.lambda_1_s, phi_rad_s and J_unc_kgm2 against "
        "joint.motor_velocity_Hz, actuator.tau_c_s and the control task's rate and release.",
        f"{fix}; or raise the cut-off or the rate, or release earlier.",
    )


def _worst(device: DeviceData, lead: float, slope: float, stiffness: float) -> LoopMode:
    period = LoopPeriod(device, lead, slope, stiffness)
    matrix = np.stack([period(x) for x in np.eye(len(LOOP_STATES))], axis=1)
    poles = np.linalg.eigvals(matrix)
    s = np.log(poles[np.abs(poles) > 1e-6].astype(complex)) / period.control_s
    frequency = np.abs(s) / (2 * np.pi)
    swings = frequency > SLOW_HZ
    damping = -s.real[swings] / np.abs(s[swings])
    i = int(np.argmin(damping))
    return LoopMode(float(damping[i]), float(frequency[swings][i]))


# SciPy has both of these; loading it takes up to a second of every command that builds a drive.
def _exponential(x: Array) -> Array:
    small, one = x / 1024, np.eye(len(x))
    series = one
    for k in range(8, 0, -1):
        series = one + small @ series / k
    return np.linalg.matrix_power(series, 1024)


def low_pass(cutoff_Hz: float, h: float) -> tuple[Array, ...]:
    """Butterworth filter of fourth order, by the bilinear rule, as a, b, c, d of its states."""
    poles = np.tan(np.pi * cutoff_Hz * h) * np.exp(1j * np.pi * np.array([5, 7, 9, 11]) / 8)
    below = np.poly((1 + poles) / (1 - poles)).real
    above = np.poly(-np.ones(4)) * below.sum() / 16
    a = np.vstack([-below[1:], np.eye(4)[:3]])
    direct = np.array([[above[0]]])
    return a, np.eye(4)[:, :1], (above - above[0] * below)[None, 1:], direct


class LoopPeriod:
    # One control period, from its first tick to the next one's, on numbers that enter linearly.

    def __init__(self, device: DeviceData, lead: float, slope: float, stiffness: float) -> None:
        drive = drive_of(device)
        a, sm, h = drive.actuator, sliding_mode_numbers(device), device.period_s
        j, n, lag = a.J_kgm2.value, a.gear_ratio.value, a.tau_c_s.value
        self.h, self.control_s = h, drive.control_period_s
        self.every = round(self.control_s / h)
        release = device.file.timing.control_release_s
        self.release = self.every if release is None else round(release.value / h)
        self.j, self.n, self.fv, self.k = j, n, a.fv_Nms_rad.value, stiffness
        # Of a set-point at rest, friction is compensated for the rate wanted: none.
        self.fv_seen = 0.0 if sm.setpoint_acceleration == "model" else self.fv
        self.slope, self.lead = slope, lead
        self.acting_j = j + sm.J_unc_kgm2.value
        reach = self.acting_j * sm.eta_rad_s2.value + sm.fc_share.value * a.fc_Nm.value
        self.layer = reach / n / sm.phi_rad_s.value
        plant = np.zeros((4, 4))
        plant[0, 1] = 1.0
        plant[1, :3] = -stiffness / j, -self.fv / j, n / j
        plant[2, 2:] = -1 / lag, 1 / lag
        exact = _exponential(plant * h)
        self.moved, self.pushed = exact[:3, :3], exact[:3, 3]
        self.filter = low_pass(drive.joint.motor_velocity_Hz.value, h)
        self.decay = math.exp(-h / lag)
        self.mean = (1 - self.decay) * lag / h
        self.share = 1 - math.exp(-drive.disturbance.drive_1_s.value * h)

    def __call__(self, state: Array) -> Array:
        x = dict(zip(LOOP_STATES, state.tolist(), strict=True))
        fa, fb, fc, fd = self.filter
        for tick in range(self.every):
            if tick == 0:
                self._control(x)
            if tick == self.release % self.every:
                x["u_now"] = x["u_pending"]
            z = np.array([x["z0"], x["z1"], x["z2"], x["z3"]])
            difference = (x["theta"] - x["theta_last"]) / self.h
            rate = float((fc @ z)[0] + fd[0, 0] * difference)
            x |= dict(zip(("z0", "z1", "z2", "z3"), fa @ z + fb[:, 0] * difference, strict=True))
            self._observe(x, rate)
            x["theta_last"] = x["theta"]
            now = np.array([x["theta"], x["omega"], x["u_a"]])
            now = self.moved @ now + self.pushed * x["u_now"]
            x |= dict(zip(("theta", "omega", "u_a"), now, strict=True))
        return np.array([x[k] for k in LOOP_STATES])

    def _observe(self, x: dict[str, Any], rate: float) -> None:
        passive = -(self.fv * rate + self.k * x["theta"]) / self.j
        driven = x["u_held"] + (x["u_a_model"] - x["u_held"]) * self.mean
        model = self.n / self.j * driven + 0.5 * (passive + x["passive"])
        seen = (rate - x["omega_last"]) / self.h
        x["d4"] += self.share * (seen - model - x["d4"])
        x["u_a_model"] = x["u_held"] + (x["u_a_model"] - x["u_held"]) * self.decay
        x |= {"u_held": x["u_now"], "omega_last": rate, "passive": passive}

    def _control(self, x: dict[str, Any]) -> None:
        # What the control task reads was measured a tick ago: the sensing task's latches.
        rate, torque = x["omega_last"], self.k * x["theta_last"]
        error, error_rate = -x["theta_last"], -rate
        wanted = 2 * self.slope * error_rate + self.slope**2 * error
        acting = self.acting_j * wanted - self.j * x["d4"]
        equivalent = (acting + self.fv_seen * rate + torque) / self.n
        surface = error_rate + 2 * self.slope * error + x["integral"]
        law = equivalent + self.layer * surface
        x["integral"] += self.control_s * self.slope**2 * error
        x["u_pending"] = law + (self.lead - 1) * (law - x["u_a_model"])
