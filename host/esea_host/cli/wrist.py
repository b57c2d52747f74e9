"""``study virtual``: a study with virtual participants; ``analyse wrist``: its tables."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from esea_gen.cli.options import ClusterOption, JobsOption, option
from esea_gen.errors import UserError
from esea_gen.files import write_json, write_whole
from esea_host.cli.app import out, say, say_left_out, told
from esea_host.cli.interaction import analyse as analyse_app
from esea_host.cli.interaction import checked_page, shown_interaction
from esea_host.cli.options import JsonOption, ReportOption, know_shipped_tasks, output_file
from esea_host.cli.study import TrustOption, study_app, trusted

if TYPE_CHECKING:
    from esea_host.wrist.analysis import WristResult


WIDE = 132  # characters in which every table here can be read


def _print_table(title: str, heads: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    # In a narrower terminal, or a file, lines run on: cells cut to a letter tell nothing.
    table = Table(*heads, title=title)
    for row in rows:
        table.add_row(*row)
    Console(highlight=False, markup=False, width=max(out.width, WIDE)).print(table)


@dataclass(frozen=True)
class VirtualRun:
    """Options of ``study virtual``."""

    folder: Path
    participants: int
    seed: int
    jobs: int
    cluster: str | None
    to_json: Path | None
    report: Path | None

    @property
    def whom(self) -> tuple[Path, int, int, int]:
        return self.folder, self.participants, self.seed, self.jobs


def compare_wrist(asked: VirtualRun) -> None:
    from esea_host.wrist.calibration import AXES
    from esea_host.wrist.figures import number
    from esea_host.wrist.sensitivity import compare_methods

    found = compare_methods(*asked.whom, cluster=asked.cluster)
    heads = (
        *("method", "people", "RMS FE %", "RMS RU %", "peak FE", "peak RU"),
        *("targets FE", "targets RU", "after-effect"),
    )
    rows = []
    for x in found:
        by_axis = [m[a] for m in (x.rms_percent, x.peak_ratio, x.achieved_gap) for a in AXES]
        values = [*by_axis, x.after_effect_gap_deg]
        rows.append((x.method, str(x.people), *(number(v) for v in values)))
    title = "SIMULATED participants: constrained against their own healthy state"
    _print_table(title, heads, rows)
    out.print(
        "RMS: speed error over the peak, tracking the own healthy motion.  Peak: constrained over "
        "healthy.  Targets, after-effect: healthy less constrained; 0 is desired."
    )
    say(f"{x.method}: ended early: {reason}" for x in found for reason in x.refused)
    write_json(asked.to_json, "host-wrist-methods", {"simulated": True, "methods": found})


def shift_wrist(asked: VirtualRun) -> None:
    from esea_host.wrist.sensitivity import sensitivity, sensitivity_page

    runs = sensitivity(*asked.whom, asked.cluster)
    rows = [(x.name, x.end, x.source, "; ".join(x.changed) or "-") for x in runs[1:]]
    title = f"{asked.participants} SIMULATED participants: what a shifted number changes"
    _print_table(title, ("number", "end", "range from", "other conclusions"), rows)
    kept = sum(not x.changed for x in runs[1:])
    out.print(
        f"{kept} of {len(runs) - 1} runs change nothing.  A conclusion: the second side is more or "
        "less in three quarters of the ranks, else neither."
    )
    say(f"{x.name} {x.end}: ended early: {reason}" for x in runs for reason in x.early)
    write_json(asked.to_json, "host-wrist-sensitivity", {"simulated": True, "runs": runs})
    if asked.report:
        write_whole(asked.report, sensitivity_page(runs, asked.participants))


@study_app.command("virtual")
def virtual(
    study: Annotated[
        str, typer.Argument(metavar="STUDY", help="wrist, interaction, or a protocol file.")
    ],
    participants: Annotated[int, typer.Option("--participants", min=1, max=10000)] = 10,
    seed: Annotated[int, option("--seed", "Random seed.", min=0)] = 1,
    jobs: JobsOption = -1,
    cluster: ClusterOption = None,
    trust: TrustOption = None,
    method: Annotated[
        str, option("--method", "Wrist normalisation: none, linear, published or rbf.")
    ] = "rbf",
    compare: Annotated[bool, option("--compare", "Wrist: run every method.")] = False,
    sensitivity: Annotated[
        bool, option("--sensitivity", "Wrist: vary each number of the person model.")
    ] = False,
    keep: Annotated[Path | None, option("--keep FOLDER", "Keep the study's folder.")] = None,
    to_json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Run a complete study with virtual participants; every result is simulated."""
    from esea_host.wrist.calibration import METHODS

    if method not in METHODS:
        raise UserError(f"There is no method {method!r}.", f"There are: {', '.join(METHODS)}.")
    trusted(trust)
    given = {"--method": method != "rbf", "--compare": compare, "--sensitivity": sensitivity}
    if study == "wrist":
        given["--method"] &= compare or sensitivity
        given["--sensitivity"] &= compare
        given |= {"--compare": False, "--report": compare and report is not None}
    elif study != "interaction":
        given |= {"--json": to_json is not None, "--report": report is not None}
    if idle := ", ".join(name for name, is_given in given.items() if is_given):
        raise UserError(f"study virtual {study}: {idle} has no effect.", "Leave it out.")
    with tempfile.TemporaryDirectory() as scratch:
        folder = keep or Path(scratch) / "study"
        asked = VirtualRun(folder, participants, seed, jobs, cluster, to_json, report)
        early: list[str] = []
        if study == "wrist" and compare:
            compare_wrist(asked)
        elif sensitivity:
            shift_wrist(asked)
        elif study == "wrist":
            early = _wrist(asked, method)
        elif study == "interaction":
            early = _interaction(asked)
        else:
            early = _any_protocol(Path(study), asked)
        say(f"ended early: {reason}" for reason in early)


