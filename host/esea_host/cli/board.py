"""``kept`` and ``blackbox``: what a board keeps without power."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.board.blackbox import blackbox_csv, read_record
from esea_gen.cli.options import writable
from esea_gen.emit.roles import board_roles
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.link.kept import (
    KeptValue,
    kept_use,
    kept_values,
    name_encoders,
    read_blackbox,
    release_blackbox,
)
from esea_gen.link.parameters import find_parameter
from esea_gen.link.session import Session
from esea_host.cli.app import app, out
from esea_host.cli.options import AddressArgument, DeviceOption, KeyOption
from esea_host.connection import open_device


@app.command()
def kept(
    address: AddressArgument,
    encoder: Annotated[
        list[int] | None,
        typer.Option(
            "--encoder",
            min=1,
            help="Serial number that stands on an encoder; one for each, in the device's order. "
            "The board starts afresh.",
        ),
    ] = None,
    device: DeviceOption = None,
    key: KeyOption = None,
) -> None:
    """Show what outlasts the power: parameters, zeros, use counters; name the encoders.

    A kept parameter that this firmware does not allow is told with what is in force in its place.
    """
    with open_device(address, device, key) as board:
        names = [e.instance for e in board_roles(board.identity.device.system).encoders]
        if encoder is not None and len(encoder) != len(names):
            raise UserError(
                f"{len(encoder)} serial numbers for {len(names)} encoders.",
                f"Give --encoder once for each of: {', '.join(names) or 'none'}.",
            )
        told = name_encoders(board.session, encoder) if encoder else kept_use(board.session)
        values, total, others = kept_values(board.session)
        changed = [_changed(board.session, v) for v in values]
    for name, (serial, zero_rad) in zip(names, told.encoders, strict=True):
        zero = "no zero" if zero_rad is None else f"zero {zero_rad:.5f} rad"
        out.print(f"{name}: {f'serial {serial}, {zero}' if serial else 'nobody said which it is'}")
    if names:
        out.print(f"zero in force: {told.zero}")
    out.print(", ".join(f"{n.replace('_', ' ')} {v}" for n, v in told.counters.items()))
    out.print(f"parameters: {total}")
    for line in (*changed, *others):
        out.print(line)


def _changed(session: Session, kept: KeptValue) -> str:
    # What was saved, what is allowed, what is in force.
    if kept.found == "unknown":
        return f"{kept.name}: {kept.value:g} was saved, and this firmware has no such parameter"
    p = find_parameter(session.known_parameters(), kept.name)
    unit = "" if p.unit == "1" else f" {p.unit}"
    why = {
        "clipped": f"outside {p.low:g} to {p.high:g}{unit}, taken to the bound",
        "out of bounds": f"outside {p.low:g} to {p.high:g}{unit}, not taken",
        "conflicting": "refused beside the other values, not taken",
    }[kept.found]
    now = session.parameter(kept.name)
    return f"{kept.name}: {kept.value:g}{unit} was saved, {why}; in force {now:g}{unit}"


@app.command()
def blackbox(
    address: AddressArgument,
    target: Annotated[
        Path, typer.Option("--out", metavar="FILE", callback=writable, help="Table to write, CSV.")
    ],
    release: Annotated[
        bool, typer.Option("--release", help="Then let it go on; the board's copy is lost.")
    ] = False,
    device: DeviceOption = None,
    key: KeyOption = None,
) -> None:
    """Read the last two seconds before a fault out of a board."""
    with open_device(address, device, key) as board:
        found = read_blackbox(board.session)
        if found is None:
            raise UserError(
                f"{address}: its black box is not frozen.",
                "It is frozen at a fault, and by a reset while the motor was on.",
            )
        named = board.identity.device
        records = [None if r is None else read_record(named, r) for r in found.records]
        write_whole(target, blackbox_csv([r for r in records if r is not None]))
        if release:
            release_blackbox(board.session)
    corrupt = sum(r is None for r in records)
    why = f"fault {found.fault}" if found.fault else "a reset while the motor was on"
    out.print(f"{target}: {len(records) - corrupt} ticks up to {found.tick}, frozen by {why}")
    if corrupt:
        out.print(f"{corrupt} records were corrupt and are left out")
