"""The torque signals of table 4.3, and the filter that they were evaluated with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_gen.language.ports import Array

SWEEP_HZ_S = 0.5 / 60
# Without this much at either end a signal is its interior: the filter reaches 0.9 s.
END_S = 1.0
PASS_HZ, STOP_HZ, ATTENUATION_DB = 10.0, 12.0, 60.0
# The load side moves while the coupling is loaded (assumed).
LOAD_RAD, LOAD_HZ = np.deg2rad(45.0), 0.2
SENSE_RATE = "timing.sense_rate_Hz"


@dataclass(frozen=True)
class TorqueSignal:
    amplitude_Nm: float
    start_Hz: float
    end_Hz: float
    duration_s: float

    def sample(self, rate_Hz: float, limit_s: float = np.inf) -> Array:
        steps = round(min(self.duration_s, limit_s) * rate_Hz)
        t = np.arange(steps) / rate_Hz
        sweep = (self.end_Hz - self.start_Hz) / self.duration_s
        phase = 2 * np.pi * (self.start_Hz + 0.5 * sweep * t) * t
        return self.amplitude_Nm * np.sin(phase)


def _sweep(amplitude_Nm: float, end_Hz: float) -> TorqueSignal:
    return TorqueSignal(amplitude_Nm, 0.0, end_Hz, end_Hz / SWEEP_HZ_S)


SIGNALS = (
    TorqueSignal(1.0, 0.01, 0.01, 300.0),
    TorqueSignal(4.5, 0.01, 0.01, 300.0),
    _sweep(0.75, 1.5),
    _sweep(3.0, 1.0),
    _sweep(4.0, 0.5),
)


def evaluation_filter(values: Array, rate_Hz: float) -> Array:
    """The zero-phase Kaiser low-pass of the evaluation, ends held at the last value."""
    from scipy.signal import fftconvolve, firwin, kaiserord

    count, beta = kaiserord(ATTENUATION_DB, 2 * (STOP_HZ - PASS_HZ) / rate_Hz)
    count |= 1
    taps = firwin(count, 0.5 * (PASS_HZ + STOP_HZ), window=("kaiser", beta), fs=rate_Hz)
    padded = np.pad(values, count // 2, mode="edge")
    return np.asarray(fftconvolve(padded, taps, "valid"))
