"""Options that several commands share."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.options import JsonOption, option, output_file

__all__ = ["JsonOption", "output_file"]

AddressArgument = Annotated[
    str,
    typer.Argument(help="Address of the board: tcp:host:port, serial:/dev/..., pty:..., sim:knee."),
]
DeviceOption = Annotated[
    str | None, option("--device", "Expected device: name or file; default: any shipped.")
]
KeyOption = Annotated[
    Path | None,
    option(
        "--key FILE", "Key of a board that is paired; default: the one that esea-host pair stored."
    ),
]
LogArgument = Annotated[Path, typer.Argument(help="A recording (.mcap).")]
SecondsOption = Annotated[
    float | None, option("--seconds", "Stop after this many s; default: Ctrl+C.", min=0.0)
]
StreamOption = Annotated[
    list[str] | None, option("--stream", "Stream, such as sense_out; repeatable; default: all.")
]
OneStreamOption = Annotated[
    str | None, option("--stream", "Stream; default: sensing of the first axis.")
]
PortOption = Annotated[
    int | None, option("--port", "Browser view's port; default: 8766; 0: any.", min=0, max=65535)
]
RateOption = Annotated[float | None, option("--rate", "Runs per second; default: all.", min=0.001)]
RecordOption = Annotated[Path | None, output_file("--record", "Also record (.mcap).")]
ReportOption = Annotated[Path | None, output_file("--report", "Write one HTML page.")]
ScreenshotOption = Annotated[
    Path | None, output_file("--screenshot", "Save a picture at the end.", ".png", ".jpg")
]
CloseAfterOption = Annotated[
    float | None, option("--seconds", "Close the window after this many s.", min=1.0, max=1e6)
]
DarkOption = Annotated[bool | None, option("--dark/--light", "Default: the desktop's theme.")]


# Rooms whose tasks register themselves when they are read.
SHIPPED_TASKS = ("esea_host.assess.tasks", "esea_host.interaction", "esea_host.wrist")


def know_shipped_tasks() -> None:
    for room in SHIPPED_TASKS:
        import_module(room)
