"""Stored values of a board: ``kept``, ``blackbox``, ``life``; its key: ``pair``, ``unpair``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from esea_gen.board.blackbox import blackbox_csv, read_record
from esea_gen.cli.options import option
from esea_gen.device import Device
from esea_gen.devices.fatigue import life_used
from esea_gen.emit.roles import board_roles
from esea_gen.errors import UserError
from esea_gen.files import write_json, write_whole
from esea_gen.link.kept import (
    CouplingLife,
    KeptValue,
    coupling_lives,
    forget_coupling,
    kept_use,
    kept_values,
    name_coupling,
    name_encoders,
    read_blackbox,
    release_blackbox,
)
from esea_gen.link.parameters import find_parameter
from esea_gen.link.session import Session
from esea_gen.link.signing import new_key_path, set_aside
from esea_gen.link.transport import LinkError
from esea_host.cli.app import app, out, say
from esea_host.cli.options import AddressArgument, DeviceOption, JsonOption, KeyOption, output_file
from esea_host.connection import life_told, open_device

UNTIL_OFF = "until power-off"  # what the board says that cannot store its key


@app.command()
def kept(
    address: AddressArgument,
    encoder: Annotated[
        list[int] | None,
        option(
            "--encoder",
            "Serial number printed on an encoder; one for each, in the device's order. "
            "The board restarts.",
            min=1,
        ),
    ] = None,
    device: DeviceOption = None,
    key: KeyOption = None,
) -> None:
    """Show what a board stores: parameters, zeros, use counters; name the encoders.

    A stored parameter that this firmware does not allow is reported with the value in force.
    """
    with open_device(address, device, key) as board:
        names = [e.instance for e in board_roles(board.identity.device.system).encoders]
        _check_serials(encoder, "encoder", names)
        told = name_encoders(board.session, encoder) if encoder else kept_use(board.session)
        values, total, others = kept_values(board.session)
        changed = [_changed(board.session, v) for v in values]
    for name, (serial, zero_rad) in zip(names, told.encoders, strict=True):
        zero = "no zero" if zero_rad is None else f"zero {zero_rad:.5f} rad"
        out.print(f"{name}: {f'serial {serial}, {zero}' if serial else 'not named'}")
    if names:
        out.print(f"zero in force: {told.zero}")
    out.print(", ".join(f"{n.replace('_', ' ')} {v}" for n, v in told.counters.items()))
    out.print(f"parameters: {total}")
    say((*changed, *others))


def _check_serials(given: list[int] | None, what: str, places: list[str]) -> None:
    # Before the first is named: each place has one of its own.
    if given and (len(given) != len(places) or len(set(given)) < len(given)):
        raise UserError(
            f"{len(given)} serial numbers for {len(places)} {what}s: {', '.join(map(str, given))}.",
            f"Give --{what} with a number of its own for each of: {', '.join(places) or 'none'}.",
        )


def _changed(session: Session, kept: KeptValue) -> str:
    # What was saved, what is allowed, what is in force.
    if kept.found == "unknown":
        return f"{kept.name}: {kept.value:g} was saved, but this firmware has no such parameter"
    p = find_parameter(session.known_parameters(), kept.name)
    bounds = p.told(f"outside {p.low:g} to {p.high:g}")
    why = {
        "clipped": f"{bounds}, taken to the bound",
        "out of bounds": f"{bounds}, not taken",
        "conflicting": "refused with the other values, not taken",
    }[kept.found]
    saved, now = (p.told(f"{x:g}") for x in (kept.value, session.parameter(kept.name)))
    return f"{kept.name}: {saved} was saved, {why}; in force {now}"


@app.command()
def blackbox(
    address: AddressArgument,
    target: Annotated[Path, output_file("--out", "Table to write, CSV.")],
    release: Annotated[
        bool, option("--release", "Then release it; the board's copy is lost.")
    ] = False,
    device: DeviceOption = None,
    key: KeyOption = None,
) -> None:
    """Read the record of the last seconds before a fault from a board."""
    with open_device(address, device, key) as board:
        found = read_blackbox(board.session)
        if found is None:
            raise UserError(
                f"{address}: its black box is not frozen.",
                "Read it after a fault, or after a reset with the motor on.",
            )
        named = board.identity.device
        records = [None if r is None else read_record(named, r) for r in found.records]
        sound = [r for r in records if r is not None]
        write_whole(target, blackbox_csv(sound, board.simulated))
        if release:
            release_blackbox(board.session)
    corrupt = sum(r is None for r in records)
    why = f"fault {found.fault}" if found.fault else "a reset while the motor was on"
    why += " (simulated)" if board.simulated else ""
    out.print(f"{target}: {len(records) - corrupt} ticks up to {found.tick}, frozen by {why}")
    if corrupt:
        out.print(f"{corrupt} records were corrupt and are left out")


@app.command()
def life(
    address: AddressArgument,
    coupling: Annotated[
        list[int] | None,
        option(
            "--coupling",
            "Serial number printed on a coupling; one for each axis, in the device's "
            "order. The count of that coupling's use continues.",
            min=1,
        ),
    ] = None,
    forget: Annotated[
        int | None, option("--forget", "Delete the count of a coupling that is not fitted.", min=1)
    ] = None,
    json_file: JsonOption = None,
    device: DeviceOption = None,
    key: KeyOption = None,
) -> None:
    """Show each coupling's load history and used share of its life; name the couplings."""
    with open_device(address, device, key) as board:
        lives = coupling_lives(board.session)
        fitted_to = [f"axis {x.axis}" for x in lives if x.axis is not None]
        _check_serials(coupling, "coupling", fitted_to)
        fitted = {x.serial for x in lives if x.axis is not None}
        for axis, serial in sorted(enumerate(coupling or ()), key=lambda pair: pair[1] in fitted):
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
        out.print("The device has no coupling with a load count.")
    rows, curve = [_row(known, one) for one in lives], known.file.fatigue
    told = None if curve is None else curve.model_dump()
    content = {"device": known.name, "simulated": simulated, "fatigue": told, "couplings": rows}
    write_json(json_file, "host-life", content)


