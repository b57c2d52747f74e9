"""Python before 3.12 counts references to ``None``; PySide6 6.12 forgets to take them.

Each call of Qt that returns ``None``, ``True``, ``False`` or ``NotImplemented`` gives one back that
was never taken, some hundreds a picture, and when none is left, within seconds, Python ends the
program.  So there are many from the start: enough for centuries.  From 3.12 on nobody counts them.
"""

from __future__ import annotations

import ctypes
import sys

MANY = 1 << 45
RETURNED = (None, True, False, NotImplemented)


def take_many() -> None:
    # Debug builds of Python lay an object out otherwise.
    plain = not hasattr(sys, "getobjects") and sys.implementation.name == "cpython"
    for one in RETURNED:
        if sys.version_info < (3, 12) and plain and sys.getrefcount(one) < MANY // 2:
            ctypes.c_ssize_t.from_address(id(one)).value += MANY
