"""Recordings: ``replay``, ``export``, ``import``, ``show``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.errors import UserError
from esea_host.cli.app import app, out
from esea_host.cli.options import LogArgument
from esea_host.cli.view import watch_recording
from esea_host.recording import open_log
from esea_host.recording.clock import clock_fit

FORMATS = ("csv", "parquet", "bids")
SpeedOption = Annotated[float, typer.Option("--speed", min=0.0, help="1: as it was; 0: at once.")]


@app.command()
def show(path: LogArgument) -> None:
    """Say what is in a recording: device, streams, gaps, notes."""
    with open_log(path) as log:
        facts = log.facts
        kind = "simulated" if facts.get("simulated") else "board"
        out.print(f"{path}: {'whole' if log.whole else 'cut off; read up to the cut'}")
        if facts:
            out.print(f"{facts['device']} ({kind} {facts['board']}), C {facts['content_hash']}")
        for name in log.streams:
            table = log[name]
            length = f"{table.time_s[-1] - table.time_s[0]:.3f} s" if len(table) else "empty"
            out.print(f"  {name}: {len(table)} runs, {length}, {len(table.names)} columns")
        fit = clock_fit(log)
        if fit is not None:
            out.print(f"  clocks: {fit}")
        for gap in log.gaps:
            out.print(f"  gap: {gap}")
        for note in log.events("note"):
            out.print(f"  note: {note['text']}")
        if log.attachments:
            out.print(f"  attached: {', '.join(log.attachments)}")


@app.command()
def replay(
    path: LogArgument,
    verify: Annotated[
        bool, typer.Option("--verify", help="Compute it again with the C that made it.")
    ] = False,
    stream: Annotated[str, typer.Option("--stream", help="Which to print.")] = "sense_out",
    speed: SpeedOption = 1.0,
    view: Annotated[bool, typer.Option("--view", help="Play it in the live view.")] = False,
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=1.0, help="With --view: close after so long.")
    ] = None,
    screenshot: Annotated[
        Path | None, typer.Option("--screenshot", metavar="FILE", help="With --view: picture.")
    ] = None,
) -> None:
    """Play a recording, line by line or in the live view, or prove that every bit is the C's."""
    if view:
        watch_recording(path, speed, seconds, screenshot)
        return
    with open_log(path) as log:
        if not verify:
            from esea_host.recording.playing import play

            for line in play(log, stream, speed):
                print(line)
            return
        from esea_host.recording.replay import verify as prove

        verdict = prove(log)
        out.print(
            f"{path}: {verdict.ticks} ticks, {verdict.values} values, {verdict.key_frames} key "
            f"frames, {verdict.unproven} ticks unproven"
        )
        for text in verdict.damaged:
            out.print(f"  {text}")
        for difference in verdict.differences:
            out.print(f"  {difference}")
        if not verdict.same:
            out.print("NOT THE SAME" if verdict.differences else "NOTHING TO COMPARE")
            raise typer.Exit(1)
        out.print("every bit is the C's")


@app.command()
def export(
    path: LogArgument,
    target: Annotated[Path, typer.Argument(help="File, or folder of the BIDS data set.")],
    to: Annotated[str, typer.Option("--to", help=", ".join(FORMATS))] = "csv",
    stream: Annotated[str, typer.Option("--stream")] = "sense_out",
    subject: Annotated[str, typer.Option("--subject", help="BIDS: label.")] = "01",
    task: Annotated[str, typer.Option("--task", help="BIDS: label.")] = "torque",
) -> None:
    """Write a stream for other programs; units are in the header, gaps stay gaps."""
    from esea_host.recording.export import to_bids, to_csv, to_parquet

    with open_log(path) as log:
        if to == "bids":
            out.print(f"{to_bids(log, target, subject, task, stream)}")
        elif to in FORMATS:
            write = to_csv if to == "csv" else to_parquet
            out.print(f"{target}: {write(log, stream, target)} rows")
        else:
            raise UserError(f"There is no format '{to}'.", f"Choose from {', '.join(FORMATS)}.")


@app.command(name="import")
def import_(
    source: Annotated[
        Path, typer.Argument(help="Log of another machine: CSV, Parquet, MAT, HDF5 or JSON.")
    ],
    target: Annotated[Path, typer.Argument(help="Recording to write (.mcap).")],
    mapping: Annotated[Path, typer.Option("--mapping", help="TOML: which column is what.")],
) -> None:
    """Make a recording of another machine's log; its faults are reported."""
    from esea_host.recording.foreign import import_table, read_mapping

    report = import_table(source, read_mapping(mapping), target)
    out.print(report.read)
    out.print(f"{target}: {report.rows} rows, {len(report.gaps)} gaps")
    out.print(
        f"unwrapped {report.wrapped}, broken values {report.broken}, missing values "
        f"{report.missing}, back in time {len(report.backward_s)} x"
    )
