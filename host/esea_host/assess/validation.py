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

from esea_gen.errors import UserError
from esea_host.assess.passive_tests import pendulum_test
from esea_host.assess.patients import (
    DEG,
    DISORDERS,
    RELAXED,
    SEVERITIES,
    Array,
    KneePatient,
    Knees,
    afflicted,
    nominal,
)

ELBOW_RATE_rad_s = 90 * DEG  # the file does not say; in the middle of the paper's 15 to 150 deg/s
RATES_deg_s = (60, 90, 120, 150)  # at which it might have been
FINE_S = 1e-3


def pendulum_table() -> list[dict[str, Any]]:
    """Pendulum tests of the middle patients."""
    names = [RELAXED, *(f"{d}{s}" for d in DISORDERS for s in SEVERITIES)]
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
) -> Array:
    """Reflex torque of the model at angles of a stretch of constant speed, with delay and lags."""
    p = KneePatient("")
    t = np.arange(0, (float(angle_rad[-1]) - float(angle_rad[0])) / rate_rad_s + 0.3, FINE_S)
    angle = float(angle_rad[0]) + rate_rad_s * (t - p.delay_s)
    drive = most_Nm * -np.expm1(-stiffness_Nm_rad * np.maximum(angle - threshold_rad, 0) / most_Nm)
    lag = -math.expm1(-FINE_S / p.activation_s)
    torque = drive
    for _ in range(2):
        torque = lfilter([lag], [1, lag - 1], torque)
    return np.asarray(np.interp(angle_rad, float(angle_rad[0]) + rate_rad_s * t, torque))


def knee_stiffness(rate_rad_s: float) -> dict[int, float]:
    """Reflex stiffness of the middle patients at a speed of stretch, Nm/rad, not saturated."""
    people = {s: afflicted(KneePatient(""), s, 0) for s in SEVERITIES}
    return {
        s: p.gain_Nms_rad2 * max(0.0, rate_rad_s - p.dynamic_threshold_rad_s)
        for s, p in people.items()
    }


def _fitted(angle: Array, torque: Array, rate_rad_s: float) -> tuple[float, float, float, float]:
    # Threshold, stiffness, most torque and error of the model fitted at a speed of stretch.
    def residual(v: Array) -> Array:
        return np.asarray(ramp_torque(angle, rate_rad_s, *v) - torque)

    start, ends = [85 * DEG, 15.0, 8.0], ([0.5, 0.5, 3], [3, 500, 60])
    found = least_squares(residual, start, x_scale=[0.2, 10, 5], bounds=ends)
    threshold, stiffness, most = (float(v) for v in found.x)
    return threshold, stiffness, most, float(np.sqrt(np.mean(found.fun**2)))


def against_elbow(folder: Path) -> dict[str, Any]:
    """The model fitted to a spastic elbow, and to none at all in healthy ones."""
    try:
        spastic = np.loadtxt(folder / "ref_data_1.csv", delimiter=",")
        healthy = {
            p.stem: np.loadtxt(p, delimiter=",", skiprows=1)
            for p in sorted(folder.glob("derived_healthy_v*.csv"))
        }
    except (OSError, ValueError) as error:
        raise UserError(
            f"{folder}: {error}.", "Name the folder of the elbow recordings."
        ) from error
    spastic = spastic[np.argsort(spastic[:, 0])]
    # Beyond its peak the torque falls, muscles being past their best length: not in the model.
    rising = spastic[: int(np.argmax(spastic[:, 1])) + 1]
    x, y = rising[:, 0] * DEG, rising[:, 1]

    threshold, stiffness, most, rms_Nm = _fitted(x, y, ELBOW_RATE_rad_s)
    scale = KneePatient("").reflex_max_Nm[0] / float(y.max())
    softer = {}
    for rate in RATES_deg_s:
        elbow = scale * _fitted(x, y, rate * DEG)[1]
        softer[rate] = {s: elbow / k if k else None for s, k in knee_stiffness(rate * DEG).items()}
    still = {n: float(np.abs(d[:, 2]).max()) for n, d in healthy.items()}
    rms = {n: float(np.sqrt(np.mean(d[:, 2] ** 2))) for n, d in healthy.items()}
    return {
        "assumed_rate_deg_s": ELBOW_RATE_rad_s / DEG,
        "rms_error_Nm": rms_Nm,
        "peak_Nm": float(y.max()),
        "threshold_deg": threshold / DEG,
        "onset_deg": float(np.interp(0.05 * y.max(), y, x)) / DEG,
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
    """As lines of text."""
    out = ["pendulum   index  first swing  rest  damping  1/s"]
    for r in found["pendulum"]:
        damping = "-" if r["damping_ratio"] is None else f"{r['damping_ratio']:.2f}"
        frequency = "-" if r["frequency_Hz"] is None else f"{r['frequency_Hz']:.2f}"
        out.append(
            f"{r['category']:<9} {r['relaxation_index']:6.2f} {r['first_swing_deg']:10.0f}°"
            f" {r['rest_deg']:5.0f}° {damping:>8} {frequency:>5}"
        )
    elbow = found.get("elbow")
    if elbow:
        out += [
            f"elbow: model within {elbow['rms_error_Nm']:.2f} Nm rms of {elbow['peak_Nm']:.1f} Nm "
            f"(at an assumed {elbow['assumed_rate_deg_s']:.0f} deg/s)",
            f"  threshold {elbow['threshold_deg']:.0f} deg, stiffness "
            f"{elbow['stiffness_Nm_deg']:.2f} Nm/deg, most {elbow['most_Nm']:.1f} Nm",
            f"  scaled to the knee {elbow['stiffness_scaled_Nm_rad']:.0f} Nm/rad; the simulated "
            "severities have "
            + ", ".join(f"{v:.0f}" for v in elbow["knee_stiffness_Nm_rad"].values()),
            "  softer than that by a factor of "
            + "; ".join(
                f"{by[5]:.1f} to {by[2]:.1f} at {rate}°/s"
                for rate, by in elbow["softer_than_elbow"].items()
                if by[2] and by[5]
            )
            + " (S5 to S2)",
            f"  healthy elbows: at most {elbow['healthy_largest_Nm']:.2f} Nm at any speed; "
            "the model has no reflex there",
        ]
    return out
