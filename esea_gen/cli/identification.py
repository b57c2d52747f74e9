"""From recordings: ``identify``, ``reliability``, ``uncertainty``, ``torque-check``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

import esea_gen
from esea_gen.cli.app import app, out
from esea_gen.cli.options import DeviceArgument, FigureOption, JsonOption
from esea_gen.cli.output import picture, progress_line, show
from esea_gen.cli.studies import StudyCommand
from esea_gen.errors import UserError
from esea_gen.files import sample_folder, write_json, write_whole

PUBLISHED = "published"
SAMPLE = "hdrb"  # a recording of a high-damping rubber that comes along


def _mapping(path: Path) -> Path:
    # The sample by its name, where there is no such file.
    return (
        sample_folder() / SAMPLE / f"{SAMPLE}.toml"
        if str(path) == SAMPLE and not path.exists()
        else path
    )


@app.command()
def identify(
    mapping: Annotated[
        Path,
        typer.Argument(
            callback=_mapping,
            help=f"Mapping file of the recording; {SAMPLE}: a rubber's, which comes along.",
        ),
    ],
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Output folder; default: identified/<device>."),
    ] = None,
    inverse: Annotated[
        bool, typer.Option("--inverse", help="Refit the published inverse's play operators too.")
    ] = False,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="NAME",
            help='Torque model: published, or a member of the family, as "slips, worn".',
        ),
    ] = PUBLISHED,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help="Compare models by conditions left out; with --out, write the chosen one's "
            "device file.",
        ),
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Fit the torque model to a recording: device file and report."""
    if compare and (inverse or model != PUBLISHED):
        given = "--inverse" if inverse else "--model"
        raise UserError(f"--compare chooses the model itself: {given}.", f"Leave {given} out.")
    if inverse and model != PUBLISHED:
        raise UserError(
            f"--inverse refits the published inverse, which is of the published model, not of "
            f"'{model}'.",
            "Leave it out: a member of the family has an exact inverse of its own.",
        )
    if not compare:
        _identify_model(mapping, data, folder, model, inverse, json_file)
        return
    chosen = _compare_models(mapping, data, json_file)
    if folder is not None:
        _identify_model(mapping, data, folder, chosen, False, None)


def _identify_model(
    mapping: Path,
    data: Path | None,
    folder: Path | None,
    model: str,
    inverse: bool,
    json_file: Path | None,
) -> None:
    from esea_gen.identify import identify as identify_published
    from esea_gen.identify.family_identification import identify_member
    from esea_gen.identify.identified import Identified
    from esea_gen.identify.inverse import refit_identified
    from esea_gen.report.identification import identification_page

    with progress_line() as say:

        def tell(share: float, what: str) -> None:
            say(f"{100 * share:.0f} % {what}")

        result: Identified
        refit = None
        if model != PUBLISHED:
            result = identify_member(mapping, model, data, tell)
        elif inverse:
            result, refit = refit_identified(identify_published(mapping, data, tell), tell)
        else:
            result = identify_published(mapping, data, tell)
    target = folder or Path("identified") / result.device.name
    content = result.to_dict() | ({} if refit is None else {"inverse": refit.to_dict()})
    page, text = target / f"{result.device.name}.html", identification_page(result)
    if page.is_dir():
        raise UserError(f"{page} is a folder.", "Give another --out folder.")
    path = result.write(target)
    write_whole(page, text)
    for line in [*result.summary(), *(refit.summary() if refit else [])]:
        out.print(line)
    out.print(f"device file: {path}")
    out.print(f"report: {page}")
    write_json(json_file, "identify", content)
    out.next("build", str(path))


def _compare_models(mapping: Path, data: Path | None, json_file: Path | None) -> str:
    from esea_gen.bench.sensor_cost import missing_tool, sensor_instructions
    from esea_gen.identify.compare import compare

    missing = missing_tool()
    if missing:
        out.print(f"note: instructions are not counted. {missing}")
    with progress_line() as say:
        result = compare(
            mapping,
            data,
            None if missing else sensor_instructions,
            lambda share, what: say(f"{100 * share:.0f} % {what}"),
        )
    show(result, json_file, "identify-compare")
    return result.chosen


@app.command()
def reliability(
    table: Annotated[
        Path, typer.Argument(help="CSV: a column a specimen, a row a condition, torques in Nm.")
    ],
    json_file: JsonOption = None,
) -> None:
    """How far specimens agree: ICC(2,1), ICC(3,1), limits of agreement."""
    from esea_gen.identify.reliability import read_specimens
    from esea_gen.identify.reliability import reliability as judged

    show(judged(read_specimens(table)), json_file, "reliability")


@app.command(cls=StudyCommand)
def uncertainty(
    device: DeviceArgument,
    runs: Annotated[int, typer.Option("--runs", help="Monte Carlo runs.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random draws.")] = 1,
    residual_deg: Annotated[
        float,
        typer.Option("--residual-deg", help="Encoder nonlinearity left after correction, degrees."),
    ] = 0.1,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--recording", metavar="MAPPING", help="Recording that the device was identified from."
        ),
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")
    ] = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    from esea_gen.studies.uncertainty.spread import identified_spread
    from esea_gen.studies.uncertainty.study import torque_uncertainty

    loaded = esea_gen.load_device(device)
    with progress_line() as say:
        say("covariance of the identification")
        spread = identified_spread(loaded, recording, data) if recording else None
        result = torque_uncertainty(
            loaded, runs, seed, spread=spread, residual_deg=residual_deg, progress=say
        )
    show(result, json_file, "uncertainty")
    picture(figure, result.figure)


@app.command("torque-check", cls=StudyCommand)
def torque_check(
    device: DeviceArgument,
    mass: Annotated[
        float | None, typer.Option("--mass", metavar="KG", help="Mass hung on the arm.")
    ] = None,
    arm: Annotated[
        float | None,
        typer.Option("--arm", metavar="M", help="From the joint axis to where the mass hangs."),
    ] = None,
    angle: Annotated[
        float, typer.Option("--angle", metavar="DEG", help="Angle of the arm to the horizontal.")
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
        typer.Option("--recording", metavar="FILE", help="CSV: time_s, tau_Nm, optionally step."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="FILE", help="Continue the check in this JSON file."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    from esea_gen.studies.torque_check.check import TorqueCheck
    from esea_gen.studies.torque_check.load import KnownLoad
    from esea_gen.studies.torque_check.recording import apply_recording, read_check, read_recording
    from esea_gen.studies.torque_check.study import instructions

    loaded = esea_gen.load_device(device)
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
            KnownLoad(
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
        raise UserError(f"the load is not known: {lacking} missing.", "Give mass (kg) and arm (m).")
    if recording is not None:
        assert check is not None
        apply_recording(check, read_recording(recording))
    elif check is None or not check.measurements:
        for line in instructions(loaded, check):
            out.print(line)
        if check is not None:
            write_json(json_file, "torque-check", check.to_dict())
        return
    for line in check.report():
        out.print(line)
    write_json(json_file, "torque-check", check.to_dict())
    if check.verdict != "pass":
        raise typer.Exit(1)
