"""C text of kernels and Blocks in any number format."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Any

from esea_gen.language.block import Block


@lru_cache(maxsize=1 << 14)  # the same in every format
def comment(text: str, indent: int = 0, width: int = 98) -> str:
    pad = " " * indent
    safe = " ".join(text.replace("*/", "* /").split())
    lines = textwrap.wrap(safe, width - indent - 6) or [safe]
    return f"\n{pad} * ".join([f"{pad}/* {lines[0]}", *lines[1:]]) + " */"


def bare(text: str) -> str:
    """C text without the brackets round the whole of it."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for i, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return text[1:-1]


def field_type(port: Any, number: str) -> str:
    """C type of a port's field, where a number has the given one."""
    return f"{port.integer}_t" if getattr(port, "whole", False) else number


DEVICE = "@"  # in a printed name of a constant, for its device's prefix


def number_name(value: Any, choices: type[IntEnum] | None) -> str:
    """C name of one of a choice's numbers; empty where it has none."""
    if choices is None or value not in [*choices]:
        return ""
    return f"{DEVICE}_{choices.__name__}_{choices(int(value)).name}".upper()


@dataclass(frozen=True)
class Statement:
    c_type: str
    name: str
    expression: str
    comment: str = ""


@dataclass(frozen=True)
class PrintedKernel:
    statements: tuple[Statement, ...]
    results: tuple[tuple[str, ...], ...]  # per result, per element, the C atom that holds it
    used_arguments: frozenset[int]


@dataclass(frozen=True)
class EmittedBlock:
    block: Block
    prepare: PrintedKernel | None
    init: PrintedKernel
    step: PrintedKernel
    template: str = "device/esea_block.c.j2"
