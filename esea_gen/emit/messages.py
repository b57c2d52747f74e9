"""The messages of a System's dialect, and who gives the System's inputs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

from esea_gen.emit.render import port_text
from esea_gen.emit.roles import board_roles
from esea_gen.emit.states import BOARD_FAULTS, TIMES_MS
from esea_gen.errors import UserError, from_extra
from esea_gen.language.ports import Code, Flag, Port
from esea_gen.language.system import External, System

FIRST_ID = 42600  # a stretch of the 24-bit range that none of the public dialects uses
MAX_PAYLOAD_BYTES = 255
MAX_FIELDS = 64
HEARTBEAT_EVERY = 1000

WANTED_ID = FIRST_ID + 60
STREAMS = 6  # that a board sends side by side
STREAM_SPAN_MS = 20  # longest that a sample waits for others to be packed with
ZERO_ROOM_RAD = 0.00873  # how far a joint that is zeroed may move: half a degree


def fault_codes(system: System) -> tuple[Code, ...]:
    """Every fault that a device with this System can tell, by number."""
    reasons = {c.value: c for b in system.kinds for p in b.outputs for c in p.codes if c.value}
    return tuple(sorted([*BOARD_FAULTS, *reasons.values()], key=lambda c: c.value))


_TYPE_BYTES = {"uint64_t": 8, "float": 4, "uint32_t": 4, "uint16_t": 2, "uint8_t": 1, "char": 1}


@dataclass(frozen=True)
class MessageField:
    c_type: str
    name: str
    description: str
    size: int = 1
    units: str = ""  # unit, where MAVLink's schema knows it; else empty
    enum: str = ""  # enum of its bits or numbers, or empty
    bitmask: bool = False

    @property
    def bytes(self) -> int:
        return self.size * _TYPE_BYTES[self.c_type]


@dataclass(frozen=True)
class Message:
    id: int
    name: str
    description: str
    fields: tuple[MessageField, ...]

    @property
    def payload_bytes(self) -> int:
        """Payload before trailing zeros are cut."""
        return sum(f.bytes for f in self.fields)


@dataclass(frozen=True)
class MessageStatus:
    enum: str
    meaning: str
    flags: tuple[Flag, ...]


@cache
def mavlink_units() -> frozenset[str]:
    package = from_extra("pymavlink", "link", "What a MAVLink message holds")
    schema = resources.files(package) / "generator" / "mavschema.xsd"
    root = ElementTree.fromstring(schema.read_bytes())
    ns = "{http://www.w3.org/2001/XMLSchema}"
    units = root.iterfind(f".//{ns}simpleType[@name='SI_Unit']//{ns}enumeration")
    return frozenset(str(e.get("value")) for e in units)


def _port_field(system: System, external: External) -> MessageField:
    port: Port = external.port
    if port.whole:
        enum = f"ESEA_{system.name}_{external.name}".upper() if port.flags else ""
        if port.choices is not None:
            enum = f"ESEA_{port.choices.__name__}".upper()
        text = port_text(port)
        return MessageField("uint32_t", external.name, text, enum=enum, bitmask=bool(port.flags))
    units = port.unit if port.unit in mavlink_units() else ""
    return MessageField("float", external.name, port_text(port), port.size, units)


_LINE = re.compile(
    r"(?P<type>\w+) (?P<name>\w+)(\[(?P<size>\d+)\])?( \((?P<unit>\w+)\))?( <(?P<enum>\w+)>)?: "
    r"(?P<text>.*)"
)
_TIME = (
    MessageField("uint32_t", "boot", "Number of this start of the board, never 0."),
    MessageField("uint32_t", "time_ms", "Device clock, at 0 again after 49.7 days.", units="ms"),
)


def _read() -> dict[str, Message]:
    text = Path(__file__).with_name("messages.txt").read_text(encoding="utf-8")
    whole = re.sub(r"\n {8,}", " ", re.sub(r"^#.*\n", "", text, flags=re.MULTILINE))
    found = {}
    for block in re.split(r"\n(?=\w)", whole.strip()):
        head, *lines = block.splitlines()
        name, number, meaning = re.split(r" |: ", head, maxsplit=2)
        fields = []
        for line in lines:
            parts = _LINE.fullmatch(line.strip())
            assert parts is not None, line
            c_type, field, said = parts["type"], parts["name"], parts["text"]
            size, unit, enum = int(parts["size"] or 1), parts["unit"] or "", parts["enum"] or ""
            fields.append(MessageField(c_type, field, said, size, unit, enum))
        found[name] = Message(FIRST_ID + int(number), name, meaning, tuple(fields))
    return found


FIXED = _read()


def _size(message: str, field: str) -> int:
    return next(f.size for f in FIXED[message].fields if f.name == field)


KEY_PART = _size("ESEA_KEY", "words")  # words of a key frame that a message holds
STREAM_WORDS = _size("ESEA_STREAM", "signals")  # values that a message of a stream holds


def task_messages(system: System) -> tuple[Message, ...]:
    found = []
    for i, task in enumerate(system.tasks):
        period = f"{task.every * system.base_period_s * 1000:.9g} ms"
        sequence = MessageField("uint32_t", "sequence", "Base tick of this run of the task.")
        ticks = MessageField(
            "uint32_t", "step_ticks", "Timer ticks of the step, measuring included (empty_ticks)."
        )
        sources = tuple(_port_field(system, x) for x in system.task_inputs(task))
        results = tuple(_port_field(system, x) for x in system.task_outputs(task))
        upper = task.name.upper()
        found += [
            Message(
                FIRST_ID + 1 + 2 * i,
                f"ESEA_{upper}_IN",
                f"Input of one run of task {task.name} (period {period}); the board steps when it "
                "comes in.",
                (sequence, *sources),
            ),
            Message(
                FIRST_ID + 2 + 2 * i,
                f"ESEA_{upper}_OUT",
                f"Output of one run of task {task.name}.",
                (sequence, *results, ticks),
            ),
        ]
    return tuple(found)


def messages(system: System) -> tuple[Message, ...]:
    info, *others = FIXED.values()
    found = [info, *task_messages(system), *others]
    roles = board_roles(system)
    if roles.drive:
        wanted = tuple(
            _port_field(system, x) for x in roles.wanted if x.name not in ("stop", "rearm")
        )
        least, most = TIMES_MS["DEADLINE_LEAST"][0], TIMES_MS["DEADLINE_MOST"][0]
        deadline = MessageField(
            "uint16_t",
            "deadline_ms",
            f"When the next one must have come, or the board lets go: {least} to {most}, what is "
            f"outside is held there; 0: {TIMES_MS['DEADLINE'][0]}.",
            units="ms",
        )
        meaning = "What the host wants, from the state ARMED on; anew before its deadline."
        fields = (*wanted, deadline, *_TIME)
        found.append(Message(WANTED_ID, "ESEA_WANTED", meaning, fields))
    for message in found:
        if message.payload_bytes > MAX_PAYLOAD_BYTES or len(message.fields) > MAX_FIELDS:
            raise UserError(
                f"Message {message.name} has {len(message.fields)} fields in "
                f"{message.payload_bytes} bytes; a MAVLink frame takes {MAX_FIELDS} in "
                f"{MAX_PAYLOAD_BYTES}.",
                "Split the task, or leave outputs out of the System.",
            )
    return tuple(found)


def choices(system: System) -> tuple[type[IntEnum], ...]:
    """Choices that messages carry, but faults, which have an enum of their own."""
    ports = [x.port for x in (*system.inputs, *system.outputs) if not x.port.codes]
    return tuple(dict.fromkeys(p.choices for p in ports if p.choices is not None))


def status_words(system: System) -> tuple[MessageStatus, ...]:
    return tuple(
        MessageStatus(f"ESEA_{system.name}_{x.name}".upper(), x.port.meaning, x.port.flags)
        for x in system.outputs
        if x.port.flags
    )
