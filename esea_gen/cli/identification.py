"""From recordings: ``identify``, ``advise``, ``reliability``, ``uncertainty``, ``torque-check``."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import esea_gen
from esea_gen.cli import options
from esea_gen.cli.app import app, out
from esea_gen.cli.options import folder_to_be, option, output_file
from esea_gen.cli.output import exit_unless, picture, progress_line, progress_share, show
from esea_gen.errors import UserError, choose
from esea_gen.files import plain, read_json, refuse_copies, write_json, write_whole

if TYPE_CHECKING:
    from esea_gen.identify.family.compare import ModelComparison
    from esea_gen.identify.published.search_problem import PresentBest, Searching

CHOSEN = "chosen"
FORMS = CHOSEN, "published"
LEAST_BETWEEN_S = 2.0  # two drawings of a search

SearchOption = Annotated[
    str,
    option(
        "--search NAME",
        "How the published model's shape is searched: multi-start, evolution (SciPy's), or "
        "thesis (as large as in the thesis, then an interior point method).",
    ),
]
ResumeOption = Annotated[
    Path | None,
    output_file("--resume", "Store the search in FILE; the same command continues from there."),
]
DrawOption = Annotated[
    Path | None,
    output_file(
        "--draw",
        "Picture of the published form's search on the training files, updated as it goes; a "
        "chosen member is in the report.",
    ),
]


@app.command()
def identify(
    context: typer.Context,
    mapping: options.MappingArgument,
    data: options.DataOption = None,
    folder: Annotated[
        Path | None,
        option("--out DIR", "Output folder; default: identified/<device>.", callback=folder_to_be),
    ] = None,
    inverse: Annotated[
        bool, option("--inverse", "Refit the published inverse's play operators too.")
    ] = False,
    model: Annotated[
        str,
        option(
            "--model NAME",
            "Torque model: chosen (by held-out error), published, or a member of the family, as "
            '"slips, worn".',
        ),
    ] = CHOSEN,
    compare: Annotated[
        bool,
        option(
            "--compare",
            "Only compare models, including two from the literature; with --out, write the "
            "chosen model's device file.",
        ),
    ] = False,
    search: SearchOption = "multi-start",
    resume: ResumeOption = None,
    draw: DrawOption = None,
    jobs: options.JobsOption = -1,
    json_file: options.JsonOption = None,
) -> None:
    """Fit the torque model to a recording: device file and report.

    For a recording without a mapping (FILE.csv), propose one and write it beside the file.
    """
    if mapping.suffix.lower() != ".toml" and mapping.is_file():
        for p in context.command.params:
            source = context.get_parameter_source(p.name or "")
            if p.name != "mapping" and source is not None and source.name == "COMMANDLINE":
                raise UserError(
                    f"{p.opts[0]}: '{mapping}' is a recording, not a mapping file.",
                    "Leave it out: the mapping is proposed first.",
                )
        _propose(mapping)
        return
    how = _searching(search, jobs, resume, draw)
    if model not in FORMS and (search, resume, draw) != ("multi-start", None, None):
        raise UserError(
            f"The model '{model}' needs no search: its weights are solved.",
            "Leave --search, --resume and --draw out.",
        )
    if compare and (inverse or model != CHOSEN):
        given = "--inverse" if inverse else "--model"
        raise UserError(
            f"--compare chooses the model itself and takes no {given}.", f"Leave {given} out."
        )
    if inverse and model not in FORMS:
        raise UserError(
            f"--inverse refits the inverse of the published model, not of '{model}'.",
            "Leave it out: a member of the family has an exact inverse of its own.",
        )
    if not compare:
        _identify_model(mapping, data, folder, model, inverse, json_file, how)
        return
    compared = _compare_models(mapping, data, json_file, how)
    if folder is not None:
        _identify_model(mapping, data, folder, CHOSEN, False, None, how, compared)


def _propose(recording: Path) -> None:
    from esea_gen.identify.recording.proposal import propose_mapping

    proposal, path = propose_mapping(recording), recording.with_suffix(".toml")
    proposal.write(path)
    out.lines(proposal.lines)
    out.print(f"proposed mapping: {path}. Check every line.")
    out.lines(f"to fill in: {m}" for m in proposal.missing)
    if proposal.missing:
        out.print("Fill these in first.")
    out.next("identify", str(path))


def _searching(method: str, jobs: int, resume: Path | None, draw: Path | None) -> Searching:
    from esea_gen.identify.published.fit import search_named
    from esea_gen.identify.published.search_problem import Searching

    search_named(method)
    return Searching(method, jobs, resume, None if draw is None else _Drawing(draw).seen)


class _Drawing:
    """The best so far in a file, at most every other second; the last of a run always."""

    def __init__(self, path: Path) -> None:
        self.path, self.drawn_s = path, -math.inf

    def seen(self, best: PresentBest, last: bool) -> None:
        from esea_gen.report.figures import search_picture

        if last or time.monotonic() - self.drawn_s > LEAST_BETWEEN_S:
            picture(self.path, lambda: search_picture(best))
            self.drawn_s = time.monotonic()


def _identify_model(
    mapping: Path,
    data: Path | None,
    folder: Path | None,
    model: str,
    inverse: bool,
    json_file: Path | None,
    how: Searching,
    compared: ModelComparison | None = None,
) -> None:
    from esea_gen.identify import identify as identify_published
    from esea_gen.identify.family.compare import identify_chosen
    from esea_gen.identify.identified import Identified
    from esea_gen.identify.inverse import refit_identified
    from esea_gen.report.identification import identification_page

    with progress_share() as tell:
        result: Identified
        refit = None
        if inverse:
            result, refit = refit_identified(identify_published(mapping, data, tell, how), tell)
        else:
            result, compared = identify_chosen(mapping, data, tell, how, model, compared)
    target = folder or Path("identified") / result.device.name
    content = result.to_dict() | ({} if refit is None else {"inverse": refit.to_dict()})
    if compared is not None:
        content["choice"] = compared.choice.to_dict() | {"compare": plain(compared.rows)}
    page, text = target / f"{result.device.name}.html", identification_page(result)
    # First what was computed: a device file that was edited by hand is not replaced.
    out.lines([*result.summary(), *(refit.summary() if refit else [])])
    write_json(json_file, "identify", content)
    path = result.write(target)
    write_whole(page, text)
    write_json(path.with_suffix(".json"), "identify", content)
    out.print(f"device file: {path}")
    out.print(f"report: {page}")
    out.next("build", str(path))


def _compare_models(
    mapping: Path, data: Path | None, json_file: Path | None, how: Searching
) -> ModelComparison:
    from esea_gen.identify.family.compare import compare

    with progress_share() as tell:
        result = compare(mapping, data, tell, how=how)
    show(result, json_file, "identify-compare")
    return result


@app.command()
def advise(
    mapping: options.MappingArgument,
    data: options.DataOption = None,
    minutes: Annotated[
        float, option("--minutes", "Longest total duration of the motions.", min=0.1)
    ] = 10.0,
    folder: Annotated[
        Path | None,
        option("--out DIR", "Folder for the motions: time, deflection.", callback=folder_to_be),
    ] = None,
    json_file: options.JsonOption = None,
) -> None:
    """Propose motions that reduce the uncertainty of the published model's parameters most."""
    from esea_gen.identify import identify as identify_published
    from esea_gen.identify.next_experiment import advise as advised

    with progress_share() as tell:
        result = identify_published(mapping, data, tell)
        found = advised(result, minutes)
    show(found, json_file, "advise", simulated=any(r.simulated for r in result.recordings))
    for number, (_, motion) in enumerate(found.motions if folder else (), 1):
        rows = (f"{t:.2f},{x:.6f}" for t, x in zip(*motion.deflection(), strict=True))
        path = (folder or Path()) / f"{number}-{motion.kind}.csv"
        write_whole(path, "\n".join(["time_s,theta_rad", *rows]) + "\n")
        out.print(f"motion: {path}")


