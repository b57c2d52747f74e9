"""Closed-loop studies: ``simulate``, ``passivity``, ``tune``; published ones: ``reproduce``."""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from esea_gen.cli import options
from esea_gen.cli.app import app, out
from esea_gen.cli.names import (
    PEOPLE,
    PLANTS,
    Written,
    closed_loop_studies,
    completing,
    configured,
    reproductions,
    written_studies,
)
from esea_gen.cli.options import (
    DataOption,
    FigureOption,
    JsonOption,
    chosen_formats,
    option,
    output_file,
)
from esea_gen.cli.output import counted, exit_unless, progress_line, show
from esea_gen.devices import BEST_CONTROLLER
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.typed import read_number

CONTROLLER_HELP = "Name of a controller (an unknown one lists all), FILE.py:law or a device file."


class SimulateCommand(TyperCommand):
    """Lists the closed-loop studies below its options."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        known = written_studies()
        with formatter.section("Studies"):
            formatter.write_dl([(k, known[k].title) for k in closed_loop_studies()])


class Reproductions(TyperGroup):
    """A command for every reproduction that is registered."""

    @property
    def commands(self) -> MutableMapping[str, Any]:
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
        from esea_gen.studies.registry import Reproduction, load_study

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
                f"esea-gen reproduce {written.name} needs recordings.",
                "Add --data DIR, the folder of the recordings.",
            )
        run(json_file, figure, data)

    def alone(json_file: JsonOption = None, figure: FigureOption = None) -> None:
        run(json_file, figure)

    return with_data if written.recordings else alone


def _whole_thesis(
    chapters: Annotated[
        list[int] | None, option("--chapter", "Only this one; repeatable.", min=3, max=8)
    ] = None,
    given: Annotated[
        list[Path] | None,
        option(
            "--given FILE", "JSON of esea-host study virtual, or of assess evaluate; repeatable."
        ),
    ] = None,
    page: Annotated[Path | None, output_file("--page", "Also write an HTML page.")] = None,
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
        write_whole(page, thesis_page(result, command))
        out.print(f"page: {page}")
    exit_unless(result.explained)


MOST_WALL_NM_RAD = 1e4  # a light hand is thrown back within 7 ms; a plant's step is 0.2 ms
FEW_RUNS = 20  # a run takes half a second: a few are done before other processes have started
ControllerOption = Annotated[
    str, option("--controller NAME", CONTROLLER_HELP, autocompletion=completing(configured))
]
ControllersOption = Annotated[
    list[str] | None,
    option(
        "--controller NAME",
        f"{CONTROLLER_HELP} Default: {BEST_CONTROLLER}. Repeatable: one table of all.",
        autocompletion=completing(configured),
    ),
]
PlantOption = Annotated[str, options.one_of("--plant", "Virtual exoskeleton.", PLANTS)]
OffOption = Annotated[
    str,
    option(
        "--off FAMILY",
        "Model mismatch of the plant: one, several "
        "separated by commas, or all (an unknown one lists them).",
    ),
]
FaultOption = Annotated[
    str,
    option(
        "--fault KIND:ENCODER@SECONDS[=AMOUNT]",
        "Encoder fault: freeze, slip, drift, gain, zero or one (a bit), noise; of load, "
        "motor, both or gear.",
    ),
]

AxisOption = Annotated[
    str, option("--axis NAME", "Axis that is moved, the others at 0 Nm; default: the first.")
]

app.add_typer(
    typer.Typer(
        cls=Reproductions,
        help="Recompute published tables with the emitted C.",
        no_args_is_help=True,
    ),
    name="reproduce",
)


@app.command(cls=SimulateCommand)
def simulate(
    study: Annotated[
        str,
        typer.Argument(
            metavar="STUDY",
            help="One of those below, or FILE.py:name.",
            autocompletion=completing(closed_loop_studies),
        ),
    ],
    controller: ControllersOption = None,
    plant: PlantOption = "real",
    person: Annotated[
        str | None,
        option(
            "--person NAME",
            f"Person who moves the load: {', '.join(PEOPLE)}; default: depends on plant and study.",
            autocompletion=completing(lambda: PEOPLE),
        ),
    ] = None,
    off: OffOption = "none",
    seed: options.SeedOption = 0,
    runs: Annotated[int, option("--runs", "Runs per case.", min=1)] = 1,
    real: Annotated[str, option("--real f64|f32|q31", "Number format of the controller.")] = "f32",
    fault: FaultOption = "",
    axis: AxisOption = "",
    jobs: options.JobsOption = -1,
    cluster: options.ClusterOption = None,
    resume: options.JournalOption = None,
    csv_file: Annotated[Path | None, output_file("--csv", "Also write every run as CSV.")] = None,
    json_file: options.JsonOption = None,
    figure: options.FigureOption = None,
) -> None:
    """Run a study: a controller's C against the virtual exoskeleton, as in the thesis or yours.

    Exit code 1: a run was unstable, tripped or latched a fault, which the table names.
    """
    from esea_gen.analysis.campaign import Workers
    from esea_gen.emit.formats import FORMATS
    from esea_gen.studies.off_table import simulate_off
    from esea_gen.studies.registry import load_study
    from esea_gen.studies.simulation import ClosedLoopStudy, default_person
    from esea_gen.twin.case import Setting
    from esea_gen.twin.off import chosen_families

    few = jobs == -1 and runs * len(load_study(study, ClosedLoopStudy).cases_run()) <= FEW_RUNS
    (real,) = chosen_formats([real], FORMATS)
    who = person or default_person(study, plant)
    laws = list(dict.fromkeys(controller or [BEST_CONTROLLER]))
    families = chosen_families(off, rigid=plant == "ideal")
    with counted(f"{study}, {', '.join(laws)}") as tell:
        result = simulate_off(
            study,
            [
                Setting(law, plant, who, real, fault=fault, off=name, axis=axis)
                for name in families
                for law in laws
            ],
            seed=seed,
            runs=runs,
            workers=Workers(1 if few else jobs, cluster),
            folder=resume,
            progress=tell,
        )
    show(result, json_file, "simulate", figure=figure)
    if csv_file is not None:
        write_whole(csv_file, result.csv())
    exit_unless(result.sound)


@app.command()
def passivity(
    controller: ControllerOption = BEST_CONTROLLER,
    plant: PlantOption = "real",
    points: Annotated[int, option("--points N", "Gains along each axis.", min=2, max=41)] = 9,
    push: Annotated[float, option("--push RAD_S", "Speed of a free hand after the push.")] = 0.5,
    seed: options.SeedOption = 0,
    wall: Annotated[
        float,
        option(
            "--wall NM_RAD",
            "Stiffness of a wall 0.02 rad ahead of the hand: contact and release. 0: no wall.",
            min=0,
            max=MOST_WALL_NM_RAD,
        ),
    ] = 0.0,
    sliding: Annotated[
        bool, option("--sliding/--no-sliding", "Also check the sliding condition.")
    ] = True,
    axis: AxisOption = "",
    jobs: options.JobsOption = -1,
    cluster: options.ClusterOption = None,
    json_file: options.JsonOption = None,
    figure: options.FigureOption = None,
) -> None:
    """Passivity of the rendered impedance over its gains, with pushed hands; sliding condition."""
    from esea_gen.analysis.campaign import Workers
    from esea_gen.studies.passivity.study import study_interaction

    with counted(f"passivity, {controller}") as tell:
        result = study_interaction(
            controller,
            plant,
            points=points,
            push_rad_s=push,
            seed=seed,
            wall_Nm_rad=wall,
            axis=axis,
            sliding=sliding,
            workers=Workers(jobs, cluster),
            progress=tell,
        )
    show(result, json_file, "passivity", figure=figure)


@app.command()
def tune(
    controller: ControllerOption = "smc",
    plant: PlantOption = "real",
    parameter: Annotated[
        str | None, option("--parameter NAME", "Tunable; default: the thesis' procedure.")
    ] = None,
    values: Annotated[str, option("--values A,B,C", "Values of the parameter.")] = "",
    seed: options.SeedOption = 0,
    jobs: options.JobsOption = 1,
    cluster: options.ClusterOption = None,
    json_file: options.JsonOption = None,
    figure: options.FigureOption = None,
) -> None:
    """Sweep tunables in the tuning case: error, overshoot, roughness; print choice and reason."""
    from esea_gen.analysis.campaign import Workers
    from esea_gen.studies.tuning_sweep import tune as sweep_tunables

    try:
        row = [read_number(v) for v in values.split(",")] if values.strip() else []
    except UserError:
        raise UserError(
            f"--values {values}: not a list of numbers.", "Write them as 1,1.5,2."
        ) from None
    with counted(f"tuning, {controller}") as tell:
        result = sweep_tunables(
            controller,
            plant,
            parameter=parameter,
            values=row,
            seed=seed,
            workers=Workers(jobs, cluster),
            progress=tell,
        )
    ran = all(sweep.ran for sweep in result.sweeps)
    show(result, json_file, "tune", figure=figure, passed=ran)
