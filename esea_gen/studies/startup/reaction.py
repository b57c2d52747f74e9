"""The drive's reaction to a jump of the command, seen in counts and not by any model.

The mean over all jumps of a recording, each turned the same way, of the second difference of the
motor's counts.  A motor with a lag does not jump with its command, but from one tick on its
acceleration grows: the curve has a bend there, the sharpest that it has.  To a tick or two that is
the delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_gen.language.ports import Array
from esea_gen.studies.startup.watch import DriveRecording

BEFORE, AFTER = 20, 50  # ticks
SIDE = 5  # ticks on either side of a bend, for the two slopes
LEAST_SHARE = 0.5  # of the largest jump, in a tick


@dataclass(frozen=True)
class JumpResponse:
    """Mean acceleration about a jump, less the parabola that it was on before.

    time_s: from the start of the tick that commands the jump, shape (n,).
    seen_rad_s2, model_rad_s2: by the counts, and by the numbers that were found.
    bend_s: tick of the sharpest bend.
    jumps: how many.
    """

    time_s: Array
    seen_rad_s2: Array
    model_rad_s2: Array
    bend_s: float
    jumps: int


def jump_response(recording: DriveRecording, model_rad_s2: Array) -> JumpResponse:
    """From a recording with jumps of the command.

    model_rad_s2: what the found numbers say of the acceleration, a row a tick.
    """
    h = recording.tick_s
    u = recording.u_Nm
    step = np.diff(u, prepend=u[0])
    at = np.flatnonzero(np.abs(step) > LEAST_SHARE * np.max(np.abs(step)))
    at = at[(at > BEFORE) & (at < len(u) - AFTER)]
    # A jump that the rate limit spreads over two ticks counts once, and none may follow at once.
    at = at[np.diff(at, prepend=-AFTER) > BEFORE]
    seen = np.zeros(len(u))
    seen[1:-1] = np.diff(recording.gear_rad, 2) / h**2
    ticks = np.arange(-BEFORE, AFTER)
    rows = at[:, None] + ticks
    way = np.sign(step[at])[:, None]
    # A second difference reaches one tick ahead.
    early = ticks < -1

    def mean(x: Array) -> Array:
        y = np.mean(way * x[rows], axis=0)
        before = np.polynomial.Polynomial.fit(ticks[early], y[early], 2)
        return np.asarray(y - before(ticks))

    found = mean(seen)
    return JumpResponse(
        np.asarray(ticks * h), found, mean(model_rad_s2), float(ticks[bend(found)] * h), len(at)
    )


def bend(curve: Array) -> int:
    """Where the slope after a point is largest over the slope before it."""
    line = np.arange(SIDE + 1) - 0.5 * SIDE
    slope = np.correlate(curve, line, "valid") / (line @ line)
    return SIDE + int(np.argmax(slope[SIDE:] - slope[:-SIDE]))


__all__ = ["JumpResponse", "bend", "jump_response"]
