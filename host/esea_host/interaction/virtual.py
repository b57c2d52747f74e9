"""Virtual participants do the cross-over, through the same engine and tasks.  Simulated."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from esea_host.interaction.design import ELEMENTS, SPRING
from esea_host.interaction.recordings import recording_name, write_manifest, write_recording
from esea_host.interaction.rig import ElementRig, RigPlayer, compile_rig, law_ends
from esea_host.people.hand import Pointer
from esea_host.people.person import PersonModel, VirtualParticipant
from esea_host.people.source import VirtualPeople
from esea_host.study.many import code_of, run_everybody
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.session import COMPLETED
from esea_host.study.source import Gauge, SimulatedSource
from esea_host.study.task import Situation, StudyTask

PROTOCOL = Path(__file__).parent / "protocol.toml"
LAST_S = 45.0  # analysed of each task, as published


class RigSource(SimulatedSource):
    """A person on the virtual rig, for a session; the encoder is recorded at 1 kHz."""

    def __init__(
        self, who: VirtualParticipant, folder: Path, pointer: Pointer | None = None
    ) -> None:
        super().__init__()
        self.who, self.pointer, self.folder, self.aims = who, pointer, folder, [0.0]
        self._rigs: dict[str, ElementRig] = {}
        self._rig: ElementRig | None = None

    def gauges(self) -> tuple[Gauge, ...]:
        """Torque of the element beside its full scale, and its angle as far as its law goes."""
        rig = self._rig
        most_rad, most_Nm = law_ends(rig.element if rig is not None else SPRING)
        theta_deg = math.degrees(rig.theta_rad) if rig is not None else 0.0
        most_deg = math.degrees(most_rad)
        return (
            Gauge("torque", rig.tau_Nm if rig is not None else 0.0, -most_Nm, most_Nm, "Nm"),
            Gauge("angle", theta_deg, -most_deg, most_deg, "deg"),
        )

    def trial(self, task: StudyTask, situation: Situation, number: int) -> RigPlayer:
        """The same person in every trial, on the rig with its element."""
        self._past_s, self.aims[0] = self.now_s(), 0.0  # between trials the hand is let go
        element = situation.parameters.element
        if element not in self._rigs:
            self._rigs[element] = ElementRig(element, self.who.limbs[0])
        rig = self._rig = self._rigs[element]
        rig.start()
        player = RigPlayer(self.who, rig.advance, self.aims, situation, lambda: self.paused)
        self._actor, player.pointer = player, self.pointer
        return player

    def over(self, number: int, state: str) -> None:
        """Keep the recording of a trial that was completed."""
        if state == COMPLETED and self._actor is not None:
            read, held = self._actor.read, self._actor.waited
            time_s = np.arange(1, len(read) + 1) / 1000
            write_recording(self.folder / recording_name(number), time_s, read, held, True)


def rig_source(folder: Path, who: VirtualParticipant, index: int, session: int) -> RigSource:
    """Recordings go where the session's log is."""
    return RigSource(who, folder / code_of(index) / f"session-{session + 1}")


def interaction_protocol(seed: int) -> Protocol:
    """The shipped protocol, with a seed of the study."""
    text = PROTOCOL.read_text(encoding="utf-8").replace("seed = 1\n", f"seed = {seed}\n", 1)
    return parse_protocol(text, PROTOCOL.name)


def run_crossover(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int = 1,
    model: PersonModel | None = None,
    protocol: Protocol | None = None,
    last_s: float | None = None,
    cluster: str | None = None,
    say: Callable[[str], None] | None = None,
) -> list[str]:
    """The cross-over with virtual participants, ready for ``analyse interaction``."""
    asked = protocol or interaction_protocol(seed)
    for element in ELEMENTS:
        compile_rig(element)
    people = VirtualPeople(seed, model or PersonModel(), partial(rig_source, folder))
    early = run_everybody(folder, asked, participants, people, jobs, cluster, say)
    write_manifest(folder, LAST_S if last_s is None else last_s)
    return early
