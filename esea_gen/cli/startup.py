"""Of a machine that is new: ``startup``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import esea_gen
from esea_gen.cli.app import app, out
from esea_gen.cli.options import DeviceArgument, FigureOption, JsonOption
from esea_gen.cli.output import picture, progress_line, show
from esea_gen.cli.studies import StudyCommand
from esea_gen.errors import UserError
from esea_gen.files import write_whole


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
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    from esea_gen.studies.startup.device_text import device_text
    from esea_gen.studies.startup.procedures import guide as instructions
    from esea_gen.studies.startup.study import SimulatedDrive, start_up_simulated

    loaded = esea_gen.load_device(device)
    if guide:
        for line in instructions(loaded):
            out.print(line)
        return
    drive = SimulatedDrive(plant, seed, off, motor_gain, delay / 1e3)
    with progress_line() as say:
        result = start_up_simulated(loaded, drive, say)
    show(result, json_file, "startup")
    if result.model is not None and result.updated is not None:
        if folder is not None:
            path = folder / result.updated.origin
            said = [result.verdict(), *(reason for reason, _ in result.reasons)]
            write_whole(path, device_text(loaded, result.updated, result.model, said))
            out.print(f"device file: {path}")
        if figure is not None:
            from esea_gen.studies.startup.figure import startup_figure

            picture(figure, lambda: startup_figure(result))
    if not result.gains_may_be_used:
        raise typer.Exit(1)
