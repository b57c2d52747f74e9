"""Figures of link and recording: ``python -m tests.benchmarks.link --json FILE``.

All on the simulated board.  What is compared is compared in the same run, on the same bytes.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.files import write_json
from esea_gen.link.transport import RECEIVE_CHUNK_BYTES
from esea_host.connection.decoder import TelemetryDecoder
from esea_host.connection.receiver import KEY, Receiver
from esea_host.recording.log import open_log
from esea_host.recording.writer import Recorder
from esea_host.simulated.drive import SimulatedBoard
from esea_host.simulated.lockstep import LockstepDevice
from esea_host.simulated.noise import NoisyTransport
from tests.benchmarks.live_view import memory_bytes, plot_latency, window_soak

PIECE_BYTES = 4096
SAMPLE_S = 20.0
FUZZED_BYTES = 10_000_000
PLOTTED_S = 20.0
SOAKED_HOURS = 1.0
STREAM = "sense_out"
PAIRS = 7


class _Bytes:
    # A link that gives what it was given, a piece at a time.

    def __init__(self, data: bytes, piece: int = PIECE_BYTES) -> None:
        self.data, self.at, self.piece = data, 0, piece

    def read(self, timeout_s: float) -> bytes:
        found = self.data[self.at : self.at + self.piece]
        self.at += self.piece
        return found

    def write(self, data: bytes, timeout_s: float) -> None:
        """Nobody listens."""

    def close(self) -> None:
        """Nothing to let go of."""

    def said(self) -> str:
        return ""


def _timed(work: Callable[[], Any]) -> float:
    start_s = time.process_time()
    work()
    return time.process_time() - start_s


def record_bytes(drive: SimulatedBoard, seconds: float) -> tuple[bytes, LockstepDevice]:
    """What a board sends in so long, every run of every task told, and the device that asked."""
    device = LockstepDevice(drive)
    device.listen()
    out = bytearray()
    for _ in range(round(seconds * 1000)):
        drive.tick()
        out += drive.read()
    return bytes(out), device


def decoding(
    data: bytes, dialect: Any, seconds: float, piece_bytes: int = PIECE_BYTES
) -> dict[str, float]:
    """Processor time of decoding, ours and pymavlink's own, of the same bytes.

    piece_bytes: handed over at a time; a transport hands over at most ``RECEIVE_CHUNK_BYTES``.
    """

    def ours() -> None:
        decoder, link = TelemetryDecoder(dialect), _Bytes(data, piece_bytes)
        while piece := link.read(0.0):
            decoder.feed(piece)

    def theirs() -> None:
        parser, link = dialect.MAVLink(None), _Bytes(data, piece_bytes)
        while piece := link.read(0.0):
            parser.parse_buffer(piece)

    def plain() -> None:
        parser = dialect.MAVLink(None)
        for byte in data:
            parser.parse_char(bytes((byte,)))

    # In turn, for others use the computer as well: it is as fast for both of a pair.
    pairs = np.array([(_timed(ours), _timed(theirs)) for _ in range(PAIRS)])
    (ours_s, theirs_s), plain_s = np.median(pairs, axis=0).tolist(), _timed(plain)
    return {
        "piece_bytes": piece_bytes,
        "ours_s": ours_s,
        "pymavlink_parse_buffer_s": theirs_s,
        "pymavlink_parse_char_s": plain_s,
        "times_real_time": seconds / ours_s,
        "faster_than_parse_buffer": float(np.median(pairs[:, 1] / pairs[:, 0])),
        "faster_than_parse_buffer_least": float(np.min(pairs[:, 1] / pairs[:, 0])),
        "faster_than_parse_char": plain_s / ours_s,
    }


def fuzzed(data: bytes, dialect: Any, total_bytes: int, seed: int = 16) -> dict[str, Any]:
    """A bad line: what came through wrong, and whether every loss is in a gap."""
    truth = {
        r["sequence"].item(): r.tobytes() for b in _rows(_Bytes(data), dialect) for r in b.rows
    }
    wrong = taken = missing = unmarked = 0
    accidents: dict[str, int] = {}
    health: dict[str, int] = {}
    rounds = max(1, math.ceil(total_bytes / len(data)))
    for i in range(rounds):
        noise = NoisyTransport(_Bytes(b""), seed + i, 2000.0)
        batches = _rows(_Bytes(noise.damage(data)), dialect, health)
        ticks = [t for b in batches for t in b.rows["sequence"].tolist()]
        wrong += sum(truth[r["sequence"].item()] != r.tobytes() if r["sequence"].item() in truth
                     else True for b in batches for r in b.rows)  # fmt: skip
        taken += len(ticks)
        lost = ticks[-1] - ticks[0] + 1 - len(ticks)
        marked = sum(g.missing for b in batches for g in b.gaps)
        missing += lost
        unmarked += abs(lost - marked)
        for kind, count in noise.accidents.items():
            accidents[kind] = accidents.get(kind, 0) + count
    return {
        "bytes": rounds * len(data),
        "accidents": accidents,
        "rows_taken": taken,
        "wrong_rows_taken": wrong,
        "rows_missing": missing,
        "missing_rows_not_in_a_gap": unmarked,
        **health,
    }


def _rows(link: _Bytes, dialect: Any, health: dict[str, int] | None = None) -> list[Any]:
    receiver = Receiver(link, TelemetryDecoder(dialect), 1_000_000)
    queue = receiver.subscribe([STREAM], 10_000_000)
    while receiver.pump(0.0):
        pass
    for name, count in vars(receiver.health).items() if health is not None else ():
        assert health is not None
        health[name] = health.get(name, 0) + count
    return queue.take(0.0)


def long_run(drive: SimulatedBoard, minutes: float, folder: Path) -> dict[str, float]:
    """1 kHz of all columns, recorded: losses, processor share, memory.  Simulated time."""
    drive.restart()
    device = LockstepDevice(drive)
    path = folder / "long.mcap"
    board_s = host_s = 0.0
    with device.record(path) as recording:
        device.advance(5.0)  # what is made once is made
        first_bytes = memory_bytes()
        for _ in range(round(minutes * 60)):
            start_s = time.process_time()
            data = bytearray()
            for _ in range(1000):
                drive.tick()
                data += drive.read()
            board_s += time.process_time() - start_s
            drive.write(device._heartbeat())
            start_s = time.process_time()
            for at in range(0, len(data), PIECE_BYTES):
                device.receiver.take(bytes(data[at : at + PIECE_BYTES]))
                recording.drain(0.0)
            host_s += time.process_time() - start_s
        grown_bytes = memory_bytes() - first_bytes
        rows = recording.rows
    size_bytes = path.stat().st_size
    start_s = time.perf_counter()
    with open_log(path) as log:
        found = next(log.read(STREAM))
        first_plot_s = time.perf_counter() - start_s
        layouts = [log.file.layout(s) for s in log.streams if s != KEY]
        columns = sum(c.size for layout in layouts if layout for c in layout.columns)
        whole = len(log[STREAM])
        whole_s = time.perf_counter() - start_s
        gaps = len(log.gaps)
    assert len(found)
    return {
        "minutes": minutes,
        "columns": columns,
        "rows": rows,
        "gaps": gaps,
        "expected_minus_recorded": round(minutes * 60000) + 5000 - whole,
        "host_processor_share": host_s / (minutes * 60),
        "simulated_board_processor_share": board_s / (minutes * 60),
        "memory_growth_bytes": grown_bytes,
        "file_bytes": size_bytes,
        "open_to_first_rows_s": first_plot_s,
        "open_and_read_one_stream_s": whole_s,
    }


def hour_open(drive: SimulatedBoard, folder: Path, hours: float) -> dict[str, float]:
    """Time to open a recording of an hour to its first rows; its content is one stream's."""
    drive.restart()
    data, device = record_bytes(drive, 2.0)
    batch = _rows(_Bytes(data), device.session.dialect)
    layout = batch[0].layout
    rows = np.concatenate([b.rows for b in batch])[:1000].copy()
    path = folder / "hour.mcap"
    with Recorder(path, piece_s=1e9) as recorder:
        for second in range(round(hours * 3600)):
            rows["sequence"] = np.arange(second * 1000, second * 1000 + 1000)
            ns = rows["sequence"].astype(np.int64) * 1_000_000
            recorder.rows(layout, rows, ns, ns)
    start_s = time.perf_counter()
    with open_log(path) as log:
        next(log.read(STREAM))
        first_s = time.perf_counter() - start_s
    return {"hours": hours, "file_bytes": path.stat().st_size, "open_to_first_rows_s": first_s}


