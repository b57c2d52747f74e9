"""The application: what every command shares, options and what is printed."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console

from esea_gen import __version__
from esea_gen.errors import UserError, paragraphs

app = typer.Typer(
    name="esea-gen",
    help="From a model of an elastomeric series elastic actuator to verified firmware.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


# Words as they are: no markup in a title, no wrapping of a line that somebody will copy.
out = Console(highlight=False, markup=False, soft_wrap=True)


err = Console(stderr=True, highlight=False)


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        out.print(f"esea-gen {__version__}")
        raise typer.Exit


def main() -> None:
    """Entry point: bad input becomes one paragraph and exit code 2."""
    try:
        app()
    except UserError as error:
        print(paragraphs(f"esea-gen: {error}"), file=sys.stderr)
        raise SystemExit(2) from None
    except BrokenPipeError:
        raise SystemExit(1) from None
