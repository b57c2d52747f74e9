"""``life``: what the couplings have borne, and how much of their life is used."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.options import writable
from esea_gen.device import Device
from esea_gen.devices.fatigue import life_used
from esea_gen.errors import UserError
from esea_gen.files import write_json
from esea_gen.link.kept import CouplingLife, coupling_lives, forget_coupling, name_coupling
from esea_host.cli.app import app, out
from esea_host.cli.options import AddressArgument, DeviceOption, KeyOption
from esea_host.connection import life_told, open_device


@app.command()
def life(
    address: AddressArgument,
    coupling: Annotated[
        list[int] | None,
        typer.Option(
            "--coupling",
            min=1,
            help="Serial number that stands on a coupling; one for each axis, in the device's "
            "order. What that coupling has borne before goes on.",
        ),
    ] = None,
    forget: Annotated[
        int | None, typer.Option("--forget", min=1, help="Forget a coupling that lies aside.")
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", callback=writable, help="Write the result, JSON."),
    ] = None,
    device: DeviceOption = None,
    key: KeyOption = None,
) -> None:
    """Show what each coupling has borne, and how much of its life is used; name the couplings."""
    with open_device(address, device, key) as board:
        lives = coupling_lives(board.session)
        axes = sum(x.axis is not None for x in lives)
        if coupling and len(coupling) != axes:
            raise UserError(
                f"{len(coupling)} serial numbers for {axes} couplings.",
                "Give --coupling once for each axis.",
            )
        for axis, serial in enumerate(coupling or ()):
            name_coupling(board.session, axis, serial)
        if forget is not None:
            forget_coupling(board.session, forget)
        lives = coupling_lives(board.session) if coupling or forget else lives
        known, simulated = board.identity.device, board.simulated
    if simulated:
        out.print("A simulated board:")
    for one in lives:
        _show(known, one)
    if not lives:
        out.print("The device has no coupling that is counted.")
    rows = [_row(known, one) for one in lives]
    curve = known.file.fatigue
    told = None if curve is None else curve.model_dump()
    content = {"device": known.name, "simulated": simulated, "fatigue": told, "couplings": rows}
    write_json(json_file, "host-life", content)


def _show(device: Device, one: CouplingLife) -> None:
    where = "lies aside" if one.axis is None else f"axis {device.axes[one.axis] or one.axis}"
    name = f"coupling {one.serial}" if one.serial else "coupling, nobody said which it is"
    out.print(f"{name}, {where}:")
    out.print(
        f"  {one.seconds / 3600:.2f} h counted, {sum(one.halves) / 2:g} cycles of "
        f"{one.width_rad:.4f} rad and more, {one.energy_J:.3g} J taken"
    )
    for k, halves in enumerate(one.halves):
        if halves:
            low, high = k * one.width_rad, (k + 1) * one.width_rad
            out.print(f"  {low:.3f} to {high:.3f} rad: {halves / 2:g} cycles")
    text, warns = life_told(device, one)
    out.print(f"  {'WARNING: ' if warns else ''}{text}")
    if one.full:
        out.print(f"  {one.full} times half a cycle was taken for want of room")


def _row(device: Device, one: CouplingLife) -> dict[str, object]:
    curve = device.file.fatigue
    used = None if curve is None else asdict(life_used(curve, one.halves, one.width_rad))
    return asdict(one) | {"life_used": used, "warns": life_told(device, one)[1]}
