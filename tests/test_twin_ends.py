"""What the virtual exoskeleton decides just at an end, and a hair beyond it."""

from __future__ import annotations

from math import inf, nextafter
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.twin.closed_loop import ClosedLoop, _skipped
from esea_gen.twin.encoders import whole_below
from esea_gen.twin.faults import parse_fault
from esea_gen.twin.judge import fault_figures, judge
from esea_gen.twin.mechanics import beyond, contact, trip
from esea_gen.twin.plant import plant_block, start_state
from esea_gen.twin.published import PLANTS
from esea_gen.twin.recorded import _tuning_case
from esea_gen.twin.trajectories import bread, fixed_sinusoid, impedance, tuning

from .test_encoder_faults import by_hand
from .test_judge import U_MAX_NM, made

SIDES = (1, -1)


def above(x):
    return nextafter(x, inf)


def below(x):
    return nextafter(x, -inf)


def same(label, x, *_):
    return x


def test_contact_begins_beyond_the_end():
    over, rate = ca.SX.sym("over"), ca.SX.sym("rate")
    push = ca.Function("f", [over, rate], contact(over, rate, 4.0, 0.5))
    for side in SIDES:
        assert [float(x) for x in push(0.0, side * 3.0)] == [0, 0]
        assert [float(x) for x in push(side * 0.25, -side * 2.0)] == [0, 0]
        assert [float(x) for x in push(side * 0.25, -side * 1.0)] == [side * 0.5, 0.5]
    for at, out in ((-1.5, -0.5), (-1.0, 0), (2.0, 0), (2.5, 0.5)):
        assert float(ca.Function("g", [over], [beyond(over, -1.0, 2.0)])(at)) == out


def test_a_drive_trips_above_its_torque_and_speed():
    """Torque 2 Nm whose square is smoothed at once; speed 3 rad/s."""
    u, w, tripped = (ca.SX.sym(n) for n in "uwt")
    c = SimpleNamespace(heat_share=1.0, trip_torque_Nm=2.0, trip_speed_rad_s=3.0)
    s = SimpleNamespace(heat=ca.SX(0), tripped=tripped)
    step = ca.Function("f", [u, w, tripped], trip(c, s, u, w, same))
    for side in SIDES:
        for at, speed, before, now in (
            (2.0, 3.0, 0, 0),
            (2.0000001, 3.0, 0, 2),
            (2.0, above(3.0), 0, 1),
            (3.0, 4.0, 0, 1),
            (3.0, 4.0, 2, 2),
            (0.0, 0.0, 1, 1),
        ):
            heat, word = step(side * at, side * speed, before)
            assert (float(heat), float(word)) == (at * at, now)


def test_whole_numbers_are_their_own_floor():
    x = ca.SX.sym("x")
    floor = ca.Function("f", [x], [whole_below(x)])
    for at, whole in ((-2, -2), (-0.5, -1), (0, 0), (0.5, 0), (below(1), 0), (1, 1), (1.5, 1)):
        assert float(floor(at)) == whole


def test_a_start_may_lie_at_the_ends_of_what_the_plant_shows():
    block = plant_block(load_device("elbow_drive"))
    for port in block.outputs:
        if port.name in ("omega_g_rad_s", "omega_m_rad_s", "omega_l_rad_s"):
            for end, past in ((port.low, below(port.low)), (port.high, above(port.high))):
                state, shown = start_state(block, 0.0, {port.name: end})
                assert shown[port.name] == end
                assert end in state["omega_rad_s"]
                with pytest.raises(UserError, match=f"Initial {port.name}"):
                    start_state(block, 0.0, {port.name: past})


