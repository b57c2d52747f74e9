"""The torque signals of table 4.3, and the filter that they were evaluated with."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.device import Device, with_numbers
from esea_gen.hostlib.library import CRunner, compile_device, compile_system
from esea_gen.identify.published.plant import tunable_system
from esea_gen.identify.verdict import RATE_EDGES, TORQUE_EDGES
from esea_gen.language.ports import Array
from esea_gen.model.inverse import exact_inverse, inverse_system
from esea_gen.model.sensing import sensing_system

TORQUES, RATES = len(TORQUE_EDGES) - 1, len(RATE_EDGES) - 1  # classes
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


ELBOW_FULL_SCALE_NM = 4.47  # the published signals are the elbow's; others' are scaled
CYCLE_S = 100.0  # the slow signals repeat after it
FINE_HZ = 10_000.0  # error of the fine step a hundredth of that at 1 kHz
CHUNK = 200_000
STRIDE = 5  # statistics look at every fifth sample; the C runs all of them
HARMONICS = 4


@dataclass(frozen=True)
class Motion:
    name: str
    theta_rad: Array
    omega_mid_rad_s: Array
    continuous_Nm: Array
    kept: Any
    cell: Any
    sign: Array


@dataclass(frozen=True)
class Programs:
    """Everything compiled for a device; each is reset before it is used."""

    inverse: CRunner
    fine: CRunner
    dense: int
    sensing: CRunner
    trial: CRunner


@cache
def compiled_programs(device: Device) -> Programs:
    block = exact_inverse(device)
    dense = max(1, round(FINE_HZ * device.period_s))
    finer = with_numbers(device, {SENSE_RATE: dense / device.period_s})
    sensing = sensing_system(device, device.velocity, device.sensor)
    return Programs(
        compile_system(inverse_system(device, block), "f64").block(block.name),
        compile_device(finer, "f64").block("sensor"),
        dense,
        compile_system(sensing, "f32").task("sense"),
        compile_system(tunable_system(device), "f64").block("sensor"),
    )


def motions(
    device: Device, limit_s: float = math.inf, say: Callable[[str], None] | None = None
) -> list[Motion]:
    """The published signals as motions: the exact inverse's set-point, filtered as published."""
    tell = say or (lambda _: None)
    h, rate_Hz = device.period_s, 1.0 / device.period_s
    size = device.tau_full_scale_Nm / ELBOW_FULL_SCALE_NM
    programs = compiled_programs(device)
    omega_max = device.file.domain.omega_max_rad_s.value
    out = []
    for i, signal in enumerate(SIGNALS):
        tell(f"motion {i + 1} of {len(SIGNALS)}")
        wanted = size * signal.sample(rate_Hz, min(limit_s, CYCLE_S if i < 2 else limit_s))
        programs.inverse.reset()
        y, _ = programs.inverse.run({"tau_Nm": wanted}, trace=False)
        t = np.arange(len(wanted)) * h
        path = scipy.interpolate.CubicSpline(
            t, evaluation_filter(np.asarray(y["theta_rad"]), rate_Hz)
        )
        torque = continuous_torque(programs.fine, path, len(t), programs.dense, h)
        omega = np.asarray(path(t - 0.5 * h, 1))
        omega[0] = 0.0
        ends = min(round(END_S * rate_Hz), len(t) // 4)
        kept = np.arange(ends, len(t) - ends, STRIDE)
        level = np.digitize(np.abs(torque[kept]) / device.tau_full_scale_Nm, TORQUE_EDGES) - 1
        speed = np.digitize(np.abs(path(t[kept], 1)) / omega_max, RATE_EDGES) - 1
        sign = np.where(torque[kept] < 0, -1.0, 1.0)
        theta = np.asarray(path(t))
        cell = level * RATES + speed
        out.append(Motion(f"S{i + 1}", theta, omega, torque, kept, cell, sign))
    return out


def continuous_torque(
    sensor: CRunner, path: scipy.interpolate.CubicSpline, steps: int, dense: int, h: float
) -> Array:
    # The sensor at a rate at which its step no longer matters, with the true rate.
    sensor.reset()
    out = np.empty(steps)
    fine = h / dense
    total = (steps - 1) * dense + 1
    for first in range(0, total, CHUNK):
        k = np.arange(first, min(first + CHUNK, total))
        omega = np.asarray(path((k - 0.5) * fine, 1))
        y, _ = sensor.run({"theta_rad": path(k * fine), "omega_rad_s": omega}, trace=False)
        at = np.flatnonzero(k % dense == 0)
        out[k[at] // dense] = y["tau_Nm"][at]
    return out


class Encoders:
    """Two encoders on a coupling whose load side moves; zeroed at the start, at rest."""

    def __init__(self, device: Device, residual_deg: float, rng: np.random.Generator) -> None:
        self.count = 2 * math.pi / 2**device.file.encoder.resolution_bits.value
        self.size = math.radians(residual_deg)
        self.start, self.phase = rng.uniform(0, 2 * math.pi, 2)
        self.harmonic = rng.integers(1, HARMONICS + 1, 2)
        self.offset = rng.uniform(0, 2 * math.pi, 2)
        self.h = device.period_s

    def read(self, theta_rad: Array, *, counts: bool, nonlinear: bool) -> Array:
        t = np.arange(len(theta_rad)) * self.h
        load = self.start + LOAD_RAD * np.cos(2 * math.pi * LOAD_HZ * t + self.phase)
        sides = [load + theta_rad, load]
        if nonlinear:
            for i in range(2):
                k, at = self.harmonic[i], sides[i]
                error = np.sin(k * at + self.offset[i]) - np.sin(k * load[0] + self.offset[i])
                sides[i] = at + self.size * error
        if counts:
            sides = [np.round(s / self.count) * self.count for s in sides]
        return np.asarray(sides[0] - sides[1])
