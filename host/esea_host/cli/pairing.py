"""``pair`` and ``unpair``: who may command a board."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.errors import UserError
from esea_gen.link.signing import new_key_path, set_aside
from esea_gen.link.transport import LinkError
from esea_host.cli.app import app, out
from esea_host.cli.options import AddressArgument, DeviceOption, KeyOption
from esea_host.connection import open_device

UNTIL_OFF = "until power-off"  # what the board says that cannot store its key


@app.command()
def pair(
    address: AddressArgument,
    device: DeviceOption = None,
    key: Annotated[
        Path | None,
        typer.Option(
            "--key",
            metavar="FILE",
            help="New file for the key; default: in the user's folder, where commands find it.",
        ),
    ] = None,
) -> None:
    """Give a board a key: from then on it takes signed commands only, and STOP from anybody."""
    with open_device(address, device) as board:
        found = board.identity
        if board.session.traffic().paired:
            raise UserError(
                f"{address}: the board is paired already; its key is in {found.key}.",
                f"For another key first: esea-host unpair {address}",
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
                f"Once the board answers, see whether it has: esea-host pair {address}",
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
    """Take the key from a board, so that it takes commands from anybody; set its file aside."""
    with open_device(address, device, key) as board:
        if not board.session.traffic().paired:
            raise UserError(f"{address}: the board is not paired.", "Nothing was changed.")
        path = board.identity.key
        board.session.unpair()
    out.print(f"{address}: no longer paired.")
    if path is not None:
        out.print(f"Its key is in {set_aside(path)} now, for no board any more.")
