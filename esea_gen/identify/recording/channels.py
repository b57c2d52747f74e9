"""Lag, backlash and dead zone between the two channels, fitted with the model.

A candidate moves the recorded deflection, and the model is fitted to the training samples' torque
again; the smallest misfit wins.  The deflection is moved, not the torque: between two samples a
noisy signal is quieter than at either, and a moved torque would fit best half-way.

Loss shifts the torque against the deflection by a share of the cycle, a lag by a time: only cycles
of different duration distinguish the two.  So the lag has a companion, the share of a cycle that
the model's loss is off by.  It is part of the deviation, and corrects the lag where the model's
loss is wrong at every rate alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from esea_gen.devices.numbers import Quantity
from esea_gen.devices.rubber import MAX_DEAD_ZONE_RAD
from esea_gen.identify.recording.conditions import least
from esea_gen.identify.recording.mapping import FITTABLE, MappingFile
from esea_gen.identify.recording.reading import (
    MIN_SAMPLES,
    beyond_rad,
    followed_rad,
    load_recordings,
    resample,
)
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.resampling import (
    FitRows,
    resampled,
    rests_on_one,
    whole_conditions,
)
from esea_gen.identify.recording.tables import ToFit
from esea_gen.language.ports import Array

LAG, BACKLASH, DEAD_ZONE = FITTABLE
PHASE = "share of a cycle"
RATES = 2.0  # by which cycles must differ, in duration and in speed, to tell lag from loss
MOST_LAG_S, CYCLE_SHARE = 0.5, 0.125  # of the shortest cycle that trains
REACH_SHARE = 0.4  # of the smallest amplitude that trains: a wider gap is no gap
POINTS, AGAIN, ROUNDS, CLOSE = 9, 5, 2, 1e-3
STEP = 1 / 200  # of the bounds, for derivatives
DEVIATIONS = 2.0  # a number that is not that far from 0 is not taken
AT_BOUND = 0.01
SAID = {
    LAG: ("ms", 1e3, "lag of the torque behind the deflection"),
    BACKLASH: ("mrad", 1e3, "backlash"),
    DEAD_ZONE: ("mrad", 1e3, "dead zone"),
}

TAKEN = {
    LAG: "taken out",
    BACKLASH: "taken out of the deflection",
    DEAD_ZONE: "the device's dead_zone_rad",
}
ELSE = {
    LAG: "A viscosity faster than the recording, and without a term in the model, "
    "makes the identified lag too small or negative.",
    BACKLASH: "A remaining lag of the torque looks like a gap if all cycles move at "
    "one rate; so does hysteresis that the model has otherwise.",
    DEAD_ZONE: "",
}


class ChannelModel(Protocol):
    """A torque model that is fitted to the training samples of moved recordings."""

    def start(self, recordings: list[Recording], /) -> None:
        """Look for its numbers everywhere; :meth:`solve` goes on from there."""

    def solve(self, recordings: list[Recording], /) -> float:
        """Fit it; the mean square torque error over data sets, Nm^2."""

    def torque_Nm(self, recordings: list[Recording], /) -> Array:
        """At the training rows, with the numbers of the last fit, shape (rows,)."""

    def linearised(self) -> tuple[Array, Array, Array, FitRows]:
        """Of the last fit: Jacobian (rows, numbers), residual, weights, and the rows' blocks."""


@dataclass(frozen=True)
class ChannelNumber:
    key: str  # in the mapping file, as torque.lag_s
    value: float  # what is taken, s or rad; 0 where it is not known
    found: float | None  # None where it could not be asked
    sigma: float | None
    why: str | None  # what keeps it from being taken: not known, or not seen; None for one that is

    def to_dict(self) -> dict[str, Any]:
        return vars(self) | {"status": "assumed" if self.why else "identified"}

    @property
    def quantity(self) -> Quantity | None:
        """As the mapping would have it; None where nothing is taken."""
        if self.why is not None:
            return None
        text = f"fitted with the model; standard deviation {self.sigma:.2g}"
        return Quantity(value=self.value, status="identified", source=text)

    @property
    def note(self) -> str:
        unit, factor, what = SAID[self.key]
        found = ""
        if self.found is not None and self.sigma is not None:
            numbers = (factor * self.found, factor * self.sigma)
            found = "{:.3g} {unit}, standard deviation {:.2g} {unit}".format(*numbers, unit=unit)
        head = f"{self.key} = 'fit': the {what} is"
        if self.why is not None:
            return f"{head} {self.why}{f' (found: {found})' if found else ''}; 0 is taken."
        other = f" {ELSE[self.key]}" if ELSE[self.key] else ""
        return (
            f"{head} {found}, and is {TAKEN[self.key]}.{other} "
            f"For other commands write {self.key.split('.')[1]} = {{ value = {self.value:.6g}, "
            'status = "identified", source = "identify" }.'
        )


