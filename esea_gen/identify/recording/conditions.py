"""Conditions of recordings (rates, amplitudes, temperatures), and splits that leave one out.

Of a member the temperatures tell one number: its change a kelvin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.devices.rubber import LEAST_FACTOR, FamilyTemperature
from esea_gen.errors import UserError, nearest
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.tables import Cycles
from esea_gen.language.ports import Array
from esea_gen.model.family import Member
from esea_gen.model.temperature import TemperatureFactor

# Nearer ones tell no change from noise and from what the specimen did before.
LEAST_APART_K = 3.0
# The search's grid, before it is refined between neighbours.
GRID = 21
# How far from the least factor the search stays, so that rounding does not pass it.
INSIDE = 0.999
NEAR_EDGE = 1e-4  # of the search's range, far wider than the search ends short of it


def temperatures_of(recordings: Sequence[Recording], *, training: bool = False) -> list[float]:
    """Known temperatures, sorted, degC."""
    found = {
        r.temperature_C
        for r in recordings
        if r.temperature_C is not None and (not training or any(len(s.training) for s in r.sets))
    }
    return sorted(found)


def far_apart(known_C: Sequence[float]) -> bool:
    """Whether sorted temperatures are far enough apart to show an effect."""
    return len(known_C) > 1 and known_C[-1] - known_C[0] >= LEAST_APART_K


def tells_none(recordings: Sequence[Recording]) -> bool:
    """Whether the training data cannot show the effect of temperature."""
    return not far_apart(temperatures_of(recordings, training=True))


def at_edge(factor: TemperatureFactor) -> str | None:
    """Edge of the search range at a factor's change a kelvin: low or high."""
    low, high = _bounds(factor.reference_C, (factor.low_C, factor.high_C))
    near = NEAR_EDGE * (high - low)
    if factor.per_K < low + near:
        return "low"
    return "high" if factor.per_K > high - near else None


def temperature_name(recording: Recording) -> str:
    """Common name of recordings at one temperature, to the degree."""
    return "" if recording.temperature_C is None else f"{round(recording.temperature_C)} degC"


def at_temperature(
    member: Member, factor: TemperatureFactor | None, temperature_C: Any, terms: Array
) -> Array:
    """Terms with the factor of their temperature; as they are without one."""
    if factor is None:
        return terms
    g = np.asarray(factor.at(np.asarray(temperature_C)))[..., None]
    return np.asarray(terms * np.where(scaled_terms(member), g, 1.0))


def scaled_terms(member: Member) -> Array:
    """1 for each term that the factor multiplies, 0 for an offset."""
    return np.array([float(t.kind != "offset") for t in member.terms])


def searched_factor(
    member: Member,
    recordings: Sequence[Recording],
    temperature_C: Array,
    basis: Array,
    target: Array,
    solve: Callable[[Array, Array], Array],
) -> TemperatureFactor | None:
    """The factor of temperature of least square error, the weights solved for each one tried."""
    if tells_none(recordings):
        return None
    trained = temperatures_of(recordings, training=True)
    known = temperatures_of(recordings)
    reference = round(float(np.mean(trained)), 1)
    # Of each temperature as many rows as terms say the same as all: the triangle of its QR.
    both = np.column_stack([basis, target])
    triangles = [np.linalg.qr(both[temperature_C == c], mode="r") for c in trained]
    rows = np.repeat(trained, [len(t) for t in triangles])
    small = np.concatenate(triangles)

    def cost(per_K: float) -> float:
        factor = TemperatureFactor(reference, per_K, known[0], known[-1])
        tried = at_temperature(member, factor, rows, small[:, :-1])
        error = small[:, -1] - tried @ solve(tried, small[:, -1])
        return float(error @ error)

    per_K = least(cost, *_bounds(reference, known), GRID, 1e-9)
    return TemperatureFactor(reference, per_K, known[0], known[-1])


def least(
    cost: Callable[[float], float], low: float, high: float, points: int, close: float
) -> float:
    """Where a cost is least, to that far: looked over in so many points, then narrowed."""
    grid = np.linspace(low, high, points)
    costs = [cost(float(v)) for v in grid]
    i = int(np.argmin(costs))
    ends = float(grid[max(i - 1, 0)]), float(grid[min(i + 1, points - 1)])
    options = {"xatol": close}
    done = scipy.optimize.minimize_scalar(cost, bounds=ends, method="bounded", options=options)
    return float(done.x) if done.fun < costs[i] else float(grid[i])


