"""Fit of the torque model, by running the emitted C over populations of parameters.

Given the stops' thresholds and decay and the viscosity's shape, the torque is linear in k1, k3,
alpha and kv (the viscosity being written over kv).  So only the former are searched, two numbers
without the Maxwell element, seven with it, and the latter solved [1]_.

``multi-start``: a seeded population, its best members refined by least squares with exact
gradients, then the stops' thresholds looked along.  ``evolution``: SciPy's differential evolution.
``thesis``: an evolution of the thesis' size and then an interior point method with exact gradients,
both SciPy's.  The last two end with the same refinement.

References
----------
.. [1] G. H. Golub and V. Pereyra, "Separable nonlinear least squares: the variable projection
   method and its applications", Inverse Problems 19, 2003.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.device import Device
from esea_gen.errors import choose
from esea_gen.identify.published.plant import ROWS_REFINE, ROWS_SEARCH, FittedPlant
from esea_gen.identify.published.search_problem import (
    Searching,
    SearchMemo,
    SearchProblem,
    finalists,
    runner_up,
    sobol_points,
)
from esea_gen.identify.published.space import Space, edges_of, parameters_of
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.resampling import FitRows
from esea_gen.language.ports import Array

POPULATION = 256
FINALISTS = 6
SHORT, LONG = 12, 60  # evaluations of a refinement
SCAN, SCAN_FINALISTS = (40, 6), 4
# SciPy's own size of a generation, 15 a number; the thesis' 300, and its generations.
EVOLUTION = {"popsize": 15, "maxiter": 150, "init": "sobol"}
THESIS_POPULATION, THESIS_GENERATIONS = 300, 1200
INTERIOR_POINT = 200  # iterations

Ends = list[tuple[float, Array]]
Search = Callable[[SearchProblem, int, int], Ends]


def multi_start(problem: SearchProblem, seed: int, count: int) -> Ends:
    """A seeded population, the best refined; then along the thresholds from the best of these."""
    low, high = problem.low, problem.high
    points = sobol_points(low, high, count, seed)
    starts = finalists(points, problem.costs(points), low, high, FINALISTS)
    ends = _narrowed(problem, starts)
    # The thresholds make minima of their own, which the viscosity's numbers hide from a sparse
    # population: look along them from the best finalist.
    return ends + _narrowed(problem, threshold_minima(problem, best_of(ends)[1]))


def _narrowed(problem: SearchProblem, starts: Sequence[Array]) -> Ends:
    # All refined a little, then the best two to the end.
    ends = sorted(problem.refined(starts, SHORT), key=lambda e: e[0])
    return problem.refined([x for _, x in ends[:2]], LONG) + ends[2:]


def threshold_minima(problem: SearchProblem, best: Array) -> list[Array]:
    """Best few minima along the thresholds, the viscosity's numbers held."""
    grid = [np.linspace(problem.low[k], problem.high[k], SCAN[k]) for k in (0, 1)]
    points = np.array([[omega, beta, *best[2:]] for omega in grid[0] for beta in grid[1]])
    costs = problem.costs(points).reshape(SCAN)
    profile = costs.min(axis=1)
    padded = np.concatenate([[np.inf], profile, [np.inf]])
    minima = np.flatnonzero((profile <= padded[:-2]) & (profile <= padded[2:]))
    order = minima[np.argsort(profile[minima], kind="stable")][:SCAN_FINALISTS]
    return [points[int(i) * SCAN[1] + int(np.argmin(costs[i]))] for i in order]


def evolution(problem: SearchProblem, seed: int, _count: int) -> Ends:
    """Differential evolution, then least squares from its best."""
    return problem.refined([_evolved(problem, seed, **EVOLUTION)], LONG)


