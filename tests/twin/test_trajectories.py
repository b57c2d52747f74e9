"""Standard trajectories: rates are the derivatives of the path, and bad numbers are refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.twin.trajectories import RATE_HZ, backdriven, bread, fixed_sinusoid, impedance


@pytest.mark.parametrize(
    "path", [backdriven(0.15), bread(0.4), impedance(0.7)], ids=lambda p: p.name
)
def test_rate_and_acceleration_are_the_derivatives_of_the_path(path):
    for x, rate in (
        (path.theta_p_rad, path.omega_p_rad_s),
        (path.omega_p_rad_s, path.alpha_p_rad_s2),
    ):
        error = np.abs(np.gradient(x, 1 / RATE_HZ) - rate)[1:-1]
        assert np.quantile(error, 0.99) < 2e-4 * np.ptp(rate)  # but where a part ends


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_torques_that_are_none_are_refused(bad):
    for make in (bread, impedance, lambda x: backdriven(0.1, x)):
        with pytest.raises(UserError, match=f"tau_Nm = {bad} is not a number.*\n?.*finite"):
            make(bad)
    with pytest.raises(UserError, match=f"amplitude_Nm = {bad} is not a number"):
        fixed_sinusoid(bad, 1.0)
    for make in (backdriven, lambda x: fixed_sinusoid(1.0, x)):
        for hertz in (bad, 0.0, -0.5):
            with pytest.raises(UserError, match=f"frequency_Hz = {hertz} is not above 0"):
                make(hertz)
    assert fixed_sinusoid(0.0, 1.0).tau_desired_Nm.max() == 0
    with pytest.raises(UserError, match="samples -1 to "):
        replace(fixed_sinusoid(1.0, 1.0), start=-1)
