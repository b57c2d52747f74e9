"""Evidence: ``verify``, ``coverage``, ``gates``, ``mutate``, ``fixed``, ``faults``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import esea_gen
from esea_gen.cli import options
from esea_gen.cli.app import app, out
from esea_gen.cli.groups import WholeSentences
from esea_gen.cli.options import chosen_formats, option, recorded_streams
from esea_gen.cli.output import counted, exit_unless, progress_line, show
from esea_gen.errors import UserError, choose
from esea_gen.files import plain, write_json

if TYPE_CHECKING:
    from esea_gen.device import Device

SearchOption = Annotated[
    int,
    option(
        "--search N",
        "Also search N motions for the largest torque error of rate and sensor together.",
        min=0,
    ),
]


@app.command()
def verify(
    device: options.DeviceArgument,
    real: options.RealOption = None,
    recording: options.RecordingOption = None,
    data: options.DataOption = None,
    block: options.BlockOption = None,
    controller: options.ControllerOption = None,
    search: SearchOption = 0,
    verbose: Annotated[bool, option("-v --verbose", "Show the table of all Blocks.")] = False,
    json_file: options.JsonOption = None,
) -> None:
    """Compare the generated C, compiled for this machine, with the symbolic model."""
    from esea_gen.verify.chain import search_chain
    from esea_gen.verify.equivalence import verify as compare_c

    loaded = esea_gen.load_device(device, controller)
    recorded = recorded_streams(loaded, recording, data)
    with progress_line() as say:
        formats = chosen_formats(real)
        result = compare_c(loaded, formats, recorded, progress=say, blocks=block)
        others = [f for f in formats if f != "f64"]
        chain = search_chain(loaded, others, search, say=say) if search else None
    _print_verification(loaded, result, verbose or out.verbose)
    out.lines(chain.table() if chain else [])
    passed = chain is None or chain.passed
    failed = "verdict: FAIL. A searched motion exceeds its aim."
    out.print(result.verdict() if passed else failed)
    more = {"chain": chain} if chain else {}
    content = result.to_dict() | {"passed": passed and result.passed} | more
    write_json(json_file, "verify", plain(content, null=True))  # a C at fault gives NaN
    exit_unless(content["passed"])
    out.next("emulate", device, *(("--controller", controller) if controller else ()))


def _bound_note(result: Any, block: str) -> str:
    from esea_gen.verify.verdict import EXACT_STEP, STATED

    items = [c for c in result.comparisons if c.block == block and c.real == "f32"]
    scale = result.full_scales[block]
    apart = max(
        (100 * d / scale[k] for c in items for k, d in c.drift.items() if k in scale), default=0.0
    )
    if any(c.rule == EXACT_STEP for c in items):
        return f"each step equals the executor's; a free run deviates by {apart:.2g} %, not bounded"
    stated = [c for c in items if c.rule == STATED]
    if stated:
        more = sum(c.turned for c in stated)
        return f"program: within a stated share, not derived; {more} steps set more status flags"
    residuals = [c.residual for c in result.comparisons if c.block == block and c.residual]
    if block not in result.bounds and residuals:
        worst, limit = max(residuals)
        return f"reproduces the request to {worst:.2g} Nm (limit {limit:.2g} Nm)"
    wide = result.telling_nothing(block)
    if wide:
        port, percent = max(wide.items(), key=lambda w: w[1])
        return f"tested, not proven: the bound of {port} is {percent:.2g} % of full scale"
    # How much the derived bound allows: one that allows a lot proves little, and shows as that.
    (name, bound), *_ = sorted(result.bounds[block].items())
    percent = max((100 * e / scale[k] for k, e in bound.outputs.items()), default=0.0)
    if name == "identified domain":
        rough = sum(c.beyond > 0 for c in result.comparisons if c.block == block)
        more = f"; {rough} rough streams step by step" if rough else ""
        return f"within the derived bound ({percent:.2g} % in the domain){more}"
    turned = sum(c.turned for c in items)
    return (
        f"{name}: each within the derived bound ({percent:.2g} %), {turned} decisions turned by "
        f"rounding; a free run deviates by {apart:.2g} %, not bounded"
    )


def _print_verification(loaded: Device, result: Any, every: bool) -> None:
    from rich.table import Table
    from rich.text import Text

    from esea_gen.verify.verdict import EXACT_PROGRAM

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
        if passed and not every:
            continue
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
    if table.rows:
        out.print(table)
    for c in result.comparisons:
        for problem in c.problems:
            out.print(f"{c.block} {c.real}, {c.stream}: {problem}")
        if c.status_differences or c.bit_identical is False:
            out.print(
                f"{c.block} {c.real}, {c.stream}: {c.status_differences} status differences; "
                f"bits equal to CasADi's C: {c.bit_identical}"
            )


@app.command()
def coverage(
    device: options.DeviceArgument,
    block: options.BlockOption = None,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Report which sides of each minimum, comparison and select the test streams take."""
    from esea_gen.verify.coverage import branch_coverage
    from esea_gen.verify.equivalence import chosen_blocks
    from esea_gen.verify.memories import other_memories
    from esea_gen.verify.streams import at_the_limits, streams

    loaded = esea_gen.load_device(device, controller)
    programs = [b.name for b in chosen_blocks(loaded, block) if b.kind == "program"]
    found = {
        b.name: branch_coverage(b, [*streams(b), at_the_limits(b), *other_memories(b)])
        for b in chosen_blocks(loaded, block)
        if b.name not in programs
    }
    for name, c in found.items():
        out.print(
            f"{name}: {100 * c.ratio:.1f} % of the sides, {len(c.excluded)} proven impossible"
        )
        out.lines(f"  not seen: {side}" for side in c.uncovered)
        out.lines(f"  only by an arithmetic fault, not proven: {side}" for side in c.detectors)
    out.lines(f"{n}: not measured: a program of loops; see docs/verification.md" for n in programs)
    blocks = {name: c.to_dict() for name, c in found.items()}
    write_json(json_file, "coverage", {"blocks": blocks})
    exit_unless(not any(c.uncovered for c in found.values()))


