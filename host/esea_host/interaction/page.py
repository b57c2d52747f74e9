"""The report: one HTML file, nothing fetched from anywhere."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.figure import Figure

from esea_gen.pages import environment
from esea_gen.plotting import svg
from esea_host.interaction.analysis import InteractionAnalysis
from esea_host.interaction.figures import effects_figure, people_figure
from esea_host.interaction.published import CANNOT, COMMENTS, TABLE_6_2, TABLE_6_3, reread
from esea_host.interaction.survey import diverging_bars


def number(value: float | None, digits: int = 3) -> str:
    if value is None or not math.isfinite(value):
        return "-"
    # A true minus sign; no exponent for what fits in a column.
    text = f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:.0f}"
    return text.replace("-", "−", 1) if text.startswith("-") else text


def render_report(found: InteractionAnalysis) -> str:
    env = environment()
    env.filters["num"] = number

    def drawn(figure: Figure, name: str, alternative: str) -> Any:
        return svg(figure, name, alternative)

    return env.get_template("interaction/report.html.j2").render(
        found=found,
        people=drawn(people_figure(found), "people", "Each person under spring and elastomer"),
        effects=drawn(effects_figure(found), "effects", "Effect and interval of each comparison"),
        bars=None
        if found.survey is None
        else drawn(diverging_bars(found.survey), "survey", "Answers by level, diverging bars"),
        tables=[
            ("6.2, block 1 and 2", reread(TABLE_6_2)),
            ("6.3, spring and elastomer", reread(TABLE_6_3)),
        ],
        cannot=CANNOT,
        published_comments=COMMENTS,
    )
