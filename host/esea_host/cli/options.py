"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

AddressArgument = Annotated[
    str,
    typer.Argument(
        help="Where the board is: tcp:host:port, serial:/dev/..., pty:..., sim:elbow_drive."
    ),
]
DeviceOption = Annotated[
    str | None,
    typer.Option("--device", help="Device that it must be: name or file; default: any shipped."),
]
LogArgument = Annotated[Path, typer.Argument(help="A recording (.mcap).")]
SecondsOption = Annotated[
    float | None, typer.Option("--seconds", min=0.0, help="End after so long; default: Ctrl+C.")
]
StreamOption = Annotated[
    list[str] | None,
    typer.Option("--stream", help="Stream, such as sense_out; again for more; default: all."),
]
