"""Pages to open: ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import esea_gen
from esea_gen.cli.app import app, out
from esea_gen.cli.options import BoardOption, ControllerOption, DeviceArgument, JsonOption, writable
from esea_gen.cli.output import progress_line
from esea_gen.files import write_json, write_whole
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
    loaded = esea_gen.load_device(device, controller)
    target = page or writable(Path(f"{loaded.name}.html"))
    assert target is not None
    from esea_gen.report.builder import gather

    with progress_line() as say:
        found = gather(loaded, recording, data, board, progress=say)
    for line in found.summary():
        out.print(line)
    write_whole(target, found.html())
    out.print(f"report: {target}")
    write_json(json_file, "report", found.to_dict())
    if not found.passed:
        raise typer.Exit(1)
