"""Boards of several axes or without a motor: arming, release and zeroing act on all axes."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.board.sim import SimBoard
from esea_gen.device import load_device
from esea_gen.emit.states import TIMES_MS
from esea_gen.link.kept import name_encoders
from esea_gen.link.transport import LinkError

NO_ANSWER = 64.0  # of a frame


def powered(name):
    return SimBoard(load_device(name))


@pytest.fixture(scope="module")
def wrist():
    board = powered("wrist_drive")
    yield board
    board.close()


def show(board, **other: float) -> None:
    board.measure(**{n: 900.0 for n in board.inputs if n.startswith("count_")} | other)


def ready(board):
    board.restart(blank=True)
    show(board)
    board.ticks(20)
    board.zero()
    board.ticks(230)
    assert board.state_now == "READY"
    return board


def active(board, **wanted: float):
    ready(board)
    board.arm()
    board.ticks(1)
    board.want(mode=1.0, **wanted)
    board.ticks(60)
    assert board.state_now == "ACTIVE"
    return board


def told(board, name: str) -> float:
    board.step()
    flag = name.startswith(("constrained", "acts_"))
    return (board.words if flag else board.values)[board.places[name]]


@pytest.mark.ci
def test_each_motor_follows_its_own_command(wrist):
    active(wrist, tau_desired_flexion_Nm=0.3, tau_desired_deviation_Nm=-0.2)
    flexion, deviation = wrist.motors_Nm
    assert flexion > 0 > deviation
    places = [wrist.places[f"u_{a}_Nm"] for a in wrist.device.axes]
    wrist.step()
    assert tuple(wrist.values[k] for k in places) == wrist.motors_Nm


@settings(max_examples=12, deadline=None)
@given(data=st.data(), frames=st.integers(0, 30))
def test_a_fault_of_one_axis_releases_all_in_the_same_tick(wrist, data, frames):
    active(wrist, tau_desired_flexion_Nm=0.3, tau_desired_deviation_Nm=0.3)
    wrong = data.draw(st.sampled_from([n for n in wrist.inputs if "gear" not in n]))
    axis = next(a for a in wrist.device.axes if a in wrong)
    wrist.ticks(frames)
    show(wrist, **{wrong: NO_ANSWER if wrong.startswith("frame") else 2000.0})
    for _ in range(8):
        wrist.ticks(1)
        assert wrist.motor_on == (wrist.state_now == "ACTIVE")
        assert wrist.motor_on or wrist.motors_Nm == (0.0, 0.0)
    assert wrist.state_now == "FAULT"
    last = wrist.blackbox()[-1]
    (found,) = [n for n, fault in last.limits.items() if fault]
    assert (found, last.fault) == (f"fault_{axis}", last.limits[found])
    assert set(last.u_Nm.values()) == {0.0}


def test_an_axis_whose_limits_do_not_release_holds_the_other(wrist):
    ready(wrist)
    show(wrist, frame_error_load_deviation=NO_ANSWER)
    wrist.ticks(20)
    wrist.arm()
    wrist.ticks(2)
    assert (wrist.state_now, wrist.motor_on, wrist.motors_Nm) == ("READY", False, (0.0, 0.0))


@pytest.mark.parametrize(
    ("ask", "time", "off", "after"),
    [("disarm", "FADE", "FADE", "READY"), ("stop", "STOP_FADE", "STOP_OFF", "STOPPED")],
)
def test_letting_go_fades_every_axis_from_its_own_torque(wrist, ask, time, off, after):
    wanted = {"tau_desired_flexion_Nm": 0.02, "tau_desired_deviation_Nm": -0.01}
    fade_ms, off_ms = TIMES_MS[time][0], TIMES_MS[off][0]
    active(wrist, **wanted)
    for _ in range(20):  # until it has come in whole
        wrist.want(mode=1.0, **wanted)
        wrist.ticks(50)
        assert wrist.state_now == "ACTIVE", wrist.lib.sim_fault()
    getattr(wrist, ask)()
    wrist.ticks(fade_ms // 2 - 1)
    for name, torque_Nm in wanted.items():  # each look takes a tick
        assert told(wrist, name.replace("desired", "set")) == pytest.approx(torque_Nm / 2, rel=0.03)
    wrist.ticks(off_ms - fade_ms // 2 - 4)
    assert max(abs(told(wrist, name.replace("desired", "set"))) for name in wanted) < 1e-3
    assert wrist.motor_on
    wrist.ticks(1)
    assert (wrist.state_now, wrist.motor_on) == (after, False)


def test_a_stop_takes_the_wall_away_in_its_time(wrist):
    """The wrist stays in it; 80 counts of 14 bits, and a wall that begins at 2 mrad."""
    ready(wrist).set_parameter("impairment_flexion.wall_rad", 0.002)
    wrist.ticks(20)
    wrist.arm()
    wrist.ticks(1)
    for k in range(0, 81, 2):
        wrist.want(mode=1.0, constrained=1.0)
        wrist.ticks(1)
        show(wrist, count_motor_flexion=900.0 + k, count_load_flexion=900.0 + k)
    wrist.ticks(40)
    wall_Nm = told(wrist, "tau_set_flexion_Nm")
    depth_rad = 80 * 2 * math.pi / 2**14 - 0.002
    assert wall_Nm == pytest.approx(-6 * depth_rad - 60 * depth_rad**3, rel=0.02)
    wrist.stop()
    wrist.ticks(TIMES_MS["STOP_FADE"][0] // 2)
    assert told(wrist, "tau_set_flexion_Nm") == pytest.approx(wall_Nm / 2, rel=0.05)
    wrist.ticks(TIMES_MS["STOP_FADE"][0] // 2 + 2)
    assert told(wrist, "tau_set_flexion_Nm") == pytest.approx(0, abs=1e-3)
    assert wrist.state_now == "STOPPING"


@pytest.mark.parametrize("end", ["stop", "disarm", "fault", "power"])
def test_what_was_impaired_is_healthy_again(wrist, end):
    active(wrist, constrained=1.0)
    assert [told(wrist, n) for n in ("constrained", "acts_flexion", "acts_deviation")] == [1, 1, 1]
    if end == "fault":
        show(wrist, frame_error_load_flexion=NO_ANSWER)
        wrist.ticks(10)
    elif end == "power":
        wrist.restart()
        show(wrist)
    else:
        getattr(wrist, end)()
    show(wrist)
    wrist.ticks(2)
    assert [told(wrist, n) for n in ("constrained", "acts_flexion", "acts_deviation")] == [0, 0, 0]


@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_one_encoder_that_moves_leaves_none_zeroed(wrist, data):
    ready(wrist)
    moving = data.draw(st.sampled_from([n for n in wrist.inputs if n.startswith("count_")]))
    wrist.zero()
    for k in range(230):
        show(wrist, **{moving: 900.0 + k // 2})
        wrist.ticks(1)
    assert wrist.state_now == ("READY" if "gear" in moving else "UNREFERENCED")


@pytest.mark.ci
@pytest.mark.parametrize("name", ["elbow_board", "wrist_board"])
def test_a_board_without_a_motor_is_zeroed_and_never_armed(name):
    board = powered(name)
    board.restart(blank=True)
    show(board)
    board.ticks(20)
    assert board.state_now == "UNREFERENCED"
    board.zero()
    board.ticks(230)
    assert (board.state_now, board.motors_Nm, board.motor_on) == ("READY", (), False)
    angles = [k for k in board.places if k.startswith(("theta_motor", "theta_load"))]
    assert [told(board, n) for n in angles] == [0.0] * len(angles)
    with pytest.raises(LinkError, match="does not arm"):
        board.arm()
    name_encoders(board, list(range(11, 11 + len(angles))))
    board.zero()
    board.ticks(230)
    board.restart()
    show(board)
    board.ticks(20)
    assert board.state_now == "READY"
    board.close()
