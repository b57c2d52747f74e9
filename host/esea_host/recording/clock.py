"""How the board's clock runs against the host's, from the pairs that a recording holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_host.recording.log import Log

FEWEST, SHORTEST_S = 10, 10.0
REAL_TIME_PPM = 10_000.0


@dataclass(frozen=True)
class ClockFit:
    """The board's clock by the host's: ``host_ns = board_ns + offset_ns + drift * board_ns``.

    Parameters
    ----------
    drift_ppm : float
        Above 0 the host counts more seconds than the board.
    low_ppm, high_ppm : float
        Ends of its 95 % interval.
    offset_ns : int
        Of the quickest arrivals, at the recording's beginning.
    late_p50_ms, late_p99_ms : float
        By how much arrivals are later than the quickest.
    pairs : int
        How many there are.
    """

    drift_ppm: float
    low_ppm: float
    high_ppm: float
    offset_ns: int
    late_p50_ms: float
    late_p99_ms: float
    pairs: int

    def __str__(self) -> str:
        if abs(self.drift_ppm) > REAL_TIME_PPM:
            return "the board's time did not run in real time"
        span = f"{self.low_ppm:+.1f} to {self.high_ppm:+.1f}"
        return (
            f"host's seconds against the board's {self.drift_ppm:+.1f} ppm ({span}); rows came "
            f"{self.late_p50_ms:.1f} ms (median) to {self.late_p99_ms:.1f} ms (99 %) after the "
            "quickest"
        )


def clock_fit(log: Log) -> ClockFit | None:
    """Offset and drift between board and host.

    Theil and Sen's slope [1]_: the median of the slopes of all pairs, which single late arrivals do
    not move.

    Parameters
    ----------
    log : Log
        With the event ``clock``, once a second.

    Returns
    -------
    ClockFit or None
        None where there are fewer than ten pairs, or less than ten seconds of them.

    References
    ----------
    .. [1] P. K. Sen, "Estimates of the regression coefficient based on Kendall's tau", Journal of
       the American Statistical Association 63, 1968.
    """
    from scipy.stats import theilslopes

    pairs = np.array([(e["host_ns"], e["board_ns"]) for e in log.events("clock")], np.int64)
    if len(pairs) < FEWEST:
        return None
    host_ns, board_ns = pairs[:, 0], pairs[:, 1]
    # In whole numbers: nanoseconds since 1970 are more than a double holds.
    ahead_ns = (host_ns - host_ns[0] - (board_ns - board_ns[0])).astype(float)
    at_s = (board_ns - board_ns[0]) * 1e-9
    if at_s[-1] < SHORTEST_S:
        return None
    found = theilslopes(ahead_ns, at_s, 0.95)
    late_ns = ahead_ns - found.slope * at_s
    late_ms = (late_ns - late_ns.min()) * 1e-6
    p50, p99 = np.percentile(late_ms, [50, 99])
    offset_ns = int(host_ns[0]) - int(board_ns[0]) + round(float(late_ns.min()))
    ppm = 1e-3  # ns a second
    return ClockFit(
        float(found.slope) * ppm,
        float(found.low_slope) * ppm,
        float(found.high_slope) * ppm,
        offset_ns,
        float(p50),
        float(p99),
        len(pairs),
    )
