"""Closed-loop studies: cases on the virtual exoskeleton, each case and seed run once.

A run puts the compiled controller, as it ships, and the plant's C into one loop and compares the
torque of the true elastomer, and the torque that the sensor shows, with the desired one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from esea_gen.analysis.campaign import run_cases
from esea_gen.analysis.journal import Configuration, file_digest, files_digest, rooms_digest
from esea_gen.analysis.monte_carlo import MonteCarlo
from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError, choose
from esea_gen.model.sensing import without_axis
from esea_gen.studies import torque_errors
from esea_gen.studies.outcome import Simulation
from esea_gen.studies.registry import Study, load_study, study_file
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.controllers import controller_device, largest_torque_Nm
from esea_gen.twin.faults import parse_fault
from esea_gen.twin.hand_plant import tunable_places
from esea_gen.twin.judge import fault_figures, judge
from esea_gen.twin.loop_run import ClosedLoopRun, RanAwayError
from esea_gen.twin.off import deviation, refuse_unknown
from esea_gen.twin.run import (
    PERSON_NAMES,
    PLANT_NAMES,
    axis_of,
    compiled_loop,
    refuse_unadapted,
    run_case,
)
from esea_gen.twin.trajectories import RATE_HZ

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAULT_FROM_S = 0.1  # by then every shipped controller is armed and on
MOST_PANELS = 4  # more cases than this are drawn as bars


class ClosedLoopStudy(Study):
    """Cases of a controller against plant and person."""

    person: ClassVar[bool] = False  # somebody moves the load; else the output is fixed
    keeps: ClassVar[bool] = False  # table and JSON need what ``keep`` gives
    thesis_Nm: ClassVar[Mapping[str, float]] = MappingProxyType({})

    def cases(self) -> list[Case]:
        raise UserError(f"study {self.name}: has no method cases.", "Write it: the list of cases.")

    def case(self, name: str) -> Case:
        known = {c.name: c for c in self.cases()}
        choose(f"case of {self.name}", name, known)
        return known[name]

    def measure(self, case: Case, run: ClosedLoopRun, device: Device) -> dict[str, float]:
        return judge(case, run, largest_torque_Nm(device))

    def keep(self, case: Case, run: ClosedLoopRun) -> Any:
        return run

    def table(self, done: Simulation) -> list[str]:
        return torque_errors.table(done)

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        return torque_errors.to_dict(done)

    def figure(self, done: Simulation) -> Figure:
        return torque_errors.figure(done)


def default_person(study: str, plant: str) -> str:
    """Who takes part when nobody is named."""
    if not load_study(study, ClosedLoopStudy).person:
        return "none"
    return {"ideal": "ideal", "random": "random"}.get(plant, "uncertain")


def simulate_case(
    study: str, case: str, seed: int, kept: dict[str, Any] | None = None, **setting: Any
) -> dict[str, float]:
    """Run and measure one case by name, in the setting of these fields: what a worker does.

    ``kept`` takes what the study keeps of this run, in this process.
    """
    chosen = load_study(study, ClosedLoopStudy)
    found, asked = chosen.case(case), Setting(**setting)
    try:
        run = run_case(found, asked, seed)
    except RanAwayError:
        return {"unstable": 1.0, "tripped": 0.0, "fault": 0.0, "ran_away": 1.0}
    if kept is not None:
        kept[case] = chosen.keep(found, run)
    figures = chosen.measure(found, run, controller_device(asked.controller))
    return figures | (fault_figures(run, parse_fault(asked.fault)) if asked.fault else {})


def simulate(
    study: str,
    setting: Setting | None = None,
    *,
    seed: int = 0,
    runs: int = 1,
    workers: Any = 1,
    folder: Path | None = None,
    progress: Callable[[int, int, int], None] | None = None,
) -> Simulation:
    """Run a study of the package, or ``FILE.py:name``; with the journal's folder it goes on."""
    s = setting or Setting()
    chosen = load_study(study, ClosedLoopStudy)
    choose("plant", s.plant, PLANT_NAMES)
    choose("person", s.person, PERSON_NAMES)
    if chosen.person and s.person == "none":
        raise UserError(
            f"{chosen.name} needs somebody who moves the load, but person is none.",
            f"Give --person {', '.join(n for n in PERSON_NAMES if n != 'none')}.",
        )
    if runs < 1 or seed < 0:
        raise UserError(f"runs = {runs}, seed = {seed}.", "Give 1 run or more, and a seed from 0.")
    device = controller_device(s.controller)
    refuse_unadapted(device, s)
    s = replace(s, axis=axis_of(device, s))
    if s.fault:
        _check_time(chosen, s.fault)
        s = replace(s, fault=str(parse_fault(s.fault)))
    # Compile once, before the workers would each do it.
    loop = compiled_loop(device, s.plant != "ideal", s.real)
    known = {without_axis(n, device.axes[0]) for n in tunable_places(loop.plant)}
    refuse_unknown(s.off, deviation(s.off, device, seed), known)
    parts = {
        "controller": s.controller,
        "controller_hash": device_hash(device),
        "c": files_digest(loop.files),
        # What the numbers depend on beside the C that runs.
        "code": rooms_digest(),
    }
    file = study_file(study)
    if file is not None:
        parts["study"] = file_digest(file)
        study = f"{file.absolute()}:{chosen.name}"  # a worker has another working directory
    fixed = vars(s) | {"tunables": {k: dict(v) for k, v in s.tunables.items()}}
    names = [c.name for c in chosen.cases()]
    seeds = tuple(range(seed, seed + runs))
    cases = [{"study": study, "case": n, "seed": k, **fixed} for k in seeds for n in names]
    keeping = chosen.keeps or (runs == 1 and len(names) <= MOST_PANELS)
    how = {"configuration": Configuration(parts), "folder": folder}
    done, kept = _run(cases, len(names) if keeping else 0, workers, progress, how)
    return Simulation(chosen, s, seeds, done, kept)


def _check_time(study: ClosedLoopStudy, text: str) -> None:
    at_s = parse_fault(text).at_s
    end_s = min(len(c.trajectory.tau_desired_Nm) for c in study.cases()) / RATE_HZ
    if not FAULT_FROM_S <= at_s < end_s:
        raise UserError(
            f"'{text}': {at_s:g} s is outside {FAULT_FROM_S:g} to {end_s:g} s: the controller is "
            f"armed first, and the shortest case of {study.name} then ends.",
            "Give a time inside.",
        )


def _run(
    cases: list[dict[str, Any]],
    keeping: int,
    workers: Any,
    progress: Callable[[int, int, int], None] | None,
    how: dict[str, Any],
) -> tuple[MonteCarlo, dict[str, Any]]:
    # Signals do not travel: the runs of which something is kept are done in this process, first.
    kept: dict[str, Any] = {}
    first: tuple[Any, ...] = ()

    def keep(**case: Any) -> dict[str, float]:
        return simulate_case(**case, kept=kept)

    def tell(done: int, _: int, failed: int) -> None:
        if progress is not None:
            before = sum(r.values is None for r in first)
            progress(len(first) + done, len(cases), before + failed)

    if keeping:
        first = run_cases(keep, cases[:keeping], progress=tell, **how).results
        for r in first:
            # Out of a journal, which holds figures only.
            if r.values is not None and r.case["case"] not in kept:
                keep(**r.case)
    rest: tuple[Any, ...] = ()
    if cases[keeping:]:
        rest = run_cases(
            simulate_case, cases[keeping:], workers=workers, progress=tell, **how
        ).results
    return MonteCarlo(how["configuration"], (*first, *rest)), kept
