"""States of the board: the C's transition function, the table, effects on the motor.

The application runs as it stands, clocked from here (``firmware/boards/sim``).  What it is held
against is written a second time below, by rules about events, not by states.
"""

from __future__ import annotations

import itertools

import cffi
import numpy as np
import pytest

from esea_gen.board.sim import SimBoard
from esea_gen.device import load_device
from esea_gen.emit.states import EVENTS, GUARDS, STATES, TIMES_MS, follow, states_header
from esea_gen.link.transport import LinkError
from esea_gen.targets import firmware_folder
from tests.sim_drive import ANGLES, zeroed

FFI = cffi.FFI()
NAMES = [s.name for s in STATES]
TORQUE = {"ARMED", "ACTIVE", "LETTING_GO", "STOPPING"}


@pytest.fixture
def board(powered):
    """The drive's board, just powered on; its encoders stand still."""
    powered.restart()
    powered.measure(**ANGLES)
    return powered


@pytest.fixture
def ready(board):
    return zeroed(board)


@pytest.fixture
def armed(ready):
    ready.arm()
    ready.ticks(5)
    assert ready.state_now == "ARMED"
    return ready


# -- the transition function -----------------------------------------------------------------------


def rule(state: str, event: str, g: set[str]) -> str | None:
    """Where an event leads, by what the events are for; None: refused."""
    rest = "STOPPED" if "stop_clear" not in g else "READY" if "referenced" in g else "UNREFERENCED"
    starting = state in ("BOOT", "SELF_TEST")
    match event:
        case "STOP":
            if state in ("ACTIVE", "LETTING_GO") and {"released", "stop_clear"} <= g:
                return "STOPPING"
            return state if starting or state == "FAULT" else "STOPPED"
        case "FAILED":
            return "FAULT"
        case "DISARM":
            return {"ARMED": "READY", "ACTIVE": "LETTING_GO"}.get(state, state)
        case "OFF":
            return "ARMED" if state == "ACTIVE" else state
        case "ON":
            live = {"link_live", "stop_clear"} <= g
            on = state == "ACTIVE" or (state == "ARMED" and "released" in g)
            return "ACTIVE" if on and live else None
        case "ARM":
            needed = {"drive", "referenced", "stop_clear", "link_live", "mode_off"}
            return "ARMED" if state == "READY" and needed <= g else None
        case "RESET":
            return None if starting or state in TORQUE or state == "ZEROING" else "BOOT"
        case "ZERO":
            at_rest = state in ("READY", "UNREFERENCED")
            return "ZEROING" if at_rest and "encoders" in g else None
        case "RELEASE":
            return rest if state == "STOPPED" and "stop_clear" in g else None
        case "CLEAR":
            return rest if state == "FAULT" and "clearable" in g else None
        case "INPUT":
            return "REPLAY" if state in ("READY", "UNREFERENCED", "REPLAY") else None
        case "EXPIRED" | "LINK_LOST" if state == "ACTIVE":
            return "LETTING_GO"
    inner = {
        ("BOOT", "STARTED"): "SELF_TEST",
        ("SELF_TEST", "PASSED"): rest,
        ("ZEROING", "ZEROED"): "READY",
        ("ZEROING", "NOT_ZEROED"): "UNREFERENCED",
        ("ARMED", "REFUSED"): "READY",
        ("ARMED", "LINK_LOST"): "READY",
        ("LETTING_GO", "FADED"): "READY",
        ("STOPPING", "FADED"): "STOPPED",
    }
    return inner.get((state, event))


def every_guard():
    names = [g.name for g in GUARDS]
    for kept in itertools.product((False, True), repeat=len(names)):
        yield {n for n, k in zip(names, kept, strict=True) if k}


def test_an_event_of_no_number_is_refused_in_every_state(powered):
    held, guards = FFI.new("uint32_t *"), FFI.new("bool[]", [True] * len(GUARDS))
    for state in STATES:
        for event in (0, 11, 31, 41, 0xFFFFFFFF):
            held[0] = state.value
            assert not powered.lib.sim_take_event(held, event, guards), (state.name, event)
            assert held[0] == state.value


