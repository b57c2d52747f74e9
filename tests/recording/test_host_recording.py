"""Recordings: other programs' readers, the rest of a cut file, rejected files."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from random import Random

import numpy as np
import pytest
from mcap.reader import make_reader

import esea_host
from esea_gen.errors import UserError
from esea_host.recording import Gap, GapError, Recorder, RecordingState, StreamColumn, StreamLayout
from esea_host.recording.export import longest, play
from esea_host.recording.log import Table
from tests.conftest import ROOT
from tests.fuzz.hostile import bomb, foreign_recording

LAYOUT = StreamLayout(
    "sense_out",
    (
        StreamColumn("sequence", "u4"),
        StreamColumn("tau_Nm", "f4", "Nm", "torque on the load"),
        StreamColumn("status", "u4"),
        StreamColumn("plan_rad", "f4", "rad", "", 3),
        *(StreamColumn(f"x{i}_rad", "f4", "rad") for i in range(20)),
    ),
)

SMALL = StreamLayout(
    "sense_out", (StreamColumn("sequence", "u4"), StreamColumn("tau_Nm", "f4", "Nm"))
)


def made(first: int, count: int) -> np.ndarray:
    rows = np.zeros(count, LAYOUT.dtype)
    rows["sequence"] = np.arange(first, first + count)
    rows["tau_Nm"] = np.sin(rows["sequence"] * 0.01)
    rows["plan_rad"] = rows["sequence"][:, None] * [1, 2, 3]
    return rows


def write(recorder: Recorder, rows: np.ndarray) -> None:
    board_ns = rows["sequence"].astype(np.int64) * 1_000_000
    recorder.rows(LAYOUT, rows, board_ns + 10**18, board_ns)


def varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        value |= (data[at] & 0x7F) << shift
        shift += 7
        at += 1
        if not data[at - 1] & 0x80:
            return value, at


def protobuf(data: bytes) -> list[tuple[int, object]]:
    """Fields of a message, read by the rules of its specification."""
    at, found = 0, []
    while at < len(data):
        key, at = varint(data, at)
        kind = key & 7
        if kind == 0:
            value, at = varint(data, at)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
            value, at = data[at : at + size], at + size
        else:
            assert kind == 2
            size, at = varint(data, at)
            value, at = data[at : at + size], at + size
        found.append((key >> 3, value))
    return found


def test_anybody_reads_it_by_the_schema_inside(tmp_path):
    """MCAP's own reader, and protobuf's rules applied by hand to the schema in the file."""
    rows = made(0, 700)
    rows["tau_Nm"][5] = np.frombuffer(struct.pack("<I", 0x7FC12345), "<f4")[0]  # NaN with a payload
    path = tmp_path / "a.mcap"
    with Recorder(path, {"facts.json": b"{}"}) as recorder:
        write(recorder, rows)
        recorder.note("the person sneezed", tick=3)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = list(reader.iter_messages("/sense_out"))
        notes = [json.loads(m.data) for _, _, m in reader.iter_messages("/note")]
        assert [a.name for a in reader.iter_attachments()] == ["facts.json"]
    assert notes == [{"text": "the person sneezed", "tick": 3}]
    assert len(found) == 700
    schema, channel, _ = found[0]
    assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
    (file,) = (v for n, v in protobuf(schema.data) if n == 1)
    top = dict(protobuf(file))
    message = protobuf(top[4])
    assert f"{top[2].decode()}.{dict(message)[1].decode()}" == schema.name
    fields = [dict(protobuf(v)) for n, v in message if n == 2]
    assert [f[1].decode() for f in fields] == [c.name for c in LAYOUT.columns]
    # FieldDescriptorProto: number, label (3: repeated), type (2: float, 7: fixed32).
    assert [(f[3], f[4], f[5]) for f in fields[:4]] == [(1, 1, 7), (2, 1, 2), (3, 1, 7), (4, 3, 2)]
    for row, (_, _, m) in zip(rows, found, strict=True):
        values = dict(protobuf(m.data))
        assert values[1] == struct.pack("<I", row["sequence"])
        assert values[2] == row["tau_Nm"].tobytes()
        assert values[4] == row["plan_rad"].tobytes()
        assert m.log_time - m.publish_time == 10**18


def test_arrays_and_frames_with_units(tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder(path, compress=True) as recorder:
        write(recorder, made(10, 300))
        write(recorder, made(310, 5))
    with esea_host.open_log(path) as log:
        table = log["sense_out"]
        assert log.whole
        assert np.array_equal(table.rows, made(10, 305))
        assert table.time_s == pytest.approx(np.arange(305) * 1e-3)
        frame = table.frame()
        assert frame.attrs["units"]["tau_Nm"] == "Nm"
        assert frame.attrs["meanings"]["tau_Nm"] == "torque on the load"
        assert list(frame.columns[3:6]) == ["plan_rad[0]", "plan_rad[1]", "plan_rad[2]"]
        assert frame["plan_rad[2]"].iloc[7] == 3 * 17
        with pytest.raises(UserError, match="no column tau"):
            table["tau"]
        with pytest.raises(UserError, match=r"no stream wrist.*sense_out"):
            log["wrist"]


def test_nothing_is_overwritten_and_no_other_file_is_read(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"somebody's")
    with pytest.raises(UserError, match="already exists"):
        Recorder(path)
    assert path.read_bytes() == b"somebody's"
    with pytest.raises(UserError, match="not an MCAP file"):
        esea_host.open_log(path)
    with pytest.raises(UserError, match="cannot be opened"):
        esea_host.open_log(tmp_path / "b.mcap")


def flip(path: Path, at: int, bit: int = 0) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1 << bit
    path.write_bytes(data)


def small(path: Path, compress: bool = False) -> bytes:
    """Three pieces, a note and an attachment."""
    rows = np.zeros(6, SMALL.dtype)
    rows["sequence"] = np.arange(6)
    ns = np.arange(6) * 1_000_000
    with Recorder(path, {"a": b"{}"}, compress, piece_s=0) as recorder:
        for first in range(0, 6, 2):
            part = slice(first, first + 2)
            recorder.rows(SMALL, rows[part], ns[part], ns[part])
        recorder.note("a try")
    return path.read_bytes()


def content(log) -> tuple:
    return log["sense_out"].rows.tobytes(), log.events("note"), log.attachments


@pytest.mark.ci
@pytest.mark.parametrize("compress", [False, True])
def test_no_changed_byte_and_no_cut_leaves_a_complete_recording(tmp_path, compress):
    """Cut at, or with a random bit flipped in, every second byte; what is read was written."""
    path = tmp_path / "a.mcap"
    data = small(path, compress)
    with esea_host.open_log(path) as log:
        assert (log.state, log.integrity.damages) == (RecordingState.COMPLETE, ())
        rows, notes, attached = content(log)
    random = Random(7)
    one_by_one = {rows[i : i + 8] for i in range(0, 48, 8)}
    for at in range(0, len(data), 5 if compress else 2):
        flipped = bytes([data[at] ^ 1 << random.randrange(8)])
        for changed in (data[:at], data[:at] + flipped + data[at + 1 :]):
            path.write_bytes(changed)
            try:
                log = esea_host.open_log(path)
            except UserError:
                assert at < 8 or len(changed) < 9
                continue
            assert log.state is not RecordingState.COMPLETE, at
            if "sense_out" in log.streams:
                found = [row.tobytes() for row in log["sense_out"].rows]
                assert one_by_one.issuperset(found)
                assert found == sorted(found)
            assert all(n in notes for n in log.events("note"))
            assert log.attachments in (attached, {})
            log.close()


@pytest.mark.parametrize("compress", [False, True])
def test_a_wrong_length_costs_one_piece(tmp_path, compress):
    path = tmp_path / "a.mcap"
    data = small(path, compress)
    place = esea_host.open_log(path).pieces[1].offset
    for byte in range(1, 9):
        path.write_bytes(data[: place + byte] + b"\x81" + data[place + byte + 1 :])
        log = esea_host.open_log(path)
        (damage,) = log.integrity.damages
        assert "lengths contradict" in damage.what or "end of the file" in damage.what
        assert log.integrity.lost == {"sense_out": 2}
        assert log["sense_out"].tick.tolist() == [0, 1, 4, 5]
        assert [(g.after_tick, g.before_tick) for g in log.gaps if g.stream == "sense_out"] == [
            (1, 4)
        ]


class Stopped(np.ndarray):
    def tolist(self):
        signal.raise_signal(signal.SIGINT)
        return super().tolist()


def test_ctrl_c_while_rows_are_written_leaves_them_complete(tmp_path):
    ns = np.arange(10)
    # What a program started in the background ignores.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt), Recorder(tmp_path / "a.mcap") as recorder:
        recorder.rows(LAYOUT, made(0, 10), ns.view(Stopped), ns)
    signal.signal(signal.SIGINT, before)
    with esea_host.open_log(tmp_path / "a.mcap") as log:
        assert (log.whole, log["sense_out"].rows.tobytes()) == (True, made(0, 10).tobytes())


def test_a_file_that_is_deleted_ends_its_recording_and_the_next_one_of_its_name_stays(tmp_path):
    with Recorder(path := tmp_path / "a.mcap", piece_s=0) as recorder:
        path.unlink()
        path.write_bytes(b"another")
        with pytest.raises(UserError, match="the file was deleted"):
            write(recorder, made(10, 10))
    assert path.read_bytes() == b"another"


@pytest.mark.parametrize("limit_bytes", [7000, pytest.param(100_001, marks=pytest.mark.ci)])
def test_a_full_disk_leaves_what_was_written(tmp_path, limit_bytes):
    """A limit on the file's size, as a full disk: in any piece, and in the closing index."""
    path = tmp_path / "a.mcap"
    script = (
        "import resource, sys\n"
        "from tests.recording.test_host_recording import Recorder, made, write\n"
        "from esea_gen.errors import UserError\nresource.setrlimit(resource.RLIMIT_FSIZE, "
        f"({limit_bytes}, resource.RLIM_INFINITY))\n"
        "with Recorder(sys.argv[1], {'facts.json': b'{}'}, piece_s=0) as r:\n"
        "    try:\n        for i in range(10**6):\n            write(r, made(10 * i, 10))\n"
        "    except UserError as error:\n        print(error)\n"
    )
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'host'}"}
    command = [sys.executable, "-c", script, str(path)]
    said = subprocess.run(command, capture_output=True, text=True, env=env, cwd=ROOT, check=True)
    assert "recording ended, the disk is full" in said.stdout
    with esea_host.open_log(path) as log:
        assert log.state is RecordingState.DISK_FULL
        rows = log["sense_out"].rows
        assert len(rows) * LAYOUT.dtype.itemsize > 0.4 * limit_bytes - 6000
        assert np.array_equal(rows, made(0, len(rows)))


