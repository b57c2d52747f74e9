"""The virtual wrist device: two axes on one board, the firmware in the loop.  Simulated.

Each axis: a hand with the handle (inertia, passive wrist), an elastomeric coupling, and a motor
that turns the coupling's other side until the torque that the board senses is the one that its
impairment wants.  Encoders stand on the coupling and on the joint.  The motor and its torque loop
are not the board's: its rate follows at once, up to its limit.  They are assumed, and so is every
number of the device.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path

from esea_gen.device import Device, load_device
from esea_host.people.person import Limb
from esea_host.people.rig import SensedRig

NAMES = ("fe", "ru")
AXES = ("flexion", "deviation")  # as the device has them
TORQUE_LOOP_1_S = 2 * math.pi * 15.0
MOTOR_RAD_S = 15.0
HANDLE_KGM2 = 0.006


def impaired_file() -> Path:
    """The device file of the wrist with its impairment, to give to any command that takes one."""
    return Path(str(resources.files("esea_host.wrist") / "devices" / "wrist_impaired.toml"))


@cache
def impaired_device() -> Device:
    """The wrist with its impairment, read once a process."""
    return load_device(impaired_file())


class Rig(SensedRig):
    """The device with a wrist in it.

    Parameters
    ----------
    limbs : sequence of Limb
        FE and RU.
    """

    def __init__(self, limbs: Sequence[Limb]) -> None:
        device = impaired_device()
        super().__init__(device, limbs, HANDLE_KGM2)
        at = self.board.places
        self._torques = [(at[f"tau_set_{a}_Nm"], at[f"tau_{a}_Nm"]) for a in AXES]
        self._angles = [at[f"theta_load_{a}_rad"] for a in AXES]
        self._acting = [at[f"acts_{a}"] for a in AXES]
        self.most_Nm = device.tau_full_scale_Nm
        # Small deflections: the loop's gain in rate per torque.
        self._gain = TORQUE_LOOP_1_S / device.elastomer.k1_Nm_rad.value

    def start(self) -> None:
        """From rest at zero; no wall in RU: resistance to speed alone."""
        super().start()
        self._asked = False
        for gain in ("Kp_Nm_rad", "Kd_Nms_rad"):
            self.board.set_parameter(f"impairment_deviation.{gain}", 0.0)

    def advance(self, muscles: Sequence[Sequence[float]], constrained: bool) -> None:
        """A frame.

        Parameters
        ----------
        muscles : sequence of sequence of float
            Of each axis, as of :meth:`CoupledLimb.step`.
        constrained : bool
            Whether the impairment is asked for; it is switched where the wrist rests.
        """
        if constrained != self._asked:
            self.board.set_parameter("request.constrained", float(constrained))
            self._asked = constrained
        self.frame(muscles)

    def show(self) -> None:
        drivers = self.board.drivers
        for k, axis in enumerate(self.axes):
            drivers[2 * k] = self.counted(axis.deflection_rad)
            drivers[2 * k + 1] = self.counted(axis.theta_rad)

    def turning_rad_s(self) -> Sequence[float]:
        told, most = self.board.values, MOTOR_RAD_S
        wanted = (self._gain * (told[a] - told[b]) for a, b in self._torques)
        return [min(max(rate, -most), most) for rate in wanted]

    @property
    def theta_rad(self) -> list[float]:
        """Angle of each joint, as the board has it."""
        return [self.board.values[k] for k in self._angles]

    @property
    def tau_Nm(self) -> list[float]:
        """Torque on each axis, as the board senses it."""
        return [self.board.values[k] for _, k in self._torques]

    @property
    def acts(self) -> bool:
        """Whether the impairment acts on both axes."""
        return all(self.board.values[k] > 0.5 for k in self._acting)
