"""A connected board: ``monitor``, ``record``, ``bridge``, ``zero``, ``parameters``, ``sim``."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.live import Live
from rich.table import Table as Grid

from esea_gen.cli.boundary import Shown
from esea_gen.cli.options import ControllerOption, option, writable
from esea_gen.devices import BEST_DRIVE
from esea_gen.emit.roles import sensing_tasks
from esea_gen.errors import UserError, from_extra, paragraphs
from esea_gen.files import plain, read_json, write_json
from esea_gen.link.received import shown_lines
from esea_gen.link.transport import LinkError
from esea_gen.portability import TERMINALS
from esea_gen.typed import read_number
from esea_host.cli.app import app, out, told
from esea_host.cli.options import (
    AddressArgument,
    DeviceOption,
    KeyOption,
    PortOption,
    RateOption,
    SecondsOption,
    StreamOption,
    output_file,
)
from esea_host.connection import ConnectedDevice, Subscription, open_device
from esea_host.connection.address import driven_by
from esea_host.connection.outlets import FoxgloveOutlet, LslOutlet
from esea_host.connection.receiver import KEY
from esea_host.windows.meanings import NO_ZERO, fault_text, lacks_zero

SCREEN_S, LINE_S = 0.2, 1.0
ZERO_S = 1.5  # it stands still for a while, and tells its state once a second


def _until(board: ConnectedDevice, seconds: float | None, step_s: float) -> Iterator[None]:
    # Turns of a loop until the time is up, or Ctrl+C; a link still broken then is an error.
    link, away = board.receiver, False
    end_s = math.inf if seconds is None else time.monotonic() + seconds
    with suppress(KeyboardInterrupt):
        while time.monotonic() < end_s and link.error is None:
            if link.away and not away:
                told(f"The link to {_said(board)} is broken; trying again ...")
            away = link.away
            yield
            time.sleep(step_s)
    if link.away:
        raise link.error or LinkError(link.away_text(), "Values since then are missing.")


def _said(device: ConnectedDevice) -> str:
    kind = " (simulated)" if device.simulated else ""
    return f"{device.identity.who}{kind}"


@app.command()
def monitor(
    address: AddressArgument,
    stream: Annotated[
        list[str] | None,
        option("--stream", "Stream to show; repeatable; default: all axes' sensing."),
    ] = None,
    device: DeviceOption = None,
    key: KeyOption = None,
    seconds: SecondsOption = None,
    jsonl: Annotated[bool, option("--jsonl", "Print one JSON object per run and line.")] = False,
    rate: RateOption = None,
) -> None:
    """Print a board's values, in the terminal or line by line."""
    Shown.streams = True
    with open_device(address, device, key) as board:
        chosen = stream or [f"{t.name}_out" for t in sensing_tasks(board.identity.device.system)]
        board.listen(chosen, rate)
        queue = board.subscribe(chosen)
        if jsonl:
            _lines(board, queue, seconds)
        else:
            _screen(board, queue, seconds)


def _lines(board: ConnectedDevice, queue: Subscription, seconds: float | None) -> None:
    marks = {"simulated": True} if board.simulated else {}
    for _ in _until(board, seconds, 0.0):
        for batch in queue.take(0.1):
            for gap in batch.gaps:
                print(json.dumps({"gap": asdict(gap)}))
            names = batch.rows.dtype.names or ()
            for row in batch.rows:
                values = {n: row[n].tolist() for n in names}
                zero = {"no_zero": True} if lacks_zero(board.identity.device, {"": row}) else {}
                told = plain({"stream": batch.layout.name} | marks | zero | values, null=True)
                print(json.dumps(told), flush=True)


def _screen(board: ConnectedDevice, queue: Subscription, seconds: float | None) -> None:
    wanted = queue.streams or ()
    layouts = [x for x in board.receiver.decoder.layouts.values() if x.name in wanted]
    last: dict[str, Any] = {}
    rows, line_s = 0, 0.0
    grid = Grid()
    with ExitStack() as held:
        # Into a pipe or a file it writes nothing before its end.
        terminal = sys.stdout.isatty()
        live = held.enter_context(Live(console=out, refresh_per_second=5)) if terminal else None
        for _ in _until(board, seconds, SCREEN_S):
            for batch in queue.take(0.0):
                last[batch.layout.name] = batch.rows[-1]
                rows += len(batch.rows)
            grid = Grid(title=f"{_said(board)}: {board.state()}", title_justify="left")
            unzeroed = lacks_zero(board.identity.device, last)
            for column in ("signal", "value", "unit", "meaning"):
                grid.add_column(column, justify="right" if column == "value" else "left")
            for row, c in ((last[x.name], c) for x in layouts if x.name in last for c in x.columns):
                value = row[c.name].tolist()
                text = f"{value:.5g}" if isinstance(value, float) else str(value)
                text += "?" if unzeroed and c.unit.startswith(("rad", "Nm")) else ""
                grid.add_row(c.name, text, c.unit, c.meaning[:50])
            health = board.health()
            grid.caption = f"{rows} runs; " + ", ".join(f"{k} {v}" for k, v in health.items())
            for text in unzeroed.values():
                grid.caption += f"\n{text}"
            if board.texts:
                grid.caption += f"\nthe board says: {board.texts[-1]}"
            if live is not None:
                live.update(grid)
            elif time.monotonic() > line_s:
                line_s = time.monotonic() + LINE_S
                print(shown_lines(f"{grid.title}; {grid.caption}".replace("\n", "; ")), flush=True)
    if not terminal:
        out.print(grid)


