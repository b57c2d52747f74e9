"""``assess``: what is known of a movement disorder of the knee, and which movement tells most."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from esea_gen.cli.groups import WholeSentences
from esea_gen.cli.options import JobsOption, writable
from esea_gen.errors import UserError
from esea_gen.files import write_json, write_whole
from esea_host.assess import MEASURED_NOTICE, NOTICE, Measure, Summary
from esea_host.cli.app import app, out, told
from esea_host.cli.view import need_a_screen

assess = typer.Typer(
    cls=WholeSentences,
    help=f"Knee: movement disorders, and which movement would tell most. {NOTICE}",
    no_args_is_help=True,
)
app.add_typer(assess, name="assess")

JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", callback=writable, help="Write the result.")
]
DataOption = Annotated[
    Path | None,
    typer.Option("--database", metavar="FILE", help="Data base; default: the simulated knee's."),
]
PageOption = Annotated[
    Path | None,
    typer.Option(
        "--page", metavar="FILE", callback=writable, help="Write a page (.html, .png, .pdf)."
    ),
]
HeightOption = Annotated[float, typer.Option("--height-m", help="Body height, 1.0 to 2.3.")]
MassOption = Annotated[float, typer.Option("--mass-kg", help="Body mass, 15 to 250.")]


def _said(read: str) -> None:
    if read:
        out.print(read)


def _data(path: Path | None) -> Any:
    from esea_host.assess.build import cached
    from esea_host.assess.database import ResponseDataBase

    return ResponseDataBase.load(path) if path else cached(say=told)


@assess.command(epilog=NOTICE)
def build(
    file: Annotated[
        Path, typer.Argument(callback=writable, help="Where the data base goes (.npz).")
    ],
    patients: Annotated[
        int, typer.Option("--patients", min=8, help="Simulated patients of each category.")
    ] = 60,
    recordings: Annotated[
        Path | None,
        typer.Option(
            "--recordings",
            metavar="FOLDER",
            help="Build from recordings instead: a folder for each category, tables or MCAP in it.",
        ),
    ] = None,
) -> None:
    """Build a data base of responses: one file, with where it comes from."""
    from esea_host.assess.build import build as simulate
    from esea_host.assess.files import from_recordings

    data = from_recordings(recordings, told) if recordings else simulate(patients, told)
    digest = data.save(file)
    out.print(data.notice)
    out.print(
        f"{file}: {len(data.category)} people, {len(data.categories)} categories, "
        f"{int(data.common.sum())} of {data.grid.cells} locations reached by all, {digest[:16]}"
    )
    if data.calibration is None:
        out.print("Not calibrated: spread and noise of a movement, and none of these, are assumed.")
        return
    fit = data.calibration
    out.print(
        f"None of these: {fit['none_called']:.0f} of {fit['none_patients']:.0f} other simulated "
        f"patients would be called so, with {fit['none_log_odds']:.2f} on its log odds."
    )


@assess.command(epilog=NOTICE)
def evaluate(
    patients: Annotated[int, typer.Option("--patients", help="Patients of the categories.")] = 200,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Who is drawn.")] = 1,
    jobs: JobsOption = -1,
    json_file: JsonOption = None,
    page: Annotated[
        Path | None,
        typer.Option("--page", metavar="FILE", callback=writable, help="Write the page (.html)."),
    ] = None,
    database: DataOption = None,
) -> None:
    """Judge the assessment on simulated patients drawn anew."""
    from esea_host.assess.evaluation import evaluate as meet_all
    from esea_host.assess.judge import judge, table
    from esea_host.assess.pages import evaluation_page

    data = _data(database)
    met, mixed = meet_all(data, patients, seed, jobs, say=told)
    result = {"seed": seed} | judge(met, mixed, data)
    out.print(data.notice)
    for line in table(result):
        out.print(line)
    write_json(json_file, "host-assess-virtual", result)
    if page is not None:
        write_whole(page, evaluation_page(result))


@assess.command(epilog=NOTICE)
def run(
    recording: Annotated[
        list[Path] | None,
        typer.Option("--recording", metavar="FILE", help="Read a movement; repeatable."),
    ] = None,
    patient: Annotated[
        str | None,
        typer.Option("--patient", help="simulated:S3, simulated:S2+D4, simulated:rigid, or :any."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the simulated patient.")] = 1,
    window: Annotated[bool, typer.Option("--window", help="The clinician's window.")] = False,
    dark: Annotated[
        bool | None, typer.Option("--dark/--light", help="Default: as the desktop has it.")
    ] = None,
    height_m: HeightOption = 1.70,
    mass_kg: MassOption = 70.0,
    low_deg: Annotated[float, typer.Option("--from-deg", help="Reach: least bending.")] = 0.0,
    high_deg: Annotated[float, typer.Option("--to-deg", help="Reach: most bending.")] = 130.0,
    fastest: Annotated[
        float, typer.Option("--fastest-deg-s", help="Fastest comfortable speed.")
    ] = 120.0,
    mixed: Annotated[bool, typer.Option("--mixed", help="Two disorders at once, too.")] = False,
    summary: Annotated[
        Summary, typer.Option("--summary", help="Of the data base; kernel: Gaussian process.")
    ] = "people",
    measure: Annotated[
        Measure,
        typer.Option("--measure", help="By which movements are chosen."),
    ] = "expected",
    who: Annotated[str, typer.Option("--who", help="Printed on the page.")] = "",
    json_file: JsonOption = None,
    page: PageOption = None,
    database: DataOption = None,
) -> None:
    """Assess one leg: a movement is proposed; type what it gave, or read recordings.

    Works without a sensor: say in a word how the leg resists, or skip.
    """
    from esea_host.assess.desk import ClinicDesk, converse
    from esea_host.assess.files import read_recording
    from esea_host.assess.patients import DEG
    from esea_host.assess.probing import Comfort
    from esea_host.assess.responses import check_body
    from esea_host.assess.session import Assessment

    if window:
        need_a_screen("the conversation: leave --window out")
    if page is not None:
        from esea_host.assess.pages import checked_name

        checked_name(page)
    check_body(height_m, mass_kg)
    comfort = Comfort(low_deg * DEG, high_deg * DEG, fastest * DEG)
    somebody = None if patient is None else _patient(patient, height_m, mass_kg, seed)
    recordings = [read_recording(p, height_m, mass_kg) for p in recording or []]
    session = Assessment(_data(database), summary, mixed)
    desk = ClinicDesk(session, comfort, height_m, mass_kg, somebody, json_file, seed, measure)
    out.print(session.data.notice)
    if somebody is not None:
        out.print("The patient is simulated.")
    for path, r in zip(recording or [], recordings, strict=True):
        _said(r.read)
        out.print(desk.recording(r, path.name))
    if window:
        from esea_host.windows.assess import run_assess

        run_assess(desk, who, dark)
    else:
        converse(desk, sys.stdin if not recording else io.StringIO(), out.print)
    if somebody is not None:
        out.print(f"The simulated patient was: {somebody.category}")
    if page is not None:
        from esea_host.assess.pages import write_session_page

        write_session_page(page, session, desk.about(who), desk.comfort, measure)


def _patient(text: str, height_m: float, mass_kg: float, seed: int) -> Any:
    from esea_host.assess.simulated import patient_named

    kind, _, name = text.partition(":")
    if kind != "simulated":
        raise UserError(f"--patient {text}.", "Give simulated:S3, simulated:any; others are real.")
    return patient_named(name or "any", (height_m, mass_kg), seed)


@assess.command(epilog=MEASURED_NOTICE)
def pendulum(
    recording: Annotated[
        Path, typer.Argument(help="Table or MCAP: time_s, and angle_deg or _rad.")
    ],
    json_file: JsonOption = None,
) -> None:
    """Wartenberg's pendulum test: relaxation index, damping, first swing."""
    from esea_host.assess.files import angle_columns
    from esea_host.assess.passive_tests import pendulum_test

    time_s, angle, table = angle_columns(recording)
    found = pendulum_test(time_s, angle)
    out.print(MEASURED_NOTICE)
    _said(table.read)
    for line in found.sentences():
        out.print(line)
    write_json(json_file, "host-assess-pendulum", {"notice": MEASURED_NOTICE} | vars(found))


