"""Identity of the connected board, and whether its C matches this version."""

from __future__ import annotations

import importlib.metadata
import io
import json
import platform
import sys
import zipfile
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from esea_gen.device import Device, board_device
from esea_gen.devices.file import read_file, shipped_devices
from esea_gen.emit.build import format_hash, render_device
from esea_gen.emit.dialect import load_dialect, render_dialect
from esea_gen.errors import UserError
from esea_gen.link.messenger import CommandedError
from esea_gen.link.session import Session
from esea_gen.link.signing import key_folder, stored_keys
from esea_gen.link.transport import LinkError, Transport
from esea_gen.portability import processors
from esea_gen.targets import BOARDS
from esea_host.connection.address import driven_by
from esea_host.recording.replay import loaded_device

ANYBODY = "elbow_drive"  # its dialect has the messages that all devices share
SIMULATED_BOARDS = ("sim", "sim-q31")
EMULATED_BOARDS = ("linux-sim",)  # the firmware's own process, with an emulated drive
PROBE_S = 3.0
GET_MESSAGE_INTERVAL = 510  # MAVLink's number; not in our dialect
PACKAGES = ("esea-gen", "numpy", "casadi", "pymavlink", "mcap")


@dataclass(frozen=True)
class Identity:
    device: Device
    real: str  # number format of its C
    content_hash: str
    board: str  # its name; simulated boards say so
    tick_us: int
    key: Path | None = None  # file of the key that it takes commands by, where it is paired
    start: int = 0  # number of its start, when it was asked

    @property
    def simulated(self) -> bool:
        return self.board in (*SIMULATED_BOARDS, *EMULATED_BOARDS)

    @property
    def controller(self) -> str:
        """Names of controllers that are not the device file's own."""
        return ",".join(Path(n).name for n in self.device.controller.split(","))

    @property
    def who(self) -> str:
        return f"{driven_by(self.controller, self.device.name)} on {self.board}"

    def facts(self) -> dict[str, Any]:
        """Facts for the record: C, board, host."""
        return {
            "device": self.device.name,
            "controller": self.controller,
            "content_hash": self.content_hash,
            "real": self.real,
            "board": self.board,
            "simulated": self.simulated,
            "tick_us": self.tick_us,
            "versions": {p: _version(p) for p in PACKAGES},
            "computer": {
                "system": platform.system(),
                "release": platform.release(),
                "machine": platform.machine(),
                "processors": processors(),
                "python": sys.version.split()[0],
            },
        }

    def attachments(self) -> dict[str, bytes]:
        """Attachments that a recording needs to be read and recomputed on its own."""
        device = self.device
        text, _ = read_file(device.name if device.shipped else device.given[0])
        text = device.toml() if device.controller else text  # with what the controller gives
        dialect, sources = _rendered(device, self.real)
        return {
            "facts.json": json.dumps(self.facts(), indent=1).encode(),
            "device.toml": text.encode(),
            **{f"law:{n}": content for n, content in device.own_laws().items()},
            "dialect.xml": dialect,
            "sources.zip": sources,
        }


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


@lru_cache(maxsize=4)
def _rendered(device: Device, real: str) -> tuple[bytes, bytes]:
    # The same for every recording of a session.
    dialect = render_dialect(device).files
    name = next(n for n in dialect if n.endswith(".xml"))
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, text in sorted(render_device(device, [real])[0].files.items()):
            # Same bytes every time: no clock in it.
            archive.writestr(zipfile.ZipInfo(file, (2000, 1, 1, 0, 0, 0)), text)
    return dialect[name].encode(), made.getvalue()


