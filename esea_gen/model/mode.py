"""Modes of a drive: numbers of a command, on the link and in C."""

from enum import IntEnum


class Mode(IntEnum):
    """A drive's mode."""

    OFF = 0
    TORQUE = 1
    IMPEDANCE = 2
