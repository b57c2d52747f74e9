"""The messages of a System's dialect, and who gives the System's inputs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
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

WANTED_ID, CLOCK_ID = FIRST_ID + 60, FIRST_ID + 61
STREAM_ID, DATA_ID, TRAFFIC_ID = FIRST_ID + 62, FIRST_ID + 63, FIRST_ID + 64
KEY_ID, KEY_PART = FIRST_ID + 65, 58  # words of a key frame that a message holds
KEPT_ID, KEPT_ENCODERS = FIRST_ID + 66, 4
BLACKBOX_ID, BLACKBOX_BYTES = FIRST_ID + 67, 224
LIFE_ID, LIFE_CLASSES = FIRST_ID + 68, 48
STAMP_ID = FIRST_ID + 69
STREAM_WORDS = 59  # values that a message of a stream holds
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
    enum: str = ""  # enum of a status word's bits, or empty

    @property
    def bitmask(self) -> bool:
        return bool(self.enum) and self.enum not in (
            "ESEA_FAULT",
            "ESEA_STATE",
            "ESEA_ZERO",
            "MAV_RESULT",
        )

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
    for simple in root.iter(f"{ns}simpleType"):
        if simple.get("name") == "SI_Unit":
            return frozenset(str(e.get("value")) for e in simple.iter(f"{ns}enumeration"))
    return frozenset()


def _port_field(system: System, external: External) -> MessageField:
    port: Port = external.port
    if port.flags:
        enum = f"ESEA_{system.name}_{external.name}".upper()
        return MessageField("uint32_t", external.name, port_text(port), enum=enum)
    units = port.unit if port.unit in mavlink_units() else ""
    return MessageField("float", external.name, port_text(port), port.size, units)


_INFO = (
    MessageField("uint32_t", "tick_us", "Base tick of the tasks.", units="us"),
    MessageField("uint32_t", "fault", "Latched fault.", enum="ESEA_FAULT"),
    MessageField("uint32_t", "steps", "Steps since the last reset, all tasks."),
    MessageField(
        "uint32_t",
        "sequence_gaps",
        "Inputs since the last reset that did not follow their predecessor.",
    ),
    MessageField("uint32_t", "bad_frames", "Frames since boot whose checksum was wrong."),
    MessageField(
        "uint32_t", "unknown_messages", "Frames since boot whose message the board does not take."
    ),
    MessageField(
        "uint32_t",
        "lost_bytes",
        "Bytes since boot for which the receive buffer had no room.",
        units="bytes",
    ),
    MessageField(
        "uint32_t",
        "receive_buffer_bytes",
        "Size of the receive buffer: the host keeps fewer bytes on the way.",
        units="bytes",
    ),
    MessageField(
        "uint32_t",
        "empty_ticks",
        "Timer ticks of measuring a step that does nothing; to be taken off step_ticks.",
    ),
    MessageField("uint32_t", "stack_bytes", "Size of the stack.", units="bytes"),
    MessageField(
        "uint32_t", "stack_peak_bytes", "Most of the stack in use since boot.", units="bytes"
    ),
    MessageField("char", "content_hash", "Content hash of the C that runs here.", 16),
    MessageField("char", "device", "Device name.", 16),
    MessageField("char", "board", "Board name.", 16),
)


_CLOCK = (
    MessageField("uint32_t", "tick", "The next base tick."),
    MessageField("uint32_t", "lost_ticks", "Base ticks since boot that came too late or not."),
    MessageField(
        "uint32_t",
        "missed_runs",
        "Runs since boot that did not start: the one before had not ended.",
    ),
    MessageField("uint32_t", "late_runs", "Runs that had not ended at their release."),
    MessageField("uint32_t", "dropped", "Runs since boot that found no room until they are sent."),
    MessageField("uint32_t", "refused", "Commands and inputs since boot that the state refused."),
    MessageField("uint32_t", "deadline_left", "Base ticks until the command's deadline; 0: none."),
    MessageField("uint32_t", "state", "State of the board.", enum="ESEA_STATE"),
)


_STREAM = (
    MessageField("uint16_t", "interval", "Base ticks from one sample to the next; 0: no more."),
    MessageField("uint8_t", "stream", f"Number of the stream, below {STREAMS}."),
    MessageField("uint8_t", "task", "Number of the task whose runs are sampled."),
    MessageField("uint8_t", "choice", "Any number, to tell samples of this choice by."),
    MessageField("uint8_t", "count", "Values in a sample."),
    MessageField("uint8_t", "samples", "In the answer: samples that a message holds."),
    MessageField("uint8_t", "result", "In the answer: what became of it.", enum="MAV_RESULT"),
    MessageField(
        "uint8_t",
        "signals",
        "What is sampled, by number: the values of the task's IN message, element by element, then "
        "those of its OUT message, both without the sequence.",
        STREAM_WORDS,
    ),
)


_DATA = (
    MessageField(
        "uint64_t",
        "time",
        "Device clock at the first sample: base ticks since power-on, which no reset sets back.",
    ),
    MessageField("uint32_t", "sequence", "Base tick of the first sample's run."),
    MessageField("uint16_t", "interval", "Base ticks from one sample to the next."),
    MessageField("uint8_t", "stream", "Number of the stream."),
    MessageField("uint8_t", "choice", "Number that the stream was chosen with."),
    MessageField("uint8_t", "count", "Samples in this message."),
    # Bytes, for they go last on the wire, where MAVLink leaves out what is not used.
    MessageField(
        "uint8_t",
        "data",
        "Samples, one behind the other; the four bytes of each value.",
        4 * STREAM_WORDS,
    ),
)


_TRAFFIC = (
    MessageField("uint32_t", "stream_messages", "Messages of streams since power-on, filled."),
    MessageField(
        "uint32_t", "stream_dropped", "Messages of streams that found no room and were left out."
    ),
    MessageField("uint32_t", "paired", "1: only signed commands are taken, beside STOP."),
    MessageField("uint32_t", "unsigned_refused", "Frames without a signature that needed one."),
    MessageField("uint32_t", "bad_signatures", "Frames whose signature was wrong."),
    MessageField("uint32_t", "replayed", "Frames whose signature was good, but old or far ahead."),
    MessageField("uint32_t", "parameters_refused", "Parameters that were not set."),
    MessageField("uint32_t", "expired", "Commands that came too late, or without their time."),
)


_TIME = (
    MessageField("uint32_t", "boot", "Number of this start of the board, never 0."),
    MessageField("uint32_t", "time_ms", "Device clock, at 0 again after 49.7 days.", units="ms"),
)


_STAMP = (
    MessageField(
        "uint64_t", "signature", "Timestamp that a signature must be above. To the board: 0."
    ),
    *_TIME,
)


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


_KEY = (
    MessageField("uint32_t", "sequence", "Base tick at whose start it was taken."),
    MessageField("uint32_t", "first", "Number of the first word here."),
    MessageField("uint32_t", "total", "Words of the whole frame: params, then state, as in the C."),
    MessageField("uint32_t", "words", "As they lie in memory; 0 behind the last.", KEY_PART),
)


_KEPT = (
    MessageField(
        "uint32_t",
        "serial",
        "Serial numbers of the encoders that are fitted; 0: none.",
        KEPT_ENCODERS,
    ),
    MessageField("float", "zero_rad", "Their zeros as they are kept, NaN: none.", KEPT_ENCODERS),
    MessageField("uint32_t", "starts", "Power-ups."),
    MessageField("uint32_t", "armings", "Times that the motor was switched on."),
    MessageField("uint32_t", "faults", "Faults that were latched."),
    MessageField("uint32_t", "watchdog_resets", "Resets by the watchdog."),
    MessageField("uint32_t", "saves", "Sets written to the memory."),
    MessageField("uint32_t", "active_s", "Time with the motor on.", units="s"),
    MessageField("uint8_t", "encoders", "How many of these the device has."),
    MessageField("uint8_t", "zero", "Where the zero in force comes from.", enum="ESEA_ZERO"),
    MessageField("uint8_t", "result", "Of naming the encoders.", enum="MAV_RESULT"),
)


_BLACKBOX = (
    MessageField("uint32_t", "first", "Number of the first record here, the oldest is 0."),
    MessageField("uint32_t", "count", "Records that there are; 0: it is not frozen."),
    MessageField("uint32_t", "fault", "Why it was frozen.", enum="ESEA_FAULT"),
    MessageField("uint32_t", "tick", "Base tick at which it was frozen."),
    MessageField("uint8_t", "records", "Records here. To the board: 255 releases it."),
    MessageField("uint8_t", "size", "Bytes of a record."),
    MessageField("uint8_t", "whole", "Bit by record: whether its check holds."),
    MessageField("uint8_t", "data", "Records as they lie in memory.", BLACKBOX_BYTES),
)


_LIFE = (
    MessageField("uint32_t", "serial", "Serial number on the coupling; 0: nobody said."),
    MessageField("uint32_t", "seconds", "Time counted.", units="s"),
    MessageField("uint32_t", "full", "Times that there was no room for a turning point."),
    MessageField("float", "energy_J", "Energy that it has taken."),
    MessageField("float", "width_rad", "Width of a class of ranges.", units="rad"),
    MessageField(
        "uint32_t",
        "halves",
        "Half cycles by class of the deflection's range, as if its history ended now; ranges below "
        "one class are not counted.",
        LIFE_CLASSES,
    ),
    MessageField(
        "uint8_t",
        "number",
        "Of the record: the couplings that are fitted, then those that lie aside. To the board: "
        "the coupling whose serial number this is; 255: forgets one that lies aside.",
    ),
    MessageField("uint8_t", "couplings", "How many the device has."),
    MessageField("uint8_t", "records", "How many records there are."),
    MessageField("uint8_t", "result", "Of naming the coupling.", enum="MAV_RESULT"),
)


def messages(system: System) -> tuple[Message, ...]:
    found = [
        Message(
            FIRST_ID, "ESEA_INFO", "What runs on the board, and its counters; on request.", _INFO
        )
    ]
    found += task_messages(system)
    found.append(Message(CLOCK_ID, "ESEA_CLOCK", "The board's own clock; on request.", _CLOCK))
    chosen = "Chooses what a stream samples, and how often; the board answers with the same."
    found += [
        Message(STREAM_ID, "ESEA_STREAM", chosen, _STREAM),
        Message(DATA_ID, "ESEA_DATA", "Samples of a stream.", _DATA),
        Message(TRAFFIC_ID, "ESEA_TRAFFIC", "Counters of the link; on request.", _TRAFFIC),
        Message(
            KEY_ID, "ESEA_KEY", "Part of a key frame: all that the next ticks come from.", _KEY
        ),
        Message(
            KEPT_ID,
            "ESEA_KEPT",
            "What outlasts the power beside parameters; on request. To the board: the serial "
            "numbers of the encoders that are fitted; the board answers with the same.",
            _KEPT,
        ),
        Message(
            BLACKBOX_ID,
            "ESEA_BLACKBOX",
            "Records of the black box; to the board: asks for those from the first on.",
            _BLACKBOX,
        ),
        Message(
            LIFE_ID,
            "ESEA_LIFE",
            "What a coupling has borne; on request, by the number of the record. To the board: the "
            "serial number of a coupling.",
            _LIFE,
        ),
        Message(
            STAMP_ID,
            "ESEA_STAMP",
            "The board's time. To the board: all 0 asks for it; else the last known time of the "
            "same sender's next frame, a command that expires.",
            _STAMP,
        ),
    ]
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


def status_words(system: System) -> tuple[MessageStatus, ...]:
    return tuple(
        MessageStatus(f"ESEA_{system.name}_{x.name}".upper(), x.port.meaning, x.port.flags)
        for x in system.outputs
        if x.port.flags
    )
