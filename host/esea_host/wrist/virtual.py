"""Virtual participants do the wrist study, through the same engine and tasks.  Simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from esea_host.study.folder import StudyFolder
from esea_host.study.many import run_everybody
from esea_host.study.plan import generator
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.scene import Scene
from esea_host.study.session import InputSource
from esea_host.study.task import Actor, Inputs, Row, Situation, StudyTask
from esea_host.wrist.person import PersonModel, VirtualParticipant, WristActor, person
from esea_host.wrist.rig import Rig, rig_library

PROTOCOL = Path(__file__).parent / "protocol.toml"


class VirtualPerson(InputSource):
    """A person in the virtual device, for a session.

    Parameters
    ----------
    who : VirtualParticipant
        Comes again another day.
    """

    def __init__(self, who: VirtualParticipant) -> None:
        self.who, self.rig = who, Rig(who.limbs)
        self.aims = [0.0, 0.0]
        self._past_s = 0.0
        self._actor: WristActor | None = None

    def ready(self) -> Mapping[str, Any]:
        """The torque at rest, as the emitted sensor has it."""
        still = [(0.0, 0.0, 0.0, 0.0, 0.0)] * 2
        self.rig.advance(still, False)
        return {"simulated": True, "tau_Nm": [a.tau_Nm for a in self.rig.axes]}

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        """The person, told what to do."""
        self._past_s = self.now_s()
        self._actor = _Learner(self.who, self.rig, task.name, self.aims, situation)
        return self._actor

    def rest(self, seconds: float) -> None:
        """The hand relaxes."""
        self._past_s, self._actor = self.now_s() + seconds, None

    def now_s(self) -> float:
        """Simulated time."""
        return self._past_s + (self._actor.time_s if self._actor else 0.0)


class _Learner(WristActor):
    """Learns by what it sees of the target, and of its own gain."""

    def __init__(
        self, who: VirtualParticipant, rig: Rig, task: str, aims: list[float], situation: Situation
    ) -> None:
        super().__init__(who, rig, task, aims)
        self.moves = not getattr(situation.parameters, "stationary", True)
        self.learnt = False
        self.first: tuple[float, float, float, float] | None = None

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        # Once a target: half a second after the hand has set off, it was seen to run or stand.
        seen_s = (self.appeared_s or 0.0) + self.who.model.reaction_s + 0.5
        if self.appeared_s is not None and not self.learnt and self.time_s > seen_s:
            self.who.learn(self.moves)
            self.learnt = True
        self._feel(scene)
        return super().react(scene, requests)

    def _feel(self, scene: Scene) -> None:
        # How far the cursor goes for what the hand was told, once that is far enough to tell.
        cursor = next((s for s in scene.shapes if s.role == "cursor"), None)
        if cursor is None or self.task in ("wrist.neutral", "wrist.range", "wrist.velocity"):
            return
        hand = self.aims
        if self.first is None:
            self.first = (cursor.x, cursor.y, hand[0], hand[1])
            return
        for k, shown in enumerate((cursor.x, cursor.y)):
            moved = hand[k] - self.first[2 + k]
            if abs(moved) > 3.0:
                ratio = (shown - self.first[k]) / moved
                rate = self.who.model.gain_rate * 0.01 / 0.5
                self.who.gain[k] += rate * (min(max(ratio, 0.3), 6.0) - self.who.gain[k])
                self.who.gain[k] = max(self.who.gain[k], 0.3)


def wrist_protocol(seed: int, method: str = "rbf") -> Protocol:
    """The shipped protocol, with a seed of the study and a method of normalisation."""
    text = PROTOCOL.read_text(encoding="utf-8")
    text = text.replace("seed = 1\n", f"seed = {seed}\n", 1)
    text = text.replace("impairment = true }", f'impairment = true, method = "{method}" }}', 1)
    return parse_protocol(text, PROTOCOL.name)


@dataclass(frozen=True)
class WristPeople:
    """Participants of the wrist study: each the same person in every session."""

    seed: int
    model: PersonModel

    def __call__(self, index: int) -> Callable[[int, float], InputSource]:
        """Sources of one of them."""
        who = person(generator(self.seed, 4, index), self.model)

        def source(number: int, days: float) -> InputSource:
            if number:
                who.forget(days)
            return VirtualPerson(who)

        return source


def run_study(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int = 1,
    method: str = "rbf",
    model: PersonModel | None = None,
    protocol: Protocol | None = None,
) -> list[str]:
    """The wrist study with virtual participants.

    Parameters
    ----------
    folder : Path
        A new folder.
    participants : int
        How many.
    seed : int
        Of the study and of the people: the same seed is the same study.
    jobs : int
        Processes; the data does not depend on it.
    method : str
        Normalisation in the constrained state.
    model : PersonModel, optional
        The people, other than the default ones.
    protocol : Protocol, optional
        Another one of wrist tasks.

    Returns
    -------
    list of str
        Sessions that ended early, with the reason.
    """
    asked = protocol or wrist_protocol(seed, method)
    rig_library()  # compiled once, before the processes start
    people = WristPeople(seed, model or PersonModel())
    return run_everybody(folder, asked, participants, people, jobs)


def all_rows(folder: Path) -> list[Row]:
    """Rows of every participant of a study."""
    study = StudyFolder.open(folder, durable=False)
    codes = sorted({c for c, _, _ in study.sessions()})
    return [row for code in codes for row in study.rows(code)]
