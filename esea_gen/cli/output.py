"""Output of commands: tables, JSON, figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from esea_gen.cli.app import out
from esea_gen.files import plain, write_json

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


def _terminal() -> Console:
    from rich.console import Console

    return Console(stderr=True, highlight=False)


def _progress(*columns: Any, **settings: Any) -> Progress:
    # Gone when done; nothing where nobody looks.
    from rich.progress import Progress

    console = _terminal()
    hidden = out.quiet or not console.is_terminal
    return Progress(*columns, console=console, transient=True, disable=hidden, **settings)


@contextmanager
def progress_line() -> Iterator[Callable[[str], None]]:
    """A progress line on the terminal, removed at the end."""
    from rich.progress import SpinnerColumn, TextColumn

    with _progress(SpinnerColumn(), TextColumn("{task.description}")) as p:
        task = p.add_task("starting", total=None)

        def say(text: str) -> None:
            p.update(task, description=text)
            if out.verbose:
                p.console.print(text, markup=False)

        yield say


@contextmanager
def progress_share() -> Iterator[Callable[[float, str], None]]:
    """A progress line with a share from 0 to 1."""
    with progress_line() as say:
        yield lambda share, what: say(f"{100 * share:.0f} % {what}")


def progress_bar() -> Progress:
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

    return _progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())


@contextmanager
def counted(text: str) -> Iterator[Callable[[int, int, int], None]]:
    """A bar that counts cases: done, of how many, failed, and the time left at their mean rate."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    left = TimeRemainingColumn(), TextColumn("left")
    with _progress(*columns, *left, speed_estimate_period=math.inf) as p:
        task = p.add_task(text, total=None)

        def tell(done: int, total: int, failed: int) -> None:
            if done < p.tasks[0].completed:  # the next campaign of the same command
                p.reset(task)
            told = f"{text}, {failed} failed" if failed else text
            p.update(task, completed=done, total=total, description=told)

        yield tell


def show(
    result: Any,
    json_file: Path | None,
    what: str,
    *,
    figure: Path | None = None,
    passed: bool = True,
    simulated: bool | None = None,
) -> None:
    """Print a result's table, write it as JSON of the schema `what`, draw it; exit 1 if failed."""
    # The table first, in case writing the file fails.
    out.lines(result.table())
    content = result.to_dict() if hasattr(result, "to_dict") else plain(result)
    write_json(json_file, what, content, simulated)
    if figure is not None:
        picture(figure, result.figure)
    exit_unless(passed)


def exit_unless(passed: bool) -> None:
    if not passed:
        raise typer.Exit(1)


def picture(figure: Path | None, draw: Callable[[], Any]) -> None:
    """Draw and save a figure, if a file was named."""
    if figure is not None:
        from esea_gen.analysis.plots import save

        save(draw(), figure)
