"""Small Blocks that tests make up."""

from __future__ import annotations

from typing import Any

from esea_gen.language.block import Block
from esea_gen.language.ports import Port


def port(name: str, low: float, high: float, size: int = 1, **more: Any) -> Port:
    return Port(name, low, high, "made up", size, **more)


def made(
    step: Any, state: Any = (), inputs: Any = (), outputs: Any = (), most: float = 1.0, **more: Any
) -> Block:
    """A Block; where nothing else is named, y_rad within +-most from x_rad within +-1."""
    ports = {"inputs": inputs or (port("x_rad", -1, 1),)}
    ports |= {"outputs": outputs or (port("y_rad", -most, most),), "state": state}
    named = {"name": "made", "title": "made up", "period_s": 1e-3} | more
    return Block.define(step=step, **ports, **named)