@app.command()
def record(
    address: AddressArgument,
    path: Annotated[
        Path, typer.Argument(callback=writable, help="File to write (.mcap); must not exist.")
    ],
    stream: StreamOption = None,
    device: DeviceOption = None,
    key: KeyOption = None,
    seconds: SecondsOption = None,
    compress: Annotated[bool, option("--compress", "Use zstandard.")] = False,
    signal: Annotated[
        list[str] | None, option("--signal", "Record only this value, such as tau_Nm; repeatable.")
    ] = None,
    rate: Annotated[float, option("--rate", "Rate of --signal, Hz; 0: every run.", min=0.0)] = 0.0,
    note: Annotated[str, option("--note", "Note at the start.")] = "",
) -> None:
    """Record a board; gaps are counted and reported.

    Exit code 1: the board went away or the disk was full; the data until then is kept.
    """
    if rate and not signal:
        raise UserError("--rate needs --signal.", "Name signals, such as --signal tau_Nm.")
    with open_device(address, device, key) as board:
        if signal:
            stream = [*(stream or ()), *board.listen_named(signal, rate)]
        with board.record(path, stream, compress) as recording:
            if note:
                recording.note(note)
            told_s = time.monotonic()
            with suppress(LinkError, UserError):  # reported below
                for _ in _until(board, seconds, 0.1):
                    if recording.error is not None:
                        break
                    if time.monotonic() - told_s > 5:
                        told_s = time.monotonic()
                        out.print(f"{recording.rows} runs, {recording.gaps} gaps")
            if recording.error is None and not board.receiver.away:
                recording.event("board_clock", **board.clock())
                if board.state() == "UNREFERENCED":  # who reads it later sees no state
                    recording.note(lacking := NO_ZERO["no zero"])
                    out.print(f"{path}: {lacking}")
        health = board.health()
        out.print(f"{path}: {recording.rows} runs of {_said(board)}, {recording.gaps} gaps")
        if counted := ", ".join(f"{k} {v}" for k, v in health.items() if v and k != "frames"):
            out.print(counted)
        if recording.error is not None or board.receiver.away:
            why = recording.error or "the link was broken."
            told(paragraphs(f"esea-host: the recording ended early: {why}"))
            if path.exists():
                told(f"The file is kept. To see its contents: esea-host show {path}")
            raise typer.Exit(1)


@app.command()
def bridge(
    address: AddressArgument,
    foxglove: Annotated[
        int | None,
        option("--foxglove", "WebSocket port; 0: any.", metavar="PORT", min=0, max=65535),
    ] = None,
    lsl: Annotated[bool, option("--lsl", "Forward to LSL.")] = False,
    stream: StreamOption = None,
    device: DeviceOption = None,
    key: KeyOption = None,
    rate: RateOption = None,
    seconds: SecondsOption = None,
) -> None:
    """Forward a board's streams to Foxglove or the Lab Streaming Layer."""
    if foxglove is None and not lsl:
        raise UserError("No destination is given.", "Add --foxglove PORT, --lsl, or both.")
    with open_device(address, device, key) as board:
        told = board.listen([s for s in stream or board.streams if s != KEY], rate)
        outlets: list[FoxgloveOutlet | LslOutlet] = []
        if foxglove is not None:
            outlets.append(FoxgloveOutlet(foxglove, board.simulated))
        if lsl:
            name = board.identity.device.name
            outlets.append(LslOutlet(name, address, board.rates_Hz, board.simulated))
        queue = board.subscribe(told)
        for outlet in outlets:
            out.print(outlet.said)
        rows = gaps = 0
        try:
            for _ in _until(board, seconds, 0.0):
                for batch in queue.take(0.1):
                    rows, gaps = rows + len(batch.rows), gaps + len(batch.gaps)
                    for outlet in outlets:
                        outlet.put(batch)
        finally:
            for outlet in outlets:
                outlet.close()
            out.print(f"{rows} runs forwarded, {gaps} gaps, {queue.dropped_rows} dropped")