def test_recordings_of_other_tools(tmp_path):
    """Outside chunks, lz4, ROS 2: JSON is read, and what is not decoded is named."""
    path = tmp_path / "a.mcap"
    for compression in ("NONE", "LZ4", "ZSTD"):
        for chunked in (True, False):
            path.write_bytes(foreign_recording(compression, chunked))
            with esea_host.open_log(path) as log:
                assert log.state is RecordingState.COMPLETE
                assert not log.integrity.checked
                assert [e["a"] for e in log.events("log")] == [1] * 20
                assert log.spans()["joint"][0] == 20
                with pytest.raises(UserError, match=r"joint is cdr \(/joint\); only"):
                    log["joint"]


def test_a_bomb_is_not_unpacked(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(bomb(Random(3)))
    with esea_host.open_log(path) as log:
        whats = {d.what.partition(" (")[0] for d in log.integrity.damages}
    assert any("unpacks to" in w or "would unpack" in w for w in whats)


@pytest.mark.parametrize("compress", [False, True])
def test_a_damaged_piece_is_a_gap_and_a_figure_across_it_is_refused(tmp_path, compress):
    path = tmp_path / "a.mcap"
    with Recorder(path, compress=compress, piece_s=0) as recorder:
        for first in range(0, 50, 10):
            write(recorder, made(first, 10))
    second = esea_host.open_log(path).pieces[2]
    flip(path, second.data + (second.end - second.data) // 2)
    log = esea_host.open_log(path)
    table = log["sense_out"]
    assert table.tick.tolist() == [*range(20), *range(30, 50)]
    assert log.gaps == (Gap("sense_out", 19, 30, -1, "recording", 19_000_000),)
    assert log.integrity.lost == {"sense_out": 10}
    assert log.integrity.damages[0].offset == second.offset
    with pytest.raises(GapError, match=r"runs missing between ticks 19 and 30.*damaged"):
        table.between(0.005, 0.045)
    assert len(table.between(0.0305, 0.0495)) == 19
    assert [p.tick.tolist() for p in table.pieces()] == [[*range(20)], [*range(30, 50)]]


def test_a_recorded_gap_refuses_too_and_so_does_an_unmarked_one(tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder(path, {"facts.json": b'{"simulated": true}'}) as recorder:
        write(recorder, made(0, 20))
        recorder.gap(Gap("sense_out", 19, 25, 5, "link", 19_000_000))
        write(recorder, made(25, 20))
        write(recorder, made(46, 4))  # a hole that nobody wrote down
        recorder.gap(Gap("sense_out", 49, -1, -1, "disconnected", 49_000_000))
    played = [json.loads(line) for line in play(esea_host.open_log(path), "sense_out", 1e6)]
    assert [i for i, x in enumerate(played) if "gap" in x] == [20, 45]
    assert all(x["simulated"] for x in played if "gap" not in x)
    table = esea_host.open_log(path)["sense_out"]
    with pytest.raises(
        GapError, match=r"5 runs missing between ticks 19 and 25: .*lost on the way"
    ):
        table.between(0.0, 0.044)
    with pytest.raises(GapError, match="uneven"):
        table.between(0.03, 0.05)
    assert len(table.between(0.025, 0.045)) == 20
    rows = np.concatenate([made(5, 10), made(2, 30), made(1, 3)])  # of a board that starts again
    assert len(longest(Table(LAYOUT, rows, np.arange(43) * 10**6, 0))) == 30


WRITER = """
import sys, time
import numpy as np
sys.path.insert(0, sys.argv[2])
from tests.recording.test_host_recording import Recorder, made, write
recorder = Recorder(sys.argv[1], {"facts.json": b"{}"})
print("started", flush=True)
start, tick = time.monotonic(), 0
while True:
    due = int((time.monotonic() - start) * 1000)
    if due > tick:
        write(recorder, made(tick, due - tick))
        tick = due
        print(tick, flush=True)
    time.sleep(0.005)
"""


def lost_by_kill(folder: Path, moment_s: float) -> tuple[int, int]:
    """Ticks that had been handed to the recorder, and those that are left after kill -9."""
    path = folder / f"{moment_s:.6f}.mcap"
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'host'}"}
    command = [sys.executable, "-c", WRITER, str(path), str(ROOT)]
    writer = subprocess.Popen(command, stdout=subprocess.PIPE, env=env, cwd=ROOT)
    assert writer.stdout.readline() == b"started\n"
    time.sleep(moment_s)
    writer.send_signal(signal.SIGKILL)
    told, _ = writer.communicate()
    handed = int((told.split() or [b"0"])[-1])
    log = esea_host.open_log(path)
    assert not log.whole
    if not log.streams:
        return handed, 0
    rows = log["sense_out"].rows
    assert np.array_equal(rows, made(0, len(rows)))
    return handed, len(rows)


RANDOM = Random(16)


@pytest.mark.parametrize("moment_s", [RANDOM.uniform(0.02, 2.5)])
def test_after_kill_nine_at_most_a_second_is_gone(tmp_path, moment_s):
    handed, left = lost_by_kill(tmp_path, moment_s)
    assert left <= handed + 100  # said a moment later than written
    assert handed - left <= 1000
