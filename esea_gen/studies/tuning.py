"""The thesis' tuning case."""

from __future__ import annotations

from types import MappingProxyType

from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin import trajectories
from esea_gen.twin.case import Case


class TuningCase(ClosedLoopStudy):
    """The thesis' tuning case: 1.7 Nm at 0.6 Hz."""

    name = "tuning"
    title = "Tuning case, output fixed"
    thesis_Nm = MappingProxyType(
        {"smc-published": 0.590, "mpc-published": 0.386, "mpc-published-no-preview": 0.386}
    )

    def cases(self) -> list[Case]:
        return [Case("1.7 Nm 0.6 Hz", trajectories.tuning())]
