"""What one closed-loop run is of: a case, and the setting that it runs in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from esea_gen.devices import BEST_CONTROLLER
from esea_gen.twin.trajectories import Trajectory

OFF, TORQUE, IMPEDANCE = 0, 1, 2


@dataclass(frozen=True)
class Case:
    name: str
    trajectory: Trajectory
    mode: int = TORQUE
    tunables: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    # Tunables of the plant; with several axes, of the axis that is moved.
    plant: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Setting:
    controller: str = BEST_CONTROLLER
    plant: str = "real"
    person: str = "none"
    real: str = "f32"
    tunables: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fault: str = ""  # of an encoder, as ``--fault`` takes it
    off: str = "none"  # family of what differs from the model
    axis: str = ""
