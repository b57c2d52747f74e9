"""A simulator's run: input and output as arrays by port, a table, one array."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from esea_gen.device import load_device


def test_three_forms_of_one_stream_give_the_same_numbers():
    elbow = load_device("elbow")
    t = np.linspace(0, 1, 50)
    given = pd.DataFrame({"theta_rad": 0.1 * np.sin(6 * t), "omega_rad_s": 0.6 * np.cos(6 * t)}, t)
    table, states = elbow.sensor.simulator().run(given)
    ports, _ = elbow.sensor.simulator().run(dict(given.items()))
    array, _ = elbow.sensor.simulator().run(given.to_numpy())
    assert np.array_equal(table.to_numpy(), array)
    assert np.array_equal(table["tau_Nm"], ports["tau_Nm"])
    assert np.array_equal(table.index, t)
    assert len(states) == 50


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"theta_rad": [0.0]}, r"no omega_rad_s; it takes \['theta_rad', 'omega_rad_s'\]"),
        ({"theta_rad": [0.0], "omega_rad_s": [0.0, 0.0]}, "different lengths"),
        (np.zeros((2, 5)), r"shape \(2, 5\), and its inputs are 2 columns: theta_rad"),
    ],
)
def test_a_stream_that_does_not_fit_is_refused(given, words):
    with pytest.raises(ValueError, match=words):
        load_device("elbow").sensor.simulator().run(given)
    assert "1000 Hz: theta_rad, omega_rad_s -> tau_Nm" in repr(
        load_device("elbow").sensor.simulator()
    )
    assert repr(load_device("elbow_drive")).startswith("<Device elbow_drive (drive), Elbow")
