"""Python starts with this file (PYTHONPATH): the project's code sees what Windows would give it.

POSIX modules are missing for everybody; for callers from the project ``sys.platform`` and
``os.name`` are Windows', ``os``, ``select``, ``signal`` and ``socket`` lack what typeshed says that
Windows lacks, and text that is written without ``newline`` gets Windows' ends of lines.
"""

import builtins
import fcntl
import os
import pathlib
import select
import signal
import socket
import sys
import types

OURS = ("esea_gen", "esea_host")
MODULES = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")
MISSING = os.environ["ESEA_MISSING"].split()  # module.name
flock, real_import = fcntl.flock, builtins.__import__


def ours(depth: int = 2) -> bool:
    return sys._getframe(depth).f_globals.get("__name__", "").partition(".")[0] in OURS


class Guarded(types.ModuleType):
    def __getattribute__(self, name):
        name_of = types.ModuleType.__getattribute__(self, "__name__")
        if (given := f"{name_of}.{name}") in SEEN and ours():
            if SEEN[given] is None:
                raise AttributeError(f"module '{name_of}' has no attribute '{name}'")
            return SEEN[given]
        return types.ModuleType.__getattribute__(self, name)


SEEN = dict.fromkeys(MISSING) | {"sys.platform": "win32", "os.name": "nt"}


def locking(file, mode, count):
    flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def importing(name, *given, **named):
    if name == "msvcrt" and ours():
        return types.SimpleNamespace(locking=locking, LK_NBLCK=2)
    return real_import(name, *given, **named)


def as_there(function, mode_at):
    # mode_at: where the mode is among the arguments; text without one.
    def called(*given, newline=None, **named):
        mode = named.get("mode") or (given[mode_at:] or ("r",))[0] if mode_at else "w"
        if "b" not in mode and ours():
            assert named.get("encoding"), "Windows' own encoding would be taken"
            newline = newline if newline is not None or mode == "r" else "\r\n"
        return function(*given, newline=newline, **named)

    return called


builtins.open = as_there(builtins.open, 1)
os.fdopen = as_there(os.fdopen, 1)
pathlib.Path.open = as_there(pathlib.Path.open, 1)
pathlib.Path.write_text = as_there(pathlib.Path.write_text, None)
builtins.__import__ = importing
sys.modules.update(dict.fromkeys(MODULES))
for module in (os, select, signal, socket, sys):
    module.__class__ = Guarded
