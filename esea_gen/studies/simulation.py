"""Closed-loop studies: cases on the virtual exoskeleton, each case and seed run once.

A run puts the compiled controller, as it ships, and the plant's C into one loop and compares the
torque of the true elastomer, and the torque that the sensor shows, with the desired one.
"""

from __future__ import annotations

import copy
import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, Self, Unpack

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis import plots
from esea_gen.analysis.campaign import Running, run_cases
from esea_gen.analysis.journal import Configuration, file_digest, files_digest, rooms_digest
from esea_gen.analysis.monte_carlo import MonteCarlo
from esea_gen.control.limits.faults import FAULT_TEXT, Fault
from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError, choose
from esea_gen.language.ports import Array
from esea_gen.model.sensing import without_axis
from esea_gen.studies.registry import Study, load_study, study_file
from esea_gen.twin.case import Case, Scale, Setting
from esea_gen.twin.controllers import controller_device, largest_torque_Nm
from esea_gen.twin.faults import parse_fault
from esea_gen.twin.hand_plant import tunable_places
from esea_gen.twin.judge import (
    ENCODER_FAULT,
    ENDED,
    FIGURES,
    ROUGH_HEADS,
    ROUGHNESS,
    desired_torque,
    fault_figures,
    judge,
    rough_cells,
)
from esea_gen.twin.loop_run import ClosedLoopRun, RanAwayError
from esea_gen.twin.off import NOTHING, deviation, off_families, refuse_unknown
from esea_gen.twin.people import PLANT_NAMES
from esea_gen.twin.run import PERSON_NAMES, axis_of, compiled_loop, run_case
from esea_gen.twin.trajectories import RATE_HZ

FAULT_FROM_S = 0.1  # by then every shipped controller is armed and on
SHOWN_S = 10.0
SHOUTED = "unstable"  # of the ways to end, the one that is the controller's own
Panel = tuple[str, Array, Array, Array, Array]
ERRORS = ("rms_true_Nm", "rms_model_Nm", "max_true_Nm")
REPAIRED = "state_repaired_ticks_"  # before a Block's name
MOST_PANELS = 4  # more cases than this are drawn as bars


