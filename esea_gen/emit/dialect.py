"""The MAVLink dialect of a device: message definition, C headers and Python module.

The definition is rendered from the System's ports; mavgen, MAVLink's own generator, makes the C
headers and the Python module from it.  A C file with its header joins the messages to the device's
C under names that are the same for every device.  mavgen's ``version.h``, which carries a build
date, and its test suite are not taken; ``version.h`` is rendered here, whole and without a date.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.build import Bundle, build_command, device_hash, manifest
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.messages import (
    FIRST_ID,
    HEARTBEAT_EVERY,
    KEY_PART,
    STREAM_SPAN_MS,
    STREAM_WORDS,
    STREAMS,
    ZERO_ROOM_RAD,
    choices,
    fault_codes,
    messages,
    status_words,
)
from esea_gen.emit.parameters import link_parameters, parameter_metadata
from esea_gen.emit.render import Renderer
from esea_gen.emit.roles import board_roles
from esea_gen.emit.states import STATES
from esea_gen.errors import from_extra

FOLDER = "dialect"


def mavlink() -> ModuleType:
    return from_extra("pymavlink", "link", "A MAVLink dialect")


@cache
def run_mavgen(name: str, xml: str) -> Mapping[str, str]:
    mavlink()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / f"{name}.xml").write_text(xml, encoding="utf-8", newline="\n")
        (folder / "python").mkdir()
        # Processes of their own: mavgen prints, exits on errors, and puts the path that it was
        # given into its output, which so is a bare file name.
        command = [sys.executable, "-m", "pymavlink.tools.mavgen", "--wire-protocol=2.0"]
        running = [
            subprocess.Popen(
                [*command, f"--lang={language}", f"--output={output}", f"{name}.xml"],
                cwd=folder,
                env=os.environ | {"PYTHONUTF8": "1", "PYTHONDONTWRITEBYTECODE": "1"},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                encoding="utf-8",
                errors="replace",
            )
            for language, output in (("C", "mavlink"), ("Python3", f"python/{name}.py"))
        ]
        for done, (said, _) in [(process, process.communicate()) for process in running]:
            if done.returncode != 0:
                raise RuntimeError(f"mavgen refuses {name}.xml:\n{said}")
        return {
            path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
            for path in sorted(folder.rglob("*"))
            if path.suffix in (".h", ".py") and path.name not in ("version.h", "testsuite.h")
        }


def dialect_files(renderer: Renderer) -> dict[str, str]:
    system, prefix = renderer.system, renderer.prefix
    own = messages(system)
    context: dict[str, Any] = {
        "messages": own,
        "choices": choices(system),
        "status_words": status_words(system),
        "states": STATES,
        "roles": board_roles(system),
        "places": {t.name: k for k, t in enumerate(system.tasks)},
        "first_id": FIRST_ID,
        "zero_room": ZERO_ROOM_RAD,
        "faults": fault_codes(system),
        "heartbeat_every": HEARTBEAT_EVERY,
        "longest_period": max(t.every for t in system.tasks),
        "parameters": link_parameters(system),
        "key_part": KEY_PART,
        "streams": (STREAMS, STREAM_WORDS, STREAM_SPAN_MS),
        "largest_payload": max(m.payload_bytes for m in own),  # longer than any standard one
    }
    # An XML comment cannot hold two hyphens in a row.
    command = str(renderer.env.globals["command"]).replace("--", "- -")
    xml = renderer.render("dialect/esea_dialect.xml.j2", **context | {"command": command})
    return {
        f"{prefix}.xml": xml,
        f"{prefix}_parameters.json": parameter_metadata(system),
        **{
            f"{prefix}_link.{x}": renderer.render(f"dialect/esea_link.{x}.j2", **context)
            for x in "ch"
        },
        f"mavlink/{prefix}/version.h": renderer.render("dialect/version.h.j2", **context),
        **run_mavgen(prefix, xml),
    }


def render_dialect(device: Device) -> Bundle:
    digest = device_hash(device)
    command = build_command(device)
    files = dialect_files(Renderer(device.system, FORMATS["f32"], digest, command, device.title))
    versions = {"pymavlink": metadata.version("pymavlink")}
    return Bundle(FOLDER, files | manifest(device, digest, FOLDER, command, files, versions))


@cache
def load_module(name: str, text: str) -> Any:
    module = ModuleType(name)
    exec(compile(text, f"{name}.py", "exec"), module.__dict__)
    return module


@cache
def load_dialect(device: Device) -> Any:
    name = f"esea_{device.name}"
    return load_module(name, render_dialect(device).files[f"python/{name}.py"])
