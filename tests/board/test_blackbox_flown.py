"""The black box and the watchdog in the application: flown into a fault, reset, and read back."""

from __future__ import annotations

import pytest

from esea_gen.board.blackbox import record_bytes
from esea_gen.board.firmware import build_firmware
from esea_gen.board.sim import SimBoard
from esea_gen.device import load_device
from esea_gen.emit.states import BOARD_FAULTS
from tests.conftest import require_tool

FAULTS = {f.name: f.value for f in BOARD_FAULTS}
SENSING = 6


@pytest.fixture(scope="module")
def powered(drive):
    board = SimBoard(drive)
    yield board
    board.close()


ANGLES = {"count_motor": 700.0, "count_load": 900.0, "count_gear": 5.0}


@pytest.fixture
def active(powered):
    """The drive's board, in the middle of a command."""
    board = powered
    board.lib.sim_blackbox_release()
    board.restart()
    board.lib.sim_stop_line(False)
    board.measure(**ANGLES)
    board.ticks(20)
    board.zero()
    board.ticks(230)
    commanded(board)
    return board


def commanded(board) -> None:
    board.arm()
    board.ticks(1)
    board.want(mode=1.0, tau_desired_Nm=0.2)


def flown(board, ticks: int) -> list[dict]:
    """So many ticks under varying commands and angles; what was fed in each, and what it gave."""
    fed = []
    for k in range(ticks):
        if k % 40 == 0:
            wanted = {"mode": 1.0, "tau_desired_Nm": k % 120 / 1024}
            wanted |= {"theta_desired_rad": 0.25, "omega_desired_rad_s": -0.5}
            board.want(**wanted)
        values = ANGLES | {"count_load": 900.0 + k % 3, "frame_error_gear": 64.0 * (k % 50 == 7)}
        board.measure(**values)
        board.ticks()
        on, u_Nm = board.motor
        fed.append({"wanted": wanted, "measured": values, "on": on, "u_Nm": u_Nm})
        fed[-1]["state"] = board.state_now
    return fed


def agrees(record, fed) -> None:
    assert record.measured == {**dict.fromkeys(record.measured, 0.0), **fed["measured"]}
    for name, value in fed["wanted"].items():
        assert record.wanted[name] == value
    assert (record.state, record.on, record.u_Nm["u_Nm"]) == (fed["state"], fed["on"], fed["u_Nm"])


@pytest.mark.ci
@pytest.mark.parametrize(("before", "ticks"), [(0, 180), (2500, 30)])
def test_after_a_fault_and_a_reset_it_holds_what_was_fed(active, before, ticks):
    active.disarm()
    active.ticks(510)
    rest = [5.0 + k % 7 for k in range(before)]
    for count_gear in rest:
        active.measure(**ANGLES | {"count_gear": count_gear})
        active.ticks()
    commanded(active)
    fed = flown(active, ticks)
    assert {f["state"] for f in fed} == {"ACTIVE"}
    active.trouble(FAULTS["MOTOR_CURRENT"])
    active.ticks()
    assert (active.state_now, active.motor) == ("FAULT", (False, 0))
    active.ticks(500)
    active.restart()
    active.ticks(30)
    records = active.blackbox()
    assert active.lib.sim_blackbox_fault() == FAULTS["MOTOR_CURRENT"]
    last = records.pop()
    assert (last.state, last.fault, last.on, last.u_Nm["u_Nm"]) == ("FAULT", 106, False, 0)
    assert last.tick == active.lib.sim_blackbox_tick() & 0xFFFF
    assert len(records) == min(1999, 20 + 230 + 1 + 510 + before + 1 + ticks)
    for record, given in zip(records[-ticks:], fed, strict=True):
        agrees(record, given)
    quiet = records[-ticks - 1 - before : -ticks - 1] if before < 1999 else records[: -ticks - 1]
    assert [r.measured["count_gear"] for r in quiet] == rest[-len(quiet) :]
    assert not any(r.on for r in quiet)
    # Zeroing starts the ticks anew.
    assert [r.tick for r in records[-ticks:]] == list(range(last.tick - ticks, last.tick))
    assert max(abs(r.u_Nm["u_Nm"]) for r in records) > 0.001


def test_a_fault_of_the_limits_is_kept_too_and_arming_begins_anew(active):
    fed = flown(active, 60)
    active.measure(**ANGLES | {"frame_error_load": 64.0})
    active.ticks(10)
    assert active.state_now == "FAULT"
    records = active.blackbox()
    assert active.lib.sim_blackbox_fault() == SENSING
    assert (records[-1].fault, records[-1].limits) == (SENSING, {"fault": SENSING})
    # Three bad frames are bridged; the fourth is the fault's.
    agrees(records[-5], fed[-1])
    assert [r.measured["frame_error_load"] for r in records[-4:]] == [64.0] * 4
    assert [r.state for r in records[-5:]] == ["ACTIVE"] * 4 + ["FAULT"]
    # Seen to and armed again.
    active.measure(**ANGLES)
    active.ticks(30)
    active.clear()
    active.ticks(30)
    assert len(active.blackbox()) == len(records)
    active.arm()
    assert active.blackbox() == []


