"""A sample of a campaign on an emulated processor: the same ticks, the same motor."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from esea_gen.analysis.campaign import Progress
from esea_gen.board.scripted import TapedBoard, play
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.verify.faults.driven import DrivenRig, below_the_inputs
from esea_gen.verify.faults.kinds import BoardFault
from esea_gen.verify.faults.rig import FaultRig, scene_of

# What a script cannot do: flip bits in memory, lose ticks, take time, cut power.
_ELSEWHERE = ("clock", "state", "coefficients", "store")
DEFAULT_EMULATOR = "mps2-an500"


@dataclass(frozen=True)
class EmulatedFault:
    input: str
    kind: str
    scene: str
    ticks: int
    off_tick: int | None
    fault: int
    emulated: int
    first_difference: int | None

    @property
    def same(self) -> bool:
        return self.first_difference is None and self.fault == self.emulated


def emulated_sample(
    device: Device,
    cases: Sequence[dict[str, Any]],
    count: int,
    seed: int,
    progress: Progress | None = None,
) -> list[EmulatedFault]:
    """Draw faults of a campaign and run them in ``sim`` and in the emulator."""
    able = [c for c in cases if c["place"] not in _ELSEWHERE]
    if not able:
        raise UserError("None of these faults can be run in the emulator.", "Ask for more runs.")
    drawn = random.Random(seed).sample(able, min(count, len(able)))
    rigs: list[FaultRig] = [FaultRig(device), DrivenRig(device)]
    for rig in rigs:
        rig.board.close()
        rig.board = TapedBoard(device)
    found = []
    try:
        for k, case in enumerate(drawn):
            found.append(_one(device, rigs, case))
            if progress is not None:
                progress(k + 1, len(drawn), sum(not f.same for f in found))
    finally:
        for rig in rigs:
            rig.close()
    return found


def _one(device: Device, rigs: Sequence[FaultRig], case: dict[str, Any]) -> EmulatedFault:
    fault = BoardFault(case["place"], case["kind"], case["amount"])
    scene = scene_of(case)
    rig = rigs[below_the_inputs(fault)]
    rig.run(scene, fault, case["at"], case["seed"])
    taped = rig.board
    assert isinstance(taped, TapedBoard)
    tape = taped.taken()
    if fault.place == "stop line":
        tape.stop_from = case["at"]
    there = play(device, DEFAULT_EMULATOR, tape)
    pairs = list(zip(tape.motor, there.motor, strict=True))
    differs = next((k for k, (a, b) in enumerate(pairs) if a != b), None)
    off = next((k for k, (on, _) in enumerate(tape.motor) if k >= case["at"] and not on), None)
    return EmulatedFault(
        fault.input, fault.kind, scene.name, len(pairs), off, tape.fault, there.fault, differs
    )
