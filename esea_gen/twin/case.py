"""A case of a closed-loop run, and its setting."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from esea_gen.control.reference import largest_gains
from esea_gen.devices import BEST_CONTROLLER
from esea_gen.devices.file import DeviceData
from esea_gen.model.mode import Mode
from esea_gen.observe import torque_scale
from esea_gen.twin.people import OF_CABLE, stiffer
from esea_gen.twin.trajectories import Trajectory

OFF, TORQUE, IMPEDANCE = Mode
# What the cases are written for: the elbow's full scale and range of motion, of which movements
# take a quarter turn, and the largest gains.
LOW_RAD, RANGE_RAD, MOVED_RAD = -0.15, 2.65, math.pi / 2
STIFFNESS_NM_RAD, DAMPING_NMS_RAD = 1.5, 0.25


@dataclass(frozen=True)
class Scale:
    """Torques and movements of a device, over those that the cases are written for."""

    torque: float = 1.0  # what makes a run unstable or oscillating goes with it, too
    travel: float = 1.0
    from_rad: float = 0.0  # where a movement begins that is written from 0 on
    rest_rad: float = 0.0  # where a joint stands that is written to stand at 0
    stiffness: float = 1.0  # as the torque, within what the device may render
    damping: float = 1.0  # likewise
    cable: float = 1.0

    @classmethod
    def of(cls, device: DeviceData) -> Scale:
        safety = device.file.safety
        assert safety is not None
        low, high = safety.rom_min_rad.value, safety.rom_max_rad.value
        travel = min(1.0, (high - low) / RANGE_RAD)
        first = max(0.0, low - travel * LOW_RAD)
        last = high + travel * (LOW_RAD - MOVED_RAD)
        rest = min(max(0.0, low), high)
        torque = torque_scale(device)
        gains = zip(largest_gains(device), (STIFFNESS_NM_RAD, DAMPING_NMS_RAD), strict=True)
        kp, kd = (min(torque, most / written) for most, written in gains)
        return cls(torque, travel, min(first, last), rest, kp, kd, stiffer(device))


@dataclass(frozen=True)
class Case:
    name: str
    trajectory: Trajectory
    mode: int = TORQUE
    tunables: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    # Tunables of the plant; with several axes, of the axis that is moved.
    plant: Mapping[str, float] = field(default_factory=dict)

    def scaled(self, by: Scale) -> Case:
        """The case in a device's own torques and range of motion; its name tells the factors."""
        path, words = self.trajectory, [self.name]
        words += [f"torque x{by.torque:.3g}"] * (by.torque != 1)
        moves = bool(path.omega_p_rad_s.any())
        words += [f"travel x{by.travel:.3g}"] * (moves and by.travel != 1)
        if self.mode == IMPEDANCE:
            words += [f"stiffness x{by.stiffness:.3g}"] * (by.stiffness != by.torque)
            words += [f"damping x{by.damping:.3g}"] * (by.damping != 1)
        path = replace(
            path,
            theta_p_rad=(by.from_rad if moves else by.rest_rad) + by.travel * path.theta_p_rad,
            omega_p_rad_s=by.travel * path.omega_p_rad_s,
            alpha_p_rad_s2=by.travel * path.alpha_p_rad_s2,
            tau_desired_Nm=by.torque * path.tau_desired_Nm,
        )
        factors = {"Kp_Nm_rad": by.stiffness, "Kd_Nms_rad": by.damping}
        gains = {
            of: {k: v * factors.get(k, 1.0) for k, v in given.items()}
            for of, given in self.tunables.items()
        }
        plant = {k: v * (by.cable if k in OF_CABLE else 1) for k, v in self.plant.items()}
        return replace(self, name=", ".join(words), trajectory=path, tunables=gains, plant=plant)


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