def _show(device: Device, one: CouplingLife) -> None:
    where = "not fitted" if one.axis is None else f"axis {device.axes[one.axis] or one.axis}"
    name = f"coupling {one.serial}" if one.serial else "coupling without a name"
    out.print(f"{name}, {where}:")
    out.print(
        f"  {one.seconds / 3600:.2f} h counted, {sum(one.halves) / 2:g} cycles of "
        f"{one.width_rad:.4f} rad and more, {one.energy_J:.3g} J absorbed"
    )
    for k, halves in enumerate(one.halves):
        if halves:
            low, high = k * one.width_rad, (k + 1) * one.width_rad
            out.print(f"  {low:.3f} to {high:.3f} rad: {halves / 2:g} cycles")
    text, warns = life_told(device, one)
    out.print(f"  {'WARNING: ' if warns else ''}{text}")
    if one.full:
        out.print(f"  {one.full} half cycles were counted early for want of memory")


def _row(device: Device, one: CouplingLife) -> dict[str, object]:
    curve = device.file.fatigue
    used = None if curve is None else asdict(life_used(curve, one.halves, one.width_rad))
    return asdict(one) | {"life_used": used, "warns": life_told(device, one)[1]}


@app.command()
def pair(
    address: AddressArgument,
    device: DeviceOption = None,
    key: Annotated[
        Path | None,
        option(
            "--key FILE",
            "New file for the key; default: in the user's folder, where commands find it.",
        ),
    ] = None,
) -> None:
    """Give a board a key: from then on it accepts only signed commands, and STOP from anyone."""
    with open_device(address, device) as board:
        found = board.identity
        if board.session.traffic().paired:
            raise UserError(
                f"{address}: the board is paired already; its key is in {found.key}.",
                f"To change the key, first: esea-host unpair {address}",
            )
        path = new_key_path(found.device.name, found.board) if key is None else key
        if path.exists():
            raise UserError(f"{path} exists already.", "Give a new file: no key is overwritten.")
        try:
            board.session.pair(path)
        except LinkError as error:
            if not path.exists():
                raise
            raise LinkError(
                f"{error.what}; the key was written to {path} before, and the board may have it",
                f"Once the board answers, check: esea-host pair {address}",
            ) from None
        temporary = any(UNTIL_OFF in text for text in board.session.texts)
    out.print(f"{address}: paired. The key is in {path}.")
    if key is not None:
        out.print(f"Commands find it with --key {key} only.")
    out.print("Keep a copy of the file in a safe place: without it nobody can command the board.")
    if temporary:
        out.print("The board cannot store its key: it is unpaired again after power-off.")


@app.command()
def unpair(address: AddressArgument, device: DeviceOption = None, key: KeyOption = None) -> None:
    """Remove a board's key, so that it accepts commands from anyone; move its file aside."""
    with open_device(address, device, key) as board:
        if not board.session.traffic().paired:
            raise UserError(f"{address}: the board is not paired.", "Nothing was changed.")
        path = board.identity.key
        board.session.unpair()
    out.print(f"{address}: no longer paired.")
    if path is not None:
        out.print(f"Its key is in {set_aside(path)}; no board uses it now.")
