"""Application shared by every command of ``esea-host``."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import Annotated, Any

import typer
from rich.console import Console

from esea_gen.cli.boundary import Shown, run
from esea_gen.cli.groups import GroupedCommands
from esea_gen.link.received import shown_lines

# Every command with the files that have it, in the groups that help shows.
GROUPS = {
    "A board, live": {
        "view": "view",
        "monitor": "live",
        "record": "live",
        "zero": "live",
        "parameters": "live",
        "sim": "live",
        "sim-moteus": "live",
        "bridge": "live",
        "serve": "live",
        "demo": "view",
        "wrist": "view",
        "pair": "board",
        "unpair": "board",
    },
    "Stored data of a board, and its joint": {
        "commission": "commission",
        "kept": "board",
        "blackbox": "board",
        "life": "board",
    },
    "Recordings": {"show": "logs", "replay": "logs", "export": "logs", "import": "logs"},
    "Studies and analysis": {
        "study": "study study_data session wrist",
        "assess": "assess",
        "analyse": "interaction wrist",
        "smoothness": "interaction",
    },
}


class HostCommands(GroupedCommands):
    package, groups = "esea_host.cli", GROUPS


app = typer.Typer(
    name="esea-host",
    cls=HostCommands,
    help="Telemetry of an elastomeric series elastic actuator, and experiments with people.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def _app(
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Show an error's traceback.")
    ] = False,
) -> None:
    Shown.verbose = verbose


class _Terminal(Console):
    # What came from a board or a file moves no cursor and changes no colour.

    def print(self, *objects: Any, **how: Any) -> None:
        super().print(*(shown_lines(o) if isinstance(o, str) else o for o in objects), **how)


# Words as they are: no markup in a title, no wrapping of a line that somebody will copy.
out = _Terminal(highlight=False, markup=False, soft_wrap=True)


def say(lines: Iterable[object]) -> None:
    for line in lines:
        out.print(line)


def told(text: str) -> None:
    """Show progress beside the result, not in it."""
    print(shown_lines(text), file=sys.stderr, flush=True)


def say_left_out(lines: Sequence[str]) -> None:
    """Report unused data and the reason first."""
    out.print("Left out:" if lines else "Nothing is left out.")
    say(f"  {line}" for line in lines)


def main() -> None:
    run("esea-host", app)
