"""``study virtual``: a whole study with virtual participants."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.options import ClusterOption, JobsOption
from esea_gen.errors import UserError
from esea_host.cli.app import out, told
from esea_host.cli.interaction import checked_page, shown_interaction
from esea_host.cli.options import JsonOption, ReportOption, know_shipped_tasks
from esea_host.cli.study import TrustOption, study_app, trusted
from esea_host.cli.wrist import VirtualRun, compare_wrist, shift_wrist, shown_wrist


@study_app.command("virtual")
def virtual(
    study: Annotated[
        str, typer.Argument(metavar="STUDY", help="wrist, interaction, or a protocol file.")
    ],
    participants: Annotated[int, typer.Option("--participants", min=1, max=10000)] = 10,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed, the same study.")] = 1,
    jobs: JobsOption = -1,
    cluster: ClusterOption = None,
    trust: TrustOption = None,
    method: Annotated[
        str, typer.Option("--method", help="Wrist: normalisation none, linear, published or rbf.")
    ] = "rbf",
    compare: Annotated[
        bool, typer.Option("--compare", help="Wrist: the study under every method.")
    ] = False,
    sensitivity: Annotated[
        bool, typer.Option("--sensitivity", help="Wrist: with each number of people shifted.")
    ] = False,
    keep: Annotated[
        Path | None, typer.Option("--keep", metavar="FOLDER", help="Keep the study's folder.")
    ] = None,
    to_json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """A whole study with virtual participants; all that comes of it is simulated."""
    from esea_host.wrist.calibration import METHODS

    if method not in METHODS:
        raise UserError(f"There is no method {method!r}.", f"There are: {', '.join(METHODS)}.")
    trusted(trust)
    if sensitivity and study != "wrist":
        raise UserError("--sensitivity is of the wrist study.", "Leave it out, or ask for wrist.")
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
        for reason in early:
            out.print(f"ended early: {reason}")


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
