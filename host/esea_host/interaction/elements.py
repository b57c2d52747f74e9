"""Spring and elastomer of the comparison as device files, and their loading curves simulated."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from esea_gen.device import Device, load_device
from esea_host.interaction.loading import LoadingCurve, LoadingProtocol, analyse_loading

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
