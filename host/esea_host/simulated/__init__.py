"""A board without hardware: the firmware's application, the virtual drive, and a virtual person."""

from esea_host.simulated.drive import SimulatedBoard
from esea_host.simulated.lockstep import LockstepDevice

__all__ = ["LockstepDevice", "SimulatedBoard"]
