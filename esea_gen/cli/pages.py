"""Pages to open: ``report``, ``specimen``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

import esea_gen
from esea_gen.cli import options
from esea_gen.cli.app import app, out
from esea_gen.cli.options import output_file, writable
from esea_gen.cli.output import exit_unless, progress_line, progress_share
from esea_gen.errors import from_extra
from esea_gen.files import write_json, write_whole
from esea_gen.targets import DEFAULT_BOARD


@app.command()
def report(
    device: options.DeviceArgument,
    recording: options.RecordingOption = None,
    data: options.DataOption = None,
    board: options.BoardOption = DEFAULT_BOARD,
    page: Annotated[
        Path | None, output_file("--out", "Output file; default: <device>.html.")
    ] = None,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Build, verify, emulate and measure a device; write one HTML report."""
    from_extra("pymavlink", "link", "esea-gen report")
    data = options.of_recording(data, recording)
    loaded = esea_gen.load_device(device, controller)
    target = page or writable(Path(f"{loaded.name}.html"))
    assert target is not None
    from esea_gen.report.builder import gather

    with progress_line() as say:
        found = gather(loaded, recording, data, board, progress=say)
    out.lines(found.summary())
    write_whole(target, found.html())
    out.print(f"report: {target}")
    write_json(json_file, "report", found.to_dict())
    exit_unless(found.passed)


@app.command()
def specimen(
    mapping: options.MappingArgument,
    results: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RESULT",
            help="JSON of identify, identify --compare, reliability, esea-host life; in any order. "
            "A missing identification is made; other missing results are reported as not known.",
        ),
    ] = None,
    data: options.DataOption = None,
    page: Annotated[Path | None, output_file("--out", "Output; default: specimen.html.")] = None,
) -> None:
    """Report on one specimen, as one HTML page: loops, intervals, reliability, life."""
    target = page or writable(Path("specimen.html"))
    assert target is not None
    from esea_gen.report.specimen import specimen_page
    from esea_gen.report.specimen_results import gather_specimen

    with progress_share() as tell:
        found = gather_specimen(mapping, results or [], data, tell)
    words = ["esea-gen", "specimen", str(mapping), *map(str, results or [])]
    words += [] if data is None else ["--data", str(data)]
    write_whole(target, specimen_page(found, shlex.join(words)))
    out.lines(found.summary())
    out.print(f"page: {target}")
