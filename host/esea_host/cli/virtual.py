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
from esea_host.cli.wrist import compare_wrist, shift_wrist, shown_wrist


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
    with tempfile.TemporaryDirectory() as scratch:
        folder = keep or Path(scratch) / "study"
        if study == "wrist" and compare:
            compare_wrist(folder, participants, seed, jobs, to_json, cluster)
            return
        if sensitivity:
            if study != "wrist":
                raise UserError(
                    "--sensitivity is of the wrist study.", "Leave it out, or ask for wrist."
                )
            shift_wrist(folder, participants, seed, jobs, to_json, report, cluster)
            return
        if study == "wrist":
            early = _wrist(folder, participants, seed, jobs, method, to_json, report, cluster)
        elif study == "interaction":
            early = _interaction(folder, participants, seed, jobs, to_json, report, cluster)
        else:
            early = _any_protocol(Path(study), folder, participants, seed, jobs, cluster)
        for reason in early:
            out.print(f"ended early: {reason}")


def _wrist(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int,
    method: str,
    to_json: Path | None,
    report: Path | None,
    cluster: str | None,
) -> list[str]:
    from esea_host.wrist.analysis import analyse
    from esea_host.wrist.virtual import run_study

    early = run_study(folder, participants, seed, jobs, method, cluster=cluster, say=told)
    shown_wrist(analyse(folder), to_json, report, None)
    return early


def _interaction(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int,
    to_json: Path | None,
    report: Path | None,
    cluster: str | None,
) -> list[str]:
    from esea_host.interaction.virtual import run_crossover

    if participants < 2:
        raise UserError(f"--participants {participants}.", "A comparison needs at least 2.")
    checked_page(report)
    early = run_crossover(folder, participants, seed, jobs, cluster=cluster, say=told)
    shown_interaction(folder, to_json, report)
    return early


def _any_protocol(
    path: Path, folder: Path, participants: int, seed: int, jobs: int, cluster: str | None
) -> list[str]:
    from esea_host.study.folder import StudyFolder
    from esea_host.study.many import EveryTask, code_of, run_everybody
    from esea_host.study.protocol import load_protocol

    know_shipped_tasks()
    protocol = load_protocol(path)
    early = run_everybody(folder, protocol, participants, EveryTask(seed), jobs, cluster, told)
    rows = sum(
        len(StudyFolder.open(folder, runs=False).rows(code_of(k))) for k in range(participants)
    )
    out.print(f"{participants} SIMULATED participants: {rows} trials completed")
    return early
