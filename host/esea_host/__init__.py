"""The host tool: telemetry, recordings, and experiments with people.

Rooms, from the top floor down: ``cli``; the windows; the three studies; the study engine; the
simulated board; the connection to a board; recordings; metrics and statistics.

``esea_host.connect`` reaches a board, ``esea_host.open_log`` a recording.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from esea_host.connection import open_device as connect
    from esea_host.recording import open_log

__all__ = ["connect", "open_log"]

_FACE = {"connect": "connection.open_device", "open_log": "recording.open_log"}


def __getattr__(name: str) -> Any:
    # Loaded when asked for: who reads a recording needs no link.
    if name not in _FACE:
        raise AttributeError(f"module 'esea_host' has no attribute '{name}'")
    from importlib import import_module

    room, _, what = _FACE[name].partition(".")
    return getattr(import_module(f"esea_host.{room}"), what)
