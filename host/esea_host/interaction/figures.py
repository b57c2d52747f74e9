"""Pictures of an analysis, and the report: one HTML file, nothing fetched from anywhere."""

from __future__ import annotations

import math

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from esea_gen.pages import environment
from esea_gen.plotting import BOUND, INK, MEASURED, MODEL, RULE, STYLE, svg
from esea_host.interaction.analysis import InteractionAnalysis
from esea_host.interaction.loading import Array, LoadingCurve
from esea_host.interaction.published import CANNOT, COMMENTS, TABLE_6_2, TABLE_6_3, reread
from esea_host.interaction.survey import diverging_bars

SPRING_COLOUR, ELASTOMER_COLOUR = MODEL, MEASURED


def people_figure(found: InteractionAnalysis) -> Figure:
    """Each person under both elements, one field a metric and task; the bar is the median."""
    tasks = list(dict.fromkeys(c.task for c in found.comparisons))
    metrics = list(dict.fromkeys(c.metric for c in found.comparisons))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.35 * len(metrics), 2.5 * len(tasks)), layout="constrained")
        fields = figure.subplots(len(tasks), len(metrics), squeeze=False)
        for c in found.comparisons:
            axes = fields[tasks.index(c.task)][metrics.index(c.metric)]
            axes.plot([0, 1], c.values.T, color=RULE, linewidth=0.9, zorder=1)
            for x, (column, colour) in enumerate(
                zip(c.values.T, (SPRING_COLOUR, ELASTOMER_COLOUR), strict=True)
            ):
                axes.plot(np.full(len(column), x), column, "o", color=colour, markersize=3.5)
                axes.hlines(np.median(column), x - 0.16, x + 0.16, color=INK, linewidth=1.6)
            axes.set_xlim(-0.4, 1.4)
            axes.set_xticks([0, 1], ["spring", "elastomer"])
            unit = "" if c.made.unit == "1" else f"\n{c.made.unit}".replace("^2", "²")
            axes.set_title(f"{c.task}: {c.metric}{unit}")
            axes.grid(visible=False, axis="x")
    return figure


def effects_figure(found: InteractionAnalysis) -> Figure:
    """Rank-biserial correlation with interval: to the right the elastomer is smoother."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 0.34 * len(found.comparisons) + 1.2), layout="constrained")
        axes = figure.add_subplot()
        for row, c in enumerate(reversed(found.comparisons)):
            # Spring minus elastomer: positive favours the elastomer where smaller is smoother.
            sign = -1 if c.made.larger_is_smoother else 1
            ends = sorted(
                sign * x for x in (c.device.rank_biserial_low, c.device.rank_biserial_high)
            )
            axes.hlines(row, ends[0], ends[1], color=MODEL, linewidth=2)
            axes.plot(sign * c.device.rank_biserial, row, "o", color=MODEL, markersize=5)
        axes.axvline(0, color=INK, linewidth=0.8)
        axes.set_xlim(-1.05, 1.05)
        axes.set_yticks(
            range(len(found.comparisons)),
            [f"{c.task}: {c.metric}" for c in reversed(found.comparisons)],
        )
        axes.set_title("Rank-biserial correlation with 95 % interval")
        axes.set_xlabel("spring smoother   |   elastomer smoother")
    return figure


def loading_figure(theta_rad: Array, tau_Nm: Array, curve: LoadingCurve, simulated: bool) -> Figure:
    """The complete record, its loading branches, and the line through them."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.4, 3.6), layout="constrained")
        axes = figure.add_subplot()
        theta_deg = np.rad2deg(theta_rad)
        axes.plot(theta_deg, tau_Nm, color=RULE, linewidth=1, label="whole record")
        for k, b in enumerate(curve.branches):
            part = slice(b.start, b.stop)
            label = "loading branches" if k == 0 else None
            axes.plot(theta_deg[part], tau_Nm[part], color=MEASURED, linewidth=1.6, label=label)
        x = np.rad2deg(curve.amplitude_rad) * np.array([-1.0, 1.0])
        text = f"{curve.stiffness_Nm_deg:.4f} Nm/deg"
        axes.plot(x, curve.line_Nm(np.deg2rad(x)), color=BOUND, linewidth=1.2, label=text)
        axes.set_xlabel("deflection, deg")
        axes.set_ylabel("torque, Nm")
        axes.legend(title="SIMULATED" if simulated else None)
    return figure


def number(value: float | None, digits: int = 3) -> str:
    if value is None or not math.isfinite(value):
        return "-"
    # A true minus sign; no exponent for what fits in a column.
    text = f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:.0f}"
    return text.replace("-", "−", 1) if text.startswith("-") else text


def render_report(found: InteractionAnalysis) -> str:
    env = environment()
    env.filters["num"] = number

    return env.get_template("interaction/report.html.j2").render(
        found=found,
        people=svg(people_figure(found), "people", "Each person under spring and elastomer"),
        effects=svg(effects_figure(found), "effects", "Effect and interval of each comparison"),
        bars=None
        if found.survey is None
        else svg(diverging_bars(found.survey), "survey", "Answers by level, diverging bars"),
        tables=[
            ("6.2, block 1 and 2", reread(TABLE_6_2)),
            ("6.3, spring and elastomer", reread(TABLE_6_3)),
        ],
        cannot=CANNOT,
        published_comments=COMMENTS,
    )
