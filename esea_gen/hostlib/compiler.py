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
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cffi

from esea_gen.cache import cache_folder, scratch_folder
from esea_gen.errors import UserError, from_extra
from esea_gen.files import write_whole
from esea_gen.targets import EXACT_FLAGS, HOST_GCC, Toolchain, this_platform

# The bits of -O2 in half the time; where runs are timed, -O2 follows.
CFLAGS = (*EXACT_FLAGS, "-O1", "-fPIC")


def find_compiler(name: str, package: str) -> str:
    """Path of a compiler; :class:`UserError` with the Debian ``package`` to install without it."""
    path = shutil.which(name)
    if path is None:
        raise UserError(
            f"The program '{name}' is not installed.",
            f"Install it with: apt-get install --no-install-recommends {package}",
        )
    return path


def compiler(tools: Toolchain = HOST_GCC) -> tuple[str, ...]:
    """Command of a toolchain's C compiler; for this computer gcc, else clang, else zig from pip."""
    if tools is not HOST_GCC:
        stands_in = tools.zig and find_spec("ziglang") and not shutil.which(tools.compiler)
        return zig(tools.zig) if stands_in else (find_compiler(*tools.gcc),)
    # What clang takes on Windows are another system's libraries.
    for name in ("gcc", "clang")[: 1 if os.name == "nt" else 2]:
        path = shutil.which(name)
        # macOS has a gcc that only says how to install one.
        if path is not None and _version((path,)) is not None:
            return (path,)
    if find_spec("ziglang") is None:
        raise UserError(
            "No C compiler is installed: neither gcc, clang nor zig.",
            'Install one: pip install "esea-gen[compiler]", or '
            f"apt-get install --no-install-recommends {HOST_GCC.package}",
        )
    return zig(this_platform().zig)


def zig(target: str) -> tuple[str, ...]:
    """Command of zig's C compiler for a target, by zig's name."""
    package = from_extra("ziglang", "compiler", "Compiling for other platforms")
    # What it makes of libraries is kept; what it makes of ours is kept by us.
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / "zig"))
    os.environ.setdefault("ZIG_LOCAL_CACHE_DIR", scratch_folder())
    program = Path(str(package.__file__)).parent / "zig"
    # No -target would be this very processor, and its code runs on no older one.
    return str(program), "cc", "-target", target, "-fno-sanitize=undefined"


def run_tool(
    command: Sequence[object], folder: Path | None = None, failed: str = "", **more: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end and return its output; with ``failed``, raise if it fails."""
    words = [str(word) for word in command]
    more |= {"env": os.environ | {"LC_ALL": "C"}}  # what is looked for in messages is English
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, errors="replace", check=False, **more
    )
    if failed and done.returncode != 0:
        raise RuntimeError(f"{failed}:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done


def write_texts(folder: Path, files: Mapping[str, str]) -> None:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def compile_sources(
    files: Mapping[str, str], flags: Sequence[str] = (), link: Sequence[str] = (), target: str = ""
) -> Path:
    """Compile C files into a shared library, once for a given content.

    target: as zig calls it; without one this computer.
    """
    cc = zig(target) if target else compiler()
    command = [*cc, *CFLAGS, *flags, "-shared"]
    key = hashlib.sha256("\0".join([compiler_version(*cc), *command, *link]).encode())
    for name in sorted(files):
        key.update(f"\0{name}\0{files[name]}".encode())
    kept = cache_folder() / f"{key.hexdigest()[:32]}.so"
    if kept.is_file():
        return kept
    with tempfile.TemporaryDirectory() as scratch:
        write_texts(Path(scratch), files)
        built = Path(scratch) / "library.so"
        units = _units(files, Path(scratch))
        done = run_tool([*command, f"-I{scratch}", *units, "-o", built, *link])
        if "No space left on device" in done.stderr:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), scratch)
        if done.returncode != 0:
            raise RuntimeError(f"the generated C does not compile:\n{done.stderr}")
        try:
            write_whole(kept, built.read_bytes())  # a second process sees all of it or none
        except UserError:  # a full disk
            kept = Path(scratch_folder()) / kept.name
            write_whole(kept, built.read_bytes())
    return kept


@cache
def _version(command: tuple[str, ...]) -> str | None:
    is_zig = command[1:2] == ("cc",)
    done = run_tool([command[0], "version"] if is_zig else [*command, "--version"])
    found = done.stdout.splitlines()[:1] if done.returncode == 0 else []
    return "".join(["zig "[: 4 * is_zig], *found]) if found else None


def compiler_version(*command: str) -> str:
    """First line of a compiler's version; asked once a process."""
    found = _version(command)
    if found is None:
        raise RuntimeError(f"{' '.join(command)} --version failed")
    return found


def is_gcc(command: tuple[str, ...]) -> bool:
    """Whether a compiler writes call graphs, and its toolchain the sizes of sections."""
    return not re.search("clang|zig", compiler_version(*command))


def _units(files: Mapping[str, str], folder: Path) -> list[str]:
    """Units of compilation: the files of a System together, any other alone.

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
    """cffi's reading of C text, types and prototypes, whose only includes are standard ones."""
    bare = re.sub(r"^\s*#\s*include.*$", "", text, flags=re.MULTILINE)
    command = [*compiler(), "-E", "-P", "-x", "c", "-std=c99", "-"]
    done = run_tool(command, failed="the header cannot be read", input=bare)
    ffi = cffi.FFI()
    ffi.cdef(done.stdout, override=True)
    return ffi
