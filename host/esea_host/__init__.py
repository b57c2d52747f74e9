"""The host tool: telemetry, recordings, and experiments with people.

Rooms, from the top floor down: ``cli``; the windows; the three studies; the study engine; the
simulated board; the connection to a board; recordings; metrics and statistics.

``esea_host.open_device`` reaches a board, ``esea_host.open_log`` a recording.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from esea_host.connection import open_device
    from esea_host.recording import open_log

__all__ = ["open_device", "open_log"]

_ROOMS = {"open_device": "connection", "open_log": "recording"}


def __getattr__(name: str) -> Any:
    # Loaded when asked for: who reads a recording needs no link.
    if name not in _ROOMS:
        raise AttributeError(f"module 'esea_host' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(f"esea_host.{_ROOMS[name]}"), name)
