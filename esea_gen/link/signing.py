"""Keys for signed commands, in files that only their owner can read."""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import stat
from glob import escape
from itertools import count
from pathlib import Path

from esea_gen.link.transport import LinkError
from esea_gen.portability import AT_ONCE, others_rights, rename_new, sync_folder, user_folder

KEY_BYTES = 32
MOST_FILE_BYTES = 4096
SUFFIX = ".key"


def new_key() -> bytes:
    """A key that nobody knows."""
    return secrets.token_bytes(KEY_BYTES)


def key_folder() -> Path:
    return user_folder("config", "esea-gen") / "keys"


def stored_keys(name: str = "") -> list[Path]:
    """Stored key files whose name starts so, the newest first; also a link to nothing."""
    found = key_folder().glob(f"{escape(name)}*{SUFFIX}")
    return sorted(found, key=lambda p: p.lstat().st_mtime, reverse=True)


def new_key_path(device: str, board: str) -> Path:
    """A free place in the folder of keys, which is made where it is missing."""
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", f"{device}-{board}").lstrip(".")
    try:
        key_folder().mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        what = f"{key_folder()} cannot be made ({error.strerror})"
        raise LinkError(what, "Give a file for the key: --key FILE.") from None
    return key_folder() / f"{name}-{secrets.token_hex(4)}{SUFFIX}"


def set_aside(path: Path) -> Path:
    """Keep a key file that is no longer used under another name, over no other file."""
    names = (path.with_name(f"{path.name}.unpaired-{number}") for number in count(1))
    aside = next(name for name in names if not os.path.lexists(name))
    try:
        rename_new(path, aside)
    except OSError as error:
        raise LinkError(f"{path} cannot be moved aside ({error.strerror})") from None
    return aside


def write_key(path: Path, key: bytes) -> None:
    """Write a key to a new file of its owner alone; on return it outlasts a power failure."""
    # Complete before it has its name, and never over a file that is there.
    scratch = path.with_name(f".{path.name[:100]}-{secrets.token_hex(4)}")
    text = json.dumps({"kind": "esea signing key", "key": key.hex()}) + "\n"
    try:
        try:
            handle = os.open(scratch, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
                if any(others_rights(os.fstat(file.fileno()))):  # as FAT has it: refused later
                    raise PermissionError(errno.EPERM, "its folder cannot keep it from others")
            rename_new(scratch, path)
        finally:
            scratch.unlink(missing_ok=True)
        sync_folder(path.parent)
    except FileExistsError:
        what = f"{path} exists already"
        fix = "Use it with use_key, or give another file: a key that is lost locks you out."
        raise LinkError(what, fix) from None
    except OSError as error:
        what = f"{path} cannot be written ({error.strerror})"
        raise LinkError(what, "Give another file for the key.") from None


def read_key(path: Path) -> bytes:
    """The key in a file, which nobody but its owner may be able to read."""
    try:
        with open(os.open(path, os.O_RDONLY | AT_ONCE), "rb") as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise LinkError(f"{path} is not a file", "Give the file that esea-host pair wrote.")
            data = file.read(MOST_FILE_BYTES)
    except OSError as error:
        fix = "Give the file that esea-host pair wrote."
        raise LinkError(f"{path} cannot be read ({error.strerror})", fix) from None
    owner, rights = others_rights(about)
    if owner:
        what = f"{path} belongs to another user (number {owner})"
        raise LinkError(
            what, "Whoever owns it can change it: use a copy of your own, or pair again."
        )
    if rights:
        what = f"{path} can be read or written by others (rights {stat.S_IMODE(about.st_mode):o})"
        raise LinkError(what, f"chmod 600 {path}; if others could log in meanwhile, pair again.")
    try:
        key = bytes.fromhex(json.loads(data)["key"])
    except (ValueError, KeyError, TypeError, RecursionError):
        key = b""
    if len(key) != KEY_BYTES:
        what = f"{path} is not a key file, or is damaged: it holds no key of {KEY_BYTES} bytes"
        raise LinkError(what, "Give the file that esea-host pair wrote, or a copy of it.")
    return key
