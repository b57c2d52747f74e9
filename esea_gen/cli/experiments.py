"""Closed-loop studies: ``simulate``, ``passivity``, ``tune``; published ones: ``reproduce``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.app import app
from esea_gen.cli.names import PEOPLE, PLANTS, closed_loop_studies, completing, configured
from esea_gen.cli.options import (
    ClusterOption,
    FigureOption,
    JobsOption,
    JsonOption,
    chosen_formats,
    writable,
)
from esea_gen.cli.output import counted, picture, show
from esea_gen.cli.studies import CONTROLLER_HELP, Reproductions, SimulateCommand, StudyCommand
from esea_gen.errors import UserError
from esea_gen.files import write_whole

FEW_RUNS = 20  # a run takes half a second: a few are done before other processes have started
ControllerOption = Annotated[
    str,
    typer.Option(
        "--controller",
        metavar="NAME",
        help=CONTROLLER_HELP,
        autocompletion=completing(configured),
    ),
]
ControllersOption = Annotated[
    list[str] | None,
    typer.Option(
        "--controller",
        metavar="NAME",
        help=f"{CONTROLLER_HELP} Default: smc. Given again: one table of all.",
        autocompletion=completing(configured),
    ),
]
PlantOption = Annotated[
    str,
    typer.Option(
        "--plant",
        metavar="|".join(PLANTS),
        help="Virtual exoskeleton.",
        autocompletion=completing(lambda: PLANTS),
    ),
]
OffOption = Annotated[
    str,
    typer.Option(
        "--off",
        metavar="FAMILY",
        help="In what the plant differs from the controller's model; several with a comma "
        "between, or all (a wrong one lists them).",
    ),
]
FaultOption = Annotated[
    str,
    typer.Option(
        "--fault",
        metavar="KIND:ENCODER@SECONDS[=AMOUNT]",
        help="Let an encoder fail: freeze, slip, drift or gain of load, motor, both or gear.",
    ),
]

AxisOption = Annotated[
    str,
    typer.Option(
        "--axis",
        metavar="NAME",
        help="Of several axes: which is moved, the others at 0 Nm. Default: the first.",
    ),
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
        typer.Option(
            "--person",
            metavar="NAME",
            help=f"Who moves the load: {', '.join(PEOPLE)}; default: what suits plant and study.",
            autocompletion=completing(lambda: PEOPLE),
        ),
    ] = None,
    off: OffOption = "none",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the first run.")] = 0,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Runs of each case.")] = 1,
    real: Annotated[
        str, typer.Option("--real", metavar="f64|f32|q31", help="Number format of the controller.")
    ] = "f32",
    fault: FaultOption = "",
    adapted: Annotated[
        bool,
        typer.Option("--adapted", help="Adapted to the rubber before, with a known mass."),
    ] = False,
    axis: AxisOption = "",
    jobs: JobsOption = -1,
    cluster: ClusterOption = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="DIR", help="Journal: continue an interrupted run."),
    ] = None,
    csv_file: Annotated[
        Path | None,
        typer.Option(
            "--csv", metavar="FILE", callback=writable, help="Also write every run as CSV."
        ),
    ] = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Run a study: a controller's C against the virtual exoskeleton, as in the thesis or yours."""
    from esea_gen.analysis.campaign import Workers
    from esea_gen.emit.formats import FORMATS
    from esea_gen.studies.off_table import simulate_off
    from esea_gen.studies.registry import load_study
    from esea_gen.studies.simulation import ClosedLoopStudy, default_person
    from esea_gen.twin.case import Setting
    from esea_gen.twin.off import chosen_families

    few = jobs == -1 and runs * len(load_study(study, ClosedLoopStudy).cases()) <= FEW_RUNS
    (real,) = chosen_formats([real], FORMATS)
    who = person or default_person(study, plant)
    laws = list(dict.fromkeys(controller or ["smc"]))
    families = chosen_families(off, rigid=plant == "ideal")
    with counted(f"{study}, {', '.join(laws)}") as tell:
        result = simulate_off(
            study,
            [
                Setting(law, plant, who, real, fault=fault, off=name, adapted=adapted, axis=axis)
                for name in families
                for law in laws
            ],
            seed=seed,
            runs=runs,
            workers=Workers(1 if few else jobs, cluster),
            folder=resume,
            progress=tell,
        )
    show(result, json_file, "simulate")
    if csv_file is not None:
        write_whole(csv_file, result.csv())
    picture(figure, result.figure)


@app.command(cls=StudyCommand)
def passivity(
    controller: ControllerOption = "smc",
    plant: PlantOption = "real",
    points: Annotated[
        int, typer.Option("--points", metavar="N", help="Gains along each axis.")
    ] = 9,
    push: Annotated[
        float,
        typer.Option("--push", metavar="RAD_S", help="Speed that the push gives a free hand."),
    ] = 0.5,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the plant.")] = 0,
    wall: Annotated[
        float,
        typer.Option(
            "--wall",
            metavar="NM_RAD",
            help="Stiffness of a wall 0.02 rad ahead of the hand: contact and release. 0: none.",
        ),
    ] = 0.0,
    sliding: Annotated[
        bool, typer.Option("--sliding/--no-sliding", help="Also check the sliding condition.")
    ] = True,
    axis: AxisOption = "",
    jobs: JobsOption = -1,
    cluster: ClusterOption = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
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
    show(result, json_file, "passivity")
    picture(figure, result.figure)


@app.command(cls=StudyCommand)
def tune(
    controller: ControllerOption = "smc",
    plant: PlantOption = "real",
    parameter: Annotated[
        str | None,
        typer.Option(
            "--parameter", metavar="NAME", help="Tunable; default: the thesis' procedure."
        ),
    ] = None,
    values: Annotated[
        str, typer.Option("--values", metavar="A,B,C", help="Values of the parameter.")
    ] = "",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the plant.")] = 0,
    jobs: JobsOption = 1,
    cluster: ClusterOption = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    from esea_gen.analysis.campaign import Workers
    from esea_gen.studies.tuning_sweep.study import tune as sweep_tunables

    try:
        row = [float(v) for v in values.split(",")] if values.strip() else []
    except ValueError:
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
    show(result, json_file, "tune")
    picture(figure, result.figure)
    if not all(sweep.ran for sweep in result.sweeps):
        raise typer.Exit(1)
