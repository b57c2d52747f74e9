"""``faults``: what a person at the drive feels when something breaks."""

from __future__ import annotations

from typing import Annotated

from esea_gen.cli.app import app
from esea_gen.cli.options import (
    DeviceArgument,
    FigureOption,
    JobsOption,
    JournalOption,
    JsonOption,
    SeedOption,
    option,
)
from esea_gen.cli.output import counted, show


@app.command()
def faults(
    device: DeviceArgument,
    runs: Annotated[int, option("--runs", "Number of faults.", min=1)] = 2000,
    seed: SeedOption = 0,
    jobs: JobsOption = -1,
    resume: JournalOption = None,
    emulator: Annotated[
        int, option("--emulator N", "So many of them on an emulated Cortex-M7 too.", min=0)
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
    passed = not result.outside and all(f.same for f in result.emulated)
    show(result, json_file, "faults", figure=figure, passed=passed)
