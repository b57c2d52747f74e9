"""Calibration of one axis: range of motion, speeds at nodes, and whether it was good enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.wrist.normalisation import NodeSpeeds, node_places

Array = npt.NDArray[np.float64]
LEAST_PASSES = 3
LEAST_SPEED_DEG_S = 5.0
LEAST_REACH = 0.8


@dataclass(frozen=True)
class Crossings:
    node_deg: float
    speeds_deg_s: tuple[float, ...]


def crossings(time_s: npt.ArrayLike, theta_deg: npt.ArrayLike, node_deg: float) -> Crossings:
    t, th = np.asarray(time_s, np.float64), np.asarray(theta_deg, np.float64)
    beyond = th >= node_deg
    k = np.flatnonzero(beyond[1:] != beyond[:-1])
    speeds = np.abs((th[k + 1] - th[k]) / (t[k + 1] - t[k]))
    return Crossings(node_deg, tuple(float(v) for v in speeds))


def node_speeds(
    low_deg: float, high_deg: float, traces: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]]
) -> NodeSpeeds:
    if not high_deg > low_deg:
        raise UserError(
            f"The range of motion, {low_deg:.1f} to {high_deg:.1f} deg, is empty.",
            "Measure it again.",
        )
    nodes = node_places(low_deg, high_deg)
    speeds: list[float | None] = []
    for node in nodes:
        passes = [v for t, th in traces for v in crossings(t, th, node).speeds_deg_s]
        speeds.append(float(np.mean(passes)) if passes else None)
    return NodeSpeeds(low_deg, high_deg, tuple(nodes), tuple(speeds))


@dataclass(frozen=True)
class Complaint:
    """What is not good enough, and what to do; ``key`` of the message catalogue."""

    key: str
    what: str
    fix: str
    node_deg: float | None = None

    @property
    def words(self) -> str:
        return f"{self.what[0].upper()}{self.what[1:]}. {self.fix}"


def quality(
    low_deg: float,
    high_deg: float,
    traces: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]],
    least_passes: int = LEAST_PASSES,
) -> list[Complaint]:
    """What is wrong with movements so far: too slow, not far enough, too few passes."""
    found: list[Complaint] = []
    width = high_deg - low_deg
    if traces:
        reached = [np.ptp(np.asarray(th, np.float64)) / width for _, th in traces]
        if max(reached) < LEAST_REACH:
            found.append(
                Complaint(
                    "further",
                    f"the movements cover {100 * max(reached):.0f} % of the range, "
                    f"{100 * LEAST_REACH:.0f} % are wanted",
                    "Ask for larger movements, or measure the range again.",
                )
            )
    for node in node_places(low_deg, high_deg):
        passes = [v for t, th in traces for v in crossings(t, th, node).speeds_deg_s]
        if len(passes) < least_passes:
            found.append(
                Complaint(
                    "more",
                    f"node {node:.0f} deg was crossed {len(passes)} times, {least_passes} are "
                    "wanted",
                    "Ask for more movements through that place.",
                    node,
                )
            )
        elif np.mean(passes) < LEAST_SPEED_DEG_S:
            found.append(
                Complaint(
                    "faster",
                    f"at node {node:.0f} deg the mean speed is {np.mean(passes):.1f} deg/s, "
                    f"{LEAST_SPEED_DEG_S:.0f} are wanted",
                    "Ask for faster movements.",
                    node,
                )
            )
    return found
