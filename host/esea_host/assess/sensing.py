"""What the passive knee sensor says of a torque: its own emitted C, twist by twist.

The coupling twists as the exact inverse of the model says (its play is crossed at once), both
encoders count whole steps, and the device's C makes a torque of that.  How far the model is from a
real coupling comes on top: 3.82 % of full scale, as published for one minute of free motion.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from esea_gen.device import Device, load_device
from esea_gen.hostlib.library import compile_device, compile_system
from esea_gen.hostlib.runner import CRunner
from esea_gen.model.inverse import exact_inverse, inverse_system
from esea_host.assess.patients import Array
from esea_host.assess.responses import SENSOR_ERROR_NM

MODEL_ERROR_S = 1.0  # how long it stays, assumed


class KneeSensor:
    """The passive knee sensor, compiled once; encoders start anywhere in a step."""

    def __init__(self, device: Device) -> None:
        self.device = device
        block = exact_inverse(device)
        self._coupling: CRunner = compile_system(inverse_system(device, block), "f64").block(
            block.name
        )
        self._sense: CRunner = compile_device(device, "f32").task("sense")
        self.rate_Hz = 1.0 / device.period_s
        self.count_rad = 2 * np.pi / 2**device.file.encoder.resolution_bits.value
        self.error_Nm = SENSOR_ERROR_NM

    def read(self, time_s: Array, torque_Nm: Array, angle_rad: Array, seed: list[int]) -> Array:
        """Torque as read, at the times given.

        torque_Nm, angle_rad: true torque through the coupling and angle of the joint.
        """
        rng = np.random.default_rng(seed)
        t = np.arange(time_s[0], time_s[-1], self.device.period_s)
        error = self._error(len(t), rng)
        self._coupling.reset()
        twist, _ = self._coupling.run(
            {"tau_Nm": np.interp(t, time_s, torque_Nm) + error}, trace=False
        )
        load = np.interp(t, time_s, angle_rad) + rng.uniform(0, 2 * np.pi)
        # Zeroed when put on: only the change counts.
        motor = load + twist["theta_rad"] + rng.uniform(0, self.count_rad)
        counts = np.floor(motor / self.count_rad) - np.floor(load / self.count_rad)
        self._sense.reset()
        out, _ = self._sense.run({"theta_rad": counts * self.count_rad}, trace=False)
        return np.interp(time_s, t, np.asarray(out["tau_Nm"], dtype=np.float64))

    def _error(self, steps: int, rng: np.random.Generator) -> Array:
        from scipy.signal import lfilter

        keep = float(np.exp(-self.device.period_s / MODEL_ERROR_S))
        start = rng.normal(0, self.error_Nm)
        new = rng.normal(0, self.error_Nm * np.sqrt(1 - keep**2), steps)
        return np.asarray(lfilter([1.0], [1.0, -keep], new, zi=[keep * start])[0])


@cache
def knee_sensor() -> KneeSensor:
    """The shipped device ``knee``."""
    return KneeSensor(load_device("knee"))
