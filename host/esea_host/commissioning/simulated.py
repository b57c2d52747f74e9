"""Simulated hands that carry out the steps on the virtual exoskeleton."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from esea_gen.device import Device
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand import CoupledHand
from esea_gen.twin.published import Person
from esea_gen.twin.stepped import EMPTY
from esea_host.commissioning.bench import CommissioningBench, HandAct
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.simulated.motion import SteppedCoupling
from esea_host.simulated.server import HANGING, LAID_ON_TICKS, LOCKED, led_path

# A firm grip.
GRIP = dataclasses.replace(EMPTY, spring_Nm_rad=60.0, damping_Nms_rad=6.0, gravity_Nm=0.0)
SWINGING = dataclasses.replace(HANGING, own_damping_Nms_rad=0.02)
AT_REST = dataclasses.replace(EMPTY, own_damping_Nms_rad=2.0, gravity_Nm=0.0)
ANYWHERE_RAD = (-3.0, 3.0)  # the ends of a hand's range play no part
RETURN_RAD = 5e-4  # a tick, to the joint's zero
Path = Mapping[str, float]


class HandledJoint:
    """A passive joint with its motor side turned, or fixed while a mass hangs on the load side."""

    def __init__(self, device: Device, axis: str) -> None:
        joint = device.file.joint
        assert joint is not None  # a board's device has one
        self._rest, self._axis = dict.fromkeys(device.axes, (0.0, 0.0)), axis
        self._coupling = SteppedCoupling(device, joint.Jh_kgm2.value)
        self._path: Iterator[float] = iter(())
        self._at_rad = self._load_Nm = self._pull_Nm = 0.0
        self._returns = True

    def act(self, act: HandAct, torque_Nm: float) -> None:
        self._load_Nm = torque_Nm
        self._returns = act.kind == "rest"
        path = act.path.theta_rad.tolist() if act.path is not None else []
        at = self._at_rad
        self._path = iter([at + angle for angle in path])

    def step(self) -> Mapping[str, tuple[float, float]]:
        held = self._at_rad
        if self._returns:
            held -= min(max(held, -RETURN_RAD), RETURN_RAD)
        self._at_rad = next(self._path, held)
        self._pull_Nm += (self._load_Nm - self._pull_Nm) / LAID_ON_TICKS
        load, _ = self._coupling.step(self._pull_Nm, self._at_rad)
        return self._rest | {self._axis: (self._at_rad, load)}


class SimulatedHands:
    """Follows the instructions to a person, in the virtual exoskeleton."""

    def __init__(
        self,
        drive: SimulatedBoard,
        torque_error: float = 0.0,
        axis: str | None = None,
        arm_Nm: float = 0.0,
    ) -> None:
        self.drive, self._error, self._arm_Nm = drive, torque_error, arm_Nm
        self._axis = drive.axes[0] if axis is None else axis
        self._load_Nm: float | None = None
        self._joint: HandledJoint | None = None
        if drive.passive:
            self._joint = HandledJoint(drive.device, self._axis)
            drive.set_up(motion=self._joint.step)

    def __call__(self, act: HandAct) -> None:
        before, self._load_Nm = self._load_Nm, None
        if self._joint is not None:
            self._joint.act(act, act.torque_Nm * (1 + self._error))
        elif act.kind == "turn":
            self._set_up(GRIP, self._turning(act, self._at_rad()))
        elif act.kind == "load":
            self._load_Nm = act.torque_Nm
            if before is None:
                self._pull_Nm = 0.0
                self._set_up(HANGING, self._pulling, values=LOCKED)
        elif act.kind == "swing":
            self._pull_Nm = 0.0
            hung = dataclasses.replace(SWINGING, Jh_kgm2=act.inertia_kgm2)
            self._set_up(hung, partial(self._swinging, act))
        elif act.kind == "rest":
            self._set_up(AT_REST)
        else:
            self._set_up(EMPTY, clamped=True)

    def _at_rad(self) -> float:
        assert not self.drive.passive
        truth: Mapping[str, Any] = self.drive.plant.truth()
        return float(truth[of_axis("theta_l_rad", self._axis)])

    def _set_up(
        self,
        person: Person,
        path: Callable[[], Path] | None = None,
        clamped: bool = False,
        values: Mapping[str, float] | None = None,
    ) -> None:
        axes = self.drive.axes
        own = {of_axis(n, self._axis): v for n, v in (values or {}).items()}
        if len(axes) == 1:
            self.drive.set_up(clamped=clamped, person=person, hand=path, values=own)
            return
        one, two = (person if a == self._axis else AT_REST for a in axes)
        hand = CoupledHand((one, two), ends_rad=(ANYWHERE_RAD, ANYWHERE_RAD))

        def paths() -> Sequence[Path]:
            still = {"theta_p_rad": 0.0}
            return [path() if path is not None and a == self._axis else still for a in axes]

        fixed = [clamped and a == self._axis for a in axes]
        self.drive.set_up(clamped=fixed, person=hand, hand=paths if path else None, values=own)

    def _turning(self, act: HandAct, at_rad: float) -> Callable[[], Mapping[str, float]]:
        path = act.path
        assert path is not None
        passed = iter(range(len(path) - 1))

        def intended() -> Mapping[str, float]:
            k = next(passed, len(path) - 1)
            turned = (path.theta_rad, path.omega_rad_s, path.alpha_rad_s2)
            theta_rad, *rates = (float(x[k]) for x in turned)
            return led_path(at_rad + theta_rad, *rates)

        return intended

    def _pulling(self) -> Mapping[str, float]:
        # Laid on without a jerk.
        aim = (self._load_Nm or 0.0) * (1 + self._error)
        self._pull_Nm += (aim - self._pull_Nm) / LAID_ON_TICKS
        return led_path(self._at_rad() + self._pull_Nm / HANGING.spring_Nm_rad)

    def _swinging(self, act: HandAct) -> Mapping[str, float]:
        weight = act.torque_Nm * (1 + self._error) + self._arm_Nm
        self._pull_Nm += (weight - self._pull_Nm) / LAID_ON_TICKS
        at = self._at_rad()
        return led_path(at - self._pull_Nm * math.sin(at - act.hangs_rad) / SWINGING.spring_Nm_rad)


def simulated_bench(
    drive: SimulatedBoard, say: Callable[[str], None] = lambda _: None, axis: str | None = None
) -> CommissioningBench:
    """A board and a person, both simulated; time moves as fast as the computer can."""
    device = LockstepDevice(drive)
    device.listen()
    device.advance(0.3)
    hands = SimulatedHands(drive, axis=axis)
    return CommissioningBench(device, hands, say, device.advance, True, axis)
