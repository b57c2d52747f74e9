"""Where a session's inputs come from when a virtual person is in the device.  Simulated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from esea_host.people.hand import ActingHand, Pointer
from esea_host.people.person import PersonModel, VirtualParticipant, person
from esea_host.study.plan import generator
from esea_host.study.source import InputSource
from esea_host.study.task import Actor, Situation, StudyTask


class PersonSource(InputSource):
    """A person in a virtual device, for a session."""

    simulated = True

    def __init__(self, who: VirtualParticipant, pointer: Pointer | None = None) -> None:
        self.who, self.pointer = who, pointer
        self._past_s = 0.0
        self._hand: ActingHand | None = None

    @abstractmethod
    def hand(self, task: StudyTask, situation: Situation, number: int) -> ActingHand: ...

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        """The same person in every trial."""
        self._past_s = self.now_s()
        self._hand = self.hand(task, situation, number)
        self._hand.pointer = self.pointer
        return self._hand

    def rest(self, seconds: float) -> None:
        """The hand relaxes."""
        self._past_s, self._hand = self.now_s() + seconds, None

    def now_s(self) -> float:
        return self._past_s + (self._hand.time_s if self._hand else 0.0)


@dataclass(frozen=True)
class VirtualPeople(ABC):
    """Participants of a study: each the same person in every session."""

    seed: int
    model: PersonModel

    @abstractmethod
    def source(self, who: VirtualParticipant, index: int, session: int) -> InputSource:
        """Where a participant's inputs of a session come from."""

    def __call__(self, index: int) -> Callable[[int, float], InputSource]:
        who = person(generator(self.seed, 4, index), self.model)

        def source(number: int, days: float) -> InputSource:
            if number:
                who.forget(days)
            return self.source(who, index, number)

        return source
