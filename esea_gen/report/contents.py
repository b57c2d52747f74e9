"""What every page of a device shows of it: numbers, equations, Blocks, code, firmware."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from esea_gen.device import Device
from esea_gen.devices.fields import field_facts
from esea_gen.emit.build import Bundle
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import block_kernels
from esea_gen.errors import UserError
from esea_gen.language.ports import unit_of
from esea_gen.targets import firmware_boards
from esea_gen.verify.emulator import EmulatorResult
from esea_gen.verify.firmware import FirmwareImage, build_firmware
from esea_gen.verify.verdict import Verification

REALS = ("f64", "f32")
REAL_NAMES = {"f64": "float64", "f32": "float32"}
OPERATION_GROUPS = (
    ("add, sub", ("add", "sub")),
    ("mul", ("mul", "sq", "twice")),
    ("div", ("div", "inv")),
    ("power", ("pow",)),
    ("exp, log, sqrt, tanh", ("exp", "log", "tanh", "sqrt")),
    ("min, max", ("fmin", "fmax")),
    ("compare", ("lt", "le", "eq", "ne")),
    ("select", ("select", "if_else_zero")),
    ("and, or, not", ("and", "or", "not")),
    ("neg, abs, sign", ("neg", "fabs", "sign")),
)


@dataclass(frozen=True)
class BoardRun:
    """What became of the firmware.

    skipped: why it did not run: a tool is missing.
    failed: why it did not run: something is wrong.
    """

    name: str
    title: str
    image: FirmwareImage | None = None
    results: Mapping[str, EmulatorResult] | None = None
    skipped: str = ""
    failed: str = ""

    @property
    def passed(self) -> bool:
        """False when it failed or any bit differs; a board that was skipped is not judged."""
        return not self.failed and all(
            r.identical and r.hash_matches for r in (self.results or {}).values()
        )


def on_board(
    device: Device,
    board: str,
    say: Callable[[str], None],
    emulate: Callable[[FirmwareImage, dict[str, EmulatorResult]], None],
) -> BoardRun:
    """Build firmware and run it, whatever comes of it.

    emulate: given the image; puts each result into the dictionary as it has it.
    return: skipped when a tool is missing, failed when the firmware does not build or answer.
    """
    known = firmware_boards()
    title = known[board].title if board in known else ""
    image = None
    results: dict[str, EmulatorResult] = {}
    try:
        with tempfile.TemporaryDirectory(prefix="esea-report-") as scratch:
            say(f"building firmware for {board}")
            image = build_firmware(device, board, Path(scratch))
            emulate(image, results)
    except UserError as error:
        if board not in known or os.environ.get("ESEA_REQUIRE_TOOLS") == "1":
            raise
        return BoardRun(board, title, image, results, skipped=str(error))
    except RuntimeError as error:
        # A board that does not build or answer is a finding: the page says so and fails.
        return BoardRun(board, title, image, results, failed=str(error))
    return BoardRun(board, title, image, results)


def verification_problems(verification: Verification) -> list[str]:
    """Every comparison that failed, one line each."""
    found = []
    for c in verification.comparisons:
        where = f"{c.block}, {REAL_NAMES[c.real]}, {c.stream}"
        found += [f"{where}: {p}" for p in c.problems]
        if c.status_differences:
            found.append(f"{where}: status differs in {c.status_differences} steps")
        if c.bit_identical is False:
            found.append(f"{where}: bits differ from CasADi's own C")
    return found


def board_problems(board: BoardRun) -> list[str]:
    """What went wrong on the board, one line each."""
    found = [f"board {board.name}: {board.failed}"] if board.failed else []
    for label, r in (board.results or {}).items():
        if r.first_difference is not None:
            d = r.first_difference
            found.append(
                f"board {r.board}, {label}: {d.output} at step {d.step} is {d.board}, on the "
                f"host {d.host}"
            )
        if not r.hash_matches:
            found.append(
                f"board {r.board}, {label}: runs content {r.content_hash}, expected "
                f"{r.expected_hash}"
            )
    return found


def quantities(device: Device) -> list[dict[str, Any]]:
    """Every number of the device file with its unit, status and source."""
    return [
        {
            "key": key,
            "value": q.value,
            "unit": unit_of(key),
            "status": q.status,
            "source": q.source,
            "meaning": field_facts(key)["text"],
            "section": key.rsplit(".", 1)[0],
        }
        for key, q in device.quantities()
    ]


def by_section(parameters: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Numbers by the section of the device file."""
    out: dict[str, list[dict[str, Any]]] = {}
    for p in parameters:
        out.setdefault(p["section"], []).append(p)
    return out


def block_tables(device: Device) -> list[dict[str, Any]]:
    """Blocks with their equations, ports and tunables, for the template."""
    return [
        {
            "name": b.name,
            "title": b.title,
            "period_s": b.period_s,
            "equations": b.equations,
            "ports": [
                (kind, p)
                for kind, ports in (("in", b.inputs), ("out", b.outputs), ("state", b.state))
                for p in ports
            ],
            "tunables": b.tunables,
        }
        for b in device.system.kinds
    ]


def generated_code(device: Device, bundles: Sequence[Bundle]) -> dict[str, Any]:
    """Generated files with their sizes, and operations of every kernel."""
    folders = []
    for bundle in bundles:
        files: list[dict[str, Any]] = [
            {"name": n, "bytes": len(t.encode()), "lines": t.count("\n")}
            for n, t in sorted(bundle.files.items())
        ]
        folders.append(
            {
                "folder": bundle.folder,
                "files": files,
                "bytes": sum(f["bytes"] for f in files),
                "lines": sum(f["lines"] for f in files),
            }
        )
    kernels = []
    for block in device.system.kinds:
        for verb, kernel in block_kernels(block).items():
            if verb == "init":
                continue
            for real in REALS:
                cost = dict(FORMATS[real].passes(kernel).cost())
                kernels.append(
                    {
                        "block": block.name,
                        "kernel": verb,
                        "format": real,
                        "operations": dict(sorted(cost.items())),
                        "total": sum(cost.values()),
                    }
                )
    kernels.sort(key=lambda k: (k["block"], k["kernel"] != "step", k["format"] != "f64"))
    return {"folders": folders, "kernels": kernels}
