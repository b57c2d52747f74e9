"""A recording computed again by the C that made it: every bit, and the one that is wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

import esea_host
from esea_gen.errors import UserError
from esea_host.recording import RecordingState
from esea_host.recording.replay import device_of, verify
from esea_host.simulated import LockstepDevice, SimulatedBoard


@pytest.fixture(scope="module", params=["sim", pytest.param("sim-q31", marks=pytest.mark.ci)])
def recorded(request, tmp_path_factory):
    """Zeroed, a parameter changed, armed, a sine of torque; the board is simulated."""
    if request.param == "sim":
        board = request.getfixturevalue("simulated_elbow")
        board.restart()
    else:
        board = SimulatedBoard("elbow_drive", board=request.param)
    device = LockstepDevice(board)
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    with device.record(path):
        device.advance(0.1)
        device.zero()
        device.advance(0.4)
        device.session.set_parameter("smc.lambda_1_s", 12)
        device.advance(0.05)
        device.arm()
        device.advance(0.01)
        for i in range(100):
            device.want(mode=1.0, tau_desired_Nm=math.sin(i * 0.1))
            device.advance(0.02)
    assert device.state() == "ACTIVE"
    if request.param != "sim":
        board.close()
    return path


def test_every_bit_is_the_cs(recorded):
    """Through zeroing, which starts the clock again, and through a change of a parameter."""
    log = esea_host.open_log(recorded)
    verdict = verify(log)
    assert verdict.differences == []
    assert verdict.proven
    assert verdict.unproven == 0
    assert verdict.ticks == len(log["sense_in"]) == 2560
    # Asked for, zeroing, zeroed, the parameter, and one a second.
    assert verdict.key_frames >= 6
    columns = len(log["sense_out"].names) - 2
    assert verdict.values > verdict.ticks * columns


@pytest.mark.ci
@pytest.mark.parametrize(
    ("stream", "tick", "signal"),
    [
        ("sense_out", 1234, "tau_Nm"),
        ("sense_out", 1777, "limits_status"),
        ("sense_in", 1234, "count_load"),
    ],
)
def test_a_changed_value_is_named(recorded, monkeypatch, stream, tick, signal):
    """An input by the outputs that do not follow from it."""
    log = esea_host.open_log(recorded)
    sound = log.read_timed

    def changed(name):
        for rows, ns in sound(name):
            own = rows.copy()
            if name == stream:
                own[signal].view("u4")[own["sequence"] == tick] ^= 0x1000
            yield own, ns

    monkeypatch.setattr(log, "read_timed", changed)
    verdict = verify(log)
    assert not verdict.same
    last = verdict.differences[-1]
    assert last.tick == tick if stream != "sense_in" else last.tick >= tick
    if stream != "sense_in":
        assert {(d.stream, d.signal) for d in verdict.differences} == {(stream, signal)}


@pytest.mark.ci
def test_a_flipped_bit_of_the_file_leaves_its_piece_unproven(recorded, tmp_path):
    data = bytearray(recorded.read_bytes())
    piece = esea_host.open_log(recorded).pieces[-2]
    data[(piece.data + piece.end) // 2] ^= 0x10
    path = tmp_path / "b.mcap"
    path.write_bytes(data)
    log = esea_host.open_log(path)
    assert log.gaps  # nobody takes the piece as it is
    verdict = verify(log)
    assert verdict.same  # no tick of a sound piece is blamed
    assert not verdict.proven
    assert verdict.unproven > 0
    (damage,) = verdict.integrity.damages
    assert "wrong checksum" in damage.what


def test_behind_a_gap_the_proof_goes_on_at_a_key_frame(recorded, tmp_path):
    """A piece cut out of the middle: less is proven, and how much is reported."""
    largest = max(esea_host.open_log(recorded).pieces[1:-1], key=lambda p: p.end - p.offset)
    data = recorded.read_bytes()
    path = tmp_path / "b.mcap"
    path.write_bytes(data[: largest.offset] + data[largest.end :])
    cut = esea_host.open_log(path)
    verdict = verify(cut)
    assert verdict.same
    assert verdict.unproven > 0
    board_ns = cut["sense_in"].board_ns
    assert verdict.ticks + verdict.unproven == (board_ns[-1] - board_ns[0]) // 1_000_000 + 1
    assert np.ptp(np.diff(board_ns)) > 0
    assert cut.state is RecordingState.DAMAGED


@pytest.mark.ci
def test_a_device_of_ones_own_is_taken_from_the_recording(recorded):
    log = esea_host.open_log(recorded)
    shipped = device_of(log)
    log.facts["device"] = "mine"
    assert device_of(log).digest == shipped.digest
    assert device_of(log) is not shipped


def test_what_cannot_be_computed_again_is_refused(recorded, tmp_path, monkeypatch):
    drive_log = esea_host.open_log(recorded)
    monkeypatch.setattr("esea_host.recording.replay.format_hash", lambda *_: "another")
    with pytest.raises(UserError, match=r"this tree's is another.*sources\.zip"):
        verify(drive_log)
