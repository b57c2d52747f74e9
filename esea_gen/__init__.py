"""esea-gen: from a model of an elastomeric series elastic actuator to verified firmware."""

from esea_gen.device import Device, load_device
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, Tunable
from esea_gen.language.system import System, Task

__version__ = "0.1.0"

__all__ = ["Block", "Device", "Port", "System", "Task", "Tunable", "UserError", "load_device"]
