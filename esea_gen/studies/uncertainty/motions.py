"""Inputs of the Monte Carlo: motions, encoders, spread of the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.device import Device, with_numbers
from esea_gen.errors import UserError
from esea_gen.hostlib.library import CRunner, compile_block, compile_device, compile_system
from esea_gen.identify.published.plant import ROWS_REFINE, FittedPlant, tunable_system, uncertainty
from esea_gen.identify.published.space import at_bound, bounds_of
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.identify.verdict import RATE_EDGES, TORQUE_EDGES
from esea_gen.language.ports import Array
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.sensing import sensing_system
from esea_gen.observe import torque_scale
from esea_gen.tables import MARK

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
    dense = max(1, round(FINE_HZ * device.period_s))
    finer = with_numbers(device, {SENSE_RATE: dense / device.period_s})
    sensing = sensing_system(device, device.velocity, device.sensor)
    return Programs(
        compile_block(exact_inverse(device)),
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
    size = torque_scale(device)
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


ASSUMED_SHARE = 0.05
WEAK = 0.5  # relative spread of a direction that the data do not determine is held to this


@dataclass(frozen=True)
class Spread:
    """How the rubber's parameters may lie round the device file's."""

    keys: tuple[str, ...]
    root: Array
    origin: str
    band_Nm: float | None = None

    @property
    def sigma(self) -> dict[str, float]:
        size = np.sqrt(np.sum(self.root**2, axis=1))
        return {k: float(s) for k, s in zip(self.keys, size, strict=True)}

    def draw(self, device: Device, rng: np.random.Generator) -> tuple[dict[str, float], int]:
        values = elastomer_values(device)
        factor = np.exp(self.root @ rng.standard_normal(self.root.shape[1]))
        clipped = 0
        for key, f in zip(self.keys, factor, strict=True):
            low, high = bounds_of(key)
            value = float(values[key] * f)
            values[key] = min(max(value, low), high)
            clipped += values[key] != value
        return values, clipped


def elastomer_values(device: Device) -> dict[str, float]:
    """The published model's parameters; refused for a device with another."""
    assert device.elastomer
    known = {c.name: c.value for c in device.constants("elastomer")}
    return {k: known[k] for k in (*MODEL_KEYS, *RATE_KEYS) if k in known}


def assumed_spread(device: Device, share: float = ASSUMED_SHARE) -> Spread:
    """Every parameter on its own, by a stated share."""
    keys = tuple(k for k, v in elastomer_values(device).items() if v > 0 and k != "eps2")
    origin = f"assumed: {100 * share:g} % (standard deviation) of each parameter, independent"
    return Spread(keys, share * np.eye(len(keys)), origin)


def identified_spread(device: Device, mapping: Path, data: Path | None = None) -> Spread:
    """The covariance of an identification, recomputed from its recording."""
    source = load_mapping(mapping, data)
    if source.mapping.device.name != device.name:
        raise UserError(
            f"{source.origin}: the recording identified '{source.mapping.device.name}', not "
            f"'{device.name}': its covariance does not apply to this device.",
            "Give the identified device's file, or leave --recording out for an assumed spread.",
        )
    recordings = load_recordings(source)
    reach = max(float(np.abs(r.theta_rad).max()) for r in recordings)
    limit = device.file.limits.theta_rad.value
    if reach > limit:
        raise UserError(
            f"{source.origin}: a recorded deflection of {reach:.3g} rad is above {device.name}'s "
            f"limits.theta_rad = {limit:g} rad.",
            "Give the recording that the device was identified with.",
        )
    rate_terms = device.elastomer.maxwell is not None
    fine = device.file.timing.sense_rate_Hz.value
    plant = FittedPlant(device, recordings, fine if rate_terms else None, ROWS_REFINE)
    values = elastomer_values(device)
    found = uncertainty(plant, values)
    free = [k for k, v in values.items() if k != "eps2" and v > 0 and at_bound(k, v) is None]
    if found.resampled is None or not np.any(np.isfinite([found.sigma[k] or 0.0 for k in free])):
        raise UserError(
            f"{source.origin}: the torque depends on none of the parameters.",
            "Leave --recording out for an assumed spread.",
        )
    variances, v = np.linalg.eigh(found.resampled.covariance)
    # A direction without effect moves nowhere when blocks are left out: it is not known at all.
    dead = variances <= 1e-12 * variances.max()
    sigmas = np.where(dead, np.inf, np.sqrt(np.maximum(variances, 0.0)))
    spread = np.minimum(sigmas, WEAK)
    weak = int(np.sum(sigmas > WEAK))
    held = f"; {weak} directions that it does not determine held to {100 * WEAK:g} %" * (weak > 0)
    mark = MARK * any(f.kind == "simulated" for r in recordings for f in r.findings)
    origin = f"covariance of the identification by {source.origin}{held}{mark}"
    return Spread(tuple(free), v * spread, origin, found.resampled.band_Nm)
