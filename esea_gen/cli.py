"""``esea-gen``: the command line."""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
import textwrap
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn
from rich.table import Table
from rich.text import Text

from esea_gen import __version__
from esea_gen.device import Device, load_device
from esea_gen.devices.file import shipped_devices
from esea_gen.errors import UserError

app = typer.Typer(
    name="esea-gen",
    help="From a model of an elastomeric series elastic actuator to verified firmware.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
# Words as they are: no markup in a title, no wrapping of a line that somebody will copy.
out = Console(highlight=False, markup=False, soft_wrap=True)
err = Console(stderr=True, highlight=False)

DeviceArgument = Annotated[
    str, typer.Argument(metavar="DEVICE", help="Shipped device (elbow) or path of a device file.")
]


def _writable(path: Path | None) -> Path | None:
    """An output file that can be written, tried before the run whose result it is to hold.

    Nothing is left behind: folders that are missing are made when there is something to write.
    """
    if path is None:
        return None
    fix = "Give another file."
    try:
        if path.is_dir():
            raise UserError(f"{path}: is a folder.", "Name a file in it.")
        folder = path.absolute().parent
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        longest = os.pathconf(folder, "PC_NAME_MAX")
        for part in path.parts:
            if len(os.fsencode(part)) > longest:
                raise UserError(f"{path}: a name has more than {longest} bytes.", fix)
        with tempfile.TemporaryFile(dir=folder):
            pass
        # Pictures are written in place, text is put in the old file's.
        if path.exists() and not os.access(path, os.W_OK):
            raise UserError(f"{path}: cannot be written (it is write-protected).", fix)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror or error}).", fix) from error
    return path


JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json", metavar="FILE", callback=_writable, help="Also write the result as JSON."
    ),
]
BlockOption = Annotated[
    list[str] | None,
    typer.Option("--block", metavar="NAME", help="Block; all of them when not given."),
]
RealOption = Annotated[
    list[str] | None, typer.Option("--real", metavar="f64|f32", help="Number format; all of them.")
]
BoardOption = Annotated[str, typer.Option("--board", help="Board to build firmware for.")]


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Parameters
    ----------
    path : Path
        Where.
    text : str
        What.

    Raises
    ------
    UserError
        When it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
            "w", dir=path.parent, prefix=".esea-", delete=False, encoding="utf-8"
        ) as scratch:
            scratch.write(text)
        os.chmod(scratch.name, 0o644)
        try:
            Path(scratch.name).replace(path)
        except OSError:
            Path(scratch.name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror or error}).", "Give another file."
        ) from error


@contextmanager
def progress_line() -> Iterator[Callable[[str], None]]:
    """A line on the terminal that says what is being done, gone when it is."""
    columns = SpinnerColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=err, transient=True) as p:
        task = p.add_task("starting", total=None)
        yield lambda text: p.update(task, description=text)


def write_json(path: Path | None, content: Any) -> None:
    """Write a result as JSON, if a file was named.

    Parameters
    ----------
    path : Path or None
        Where.
    content : object
        JSON-ready content.
    """
    if path is not None:
        write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def _formats(real: list[str] | None, known: Collection[str] | None = None) -> list[str]:
    from esea_gen.emit.formats import FORMATS

    allowed = list(known or FORMATS)
    chosen = real or list(FORMATS)
    for name in chosen:
        if name not in allowed:
            hint = " Fixed point has its own command: esea-gen fixed." if name == "q31" else ""
            raise UserError(
                f"Unknown number format '{name}'.", f"Choose from {', '.join(allowed)}.{hint}"
            )
    return list(dict.fromkeys(chosen))


def _bundles(device: Device, real: list[str] | None) -> list[Any]:
    from esea_gen.emit.build import render_device
    from esea_gen.emit.dialect import render_dialect
    from esea_gen.emit.formats import ALL_FORMATS

    bundles = render_device(device, _formats(real, ALL_FORMATS))
    if real is None:
        bundles.append(render_dialect(device))
    return bundles


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.")
    ] = False,
) -> None:
    if version:
        out.print(f"esea-gen {__version__}")
        raise typer.Exit


@app.command()
def build(
    device: DeviceArgument,
    real: Annotated[
        list[str] | None,
        typer.Option(
            "--real", metavar="f64|f32|q31", help="Number format; f64 and f32 when not given."
        ),
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Output; generated/<device>.")
    ] = None,
) -> None:
    """Generate C for a device: one folder per number format that stands alone."""
    from esea_gen.emit.build import device_hash, write_bundles

    loaded = load_device(device)
    target = folder or Path("generated") / loaded.name
    bundles = _bundles(loaded, real)
    for path, bundle in zip(write_bundles(bundles, target), bundles, strict=True):
        size = sum(len(t) for t in bundle.files.values())
        out.print(f"{path}: {len(bundle.files)} files, {size / 1000:.0f} kB")
    out.print(f"content {device_hash(loaded)}")


