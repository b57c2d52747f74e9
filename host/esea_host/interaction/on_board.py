"""A session of these tasks on a board: the element is confirmed first, the angle has a middle.

At a simulated board an attendant loads the element and a participant plays, both simulated.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_gen.studies.torque_check.procedure import KnownLoad
from esea_host.connection import ConnectedDevice, hands_at
from esea_host.interaction.confirming import PHASES, judge, spring_Nm_rad
from esea_host.interaction.rig import RigPlayer
from esea_host.interaction.tasks import WithElement
from esea_host.people.person import VirtualParticipant
from esea_host.study.board import WORKING, BoardSource
from esea_host.study.plan import PlannedTrial
from esea_host.study.recorded import MIDDLE
from esea_host.study.scene import Scene
from esea_host.study.task import Actor, Inputs, Situation, StudyTask, TaskSignal, task_named
from esea_host.study.words import keyed

# Of a phase: so long it is still, and its mean is taken; nobody is waited for longer.
STILL_S, LONGEST_S, SILENT_S = 1.5, 180.0, 120.0
LEAST_COUNTS = 20  # of the deflection under the load
ROOM_RAD = math.radians(15.0)  # from the middle to a limit: what the tasks ask for, and half of it
MIDDLE_S, LED_RAD_S = 0.5, 0.5
SIMULATED_LOAD = KnownLoad(0.5, 0.2)


# Who builds in an element, loads it and leads the arm where nobody has to be asked; by the words of
# esea_host.simulated.server.Hands.
ElementHands = Callable[[str, float], None]


def process_hands(board: ConnectedDevice) -> ElementHands:
    """Hands at a simulated board in a process of its own; an element in its address stays in."""
    act = hands_at(board)
    if board.address is None or "spring=" not in board.address.place:
        return act
    return lambda word, number: None if word == "spring" else act(word, number)


class ElementBoard(BoardSource):
    """A board with one of the study's elements in its coupling."""

    def __init__(
        self,
        device: ConnectedDevice,
        folder: Path | None,
        drive: bool = False,
        advance: Callable[[float], None] | None = None,
        known: KnownLoad | None = None,
        hands: ElementHands | None = None,
        who: VirtualParticipant | None = None,
    ) -> None:
        super().__init__(device, folder, drive, advance)
        self.hands, self.who = hands, who
        self.known = known or (SIMULATED_LOAD if hands is not None else None)
        self._aims = [0.0]
        self._confirmed = ""

    def before(self, trial: PlannedTrial) -> str:
        """Confirm the element where it is another one than in the trial before."""
        given = task_named(trial.task, "plan").Parameters(**trial.parameters)
        try:
            if isinstance(given, WithElement) and given.element != self._confirmed:
                problem = self._confirm(given.element, given.stiffness_Nm_deg, trial.number)
                if problem:
                    return problem
                self._confirmed = given.element
            if not math.isfinite(self.middle_rad):
                self._take_middle()
        except (LinkError, UserError) as error:
            return str(error)
        finally:
            self.waits("")
        return ""

    # -- the element -------------------------------------------------------------------------------

    def _confirm(self, element: str, stiffness_Nm_deg: float, number: int) -> str:
        if self.known is None:
            raise UserError(
                f"Confirming the {element} needs a known mass.",
                "Give --mass KG and --lever M, such as bend the coupling by 3 deg.",
            )
        self._motor_off()
        if self.hands is not None:
            self.waits(keyed("advice.building_in", element=keyed(f"element.{element}")))
            spring = spring_Nm_rad(self.device.identity.device, element, stiffness_Nm_deg)
            self.hands("spring", spring)
        means = self._phases(self.known)
        if self.hands is not None:
            self.hands("let-go", 0.0)
        if why := self.ask():
            return why
        given = self.device.identity.device, element, self.known, means, stiffness_Nm_deg
        finding = judge(*given)
        self.say("element", trial=number, simulated=self.simulated, **finding.to_dict())
        if finding.problem:
            return finding.problem
        ready = dict(self.ready())
        self.say("ready", **ready)
        return str(ready.get("problem", ""))

    def _motor_off(self) -> None:
        device, until_s = self.device, self.now_s() + 5.0
        if device.state() in WORKING:
            device.disarm()
        while (state := device.state()) in WORKING:
            if self.now_s() > until_s:
                raise UserError(f"The board stays {state}.", "Switch the motor off.")
            self.pull()
        self._state = state

    def _pull(self) -> None:
        # Of a simulated board another plant may be compiled meanwhile.
        tries = round(SILENT_S) if self.hands is not None else 1
        for left in range(tries, 0, -1):
            try:
                self.pull()
            except UserError:
                if left == 1 or self.ask():
                    raise
            else:
                return

    def _phases(self, known: KnownLoad) -> list[float]:
        device = self.device
        tap = self.signals.tap(TaskSignal("theta_rad"))
        assert tap is not None  # every board tells its deflection
        queue = device.subscribe([tap.stream])
        signs, means = (0, 1, 0, -1, 0), list[float]()
        load = {"mass_kg": known.mass_kg, "arm_m": known.arm_m}
        asked = {0: "advice.unloaded", 1: "advice.loaded_one_way", -1: "advice.loaded_other_way"}
        try:
            for k, phase in enumerate(PHASES):
                self.waits(keyed(asked[signs[k]], step=k + 1, steps=len(PHASES), **load))
                if self.hands is not None:
                    self.hands("hang", signs[k] * known.torque_Nm)
                means.append(self._settled(queue, tap.column, phase, means))
                if self.ask():
                    break
        finally:
            device.receiver.unsubscribe(queue)
        return means

    def _settled(self, queue: Any, column: str, phase: str, means: Sequence[float]) -> float:
        file = self.device.identity.device.file
        count = 2 * math.pi / 2 ** round(file.encoder.resolution_bits.value)
        until_s, latest = self.now_s() + LONGEST_S, deque[float](maxlen=round(1e3 * STILL_S))
        while not self.ask():
            self._pull()
            for batch in queue.take(0.0):
                latest.extend(batch.rows[column].tolist())
            there = np.array(latest)
            if len(there) == latest.maxlen and np.ptp(there) < 3.5 * count:
                mean = float(np.mean(there))
                if _is_there(mean, means, LEAST_COUNTS * count):
                    return mean
            if self.now_s() > until_s:
                raise UserError(
                    f"Within {LONGEST_S:g} s the coupling was not {phase} and still.",
                    "Load it as requested, then continue.",
                )
        return math.nan

    # -- the angle's middle ------------------------------------------------------------------------

    def _take_middle(self) -> None:
        angle = next(g for g in self.gauges() if g.name.startswith("angle"))
        low, high = math.radians(angle.low) + ROOM_RAD, math.radians(angle.high) - ROOM_RAD
        now = math.radians(angle.value)
        if low > high:
            raise UserError(
                f"The limits leave {angle.low:.0f} to {angle.high:.0f} deg; the tasks need "
                f"{2 * math.degrees(ROOM_RAD):.0f} deg.",
                "Widen limits.rom_min_rad and limits.rom_max_rad, or use another joint.",
            )
        self.waits(keyed("advice.hold_middle"))
        if self.who is not None and self.hands is not None:
            wanted = min(0.5 * (low + high), low + 2 * ROOM_RAD)
            step = math.copysign(0.01 * LED_RAD_S, wanted - now)
            for k in range(1, 1 + int((wanted - now) / step)):
                self.hands("aim", now + k * step)
                self._frame()
        at = []
        for _ in range(round(100 * MIDDLE_S)):
            self._frame()
            at.append(next(g.value for g in self.gauges() if g.name.startswith("angle")))
        held = math.radians(float(np.mean(at)))
        self.middle_rad = min(max(held, low), high)
        self.say(MIDDLE, inputs={"theta_rad": self.middle_rad}, held_rad=held)

    def _frame(self) -> None:
        self.want({})
        self.pull()

    # -- trials ------------------------------------------------------------------------------------

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        """The person who wears the board, or simulated hands."""
        actor = super().trial(task, situation, number)
        player, hands = None, self.hands
        if self.who is not None and hands is not None:

            def advance(muscle: Sequence[float]) -> list[float]:
                hands("aim", self.middle_rad + muscle[3])
                return [0.0]

            player = RigPlayer(self.who, advance, self._aims, situation, lambda: self.paused)
        return _Centred(actor, self.middle_rad, player)


def _is_there(mean: float, means: Sequence[float], least: float) -> bool:
    # The phase that follows these means: unloaded, one way, unloaded, the other way, unloaded.
    if not means:
        return True
    from_zero = mean - means[0]
    if len(means) == 1:
        return abs(from_zero) > least
    bent = means[1] - means[0]
    if len(means) == 3:
        return from_zero * bent < 0 and abs(from_zero) > least
    return abs(from_zero) < 0.5 * abs(bent)


class _Centred(Actor):
    def __init__(self, inner: Actor, middle_rad: float, player: RigPlayer | None) -> None:
        self._inner, self._middle_rad, self._player = inner, middle_rad, player
        self._last_s = 0.0

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        more = {}
        if self._player is not None:
            self._player.time_s = self._last_s
            played = self._player.react(scene, requests)[1]
            more = {"recentre": 1.0} if played["recentre"] else {}
        self._last_s, inputs = self._inner.react(scene, requests)
        return self._last_s, {"theta_rad": inputs["theta_rad"] - self._middle_rad, **more}
