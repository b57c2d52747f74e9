"""Virtual participants do the wrist study, through the same engine and tasks.  Simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from esea_host.people.hand import Hand, Pointer
from esea_host.people.person import PersonModel, VirtualParticipant
from esea_host.people.rig import compile_rig
from esea_host.people.source import PersonSource, VirtualPeople
from esea_host.study.folder import StudyFolder
from esea_host.study.many import run_everybody
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.task import Row, Situation, StudyTask
from esea_host.study.watching import Gauge
from esea_host.wrist.actor import Arm, WristActor
from esea_host.wrist.rig import HANDLE_KGM2, NAMES, Rig, impaired_device

PROTOCOL = Path(__file__).parent / "protocol.toml"


class VirtualPerson(PersonSource):
    """A person in the virtual wrist device, for a session."""

    def __init__(self, who: VirtualParticipant, pointer: Pointer | None = None) -> None:
        super().__init__(who, pointer)
        self.rig = Rig(who.limbs)
        self.arm = Arm(who, HANDLE_KGM2)

    def ready(self) -> Mapping[str, Any]:
        """The torque at rest, as the board senses it."""
        still = [(0.0, 0.0, 0.0, 0.0, 0.0)] * 2
        self.rig.advance(still, False)
        return {"simulated": True, "tau_Nm": self.rig.tau_Nm}

    def gauges(self) -> tuple[Gauge, ...]:
        """Torque on the wrist beside the largest that the impairment may ask for."""
        most = self.rig.most_Nm
        return tuple(
            Gauge(f"torque {name.upper()}", tau_Nm, -most, most, "Nm")
            for name, tau_Nm in zip(NAMES, self.rig.tau_Nm, strict=True)
        )

    def hand(self, task: StudyTask, situation: Situation, number: int) -> Hand:
        """The person, told what to do."""
        return WristActor(self.who, self.rig, self.arm, task.name, situation.parameters)


def wrist_protocol(seed: int, method: str = "rbf") -> Protocol:
    """The shipped protocol, with a seed of the study and a method of normalisation."""
    text = PROTOCOL.read_text(encoding="utf-8")
    text = text.replace("seed = 1\n", f"seed = {seed}\n", 1)
    text = text.replace("impairment = true }", f'impairment = true, method = "{method}" }}', 1)
    return parse_protocol(text, PROTOCOL.name)


class WristPeople(VirtualPeople):
    """Participants of the wrist study."""

    def source(self, who: VirtualParticipant, index: int, session: int) -> PersonSource:
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
    compile_rig(impaired_device())
    people = WristPeople(seed, model or PersonModel())
    return run_everybody(folder, asked, participants, people, jobs, cluster, say)


def all_rows(folder: Path) -> list[Row]:
    """Rows of every participant of a study."""
    study = StudyFolder.open(folder, durable=False, runs=False)
    codes = sorted({c for c, _, _ in study.sessions()})
    return [row for code in codes for row in study.rows(code)]
