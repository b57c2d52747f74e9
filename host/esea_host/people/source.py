"""Where a session's inputs come from when a virtual person is in the device.  Simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from esea_host.people.person import PersonModel, VirtualParticipant, person
from esea_host.study.plan import generator
from esea_host.study.source import InputSource


@dataclass(frozen=True)
class VirtualPeople:
    """Participants of a study: each the same person in every session.

    source: where a participant's inputs come from, by the person, their index and the session.
    """

    seed: int
    model: PersonModel
    source: Callable[[VirtualParticipant, int, int], InputSource]

    def __call__(self, index: int) -> Callable[[int, float], InputSource]:
        who = person(generator(self.seed, 4, index), self.model)

        def source(number: int, days: float) -> InputSource:
            if number:
                who.forget(days)
            return self.source(who, index, number)

        return source