@assess.command("range", epilog=MEASURED_NOTICE)
def range_(
    recording: Annotated[Path, typer.Argument(help="Table or MCAP: time_s, angle_deg, torque_Nm.")],
    height_m: HeightOption = 1.70,
    mass_kg: MassOption = 70.0,
    json_file: JsonOption = None,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE", callback=writable, help="Torque over angle."),
    ] = None,
) -> None:
    """Passive range of motion: how far, how stiff, and what the loop of torque loses."""
    from esea_host.assess.files import read_recording
    from esea_host.assess.pages import FIGURES, checked_name, loop_picture
    from esea_host.assess.passive_tests import motion_range

    if figure is not None:
        checked_name(figure, FIGURES)
    leg = read_recording(recording, height_m, mass_kg)
    found = motion_range(leg)
    out.print(MEASURED_NOTICE)
    _said(leg.read)
    for line in found.sentences():
        out.print(line)
    numbers = {k: v for k, v in vars(found).items() if v is None or isinstance(v, int | float)}
    write_json(json_file, "host-assess-motion", {"notice": MEASURED_NOTICE} | numbers)
    if figure is not None:
        buffer = io.BytesIO()
        loop_picture(found).savefig(buffer, format=figure.suffix[1:], dpi=150)
        write_whole(figure, buffer.getvalue())


@assess.command(epilog=NOTICE)
def validate(
    folder: Annotated[
        Path | None, typer.Option("--elbow", help="Folder with the published elbow recordings.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Hold the simulated knee against published numbers."""
    from esea_host.assess.validation import against_elbow, pendulum_table, table

    found: dict[str, Any] = {"notice": NOTICE, "simulated": True, "pendulum": pendulum_table()}
    if folder is not None:
        found["elbow"] = against_elbow(folder)
    out.print(NOTICE)
    for line in table(found):
        out.print(line)
    write_json(json_file, "host-assess-known", found)
