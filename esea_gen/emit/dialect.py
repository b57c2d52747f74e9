"""The MAVLink dialect of a device: message definition, C headers and Python module.

The definition is rendered from the System's ports; mavgen, MAVLink's own generator, makes the C
headers and the Python module from it.  A binding header joins the messages to the device's C under
names that are the same for every device.  mavgen's ``version.h``, which carries a build date, and
its test suite are not taken; ``version.h`` is rendered here, whole and without a date.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import types
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import metadata, resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from esea_gen.device import Device
from esea_gen.emit.build import MANIFEST, Bundle, _manifest, build_command, device_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer, port_text
from esea_gen.emit.states import BOARD_FAULTS, STATES, TIMES_MS
from esea_gen.errors import UserError
from esea_gen.language.ports import Code, Flag, Port
from esea_gen.language.system import External, System

FOLDER = "dialect"
CORE_FOLDER = "mavlink"
FIRST_ID = 42600  # a stretch of the 24-bit range that none of the public dialects uses
MAX_PAYLOAD_BYTES = 255
MAX_FIELDS = 64
HEARTBEAT_EVERY = 1000

WANTED_ID, CLOCK_ID = FIRST_ID + 60, FIRST_ID + 61
ZERO_ROOM_RAD = 0.00873  # how far a joint that is zeroed may move: half a degree


@dataclass(frozen=True)
class ZeroedEncoder:
    """An encoder whose zero a calibration sets.

    theta, status: the outputs that tell of it.
    """

    instance: str
    block: str
    theta: str
    status: str


@dataclass(frozen=True)
class BoardRoles:
    """Who gives a System's inputs on the board's own clock, and what the board itself looks at.

    drive: whether there is a motor, with limits before it.
    measured: inputs that its drivers give; the others are wanted by the host.
    first: the task whose outputs the board looks at.
    """

    drive: bool
    measured: tuple[External, ...]
    wanted: tuple[External, ...]
    encoders: tuple[ZeroedEncoder, ...]
    first: str

    @property
    def wanted_names(self) -> tuple[str, ...]:
        """Names of what the host gives."""
        return tuple(x.name for x in self.wanted)


def board_roles(system: System) -> BoardRoles:
    """Roles of a System's inputs; with limits all but counts and frame words are wanted."""
    inputs = {x.name: x for t in system.tasks for x in system.task_inputs(t)}
    drive = "rearm" in inputs
    measured = [
        x for x in inputs.values() if not drive or x.name.startswith(("count_", "frame_error_"))
    ]
    outputs = {
        (x.signals[0].instance, x.signals[0].port): x.name
        for x in (system.outputs if drive else ())
    }
    return BoardRoles(
        drive,
        tuple(measured),
        tuple(x for x in inputs.values() if x not in measured),
        tuple(
            ZeroedEncoder(name, block.name, outputs[name, "theta_rad"], outputs[name, "status"])
            for name, block in (system.blocks.items() if drive else ())
            if {"zero_rad", "zeroed"} <= {t.name for t in block.tunables}
        ),
        system.tasks[0].name,
    )


def fault_codes(system: System) -> tuple[Code, ...]:
    """Every fault that a device with this System can tell, by number."""
    reasons = {c.value: c for b in system.kinds for p in b.outputs for c in p.codes if c.value}
    return tuple(sorted([*BOARD_FAULTS, *reasons.values()], key=lambda c: c.value))


@dataclass(frozen=True)
class MessageField:
    """A field of a message.

    size: elements; above 1 the field is an array.
    units: unit, where MAVLink's schema knows it; else empty.
    enum: enum of a status word's bits, or empty.
    """

    c_type: str
    name: str
    description: str
    size: int = 1
    units: str = ""
    enum: str = ""

    @property
    def bitmask(self) -> bool:
        """Whether the enum names bits."""
        return bool(self.enum) and self.enum not in ("ESEA_FAULT", "ESEA_STATE")

    @property
    def bytes(self) -> int:
        """Size on the wire."""
        return self.size * {"float": 4, "uint32_t": 4, "uint16_t": 2, "char": 1}[self.c_type]


@dataclass(frozen=True)
class Message:
    """A message of the dialect."""

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
    """Enum of a status word's bits.

    flags: its bits, least significant first.
    """

    enum: str
    meaning: str
    flags: tuple[Flag, ...]


@cache
def mavlink_units() -> frozenset[str]:
    """Units that MAVLink's own schema knows."""
    schema = resources.files("pymavlink") / "generator" / "mavschema.xsd"
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


def messages(system: System) -> tuple[Message, ...]:
    """The messages of a System beside the three standard ones."""
    found = [
        Message(
            FIRST_ID, "ESEA_INFO", "What runs on the board, and its counters; on request.", _INFO
        )
    ]
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
    found.append(Message(CLOCK_ID, "ESEA_CLOCK", "The board's own clock; on request.", _CLOCK))
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
        found.append(Message(WANTED_ID, "ESEA_WANTED", meaning, (*wanted, deadline)))
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
    """Enums of the status words among a System's outputs."""
    return tuple(
        MessageStatus(f"ESEA_{system.name}_{x.name}".upper(), x.port.meaning, x.port.flags)
        for x in system.outputs
        if x.port.flags
    )


