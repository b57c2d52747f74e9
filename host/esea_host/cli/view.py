"""``view``: the live view of a board."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.options import writable
from esea_gen.errors import UserError
from esea_host.cli.app import app, out
from esea_host.cli.options import AddressArgument, DeviceOption, KeyOption, of_file
from esea_host.connection import ConnectedDevice, open_device
from esea_host.connection.address import SimulatedProcess, parse_address

WITHOUT_SCREEN = ("offscreen", "minimal")  # platforms of Qt
OPEN_S = 60.0


@app.command()
def view(
    address: AddressArgument,
    device: DeviceOption = None,
    key: KeyOption = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record", metavar="FILE", callback=writable, help="Record meanwhile (.mcap)."
        ),
    ] = None,
    dark: Annotated[
        bool | None, typer.Option("--dark/--light", help="Default: as the desktop has it.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=1.0, help="Close after so long.")
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(
            "--screenshot", metavar="FILE", callback=writable, help="Picture before it closes."
        ),
    ] = None,
) -> None:
    """See a board live: curves, limits, faults; Space or Escape stops the motor."""
    _watch(address, device, key, record, dark, seconds, screenshot, operated=False)


def watch_demo(address: str, record: Path | None, seconds: float | None) -> None:
    _watch(address, None, None, record, None, seconds, None, operated=True)


def watch_recording(
    path: Path, speed: float, seconds: float | None, screenshot: Path | None
) -> None:
    need_a_screen("esea-host replay without --view")
    from esea_host.connection import PlayedBoard
    from esea_host.recording import open_log
    from esea_host.recording.integrity import warn_unless_complete
    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.running import run_live

    with open_log(path) as log, PlayedBoard(log, speed) as board:
        warn_unless_complete(path, log.integrity)
        feed = LiveFeed(board)
        board.play()
        run_live(feed, None, seconds, screenshot)
        feed.close()


def _watch(
    address: str,
    device: str | None,
    key: Path | None,
    record: Path | None,
    dark: bool | None,
    seconds: float | None,
    screenshot: Path | None,
    operated: bool,
) -> None:
    parse_address(address)  # a wrong one first, whether there is a screen or not
    need_a_screen("esea-host monitor, or esea-host demo --headless")
    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.operator import DemoOperator
    from esea_host.windows.running import run_live

    with ExitStack() as held:
        board = held.enter_context(open_device(address, device, key))
        recording = held.enter_context(board.record(record)) if record else None
        feed = LiveFeed(board, recording)
        held.callback(feed.close)
        push = None
        if operated:
            held.callback(DemoOperator(board).close)
            push = partial(_push, board)
        run_live(feed, dark, seconds, screenshot, push)
    if recording is not None:
        out.print(f"{record}: {recording.rows} runs, {recording.gaps} gaps")
        if recording.error is not None:
            raise of_file(recording.error, record)


def _push(board: ConnectedDevice, *pushes_rad: float) -> None:
    transport = board.receiver.transport
    if isinstance(transport, SimulatedProcess):
        transport.push(*pushes_rad)


def need_a_screen(otherwise: str) -> None:
    """What to use where there is none, or no Qt."""
    missing = [m for m in ("PySide6", "pyqtgraph") if importlib.util.find_spec(m) is None]
    if missing:
        raise UserError(f"{missing[0]} is not installed.", "pip install 'esea-gen[host]'")
    screens = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    if sys.platform.startswith("linux") and not any(os.environ.get(s) for s in screens):
        raise UserError("There is no screen here.", f"Use {otherwise}.")
    if os.environ.get("QT_QPA_PLATFORM") in WITHOUT_SCREEN:
        return
    # Qt ends the whole program where it cannot open a window: let it end another one.
    code = "from PySide6.QtWidgets import QApplication; QApplication([])"
    try:
        tried = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            timeout=OPEN_S,
            check=False,
        )
        said, opened = tried.stderr, tried.returncode == 0
    except subprocess.TimeoutExpired:
        said, opened = f"no answer within {OPEN_S:g} s", False
    if not opened:
        line = next((x for x in said.splitlines() if "ould not" in x or "rror" in x), said[-200:])
        raise UserError(f"No window can be opened here: {line.strip()}", f"Use {otherwise}.")
