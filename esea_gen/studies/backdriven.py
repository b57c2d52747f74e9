"""Transparency: somebody moves the arm, no torque is wanted."""

from __future__ import annotations

from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin import trajectories
from esea_gen.twin.case import Case

BACKDRIVEN_HZ = (0.1, 0.15, 0.2, 0.25)


class Backdriven(ClosedLoopStudy):
    """0 Nm while the arm moves 90 deg peak to peak at 0.1, 0.15, 0.2 and 0.25 Hz."""

    name = "backdriven"
    title = "Backdriven at 0 Nm"
    person = True

    def cases(self) -> list[Case]:
        return [Case(f"{f:g} Hz", trajectories.backdriven(f)) for f in BACKDRIVEN_HZ]