@cache
def run_mavgen(name: str, xml: str) -> Mapping[str, str]:
    """Run MAVLink's generator on a definition.

    return: relative path to text: ``mavlink/...`` (C headers without ``version.h`` and test suite)
        and ``python/<name>.py``.
    """
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / f"{name}.xml").write_text(xml, encoding="utf-8")
        (folder / "python").mkdir()
        for language, output in (("C", "mavlink"), ("Python3", f"python/{name}.py")):
            # A process of its own: mavgen prints, exits on errors, and puts the path that it was
            # given into its output, which so is a bare file name.
            command = [sys.executable, "-m", "pymavlink.tools.mavgen", "--wire-protocol=2.0"]
            done = subprocess.run(
                [*command, f"--lang={language}", f"--output={output}", f"{name}.xml"],
                cwd=folder,
                env=os.environ | {"PYTHONUTF8": "1", "PYTHONDONTWRITEBYTECODE": "1"},
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode != 0:
                raise RuntimeError(f"mavgen refuses {name}.xml:\n{done.stdout}{done.stderr}")
        return {
            path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
            for path in sorted(folder.rglob("*"))
            if path.suffix in (".h", ".py") and path.name not in ("version.h", "testsuite.h")
        }


def dialect_files(renderer: Renderer) -> dict[str, str]:
    """Every file of a dialect folder but the manifest."""
    system, prefix = renderer.system, renderer.prefix
    own = messages(system)
    context: dict[str, Any] = {
        "messages": own,
        "status_words": status_words(system),
        "states": STATES,
        "roles": board_roles(system),
        "first_id": FIRST_ID,
        "zero_room": ZERO_ROOM_RAD,
        "faults": fault_codes(system),
        "heartbeat_every": HEARTBEAT_EVERY,
        "longest_period": max(t.every for t in system.tasks),
        # COMMAND_LONG is the longest of the standard messages.
        "largest_payload": max(33, *(m.payload_bytes for m in own)),
    }
    # An XML comment cannot hold two hyphens in a row.
    command = str(renderer.env.globals["command"]).replace("--", "- -")
    xml = renderer.render("dialect/esea_dialect.xml.j2", **context | {"command": command})
    return {
        f"{prefix}.xml": xml,
        f"{prefix}_link.h": renderer.render("dialect/esea_link.h.j2", **context),
        f"mavlink/{prefix}/version.h": renderer.render("dialect/version.h.j2", **context),
        **run_mavgen(prefix, xml),
    }


def render_dialect(device: Device) -> Bundle:
    """Render a device's MAVLink dialect in memory.

    return: folder ``dialect``: ``esea_<device>.xml``, the binding header ``esea_<device>_link.h``,
        mavgen's C headers below ``mavlink/`` and its Python module below ``python/``.
    """
    digest = device_hash(device)
    command = build_command(device)
    files = dialect_files(Renderer(device.system, FORMATS["f32"], digest, command, device.title))
    versions = {"pymavlink": metadata.version("pymavlink")}
    return Bundle(FOLDER, files | _manifest(device, digest, FOLDER, command, files, versions))


@cache
def core_bundle() -> Bundle:
    """MAVLink's core headers, which are the same for every device, as pymavlink has them.

    return: folder ``mavlink``, to stand once beside the folders of several devices.
    """
    source = resources.files("pymavlink") / "generator" / "C" / "include_v2.0"
    files = {
        path.name: path.read_text(encoding="utf-8")
        for path in sorted(source.iterdir(), key=lambda p: p.name)
        if path.name.endswith(".h")
    }
    content = {
        "kind": CORE_FOLDER,
        "versions": {"pymavlink": metadata.version("pymavlink")},
        "command": "esea-gen build DEVICE",
        "files": {n: hashlib.sha256(t.encode()).hexdigest() for n, t in files.items()},
    }
    return Bundle(CORE_FOLDER, files | {MANIFEST: json.dumps(content, indent=2) + "\n"})


def without_core(bundle: Bundle) -> Bundle:
    """A bundle as it stands beside :func:`core_bundle`; its manifest still lists all that it needs.

    bundle: any; only a dialect's holds core headers.
    """
    core = {f"mavlink/{name}" for name in core_bundle().files}
    return Bundle(bundle.folder, {n: t for n, t in bundle.files.items() if n not in core})


def load_module(name: str, text: str) -> Any:
    """Load a dialect's Python module from its text."""
    module = types.ModuleType(name)
    exec(compile(text, f"{name}.py", "exec"), module.__dict__)
    return module


@cache
def _load(device_name: str, text: str) -> Any:
    return load_module(device_name, text)


def load_dialect(device: Device) -> Any:
    """The Python module of a device's dialect."""
    name = f"esea_{device.name}"
    return _load(name, render_dialect(device).files[f"python/{name}.py"])