def latency(drive: SimulatedBoard, seconds: float) -> dict[str, float]:
    """From a byte at the host to its row at a reader in another thread, in real time."""
    drive.restart()
    data, device = record_bytes(drive, seconds)
    link = _Paced(data, seconds)
    receiver = Receiver(link, TelemetryDecoder(device.session.dialect), 1_000_000)
    queue = receiver.subscribe([STREAM])
    receiver.start()
    found_s = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        for batch in queue.take(0.1):
            found_s += [(time.time_ns() - batch.arrived_ns) * 1e-9] * len(batch.rows)
    receiver.close()
    p50, p99 = np.percentile(found_s, [50, 99])
    return {"rows": len(found_s), "p50_ms": float(p50) * 1e3, "p99_ms": float(p99) * 1e3}


class _Paced(_Bytes):
    # As fast as the board sent it.

    def __init__(self, data: bytes, seconds: float) -> None:
        super().__init__(data)
        self.start_s, self.rate = time.monotonic(), len(data) / seconds

    def read(self, timeout_s: float) -> bytes:
        due = min(len(self.data), int((time.monotonic() - self.start_s) * self.rate))
        if due <= self.at:
            time.sleep(0.001)
            return b""
        found = self.data[self.at : due]
        self.at = due
        return found


def measure(
    minutes: float,
    fuzzed_bytes: int = FUZZED_BYTES,
    hours: float = 1.0,
    sample_s: float = SAMPLE_S,
    drive: SimulatedBoard | None = None,
    plotted_s: float = PLOTTED_S,
    soaked_hours: float = SOAKED_HOURS,
) -> dict[str, Any]:
    """All figures.

    minutes: of simulated time of the long run.
    hours: of the recording that is opened.
    sample_s: of the bytes that are decoded and damaged.
    drive: powered on; default: a new one.
    plotted_s: of the live view, in real time; 0: without it.
    soaked_hours: of the board's time through the live view; 0: without it.
    """
    board = drive or SimulatedBoard("elbow_drive")
    board.restart()
    data, device = record_bytes(board, sample_s)
    dialect = device.session.dialect
    with tempfile.TemporaryDirectory() as folder:
        found = {
            "simulated": True,
            "bytes_per_s": len(data) / sample_s,
            "decoding": decoding(data, dialect, sample_s),
            "decoding_large_pieces": decoding(data, dialect, sample_s, RECEIVE_CHUNK_BYTES),
            "fuzzed": fuzzed(data, dialect, fuzzed_bytes),
            "long_run": long_run(board, minutes, Path(folder)),
            "hour": hour_open(board, Path(folder), hours),
            "latency_to_reader": latency(board, min(3.0, sample_s)),
            "latency_to_plot": plot_latency(plotted_s) if plotted_s else {},
            "live_view": window_soak(board, soaked_hours) if soaked_hours else {},
            "peak_memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        }
    if drive is None:
        board.close()
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--minutes", type=float, default=1.0, help="simulated; of the long run")
    parser.add_argument("--fuzzed-bytes", type=int, default=FUZZED_BYTES)
    parser.add_argument("--hours", type=float, default=1.0, help="of the recording that is opened")
    parser.add_argument("--plotted", type=float, default=PLOTTED_S, help="seconds of live view")
    parser.add_argument("--soaked", type=float, default=SOAKED_HOURS, help="hours through it")
    given = parser.parse_args()
    found = measure(
        given.minutes,
        given.fuzzed_bytes,
        given.hours,
        plotted_s=given.plotted,
        soaked_hours=given.soaked,
    )
    print(json.dumps(found, indent=1))
    write_json(given.json, "host-bench", found)
