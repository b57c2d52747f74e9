"""The virtual wrist device: two axes on one board, the firmware in the loop.  Simulated.

Each axis: a hand with the handle (inertia, passive wrist), an elastomeric coupling, and a motor
that turns the coupling's other side until the torque that the board senses is the one that its
impairment wants and its limits let through.  Encoders stand on the coupling and on the joint.  The
motor and its torque loop are not the board's: its rate follows at once, up to its limit.  They are
assumed, and so is every number of the device.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path

from esea_gen.control.faults import Fault
from esea_gen.device import Device, load_device
from esea_gen.emit.roles import board_roles
from esea_gen.errors import UserError
from esea_host.people.person import Limb
from esea_host.people.rig import SensedRig

NAMES = ("fe", "ru")
AXES = ("flexion", "deviation")  # as the device has them
TORQUE_LOOP_1_S = 2 * math.pi * 15.0
MOTOR_RAD_S = 15.0
HANDLE_KGM2 = 0.006
SEEN_TICKS = 20  # more than the control task's period and its release


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
        given = [x.name for x in board_roles(device.system).measured].index
        self._encoders = [(given(f"theta_{a}_rad"), given(f"theta_load_{a}_rad")) for a in AXES]
        super().__init__(device, limbs, HANDLE_KGM2)
        at = self.board.places
        self._torques = [(at[f"u_{a}_Nm"], at[f"tau_{a}_Nm"]) for a in AXES]
        self._faults = [at[f"fault_{a}"] for a in AXES]
        self._angles = [at[f"theta_load_{a}_rad"] for a in AXES]
        self._acting = [at[f"acts_{a}"] for a in AXES]
        self.most_Nm = device.tau_full_scale_Nm
        # Small deflections: the loop's gain in rate per torque.
        self._gain = TORQUE_LOOP_1_S / device.elastomer.k1_Nm_rad.value

    def start(self) -> None:
        """From rest at zero, limits released; no wall in RU: resistance to speed alone."""
        super().start()
        self._asked, self._rearms = False, 0
        for gain in ("Kp_Nm_rad", "Kd_Nms_rad"):
            self.board.set_parameter(f"impairment_deviation.{gain}", 0.0)
        self.release()

    def release(self) -> None:
        """Ask the limits of both axes to release, while the joints rest."""
        self._rearms = (self._rearms + 1) % 8
        self._wait()  # what was asked last has been seen
        self.board.set_parameter("request.rearm", float(self._rearms))
        self._wait()

    def _wait(self) -> None:
        self.show()
        for _ in range(SEEN_TICKS):
            self.board.step()

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
        if any(self.faults):
            reason = Fault(max(self.faults)).name.lower().replace("_", " ")
            raise UserError(
                f"The limits of the simulated wrist have latched: {reason}.",
                "Nothing is pushed any more; begin the trial again.",
            )

    def show(self) -> None:
        drivers = self.board.drivers
        for axis, (bent, at) in zip(self.axes, self._encoders, strict=True):
            drivers[bent] = self.counted(axis.deflection_rad)
            drivers[at] = self.counted(axis.theta_rad)

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
    def faults(self) -> list[int]:
        """Why the limits of each axis hold, 0 where they do not."""
        return [int(self.board.values[k]) for k in self._faults]

    @property
    def acts(self) -> bool:
        """Whether the impairment acts on both axes."""
        return all(self.board.values[k] > 0.5 for k in self._acting)
