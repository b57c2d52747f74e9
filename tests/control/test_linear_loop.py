"""Linear loop inside the boundary layer: predictions and rejected gains."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import signal

from esea_gen.control.sliding_mode import controller as law
from esea_gen.control.sliding_mode.linear_loop import LEAST_DAMPING, least_damped, low_pass
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.observe.disturbance import drive_observer
from esea_gen.observe.rates import motor_rate
from tests.own_device import own_device

H, EVERY = 1e-3, 5


def variant(**changes: float) -> Device:
    """The shipped drive with other numbers, ``section__key``."""
    sections: dict[str, dict[str, float]] = {}
    for key, value in changes.items():
        section, _, name = key.partition("__")
        sections.setdefault(section, {})[name] = value
    return own_device(**sections)


def free_response(device: Device, stiffness: float, seconds: float) -> np.ndarray:
    """Motor side's angle at the control task's runs: the Blocks themselves against a drive."""
    a = device.file.actuator
    assert a is not None
    j, n, lag, fv = (x.value for x in (a.J_kgm2, a.gear_ratio, a.tau_c_s, a.fv_Nms_rad))
    f = np.array([[0, 1, 0], [-stiffness / j, -fv / j, n / j], [0, 0, -1 / lag]])
    plant = signal.cont2discrete(
        (f, np.array([[0], [0], [1 / lag]]), np.eye(3), np.zeros((3, 1))), H
    )[:2]
    rate, observer = motor_rate(device).simulator(), drive_observer(device).simulator()
    control = law.sliding_mode(device).simulator()
    x = np.array([[1e-4], [0.0], [0.0]])
    read: dict[str, float] = {}
    now = pending = 0.0
    found = []
    for k in range(round(seconds / H)):
        if k % EVERY == 0 and read:
            y = control.step(
                delta_set_rad=0.0,
                delta_rate_rad_s=0.0,
                delta_acc_rad_s2=0.0,
                omega_load_rad_s=0.0,
                tau_h_Nm=-read["tau_Nm"],
                mode=1.0,
                u_applied_Nm=now,
                **read,
            )
            pending = y["u_command_Nm"]
            found.append(x[0, 0])
        if k % EVERY == 1:
            now = pending
        theta = float(x[0, 0])
        omega = rate.step(theta_rad=theta)["omega_rad_s"]
        seen = observer.step(u_Nm=now, omega_motor_rad_s=omega, tau_Nm=stiffness * theta)
        read = {
            "theta_rad": theta,
            "omega_motor_rad_s": omega,
            "tau_Nm": stiffness * theta,
            "d4_rad_s2": seen["d4_rad_s2"],
            "u_a_Nm": seen["u_a_Nm"],
        }
        x = plant[0] @ x + plant[1] * now
    return np.array(found)


def slowest_swing(response: np.ndarray, period_s: float) -> tuple[float, float]:
    """Damping and frequency of what is left of a response, by linear prediction of its tail."""
    tail = response[len(response) // 2 :]
    tail = tail / np.max(np.abs(tail))
    order = 6
    rows = np.lib.stride_tricks.sliding_window_view(tail, order + 1)
    a = np.linalg.lstsq(rows[:, :order], rows[:, order], rcond=1e-9)[0]
    poles = np.roots([1.0, *(-a[::-1])])
    s = np.log(poles[np.abs(poles) > 0.5].astype(complex)) / period_s
    swings = s[np.abs(s.imag) > 2 * np.pi * 2]
    best = swings[np.argmax(swings.real)]
    return float(-best.real / np.abs(best)), float(np.abs(best) / (2 * np.pi))


@pytest.mark.parametrize("slope", [13.0, 18.0, 21.0, 24.0])
def test_the_blocks_themselves_swing_as_predicted(monkeypatch, slope):
    # No Coulomb friction and no doubt of the inertia: then nothing in the layer is nonlinear.
    monkeypatch.setattr(law, "check_loop", lambda *_: None)
    device = variant(
        actuator__fc_Nm=0.0, sliding_mode__J_unc_kgm2=0.0, sliding_mode__lambda_1_s=slope
    )
    stiffness = device.file.elastomer.k1_Nm_rad.value
    predicted = least_damped(device, law.LEAD)
    response = free_response(device, stiffness, 1.6)
    assert np.max(np.abs(response)) < 2e-3  # inside the layer and below the motor's limit
    damping, frequency = slowest_swing(response, H * EVERY)
    assert frequency == pytest.approx(predicted.frequency_Hz, rel=0.05)
    assert damping == pytest.approx(predicted.damping, abs=0.01)


SWINGING = [
    {"sliding_mode__lambda_1_s": 24.9},
    {"actuator__tau_c_s": 0.2},
    {"actuator__tau_c_s": 1.0},
    {"sliding_mode__J_unc_kgm2": 2.0},
    {"sliding_mode__J_unc_kgm2": 5.0},
    {"joint__motor_velocity_Hz": 15.0},
    {"joint__motor_velocity_Hz": 5.0, "disturbance__drive_1_s": 2.0},
]


@pytest.mark.parametrize("changes", SWINGING)
def test_what_swings_is_refused_and_the_fix_is_taken(changes):
    # Each of these tripped the drive, latched a fault or stood at the limit in the tuning case.
    with pytest.raises(UserError, match=r"a swing (grows|hardly dies away)") as refused:
        law.sliding_mode(variant(**changes))
    text = str(refused.value)
    assert f"below {LEAST_DAMPING:g}" in text
    named = re.search(r"lambda_1_s from [0-9.]+ to ([0-9.]+) 1/s", text)
    assert named
    law.sliding_mode(variant(**(changes | {"sliding_mode__lambda_1_s": float(named[1])})))


@pytest.mark.parametrize(("cutoff_Hz", "h"), [(30.0, 1e-3), (10.0, 5e-3), (60.0, 1e-3)])
def test_the_filter_of_the_rates_is_scipys(cutoff_Hz, h):
    expected = signal.tf2ss(*signal.butter(4, cutoff_Hz, fs=1 / h))
    for found, known in zip(low_pass(cutoff_Hz, h), expected, strict=True):
        np.testing.assert_allclose(found, known, atol=1e-13)
