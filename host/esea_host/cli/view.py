"""Windows on a board: ``view``, ``wrist`` and ``demo``."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from esea_gen.cli.options import PICTURES, ControllerOption, option, writable
from esea_gen.devices import BEST_DRIVE
from esea_gen.errors import UserError, from_extra
from esea_host.cli.app import app, out
from esea_host.cli.options import (
    AddressArgument,
    CloseAfterOption,
    DarkOption,
    DeviceOption,
    KeyOption,
    PortOption,
    RecordOption,
    ScreenshotOption,
    output_file,
)
from esea_host.connection import ConnectedDevice, hands_at, open_device
from esea_host.connection.address import driven_by, parse_address

if TYPE_CHECKING:
    from esea_host.connection.recording import LiveRecording

OPEN_S, FILMED_S = 60.0, 5.0


@contextmanager
def _recording(board: ConnectedDevice, record: Path | None) -> Iterator[LiveRecording | None]:
    if record is None:
        yield None
        return
    with board.record(record) as recording:
        yield recording
    out.print(f"{record}: {recording.rows} runs, {recording.gaps} gaps")
    if (error := recording.error) is not None:
        if isinstance(error, OSError):  # a full disk does not tell it
            error.filename = error.filename or str(record)
        raise error


@app.command()
def view(
    address: AddressArgument,
    device: DeviceOption = None,
    key: KeyOption = None,
    record: RecordOption = None,
    dark: DarkOption = None,
    seconds: CloseAfterOption = None,
    screenshot: ScreenshotOption = None,
    serve: Annotated[
        str | None, option("--serve IP", "Also serve browsers: see esea-host serve --listen.")
    ] = None,
    port: PortOption = None,
) -> None:
    """Show a board live: curves, limits, faults; Space, Escape or F12 stops."""
    parse_address(address)  # a wrong one first, whether there is a screen or not
    if port is not None and serve is None:
        raise UserError("--port needs --serve.", "Add --serve IP, or leave --port out.")
    need_a_screen("esea-host monitor, or esea-host demo --headless")
    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.live import run_live

    with open_device(address, device, key) as board, ExitStack() as held:
        feed = LiveFeed(board)
        held.callback(feed.close)
        if serve is not None:
            from_extra("tornado", "serve", "The browser view")
            from esea_host.serve import browser_view

            out.print(held.enter_context(browser_view(feed, serve, port)))
        # Last: where it cannot be served, no file is begun.
        feed.recording = held.enter_context(_recording(board, record))
        run_live(feed, dark, seconds, screenshot)


def watch_recording(
    path: Path, speed: float, seconds: float | None, screenshot: Path | None
) -> None:
    need_a_screen("esea-host replay without --view")
    from esea_host.connection import PlayedBoard
    from esea_host.recording import open_log
    from esea_host.recording.integrity import warn_unless_complete
    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.live import run_live

    with open_log(path) as log, PlayedBoard(log, speed) as board:
        warn_unless_complete(path, log.integrity)
        feed = LiveFeed(board)
        board.play()
        run_live(feed, None, seconds, screenshot)
        feed.close()


@app.command()
def demo(
    device: Annotated[str, option("--device", "Device; headless: with a drive.")] = BEST_DRIVE,
    controller: ControllerOption = None,
    headless: Annotated[bool, option("--headless", "Show no window.")] = False,
    seconds: Annotated[
        float | None,
        option("--seconds", "Torque control, s; default: 10, or no end.", min=1.0, max=3600.0),
    ] = None,
    report: Annotated[
        Path | None,
        output_file("--report", "With --headless: page to draw; default: demo.png.", *PICTURES),
    ] = None,
    recording: Annotated[
        Path | None, output_file("--recording", "Recording; default: beside the page.")
    ] = None,
    person: Annotated[
        str | None, option("--person", "Person in the joint; default: uncertain.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
) -> None:
    """Show a simulated board and person live; headless: record, verify and report them."""
    device = driven_by(controller, device)
    if not headless:
        if report is not None:
            raise UserError("--report needs --headless.", "Add it, or leave --report out.")
        who = f"&person={person}" if person else ""
        _watch_demo(f"sim:{device}?seed={seed}{who}", recording, seconds)
        return
    from esea_gen.twin.judge import ROUGH_HEADS, rough_cells
    from esea_host.simulated.demo import run_demo, shown_error

    page, seconds = report or Path("demo.png"), 10.0 if seconds is None else seconds
    writable(page)
    done = run_demo(device, seconds, page, recording, person, seed, out.print)
    v = done.verdict
    out.print(f"{done.recording}: {v.ticks} ticks, {v.values} values computed again")
    out.print("All bits match the C." if v.same else "NOT THE SAME: esea-host replay --verify")
    out.print(f"{done.report}: simulated {shown_error(done.rms_error_Nm)}")
    named = zip(ROUGH_HEADS, rough_cells(done.roughness), strict=True)
    out.print("roughness: " + ", ".join(f"{head} {cell}" for head, cell in named))
    if done.fault:
        out.print(f"the board latched a fault: {done.fault.partition(' Cure:')[0]}")
    if done.fault or not v.same:
        raise typer.Exit(1)


def _watch_demo(address: str, record: Path | None, seconds: float | None) -> None:
    parse_address(address)
    need_a_screen("esea-host demo --headless")
    from esea_host.windows.feed import LiveFeed
    from esea_host.windows.live import run_live
    from esea_host.windows.operator import DemoOperator

    with open_device(address) as board, _recording(board, record) as recording, ExitStack() as held:
        feed = LiveFeed(board, recording)
        held.callback(feed.close)
        held.callback(DemoOperator(board).close)
        run_live(feed, None, seconds, None, partial(hands_at(board), "push"))


@app.command()
def wrist(
    address: AddressArgument,
    calibration: Annotated[
        Path | None,
        option(
            "--calibration FILE",
            "Calibration to normalise with (.toml); if missing, a new one is written there.",
        ),
    ] = None,
    device: DeviceOption = None,
    key: KeyOption = None,
    record: RecordOption = None,
    dark: DarkOption = None,
    seconds: CloseAfterOption = None,
    screenshot: ScreenshotOption = None,
    headless: Annotated[
        bool,
        option(
            "--headless",
            "Without a screen; sim: is calibrated first, and recorded while constrained.",
        ),
    ] = False,
) -> None:
    """Show a wrist's raw and normalised cursor, switch the constraint, calibrate."""
    place = parse_address(address, device)
    if headless:
        if screenshot is None:
            raise UserError("--headless needs an output file.", "Give --screenshot FILE.")
        os.environ["QT_QPA_PLATFORM"] = "offscreen"
        seconds = seconds or FILMED_S
    need_a_screen("esea-host wrist --headless --screenshot FILE")
    from esea_host.windows.wrist import SAVED
    from esea_host.windows.wrist_running import film_wrist, run_wrist
    from esea_host.wrist.calibration import load_calibration

    there = calibration is not None and calibration.exists()
    used = load_calibration(calibration) if there and calibration is not None else None
    save_to = calibration or SAVED
    if headless and screenshot is not None and seconds is not None and place.kind == "sim":
        if "?" in place.place:
            raise UserError(f"--headless takes no options of {address}.", "Give sim:wrist_drive.")
        film_wrist(place.place, used, save_to, screenshot, record, seconds, bool(dark), out.print)
        return
    with open_device(address, device, key) as board, _recording(board, record) as recording:
        run_wrist(board, recording, used, save_to, dark, seconds, screenshot)


