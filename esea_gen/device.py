"""Devices: the numbers of a device file, and the Blocks and System built from them."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from esea_gen.control.system import torque_control_system
from esea_gen.devices.file import DeviceData, copied_file, parse_file, read_file
from esea_gen.language.block import Block
from esea_gen.language.system import System
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.filters import tracking_observer
from esea_gen.model.inverse import chosen_inverse
from esea_gen.model.sensing import sensing_system


class Device(DeviceData):
    """A validated device: its numbers, and the Blocks and System built from them.

    Parameters
    ----------
    file : DeviceFile
        The validated content.
    origin : str
        Name of the file it was read from, for messages.
    """

    @cached_property
    def sensor(self) -> Block:
        """The torque sensor Block (spec section 3)."""
        return torque_sensor(self)

    @cached_property
    def velocity(self) -> Block:
        """The velocity estimate Block."""
        return tracking_observer(self)

    @cached_property
    def inverse(self) -> Block:
        """The inverse that the section ``[inverse]`` asks for; exact where there is none."""
        return chosen_inverse(self)

    @cached_property
    def system(self) -> System:
        """All Blocks, wired into tasks: torque control for a device with a drive, else sensing.

        Torque control is predictive where the file has a section ``[predictive]``, else sliding
        mode.
        """
        if self.file.predictive is not None:
            # Late: its programs of kernels take the emitter along.
            from esea_gen.control.predictive_system import device_predictive_system

            return device_predictive_system(self, self.velocity, self.sensor, self.inverse)
        if self.file.sliding_mode is not None:
            return torque_control_system(self, self.velocity, self.sensor, self.inverse)
        return sensing_system(self, self.velocity, self.sensor)


def load_device(name_or_path: str | Path) -> Device:
    """Read and validate a device file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped device (``elbow``) or path of a TOML file.

    Returns
    -------
    Device
        The validated device.

    Raises
    ------
    UserError
        When there is no such device, the file is not TOML, or a key, unit, value or relation is
        wrong; the message names file, key, value, limit and fix.
    """
    return parse_device(*read_file(name_or_path))


def parse_device(text: str, origin: str) -> Device:
    """Validate the text of a device file.

    Parameters
    ----------
    text : str
        TOML.
    origin : str
        File name for messages.

    Returns
    -------
    Device
        The validated device.

    Raises
    ------
    UserError
        As :func:`load_device`.
    """
    return Device(parse_file(text, origin), origin)


def copy_device(base: Device, name: str) -> Device:
    """A new device with the numbers of another one.

    None of them is published or identified for the new device: each becomes ``assumed``, and its
    source says where it was copied from.

    Parameters
    ----------
    base : Device
        Whose numbers.
    name : str
        Name of the new device.

    Returns
    -------
    Device
        The new device.

    Raises
    ------
    UserError
        For a name that is no lower case C identifier of 1 to 15 characters, or a shipped device's.
    """
    return Device(copied_file(base, name), f"{name}.toml")
