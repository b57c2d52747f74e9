"""Figures of the wrist study: distributions with every participant, maps, a page of all."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from esea_gen.pages import plain_page
from esea_gen.plotting import INK, MEASURED, MODEL, STYLE, svg
from esea_host.wrist.analysis import TABLES, TableLine, WristResult


def distributions(result: WristResult, title: str) -> Figure:
    """One table's metrics: each participant a line between the two sides, the median beside."""
    lines = TABLES[title].lines
    with style.context(STYLE):
        figure = Figure(figsize=(2.3 * len(lines), 3.0), layout="constrained")
        drawn = np.atleast_1d(figure.subplots(1, len(lines)))
        for axes, line in zip(drawn, lines, strict=True):
            each = [(v.get(line.first), v.get(line.second)) for v in result.people[title].values()]
            pairs = [pair for pair in each if None not in pair]
            for pair in pairs:
                axes.plot((0, 1), pair, "o-", color=MODEL, alpha=0.5, ms=4, lw=0.8)
            if pairs:
                middle = np.median(np.array(pairs, np.float64), axis=0)
                axes.plot((-0.22, 1.22), middle, "_", color=MEASURED, ms=18, mew=3)
            axes.set(xlim=(-0.5, 1.5), xticks=(0, 1), title=line.metric, ylabel=line.unit)
            axes.set_xticklabels(result.sides[title])
        if result.simulated:
            figure.suptitle(f"{title}: simulated participants", color=INK, fontsize=9)
    return figure


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


COLUMNS = ("metric", "unit", "n", "", "", "p", "p Holm", "effect", "95 %", "published", "p")


def cells(line: TableLine) -> list[str]:
    effect = "-"
    if line.effect_low is not None:
        effect = f"{number(line.effect_low)} to {number(line.effect_high)}"
    published = f"{number(line.published[0])} / {number(line.published[1])}"
    people = f"{line.n}, {line.zeros} equal" if line.zeros else str(line.n)
    head = [line.metric, line.unit, people, number(line.first), number(line.second)]
    tests = [number(line.p), number(line.p_holm), number(line.effect), effect]
    return [*head, *tests, published, number(line.published_p)]


def page(result: WristResult) -> str:
    who = "SIMULATED participants" if result.simulated else "participants"
    parts = [f"<h1>Wrist study: {result.participants} {who}</h1>"]
    items = "".join(f"<li>{html.escape(x)}</li>" for x in result.left_out)
    parts.append(f"<p>Left out:</p><ul>{items}</ul>" if items else "<p>Nothing is left out.</p>")
    if result.blinded:
        parts.append("<p class='notice'>BLINDED: neutral names for the two states.</p>")
    for k, (title, lines) in enumerate(result.tables.items()):
        heads = [*COLUMNS[:3], *result.sides[title], *COLUMNS[5:]]
        table = _row("th", heads) + "".join(_row("td", cells(x)) for x in lines)
        notes = "".join(
            f"<p>{html.escape(x.metric)}: {html.escape(x.note)}</p>" for x in lines if x.note
        )
        parts.append(
            f"<h2>Table {html.escape(title)}</h2>"
            f"<div class='table'><table>{table}</table></div>{notes}"
        )
        drawn = svg(distributions(result, title), f"t{k}", f"Each participant, {title}")
        parts.append(f"<figure>{drawn}</figure>")
    parts.append(
        "<p>Medians. Two-sided Wilcoxon signed-rank test, exact up to 50 people; zero differences "
        "dropped; Holm over each table; effect: rank-biserial correlation, score interval.</p>"
    )
    return plain_page("Wrist study", "\n".join(parts))


def _row(kind: str, texts: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{kind}>{html.escape(x)}</{kind}>' for x in texts)}</tr>"
