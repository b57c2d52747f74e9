"""Ways to search the numbers that shape the torque, by name; the linear ones are solved each time.

``multi-start``: a seeded population, its best members refined by least squares with exact
gradients, then the stops' thresholds looked along.  ``evolution``: SciPy's differential evolution
[1]_.  ``thesis``: as it was done there, a genetic algorithm and then an interior point method, here
IPOPT [2]_ with exact gradients.  The last two end with the same refinement.

References
----------
.. [1] R. Storn, K. Price, "Differential evolution", Journal of Global Optimization 11, 1997.
.. [2] A. Waechter, L. T. Biegler, "On the implementation of an interior-point filter line-search
   algorithm", Mathematical Programming 106, 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy  # its parts are read on first use

from esea_gen.errors import UserError, nearest
from esea_gen.identify.published.population import finalists, sobol_points
from esea_gen.identify.published.search_problem import SearchProblem
from esea_gen.language.ports import Array

POPULATION = 256
FINALISTS = 6
SHORT, LONG = 12, 60  # evaluations of a refinement
SCAN, SCAN_FINALISTS = (40, 6), 4
# SciPy's own size of a generation: 15 a number.
EVOLUTION = {"popsize": 15, "maxiter": 150, "tol": 1e-4, "mutation": (0.5, 1.0)}
INTERIOR_POINT = 200  # iterations


@dataclass(frozen=True)
class GeneticSettings:
    """The thesis' numbers; where it prints none, MATLAB's defaults."""

    population: int = 300
    generations: int = 1200
    stall: int = 50
    tolerance_Nm: float = 1e-6
    elite: float = 0.05
    crossed: float = 0.8


Search = Callable[[SearchProblem, int, int], list[tuple[float, Array]]]


def multi_start(problem: SearchProblem, seed: int, count: int) -> list[tuple[float, Array]]:
    """A seeded population, the best refined; then along the thresholds from the best of these."""
    low, high = problem.low, problem.high
    points = sobol_points(low, high, count, seed)
    starts = finalists(points, problem.costs(points), low, high, FINALISTS)
    ends = _narrowed(problem, starts)
    # The thresholds make minima of their own, which the viscosity's numbers hide from a sparse
    # population: look along them from the best finalist (measured: docs/identify.md).
    return ends + _narrowed(problem, _threshold_minima(problem, best_of(ends)[1]))


def _narrowed(problem: SearchProblem, starts: Sequence[Array]) -> list[tuple[float, Array]]:
    # All refined a little, then the best two to the end.
    ends = sorted(problem.refined(starts, SHORT), key=lambda e: e[0])
    return problem.refined([x for _, x in ends[:2]], LONG) + ends[2:]


def _threshold_minima(problem: SearchProblem, best: Array) -> list[Array]:
    # Best few minima along the thresholds, the viscosity's numbers held.
    grid = [np.linspace(problem.low[k], problem.high[k], SCAN[k]) for k in (0, 1)]
    points = np.array([[omega, beta, *best[2:]] for omega in grid[0] for beta in grid[1]])
    costs = problem.costs(points).reshape(SCAN)
    profile = costs.min(axis=1)
    padded = np.concatenate([[np.inf], profile, [np.inf]])
    minima = np.flatnonzero((profile <= padded[:-2]) & (profile <= padded[2:]))
    order = minima[np.argsort(profile[minima], kind="stable")][:SCAN_FINALISTS]
    return [points[int(i) * SCAN[1] + int(np.argmin(costs[i]))] for i in order]


def evolution(problem: SearchProblem, seed: int, _count: int) -> list[tuple[float, Array]]:
    """Differential evolution, then least squares from its best."""
    found = scipy.optimize.differential_evolution(
        lambda x: problem.costs(np.ascontiguousarray(x.T)),
        list(zip(problem.low, problem.high, strict=True)),
        seed=seed,
        polish=False,
        init="sobol",
        vectorized=True,
        updating="deferred",
        **EVOLUTION,
    )
    return problem.refined([np.asarray(found.x, float)], LONG)


def thesis(problem: SearchProblem, seed: int, _count: int) -> list[tuple[float, Array]]:
    """A genetic algorithm, then IPOPT from its best, then least squares."""
    fittest = genetic(problem.costs, problem.low, problem.high, seed)
    inside = interior_point(problem, fittest)
    return problem.refined([inside, fittest], LONG)


def genetic(
    costs: Callable[[Array], Array],
    low: Array,
    high: Array,
    seed: int,
    settings: GeneticSettings | None = None,
) -> Array:
    """The best point of a genetic algorithm over a box."""
    s, rng, n = settings or GeneticSettings(), np.random.default_rng(seed), len(low)
    kept, crossed = round(s.elite * s.population), round(s.crossed * s.population)
    points = low + (high - low) * rng.random((s.population, n))
    values = costs(points)
    past: list[float] = []
    for generation in range(s.generations):
        order = np.argsort(values, kind="stable")
        points, values = points[order], values[order]
        past.append(float(np.sqrt(values[0])))
        if len(past) > s.stall and past[-1 - s.stall] - past[-1] < s.tolerance_Nm:
            break
        # Ranked fitness, drawn evenly along the wheel (stochastic uniform selection).
        wheel = np.cumsum(1 / np.sqrt(np.arange(1, s.population + 1)))
        children = s.population - kept
        spokes = (rng.random() + np.arange(2 * children)) / (2 * children) * wheel[-1]
        parents = rng.permutation(np.searchsorted(wheel, spokes))
        first, second = points[parents[:children]], points[parents[children:]]
        mixed = np.where(rng.random((children, n)) < 0.5, first, second)
        # What is not crossed is one parent, moved; ever less far.
        width = (high - low) * (1 - generation / s.generations)
        moved = first + width * rng.normal(0, 0.3, (children, n)) * (
            rng.random((children, n)) < 0.5
        )
        born = np.where((np.arange(children) < crossed)[:, None], mixed, moved)
        # Beyond an end it comes back from there.
        born = np.clip(np.where(born < low, 2 * low - born, born), low, None)
        born = np.clip(np.where(born > high, 2 * high - born, born), low, high)
        points = np.concatenate([points[:kept], born])
        values = np.concatenate([values[:kept], costs(born)])
    return np.asarray(points[int(np.argmin(values))])


def interior_point(problem: SearchProblem, start: Array) -> Array:
    """IPOPT over the box, scaled to 1, from a start: least RMS error."""
    name = problem.memo.name(problem.plant.digest, "interior point", start.tobytes())
    known = problem.memo.get(name)
    if known is None:
        width = problem.high - problem.low

        def rms(y: Array) -> tuple[float, Array]:
            cost, slope = problem.gradient(problem.low + width * y)
            size = float(np.sqrt(cost))
            return size, width * slope / (2 * size)

        cost = _Cost(rms, len(start))
        y = ca.MX.sym("y", len(start))
        # The start is good: a barrier of usual height would push it away.
        near = {"mu_strategy": "monotone", "mu_init": 1e-6, "bound_push": 1e-8, "bound_frac": 1e-8}
        settings: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "max_iter": INTERIOR_POINT,
            **near,
        }
        settings["hessian_approximation"] = "limited-memory"
        options: dict[str, Any] = {"print_time": False, "error_on_fail": False}
        options |= {f"ipopt.{k}": v for k, v in settings.items()}
        solver = ca.nlpsol("search", "ipopt", {"x": y, "f": cost(y)}, options)
        begun = problem.evaluations
        inside = np.clip((start - problem.low) / width, 1e-6, 1 - 1e-6)
        found = np.clip(np.array(solver(x0=inside, lbx=0, ubx=1)["x"]).ravel(), 0, 1)
        known = (float(problem.evaluations - begun), *(problem.low + width * found))
        problem.evaluations = begun
        problem.memo.put([(name, known)])
    problem.evaluations += int(known[0])
    return np.array(known[1:])


class _Cost(ca.Callback):
    """A value with its gradient as CasADi sees it; its Jacobian is a callback of its own."""

    def __init__(self, gradient: Callable[[Array], tuple[float, Array]], size: int) -> None:
        super().__init__()
        self.gradient, self.size = gradient, size
        self._at: tuple[bytes, float, Array] = (b"", 0.0, np.zeros(size))
        self.construct("cost", {})

    def get_sparsity_in(self, i: int) -> Any:
        return ca.Sparsity.dense(self.size, 1)

    def known(self, argument: Any) -> tuple[float, Array]:
        y = np.array(argument).ravel()
        if y.tobytes() != self._at[0]:
            self._at = y.tobytes(), *self.gradient(y)
        return self._at[1:]

    def eval(self, arguments: Any) -> list[Any]:
        return [self.known(arguments[0])[0]]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, _in: Any, _out: Any, options: Any) -> Any:
        self.slope = _Slope(self, name, options)
        return self.slope


class _Slope(ca.Callback):
    def __init__(self, cost: _Cost, name: str, options: Any) -> None:
        super().__init__()
        self.cost = cost
        self.construct(name, options)

    def get_n_in(self) -> int:
        return 2

    def get_sparsity_in(self, i: int) -> Any:
        return ca.Sparsity.dense(1 if i else self.cost.size, 1)

    def get_sparsity_out(self, i: int) -> Any:
        return ca.Sparsity.dense(1, self.cost.size)

    def eval(self, arguments: Any) -> list[Any]:
        return [ca.DM(self.cost.known(arguments[0])[1]).T]


def best_of(ends: list[tuple[float, Array]]) -> tuple[float, Array]:
    """The one of least cost."""
    return min(ends, key=lambda e: e[0])


SEARCHES: dict[str, Search] = {
    "multi-start": multi_start,
    "evolution": evolution,
    "thesis": thesis,
}


def search_named(name: str) -> Search:
    """A way to search by its name."""
    if name not in SEARCHES:
        raise UserError(
            f"There is no search '{name}'.",
            f"{nearest(name, SEARCHES)}Known: {', '.join(SEARCHES)}.",
        )
    return SEARCHES[name]
