"""Windows: plain objects have the content, Qt only draws it."""

from __future__ import annotations

import ctypes
import sys

MANY = 1 << 45


def take_references() -> None:
    """Python before 3.12 counts references to ``None``; PySide6 6.12 forgets to take them.

    Each call of Qt that returns one of these gives one back that was never taken, some hundreds a
    picture, and when none is left, within seconds, Python ends the program.  So there are enough
    for centuries from the start.
    """
    # Debug builds of Python lay an object out otherwise.
    plain = not hasattr(sys, "getobjects") and sys.implementation.name == "cpython"
    for one in (None, True, False, NotImplemented):
        if sys.version_info < (3, 12) and plain and sys.getrefcount(one) < MANY // 2:
            ctypes.c_ssize_t.from_address(id(one)).value += MANY


take_references()
