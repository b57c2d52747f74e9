"""Measures of the motor-learning task for reaches to fixed targets, from any recording.

Applicable: whether a target was reached and held, how long that took, the squared error on the way,
how far beyond the target the hand went, speed, smoothness.  Not applicable: tracking and
after-effects, because no target moves, and FE and RU, which a hand on a screen does not have.
Lengths are shares of the distance to the target, for pixels have no size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.recording.log import Table
from esea_host.smoothness import NoAnswerError, sparc, submovements
from esea_host.wrist.analysis import LEAST_PEAK
from esea_host.wrist.moving import HOLD_S, REACH_S

Array = npt.NDArray[np.float64]
COLUMNS = ("x_px", "y_px", "target_x_px", "target_y_px", "inside")
SSE_RATE_HZ = 100.0
LEAST_SAMPLES = 10


@dataclass(frozen=True)
class ScreenReach:
    """achieved: held 0.75 s within 10 s, from reach_s; sse, beyond: over the distance."""

    samples: int
    duration_s: float
    peak_px_s: float
    mean_px_s: float
    achieved: bool
    reach_s: float | None
    sse: float | None
    beyond: float
    away: bool
    sparc: float | None
    submovements: float | None


def reaches(table: Table) -> tuple[tuple[ScreenReach, ...], tuple[str, ...]]:
    """Every reach from the first change of target on, and why some are left out."""
    missing = [c for c in COLUMNS if c not in table.names]
    if missing:
        raise UserError(
            f"The recording has no column {', '.join(missing)}.",
            "examples/reach_stroke.toml is the mapping that makes them.",
        )
    time_s = table.time_s
    x, y, target_x, target_y, inside = (np.asarray(table[c], np.float64) for c in COLUMNS)
    new = np.flatnonzero((np.diff(target_x) != 0) | (np.diff(target_y) != 0)) + 1
    if not len(new):
        raise UserError("No target changes in it.", "Record at least one reach.")
    found, left_out = [], []
    for first, last in zip(new, [*new[1:], len(x)], strict=True):
        part = slice(int(first), int(last))
        aim, at = np.array([target_x[first], target_y[first]]), np.column_stack([x, y])[part]
        if why := _unmeasured(time_s[part], at, aim):
            left_out.append(f"reach from {time_s[first]:.2f} s: {why}")
        else:
            found.append(_reach(time_s[part], at, aim, inside[part] > 0.5))
    return tuple(found), tuple(left_out)


def _unmeasured(time_s: Array, at: Array, aim: Array) -> str:
    # Why a reach has no measures; empty where it has.
    steps = np.diff(time_s)
    if len(at) < LEAST_SAMPLES:
        return f"{len(at)} samples, and {LEAST_SAMPLES} are needed"
    if not np.isfinite([*at, aim]).all():
        return "a position is missing"
    if steps.min() <= 0:
        return "its times do not rise"
    if steps.max() >= HOLD_S:
        return f"{steps.max():.2f} s without a sample"
    return "it begins on its target" if (at[0] == aim).all() else ""


def _reach(time_s: Array, at: Array, aim: Array, inside: npt.NDArray[np.bool_]) -> ScreenReach:
    t = time_s - time_s[0]
    speed = np.hypot(np.gradient(at[:, 0], t), np.gradient(at[:, 1], t))
    way = aim - at[0]
    distance = float(np.hypot(*way))
    done_s = _held(t, inside)
    errors = np.sum((at - aim) ** 2, axis=1)
    until = t <= (t[-1] if done_s is None else done_s + HOLD_S)
    along = (at - at[0]) @ way / distance**2
    steps = np.diff(t[until], prepend=0.0)
    sse = float(np.sum(errors[until] * steps)) * SSE_RATE_HZ / distance**2
    first = along[np.abs(along) > LEAST_PEAK]
    smooth, count = _smoothness(t, at)
    return ScreenReach(
        *(len(t), float(t[-1]), float(np.max(speed)), float(np.mean(speed))),
        *(done_s is not None, done_s, None if done_s is None else sse),
        *(float(max(np.max(along) - 1.0, 0.0)), bool(len(first) and first[0] < 0)),
        *(smooth, count),
    )


def _held(t: Array, inside: npt.NDArray[np.bool_]) -> float | None:
    # Beginning of the first stay of HOLD_S.
    since: float | None = None
    for now, within in zip(t, inside, strict=True):
        since = (now if since is None else since) if within else None
        if since is not None and now - since >= HOLD_S:
            return float(since) if now <= REACH_S else None
    return None


def _smoothness(t: Array, at: Array) -> tuple[float | None, float | None]:
    step = float(np.median(np.diff(t)))
    even = np.arange(0.0, t[-1], step)
    speed = np.hypot(*(np.gradient(np.interp(even, t, c), step) for c in at.T))
    found: list[float | None] = []
    for measure in (sparc, submovements):
        try:
            found.append(float(np.asarray(measure(speed, 1.0 / step).value)))
        except NoAnswerError:
            found.append(None)
    return found[0], found[1]


def summary(found: Sequence[ScreenReach]) -> dict[str, Any]:
    def median(name: str) -> float | None:
        values = [v for x in found if (v := getattr(x, name)) is not None]
        return float(np.median(values)) if values else None

    names = ("reach_s", "sse", "beyond", "peak_px_s", "sparc", "submovements")
    return {
        "reaches": len(found),
        "achieved": sum(x.achieved for x in found),
        "away_first": sum(x.away for x in found),
        "without_sparc": sum(x.sparc is None for x in found),
        **{n: median(n) for n in names},
    }