def need_a_screen(otherwise: str) -> None:
    """Reject a window without a screen or Qt; the error names the alternative."""
    missing = [m for m in ("PySide6", "pyqtgraph") if importlib.util.find_spec(m) is None]
    if missing:
        raise UserError(f"{missing[0]} is not installed.", 'pip install "esea-gen[host]"')
    screens = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    if sys.platform.startswith("linux") and not any(os.environ.get(s) for s in screens):
        raise UserError("There is no screen here.", f"Use {otherwise}.")
    loaded = sys.modules.get("PySide6.QtWidgets")
    if loaded is not None and loaded.QApplication.instance() is not None:
        return  # a window is open already
    # Qt ends the whole program where it cannot open a window: let it end another one.
    code = "from PySide6.QtWidgets import QApplication; QApplication([])"
    try:
        tried = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=OPEN_S,
            check=False,
        )
        said, opened = tried.stderr, tried.returncode == 0
    except subprocess.TimeoutExpired:
        said, opened = f"no answer within {OPEN_S:g} s", False
    if not opened:
        line = next((x for x in said.splitlines() if "ould not" in x or "rror" in x), said[-200:])
        reason = line.strip().removeprefix("qt.qpa.xcb: ").rstrip(".")
        fix = "Install the libraries in docs/install.md, or use" if "plugin" in reason else "Use"
        raise UserError(f"No window can be opened here: {reason}.", f"{fix} {otherwise}.")
