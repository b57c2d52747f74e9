"""The host's C compiler: shared libraries from texts, and cffi's declarations from headers."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import cffi

from esea_gen.cache import cache_folder
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.targets import EXACT_FLAGS, HOST_GCC

CFLAGS = (*EXACT_FLAGS, "-fPIC")


def find_compiler(name: str, package: str) -> str:
    """Path of a compiler; :class:`UserError` with the Debian ``package`` to install without it."""
    path = shutil.which(name)
    if path is None:
        raise UserError(
            f"The program '{name}' is not installed.",
            f"Install it with: apt-get install --no-install-recommends {package}",
        )
    return path


def run_tool(
    command: Sequence[object], folder: Path | None = None, failed: str = "", **more: Any
) -> subprocess.CompletedProcess[str]:
    """A program run to its end, and what it said; with ``failed``, an error where it fails."""
    words = [str(word) for word in command]
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, errors="replace", check=False, **more
    )
    if failed and done.returncode != 0:
        raise RuntimeError(f"{failed}:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done


def write_texts(folder: Path, files: Mapping[str, str]) -> None:
    """Write files by their relative paths."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def compile_sources(
    files: Mapping[str, str], flags: Sequence[str] = (), link: Sequence[str] = ()
) -> Path:
    """Compile C files into a shared library, once for a given content."""
    gcc = find_compiler(HOST_GCC.compiler, HOST_GCC.package)
    command = [gcc, *CFLAGS, *flags, "-shared"]
    key = hashlib.sha256("\0".join([compiler_version(gcc), *command, *link]).encode())
    for name in sorted(files):
        key.update(f"\0{name}\0{files[name]}".encode())
    target = cache_folder() / f"{key.hexdigest()[:32]}.so"
    if target.is_file():
        return target
    with tempfile.TemporaryDirectory() as scratch:
        write_texts(Path(scratch), files)
        built = Path(scratch) / "library.so"
        units = _units(files, Path(scratch))
        done = run_tool([*command, f"-I{scratch}", *units, "-o", built, *link])
        if "No space left on device" in done.stderr:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), scratch)
        if done.returncode != 0:
            raise RuntimeError(f"the generated C does not compile:\n{done.stderr}")
        write_whole(target, built.read_bytes())  # a second process sees all of it or none
    return target


@cache
def compiler_version(compiler: str) -> str:
    """First line of what a ``compiler`` says of its version; asked once a process."""
    done = run_tool([compiler, "--version"], failed=f"{compiler} --version failed")
    return done.stdout.splitlines()[0]


def _units(files: Mapping[str, str], folder: Path) -> list[str]:
    """Paths of what is compiled at once: the files of a System together, any other alone.

    To read a drive's header once for each of its Blocks takes as long as to compile them.  With
    ``-fPIC`` each function stays whole, since another may take its place: none is merged.
    """
    units: dict[str, list[str]] = {}
    for name in sorted(files):
        if name.endswith(".c") and name != "main.c":
            own = re.search(r'^#include "(\S+_real)\.h"', files[name], re.MULTILINE)
            units.setdefault(f"{own[1]}.unit.c" if own else name, []).append(name)
    joined = {u: n for u, n in units.items() if u not in files}
    write_texts(folder, {u: "".join(f'#include "{x}"\n' for x in n) for u, n in joined.items()})
    return [str(folder / unit) for unit in units]


@lru_cache(maxsize=16)
def declared(text: str) -> cffi.FFI:
    """What cffi makes of C text, types and prototypes, whose only includes are standard ones."""
    gcc = find_compiler(HOST_GCC.compiler, HOST_GCC.package)
    bare = re.sub(r"^\s*#\s*include.*$", "", text, flags=re.MULTILINE)
    command = [gcc, "-E", "-P", "-x", "c", "-std=c99", "-"]
    done = run_tool(command, failed="the header cannot be read", input=bare)
    ffi = cffi.FFI()
    ffi.cdef(done.stdout, override=True)
    return ffi