def _wrist(asked: VirtualRun, method: str) -> list[str]:
    from esea_host.wrist.analysis import analyse
    from esea_host.wrist.virtual import run_study

    early = run_study(*asked.whom, method, cluster=asked.cluster, say=told)
    shown_wrist(analyse(asked.folder), asked.to_json, asked.report, None)
    return early


def _interaction(asked: VirtualRun) -> list[str]:
    from esea_host.interaction.virtual import run_crossover

    if asked.participants < 2:
        raise UserError(f"--participants {asked.participants}.", "A comparison needs at least 2.")
    checked_page(asked.report)
    early = run_crossover(*asked.whom, cluster=asked.cluster, say=told)
    shown_interaction(asked.folder, asked.to_json, asked.report)
    return early


def _any_protocol(path: Path, asked: VirtualRun) -> list[str]:
    from esea_host.study.folder import StudyFolder
    from esea_host.study.many import EveryTask, code_of, run_everybody
    from esea_host.study.protocol import load_protocol

    know_shipped_tasks()
    folder, participants, seed, jobs = asked.whom
    given = folder, load_protocol(path), participants, EveryTask(seed), jobs, asked.cluster
    early = run_everybody(*given, told)
    study = StudyFolder.open(folder, runs=False)
    rows = sum(len(study.rows(code_of(k))) for k in range(participants))
    out.print(f"{participants} SIMULATED participants: {rows} trials completed")
    return early


@analyse_app.command("wrist")
def analyse_wrist(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The study's folder.")],
    to_json: JsonOption = None,
    report: ReportOption = None,
    csv: Annotated[Path | None, output_file("--csv", "Write every participant's values.")] = None,
    blinded: Annotated[
        bool, option("--blinded", "States by neutral names, as while blinded.")
    ] = False,
) -> None:
    """Every metric and test of the wrist study, tables 7.1 to 7.4 beside the published ones."""
    from esea_host.wrist.analysis import analyse

    shown_wrist(analyse(folder, blinded), to_json, report, csv)


def shown_wrist(
    result: WristResult, to_json: Path | None, report: Path | None, csv: Path | None
) -> None:
    from esea_host.wrist.figures import COLUMNS, cells, page

    say_left_out(result.left_out)
    if result.blinded:
        out.print("BLINDED: neutral names for the two states; their order was drawn at random.")
    mark = "SIMULATED participants" if result.simulated else "participants"
    for title, lines in result.tables.items():
        heads = (*COLUMNS[:3], *result.sides[title], *COLUMNS[5:])
        _print_table(f"Table {title}: {result.participants} {mark}", heads, map(cells, lines))
        say(f"{line.metric}: {line.note}" for line in lines if line.note)
    out.print(
        "Medians; two-sided Wilcoxon signed-rank test, exact up to 50 people, zero differences "
        "dropped; Holm over each table; effect: rank-biserial correlation."
    )
    write_json(to_json, "host-wrist", vars(result))
    if report:
        write_whole(report, page(result))
    if csv:
        import pandas as pd

        rows = [
            {"table": t, "participant": c, "metric": k, "value": x, "simulated": result.simulated}
            for t, people in result.people.items()
            for c, values in people.items()
            for k, x in values.items()
        ]
        write_whole(csv, pd.DataFrame(rows).to_csv(index=False))


@analyse_app.command("reaches")
def analyse_reaches(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Imported recordings.")],
    to_json: JsonOption = None,
    stream: Annotated[str, option("--stream", "Stream with cursor and target.")] = "reach",
) -> None:
    """The motor-learning task's measures on reaching to fixed targets, one line per recording."""
    from esea_host.recording.integrity import warn_unless_complete
    from esea_host.recording.log import open_log
    from esea_host.wrist.figures import number
    from esea_host.wrist.reaching import reaches, summary

    content, rows = {}, []
    for path in files:
        with open_log(path) as log:
            warn_unless_complete(path, log.integrity)
            each, left_out = reaches(log[stream])
            simulated = bool(log.facts.get("simulated"))
        say(f"{path}: left out: {why}" for why in left_out)
        x = summary(each)
        beyond = None if x["beyond"] is None else 100 * x["beyond"]
        values = (x["reach_s"], x["sse"], beyond, x["sparc"], x["submovements"])
        name = f"{path}{', SIMULATED' if simulated else ''}"
        rows.append((name, str(x["reaches"]), str(x["achieved"]), *map(number, values)))
        about = {"simulated": simulated, "left_out": left_out}
        content[str(path)] = {"summary": x, "reaches": each} | about
    heads = ("file", "reaches", "held", "until, s", "SSE", "beyond, %", "SPARC", "parts")
    _print_table("Reaching to fixed targets; medians", heads, rows)
    out.print(
        "held: 0.75 s within the target, within 10 s; until: to the beginning of that; SSE: "
        "squared error over the squared distance, 100 a second; beyond: past the target, of the "
        "distance."
    )
    write_json(to_json, "host-reaches", {"files": content})