def test_from_a_state_that_is_none_every_event_leads_to_the_fault(powered):
    held, guards = FFI.new("uint32_t *"), FFI.new("bool[]", [True] * len(GUARDS))
    fault = next(s.value for s in STATES if s.name == "FAULT")
    for state in (12, 77, 2**32 - 1):
        for event in EVENTS:
            held[0] = state
            taken = powered.lib.sim_take_event(held, event.value, guards)
            assert (held[0], bool(taken)) == (fault, event.name == "STOP")


def test_every_state_and_event_leads_where_the_table_and_the_rules_say(board):
    wrong = []
    for state, event, guards in itertools.product(STATES, EVENTS, every_guard()):
        expected = rule(state.name, event.name, guards)
        assert follow(state.name, event.name, guards) == expected, (state, event, guards)
        found = board.follow(state.name, event.name, guards)
        if found != (expected or state.name, expected is not None):
            wrong.append((state.name, event.name, guards, found))
    assert wrong == []


def test_no_way_leads_to_torque_but_arm_and_on(board):
    for state, event, guards in itertools.product(STATES, EVENTS, every_guard()):
        after, _ = board.follow(state.name, event.name, guards)
        if state.name not in TORQUE and after in TORQUE:
            assert (state.name, event.name, after) == ("READY", "ARM", "ARMED")
        if state.name != "ACTIVE" and after == "ACTIVE":
            assert (state.name, event.name) == ("ARMED", "ON")


def test_the_header_is_that_of_the_table():
    """Written by ``python -m esea_gen.emit.states``."""
    assert (firmware_folder() / "app" / "states.h").read_text(encoding="utf-8") == states_header()


# -- what it does ----------------------------------------------------------------------------------


def test_it_starts_without_torque_and_without_a_zero(board):
    assert board.state_now == "UNREFERENCED"
    board.ticks(50)
    assert board.motor == (False, 0.0)
    with pytest.raises(LinkError, match="does not arm now: it is UNREFERENCED"):
        board.arm()


def test_without_a_driver_nothing_is_measured_and_nothing_can_be_zeroed(powered):
    powered.restart()
    powered.ticks(20)
    powered.zero()
    powered.ticks(230)
    assert powered.state_now == "UNREFERENCED"


def test_zeroing_takes_the_angles_that_stand_still(ready):
    ready.tell("ESEA_SENSE_OUT", 1000)
    ready.ticks(20)
    told = [m for m in ready.pending() if m.get_type() == "ESEA_SENSE_OUT"][-1]
    # Whatever the counts were: the joint is at its zero, within half a count of 4096.
    assert abs(told.theta_motor_rad) < np.pi / 4096
    assert abs(told.theta_load_rad) < np.pi / 4096
    assert told.theta_rad == pytest.approx(0, abs=2 * np.pi / 4096)


