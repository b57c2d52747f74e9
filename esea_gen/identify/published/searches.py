"""Ways to search the numbers that shape the torque, by name; the linear ones are solved each time.

``multi-start``: a seeded population, its best members refined by least squares with exact
gradients, then the stops' thresholds looked along.  ``evolution``: SciPy's differential evolution
[1]_.  ``thesis``: the two stages of the thesis, an evolution of its size and then an interior point
method with exact gradients [2]_, both SciPy's.  The last two end with the same refinement.

References
----------
.. [1] R. Storn, K. Price, "Differential evolution", Journal of Global Optimization 11, 1997.
.. [2] R. H. Byrd, M. E. Hribar, J. Nocedal, "An interior point algorithm for large-scale nonlinear
   programming", SIAM Journal on Optimization 9, 1999.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.errors import choose
from esea_gen.identify.published.population import finalists, sobol_points
from esea_gen.identify.published.search_problem import SearchProblem
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
    # population: look along them from the best finalist (measured: docs/identify.md).
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
    """The one of least cost."""
    return min(ends, key=lambda e: e[0])


SEARCHES: dict[str, Search] = {
    "multi-start": multi_start,
    "evolution": evolution,
    "thesis": thesis,
}


def search_named(name: str) -> Search:
    """A way to search by its name."""
    choose("search", name, SEARCHES)
    return SEARCHES[name]
