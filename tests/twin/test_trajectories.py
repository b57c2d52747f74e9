"""Paths and torques of the standard trajectories, in closed form with their numbers typed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.twin.trajectories import (
    RATE_HZ,
    backdriven,
    bread,
    fixed_output,
    fixed_sinusoid,
    impedance,
    tuning,
)

TURN = 2 * math.pi


def at(path, t_s: float) -> tuple[float, float, float]:
    k = round(1000 * t_s)
    return path.theta_p_rad[k], path.omega_p_rad_s[k], path.alpha_p_rad_s2[k]


def almost(*numbers: float):
    return pytest.approx(numbers, rel=1e-9, abs=1e-12)


def test_a_slow_sinusoid_from_full_extension():
    path, w = backdriven(0.15, -1.3), TURN * 0.15
    assert (path.name, path.clamped) == ("backdriven at 0.15 Hz", False)
    assert (path.start, path.end, len(path.theta_p_rad)) == (10_000, 45_000, 45_000)
    assert path.window == slice(10_000, 45_000)
    assert set(path.tau_desired_Nm) == {-1.3}
    a = math.pi / 4
    for t in (0.0, 0.7, 3.25, 44.999):
        angle = w * t
        expected = a * (1 - math.cos(angle)), a * w * math.sin(angle), a * w * w * math.cos(angle)
        assert at(path, t) == almost(*expected)
    assert set(backdriven(0.1).tau_desired_Nm) == {0.0}
    assert path.start_rad == 0.0


def test_a_rise_and_then_slices_that_fade_in():
    path, w = bread(0.4), TURN * 0.9
    assert (path.name, path.clamped) == ("bread cutting", False)
    assert (path.start, path.end, len(path.theta_p_rad)) == (10_000, 25_000, 25_000)
    assert set(path.tau_desired_Nm) == {0.4}
    assert set(bread().tau_desired_Nm) == {0.0}
    for t in (0.0, 0.6, 1.5, 2.7, 2.999):
        # 1.05 rad times s^2 (3 - 2 s), s = t / 3.
        s = t / 3
        expected = 3 * s**2 - 2 * s**3, (6 * s - 6 * s**2) / 3, (6 - 12 * s) / 9
        assert at(path, t) == almost(*(1.05 * x for x in expected))
    for t in (3.0, 3.1, 3.77, 9.0):
        # Slices a (1 - exp(-t / 0.5)) sin(w t), as the imaginary part of exponentials.
        late = t - 3
        one, two = 1j * w, 1j * w - 2
        terms = [(0.26 * np.exp(one * late), one), (-0.26 * np.exp(two * late), two)]
        slices = [sum(x * p**k for x, p in terms).imag for k in range(3)]
        assert at(path, t) == almost(1.05 + slices[0], slices[1], slices[2])


def test_reaching_there_and_back_with_least_jerk():
    path = impedance(0.7)
    assert (path.name, path.clamped) == ("reaching", False)
    assert (path.start, path.end, len(path.theta_p_rad)) == (12_000, 32_000, 40_000)
    assert set(path.tau_desired_Nm) == {0.7}
    assert set(impedance().tau_desired_Nm) == {0.0}
    way = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    reach = math.pi / 2
    for t in (0.0, 0.5, 1.3, 1.999, 2.0, 2.6, 3.999, 4.0, 5.1, 6.4, 38.2):
        back, s = divmod(t % 4 / 2, 1)
        sign = -1 if back else 1
        theta = reach * (1 - way(s) if back else way(s))
        rates = [sign * reach * way.deriv(k)(s) / 2**k for k in (1, 2)]
        assert at(path, t) == pytest.approx((theta, *rates), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("hertz", "cycles", "settle"), [(0.4, 8, 4), (0.499, 8, 4), (0.5, 22, 10), (2.0, 22, 10)]
)
def test_a_sinusoid_with_the_output_fixed(hertz, cycles, settle):
    path = fixed_sinusoid(-1.2, hertz)
    assert path.name == f"fixed output, -1.2 Nm at {hertz:g} Hz"
    assert path.clamped
    n = round(1000 * cycles / hertz)
    assert (path.start, path.end) == (round(1000 * settle / hertz), n)
    wanted = -1.2 * np.sin(TURN * hertz * np.arange(n) / 1000)
    np.testing.assert_allclose(path.tau_desired_Nm, wanted, atol=1e-10)
    for rest in (path.theta_p_rad, path.omega_p_rad_s, path.alpha_p_rad_s2):
        assert rest.tolist() == [0.0] * n


def test_the_tuning_case_and_any_torque():
    path = tuning()
    assert path.name == "fixed output, 1.7 Nm at 0.6 Hz"
    assert path.tau_desired_Nm[100] == pytest.approx(1.7 * math.sin(TURN * 0.06))
    own = fixed_output("mine", np.array([1.0, -2.0, 3.0, 0.5]), 2)
    assert (own.name, own.start, own.end, own.clamped) == ("mine", 2, 4, True)
    assert own.tau_desired_Nm[own.window].tolist() == [3.0, 0.5]
    assert own.theta_p_rad.tolist() == [0.0] * 4
    assert RATE_HZ == 1000


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
