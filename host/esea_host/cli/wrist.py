"""``analyse wrist``: the wrist study's tables, and its methods compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from esea_gen.cli.options import writable
from esea_gen.files import write_json, write_whole
from esea_host.cli.analyse import analyse as analyse_app
from esea_host.cli.app import out

if TYPE_CHECKING:
    from esea_host.wrist.analysis import WristResult

JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", callback=writable, help="Write as JSON.")
]
ReportOption = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE", callback=writable, help="Write one HTML page."),
]
CsvOption = Annotated[
    Path | None,
    typer.Option(
        "--csv", metavar="FILE", callback=writable, help="Write every participant's values."
    ),
]


WIDE = 132  # characters in which every table here can be read


def _print_wide(table: Table) -> None:
    # In a narrower terminal, or a file, lines run on: cells cut to a letter tell nothing.
    Console(highlight=False, markup=False, width=max(out.width, WIDE)).print(table)


def compare_wrist(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int,
    to_json: Path | None,
    cluster: str | None,
) -> None:
    from esea_host.wrist.compared import compare_methods
    from esea_host.wrist.figures import number

    found = compare_methods(folder, participants, seed, jobs, cluster=cluster)
    table = Table(title="SIMULATED participants: constrained against their own healthy state")
    for head in (
        *("method", "people", "RMS FE %", "RMS RU %", "peak FE", "peak RU"),
        *("targets FE", "targets RU", "after-effect"),
    ):
        table.add_column(head)
    for x in found:
        values = [
            *(x.rms_percent[a] for a in ("FE", "RU")),
            *(x.peak_ratio[a] for a in ("FE", "RU")),
            *(x.achieved_gap[a] for a in ("FE", "RU")),
            x.after_effect_gap_deg,
        ]
        table.add_row(x.method, str(x.people), *(number(v) for v in values))
    _print_wide(table)
    out.print(
        "RMS: speed error over the peak, tracking the own healthy motion.  Peak: constrained over "
        "healthy.  Targets, after-effect: healthy less constrained; 0 is what is wanted."
    )
    for x in found:
        for reason in x.refused:
            out.print(f"{x.method}: ended early: {reason}")
    write_json(
        to_json, "host-wrist-methods", {"simulated": True, "methods": [x.to_dict() for x in found]}
    )


def shift_wrist(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int,
    to_json: Path | None,
    report: Path | None,
    cluster: str | None,
) -> None:
    from esea_host.wrist.sensitivity import sensitivity, sensitivity_page

    runs = sensitivity(folder, participants, seed, jobs, cluster)
    table = Table(title=f"{participants} SIMULATED participants: what a shifted number changes")
    for head in ("number", "end", "range from", "other conclusions"):
        table.add_column(head)
    for x in runs[1:]:
        table.add_row(x.name, x.end, x.source, "; ".join(x.changed) or "-")
    _print_wide(table)
    kept = sum(not x.changed for x in runs[1:])
    out.print(
        f"{kept} of {len(runs) - 1} runs change nothing.  A conclusion: the second side is more or "
        "less in three quarters of the ranks, else neither."
    )
    for x in runs:
        for reason in x.early:
            out.print(f"{x.name} {x.end}: ended early: {reason}")
    write_json(
        to_json,
        "host-wrist-sensitivity",
        {"simulated": True, "runs": [x.to_dict() for x in runs]},
    )
    if report:
        write_whole(report, sensitivity_page(runs, participants))


@analyse_app.command("wrist")
def analyse_wrist(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The study's folder.")],
    to_json: JsonOption = None,
    report: ReportOption = None,
    csv: CsvOption = None,
) -> None:
    """Every metric and test of the wrist study, tables 7.1 to 7.4 beside the published ones."""
    from esea_host.wrist.analysis import analyse

    shown_wrist(analyse(folder), to_json, report, csv)


def shown_wrist(
    result: WristResult, to_json: Path | None, report: Path | None, csv: Path | None
) -> None:
    from esea_host.wrist.figures import COLUMNS, cells, page

    mark = "SIMULATED participants" if result.simulated else "participants"
    for title, lines in result.tables.items():
        first, second = result.sides[title]
        table = Table(title=f"Table {title}: {result.participants} {mark}")
        for head in (*COLUMNS[:3], first, second, *COLUMNS[5:]):
            table.add_column(head)
        for line in lines:
            table.add_row(*cells(line))
        _print_wide(table)
        for line in lines:
            if line.note:
                out.print(f"{line.metric}: {line.note}")
    out.print(
        "Medians; two-sided Wilcoxon signed-rank test, exact, zero differences dropped; Holm over "
        "each table; effect: rank-biserial correlation."
    )
    write_json(to_json, "host-wrist", result.to_dict())
    if report:
        write_whole(report, page(result))
    if csv:
        import pandas as pd

        rows = [
            {"table": t, "participant": c, "metric": k, "value": x}
            for t, people in result.people.items()
            for c, values in people.items()
            for k, x in values.items()
        ]
        write_whole(csv, pd.DataFrame(rows).to_csv(index=False))


@analyse_app.command("reaches")
def analyse_reaches(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Imported recordings.")],
    to_json: JsonOption = None,
    stream: Annotated[
        str, typer.Option("--stream", help="Stream with cursor and target.")
    ] = "reach",
) -> None:
    """The motor-learning task's numbers on reaching to targets that stand, a line a recording."""
    from esea_host.recording.integrity import warn_unless_complete
    from esea_host.recording.log import open_log
    from esea_host.wrist.figures import number
    from esea_host.wrist.reaching import reaches, summary, to_rows

    found = {}
    for path in files:
        with open_log(path) as log:
            warn_unless_complete(path, log.integrity)
            found[path.name] = reaches(log[stream])
    table = Table(title="Reaching to targets that stand; medians")
    for head in ("file", "reaches", "held", "until, s", "SSE", "beyond, %", "SPARC", "parts"):
        table.add_column(head)
    for name, each in found.items():
        x = summary(each)
        beyond = None if x["beyond"] is None else 100 * x["beyond"]
        values = (x["reach_s"], x["sse"], beyond, x["sparc"], x["submovements"])
        counts = (str(x["reaches"]), str(x["achieved"]))
        table.add_row(name, *counts, *(number(v) for v in values))
    _print_wide(table)
    out.print(
        "held: 0.75 s within the target, within 10 s; until: to the beginning of that; SSE: "
        "squared error over the squared distance, 100 a second; beyond: past the target, of the "
        "distance."
    )
    told = {k: {"summary": summary(v), "reaches": to_rows(v)} for k, v in found.items()}
    write_json(to_json, "host-reaches", {"files": told})
