"""Kinds of faults: every input of the board, its memory, its clock, its link."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.roles import board_roles
from esea_gen.language.ports import Port

# Ways in which a reading or a wanted value may be wrong, from a moment on.
INPUT_KINDS = (
    "freeze",
    "jump",
    "ramp",
    "sign flip",
    "NaN",
    "bit flip",
    "drop",
    "delay",
    "duplicate",
)
MOST_DELAY = 40  # ticks
OFTEN = 4  # so often comes an input in a round in which every word of memory comes once
# By kind, the amounts of which one is drawn: share of the range, share a second, ticks.
AMOUNTS: dict[str, tuple[float, ...]] = {
    "jump": (-0.3, -0.02, 0.02, 0.3),
    "ramp": (-0.3, -0.02, 0.02, 0.3),
    "drop": (1, 3, 5, 20, 700),
    "delay": (2, 5, 10, 40),
    "duplicate": (2, 3, 5),
}
CLOCK_KINDS = {"lost ticks": (1, 2, 7, 60), "control starved": (5, 10, 25, 60, 200)}


@dataclass(frozen=True)
class BoardFault:
    place: str
    kind: str
    amount: float = 0.0
    word: str = ""
    byte: int = 0

    @property
    def input(self) -> str:
        return f"{self.place}.{self.word}" if self.word else self.place


def measured_and_wanted(device: Device) -> tuple[list[str], list[str]]:
    """Inputs that drivers give, and inputs that the host gives and a person could see wrong."""
    roles = board_roles(device.system)
    told = {"stop", "rearm"}  # the board's own; a stop is a fault of its own here
    one = [x.name for x in roles.wanted if x.name not in told and x.port.size == 1]
    return [x.name for x in roles.measured], one


def input_ports(device: Device) -> dict[str, Port]:
    return {x.name: x.port for t in device.system.tasks for x in device.system.task_inputs(t)}


@dataclass(frozen=True)
class Word:
    """Four bytes of memory with a name."""

    name: str
    byte: int


def words(dtype: Any, before: str = "", start: int = 0) -> list[Word]:
    """Words of a C struct, in order; ``dtype`` as numpy has it."""
    found: list[Word] = []
    if dtype.names:
        for name in dtype.names:
            kind, offset = dtype.fields[name][:2]
            found += words(kind, f"{before}.{name}" if before else name, start + offset)
    elif dtype.subdtype:
        kind, shape = dtype.subdtype
        for i in range(shape[0]):
            found += words(kind, f"{before}[{i}]", start + i * kind.itemsize)
    else:
        found.append(Word(before, start))
    return found


def all_faults(
    device: Device,
    state: Sequence[Word],
    coefficients: Sequence[Word],
    seed: int,
    most: int,
    more: Sequence[BoardFault] = (),
) -> list[BoardFault]:
    """Every input with every kind, every word of memory, and so on, until there are ``most``."""
    rng = random.Random(seed)
    measured, wanted = measured_and_wanted(device)
    found: list[BoardFault] = []
    while len(found) < most:
        for _ in range(OFTEN):
            found += [
                BoardFault(place, kind, rng.choice(AMOUNTS.get(kind, (float(rng.randrange(32)),))))
                for place in (*measured, *wanted)
                for kind in INPUT_KINDS
            ]
            found += [
                BoardFault("clock", kind, rng.choice(amounts))
                for kind, amounts in CLOCK_KINDS.items()
            ]
            found += [BoardFault("link", "cut"), BoardFault("stop line", "open")]
            found += [BoardFault("operator", "stop"), *more]
        for place, all_ in (("state", state), ("coefficients", coefficients)):
            found += [
                BoardFault(place, "bit flip", float(rng.randrange(32)), w.name, w.byte)
                for w in all_
            ]
    return found[:most]


class Distortion:
    """Change of an input from the fault on."""

    def __init__(
        self, fault: BoardFault, low: float, high: float, wraps: bool, whole: bool = False
    ) -> None:
        self.fault, self.low, self.high, self.wraps = fault, low, high, wraps
        self.whole = whole  # held as a uint32_t
        self._before: list[float] = []
        self._held, self._gone = 0.0, 0.0
        self._distort: Callable[[int, float], float] = {
            "freeze": lambda age, x: self._held,
            "jump": lambda age, x: self._moved(x, fault.amount),
            "ramp": lambda age, x: self._moved(x, fault.amount * age * 1e-3),
            "sign flip": lambda age, x: self.high - (x - self.low) if wraps else -x,
            "NaN": lambda age, x: math.nan,
            "bit flip": self._flipped,
            "gain": self._scaled,
            "drop": lambda age, x: math.nan if age < fault.amount else x,
            "delay": lambda age, x: self._before[-1 - int(fault.amount)],
            "duplicate": lambda age, x: self._before[-1 - age % int(fault.amount)],
        }[fault.kind]

    def __call__(self, age: int, value: float) -> float:
        """The value in place of one, so many ticks after the fault began; before, that value."""
        self._before = [*self._before[-MOST_DELAY:], value]
        if age < 0:
            self._held = value
            return value
        if len(self._before) > 1:
            self._gone += self._step(value - self._before[-2])
        found = self._distort(age, value)
        if not self.whole:
            return found
        return float(math.ceil(found) % 2**32) if math.isfinite(found) else 2.0**32 - 1

    def _moved(self, x: float, share: float) -> float:
        x += share * (self.high - self.low)
        if not self.wraps:
            return x
        full = self.high - self.low + 1
        return self.low + math.floor(x - self.low) % full

    def _step(self, counts: float) -> float:
        # The short way round.
        full = self.high - self.low + 1
        return (counts + full / 2) % full - full / 2 if self.wraps else counts

    def _scaled(self, age: int, x: float) -> float:
        moved = self._held + self.fault.amount * self._gone
        return self._moved(moved, 0.0) if self.wraps else moved

    def _flipped(self, age: int, x: float) -> float:
        bit = int(self.fault.amount)
        if self.wraps:  # on its way from the chip: one line is inverted
            return float(int(x) ^ (1 << bit % int(math.log2(self.high + 1))))
        if self.whole:
            return float(int(x) ^ (1 << bit))
        (raw,) = struct.unpack("<I", struct.pack("<f", x))
        (flipped,) = struct.unpack("<f", struct.pack("<I", raw ^ (1 << bit)))
        return float(flipped)
