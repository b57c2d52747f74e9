"""Frequency responses: bandwidth, stability margins, delay, phase lag; output impedance.

`esea_gen.analysis.sweeps` estimates one from recorded signals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_gen.language.ports import Array

Complex = npt.NDArray[np.complex128]

Crossing = tuple[float | None, float | None]  # margin and frequency
HALF_POWER_DB = 10 * math.log10(2.0)


@dataclass(frozen=True)
class Bandwidth:
    """Where a gain has fallen, and by which definition."""

    bandwidth_Hz: float | None
    passband_gain: float
    passband: str
    drop_dB: float
    peak_dB: float
    peak_Hz: float
    returns: bool  # above the level at a higher frequency: the figure hangs on the definition


@dataclass(frozen=True)
class Margins:
    """Stability margins of an open loop; None where nothing crosses."""

    gain_margin_dB: float | None
    gain_margin_Hz: float | None
    phase_margin_deg: float | None
    phase_margin_Hz: float | None
    delay_margin_s: float | None
    modulus_margin: float


@dataclass(frozen=True)
class FrequencyResponse:
    frequency_Hz: Array
    response: Complex
    coherence: Array | None
    sigma: Array | None  # relative to the gain, from noise alone
    method: str

    @property
    def gain(self) -> Array:
        return np.abs(self.response)

    @property
    def gain_dB(self) -> Array:
        return np.asarray(20 * np.log10(np.maximum(self.gain, 1e-300)))

    @property
    def phase_deg(self) -> Array:
        return np.asarray(np.degrees(np.unwrap(np.angle(self.response))))

    def band(self, low_Hz: float = 0.0, high_Hz: float = math.inf) -> FrequencyResponse:
        keep = (self.frequency_Hz >= low_Hz) & (self.frequency_Hz <= high_Hz)
        if np.count_nonzero(keep) < 4:
            raise UserError(
                f"{np.count_nonzero(keep)} points between {low_Hz:g} and {high_Hz:g} Hz; four are "
                "needed.",
                "Widen the band.",
            )
        parts: dict[str, Any] = {
            k: v[keep] for k, v in vars(self).items() if isinstance(v, np.ndarray)
        }
        return replace(self, **parts)

    def bandwidth(
        self, *, drop_dB: float = HALF_POWER_DB, passband_gain: float | None = None
    ) -> Bandwidth:
        """Lowest frequency at which the gain has fallen by some dB; None outside the data."""
        f = self.frequency_Hz
        start = float(self.gain[0]) if passband_gain is None else passband_gain
        words = f"gain at {f[0]:.3g} Hz" if passband_gain is None else "given gain"
        relative = self.gain_dB - 20 * math.log10(start)
        below = relative < -drop_dB
        peak = int(np.argmax(relative))
        found: float | None = None
        returns = False
        if below.any():
            k = int(np.argmax(below))
            returns = bool((~below[k:]).any())
            found = _between(f, relative + drop_dB, k - 1) if k > 0 else float(f[k])
        return Bandwidth(
            *(found, start, words, drop_dB), *(float(relative[peak]), float(f[peak]), returns)
        )

    def open_loop(self) -> FrequencyResponse:
        """Open loop L = T / (1 - T) of a closed loop with unit feedback."""
        sigma = None if self.sigma is None else self.sigma / np.abs(1 - self.response)
        return replace(self, response=self.response / (1 - self.response), sigma=sigma)

    def margins(self) -> Margins:
        """Margins, with this response taken as an open loop under negative unit feedback."""
        f, gain, phase = self.frequency_Hz, self.gain_dB, self.phase_deg
        level = np.log10(f)
        phases: list[tuple[float, float]] = []
        for k in np.flatnonzero(np.diff(np.signbit(gain))):
            crossing = _between(f, gain, int(k))
            angle = float(np.interp(math.log10(crossing), level, phase))
            phases.append(((angle + 360.0) % 360.0 - 180.0, crossing))
        gains: list[tuple[float, float]] = []
        turns = np.floor((phase + 180.0) / 360.0)
        for k in np.flatnonzero(np.diff(turns)):
            line = 360.0 * max(turns[k], turns[k + 1]) - 180.0
            crossing = _between(f, phase - line, int(k))
            gains.append((-float(np.interp(math.log10(crossing), level, gain)), crossing))
        worst_phase: Crossing = min(phases, key=lambda p: abs(p[0]), default=(None, None))
        worst_gain: Crossing = min(gains, key=lambda g: abs(g[0]), default=(None, None))
        delays = [p / 360.0 / at for p, at in phases if p > 0]
        return Margins(
            *worst_gain,
            *worst_phase,
            min(delays, default=None),
            float(np.min(np.abs(1 + self.response))),
        )

    def to_dict(self) -> dict[str, Any]:
        content = {k: getattr(self, k) for k in ("method", "frequency_Hz", "gain", "phase_deg")}
        found: dict[str, Any] = plain(
            content | {"coherence": self.coherence, "sigma": self.sigma}, null=True
        )
        return found

    def table(self, rows: int = 12) -> list[str]:
        wanted = np.geomspace(max(self.frequency_Hz[0], 1e-9), self.frequency_Hz[-1], rows)
        picked = sorted({int(np.argmin(np.abs(self.frequency_Hz - w))) for w in wanted})
        lines = [f"{self.method}", f"{'Hz':>10}{'gain dB':>10}{'phase deg':>11}{'coherence':>11}"]
        for k in picked:
            c = "" if self.coherence is None else f"{self.coherence[k]:11.3f}"
            gain, phase = self.gain_dB[k], self.phase_deg[k]
            lines.append(f"{self.frequency_Hz[k]:10.3g}{gain:10.2f}{phase:11.1f}{c}")
        return lines


def _between(f: Array, value: Array, k: int) -> float:
    """Frequency of a sign change between points k and k + 1, over the logarithm of frequency."""
    share = value[k] / (value[k] - value[k + 1]) if value[k] != value[k + 1] else 0.5
    return float(f[k] * (f[k + 1] / f[k]) ** share)


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
        """From the response of the torque on the moved side to its angle: a spring pulls back."""
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
        # Relative to the gain; scaled by the highest frequency, so that columns are of like size.
        top = float(w[-1])
        columns = np.stack([-((w / top) ** 2), 1j * w / top, np.ones_like(w)], axis=1)
        columns = columns / used.gain[:, None]
        relative = used.response / used.gain
        base = np.concatenate([columns.real, columns.imag])
        wanted = np.concatenate([relative.real, relative.imag])
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
        above = f", above {GOOD_FIT:g}: not one mass, damper and spring"
        poor = above if fit.misfit > GOOD_FIT else ""
        return [
            *self.angle.table(rows),
            f"fit from {fit.low_Hz:.3g} to {fit.high_Hz:.3g} Hz, torque needed for the motion:",
            f"inertia {fit.inertia_kgm2:.4g} +- {fit.inertia_std:.2g} kg m2",
            f"damping {fit.damping_Nms_rad:.4g} +- {fit.damping_std:.2g} Nms/rad",
            f"stiffness {fit.stiffness_Nm_rad:.4g} +- {fit.stiffness_std:.2g} Nm/rad",
            f"relative misfit {fit.misfit:.2g}{poor}",
        ]
