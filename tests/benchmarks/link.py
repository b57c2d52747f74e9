"""Benchmark of link, recording and live view: ``python -m tests.benchmarks.link``.

All on the simulated board.  What is compared is compared in the same run, on the same bytes.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.link.transport import RECEIVE_CHUNK_BYTES
from esea_host.connection.decoder import TelemetryDecoder
from esea_host.connection.receiver import Receiver
from esea_host.recording.log import open_log
from esea_host.recording.writer import Recorder
from esea_host.simulated.drive import LockstepDevice, SimulatedBoard

from .live_view import memory_bytes, plot_latency, window_soak

PIECE_BYTES = 4096
SAMPLE_S = 20.0
STREAM = "sense_out"
PAIRS = 7


class _Bytes:
    # A link that gives recorded bytes, a piece at a time, or as fast as the board sent them.

    def __init__(self, data: bytes, piece: int = PIECE_BYTES, seconds: float = 0.0) -> None:
        self.data, self.at, self.piece = data, 0, piece
        self.start_s, self.rate = time.monotonic(), len(data) / seconds if seconds else 0.0

    def read(self, timeout_s: float) -> bytes:
        due = self.at + self.piece
        if self.rate:
            due = int((time.monotonic() - self.start_s) * self.rate)
            if due <= self.at:
                time.sleep(0.001)
                return b""
        found = self.data[self.at : due]
        self.at += len(found)
        return found

    def write(self, data: bytes, timeout_s: float) -> None:
        pass

    def close(self) -> None:
        pass

    def said(self) -> str:
        return ""


class _TimedBoard:
    # A simulated board that counts its own processor time.

    def __init__(self, drive: SimulatedBoard) -> None:
        self._drive, self.used_s = drive, 0.0

    def tick(self) -> None:
        start_s = time.process_time()
        self._drive.tick()
        self.used_s += time.process_time() - start_s

    def __getattr__(self, name: str) -> Any:
        return getattr(self._drive, name)


def _timed(work: Callable[[], Any]) -> float:
    start_s = time.process_time()
    work()
    return time.process_time() - start_s


def record_bytes(drive: SimulatedBoard, seconds: float) -> tuple[bytes, LockstepDevice]:
    """What a board sends, every run of every task streamed, and the device that asked."""
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


def long_run(drive: SimulatedBoard, minutes: float, folder: Path) -> dict[str, float]:
    """1 kHz of all columns, recorded: losses, processor share, memory.  Simulated time."""
    drive.restart()
    board = _TimedBoard(drive)
    device = LockstepDevice(board)
    path = folder / "long.mcap"
    with device.record(path) as recording:
        device.advance(5.0)  # what is made once is made
        first_bytes, first_s, start_s = memory_bytes(), board.used_s, time.process_time()
        for _ in range(round(minutes * 60)):
            device.advance(1.0)
            recording.drain(0.0)
        board_s = board.used_s - first_s
        host_s = time.process_time() - start_s - board_s
        grown_bytes, rows = memory_bytes() - first_bytes, recording.rows
    with open_log(path) as log:
        whole, gaps = len(log[STREAM]), len(log.gaps)
    return {
        "minutes": minutes,
        "rows": rows,
        "gaps": gaps,
        "expected_minus_recorded": round(minutes * 60000) + 5000 - whole,
        "host_processor_share": host_s / (minutes * 60),
        "simulated_board_processor_share": board_s / (minutes * 60),
        "memory_growth_bytes": grown_bytes,
        "file_bytes": path.stat().st_size,
    }


def hour_open(drive: SimulatedBoard, folder: Path, hours: float) -> dict[str, float]:
    """Time to open a recording of an hour to its first rows; its content is one stream's."""
    drive.restart()
    data, device = record_bytes(drive, 2.0)
    receiver = Receiver(_Bytes(data), TelemetryDecoder(device.session.dialect), 1_000_000)
    queue = receiver.subscribe([STREAM], 10_000_000)
    while receiver.pump(0.0):
        pass
    batch = queue.take(0.0)
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
    link = _Bytes(data, seconds=seconds)
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


def measure(
    drive: SimulatedBoard,
    minutes: float,
    hours: float,
    sample_s: float,
    plotted_s: float,
    soaked_hours: float,
) -> dict[str, Any]:
    """All figures; 0 plotted seconds or soaked hours leave the live view out."""
    drive.restart()
    data, device = record_bytes(drive, sample_s)
    dialect = device.session.dialect
    with tempfile.TemporaryDirectory() as folder:
        return {
            "simulated": True,
            "bytes_per_s": len(data) / sample_s,
            "decoding": decoding(data, dialect, sample_s),
            "decoding_large_pieces": decoding(data, dialect, sample_s, RECEIVE_CHUNK_BYTES),
            "long_run": long_run(drive, minutes, Path(folder)),
            "hour": hour_open(drive, Path(folder), hours),
            "latency_to_reader": latency(drive, min(3.0, sample_s)),
            "latency_to_plot": plot_latency(plotted_s) if plotted_s else {},
            "live_view": window_soak(drive, soaked_hours) if soaked_hours else {},
            "peak_memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="simulated; of the long run")
    parser.add_argument("--hours", type=float, default=1.0, help="of the recording that is opened")
    parser.add_argument("--plotted", type=float, default=20.0, help="seconds of live view")
    parser.add_argument("--soaked", type=float, default=1.0, help="hours through it")
    given = parser.parse_args()
    board = SimulatedBoard("elbow_drive")
    found = measure(board, given.minutes, given.hours, SAMPLE_S, given.plotted, given.soaked)
    board.close()
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