def settled(
    source: MappingFile, model_of: Callable[[MappingFile, list[Recording]], ChannelModel]
) -> tuple[MappingFile, list[Recording], tuple[ChannelNumber, ...]]:
    """A mapping's recordings, with its fitted settings filled in."""
    asked = [k for k, q in source.fittable().items() if isinstance(q, ToFit)]
    if not asked:
        return source, load_recordings(source), ()
    bare = source.settled(dict.fromkeys(asked))
    recordings = load_recordings(bare)
    found = _found(recordings, asked, lambda: model_of(bare, recordings))
    done = source.settled({n.key: n.quantity for n in found})
    return done, load_recordings(done), tuple(found)


def _found(
    recordings: list[Recording], asked: Sequence[str], model_of: Callable[[], ChannelModel]
) -> list[ChannelNumber]:
    bounds = _bounds(recordings)
    why = {k: _not_asked(recordings, bounds[LAG][1]) if k == LAG else None for k in asked}
    keys = [k for k in asked if why[k] is None]
    if not keys:
        return [ChannelNumber(k, 0.0, None, None, why[k]) for k in asked]
    if LAG in keys:
        recordings = _inside(recordings, bounds[LAG][1])
    model, numbers = model_of(), dict.fromkeys(keys, 0.0)

    for first in (True, *(False,) * (ROUNDS + len(keys) - 2)):
        model.start([moved(r, numbers) for r in recordings])
        for k in keys:

            def cost(value: float, key: str = k) -> float:
                return model.solve([moved(r, numbers | {key: value}) for r in recordings])

            low, high = bounds[k]
            near = (high - low) / (POINTS - 1)
            if not first:
                low, high = max(low, numbers[k] - near), min(high, numbers[k] + near)
            numbers[k] = least(cost, low, high, POINTS if first else AGAIN, CLOSE * (high - low))
    sigma = _sharpened(model, recordings, numbers, bounds)
    return [
        ChannelNumber(k, 0.0, None, None, why[k])
        if k not in keys
        else _judged(k, numbers[k], sigma[k], bounds[k])
        for k in asked
    ]


def _judged(key: str, found: float, sigma: float, bounds: tuple[float, float]) -> ChannelNumber:
    low, high = bounds
    unit, factor, _ = SAID[key]
    near = AT_BOUND * (high - low)
    why = None
    if not abs(found) > DEVIATIONS * sigma:
        why = "not seen beyond two deviations"
    elif found > high - near or (low < 0 and found < low + near):
        end = f"{factor * math.copysign(high, found):.3g} {unit}"
        why = f"not known: it ends at the bound of the search, {end}"
    return ChannelNumber(key, 0.0 if why else found, found, sigma, why)


def moved(recording: Recording, numbers: Mapping[str, float]) -> Recording:
    """A recording whose deflection is the rubber's, at the torque's own samples."""
    r, theta = recording, recording.theta_rad
    late_s = numbers.get(LAG, 0.0) + numbers.get(PHASE, 0.0) * _durations_s(r)
    if np.any(late_s):
        theta = resample(r.time_s, theta, r.time_s - late_s)
    if numbers.get(BACKLASH):
        theta = followed_rad(theta, numbers[BACKLASH])
    if numbers.get(DEAD_ZONE):
        theta = beyond_rad(theta, numbers[DEAD_ZONE])
    return replace(r, theta_rad=theta)


def _durations_s(r: Recording) -> Array:
    # Of the cycle that each sample is in, or next to.
    out = np.full(len(r.time_s), float(r.time_s[-1]))
    for i, c in enumerate(r.cycles):
        first = 0 if i == 0 else c.start
        out[first:] = r.time_s[c.stop] - r.time_s[c.start]
    return out


