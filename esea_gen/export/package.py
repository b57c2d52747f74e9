"""A board with Linux: the controller as a library beside the firmware's daemon, in one package."""

from __future__ import annotations

import gzip
import io
import tarfile
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from esea_gen import __version__
from esea_gen.board.firmware import FirmwareImage
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.export.library import FORMS, library_files
from esea_gen.files import write_whole
from esea_gen.hostlib.compiler import find_compiler, run_tool, write_texts
from esea_gen.targets import CONTROL_FLAGS, SECTION_FLAGS, find_board

# Only what is declared in the header can be called.
_LIBRARY = ("-fPIC", "-fvisibility=hidden", *SECTION_FLAGS)
_LINK = ("-shared", "-Wl,--gc-sections", "-Wl,--build-id=none", "-Wl,--no-undefined", "-s")


def build_flat_library(device: Device, board: str, out: Path) -> tuple[Path, dict[str, str]]:
    """Compile a device's flat calls for a board."""
    chosen = find_board(board)
    gcc = find_compiler(*chosen.processor.toolchain.gcc)
    _, bundle = library_files(device, FORMS["labview"], chosen.real)
    target = out / f"lib{bundle.folder}.so"
    with tempfile.TemporaryDirectory(prefix="esea-flat-") as scratch:
        folder = Path(scratch)
        write_texts(folder, bundle.files)
        sources = sorted(n for n in bundle.files if n.endswith(".c"))
        flags = (*chosen.processor.flags, *CONTROL_FLAGS, *_LIBRARY)
        command = [gcc, *flags, *sources, *_LINK, f"-Wl,-soname,{target.name}", "-o", target.name]
        run_tool(command, folder, "the flat library does not build")
        write_whole(target, (folder / target.name).read_bytes())
    return target, bundle.files


def build_package(device: Device, image: FirmwareImage, out: Path) -> list[Path]:
    """Library, table of its calls, and a package of them and of the daemon."""
    board = find_board(image.board)
    if not board.package:
        raise UserError(f"{board.name} takes no packages.", "Choose a board with Linux: myrio.")
    library, files = build_flat_library(device, image.board, out)
    prefix = f"esea_{device.name}"
    name = prefix.replace("_", "-")
    share = f"/usr/share/{prefix}"
    content = {
        f"/usr/lib/{library.name}": (library.read_bytes(), 0o755),
        f"/usr/sbin/{prefix}": (image.elf.read_bytes(), 0o755),
        f"/usr/include/{prefix}_flat.h": (files[f"{prefix}_flat.h"].encode(), 0o644),
        f"{share}/calls.md": (files["calls.md"].encode(), 0o644),
    }
    control = {
        "Package": name,
        "Version": f"{__version__}-{image.content_hash}",
        "Architecture": board.package,
        "Maintainer": "esea-gen",
        "License": "MIT",
        "Section": "misc",
        "Priority": "optional",
        "Description": f"{device.title}: flat library and daemon",
    }
    package = out / f"{name}_{control['Version']}_{board.package}.ipk"
    write_whole(package, ipk(control, content))
    calls = out / "calls.md"
    write_whole(calls, files["calls.md"].encode())
    return [library, calls, package]


_MEMBERS = ("debian-binary", "control.tar.gz", "data.tar.gz")


def ipk(control: Mapping[str, str], files: Mapping[str, tuple[bytes, int]]) -> bytes:
    told = "".join(f"{name}: {value}\n" for name, value in control.items()).encode()
    parts = (b"2.0\n", _packed({"/control": (told, 0o644)}), _packed(files))
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