@app.command()
def serve(
    address: AddressArgument,
    listen: Annotated[str, option("--listen", "IP address of this computer.")] = "127.0.0.1",
    port: PortOption = None,
    device: DeviceOption = None,
    key: KeyOption = None,
    seconds: SecondsOption = None,
) -> None:
    """Show a board live in a browser, also on a tablet, with a STOP button."""
    from_extra("tornado", "serve", "The browser view")
    from esea_host.serve import browser_view
    from esea_host.windows.feed import LiveFeed

    with open_device(address, device, key) as board, ExitStack() as held:
        feed = LiveFeed(board)
        held.callback(feed.close)
        out.print(held.enter_context(browser_view(feed, listen, port)))
        for _ in _until(board, seconds, 0.2):
            pass


@app.command()
def zero(address: AddressArgument, device: DeviceOption = None, key: KeyOption = None) -> None:
    """Set the present angles to zero: joint unloaded, at its zero and at rest.

    Exit code 1: something moved meanwhile, and the encoders have no zero.
    """
    with open_device(address, device, key) as board:
        board.zero()
        time.sleep(ZERO_S)
        if (state := board.state()) == "FAULT":
            f = fault_text(board.session.dialect, board.fault())
            out.print(f"{_said(board)}: fault {f.number} {f.name}: {f.meaning}.")
            told(f"What to do: {f.cure}.")
            raise typer.Exit(1)
        out.print(f"{_said(board)}: {state}")
        if state != "READY":
            told("The joint moved, or an encoder cannot be read. Hold it still, and zero it again.")
            raise typer.Exit(1)


@app.command()
def parameters(
    address: AddressArgument,
    device: DeviceOption = None,
    key: KeyOption = None,
    assign: Annotated[
        list[str] | None, option("--set", "name=value, such as smc.lambda_1_s=12; repeatable.")
    ] = None,
    save: Annotated[
        Path | None, output_file("--save", "Write the values into a JSON file.")
    ] = None,
    load: Annotated[Path | None, option("--load", "Set the values of a JSON file.")] = None,
    compare: Annotated[
        Path | None, option("--compare", "Show only what differs from a JSON file.")
    ] = None,
    keep: Annotated[bool, option("--keep", "Store the values on the board.")] = False,
) -> None:
    """List, set, save, load or compare a board's parameters; changes are shown first."""
    if compare is not None and (assign or load or save or keep):
        raise UserError("--compare changes nothing and writes nothing.", "Give it alone.")
    loaded = {} if load is None else _read(load)
    with open_device(address, device, key) as board:
        values = board.parameters()
        known = {p.name: p for p in board.session.known_parameters()}
        if compare is not None:
            other = _read(compare)
            for name in sorted(set(values) | set(other)):
                if values.get(name) != other.get(name):
                    out.print(f"{name}: {values.get(name)} here, {other.get(name)} in {compare}")
            return
        wanted = _wanted(board, loaded, assign or [])
        for full, value in wanted.items():
            if values[full] == value:
                continue
            out.print(f"{full}: {values[full]:g} -> {known[full].told(f'{value:g}')}")
            values[full] = board.set(full, value)
        if save is not None:
            content = {"parameters": values, "simulated": board.simulated}
            write_json(save, "host-parameters", content)
            out.print(f"{save}: {len(values)} parameters")
        if keep:
            board.session.save_parameters()
            how = "(simulated: stored until it ends)" if board.simulated else "without power"
            out.print(f"The board keeps these values {how}.")
        if not (assign or load) and save is None and not keep:
            for name, p in known.items():
                bounds = f"[{p.low:g}, {p.high:g}]"
                out.print(f"{name} = {p.told(f'{values[name]:g}')}  {bounds}  {p.meaning}")


