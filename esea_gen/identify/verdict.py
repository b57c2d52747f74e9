"""What the device's C makes of recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.identify.recording.misfit import Misfits
from esea_gen.identify.recording.reading import resample
from esea_gen.identify.recording.recorded import Recording
from esea_gen.language.ports import Array
from esea_gen.language.system import System
from esea_gen.model.family_sensor import TEMPERATURE
from esea_gen.model.sensing import sensing_system


@dataclass(frozen=True)
class Verdict:
    """What the device's C makes of the recordings."""

    misfits: Misfits
    torque_Nm: dict[str, Array]
    omega_rad_s: dict[str, Array]
    largest_rate_Nm: float


def temperature_tunables(
    device: Device, system: System, recording: Recording
) -> dict[str, dict[str, float]]:
    """What a recording's temperature sets in a System, by instance."""
    known = [(i, t) for i, t in system.tunables if t.name == TEMPERATURE]
    wanted = recording.temperature_C
    if wanted is None or not known:
        return {}
    for _, t in known:
        if not t.low <= t.taken(wanted) <= t.high:
            raise UserError(
                f"{recording.label}: was recorded at {wanted:g} degC, outside {t.low:g} to "
                f"{t.high:g} degC, in which {device.origin}'s [family.temperature] holds.",
                "Leave it out, or identify with a recording at that temperature.",
            )
    return {i: {t.name: t.taken(wanted)} for i, t in known}


def judge(device: Device, recordings: Iterable[Recording]) -> Verdict:
    """Run the device's C over recordings and compare at their own samples.

    The sensor is given the deflection as it was recorded, as in the fit: it does not come in
    counts of the device's encoders, and is not smoothed.
    """
    system = sensing_system(device, device.velocity, device.sensor, counts=False)
    task = compile_system(system, "f64").task("sense")
    errors, largest = [], 0.0
    torque: dict[str, Array] = {}
    omega: dict[str, Array] = {}
    for r in recordings:
        grid = np.arange(math.ceil(r.time_s[-1] / device.period_s) + 1) * device.period_s
        task.prepare(temperature_tunables(device, system, r))
        out, _ = task.run({"theta_rad": resample(r.time_s, r.theta_rad, grid)}, trace=False)
        for found, port in ((torque, "tau_Nm"), (omega, "omega_rad_s")):
            found[r.label] = resample(grid, np.asarray(out[port], dtype=np.float64), r.time_s)
        model = torque[r.label]
        largest = max(largest, float(np.abs(out["tau_rate_Nm"]).max()))
        errors.append((r, model - r.tau_Nm))
    return Verdict(Misfits.of("Nm", errors), torque, omega, largest)
