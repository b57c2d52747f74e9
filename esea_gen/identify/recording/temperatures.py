"""Temperatures of recordings, and the one number of a member that they tell: change a kelvin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.devices.rubber import LEAST_FACTOR, FamilyTemperature
from esea_gen.identify.recording.recorded import Recording
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
    """Whether sorted temperatures tell what a temperature does."""
    return len(known_C) > 1 and known_C[-1] - known_C[0] >= LEAST_APART_K


def tells_none(recordings: Sequence[Recording]) -> bool:
    """Whether what trains does not tell what a temperature does."""
    return not far_apart(temperatures_of(recordings, training=True))


def at_edge(factor: TemperatureFactor) -> str | None:
    """The end of what is searched that a factor's change a kelvin sits at: low or high."""
    low, high = _bounds(factor.reference_C, (factor.low_C, factor.high_C))
    near = NEAR_EDGE * (high - low)
    if factor.per_K < low + near:
        return "low"
    return "high" if factor.per_K > high - near else None


def temperature_name(recording: Recording) -> str:
    """What all recordings at one temperature, to the degree, have in common."""
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
