"""Where to probe next, and the movement that goes there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess.database import LocationGrid
from esea_host.assess.hypotheses import Hypotheses
from esea_host.assess.patients import DEG, RANGE_RAD, Array
from esea_host.assess.responses import SENSOR_ERROR_NM, Location, Passage, along
from esea_host.assess.session import Assessment

MEASURES = ("expected", "thesis", "inherent")
K_MOST_PROBABLE = 5
LEAST_PROBABILITY = 1e-3  # of a hypothesis that is planned for
PLAN_STEP_S, PLAN_HOLD_S = 0.01, 0.3


def inherent_information(means_Nm: Array) -> Array:
    """Standard deviation of the categories' means at each location; means (categories, cells)."""
    return np.asarray(np.std(means_Nm, axis=0))


def contextual_information(
    means_Nm: Array, probabilities: Array, k: int = K_MOST_PROBABLE
) -> Array:
    """The same over the k most probable categories."""
    most = np.argsort(-probabilities, kind="stable")[:k]
    return np.asarray(np.std(means_Nm[most], axis=0))


def expected_information(mean_Nm: Array, covariance_Nm2: Array, probabilities: Array) -> float:
    """Information in nats that readings to come are expected to give about the hypothesis.

    mean_Nm, covariance_Nm2: of the readings, shapes (hypotheses, k) and (hypotheses, k, k).

    The lower bound of [Kolchinsky2017] with Bhattacharyya distances B_ij of the Gaussians,
    I >= - sum_i p_i log sum_j p_j exp(-B_ij): exact where they are equal or far apart.

    [Kolchinsky2017] A. Kolchinsky, B. D. Tracey, "Estimating mixture entropy with pairwise
        distances", Entropy 19(7):361, 2017.
    """
    likely = probabilities > LEAST_PROBABILITY
    p = probabilities[likely] / probabilities[likely].sum()
    m, c = mean_Nm[likely], covariance_Nm2[likely]
    middle, off = 0.5 * (c[:, None] + c[None]), m[:, None] - m[None]
    far = np.einsum("ijk,ijk->ij", off, np.linalg.solve(middle, off[..., None])[..., 0]) / 8
    size = np.linalg.slogdet(c)[1]
    apart = far + 0.5 * (np.linalg.slogdet(middle)[1] - 0.5 * (size[:, None] + size[None]))
    return float(-p @ np.log(np.exp(-apart) @ p))


@dataclass(frozen=True)
class Comfort:
    low_rad: float = 0.0
    high_rad: float = RANGE_RAD
    rate_rad_s: float = 120 * DEG
    amplitude_rad: float = 60 * DEG
    least_amplitude_rad: float = 12 * DEG
    longest_s: float = 3.5
    shortest_s: float = 0.4

    def __post_init__(self) -> None:
        if not 0 <= self.low_rad < self.high_rad <= math.radians(160):
            raise UserError(
                f"reach: {self.low_rad / DEG:g} to {self.high_rad / DEG:g} deg.",
                "Give two angles of flexion between 0 and 160 deg, the smaller first.",
            )
        if not 0 < self.rate_rad_s <= 300 * DEG:
            raise UserError(
                f"comfortable speed: {self.rate_rad_s / DEG:g} deg/s.", "Give 1 to 300 deg/s."
            )


@dataclass(frozen=True)
class ProbingMovement:
    """A minimum-jerk movement whose midpoint is the location."""

    location: Location
    start_rad: float
    end_rad: float
    duration_s: float

    def at(self, time_s: Array | float) -> tuple[Array, Array]:
        """Angle and rate at times; constant before and after."""
        u = np.clip(np.asarray(time_s, dtype=np.float64) / self.duration_s, 0, 1)
        a = self.end_rad - self.start_rad
        shape = u**3 * (10 - 15 * u + 6 * u**2)
        return self.start_rad + a * shape, a / self.duration_s * 30 * (u * (1 - u)) ** 2


