"""Identification of the published elastomer against SciPy's differential evolution on NumPy.

Both search the twelve numbers of table 3.2 from the same simulated recordings (the thesis' three
excitations, 0.01 Nm of noise) for the least mean square error over data sets, at the same rate.
Ours solves the linear ones and follows exact gradients on the generated C; the other is
:func:`scipy.optimize.differential_evolution` over all twelve, its population run at once by a model
in NumPy as fast as one can write it: only the stops and the Maxwell element's recursion are a loop
over time.  What counts is processor time until 1 % above the optimum, in one run of this program.

    python -m tests.benchmarks.identification [--budget 1200]
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution

from esea_gen.device import load_device
from esea_gen.hostlib.library import compile_system
from esea_gen.identify.drafting import draft
from esea_gen.identify.published.fit import POPULATION, multi_start
from esea_gen.identify.published.plant import ROWS_SEARCH, FitStream, FittedPlant
from esea_gen.identify.published.search_problem import (
    PresentBest,
    Searching,
    SearchMemo,
    SearchProblem,
)
from esea_gen.identify.published.space import Space, bounds_of
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.language.ports import Array
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS

KEYS = (*MODEL_KEYS, *RATE_KEYS)
NEAR = 1.01
NOISE_Nm, RECORDED_Hz = 0.01, 100
# Amplitude in degrees, first and last frequency in Hz, seconds; the last two judge.
SWEEPS = (
    (10.0, 0.01, 0.01, 100.0),
    (5.0, 0.0, 1.5, 180.0),
    (10.0, 0.0, 1.0, 120.0),
    (5.0, 1.5, 0.0, 30.0),
)
MAPPING = """schema = 1
full_scale_Nm = { value = 4.47, status = "published", source = "thesis" }
[device]
name = "again"
title = "Elbow"
rate_terms = true
[deflection]
column = "theta"
unit = "rad"
[torque]
column = "tau"
unit = "Nm"
[sampling]
time_column = "t"
[[recording]]
files = ["[012].csv"]
use = "train"
[[recording]]
files = ["3.csv"]
use = "held_out"
"""


def published_problem(folder: Path) -> Path:
    """The published elbow's excitations, simulated and recorded; the mapping file."""
    elbow = load_device("elbow")
    task = compile_system(elbow.system, "f64").task("sense")
    every = round(1 / elbow.period_s / RECORDED_Hz)
    for number, (amplitude, first, last, seconds) in enumerate(SWEEPS):
        t = np.arange(round(seconds / elbow.period_s) + 1) * elbow.period_s
        phase = 2 * np.pi * (first * t + (last - first) * t * t / (2 * seconds))
        theta = np.radians(amplitude) * np.sin(phase)
        task.reset()
        tau = task.run({"theta_rad": theta}, trace=False)[0]["tau_Nm"]
        tau = tau + np.random.default_rng(number).normal(0, NOISE_Nm, len(t))
        rows = np.column_stack([t, theta, tau])[::every]
        lines = [",".join(f"{v:.9g}" for v in row) for row in rows]
        (folder / f"{number}.csv").write_text("\n".join(["t,theta,tau", *lines]) + "\n")
    (folder / "elbow.toml").write_text(MAPPING)
    return folder / "elbow.toml"


class NumpyPopulation:
    """The torque model in NumPy for many parameters at once, at a plant's training rows."""

    def __init__(self, plant: FittedPlant, stops: int) -> None:
        self.plant, self.h = plant, 1 / float(plant.rate_Hz or 1.0)
        self.index = np.arange(1, stops + 1)[:, None]
        self.evaluations = 0

    def costs(self, x: Array) -> Array:
        """Costs of points, shape (parameters, points)."""
        p = dict(zip(KEYS, np.atleast_2d(x.T).T, strict=True))
        self.evaluations += x.shape[1]
        total, first = np.zeros(x.shape[1]), 0
        for s in self.plant.streams:
            tau = self._torque(s, p)
            for rows in s.training:
                part = slice(first, first + len(rows))
                error = tau[rows] - self.plant.measured[part, None]
                total += self.plant.weight[part] ** 2 @ error**2
                first += len(rows)
        return np.where(np.isfinite(total), total, np.inf)

    def _torque(self, s: FitStream, p: dict[str, Array]) -> Array:
        theta, omega = s.theta_rad[:, None], np.abs(s.omega_rad_s)[:, None]
        last = np.concatenate([s.theta_rad[:1], s.theta_rad[:-1]])
        middle = np.abs(last + 0.5 * self.h * s.omega_rad_s)[:, None]
        gain = p["A_Nms_rad"] * middle ** p["m"] + p["eps1_Nms_rad"]
        step = self.h * p["kv_Nm_rad"] * (p["B"] * omega ** p["n"] + p["eps2"]) / gain
        series = 1 + step / 2 + step * step / 6
        kept = 1 / (1 + step * series)
        taken = p["kv_Nm_rad"] * (s.theta_rad - last)[:, None] * series * kept
        radius = p["omega_rad"] * self.index
        weight = p["alpha_Nm_rad"] * np.exp(-p["beta_1_rad"] * radius)
        play, rate = np.full(radius.shape, s.theta_rad[0]), np.zeros(radius.shape[1])
        out = p["k3_Nm_rad3"] * theta**3 + p["k1_Nm_rad"] * theta
        for k, now in enumerate(s.theta_rad.tolist()):
            np.maximum(play, now - radius, out=play)
            np.minimum(play, now + radius, out=play)
            rate = rate * kept[k] + taken[k]
            out[k] += rate + np.einsum("ij,ij->j", weight, now - play)
        return out


