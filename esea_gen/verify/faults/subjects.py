"""The people in whose hands a drive fails or is stopped: from limp to stiff, some with a reflex."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

from esea_gen.twin.published import PEOPLE, Person

# Of the stretch reflex, all assumed: share of the arm's own stiffness, conduction, muscle.
REFLEX_SHARE, REFLEX_DELAY_S, MUSCLE_S = 0.3, 0.05, 0.03
DAMPING_RATIO = 0.4  # of a stiff arm, without which its own late reflex would swing it; assumed


@dataclass(frozen=True)
class Subject:
    person: Person
    reflex: bool = False


def _stiff(spring_Nm_rad: float) -> Subject:
    at = PEOPLE["uncertain"]
    damping = 2 * DAMPING_RATIO * math.sqrt(spring_Nm_rad * at.Jh_kgm2)
    return Subject(replace(at, spring_Nm_rad=spring_Nm_rad, damping_Nms_rad=damping), reflex=True)


# Desired of a drive in their hands, where not 2: more throws a limp arm out of its range.
LIMP, CLAMPED, COMMON = "limp", "clamped", "12 Nm/rad"
SUBJECTS: Mapping[str, Subject] = {
    LIMP: Subject(
        replace(PEOPLE["uncertain"], spring_Nm_rad=0.0, damping_Nms_rad=0.0, feedforward=False)
    ),
    COMMON: Subject(PEOPLE["uncertain"]),
    **{f"{k} Nm/rad": _stiff(k) for k in (30, 60, 120, 250)},
    CLAMPED: Subject(PEOPLE["none"]),
}
MOST_NM = {LIMP: 0.2, CLAMPED: 1.7}


class StretchReflex:
    """Delayed pull against stretch, as a shift of the intended angle."""

    def __init__(self, tick_s: float) -> None:
        self._late = deque([0.0] * round(REFLEX_DELAY_S / tick_s))
        self._keep = math.exp(-tick_s / MUSCLE_S)
        self._pull_rad = 0.0

    def moved(self, intended_rad: float, theta_rad: float) -> float:
        self._late.append(intended_rad - theta_rad)
        self._pull_rad += (1 - self._keep) * (self._late.popleft() - self._pull_rad)
        return intended_rad + REFLEX_SHARE * self._pull_rad


def subject_of(name: str) -> Subject:
    """By its name, here or in ``plants.toml``."""
    return SUBJECTS[name] if name in SUBJECTS else Subject(PEOPLE[name])
