"""Times of frames: the rate behind rounded stamps, and whether frames are missing."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from esea_host.smoothness.result import Array

# A steady rate is one whose steps differ from the mean step by less than this share.
JITTER = 0.01
_BEATS = 10  # of the rate against the rounding: fewer look like lost frames


def rounding_s(time_s: Array) -> float:
    """Largest power of ten, down to 1 us, that all stamps are multiples of; 0 for finer ones."""
    top = float(np.max(np.abs(time_s)))
    for decimals in range(-3, 7):
        scaled = time_s * 10.0**decimals
        # Of single precision as well; of many stamps none is off by more by chance.
        if 8 * np.finfo(np.float64).eps * top * 10.0**decimals > 0.02:
            break
        whole = np.round(scaled)
        if np.ptp(whole) > 1 and np.max(np.abs(scaled - whole)) <= 0.02:
            return float(10.0**-decimals)
    return 0.0


def spread_s(time_s: Array, period_s: float) -> float:
    """Width of the band round a line with one frame every period that has all stamps."""
    return float(np.ptp((time_s - time_s[0]) - period_s * np.arange(len(time_s))))


def rate_behind(time_s: Array) -> float:
    """Mean rate, Hz; of rounded stamps the roundest that they allow.

    The stamps of a steady rate lie in a band of the rounding's width; the line is chosen to have
    the narrowest.  Times rise from first to last.
    """
    mean_s = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    rounding = rounding_s(time_s)
    if rounding <= JITTER * mean_s:
        return float(f"{1 / mean_s:.6g}")
    room_s = rounding / (len(time_s) - 1)
    low_s = max(mean_s - room_s, 0.01 * mean_s)
    best = minimize_scalar(
        lambda period_s: spread_s(time_s, period_s),
        bounds=(low_s, mean_s + room_s),
        method="bounded",
        options={"xatol": 1e-4 * room_s},
    )
    band_s = max(rounding, spread_s(time_s, best.x)) * (1 + 1e-6)
    for digits in range(1, 10):
        rate_Hz = float(f"{1 / best.x:.{digits}g}")
        if spread_s(time_s, 1 / rate_Hz) <= band_s:
            return rate_Hz
    return float(1 / best.x)


def unsteady(time_s: Array, fs_Hz: float) -> tuple[int, str] | None:
    """Frame before the worst step and the defect; None for a steady rate.

    Stamps that are rounded may be off by their rounding.  Where that is so coarse that one long
    step may be a lost frame, the band of all stamps decides.
    """
    period_s, step = 1 / fs_Hz, np.diff(time_s)
    off = np.abs(step - period_s)
    worst = int(np.argmax(off))
    if off[worst] <= JITTER * period_s:
        return None
    rounding = rounding_s(time_s)
    rounding = rounding if rounding > JITTER * period_s else 0.0
    about = f", stamps rounded to {rounding:g} s" if rounding else ""
    if not rounding or off[worst] > rounding + JITTER * period_s:
        what = (
            f"{step[worst]:.6g} s after sample {worst}, where {fs_Hz:g} Hz has {period_s:.6g} s "
            f"(at most {JITTER:.0%} off{about})."
        )
        return worst, f"A gap in time: {what}"
    lost_seen = period_s >= 1.5 * rounding
    ratio = period_s / rounding
    beats = len(time_s) * abs(ratio - round(ratio))
    if not lost_seen and (ratio < 0.6 or beats < _BEATS):
        return worst, (
            f"A gap in time or too coarse stamps: {step[worst]:.6g} s after sample {worst}; stamps "
            f"rounded to {rounding:g} s do not show a lost frame at {fs_Hz:g} Hz."
        )
    # A clock may wander where single steps show what is lost.
    wander_s = 0.1 * JITTER * len(time_s) * period_s if lost_seen else 0.0
    spread, most = spread_s(time_s, period_s), rounding + 2 * (JITTER * period_s + wander_s)
    if spread <= most:
        return None
    return worst, (
        f"A gap in time, or no steady rate: the times scatter over {spread:.3g} s round "
        f"{fs_Hz:g} Hz (at most {most:.3g} s{about})."
    )