def test_a_stop_is_recorded(active):
    active.ticks(3)
    active.lib.sim_stop_line(True)
    active.ticks(2)
    active.lib.sim_stop_line(False)
    active.trouble(FAULTS["BROWN_OUT"])
    active.ticks()
    assert [(r.state, r.stop_held, r.on) for r in active.blackbox()[-4:]] == [
        ("ACTIVE", False, True),
        ("STOPPED", True, False),
        ("STOPPED", True, False),
        ("FAULT", True, False),
    ]


def test_a_watchdog_s_reset_is_a_fault_with_what_came_before(active):
    flown(active, 100)
    active.trouble(FAULTS["WATCHDOG"])
    active.restart()
    assert active.state_now == "FAULT"
    assert active.fault().startswith("WATCHDOG:")
    records = active.blackbox()
    assert active.lib.sim_blackbox_fault() == FAULTS["WATCHDOG"]
    assert (records[-1].state, records[-1].on) == ("ACTIVE", True)
    active.ticks(5)
    active.reset()
    assert active.state_now == "UNREFERENCED"
    assert len(active.blackbox()) == len(records)


@pytest.mark.parametrize("fault", [106, 108])
def test_what_the_drivers_find_takes_the_torque_away_in_its_tick(active, fault):
    flown(active, 20)
    assert active.motor[0]
    active.trouble(fault)
    active.ticks()
    assert (active.state_now, active.motor) == ("FAULT", (False, 0))
    assert active.lib.sim_fault() == fault
    active.ticks(5)
    assert active.state_now == "FAULT"
    active.reset()
    assert active.state_now == "UNREFERENCED"


# -- the watchdog ----------------------------------------------------------------------------------


def fed_in(board, ticks: int, lost: int = 0, slower: bool = True) -> int:
    before = board.lib.sim_times_fed()
    for _ in range(ticks):
        board.lib.sim_tick(1 + lost, slower)
        board.lib.sim_poll()
    return board.lib.sim_times_fed() - before


def test_the_watchdog_is_fed_once_a_control_cycle(active):
    assert fed_in(active, 500) == 100


def test_it_is_not_fed_while_ticks_are_lost(active):
    fed_in(active, 10)
    assert fed_in(active, 200, lost=1) == 0


def test_it_is_not_fed_while_control_does_not_end(active):
    fed_in(active, 10)
    assert fed_in(active, 10, slower=False) <= 1
    assert fed_in(active, 500, slower=False) == 0
    assert 98 <= fed_in(active, 500) <= 100


def test_it_is_not_fed_by_runs_that_end_late(active):
    """Control runs to its end just before it is due again: beyond its release."""

    def late(cycles):
        before = active.lib.sim_times_fed()
        for _ in range(cycles):
            for _ in range(4):
                active.lib.sim_tick(1, False)
            active.lib.sim_slower()
            active.lib.sim_tick(1, False)
        return active.lib.sim_times_fed() - before

    while not active.lib.sim_state() or active.clock().tick % 5:
        active.ticks()
    late(2)
    assert late(10) == 0


def test_in_a_replay_and_in_a_fault_the_ticks_feed_it(active):
    active.trouble(106)
    active.ticks()
    assert fed_in(active, 500) == 100
    active.lib.sim_fail(103)
    assert fed_in(active, 50) == 50


def test_a_state_with_torque_and_a_clock_that_rests_is_not_fed(active):
    active.lib.sim_fail(103)
    active.lib.sim_overwrite_state(8)
    assert fed_in(active, 50) == 0


# -- size ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_board_with_less_memory_remembers_less(drive, tmp_path):
    """Nearly two seconds of the drive fit; of predictive control, which keeps more, less does."""
    require_tool("arm-none-eabi-gcc")
    for device, held in ((drive, 1980), (load_device("elbow_mpc"), 1911)):
        image = build_firmware(device, "netduinoplus2", tmp_path)
        assert image.noinit_bytes == 36 + held * record_bytes(device)


@pytest.mark.ci
def test_a_device_without_a_motor_has_one_too(tmp_path):
    board = SimBoard(load_device("elbow"))
    board.measure(theta_rad=0.125)
    board.ticks(30)
    board.trouble(FAULTS["BROWN_OUT"])
    board.ticks()
    records = board.blackbox()
    assert len(records) == 31
    assert {r.measured["theta_rad"] for r in records} == {0.125}
    assert records[-1].fault == FAULTS["BROWN_OUT"]
    board.close()
