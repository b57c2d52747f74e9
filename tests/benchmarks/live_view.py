"""The live view: from a sample's arrival to its picture, and its memory over hours."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from esea_host.connection import Batch, open_device
from esea_host.simulated import LockstepDevice, SimulatedBoard

PIECE_ROWS = 50  # of a stream that runs at every tick
PICTURE_S, MINUTE_S, WARM_S = 0.5, 60.0, 180.0  # of the board's time


def memory_bytes() -> int:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def application() -> Any:
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from PySide6.QtWidgets import QApplication

    return QApplication.instance() or QApplication([])


def plot_latency(seconds: float) -> dict[str, float]:
    """Age of samples at the end of the first painting that shows them, in real time, off screen."""
    qt = application()
    from PySide6.QtCore import QTimer

    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.live import LiveWindow

    found_s: list[float] = []
    took_s: list[float] = []
    with open_device("sim:elbow_drive") as device:
        feed = LiveFeed(device)
        queue = device.subscribe(["sense_out"])
        waiting: list[tuple[float, int]] = []  # last board time of a batch, and its arrival
        start_s = time.monotonic()

        class TimedWindow(LiveWindow):
            def draw(self) -> None:
                begun_s = time.perf_counter()
                shown = feed.rings["sense_out"].last(1).time_s
                super().draw()
                self.area.viewport().repaint()
                now_ns = time.time_ns()
                took_s.append(time.perf_counter() - begun_s)
                for batch in queue.take(0.0):
                    for ns in batch.board_ns.tolist():
                        waiting.append((ns * 1e-9, batch.arrived_ns))
                while waiting and len(shown) and waiting[0][0] <= shown[0]:
                    arrived_ns = waiting.pop(0)[1]
                    if time.monotonic() - start_s > 1.0:  # what is made once is made
                        found_s.append((now_ns - arrived_ns) * 1e-9)

        window = TimedWindow(feed)
        window.resize(1280, 860)
        window.show()
        used_s = time.process_time()
        QTimer.singleShot(int((seconds + 1) * 1000), qt.quit)
        qt.exec()
        used_s = time.process_time() - used_s
        frames, gaps = window.drawn_frames, device.receiver.gap_count
        window.close()
        feed.close()
    p50, p99 = np.percentile(found_s, [50, 99])
    return {
        "rows": len(found_s),
        "p50_ms": float(p50) * 1e3,
        "p99_ms": float(p99) * 1e3,
        "pictures_per_s": frames / (seconds + 1),
        "painting_p50_ms": float(np.median(took_s)) * 1e3,
        "processor_share": used_s / (seconds + 1),
        "gaps": gaps,
    }


def _pieces(drive: SimulatedBoard) -> tuple[LockstepDevice, dict[str, Batch]]:
    # Some milliseconds of every stream, as they came.
    drive.restart()
    device = LockstepDevice(drive)
    queue = device.subscribe()
    device.listen()
    device.advance(0.2)
    queue.take(0.0)
    for _ in range(PIECE_ROWS):
        drive.tick()
    device.pump()  # once: one batch of each stream, with all of its rows
    found = {batch.layout.name: batch for batch in queue.take(0.0)}
    device.receiver.unsubscribe(queue)
    return device, found


def window_soak(
    drive: SimulatedBoard,
    hours: float,
    warm_s: float = WARM_S,
    picture_s: float = PICTURE_S,
    channels: int = 0,
    every_s: float = MINUTE_S,
) -> dict[str, Any]:
    """Memory of the live view with every stream of the board in it, over hours of its time.

    warm_s: of the board's time, until the memory is measured, every ``every_s`` from then on.
    channels: drawn beside the panels' own signals, each with its spectrum.
    """
    qt = application()
    from PySide6.QtCore import Qt

    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.live import LiveWindow

    device, pieces = _pieces(drive)
    feed = LiveFeed(device, threaded=False)
    window = LiveWindow(feed)
    window.timer.stop()
    window.toggle_spectrum()
    for item in list(window.channels.items.values())[:channels]:
        item.setCheckState(0, Qt.CheckState.Checked)
    window.resize(1280, 860)
    window.show()
    counts = {n: len(b.rows) for n, b in pieces.items() if n in feed.rings}
    piece_s, rows, painted_s = PIECE_ROWS * 1e-3, 0, 0.0
    seen: list[tuple[float, int, int]] = []  # hour, pictures, memory
    for k in range(round(hours * 3600 / piece_s)):
        for name in counts:
            batch = pieces[name]
            moved = batch.rows.copy()
            moved["sequence"] += np.uint32(k * PIECE_ROWS)
            board_ns = batch.board_ns + k * PIECE_ROWS * device.identity.tick_us * 1000
            feed.receive(Batch(batch.layout, moved, board_ns, time.time_ns()))
            rows += len(moved)
        at_s = (k + 1) * piece_s
        if at_s - painted_s >= picture_s:
            painted_s = at_s
            feed.ask()
            window.draw()
            qt.processEvents()  # paints
        if at_s >= warm_s + every_s * len(seen):
            seen.append((at_s / 3600, window.drawn_frames, memory_bytes()))
    pictures = window.drawn_frames
    window.close()
    feed.close()
    at_h, at_picture, held = np.array(seen or [(0.0, 0, memory_bytes())]).T
    slope = float(np.polyfit(at_h, held, 1)[0]) if len(seen) > 2 else float("nan")
    return {
        "hours": hours,
        "rows": rows,
        "pictures": pictures,
        "memory_after_warm_up_bytes": float(held[0]),
        "memory_growth_bytes": float(held[-1] - held[0]),
        "memory_slope_bytes_per_hour": slope,
        "memory_bytes_by_picture": np.column_stack([at_picture, held]).astype(int).tolist(),
    }
