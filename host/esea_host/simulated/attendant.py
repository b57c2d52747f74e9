"""Somebody at a simulated drive of one axis: swaps its element, hangs a mass, leads the person."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from esea_gen.twin.published import Person
from esea_gen.twin.stepped import EMPTY
from esea_host.simulated.drive import SimulatedBoard

# A mass that hangs pulls with the same torque wherever the joint is; somebody holds the motor.
HANGING = dataclasses.replace(
    EMPTY, spring_Nm_rad=1.0, own_damping_Nms_rad=2.0, damping_Nms_rad=0.0, gravity_Nm=0.0
)
LOCKED = {"fc_Nm": 100.0, "coulomb_width_rad_s": 2e-3, "fv_Nms_rad": 100.0, "J_kgm2": 100.0}
LAID_ON_TICKS = 100
# An elbow that is held firmly while it is led; assumed.
FIRM_NM_RAD, FIRM_NMS_RAD = 40.0, 4.0
AIM_TICKS = 10  # from one aim to the next: a frame of a study


class Attendant:
    """Does at the virtual machine what a person does at a real one."""

    def __init__(self, drive: SimulatedBoard, seed: int = 0) -> None:
        self.drive = drive
        self._hung_Nm = 0.0
        self._noise = np.random.default_rng([seed, 5])
        self._aim: tuple[float, float, int] | None = None  # place, step, steps left

    def hang(self, load_Nm: float) -> None:
        """Hold the motor, nobody in the joint, and hang a mass on it, without a jerk; 0: none."""
        now_Nm, self._hung_Nm, self._aim = self._hung_Nm, load_Nm, None

        def pulling() -> Mapping[str, float]:
            nonlocal now_Nm
            now_Nm += (load_Nm - now_Nm) / LAID_ON_TICKS
            at = float(self.drive.plant.truth()["theta_l_rad"])
            return led_path(at + now_Nm / HANGING.spring_Nm_rad)

        self.drive.set_up(person=HANGING, hand=pulling, values=LOCKED)

    def let_go(self) -> None:
        """Let the motor go; whoever was in the joint at first holds it where it is."""
        self._hung_Nm = 0.0
        self._lead()

    def aim(self, aim_rad: float) -> None:
        """The person moves no longer to and fro, but to this angle within the next frame."""
        at_rad = self._lead() if self._aim is None else self._aim[0]
        self._aim = at_rad, (aim_rad - at_rad) / AIM_TICKS, AIM_TICKS

    def _lead(self) -> float:
        at_rad = float(self.drive.plant.truth()["theta_l_rad"])
        person, clamped = self.drive.first_person
        assert isinstance(person, Person)
        firm = dataclasses.replace(person, spring_Nm_rad=FIRM_NM_RAD, damping_Nms_rad=FIRM_NMS_RAD)
        self.drive.set_up(clamped=clamped, person=firm, hand=self._led)
        self._aim = at_rad, 0.0, 0
        return at_rad

    def _led(self) -> Mapping[str, float]:
        assert self._aim is not None
        at, step, left = self._aim
        moves = left > 0
        self._aim = at + moves * step, step, left - moves
        return led_path(
            self._aim[0], 1e3 * step * moves, noise=float(self._noise.standard_normal())
        )


def led_path(
    theta_rad: float, omega_rad_s: float = 0.0, alpha_rad_s2: float = 0.0, noise: float = 0.0
) -> dict[str, float]:
    """Where somebody leads the hand, as the virtual plant takes it."""
    speed = {"omega_p_rad_s": omega_rad_s, "alpha_p_rad_s2": alpha_rad_s2}
    return {"theta_p_rad": theta_rad, **speed, "noise": noise}
