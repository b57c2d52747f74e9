"""The drive's first reaction to a jump of the command, seen in counts and not by any model.

The mean over all jumps of a recording, each turned the same way, of the second difference of the
motor's counts.  Before the jump it goes along a parabola; where it leaves that for good the drive
has reacted.  That is an upper bound on the delay: the motor's lag lets the torque begin slowly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_gen.language.ports import Array
from esea_gen.studies.startup.watch import Recording

BEFORE, AFTER = 20, 50  # ticks
LEAVES, IN_A_ROW = 4.0, 3  # standard deviations, ticks
LEAST_SHARE = 0.5  # of the largest jump, in a tick


@dataclass(frozen=True)
class JumpResponse:
    """Mean acceleration about a jump, less what it was on the way to before.

    time_s: from the start of the tick that commands the jump, shape (n,).
    seen_rad_s2, model_rad_s2: by the counts, and by the numbers that were found.
    deviation_rad_s2: of the mean, before the jump.
    first_s: when the counts have left the parabola; None where they never do.
    jumps: how many.
    """

    time_s: Array
    seen_rad_s2: Array
    model_rad_s2: Array
    deviation_rad_s2: float
    first_s: float | None
    jumps: int


def jump_response(recording: Recording, model_rad_s2: Array) -> JumpResponse:
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
    curve = np.polynomial.Polynomial.fit

    def mean(x: Array) -> Array:
        y = np.mean(way * x[rows], axis=0)
        # Up to two ticks before: a second difference reaches one tick ahead.
        early = ticks < -1
        return np.asarray(y - curve(ticks[early], y[early], 2)(ticks))

    found = mean(seen)
    deviation = float(np.std(found[ticks < -1], ddof=3))
    after = np.flatnonzero(ticks >= 0)
    above = np.abs(found[after]) > LEAVES * deviation
    runs = np.flatnonzero(np.convolve(above, np.ones(IN_A_ROW), "valid") == IN_A_ROW)
    first = float(ticks[after[runs[0]]] * h) if len(runs) else None
    return JumpResponse(np.asarray(ticks * h), found, mean(model_rad_s2), deviation, first, len(at))


__all__ = ["JumpResponse", "jump_response"]
