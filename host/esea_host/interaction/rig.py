"""The virtual test rig: a wrist turns a handle against one compliant element.  Simulated.

The rig has no motor, so the other end of the element stands still.  Its law is taken to be that of
the torque sensor.  Mass of the handle is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from esea_gen.errors import UserError
from esea_host.interaction.elements import element_device
from esea_host.people.person import Limb
from esea_host.people.rig import SensedRig

HANDLE_KGM2 = 0.001


def law_ends(element: str) -> tuple[float, float]:
    """How far the element's law goes, rad, and its full scale, Nm."""
    device = element_device(element)
    return float(device.sensor.inputs[0].high), float(device.file.domain.tau_full_scale_Nm.value)


class ElementRig(SensedRig):
    """A wrist on the rig."""

    def __init__(self, element: str, limb: Limb) -> None:
        super().__init__(element_device(element), (limb,), HANDLE_KGM2)
        self.element = element
        self._most_rad, _ = law_ends(element)
        self._at = self.board.places["theta_rad"], self.board.places["tau_Nm"]

    @property
    def theta_rad(self) -> float:
        return -float(self.board.values[self._at[0]])

    @property
    def tau_Nm(self) -> float:
        return float(self.board.values[self._at[1]])

    def advance(self, muscle: Sequence[float]) -> list[float]:
        """A frame; the board's angle at each of its milliseconds."""
        wrist, read = self.axes[0], self.frame((muscle,), "theta_rad")
        if abs(wrist.theta_rad) > self._most_rad:
            raise UserError(
                f"The {self.element} is bent by {math.degrees(wrist.theta_rad):.1f} deg, its law "
                f"goes to {math.degrees(self._most_rad):.1f} deg.",
                "Ask people for less motion.",
            )
        return [-x for x in read]

    def show(self) -> None:
        # Motor side minus load side; the motor side stands still.
        self.board.drivers[0] = self.counted(self.axes[0].deflection_rad)
