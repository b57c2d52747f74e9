"""The elements of the comparison as device files, and the virtual rig: a wrist turns a handle.

The rig has no motor, so the other end of the element stands still.  Its law is taken to be that of
the torque sensor.  Mass of the handle is assumed.  Simulated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from esea_gen.device import Device, load_device
from esea_gen.errors import UserError
from esea_host.interaction.loading import LoadingCurve, LoadingProtocol, analyse_loading
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


# Thesis section 6.4, Nm/deg.
PUBLISHED_NM_DEG = {"spring": 0.0502, "elastomer": 0.0480}
ELEMENTS = ("spring", "elastomer", "equal")  # equal: an ideal spring as stiff as the elastomer


def element_file(element: str) -> Path:
    """The device file of an element, to give to any command that takes one."""
    return Path(str(resources.files("esea_host.interaction") / "devices" / f"rig_{element}.toml"))


@cache
def element_device(element: str) -> Device:
    """The element as a device of the generator, read once a process."""
    return load_device(element_file(element))


def simulated_loading(
    device: Device, protocol: LoadingProtocol | None = None, skip_first: bool = False
) -> LoadingCurve:
    """The protocol run on the device's torque model: simulated, not measured."""
    _, theta, omega = (protocol or LoadingProtocol()).motion(1 / device.period_s)
    found, _ = device.sensor.simulator().run({"theta_rad": theta, "omega_rad_s": omega})
    return analyse_loading(theta, np.ravel(found["tau_Nm"]), skip_first=skip_first)
