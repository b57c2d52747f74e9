"""Ways to lead the cable."""

from __future__ import annotations

import dataclasses

from esea_gen.studies.grid import Grid
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Case
from esea_gen.twin.published import PLANTS


class Twists(ClosedLoopStudy):
    """The twelve sines at three ways to lead the cable (assumed: the thesis gives no numbers)."""

    name = "twists"
    title = "The twelve points at three cable twists, output fixed"

    def cases(self) -> list[Case]:
        return [
            dataclasses.replace(c, name=f"{c.name}, twist {angle} deg", plant=vars(t))
            for angle, t in PLANTS.twist.items()
            for c in Grid().cases()
        ]