def _trained(recordings: Sequence[Recording]) -> Array:
    # Duration and range of the cycles that train, shape (cycles, 2).
    rows = []
    for r in recordings:
        trains = np.zeros(len(r.time_s), dtype=bool)
        for s in r.sets:
            trains[s.training] = True
        spans = [(c.start, c.stop) for c in r.cycles] or [(0, len(r.time_s) - 1)]
        rows += [
            (float(r.time_s[b] - r.time_s[a]), float(np.ptp(r.theta_rad[a : b + 1])))
            for a, b in spans
            if 2 * np.count_nonzero(trains[a:b]) > b - a
        ]
    return np.array(rows).reshape(-1, 2)


def _bounds(recordings: Sequence[Recording]) -> dict[str, tuple[float, float]]:
    cycles = _trained(recordings)
    shortest, least = cycles.min(axis=0) if len(cycles) else (math.inf, math.inf)
    lag, gap = min(MOST_LAG_S, CYCLE_SHARE * shortest), min(1.0, REACH_SHARE * least / 2)
    return {LAG: (-lag, lag), BACKLASH: (0.0, gap), DEAD_ZONE: (0.0, min(gap, MAX_DEAD_ZONE_RAD))}


def _not_asked(recordings: Sequence[Recording], most_lag_s: float) -> str | None:
    # Why a lag could not be told from loss, before anything is fitted.
    if not all(r.timed for r in recordings):
        return "not known: no time was recorded"
    one_rate = _one_rate(_trained(recordings))
    if one_rate:
        return one_rate
    left = sum(len(s.training) for r in _inside(recordings, most_lag_s) for s in r.sets)
    return None if left >= MIN_SAMPLES else f"not known: {left} samples are left to train on"


def _one_rate(cycles: Array) -> str | None:
    if len(cycles) < 2:
        return "not known: fewer than two cycles train"
    for what, unit, x in (
        ("last", "s", cycles[:, 0]),
        ("move at", "rad/s", 2 * cycles[:, 1] / cycles[:, 0]),
    ):
        if x.max() < RATES * x.min():
            return (
                f"not known: the cycles that train {what} {x.min():.3g} to {x.max():.3g} {unit}, "
                f"below a factor of {RATES:g}, and within one rate lag and loss are one"
            )
    return None


def _inside(recordings: Sequence[Recording], most_lag_s: float) -> list[Recording]:
    # Training samples for which every candidate has a recorded deflection.
    out = []
    for r in recordings:
        t = r.time_s
        known = (t >= t[0] + most_lag_s) & (t <= t[-1] - most_lag_s)
        sets = tuple(replace(s, training=s.training[known[s.training]]) for s in r.sets)
        out.append(replace(r, sets=sets))
    return out


def _sharpened(
    model: ChannelModel,
    recordings: list[Recording],
    numbers: dict[str, float],
    bounds: Mapping[str, tuple[float, float]],
) -> dict[str, float]:
    """Standard deviations from blocks left out; a lag corrected for loss that the model lacks."""
    at = [moved(r, numbers) for r in recordings]
    model.solve(at)
    jacobian, residual, weight, rows = model.linearised()
    keys = [*numbers, *([PHASE] if LAG in numbers else [])]
    columns = []
    for k in keys:
        low, high = bounds.get(k, (-0.25, 0.25))
        value, step = numbers.get(k, 0.0), STEP * (high - low)
        ends = max(low, value - step), min(high, value + step)
        down, up = (
            model.torque_Nm([moved(r, numbers | {k: end}) for r in recordings]) for end in ends
        )
        columns.append((up - down) / (ends[1] - ends[0]))
    if LAG in numbers and rests_on_one(recordings, lambda left: _one_rate(_trained(left))):
        rows = replace(rows, alone=True)
    whole = np.column_stack([jacobian, *columns])
    found = resampled(whole, residual, weight, rows, whole_conditions(recordings))
    first = jacobian.shape[1]
    if LAG in numbers:
        size = np.sqrt(np.einsum("ij,ij->j", whole, whole))
        scale = np.where(size > 0, size, 1.0)
        weighted = whole / scale * weight[:, None]
        change = np.linalg.lstsq(weighted, residual * weight, rcond=1e-9)[0] / scale
        for i, k in enumerate(numbers):
            low, high = bounds[k]
            numbers[k] = float(np.clip(numbers[k] + change[first + i], low, high))
    return {k: float(found.sigma[first + i]) for i, k in enumerate(numbers)}
