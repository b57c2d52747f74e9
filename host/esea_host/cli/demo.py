"""The first minute without hardware: ``demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.options import writable
from esea_host.cli.app import app, out
from esea_host.cli.view import watch_demo


@app.command()
def demo(
    device: Annotated[
        str, typer.Option("--device", help="Without a window one with a drive.")
    ] = "elbow_drive",
    headless: Annotated[bool, typer.Option("--headless", help="Without a window.")] = False,
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", help="Of torque control; default: 10, or until it is closed."),
    ] = None,
    report: Annotated[
        Path, typer.Option("--report", callback=writable, help="Page to draw (.png).")
    ] = Path("demo.png"),
    recording: Annotated[
        Path | None,
        typer.Option("--recording", callback=writable, help="Default: beside the page."),
    ] = None,
    person: Annotated[
        str | None, typer.Option("--person", help="Who is in the joint; default: uncertain.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed")] = 0,
) -> None:
    """Simulated board and person, in the live view; headless: a recording, its proof, one page."""
    from esea_host.simulated.demo import run_demo

    if not headless:
        who = f"&person={person}" if person else ""
        watch_demo(f"sim:{device}?seed={seed}{who}", recording, seconds)
        return
    done = run_demo(
        device, 10.0 if seconds is None else seconds, report, recording, person, seed, out.print
    )
    v = done.verdict
    out.print(f"{done.recording}: {v.ticks} ticks, {v.values} values computed again")
    out.print("every bit is the C's" if v.same else "NOT THE SAME: esea-host replay --verify")
    out.print(f"{done.report}: simulated torque error {done.rms_error_Nm:.3f} Nm rms")
    if not v.same:
        raise typer.Exit(1)
