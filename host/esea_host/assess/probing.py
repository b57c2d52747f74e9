"""Where to probe next, and the movement that goes there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.assess.database import LocationGrid
from esea_host.assess.patients import DEG, RANGE_RAD, Array
from esea_host.assess.responses import Location
from esea_host.assess.session import Assessment

MEASURES = ("expected", "thesis")
K_MOST_PROBABLE = 5
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


def inherent_information(means_Nm: Array) -> Array:
    """Standard deviation of the categories' means at each location; means (categories, cells)."""
    return np.asarray(np.std(means_Nm, axis=0))


def contextual_information(
    means_Nm: Array, probabilities: Array, k: int = K_MOST_PROBABLE
) -> Array:
    """The same over the k most probable categories."""
    most = np.argsort(-probabilities, kind="stable")[:k]
    return np.asarray(np.std(means_Nm[most], axis=0))


def expected_information(mean_Nm: Array, spread_Nm: Array, probabilities: Array) -> Array:
    """Information in nats that a reading is expected to give about the hypothesis, per location.

    mean_Nm, spread_Nm: of the next reading, shape (hypotheses, cells).

    I = sum_i p_i E_i[log N_i(y) - log sum_j p_j N_j(y)], each expectation by Gauss-Hermite.
    """
    likely = probabilities > 1e-3
    p, m, s = probabilities[likely], mean_Nm[likely], spread_Nm[likely]
    y = m[:, None] + s[:, None] * _NODES[None, :, None]  # (i, node, cell)
    z = (y[:, :, None] - m[None, None]) / s[None, None]
    log = -0.5 * z**2 - np.log(s)[None, None]  # (i, node, j, cell)
    own = -0.5 * _NODES[None, :, None] ** 2 - np.log(s)[:, None]
    top = log.max(axis=2)
    mixed = top + np.log(np.einsum("injc,j->inc", np.exp(log - top[:, :, None]), p))
    return np.asarray(np.einsum("i,n,inc->c", p, _WEIGHTS, own - mixed))


@dataclass(frozen=True)
class Comfort:
    """What the leg may be asked to do: reach, speed, and how a movement may be made.

    low_rad, high_rad: how far it may be straightened and bent.
    """

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
                f"reach: {self.low_rad / DEG:.0f} to {self.high_rad / DEG:.0f} deg.",
                "Give two angles of flexion between 0 and 160 deg, the smaller first.",
            )
        if not 0 < self.rate_rad_s <= 300 * DEG:
            raise UserError(
                f"comfortable speed: {self.rate_rad_s / DEG:.0f} deg/s.", "Give 1 to 300."
            )


@dataclass(frozen=True)
class ProbingMovement:
    """A minimum-jerk movement whose midpoint is the location."""

    location: Location
    start_rad: float
    end_rad: float
    duration_s: float

    def at(self, time_s: Array | float) -> tuple[Array, Array]:
        """Angle and rate at times; held before and after."""
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


def reachable(
    grid: LocationGrid, known: npt.NDArray[np.bool_], comfort: Comfort
) -> npt.NDArray[np.bool_]:
    """Cells of the map that a comfortable movement passes."""
    able = [probing_movement(grid.location(c), comfort) is not None for c in range(grid.cells)]
    return np.asarray(known & np.array(able))


def informative(session: Assessment, measure: str = "expected") -> Array:
    """How much each cell would tell now, shape (cells,)."""
    if measure == "thesis":
        singles = slice(0, len(session.names) - 1)
        return contextual_information(
            session.hypotheses.mean[singles], session.probabilities[singles]
        )
    if measure != "expected":
        raise UserError(f"measure: {measure!r}.", f"One of {', '.join(MEASURES)}.")
    mean, spread = session.evidence.predicted()
    return expected_information(mean, spread, session.probabilities)


def next_movement(
    session: Assessment, comfort: Comfort | None = None, measure: str = "expected"
) -> ProbingMovement:
    """The movement that would tell most, within reach and comfort."""
    limits = comfort or Comfort()
    able = reachable(session.hypotheses.grid, session.hypotheses.known, limits)
    if not able.any():
        raise UserError(
            "reach: no location of the map can be passed comfortably.",
            "Widen the reach or allow a faster movement.",
        )
    grid = session.hypotheses.grid
    for cell in np.flatnonzero(able) if session.avoided else ():
        able[cell] = grid.location(int(cell)) not in session.avoided
    if not able.any():
        session.avoided.clear()
        return next_movement(session, comfort, measure)
    value = np.where(able, informative(session, measure), -np.inf)
    found = probing_movement(grid.location(int(np.argmax(value))), limits)
    assert found is not None
    return found
