"""Signed commands on the simulated board, and bytes of any kind."""

from __future__ import annotations

import stat

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from esea_gen.link.signing import read_key
from esea_gen.link.transport import LinkError
from tests.sim_drive import ANGLES, active, zeroed

pytestmark = pytest.mark.ci


@pytest.fixture
def board(powered):
    powered.restart(blank=True)
    powered.sign_with(None)
    powered.measure(**ANGLES)
    return powered


# -- who may command -------------------------------------------------------------------------------


@pytest.fixture
def paired(board, tmp_path):
    path = tmp_path / "board.key"
    board.pair(path)
    return board, path


def test_the_key_is_its_owners_alone(paired, tmp_path):
    board, path = paired
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    board.use_key(path)
    path.chmod(0o640)
    with pytest.raises(LinkError, match="read or written by others"):
        board.use_key(path)
    other = tmp_path / "other"
    other.write_text("no key")
    other.chmod(0o600)
    with pytest.raises(LinkError, match="is not a key file"):
        read_key(other)
    with pytest.raises(LinkError, match="paired already"):
        board.pair(tmp_path / "second")
    assert not (tmp_path / "second").exists()


def test_a_paired_board_takes_a_stop_from_anybody_and_nothing_else_unsigned(paired):
    board, path = paired
    zeroed(board)
    before = board.traffic().unsigned_refused
    board.sign_with(None)
    refused = 0
    enum = board.dialect.enums["MAV_CMD"]
    for command in [c for c in enum if not enum[c].name.endswith("ENUM_END")]:
        if command not in (board.dialect.MAV_CMD_USER_4, board.dialect.MAV_CMD_REQUEST_MESSAGE):
            assert board.command(command, 1.0) == board.dialect.MAV_RESULT_DENIED
            refused += 1
    with pytest.raises(LinkError, match="does not arm"):
        board.arm()
    with pytest.raises(LinkError, match="sign with its key"):
        board.set_parameter("smc.margin", 1.5)
    board.want(mode=1.0)
    board.send(board.message("ESEA_SENSE_IN", 0, *[0.0] * 12))
    board.send(board.message("SETUP_SIGNING", 1, 1, [7] * 32, 2**47))
    with pytest.raises(LinkError):
        board.stream(["tau_Nm"])
    assert board.state_now == "READY"
    # What changes nothing is answered.
    assert len(board.parameters()) == 40
    board.time_sync(1)
    board.stop()
    assert board.state_now == "STOPPED"
    with pytest.raises(LinkError):
        board.release()
    assert board.state_now == "STOPPED"
    board.use_key(path)
    board.release()
    assert board.state_now == "READY"
    assert board.traffic().unsigned_refused > before + refused


def test_what_was_signed_is_taken_once(paired):
    board, _ = paired
    zeroed(board)
    arm = board.message("COMMAND_LONG", 1, 1, 400, 0, 1.0, *[0.0] * 6)
    frame = board.frames(arm)
    board.send_bytes(frame)
    assert board.state_now == "ARMED"
    board.disarm()
    before = board.traffic().replayed
    for _ in range(3):
        board.send_bytes(frame)
    assert board.state_now == "READY"
    assert board.traffic().replayed == before + 3
    # One that was signed earlier and held back is old as well.
    held, later = board.pack(arm), board.pack(board.message("HEARTBEAT", 6, 8, 0, 0, 0, 3))
    board.send_bytes(later + held)
    assert board.state_now == "READY"
    # Under another sender's address the old one is still old: and its signature no longer fits.
    forged = bytearray(held)
    forged[5] ^= 1
    board.send_bytes(bytes(forged))
    assert board.state_now == "READY"