class ClosedLoopStudy(Study):
    person: ClassVar[bool] = False  # somebody moves the load; else the output is fixed
    scales: ClassVar[bool] = False  # its cases are the elbow's, and another device's in proportion
    scale: Scale = Scale()
    keeps: ClassVar[bool] = False  # table and JSON need what ``keep`` gives
    normalised: ClassVar[bool] = False  # errors over the largest torque, too: the thesis' measure
    thesis_Nm: ClassVar[Mapping[str, float]] = MappingProxyType({})

    def cases(self) -> list[Case]:
        raise UserError(f"study {self.name}: has no method cases.", "Add it; it lists the cases.")

    def of(self, device: Device) -> Self:
        """The study on a device; one that scales, in the device's own torques and movements."""
        made = copy.copy(self)
        made.scale = Scale.of(device) if self.scales else Scale()
        return made

    def cases_run(self) -> list[Case]:
        cases = list(self.cases())
        return cases if self.scale == Scale() else [c.scaled(self.scale) for c in cases]

    def case(self, name: str) -> Case:
        known = {c.name: c for c in self.cases_run()}
        choose(f"case of {self.name}", name, known)
        return known[name]

    def measure(self, case: Case, run: ClosedLoopRun, device: Device) -> dict[str, float]:
        return judge(case, run, largest_torque_Nm(device), Scale.of(device).torque)

    def keep(self, case: Case, run: ClosedLoopRun) -> Any:
        return run

    def table(self, done: Simulation) -> list[str]:
        """A line a case, of the medians over the seeds."""
        s, runs = done.setting, len(done.seeds)
        off = f", off: {off_families()[s.off].meaning}" if s.off != NOTHING else ""
        heads = ["RMS true", "RMS model", "max true", "thesis", "limited", *ROUGH_HEADS]
        width = max(32, *(1 + len(name) for name in done.by_case()))
        lines = [
            f"Simulated. {done.study.title}: {s.controller}, plant {s.plant}, person "
            f"{done.person}{off}{done.more}, {runs} run{'s' if runs > 1 else ''} a case",
            f"{'case':{width}}"
            + "".join(f"{h:>12}" for h in heads + ["of largest"] * self.normalised),
        ]
        for name, entries in done.by_case().items():
            lines += _case_lines(f"{name:{width}}", entries, self.normalised)
        full = controller_device(s.controller).tau_full_scale_Nm
        asked = max(float(np.max(np.abs(c.trajectory.tau_desired_Nm))) for c in self.cases_run())
        if asked > 1.001 * full:
            lines.append(
                f"desired torque up to {asked:.3g} Nm, above full scale, {full:.3g} Nm: the "
                "excess is not followed, and counts as error"
            )
        total, ended = len(done.monte_carlo.results), len(done.ended())
        if ended:
            lines.append(
                f"{ended} of {total} runs were unstable, tripped, latched or failed; their "
                "errors include the time after that"
            )
        every = np.array([e["rms_true_Nm"] for e in done.cases() if e["rms_true_Nm"] is not None])
        if runs > 1 and len(every):
            low, middle, high = np.percentile(every, [5, 50, 95])
            lines.append(
                f"all runs: RMS true 5 % {low:.4f}, median {middle:.4f}, 95 % {high:.4f}, mean "
                f"{every.mean():.4f}, max {every.max():.4f} Nm; medians above"
            )
        return lines

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        """The setting, ``cases``, and percentiles by case where there are several seeds."""
        s, names = done.setting, ("controller", "plant", "off", "axis")
        content: dict[str, Any] = {
            "experiment": done.study.name,
            "title": done.study.title,
            **{k: v for k in names if (v := getattr(s, k))},
            "person": done.person,
            "format": s.real,
            "content_hash": done.monte_carlo.configuration.parts["controller_hash"],
            "seeds": done.seeds,
            "cases": done.cases(),
            "ended_runs": len(done.ended()),
        }
        if len(done.seeds) > 1:
            content["percentiles"] = {
                n: {k: p.to_dict() for k, p in done.monte_carlo.summary({"case": n}).items()}
                for n in done.by_case()
            }
        return content

    def figure(self, done: Simulation) -> Figure:
        """Torque in time of a few cases, RMS by case of more, percentiles over several seeds."""
        if len(done.seeds) > 1:
            by_name = {n: done.monte_carlo.summary({"case": n}) for n in done.by_case()}
            rows = [(n, p["rms_true_Nm"]) for n, p in by_name.items() if "rms_true_Nm" in p]
            if not rows:
                raise UserError("No run finished: there is nothing to draw.", "See the table.")
            return plots.percentile_bars(rows)
        panels = [
            panel(self.case(name), run)
            for name, run in done.kept.items()
            if isinstance(run, ClosedLoopRun)
        ]
        if len(panels) == 1:
            ((name, *curves),) = panels
            return plots.torque_tracking(*curves, title=f"{name}: {done.label}")
        if panels:
            return plots.torque_cases(panels, title=done.label)
        entries = done.cases()
        ours, thesis = (
            np.array([math.nan if e[k] is None else e[k] for e in entries])
            for k in ("rms_true_Nm", "thesis_rms_Nm")
        )
        known = thesis if np.isfinite(thesis).any() else None
        return plots.rms_by_case([e["name"] for e in entries], done.label, ours, known)


def _case_lines(name: str, entries: list[dict[str, Any]], normalised: bool) -> list[str]:
    def median(key: str) -> float:
        found = [e[key] for e in entries if e.get(key) is not None]
        return float(np.median(found)) if found else math.nan

    row = "".join(f"{median(k):>12.4f}" for k in ("rms_true_Nm", "rms_model_Nm", "max_true_Nm"))
    thesis = entries[0]["thesis_rms_Nm"]
    row += f"{thesis:>12.3f}" if thesis else f"{'-':>12}"
    row += f"{100 * median('limited_share'):>11.1f}%"
    row += "".join(f"{c:>12}" for c in rough_cells({k: median(k) for k in ROUGHNESS}))
    if normalised:
        share = median("rms_normalised")
        row += f"{'-':>12}" if math.isnan(share) else f"{100 * share:>11.1f}%"
    words = {k: text.upper() if k == SHOUTED else text for k, text in ENDED.items()}
    words |= {"ran_away": "left the plant's ranges", "failure": "failed"}
    counts = [(sum(bool(e.get(k)) for e in entries), text) for k, text in words.items()]
    said = ", ".join(f"{n} {text}" for n, text in counts if n)
    reasons = dict.fromkeys(e["failure"] for e in entries if e.get("failure"))
    latched = sorted({int(e["fault_reason"]) for e in entries if e.get("fault_reason")})
    return [
        f"{name}{row}  {said}".rstrip(),
        *(f"  latched: {Fault(n).name}, {FAULT_TEXT[Fault(n)]}" for n in latched),
        *(f"  failed: {reason}" for reason in reasons),
    ]


def panel(case: Case, run: ClosedLoopRun, *, whole: bool = False) -> Panel:
    """Name, time, desired, true and sensed torque of a case; the first 10 s that are judged."""
    w = case.trajectory.window
    w = slice(0, None) if whole else slice(w.start, min(w.stop, w.start + round(SHOWN_S * RATE_HZ)))
    return (
        case.name,
        run.time_s[w],
        desired_torque(case, run)[w],
        run.plant["tau_e_Nm"][w],
        run.controller["tau_Nm"][w],
    )


