"""Keys for signed commands: made here, kept in a file that only its owner reads."""

from __future__ import annotations

import json
import os
import secrets
import stat
from pathlib import Path

from esea_gen.link.transport import LinkError

KEY_BYTES = 32


def new_key() -> bytes:
    """A key that nobody knows."""
    return secrets.token_bytes(KEY_BYTES)


def write_key(path: Path, key: bytes) -> None:
    """Keep a key in a new file, readable and writable by its owner alone."""
    try:
        # With its rights from the first moment on, and never over a file that is there.
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        what = f"{path} exists already"
        fix = "Use it with use_key, or give another file: a key that is lost locks you out."
        raise LinkError(what, fix) from None
    except OSError as error:
        raise LinkError(f"{path} cannot be written ({error.strerror})") from None
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        json.dump({"kind": "esea signing key", "key": key.hex()}, file)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())


def read_key(path: Path) -> bytes:
    """The key in a file, which nobody but its owner may be able to read."""
    try:
        rights = stat.S_IMODE(path.stat().st_mode)
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise LinkError(f"{path} cannot be read ({error.strerror})") from None
    if rights & 0o077:
        what = f"{path} can be read or written by others (rights {rights:o})"
        raise LinkError(what, f"chmod 600 {path}; if others could log in meanwhile, pair anew.")
    try:
        key = bytes.fromhex(json.loads(text)["key"])
    except (ValueError, KeyError, TypeError):
        raise LinkError(f"{path} is no key file") from None
    if len(key) != KEY_BYTES:
        raise LinkError(f"{path} is no key file: {len(key)} bytes instead of {KEY_BYTES}")
    return key
