"""``bridge``: a board for other programs, live."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from esea_gen.errors import UserError
from esea_host.cli.app import app, out
from esea_host.cli.options import (
    AddressArgument,
    DeviceOption,
    KeyOption,
    SecondsOption,
    StreamOption,
)
from esea_host.connection import open_device
from esea_host.connection.outlets import FoxgloveOutlet, LslOutlet, Outlet
from esea_host.connection.receiver import KEY


@app.command()
def bridge(
    address: AddressArgument,
    foxglove: Annotated[
        int | None,
        typer.Option(
            "--foxglove", metavar="PORT", min=0, max=65535, help="WebSocket server; 0: any."
        ),
    ] = None,
    lsl: Annotated[bool, typer.Option("--lsl", help="Lab Streaming Layer.")] = False,
    stream: StreamOption = None,
    device: DeviceOption = None,
    key: KeyOption = None,
    rate: Annotated[
        float | None, typer.Option("--rate", min=0.001, help="Runs a second; default: every one.")
    ] = None,
    seconds: SecondsOption = None,
) -> None:
    """Hand a board's streams on to Foxglove or the Lab Streaming Layer as they come."""
    if foxglove is None and not lsl:
        raise UserError("Nobody is named to hand on to.", "Add --foxglove PORT, --lsl, or both.")
    with open_device(address, device, key) as board:
        names = [s for s in stream or board.streams if s != KEY]
        told = board.listen(names, rate)
        system = board.identity.device.system
        own_Hz = {t.name: 1 / (t.every * system.base_period_s) for t in system.tasks}
        rates_Hz = {n: min(own_Hz[n.rpartition("_")[0]], rate or 1e9) for n in told}
        outlets: list[Outlet] = []
        if foxglove is not None:
            outlets.append(FoxgloveOutlet(foxglove))
        if lsl:
            outlets.append(LslOutlet(board.identity.device.name, rates_Hz))
        queue = board.subscribe(told)
        for outlet in outlets:
            out.print(outlet.said)
        end_s = None if seconds is None else time.monotonic() + seconds
        rows = gaps = 0
        try:
            while end_s is None or time.monotonic() < end_s:
                for batch in queue.take(0.1):
                    rows, gaps = rows + len(batch.rows), gaps + len(batch.gaps)
                    for outlet in outlets:
                        outlet.put(batch)
        except KeyboardInterrupt:
            pass
        finally:
            for outlet in outlets:
                outlet.close()
        out.print(f"{rows} runs handed on, {gaps} gaps, {queue.dropped_rows} dropped")
