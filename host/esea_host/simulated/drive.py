"""The firmware's application, a virtual drive or passive joint and a virtual person, in lockstep.

Everything that it gives is simulated.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from esea_gen.board.sim import SimBoard
from esea_gen.device import Device, board_device
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.link.transport import Transport
from esea_gen.twin.hand import HAND_NAMES, NOBODY, CoupledHand, hand_variant, named_hand
from esea_gen.twin.people import PLANT_NAMES, limb_of, random_person
from esea_gen.twin.published import PEOPLE, Person
from esea_gen.twin.run import PERSON_NAMES, plant_variant
from esea_gen.twin.stepped import EMPTY, SteppedTwin
from esea_host.connection.device import ConnectedDevice
from esea_host.connection.identity import SIMULATED_BOARDS, identify
from esea_host.recording.replay import loaded_device
from esea_host.simulated.motion import JointMotion, MovedJoint, make_motion

EMPTY_JOINT, CLAMPED = "nobody", "none"
PEOPLE_NAMES = (EMPTY_JOINT, *PERSON_NAMES)
PLANT, PERSON, MOTION = "real", "uncertain", "person"  # unless another is named
NOISE_TICKS = 1000
PUSH_TICKS = 200
# There and back, of each axis; of the first as in the published trials' slow movement.
MOVES_RAD, MOVES_HZ = (0.6, 0.25), (0.4, 0.27)
Intent = Callable[[], Mapping[str, float] | Sequence[Mapping[str, float]]]


class SimulatedBoard:
    """A board whose drivers read a virtual drive that its motor turns, or a passive joint.

    While the board of a drive is active the person moves to and fro; otherwise the person rests.
    A passive joint rests until its encoders are zeroed; from then on it moves.
    """

    def __init__(
        self,
        device: Device | str,
        plant: str | None = None,
        person: str | None = None,
        seed: int = 0,
        board: str = "sim",
        motion: JointMotion | str | None = None,
        spring_Nm_rad: float = 0.0,
    ) -> None:
        given = loaded_device(device) if isinstance(device, str) else device
        self.device = board_device(given)
        known("board", board, SIMULATED_BOARDS)
        self.axes = self.device.axes
        self._seed, self._motion = seed, MOTION if motion is None else motion
        self.passive = not self.device.laws
        self._person: Person | CoupledHand = EMPTY
        self.plant: SteppedTwin | MovedJoint
        if self.passive:
            of_drive = {"plant": plant, "person": person, "spring": spring_Nm_rad}
            if unfit := [n for n, v in of_drive.items() if v]:
                raise UserError(
                    f"{given.name} has no drive: {' and '.join(unfit)} cannot be chosen.",
                    "Choose how it is moved: --motion person, therapist or a table's file.",
                )
            self._clamped = False
            self.first_plant: SteppedTwin | MovedJoint = self._moved_joint()
        else:
            if motion is not None:
                raise UserError(
                    f"{given.name} has a drive: a motion of both its sides cannot be given.",
                    "Choose the person in it: --person NAME.",
                )
            plant, person = known("plant", plant or PLANT, PLANT_NAMES), person or PERSON
            self._person, self._clamped = self._named(person), person == CLAMPED
            if len(self.axes) == 1:
                self._variant = plant_variant(self.device, plant, "ideal", seed)
                self.first_plant = self._plant_with(spring_Nm_rad)
            else:
                self.first_plant = SteppedTwin(hand_variant(self.device, plant, "ideal", seed))
        self.first_person = self._person, self._clamped
        self.board = SimBoard(self.device, board=board)
        self._transport = self.board.transport
        self._counts = [n for n in self.board.inputs if n.startswith("count_")]
        self.pushes_rad, self.led = [0.0] * len(self.axes), False
        self._start()

    def _named(self, person: str) -> Person | CoupledHand:
        if len(self.axes) > 1:
            return named_hand(known("person", person, HAND_NAMES), self._seed)
        return named_person(self.device, person, self._seed)

    def _plant_with(self, spring_Nm_rad: float) -> SteppedTwin:
        device = _with_spring(self.device, spring_Nm_rad) if spring_Nm_rad else self.device
        return SteppedTwin(dataclasses.replace(self._variant, device=device))

    def build_in(self, spring_Nm_rad: float) -> None:
        """Exchange the unloaded element of a drive of one axis, without telling the board."""
        before, plant = self.plant, self._plant_with(spring_Nm_rad)
        self.plant = self.first_plant = plant
        self._begin(plant, [before.truth()["theta_l_rad"]])

    def _begin(self, plant: SteppedTwin, angles_rad: Sequence[float]) -> None:
        self._show(plant.start(angles_rad, clamped=self._clamped, person=self._person))

    def _show(self, counts: Mapping[str, int]) -> None:
        self.board.show(counts[n] for n in self._counts)

    def _moved_joint(self) -> MovedJoint:
        named = self._motion
        motion = make_motion(named, self.device) if isinstance(named, str) else named
        return MovedJoint(self.device, motion, self._seed)

    def set_up(
        self,
        *,
        clamped: bool | Sequence[bool] = False,
        person: Person | CoupledHand | None = None,
        hand: Intent | None = None,
        values: Mapping[str, float] | None = None,
        motion: JointMotion | None = None,
    ) -> None:
        """Change the person's activity at the machine; the state continues."""
        more, self._intent = dict(values or {}), hand
        if isinstance(self.plant, SteppedTwin):
            nobody = EMPTY if len(self.axes) == 1 else NOBODY
            self._person = nobody if person is None else person
            self.plant.change(clamped=clamped, person=self._person, **more)
        elif motion is not None:
            self.plant.motion = motion
        else:
            raise UserError(f"{self.device.name} has no drive.", "Give a motion.")

    def _start(self) -> None:
        self.plant, self._intent = self.first_plant, None
        self._person, self._clamped = self.first_person
        self._pushed_rad = [0.0] * len(self.axes)
        self._noise = np.random.default_rng([self._seed, 3])
        self._draw()
        self.ticks, self._moved_ticks = 0, 0
        if isinstance(self.plant, SteppedTwin):
            self._begin(self.plant, [0.0] * len(self.axes))
        else:
            self.plant = self._moved_joint()
            self.board.show(self.plant.start())

    def restart(self) -> None:
        """Power off and on, everything as at first."""
        self.board.restart()
        self._start()

    def tick(self) -> None:
        """One base tick of the board, and the plant's response to its command."""
        self.board.step()
        plant = self.plant
        if isinstance(plant, SteppedTwin):
            plant.intend(self._paths())
            self._show(plant.step(self.board.motors_Nm))
        else:
            # Zeroed once, it moves whatever the board does.
            moves = not self.led and (self._moved_ticks > 0 or self.board.state_now == "READY")
            self._moved_ticks += moves
            self._push()
            self.board.show(plant.step(moves, self._pushed_rad))
        self.ticks += 1

    def _push(self) -> list[float]:
        # A mouse jumps, and is still for a while; an arm follows.
        steps = [
            (wanted - now) / PUSH_TICKS
            for wanted, now in zip(self.pushes_rad, self._pushed_rad, strict=True)
        ]
        self._pushed_rad = [now + s for now, s in zip(self._pushed_rad, steps, strict=True)]
        return steps

    def _draw(self) -> None:
        shape = NOISE_TICKS, len(self.axes)
        self._white: list[list[float]] = self._noise.standard_normal(shape).tolist()

    def _paths(self) -> Sequence[Mapping[str, float]]:
        if self._intent is not None:
            given = self._intent()
            return [given] if isinstance(given, Mapping) else given
        at = self.ticks % NOISE_TICKS
        if at == 0:
            self._draw()
        moves = self.board.state_now == "ACTIVE" and not self.led
        self._moved_ticks += moves
        paths = []
        for axis, pushed in enumerate(self._push()):
            half, w = MOVES_RAD[axis] / 2, 2 * math.pi * MOVES_HZ[axis]
            phase = w * self._moved_ticks * 1e-3
            paths.append(
                {
                    "theta_p_rad": half * (1 - math.cos(phase)) + self._pushed_rad[axis],
                    "omega_p_rad_s": (half * w * math.sin(phase) if moves else 0.0) + 1e3 * pushed,
                    "alpha_p_rad_s2": half * w * w * math.cos(phase) if moves else 0.0,
                    "noise": self._white[at][axis],
                }
            )
        return paths

    def write(self, data: bytes) -> None:
        self._transport.write(data, 0.0)

    def read(self) -> bytes:
        return self._transport.read(0.0)

    def close(self) -> None:
        self.board.close()