def _bounds(reference_C: float, known_C: Sequence[float]) -> tuple[float, float]:
    # Of the device file, and so that the factor keeps its least over the known temperatures.
    extra = FamilyTemperature.model_fields["per_K"].json_schema_extra
    assert isinstance(extra, dict)
    room = INSIDE * (1 - LEAST_FACTOR)
    low = max(float(str(extra["low"])), -room / (known_C[-1] - reference_C))
    high = min(float(str(extra["high"])), room / (reference_C - known_C[0]))
    return low, high


# With fewer, leaving one out leaves too little, or one on one side only.
LEAST_CONDITIONS = 3


@dataclass(frozen=True)
class Split:
    condition: str  # what judges; of the file's own division "last cycles" or "as declared"
    recordings: tuple[Recording, ...]
    declared: bool  # whether it is the file's own division
    whole: bool  # whether a whole condition is left out


def conditions_of(recording: Recording, data: DataSet) -> tuple[str, ...]:
    """The conditions of a data set: the mapping's, else its own label."""
    return recording.conditions or (data.label,)


def _names_of(recording: Recording, data: DataSet) -> tuple[str, ...]:
    # With its temperature, which is a condition too.
    own = conditions_of(recording, data)
    return own if recording.temperature_C is None else (temperature_name(recording), *own)


def splits_of(recordings: Sequence[Recording]) -> tuple[Split, ...]:
    """The file's own division, and one split for each condition left out as a whole."""
    # A condition that is just what the file holds out stands for both; one that has the same files
    # as another, as where a temperature has one file, is tried once.
    used = [(r, s) for r in recordings for s in r.sets if len(s.training) or len(s.held_out)]
    warm = [temperature_name(r) for r, _ in used if r.temperature_C is not None]
    known = list(dict.fromkeys([*warm, *(c for r, s in used for c in conditions_of(r, s))]))
    mixed = any(len(s.training) and len(s.held_out) for _, s in used)
    judged = {s.label for _, s in used if len(s.held_out)}
    splits: list[Split] = []
    tried: list[set[str]] = []
    for c in known:
        inside = {s.label for r, s in used if c in _names_of(r, s)}
        if len(inside) == len(used):  # nothing would be left to train on
            continue
        if warm and inside in tried:
            continue
        tried.append(inside)
        same = not mixed and inside == judged
        splits.append(Split(c, tuple(_without(r, c) for r in recordings), same, True))
    if not any(s.declared for s in splits):
        name = "last cycles" if mixed else "as declared"
        splits.insert(0, Split(name, tuple(recordings), True, False))
    return tuple(splits)


def divided(recordings: list[Recording], rules: Cycles) -> list[Recording]:
    """Recordings as their mapping divides them: with ``hold_out``, a whole condition judges."""
    # Where the mapping says neither which condition nor how many cycles to hold out, and every file
    # is used by cycles, the condition of middle amplitude is held out: what lies inside.
    used = [(r, s) for r in recordings for s in r.sets if len(s.training) or len(s.held_out)]
    known = list(dict.fromkeys(c for r, s in used for c in conditions_of(r, s)))
    asked = rules.hold_out
    if asked is not None:
        every = list(dict.fromkeys(c for r, s in used for c in _names_of(r, s)))
        if asked not in every or len(every) < 2:
            raise UserError(
                f"cycles.hold_out = '{asked}' is not a condition that could be left out.",
                f"{nearest(asked, every)}There are: {', '.join(every)}; two at least are needed.",
            )
    elif rules.hold_out_last is None and len(known) >= LEAST_CONDITIONS:
        mixed = all(len(s.training) and len(s.held_out) for _, s in used)
        if mixed and all(len(conditions_of(r, s)) == 1 for r, s in used):
            sizes = {
                c: float(np.mean([s.amplitude_rad for r, s in used if c in conditions_of(r, s)]))
                for c in known
            }
            asked = sorted(known, key=lambda c: sizes[c])[len(known) // 2]
    return recordings if asked is None else [_without(r, asked) for r in recordings]


def _without(recording: Recording, condition: str) -> Recording:
    sets = []
    for s in recording.sets:
        every = np.union1d(s.training, s.held_out).astype(np.intp)
        out = condition in _names_of(recording, s)
        training, held_out = (every[:0], every) if out else (every, every[:0])
        sets.append(replace(s, training=training, held_out=held_out))
    return replace(recording, sets=tuple(sets))