def thesis(problem: SearchProblem, seed: int, _count: int) -> Ends:
    """An evolution as large as the thesis', an interior point method, then least squares."""
    size = -(-THESIS_POPULATION // len(problem.low))
    fittest = _evolved(problem, seed, popsize=size, maxiter=THESIS_GENERATIONS)
    return problem.refined([interior_point(problem, fittest), fittest], LONG)


def _evolved(problem: SearchProblem, seed: int, **size: object) -> Array:
    found = scipy.optimize.differential_evolution(
        lambda x: problem.costs(np.ascontiguousarray(x.T)),
        list(zip(problem.low, problem.high, strict=True)),
        seed=seed,
        tol=1e-4,
        polish=False,
        vectorized=True,
        updating="deferred",
        **size,
    )
    return np.asarray(found.x, float)


def interior_point(problem: SearchProblem, start: Array) -> Array:
    """Least RMS error over the box, scaled to 1, from a start, with exact gradients."""
    width = problem.high - problem.low

    def rms(y: Array) -> tuple[float, Array]:
        cost, slope = problem.gradient(problem.low + width * y)
        size = float(np.sqrt(cost))
        return size, width * slope / (2 * size)

    done = scipy.optimize.minimize(
        rms,
        np.clip((start - problem.low) / width, 1e-6, 1 - 1e-6),
        jac=True,
        method="trust-constr",
        bounds=[(0, 1)] * len(start),
        # The start is good: a barrier of usual height would push it away.
        options={
            "maxiter": INTERIOR_POINT,
            "initial_barrier_parameter": 1e-6,
            "initial_barrier_tolerance": 1e-6,
        },
    )
    return np.asarray(problem.low + width * np.clip(done.x, 0, 1))


def best_of(ends: Ends) -> tuple[float, Array]:
    return min(ends, key=lambda e: e[0])


SEARCHES: dict[str, Search] = {"multi-start": multi_start, "evolution": evolution, "thesis": thesis}


def search_named(name: str) -> Search:
    choose("search", name, SEARCHES)
    return SEARCHES[name]


Progress = Callable[[float, str], None]


def part_of(tell: Progress, low: float, high: float) -> Progress:
    """Progress of a part as a share of the total."""
    return lambda share, text: tell(low + (high - low) * share, text)


FINE_STEPS = 4
SOLVE_STEPS = 30
AT_EDGE = 1e-4
# Of the evaluations that a search takes, for its progress alone.
USUAL = {False: 550, True: 650}


@dataclass(frozen=True)
class Fit:
    values: dict[str, float]  # elastomer parameters by key; without rate terms only the first five
    cost: float  # mean over data sets of the mean square error, Nm^2, training data
    population: int  # size of the starting population; runs of the C over all training data
    evaluations: int
    runner_up: float  # second finalist's cost over the best's
    rate_dropped: bool = False  # the fit gave the Maxwell element no stiffness: it is left out
    # Parameters that ended at the edge of the searched space, and what that means.
    edges: Mapping[str, str] = field(default_factory=dict)
    method: str = "multi-start"


def search(
    device: Device,
    recordings: list[Recording],
    space: Space,
    fit_rate_Hz: float | None,
    progress: Progress,
    seed: int,
    population_size: int | None = None,
    how: Searching | None = None,
) -> Fit:
    """Global search by a method of that name, then refinement at the device's rate."""
    how = how or Searching()
    method, memo = search_named(how.method), SearchMemo(how.resume)
    count = population_size or POPULATION

    def tell(evaluations: int, best: float) -> None:
        share = 1 - math.exp(-1.5 * evaluations / USUAL[space.rate_terms])
        progress(0.86 * share, f"{how.method}: {evaluations} runs, best {math.sqrt(best):.4g} Nm")

    coarse = FittedPlant(device, recordings, fit_rate_Hz, ROWS_SEARCH)
    problem = SearchProblem(coarse, space, memo, how, tell)
    ends = sorted(method(problem, seed, count), key=lambda e: e[0])
    problem.over()
    evaluations, best = problem.evaluations, ends[0]
    fine = device.file.timing.sense_rate_Hz.value
    if fit_rate_Hz is not None and fit_rate_Hz < fine:
        progress(0.87, "refinement at the device's rate")
        plant = FittedPlant(device, recordings, fine, ROWS_REFINE)
        problem = SearchProblem(plant, space, memo, how, lambda _count, _best: None)
        best = best_of(problem.refined([best[1]], FINE_STEPS))
        evaluations += problem.evaluations
    values, dropped = _parameters(problem, best[1])
    return Fit(
        values=values,
        cost=best[0],
        population=count,
        evaluations=evaluations,
        runner_up=runner_up([e[0] for e in ends]),
        rate_dropped=dropped,
        edges={} if dropped else edges_of(space, best[1]),
        method=how.method,
    )


@dataclass
class PublishedChannels:
    """The published model as :class:`esea_gen.identify.recording.channels.ChannelModel`."""

    device: Device
    space: Space
    rate_Hz: float | None
    seed: int
    population_size: int | None
    how: Searching
    _problem: SearchProblem | None = None

    def __post_init__(self) -> None:
        self._begun = self._x = self.space.low

    def _plant(self, recordings: list[Recording]) -> FittedPlant:
        if self._problem is None:
            return FittedPlant(self.device, recordings, self.rate_Hz, ROWS_SEARCH)
        return self._problem.plant.having(recordings, ROWS_SEARCH)

    def _over(self, recordings: list[Recording]) -> SearchProblem:
        plant = self._plant(recordings)
        return SearchProblem(plant, self.space, SearchMemo(), self.how, lambda _count, _best: None)

    def start(self, recordings: list[Recording]) -> None:
        method = search_named(self.how.method)
        self._problem = self._over(recordings)
        count = self.population_size or POPULATION
        self._begun = best_of(method(self._problem, self.seed, count))[1]

    def solve(self, recordings: list[Recording]) -> float:
        """The minimum next to the one that :meth:`start` found."""
        self._problem = self._over(recordings)
        cost, self._x = best_of(self._problem.refined([self._begun], SOLVE_STEPS))
        return cost

    def torque_Nm(self, recordings: list[Recording]) -> Array:
        """With the numbers of the last :meth:`solve`."""
        assert self._problem is not None
        linear = self._problem.weighted(self._x)[2]
        return np.asarray(self._plant(recordings).basis(self.space.shape(self._x)) @ linear)

    def linearised(self) -> tuple[Array, Array, Array, FitRows]:
        """In the linear numbers above 0 and the searched ones inside their bounds."""
        assert self._problem is not None
        plant, space, x = self._problem.plant, self.space, self._x
        basis, target, linear = self._problem.weighted(x)
        inside = np.minimum(x - space.low, space.high - x) > AT_EDGE * (space.high - space.low)
        moves = self._problem.jacobian(x, basis, linear)[:, inside]
        jacobian = np.column_stack([basis[:, linear > 0], moves]) / plant.weight[:, None]
        residual = (target - basis @ linear) / plant.weight
        return jacobian, residual, plant.weight * math.sqrt(len(target)), plant.rows


def _parameters(problem: SearchProblem, x: Array) -> tuple[dict[str, float], bool]:
    basis, target, linear = problem.weighted(x)
    share = 0.0
    if problem.space.rate_terms:
        share = float(np.linalg.norm(linear[3] * basis[:, 3]) / np.linalg.norm(target))
    return parameters_of(problem.space, x, linear, share)
