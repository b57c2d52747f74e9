"""Shared parts of the pages: sections, the Jinja environment, numbers as text."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup

from esea_gen import pages

STATUS_MARKS = {"published": "●", "identified": "◆", "assumed": "▲", "derived": "○"}


class PageSection(NamedTuple):
    part: str  # its template below templates/report; the last word is its anchor
    title: str = ""  # in the page's list of sections
    content: Callable[[Any], dict[str, Any]] = lambda _: {}  # its part of the JSON
    shown: Callable[[Any], dict[str, Any]] = lambda _: {}  # what its template needs beside it


@cache
def environment() -> jinja2.Environment:
    env = pages.environment()
    env.filters |= {
        "num": number,
        "plain": plain,
        "unit": unit_text,
        "people": for_people,
        "count": count_text,
        "mathml": Markup,  # presentation MathML of a Block: our own output, so not escaped
        "mark": STATUS_MARKS.__getitem__,
    }
    return env


def render(head: PageSection, sections: Sequence[PageSection], found: Any, **context: Any) -> str:
    for section in (head, *sections):
        context |= section.shown(found)
    template = environment().get_template("report/page.html.j2")
    return template.render(head=head, sections=sections, found=found, **context)


def number(value: float | None, digits: int = 2) -> str | Markup:
    """A measured or derived figure, rounded; very small and large ones as powers of ten."""
    if value is None:
        return "–"
    if not math.isfinite(value):
        return "∞" if value > 0 else "–∞" if value < 0 else "not a number"
    if value == 0:
        return "0"
    if 1e-3 <= abs(value) < 1e5:
        places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
        return f"{value:.{places}f}".replace("-", "−")
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    text = mantissa.replace("-", "−")
    power = str(int(exponent)).replace("-", "−")
    return Markup('<span class="n">{}·10<sup>{}</sup></span>').format(text, power)


def plain(value: float) -> str | Markup:
    """A parameter's value: six significant digits, no more zeros than it needs."""
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        short = f"{value:.5e}".split("e")[0].rstrip("0").rstrip(".")
        return number(value, max(1, len(short.replace(".", "").lstrip("-"))))
    return f"{value:.6g}".replace("-", "−")


def unit_text(unit: str) -> str:
    if unit in ("1", "bits"):
        return ""
    raised = unit.replace("^2", "²").replace("^3", "³")
    return raised.replace("Nm s", "Nm·s").replace("Nm", "N·m")


def for_people(value: float, unit: str) -> str:
    """The same value in degrees, for angles and their rates."""
    if unit not in ("rad", "rad/s"):
        return ""
    degrees = math.degrees(value)
    text = f"{degrees:.3g}" if abs(degrees) < 1000 else count_text(round(degrees))
    return text.replace("-", "−") + ("°/s" if unit == "rad/s" else "°")


def count_text(value: int) -> str:
    """A whole number with thin spaces between thousands."""
    return f"{value:,}".replace(",", "\u202f")
