"""Delay, gain and noise of the velocity estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from esea_gen.language.ports import Array, Equation
from esea_gen.model.filters import BANDWIDTH_MAX_HZ, BANDWIDTH_MIN_HZ
from esea_gen.model.symbolic import equation

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

P, W = sp.symbols("p W", positive=True)
# Of the two outputs, with pole p and W = 2 pi f h: relative gain excess over W^2, phase lag over
# W^3 (of the middle of the step: beyond its own half step), and noise variance times h^2.  Series
# in W and residues at the pole, both by SymPy; tests/test_velocity.py has them another way.
EXCESS = (
    (11 * P**2 + 5 * P + 2) / (6 * (1 - P) ** 2),
    (23 * P**2 + 26 * P + 23) / (24 * (1 - P) ** 2),
)
LAG = ((1 + P) * (10 * P**2 + 5 * P + 1) / (4 * (1 - P) ** 3), (1 + P) ** 3 / (1 - P) ** 3)
NOISE = (
    (1 - P) ** 3 * (49 * P**2 + 50 * P + 13) / (2 * (1 + P) ** 5),
    14 * (1 - P) ** 3 / (1 + P) ** 3,
)


@dataclass(frozen=True)
class VelocityProperties:
    """What the velocity estimate does to a motion and to the encoders' noise.

    With ``mid`` everything here means ``omega_mid_rad_s``, else ``omega_rad_s``.

    bandwidth_Hz: bandwidth of the triple pole.
    period_s: sampling period h.

    With p = exp(-2 pi h bandwidth), q = 1 - p, b = 3/2 q^2 (1 + p), g = q^3, from deflection::

        omega      H(z) = z (z - 1) (b (z - 1) + g) / (h (z - p)^3)
        omega_mid  H(z) =   (z - 1) ((b + g/2) (z - 1) + g) / (h (z - p)^3)

    A constant rate and a constant acceleration leave no steady error: at low frequency the delay of
    ``omega`` is 0, that of ``omega_mid`` half a period (it is the rate in the middle of the step
    before the sample).  Both grow with the square of the frequency, as does the gain's excess.
    """

    bandwidth_Hz: float
    period_s: float

    @property
    def pole(self) -> float:
        """The triple pole p."""
        return math.exp(-2 * math.pi * self.period_s * self.bandwidth_Hz)

    @property
    def delay_s(self) -> float:
        """Delay of ``omega_rad_s`` at low frequency, phase and group delay alike."""
        return 0.0

    @property
    def mid_delay_s(self) -> float:
        """Delay of ``omega_mid_rad_s`` at low frequency."""
        return 0.5 * self.period_s

    def response(self, f_Hz: Any, mid: bool = False) -> Any:
        """Estimate over true rate, at frequencies."""
        s = 2j * np.pi * np.asarray(f_Hz) * self.period_s
        z, q = np.exp(s), 1 - self.pole
        b, g = 1.5 * q * q * (1 + self.pole), q**3
        slope = (b + g / 2) * (z - 1) + g if mid else z * (b * (z - 1) + g)
        return (z - 1) * slope / (z - self.pole) ** 3 / s

    def gain_at(self, f_Hz: float, mid: bool = False) -> float:
        """Relative gain at a frequency."""
        return float(np.abs(self.response(f_Hz, mid)))

    def delay_at_s(self, f_Hz: float, mid: bool = False) -> float:
        """Phase delay at a frequency."""
        return float(-np.angle(self.response(f_Hz, mid)) / (2 * np.pi * f_Hz))

    def gain_excess(self, f_Hz: float, mid: bool = False) -> float:
        """Closed form of the relative gain's excess at low frequency."""
        return self._value(EXCESS[mid]) * (2 * math.pi * f_Hz * self.period_s) ** 2

    def delay_growth_s(self, f_Hz: float, mid: bool = False) -> float:
        """Closed form of the delay that is added to the one at low frequency."""
        turn = 2 * math.pi * f_Hz * self.period_s
        return self._value(LAG[mid]) * turn**2 * self.period_s

    def _value(self, expression: sp.Expr) -> float:
        return float(expression.subs(P, self.pole))

    def noise_gain_1_s(self, mid: bool = False) -> float:
        """Standard deviation of the estimate over that of white noise on the deflection."""
        return math.sqrt(self._value(NOISE[mid])) / self.period_s

    def worst_gain_1_s(self, mid: bool = False) -> float:
        """Largest error of the estimate over the largest error of the deflection.

        The sum of the magnitudes of the impulse response: it holds for any error whatever, and so
        for quantisation that is far from white, as in slow motion.
        """
        return float(np.sum(np.abs(self.impulse_1_s(mid))))

    def impulse_1_s(self, mid: bool = False) -> Array:
        """Response to one sample of deflection of 1 rad."""
        p, q, h = self.pole, 1 - self.pole, self.period_s
        count = math.ceil(40 / (1 - p)) + 10
        b, g = 1.5 * q * q * (1 + p) / h, q**3 / h
        b = b + g / 2 if mid else b
        # (z - 1)(b (z - 1) + g) z^(0 or 1) over (z - p)^3: the third-order pole's own response,
        # C(k, 2) p^(k - 2), times the numerator's taps; the middle is one sample later.
        k = np.arange(count + 3)
        pole = 0.5 * k * (k - 1) * p ** np.maximum(k - 2.0, 0.0)
        taps = np.array([b, g - 2 * b, b - g])
        delay = 0 if mid else 1
        full = np.convolve(pole, taps)
        return np.asarray(full[delay + 1 : delay + 1 + count])

    @property
    def overshoot(self) -> float:
        """How far ``omega_rad_s`` overshoots when the rate jumps from 0, relative to the jump."""
        ramp = np.cumsum(np.cumsum(self.impulse_1_s())) * self.period_s
        return float(np.max(ramp) - 1)

    def bandwidth_3dB_Hz(self, mid: bool = False) -> float:
        """Highest frequency at which the relative gain is at least 1 over the square root of 2."""
        f = np.linspace(1e-4, 0.5, 20001) / self.period_s
        above = np.flatnonzero(np.abs(self.response(f, mid)) >= math.sqrt(0.5))
        return float(f[above[-1]])

    def noise_rad_s(self, bits: int, mid: bool = False, encoders: int = 2) -> float:
        """Standard deviation of the rate from quantisation, where the motion makes it white."""
        count = 2 * math.pi / (1 << bits)
        return count * math.sqrt(encoders / 12) * self.noise_gain_1_s(mid)

    def worst_rad_s(self, bits: int, mid: bool = False, encoders: int = 2) -> float:
        """Largest error of the rate from quantisation, whatever the motion."""
        return math.pi / (1 << bits) * encoders * self.worst_gain_1_s(mid)

    @property
    def equations(self) -> tuple[Equation, ...]:
        """What is stated, for reports; W is 2 pi f h."""
        h, f = sp.symbols("h f")
        lags = (LAG[0] * W**2 * h, h / 2 + LAG[1] * W**2 * h)
        return (
            equation("[obs 4]", "W", 2 * sp.pi * f * h, "frequency times period"),
            equation("[obs 5]", "D", lags[0], "delay of the rate at low frequency"),
            equation("[obs 6]", "D_m", lags[1], "delay of the rate in the middle of the step"),
            equation("[obs 7]", "G", 1 + EXCESS[0] * W**2, "gain of the rate at low frequency"),
            equation("[obs 8]", "N", sp.sqrt(NOISE[0]) / h, "noise gain of the rate"),
            equation("[obs 9]", "N_m", sp.sqrt(NOISE[1]) / h, "noise gain in the middle"),
        )

    def to_dict(self, bits: tuple[int, ...] = (12, 14), f_Hz: float = 1.5) -> dict[str, Any]:
        """JSON-ready content."""

        def of(mid: bool) -> dict[str, Any]:
            return {
                "delay_s": self.mid_delay_s if mid else self.delay_s,
                "f_Hz": f_Hz,
                "delay_at_f_s": self.delay_at_s(f_Hz, mid),
                "gain_at_f": self.gain_at(f_Hz, mid),
                "bandwidth_3dB_Hz": self.bandwidth_3dB_Hz(mid),
                "noise_gain_1_s": self.noise_gain_1_s(mid),
                "worst_gain_1_s": self.worst_gain_1_s(mid),
                "noise_rad_s": {str(b): self.noise_rad_s(b, mid) for b in bits},
                "worst_rad_s": {str(b): self.worst_rad_s(b, mid) for b in bits},
            }

        return {
            "bandwidth_Hz": self.bandwidth_Hz,
            "period_s": self.period_s,
            "overshoot": self.overshoot,
            "omega_rad_s": of(False),
            "omega_mid_rad_s": of(True),
        }


def velocity_properties(
    device: DeviceData, bandwidth_Hz: float | None = None
) -> VelocityProperties:
    """What a device's velocity estimate does to a motion and to noise."""
    chosen = device.file.velocity.bandwidth_Hz.value if bandwidth_Hz is None else bandwidth_Hz
    high = min(BANDWIDTH_MAX_HZ, 0.1 / device.period_s)
    if not BANDWIDTH_MIN_HZ <= chosen <= high * (1 + 1e-6):
        raise ValueError(f"bandwidth_Hz = {chosen} is outside [{BANDWIDTH_MIN_HZ}, {high}]")
    return VelocityProperties(float(chosen), device.period_s)
