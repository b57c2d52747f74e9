"""The firmware's application, a virtual drive or passive joint and a virtual person, in lockstep.

Everything that it gives is simulated.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping

import numpy as np

from esea_gen.device import Device, board_device
from esea_gen.errors import UserError
from esea_gen.twin.people import random_person
from esea_gen.twin.published import PEOPLE, Person
from esea_gen.twin.run import PERSON_NAMES, PLANT_NAMES, plant_variant
from esea_gen.twin.stepped import EMPTY, SteppedPlant
from esea_gen.verify.sim import SimBoard
from esea_host.connection.identity import SIMULATED_BOARDS
from esea_host.recording.replay import loaded_device
from esea_host.simulated.elements import with_spring
from esea_host.simulated.joint import MovedJoint
from esea_host.simulated.motion import Motion, make_motion

NOBODY, CLAMPED = "nobody", "none"
PEOPLE_NAMES = (NOBODY, *PERSON_NAMES)
PLANT, PERSON, MOTION = "real", "uncertain", "person"  # unless another is named
NOISE_TICKS = 1000
PUSH_TICKS = 200
AIM_TICKS = 10  # from one aim to the next: a frame of a study
# A mass that hangs pulls with the same torque wherever the joint is; somebody holds the motor.
HANGING = dataclasses.replace(
    EMPTY, spring_Nm_rad=1.0, own_damping_Nms_rad=2.0, damping_Nms_rad=0.0, gravity_Nm=0.0
)
LOCKED = {"fc_Nm": 100.0, "coulomb_width_rad_s": 2e-3, "fv_Nms_rad": 100.0, "J_kgm2": 100.0}
LAID_ON_TICKS = 100
MOVES_RAD, MOVES_HZ = 0.6, 0.4  # flexion and back, as in the published trials' slow movement


class SimulatedBoard:
    """A board whose drivers read a virtual drive that its motor turns, or a passive joint.

    While the board of a drive is active the person moves to and fro; otherwise the person rests.
    A passive joint rests until its encoders are zeroed; from then on it moves.

    Parameters
    ----------
    device : Device or str
        Of a passive one without encoders its board's is simulated.
    plant : str, optional
        Of a drive: ``ideal``, ``real`` or ``random``.
    person : str, optional
        At a drive: ``nobody``, ``none`` (the joint is held), ``ideal``, ``uncertain`` ...
    seed : int
        Of the plant, of the person, and of all noise.
    board : str
        ``sim``, which computes in f32, or ``sim-q31``.
    motion : Motion or str, optional
        Of a passive joint: ``person``, ``therapist``, or a table's file.  A motion that is an
        object goes on where it is after a restart.
    spring_Nm_rad : float
        Of a spring in a drive's coupling in place of its elastomer; 0: the elastomer.

    ``pushes_rad`` is how far somebody pushes each axis away from what the person intends.
    """

    def __init__(
        self,
        device: Device | str,
        plant: str | None = None,
        person: str | None = None,
        seed: int = 0,
        board: str = "sim",
        motion: Motion | str | None = None,
        spring_Nm_rad: float = 0.0,
    ) -> None:
        given = loaded_device(device) if isinstance(device, str) else device
        self.device = board_device(given)
        _known("board", board, SIMULATED_BOARDS)
        self._seed, self._motion = seed, MOTION if motion is None else motion
        self.passive = not self.device.laws
        if self.passive:
            given_of_drive = {"plant": plant, "person": person, "spring": spring_Nm_rad}
            if unfit := [n for n, v in given_of_drive.items() if v]:
                raise UserError(
                    f"{given.name} has no drive: {' and '.join(unfit)} cannot be chosen.",
                    "Say how it is moved: --motion person, therapist or a table's file.",
                )
            if isinstance(self._motion, str):
                make_motion(self._motion, self.device)  # refused before C is compiled
        else:
            if motion is not None:
                raise UserError(
                    f"{given.name} has a drive: a motion of both its sides cannot be given.",
                    "Say who is in it: --person NAME.",
                )
            plant = _known("plant", plant or PLANT, PLANT_NAMES)
            person = _known("person", person or PERSON, PEOPLE_NAMES)
            self.clamped = person == CLAMPED
            self._variant = plant_variant(self.device, plant, "ideal", seed)
            self.plant = self._plant_with(spring_Nm_rad)
            self._person = _person(person, seed)
            self._first = self.plant, self.clamped, self._person
        self.board = SimBoard(self.device, board=board)
        self._transport = self.board.transport
        self._hand: Callable[[], Mapping[str, float]] | None = None
        self.pushes_rad = [0.0] * len(self.device.axes)
        self._start()

    def set_up(
        self,
        *,
        clamped: bool = False,
        person: Person = EMPTY,
        hand: Callable[[], Mapping[str, float]] | None = None,
        values: Mapping[str, float] | None = None,
    ) -> None:
        """What somebody does at the machine meanwhile; everything goes on from where it is.

        hand: what the person intends, asked once a tick; default: as the board's state says.
        values: of the plant, that differ from its own, such as a drive that is locked.
        """
        self.clamped, self._person, self._hand = clamped, person, hand
        self._hung_Nm = None
        self.plant.change(clamped=clamped, person=person, **(values or {}))

    def _plant_with(self, spring_Nm_rad: float) -> SteppedPlant:
        device = with_spring(self.device, spring_Nm_rad) if spring_Nm_rad else self.device
        return SteppedPlant(dataclasses.replace(self._variant, device=device))

    def build_in(self, spring_Nm_rad: float) -> None:
        """Exchange the coupling's element, unloaded; the board goes on and is not told.

        spring_Nm_rad: of a linear spring; 0: the device's own elastomer.
        """
        at_rad = float(self.plant.truth()["theta_l_rad"])
        self.plant = self._plant_with(spring_Nm_rad)
        self._first = self.plant, *self._first[1:]
        self.board.show(self.plant.start(at_rad, clamped=self.clamped, person=self._person))

    def hang(self, load_Nm: float) -> None:
        """Hold the motor still, nobody in the joint, and hang a mass on it, without a jerk."""
        pulled_Nm = self._hung_Nm or 0.0

        def pulling() -> Mapping[str, float]:
            nonlocal pulled_Nm
            pulled_Nm += (load_Nm - pulled_Nm) / LAID_ON_TICKS
            at = float(self.plant.truth()["theta_l_rad"])
            return _still(at + pulled_Nm / HANGING.spring_Nm_rad)

        self.set_up(person=HANGING, hand=pulling, values=LOCKED)
        self._hung_Nm = load_Nm

    def let_go(self) -> None:
        """Take the mass off, let the motor go; whoever was in the joint at first is there again."""
        _, clamped, person = self._first
        self.set_up(clamped=clamped, person=person)

    def aim(self, aim_rad: float) -> None:
        """The person no longer moves to and fro, but to this angle, in the next frame."""
        now = self._aimed[0] if self._aimed else float(self.plant.truth()["theta_l_rad"])
        self._aimed = now, (aim_rad - now) / AIM_TICKS, AIM_TICKS

    def _towards_aim(self, theta_rad: float, step_rad: float, left: int) -> Mapping[str, float]:
        moves = left > 0
        self._aimed = theta_rad + moves * step_rad, step_rad, left - moves
        return _still(self._aimed[0]) | {"omega_p_rad_s": 1e3 * step_rad * moves}

    def _start(self) -> None:
        self._pushed_rad = [0.0] * len(self.device.axes)
        self._hand = None
        self._hung_Nm: float | None = None
        self._aimed: tuple[float, float, int] | None = None  # place, step, how many are left
        self._noise = np.random.default_rng([self._seed, 3])
        self._white = self._noise.standard_normal(NOISE_TICKS)
        self.ticks, self._moved_ticks = 0, 0
        if self.passive:
            named = self._motion
            motion = make_motion(named, self.device) if isinstance(named, str) else named
            self.joint = MovedJoint(self.device, motion, self._seed)
            self.board.show(self.joint.start())
        else:
            self.plant, self.clamped, self._person = self._first
            self.board.show(self.plant.start(0.0, clamped=self.clamped, person=self._person))

    def restart(self) -> None:
        """Power off and on, everything as at first."""
        self.board.restart()
        self._start()

    def tick(self) -> None:
        """One base tick of the board, and what the plant makes of its command."""
        self.board.step()
        if self.passive:
            # Zeroed once, it moves whatever the board does.
            moves = self._moved_ticks > 0 or self.board.state_now == "READY"
            self._moved_ticks += moves
            self._push()
            self.board.show(self.joint.step(moves, self._pushed_rad))
        else:
            self.plant.intend(self._intended())
            self.board.show(self.plant.step(float(self.board.lib.sim_motor_Nm())))
        self.ticks += 1

    def _push(self) -> list[float]:
        # A mouse jumps, and is still for a while; an arm follows.
        steps = [
            (wanted - now) / PUSH_TICKS
            for wanted, now in zip(self.pushes_rad, self._pushed_rad, strict=True)
        ]
        self._pushed_rad = [now + s for now, s in zip(self._pushed_rad, steps, strict=True)]
        return steps

    def _intended(self) -> Mapping[str, float]:
        if self._hand is not None:
            return self._hand()
        at = self.ticks % NOISE_TICKS
        if at == 0:
            self._white = self._noise.standard_normal(NOISE_TICKS)
        if self._aimed:
            return self._towards_aim(*self._aimed) | {"noise": float(self._white[at])}
        moves = self.board.state_now == "ACTIVE"
        self._moved_ticks += moves
        w = 2 * math.pi * MOVES_HZ
        phase, half = w * self._moved_ticks * 1e-3, MOVES_RAD / 2
        (pushed,) = self._push()
        return {
            "theta_p_rad": half * (1 - math.cos(phase)) + self._pushed_rad[0],
            "omega_p_rad_s": (half * w * math.sin(phase) if moves else 0.0) + 1e3 * pushed,
            "alpha_p_rad_s2": half * w * w * math.cos(phase) if moves else 0.0,
            "noise": float(self._white[at]),
        }

    def write(self, data: bytes) -> None:
        """Bytes from the host."""
        self._transport.write(data, 0.0)

    def read(self) -> bytes:
        """Bytes for the host."""
        return self._transport.read(0.0)

    def close(self) -> None:
        """Let go of the board."""
        self.board.close()


def _still(at_rad: float) -> dict[str, float]:
    return {"theta_p_rad": at_rad, "omega_p_rad_s": 0.0, "alpha_p_rad_s2": 0.0, "noise": 0.0}


def _known(what: str, name: str, names: tuple[str, ...]) -> str:
    if name not in names:
        raise UserError(f"There is no {what} '{name}'.", f"Choose from {', '.join(names)}.")
    return name


def _person(name: str, seed: int) -> Person:
    if name in (NOBODY, CLAMPED):
        return EMPTY
    return random_person(seed) if name == "random" else PEOPLE[name]
