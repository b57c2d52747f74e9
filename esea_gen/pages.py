"""HTML pages: one self-contained file each, from templates."""

from __future__ import annotations

import jinja2
from markupsafe import Markup

from esea_gen.files import template_folder
from esea_gen.plotting import DARK


def environment() -> jinja2.Environment:
    """A Jinja environment of pages: HTML is escaped, an undefined name is an error."""
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=True,
    )
    env.globals["dark_figures"] = {name: colour for name, (_, colour) in DARK.items()}
    return env


def plain_page(title: str, body: str) -> str:
    template = environment().get_template("page/plain.html.j2")
    return template.render(title=title, body=Markup(body))
