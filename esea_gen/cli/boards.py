"""Firmware and emulated boards: ``firmware``, ``emulate``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import esea_gen
from esea_gen.cli import options
from esea_gen.cli.app import app, out
from esea_gen.cli.options import option, recorded_streams
from esea_gen.cli.output import exit_unless, progress_bar
from esea_gen.errors import UserError, from_extra
from esea_gen.files import write_json
from esea_gen.targets import BOARDS, DEFAULT_BOARD

if TYPE_CHECKING:
    from esea_gen.device import Device


@app.command()
def firmware(
    device: options.DeviceArgument,
    board: options.BoardOption = DEFAULT_BOARD,
    folder: Annotated[
        Path | None, option("--out DIR", "Output folder; default: build/<device>.")
    ] = None,
    cycles: Annotated[
        float | None,
        option("--cycles", "For a drive: cycles per instruction; default: 1.5 (assumed).", min=0.1),
    ] = None,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Compile firmware for a board and print its size.

    Every task of a drive must end before its values are released, by the bound of its instructions,
    the clock, and the cycles per instruction.
    """
    from esea_gen.board.firmware import build_firmware

    from_extra("pymavlink", "link", "esea-gen firmware")
    loaded = esea_gen.load_device(device, controller)
    fits, times, needs_Hz = _fits(loaded, board, cycles)
    image = build_firmware(loaded, board, folder or Path("build") / loaded.name, needs_Hz=needs_Hz)
    measured = f"flash {image.flash_bytes} B, RAM {image.ram_bytes} B"  # not of zig's
    out.print(f"{image.elf}: {measured if image.flash_bytes else image.compiler}")
    out.lines(fits)
    if BOARDS[board].package:
        from esea_gen.export.package import build_package

        for path in build_package(loaded, image, image.elf.parent):
            out.print(f"{path}: {path.stat().st_size} B")
    write_json(json_file, "firmware", image.to_dict() | times)


def _fits(
    loaded: Device, name: str, cycles: float | None
) -> tuple[list[str], dict[str, Any], float | None]:
    # What a drive's tasks take on a board with a known clock, too long being an error, as lines and
    # for JSON; and the slowest clock that they fit at.
    board = BOARDS.get(name)
    if not loaded.laws or board is None or not (board.clock_Hz or cycles):
        return [], {}, None
    if board.real != "f32":
        return [f"time is not checked: code in {board.real} has no bound"], {}, None
    from esea_gen.board.release import lighter_law, task_times

    times = task_times(loaded, board, cycles)
    times.check(lambda: lighter_law(loaded, board, cycles))
    lines = [
        f"{task}: at most {count} instructions; ended {1e3 * times.ended_s[task]:.3f} ms after its "
        f"start at {times.cycles:g} cycles per instruction and {board.clock_Hz / 1e6:g} MHz, "
        f"released after {1e3 * times.release_s[task]:g} ms"
        for task, count in times.instructions.items()
    ]
    if board.reset_Hz:
        slow = "fits" if times.least_Hz <= board.reset_Hz else "is refused"
        lines.append(
            f"it needs {times.least_MHz:g} MHz: if the board stays at "
            f"{board.reset_Hz / 1e6:g} MHz it {slow}"
        )
    found: dict[str, Any] = {"instructions": times.instructions, "needs_MHz": times.least_MHz}
    for key in ("ended", "release"):
        found[f"{key}_ms"] = {k: 1e3 * s for k, s in getattr(times, f"{key}_s").items()}
    return lines, found, times.least_Hz


@app.command()
def emulate(
    device: options.DeviceArgument,
    recording: options.RecordingOption = None,
    data: options.DataOption = None,
    board: options.BoardOption = DEFAULT_BOARD,
    seconds: Annotated[
        float | None, option("--seconds", "For a drive: seconds of the tuning case; default: 3.")
    ] = None,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Run the firmware in an emulator and compare every bit with the host library.

    A sensing device gets a stream of deflections.  A drive runs all its tasks, interleaved, with
    their inputs of the tuning case in closed loop with the virtual exoskeleton.
    """
    from esea_gen.report.findings import emulated

    from_extra("pymavlink", "link", "esea-gen emulate")
    loaded = esea_gen.load_device(device, controller)
    deflections: dict[str, Any] = {}
    if loaded.laws and (recording is not None or data is not None):
        raise UserError(
            f"{loaded.origin}: a drive does not run on a recorded deflection.",
            "Leave --recording and --data out: its inputs are recorded from the simulation.",
        )
    if not loaded.laws:
        if seconds is not None:
            raise UserError(f"{loaded.origin}: --seconds is for a drive.", "Leave --seconds out.")
        from esea_gen.verify.streams import domain_chirp

        deflections = recorded_streams(loaded, recording, data) or {
            "chirp in the domain": domain_chirp(loaded)
        }
    lasting_s = 3.0 if seconds is None else seconds
    if lasting_s < loaded.period_s:
        raise UserError(
            f"--seconds {lasting_s:g} is less than a period.",
            "Give a number of seconds, such as 3.",
        )
    with progress_bar() as p:

        def told(what: str) -> Callable[[int, int], None]:
            bar = p.add_task(what, total=None)
            return lambda done, total: p.update(bar, completed=done, total=total)

        ticks = round(lasting_s / loaded.period_s)
        _, results = emulated(loaded, board, deflections, ticks, told)
    content = {name: r.to_dict() for name, r in results.items()}
    if loaded.laws:
        _show_tasks(results)
        found = {"device": loaded.name, "case": "tuning", "tasks": content}
        write_json(json_file, "emulate-drive", found)
    else:
        for name, r in content.items():
            same = "same bits as the host's"
            same = same if r["identical"] else f"DIFFERS {r['first_difference']}"
            n = r["instructions"] or dict.fromkeys(("min", "median", "max"), "not counted")
            out.print(
                f"{name}: {r['steps']} steps, {same}; instructions per step "
                f"{n['min']}/{n['median']}/{n['max']} (min/median/max, emulated)"
            )
        write_json(json_file, "emulate", {"device": loaded.name, "streams": content})
    exit_unless(all(r.identical for r in results.values()))
    more = ["--controller", controller] if controller else []
    more += ["--board", board] if board != DEFAULT_BOARD else []
    out.next("report", device, *more)


def _show_tasks(results: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table("task", "runs", "bits", "instructions per run", "stack, B")
    for name, r in results.items():
        same = "the host's" if r.identical else "DIFFER"
        n = r.instructions
        count = f"{n['min']} / {n['median']} / {n['max']}" if n else "-"
        table.add_row(name, str(r.steps), same, count, str(r.step_stack_bytes))
    out.print(table)
    first = next(iter(results.values()))
    if first.instructions:
        out.print(
            "instructions: min / median / max, emulated, not cycles; "
            f"flash {first.flash_bytes} B, RAM {first.ram_bytes} B, deepest stack "
            f"{first.stack_peak_bytes} of {first.stack_bytes} B"
        )
    for r in results.values():
        if r.first_difference is not None:
            out.print(f"{r.task}: {r.first_difference}")