def named_person(device: DeviceData, person: str, seed: int) -> Person:
    """Somebody in the joint of one axis, or nobody."""
    known("person", person, PEOPLE_NAMES)
    if person in (EMPTY_JOINT, CLAMPED):
        return EMPTY
    return limb_of(device, random_person(seed) if person == "random" else PEOPLE[person])


def known(what: str, name: str, names: tuple[str, ...]) -> str:
    if name not in names:
        raise UserError(f"There is no {what} '{name}'.", f"Choose from {', '.join(names)}.")
    return name


def _with_spring(device: DeviceData, stiffness_Nm_rad: float) -> DeviceData:
    """An ideal spring in the elastomer's place, for the plant; the board keeps its law."""
    if not 0.1 <= stiffness_Nm_rad <= 1000:
        raise UserError(f"A spring of {stiffness_Nm_rad:g} Nm/rad.", "Give 0.1 to 1000 Nm/rad.")
    rubber = device.file.elastomer
    if rubber is None or rubber.maxwell is None:
        raise UserError(
            f"{device.name}: only a device with [elastomer.maxwell] can carry a spring.",
            "Take one such as elbow_drive.",
        )

    def changed(model: Any, **values: float) -> dict[str, Any]:
        return {k: getattr(model, k).model_copy(update={"value": v}) for k, v in values.items()}

    maxwell = rubber.maxwell.model_copy(update=changed(rubber.maxwell, kv_Nm_rad=0.0))
    spring = changed(rubber, k1_Nm_rad=stiffness_Nm_rad, k3_Nm_rad3=0.0, alpha_Nm_rad=0.0)
    element = rubber.model_copy(update={**spring, "maxwell": maxwell})
    file = device.file.model_copy(update={"elastomer": element})
    return DeviceData(file, device.origin)


