"""One step of the plant's bodies: friction, dampers and stops act at the speed of its end.

Every torque is taken as a line over the speed, about that of the middle of the step.  What a body
does at the end therefore solves a linear equation, which NumPy solves here again.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.twin.mechanics import Gear, gear_torques, move_load, move_with_cable
from esea_gen.twin.parameters import SINES

Q = 1e-4
CABLE = SimpleNamespace(
    J_kgm2=0.6,
    cable_backlash_rad=0.02,
    cable_stiffness_Nm_rad=150.0,
    cable_damping_Nms_rad=30.0,
    cable_loss=0.4,
    cable_loss_width_rad_s=0.5,
    motor_side_inertia_kgm2=0.003,
    motor_side_damping_Nms_rad=0.2,
)
PERSON = SimpleNamespace(
    Jh_kgm2=0.02,
    spring_Nm_rad=15.0,
    damping_Nms_rad=1.5,
    own_damping_Nms_rad=0.1,
    feedforward=0.5,
    gravity_Nm=2.0,
    noise_decay=0.9,
    noise_gain_Nm=0.1,
    joint_min_rad=-0.6,
    joint_max_rad=3.0,
    joint_stop_Nm_rad=5000.0,
    joint_stop_Nms_rad=200.0,
    free=1.0,
)


def number(x) -> float:
    return float(ca.evalf(ca.SX(x)))


def label(_name, value, *_):
    return value


@pytest.mark.parametrize("wound", [0.03, -0.03, 0.005])
@pytest.mark.parametrize("v_m", [0.3, -0.2])
def test_gear_and_motor_side_part_move_together(wound, v_m):
    v_g, slope, free, tau_e = 0.1, 0.7, 2.0, 1.1
    gear = Gear(ca.SX(0), ca.SX(0), ca.SX(slope), ca.SX(free))
    c = CABLE
    m = move_with_cable(c, gear, ca.SX(wound), ca.SX(v_g), ca.SX(v_m), ca.SX(tau_e), Q, label)
    gap = wound - np.clip(wound, -0.01, 0.01)
    tau_c = (150 * gap + 30 * (v_g - v_m)) * (gap != 0)
    d_c = 30.0 * (gap != 0)
    if tau_c * gap <= 0:  # the damper alone does not pull
        tau_c = d_c = 0.0

    def cable(w_g, w_m):
        return tau_c + d_c * ((w_g - v_g) - (w_m - v_m))

    def on_gear(w_g, w_m):
        return free - slope * (w_g - v_g) - cable(w_g, w_m)

    rub, width = np.tanh(v_m / 0.5), 0.5

    def on_motor_side(w_g, w_m):
        # 40 % of the cable's torque is lost in rubbing; of what it changes the same share.
        rubbed = 0.4 * abs(tau_c) * (rub + (1 - rub**2) / width * (w_m - v_m))
        rubbed += 0.4 * np.sign(tau_c) * rub * (cable(w_g, w_m) - tau_c)
        return cable(w_g, w_m) - rubbed - 0.2 * w_m - tau_e

    # w = v + q a with J a = torque(w), linear in w: three values of it give the equation.
    def left(w):
        return np.array(
            [0.6 * (w[0] - v_g) / Q - on_gear(*w), 0.003 * (w[1] - v_m) / Q - on_motor_side(*w)]
        )

    at_0 = left([0.0, 0.0])
    w = np.linalg.solve(np.c_[left([1.0, 0.0]) - at_0, left([0.0, 1.0]) - at_0], -at_0)
    found = [number(m.w_g), number(m.w_m)]
    assert found == pytest.approx(w, rel=1e-9)
    assert [number(m.a_g), number(m.a_m)] == pytest.approx((w - [v_g, v_m]) / Q, rel=1e-6)


@pytest.mark.parametrize(
    ("x", "v", "beyond"), [(3.01, 0.4, 0.01), (-0.63, -0.2, -0.03), (1.0, 0.4, 0.0)]
)
def test_the_load_at_a_stop(x, v, beyond):
    s = SimpleNamespace(noise_Nm=0.5)
    u = SimpleNamespace(noise=2.0, theta_p_rad=1.2, omega_p_rad_s=0.3, alpha_p_rad_s2=4.0)
    load = move_load(PERSON, s, u, ca.SX(3.0), ca.SX(x), ca.SX(v), Q, label)
    noise = 0.9 * 0.5 + 0.1 * 2.0
    feed = 0.02 * 4.0 + 0.1 * 0.3 + 2.0 * np.sin(1.2)

    def person(w):
        pulled = 15 * (1.2 - x) + 1.5 * (0.3 - w)
        return pulled + 0.5 * feed - 0.1 * w - 2.0 * np.sin(x) + noise

    def stop(w):
        return (5000 * beyond + 200 * w) * (beyond != 0)

    def left(w):
        return 0.02 * (w - v) / Q - (3.0 + person(w) - stop(w))

    w = -left(0.0) / (left(1.0) - left(0.0))
    assert number(load.w) == pytest.approx(w, rel=1e-9)
    # The sine of the plant is one for C, of an accuracy of 1e-7.
    assert number(load.tau_h) == pytest.approx(person(w), rel=1e-6)
    assert number(load.noise) == pytest.approx(noise)
    assert number(load.end) == pytest.approx(beyond)
    assert number(load.tau_end) == pytest.approx(stop(v))


@pytest.mark.parametrize("v_g", [0.0, 0.02, -0.05, 1.5])
@pytest.mark.parametrize("x_g", [0.3, -1.1])
def test_torques_of_the_gear_and_the_slope_of_its_friction(x_g, v_g):
    """(5.2) in NumPy; the slope by differences of the friction."""
    turns, phases = np.arange(1, SINES + 1) / 7, np.linspace(0, 0.9, SINES)
    c = SimpleNamespace(
        fv_Nms_rad=0.5551,
        fc_Nm=0.4688,
        coulomb_width_rad_s=0.05,
        J_kgm2=0.663,
        d4_amplitude_rad_s2=0.7,
        wave_turns=ca.SX(ca.DM(turns)),
        phase_turns=ca.SX(ca.DM(phases)),
    )

    def at(v: float) -> Gear:
        return gear_torques(c, ca.SX(x_g), ca.SX(v), ca.SX(2.0), label)

    found, h = at(v_g), 1e-6
    d4 = 0.7 * np.sin(2 * np.pi * (turns * x_g + phases)).sum()
    friction = 0.5551 * v_g + 0.4688 * np.tanh(v_g / 0.05)
    assert number(found.d4) == pytest.approx(d4, abs=1e-9)
    assert number(found.friction) == pytest.approx(friction, rel=1e-12)
    assert number(found.free) == pytest.approx(2.0 + 0.663 * d4 - friction, abs=1e-9)
    slope = (number(at(v_g + h).friction) - number(at(v_g - h).friction)) / (2 * h)
    assert number(found.slope) == pytest.approx(slope, rel=1e-6)