@lru_cache(maxsize=100_000)
def probing_movement(where: Location, comfort: Comfort) -> ProbingMovement | None:
    """Through a location at its midpoint, where the speed peaks at 1.875 A/T; None out of reach."""
    speed = abs(where.rate_rad_s)
    room = 2 * min(where.angle_rad - comfort.low_rad, comfort.high_rad - where.angle_rad)
    if speed > comfort.rate_rad_s * (1 + 1e-9) or speed == 0:
        return None
    amplitude = min(comfort.amplitude_rad, room, comfort.longest_s * speed / 1.875)
    if amplitude < comfort.least_amplitude_rad:
        return None
    duration = 1.875 * amplitude / speed
    if duration < comfort.shortest_s:
        return None
    half = math.copysign(amplitude / 2, where.rate_rad_s)
    return ProbingMovement(where, where.angle_rad - half, where.angle_rad + half, duration)


@dataclass(frozen=True)
class PlannedMovement:
    """A comfortable movement through a cell of the map, and the locations on its way."""

    cell: int
    movement: ProbingMovement
    weights: Array  # of the cells at each reading, shape (k, cells)
    error_Nm2: Array  # covariance, shape (k, k)


@lru_cache(maxsize=32)
def planned(grid: LocationGrid, known: bytes, comfort: Comfort) -> tuple[PlannedMovement, ...]:
    """Movements through all cells that are known (as bytes of a mask) and comfortable."""
    mask = np.frombuffer(known, dtype=np.bool_)
    out = []
    for cell in np.flatnonzero(mask):
        where = grid.location(int(cell))
        move = probing_movement(where, comfort)
        if move is None:
            continue
        t = np.arange(-PLAN_HOLD_S, move.duration_s + PLAN_HOLD_S, PLAN_STEP_S)
        angle, rate = move.at(t)
        still = np.zeros(len(t))
        way = Passage(t, angle, rate, still, still > 0, SENSOR_ERROR_NM)
        read = along(way, where)
        assert read is not None
        found = [grid.weights(w, mask) for w in read.locations]
        use = [i for i, w in enumerate(found) if w is not None]
        weights = np.array([found[i] for i in use])
        out.append(PlannedMovement(int(cell), move, weights, read.error_Nm2[np.ix_(use, use)]))
    return tuple(out)


def plans(hypotheses: Hypotheses, comfort: Comfort | None = None) -> tuple[PlannedMovement, ...]:
    found = planned(hypotheses.grid, hypotheses.known.tobytes(), comfort or Comfort())
    if not found:
        raise UserError(
            "reach: no location of the map can be passed comfortably.",
            "Widen the reach or allow a faster movement.",
        )
    return found


def informative(
    session: Assessment, comfort: Comfort | None = None, measure: str = "expected"
) -> Array:
    """How much a movement through each cell would tell now, shape (cells,)."""
    if measure not in MEASURES:
        raise UserError(f"measure: {measure!r}.", f"Use {', '.join(MEASURES)}.")
    h, p = session.evidence.now, session.probabilities
    likely = np.flatnonzero(p > LEAST_PROBABILITY)
    some = h.only([h.names[i] for i in likely])
    means = session.hypotheses.mean[:-1]
    spread = {
        "thesis": contextual_information(means, p[:-1]),
        "inherent": inherent_information(means),
    }.get(measure)
    out = np.full(h.grid.cells, np.nan)
    for plan in plans(session.hypotheses, comfort):
        if spread is not None:
            out[plan.cell] = spread[plan.cell]
        else:
            ahead = some.readings(plan.weights, plan.error_Nm2)
            out[plan.cell] = expected_information(*ahead, p[likely])
    return out


def next_movement(
    session: Assessment, comfort: Comfort | None = None, value: Array | None = None
) -> ProbingMovement:
    """The movement that would tell most, within reach and comfort."""
    made = plans(session.hypotheses, comfort)
    worth = informative(session, comfort) if value is None else value
    left = [p for p in made if p.movement.location not in session.avoided]
    if not left:
        session.avoided.clear()
        left = list(made)
    return max(left, key=lambda p: worth[p.cell]).movement
