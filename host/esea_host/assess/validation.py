"""The simulated knee against published numbers: pendulum test, and the elbow's stretch reflex.

The elbow's recordings (Apache-2.0, digitised from [McPherson2018] by the authors of
SpasticMyoElbow) are no part of this program; the folder that holds them is named by its owner.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from esea_gen.tables import TableFormat, read_table
from esea_host.assess.passive_tests import pendulum_test
from esea_host.assess.patients import (
    CATEGORIES,
    DEG,
    RANGE_RAD,
    RELAXED,
    SEVERITIES,
    Array,
    KneePatient,
    Knees,
    nominal,
    stretched,
)

ELBOW_RATE_rad_s = 90 * DEG  # the file does not say; in the middle of the paper's 15 to 150 deg/s
RATES_deg_s = (60, 90, 120, 150)  # at which it might have been
FINE_S = 1e-3
DELAYS_S = (0.015, 0.03, 0.06)  # that a reflex might have
# Flexors are stretched from a bent elbow to a straight one, over as much of their range as a knee's
# extensors are from a straight knee to a bent one: angles are compared as shares of the range.
ELBOW_RAD = (35 * DEG, 180 * DEG)  # assumed
MIDDLE = {s: nominal(f"S{s}") for s in SEVERITIES}


def pendulum_table() -> list[dict[str, Any]]:
    names = (RELAXED, *CATEGORIES)
    knees = Knees([nominal(n) for n in names])
    m = knees.release(0.0, 14.0, [[0, i] for i in range(len(names))])
    out = []
    for i, n in enumerate(names):
        r = pendulum_test(m.time_s, m.angle_rad[:, i])
        out.append(
            {
                "category": n,
                "relaxation_index": r.relaxation_index,
                "first_swing_deg": r.first_swing_rad / DEG,
                "rest_deg": r.rest_rad / DEG,
                "swings": r.swings,
                "damping_ratio": r.damping_ratio,
                "frequency_Hz": r.frequency_Hz,
                "fastest_deg_s": r.peak_rate_rad_s / DEG,
            }
        )
    return out


def ramp_torque(
    angle_rad: Array,
    rate_rad_s: float,
    threshold_rad: float,
    stiffness_Nm_rad: float,
    most_Nm: float,
    lag_s: float | None = None,
) -> Array:
    """Reflex torque of the model at angles of a stretch of constant speed, with delay and lags."""
    p = KneePatient("")
    t = np.arange(0, (float(angle_rad[-1]) - float(angle_rad[0])) / rate_rad_s + 0.3, FINE_S)
    angle = float(angle_rad[0]) + rate_rad_s * (t - p.delay_s)
    drive = most_Nm * -np.expm1(-stiffness_Nm_rad * np.maximum(angle - threshold_rad, 0) / most_Nm)
    lag = -math.expm1(-FINE_S / (lag_s or p.activation_s))
    torque = drive
    for _ in range(2):
        torque = lfilter([lag], [1, lag - 1], torque)
    torque = torque * stretched(np.asarray(rate_rad_s))
    return np.asarray(np.interp(angle_rad, float(angle_rad[0]) + rate_rad_s * t, torque))


def knee_stiffness(rate_rad_s: float) -> dict[int, float]:
    """Reflex stiffness of the middle patients at a speed of stretch, Nm/rad, not saturated."""
    return {
        s: p.gain_Nms_rad2 * max(0.0, rate_rad_s - p.dynamic_threshold_rad_s)
        for s, p in MIDDLE.items()
    }


def _fitted(angle: Array, torque: Array, rate_rad_s: float, *, lag: bool = False) -> Array:
    """Threshold, stiffness, most torque, and where asked for each lag; then the rms error."""

    def residual(v: Array) -> Array:
        return np.asarray(ramp_torque(angle, rate_rad_s, *v) - torque)

    n = 4 if lag else 3
    start, scale = [85 * DEG, 15.0, 8.0, 0.02][:n], [0.2, 10, 5, 0.02][:n]
    ends = [0.5, 0.5, 3, 2 * FINE_S][:n], [3, 500, 60, 0.2][:n]
    found = least_squares(residual, start, x_scale=scale, bounds=ends)
    return np.append(found.x, np.sqrt(np.mean(found.fun**2)))


def _on_knee(elbow_rad: float) -> float:
    """A knee bent by as much of its range as an elbow has been straightened of its."""
    return RANGE_RAD * (elbow_rad - ELBOW_RAD[0]) / (ELBOW_RAD[1] - ELBOW_RAD[0])


def against_elbow(folder: Path) -> dict[str, Any]:
    """Fit the model to a spastic elbow, and to healthy ones without spasticity."""
    bare = TableFormat(kind="csv", header_line=0)
    spastic = read_table(folder / "ref_data_1.csv", ("1", "2"), bare)
    angle, torque = spastic.numbers("1"), spastic.numbers("2")
    below = bare.model_copy(update={"first_data_line": 2})
    healthy = {
        p.stem: read_table(p, ("3",), below).numbers("3")
        for p in sorted(folder.glob("derived_healthy_v*.csv"))
    }
    order = np.argsort(angle)
    # Beyond its peak the torque falls, muscles being past their best length: not in the model.
    rising = order[: int(np.argmax(torque[order])) + 1]
    x, y = angle[rising] * DEG, torque[rising]

    threshold, stiffness, most, rms_Nm = (float(v) for v in _fitted(x, y, ELBOW_RATE_rad_s))
    strongest = KneePatient("").reflex_max_Nm[0] * float(stretched(np.asarray(ELBOW_RATE_rad_s)))
    scale = strongest / float(y.max())
    softer = {}
    for rate in RATES_deg_s:
        elbow = scale * float(_fitted(x, y, rate * DEG)[1])
        softer[rate] = {s: elbow / k if k else None for s, k in knee_stiffness(rate * DEG).items()}
    still = {n: float(np.abs(d).max()) for n, d in healthy.items()}
    rms = {n: float(np.sqrt(np.mean(d**2))) for n, d in healthy.items()}
    return {
        "assumed_rate_deg_s": ELBOW_RATE_rad_s / DEG,
        "rms_error_Nm": rms_Nm,
        "peak_Nm": float(y.max()),
        "threshold_deg": threshold / DEG,
        "onset_deg": float(np.interp(0.05 * y.max(), y, x)) / DEG,
        "threshold_scaled_deg": _on_knee(threshold) / DEG,
        "knee_threshold_deg": {  # of the extensors
            s: (p.threshold_rad[0] - p.threshold_rate_s * ELBOW_RATE_rad_s) / DEG
            for s, p in MIDDLE.items()
        },
        # One reflex may come later and be called forth earlier: the curve is the same.
        "threshold_scaled_by_delay_ms": {
            round(1e3 * d): _on_knee(threshold - (d - KneePatient("").delay_s) * ELBOW_RATE_rad_s)
            / DEG
            for d in DELAYS_S
        },
        "lag_ms": {v: 1e3 * float(_fitted(x, y, v * DEG, lag=True)[3]) for v in RATES_deg_s},
        "stiffness_Nm_deg": stiffness * DEG,
        "most_Nm": most,
        "scale_to_knee": scale,
        "stiffness_scaled_Nm_rad": stiffness * scale,
        "knee_stiffness_Nm_rad": knee_stiffness(ELBOW_RATE_rad_s),
        "softer_than_elbow": softer,
        "healthy_largest_Nm": max(still.values()) if still else None,
        "healthy_rms_Nm": rms,
    }


def table(found: dict[str, Any]) -> list[str]:
    out = ["pendulum   index  first swing  rest  swings  damping  1/s"]
    for r in found["pendulum"]:
        damping = "-" if r["damping_ratio"] is None else f"{r['damping_ratio']:.2f}"
        frequency = "-" if r["frequency_Hz"] is None else f"{r['frequency_Hz']:.2f}"
        out.append(
            f"{r['category']:<9} {r['relaxation_index']:6.2f} {r['first_swing_deg']:10.0f}°"
            f" {r['rest_deg']:5.0f}° {r['swings']:7} {damping:>8} {frequency:>5}"
        )
    return out + (_elbow_table(found["elbow"]) if "elbow" in found else [])


def _elbow_table(e: dict[str, Any]) -> list[str]:
    def each(form: str, of: dict[Any, Any]) -> str:
        return ", ".join(form.format(k, v) for k, v in of.items())

    own = each("S{}: {:.0f}°", e["knee_threshold_deg"])
    softer = {k: (v[5], v[2]) for k, v in e["softer_than_elbow"].items() if v[2] and v[5]}
    out = [
        f"elbow: model within {e['rms_error_Nm']:.2f} Nm rms of {e['peak_Nm']:.1f} Nm "
        f"(at an assumed {e['assumed_rate_deg_s']:.0f}°/s)",
        f"  threshold {e['threshold_deg']:.0f}°, first torque at {e['onset_deg']:.0f}°; "
        f"as a share of the range {e['threshold_scaled_deg']:.0f}° of the knee ({own})",
        "  the same with another delay: "
        + each("at {} ms {:.1f}°", e["threshold_scaled_by_delay_ms"]),
        f"  each of two lags, from how it sets in: {each('at {}°/s {:.0f} ms', e['lag_ms'])}; "
        f"the model's {1e3 * KneePatient('').activation_s:.0f} ms",
        f"  stiffness {e['stiffness_Nm_deg']:.2f} Nm per degree, at most {e['most_Nm']:.1f} Nm; "
        f"scaled to the knee {e['stiffness_scaled_Nm_rad']:.0f} Nm/rad "
        f"({each('S{}: {:.0f}', e['knee_stiffness_Nm_rad'])})",
        "  softer than that, S5 to S2, by a factor of "
        + "; ".join(f"{a:.1f} to {b:.1f} at {rate}°/s" for rate, (a, b) in softer.items()),
    ]
    if e["healthy_largest_Nm"] is not None:
        most = f"{e['healthy_largest_Nm']:.2f} Nm"
        out.append(f"  healthy elbows: at most {most} at any speed; the model has no reflex there")
    return out
