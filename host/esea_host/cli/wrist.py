"""``analyse wrist``: the wrist study's tables, and its methods compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from esea_gen.files import write_json, write_whole
from esea_host.cli.analyse import analyse as analyse_app
from esea_host.cli.app import out

if TYPE_CHECKING:
    from esea_host.wrist.analysis import WristResult

JsonOption = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write as JSON.")]
ReportOption = Annotated[
    Path | None, typer.Option("--report", metavar="FILE", help="Write one HTML page.")
]
CsvOption = Annotated[
    Path | None, typer.Option("--csv", metavar="FILE", help="Write every participant's values.")
]


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
    out.print(table)
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
    """The wrist study's tables, on the screen and in files."""
    from esea_host.wrist.figures import COLUMNS, cells, page

    mark = "SIMULATED participants" if result.simulated else "participants"
    for title, lines in result.tables.items():
        first, second = result.sides[title]
        table = Table(title=f"Table {title}: {result.participants} {mark}")
        for head in (*COLUMNS[:3], first, second, *COLUMNS[5:]):
            table.add_column(head)
        for line in lines:
            table.add_row(*cells(line))
        out.print(table)
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
        pd.DataFrame(rows).to_csv(csv, index=False)
