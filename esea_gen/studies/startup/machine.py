"""The machine as the start-up routine sees it: a command in, encoder counts out, nothing else.

A board is a `Machine` as the virtual exoskeleton is: the procedures know no other way to either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from esea_gen.twin.plant import TICK_S
from esea_gen.twin.stepped import SteppedPlant

Output = Literal["clamped", "free"]


@dataclass(frozen=True)
class Counts:
    """Raw counts of one tick.

    motor, load: joint encoders on either side of the coupling; gear: the motor's own.
    """

    motor: int
    load: int
    gear: int


class Machine(Protocol):
    """A drive that takes a command every tick.

    tick_s: time between two ticks.
    """

    tick_s: float

    def begin(self, output: Output, at_rad: float) -> Counts:
        """Once a person has set the machine up: rest, command 0, the output clamped or free.

        return: what the encoders read in tick 0.
        """

    def step(self, tick: int, u_Nm: float) -> Counts:
        """Command a motor torque in a tick; what the encoders read in the next one."""


class SimulatedMachine:
    """The virtual exoskeleton as a machine; what is behind the counts stays hidden."""

    tick_s = TICK_S

    def __init__(self, plant: SteppedPlant) -> None:
        self._plant = plant

    def begin(self, output: Output, at_rad: float) -> Counts:
        """A plant at rest; nobody has to be waited for."""
        return Counts(*self._plant.start(at_rad, clamped=output == "clamped"))

    def step(self, tick: int, u_Nm: float) -> Counts:
        """One tick of the plant."""
        del tick  # the twin has no time but its own steps
        return Counts(*self._plant.step(u_Nm))


__all__ = ["Counts", "Machine", "Output", "SimulatedMachine"]
