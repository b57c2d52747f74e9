"""Device files and generated C: ``build``, ``check``, ``new``, ``schema``."""

from __future__ import annotations

import json
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import esea_gen
from esea_gen.cli import options
from esea_gen.cli.app import app, out
from esea_gen.cli.names import completing
from esea_gen.cli.options import DeviceArgument, chosen_formats, option, output_file
from esea_gen.cli.output import progress_line
from esea_gen.devices import BEST_DRIVE
from esea_gen.errors import UserError, choose
from esea_gen.files import result_schema, result_schemas, write_whole

if TYPE_CHECKING:
    from esea_gen.device import Device

GENERATED = Path("generated")


def _bundles(device: Device, real: list[str] | None, linked: bool, folder: Path) -> list[Any]:
    from esea_gen.emit.build import device_formats, render_device
    from esea_gen.emit.dialect import render_dialect
    from esea_gen.emit.formats import DEFAULT_FORMATS, FORMATS

    bundles: list[Any] = []
    for name in chosen_formats(real or device_formats(device, folder), FORMATS):
        try:
            bundles += render_device(device, [name])
        except UserError as error:
            if real or name in DEFAULT_FORMATS:
                raise
            if (folder / name).exists():  # what is there would pass for this build's
                what = f"{folder / name} is of another build, and this one has no {name}."
                raise UserError(f"{what} {error.what}", "Delete that folder.") from None
            out.print(f"left out: {name}. {error.what}")  # not every law has it
    if linked:
        bundles.append(render_dialect(device))
    return bundles


@app.command()
def build(
    device: DeviceArgument,
    real: Annotated[
        list[str] | None,
        option("--real f64|f32|q31", "Number format; default: all of the device's."),
    ] = None,
    folder: Annotated[
        Path | None, option("--out DIR", "Output folder; default: generated/<device>.")
    ] = None,
    controller: options.ControllerOption = None,
) -> None:
    """Generate C for a device: one folder per number format and one for the MAVLink dialect."""
    from esea_gen.emit.build import device_hash, write_bundles
    from esea_gen.emit.telemetry import cost_table

    linked = real is None and find_spec("pymavlink") is not None
    loaded = esea_gen.load_device(device, controller)
    target = folder or GENERATED / loaded.name
    with progress_line() as say:
        say(f"{loaded.name}: rendering; ranges of a new q31 device take some ten seconds")
        bundles = _bundles(loaded, real, linked, target)
    for path, bundle in zip(write_bundles(bundles, target), bundles, strict=True):
        size = sum(len(t) for t in bundle.files.values())
        out.print(f"{path}: {len(bundle.files)} files, {size / 1000:.0f} kB")
    out.print(f"content {device_hash(loaded)}")
    if linked:
        out.print(cost_table(loaded.system))
    elif real is None:
        out.print('no MAVLink dialect: it needs pymavlink; pip install "esea-gen[link]"')
    out.next("verify", device, *(("--controller", controller) if controller else ()))


@app.command()
def check(
    devices: Annotated[
        list[str] | None, typer.Argument(help="Devices; default: all shipped.")
    ] = None,
    folder: Annotated[Path, option("--in DIR", "Folder that holds <device>/.")] = GENERATED,
    controller: options.ControllerOption = None,
) -> None:
    """Compare generated output on disk with what would be generated now; exit 1 when stale.

    A folder that holds only its manifest is compared by the hashes in it.
    """
    from esea_gen.devices.file import shipped_devices
    from esea_gen.emit.build import differences

    if not folder.is_dir():
        raise UserError(
            f"{folder}: there is no generated output to compare with.",
            "Run this in its parent folder, give that with --in, or generate it: esea-gen build.",
        )
    stale = 0
    for name in devices or sorted(shipped_devices()):
        loaded = esea_gen.load_device(name, controller)
        if not (folder / loaded.name).is_dir():
            out.print(f"{loaded.name}: nothing generated in {folder}")
            stale += 1
            continue
        bundles = _bundles(loaded, None, True, folder / loaded.name)
        stale += _tell(loaded.name, differences(bundles, folder / loaded.name))
    if stale:
        law = f" --controller {controller}" if controller else ""
        where = "" if folder == Path("generated") else f" --out {folder}/DEVICE"
        out.print(f"Regenerate with: esea-gen build DEVICE{law}{where}")
        raise typer.Exit(1)


