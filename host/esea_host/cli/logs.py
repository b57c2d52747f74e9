"""Recordings: ``replay``, ``export``, ``import``, ``show``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.boundary import Shown
from esea_gen.cli.options import option, writable
from esea_gen.errors import choose
from esea_gen.link.received import shown
from esea_host.cli.app import app, out
from esea_host.cli.options import CloseAfterOption, LogArgument, OneStreamOption, ScreenshotOption
from esea_host.cli.view import watch_recording
from esea_host.connection.address import driven_by
from esea_host.recording import open_log
from esea_host.recording.clock import clock_fit
from esea_host.recording.integrity import warn_unless_complete

FORMATS = ("csv", "parquet", "bids")
EVENTS = ("gap", "note", "clock", "parameter", "parameters", "board_clock")
MOST_LINES = 20
SpeedOption = Annotated[float, option("--speed", "1: as recorded; 0: at once.", min=0.0)]


@app.command()
def show(path: LogArgument) -> None:
    """Print the contents of a recording: state, device, streams, gaps, notes."""
    with open_log(path) as log:
        facts = log.facts
        out.print(f"{path}: {log.integrity}")
        _list("damage", log.integrity.damages)
        if facts:
            kind = "simulated" if facts.get("simulated") else "board"
            device = driven_by(facts.get("controller"), facts.get("device", "?"))
            board = facts.get("board", "?")
            out.print(f"{device} ({kind} {board}), C {facts.get('content_hash', '?')}")
        for name, (count, first, last) in log.spans().items():
            length = f"{(last - first) * 1e-9:.3f} s" if count else "empty"
            layout = log.layouts.get(name)
            if layout is not None:
                out.print(f"  {name}: {count} runs, {length}, {len(layout.columns)} columns")
            elif name not in EVENTS:
                kind = log.kind(name)
                out.print(f"  {name}: {count} messages, {length}, {kind}: no table of esea-host")
        fit = clock_fit(log)
        if fit is not None:
            out.print(f"  clocks: {fit}")
        _list("gap", log.gaps)
        _list("note", [shown(str(note.get("text"))) for note in log.events("note")])
        if log.attachments:
            out.print(f"  attached: {', '.join(log.attachments)}")


def _list(what: str, found: Sequence[object]) -> None:
    for one in found[:MOST_LINES]:
        out.print(f"  {what}: {one}")
    if len(found) > MOST_LINES:
        out.print(f"  and {len(found) - MOST_LINES} more of {what}")


@app.command()
def replay(
    path: LogArgument,
    verify: Annotated[
        bool, option("--verify", "Recompute it with the generated C and compare every bit.")
    ] = False,
    allow_damage: Annotated[
        bool, option("--allow-damage", "With --verify: pass if all undamaged parts agree.")
    ] = False,
    stream: OneStreamOption = None,
    speed: SpeedOption = 1.0,
    view: Annotated[bool, option("--view", "Play it in the live view.")] = False,
    seconds: CloseAfterOption = None,
    screenshot: ScreenshotOption = None,
) -> None:
    """Play a recording, line by line or in the live view, or compare it with the C bit for bit."""
    if view:
        watch_recording(path, speed, seconds, screenshot)
        return
    with open_log(path) as log:
        if not verify:
            from esea_host.recording.export import play

            warn_unless_complete(path, log.integrity)
            Shown.streams = True
            for line in play(log, stream or log.first_output, speed):
                print(line)
            return
        from esea_host.recording.replay import verify as prove

        verdict = prove(log)
        out.print(
            f"{path}: {verdict.ticks} ticks, {verdict.values} values, {verdict.key_frames} key "
            f"frames, {verdict.unproven} ticks unproven"
        )
        out.print(f"The recording is {verdict.integrity}.")
        _list("damage", verdict.integrity.damages)
        _list("different", verdict.differences)
        if not verdict.same:
            out.print("NOT THE SAME" if verdict.differences else "NOTHING TO COMPARE")
            raise typer.Exit(1)
        if verdict.proven:
            out.print("Replay matches the generated C bit for bit.")
            return
        out.print("The rest matches the generated C bit for bit; the recording is NOT COMPLETE.")
        if not allow_damage:
            out.print("To accept that, add --allow-damage.")
            raise typer.Exit(1)


@app.command()
def export(
    path: LogArgument,
    target: Annotated[Path, typer.Argument(help="File, or folder of the BIDS data set.")],
    to: Annotated[str, option("--to", ", ".join(FORMATS))] = "csv",
    stream: OneStreamOption = None,
    subject: Annotated[str, option("--subject", "BIDS label.")] = "01",
    task: Annotated[str, option("--task", "BIDS label.")] = "torque",
) -> None:
    """Export a stream to other programs; units are in the header, gaps stay gaps."""
    from esea_host.recording.export import to_bids, to_csv, to_parquet

    choose("format", to, FORMATS)
    with open_log(path) as log:
        warn_unless_complete(path, log.integrity)
        stream = stream or log.first_output
        if to == "bids":
            out.print(f"{to_bids(log, target, subject, task, stream)}")
        else:
            write = to_csv if to == "csv" else to_parquet
            out.print(f"{target}: {write(log, stream, target)} rows")


@app.command(name="import")
def import_(
    source: Annotated[
        Path, typer.Argument(help="Log of another machine: CSV, Parquet, MAT, HDF5 or JSON.")
    ],
    target: Annotated[Path, typer.Argument(callback=writable, help="Recording to write (.mcap).")],
    mapping: Annotated[Path, option("--mapping", "TOML file that describes the columns.")],
) -> None:
    """Convert another machine's log to a recording; its defects are reported."""
    from esea_host.recording.foreign import import_table, read_mapping

    report = import_table(source, read_mapping(mapping), target)
    out.print(report.read)
    out.print(f"{target}: {report.rows} rows, {len(report.gaps)} gaps")
    out.print(
        f"unwrapped {report.wrapped}, broken values {report.broken}, missing values "
        f"{report.missing}, back in time {len(report.backward_s)} x"
    )