def identify(
    transport: Transport, expected: str | Device | None = None, key: Path | None = None
) -> Identity:
    given = expected if isinstance(expected, Device) else None
    device = given or loaded_device(str(expected or ANYBODY))
    session = Session(transport, load_dialect(device), PROBE_S)
    session.stays = False
    try:
        key = _key_taken(session, key)
        info, start = session.info(), session.learn_time().boot
    except (PairedError, CommandedError):
        raise
    except LinkError as error:
        told = ", though it" if session.counters.frames else ": nothing at the other end"
        what = f"{error.what}{told} speaks this tree's dialect"
        fix = error.fix or "Check the address, and that its board has this version's firmware."
        raise LinkError(what, fix, error.said) from None
    name = _text(info.device)
    if name == f"{device.name}_board":
        device = board_device(device)
    if expected is not None and device.name != name:
        raise UserError(
            f"The board runs the device {name}, not {device.name}.",
            f"Connect to it as {name}, or flash the other: {_build(device)}",
        )
    if expected is None:
        if name not in shipped_devices():
            raise UserError(
                f"The board runs the device '{name}', which does not come with this version.",
                "Give its device file: --device FILE.toml",
            )
        device = loaded_device(name)
    board = _text(info.board), int(info.tick_us)
    return replace(check_hash(device, _text(info.content_hash), *board), key=key, start=start)


class PairedError(LinkError):
    """The board is paired, and its key is not at hand."""


def _key_taken(session: Session, key: Path | None) -> Path | None:
    """The key file that the board takes commands by; None where it takes them from anybody."""
    if key is None and _obeys(session):
        return None
    unread = []
    for path in stored_keys() if key is None else [key]:
        try:
            session.use_key(path)
        except LinkError as error:
            unread.append(PairedError(error.what, error.fix))
            continue
        if _obeys(session):
            return path
    if key is None:
        raise PairedError(
            "The board is paired: it takes only commands that are signed with its key, and "
            f"{key_folder()} holds no key that it takes",
            "Give the file with its key: --key FILE. On the computer where it was paired esea-host "
            "finds the key." + "".join(f" Not tried: {x.what}. {x.fix}" for x in unread),
        )
    if unread:
        raise unread[0]
    raise PairedError(
        f"The board is paired, and does not take the key in {key}",
        "Give the file that esea-host pair wrote for this board.",
    )


def _obeys(session: Session) -> bool:
    # Boards do not know this question: they deny it to whom they do not obey.  What comes too late
    # they deny as well, once they have taken the key.
    result = session.command(GET_MESSAGE_INTERVAL)
    return session.was_late or result != int(session.dialect.MAV_RESULT_DENIED)


def passive(device: str | None) -> Identity:
    """Identity for bytes from a file, which cannot be asked: the caller names the device."""
    if device is None:
        raise UserError("A file of bytes does not name its device.", "Add --device elbow_drive.")
    loaded = board_device(loaded_device(device))
    tick_us = round(loaded.system.base_period_s * 1e6)
    return Identity(loaded, "f32", "unknown", "file", tick_us)


def check_hash(device: Device, told: str, board: str, tick_us: int) -> Identity:
    """Reject a board whose C differs from the C generated for its device."""
    real = BOARDS[board].real if board in BOARDS else "f32"
    ours = format_hash(device, real)
    if told == ours:
        return Identity(device, real, told, board, tick_us)
    raise UserError(
        f"The board '{board}' runs different C of {device.name}: content hash {told}, and this "
        f"tree's device file gives {ours}. Units, bounds and limits may differ.",
        f"Flash this tree's firmware: {_build(device, board)}; or use the version that built "
        "the board's.",
    )


def _build(device: Device, board: str = "BOARD") -> str:
    name = device.name if device.shipped else device.given[0]
    return f"esea-gen firmware {name} --board {board}"


def _text(field: Any) -> str:
    text = field.decode("ascii", "replace") if isinstance(field, bytes) else str(field)
    return text.rstrip("\0")


def column_texts(device: Device) -> tuple[dict[str, dict[str, str]], dict[str, dict[str, str]]]:
    """Units and meanings of all that a device's tasks take and give, by message and field."""
    units: dict[str, dict[str, str]] = {}
    texts: dict[str, dict[str, str]] = {}
    system = device.system
    for task in system.tasks:
        sides = {"IN": system.task_inputs(task), "OUT": system.task_outputs(task)}
        for side, ports in sides.items():
            name = f"ESEA_{task.name}_{side}".upper()
            units[name] = {x.name: x.port.unit for x in ports if not x.port.flags}
            texts[name] = {x.name: x.port.meaning for x in ports}
    return units, texts