def csv_lines(entries: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    keys = list(dict.fromkeys(k for e in entries for k in e))
    table = csv.DictWriter(text, keys, lineterminator="\n")
    table.writeheader()
    table.writerows(entries)
    return text.getvalue()


@dataclass(frozen=True)
class Simulation:
    study: ClosedLoopStudy
    setting: Setting
    seeds: tuple[int, ...]
    monte_carlo: MonteCarlo
    kept: Mapping[str, Any]

    @property
    def person(self) -> str:
        return self.setting.person if self.study.person else "none"

    @property
    def label(self) -> str:
        s = self.setting
        off = f", {s.off}" if s.off != NOTHING else ""
        return f"{s.controller}, simulated ({s.plant}{off}{self.more})"

    @property
    def more(self) -> str:
        return f", {self.setting.axis}" if self.setting.axis else ""

    def cases(self) -> list[dict[str, Any]]:
        entries = []
        for r in self.monte_carlo.results:
            entry: dict[str, Any] = {"name": r.case["case"], "seed": r.case["seed"]}
            entry |= dict.fromkeys(ERRORS)
            values = r.values or {}
            # In one order, whether it was run now or comes out of a journal.
            order = [*(k for k in FIGURES if k in values), *sorted(set(values) - set(FIGURES))]
            entry |= {k: values[k] for k in order}
            entry |= {k: bool(values.get(k)) for k in ENDED}
            if self.setting.fault:
                entry |= {k: values.get(k) for k in ENCODER_FAULT}
            if r.values is None:
                entry["failure"] = r.failure
            entry |= {"off": self.setting.off, "family": off_families()[self.setting.off].group}
            entry["thesis_rms_Nm"] = self.study.thesis_Nm.get(self.setting.controller)
            entries.append(entry)
        return entries

    def by_case(self) -> dict[str, list[dict[str, Any]]]:
        found: dict[str, list[dict[str, Any]]] = {}
        for entry in self.cases():
            found.setdefault(entry["name"], []).append(entry)
        return found

    def ended(self) -> list[dict[str, Any]]:
        """Runs that were unstable, tripped, latched or failed: their errors judge no controller."""
        return [e for e in self.cases() if any(e.get(k) for k in (*ENDED, "failure"))]

    @property
    def sound(self) -> bool:
        """Whether every run came to its end; where an encoder is broken on purpose, none need."""
        return bool(self.setting.fault) or not self.ended()

    def to_dict(self) -> dict[str, Any]:
        told = {"fault": str(parse_fault(f))} if (f := self.setting.fault) else {}
        return self.study.to_dict(self) | told | {"simulated": True}

    def table(self) -> list[str]:
        every = [(k, n) for e in self.cases() for k, n in e.items() if k.startswith(REPAIRED)]
        return [
            *(self._faults() if self.setting.fault else self.study.table(self)),
            *(
                f"{key.removeprefix(REPAIRED)}: its state left its Port's range and was repaired "
                f"in up to {n:g} ticks of a run. Widen that Port, or clip what the step returns."
                for key, n in dict(sorted(every)).items()  # of each the most
            ),
        ]

    def _faults(self) -> list[str]:
        # What came of an encoder's fault, a line a case.
        s, runs = self.setting, len(self.seeds)
        lines = [
            f"{self.study.title}, {parse_fault(s.fault)}, simulated: {s.controller}, plant "
            f"{s.plant}, person {self.person}, {runs} run{'s' if runs > 1 else ''} a case",
            f"{'case':32}{'found':>8}{'after ms':>10}{'torque then':>13}{'peak torque':>13}"
            f"{'energy':>9}",
        ]
        for name, entries in self.by_case().items():
            good = [e for e in entries if e["peak_torque_Nm"] is not None]
            found = [e for e in good if e["detected_ticks"] is not None]

            def worst(key: str, of: list[dict[str, Any]], places: int, width: int) -> str:
                return f"{max(e[key] for e in of):{width}.{places}f}" if of else f"{'-':>{width}}"

            lines.append(
                f"{name:32}{f'{len(found)}/{len(entries)}':>8}"
                f"{worst('detected_ticks', found, 0, 10)}{worst('torque_then_Nm', found, 2, 13)}"
                f"{worst('peak_torque_Nm', good, 2, 13)}{worst('energy_J', good, 2, 9)}"
            )
        return [*lines, "the worst of all runs; torques in Nm, energy given to the limb in J"]

    def figure(self) -> Figure:
        ended: dict[str, str] = {}
        for entry in self.ended():
            words = [ENDED.get(k, "failed") for k in (*ENDED, "failure") if entry.get(k)]
            ended.setdefault(entry["name"], f"seed {entry['seed']} {', '.join(words)}")
        return plots.crossed(self.study.figure(self), ended)

    def csv(self) -> str:
        return csv_lines(self.cases())


def default_person(study: str, plant: str) -> str:
    """Who takes part when nobody is named."""
    who = {"ideal": "ideal", "random": "random"}.get(plant, "uncertain")
    return who if load_study(study, ClosedLoopStudy).person else "none"


def simulate_case(
    study: str, case: str, seed: int, kept: dict[str, Any] | None = None, **setting: Any
) -> dict[str, float]:
    """Run and measure one case by name, in the setting of these fields, in a worker.

    ``kept`` takes what the study keeps of this run, in this process.
    """
    asked = Setting(**setting)
    chosen = load_study(study, ClosedLoopStudy).of(controller_device(asked.controller))
    found = chosen.case(case)
    try:
        run = run_case(found, asked, seed)
    except RanAwayError:
        return {"unstable": 1.0, "tripped": 0.0, "fault": 0.0, "ran_away": 1.0}
    if kept is not None:
        kept[case] = chosen.keep(found, run)
    figures = chosen.measure(found, run, controller_device(asked.controller))
    figures |= {f"{REPAIRED}{name}": float(n) for name, n in run.repaired.items()}
    return figures | (fault_figures(run, parse_fault(asked.fault)) if asked.fault else {})


def simulate(
    study: str,
    setting: Setting | None = None,
    *,
    seed: int = 0,
    runs: int = 1,
    **how: Unpack[Running],
) -> Simulation:
    """Run a study of the package, or ``FILE.py:name``; with the journal's folder it goes on."""
    s = setting or Setting()
    chosen = load_study(study, ClosedLoopStudy)
    choose("plant", s.plant, PLANT_NAMES)
    choose("person", s.person, PERSON_NAMES)
    if chosen.person and s.person == "none":
        raise UserError(
            f"{chosen.name} needs a person to move the load, but the person is 'none'.",
            f"Give --person {', '.join(n for n in PERSON_NAMES if n != 'none')}.",
        )
    device = controller_device(s.controller)
    chosen = chosen.of(device)
    s = replace(s, axis=axis_of(device, s))
    if s.fault:
        _check_time(chosen, s.fault)
        s = replace(s, fault=str(parse_fault(s.fault)))
    # Compile once, before the workers would each do it.
    loop = compiled_loop(device, s.plant != "ideal", s.real)
    places = tunable_places(loop.plant)
    known = dict.fromkeys((*(without_axis(n, device.axes[0]) for n in places), *places))
    refuse_unknown(f"--off {s.off}", deviation(s.off, device, seed).values, known)
    for case in chosen.cases_run():
        refuse_unknown(f"case {case.name}", case.plant, known)
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
    names = [c.name for c in chosen.cases_run()]
    seeds = tuple(range(seed, seed + runs))
    cases = [{"study": study, "case": n, "seed": k, **fixed} for k in seeds for n in names]
    keeping = chosen.keeps or (runs == 1 and len(names) <= MOST_PANELS)
    done, kept = _run(cases, len(names) if keeping else 0, Configuration(parts), **how)
    return Simulation(chosen, s, seeds, done, kept)


def _check_time(study: ClosedLoopStudy, text: str) -> None:
    at_s = parse_fault(text).at_s
    end_s = min(len(c.trajectory.tau_desired_Nm) for c in study.cases_run()) / RATE_HZ
    if not FAULT_FROM_S <= at_s < end_s:
        raise UserError(
            f"'{text}': {at_s:g} s is outside {FAULT_FROM_S:g} to {end_s:g} s: the controller is "
            f"armed first, and the shortest case of {study.name} then ends.",
            "Give a time in that range.",
        )


def _run(
    cases: list[dict[str, Any]], keeping: int, configuration: Configuration, **how: Unpack[Running]
) -> tuple[MonteCarlo, dict[str, Any]]:
    # Signals do not travel: the runs of which something is kept are done in this process, first.
    kept: dict[str, Any] = {}
    first: tuple[Any, ...] = ()
    progress = how.get("progress")

    def keep(**case: Any) -> dict[str, float]:
        return simulate_case(**case, kept=kept)

    def tell(done: int, _: int, failed: int) -> None:
        if progress is not None:
            before = sum(r.values is None for r in first)
            progress(len(first) + done, len(cases), before + failed)

    how["progress"] = tell
    if keeping:
        here: Running = {**how, "workers": 1}
        first = run_cases(keep, cases[:keeping], configuration=configuration, **here).results
        for r in first:
            # Out of a journal, which holds figures only.
            if r.values is not None and r.case["case"] not in kept:
                keep(**r.case)
    rest: tuple[Any, ...] = ()
    if cases[keeping:] or not keeping:
        left = cases[keeping:]
        rest = run_cases(simulate_case, left, configuration=configuration, **how).results
    return MonteCarlo(configuration, (*first, *rest)), kept