def _tell(name: str, found: list[str]) -> int:
    most = 60 if len(found) < 10 else 4  # of many files their names
    for diff in found:
        lines = diff.splitlines()
        out.print("\n".join(lines[:most]))
        if len(lines) > most:
            out.print(f"... {len(lines) - most} more lines")
    out.print(f"{name}: {len(found)} stale files" if found else f"{name}: current")
    return len(found)


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the new device.")],
    base: Annotated[
        str | None,
        option("--from DEVICE", f"Device to start from; default: elbow; --short: {BEST_DRIVE}."),
    ] = None,
    short: Annotated[
        bool, option("--short", "Ask for a dozen numbers of a drive; the others are scaled.")
    ] = False,
    give: Annotated[
        list[str] | None,
        option("--give KEY=VALUE", "With --short: an answer, such as gear_ratio=50; repeatable."),
    ] = None,
    motor: Annotated[
        list[str] | None,
        option("--motor", "With --short: a motor whose numbers are stored, such as moteus-c1."),
    ] = None,
    target: Annotated[Path | None, output_file("--out", "Output file; default: NAME.toml.")] = None,
) -> None:
    """Write a device file to edit: a commented copy, or with --short a dozen numbers of a drive."""
    from esea_gen.device import copy_device
    from esea_gen.devices.fields import SCHEMA_FILE
    from esea_gen.devices.file import check_new_name

    check_new_name(name)
    path = target or Path(f"{name}.toml")
    beside = path.parent / SCHEMA_FILE
    if path.exists():
        raise UserError(f"{path} exists already.", "Give another file with --out, or move it away.")
    if (give or motor) and not short:
        option_ = "--give" if give else "--motor"
        raise UserError(f"{option_} works only with --short.", "Add --short.")
    if motor and len(motor) > 1:
        raise UserError(f"--motor is given {len(motor)} times.", "Give one motor.")
    if short:
        text = _short(name, base or BEST_DRIVE, give or [], motor[0] if motor else None)
    else:
        text = copy_device(esea_gen.load_device(base or "elbow"), name).toml()
    fresh = not beside.exists()
    if fresh:
        write_whole(beside, _schema_text())
    # The first line tells editors where the schema is.
    write_whole(path, f"#:schema ./{SCHEMA_FILE}\n{text}")
    out.print(f"device file: {path}")
    out.print(f"schema for editors: {beside}{'' if fresh else ' (exists, left unchanged)'}")
    out.print(f"Edit the numbers, their status and source, then: esea-gen build {path}")
    if short:
        out.print(f"Check torque tracking: esea-gen simulate tuning --controller {path}")


def terminal() -> bool:
    """Whether somebody is there to answer."""
    return sys.stdin.isatty()


def _short(name: str, base: str, words: list[str], kit: str | None) -> str:
    from esea_gen.device import parse_device
    from esea_gen.devices import short
    from esea_gen.devices.motors import MOTORS

    if kit is not None:
        choose("motor", kit, MOTORS)
    motor = None if kit is None else MOTORS[kit]
    given = short.read_given(words)
    if motor is not None:
        motor.check(given)
        given = {key: value for key, value, _ in motor.numbers()} | given
    asked = [q for q in short.questions(motor) if q.name not in given]
    if not terminal():
        short.refuse_missing(given, motor)
    elif asked:
        print(f"{len(asked)} numbers; Enter accepts the one in brackets.")

    def repeat() -> str:  # answers that somebody typed are not lost
        rows = "".join(f" \\\n  --give {k}={v:.12g}" for k, v in given.items())
        named = "" if kit is None else f" --motor {kit}"
        again = f"esea-gen new {name} --short --from {base}{named}{rows}"
        return f"To correct a number, change it in:\n  {again}"

    for k, q in enumerate(asked, 1):
        while q.name not in given:
            print(f"\n{k} of {len(asked)}. {q}.\n   {q.why}")
            try:
                typed = input(f"   {q.name} [{q.typical:g}]: ").strip()
                given[q.name] = short.read_answer(q, typed or str(q.typical))
            except UserError as error:
                print(f"   {error}")
            except EOFError:
                raise UserError("The input ended; nothing was written.", repeat()) from None
    text = short.short_text(name, base, given, motor)
    try:
        _ = parse_device(text, f"{name}.toml").system  # what cannot be built is not written
    except UserError as error:
        if not asked:
            raise
        raise UserError(f"{error}\nNothing was written.", repeat()) from None
    return text


def _schema_text() -> str:
    from esea_gen.devices.schema import json_schema

    return json.dumps(json_schema(), indent=2) + "\n"


@app.command()
def schema(
    result: Annotated[
        str | None,
        typer.Argument(
            metavar="RESULT",
            help="Command whose JSON result is described, such as simulate; default: device files.",
            autocompletion=completing(result_schemas),
        ),
    ] = None,
    listed: Annotated[bool, option("--list", "List the names of the results.")] = False,
    target: Annotated[Path | None, output_file("--out", "Output file; default: print.")] = None,
) -> None:
    """Print a JSON schema: of device files, for completion in editors, or of a result."""
    text = _schema_text() if result is None else result_schema(result)
    text = "\n".join([*result_schemas(), ""]) if listed else text
    if target is None:
        print(text, end="")
    else:
        write_whole(target, text)