@dataclass(frozen=True)
class SearchRow:
    """One search: processor seconds until 1 % above the optimum, if it was reached, and in all."""

    name: str
    reached_s: float | None
    seconds: float
    evaluations: int
    rms_Nm: float


def _timed(
    name: str, run: Callable[[Callable[[float, int], None]], None], goal: float
) -> SearchRow:
    begun = time.process_time()
    reached, best, count = None, math.inf, 0

    def seen(rms: float, evaluations: int) -> None:
        nonlocal reached, best, count
        best, count = min(best, rms), evaluations
        if reached is None and best <= goal:
            reached = time.process_time() - begun

    with suppress(KeyboardInterrupt):  # keep what was found until then
        run(seen)
    used = time.process_time() - begun
    return SearchRow(name, reached, used, count, best)


def compare_searches(
    budget_s: float, seed: int, say: Callable[[str], None]
) -> tuple[SearchRow, SearchRow, float]:
    """Ours and differential evolution, each until it is done or its budget is spent.

    return: both, and seconds of an evaluation by NumPy one point at a time.
    """
    with tempfile.TemporaryDirectory() as scratch:
        source = load_mapping(published_problem(Path(scratch)))
        recordings = load_recordings(source)
    device = draft(source, recordings, True)
    domain, rate = device.file.domain, float(RECORDED_Hz)
    longest = max(float(r.time_s[-1]) for r in recordings)
    space = Space(True, domain.theta_max_rad.value, domain.omega_max_rad_s.value, longest)

    def ours(seen: Callable[[float, int], None]) -> None:
        def watch(present: PresentBest, _last: bool) -> None:
            seen(math.sqrt(present.cost), int(present.curve[-1, 0]))

        # The same rate and rows as the other: its refinement at the device's rate is another sum.
        own = FittedPlant(device, recordings, rate, ROWS_SEARCH)
        problem = SearchProblem(
            own, space, SearchMemo(), Searching(watch=watch), lambda count, _: say(f"{count} runs")
        )
        multi_start(problem, seed, POPULATION)

    say("ours")
    first = _timed("ours", ours, math.inf)
    goal = NEAR * first.rms_Nm
    mine = _timed("ours", ours, goal)
    plant = FittedPlant(device, recordings, rate, ROWS_SEARCH)
    model = NumpyPopulation(plant, int(device.elastomer.stops.value))
    begun = time.process_time()

    def evolve(seen: Callable[[float, int], None]) -> None:
        best = math.inf

        def costs(x: Array) -> Array:
            nonlocal best
            found = model.costs(x)
            best = min(best, math.sqrt(found.min()))
            seen(best, model.evaluations)
            say(f"differential evolution: {model.evaluations} runs, best {best:.4g} Nm")
            return found

        def over(*_args: object, **_named: object) -> bool:
            return best <= goal or time.process_time() - begun > budget_s

        differential_evolution(
            costs,
            [bounds_of(k) for k in KEYS],
            seed=seed,
            vectorized=True,
            updating="deferred",
            polish=False,
            maxiter=100_000,
            tol=0,
            callback=over,
        )

    begun = time.process_time()
    theirs = _timed("differential evolution, NumPy", evolve, goal)
    start = time.process_time()
    model.costs(np.array([[sum(bounds_of(k)) / 2] for k in KEYS]))
    return mine, theirs, time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--budget", type=float, default=1200, help="processor seconds of the other")
    parser.add_argument("--seed", type=int, default=20240229)
    chosen = parser.parse_args()
    mine, theirs, one_s = compare_searches(
        chosen.budget, chosen.seed, lambda text: print(text, end="\r", flush=True)
    )
    for row in (mine, theirs):
        when = "not reached" if row.reached_s is None else f"after {row.reached_s:.1f} s"
        print(
            f"{row.name:32} 1 % above the optimum {when}; {row.rms_Nm:.5f} Nm after "
            f"{row.seconds:.1f} s of processor time, {row.evaluations} runs"
        )
    assert mine.reached_s is not None
    least = theirs.reached_s or theirs.seconds
    bound = "" if theirs.reached_s else "at least "
    print(f"whole population at once: {bound}{least / mine.reached_s:.0f} times ours")
    single = theirs.evaluations * one_s / mine.reached_s
    print(f"as many runs one by one, {one_s:.2f} s each: {bound}{single:.0f} times ours")


if __name__ == "__main__":
    main()
