"""Commands that the registry of studies speaks for: their help is read when it is shown."""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from esea_gen.cli.app import out
from esea_gen.cli.names import Written, closed_loop_studies, reproductions, written_studies
from esea_gen.cli.options import DataOption, FigureOption, JsonOption, option, writable
from esea_gen.cli.output import exit_unless, progress_line, show
from esea_gen.errors import UserError
from esea_gen.files import write_whole

CONTROLLER_HELP = "Name of a controller (a wrong one lists all), FILE.py:law or a device file."


class SimulateCommand(TyperCommand):
    """Lists the closed-loop studies below its options."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Name and title of each."""
        known = written_studies()
        with formatter.section("Studies"):
            formatter.write_dl([(k, known[k].title) for k in closed_loop_studies()])


class Reproductions(TyperGroup):
    """A command for every reproduction that is registered."""

    @property
    def commands(self) -> MutableMapping[str, Any]:
        """By name."""
        return _reproductions()

    @commands.setter
    def commands(self, _: Any) -> None:
        return


@cache
def _reproductions() -> dict[str, Any]:
    found = {}
    for written in reproductions():
        single = typer.Typer(add_completion=False, rich_markup_mode=None)
        run = _whole_thesis if written.name == "all" else _reproduce(written)
        single.command(written.name, help=written.help)(run)
        found[written.name] = typer.main.get_command(single)
    return found


def _reproduce(written: Written) -> Callable[..., None]:
    def run(json_file: Path | None, figure: Path | None, data: Path | None = None) -> None:
        from esea_gen.reproduce.reproduction import Reproduction
        from esea_gen.studies.registry import load_study

        # Any reproduction makes something; which, only itself knows.
        study: Reproduction[Any] = load_study(written.name, Reproduction)
        with progress_line() as say:
            outcome = study.run(say, data)
        show(
            outcome,
            json_file,
            f"reproduce-{written.name}",
            figure=figure,
            passed=study.reproduced(outcome),
        )

    def with_data(
        data: DataOption = None, json_file: JsonOption = None, figure: FigureOption = None
    ) -> None:
        if data is None:
            raise UserError(
                f"esea-gen reproduce {written.name} works on recordings, and none are given.",
                "Add --data DIR, the folder that they lie in.",
            )
        run(json_file, figure, data)

    def alone(json_file: JsonOption = None, figure: FigureOption = None) -> None:
        run(json_file, figure)

    return with_data if written.recordings else alone


def _page_file(path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() not in (".html", ".md"):
        raise UserError(f"{path}: not a page's name.", "End it in .html or .md.")
    return writable(path)


def _whole_thesis(
    chapters: Annotated[
        list[int] | None, option("--chapter", "Only this one; may be given again.", min=3, max=8)
    ] = None,
    given: Annotated[
        list[Path] | None,
        option(
            "--given FILE",
            "JSON of esea-host study virtual, or of assess evaluate; again for more.",
        ),
    ] = None,
    page: Annotated[
        Path | None,
        option("--page FILE", "Also write the page: .html or .md.", callback=_page_file),
    ] = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    from esea_gen.report.thesis import thesis_page
    from esea_gen.reproduce.thesis import CHAPTERS, recompute

    with progress_line() as say:
        result = recompute(say, chapters=chapters or CHAPTERS, given=given or ())
    show(result, json_file, "reproduce-all", figure=figure)
    if page is not None:
        command = " ".join(
            ["esea-gen reproduce all", *(f"--chapter {c}" for c in chapters or ())]
            + [f"--given {p.name}" for p in given or ()]
        )
        html = page.suffix.lower() == ".html"
        write_whole(page, thesis_page(result, command) if html else result.markdown())
        out.print(f"page: {page}")
    exit_unless(result.explained)
