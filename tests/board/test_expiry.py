"""Commands that come late, twice, or after a power-off; stops that are taken all the same."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from esea_gen.emit.states import TIMES_MS
from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError
from tests.sim_drive import zeroed

AGE_MS = 500  # as docs/link-security.md has it
ZERO, CLEAR, STOP, RELEASE, RESET = 31011, 31012, 31013, 31014, 31010
ARM, STORE = 400, 245


@pytest.fixture
def board(powered):
    powered.clock_s = lambda: powered.lib.sim_time_ms() * 1e-3
    powered.restart(blank=True)
    powered.sign_with(None)
    return zeroed(powered)


def command(board, number, value=0.0):
    return board.message("COMMAND_LONG", 1, 1, number, 0, value, *[0.0] * 6)


def expiring(board):
    """By name: a command that expires."""
    p = board.known_parameters()[-1]
    kind = board.dialect.MAV_PARAM_TYPE_REAL32
    sent = {
        "arm": command(board, ARM, 1.0),
        "zero": command(board, ZERO),
        "reset": command(board, RESET),
        "clear": command(board, CLEAR),
        "release": command(board, RELEASE),
        "save": command(board, STORE, 1.0),
        "unknown": command(board, 31005),
        "parameter": board.message("PARAM_SET", 1, 1, p.id.encode(), p.high, kind),
        "key": board.message("SETUP_SIGNING", 1, 1, [7] * 32, 0),
        "encoders": board.message("ESEA_KEPT", [1, 2, 0, 0], [0] * 4, *[0] * 9),
        "coupling": board.message("ESEA_LIFE", 5, 0, 0, 0, 0, [0] * 48, 0, 0, 0, 0),
        "blackbox": board.message("ESEA_BLACKBOX", 0, 0, 0, 0, 255, 0, 0, [0] * 224),
    }
    wanted = board.dialect.MAVLink_esea_wanted_message
    values = {"mode": 1, "tau_desired_Nm": 0.2}
    return sent | {"wanted": wanted(*(values.get(n, 0) for n in wanted.fieldnames))}


def expired(board):
    return board.traffic().expired


def test_every_command_that_may_move_or_permit_something_expires(board):
    for name, message in expiring(board).items():
        held = board.frames(message)
        before = expired(board)
        board.ticks(AGE_MS + 1)
        board.send_bytes(held)
        board.ticks(2)
        assert expired(board) == before + 1, name
        board.send_bytes(held[-len(board.pack(message)) :])  # without its time, but for set-points
        assert expired(board) == before + 2, name
        assert board.state_now == "READY", name
    assert not board.traffic().paired
    assert board.parameters() == {p.name: board.parameter(p.name) for p in board.known_parameters()}
    assert any("too late" in t for t in board.texts)


@pytest.mark.parametrize("wait_ms", [0, AGE_MS - 1, AGE_MS, AGE_MS + 1, 60_000])
def test_a_queue_in_the_path_moves_nothing_late_and_keeps_no_stop_back(board, wait_ms):
    arm, on = (board.frames(expiring(board)[n]) for n in ("arm", "wanted"))
    board.ticks(wait_ms)
    in_time = wait_ms <= AGE_MS
    board.send_bytes(arm)
    board.ticks(1)
    assert board.state_now == ("ARMED" if in_time else "READY")
    board.send_bytes(on)
    board.ticks(1)
    assert (board.state_now == "ACTIVE") == (in_time and wait_ms < AGE_MS)
    # What switches off is taken at any age.
    if not in_time:
        board.pending()
        board.arm()
    off, stop = board.frames(command(board, ARM, 0.0)), board.frames(command(board, STOP))
    board.ticks(wait_ms)
    board.send_bytes(off)
    assert board.state_now in ("READY", "LETTING_GO")
    board.send_bytes(stop)
    assert board.state_now in ("STOPPED", "STOPPING")
    board.send_bytes(stop)  # a second one, which waits for nothing
    board.ticks(1)
    assert (board.state_now, board.motor) == ("STOPPED", (False, 0.0))


@pytest.mark.parametrize("wait_ms", [100, 251, 600])
def test_a_command_is_as_old_as_the_word_of_who_gave_it(board, wait_ms):
    """The question for the time and the command wait in the line, one after the other."""
    line = board.transport
    board.transport = Wiretap(line, lambda: board.ticks(wait_ms))
    try:
        if wait_ms < AGE_MS / 2:
            board.arm()
        else:
            with pytest.raises(LinkError, match="came more than half a second"):
                board.arm()
    finally:
        board.transport = line
    assert board.state_now == ("ARMED" if wait_ms < AGE_MS / 2 else "READY")


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(boot=st.integers(0, 2**32 - 1), time_ms=st.integers(0, 2**32 - 1), near=st.booleans())
def test_a_time_of_another_start_or_of_the_future_is_none(board, boot, time_ms, near):
    known = board.learn_time()
    time_ms = (known.time_ms + time_ms % 4001 - 2000) % 2**32 if near else time_ms
    before = expired(board)
    stamp = board.message("ESEA_STAMP", 0, boot, time_ms)
    board.send_bytes(board.pack(stamp) + board.pack(command(board, ARM, 1.0)))
    assert (board.state_now, expired(board)) == ("READY", before + 1) or boot == known.boot
    stamp = board.message("ESEA_STAMP", 0, known.boot, time_ms)
    board.send_bytes(board.pack(stamp) + board.pack(command(board, ARM, 1.0)))
    away = (time_ms - known.time_ms) % 2**32
    assert (board.state_now == "ARMED") == (min(away, 2**32 - away) <= AGE_MS)
    board.pending()
    board.disarm()


def test_a_time_is_for_the_next_frame_of_its_sender_alone(board):
    arm = command(board, ARM, 1.0)
    stamp = board.pack(board.message("ESEA_STAMP", 0, *board.time_now(0.0)))
    other = Session(board.transport, board.dialect, host=(254, 1))
    other.send_bytes(stamp + other.pack(arm))
    board.send_bytes(board.pack(board.message("HEARTBEAT", 6, 8, 0, 0, 0, 3)) + board.pack(arm))
    assert (board.state_now, expired(board)) == ("READY", 2)


def test_a_line_that_holds_back_frames_keeps_nothing_armed(board):
    board.arm()
    held = [b"".join(map(board.pack, board.beat())) for _ in range(60)]
    for frames in held:
        board.send_bytes(frames)
        board.ticks(50)
    assert board.state_now == "READY"


def test_set_points_go_on_while_a_clock_runs_otherwise_than_ours(board):
    """A simulated board at half and at ten times the pace of the host's clock."""
    for pace in (0.5, 3.0, 10.0):
        board.clock_s = lambda pace=pace: board.lib.sim_time_ms() * 1e-3 / pace
        board.learn_time()
        board.arm()
        board.ticks(1)
        for _ in range(800):
            board.want(mode=1.0)
            board.ticks(5)
        assert (board.state_now, expired(board)) == ("ACTIVE", 0)
        board.stop()
        board.ticks(TIMES_MS["STOP_OFF"][0])
        board.release()


