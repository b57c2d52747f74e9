"""Packages for opkg, as NI Linux RT installs them: the same content gives the same bytes."""

from __future__ import annotations

import gzip
import io
import tarfile
from collections.abc import Mapping
from pathlib import PurePosixPath

_MEMBERS = ("debian-binary", "control.tar.gz", "data.tar.gz")


def ipk(control: Mapping[str, str], files: Mapping[str, tuple[bytes, int]]) -> bytes:
    """Bytes of a package."""
    told = "".join(f"{name}: {value}\n" for name, value in control.items()).encode()
    parts = (
        b"2.0\n",
        _packed({"/control": (told, 0o644)}),
        _packed(files),
    )
    # The archive as ar writes it, without a time or an owner; every member begins at an even place.
    made = b"!<arch>\n"
    for name, part in zip(_MEMBERS, parts, strict=True):
        head = f"{name:<16}{0:<12}{0:<6}{0:<6}{100644:<8}{len(part):<10}`\n"
        made += head.encode() + part + b"\n" * (len(part) % 2)
    return made


def _packed(files: Mapping[str, tuple[bytes, int]]) -> bytes:
    folders = {str(p) for name in files for p in PurePosixPath(name).parents if str(p) != "/"}
    buffer = io.BytesIO()
    # Neither the time nor a name: both would stand in the stream's head.
    with (
        gzip.GzipFile("", "wb", 9, buffer, mtime=0) as stream,
        tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for name in sorted([*folders, *files]):
            entry = tarfile.TarInfo("." + name)
            if name in folders:
                entry.type, entry.mode = tarfile.DIRTYPE, 0o755
                tar.addfile(entry)
                continue
            content, entry.mode = files[name]
            entry.size = len(content)
            tar.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()
