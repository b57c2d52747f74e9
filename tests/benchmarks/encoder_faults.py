"""False alarms of the encoder monitors.

    python -m tests.benchmarks.encoder_faults --plants 200

Everything is simulated: the generated f32 C of the shipped controllers in closed loop with random
plants and people without a fault: how near the comparisons of the Block ``redundancy`` come to
their limits.  What faults do: ``esea-gen faults elbow_drive --table encoders``.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from esea_gen.analysis.campaign import Workers, run_cases
from esea_gen.analysis.journal import Configuration, rooms_digest
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy, default_person
from esea_gen.twin.case import Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.loop_run import RanAwayError
from esea_gen.twin.run import run_case

CONTROLLERS = ("cascade", "smc", "mpc")
# One case of each kind: nobody at the arm, a hand that lets itself be moved, one that moves.
CASES = (
    ("tuning", "1.7 Nm 0.6 Hz"),
    ("bread", "0 Nm"),
    ("bread", "2 Nm"),
    ("backdriven", "0.1 Hz"),
    ("backdriven", "0.25 Hz"),
)
SETTLED_S = 0.1
HOURS = 1000.0


def nearness(study: str, case: str, seed: int, controller: str) -> dict[str, float]:
    """Of one healthy run: largest share of the room for angles and torques; latched; hours."""
    found = load_study(study, ClosedLoopStudy).case(case)
    setting = Setting(controller, "random", default_person(study, "random"))
    try:
        run = run_case(found, setting, seed)
    except RanAwayError:
        return {"ran_away": 1.0}
    device = controller_device(controller)
    first = round(SETTLED_S / (run.time_s[1] - run.time_s[0]))
    own, shown = device.file.redundancy, run.controller
    softer = 1 / own.cable_least_Nm_rad.value - 1 / own.cable_Nm_rad.value
    angle = np.abs(shown["apart_rad"]) / (own.apart_rad.value + softer * np.abs(shown["tau_Nm"]))
    # The room is 0 before the first run.
    torque = np.abs(shown["apart_Nm"]) / np.maximum(shown["room_Nm"], own.torque_Nm.value)
    return {
        "angle": float(np.max(angle[first:])),
        "torque": float(np.max(torque[first:])),
        "latched": float(np.max(run.controller["fault"][first:]) > 0),
        "hours": float(run.time_s[-1] / 3600),
    }


@dataclass(frozen=True)
class Quiet:
    """How near healthy runs come to an alarm; per_1000_h is extrapolated by the shares' tail."""

    runs: int
    hours: float
    alarms: int
    angle: float
    torque: float
    per_1000_h: float


def quiet(results: Sequence[Mapping[str, float]]) -> Quiet:
    """Of many runs: what was seen, and the rate of alarms that their largest shares let expect.

    The largest share of a run is a maximum of many, so its distribution over the runs is taken as
    a generalised extreme value one, fitted by maximum likelihood.
    """
    good = [r for r in results if "ran_away" not in r]
    largest = np.array([max(r["angle"], r["torque"]) for r in good])
    hours = sum(r["hours"] for r in good)
    chance = float(stats.genextreme.sf(1.0, *stats.genextreme.fit(largest)))
    return Quiet(
        len(good),
        hours,
        sum(r["latched"] > 0 for r in good),
        max(r["angle"] for r in good),
        max(r["torque"] for r in good),
        chance * len(good) / hours * HOURS,
    )


def run_all(fn: Any, cases: list[dict[str, Any]], jobs: int) -> list[Any]:
    configuration = Configuration({"code": rooms_digest()})
    done = run_cases(fn, cases, configuration=configuration, workers=Workers(jobs, None))
    failed = [r for r in done.results if r.values is None]
    if failed:
        raise SystemExit(f"{failed[0].case}: {failed[0].failure}")
    return [r.values for r in done.results]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plants", type=int, default=200, help="random plants and people")
    parser.add_argument("--jobs", type=int, default=-1, help="parallel processes; -1: all cores")
    chosen = parser.parse_args()
    for controller in CONTROLLERS:
        cases = [
            {"study": study, "case": case, "seed": seed, "controller": controller}
            for study, case in CASES
            for seed in range(chosen.plants)
        ]
        found = quiet(run_all(nearness, cases, chosen.jobs))
        print(
            f"{controller}, simulated: {found.runs} healthy runs, {found.hours:.1f} h: "
            f"{found.alarms} latched; largest share of the room: angles {found.angle:.2f}, "
            f"torques {found.torque:.2f}; by their tail {found.per_1000_h:.2g} alarms in "
            f"{HOURS:.0f} h",
            flush=True,
        )


if __name__ == "__main__":
    main()
