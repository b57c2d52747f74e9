"""The strongest sines in a map of the gear's disturbance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_gen.language.ports import Array

MOST, LEAST_SHARE = 8, 0.25
LOW_1_RAD, HIGH_1_RAD = 4.0, 90.0


@dataclass(frozen=True)
class Wave:
    """amplitude_Nm sin(wave_1_rad theta + phase_rad), at the joint."""

    wave_1_rad: float
    amplitude_Nm: float
    phase_rad: float


def strongest_waves(theta_rad: Array, torque_Nm: Array, least_Nm: float) -> tuple[Wave, ...]:
    """One after the other, each time fitting all anew, until the next one is small.

    least_Nm: amplitude below which nothing is said.
    """
    from scipy.optimize import least_squares

    torque = torque_Nm - np.mean(torque_Nm)
    grid = np.linspace(LOW_1_RAD, HIGH_1_RAD, 800)
    probe = np.exp(-1j * np.outer(grid, theta_rad)) * np.hanning(len(theta_rad))
    waves = np.zeros(0)
    apart = np.pi / (theta_rad[-1] - theta_rad[0])

    def parts(k: Array) -> Array:
        phase = np.outer(theta_rad, k)
        return np.hstack([np.sin(phase), np.cos(phase), np.ones((len(theta_rad), 1))])

    def left(k: Array) -> Array:
        terms = parts(k)
        return np.asarray(torque - terms @ np.linalg.lstsq(terms, torque, rcond=None)[0])

    for _ in range(MOST):
        more = np.append(waves, grid[int(np.argmax(np.abs(probe @ left(waves))))])
        more = least_squares(left, more, bounds=(LOW_1_RAD - 1, HIGH_1_RAD + 1), x_scale=1.0).x
        sines = _amplitudes(parts(more), torque, len(more))
        size = np.abs(sines)
        # Two within what the travel can part are one wave, told badly.
        gaps = np.diff(np.sort(more))
        if size[-1] < max(LEAST_SHARE * size.max(), least_Nm) or np.any(gaps < apart):
            break
        waves = more
    if not len(waves):
        return ()
    sines = _amplitudes(parts(waves), torque, len(waves))
    found = [
        Wave(float(k), float(abs(s)), float(np.angle(s))) for k, s in zip(waves, sines, strict=True)
    ]
    return tuple(sorted(found, key=lambda w: -w.amplitude_Nm))


def _amplitudes(terms: Array, torque: Array, count: int) -> np.ndarray:
    found = np.linalg.lstsq(terms, torque, rcond=None)[0]
    return np.asarray(found[:count] + 1j * found[count : 2 * count])


__all__ = ["Wave", "strongest_waves"]
