"""The generated C as a library: CMake, Arduino and PlatformIO, Zephyr, Simulink, LabVIEW."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from esea_gen.device import Device
from esea_gen.emit.build import Bundle, build_command, format_hash, manifest, write_bundles
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.emit.walker import UnsupportedOperationError
from esea_gen.errors import UserError
from esea_gen.export.fmu import model_header
from esea_gen.export.model import controller_model
from esea_gen.portability import command_line

Text = Callable[[str], str]


@dataclass(frozen=True)
class LibraryForm:
    name: str
    templates: Mapping[str, str]  # by what they become; ``{p}`` stands for the C's prefix
    steps: tuple[str, ...]  # what to do next, a line each
    headers: str = "include/"  # folders of these; none without an example
    sources: str = "src/"
    example: str = ""
    top: str = ""  # text at the top of every C file
    arrays: bool = False  # whether it is called by arrays of numbers, as a simulator calls it


# Arduino's and PlatformIO's names of processors that a test compiles for; avr has no 64-bit double.
_ARDUINO = ("avr", "mbed_giga", "mbed_nano", "mbed_portenta", "renesas_uno", "sam", "samd", "stm32")
_PLATFORMIO = ("atmelavr", "atmelsam", "nordicnrf52", "renesas-ra", "ststm32")

FORMS = {
    f.name: f
    for f in (
        LibraryForm(
            "cmake",
            {"CMakeLists.txt": "CMakeLists.txt", "cmake/{p}Config.cmake.in": "config.cmake.in"},
            (
                "Build, try, install: cmake -S {to} -B build && cmake --build build && "
                "ctest --test-dir build && cmake --install build --prefix DIR",
                "Use: find_package({p} CONFIG REQUIRED), target_link_libraries(app PRIVATE "
                "esea::{name})",
            ),
            example="example/",
        ),
        LibraryForm(
            "arduino",
            {
                "library.properties": "library.properties",
                "library.json": "library.json",
                "keywords.txt": "keywords.txt",
                "examples/ticks/ticks.ino": "sketch.ino",
            },
            (
                "Arduino: put the folder into libraries/; File > Examples > {p} > ticks",
                "PlatformIO: put it into lib/, or name it in lib_deps as file://...",
            ),
            headers="src/",
            top="contract.txt",
        ),
        LibraryForm(
            "zephyr",
            {
                "zephyr/module.yml": "module.yml",
                "zephyr/Kconfig": "Kconfig",
                "zephyr/CMakeLists.txt": "CMakeLists.txt",
                "samples/check/CMakeLists.txt": "sample.cmake",
                "samples/check/prj.conf": "prj.conf",
                "samples/check/sample.yaml": "sample.yaml",
            },
            (
                "Try: west build -b native_sim {to}/samples/check && west build -t run",
                "Use: name the folder in ZEPHYR_EXTRA_MODULES, set CONFIG_{P}=y, include {p}.h",
            ),
            example="samples/check/src/",
        ),
        LibraryForm(
            "simulink",
            {"{p}_caller.h": "caller.h", "{p}_caller.c": "caller.c"},
            (
                "What to enter in the model's custom code settings is in {p}_caller.h",
                "Several of them, or FMI's own import block: esea-gen export fmu",
            ),
            headers="",
            sources="",
            arrays=True,
        ),
        LibraryForm(
            "labview",
            {"{p}_flat.h": "flat.h", "{p}_flat.c": "flat.c", "calls.md": "calls.md"},
            (
                "What to enter in Call Library Function nodes is in calls.md",
                "Compiled and packed for a myRIO: esea-gen firmware {again} --board myrio",
            ),
            headers="",
            sources="",
            arrays=True,
        ),
    )
}


@dataclass(frozen=True)
class WrittenLibrary:
    folder: Path
    files: dict[str, str] = field(repr=False)
    digest: str
    next_steps: tuple[str, ...]


def library_files(device: Device, form: LibraryForm, real: str = "f32") -> tuple[str, Bundle]:
    """Content hash and files of a library, in memory."""
    allowed = [n for n, f in FORMATS.items() if f.floating or not form.arrays]
    if real not in allowed:
        raise UserError(
            f"No number format '{real}' for {form.name}.", f"Choose from {', '.join(allowed)}."
        )
    digest = format_hash(device, real)
    again = build_command(device).removeprefix("esea-gen build ")
    command = f"esea-gen export {form.name} {again} --real {real}"
    # Kconfig and JSON put the title between double quotes.
    extra: dict[str, object] = {"title": device.title.replace('"', "'")}
    try:
        # The C is what `build` writes, to the byte.
        build = f"{build_command(device)} --real {real}"
        renderer = Renderer(device.system, FORMATS[real], digest, build, device.title)
        made = {n: t for n, t in renderer.folder().items() if "/" not in n}
    except UnsupportedOperationError as error:
        raise UserError(f"{device.origin}: {error.what}", error.fix) from None
    example = made.pop("main.c")
    if form.arrays:
        extra["model"] = model = controller_model(device, real)
        renderer = model.renderer
        made["model.h"] = model_header(model, digest, command)
    extra["command"], extra["c_files"] = command, sorted(n for n in made if n.endswith(".c"))
    for name, known in (("architectures", _ARDUINO), ("platforms", _PLATFORMIO)):
        extra[name] = [n for n in known if real != "f64" or "avr" not in n]

    def rendered(name: str) -> str:
        return renderer.render(f"export/{form.name}/{name}.j2", **extra)

    top = rendered(form.top) if form.top else ""
    files = {}
    for name, text in made.items():
        folder = form.headers if name.endswith(".h") else form.sources
        files[folder + name] = text if name.endswith(".h") else top + text
    if form.example:
        files[f"{form.example}main.c"] = example
    for target, template in form.templates.items():
        files[target.format(p=renderer.prefix)] = rendered(template)
    steps = "\n".join(f"- {s}" for s in _steps(form, device.name, ".", again))
    files["README.md"] = (
        f"# {renderer.prefix}\n\n{device.title}. Number format {real}, content {digest}, "
        f"MIT licence.\nWritten by `{command}`; do not edit.\n\n{steps}\n"
    )
    kind = f"export {form.name}"
    return digest, Bundle(renderer.prefix, files | manifest(device, digest, kind, command, files))


def _steps(form: LibraryForm, name: str, to: str, again: str) -> tuple[str, ...]:
    known = {"p": f"esea_{name}", "P": f"ESEA_{name.upper()}", "name": name, "to": to}
    return tuple(s.format(**known, again=again) for s in form.steps)


def write_library(
    device: Device, form: LibraryForm, real: str = "f32", folder: Path | None = None
) -> WrittenLibrary:
    """Write a library into a folder of its own, completely or not at all."""
    digest, bundle = library_files(device, form, real)
    target = folder or Path(f"{bundle.folder}_{form.name}")
    whole = target.absolute()
    write_bundles([Bundle(whole.name, bundle.files)], whole.parent)
    asked, law = device.given
    again = command_line(asked, *(("--controller", law) if law else ()))
    steps = _steps(form, device.name, command_line(str(target)), again)
    return WrittenLibrary(target, bundle.files, digest, steps)