@app.command()
def gates(
    device: options.DeviceArgument,
    target: Annotated[list[str] | None, option("--target", "Target; default: all.")] = None,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Inspect the f32 object code: no double, libm, heap or writable data; stack bound."""
    from esea_gen.verify.gates import TARGETS, check_objects, find_target

    loaded = esea_gen.load_device(device, controller)
    for name in target or []:
        find_target(name)
    found = {name: check_objects(loaded, name) for name in target or TARGETS}
    for name, r in found.items():
        stacks = ", ".join(f"{task} {n} B" for task, n in r.stack_bytes.items())
        out.print(f"{name}: {'passed' if r.passed else 'FAILED'}; stack {stacks}")
        out.lines(f"  {problem}" for problem in r.problems)
    targets = {name: r.to_dict() for name, r in found.items()}
    write_json(json_file, "gates", {"targets": targets})
    exit_unless(all(r.passed for r in found.values()))


@app.command()
def mutate(
    device: options.DeviceArgument,
    real: options.RealOption = None,
    sample: Annotated[
        int | None, option("--sample", "Number of mutants, drawn at random; default: all.", min=1)
    ] = None,
    seed: options.SeedOption = 0,
    block: options.BlockOption = None,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Insert one fault at a time into kernels and wiring; report which ones the tests detect."""
    from esea_gen.verify.mutation.campaign import REQUIRED_SCORE, run_mutation

    loaded = esea_gen.load_device(device, controller)
    reports = {}
    with progress_line() as say:
        for name in chosen_formats(real):
            reports[name] = run_mutation(loaded, name, sample, seed, say, block)
    for name, r in reports.items():
        out.print(f"{name}: {100 * r.score:.1f} % of the mutants caught")
    formats = {name: r.to_dict() for name, r in reports.items()}
    write_json(json_file, "mutate", {"formats": formats})
    exit_unless(all(r.score >= REQUIRED_SCORE for r in reports.values()))


traces = typer.Typer(cls=WholeSentences, help="Golden traces of every shipped System.")


app.add_typer(traces, name="traces", no_args_is_help=True)


TraceFolder = Annotated[Path, option("--in DIR", "Folder of the traces.")]


@traces.command("check")
def traces_check(folder: TraceFolder = Path("tests/traces")) -> None:
    """Compare behaviour with the committed traces; exit 1 on a change."""
    from esea_gen.verify.traces import ACCEPT, check_traces

    changes = check_traces(folder)
    out.lines(changes)
    if changes:
        out.print(ACCEPT)
        raise typer.Exit(1)
    out.print("current")


@traces.command("accept")
def traces_accept(folder: TraceFolder = Path("tests/traces")) -> None:
    """Accept the current behaviour."""
    from esea_gen.verify.traces import accept_traces

    out.lines(accept_traces(folder))


@app.command()
def ranges(
    device: options.DeviceArgument,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
    figure: options.FigureOption = None,
) -> None:
    """Fixed point: range, format, headroom and proven error of every value, and the remedies."""
    from esea_gen.emit.fixed.report import range_report

    loaded = esea_gen.load_device(device, controller)
    with progress_line() as say:
        result = range_report(loaded.name, loaded.system, say)
    show(result, json_file, "ranges", figure=figure)


@app.command()
def fixed(
    device: options.DeviceArgument,
    minutes: Annotated[
        float, option("--minutes", "Length of the chirps in the domain.", min=1.0)
    ] = 1.0,
    recording: options.RecordingOption = None,
    data: options.DataOption = None,
    cores: Annotated[
        bool, option("--cores", "Also run on emulated Cortex-M3, M0 and M4F.")
    ] = False,
    prove: Annotated[
        bool, option("--prove", "Also run Frama-C's value analysis; lists its assumptions.")
    ] = False,
    search: SearchOption = 0,
    controller: options.ControllerOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Fixed point: bits, proven and measured errors, torque against f64, emulated cores."""
    from esea_gen.verify.fixed_report import check_fixed

    loaded = esea_gen.load_device(device, controller)
    deflections = recorded_streams(loaded, recording, data)
    with progress_line() as say:
        result = check_fixed(loaded, minutes, deflections, cores, prove, search, say)
    show(result, json_file, "fixed", passed=result.passed)


@app.command()
def faults(
    device: options.DeviceArgument,
    runs: Annotated[
        int | None,
        option(
            "--runs", "Number of faults (2000); with --table, seeds per cell and law (20).", min=1
        ),
    ] = None,
    table: Annotated[
        str,
        option(
            "--table NAME",
            "Table by person, from limp to stiff, instead: wrong but plausible encoders "
            "('encoders'), or both categories of stop ('stops').",
        ),
    ] = "",
    controller: options.ControllerOption = None,
    seed: options.SeedOption = 0,
    jobs: options.JobsOption = -1,
    resume: options.JournalOption = None,
    emulator: Annotated[
        int, option("--emulator N", "Number of runs to repeat on an emulated Cortex-M7.", min=0)
    ] = 0,
    json_file: options.JsonOption = None,
    figure: options.FigureOption = None,
) -> None:
    """Inject faults into a drive's inputs, memory, clock and link; exit 1 beyond a stated bound.

    The firmware runs on the board `sim` in lockstep with the virtual exoskeleton and a person; with
    --emulator a sample of the runs is repeated on the image of the board mps2-an500, tick by tick.
    With --table, several laws of --controller (smc,cascade) are compared.
    """
    from esea_gen.analysis.campaign import Workers
    from esea_gen.verify.faults.campaign import DEFAULT_RUNS, fault_campaign, with_emulated
    from esea_gen.verify.faults.everyone import ENCODERS, SEEDS, STOPS, people_table

    if (emulator or figure) if table else controller:
        raise UserError(
            "--table excludes --emulator and --figure; --controller requires --table.",
            f"Leave {'--emulator and --figure' if table else '--controller'} out.",
        )
    if table:
        choose("table", table, (ENCODERS, STOPS))
        with counted(f"{device}, {table}") as tell:
            made = people_table(
                device,
                table,
                controllers=controller.split(",") if controller else (),
                seeds=runs or SEEDS,
                first_seed=seed,
                workers=Workers(jobs),
                folder=resume,
                progress=tell,
            )
        show(made, json_file, "faults")
        return
    runs = runs or DEFAULT_RUNS
    with counted(f"{device}, faults") as tell:
        result = fault_campaign(
            device, runs=runs, seed=seed, workers=Workers(jobs), folder=resume, progress=tell
        )
    if emulator:
        with counted(f"{device}, in the emulator") as tell:
            result = with_emulated(result, device, runs, seed, emulator, tell)
    passed = not result.outside and all(f.same for f in result.emulated)
    show(result, json_file, "faults", figure=figure, passed=passed)
