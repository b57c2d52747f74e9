"""``faults``: what a person at the drive feels when something breaks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.app import app
from esea_gen.cli.options import DeviceArgument, FigureOption, JobsOption, JsonOption
from esea_gen.cli.output import counted, picture, show


@app.command()
def faults(
    device: DeviceArgument,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Number of faults.")] = 2000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of what is drawn.")] = 0,
    jobs: JobsOption = -1,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="DIR", help="Journal: continue an interrupted run."),
    ] = None,
    emulator: Annotated[
        int,
        typer.Option(
            "--emulator", min=0, metavar="N", help="So many of them on an emulated Cortex-M7 too."
        ),
    ] = 0,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Break inputs, memory, clock and link of a drive's board; exit 1 where a bound is broken.

    The firmware runs on the board `sim` in lockstep with the virtual exoskeleton and a person; with
    --emulator a sample of the runs is played to the image of the board mps2-an500, tick by tick.
    """
    from esea_gen.analysis.campaign import Workers
    from esea_gen.verify.faults.campaign import fault_campaign, with_emulated

    with counted(f"{device}, faults") as tell:
        result = fault_campaign(
            device, runs=runs, seed=seed, workers=Workers(jobs), folder=resume, progress=tell
        )
    if emulator:
        with counted(f"{device}, in the emulator") as tell:
            result = with_emulated(result, device, runs, seed, emulator, tell)
    show(result, json_file, "faults")
    picture(figure, result.figure)
    if result.outside or not all(f.same for f in result.emulated):
        raise typer.Exit(1)
