"""Sines over the operating space."""

from __future__ import annotations

from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Case
from esea_gen.twin.trajectories import fixed_sinusoid

GRID_NM = {0.25: (1, 2, 3, 4), 0.5: (1, 2, 3, 4), 1.0: (1, 2, 3), 1.5: (0.75,)}


class Grid(ClosedLoopStudy):
    """Twelve sines in the operating space, 0.75 to 4 Nm, 0.25 to 1.5 Hz."""

    name = "grid"
    title = "Twelve points of the operating space, output fixed"

    def cases(self) -> list[Case]:
        return [
            Case(f"{torque:g} Nm {f:g} Hz", fixed_sinusoid(torque, f))
            for f, torques in GRID_NM.items()
            for torque in torques
        ]
