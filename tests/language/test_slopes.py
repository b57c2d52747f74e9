"""Derivatives that a Block carries along beside its step, against differences."""

from __future__ import annotations

import numpy as np

from esea_gen.device import load_device
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.slopes import sloped


def test_slopes_of_the_torque_by_each_of_its_numbers():
    sensor = torque_sensor(load_device("elbow"), tunable=True)
    numbers = sensor.default_tunables()
    outputs = ("tau_Nm", "tau_rate_Nm", "tau_hysteresis_Nm")
    by = tuple(numbers)
    block = sloped(sensor, outputs, by)
    t = np.arange(60) / 60
    path = {"theta_rad": 0.15 * np.sin(7 * t) + 0.01, "omega_rad_s": 1.05 * np.cos(7 * t)}
    y, _ = block.simulator(numbers).run(path)
    shown = [p.name for p in sensor.outputs if p.name in outputs]
    found = np.asarray(y["slopes"]).reshape(len(t), len(outputs), len(by))
    for k, name in enumerate(by):
        step = 1e-5 * numbers[name]
        up, down = (
            sensor.simulator(numbers | {name: numbers[name] + d}).run(path)[0]
            for d in (step, -step)
        )
        for i, output in enumerate(outputs):
            rise = (up[output] - down[output]) / (2 * step)
            size = np.abs(rise).max()
            np.testing.assert_allclose(found[:, i, k], rise, rtol=1e-4, atol=1e-5 * size + 1e-9)
    assert shown == list(outputs)
