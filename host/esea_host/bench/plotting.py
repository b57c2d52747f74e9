"""From a sample's arrival to its picture: the live view on a board in a process of its own."""

from __future__ import annotations

import os
import time

import numpy as np


def plot_latency(seconds: float, address: str = "sim:elbow_drive") -> dict[str, float]:
    """How old samples are when the live view has painted them, in real time, without a screen.

    Every sample counts from when its bytes came to the end of the first painting that shows it.
    """
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from PySide6.QtCore import QTimer
    from PySide6.QtWidgets import QApplication

    from esea_host.connection import open_device
    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.live import LiveWindow

    application = QApplication.instance() or QApplication([])
    found_s: list[float] = []
    took_s: list[float] = []
    with open_device(address) as device:
        feed = LiveFeed(device)
        queue = device.subscribe(["sense_out"])
        window = LiveWindow(feed)
        window.resize(1280, 860)
        window.show()
        waiting: list[tuple[float, int]] = []  # last board time of a batch, and its arrival
        draw, start_s = window.draw, time.monotonic()

        def drawn() -> None:
            begun_s = time.perf_counter()
            shown = feed.rings["sense_out"].last(1).time_s
            draw()
            window._area.viewport().repaint()
            now_ns = time.time_ns()
            took_s.append(time.perf_counter() - begun_s)
            for batch in queue.take(0.0):
                for ns in batch.board_ns.tolist():
                    waiting.append((ns * 1e-9, batch.arrived_ns))
            while waiting and len(shown) and waiting[0][0] <= shown[0]:
                arrived_ns = waiting.pop(0)[1]
                if time.monotonic() - start_s > 1.0:  # what is made once is made
                    found_s.append((now_ns - arrived_ns) * 1e-9)

        window.draw = drawn  # type: ignore[method-assign]
        QTimer.singleShot(int((seconds + 1) * 1000), application.quit)
        application.exec()
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
        "gaps": gaps,
    }
