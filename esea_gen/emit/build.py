"""Write and check the output folder of a device: files and manifest, complete or not at all."""

from __future__ import annotations

import difflib
import hashlib
import json
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.formats import DEFAULT_FORMATS, FORMATS
from esea_gen.emit.render import Renderer, content_hash, versions
from esea_gen.emit.walker import UnsupportedOperationError
from esea_gen.errors import UserError, choose
from esea_gen.language.system import System
from esea_gen.portability import replace

MANIFEST = "manifest.json"
# Formats beside the default ones that a shipped device is built in, and its output compared in.
FURTHER_FORMATS = {"elbow_drive": ("q31",)}


@dataclass(frozen=True)
class Bundle:
    """One folder of output: its files in memory."""

    folder: str  # below the device's output folder: a number format, or ``dialect``
    files: dict[str, str]  # by relative path, the manifest among them


def device_hash(device: Device, real: str = "") -> str:
    """Content hash of a device file, its emitted text and versions: 16 hexadecimal digits.

    real: a number format outside the default ones, whose text is covered too.
    """
    formats = dict.fromkeys([*DEFAULT_FORMATS, real] if real else DEFAULT_FORMATS)
    return _hash_once(device.system, device.digest, device.title, tuple(formats))


@cache
def _hash_once(system: System, digest: str, title: str, formats: tuple[str, ...]) -> str:
    # The text is printed for it, and devices of equal content have one System.
    return content_hash(system, digest, title, [FORMATS[name] for name in formats])


def format_hash(device: Device, real: str) -> str:
    """Content hash that the files of a number format carry."""
    return device_hash(device) if FORMATS[real].default else device_hash(device, real)


def build_command(device: Device) -> str:
    """The command that regenerates a device's output."""
    law = f" --controller {device.controller}" if device.controller else ""
    return f"esea-gen build {device.argument}{law}"


def device_formats(device: Device, out: Path = Path()) -> list[str]:
    """Number formats that a device is built in where none is named: those in its folder, too."""
    further = FURTHER_FORMATS.get(device.name, ()) if device.shipped else ()
    built = (name for name in FORMATS if (out / name / MANIFEST).is_file())
    return list(dict.fromkeys([*DEFAULT_FORMATS, *further, *built]))


def render_device(device: Device, reals: Iterable[str]) -> list[Bundle]:
    """Render a device's output folders in memory."""
    bundles = []
    for real in reals:
        choose("number format", real, FORMATS)
        command = f"{build_command(device)} --real {real}"
        try:
            digest = format_hash(device, real)
            files = Renderer(device.system, FORMATS[real], digest, command, device.title).folder()
        except UnsupportedOperationError as error:
            raise UserError(f"{device.origin}: {error.what}", error.fix) from None
        bundles.append(Bundle(real, files | manifest(device, digest, real, command, files)))
    return bundles


def manifest(
    device: Device,
    digest: str,
    kind: str,
    command: str,
    files: Mapping[str, str],
    more_versions: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """Manifest of an output folder: its kind and content."""
    content: dict[str, Any] = {
        "device": device.name,
        "kind": kind,
        "content_hash": digest,
        "device_sha256": device.digest,
        "versions": versions() | dict(more_versions or {}),
        "command": command,
        "files": {name: hashlib.sha256(files[name].encode()).hexdigest() for name in sorted(files)},
    }
    return {MANIFEST: json.dumps(content, indent=2) + "\n"}


def write_bundles(bundles: list[Bundle], out: Path) -> list[Path]:
    """Write output folders, each completely or not at all."""
    written = []
    for bundle in bundles:
        _refuse_foreign(bundle, out / bundle.folder)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".esea-", dir=out) as scratch:
            for bundle in bundles:
                fresh = Path(scratch) / bundle.folder
                for name, text in bundle.files.items():
                    target = fresh / name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_text(text, encoding="utf-8", newline="\n")
            for bundle in bundles:
                target, old = out / bundle.folder, Path(scratch) / f"old-{bundle.folder}"
                if target.exists():
                    replace(target, old)
                try:
                    replace(Path(scratch) / bundle.folder, target)
                except OSError:
                    if old.exists():
                        replace(old, target)
                    raise
                written.append(target)
    except OSError as error:
        raise UserError(
            f"{out}: cannot be written ({error.strerror or error}).", "Give another --out folder."
        ) from error
    return written


def _refuse_foreign(bundle: Bundle, folder: Path) -> None:
    # Only what was written here, by the manifest, is replaced, and what stays as it is.
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder} is a file.", "Give another --out folder.")
    present, files = _present(folder), bundle.files
    known = {n for n in present & set(files) if (folder / n).read_bytes() == files[n].encode()}
    with suppress(OSError, ValueError, KeyError, TypeError):
        known |= {MANIFEST, *json.loads((folder / MANIFEST).read_bytes())["files"]}
    if foreign := sorted(present - known):
        raise UserError(
            f"{folder} has files that esea-gen did not write ({', '.join(foreign[:3])}).",
            "Move them away, or give another --out folder.",
        )


def _present(folder: Path) -> set[str]:
    found = (p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts)
    return {p.relative_to(folder).as_posix() for p in found}


def differences(bundles: list[Bundle], out: Path) -> list[str]:
    """Unified diffs between generated and present files."""
    found = []
    for bundle in bundles:
        folder = out / bundle.folder
        present = _present(folder)
        # A folder of which only the manifest is kept is compared by the hashes in it.
        made = {MANIFEST} if present == {MANIFEST} else set(bundle.files)
        for name in sorted(present | made):
            label, new = f"{bundle.folder}/{name}", bundle.files.get(name)
            old = (folder / name).read_bytes().decode(errors="replace") if name in present else None
            if new is None:
                found.append(f"{label}: not generated")
            elif old != new:
                diff = difflib.unified_diff(
                    (old or "").splitlines(),
                    new.splitlines(),
                    "(missing)" if old is None else f"{label} (on disk)",
                    f"{label} (as generated now)",
                    lineterm="",
                    n=2,
                )
                alike = "missing" if old is None else "other line endings than generated"
                found.append("\n".join(diff) or f"{label}: {alike}")
    return found
