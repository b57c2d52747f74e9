"""Application shared by every command: options, output."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterable, Sequence
from typing import Annotated, Any

import typer

from esea_gen import __version__
from esea_gen.cli.boundary import Shown, by_hand, run
from esea_gen.cli.groups import GroupedCommands
from esea_gen.portability import command_line

# Every command with the file that has it, in the groups that help shows.
GROUPS = {
    "Devices and generated C": {
        "new": "generate",
        "schema": "generate",
        "build": "generate",
        "check": "generate",
        "export": "exporting",
        "report": "pages",
    },
    "Boards": {"firmware": "boards", "emulate": "boards", "faults": "evidence"},
    "Verification of the generated C": {
        "verify": "evidence",
        "coverage": "evidence",
        "ranges": "evidence",
        "fixed": "evidence",
        "gates": "evidence",
        "mutate": "evidence",
        "traces": "evidence",
    },
    "Virtual experiments": {
        "simulate": "experiments",
        "passivity": "experiments",
        "tune": "experiments",
        "reproduce": "experiments",
    },
    "Recordings and real machines": {
        "identify": "identification",
        "uncertainty": "identification",
        "friction": "identification",
        "encoder-table": "identification",
        "advise": "identification",
        "reliability": "identification",
        "specimen": "pages",
        "torque-check": "identification",
    },
}


class Commands(GroupedCommands):
    package, groups = "esea_gen.cli", GROUPS

    def invoke(self, ctx: Any) -> Any:
        """After Ctrl-C, print how to continue."""
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, Exception) as error:
            if not by_hand(error):
                raise
            chosen = self.commands.get(ctx.invoked_subcommand)
            found = (p.metavar for p in chosen.params if p.name == "resume") if chosen else ()
            print(f"\nesea-gen: {stopped(sys.argv[1:], next(iter(found), ''))}", file=sys.stderr)
            raise SystemExit(130) from None


def stopped(words: Sequence[str], resume: str | None) -> str:
    """Finished part of an interrupted command; ``resume``: the place for its --resume, if any."""
    again = command_line("esea-gen", *words)
    if resume not in ("DIR", "FILE"):
        return f"stopped; no file is incomplete. Start again with:\n  {again}"
    if any(w.partition("=")[0] == "--resume" for w in words):
        return f"stopped; finished work is stored. Continue with:\n  {again}"
    return f"stopped; nothing was stored. To store progress, use:\n  {again} --resume {resume}"


app = typer.Typer(
    name="esea-gen",
    cls=Commands,
    help="From a model of an elastomeric series elastic actuator to verified firmware.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Out:
    """Output of a command: lines unchanged, tables by rich, nothing if ``quiet``."""

    quiet = verbose = False

    def print(self, what: Any = "") -> None:
        """Print a line for people, or a table."""
        if self.quiet:
            return
        if isinstance(what, str):
            print(what)
        else:
            from rich.console import Console

            Console(highlight=False, markup=False).print(what)

    def lines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.print(line)

    def next(self, *words: str) -> None:
        """Say which command comes next."""
        self.print(f"next: {command_line('esea-gen', *words)}")


out = Out()


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Print errors only; the result is the exit code.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Print every step, and tracebacks of errors.")
    ] = False,
    trusted: Annotated[
        list[str] | None,
        typer.Option(
            "--trust",
            metavar="SHA256",
            help="Trust the law file with this hash from now on when a device file names it.",
        ),
    ] = None,
) -> None:
    out.quiet, out.verbose, Shown.verbose = quiet, verbose, verbose
    if trusted:
        from esea_gen.trust import trust

        trust(trusted)
        out.print(f"trusted from now on: {', '.join(trusted)}")
    if version:
        print(f"esea-gen {__version__}")
        raise typer.Exit


def main() -> None:
    gc.set_threshold(50_000, 20, 50)  # for objects by the 10^6: 700 costs a tenth of a build
    run("esea-gen", app, lambda: out.quiet)
