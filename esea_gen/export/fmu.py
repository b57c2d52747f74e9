"""Functional Mock-up Units: a model's C, its binary and its description in one file.

FMI 2.0 and FMI 3.0, co-simulation.  The same model gives the same bytes.
"""

from __future__ import annotations

import hashlib
import html
import io
import json
import math
import re
import struct
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from esea_gen.emit.render import versions
from esea_gen.errors import UserError, from_extra
from esea_gen.export.model import ExportedModel
from esea_gen.files import read_whole, template_folder
from esea_gen.hostlib.compiler import compile_sources
from esea_gen.targets import PLATFORMS, Platform, this_platform

Version = Literal["2", "3"]
MANIFEST = "extra/org.esea-gen/manifest.json"
DESCRIPTION = "modelDescription.xml"
# Only what FMI names is seen from outside; no table of symbols, which would name scratch files.
_FLAGS = ("-O2", "-fvisibility=hidden", "-s")
# In a library of its own every function has its plain name.
_PLAIN = "-DFMI3_OVERRIDE_FUNCTION_PREFIX"
MOST_BYTES = 1 << 26  # of what is checked, unpacked
_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip file can hold: no date in the bytes


# Exponents of kg, m, s, rad, K; hertz, bits and counts have no dimension of their own here.
_BASE: dict[str, dict[str, int]] = {
    "rad": {"rad": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "Hz": {"s": -1},
    "Nm": {"kg": 1, "m": 2, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "bit": {},
    "K": {"K": 1},
    "degC": {"K": 1},
    "1": {},
}
DEGREES = {"rad": "deg", "rad/s": "deg/s"}
"""Units that people read in degrees, and what those are called."""
PER_RADIAN = 180 / math.pi


def exponents(unit: str) -> dict[str, int]:
    """Exponents of the SI base units of a unit as ports write it: ``Nm s/rad``, ``1/(rad s)``."""
    over, _, under = unit.partition("/")
    total: dict[str, int] = {}
    for part, sign in ((over, 1), (under.strip("()"), -1)):
        for name, power in re.findall(r"([A-Za-z]+|1)(?:\^(\d))?", part):
            for base, n in _BASE[name].items():
                total[base] = total.get(base, 0) + sign * n * int(power or 1)
    return {k: n for k, n in total.items() if n}


def _headers(fmi: Version) -> dict[str, str]:
    # The standard's own, as FMPy carries them: to compile with, and no part of an FMU.
    package = from_extra("fmpy", "fmu", "An FMU")
    folder = Path(str(package.__file__)).parent / "c-code"
    return {p.name: p.read_text(encoding="utf-8") for p in sorted(folder.glob(f"fmi{fmi}*.h"))}


def _stubs(written: str) -> list[tuple[str, str, str]]:
    # Functions that FMI 3.0 wants exported and that its own text does not define: name, arguments,
    # and the statement that uses the arguments.
    text = _headers("3")["fmi3FunctionTypes.h"]
    found = []
    for name, given in re.findall(r"typedef fmi3Status fmi3(\w+?)TYPE\s*\((.*?)\);", text, re.S):
        if f"fmi3{name}(" in written:
            continue
        arguments = " ".join(given.split())
        names = [re.sub(r"\[\]$", "", a.split()[-1]).lstrip("*") for a in arguments.split(",")]
        unused = ", ".join(f"(void){n}" for n in names if n != "instance")
        found.append((name, arguments, unused))
    return found


def sources(model: ExportedModel, fmi: Version) -> dict[str, str]:
    """C and headers of the FMU's folder ``sources``, but for the token that is made of them."""
    files = model.renderer.files()
    chosen = {name: files[name] for name in model.files}
    folder = template_folder() / "export" / "fmu"
    chosen["instance.h"] = (folder / "instance.h").read_text(encoding="utf-8")
    render = model.renderer.render
    name = f"fmi{fmi}.c"
    written = render(f"export/fmu/{name}.j2", model=model, stubs=[])
    # FMI 3.0's getters and setters come from a loop: the text is asked, not the template.
    stubs = _stubs(written) if fmi == "3" else []
    chosen[name] = render(f"export/fmu/{name}.j2", model=model, stubs=stubs)
    shown = _description(model, fmi, "")
    digest = hashlib.sha256("\0".join([*sorted(chosen.values()), shown]).encode())
    chosen["model.h"] = model_header(model, digest.hexdigest()[:32], model.command)
    if fmi == "3":
        chosen["buildDescription.xml"] = render(
            "export/fmu/buildDescription.xml.j2", model=model, c_files=_compiled(model, fmi)
        )
    return chosen


def model_header(model: ExportedModel, token: str, command: str) -> str:
    """C text that calls the model by numbers in an array."""
    _filters(model)
    given = {"model": model, "token": token, "command": command}
    return model.renderer.render("export/fmu/model.h.j2", **given)


def _filters(model: ExportedModel) -> None:
    model.renderer.env.filters |= {"xml": html.escape, "double": lambda x: repr(float(x))}


def _is_binary(name: str) -> bool:
    return name.startswith("binaries/")


def _compiled(model: ExportedModel, fmi: Version) -> list[str]:
    return [f"fmi{fmi}.c", *sorted(n for n in model.files if n.endswith(".c"))]


def _description(model: ExportedModel, fmi: Version, token: str) -> str:
    named = dict.fromkeys(["s", *(v.unit for v in model.variables if v.unit != "1")])
    units = {name: exponents(name) for name in named}
    _filters(model)
    return model.renderer.env.get_template(f"export/fmu/description{fmi}.xml.j2").render(
        model=model,
        token=token,
        units=units,
        degrees=DEGREES,
        per_radian=PER_RADIAN,
        c_files=_compiled(model, fmi),
        version=versions()["esea-gen"],
    )


@dataclass(frozen=True)
class Fmu:
    model: ExportedModel
    fmi: Version
    files: dict[str, bytes]

    def packed(self) -> bytes:
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(self.files, key=lambda n: (n != DESCRIPTION, n)):
                entry = zipfile.ZipInfo(name, _TIME)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = (0o755 if _is_binary(name) else 0o644) << 16
                archive.writestr(entry, self.files[name])
        return stream.getvalue()


def every_platform() -> tuple[Platform, ...]:
    """All platforms if zig is installed, the only cross compiler; else none."""
    return tuple(PLATFORMS.values()) if find_spec("ziglang") else ()


def universal(binaries: Sequence[bytes]) -> bytes:
    """One Mach-O file of those of several processors, as ``lipo`` writes it; one as it is."""
    if len(binaries) == 1:
        return binaries[0]
    page = 1 << 14  # Apple's arm64 pages
    head, body = struct.pack(">II", 0xCAFEBABE, len(binaries)), b""
    for binary in binaries:
        body += bytes(-len(body) % page)
        kind = struct.unpack_from("<II", binary, 4)  # processor and subtype
        head += struct.pack(">IIIII", *kind, page + len(body), len(binary), 14)
        body += binary
    return head.ljust(page, b"\0") + body


def make_fmu(model: ExportedModel, fmi: Version = "3", platforms: Sequence[Platform] = ()) -> Fmu:
    """Render, compile and describe a model as an FMU for co-simulation.

    platforms: by zig, the same bytes anywhere; none: this computer, by what compiles here.
    """
    texts = sources(model, fmi)
    (token,) = re.findall(r'MODEL_TOKEN "(\w+)"', texts["model.h"])
    libm = ("-lm",) if model.renderer.fmt.needs_libm else ()
    given = texts | _headers(fmi), (*_FLAGS, _PLAIN)
    binaries: dict[str, list[bytes]] = {}
    for p in platforms or (this_platform(),):
        name = f"{model.identifier}{p.suffix}"
        path = f"binaries/{p.name if fmi == '3' else p.fmi2}/{name}"
        # By default macOS' linker writes the scratch folder's path into the file.
        link = (*libm, f"-Wl,-install_name,@rpath/{name}") if p.suffix == ".dylib" else libm
        built = compile_sources(*given, link, p.zig if platforms else "").read_bytes()
        binaries.setdefault(path, []).append(built)
    page = model.renderer.render("export/fmu/index.html.j2", model=model, fmi=fmi)
    files = {f"sources/{name}": text.encode() for name, text in texts.items()}
    files |= {
        DESCRIPTION: _description(model, fmi, token).encode(),
        "documentation/index.html": page.encode(),
    }
    files |= {path: universal(found) for path, found in binaries.items()}
    manifest = {
        "identifier": model.identifier,
        "content_hash": model.digest,
        "number_format": model.renderer.fmt.name,
        "fmi": fmi,
        "token": token,
        "versions": versions(),
        "files": {n: hashlib.sha256(files[n]).hexdigest() for n in sorted(files)},
    }
    files[MANIFEST] = (json.dumps(manifest, indent=2) + "\n").encode()
    return Fmu(model, fmi, files)


def check_fmu(path: Path) -> dict[str, Any]:
    """The manifest of an FMU on disk, if the file is whole and of one content."""
    fix = "Export it again: esea-gen export fmu."
    try:
        with zipfile.ZipFile(io.BytesIO(read_whole(path, "Name an .fmu file."))) as archive:
            size_bytes = sum(entry.file_size for entry in archive.infolist())
            if size_bytes > MOST_BYTES:
                raise UserError(f"{path}: more than {MOST_BYTES >> 20} MiB unpacked.", fix)
            files = {n: archive.read(n) for n in archive.namelist() if not n.endswith("/")}
    except UserError:
        raise
    except (OSError, zipfile.BadZipFile, zipfile.LargeZipFile, EOFError, RuntimeError) as error:
        raise UserError(f"{path}: damaged, or no FMU ({error}).", fix) from None
    except Exception as error:  # zlib's own, of a damaged stream
        raise UserError(f"{path}: damaged ({error}).", fix) from None
    try:
        manifest: dict[str, Any] = json.loads(files.pop(MANIFEST))
        listed, token = manifest["files"], str(manifest["token"])
    except (KeyError, ValueError, TypeError):
        raise UserError(f"{path}: not written by esea-gen (no {MANIFEST}).", fix) from None
    for name in sorted(set(listed) | set(files)):
        if name not in files:
            raise UserError(f"{path}: {name} is missing.", fix)
        if name not in listed:
            raise UserError(f"{path}: {name} was added after the export.", fix)
        if hashlib.sha256(files[name]).hexdigest() != listed[name]:
            raise UserError(f"{path}: {name} was changed after the export.", fix)
    for name, content in files.items():
        if (name == DESCRIPTION or _is_binary(name)) and token.encode() not in content:
            raise UserError(f"{path}: {name} comes from another export than the rest.", fix)
    return manifest
