"""Instructions of a Block's step on emulated processors, counted by a plugin of the emulator."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from esea_gen.board.bare import emulate
from esea_gen.emit.render import Renderer
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream
from esea_gen.targets import Board


@dataclass(frozen=True)
class Count:
    """Instructions of a step, and the checksum of all outputs."""

    mean: float
    least: int
    most: int
    checksum: int


def checksum(results: Array) -> int:
    """FNV-1a of outputs as float64, shape (steps, outputs), as the board's program has it."""
    total = 2166136261
    for byte in np.ascontiguousarray(results, dtype="<f8").tobytes():
        total = ((total ^ byte) * 16777619) & 0xFFFFFFFF
    return total


def stream_program(renderer: Renderer, block: Block, stream: Stream) -> dict[str, str]:
    """The C of a Block's step as it ships, and a loop that runs a stream through it."""
    renderer.env.filters["number17"] = repr
    columns = [stream.inputs[p.name].reshape(stream.steps, -1) for p in block.inputs]
    context = {
        "block": block,
        "sizes": {
            "inputs": sum(p.size for p in block.inputs),
            "outputs": sum(p.size for p in block.outputs),
        },
        "steps": stream.steps,
        "rows": np.hstack(columns).tolist(),
    }
    names = ("bench.h", "stream.h", "struct.c")
    own = {n: text for n, text in renderer.files().items() if "/" not in n}
    return own | {n: renderer.render(f"bench/{n}.j2", **context) for n in names}


def count_step(
    board: Board, files: dict[str, str], renderer: Renderer, step: str, libm: bool = False
) -> Count:
    """Count the instructions of a step on an emulated board."""
    context = {"board": board, "double": libm}
    extra = {n: renderer.render(f"bench/{n}.j2", **context) for n in ("board.c", "board.ld")}
    done = emulate(files | extra, board, step, "counted_high", "counted_low")
    found = re.search(r"^([0-9a-f]{8})$", done.said, re.MULTILINE)
    if found is None:
        raise RuntimeError(f"{board.title} did not answer: {done.said}")
    n = done.instructions
    return Count(n["mean"], int(n["min"]), int(n["max"]), int(found.group(1), 16))
