"""Virtual participants do the wrist study, through the same engine and tasks.  Simulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from esea_gen.device import Device
from esea_host.people.hand import FRAME_S, Pointer, shape
from esea_host.people.person import PersonModel, VirtualParticipant
from esea_host.people.source import VirtualPeople
from esea_host.simulated import SimulatedBoard
from esea_host.study.folder import StudyFolder
from esea_host.study.many import run_everybody
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.scene import Scene
from esea_host.study.source import InputSource
from esea_host.study.task import Actor, Inputs, Row, Situation, StudyTask
from esea_host.wrist.actor import WristActor
from esea_host.wrist.worn import WornWrist, wrist_drive

PROTOCOL = Path(__file__).parent / "protocol.toml"
HOLDING = (8.0, 0.3)  # of a hand that nobody moves: Nm/rad and Nms/rad
HOME_DEG_S = 40.0  # and how fast it goes home


class VirtualPerson(WornWrist):
    """A person in the simulated wrist drive, for a session.

    Parameters
    ----------
    who : VirtualParticipant
        Comes again another day.
    folder : Path, optional
        Of the session, for the board's recording.
    pointer : callable, optional
        Somebody real who points moves this person's hand; the device stays simulated.
    device : Device, optional
        Default: ``wrist_drive``.
    """

    def __init__(
        self,
        who: VirtualParticipant,
        folder: Path | None = None,
        pointer: Pointer | None = None,
        device: Device | None = None,
    ) -> None:
        super().__init__(who, folder, device)
        self.pointer, self.aims = pointer, [0.0, 0.0]

    def hand(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        """The person, told what to do."""
        hand = _Learner(self.who, self, task.name, self.aims, situation)
        hand.pointer = self.pointer
        return hand

    def idle(self) -> Sequence[Sequence[float]]:
        """The hand goes home."""
        before, most = list(self.aims), HOME_DEG_S * FRAME_S
        self.aims[:] = [x - min(max(x, -most), most) for x in before]
        ends = zip(before, self.aims, strict=True)
        return [(*HOLDING, *map(math.radians, e), self.who.model.effort_Nm) for e in ends]


class _Learner(WristActor):
    """Learns by what it sees of the target, and of its own gain."""

    def __init__(
        self,
        who: VirtualParticipant,
        rig: WornWrist,
        task: str,
        aims: list[float],
        situation: Situation,
    ) -> None:
        super().__init__(who, rig, task, aims)
        self.moves = not getattr(situation.parameters, "stationary", True)
        self.learnt = False

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        # Once a target: half a second after the hand has set off, it was seen to run or stand.
        seen_s = (self.appeared_s or 0.0) + self.who.model.reaction_s + 0.5
        if self.appeared_s is not None and not self.learnt and self.time_s > seen_s:
            self.who.learn(self.moves)
            self.learnt = True
        # In the other tasks the cursor is the hand itself, or nothing.
        cursor = shape(scene, "cursor")
        if cursor and self.task not in ("wrist.neutral", "wrist.range", "wrist.velocity"):
            self.feel((cursor.x, cursor.y))
        return super().react(scene, requests)


def wrist_protocol(seed: int, method: str = "rbf") -> Protocol:
    """The shipped protocol, with a seed of the study and a method of normalisation."""
    text = PROTOCOL.read_text(encoding="utf-8")
    text = text.replace("seed = 1\n", f"seed = {seed}\n", 1)
    text = text.replace("impairment = true }", f'impairment = true, method = "{method}" }}', 1)
    return parse_protocol(text, PROTOCOL.name)


class WristPeople(VirtualPeople):
    """Participants of the wrist study."""

    def source(self, who: VirtualParticipant, index: int, session: int) -> InputSource:
        """In the virtual wrist device."""
        return VirtualPerson(who)


def run_study(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int = 1,
    method: str = "rbf",
    model: PersonModel | None = None,
    protocol: Protocol | None = None,
    cluster: str | None = None,
    say: Callable[[str], None] | None = None,
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
    cluster : str, optional
        In place of processes: address of a Dask scheduler.
    say : callable, optional
        Is told whenever a participant is through.

    Returns
    -------
    list of str
        Sessions that ended early, with the reason.
    """
    asked = protocol or wrist_protocol(seed, method)
    SimulatedBoard(wrist_drive(), person="nobody").close()  # compiled before the processes start
    people = WristPeople(seed, model or PersonModel())
    return run_everybody(folder, asked, participants, people, jobs, cluster, say)


def all_rows(folder: Path) -> list[Row]:
    """Rows of every participant of a study."""
    study = StudyFolder.open(folder, durable=False, runs=False)
    codes = sorted({c for c, _, _ in study.sessions()})
    return [row for code in codes for row in study.rows(code)]
