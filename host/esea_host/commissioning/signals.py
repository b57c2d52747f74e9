"""Recordings as the terms of (5.1) and (5.2), all through one filter that delays nothing.

Speed and acceleration come from the motor's encoder, the torque on the gear from the rubber's model
fed with both joint encoders.  Every term of an equation goes through the same symmetric filter, so
the equation still holds afterwards, and what was one count of noise is smooth.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from esea_gen.device import Device
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.language.ports import Array
from esea_gen.language.system import System, Task
from esea_host.commissioning.startup import DriveRecording

FILTER_S, RUBBER_S = 0.042, 0.024  # widths of the Hann windows
SLOW_RAD_S = 0.1  # below, friction is neither Coulomb's full value nor known to be less
EVERY_S, BLOCK_S = 0.005, 0.5  # samples that are used; blocks for the intervals


def _window(width_s: float, tick_s: float) -> Array:
    n = 2 * max(round(0.5 * width_s / tick_s), 1) + 1
    w = np.hanning(n + 2)[1:-1]
    return np.asarray(w / w.sum())


@lru_cache(maxsize=4)
def _rubber(device: Device) -> HostLibrary:
    sensor = device.sensor
    system = System(
        "rubber",
        sensor.period_s,
        {"sensor": sensor},
        (Task("sense", ("sensor",)),),
        {},
        {p.name: (f"sensor.{p.name}",) for p in sensor.inputs},
        {p.name: f"sensor.{p.name}" for p in sensor.outputs},
    )
    return compile_system(system, "f64")


def rubber_torque_Nm(device: Device, deflection_rad: Array, tick_s: float) -> Array:
    """Torque of the rubber by the device's own sensor, from a quantised deflection."""
    w = _window(RUBBER_S, tick_s)
    half = len(w) // 2
    padded = np.pad(deflection_rad, half, mode="edge")
    smooth = np.convolve(padded, w, "valid")
    limit = device.file.limits.theta_rad.value
    inputs = {
        "theta_rad": np.clip(smooth, -limit, limit),
        "omega_rad_s": np.gradient(smooth, tick_s),
    }
    found, _ = _rubber(device).task("sense").run(inputs, trace=False)
    return np.asarray(found["tau_Nm"])


def motor_torque(u_Nm: Array, lag_s: float, delay_s: float, tick_s: float) -> Array:
    """Torque of the motor at every tick, by (5.1), from commands that are held for a tick."""
    from scipy.signal import lfilter

    decay = math.exp(-tick_s / lag_s)
    at_ticks = lfilter([0, 1 - decay], [1, -decay], u_Nm)
    whole = math.floor(delay_s / tick_s)
    part = delay_s - whole * tick_s
    shift = max(whole + 1, 0)
    held = np.concatenate([np.zeros(shift), u_Nm])[: len(u_Nm)]
    begun = np.concatenate([np.zeros(shift), at_ticks])[: len(u_Nm)]
    return np.asarray(held + (begun - held) * math.exp(-(tick_s - part) / lag_s))


class Signals:
    """One recording, ready for regression."""

    def __init__(self, device: Device, recording: DriveRecording, rest_rad: float) -> None:
        r, h = recording, recording.tick_s
        self.tick_s = h
        self.u_Nm, self.gear_rad = r.u_Nm, r.gear_rad
        self.motor_rad, self.load_rad = r.motor_rad, r.load_rad
        self.omega_rad_s = np.gradient(r.gear_rad, h)
        self.alpha_rad_s2 = np.zeros_like(r.gear_rad)
        self.alpha_rad_s2[1:-1] = np.diff(r.gear_rad, 2) / h**2
        self.rubber_Nm = rubber_torque_Nm(device, r.motor_rad - r.load_rad - rest_rad, h)
        a = device.file.actuator
        assert a is not None
        self._n = a.gear_ratio.value
        self._w = _window(FILTER_S, h)
        rate = self.filtered(self.omega_rad_s)
        self.way = np.where(rate < 0, -1.0, 1.0)
        half = len(self._w)
        near = np.convolve(np.abs(rate) < SLOW_RAD_S, np.ones(2 * half + 1), "same") > 0
        used = np.zeros(len(rate), dtype=bool)
        used[half : -half : round(EVERY_S / h)] = True
        self.used = np.flatnonzero(used & ~near)
        self.blocks = (self.used * h / BLOCK_S).astype(int)

    def filtered(self, x: Array) -> Array:
        """A term through the filter, at every tick; of shape (n,) or (n, columns)."""
        from scipy.signal import fftconvolve

        w = self._w if x.ndim == 1 else self._w[:, None]
        return np.asarray(fftconvolve(x, w, "same", axes=0))

    def term(self, x: Array) -> Array:
        """A term through the filter, at the samples that are used."""
        return np.asarray(self.filtered(x)[self.used])

    def motor_Nm(self, lag_s: float, delay_s: float) -> Array:
        """What the commanded torque is at the joint, at every tick."""
        return self._n * motor_torque(self.u_Nm, lag_s, delay_s, self.tick_s)

    def drive_Nm(self, lag_s: float, delay_s: float) -> Array:
        """The same through the filter, at the samples that are used."""
        return self.term(self.motor_Nm(lag_s, delay_s))

    def cable_Nm(self, loss: float) -> Array:
        """Torque of the cable on the gear, before the filter: the rubber's and what is lost."""
        return self.rubber_Nm + loss * self.way * np.abs(self.rubber_Nm)
