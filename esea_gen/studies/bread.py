"""Cutting bread."""

from __future__ import annotations

from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin import trajectories
from esea_gen.twin.case import Case


class Bread(ClosedLoopStudy):
    """Slices at 0.9 Hz, without help and with 2 Nm."""

    name = "bread"
    title = "Bread cutting at 0 and 2 Nm"
    person = True

    def cases(self) -> list[Case]:
        return [Case(f"{tau:g} Nm", trajectories.bread(tau)) for tau in (0.0, 2.0)]