def test_a_joint_that_moves_is_not_zeroed(board):
    board.ticks(20)
    board.zero()
    for k in range(250):
        board.measure(**(ANGLES | {"count_load": 900 + k // 5}))
        board.ticks()
    assert board.state_now == "UNREFERENCED"


def test_armed_it_holds_no_torque_and_active_it_may(armed):
    assert armed.motor == (True, 0.0)
    for _ in range(40):
        armed.want(mode=1.0, tau_desired_Nm=0.3)
        armed.ticks()
    assert armed.state_now == "ACTIVE"
    on, u_Nm = armed.motor
    assert on
    assert abs(u_Nm) > 1e-4


def test_a_command_without_a_next_one_lets_go(armed):
    armed.tell("ESEA_SENSE_IN", 1000)
    armed.tell("ESEA_SENSE_OUT", 1000)
    for _ in range(40):
        armed.want(mode=2.0, tau_desired_Nm=0.1)
        armed.ticks()
    deadline, fade = TIMES_MS["DEADLINE"][0], TIMES_MS["FADE"][0]
    armed.pending()
    armed.ticks(deadline - 2)
    told = armed.pending()
    assert armed.state_now == "ACTIVE"
    armed.ticks(1)
    assert armed.state_now == "LETTING_GO"
    assert armed.motor[0]
    armed.want(mode=1.0, tau_desired_Nm=0.3)  # nothing brings it back
    for part in (200, fade - 202):  # so many frames as the line holds
        armed.ticks(part)
        told += armed.pending()
    assert armed.state_now == "LETTING_GO"
    armed.ticks(1)
    assert (armed.state_now, armed.motor) == ("READY", (False, 0.0))
    told += armed.pending()
    given = [m for m in told if m.get_type() == "ESEA_SENSE_IN"]
    set_Nm = [m.tau_set_Nm for m in told if m.get_type() == "ESEA_SENSE_OUT"]
    fading = [t for m, t in zip(given, set_Nm, strict=True) if m.mode == 1.0]
    # From what was set when the deadline passed, by equal steps, to nothing.
    from_Nm = set_Nm[next(i for i, m in enumerate(given) if m.mode == 1.0) - 1]
    assert from_Nm != 0
    steps = from_Nm * (fade - np.arange(len(fading))) / fade
    assert len(fading) == fade - 1
    # A blend's rest is taken off a tick late; the first interpolated steps may lag by three.
    assert np.allclose(fading, steps, atol=1e-3)


@pytest.mark.parametrize(
    ("asked_ms", "held_ms"), [(0, 100), (1, 20), (20, 20), (300, 300), (1000, 1000), (65535, 1000)]
)
def test_no_value_switches_the_deadline_off(armed, asked_ms, held_ms):
    armed.want(mode=1.0, deadline_ms=asked_ms)
    armed.ticks(held_ms - 1)
    assert armed.state_now == "ACTIVE"
    armed.ticks(1)
    assert armed.state_now == "LETTING_GO"


@pytest.mark.parametrize("mode", [3.0, 2**32 - 1])
def test_what_is_no_mode_is_no_command(armed, mode):
    armed.want(mode=1.0)
    armed.ticks(60)
    armed.want(mode=mode)
    armed.ticks(40)
    assert armed.state_now == "LETTING_GO"
    assert armed.clock().refused == 1
    for none in (float("nan"), float("inf"), 0.5, -1.0):
        with pytest.raises(ValueError, match=r"mode is .* whole numbers"):
            armed.want(mode=none)


@pytest.mark.parametrize("state", sorted(set(NAMES) - {"BOOT", "SELF_TEST"}))
def test_a_stop_is_taken_in_every_state_from_anybody(armed, state):
    if state in ("ACTIVE", "LETTING_GO", "STOPPING"):
        armed.want(mode=1.0, tau_desired_Nm=0.1)
        armed.ticks(30)
    if state == "LETTING_GO":
        armed.disarm()
    if state in ("READY", "UNREFERENCED", "ZEROING", "REPLAY"):
        armed.disarm()
    if state in ("UNREFERENCED", "ZEROING"):
        armed.zero()
    if state == "UNREFERENCED":
        armed.measure(**(ANGLES | {"frame_error_load": 1}))
        armed.ticks(250)
    if state == "REPLAY":
        zeros = [0.0] * 12
        armed.send(armed.message("ESEA_SENSE_IN", 0, *zeros))
    if state == "FAULT":
        armed.measure(**(ANGLES | {"frame_error_load": 1}))
        armed.ticks(10)
    if state in ("STOPPED", "STOPPING"):
        armed.stop()
    assert armed.state_now == state
    # From a stranger, and addressed to another: system 7, component 9.
    stranger = armed.dialect.MAVLink(None, 42, 1)
    message = armed.message("COMMAND_LONG", 7, 9, armed.dialect.MAV_CMD_USER_4, 0, *[0.0] * 7)
    armed.send_bytes(message.pack(stranger))
    assert armed.state_now == {
        "FAULT": "FAULT",
        "ACTIVE": "STOPPING",
        "LETTING_GO": "STOPPING",
    }.get(state, "STOPPED")
    armed.ticks(1 if armed.state_now != "STOPPING" else TIMES_MS["STOP_OFF"][0])
    assert armed.state_now == ("FAULT" if state == "FAULT" else "STOPPED")
    assert armed.motor == (False, 0.0)
    with pytest.raises(LinkError, match="does not arm"):
        armed.arm()


def test_a_clock_that_comes_to_rest_between_two_ticks_leaves_no_motor_on(armed):
    """Stopped at once, released and put into a replay before the next tick; found by fuzzing."""
    armed.want(mode=1.0, tau_desired_Nm=0.3, deadline_ms=1000)
    armed.ticks(30)
    assert armed.motor[0]
    assert armed.motor[1] != 0
    armed.stop()
    armed.stop()
    armed.release()
    armed.send(armed.message("ESEA_SENSE_IN", 0, *[0.0] * 12))
    assert armed.state_now == "REPLAY"
    armed.ticks(1)
    assert armed.motor == (False, 0.0)


def test_a_replay_leaves_no_zero_behind(board):
    board.send(board.message("ESEA_SENSE_IN", 0, *[0.0] * 12))
    assert board.state_now == "REPLAY"
    board.stop()
    board.release()
    assert board.state_now == "UNREFERENCED"


def test_a_released_stop_restores_nothing(armed):
    for _ in range(30):
        armed.want(mode=1.0, tau_desired_Nm=0.1, deadline_ms=1000)
        armed.ticks()
    armed.stop()
    armed.ticks(3)
    with pytest.raises(LinkError, match="does not release the stop now: it is STOPPING"):
        armed.release()
    armed.ticks(TIMES_MS["STOP_OFF"][0])
    armed.release()
    assert armed.state_now == "READY"
    armed.ticks(200)
    assert armed.motor == (False, 0.0)
    armed.arm()
    armed.ticks(200)
    assert armed.state_now == "ARMED"
    assert armed.motor == (True, 0.0)


@pytest.mark.parametrize("release", ["stop", "disarm"])
def test_letting_go_makes_no_step_while_what_is_wanted_fades_in(armed, release):
    """The torque starts where it was, 0, and the wish is blended in: both fade on."""
    armed.tell("ESEA_SENSE_OUT", 1000)
    armed.want(mode=1.0, tau_desired_Nm=2.0)
    armed.ticks(3)
    getattr(armed, release)()
    armed.ticks(3)
    told = [m.tau_set_Nm for m in armed.pending() if m.get_type() == "ESEA_SENSE_OUT"]
    assert abs(np.diff(told[-7:])).max() < 0.05


@pytest.mark.parametrize("mode", [1.0, 2.0])
@pytest.mark.parametrize("release", ["stop", "disarm"])
def test_a_stop_soon_after_a_start_is_at_zero_in_its_time(ready, release, mode):
    """Whatever a long blend still has to add, and from the middle of a ramp between messages."""
    armed, fade_ms = ready, TIMES_MS["STOP_FADE" if release == "stop" else "FADE"][0]
    ready.set_parameter("reference.blend_s", 5.0)
    ready.arm()
    ready.ticks(5)
    armed.tell("ESEA_SENSE_OUT", 1000)
    for k in range(5):
        armed.want(mode=mode, tau_desired_Nm=2.0 + 0.01 * k)
        armed.ticks(20 if k < 4 else 7)
    getattr(armed, release)()
    armed.pending()
    told = []
    for _ in range(fade_ms // 50):
        armed.ticks(50)
        told += [m.tau_set_Nm for m in armed.pending() if m.get_type() == "ESEA_SENSE_OUT"]
    assert abs(np.diff(told)).max() < 0.02
    assert told[0] > 0.05
    assert max(abs(x) for x in told[-3:]) < 0.002


def test_a_controlled_stop_ends_in_its_time_and_at_once_by_a_second_one(armed):
    """A repeated frame is not a second stop; an open line and a fault are not waited for."""
    off, line = TIMES_MS["STOP_OFF"][0], armed.lib.sim_stop_line

    def stop_again(confirmation: int) -> None:
        command = armed.dialect.MAV_CMD_USER_4
        armed.send(armed.message("COMMAND_LONG", 1, 1, command, confirmation, *[0.0] * 7))

    ends = {
        "in its time": (lambda: stop_again(1), "STOPPING"),
        "whoever tidies up": (lambda: armed.stop(again=True), "STOPPING"),
        "a second stop": (lambda: stop_again(0), "STOPPED"),
        "the line": (lambda: line(True), "STOPPED"),
        "a lost tick": (lambda: armed.lib.sim_tick(3, True), "FAULT"),
        "sensing": (lambda: armed.measure(**(ANGLES | {"frame_error_load": 1})), "FAULT"),
        "the link": (armed.pending, "STOPPING"),  # silence neither shortens nor lengthens it
    }
    for how, (deed, after) in ends.items():
        for _ in range(40):
            armed.want(mode=2.0, tau_desired_Nm=0.1)
            armed.ticks()
        armed.stop()
        assert armed.state_now == "STOPPING", how
        assert armed.motor[0]
        armed.want(mode=1.0, tau_desired_Nm=0.3)  # nothing brings it back
        armed.ticks(10)
        deed()
        armed.ticks(4 if how == "sensing" else 1)
        assert (armed.state_now, armed.motor[0]) == (after, after == "STOPPING"), how
        armed.ticks(off - 12 if after == "STOPPING" else 0)
        assert (armed.state_now == "STOPPING") == (after == "STOPPING"), how
        armed.ticks(1)
        assert armed.motor == (False, 0.0)
        assert armed.state_now == ("FAULT" if after == "FAULT" else "STOPPED"), how
        line(False)
        armed.measure(**ANGLES)
        armed.ticks(30)
        armed.clear() if after == "FAULT" else armed.release()
        if after == "FAULT":
            armed.release()
        armed.arm()
        armed.ticks(1)


def test_a_command_waits_until_the_limits_have_released(ready):
    """Sent right behind the arming, in the same tick: refused, and the next one is taken."""
    ready.arm()
    ready.want(mode=1.0)
    assert ready.state_now == "ARMED"
    ready.ticks(1)
    assert (ready.state_now, ready.clock().refused) == ("ARMED", 1)
    ready.want(mode=1.0)
    ready.ticks(1)
    assert ready.state_now == "ACTIVE"


def test_arming_needs_mode_0(ready):
    ready.want(mode=1.0, tau_desired_Nm=0.3)
    with pytest.raises(LinkError, match="does not arm"):
        ready.arm()
    ready.want(mode=0.0)
    ready.arm()
    assert ready.state_now == "ARMED"


def test_a_silent_host_disarms(armed):
    armed.ticks(TIMES_MS["LINK_LOST"][0] - 10)
    assert armed.state_now == "ARMED"
    armed.ticks(10)
    assert armed.state_now == "READY"


def test_an_open_stop_line_holds_until_it_is_closed_and_released(armed):
    armed.lib.sim_stop_line(True)
    armed.ticks(1)
    assert (armed.state_now, armed.motor) == ("STOPPED", (False, 0.0))
    with pytest.raises(LinkError, match="does not release the stop"):
        armed.release()
    armed.lib.sim_stop_line(False)
    armed.ticks(5)
    assert armed.state_now == "STOPPED"
    armed.release()
    assert armed.state_now == "READY"


def test_a_fault_of_the_limits_is_cleared_by_a_person_and_needs_a_new_arm(armed):
    armed.measure(**(ANGLES | {"frame_error_load": 1}))
    armed.ticks(10)
    assert (armed.state_now, armed.motor) == ("FAULT", (False, 0.0))
    assert armed.fault().startswith("SENSING")
    # While the cause stands it may be cleared, but the limits do not release.
    armed.clear()
    armed.arm()
    armed.ticks(1)
    assert armed.state_now == "READY"
    armed.measure(**ANGLES)
    armed.ticks(20)
    armed.arm()
    armed.ticks(1)
    assert (armed.state_now, armed.motor) == ("ARMED", (True, 0.0))


def test_a_fault_of_the_board_needs_a_reset(armed):
    armed.lib.sim_fail(102)
    assert armed.state_now == "FAULT"
    assert armed.motor == (False, 0.0)
    with pytest.raises(LinkError, match="does not clear the fault"):
        armed.clear()
    armed.reset()
    assert armed.state_now == "UNREFERENCED"


def test_a_stop_outlives_a_reset(ready):
    ready.stop()
    ready.reset()
    assert ready.state_now == "STOPPED"


def test_a_state_that_is_none_is_a_fault_at_the_next_tick(armed):
    armed.want(mode=1.0)
    armed.ticks(50)
    armed.lib.sim_overwrite_state(77)
    armed.ticks(1)
    assert (armed.state_now, armed.motor) == ("FAULT", (False, 0.0))
    assert armed.fault().startswith("STATE_UNKNOWN")


def test_a_lost_tick_latches_and_a_host_hears_of_it(armed):
    armed.want(mode=1.0, deadline_ms=1000)
    armed.ticks(20)
    armed.lib.sim_tick(3, True)
    assert (armed.state_now, armed.motor) == ("FAULT", (False, 0.0))
    assert armed.fault().startswith("CLOCK")
    assert armed.clock().lost_ticks == 2


def test_what_the_counter_was_before_the_first_tick_does_not_matter(board):
    board.restart()
    board.lib.sim_tick(5, True)
    sync = board.time_sync(1)
    assert sync.offset_ns + sync.host_ns == pytest.approx(1_000_000, abs=1)
    assert board.clock().lost_ticks == 0
    # And a counter that stands still loses none: an interrupt is a tick.
    board.lib.sim_tick(0, True)
    sync = board.time_sync(1)
    assert sync.offset_ns + sync.host_ns == pytest.approx(2_000_000, abs=1)


def test_late_runs_of_the_slower_task_latch(armed):
    """Each is started, and ends only two ticks later: the twelfth in a row is too late."""
    armed.want(mode=1.0, deadline_ms=1000)
    while armed.clock().tick % 5:
        armed.ticks()
    before = armed.clock().late_runs
    first = None
    for k in range(60):
        armed.lib.sim_tick(1, False)
        if k % 5 == 2:
            armed.lib.sim_slower()
        armed.lib.sim_poll()
        first = k if first is None and armed.state_now == "FAULT" else first
    assert first == 11 * 5 + 1
    assert armed.fault().startswith("LATE")
    assert armed.clock().late_runs - before == 12


# -- other devices ---------------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize("name", ["elbow", "wrist"])
def test_a_device_without_a_motor_is_ready_and_never_armed(name):
    board = SimBoard(load_device(name))
    board.measure()
    board.ticks(20)
    assert board.state_now == "READY"
    for ask in (board.arm, board.zero):
        with pytest.raises(LinkError, match="READY"):
            ask()
    with pytest.raises(LinkError, match="no motor"):
        board.want(mode=1.0)
    board.stop()
    assert board.state_now == "STOPPED"
    # Its parameters are kept as a drive's are, the first of them too.
    first = next(iter(board.parameters()))
    value = board.parameter(first)
    board.set_parameter(first, value + 1.0)
    board.save_parameters()
    board.restart()
    assert board.parameter(first) == value + 1.0
    board.close()


@pytest.mark.ci
def test_in_whole_numbers_it_is_zeroed_and_armed_alike(drive):
    board = SimBoard(drive, board="sim-q31")
    board.measure(**ANGLES)
    board.ticks(20)
    board.zero()
    board.ticks(230)
    board.arm()
    board.tell("ESEA_SENSE_OUT", 1000)
    for _ in range(30):
        board.want(mode=1.0, tau_desired_Nm=0.3)
        board.ticks()
    told = [m for m in board.pending() if m.get_type() == "ESEA_SENSE_OUT"][-1]
    assert board.state_now == "ACTIVE"
    assert board.motor[1] != 0
    assert abs(told.theta_load_rad) < np.pi / 4096
    board.close()
