"""How the board's clock runs against the host's, from the pairs that a recording holds.

New recordings hold the host's monotonic clock, which nobody sets, and how far the wall clock is
ahead of it: steps of the wall clock are read off, and do not enter the fit.  Older recordings hold
the wall clock alone.  There steps are searched for in the pairs, and the interval allows for one
that is too small to be detected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_host.recording.log import Log

Floats = npt.NDArray[np.float64]

FEWEST, SHORTEST_S = 10, 10.0
REAL_TIME_PPM = 10_000.0
# Of a wall clock that is slewed, not set: NTP's fastest rate, and what two readings can be apart.
SLEW_PPM, READING_NS = 500.0, 300_000.0
# Pairs times the logarithm of the share by which a step lessens the loss.  Without a step simulated
# arrivals (uniform, exponential, Pareto, log-normal, correlated) stayed below 23 in 960 runs.
EVIDENCE, MOST_STEPS = 30.0, 8
MOST_POINTS, EDGE, SPLITS = 300, 3, 12
MOST_NS = 1 << 61
QUANTILE = 0.25  # late arrivals are late, never early
Z_95, Z_99 = 1.96, 2.576


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
    """The board's clock by the host's: ``host_ns = board_ns + offset_ns + drift * board_ns``.

    Parameters
    ----------
    drift_ppm : float
        Above 0 the host counts more seconds than the board.
    low_ppm, high_ppm : float
        Ends of its 95 % interval; without the monotonic clock it allows for an unseen step.
    offset_ns : int
        Of the quickest arrivals, at the recording's beginning.
    late_p50_ms, late_p99_ms : float
        By how much arrivals are later than the quickest.
    pairs : int
        How many there are.
    steps : tuple of ClockStep
        Of the wall clock; without the monotonic clock a lasting change of the link's delay looks
        the same.
    monotonic : bool
        Whether the pairs are of the host's monotonic clock.
    malformed : int
        Events ``clock`` that hold no pair, and were left out.
    """

    drift_ppm: float
    low_ppm: float
    high_ppm: float
    offset_ns: int
    late_p50_ms: float
    late_p99_ms: float
    pairs: int
    steps: tuple[ClockStep, ...] = ()
    monotonic: bool = False
    malformed: int = 0

    def __str__(self) -> str:
        if abs(self.drift_ppm) > REAL_TIME_PPM:
            return "the board's time did not run in real time"
        span = f"{self.low_ppm:+.1f} to {self.high_ppm:+.1f}"
        steps = "".join(f"; {s}" for s in self.steps)
        if self.steps and not self.monotonic:
            steps += " (or the link's delay changed)"
        if self.malformed:
            steps += f"; {self.malformed} events of the clock are malformed, and left out"
        return (
            f"host's seconds against the board's {self.drift_ppm:+.1f} ppm ({span}); rows came "
            f"{self.late_p50_ms:.1f} ms (median) to {self.late_p99_ms:.1f} ms (99 %) after the "
            f"quickest{steps}"
        )


def clock_fit(log: Log) -> ClockFit | None:
    """Offset and drift between board and host.

    Theil and Sen's slope [1]_: the median of the slopes between any two pairs with no step between
    them, which single late arrivals do not move.

    Parameters
    ----------
    log : Log
        With the event ``clock``, once a second.

    References
    ----------
    .. [1] P. K. Sen, "Estimates of the regression coefficient based on Kendall's tau", Journal of
       the American Statistical Association 63, 1968.
    """
    written = log.events("clock")
    events = [e for e in written if _is_count(e.get("host_ns")) and _is_count(e.get("board_ns"))]
    pairs = np.array([(e["host_ns"], e["board_ns"]) for e in events], np.int64)
    if len(pairs) < FEWEST:
        return None
    host_ns, board_ns = pairs[:, 0], pairs[:, 1]
    # In whole numbers: nanoseconds since 1970 are more than a double holds.
    ahead_ns = (host_ns - host_ns[0] - (board_ns - board_ns[0])).astype(float)
    at_s = (board_ns - board_ns[0]) * 1e-9
    if at_s[-1] < SHORTEST_S:
        return None
    few = _quickest(at_s, ahead_ns)
    monotonic = all(_is_count(e.get("wall_ahead_ns")) for e in events)
    steps = _set_steps(at_s, events) if monotonic else _found_steps(at_s[few], ahead_ns[few])
    moved_ns = np.zeros_like(ahead_ns)
    if not monotonic:
        for step in steps:
            moved_ns += 1e6 * step.size_ms * (at_s >= step.at_s)
    edges = [] if monotonic else [int(np.searchsorted(at_s[few], s.at_s)) for s in steps]
    slope, low, high = _sen(at_s[few], ahead_ns[few], edges, Z_95)
    if not monotonic:
        for split in np.linspace(0, len(few), SPLITS + 2)[1:-1].astype(int).tolist():
            other = _sen(at_s[few], ahead_ns[few], sorted({*edges, split}), Z_99)
            low, high = min(low, other[1]), max(high, other[2])
    late_ns = ahead_ns - moved_ns - slope * at_s
    late_ms = (late_ns - late_ns.min()) * 1e-6
    p50, p99 = np.percentile(late_ms, [50, 99])
    offset_ns = int(host_ns[0]) - int(board_ns[0]) + round(float(late_ns.min()))
    ppm = 1e-3  # ns a second
    ends = slope * ppm, low * ppm, high * ppm
    late = float(p50), float(p99)
    malformed = len(written) - len(events)
    return ClockFit(*ends, offset_ns, *late, len(pairs), tuple(steps), monotonic, malformed)


def _is_count(value: Any) -> bool:
    # A recording may come from anybody; differences of two differences stay within 64 bits.
    return type(value) is int and abs(value) < MOST_NS


def _set_steps(at_s: Floats, events: Sequence[dict[str, Any]]) -> list[ClockStep]:
    # Read off: the wall clock against the monotonic one, both of the host.
    moved_ns = np.diff([float(e["wall_ahead_ns"]) for e in events])
    most_ns = READING_NS + 1e3 * SLEW_PPM * np.abs(np.diff(at_s))
    return [
        ClockStep(float(at_s[i + 1]), float(moved_ns[i]) * 1e-6)
        for i in np.flatnonzero(np.abs(moved_ns) > most_ns)
    ]


def _quickest(at_s: Floats, ahead_ns: Floats) -> npt.NDArray[np.int64]:
    # Of a long recording the quickest arrival of each of 300 stretches.
    count, third = len(at_s), len(at_s) // 3
    if count <= MOST_POINTS:
        return np.arange(count)
    ends = [np.median(x[-third:]) - np.median(x[:third]) for x in (ahead_ns, at_s)]
    late_ns = ahead_ns - ends[0] / ends[1] * at_s
    parts = np.array_split(np.arange(count), MOST_POINTS)
    return np.array([part[np.argmin(late_ns[part])] for part in parts])


def _sen(
    at_s: Floats, ahead_ns: Floats, edges: Sequence[int], z: float
) -> tuple[float, float, float]:
    # Slope and interval from the pairs between edges.  Kendall's variances add up.
    slopes, variance = [], 0.0
    for first, last in zip([0, *edges], [*edges, len(at_s)], strict=True):
        i, j = np.triu_indices(last - first, 1)
        apart_s = at_s[first:last][j] - at_s[first:last][i]
        rise_ns = ahead_ns[first:last][j] - ahead_ns[first:last][i]
        slopes.append(rise_ns[apart_s != 0] / apart_s[apart_s != 0])
        n = last - first
        variance += n * (n - 1) * (2 * n + 5) / 18
    ranked = np.sort(np.concatenate(slopes))
    half, middle = z * variance**0.5 / 2, len(ranked) / 2
    low = ranked[max(0, int(middle - half) - 1)]
    high = ranked[min(len(ranked) - 1, int(middle + half) + 1)]
    return float(np.median(ranked)), float(low), float(high)


def _found_steps(at_s: Floats, ahead_ns: Floats) -> list[ClockStep]:
    # One after another, as long as one more explains the pairs far better than none.
    count = len(at_s)
    places = np.arange(EDGE, count - EDGE + 1)
    after = (np.arange(count) >= places[:, None]).astype(float)
    line = np.stack([np.ones(count), (at_s - at_s.mean()) / (at_s[-1] - at_s[0])], axis=1)
    chosen: list[int] = []
    while True:
        base = np.concatenate([line, after[[k - EDGE for k in chosen]].T], axis=1)
        sizes, loss = _quantile_fit(base, ahead_ns)
        if len(chosen) == MOST_STEPS:
            break
        _, losses = _quantile_fit(
            np.concatenate(
                [np.broadcast_to(base, (len(places), *base.shape)), after[..., None]], axis=2
            ),
            ahead_ns,
        )
        evidence = count * np.log(loss / np.maximum(losses, 1e-9 * loss + 1e-300))
        near = np.array([min((abs(k - c) for c in chosen), default=EDGE) < EDGE for k in places])
        best = int(np.argmax(np.where(near, -1.0, evidence)))
        if near[best] or evidence[best] < EVIDENCE:
            break
        chosen = sorted([*chosen, int(places[best])])
    return [
        ClockStep(float(at_s[k]), float(size) * 1e-6)
        for k, size in zip(chosen, sizes[2:], strict=True)
    ]


def _quantile_fit(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    # Of the line below which a quarter of the points lie, by reweighted squares; x may be a stack.
    weights = np.ones(x.shape[:-1])
    least = 1e-3 * float(np.median(np.abs(np.diff(y)))) + 1.0
    for _ in range(25):
        square = np.einsum("...np,...n,...nq->...pq", x, weights, x, optimize=True)
        right = np.einsum("...np,...n,n->...p", x, weights, y, optimize=True)
        square += 1e-9 * square[..., :1, :1] * np.eye(x.shape[-1])
        found = np.linalg.solve(square, right[..., None])[..., 0]
        off = y - np.einsum("...np,...p->...n", x, found)
        weights = np.where(off > 0, QUANTILE, 1 - QUANTILE) / np.maximum(np.abs(off), least)
    return found, np.sum(np.where(off > 0, QUANTILE, QUANTILE - 1) * off, axis=-1)
