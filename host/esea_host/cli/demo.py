"""The first minute without hardware: ``demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.errors import UserError
from esea_host.cli.app import app, out


@app.command()
def demo(
    device: Annotated[str, typer.Option("--device", help="With a drive.")] = "elbow_drive",
    headless: Annotated[bool, typer.Option("--headless", help="Without a window.")] = False,
    seconds: Annotated[float, typer.Option("--seconds", help="Of torque control.")] = 10.0,
    report: Annotated[Path, typer.Option("--report", help="Page to draw (.png).")] = Path(
        "demo.png"
    ),
    recording: Annotated[
        Path | None, typer.Option("--recording", help="Default: beside the page.")
    ] = None,
    person: Annotated[str, typer.Option("--person", help="Who is in the joint.")] = "uncertain",
    seed: Annotated[int, typer.Option("--seed")] = 0,
) -> None:
    """Simulated board, simulated person, a recording, its replay proven, one page."""
    from esea_host.simulated.demo import run_demo

    if not headless:
        raise UserError("There is no window yet.", "Add --headless.")
    done = run_demo(device, seconds, report, recording, person, seed, out.print)
    v = done.verdict
    out.print(f"{done.recording}: {v.ticks} ticks, {v.values} values computed again")
    out.print("every bit is the C's" if v.same else "NOT THE SAME: esea-host replay --verify")
    out.print(f"{done.report}: simulated torque error {done.rms_error_Nm:.3f} Nm rms")
    if not v.same:
        raise typer.Exit(1)
