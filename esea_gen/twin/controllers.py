"""Controllers by name: the device that the virtual exoskeleton runs."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from esea_gen import devices
from esea_gen.device import Device, load_device
from esea_gen.devices.file import read_file
from esea_gen.errors import UserError
from esea_gen.language.system import System
from esea_gen.twin.choices import choose
from esea_gen.twin.trajectories import RATE_HZ

_FOLDER = Path(devices.__file__).parent / "controllers"
CONTROLLERS = {
    "smc": "elbow_drive",
} | {
    name: str(_FOLDER / f"{name}.toml")
    for name in (
        "smc-published",
        "mpc",
        "mpc-no-preview",
        "mpc-published",
        "mpc-published-no-preview",
    )
}


def controller_device(controller: str) -> Device:
    """Device of a controller.

    controller: key of ``CONTROLLERS``, or path of a device file with a drive.
    """
    if not controller.endswith(".toml"):
        choose("controller", controller, CONTROLLERS, ", or give the path of a device file")
    name = CONTROLLERS.get(controller, controller)
    device = _device(name, read_file(name)[0])
    if device.file.sliding_mode is None:
        raise UserError(
            f"{device.origin}: the device has no drive to be simulated.",
            'Write extends = "elbow_drive" in it.',
        )
    rate = device.file.timing.sense_rate_Hz.value
    if rate != RATE_HZ:
        raise UserError(
            f"{device.origin}: timing.sense_rate_Hz = {rate:g} Hz; the studies' signals have a "
            f"sample every {1000 / RATE_HZ:g} ms and would be played at another speed.",
            f"Simulate a device with {RATE_HZ:g} Hz.",
        )
    return device


# By its text as well: a device file may be edited between two runs.  To read one takes longer than
# to simulate two seconds.
@lru_cache(maxsize=8)
def _device(name: str, _text: str) -> Device:
    return load_device(name)


def controller_system(controller: str) -> System:
    """System of a controller: which Blocks it has, and their tunables."""
    return controller_device(controller).system


def largest_torque_Nm(device: Device) -> float:
    """The motor's limit."""
    assert device.file.actuator is not None
    return device.file.actuator.u_max_Nm.value
