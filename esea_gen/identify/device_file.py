"""An identified device's file: written whole or not at all, and never over somebody's own work."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path

from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError

MARK = "# Written by esea-gen identify."


def marked_toml(device: Device) -> str:
    """The device file, its first line saying that it is ours and unchanged."""
    body = device.toml()
    return f"{MARK}  Content {_digest(body)}; once changed by hand it is not overwritten.\n{body}"


def write_marked(device: Device, path: Path, overwrite: bool) -> None:
    """Write :func:`marked_toml`."""
    text = marked_toml(device)
    if parse_device(text, path.name).canonical() != device.canonical():
        raise RuntimeError(f"{path.name} does not read back to what was identified")
    try:
        if path.exists() and not overwrite and not _ours(path):
            raise UserError(
                f"'{path}' exists and was not written by esea-gen identify, or was changed by "
                "hand since.",
                "Choose another folder or device.name, or allow overwriting.",
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, partial = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as out:
                out.write(text)
            # mkstemp makes it private; a device file is read by everybody.
            os.chmod(partial, 0o644)
            os.replace(partial, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(partial)
            raise
    except OSError as error:
        raise UserError(
            f"'{path}' cannot be written ({error.strerror}).", "Choose another folder."
        ) from None


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]


def _ours(path: Path) -> bool:
    try:
        first, _, body = path.read_text(encoding="utf-8").partition("\n")
    except UnicodeDecodeError:
        return False
    return first.startswith(MARK) and _digest(body) in first
