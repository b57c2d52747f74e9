"""What a command shows and writes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeRemainingColumn,
)

from esea_gen.cli.app import err, out
from esea_gen.errors import UserError
from esea_gen.files import write_json


@contextmanager
def progress_line() -> Iterator[Callable[[str], None]]:
    """A line on the terminal that says what is being done, gone when it is."""
    columns = SpinnerColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=err, transient=True) as p:
        task = p.add_task("starting", total=None)
        yield lambda text: p.update(task, description=text)


def progress_bar() -> Progress:
    """A bar on the terminal, gone when done."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    return Progress(*columns, console=err, transient=True)


@contextmanager
def counted(text: str) -> Iterator[Callable[[int, int, int], None]]:
    """A bar that counts cases: done, of how many, failed, and the time left at their mean rate."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    left = TimeRemainingColumn(), TextColumn("left")
    with Progress(
        *columns, *left, console=err, transient=True, speed_estimate_period=math.inf
    ) as p:
        task = p.add_task(text, total=None)

        def tell(done: int, total: int, failed: int) -> None:
            if done < p.tasks[0].completed:  # the next campaign of the same command
                p.reset(task)
            told = f"{text}, {failed} failed" if failed else text
            p.update(task, completed=done, total=total, description=told)

        yield tell


def show(result: Any, json_file: Path | None) -> None:
    """Print a result as a table, then write it as JSON."""
    # The table first: it is there whatever becomes of the file.
    for line in result.table():
        out.print(line)
    write_json(json_file, result.to_dict())


def picture(figure: Path | None, draw: Callable[[], Any]) -> None:
    """Draw and save a figure, if a file was named."""
    from esea_gen.analysis.plots import save

    if figure is None:
        return
    try:
        figure.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{figure}: cannot be written ({error.strerror}).", "Give another file."
        ) from error
    save(draw(), figure)
