"""Instructions of a torque sensor's step on the Cortex-M4F, for a comparison of models."""

from __future__ import annotations

import numpy as np

from esea_gen.bench.boards import BOARDS, checksum, count_step
from esea_gen.bench.peers import CompiledPeer, peer_sources
from esea_gen.bench.steps import AIM_BOARD
from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.compiler import find_compiler
from esea_gen.targets import ARM_GCC
from esea_gen.verify.streams import domain_chirp, recorded_stream

STEPS = 400


def missing_tool() -> str:
    """What is not installed that counting needs, and how to get it; empty where all is there."""
    from esea_gen.board.emulator import find_qemu

    try:
        find_qemu()
        find_compiler(*ARM_GCC.gcc)
    except UserError as error:
        return str(error)
    return ""


def sensor_instructions(device: Device) -> float:
    """Mean instructions of the emitted f32 step, on a sweep inside the domain, bits checked.

    device: a device that only measures.
    """
    board = next(b for b in BOARDS if b.core == AIM_BOARD)
    theta = domain_chirp(device, STEPS * device.period_s)[:STEPS]
    stream = recorded_stream(device, theta, "sweep in the domain")[device.sensor.name]
    sources = peer_sources(device, device.sensor, stream)["f32"]
    here = CompiledPeer(sources, device.sensor, stream)
    here.run(1)
    renderer = Renderer(device.system, FORMATS["f32"], "-", "-", device.title)
    step = f"esea_{device.name}_{device.sensor.name}_step"
    found = count_step(board, sources, renderer, step, STEPS)
    if found.checksum != checksum(np.asarray(here.results())):
        raise RuntimeError(f"{device.name}: {board.core} computes other bits than this machine")
    return found.mean


__all__ = ["missing_tool", "sensor_instructions"]