# -- bytes around a stop ---------------------------------------------------------------------------


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(before=st.binary(max_size=300), cut=st.integers(0, 300), data=st.data())
def test_a_stop_is_taken_whatever_came_before(board, before, cut, data):
    part = board.pack(data.draw(st.sampled_from(list(expiring(board).values()))))[:cut]
    stop = board.pack(command(board, STOP))
    if data.draw(st.booleans()):
        board.greet(0, "somebody")
        board.overhear(0, before + part + stop, last=True)
    else:
        board.send_bytes(before + part + stop)
        board.ticks(202)
    assert board.state_now == "STOPPED"
    board.send_bytes(bytes(300))
    board.pending()
    board.release()


def test_from_who_comes_beside_the_host_only_a_stop_is_taken(board):
    assert b"this board is commanded by 10.0.0.1:5760" in board.greet(1, "10.0.0.1:5760")
    for name, message in expiring(board).items():
        board.overhear(1, board.frames(message), last=False)
        assert board.state_now == "READY", name
    assert board.pack(board.message("HEARTBEAT", 6, 8, 0, 0, 0, 3))  # the host's own count goes on
    answer = board.overhear(1, board.pack(command(board, STOP)), last=False)
    assert [m.get_type() for m in board.dialect.MAVLink(None).parse_buffer(answer)][-1:] == [
        "COMMAND_ACK"
    ]
    assert board.state_now == "STOPPED"


# -- signed ----------------------------------------------------------------------------------------


class Wiretap:
    """Remembers all that is sent, and does something before it is."""

    def __init__(self, transport, before=lambda: None):
        self.transport, self.before, self.sent = transport, before, []

    def __getattr__(self, name):
        return getattr(self.transport, name)

    def write(self, data, timeout_s):
        self.before()
        self.sent.append(data)
        self.transport.write(data, timeout_s)


def test_recorded_signed_frames_are_void_after_a_power_off(board, tmp_path):
    """At any later start, at the same times of it; and again in the same one."""
    line = board.transport
    board.transport = tap = Wiretap(line)
    board.pair(tmp_path / "key")
    board.arm()
    board.ticks(1)
    board.want(mode=1.0, tau_desired_Nm=0.2)
    board.ticks(1)
    assert board.state_now == "ACTIVE"
    board.transport = line
    board.stop()
    board.stop()
    board.release()
    for start in range(4):
        signed = [data for data in tap.sent if b"\xfd" in data[:1]]
        for data in signed:
            board.send_bytes(data)
            board.ticks(1)
            assert board.motor == (False, 0.0), start
        assert board.state_now != "ARMED"
        board.restart()
        board.sign_with(None)
        board.use_key(tmp_path / "key")
        zeroed(board)
        board.arm()  # who has the key still commands
        board.disarm()
        if start == 2:
            board.unpair()
            board.pair(tmp_path / "second")
            (tmp_path / "second").replace(tmp_path / "key")


@pytest.mark.parametrize("stamp", [2**48 - 1, 2**47, 10**13, 6_000_100])
def test_who_counts_far_ahead_commands_nothing_and_locks_nobody_out(board, tmp_path, stamp):
    """As a client does whose clock is in the future."""
    board.pair(tmp_path / "key")
    board.arm()
    board.disarm()
    beside = board.dialect.MAVLink(None)
    board.sign_as_well(beside)
    own = beside.signing
    frames = board.frames(command(board, ARM, 1.0))  # so that its time is known
    own.timestamp, held = min(own.timestamp + stamp, 2**48 - 2), own.timestamp
    board.send_bytes(board.frames(command(board, ARM, 1.0)))
    assert board.state_now == "READY"
    own.timestamp = held
    board.send_bytes(frames)
    assert board.state_now == "ARMED"
    board.sign_with(None)
    with pytest.raises(LinkError):
        board.disarm()
    board.stop()
    assert board.state_now == "STOPPED"


@pytest.mark.parametrize("now_s", [0.0, 1.38e9, 4.07e9])
def test_the_hosts_clock_is_of_no_importance(board, tmp_path, monkeypatch, now_s):
    """1970, 2013 and 2098: also for a stop."""
    monkeypatch.setattr("time.time", lambda: now_s)
    monkeypatch.setattr("time.time_ns", lambda: int(now_s * 1e9))
    board.pair(tmp_path / "key")
    board.arm()
    board.stop()
    board.release()
    board.unpair()
    board.arm()
