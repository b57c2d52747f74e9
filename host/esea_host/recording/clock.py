"""How the board's clock runs against the host's, from the pairs that a recording holds.

The host's side is its monotonic clock, which nobody sets; how far the wall clock is ahead of it is
recorded beside it, so that steps of the wall clock are read off and do not enter the fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy  # its parts are read on first use

from esea_host.recording.log import Log

Floats = npt.NDArray[np.float64]

FEWEST, SHORTEST_S = 10, 10.0
REAL_TIME_PPM = 10_000.0
# Of a wall clock that is slewed, not set: NTP's fastest rate, and what two readings can be apart.
SLEW_PPM, READING_NS = 500.0, 300_000.0
MOST_POINTS = 300
MOST_NS = 1 << 61
NAMES = ("host_ns", "board_ns", "wall_ahead_ns")


@dataclass(frozen=True)
class ClockStep:
    """The host's wall clock was set.

    at_s: on the board's clock, since the first pair.  size_ms: above 0 forward.
    """

    at_s: float
    size_ms: float

    def __str__(self) -> str:
        return f"the host's clock stepped by {self.size_ms:+.1f} ms at {self.at_s:.0f} s"


@dataclass(frozen=True)
class ClockFit:
    """The board's clock by the host's: ``host_ns = board_ns + offset_ns + drift * board_ns``."""

    drift_ppm: float  # above 0 the host counts more seconds than the board; its 95 % interval
    low_ppm: float
    high_ppm: float
    offset_ns: int  # of the quickest arrivals, at the beginning of what is fitted
    late_p50_ms: float  # by how much arrivals are later than the quickest
    late_p99_ms: float
    pairs: int
    steps: tuple[ClockStep, ...] = ()  # of the wall clock
    malformed: int = 0  # events ``clock`` that hold no pair, and were left out

    def __str__(self) -> str:
        if abs(self.drift_ppm) > REAL_TIME_PPM:
            return "the board's time did not run in real time"
        span = f"{self.low_ppm:+.1f} to {self.high_ppm:+.1f}"
        steps = "".join(f"; {s}" for s in self.steps)
        if self.malformed:
            steps += f"; {self.malformed} events of the clock are malformed, and left out"
        return (
            f"host's seconds against the board's {self.drift_ppm:+.1f} ppm ({span}); rows came "
            f"{self.late_p50_ms:.1f} ms (median) to {self.late_p99_ms:.1f} ms (99 %) after the "
            f"quickest{steps}"
        )


def clock_fit(log: Log) -> ClockFit | None:
    """Offset and drift between board and host.

    Theil and Sen's slope: the median of the slopes between any two pairs, which single late
    arrivals do not move (P. K. Sen, "Estimates of the regression coefficient based on Kendall's
    tau", Journal of the American Statistical Association 63, 1968).
    """
    written = log.events("clock")
    told = [[e.get(n) for n in NAMES] for e in written]
    pairs = np.array([x for x in told if all(map(_is_count, x))], np.int64).reshape(-1, 3)
    if len(pairs) < FEWEST:
        return None
    # Steps are read off: the wall clock against the monotonic one, both of the host.
    begin_ns, moved_ns = int(pairs[0, 1]), np.diff(pairs[:, 2])
    most_ns = READING_NS + 1e-6 * SLEW_PPM * np.abs(np.diff(pairs[:, 1]))
    steps = tuple(
        ClockStep((int(pairs[i + 1, 1]) - begin_ns) * 1e-9, float(moved_ns[i]) * 1e-6)
        for i in np.flatnonzero(np.abs(moved_ns) > most_ns)
    )
    # How long a board was away that started again, nobody knows: the longest part without that.
    breaks = sorted(g.board_ns for g in log.recorded_gaps if g.reason == "disconnected")
    part = np.searchsorted(breaks, pairs[:, 1])
    host_ns, board_ns, _ = pairs[part == np.bincount(part).argmax()].T
    # In whole numbers: nanoseconds since 1970 are more than a double holds.
    ahead_ns = (host_ns - host_ns[0] - (board_ns - board_ns[0])).astype(float)
    at_s = (board_ns - board_ns[0]) * 1e-9
    if len(at_s) < FEWEST or at_s[-1] < SHORTEST_S:
        return None
    few = _quickest(at_s, ahead_ns)
    slope, _, low, high = scipy.stats.theilslopes(ahead_ns[few], at_s[few], 0.95)
    late_ns = ahead_ns - slope * at_s
    p50, p99 = np.percentile((late_ns - late_ns.min()) * 1e-6, [50, 99]).tolist()
    offset_ns = int(host_ns[0]) - int(board_ns[0]) + round(float(late_ns.min()))
    drift_ppm, low_ppm, high_ppm = (float(x) * 1e-3 for x in (slope, low, high))  # from ns a second
    malformed = len(written) - len(pairs)
    fitted = drift_ppm, low_ppm, high_ppm, offset_ns, p50, p99
    return ClockFit(*fitted, len(at_s), steps, malformed)


def _is_count(value: Any) -> bool:
    # A recording may come from anybody; differences of two differences stay within 64 bits.
    return type(value) is int and abs(value) < MOST_NS


def _quickest(at_s: Floats, ahead_ns: Floats) -> npt.NDArray[np.int64]:
    # Of a long recording the quickest arrival of each of 300 stretches.
    count, third = len(at_s), len(at_s) // 3
    if count <= MOST_POINTS:
        return np.arange(count)
    ends = [np.median(x[-third:]) - np.median(x[:third]) for x in (ahead_ns, at_s)]
    late_ns = ahead_ns - ends[0] / ends[1] * at_s
    parts = np.array_split(np.arange(count), MOST_POINTS)
    return np.array([part[np.argmin(late_ns[part])] for part in parts])
