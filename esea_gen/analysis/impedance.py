"""Output impedance: the torque with which a driving point resists a prescribed motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.frequency import FrequencyResponse

GOOD_FIT = 0.2


@dataclass(frozen=True)
class ImpedanceFit:
    """Inertia, damping and stiffness that a driving point shows in a band."""

    inertia_kgm2: float
    damping_Nms_rad: float
    stiffness_Nm_rad: float
    inertia_std: float
    damping_std: float
    stiffness_std: float
    low_Hz: float
    high_Hz: float
    misfit: float


@dataclass(frozen=True)
class OutputImpedance:
    """Torque in Nm with which a driving point resists a prescribed angle, over frequency."""

    angle: FrequencyResponse

    @classmethod
    def of(cls, response: FrequencyResponse) -> OutputImpedance:
        """From the response of the torque on what is moved to its angle: a spring pulls back."""
        return cls(replace(response, response=-response.response))

    @property
    def per_rate(self) -> npt.NDArray[np.complex128]:
        """Torque per angular rate, Nms/rad; its real part is the damping."""
        value = self.angle.response / (2j * np.pi * self.angle.frequency_Hz)
        return np.asarray(value, dtype=np.complex128)

    def fit(self, low_Hz: float = 0.0, high_Hz: float = math.inf) -> ImpedanceFit:
        """Equivalent inertia, damping and stiffness: K + j w B - w^2 J."""
        used = self.angle.band(low_Hz, high_Hz)
        w = 2 * np.pi * used.frequency_Hz
        weight = 1 / used.gain
        zero = np.zeros_like(w)
        # Scaled by the highest frequency: the columns are then of like size.
        top = float(w[-1])
        base = np.concatenate(
            [
                np.stack([-((w / top) ** 2), zero, np.ones_like(w)], axis=1) * weight[:, None],
                np.stack([zero, w / top, zero], axis=1) * weight[:, None],
            ]
        )
        wanted = np.concatenate([used.response.real * weight, used.response.imag * weight])
        found = np.linalg.lstsq(base, wanted, rcond=None)[0]
        rest = wanted - base @ found
        variance = float(rest @ rest) / max(len(wanted) - 3, 1)
        deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(base.T @ base)) * variance, 0))
        scale = np.array([1 / top**2, 1 / top, 1.0])
        j, b, k = (found * scale).tolist()
        dj, db, dk = (deviation * scale).tolist()
        misfit = math.sqrt(float(rest @ rest) / len(w))
        f = used.frequency_Hz
        return ImpedanceFit(j, b, k, dj, db, dk, float(f[0]), float(f[-1]), misfit)

    def to_dict(self) -> dict[str, Any]:
        rate = self.per_rate
        return self.angle.to_dict() | {
            "rate_gain": np.abs(rate),
            "rate_phase_deg": np.degrees(np.angle(rate)),
        }

    def table(self, rows: int = 12, low_Hz: float = 0.0, high_Hz: float = math.inf) -> list[str]:
        fit = self.fit(low_Hz, high_Hz)
        poor = (
            f", above {GOOD_FIT:g}: not one mass, damper and spring"
            if fit.misfit > GOOD_FIT
            else ""
        )
        return [
            *self.angle.table(rows),
            f"fit from {fit.low_Hz:.3g} to {fit.high_Hz:.3g} Hz, torque that the moving needs:",
            f"inertia {fit.inertia_kgm2:.4g} +- {fit.inertia_std:.2g} kg m2",
            f"damping {fit.damping_Nms_rad:.4g} +- {fit.damping_std:.2g} Nms/rad",
            f"stiffness {fit.stiffness_Nm_rad:.4g} +- {fit.stiffness_std:.2g} Nm/rad",
            f"relative misfit {fit.misfit:.2g}{poor}",
        ]
