"""Of a machine that is new: ``startup``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import esea_gen
from esea_gen.cli.app import app, out
from esea_gen.cli.options import DeviceArgument, FigureOption, JsonOption
from esea_gen.cli.output import picture, progress_line, show
from esea_gen.cli.studies import StudyCommand
from esea_gen.errors import UserError
from esea_gen.files import write_whole

if TYPE_CHECKING:
    from esea_gen.device import Device
    from esea_gen.studies.startup.outcome import Startup


def _folder(path: Path | None) -> Path | None:
    if path is not None and path.exists() and not path.is_dir():
        raise UserError(f"{path}: is a file.", "Name a folder.")
    return path


@app.command(cls=StudyCommand)
def startup(
    device: DeviceArgument,
    guide: Annotated[
        bool, typer.Option("--guide", help="Only show what there is to do, and the limits.")
    ] = False,
    plant: Annotated[
        str, typer.Option("--plant", metavar="ideal|real|random", help="Virtual exoskeleton.")
    ] = "real",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of plant and jumps.")] = 0,
    off: Annotated[
        str,
        typer.Option(
            "--off",
            metavar="FAMILY",
            help="In what the plant differs from the device file (a wrong one lists them).",
        ),
    ] = "none",
    motor_gain: Annotated[
        float,
        typer.Option(
            "--motor-gain",
            metavar="X",
            help="Simulated motor's torque over its command; below 0 it turns the other way.",
        ),
    ] = 1.0,
    delay: Annotated[
        float,
        typer.Option("--delay", metavar="MS", help="Simulated delay from command to motor."),
    ] = 0.0,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            callback=_folder,
            help="Write the device file with what was found into this folder.",
        ),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            "--keep", metavar="DIR", callback=_folder, help="Write what was recorded, CSV."
        ),
    ] = None,
    recorded: Annotated[
        Path | None,
        typer.Option("--recordings", metavar="DIR", help="Take such recordings; nothing is moved."),
    ] = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    from esea_gen.studies.startup.procedures import guide as instructions
    from esea_gen.studies.startup.recordings import write_recordings
    from esea_gen.studies.startup.study import (
        SimulatedDrive,
        start_up_recorded,
        start_up_simulated,
    )

    loaded = esea_gen.load_device(device)
    if guide:
        for line in instructions(loaded):
            out.print(line)
        return
    drive = SimulatedDrive(plant, seed, off, motor_gain, delay / 1e3)
    with progress_line() as say:
        if recorded is not None:
            result = start_up_recorded(loaded, recorded, say)
        else:
            result = start_up_simulated(loaded, drive, say)
    if keep is not None:
        write_recordings(keep, result.recordings)
    show(result, json_file, "startup")
    _write(loaded, result, folder, figure)
    if not result.gains_may_be_used:
        raise typer.Exit(1)


def _write(device: Device, result: Startup, folder: Path | None, figure: Path | None) -> None:
    # What was found, where anything was.
    from esea_gen.studies.startup.device_text import device_text
    from esea_gen.studies.startup.figure import startup_figure

    if result.model is None or result.updated is None:
        return
    if folder is not None:
        path = folder / result.updated.origin
        said = [result.verdict(), *(reason for reason, _ in result.reasons)]
        write_whole(path, device_text(device, result.updated, result.model, said))
        out.print(f"device file: {path}")
    picture(figure, lambda: startup_figure(result))