TICKS_A_READ = 20
BEAT_TICKS = 250


class LockstepTransport(Transport):
    """The line to a :class:`SimulatedBoard`; waiting for it advances the board's clock."""

    def __init__(self, drive: SimulatedBoard) -> None:
        self.drive = drive

    def read(self, timeout_s: float) -> bytes:
        data = self.drive.read()
        last = self.drive.ticks + round(timeout_s * 1000)
        while not data and self.drive.ticks < last:
            self.drive.tick()
            data = self.drive.read()
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        self.drive.write(data)

    def close(self) -> None:
        self.drive.close()


class LockstepDevice(ConnectedDevice):
    """A simulated board, connected, moved by :meth:`advance`."""

    def __init__(self, drive: SimulatedBoard) -> None:
        self.drive = drive
        transport = LockstepTransport(drive)
        super().__init__(identify(transport, drive.device), transport, threaded=False)
        self.session.clock_s = lambda: drive.ticks * 1e-3

    def advance(self, time_s: float) -> None:
        for i in range(round(time_s * 1000)):
            if self.drive.ticks % BEAT_TICKS == 0:
                self.drive.write(self._heartbeat())
            self.drive.tick()
            if i % TICKS_A_READ == TICKS_A_READ - 1:
                self.pump()
        self.pump()
