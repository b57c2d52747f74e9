"""``analyse wrist``: the wrist study's tables, and its methods compared."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from esea_gen.files import write_json, write_whole
from esea_host.cli.app import out, say_left_out
from esea_host.cli.interaction import analyse as analyse_app
from esea_host.cli.options import JsonOption, ReportOption, output_file

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
    """What was asked of ``study virtual``."""

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
    from esea_host.wrist.compared import compare_methods
    from esea_host.wrist.figures import number

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
        "healthy.  Targets, after-effect: healthy less constrained; 0 is what is wanted."
    )
    for x in found:
        for reason in x.refused:
            out.print(f"{x.method}: ended early: {reason}")
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
    for x in runs:
        for reason in x.early:
            out.print(f"{x.name} {x.end}: ended early: {reason}")
    write_json(asked.to_json, "host-wrist-sensitivity", {"simulated": True, "runs": runs})
    if asked.report:
        write_whole(asked.report, sensitivity_page(runs, asked.participants))


@analyse_app.command("wrist")
def analyse_wrist(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The study's folder.")],
    to_json: JsonOption = None,
    report: ReportOption = None,
    csv: Annotated[Path | None, output_file("--csv", "Write every participant's values.")] = None,
    blinded: Annotated[
        bool, typer.Option("--blinded", help="States by neutral names, as while blinded.")
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
        for line in lines:
            if line.note:
                out.print(f"{line.metric}: {line.note}")
    out.print(
        "Medians; two-sided Wilcoxon signed-rank test, exact, zero differences dropped; Holm over "
        "each table; effect: rank-biserial correlation."
    )
    write_json(to_json, "host-wrist", vars(result))
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
    from esea_host.wrist.reaching import reaches, summary

    found = {}
    for path in files:
        with open_log(path) as log:
            warn_unless_complete(path, log.integrity)
            found[path.name] = reaches(log[stream])
    rows = []
    for name, each in found.items():
        x = summary(each)
        beyond = None if x["beyond"] is None else 100 * x["beyond"]
        values = (x["reach_s"], x["sse"], beyond, x["sparc"], x["submovements"])
        rows.append((name, str(x["reaches"]), str(x["achieved"]), *map(number, values)))
    heads = ("file", "reaches", "held", "until, s", "SSE", "beyond, %", "SPARC", "parts")
    _print_table("Reaching to targets that stand; medians", heads, rows)
    out.print(
        "held: 0.75 s within the target, within 10 s; until: to the beginning of that; SSE: "
        "squared error over the squared distance, 100 a second; beyond: past the target, of the "
        "distance."
    )
    told = {k: {"summary": summary(v), "reaches": v} for k, v in found.items()}
    write_json(to_json, "host-reaches", {"files": told})
