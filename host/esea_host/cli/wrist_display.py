"""``wrist``: the wrist-normalisation display of a board."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.options import writable
from esea_gen.errors import UserError
from esea_host.cli.app import app, out
from esea_host.cli.options import AddressArgument, DeviceOption, KeyOption, of_file
from esea_host.cli.view import need_a_screen
from esea_host.connection import open_device
from esea_host.connection.address import parse_address

FILMED_S = 5.0


@app.command()
def wrist(
    address: AddressArgument,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration",
            metavar="FILE",
            help="Calibration to normalise with (.toml); if there is none, a new one goes there.",
        ),
    ] = None,
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
        float | None, typer.Option("--seconds", min=1.0, max=3600.0, help="Close after so long.")
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(
            "--screenshot", metavar="FILE", callback=writable, help="Picture before it closes."
        ),
    ] = None,
    headless: Annotated[
        bool,
        typer.Option(
            "--headless",
            help="Without a screen; sim: is calibrated first, and recorded while constrained.",
        ),
    ] = False,
) -> None:
    """See raw and normalised cursor of a wrist, switch the constraint, calibrate."""
    place = parse_address(address)
    if headless:
        if screenshot is None:
            raise UserError("--headless shows nothing.", "Give --screenshot FILE.")
        os.environ["QT_QPA_PLATFORM"] = "offscreen"
    need_a_screen("esea-host wrist --headless --screenshot FILE")
    from esea_host.windows.wrist import SAVED
    from esea_host.windows.wrist_running import film_wrist, run_wrist
    from esea_host.wrist.stored import load_calibration

    there = calibration is not None and calibration.exists()
    used = load_calibration(calibration) if there and calibration is not None else None
    save_to = calibration or SAVED
    if headless and screenshot is not None and place.kind == "sim":
        if "?" in place.place:
            raise UserError(f"--headless takes no options of {address}.", "Give sim:wrist_drive.")
        for_s = seconds or FILMED_S
        film_wrist(place.place, used, save_to, screenshot, record, for_s, bool(dark), out.print)
        return
    with ExitStack() as held:
        board = held.enter_context(open_device(address, device, key))
        recording = held.enter_context(board.record(record)) if record else None
        if headless:
            seconds = seconds or FILMED_S
        run_wrist(board, recording, used, save_to, dark, seconds, screenshot)
    if recording is not None:
        out.print(f"{record}: {recording.rows} runs, {recording.gaps} gaps")
        if recording.error is not None:
            raise of_file(recording.error, record)
