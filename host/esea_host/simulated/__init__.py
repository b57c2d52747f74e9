"""A board without hardware: the firmware's application, the virtual drive, and a virtual person."""

from esea_host.simulated.drive import LockstepDevice, SimulatedBoard

__all__ = ["LockstepDevice", "SimulatedBoard"]
