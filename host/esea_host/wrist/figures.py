"""Figures of the wrist study: distributions with every participant, maps, a page of all."""

from __future__ import annotations

import html

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from esea_gen.pages import plain_page
from esea_gen.plotting import BOUND, INK, MEASURED, MODEL, STYLE, svg
from esea_host.wrist.analysis import LEARNED, TRACKED, TableLine, WristResult
from esea_host.wrist.normalisation import CursorMap, NodeSpeeds, fit_rbf


def distributions(result: WristResult, title: str) -> Figure:
    """One table's metrics: each participant a line between the two sides, the median beside."""
    tracked = title.startswith(("7.1", "7.2"))
    metrics = (
        [(m, unit, a, b) for m, unit, a, b in TRACKED]
        if tracked
        else [(m, unit, f"{k} 1", f"{k} 2") for m, unit, k in LEARNED]
    )
    with style.context(STYLE):
        figure = Figure(figsize=(2.3 * len(metrics), 3.0), layout="constrained")
        for axes, (metric, unit, first, second) in zip(
            np.atleast_1d(figure.subplots(1, len(metrics))), metrics, strict=True
        ):
            pairs = [
                (v[first], v[second])
                for v in result.people[title].values()
                if v.get(first) is not None and v.get(second) is not None
            ]
            for pair in pairs:
                axes.plot((0, 1), pair, "o-", color=MODEL, alpha=0.5, ms=4, lw=0.8)
            if pairs:
                middle = np.median(np.array(pairs, np.float64), axis=0)
                axes.plot((-0.22, 1.22), middle, "_", color=MEASURED, ms=18, mew=3)
            axes.set(xlim=(-0.5, 1.5), xticks=(0, 1), title=metric, ylabel=unit)
            axes.set_xticklabels(result.sides[title])
        if result.simulated:
            figure.suptitle(f"{title}: simulated participants", color=INK, fontsize=9)
    return figure


def maps(healthy: NodeSpeeds, constrained: NodeSpeeds, found: CursorMap, axis: str) -> Figure:
    """Healthy, compressed and constrained speed; the scaling factor; the cursor's position."""
    middle = found.middle_deg
    width = (constrained.high_deg - constrained.low_deg) / (healthy.high_deg - healthy.low_deg)
    centre = (healthy.low_deg + healthy.high_deg) / 2
    theta = np.linspace(found.low_deg, found.high_deg, 300)
    with style.context(STYLE):
        figure = Figure(figsize=(9.5, 3.0), layout="constrained")
        speeds, factor, position = figure.subplots(1, 3)
        known = np.array(healthy.speeds_deg_s, np.float64)
        nodes = np.array(healthy.nodes_deg)
        speeds.plot(nodes, known, "o-", color=MODEL, label="healthy", lw=1)
        compressed = middle + width * (nodes - centre)
        network = fit_rbf(compressed - middle, known)
        speeds.plot(theta, network.value(theta - middle), color=BOUND, label="compressed")
        own = np.array(constrained.speeds_deg_s, np.float64)
        speeds.plot(constrained.nodes_deg, own, "s-", color=MEASURED, label="constrained", lw=1)
        speeds.set(title=f"{axis}: speed at nodes", xlabel="deg", ylabel="deg/s", ylim=(0, None))
        speeds.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, fontsize=8)
        factor.plot(theta, found.scaling(theta), color=MODEL)
        at_nodes = np.array(constrained.nodes_deg)
        factor.plot(at_nodes, found.scaling(at_nodes), "o", color=MEASURED)
        factor.set(title="scaling factor", xlabel="wrist, deg", ylim=(0, None))
        position.plot(theta, found.position(theta), color=MODEL)
        position.plot(theta, theta - middle, color=MEASURED, lw=1, ls="--", label="shift alone")
        position.set(title="cursor", xlabel="wrist, deg", ylabel="deg")
        position.legend()
    return figure


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


COLUMNS = ("metric", "unit", "n", "", "", "p", "p Holm", "effect", "95 %", "published", "p")


def cells(line: TableLine) -> list[str]:
    effect = "-"
    if line.effect_low is not None:
        effect = f"{number(line.effect_low)} to {number(line.effect_high)}"
    published = f"{number(line.published[0])} / {number(line.published[1])}"
    head = [line.metric, line.unit, str(line.n), number(line.first), number(line.second)]
    tests = [number(line.p), number(line.p_holm), number(line.effect), effect]
    return [*head, *tests, published, number(line.published_p)]


def page(result: WristResult) -> str:
    who = "SIMULATED participants" if result.simulated else "participants"
    parts = [
        f"<h1>Wrist study: {result.participants} {who}</h1>",
    ]
    for k, (title, lines) in enumerate(result.tables.items()):
        first, second = result.sides[title]
        heads = [*COLUMNS[:3], first, second, *COLUMNS[5:]]
        rows = "".join(
            "<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in cells(x)) + "</tr>"
            for x in lines
        )
        notes = "".join(
            f"<p>{html.escape(x.metric)}: {html.escape(x.note)}</p>" for x in lines if x.note
        )
        parts.append(
            f"<h2>Table {html.escape(title)}</h2><div class='table'><table><tr>"
            + "".join(f"<th>{html.escape(h)}</th>" for h in heads)
            + f"</tr>{rows}</table></div>{notes}"
        )
        drawn = svg(distributions(result, title), f"t{k}", f"Each participant, {title}")
        parts.append(f"<figure>{drawn}</figure>")
    parts.append(
        "<p>Medians. Two-sided Wilcoxon signed-rank test, exact; zero differences dropped; Holm's "
        "correction over each table; effect: rank-biserial correlation with its score interval.</p>"
    )
    return plain_page("Wrist study", "\n".join(parts))
