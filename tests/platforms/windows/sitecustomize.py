"""Start-up file that gives the project's code a simulated Windows.

POSIX modules are missing for everybody.  For callers from the project the system is Windows, calls
that it lacks are missing, text without an encoding is an error, and the ends of lines are its own.
"""

import builtins
import fcntl
import inspect
import os
import pathlib
import select
import signal
import socket
import sys
from types import ModuleType, SimpleNamespace

BLOCKED = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")
MISSING = {
    *("os.fork", "os.getuid", "os.geteuid", "os.openpty", "os.ttyname", "os.set_blocking"),
    *("os.pathconf", "os.major", "os.sched_getaffinity", "os.O_NOCTTY", "os.O_NONBLOCK"),
    *("select.poll", "signal.SIGHUP", "signal.alarm", "socket.AF_UNIX"),
}
flock, real_import, getter = fcntl.flock, builtins.__import__, ModuleType.__getattribute__


def ours() -> bool:
    name = inspect.currentframe().f_back.f_back.f_globals.get("__name__") or ""
    return name.partition(".")[0] in ("esea_gen", "esea_host")


class AsThere(ModuleType):
    def __getattribute__(self, name):
        full = f"{getter(self, '__name__')}.{name}"
        if full in MISSING and ours():
            raise AttributeError(full)
        return "win32" if full == "sys.platform" and ours() else getter(self, name)


def importing(name, *given, **named):
    if name == "msvcrt" and ours():
        lock = fcntl.LOCK_EX | fcntl.LOCK_NB
        return SimpleNamespace(locking=lambda file, *_: flock(file, lock), LK_NBLCK=2)
    return real_import(name, *given, **named)


def as_there(function, mode_at):
    def called(*given, newline=None, **named):
        mode = named.get("mode") or ((given[mode_at:] or ("r",))[0] if mode_at else "w")
        if "b" not in mode and ours():
            assert named.get("encoding"), "the locale's encoding"
            newline = "\r\n" if newline is None and mode != "r" else newline
        return function(*given, newline=newline, **named)

    return called


builtins.open, os.fdopen = as_there(builtins.open, 1), as_there(os.fdopen, 1)
pathlib.Path.open = as_there(pathlib.Path.open, 1)
pathlib.Path.write_text = as_there(pathlib.Path.write_text, 0)
builtins.__import__ = importing
sys.modules.update(dict.fromkeys(BLOCKED))
for module in (os, select, signal, socket, sys):
    module.__class__ = AsThere