def _wanted(board: ConnectedDevice, loaded: dict[str, float], typed: list[str]) -> dict[str, float]:
    # Every name and number is tried before the first is set.
    known: dict[str, Any] = {p.name: p for p in board.session.known_parameters()}
    found: tuple[dict[str, float], ...] = {}, {}
    for of, texts in zip(found, ([f"{n}={v!r}" for n, v in loaded.items()], typed), strict=True):
        for text in texts:
            name, _, value = text.partition("=")
            p = known[board.parameter_name(name.strip())]
            if p.fixed and texts is not typed:
                continue  # another calibration's
            if p.fixed:
                what = f"{text}: {p.name} is fixed: only a calibration sets it."
                raise UserError(what, "To set the present angles to zero: esea-host zero ADDRESS")
            if p.name in of:
                raise UserError(f"{p.name} is given twice.", "Give it once; nothing was set.")
            try:
                number = read_number(value)
            except UserError:
                number = math.nan
            with np.errstate(over="ignore"):
                held = np.array([p.low, number, p.high], np.float32)  # as the board holds them
            if not held[0] <= held[1] <= held[2]:
                limits = p.told(f"{p.low:g} to {p.high:g}")
                raise UserError(f"{text} is not a number from {limits}.", "Nothing was set.")
            of[p.name] = number
    return found[0] | found[1]


def _read(path: Path) -> dict[str, float]:
    content = read_json(path, fix := "Write one with --save.")
    values = content.get("parameters", content) if isinstance(content, dict) else content
    if not isinstance(values, dict):
        raise UserError(f"{path} is not a file of parameters.", fix)
    if wrong := [n for n, v in values.items() if type(v) not in (int, float) or abs(v) > 3e38]:
        raise UserError(f"{path}: {wrong[0]} has no number.", fix)
    return {n: float(v) for n, v in values.items()}


@app.command()
def sim(
    device: Annotated[str, typer.Argument(help="Device, such as elbow_drive.")] = BEST_DRIVE,
    controller: ControllerOption = None,
    tcp: Annotated[int | None, option("--tcp", "TCP port; 0: any.", min=0, max=65535)] = None,
    pty: Annotated[bool, option("--pty", "Use a pseudo terminal, not TCP.")] = False,
    person: Annotated[
        str | None, option("--person", "Person in a driven joint; default: uncertain.")
    ] = None,
    plant: Annotated[
        str | None, option("--plant", "Drive's plant: ideal, real (default) or random.")
    ] = None,
    motion: Annotated[
        str | None,
        option("--motion", "Passive joint's: person (default), therapist or a table (.csv)."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
    speed: Annotated[float, option("--speed", "1: real time; 0: as fast as it is read.")] = 1.0,
    board: Annotated[str, option("--board", "sim (f32) or sim-q31.")] = "sim",
    spring: Annotated[
        float, option("--spring", "Replace the elastomer by a spring, Nm/deg.", min=0.0)
    ] = 0.0,
    zeroed: Annotated[bool, option("--zeroed", "Zero its encoders before serving.")] = False,
) -> None:
    """Serve a simulated board: the firmware's application, a virtual joint, a virtual person."""
    from esea_host.simulated.server import serve

    if pty and tcp is not None:
        raise UserError("Both --tcp and --pty are given.", "Give one.")
    port, device = None if pty else (tcp or 0), driven_by(controller, device)
    with suppress(KeyboardInterrupt):
        serve(device, port, plant=plant, person=person, motion=motion, seed=seed, speed=speed,
              board=board, zeroed=zeroed, spring_Nm_rad=math.degrees(spring))  # fmt: skip


@app.command("sim-moteus")
def sim_moteus(
    device: Annotated[
        str, typer.Argument(help="Device with one motor, such as elbow_drive.")
    ] = BEST_DRIVE,
    person: Annotated[
        str, option("--person", "Person in the joint; nobody, or none: output fixed.")
    ] = "nobody",
    plant: Annotated[str, option("--plant", "ideal, real or random.")] = "real",
    seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
    rotor_side: Annotated[
        bool, option("--rotor-side", "No encoder on the coupling's motor side.")
    ] = False,
    program: Annotated[
        Path | None,
        option("--program FILE", "Run this firmware on it; print its lost ticks at the end."),
    ] = None,
    seconds: SecondsOption = None,
) -> None:
    """Emulate a moteus drive with a virtual joint, for the firmware's --drive on this computer."""
    from_extra("moteus", "moteus", "The emulated drive")
    from esea_host.simulated.moteus import MoteusJoint, run_board, serve_drive
    from esea_host.simulated.server import Terminal

    if not TERMINALS:
        raise UserError("This system has no pseudo terminals.", "Run it on Linux, or in WSL.")
    line = Terminal()
    joint = MoteusJoint(device, plant, person, seed, rotor_side)
    print(f"simulated moteus of {device} at serial:{line.name}", flush=True)
    last_s = math.inf if seconds is None else time.monotonic() + seconds
    try:
        with run_board(program, line.name, rotor_side) as ended:
            serve_drive(joint, line, lambda: ended() or time.monotonic() > last_s)
            if ended():  # it has said why
                raise typer.Exit(1)
    except KeyboardInterrupt:
        return
    finally:
        line.close()
