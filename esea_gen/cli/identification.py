"""From recordings: ``identify``, ``uncertainty``, ``torque-check``."""

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
from esea_gen.files import write_json, write_whole


@app.command()
def identify(
    mapping: Annotated[Path, typer.Argument(help="Mapping file of the recording.")],
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
    compare: Annotated[
        bool,
        typer.Option(
            "--compare", help="Compare models by conditions left out, and write no device file."
        ),
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Fit the torque model to a recording: device file and report."""
    if compare:
        if inverse or folder is not None:
            raise UserError("--compare writes no device file.", "Leave --inverse and --out out.")
        _compare_models(mapping, data, json_file)
        return
    from esea_gen.identify import identify as identify_recording
    from esea_gen.identify.inverse import refit_identified
    from esea_gen.report.identification import identification_page

    with progress_line() as say:

        def tell(share: float, what: str) -> None:
            say(f"{100 * share:.0f} % {what}")

        result, refit = identify_recording(mapping, data, progress=tell), None
        if inverse:
            result, refit = refit_identified(result, tell)
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
    write_json(json_file, content)


def _compare_models(mapping: Path, data: Path | None, json_file: Path | None) -> None:
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
    show(result, json_file)


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
    show(result, json_file)
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
            write_json(json_file, check.to_dict())
        return
    for line in check.report():
        out.print(line)
    write_json(json_file, check.to_dict())
    if check.verdict != "pass":
        raise typer.Exit(1)