@app.command()
def reliability(
    table: Annotated[
        Path,
        typer.Argument(
            help="CSV: one column per specimen, one row per condition, torques in Nm. Or a mapping "
            "file (.toml) whose conditions are specimens: one model is fitted to all, and to each."
        ),
    ],
    data: options.DataOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Agreement of specimens: ICC(2,1), ICC(3,1), limits of agreement; a joint fit."""
    from esea_gen.identify import reliability as specimens

    if table.suffix == ".toml":
        with progress_share() as tell:
            joint = specimens.joint_fit(table, data, tell)
        show(joint, json_file, "reliability")
        return
    if data is not None:
        raise UserError("--data goes with a mapping file (.toml).", "Leave it out.")
    read, torques = specimens.read_specimens(table)
    out.print(read.report())
    show(specimens.reliability(torques), json_file, "reliability", simulated=read.simulated)


@app.command()
def uncertainty(
    device: options.DeviceArgument,
    runs: Annotated[int, option("--runs", "Monte Carlo runs.", min=2, max=100_000)] = 100,
    seed: options.SeedOption = 1,
    residual_deg: Annotated[
        float,
        option("--residual-deg", "Encoder nonlinearity after correction, degrees.", min=0, max=5),
    ] = 0.1,
    recording: options.RecordingOption = None,
    data: options.DataOption = None,
    json_file: options.JsonOption = None,
    figure: options.FigureOption = None,
) -> None:
    """Uncertainty of the measured torque by source, torque and rate: Monte Carlo on the C."""
    from esea_gen.studies.uncertainty.motions import identified_spread
    from esea_gen.studies.uncertainty.study import torque_uncertainty

    data = options.of_recording(data, recording)
    loaded = esea_gen.load_device(device)
    with progress_line() as say:
        say("covariance of the identification")
        spread = identified_spread(loaded, recording, data) if recording else None
        result = torque_uncertainty(
            loaded, runs, seed, spread=spread, residual_deg=residual_deg, progress=say
        )
    show(result, json_file, "uncertainty", figure=figure, simulated=True)


@app.command("torque-check")
def torque_check(
    device: options.DeviceArgument,
    mass: Annotated[float | None, option("--mass KG", "Mass on the arm.")] = None,
    arm: Annotated[
        float | None, option("--arm M", "Distance from the joint axis to the mass.")
    ] = None,
    angle: Annotated[
        float | None, option("--angle DEG", "Angle of the arm to the horizontal; default: 0.")
    ] = None,
    mass_uncertainty: Annotated[
        float | None, option("--mass-uncertainty KG", "Standard uncertainty; default: 0.005.")
    ] = None,
    arm_uncertainty: Annotated[
        float | None, option("--arm-uncertainty M", "Standard uncertainty; default: 0.001.")
    ] = None,
    angle_uncertainty: Annotated[
        float | None, option("--angle-uncertainty DEG", "Standard uncertainty; default: 1.")
    ] = None,
    recording: Annotated[
        Path | None, option("--recording FILE", "CSV: time_s, tau_Nm, optionally step.")
    ] = None,
    resume: Annotated[
        Path | None, option("--resume JSON", "Continue the check in the file that --json wrote.")
    ] = None,
    json_file: options.JsonOption = None,
) -> None:
    """Check the torque sensor with a hanging mass: procedure, limits, a recording's verdict."""
    from esea_gen.studies.torque_check.check import TorqueCheck, instructions
    from esea_gen.studies.torque_check.procedure import KnownLoad
    from esea_gen.studies.torque_check.recording import apply_recording, read_recording

    loaded = esea_gen.load_device(device)
    check = None
    lengths = {"mass_kg": mass, "arm_m": arm}
    lengths |= {"u_mass_kg": mass_uncertainty, "u_arm_m": arm_uncertainty}
    angles = {"angle_rad": angle, "u_angle_rad": angle_uncertainty}
    load = {k: v for k, v in lengths.items() if v is not None}
    load |= {k: math.radians(v) for k, v in angles.items() if v is not None}
    if resume is not None:
        if load:
            raise UserError(
                "--resume takes the load from its file.",
                "Leave --mass, --arm, --angle and their uncertainties out, or start again.",
            )
        check = TorqueCheck.resumed(loaded, read_json(resume, "Give the file that --json wrote."))
    elif mass is not None and arm is not None:
        check = TorqueCheck(loaded, KnownLoad(**load))
    elif recording is not None or json_file is not None or load:
        lacking = " and ".join(n for n, v in (("--mass", mass), ("--arm", arm)) if v is None)
        raise UserError(f"the load is not known: {lacking} missing.", "Give mass (kg) and arm (m).")
    if recording is not None:
        assert check is not None
        read = read_recording(recording)
        out.print(read.read_as)
        apply_recording(check, read)
    begun = check is not None and bool(check.measurements)
    out.lines(check.report() if check and begun else instructions(loaded, check))
    if check is not None:
        write_json(json_file, "torque-check", check.to_dict())
        exit_unless(not begun or check.verdict == "pass")


@app.command()
def friction(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="One run per speed: exports of EPOS Studio, or CSV with omega_rad_s and "
            "tau_Nm at the motor shaft. A folder: all its .csv.",
        ),
    ],
    full: Annotated[
        float | None, option("--full-Nm", "Torque of 100 % in an export.", min=1e-9, max=1e9)
    ] = None,
    device: Annotated[
        str | None, option("--device", "Drive that was measured, for its gear ratio.")
    ] = None,
    folder: Annotated[
        Path | None, option("--out DIR", "Write the results as a derived device file.")
    ] = None,
    json_file: options.JsonOption = None,
    figure: options.FigureOption = None,
) -> None:
    """Friction of a drive from runs at steady speeds: Coulomb, viscous, Stribeck, load."""
    from esea_gen.identify.drive.device_text import actuator_text, with_actuator
    from esea_gen.identify.drive.friction import fit_friction, read_run
    from esea_gen.identify.identified import marked, write_device
    from esea_gen.report.figures import friction_picture
    from esea_gen.tables import MARK

    if (device is None) != (folder is None):
        raise UserError("--device and --out work only together.", "Give both, or neither.")
    files = [f for p in runs for f in (sorted(p.rglob("*.csv")) if p.is_dir() else [p])]
    loaded = None if device is None else esea_gen.load_device(device)
    if loaded is not None and loaded.file.actuator is None:
        raise UserError(f"{loaded.origin}: has no [actuator].", "Give a device with a drive.")
    refuse_copies(files)
    read = [read_run(f, full) for f in files]
    simulated = any(r.read_as.endswith(MARK) for r in read)
    out.lines(r.read_as for r in read)
    found = fit_friction(read)
    show(found, json_file, "friction", simulated=simulated)
    picture(figure, lambda: friction_picture(read, found))
    if loaded is not None and folder is not None:
        assert loaded.file.actuator is not None
        numbers = found.at_joint(loaded.file.actuator.gear_ratio.value)
        source = f"{found.runs} runs at steady speeds{MARK * simulated}"
        updated = with_actuator(loaded, numbers, source)
        text = marked(actuator_text(loaded, updated, []), "friction")
        write_device(folder / updated.origin, text)
        out.print(f"device file: {folder / updated.origin}")


