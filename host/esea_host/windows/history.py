"""The last minutes of a stream in a memory of fixed size, and curves that a screen can hold."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esea_host.connection.receiver import Batch
from esea_host.recording.layout import Array, StreamLayout

Floats = npt.NDArray[np.float64]
LAST_S = 120.0
SAME_S = 1e-6


@dataclass(frozen=True)
class Stretch:
    """Rows of a stream, oldest first; ``first`` rows had come before them."""

    first: int
    time_s: Floats
    rows: Array
    after_gap: npt.NDArray[np.bool_]

    def between(self, start_s: float, end_s: float) -> Stretch:
        """The part between two times, both included; no copy."""
        a = int(np.searchsorted(self.time_s, start_s - SAME_S, "left"))
        b = max(a, int(np.searchsorted(self.time_s, end_s + SAME_S, "right")))
        rows = self.rows[a:b]
        return Stretch(self.first + a, self.time_s[a:b], rows, self.after_gap[a:b])


class RowRing:
    """Keeps the newest rows of a stream; its memory is taken once and never grows."""

    def __init__(self, layout: StreamLayout, most_rows: int) -> None:
        self.layout, self.most_rows = layout, most_rows
        # Ones are written; zeros are only promised, and taken page by page until the ring is full.
        self._rows = np.ones(most_rows * layout.dtype.itemsize, np.uint8).view(layout.dtype)
        # Rows whole, not column by column: thirty times as fast.
        self._whole = self._rows.view(f"V{layout.dtype.itemsize}")
        self._time_s = np.ones(most_rows)
        self._after_gap = np.ones(most_rows, bool)
        self._lock = threading.Lock()
        self.total = 0

    @property
    def nbytes(self) -> int:
        return self._rows.nbytes + self._time_s.nbytes + self._after_gap.nbytes

    def extend(self, batch: Batch) -> None:
        after_gap = np.zeros(len(batch.rows), bool)
        for gap in batch.gaps:
            after_gap |= batch.rows["sequence"] == gap.before_tick
        kept = slice(max(0, len(batch.rows) - self.most_rows), None)
        with self._lock:
            self.total += len(batch.rows)
            count = len(batch.rows[kept])
            places = np.arange(self.total - count, self.total) % self.most_rows
            self._whole[places] = batch.rows[kept].view(self._whole.dtype)
            self._time_s[places] = batch.board_ns[kept] * 1e-9
            self._after_gap[places] = after_gap[kept]

    def last(self, rows: int | None = None) -> Stretch:
        with self._lock:
            held = min(self.total, self.most_rows)
            count = held if rows is None else min(rows, held)
            first = self.total - count
            start = first % self.most_rows
            parts = slice(start, start + count), slice(0, max(0, start + count - self.most_rows))
            held_in = self._time_s, self._whole, self._after_gap
            time_s, whole, gaps = (np.concatenate([a[p] for p in parts]) for a in held_in)
            return Stretch(first, time_s, whole.view(self.layout.dtype), gaps)

    def newest(self) -> Array | None:
        with self._lock:
            return self._rows[(self.total - 1) % self.most_rows].copy() if self.total else None


def curve(stretch: Stretch, values: Floats, most_points: int) -> tuple[Floats, Floats]:
    """A curve of at most so many points that shows every peak, and every gap as a hole."""
    broken = np.flatnonzero(stretch.after_gap[1:]) + 1
    group = -(-len(values) * 2 // most_points) if len(values) else 1
    if group <= 2:
        holes = np.full(len(broken), np.nan)
        return np.insert(stretch.time_s, broken, holes), np.insert(values, broken, holes)
    start = -stretch.first % group
    count = (len(values) - start) // group
    part = slice(start, start + count * group)
    folded = values[part].reshape(count, group)
    time_s = stretch.time_s[part].reshape(count, group)
    drawn = np.stack([folded.min(1), folded.max(1)], axis=1)
    # The group that a gap falls into is left out: it would be bridged.
    drawn[stretch.after_gap[part].reshape(count, group).any(1)] = np.nan
    return np.stack([time_s[:, 0], time_s[:, -1]], axis=1).ravel(), drawn.ravel()


def spans(time_s: Floats, held: Array, joined_s: float) -> list[tuple[float, float]]:
    """From when to when something held; nearer than ``joined_s`` they count as one."""
    edges = np.flatnonzero(np.diff(held.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    if not len(edges):
        return []
    starts, ends = time_s[edges[:, 0]], time_s[edges[:, 1] - 1]
    apart = starts[1:] - ends[:-1] > joined_s
    return list(
        zip(
            starts[np.r_[True, apart]].tolist(),
            np.maximum(ends, starts)[np.r_[apart, True]].tolist(),
            strict=True,
        )
    )
