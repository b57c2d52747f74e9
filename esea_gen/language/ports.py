"""Ports of the usual shapes."""

from __future__ import annotations

from typing import Any

from esea_gen.language.block import Port


def around(name: str, limit: float, meaning: str, *more: Any, **named: Any) -> Port:
    """A port whose range is ``limit`` either way of 0; the rest as in :class:`Port`."""
    return Port(name, -limit, limit, meaning, *more, **named)
