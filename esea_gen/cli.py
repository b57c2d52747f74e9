"""``esea-gen``: the command line."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn
from rich.table import Table
from rich.text import Text

from esea_gen import __version__
from esea_gen.device import Device, load_device, shipped_devices
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
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Also write the result as JSON.")
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


def _formats(real: list[str] | None) -> list[str]:
    from esea_gen.emit.formats import FORMATS

    chosen = real or list(FORMATS)
    for name in chosen:
        if name not in FORMATS:
            raise UserError(
                f"Unknown number format '{name}'.", f"Choose from {', '.join(FORMATS)}."
            )
    return list(dict.fromkeys(chosen))


def _bundles(device: Device, real: list[str] | None) -> list[Any]:
    from esea_gen.emit.build import render_device
    from esea_gen.emit.dialect import render_dialect

    bundles = render_device(device, _formats(real))
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
    real: RealOption = None,
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
    json_file: JsonOption = None,
) -> None:
    """Compare the generated C, compiled for this machine, with the symbolic model."""
    from esea_gen.verify.equivalence import verify as run

    loaded = load_device(device)
    recorded = _recorded(loaded, recording, data)
    with progress_line() as say:
        result = run(loaded, _formats(real), recorded, progress=say)
    write_json(json_file, result.to_dict())
    _print_verification(loaded, result)
    if not result.passed:
        raise typer.Exit(1)


def _recorded(loaded: Device, recording: Path | None, data: Path | None) -> dict[str, Any]:
    if recording is None:
        return {}
    from esea_gen.identify import recorded_deflections

    return recorded_deflections(loaded, recording, data)


def _bound_note(result: Any, block: str) -> str:
    # How much the derived bound allows: one that allows a lot proves little, and shows as that.
    bound = result.bounds[block]["identified domain"].outputs
    percent = max(100 * e / result.full_scale[k] for k, e in bound.items())
    return f"within the derived bound ({percent:.2g} % in the domain)"


def _print_verification(loaded: Device, result: Any) -> None:
    title = Text(f"{loaded.title}: C against the symbolic model")
    table = Table(title=title, title_justify="left")
    for column in ("block", "format", "streams", "steps", "worst error, % of full scale", "result"):
        table.add_column(column)
    groups: dict[tuple[str, str], list[Any]] = {}
    for c in result.comparisons:
        groups.setdefault((c.block, c.real), []).append(c)
    for (block, real), items in groups.items():
        worst = max((100 * e / result.full_scale[k], k) for c in items for k, e in c.errors.items())
        passed = all(c.passed for c in items)
        note = "equal to CasADi's C bit for bit" if real == "f64" and passed else ""
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
    json_file: JsonOption = None,
) -> None:
    """Fit the torque model to a recording: device file and report."""
    from esea_gen.identify import identify as run
    from esea_gen.report.identification import identification_page

    with progress_line() as say:
        result = run(
            mapping,
            data,
            progress=lambda share, what: say(f"{100 * share:.0f} % {what}"),
        )
    target = folder or Path("identified") / result.device.name
    content = result.to_dict()
    page, text = target / f"{result.device.name}.html", identification_page(result)
    if page.is_dir():
        raise UserError(f"{page} is a folder.", "Give another --out folder.")
    path = result.write(target)
    write_text(page, text)
    write_json(json_file, content)
    for line in result.summary():
        out.print(line)
    out.print(f"device file: {path}")
    out.print(f"report: {page}")


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
    write_json(json_file, image.to_dict())
    out.print(f"{image.elf}: flash {image.flash_bytes} B, RAM {image.ram_bytes} B")


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
    json_file: JsonOption = None,
) -> None:
    """Run the firmware in an emulator and compare every bit with the host library."""
    loaded = load_device(device)
    deflections = _recorded(loaded, recording, data)
    if not deflections:
        from esea_gen.verify.equivalence import domain_chirp

        deflections = {"chirp in the domain": domain_chirp(loaded)}
    results = emulate_deflections(loaded, board, deflections)
    write_json(json_file, {"device": loaded.name, "streams": results})
    for name, r in results.items():
        same = (
            "same bits as the host's f32" if r["identical"] else f"DIFFERS {r['first_difference']}"
        )
        n = r["instructions"] or dict.fromkeys(("min", "median", "max"), "not counted")
        out.print(
            f"{name}: {r['steps']} steps, {same}; instructions per step "
            f"{n['min']}/{n['median']}/{n['max']} (min/median/max, emulated)"
        )
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
        with Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            console=err,
            transient=True,
        ) as p:
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
        Path | None, typer.Option("--out", metavar="FILE", help="The page; <device>.html.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Build, verify, emulate, measure: everything known of a device on one HTML page."""
    from esea_gen.report.device import gather

    loaded = load_device(device)
    with progress_line() as say:
        findings = gather(loaded, recording, data, board, progress=say)
    target = page or Path(f"{loaded.name}.html")
    write_text(target, findings.html())
    write_json(json_file, findings.to_dict())
    for line in findings.summary():
        out.print(line)
    out.print(f"report: {target}")
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
    from esea_gen.device import SCHEMA_FILE, copy_device

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
    from esea_gen.device import json_schema

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


