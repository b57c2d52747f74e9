"""Pages to open: ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.app import app, out
from esea_gen.cli.options import BoardOption, ControllerOption, DeviceArgument, JsonOption, writable
from esea_gen.cli.output import progress_line, write_json, write_text
from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.targets import DEFAULT_BOARD


@app.command()
def report(
    device: DeviceArgument,
    recording: Annotated[
        Path | None, typer.Option("--recording", metavar="MAPPING", help="Recording to run.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    board: BoardOption = DEFAULT_BOARD,
    page: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", callback=writable, help="Output file; default: <device>.html."
        ),
    ] = None,
    controller: ControllerOption = None,
    json_file: JsonOption = None,
) -> None:
    """Build, verify, emulate, measure: everything known of a device on one HTML page."""
    from esea_gen.report.device import gather
    from esea_gen.report.drive import gather_drive

    loaded = load_device(device, controller)
    has_drive = bool(loaded.laws)
    if has_drive and (recording is not None or data is not None):
        raise UserError(
            f"{loaded.name} has a drive: its page is of closed-loop runs and takes no recording.",
            "Leave --recording and --data out, or report on the device that it extends.",
        )
    with progress_line() as say:
        findings = (
            gather_drive(loaded, board, progress=say)
            if has_drive
            else gather(loaded, recording, data, board, progress=say)
        )
    target = page or Path(f"{loaded.name}.html")
    for line in findings.summary():
        out.print(line)
    write_text(target, findings.html())
    out.print(f"report: {target}")
    write_json(json_file, findings.to_dict())
    if not findings.passed:
        raise typer.Exit(1)
