"""Streams: values of a task's runs, by name and rate, and the samples in their messages."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

_SIDES = ("IN", "OUT")


@dataclass(frozen=True)
class StreamSignal:
    name: str  # tau_Nm, of an array pair_rad[0]
    task: str  # whose runs have it
    number: int  # its number in ESEA_STREAM
    whole: bool  # whether it is a whole number (a status word) rather than a float
    unit: str  # as the dialect has it; empty where MAVLink knows none

    @property
    def full_name(self) -> str:
        return f"{self.task}.{self.name}"

    @property
    def array(self) -> str:
        return self.name.partition("[")[0]


@dataclass(frozen=True)
class StreamSamples:
    names: tuple[str, ...]  # full names of the values
    times: tuple[int, ...]  # device clock of each sample, base ticks since power-on
    sequences: tuple[int, ...]  # base tick of each sample's run, which a reset sets back
    values: tuple[tuple[float, ...], ...]  # a tuple each sample


@dataclass(frozen=True)
class BoardStream:
    number: int  # with choice: by which its messages are known
    choice: int
    task: str
    signals: tuple[StreamSignal, ...]
    interval: int  # base ticks from one sample to the next, as the board rounded it
    samples: int  # in a full message
    rate_Hz: float  # samples a second

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(s.full_name for s in self.signals)

    def decode(self, message: Any) -> StreamSamples:
        width = len(self.signals)
        layout = "<" + "".join("I" if s.whole else "f" for s in self.signals)
        data = bytes(message.data[: 4 * width * message.count])
        steps = [k * message.interval for k in range(message.count)]
        return StreamSamples(
            self.names,
            tuple(message.time + k for k in steps),
            tuple((message.sequence + k) % (1 << 32) for k in steps),
            tuple(struct.iter_unpack(layout, data)),
        )


def tasks(dialect: Any) -> list[str]:
    first = dialect.MAVLINK_MSG_ID_ESEA_INFO + 1
    found: list[str] = []
    while (cls := dialect.mavlink_map.get(first + 2 * len(found))) is not None:
        found.append(cls.msgname.removeprefix("ESEA_").removesuffix("_IN").lower())
    return found


def signals(dialect: Any) -> list[StreamSignal]:
    """Everything that can be sampled, task by task."""
    classes = {c.msgname: c for c in dialect.mavlink_map.values()}
    found: list[StreamSignal] = []
    for task in tasks(dialect):
        number = 0
        for side in _SIDES:
            for name, size, whole, unit in _fields(classes[f"ESEA_{task.upper()}_{side}"]):
                elements = [f"{name}[{i}]" for i in range(size)] if size else [name]
                for element in elements:
                    found.append(StreamSignal(element, task, number, whole, unit))
                    number += 1
    return found


def _fields(cls: Any) -> Iterator[tuple[str, int, bool, str]]:
    # Name, elements (0: no array), whether whole, unit; in the order of the definition.
    sizes = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
        if name != "sequence":
            unit = str(cls.fieldunits_by_name.get(name, ""))
            yield name, sizes[name], kind != "float", unit


def choose(known: Sequence[StreamSignal], names: Iterable[str]) -> dict[str, list[StreamSignal]]:
    """Signals of each task: ``tau_Nm`` where one task has it, ``sense.tau_Nm``, ``sense.*``."""
    found: dict[str, list[StreamSignal]] = {}
    for name in names:
        fits = [s for s in known if name in (s.full_name, f"{s.task}.{s.array}", f"{s.task}.*")]
        fits = fits or [s for s in known if name in (s.name, s.array)]
        owners = {s.task for s in fits}
        if not fits:
            raise ValueError(f"{name} cannot be streamed; there is {_names(known)}")
        if len(owners) > 1:
            which = " or ".join(f"{t}.{name}" for t in sorted(owners))
            raise ValueError(f"{name} is in several tasks: say {which}")
        chosen = found.setdefault(owners.pop(), [])
        chosen += [s for s in fits if s not in chosen]
    return found


def _names(known: Sequence[StreamSignal]) -> str:
    return ", ".join(dict.fromkeys(f"{s.task}.{s.array}" for s in known))
