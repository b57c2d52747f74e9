"""Frequency responses from recorded sweeps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.frequency import FrequencyResponse
from esea_gen.analysis.response import checked, checked_time
from esea_gen.errors import UserError
from esea_gen.language.ports import Array

MIN_SAMPLES_A_WINDOW = 16
# Of the windows along a sweep: width, at least so many cycles, and how many are tried.
RESOLUTION_Hz, CYCLES, POINTS = 1.0, 3.0, 200


@dataclass(frozen=True)
class Sweep:
    start_Hz: float
    end_Hz: float
    duration_s: float
    start_s: float = 0.0

    def __post_init__(self) -> None:
        values = (self.start_Hz, self.end_Hz, self.duration_s, self.start_s)
        if not (all(map(math.isfinite, values)) and self.duration_s > 0 and self.start_Hz >= 0):
            raise UserError(f"Sweep {values}.", "Give finite ends from 0 Hz on and a length.")
        if self.end_Hz <= self.start_Hz:
            raise UserError(
                f"Sweep from {self.start_Hz:g} to {self.end_Hz:g} Hz does not rise.",
                "Give a higher end.",
            )

    @property
    def rate_Hz_s(self) -> float:
        return (self.end_Hz - self.start_Hz) / self.duration_s

    def phase_rad(self, time_s: Array) -> Array:
        t = time_s - self.start_s
        return 2 * np.pi * (self.start_Hz + 0.5 * self.rate_Hz_s * t) * t


def sweep_response(
    time_s: npt.ArrayLike, u: npt.ArrayLike, y: npt.ArrayLike, sweep: Sweep
) -> FrequencyResponse:
    """Response along a linear sweep, by local least squares on the sweep's own phase."""
    # In a Hann-weighted window both signals are fitted by (a + b x) cos(phase) + (c + d x)
    # sin(phase) + e + g x; the ratio of (a - j c) is the response in its middle.  The rate k adds
    # -j (k / 4 pi) d2H/df2, which is not corrected: the curvature is noisier than the response.
    time = checked_time(time_s)
    x, z = checked("u", u, len(time)), checked("y", y, len(time))
    kept = _windows(time, np.stack([x, z], axis=1), sweep)
    f_kept, response, coherence, sigma = (np.array(c) for c in zip(*kept, strict=True))
    return FrequencyResponse(
        f_kept.astype(np.float64),
        response.astype(np.complex128),
        coherence.astype(np.float64),
        sigma.astype(np.float64),
        f"sweep {sweep.start_Hz:g} to {sweep.end_Hz:g} Hz, local fits over {RESOLUTION_Hz:g} Hz",
    )


def _windows(time: Array, both: Array, sweep: Sweep) -> list[tuple[float, complex, float, float]]:
    """Frequency, response, explained share and relative deviation of every window that fits."""
    rate = sweep.rate_Hz_s
    begin = max(time[0], sweep.start_s)
    end = min(time[-1], sweep.start_s + sweep.duration_s)
    lowest = max(sweep.start_Hz, math.sqrt(rate * CYCLES / 2))
    phase = sweep.phase_rad(time)
    kept: list[tuple[float, complex, float, float]] = []
    for f in np.geomspace(lowest, sweep.end_Hz, POINTS) if lowest < sweep.end_Hz else ():
        centre = sweep.start_s + (f - sweep.start_Hz) / rate
        half = 0.5 * max(RESOLUTION_Hz / rate, CYCLES / f)
        if centre - half < begin - 1e-9 or centre + half > end + 1e-9:
            continue
        a, b = np.searchsorted(time, (centre - half, centre + half))
        if b - a < MIN_SAMPLES_A_WINDOW or (b - a) < 4 * 2 * half * f:
            continue  # fewer than four samples a cycle, or a gap
        kept.append((float(f), *_local(time[a:b], phase[a:b], both[a:b], centre, half)))
    if len(kept) < 4:
        raise UserError(
            f"{len(kept)} of {POINTS} windows fit into the sweep from {begin:g} to {end:g} s.",
            "Record a longer sweep, or check its ends.",
        )
    return kept


def _local(
    time: Array, phase: Array, both: Array, centre: float, half: float
) -> tuple[complex, float, float]:
    s = (time - centre) / half
    window = np.cos(0.5 * np.pi * s) ** 2
    c, d = np.cos(phase), np.sin(phase)
    base = np.stack([c, d, s * c, s * d, np.ones_like(s), s], axis=1)
    root = np.sqrt(window)[:, None]
    found = np.linalg.lstsq(root * base, root * both, rcond=None)[0]
    rest = both - base @ found
    mean = np.sum(window[:, None] * both, axis=0) / np.sum(window)
    total = np.sum(window[:, None] * (both - mean) ** 2, axis=0)
    share = 1 - np.sum(window[:, None] * rest**2, axis=0) / np.maximum(total, 1e-300)
    if not share[0] > 0.9:
        raise UserError(
            f"u is not the given sweep near {centre:g} s: it explains {100 * share[0]:.0f} %.",
            "Check the sweep's ends, length and start.",
        )
    pair = found[0] - 1j * found[1]
    inverse = np.linalg.pinv(base.T @ (window[:, None] * base))
    noise = inverse @ (base.T @ (window[:, None] ** 2 * rest[:, 1:] ** 2 * base)) @ inverse
    deviation = math.sqrt(max(0.5 * (noise[0, 0] + noise[1, 1]), 0.0)) / max(abs(pair[1]), 1e-300)
    return complex(pair[1] / pair[0]), float(np.clip(share[1], 0, 1)), deviation