@app.command()
def coverage(device: DeviceArgument, json_file: JsonOption = None) -> None:
    """Which sides of every minimum, comparison and select the test streams take."""
    from esea_gen.verify.coverage import branch_coverage
    from esea_gen.verify.streams import at_the_limits, streams

    loaded = load_device(device)
    found = {
        b.name: branch_coverage(b, [*streams(b), at_the_limits(b)]) for b in loaded.system.kinds
    }
    write_json(json_file, {name: c.to_dict() for name, c in found.items()})
    for name, c in found.items():
        out.print(
            f"{name}: {100 * c.ratio:.1f} % of the sides, {len(c.excluded)} proven impossible"
        )
        for side in c.uncovered:
            out.print(f"  not seen: {side}")
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
    write_json(json_file, {name: r.to_dict() for name, r in found.items()})
    for name, r in found.items():
        stacks = ", ".join(f"{task} {n} B" for task, n in r.stack_bytes.items())
        out.print(f"{name}: {'passed' if r.passed else 'FAILED'}; stack {stacks}")
        for problem in r.problems:
            out.print(f"  {problem}")
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
    json_file: JsonOption = None,
) -> None:
    """Change the emitted C one place at a time and see whether the tests notice."""
    from esea_gen.verify.mutation import REQUIRED_SCORE, run_mutation

    loaded = load_device(device)
    reports = {}
    with progress_line() as say:
        for name in _formats(real):
            reports[name] = run_mutation(loaded, name, sample, seed, progress=say)
    write_json(json_file, {name: r.to_dict() for name, r in reports.items()})
    for name, r in reports.items():
        out.print(f"{name}: {100 * r.score:.1f} % of the mutants caught")
    if any(r.score < REQUIRED_SCORE for r in reports.values()):
        raise typer.Exit(1)


reproduce = typer.Typer(help="Recompute published tables with the emitted C.")
app.add_typer(reproduce, name="reproduce", no_args_is_help=True)
FigureOption = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", help="Also a plot: .png, .svg or .pdf.")
]


def _show(result: Any, json_file: Path | None) -> None:
    write_json(json_file, result.to_dict())
    for line in result.table():
        out.print(line)


@reproduce.command("chapter4")
def reproduce_tables(json_file: JsonOption = None, figure: FigureOption = None) -> None:
    """Tables 4.4 and 4.5: the published inverses and the exact one, thesis beside ours."""
    from esea_gen.twin.chapter4 import reproduce_chapter4

    if figure is not None and figure.suffix not in (".png", ".svg", ".pdf"):
        raise UserError(f"{figure}: not a picture's name.", "End it in .png, .svg or .pdf.")
    with progress_line() as say:
        result = reproduce_chapter4(say)
    _show(result, json_file)
    if figure is not None:
        try:
            figure.parent.mkdir(parents=True, exist_ok=True)
            result.figure().savefig(figure)
        except OSError as error:
            raise UserError(
                f"{figure}: cannot be written ({error.strerror}).", "Give another file."
            ) from error


@reproduce.command("discretisation")
def reproduce_discretisation(json_file: JsonOption = None) -> None:
    """The sensor's discretisation: ideal encoders, and real ones with velocity filters."""
    from esea_gen.twin.discretisation import discretisation

    with progress_line() as say:
        result = discretisation(say)
    _show(result, json_file)


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
