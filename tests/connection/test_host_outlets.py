"""Streams by name, clocks of board and host, outlets to other programs."""

from __future__ import annotations

import platform
import sys
import types

import numpy as np
import pytest

import esea_host
from esea_gen.errors import UserError
from esea_host.connection.outlets import FoxgloveOutlet, LslOutlet
from esea_host.connection.receiver import Batch
from esea_host.recording.clock import clock_fit
from esea_host.recording.integrity import Gap
from esea_host.recording.layout import StreamColumn, StreamLayout
from esea_host.recording.writer import Recorder
from esea_host.simulated import LockstepDevice


@pytest.fixture
def device(simulated_elbow):
    simulated_elbow.restart()
    return LockstepDevice(simulated_elbow)


def test_values_by_name_and_rate_are_recorded_bit_for_bit(device, tmp_path):
    named = device.listen_named(["tau_Nm", "u_Nm", "limits_status", "sense.count_motor"], 100)
    assert named == ["chosen"]
    path = tmp_path / "a.mcap"
    with pytest.raises(UserError, match="no stream 'tau_Nm'"):
        device.record(path, ["tau_Nm"])  # which begins no file
    with device.record(path, [*named, "sense_in", "sense_out"]):
        device.advance(0.5)
    with esea_host.open_log(path) as log:
        chosen, whole = log["chosen"], log["sense_out"]
        assert np.all(np.diff(chosen.tick.astype(int)) == 10)
        assert len(chosen) >= 45
        assert chosen.units["tau_Nm"] == "Nm"
        assert chosen.layout.columns[3].kind == "u4"
        assert not log.gaps
        at = np.searchsorted(whole.tick, chosen.tick)
        inside = (at < len(whole)) & (chosen.tick >= whole.tick[0])
        for name in ("tau_Nm", "u_Nm", "limits_status"):
            a, b = chosen[name][inside], whole[name][at[inside]]
            assert a.tobytes() == b.tobytes(), name
        assert np.allclose(chosen.time_s[inside], whole.time_s[at[inside]])
    with pytest.raises(UserError, match="cannot be streamed"):
        device.listen_named(["nothing"])


def told(device, ticks):
    """Messages of a board, and the places of those with named values."""
    data, messages, at = bytearray(), [], 0
    for _ in range(ticks):
        device.drive.tick()
        data += device.drive.read()
    while at < len(data):
        end = at + 12 + data[at + 1]
        messages.append(bytes(data[at:end]))
        at = end
    number = device.session.dialect.MAVLINK_MSG_ID_ESEA_DATA
    own = [i for i, m in enumerate(messages) if int.from_bytes(m[7:10], "little") == number]
    return messages, own


def test_a_lost_message_of_named_values_is_a_gap_and_the_board_is_let_go(device, monkeypatch):
    (name,) = device.listen_named(["tau_Nm"], 200)
    queue = device.subscribe([name])
    messages, own = told(device, 300)
    lost = own[5]
    rows_in = messages[lost][10 + 16]
    device.receiver.take(b"".join(m for i, m in enumerate(messages) if i != lost))
    gaps = [g for b in queue.take(0.0) for g in b.gaps]
    assert [(g.stream, g.missing) for g in gaps] == [(name, rows_in)]
    assert gaps[0].reason == "link"
    monkeypatch.setattr(device.receiver.transport, "close", lambda: None)
    device.close()
    told(device, 1)
    assert told(device, 300)[1] == []


def test_drift_and_offset_of_the_clocks_are_found(tmp_path):
    rng = np.random.default_rng(7)
    drift, offset_ns = 37e-6, 1_795_000_000_123_456_789
    board_ns = (np.arange(120) * 1_000_000_000 + rng.integers(0, 10**6, 120)).astype(np.int64)
    late_ns = rng.exponential(4e6, 120).astype(np.int64)
    host_ns = offset_ns + board_ns + np.rint(drift * board_ns).astype(np.int64) + late_ns
    path = tmp_path / "a.mcap"
    with Recorder(path) as recorder:
        for h, b in zip(host_ns.tolist(), board_ns.tolist(), strict=True):
            recorder.event("clock", {"host_ns": h, "board_ns": b, "wall_ahead_ns": 0})
        for odd in ({}, {"host_ns": None}, {"host_ns": "1"}, {"host_ns": 1 << 70}):
            recorder.event("clock", {"board_ns": 2, "wall_ahead_ns": 0} | odd)
    with esea_host.open_log(path) as log:
        fit = clock_fit(log)
    assert fit.low_ppm < 37 < fit.high_ppm
    assert fit.drift_ppm == pytest.approx(37, abs=15)
    assert fit.offset_ns == pytest.approx(offset_ns, abs=2_000_000)
    assert fit.late_p50_ms == pytest.approx(4 * np.log(2), rel=0.4)  # median of the exponential
    assert (fit.pairs, fit.malformed) == (120, 4)
    assert "4 events of the clock are malformed" in str(fit)
    with Recorder(tmp_path / "b.mcap") as recorder:
        recorder.event("clock", {"host_ns": 1, "board_ns": 1})
    with esea_host.open_log(tmp_path / "b.mcap") as log:
        assert clock_fit(log) is None


LATE_MS = {
    "usb": lambda rng, n: rng.uniform(0, 1, n) + rng.exponential(0.1, n),
    "tcp": lambda rng, n: 0.3 * rng.pareto(1.5, n),
    "bursts": lambda rng, n: rng.exponential(0.5, n) + 80 * (rng.random(n) < 0.03) * rng.random(n),
}


