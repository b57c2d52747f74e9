"""Virtual participants do the wrist study, through the same engine and tasks.  Simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from esea_gen.device import Device
from esea_host.people.hand import Pointer
from esea_host.people.person import Muscle, PersonModel, VirtualParticipant
from esea_host.people.source import VirtualPeople
from esea_host.simulated import SimulatedBoard
from esea_host.study.folder import StudyFolder
from esea_host.study.many import run_everybody
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.source import InputSource
from esea_host.study.task import Actor, Row, Situation, StudyTask, TaskParameters
from esea_host.wrist.actor import Arm, WristActor
from esea_host.wrist.worn import HANDLE_KGM2, WornWrist, wrist_drive

PROTOCOL = Path(__file__).parent / "protocol.toml"


class VirtualPerson(WornWrist):
    """A person in the simulated drive, whose hand a real pointer may move."""

    def __init__(
        self,
        who: VirtualParticipant,
        folder: Path | None = None,
        pointer: Pointer | None = None,
        device: Device | None = None,
    ) -> None:
        super().__init__(who, folder, device)
        self.pointer, self.arm = pointer, Arm(who, HANDLE_KGM2)
        self._resting: WristActor | None = None

    def hand(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        self._resting = None
        hand = WristActor(self.who, self, self.arm, task.name, situation.parameters)
        hand.pointer = self.pointer
        return hand

    def idle(self) -> Sequence[Muscle]:
        """The hand goes where it rests by itself."""
        if self._resting is None:
            self._resting = WristActor(self.who, self, self.arm, "wrist.neutral", TaskParameters())
        self.arm.felt_deg[:] = self.angles_deg()
        return self._resting.rests()


def wrist_protocol(seed: int, method: str = "rbf") -> Protocol:
    """The shipped protocol, with a seed of the study and a method of normalisation."""
    text = PROTOCOL.read_text(encoding="utf-8")
    text = text.replace("seed = 1\n", f"seed = {seed}\n", 1)
    text = text.replace("impairment = true }", f'impairment = true, method = "{method}" }}', 1)
    return parse_protocol(text, PROTOCOL.name)


class WristPeople(VirtualPeople):
    def source(self, who: VirtualParticipant, index: int, session: int) -> InputSource:
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
    asked = protocol or wrist_protocol(seed, method)
    SimulatedBoard(wrist_drive(), person="nobody").close()  # compiled before the processes start
    people = WristPeople(seed, model or PersonModel())
    return run_everybody(folder, asked, participants, people, jobs, cluster, say)


def all_rows(folder: Path) -> list[Row]:
    study = StudyFolder.open(folder, durable=False, runs=False)
    codes = sorted({c for c, _, _ in study.sessions()})
    return [row for code in codes for row in study.rows(code)]
