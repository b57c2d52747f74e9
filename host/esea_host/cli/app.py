"""The application: what every command of ``esea-host`` shares."""

from __future__ import annotations

import sys

import typer
from rich.console import Console

from esea_gen.errors import UserError, paragraphs
from esea_gen.link.transport import LinkError

app = typer.Typer(
    name="esea-host",
    help="Telemetry of an elastomeric series elastic actuator, and experiments with people.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def _app() -> None:
    pass


# Words as they are: no markup in a title, no wrapping of a line that somebody will copy.
out = Console(highlight=False, markup=False, soft_wrap=True)


def told(text: str) -> None:
    """What is being done, while it is: beside the result, not in it."""
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Entry point: bad input, or a board that does not answer, is one paragraph and exit code 2."""
    try:
        app()
    except (UserError, LinkError) as error:
        print(paragraphs(f"esea-host: {error}"), file=sys.stderr)
        raise SystemExit(2) from None
    except BrokenPipeError:
        raise SystemExit(1) from None
