"""One control period of the linear loop, typed a second time, and what is made of its modes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from esea_gen.control import linear_loop
from esea_gen.control.linear_loop import (
    LOOP_STATES,
    LoopPeriod,
    Mode,
    check_loop,
    least_damped,
    slope_range,
)
from esea_gen.errors import UserError

from .test_linear_loop import variant

H = 1e-3
J, N, FV, FC, LAG_S = 0.663, 74.0, 0.5551, 0.4688, 0.03488


def period_typed(x, lead, slope, k, *, seen_friction, every, release, more_inertia, phi):
    """(5.1), (5.2), (5.5), (5.12) to (5.22) inside the layer, tick by tick."""
    s = dict(zip(LOOP_STATES, x, strict=True))
    plant = (
        np.array([[0, 1, 0], [-k / J, -FV / J, N / J], [0, 0, -1 / LAG_S]]),
        np.array([[0], [0], [1 / LAG_S]]),
    )
    ad, bd = signal.cont2discrete((*plant, np.eye(3), np.zeros((3, 1))), H)[:2]
    fa, fb, fc, fd = signal.tf2ss(*signal.butter(4, 30.0, fs=1 / H))
    kept = np.exp(-H / LAG_S)
    mean = LAG_S / H * (1 - kept)
    bound = (more_inertia + J) * 1e-3 + 0.25 * FC
    for tick in range(every):
        if tick == 0:
            e, v, tau = -s["theta_last"], -s["omega_last"], k * s["theta_last"]
            a = slope**2 * e + 2 * slope * v
            u = (a * (J + more_inertia) - J * s["d4"] + tau - seen_friction * v) / N
            u += bound / N / phi * (v + 2 * slope * e + s["integral"])
            s["integral"] += every * H * slope**2 * e
            s["u_pending"] = lead * u - (lead - 1) * s["u_a_model"]
        if tick == release:
            s["u_now"] = s["u_pending"]
        z = np.array([s[f"z{i}"] for i in range(4)])
        d = (s["theta"] - s["theta_last"]) / H
        rate = float(fc[0] @ z + fd[0, 0] * d)
        z = fa @ z + fb[:, 0] * d
        passive = (-k * s["theta"] - FV * rate) / J
        driven = mean * s["u_a_model"] + (1 - mean) * s["u_held"]
        left = (rate - s["omega_last"]) / H - N / J * driven - (passive + s["passive"]) / 2
        s["d4"] += (1 - np.exp(-5.0 * H)) * (left - s["d4"])
        s["u_a_model"] = kept * s["u_a_model"] + (1 - kept) * s["u_held"]
        s["u_held"], s["omega_last"], s["passive"] = s["u_now"], rate, passive
        s["theta_last"] = s["theta"]
        s |= {f"z{i}": z[i] for i in range(4)}
        motion = ad @ [s["theta"], s["omega"], s["u_a"]] + bd[:, 0] * s["u_now"]
        s["theta"], s["omega"], s["u_a"] = motion
    return np.array([s[n] for n in LOOP_STATES])


@pytest.mark.parametrize(
    ("changes", "typed"),
    [
        ({}, {}),
        (
            {"timing__control_release_s": 0.003, "timing__control_rate_Hz": 250.0},
            {"release": 3, "every": 4},
        ),
        # Released a whole period later: at the first tick of the next one.
        ({"timing__control_release_s": 0.005}, {"release": 0}),
        (
            {"sliding_mode__J_unc_kgm2": 0.17, "sliding_mode__phi_rad_s": 0.7},
            {"more_inertia": 0.17, "phi": 0.7},
        ),
    ],
)
def test_a_control_period_is_what_the_blocks_do_in_it(changes, typed):
    device = variant(**changes)
    given = {"seen_friction": 0.0, "every": 5, "release": 1, "more_inertia": 0.05, "phi": 1.5}
    rng = np.random.default_rng(4)
    for lead, slope, k in ((1.0, 9.0, 13.0), (2.5, 15.0, 31.0)):
        period = LoopPeriod(device, lead, slope, k)
        for _ in range(3):
            x = rng.normal(size=len(LOOP_STATES))
            expected = period_typed(x, lead, slope, k, **(given | typed))
            np.testing.assert_allclose(period(x), expected, rtol=1e-9, atol=1e-9)


def test_a_set_point_that_is_taken_as_at_rest_has_friction_of_the_rate_seen():
    device = variant()
    section = device.file.sliding_mode
    still = section.model_copy(update={"setpoint_acceleration": "zero"})
    file = device.file.model_copy(update={"sliding_mode": still})
    timing = file.timing.model_copy(update={"control_release_s": None})
    data = SimpleNamespace(
        file=file.model_copy(update={"timing": timing}), period_s=H, origin="mine.toml"
    )
    x = np.random.default_rng(5).normal(size=len(LOOP_STATES))
    # Without a release of its own: at the end of the period.
    expected = period_typed(
        *(x, 1.7, 11.0, 17.0),
        **{"seen_friction": FV, "every": 5, "release": 0, "more_inertia": 0.05, "phi": 1.5},
    )
    np.testing.assert_allclose(LoopPeriod(data, 1.7, 11.0, 17.0)(x), expected, rtol=1e-9)


def test_of_all_modes_that_swing_the_least_damped_is_found(monkeypatch):
    """Modes that are known: frequency and damping are length and cosine of the pole."""
    modes = [(3.0, 0.3), (7.0, 0.11), (0.501, 0.5), (0.49, -0.2), (20.0, 0.12)]

    class Known:
        control_s = 0.004

        def __init__(self, device, lead, slope, stiffness):
            assert (device, lead, slope, stiffness) == ("device", 2.5, 15.0, 31.0)
            self.matrix = np.zeros((16, 16))
            for i, (f, damping) in enumerate(modes):
                s = 2 * np.pi * f * complex(-damping, np.sqrt(1 - damping**2))
                z = np.exp(s * self.control_s)
                block = [[z.real, z.imag], [-z.imag, z.real]]
                self.matrix[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
            # One over the diagonal, which an eigenvalue does not see, but its transpose would show.
            self.matrix[0, 15] = 3.0

        def __call__(self, x):
            return self.matrix @ x

    monkeypatch.setattr(linear_loop, "LoopPeriod", Known)
    found = linear_loop._worst("device", 2.5, 15.0, 31.0)
    assert (found.damping, found.frequency_Hz) == pytest.approx((0.11, 7.0))
    # Half a cycle a second is slow, a little more is a swing.
    modes[2] = (0.501, 0.09)
    found = linear_loop._worst("device", 2.5, 15.0, 31.0)
    assert (found.damping, found.frequency_Hz) == pytest.approx((0.09, 0.501))
    modes[0] = (3.0, -0.05)
    found = linear_loop._worst("device", 2.5, 15.0, 31.0)
    assert (found.damping, found.frequency_Hz) == pytest.approx((-0.05, 3.0))


def test_the_worse_of_both_ends_of_the_stiffness_counts(monkeypatch):
    asked = []

    def worst(device, lead, slope, stiffness):
        asked.append((lead, slope, stiffness))
        return Mode(0.1 if stiffness > 20 else 0.2, stiffness)

    monkeypatch.setattr(linear_loop, "_worst", worst)
    monkeypatch.setattr(linear_loop, "stiffness_range_Nm_rad", lambda _: (12.0, 29.0))
    assert least_damped(variant(), 2.5) == Mode(0.1, 29.0)
    assert asked == [(2.5, 15.0, 12.0), (2.5, 15.0, 29.0)]
    least_damped(variant(), 1.5, 7.0)
    assert asked[2:] == [(1.5, 7.0, 12.0), (1.5, 7.0, 29.0)]


@pytest.mark.parametrize(
    ("slope", "control_Hz", "ends"),
    [(15.0, 200.0, (1, 25)), (1.0, 200.0, (1, 25)), (25.0, 250.0, (1, 25)), (12.5, 100, (1, 12.5))],
)
def test_a_slope_up_to_an_eighth_of_the_rate_and_25_per_second_is_followed(slope, control_Hz, ends):
    device = SimpleNamespace(file=variant().file, origin="mine.toml")
    section = device.file.sliding_mode
    asked = section.lambda_1_s.model_copy(update={"value": slope})
    section = section.model_copy(update={"lambda_1_s": asked})
    device.file = device.file.model_copy(update={"sliding_mode": section})
    assert slope_range(device, 1 / control_Hz) == ends


@pytest.mark.parametrize(
    ("slope", "control_Hz", "words"),
    [
        (15.0, 50.0, ["= 15 1/s is outside 1 to 6.25 1/s", "= 50 Hz allows", "to 120 Hz or more."]),
        (25.0, 100.0, ["= 25 1/s is outside 1 to 12.5", "raise the rate to 200 Hz"]),
        (13.1, 100.0, ["raise the rate to 105 Hz"]),
        (25.1, 100.0, ["1 to 12.5 1/s", "motor's lag allows", "Give a value inside."]),
        (0.9, 200.0, ["= 0.9 1/s is outside 1 to 25", "motor's lag", "Give a value inside."]),
    ],
)
def test_a_slope_outside_is_refused_with_what_helps(slope, control_Hz, words):
    device = variant()
    section = device.file.sliding_mode
    asked = section.lambda_1_s.model_copy(update={"value": slope})
    section = section.model_copy(update={"lambda_1_s": asked})
    file = device.file.model_copy(update={"sliding_mode": section})
    with pytest.raises(UserError) as refused:
        slope_range(SimpleNamespace(file=file, origin="mine.toml"), 1 / control_Hz)
    for word in words:
        assert word in str(refused.value)


@pytest.mark.parametrize(
    ("dampings", "words"),
    [
        # Damped enough up to 7.354 1/s; less a hundredth, to three digits.
        (lambda slope: 0.02 if slope <= 7.354 else -0.03, ["from 15 to 7.28 1/s or", "grows"]),
        (lambda slope: 0.0 if slope > 1 else 0.02, ["to 0.99 1/s or", "hardly dies away"]),
        (lambda slope: 0.0199, ["No slope from 1 1/s on", "with damping 0.02, below 0.02"]),
    ],
)
def test_the_slope_that_is_damped_enough_is_named(monkeypatch, dampings, words):
    def known(device, lead, slope=15.0):
        assert lead == 2.5
        return Mode(dampings(slope), 6.0)

    device = variant()
    monkeypatch.setattr(linear_loop, "least_damped", known)
    with pytest.raises(UserError) as refused:
        check_loop(device, 2.5)
    for word in (*words, "mode at 6 Hz"):
        assert word in str(refused.value)
    # Just enough is enough.
    monkeypatch.setattr(linear_loop, "least_damped", lambda *_: Mode(0.02, 6.0))
    assert check_loop(device, 2.5) is None


def test_a_slope_of_one_has_none_below_it(monkeypatch):
    device = variant(sliding_mode__lambda_1_s=1.0)
    monkeypatch.setattr(linear_loop, "least_damped", lambda *_: Mode(0.01, 6.0))
    with pytest.raises(UserError, match="No slope from 1 1/s on"):
        check_loop(device, 2.5)
