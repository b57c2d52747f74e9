"""Pages in HTML, one file each, nothing fetched from anywhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jinja2

from esea_gen.emit.render import template_folder
from esea_gen.plotting import svg
from esea_host.assess import NOTICE
from esea_host.assess.pictures import (
    calibration_picture,
    confusion_picture,
    motions_picture,
    session_page,
)
from esea_host.assess.session import Assessment
from esea_host.assess.words import conclusion


def _render(template: str, **context: Any) -> str:
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    return env.get_template(f"assess/{template}.html.j2").render(notice=NOTICE, **context)


def evaluation_page(result: Mapping[str, Any]) -> str:
    """The evaluation as a page."""

    def row(text: str, key: str, aim: str, form: str = "{:.2f}") -> tuple[str, str, str, str]:
        low, high = result[f"{key}_interval"]
        ends = f"{form.format(low)} to {form.format(high)}"
        return text, form.format(result[key]), ends, aim

    rows = [
        row("Movements to 95 % against random", "motions_ratio", "at most 0.5"),
        row("Movements to 95 % against a fixed protocol", "motions_ratio_fixed", ""),
        row("Calibration error", "calibration_error", "at most 0.05", "{:.3f}"),
        row("None of these, people of no category", "none_rate_outside", "at least 0.9"),
        row("None of these or no sign, patients", "none_rate_inside", "at most 0.05"),
    ]
    figures = [
        svg(confusion_picture(result), "confusion", "Simulated patients by category and answer"),
        svg(calibration_picture(result), "calibration", "Shown probability against share right"),
        svg(motions_picture(result), "motions", "Movements to 95 percent, four ways"),
    ]
    title = "Knee assessment, judged on simulated patients"
    return _render("evaluation", title=title, r=result, rows=rows, figures=figures)


def session_html(session: Assessment, who: str = "") -> str:
    """One assessment as a page."""
    figure = svg(session_page(session, who), "session", "Probabilities, history, map and steps")
    title = "Knee: assessment of resistance to movement"
    return _render("session", title=title, lines=conclusion(session), figure=figure)
