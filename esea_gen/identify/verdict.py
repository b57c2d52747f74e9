"""What the device's C makes of recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from esea_gen.device import Device
from esea_gen.hostlib.library import compile_system
from esea_gen.identify.misfit import Misfits
from esea_gen.identify.recorded import Recording
from esea_gen.identify.recording import resample
from esea_gen.language.ports import Array
from esea_gen.model.sensing import sensing_system


@dataclass(frozen=True)
class Verdict:
    """What the device's C makes of the recordings.

    Parameters
    ----------
    misfits : Misfits
        Torque errors of every data set, in training and held out.
    torque_Nm, omega_rad_s : dict of str to ndarray
        Model torque and rate of the deflection at the samples of each recording.
    largest_rate_Nm : float
        Largest |torque| of the Maxwell element.
    """

    misfits: Misfits
    torque_Nm: dict[str, Array]
    omega_rad_s: dict[str, Array]
    largest_rate_Nm: float


def judge(device: Device, recordings: Iterable[Recording]) -> Verdict:
    """Run the device's C over recordings and compare at their own samples.

    The sensor is given the deflection as it was recorded, as in the fit: it does not come in
    counts of the device's encoders, and is not smoothed.

    Parameters
    ----------
    device : Device
        What is judged: its velocity estimate and torque sensor, at its own rate.
    recordings : iterable of Recording
        Data; the deflection is interpolated linearly to the device's rate.

    Returns
    -------
    Verdict
        Errors by data set, model torque by recording.
    """
    system = sensing_system(device, device.velocity, device.sensor, counts=False)
    task = compile_system(system, "f64").task("sense")
    errors, largest = [], 0.0
    torque: dict[str, Array] = {}
    omega: dict[str, Array] = {}
    for r in recordings:
        grid = np.arange(math.ceil(r.time_s[-1] / device.period_s) + 1) * device.period_s
        task.reset()
        out, _ = task.run({"theta_rad": resample(r.time_s, r.theta_rad, grid)}, trace=False)
        for found, port in ((torque, "tau_Nm"), (omega, "omega_rad_s")):
            found[r.label] = resample(grid, np.asarray(out[port], dtype=np.float64), r.time_s)
        model = torque[r.label]
        largest = max(largest, float(np.abs(out["tau_rate_Nm"]).max()))
        errors.append((r, model - r.tau_Nm))
    return Verdict(Misfits.of("Nm", errors), torque, omega, largest)
