"""Standard trajectories at 1 kHz: the person's intention and the desired torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.twin.published import PLANTS

RATE_HZ = 1000.0
REACH_REST_S = 0.8


@dataclass(frozen=True)
class Trajectory:
    """A path, a desired torque, and the window in which a run is judged."""

    name: str
    theta_p_rad: Array
    omega_p_rad_s: Array
    alpha_p_rad_s2: Array
    tau_desired_Nm: Array
    start: int  # first sample that is judged, and the one after the last
    end: int
    clamped: bool = False  # the output is fixed: no person

    def __post_init__(self) -> None:
        n = len(self.tau_desired_Nm)
        if not 0 <= self.start < self.end <= n:
            judged = f"samples {self.start} to {self.end} of {n} are judged"
            raise UserError(f"trajectory {self.name}: {judged}.", f"Give 0 <= start < end <= {n}.")

    @property
    def window(self) -> slice:
        return slice(self.start, self.end)

    @property
    def start_rad(self) -> float:
        return float(self.theta_p_rad[0])

    def signals(self) -> dict[str, Array]:
        """The path for the plant, and path and torque as a controller's references."""
        return {
            "theta_p_rad": self.theta_p_rad,
            "omega_p_rad_s": self.omega_p_rad_s,
            "alpha_p_rad_s2": self.alpha_p_rad_s2,
            "tau_desired_Nm": self.tau_desired_Nm,
            "theta_desired_rad": self.theta_p_rad,
            "omega_desired_rad_s": self.omega_p_rad_s,
        }


def _check(name: str, value: float, above: float = -np.inf) -> None:
    if not above < value < np.inf:
        kind = "a number" if above else "above 0"
        raise UserError(f"{name} = {value} is not {kind}.", "Give a finite one.")


def _time(duration_s: float) -> Array:
    return np.arange(round(duration_s * RATE_HZ)) / RATE_HZ


def _made(
    name: str,
    duration_s: float,
    window_s: tuple[float, float],
    path: Callable[[Array], tuple[Array, Array, Array]],
    tau_Nm: float,
) -> Trajectory:
    _check("tau_Nm", tau_Nm)
    t = _time(duration_s)
    theta, omega, alpha = path(t)
    start, end = (round(w * RATE_HZ) for w in window_s)
    return Trajectory(name, theta, omega, alpha, np.full(len(t), tau_Nm), start, end)


def fixed_output(name: str, tau_Nm: Array, start: int) -> Trajectory:
    """Any desired torque with the output fixed, judged from sample ``start`` to the end."""
    rest = np.zeros(len(tau_Nm))
    return Trajectory(name, rest, rest, rest, tau_Nm, start, len(tau_Nm), True)


def fixed_sinusoid(amplitude_Nm: float, frequency_Hz: float) -> Trajectory:
    _check("frequency_Hz", frequency_Hz, 0.0)
    _check("amplitude_Nm", amplitude_Nm)
    p = PLANTS.trajectory.fixed
    slow = frequency_Hz < p.slow_below_Hz
    cycles, settle = (p.slow_cycles, p.slow_settle_cycles) if slow else (p.cycles, p.settle_cycles)
    t = _time(cycles / frequency_Hz)
    tau = amplitude_Nm * np.sin(2 * np.pi * frequency_Hz * t)
    name = f"fixed output, {amplitude_Nm:g} Nm at {frequency_Hz:g} Hz"
    return fixed_output(name, tau, round(settle / frequency_Hz * RATE_HZ))


def tuning() -> Trajectory:
    return fixed_sinusoid(1.7, 0.6)


def backdriven(frequency_Hz: float, tau_Nm: float = 0.0) -> Trajectory:
    _check("frequency_Hz", frequency_Hz, 0.0)
    p = PLANTS.trajectory.backdriven
    a, w = np.deg2rad(p.amplitude_deg), 2 * np.pi * frequency_Hz

    def path(t: Array) -> tuple[Array, Array, Array]:
        return a - a * np.cos(w * t), a * w * np.sin(w * t), a * w**2 * np.cos(w * t)

    window = (p.settle_s, p.duration_s)
    return _made(f"backdriven at {frequency_Hz:g} Hz", p.duration_s, window, path, tau_Nm)


def bread(tau_Nm: float = 0.0) -> Trajectory:
    """Cutting bread: a rise to the middle of the range, then slices about it."""
    p = PLANTS.trajectory.bread
    w = 2 * np.pi * p.frequency_Hz

    def path(t: Array) -> tuple[Array, Array, Array]:
        s = np.minimum(t / p.rise_s, 1.0)
        rising = t < p.rise_s
        m = p.middle_rad
        theta = m * s * s * (3 - 2 * s)
        omega = m * 6 * s * (1 - s) / p.rise_s
        alpha = np.where(rising, m * 6 * (1 - 2 * s) / p.rise_s**2, 0.0)
        late = np.maximum(t - p.rise_s, 0.0)
        fade = np.exp(-late / p.fade_s)
        gain, gain1, gain2 = 1 - fade, fade / p.fade_s, -fade / p.fade_s**2
        sin, cos = np.sin(w * late), np.cos(w * late)
        a = p.amplitude_rad * ~rising
        return (
            theta + a * gain * sin,
            omega + a * (gain1 * sin + gain * w * cos),
            alpha + a * (gain2 * sin + 2 * gain1 * w * cos - gain * w * w * sin),
        )

    return _made("bread cutting", p.duration_s, (p.settle_s, p.duration_s), path, tau_Nm)


def minimum_jerk(share: Any) -> tuple[Any, Any, Any]:
    """Way, speed and acceleration of a minimum-jerk movement from 0 to 1; at rest outside."""
    s = np.clip(share, 0.0, 1.0)
    return (
        s**3 * (10 - 15 * s + 6 * s**2),
        30 * s**2 * (1 - s) ** 2,
        60 * s * (1 - s) * (1 - 2 * s),
    )


def reaches(ends_rad: Array, lasting_s: Array, h: float) -> Array:
    """Deflection from rest to each end in turn, by minimum jerk, with a rest after each."""
    parts, last = [np.zeros(1)], 0.0
    for end, lasting in zip(ends_rad, lasting_s, strict=True):
        u = np.minimum(np.arange(1, round((lasting + REACH_REST_S) / h) + 1) * h / lasting, 1.0)
        parts.append(last + (end - last) * u**3 * (10 - 15 * u + 6 * u * u))
        last = float(end)
    return np.concatenate(parts)


def impedance(tau_Nm: float = 0.0) -> Trajectory:
    """Reaching from 0 to 90 degrees and back with minimum jerk each way."""
    p = PLANTS.trajectory.impedance
    reach, half = np.deg2rad(p.reach_deg), p.half_s

    def path(t: Array) -> tuple[Array, Array, Array]:
        phase = np.mod(t, 2 * half)
        back = phase >= half
        way, speed, rise = minimum_jerk(np.where(back, phase - half, phase) / half)
        theta, omega, alpha = way, speed / half, rise / half**2
        sign = np.where(back, -1.0, 1.0)
        return reach * np.where(back, 1 - theta, theta), reach * sign * omega, reach * sign * alpha

    return _made("reaching", p.duration_s, (p.settle_s, p.end_s), path, tau_Nm)