@pytest.mark.parametrize("where", [4, 12, 30, -13, -12, -1])
def test_a_signed_frame_with_any_byte_another_is_refused(paired, where):
    board, _ = paired
    zeroed(board)
    frame = bytearray(board.pack(board.message("COMMAND_LONG", 1, 1, 400, 0, 1.0, *[0.0] * 6)))
    crc_at = len(frame) - 15
    frame[where] ^= 0x10
    # With a checksum that fits again, so that only the signature can tell.
    crc = common.x25crc(bytes(frame[1:crc_at]))
    crc.accumulate(bytes([152]))
    frame[crc_at : crc_at + 2] = crc.crc.to_bytes(2, "little")
    board.send_bytes(bytes(frame))
    assert board.state_now == "READY"
    traffic = board.traffic()
    assert traffic.bad_signatures + traffic.replayed >= 1


def test_a_wrong_key_commands_nothing_but_a_stop(paired):
    board, _ = paired
    zeroed(board)
    board.sign_with(bytes(range(32)))
    assert board.command(board.dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == 2
    assert board.state_now == "READY"
    board.command(board.dialect.MAV_CMD_USER_4)
    assert board.state_now == "STOPPED"


def test_strangers_do_not_keep_the_link_alive(paired):
    board, path = paired
    zeroed(board)
    board.arm()
    for state in ("ARMED", "READY"):
        for _ in range(60):  # for longer than the link may be silent
            board.learn_time()
            board.send_bytes(b"".join(map(board.pack, board.beat())))
            board.ticks(20)
        assert board.state_now == state
        board.sign_with(None)
    board.use_key(path)


def test_a_board_is_not_paired_with_the_motor_on(board, tmp_path):
    active(zeroed(board))
    with pytest.raises(LinkError, match="does not pair now: it is ACTIVE"):
        board.pair(tmp_path / "key")
    assert not (tmp_path / "key").exists()
    assert board.traffic().paired == 0


def test_a_signed_key_of_zeros_takes_the_key_away(paired):
    board, _ = paired
    board.send(board.message("SETUP_SIGNING", 1, 1, [0] * 32, 0))
    assert board.traffic().paired == 0
    board.sign_with(None)
    board.reset()


def test_a_stop_in_the_first_version_of_mavlink_is_a_stop(paired):
    board, _ = paired
    board.sign_with(None)
    values = (1, 1, board.dialect.MAV_CMD_USER_4, 0, *[0.0] * 7)
    plain = board.dialect.MAVLink(None, 99, 99)
    board.send_bytes(bytes(board.message("COMMAND_LONG", *values).pack(plain, force_mavlink1=True)))
    assert board.state_now == "STOPPED"


# -- bytes of any kind -----------------------------------------------------------------------------


def frame_of_any_content(board, rng):
    """One well-formed frame of any message, its fields of any bits."""
    known = list(board.dialect.mavlink_map.values())
    cls = known[rng.integers(len(known))]
    size = cls.unpacker.size
    payload = rng.integers(0, 256, size).astype(np.uint8).tobytes()
    if rng.random() < 0.5:  # mostly small numbers: indices that are just in or out of range
        payload = bytes(b if rng.random() < 0.2 else b % 4 for b in payload)
    head = bytes([0xFD, size, 0, 0, 0, 255, 190]) + int(cls.id).to_bytes(3, "little")
    crc = common.x25crc(head[1:] + payload)
    crc.accumulate(bytes([cls.crc_extra]))
    return head + payload + crc.crc.to_bytes(2, "little")


@pytest.mark.parametrize("signed", [False, True])
def test_frames_of_any_content_leave_a_board_that_answers(board, tmp_path, signed):
    """Under the sanitizer that the simulated board is built with; no torque without the states."""
    rng = np.random.default_rng(12)
    if signed:
        board.pair(tmp_path / "key")
        board.sign_with(None)
    for _ in range(1500):
        board.send_bytes(frame_of_any_content(board, rng))
        if rng.random() < 0.2:
            board.send_bytes(rng.integers(0, 256, 40).astype(np.uint8).tobytes())
        board.ticks(1)
        board.pending()
        on, u_Nm = board.motor
        assert on or u_Nm == 0
        if signed:
            assert board.state_now in ("UNREFERENCED", "STOPPED")
    board.send_bytes(bytes(600))
    board.pending()
    board.time_sync(1)
