"""The generated C in other tools' forms: ``export fmu``, ``cmake``, ``arduino``, ``zephyr``, ..."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import esea_gen
from esea_gen.cli import options
from esea_gen.cli.app import app, out
from esea_gen.cli.groups import WholeSentences
from esea_gen.cli.names import PEOPLE, PLANTS, complete_block
from esea_gen.cli.options import ControllerOption, DeviceArgument, SeedOption, option, output_file
from esea_gen.cli.output import progress_line
from esea_gen.errors import UserError, from_extra
from esea_gen.files import write_whole

export = typer.Typer(cls=WholeSentences, help="Export the generated C to other tools.")


app.add_typer(export, name="export", no_args_is_help=True)


FormatOption = Annotated[str, option("--real f64|f32", "Number format of the C.")]
AnyFormatOption = Annotated[str, option("--real f64|f32|q31", "Number format of the C.")]
FolderOption = Annotated[
    Path | None, option("--out DIR", "Output folder; default: named by device and tool.")
]


@export.command("fmu")
def export_fmu(
    device: DeviceArgument,
    target: Annotated[Path | None, output_file("--out", "Output file; default: NAME.fmu.")] = None,
    block: Annotated[
        str | None,
        option(
            "--block NAME",
            "One Block instead of the whole controller.",
            autocompletion=complete_block,
        ),
    ] = None,
    plant: Annotated[
        str | None,
        options.one_of("--plant", "Instead: the virtual exoskeleton (simulated).", PLANTS),
    ] = None,
    person: Annotated[
        str | None,
        options.one_of("--person", "Person in the virtual exoskeleton; default: by plant.", PEOPLE),
    ] = None,
    seed: SeedOption = 0,
    fmi: Annotated[str, option("--fmi 2|3", "FMI 2.0 or FMI 3.0.")] = "3",
    real: FormatOption = "f32",
    platforms: Annotated[
        str | None, option("--platforms all|host", "Platforms; default: all if zig is installed.")
    ] = None,
    controller: ControllerOption = None,
) -> None:
    """Write a Functional Mock-up Unit for co-simulation: sources, description, binaries.

    The whole controller of the device, or one Block of it, or the virtual exoskeleton.
    """
    from esea_gen.export.fmu import make_fmu
    from esea_gen.export.model import block_model, controller_model, twin_model

    if fmi not in ("2", "3"):
        raise UserError(f"--fmi {fmi}: unsupported version.", "Give 2 or 3.")
    every = _platforms(platforms)
    if block is not None and plant is not None:
        raise UserError("--block and --plant ask for two FMUs.", "Give one of them.")
    if plant is None and (person or seed):
        raise UserError("--person and --seed need --plant.", "Add --plant or leave them out.")
    loaded = esea_gen.load_device(device, controller)
    with progress_line() as say:
        say(f"{loaded.name}: rendering and compiling")
        if plant is not None:
            from esea_gen.twin.run import plant_variant

            if loaded.drive is None:
                raise UserError(
                    f"{loaded.name} has no drive, so it has no virtual exoskeleton.",
                    "Give a device with one, such as elbow_drive.",
                )
            suits = {"ideal": "ideal", "random": "random"}.get(plant, "uncertain")
            variant = plant_variant(loaded, plant, person or suits, seed)
            tick_s = loaded.system.base_period_s
            model = twin_model(variant, tick_s, loaded.title, loaded.digest)
        elif block is not None:
            model = block_model(loaded, block, real)
        else:
            model = controller_model(loaded, real)
        made = make_fmu(model, "2" if fmi == "2" else "3", every)
    path = target or Path(f"{model.identifier}.fmu")
    write_whole(path, made.packed())
    inputs, tunables, outputs = (len(model.of(r)) for r in ("input", "tunable", "output"))
    out.print(f"{path}: {model.title}; FMI {fmi}.0, {model.renderer.fmt.name}")
    out.print(f"{inputs} inputs, {tunables} tunables, {outputs} outputs; tick {model.tick_s:g} s")
    binaries = ", ".join(sorted(n.split("/")[1] for n in made.files if n.startswith("binaries/")))
    out.print(f"binaries: {binaries}; {path.stat().st_size / 1e3:.0f} kB\ncontent {model.digest}")
    out.next("export", "check", str(path))


def _platforms(asked: str | None) -> Any:
    from esea_gen.export.fmu import every_platform

    if asked not in (None, "all", "host"):
        raise UserError(f"--platforms {asked}: unknown choice.", "Give all or host.")
    every = () if asked == "host" else every_platform()
    if asked == "all" and not every:
        from_extra("ziglang", "compiler", "Compiling for other platforms")
    return every


@export.command("check")
def export_check(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="FMU exported by esea-gen.")],
) -> None:
    """Check that an FMU is intact: complete, unchanged, and from one export."""
    from esea_gen.export.fmu import check_fmu

    found = check_fmu(path)
    out.print(
        f"{path}: intact; FMI {found['fmi']}.0, {found['number_format']}, {found['identifier']}"
    )
    out.print(f"content {found['content_hash']}")


def _library(kind: str, text: str) -> None:
    # One command a form: they differ in what is written, not in how they are asked.
    def run(
        device: DeviceArgument,
        folder: FolderOption = None,
        real: AnyFormatOption = "f32",
        controller: ControllerOption = None,
    ) -> None:
        from esea_gen.export.library import FORMS, write_library

        loaded = esea_gen.load_device(device, controller)
        with progress_line() as say:
            say(f"{loaded.name}: rendering")
            written = write_library(loaded, FORMS[kind], real, folder)
        out.print(f"{written.folder}: {len(written.files)} files, content {written.digest}")
        out.lines(written.next_steps)

    run.__doc__ = text
    export.command(kind)(run)


_library("cmake", "Write a CMake package: builds with one line, found by find_package.")
_library("arduino", "Write a library for Arduino and PlatformIO, with an example sketch.")
_library("zephyr", "Write a Zephyr module: a library behind a Kconfig switch.")
_library("simulink", "Write a C Caller's header and source for Simulink.")
_library("labview", "Write flat C calls, and their table, for LabVIEW's Call Library Function.")