@app.command()
def check(
    devices: Annotated[list[str] | None, typer.Argument(help="Devices; all shipped.")] = None,
    folder: Annotated[
        Path, typer.Option("--in", metavar="DIR", help="Folder that holds <device>/.")
    ] = Path("generated"),
) -> None:
    """Compare generated output on disk with what would be generated now; exit 1 when stale."""
    from esea_gen.emit.build import differences

    stale = 0
    for name in devices or sorted(shipped_devices()):
        loaded = load_device(name)
        found = differences(_bundles(loaded, None), folder / loaded.name)
        stale += len(found)
        for diff in found:
            lines = diff.splitlines()
            out.print("\n".join(lines[:60]))
            if len(lines) > 60:
                out.print(f"... {len(lines) - 60} more lines")
        out.print(
            f"{loaded.name}: {len(found)} stale files" if found else f"{loaded.name}: current"
        )
    if stale:
        out.print("Regenerate with: esea-gen build DEVICE")
        raise typer.Exit(1)


@app.command()
def verify(
    device: DeviceArgument,
    real: RealOption = None,
    recording: Annotated[
        Path | None,
        typer.Option("--recording", metavar="MAPPING", help="Also a recorded deflection."),
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    block: BlockOption = None,
    json_file: JsonOption = None,
) -> None:
    """Compare the generated C, compiled for this machine, with the symbolic model."""
    from esea_gen.verify.equivalence import verify as run

    loaded = load_device(device)
    recorded = _recorded(loaded, recording, data)
    with progress_line() as say:
        result = run(loaded, _formats(real), recorded, progress=say, blocks=block)
    _print_verification(loaded, result)
    write_json(json_file, result.to_dict())
    if not result.passed:
        raise typer.Exit(1)


def _recorded(loaded: Device, recording: Path | None, data: Path | None) -> dict[str, Any]:
    if recording is None:
        return {}
    from esea_gen.identify import recorded_deflections

    return recorded_deflections(loaded, recording, data)


def _bound_note(result: Any, block: str) -> str:
    from esea_gen.verify.equivalence import STATED

    stated = [c for c in result.comparisons if c.block == block and c.rule == STATED]
    if stated:
        more = sum(c.turned for c in stated)
        return f"a program: within a stated share, not derived; {more} steps say more of themselves"
    residuals = [c.residual for c in result.comparisons if c.block == block and c.residual]
    if block not in result.bounds and residuals:
        worst, limit = max(residuals)
        return f"gives the request back to {worst:.2g} Nm (limit {limit:.2g} Nm)"
    # How much the derived bound allows: one that allows a lot proves little, and shows as that.
    scale = result.full_scales[block]
    (name, bound), *_ = sorted(result.bounds[block].items())
    percent = max((100 * e / scale[k] for k, e in bound.outputs.items()), default=0.0)
    if name == "identified domain":
        return f"within the derived bound ({percent:.2g} % in the domain)"
    items = [c for c in result.comparisons if c.block == block and c.real == "f32"]
    apart = max((100 * d / scale[k] for c in items for k, d in c.drift.items() if k in scale))
    turned = sum(c.turned for c in items)
    return (
        f"{name}: each within the derived bound ({percent:.2g} %), {turned} decisions turned by "
        f"rounding; a free run comes {apart:.2g} % apart, not bounded"
    )


def _print_verification(loaded: Device, result: Any) -> None:
    from esea_gen.verify.equivalence import EXACT_PROGRAM

    title = Text(f"{loaded.title}: C against the symbolic model")
    table = Table(title=title, title_justify="left")
    for column in ("block", "format", "streams", "steps", "worst error, % of full scale", "result"):
        table.add_column(column)
    groups: dict[tuple[str, str], list[Any]] = {}
    for c in result.comparisons:
        groups.setdefault((c.block, c.real), []).append(c)
    for (block, real), items in groups.items():
        scale = result.full_scales[block]
        worst = max((100 * e / scale[k], k) for c in items for k, e in c.errors.items())
        passed = all(c.passed for c in items)
        whose = "the executor's" if items[0].rule == EXACT_PROGRAM else "CasADi's C"
        note = f"equal to {whose} bit for bit" if real == "f64" and passed else ""
        table.add_row(
            block,
            real,
            str(len(items)),
            str(sum(c.steps for c in items)),
            f"{worst[0]:.2g} ({worst[1]})",
            (note or _bound_note(result, block)) if passed else "FAILED",
        )
    out.print(table, soft_wrap=False)
    for c in result.comparisons:
        for problem in c.problems:
            out.print(f"{c.block} {c.real}, {c.stream}: {problem}")
        if c.status_differences or c.bit_identical is False:
            out.print(
                f"{c.block} {c.real}, {c.stream}: {c.status_differences} status differences; "
                f"bits equal to CasADi's C: {c.bit_identical}"
            )


@app.command()
def identify(
    mapping: Annotated[Path, typer.Argument(help="Mapping file of the recording.")],
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Output; identified/<device>.")
    ] = None,
    inverse: Annotated[
        bool, typer.Option("--inverse", help="Refit the published inverse's play operators too.")
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Fit the torque model to a recording: device file and report."""
    from esea_gen.identify import identify as run
    from esea_gen.identify.inverse import refit_identified
    from esea_gen.report.identification import identification_page

    with progress_line() as say:

        def tell(share: float, what: str) -> None:
            say(f"{100 * share:.0f} % {what}")

        result, refit = run(mapping, data, progress=tell), None
        if inverse:
            result, refit = refit_identified(result, tell)
    target = folder or Path("identified") / result.device.name
    content = result.to_dict() | ({} if refit is None else {"inverse": refit.to_dict()})
    page, text = target / f"{result.device.name}.html", identification_page(result)
    if page.is_dir():
        raise UserError(f"{page} is a folder.", "Give another --out folder.")
    path = result.write(target)
    write_text(page, text)
    for line in [*result.summary(), *(refit.summary() if refit else [])]:
        out.print(line)
    out.print(f"device file: {path}")
    out.print(f"report: {page}")
    write_json(json_file, content)


@app.command()
def firmware(
    device: DeviceArgument,
    board: BoardOption = "netduinoplus2",
    folder: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Output; build/<device>.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Compile firmware for a board and say how large it is."""
    from esea_gen.verify.firmware import build_firmware

    loaded = load_device(device)
    image = build_firmware(loaded, board, folder or Path("build") / loaded.name)
    out.print(f"{image.elf}: flash {image.flash_bytes} B, RAM {image.ram_bytes} B")
    write_json(json_file, image.to_dict())


@app.command()
def emulate(
    device: DeviceArgument,
    recording: Annotated[
        Path | None, typer.Option("--recording", metavar="MAPPING", help="A recorded deflection.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    board: BoardOption = "netduinoplus2",
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", help="Of a drive: how much of the tuning case; 3."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Run the firmware in an emulator and compare every bit with the host library.

    A sensing device is given deflections.  Of a drive all tasks run interleaved, on what they were
    given in the tuning case in closed loop with the virtual exoskeleton.
    """
    loaded = load_device(device)
    if loaded.file.sliding_mode is not None:
        if recording is not None or data is not None:
            raise UserError(
                f"{loaded.origin}: a drive is not run on a recorded deflection.",
                "Leave --recording and --data out: its inputs are recorded from the simulation.",
            )
        _emulate_drive(loaded, board, 3.0 if seconds is None else seconds, json_file)
        return
    if seconds is not None:
        raise UserError(f"{loaded.origin}: --seconds is for a drive.", "Leave it out.")
    deflections = _recorded(loaded, recording, data)
    if not deflections:
        from esea_gen.verify.equivalence import domain_chirp

        deflections = {"chirp in the domain": domain_chirp(loaded)}
    results = emulate_deflections(loaded, board, deflections)
    for name, r in results.items():
        same = (
            "same bits as the host's f32" if r["identical"] else f"DIFFERS {r['first_difference']}"
        )
        n = r["instructions"] or dict.fromkeys(("min", "median", "max"), "not counted")
        out.print(
            f"{name}: {r['steps']} steps, {same}; instructions per step "
            f"{n['min']}/{n['median']}/{n['max']} (min/median/max, emulated)"
        )
    write_json(json_file, {"device": loaded.name, "streams": results})
    if not all(r["identical"] for r in results.values()):
        raise typer.Exit(1)


def emulate_deflections(
    loaded: Device, board: str, deflections: dict[str, Any]
) -> dict[str, dict[str, Any]]:
    """Build firmware and run deflection streams on the emulated board.

    Parameters
    ----------
    loaded : Device
        The device.
    board : str
        Board.
    deflections : dict of str to ndarray
        Deflections at the sensing rate, by name.

    Returns
    -------
    dict of str to dict
        JSON-ready result of each.
    """
    from esea_gen.verify.emulator import run_in_emulator
    from esea_gen.verify.firmware import build_firmware
    from esea_gen.verify.streams import deflection_inputs

    results = {}
    with tempfile.TemporaryDirectory() as scratch:
        image = build_firmware(loaded, board, Path(scratch) / "image")
        with _bar() as p:
            for name, theta in deflections.items():
                task = p.add_task(name, total=len(theta))
                result = run_in_emulator(
                    loaded,
                    image,
                    deflection_inputs(loaded.system, theta),
                    progress=lambda done, _, t=task: p.update(t, completed=done),  # type: ignore[misc]
                )
                results[name] = result.to_dict()
    return results


def _bar() -> Progress:
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    return Progress(*columns, console=err, transient=True)


def _emulate_drive(loaded: Device, board: str, seconds: float, json_file: Path | None) -> None:
    if not (math.isfinite(seconds) and seconds >= loaded.period_s):
        raise UserError(
            f"--seconds {seconds:g} is less than a period.", "Give a number of seconds, such as 3."
        )
    results = emulate_tasks(loaded, board, round(seconds / loaded.period_s))
    content = {t: r.to_dict() for t, r in results.items()}
    table = Table("task", "runs", "bits", "instructions a run", "stack, B")
    for name, r in results.items():
        same = "the host's" if r.identical else "DIFFER"
        n = r.instructions
        count = f"{n['min']} / {n['median']} / {n['max']}" if n else "-"
        table.add_row(name, str(r.steps), same, count, str(r.step_stack_bytes))
    out.print(table)
    first = next(iter(results.values()))
    if first.instructions:
        out.print(
            "instructions: min / median / max, emulated, not cycles; "
            f"flash {first.flash_bytes} B, RAM {first.ram_bytes} B, deepest stack "
            f"{first.stack_peak_bytes} of {first.stack_bytes} B"
        )
    for r in results.values():
        if r.first_difference is not None:
            out.print(f"{r.task}: {r.first_difference}")
    write_json(json_file, {"device": loaded.name, "case": "tuning", "tasks": content})
    if not all(r.identical for r in results.values()):
        raise typer.Exit(1)


def emulate_tasks(loaded: Device, board: str, ticks: int) -> dict[str, Any]:
    """Build firmware and run a drive's tasks on the emulated board, inputs as in closed loop.

    Parameters
    ----------
    loaded : Device
        A device with a drive.
    board : str
        Board.
    ticks : int
        How many milliseconds of the tuning case.

    Returns
    -------
    dict of str to EmulatorResult
        By task.
    """
    from esea_gen.bench.recorded import record_drive
    from esea_gen.verify.emulator import run_tasks_in_emulator
    from esea_gen.verify.firmware import build_firmware, find_board

    find_board(board)
    with _bar() as p, tempfile.TemporaryDirectory() as scratch:
        bar = p.add_task("recording the tuning case", total=None)
        inputs = record_drive(loaded, ticks).inputs
        p.update(bar, description="building firmware")
        image = build_firmware(loaded, board, Path(scratch) / "image")

        def told(done: int, runs: int) -> None:
            p.update(bar, description="tuning case", completed=done, total=runs)

        return run_tasks_in_emulator(loaded, image, inputs, progress=told)


@app.command()
def report(
    device: DeviceArgument,
    recording: Annotated[
        Path | None, typer.Option("--recording", metavar="MAPPING", help="A recording to run.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    board: BoardOption = "netduinoplus2",
    page: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", callback=_writable, help="The page; <device>.html."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Build, verify, emulate, measure: everything known of a device on one HTML page."""
    from esea_gen.report.device import gather
    from esea_gen.report.drive import gather_drive

    loaded = load_device(device)
    has_drive = loaded.file.sliding_mode is not None
    if has_drive and (recording is not None or data is not None):
        raise UserError(
            f"{loaded.name} has a drive: its page is of closed-loop runs and takes no recording.",
            "Leave --recording and --data out, or report on the device that it extends.",
        )
    with progress_line() as say:
        findings = (
            gather_drive(loaded, board, progress=say)
            if has_drive
            else gather(loaded, recording, data, board, progress=say)
        )
    target = page or Path(f"{loaded.name}.html")
    for line in findings.summary():
        out.print(line)
    write_text(target, findings.html())
    out.print(f"report: {target}")
    write_json(json_file, findings.to_dict())
    if not findings.passed:
        raise typer.Exit(1)


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the new device.")],
    base: Annotated[
        str, typer.Option("--from", metavar="DEVICE", help="Device whose numbers to start from.")
    ] = "elbow",
    target: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The file; NAME.toml.")
    ] = None,
) -> None:
    """Write a commented device file to edit; its numbers are copied, each marked as assumed."""
    from esea_gen.device import copy_device
    from esea_gen.devices.fields import SCHEMA_FILE

    device = copy_device(load_device(base), name)
    path = target or Path(f"{name}.toml")
    beside = path.parent / SCHEMA_FILE
    if path.exists():
        raise UserError(f"{path} exists already.", "Give another file with --out, or move it away.")
    fresh = not beside.exists()
    if fresh:
        write_text(beside, _schema_text())
    # The first line tells editors where the schema is.
    write_text(path, f"#:schema ./{SCHEMA_FILE}\n{device.toml()}")
    out.print(f"device file: {path}")
    out.print(f"schema for editors: {beside}{'' if fresh else ' (was there, left as it is)'}")
    out.print(f"Edit the numbers, their status and source, then: esea-gen build {path}")


def _schema_text() -> str:
    from esea_gen.devices.file import json_schema

    return json.dumps(json_schema(), indent=2) + "\n"


@app.command()
def schema(
    target: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write it there.")
    ] = None,
) -> None:
    """Print the JSON schema of device files, for completion in editors."""
    text = _schema_text()
    if target is None:
        print(text, end="")
    else:
        write_text(target, text)


def _no_programs(loaded: Device, what: str) -> None:
    from esea_gen.verify.equivalence import is_program

    for block in loaded.system.kinds:
        if is_program(block):
            raise UserError(
                f"{loaded.origin}: {block.name} is a program of loops; {what} reads straight-line "
                "Blocks.",
                "verify and gates take it; give the device that it extends for the other Blocks.",
            )


@app.command()
def coverage(
    device: DeviceArgument, block: BlockOption = None, json_file: JsonOption = None
) -> None:
    """Which sides of every minimum, comparison and select the test streams take."""
    from esea_gen.verify.coverage import branch_coverage
    from esea_gen.verify.equivalence import chosen_blocks, is_program
    from esea_gen.verify.streams import at_the_limits, other_memories, streams

    loaded = load_device(device)
    programs = [b.name for b in chosen_blocks(loaded, block) if is_program(b)]
    found = {
        b.name: branch_coverage(b, [*streams(b), at_the_limits(b), *other_memories(b)])
        for b in chosen_blocks(loaded, block)
        if b.name not in programs
    }
    for name, c in found.items():
        out.print(
            f"{name}: {100 * c.ratio:.1f} % of the sides, {len(c.excluded)} proven impossible"
        )
        for side in c.uncovered:
            out.print(f"  not seen: {side}")
        for side in c.detectors:
            out.print(f"  only by a fault of the arithmetic, not proven: {side}")
    for name in programs:
        out.print(f"{name}: not measured: a program of loops; see docs/verification.md")
    write_json(json_file, {name: c.to_dict() for name, c in found.items()})
    if any(c.uncovered for c in found.values()):
        raise typer.Exit(1)


@app.command()
def gates(
    device: DeviceArgument,
    target: Annotated[
        list[str] | None, typer.Option("--target", help="Target; all of them when not given.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Inspect the f32 object code: no double, libm, heap, writable data; stack bound."""
    from esea_gen.verify.gates import TARGETS, check_objects

    loaded = load_device(device)
    for name in target or []:
        if name not in TARGETS:
            raise UserError(f"Unknown target '{name}'.", f"Choose from {', '.join(TARGETS)}.")
    found = {name: check_objects(loaded, name) for name in target or TARGETS}
    for name, r in found.items():
        stacks = ", ".join(f"{task} {n} B" for task, n in r.stack_bytes.items())
        out.print(f"{name}: {'passed' if r.passed else 'FAILED'}; stack {stacks}")
        for problem in r.problems:
            out.print(f"  {problem}")
    write_json(json_file, {name: r.to_dict() for name, r in found.items()})
    if not all(r.passed for r in found.values()):
        raise typer.Exit(1)


@app.command()
def mutate(
    device: DeviceArgument,
    real: RealOption = None,
    sample: Annotated[
        int | None, typer.Option("--sample", min=1, help="So many mutants, drawn; else all.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the draw.")] = 0,
    block: BlockOption = None,
    json_file: JsonOption = None,
) -> None:
    """Change the emitted C one place at a time and see whether the tests notice."""
    from esea_gen.verify.mutation import REQUIRED_SCORE, run_mutation

    loaded = load_device(device)
    _no_programs(loaded, "mutation")
    reports = {}
    with progress_line() as say:
        for name in _formats(real):
            reports[name] = run_mutation(loaded, name, sample, seed, say, block)
    for name, r in reports.items():
        out.print(f"{name}: {100 * r.score:.1f} % of the mutants caught")
    write_json(json_file, {name: r.to_dict() for name, r in reports.items()})
    if any(r.score < REQUIRED_SCORE for r in reports.values()):
        raise typer.Exit(1)


reproduce = typer.Typer(help="Recompute published tables with the emitted C.")
app.add_typer(reproduce, name="reproduce", no_args_is_help=True)


def _jobs(value: int) -> int:
    if value < 1 and value != -1:
        raise UserError(f"--jobs {value}: no number of processes.", "Give 1 or more, or -1.")
    return value


JobsOption = Annotated[
    int, typer.Option("--jobs", callback=_jobs, help="Processes; -1 for one a core.")
]


def _picture_file(figure: Path | None) -> Path | None:
    if figure is not None and figure.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise UserError(f"{figure}: not a picture's name.", "End it in .png, .svg or .pdf.")
    return _writable(figure)


FigureOption = Annotated[
    Path | None,
    typer.Option(
        "--figure",
        metavar="FILE",
        callback=_picture_file,
        help="Also a plot: .png, .svg or .pdf.",
    ),
]


def _show(result: Any, json_file: Path | None) -> None:
    # The table first: it is there whatever becomes of the file.
    for line in result.table():
        out.print(line)
    write_json(json_file, result.to_dict())


def _picture(figure: Path | None, draw: Callable[[], Any]) -> None:
    from esea_gen.twin.plots import save

    if figure is None:
        return
    try:
        figure.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{figure}: cannot be written ({error.strerror}).", "Give another file."
        ) from error
    save(draw(), figure)


@reproduce.command("chapter3")
def reproduce_forward(json_file: JsonOption = None, figure: FigureOption = None) -> None:
    """The forward model's published behaviour: torque range, loops, relaxation."""
    from esea_gen.twin.chapter3 import reproduce_chapter3

    with progress_line() as say:
        result = reproduce_chapter3(say)
    _show(result, json_file)
    _picture(figure, result.figure)


@reproduce.command("chapter4")
def reproduce_tables(json_file: JsonOption = None, figure: FigureOption = None) -> None:
    """Tables 4.4 and 4.5: the published inverses and the exact one; the forward model's figures."""
    from esea_gen.twin.chapter3 import reproduce_chapter3
    from esea_gen.twin.chapter4 import reproduce_chapter4

    with progress_line() as say:
        result = reproduce_chapter4(say)
        forward = reproduce_chapter3(say)
    for line in [*result.table(), "", *forward.table()]:
        out.print(line)
    write_json(json_file, result.to_dict() | {"chapter_3": forward.to_dict()})
    _picture(figure, result.figure)


@reproduce.command("discretisation")
def reproduce_discretisation(json_file: JsonOption = None) -> None:
    """The sensor's discretisation: ideal encoders, and real ones with velocity filters."""
    from esea_gen.twin.discretisation import discretisation

    with progress_line() as say:
        result = discretisation(say)
    _show(result, json_file)


@app.command()
def uncertainty(
    device: DeviceArgument,
    runs: Annotated[int, typer.Option("--runs", help="Runs of the Monte-Carlo.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of its draws.")] = 1,
    residual_deg: Annotated[
        float,
        typer.Option("--residual-deg", help="Nonlinearity that the encoders' correction leaves."),
    ] = 0.1,
    recording: Annotated[
        Path | None,
        typer.Option("--recording", metavar="MAPPING", help="What the device was identified with."),
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """How far the sensed torque may be off, by source, torque and rate: Monte-Carlo on the C."""
    from esea_gen.twin.uncertainty import identified_spread, torque_uncertainty

    loaded = load_device(device)
    with progress_line() as say:
        say("covariance of the identification")
        spread = identified_spread(loaded, recording, data) if recording else None
        result = torque_uncertainty(
            loaded, runs, seed, spread=spread, residual_deg=residual_deg, progress=say
        )
    _show(result, json_file)
    _picture(figure, result.figure)


@reproduce.command("bandwidth")
def reproduce_bandwidth(
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")],
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Published bandwidths and steps of a metal series elastic actuator, from its recordings."""
    from esea_gen.twin.spring_rig import check_on_data

    with progress_line() as say:
        result = check_on_data(data, say)
    _show(result, json_file)
    _picture(figure, result.figure)
    if not result.reproduced:
        raise typer.Exit(1)


@app.command()
def simulate(
    experiment: Annotated[
        str,
        typer.Argument(
            metavar="EXPERIMENT",
            help="tuning, grid, twists, backdriven, bread, impedance, step, frequency or "
            "output-impedance.",
        ),
    ],
    controller: Annotated[
        str,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="smc, smc-published, mpc, mpc-no-preview, mpc-published, "
            "mpc-published-no-preview, or a device file.",
        ),
    ] = "smc",
    plant: Annotated[
        str, typer.Option("--plant", metavar="ideal|real|random", help="Virtual exoskeleton.")
    ] = "real",
    person: Annotated[
        str | None,
        typer.Option(
            "--person",
            metavar="none|ideal|uncertain|random",
            help="Who moves the load; suits plant and experiment when not given.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the first run.")] = 0,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Runs of each case.")] = 1,
    real: Annotated[
        str, typer.Option("--real", metavar="f64|f32|q31", help="Number format of the controller.")
    ] = "f32",
    jobs: JobsOption = -1,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="DIR", help="Journal: go on where a run was cut off."),
    ] = None,
    csv_file: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", callback=_writable, help="Also every run as CSV."),
    ] = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Run an experiment of the thesis: a controller's C against the virtual exoskeleton."""
    from esea_gen.emit.formats import ALL_FORMATS
    from esea_gen.twin.experiments import EXPERIMENTS, Setting, default_person
    from esea_gen.twin.experiments import simulate as run

    if experiment not in EXPERIMENTS:
        raise UserError(
            f"Unknown experiment '{experiment}'.", f"Choose from {', '.join(EXPERIMENTS)}."
        )
    (real,) = _formats([real], ALL_FORMATS)
    who = person or default_person(experiment, plant)
    with _counted(f"{experiment}, {controller}") as tell:
        result = run(
            experiment,
            Setting(controller, plant, who, real),
            seed=seed,
            runs=runs,
            # A run takes half a second: a few are done before other processes have started.
            workers=jobs if runs * len(EXPERIMENTS[experiment].cases()) > 20 else 1,
            folder=resume,
            progress=tell,
        )
    _show(result, json_file)
    if csv_file is not None:
        write_text(csv_file, result.csv())
    _picture(figure, result.figure)


@app.command()
def passivity(
    controller: Annotated[
        str,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="smc, smc-published, mpc, mpc-no-preview, mpc-published, "
            "mpc-published-no-preview, or a device file.",
        ),
    ] = "smc",
    plant: Annotated[
        str, typer.Option("--plant", metavar="ideal|real|random", help="Virtual exoskeleton.")
    ] = "real",
    points: Annotated[
        int, typer.Option("--points", metavar="N", help="Gains along each axis.")
    ] = 9,
    push: Annotated[
        float,
        typer.Option("--push", metavar="RAD_S", help="Speed that the push gives a hand alone."),
    ] = 0.5,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the plant.")] = 0,
    sliding: Annotated[
        bool, typer.Option("--sliding/--no-sliding", help="Also the sliding condition.")
    ] = True,
    jobs: JobsOption = -1,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Passivity of the rendered impedance over its gains, with pushed hands; sliding condition."""
    from esea_gen.twin.interaction import study_interaction

    with _counted(f"passivity, {controller}") as tell:
        result = study_interaction(
            controller,
            plant,
            points=points,
            push_rad_s=push,
            seed=seed,
            sliding=sliding,
            workers=jobs,
            progress=tell,
        )
    _show(result, json_file)
    _picture(figure, result.figure)


@app.command()
def tune(
    controller: Annotated[
        str,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="smc, smc-published, mpc, mpc-no-preview, mpc-published, "
            "mpc-published-no-preview, or a device file.",
        ),
    ] = "smc",
    plant: Annotated[
        str, typer.Option("--plant", metavar="ideal|real|random", help="Virtual exoskeleton.")
    ] = "real",
    parameter: Annotated[
        str | None,
        typer.Option("--parameter", metavar="NAME", help="Tunable; the thesis' procedure without."),
    ] = None,
    values: Annotated[
        str, typer.Option("--values", metavar="A,B,C", help="Values of the parameter.")
    ] = "",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the plant.")] = 0,
    jobs: JobsOption = 1,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Sweep tunables in the tuning case: error, overshoot, roughness; choose, and say why."""
    from esea_gen.twin.tune import tune as run

    try:
        row = [float(v) for v in values.split(",")] if values.strip() else []
    except ValueError:
        raise UserError(
            f"--values {values}: not a list of numbers.", "Write them as 1,1.5,2."
        ) from None
    with _counted(f"tuning, {controller}") as tell:
        result = run(
            controller,
            plant,
            parameter=parameter,
            values=row,
            seed=seed,
            workers=jobs,
            progress=tell,
        )
    _show(result, json_file)
    _picture(figure, result.figure)
    if not all(sweep.ran for sweep in result.sweeps):
        raise typer.Exit(1)


@contextmanager
def _counted(text: str) -> Iterator[Callable[[int, int, int], None]]:
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    with Progress(*columns, console=err, transient=True) as p:
        task = p.add_task(text, total=None)
        yield lambda done, total, failed: p.update(
            task,
            completed=done,
            total=total,
            description=f"{text}, {failed} failed" if failed else text,
        )


traces = typer.Typer(help="Reference traces: how every shipped System behaves.")
app.add_typer(traces, name="traces", no_args_is_help=True)
TraceFolder = Annotated[Path, typer.Option("--in", metavar="DIR", help="Folder of the traces.")]


@traces.command("check")
def traces_check(folder: TraceFolder = Path("tests/traces")) -> None:
    """Compare behaviour with the committed traces; exit 1 on a change."""
    from esea_gen.verify.traces import ACCEPT, check_traces

    changes = check_traces(folder)
    for line in changes:
        out.print(line)
    if changes:
        out.print(ACCEPT)
        raise typer.Exit(1)
    out.print("current")


@traces.command("accept")
def traces_accept(folder: TraceFolder = Path("tests/traces")) -> None:
    """Take the present behaviour as the reference."""
    from esea_gen.verify.traces import accept_traces

    for line in accept_traces(folder):
        out.print(line)


@app.command()
def ranges(
    device: DeviceArgument, json_file: JsonOption = None, figure: FigureOption = None
) -> None:
    """Fixed point: range, format, headroom and proven error of every value, and what to do."""
    from esea_gen.emit.fixed.report import range_report

    loaded = load_device(device)
    _no_programs(loaded, "fixed point")
    with progress_line() as say:
        result = range_report(loaded.name, loaded.system, say)
    _show(result, json_file)
    _picture(figure, result.figure)


@app.command()
def fixed(
    device: DeviceArgument,
    minutes: Annotated[
        float, typer.Option("--minutes", min=1.0, help="Length of the chirps in the domain.")
    ] = 1.0,
    recording: Annotated[
        Path | None, typer.Option("--recording", metavar="MAPPING", help="A recording to run.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    cores: Annotated[
        bool, typer.Option("--cores", help="Also on emulated Cortex-M3, M0 and M4F.")
    ] = False,
    prove: Annotated[
        bool, typer.Option("--prove", help="Also Frama-C's value analysis, assumptions listed.")
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Fixed point: bits, proven and measured errors, torque against f64, emulated cores."""
    from esea_gen.verify.fixed_report import check_fixed, read_recorded

    loaded = load_device(device)
    with progress_line() as say:
        deflections = read_recorded(loaded, recording, data)
        result = check_fixed(loaded, minutes, deflections, cores, prove, say)
    _show(result, json_file)
    if not result.passed:
        raise typer.Exit(1)


@app.command("torque-check")
def torque_check(
    device: DeviceArgument,
    mass: Annotated[
        float | None, typer.Option("--mass", metavar="KG", help="Mass that is hung up.")
    ] = None,
    arm: Annotated[
        float | None, typer.Option("--arm", metavar="M", help="From the axis to where it hangs.")
    ] = None,
    angle: Annotated[
        float, typer.Option("--angle", metavar="DEG", help="Of the arm off the horizontal.")
    ] = 0.0,
    mass_uncertainty: Annotated[
        float, typer.Option("--mass-uncertainty", metavar="KG", help="Standard uncertainty.")
    ] = 0.005,
    arm_uncertainty: Annotated[
        float, typer.Option("--arm-uncertainty", metavar="M", help="Standard uncertainty.")
    ] = 0.001,
    angle_uncertainty: Annotated[
        float, typer.Option("--angle-uncertainty", metavar="DEG", help="Standard uncertainty.")
    ] = 1.0,
    recording: Annotated[
        Path | None,
        typer.Option("--recording", metavar="FILE", help="CSV: time_s, tau_Nm and perhaps step."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="FILE", help="JSON of a check to go on with."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Check the torque sensor with a hanging mass: procedure, limits, a recording's verdict."""
    from esea_gen.lab.reference import Reference
    from esea_gen.lab.torque_check import TorqueCheck, instructions
    from esea_gen.lab.torque_recording import apply_recording, read_check, read_recording

    loaded = load_device(device)
    check = None
    if resume is not None:
        if mass is not None or arm is not None:
            raise UserError(
                "--resume already knows the load.", "Leave --mass and --arm out, or start anew."
            )
        check = TorqueCheck.resumed(loaded, read_check(resume))
    elif mass is not None and arm is not None:
        check = TorqueCheck(
            loaded,
            Reference(
                mass,
                arm,
                math.radians(angle),
                mass_uncertainty,
                arm_uncertainty,
                math.radians(angle_uncertainty),
            ),
        )
    elif recording is not None or mass is not None or arm is not None:
        lacking = " and ".join(n for n, v in (("--mass", mass), ("--arm", arm)) if v is None)
        raise UserError(
            f"the reference torque is not known: {lacking} missing.", "Give mass (kg) and arm (m)."
        )
    if recording is not None:
        assert check is not None
        apply_recording(check, read_recording(recording))
    elif check is None or not check.measurements:
        for line in instructions(loaded, check):
            out.print(line)
        if check is not None:
            write_json(json_file, check.to_dict())
        return
    for line in check.report():
        out.print(line)
    write_json(json_file, check.to_dict())
    if check.verdict != "pass":
        raise typer.Exit(1)


def main() -> None:
    """Entry point: bad input becomes one paragraph and exit code 2."""
    try:
        app()
    except UserError as error:
        print(textwrap.fill(f"esea-gen: {error}", 100), file=sys.stderr)
        raise SystemExit(2) from None
    except BrokenPipeError:
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