def test_the_fewest_and_most_ticks():
    loop = SimpleNamespace(signals=())
    for ticks in (1, 2**32 - 1):
        assert ClosedLoop._ticks(loop, {}, ticks) == ticks
    for ticks in (0, 2**32):
        with pytest.raises(UserError, match=f"A run of {ticks} ticks"):
            ClosedLoop._ticks(loop, {}, ticks)
    assert _skipped(None, 0, 3).tolist() == [0, 0, 0]
    assert _skipped([0, 1, 1], 2, 3).tolist() == [0, 1, 1]
    for missed, delay in ((None, -1), ([0, 1], 0), ([[0, 1, 0]], 0)):
        with pytest.raises(UserError, match=f"A delay of {delay} ticks"):
            _skipped(missed, delay, 3)
    device = load_device("elbow_drive")
    most = len(tuning().tau_desired_Nm)
    for ticks in (1, most):
        assert len(_tuning_case(device, ticks).tau_desired_Nm) == most
    for ticks in (0, most + 1):
        with pytest.raises(UserError, match="of the tuning case are asked for"):
            _tuning_case(device, ticks)


def test_a_fault_may_be_as_large_and_as_late_as_its_ends():
    for amount in (-10.0, 10.0):
        assert parse_fault(f"slip:load@0={amount}").amount == amount
    assert parse_fault("slip:load@10000=1").at_s == 1e4
    for text in ("slip:load@10000.001=1", "slip:load@1=10.0001", "slip:load@1=-10.0001"):
        with pytest.raises(UserError, match="is not a number from"):
            parse_fault(text)


def test_half_a_hertz_counts_as_fast():
    for hertz, cycles, settle in ((0.5, 22, 10), (below(0.5), 8, 4)):
        path = fixed_sinusoid(1.0, hertz)
        assert len(path.tau_desired_Nm) == pytest.approx(cycles / hertz * 1000, abs=1)
        assert path.start == pytest.approx(settle / hertz * 1000, abs=1)


def test_slices_begin_when_the_rise_has_ended():
    p, path = PLANTS.trajectory.bread, bread()
    at = round(p.rise_s * 1000)
    turn = 2 * np.pi * p.frequency_Hz
    assert path.theta_p_rad[at] == pytest.approx(p.middle_rad)
    assert path.alpha_p_rad_s2[at] == pytest.approx(2 * p.amplitude_rad * turn / p.fade_s)
    before = p.middle_rad * 6 * (1 - 2 * (at - 1) / at) / p.rise_s**2
    assert path.alpha_p_rad_s2[at - 1] == pytest.approx(before)
    back, half = impedance(), round(PLANTS.trajectory.impedance.half_s * 1000)
    assert back.theta_p_rad[half] == pytest.approx(np.pi / 2)
    assert back.omega_p_rad_s[half + 1] < 0 < back.omega_p_rad_s[half - 1]


def test_a_run_is_unstable_above_the_limits():
    limits = PLANTS.unstable
    for speed, unstable in (
        (limits.max_gear_speed_rad_s, 0),
        (above(limits.max_gear_speed_rad_s), 1),
    ):
        case, run = made()
        run.plant["omega_g_rad_s"][3] = -speed
        assert judge(case, run, U_MAX_NM)["unstable"] == unstable
    for worst, unstable in (
        (limits.max_true_error_Nm, 0),
        (above(limits.max_true_error_Nm), 1),
    ):
        case, run = made()
        case.trajectory.tau_desired_Nm[:] = 0
        run.plant["tau_e_Nm"][:] = 0
        run.plant["tau_e_Nm"][2000] = -worst
        assert judge(case, run, U_MAX_NM)["unstable"] == unstable
    case, run = made()
    run.controller["u_Nm"][:] = 0
    run.controller["u_Nm"][1000:1500] = 0.999 * U_MAX_NM
    run.controller["u_Nm"][1500:3000] = below(0.999 * U_MAX_NM)
    assert judge(case, run, U_MAX_NM)["limited_share"] == pytest.approx(0.1)


def test_a_fault_needs_two_samples_of_the_run():
    for at, late in ((0.998, False), (0.999, True)):
        fault = parse_fault(f"freeze:load@{at}")
        if not late:
            assert fault_figures(by_hand(None), fault)["peak_torque_Nm"] == 0
            continue
        with pytest.raises(UserError, match=r"the run ends at 0\.999 s"):
            fault_figures(by_hand(None), fault)
