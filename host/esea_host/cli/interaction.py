"""``analyse``: interaction study and its parts; ``smoothness`` for any recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from esea_gen.cli.groups import WholeSentences
from esea_gen.cli.options import FigureOption, option, writable
from esea_gen.errors import UserError
from esea_gen.files import write_json, write_whole, written_whole
from esea_gen.tables import MARK, read_table
from esea_host.cli.app import app, out, say, say_left_out
from esea_host.cli.options import JsonOption, ReportOption
from esea_host.cli.study import FolderArgument, opened, study_app

analyse = typer.Typer(
    cls=WholeSentences, help="Analyse recordings and surveys.", no_args_is_help=True
)
app.add_typer(analyse, name="analyse")

FileArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="CSV, Parquet, MAT, HDF5 or JSON.")
]


def _draw(path: Path | None, figure: Any) -> None:
    if path is not None:
        with written_whole(path) as scratch:
            figure.savefig(scratch, dpi=150)


@analyse.command()
def interaction(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with interaction.toml.")],
    json_file: JsonOption = None,
    report: ReportOption = None,
    blinded: Annotated[
        bool, option("--blinded", "Study folder: give the elements neutral names.")
    ] = False,
) -> None:
    """Spring against elastomer: smoothness, statistics, survey, detectable differences."""
    from esea_host.study.folder import PROTOCOL

    checked_page(report)
    if (folder / PROTOCOL).exists():
        _shown_study(folder, json_file, report, blinded)
    elif blinded:
        raise UserError("--blinded needs a study's folder.", "Leave it out.")
    else:
        shown_interaction(folder, json_file, report)


def _shown_study(folder: Path, json_file: Path | None, report: Path | None, blinded: bool) -> None:
    from esea_host.interaction.analysis import analyse_interaction
    from esea_host.interaction.design import ELEMENTS, SPRING
    from esea_host.interaction.words import lines
    from esea_host.study.exchange import omissions, veiled_names
    from esea_host.study.folder import StudyFolder

    study = StudyFolder.open(folder, runs=False)
    say_left_out(omissions(study))
    if not blinded and not any(study.blinded(role) for role in ("operator", "analyst")):
        shown_interaction(folder, json_file, report)
        return
    if json_file is not None or report is not None:
        raise UserError(
            "A blinded analysis is printed only: files name the elements.",
            "Leave --json and --report out until the study is unblinded.",
        )
    names = veiled_names(study)
    out.print("BLINDED: neutral names for the two elements; their order was drawn at random.")
    swapped = names[SPRING] != min(names.values())
    order = dict(zip(ELEMENTS, sorted(names.values()), strict=True))
    say(lines(analyse_interaction(folder, True, swapped), order))


def checked_page(report: Path | None) -> None:
    if report is not None and report.suffix != ".html":
        raise UserError(f"{report}: a page ends in .html.", "Give another name.")


def shown_interaction(folder: Path, json_file: Path | None, report: Path | None) -> None:
    from esea_host.interaction.analysis import analyse_interaction
    from esea_host.interaction.words import lines

    found = analyse_interaction(folder)
    say(lines(found))
    write_json(json_file, "host-interaction", found.to_dict())
    if report is not None:
        from esea_host.interaction.figures import render_report

        write_whole(report, render_report(found))


@analyse.command()
def loading(
    file: FileArgument,
    rest: Annotated[float, option("--rest", "Angle at rest, rad.")] = 0.0,
    skip_first: Annotated[bool, option("--skip-first", "Leave the first loading out.")] = False,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Loading stiffness and hysteresis of a torque-displacement curve (theta_rad, tau_Nm)."""
    from esea_host.interaction.figures import loading_figure
    from esea_host.interaction.loading import analyse_loading
    from esea_host.recording.export import column_of, longest_run

    table = longest_run(read_table(file))
    theta, tau = (table.numbers(column_of(table, n)) for n in ("theta_rad", "tau_Nm"))
    found = analyse_loading(theta, tau, rest_rad=rest, skip_first=skip_first)
    say([table.report(), *found.lines()])
    simulated = table.simulated
    write_json(json_file, "host-loading", {"simulated": simulated} | found.to_dict())
    _draw(figure, loading_figure(theta - rest, tau, found, simulated))


@analyse.command()
def survey(file: FileArgument, json_file: JsonOption = None, figure: FigureOption = None) -> None:
    """Convert answers on first against second device to spring against elastomer."""
    from esea_host.interaction.survey import diverging_bars, read_survey

    found = read_survey(file)
    say(found.lines())
    write_json(json_file, "host-survey", found.to_dict(), found.read.endswith(MARK))
    _draw(figure, diverging_bars(found))


@study_app.command("survey")
def survey_page(
    folder: FolderArgument,
    to: Annotated[Path, typer.Argument(metavar="OUT.html", callback=writable, help="The page.")],
    language: Annotated[str, option("--language", "en, de, or one that the study brings.")] = "",
) -> None:
    """Write the questions at the end of the interaction study as a page to print."""
    from esea_host.interaction.survey import survey_form

    write_whole(to, survey_form(opened(folder, runs=False).protocol.words(language)))
    out.print(f"{to} is written; answers go to esea-host analyse survey")


@analyse.command()
def comments(file: FileArgument, json_file: JsonOption = None) -> None:
    """Open comments by theme and tone, and the agreement of two coders."""
    from esea_host.interaction.survey import read_comments

    found = read_comments(file)
    say(found.lines())
    write_json(json_file, "host-comments", found.to_dict(), found.read.endswith(MARK))


@analyse.command()
def power(
    people: Annotated[int, option("--people", "With both conditions.", min=2, max=2000)] = 10,
    tests: Annotated[int, option("--tests", "Comparisons in the family.", min=1)] = 1,
    sd: Annotated[
        float, option("--sd", "Standard deviation of the differences, in their unit.")
    ] = math.nan,
    json_file: JsonOption = None,
) -> None:
    """Detectable difference for a number of people, and people needed for a difference."""
    from esea_host.statistics import NoStatisticError, power_statement

    try:
        found = power_statement(people, sd, alpha=0.05 / tests)
    except NoStatisticError as error:
        raise UserError(error.what, error.fix) from None
    out.print(found.sentence())
    for dz, p in found.powers.items():
        needed = found.needed.get(dz)
        out.print(f"  {dz} sd: power {p:.0%}; {needed or 'more than 2000'} people for 80 %")
    write_json(json_file, "host-power", found.to_dict())


@app.command()
def smoothness(
    file: FileArgument,
    column: Annotated[
        str | None,
        option("--column", "Angle, position or their speed; default: by its name and unit."),
    ] = None,
    time: Annotated[
        str | None, option("--time", "Column of the time; default: by its name.")
    ] = None,
    time_unit: Annotated[
        str | None, option("--time-unit", "s, ms, us or ns; default: by its name, or s.")
    ] = None,
    stop_Hz: Annotated[float, option("--stop", "Stop band of the filter, Hz.")] = 4.0,
    last_s: Annotated[float | None, option("--last", "Analyse this many last s.")] = None,
    resample_Hz: Annotated[
        float | None, option("--resample", "Rate in Hz, for frames at irregular times; reported.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Compute every smoothness metric of a recording, with its settings and their band."""
    from esea_host.interaction.own_data import measure_file

    found = measure_file(file, column, time, stop_Hz, last_s, resample_Hz, time_unit)
    say(found.lines())
    write_json(json_file, "host-smoothness", found.to_dict())
