"""When frames were painted: intervals, frames dropped, and how late an onset came.  No window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

Lists = tuple[list[float], list[float], list[float]]


def summary(
    intervals_s: Sequence[float],
    delays_s: Sequence[float],
    refresh_Hz: float,
    ages_s: Sequence[float] = (),
) -> dict[str, Any]:
    found: dict[str, Any] = {"refresh_Hz": refresh_Hz, "intervals": len(intervals_s)}
    refreshes = np.round(np.asarray(intervals_s, np.float64) * refresh_Hz)
    found["dropped"] = int(np.sum(np.maximum(refreshes - 1, 0)))
    kinds = {"interval": intervals_s, "onset_delay": delays_s, "tick_to_frame": ages_s}
    for name, values in kinds.items():
        for share in (50, 95, 99, 100):
            ms = float(np.percentile(values, share)) * 1e3 if len(values) else None
            found[f"{name}_p{share}_ms"] = ms if ms is None else round(ms, 3)
    return found | {"onsets": len(delays_s)}


class FrameTimes:
    """When Qt painted, by the host's clock; light on the screen needs a photodiode."""

    def __init__(self, refresh_Hz: float) -> None:
        self.refresh_Hz = refresh_Hz
        self.facts: dict[str, Any] = {}
        self._last_s: float | None = None
        self._onsets, self._tick_s = 0, -math.inf
        self._trial: Lists = ([], [], [])
        self._all: Lists = ([], [], [])

    def painted(self, at_s: float, onsets: int, made_s: float, tick_s: float | None = None) -> bool:
        """A frame was painted; whether something appeared with it."""
        intervals, delays, ages = self._trial
        if tick_s is not None and tick_s > self._tick_s:
            ages.append(at_s - tick_s)
            self._tick_s = tick_s
        if self._last_s is not None:
            intervals.append(at_s - self._last_s)
        self._last_s = at_s
        new = onsets > self._onsets
        if new and made_s > 0:
            delays.append(at_s - made_s)
        self._onsets = onsets
        return new

    def take(self, whole: bool) -> dict[str, Any]:
        """Numbers since the last taking, or (whole) of every trial taken so far."""
        if whole:
            return self._summary(self._all) | self.facts
        taken, self._trial = self._trial, ([], [], [])
        for kept, new in zip(self._all, taken, strict=True):
            kept.extend(new)
        return self._summary(taken)

    def _summary(self, lists: Lists) -> dict[str, Any]:
        intervals, delays, ages = lists
        return summary(intervals, delays, self.refresh_Hz, ages)

    def drop(self) -> None:
        self._trial, self._last_s = ([], [], []), None
