"""What one closed-loop run is of: a case, and the setting that it runs in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from esea_gen.twin.trajectories import Trajectory

OFF, TORQUE, IMPEDANCE = 0, 1, 2


@dataclass(frozen=True)
class Case:
    """One run of a study.

    trajectory: path, desired torque and analysed window.
    tunables: ``{instance: {tunable: value}}`` of the controller.
    plant: tunables of the plant beside the variant's.
    """

    name: str
    trajectory: Trajectory
    mode: int = TORQUE
    tunables: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    plant: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Setting:
    """What a study runs with.

    controller: as :func:`esea_gen.twin.controllers.controller_device` takes it.
    real: number format of the controller's C.
    tunables: ``{instance: {tunable: value}}`` beside each case's own.
    fault: of an encoder, as :func:`esea_gen.twin.faults.parse_fault` reads it; empty for none.
    off: in what the plant differs from the model, as :mod:`esea_gen.twin.off` names it.
    adapted: whether the rubber was adapted to before, with a known mass.
    axis: which a case moves, and whose encoder fails; the others are wanted at 0 Nm, the hand rests
        there.  Empty: the first.
    """

    controller: str = "smc"
    plant: str = "real"
    person: str = "none"
    real: str = "f32"
    tunables: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fault: str = ""
    off: str = "none"
    adapted: bool = False
    axis: str = ""
