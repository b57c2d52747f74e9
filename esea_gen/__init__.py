"""esea-gen: from a model of an elastomeric series elastic actuator to verified firmware."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from esea_gen.device import Device, load_device
    from esea_gen.errors import UserError
    from esea_gen.language.block import Block
    from esea_gen.language.ports import Port, Tunable
    from esea_gen.language.system import System, Task
    from esea_gen.version import __version__ as __version__

# Before NumPy reads it.  The matrices here are small: an OpenBLAS with threads takes 7 ms for the
# exponential of a 4 by 4 one, 300 times as long as with one thread, and its sums depend on the
# machine's cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__all__ = ["Block", "Device", "Port", "System", "Task", "Tunable", "UserError", "load_device"]

# Read when first asked for: the symbolic engines take two seconds, and `--help`, completion and the
# host tool's metrics need none of them.
_HOMES = {
    "Block": "language.block",
    "Device": "device",
    "Port": "language.ports",
    "System": "language.system",
    "Task": "language.system",
    "Tunable": "language.ports",
    "UserError": "errors",
    "load_device": "device",
    "__version__": "version",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
