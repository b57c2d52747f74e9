"""``esea-host analyse``: from recordings to numbers; each study adds its own command."""

from __future__ import annotations

import typer

from esea_gen.cli.groups import WholeSentences
from esea_host.cli.app import app

analyse = typer.Typer(cls=WholeSentences, help="Analyse what was recorded.", no_args_is_help=True)
app.add_typer(analyse, name="analyse")
