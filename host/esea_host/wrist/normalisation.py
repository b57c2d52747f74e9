"""Virtual normalisation: maps a constrained wrist's motion to the healthy one's.

Speeds at nodes of the workspace, healthy and constrained, give a scaling factor over the angle; its
integral is the cursor's position: one smooth lookup that cannot drift.  Angles in degrees, as
published.

References
----------
[1] C. Jarrett, A. McDaid, "Virtual Normalization of Physical Impairment", Frontiers in
    Neuroscience 11, 2017 (thesis chapter 7, equations 7.3 to 7.6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import pydantic
from pydantic import Field
from scipy.special import erf

from esea_gen.errors import UserError
from esea_gen.files import plain

Array = npt.NDArray[np.float64]
LEAST_NODES = 3
SPACING_DEG = 10.0
# Two measurements of one range may differ by so much: RU has no wall.  M. Horger, American Journal
# of Occupational Therapy 44, 1990: a goniometer on the wrist, about 5 deg.
REPEATED_DEG = 5.0
# At a soft wall the wrist slows down and turns round over several nodes.  An outermost node with
# less than this share of the median speed (assumed) is left out, as those at an end are: its ratio
# of speeds would multiply the cursor's motion there beyond what anybody can steer.
LEAST_SPEED_SHARE = 0.25


Angle_deg = Annotated[float, Field(ge=-180, le=180)]
MOST_NODES = 36  # a full turn


@pydantic.dataclasses.dataclass(
    frozen=True, config=pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
)
class NodeSpeeds:
    """Range of one axis in one state from the neutral position, mean speeds at its nodes."""

    low_deg: Angle_deg
    high_deg: Angle_deg
    nodes_deg: Annotated[tuple[float, ...], Field(max_length=MOST_NODES)]
    speeds_deg_s: Annotated[tuple[float | None, ...], Field(max_length=MOST_NODES)]

    @property
    def range_deg(self) -> tuple[float, float]:
        return self.low_deg, self.high_deg

    @property
    def width_deg(self) -> float:
        return self.high_deg - self.low_deg

    @property
    def middle_deg(self) -> float:
        return (self.low_deg + self.high_deg) / 2


@dataclass(frozen=True)
class RbfNetwork:
    """A sum of Gaussians of one width on a constant and a slope."""

    centres_deg: Array
    weights: Array
    sigma_deg: float
    base: float
    slope_1_deg: float

    def value(self, theta_deg: npt.ArrayLike) -> Array:
        theta = np.asarray(theta_deg, np.float64)
        d = (theta[..., None] - self.centres_deg) / self.sigma_deg
        bumps = np.exp(-0.5 * d * d) @ self.weights
        return np.asarray(self.base + bumps + self.slope_1_deg * theta)

    def integral(self, theta_deg: npt.ArrayLike) -> Array:
        """Its integral from 0, in closed form."""
        theta = np.asarray(theta_deg, np.float64)
        scale = self.sigma_deg * np.sqrt(2.0)
        area = self.sigma_deg * np.sqrt(np.pi / 2.0)
        steps = erf((theta[..., None] - self.centres_deg) / scale) - erf(-self.centres_deg / scale)
        slope = 0.5 * self.slope_1_deg * theta**2
        return np.asarray(self.base * theta + area * (steps @ self.weights) + slope)

    def steepest_1_deg(self) -> float:
        """A bound of its derivative: a Gaussian is nowhere steeper than exp(-1/2) / sigma."""
        bumps = np.sum(np.abs(self.weights)) * np.exp(-0.5) / self.sigma_deg
        return float(bumps + abs(self.slope_1_deg))


def fit_rbf(
    nodes_deg: npt.ArrayLike, values: npt.ArrayLike, *, slope: bool = False, base: bool = True
) -> RbfNetwork:
    """Fit a network through values at nodes.

    Without w the Gaussian matrix of separate nodes is positive definite, and nothing is
    regularised.  With w there is one unknown more than values: of all networks through the values
    the one with the least sum of a_n^2 + (w sigma)^2 (so that the unit of the angle does not
    matter).  On 0 the network falls to 0 outside its nodes, on the mean it falls to the mean.
    """
    nodes, wanted = np.asarray(nodes_deg, np.float64), np.asarray(values, np.float64)
    sigma = float(np.mean(np.diff(nodes)))
    d = (nodes[:, None] - nodes) / sigma
    matrix = np.exp(-0.5 * d * d)
    mean = float(np.mean(wanted)) if base else 0.0
    if not slope:
        weights = np.asarray(np.linalg.solve(matrix, wanted - mean), np.float64)
        return RbfNetwork(nodes, weights, sigma, mean, 0.0)
    wide = np.column_stack([matrix, nodes / sigma])
    found = np.linalg.lstsq(wide, wanted - mean, rcond=None)[0]
    return RbfNetwork(nodes, found[:-1], sigma, mean, float(found[-1] / sigma))


@dataclass(frozen=True)
class CursorMap:
    """From the wrist's angle to the cursor's position, one axis."""

    middle_deg: float
    low_deg: float
    high_deg: float
    factor: RbfNetwork

    def position(self, theta_deg: npt.ArrayLike) -> Array:
        """Cursor, deg; outside the range it goes on with the factor of the range's end."""
        theta = np.asarray(theta_deg, np.float64)
        inside = np.clip(theta, self.low_deg, self.high_deg)
        within = self.factor.integral(inside - self.middle_deg)
        return np.asarray(within + (theta - inside) * self.factor.value(inside - self.middle_deg))

    def numbers(self) -> dict[str, Any]:
        """All that it was fitted to, for a log."""
        ends = {n: float(getattr(self, n)) for n in ("middle_deg", "low_deg", "high_deg")}
        return ends | dict(plain(self.factor))

    def scaling(self, theta_deg: npt.ArrayLike) -> Array:
        """Scaling factor: the cursor's speed over the wrist's."""
        inside = np.clip(np.asarray(theta_deg, np.float64), self.low_deg, self.high_deg)
        return self.factor.value(inside - self.middle_deg)


