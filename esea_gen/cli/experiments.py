"""Closed-loop experiments: ``simulate``, ``passivity``, ``tune``, ``reproduce``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.app import app, out
from esea_gen.cli.options import FigureOption, JobsOption, JsonOption, chosen_formats, writable
from esea_gen.cli.output import counted, picture, progress_line, show, write_json, write_text
from esea_gen.errors import UserError

reproduce = typer.Typer(help="Recompute published tables with the emitted C.")


app.add_typer(reproduce, name="reproduce", no_args_is_help=True)


@reproduce.command("chapter3")
def reproduce_forward(json_file: JsonOption = None, figure: FigureOption = None) -> None:
    """The forward model's published behaviour: torque range, loops, relaxation."""
    from esea_gen.studies.chapter3 import reproduce_chapter3

    with progress_line() as say:
        result = reproduce_chapter3(say)
    show(result, json_file)
    picture(figure, result.figure)


@reproduce.command("chapter4")
def reproduce_tables(json_file: JsonOption = None, figure: FigureOption = None) -> None:
    """Tables 4.4 and 4.5: the published inverses and the exact one; the forward model's figures."""
    from esea_gen.studies.chapter3 import reproduce_chapter3
    from esea_gen.studies.chapter4 import reproduce_chapter4

    with progress_line() as say:
        result = reproduce_chapter4(say)
        forward = reproduce_chapter3(say)
    for line in [*result.table(), "", *forward.table()]:
        out.print(line)
    write_json(json_file, result.to_dict() | {"chapter_3": forward.to_dict()})
    picture(figure, result.figure)


@reproduce.command("discretisation")
def reproduce_discretisation(json_file: JsonOption = None) -> None:
    """The sensor's discretisation: ideal encoders, and real ones with velocity filters."""
    from esea_gen.studies.discretisation import discretisation

    with progress_line() as say:
        result = discretisation(say)
    show(result, json_file)


@reproduce.command("bandwidth")
def reproduce_bandwidth(
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder of the recordings.")],
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Published bandwidths and steps of a metal series elastic actuator, from its recordings."""
    from esea_gen.studies.spring_rig import check_on_data

    with progress_line() as say:
        result = check_on_data(data, say)
    show(result, json_file)
    picture(figure, result.figure)
    if not result.reproduced:
        raise typer.Exit(1)


@app.command()
def simulate(
    experiment: Annotated[
        str,
        typer.Argument(
            metavar="EXPERIMENT",
            help="tuning, grid, twists, backdriven, bread, impedance, step, frequency or "
            "output-impedance.",
        ),
    ],
    controller: Annotated[
        str,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="smc, smc-published, mpc, mpc-no-preview, mpc-published, "
            "mpc-published-no-preview, or a device file.",
        ),
    ] = "smc",
    plant: Annotated[
        str, typer.Option("--plant", metavar="ideal|real|random", help="Virtual exoskeleton.")
    ] = "real",
    person: Annotated[
        str | None,
        typer.Option(
            "--person",
            metavar="none|ideal|uncertain|random",
            help="Who moves the load; suits plant and experiment when not given.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the first run.")] = 0,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Runs of each case.")] = 1,
    real: Annotated[
        str, typer.Option("--real", metavar="f64|f32|q31", help="Number format of the controller.")
    ] = "f32",
    jobs: JobsOption = -1,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="DIR", help="Journal: go on where a run was cut off."),
    ] = None,
    csv_file: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", callback=writable, help="Also every run as CSV."),
    ] = None,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Run an experiment of the thesis: a controller's C against the virtual exoskeleton."""
    from esea_gen.emit.formats import FORMATS
    from esea_gen.studies.experiments import EXPERIMENTS, Setting, default_person
    from esea_gen.studies.experiments import simulate as run

    if experiment not in EXPERIMENTS:
        raise UserError(
            f"Unknown experiment '{experiment}'.", f"Choose from {', '.join(EXPERIMENTS)}."
        )
    (real,) = chosen_formats([real], FORMATS)
    who = person or default_person(experiment, plant)
    with counted(f"{experiment}, {controller}") as tell:
        result = run(
            experiment,
            Setting(controller, plant, who, real),
            seed=seed,
            runs=runs,
            # A run takes half a second: a few are done before other processes have started.
            workers=jobs if runs * len(EXPERIMENTS[experiment].cases()) > 20 else 1,
            folder=resume,
            progress=tell,
        )
    show(result, json_file)
    if csv_file is not None:
        write_text(csv_file, result.csv())
    picture(figure, result.figure)


@app.command()
def passivity(
    controller: Annotated[
        str,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="smc, smc-published, mpc, mpc-no-preview, mpc-published, "
            "mpc-published-no-preview, or a device file.",
        ),
    ] = "smc",
    plant: Annotated[
        str, typer.Option("--plant", metavar="ideal|real|random", help="Virtual exoskeleton.")
    ] = "real",
    points: Annotated[
        int, typer.Option("--points", metavar="N", help="Gains along each axis.")
    ] = 9,
    push: Annotated[
        float,
        typer.Option("--push", metavar="RAD_S", help="Speed that the push gives a hand alone."),
    ] = 0.5,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the plant.")] = 0,
    sliding: Annotated[
        bool, typer.Option("--sliding/--no-sliding", help="Also the sliding condition.")
    ] = True,
    jobs: JobsOption = -1,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Passivity of the rendered impedance over its gains, with pushed hands; sliding condition."""
    from esea_gen.studies.interaction import study_interaction

    with counted(f"passivity, {controller}") as tell:
        result = study_interaction(
            controller,
            plant,
            points=points,
            push_rad_s=push,
            seed=seed,
            sliding=sliding,
            workers=jobs,
            progress=tell,
        )
    show(result, json_file)
    picture(figure, result.figure)


@app.command()
def tune(
    controller: Annotated[
        str,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="smc, smc-published, mpc, mpc-no-preview, mpc-published, "
            "mpc-published-no-preview, or a device file.",
        ),
    ] = "smc",
    plant: Annotated[
        str, typer.Option("--plant", metavar="ideal|real|random", help="Virtual exoskeleton.")
    ] = "real",
    parameter: Annotated[
        str | None,
        typer.Option("--parameter", metavar="NAME", help="Tunable; the thesis' procedure without."),
    ] = None,
    values: Annotated[
        str, typer.Option("--values", metavar="A,B,C", help="Values of the parameter.")
    ] = "",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the plant.")] = 0,
    jobs: JobsOption = 1,
    json_file: JsonOption = None,
    figure: FigureOption = None,
) -> None:
    """Sweep tunables in the tuning case: error, overshoot, roughness; choose, and say why."""
    from esea_gen.studies.tune import tune as run

    try:
        row = [float(v) for v in values.split(",")] if values.strip() else []
    except ValueError:
        raise UserError(
            f"--values {values}: not a list of numbers.", "Write them as 1,1.5,2."
        ) from None
    with counted(f"tuning, {controller}") as tell:
        result = run(
            controller,
            plant,
            parameter=parameter,
            values=row,
            seed=seed,
            workers=jobs,
            progress=tell,
        )
    show(result, json_file)
    picture(figure, result.figure)
    if not all(sweep.ran for sweep in result.sweeps):
        raise typer.Exit(1)
