"""Controllers by name: the device that the virtual exoskeleton runs."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from esea_gen.device import Device, load_device
from esea_gen.devices.file import read_file, shipped_devices
from esea_gen.errors import UserError
from esea_gen.language.system import System

DRIVE = "elbow_drive"  # whose plant the virtual exoskeleton has


def controller_device(controller: str) -> Device:
    if (controller.endswith(".toml") and "@" not in controller) or controller in shipped_devices():
        text = read_file(controller)[0]
        device = _device(controller, None, text)
        if any(law.path and _content(str(law.path)) != law.digest for law in device.laws):
            device = _device.__wrapped__(controller, None, text)  # a law of it was edited
        return _simulated(device)
    names, _, base = controller.partition("@")
    base = base or DRIVE
    contents = map(_content, names.split(","))
    return _simulated(_device(base, names, read_file(base)[0] + "".join(contents)))


def _simulated(device: Device) -> Device:
    if not device.laws:
        raise UserError(
            f"{device.origin}: the device has no drive to be simulated.",
            'Write extends = "elbow_drive" in it.',
        )
    return device


def _content(part: str) -> str:
    path = Path(part.partition(".py:")[0] + ".py" if ".py:" in part else part)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


# By its content as well: a file may be edited between two runs.  To read one takes longer than to
# simulate two seconds.
@lru_cache(maxsize=8)
def _device(name: str, controller: str | None, _content: str) -> Device:
    return load_device(name, controller)


def controller_system(controller: str) -> System:
    return controller_device(controller).system


def largest_torque_Nm(device: Device) -> float:
    """Largest motor command that the limits let through."""
    limits = device.file.safety or device.file.actuator
    assert limits is not None
    return limits.u_max_Nm.value