def plain_map(speeds: NodeSpeeds, factor: float = 1.0) -> CursorMap:
    """Map with one factor everywhere: unchanged (1), or linear scaling."""
    flat = RbfNetwork(np.zeros(1), np.zeros(1), SPACING_DEG, factor, 0.0)
    return CursorMap(speeds.middle_deg, speeds.low_deg, speeds.high_deg, flat)


def linear_map(healthy: NodeSpeeds, constrained: NodeSpeeds) -> CursorMap:
    _check_range(healthy, constrained)
    return plain_map(constrained, healthy.width_deg / constrained.width_deg)


def normalise(
    healthy: NodeSpeeds, constrained: NodeSpeeds, *, slope: bool = False, base: bool = True
) -> CursorMap:
    for name, speeds in (("healthy", healthy), ("constrained", constrained)):
        check_nodes(name, speeds)
    _check_range(healthy, constrained)
    constrained = without_turns(constrained)
    middle = constrained.middle_deg
    shrink = constrained.width_deg / healthy.width_deg
    compressed = shrink * (np.array(healthy.nodes_deg) - healthy.middle_deg)
    nodes = np.array(constrained.nodes_deg) - middle
    ours = np.array(constrained.speeds_deg_s, np.float64)
    measured = np.array(healthy.speeds_deg_s, np.float64)
    theirs = fit_rbf(compressed, measured, base=base).value(nodes)
    factor = fit_rbf(nodes, theirs / ours, slope=slope, base=base)
    found = CursorMap(middle, constrained.low_deg, constrained.high_deg, factor)
    _check_fold(found)
    return found


def without_turns(speeds: NodeSpeeds) -> NodeSpeeds:
    """Checked speeds without outermost nodes where the wrist was about to turn round."""
    found = np.array(speeds.speeds_deg_s, np.float64)
    passed = np.flatnonzero(found >= LEAST_SPEED_SHARE * np.median(found))
    kept = slice(int(passed[0]), int(passed[-1]) + 1)
    if kept.stop - kept.start < LEAST_NODES:
        return speeds
    return replace(speeds, nodes_deg=speeds.nodes_deg[kept], speeds_deg_s=speeds.speeds_deg_s[kept])


def check_nodes(name: str, speeds: NodeSpeeds) -> None:
    if len(speeds.nodes_deg) < LEAST_NODES:
        raise UserError(
            f"The {name} range {speeds.low_deg:.1f} to {speeds.high_deg:.1f} deg holds "
            f"{len(speeds.nodes_deg)} nodes, {LEAST_NODES} are needed.",
            "Measure the range of motion again, or place the nodes nearer to each other.",
        )
    for node, speed in zip(speeds.nodes_deg, speeds.speeds_deg_s, strict=True):
        if speed is None:
            raise UserError(
                f"The {name} calibration never crossed the node at {node:.1f} deg.",
                "Repeat the movements over the full measured range.",
            )
        if not speed > 0:
            raise UserError(
                f"The {name} speed at the node {node:.1f} deg is {speed:g} deg/s.",
                "Repeat the movements through that place without a stop.",
            )


def _check_range(healthy: NodeSpeeds, constrained: NodeSpeeds) -> None:
    if constrained.width_deg > healthy.width_deg + REPEATED_DEG:
        raise UserError(
            f"The constrained range, {constrained.width_deg:.1f} deg, is larger than the healthy "
            f"one, {healthy.width_deg:.1f} deg.",
            "Measure both ranges again, each in its own state.",
        )


def _check_fold(found: CursorMap) -> None:
    # Positive at every point of a grid, by more than the factor can fall between two of them.
    points = 501
    while True:
        theta = np.linspace(found.low_deg, found.high_deg, points)
        values = found.scaling(theta)
        least = int(np.argmin(values))
        fall = found.factor.steepest_1_deg() * (theta[1] - theta[0]) / 2
        if values[least] > fall:
            return
        if values[least] <= 0 or points > 500_000:
            raise UserError(
                f"The scaling factor is {values[least]:.3g} at {theta[least]:.1f} deg: the cursor "
                "would reverse while the wrist moves on.",
                "Repeat the calibration there; without the linear term (w = 0) it may be positive.",
            )
        points = 4 * points - 3


def node_places(low_deg: float, high_deg: float, spacing_deg: float = SPACING_DEG) -> list[float]:
    """Nodes at whole multiples of the spacing from the neutral position, across the range."""
    # Nearer to an end the wrist turns round, and has no speed to measure.
    room = 0.2 * spacing_deg
    first, last = np.ceil((low_deg + room) / spacing_deg), np.floor((high_deg - room) / spacing_deg)
    return [float(k * spacing_deg) for k in range(int(first), int(last) + 1)]