@app.command(name="encoder-table")
def encoder_table(
    device: options.DeviceArgument,
    recording: Annotated[
        Path,
        typer.Argument(help="CSV with the encoder's count and a better encoder's reference_rad."),
    ],
    side: Annotated[str, option("--side motor|load", "Joint encoder that was recorded.")] = "motor",
    nodes: Annotated[int, option("--values", "Number of values in the table.")] = 32,
    orientation: Annotated[
        float, option("--orientation-rad", "Angle of the mounted encoder.", min=-7, max=7)
    ] = 0.0,
    folder: Annotated[
        Path | None, option("--out DIR", "Write the device file with the table.")
    ] = None,
    json_file: options.JsonOption = None,
) -> None:
    """Correction table of an encoder from a recording with a better one."""
    from esea_gen.identify.drive.encoder_table import fit_table, read_counts, with_table
    from esea_gen.identify.identified import marked, write_device
    from esea_gen.tables import MARK

    choose("side", side, ("motor", "load"))
    loaded = esea_gen.load_device(device)
    full = 1 << round(loaded.file.encoder.resolution_bits.value)
    read, count, reference_rad = read_counts(recording, full)
    out.print(read.report())
    found = fit_table(side, count, reference_rad, full, nodes)
    show(found, json_file, "encoder-table", simulated=read.simulated)
    if folder is not None:
        source = f"recording {recording.name}{MARK * read.simulated}"
        made = with_table(loaded, found, orientation, source)
        write_device(folder / f"{made.name}.toml", marked(made.toml(), "encoder-table"))
        out.print(f"device file: {folder / f'{made.name}.toml'}")