def fitted(path, steps_ms, late_ms, drift=20e-6):
    """The fit of pairs a second apart; steps of the wall clock by time; a link that breaks."""
    at_s = np.arange(len(late_ms))
    late_ms = late_ms + 700 * (at_s > 1800)
    wall_ns = sum(round(ms * 1e6) * (at_s >= s) for s, ms in steps_ms.items()) + 0 * at_s
    host_ns = np.rint(at_s * (1 + drift) * 1e9 + late_ms * 1e6).astype(np.int64) + 1_795 * 10**15
    with Recorder(path) as recorder:
        recorder.gap(Gap("sense_out", 1, 2, -1, "disconnected", 1800 * 10**9))
        for host, wall, s in zip(host_ns.tolist(), wall_ns.tolist(), at_s.tolist(), strict=True):
            recorder.event("clock", {"host_ns": host, "board_ns": s * 10**9, "wall_ahead_ns": wall})
    with esea_host.open_log(path) as log:
        return clock_fit(log)


@pytest.mark.parametrize("late", LATE_MS)
def test_steps_of_the_wall_clock_are_read_off_and_leave_the_drift(tmp_path, late):
    late_ms = LATE_MS[late](np.random.default_rng(1), 3000)
    steps = {300: 1.0, 900: -1.0, 901: 100, 2000: -3600e3}
    fit = fitted(tmp_path / "a.mcap", steps, late_ms)
    assert {round(s.at_s): round(s.size_ms, 3) for s in fit.steps} == steps
    assert fit.low_ppm <= 20 <= fit.high_ppm < fit.low_ppm + 1
    assert "stepped by -1.0 ms at 900 s" in str(fit)


def test_arrivals_are_stamped_by_a_clock_that_nobody_sets(device, monkeypatch):
    from esea_host.connection import receiver as module

    receiver, real = device.receiver, module.time.time_ns
    assert abs(receiver.now_ns() - real()) < 10**9
    before = receiver.now_ns()
    monkeypatch.setattr(module.time, "time_ns", lambda: real() - 3600 * 10**9)
    assert receiver.now_ns() >= before
    assert receiver.wall_ahead_ns() == pytest.approx(-3600e9, abs=1e9)


LAYOUT = StreamLayout(
    "sense_out", (StreamColumn("sequence", "u4"), StreamColumn("tau_Nm", unit="Nm"))
)


def batch(first: int) -> Batch:
    rows = np.zeros(3, LAYOUT.dtype)
    rows["sequence"] = first + np.arange(3)
    rows["tau_Nm"] = rows["sequence"] * 0.5
    ns = rows["sequence"].astype(np.int64) * 1_000_000
    return Batch(LAYOUT, rows, ns, 5_000_000_000 + int(ns[-1]))


def test_foxglove_gets_the_recordings_own_messages(monkeypatch):
    logged, made, stopped = [], [], []
    library = types.SimpleNamespace(
        start_server=lambda **k: types.SimpleNamespace(port=1234, stop=lambda: stopped.append(k)),
        Schema=lambda **k: k,
        Channel=lambda topic, **k: (
            made.append((topic, k)),
            types.SimpleNamespace(log=lambda m, log_time: logged.append((m, log_time))),
        )[1],
    )
    monkeypatch.setitem(sys.modules, "foxglove", library)
    outlet = FoxgloveOutlet(0, simulated=True)
    assert outlet.said == "Foxglove: ws://127.0.0.1:1234"
    outlet.put(batch(100))
    outlet.put(batch(103))
    outlet.close()
    ((topic, told),) = made
    assert topic == "/sense_out"
    assert told["metadata"]["simulated"] == "1"
    assert told["schema"] == {
        "name": "esea.sense_out", "encoding": "protobuf", "data": LAYOUT.descriptor()
    }  # fmt: skip
    assert [LAYOUT.rows(m)["sequence"][0] for m, _ in logged] == list(range(100, 106))
    assert np.all(np.diff([t for _, t in logged]) == 1_000_000)  # the board's time, not arrival's
    assert stopped


def test_lsl_gets_numbers_by_name_with_the_boards_time(monkeypatch):
    pushed, labels, infos = [], [], []

    class Node:
        def append_child(self, _):
            return self

        def append_child_value(self, key, value):
            labels.append((key, value))

    def info(*words):
        infos.append(words)
        return types.SimpleNamespace(desc=Node)

    library = types.SimpleNamespace(
        StreamInfo=info,
        StreamOutlet=lambda _: types.SimpleNamespace(
            push_sample=lambda r, t: pushed.append((r, t))
        ),
        local_clock=iter([10.0, 10.5, 21.0, 32.0]).__next__,
    )
    monkeypatch.setitem(sys.modules, "pylsl", library)
    outlet = LslOutlet("elbow_drive", "serial:COM3", {"sense_out": 1000.0}, simulated=True)
    outlet.put(batch(100))
    outlet.put(batch(103))
    (*about, source), *_ = infos
    assert about == ["elbow_drive sense_out", "Mocap", 1, 1000.0, "double64"]
    assert source == f"elbow_drive sense_out of serial:COM3 at {platform.node()}"  # of two boards
    assert labels == [("simulated", "1"), ("label", "tau_Nm"), ("unit", "Nm")]
    assert [r for r, _ in pushed] == [[50.0], [50.5], [51.0], [51.5], [52.0], [52.5]]
    # The second batch came late: the first one's arrival counts, and steps are the board's.
    assert [t for _, t in pushed] == pytest.approx(10.0 + 0.001 * np.arange(-2, 4))
    outlet.put(batch(10_097))
    outlet.put(batch(20_094))
    assert pushed[-1][1] == pytest.approx(30.997)  # drift: not the first arrival


def test_the_rate_of_a_stream_is_as_the_board_rounds_it(device):
    device.listen(["sense_out", "control_out"], 150)
    assert device.rates_Hz == {"sense_out": pytest.approx(1e3 / 6), "control_out": 100}
