"""Hands without a person: what is asked is done to the virtual exoskeleton."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

from esea_gen.twin.stepped import EMPTY
from esea_host.commissioning.bench import CommissioningBench, HandAct
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.simulated.attendant import Attendant

# A firm grip.
GRIP = dataclasses.replace(EMPTY, spring_Nm_rad=60.0, damping_Nms_rad=6.0, gravity_Nm=0.0)
AT_REST = dataclasses.replace(EMPTY, own_damping_Nms_rad=2.0, gravity_Nm=0.0)


class SimulatedHands:
    """Does what is asked of a person, in the virtual exoskeleton.

    drive: a simulated board whose clock the caller moves.
    torque_error: share by which the simulated load is not what it is said to be.
    """

    def __init__(self, drive: SimulatedBoard, torque_error: float = 0.0) -> None:
        self.drive, self._error = drive, torque_error
        self._attendant = Attendant(drive)

    def __call__(self, act: HandAct) -> None:
        """Do it."""
        if act.kind == "turn":
            at = float(self.drive.plant.truth()["theta_l_rad"])
            self.drive.set_up(person=GRIP, hand=self._turning(act, at))
        elif act.kind == "load":
            self._attendant.hang(act.torque_Nm * (1 + self._error))
        elif act.kind == "rest":
            self.drive.set_up(person=AT_REST)
        else:
            self.drive.set_up(clamped=True)

    def _turning(self, act: HandAct, at_rad: float) -> Callable[[], Mapping[str, float]]:
        path = act.path
        assert path is not None
        passed = iter(range(len(path) - 1))

        def intended() -> Mapping[str, float]:
            k = next(passed, len(path) - 1)
            return {
                "theta_p_rad": at_rad + float(path.theta_rad[k]),
                "omega_p_rad_s": float(path.omega_rad_s[k]),
                "alpha_p_rad_s2": float(path.alpha_rad_s2[k]),
                "noise": 0.0,
            }

        return intended


def simulated_bench(
    drive: SimulatedBoard, say: Callable[[str], None] = lambda _: None
) -> CommissioningBench:
    """A board and a person, both simulated; time moves as fast as the computer can."""
    device = LockstepDevice(drive)
    device.listen()
    device.advance(0.3)
    return CommissioningBench(device, SimulatedHands(drive), say, device.advance, True)
