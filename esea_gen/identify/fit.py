"""Fit of the torque model, by running the emitted C over populations of parameters.

Given the stops' thresholds and decay and the viscosity's shape, the torque is linear in k1, k3,
alpha and kv (the viscosity being written over kv).  So only the former are searched - two numbers
without the Maxwell element, seven with it - and the latter follow from a bounded linear
least-squares problem (variable projection [1]).

References
----------
.. [1] G. H. Golub and V. Pereyra, "Separable nonlinear least squares: the variable projection
   method and its applications", Inverse Problems 19, 2003.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear, nnls

from esea_gen.device import Device
from esea_gen.identify.plant import ROWS_REFINE, ROWS_SEARCH, FittedPlant
from esea_gen.identify.population import (
    Residual,
    finalists,
    polished,
    runner_up,
    sobol_population,
)
from esea_gen.identify.recorded import Recording
from esea_gen.identify.space import Space, edges_of, linear_bounds, parameters_of
from esea_gen.language.ports import Array

Progress = Callable[[float, str], None]

POPULATION = {False: 256, True: 1024}
FINALISTS = 6
SCAN, SCAN_FINALISTS = (40, 6), 4


def solve_linear(basis: Array, target: Array, low: Array, high: Array) -> Array:
    """Bounded linear least squares of few columns.

    basis: shape (rows, columns).
    target: shape (rows,).
    low, high: bounds, shape (columns,); ``low`` is 0.
    """
    size = np.sqrt(np.einsum("ij,ij->j", basis, basis))
    size[size == 0] = 1.0
    scaled = basis / size
    gram = scaled.T @ scaled + 1e-13 * np.eye(len(size))
    root = np.linalg.cholesky(gram).T
    right = solve_triangular(root, scaled.T @ target, trans="T")
    solution: Array = np.asarray(nnls(root, right)[0] / size, dtype=np.float64)
    if np.any(solution > high):
        bounded = lsq_linear(root, right, (low * size, high * size), method="bvls", max_iter=100)
        solution = np.clip(bounded.x / size, low, high)
    return solution


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    values: elastomer parameters by key; without rate terms only the first five.
    cost: mean over data sets of the mean square error, Nm^2, training data.
    population, evaluations: size of the starting population; runs of the C over all training data.
    runner_up: cost of the second best finalist over the best's: near 1 the optimum was found
        repeatedly.
    rate_dropped: the fit gave the Maxwell element no stiffness: it is left out.
    edges: what ended at the edge of the searched space, and what that means.
    """

    values: dict[str, float]
    cost: float
    population: int
    evaluations: int
    runner_up: float
    rate_dropped: bool = False
    edges: tuple[str, ...] = ()


def search(
    device: Device,
    recordings: list[Recording],
    space: Space,
    fit_rate_Hz: float | None,
    progress: Progress,
    seed: int,
    population_size: int | None = None,
) -> Fit:
    """Global search from a seeded population, then refinement.

    A Sobol population over the whole space is run through the C; bounded least squares starts from
    its best members (apart from each other), and from the best of these again at the device's rate.
    """
    coarse = FittedPlant(device, recordings, fit_rate_Hz, ROWS_SEARCH)
    residual = _residual(coarse, space)
    count = population_size or POPULATION[space.rate_terms]

    def tell(i: int, best: float) -> None:
        if i % 32 == 0:
            progress(0.5 * i / count, f"population: {i} of {count}, best {_rms(best)}")

    points, costs = sobol_population(residual, space.low, space.high, count, seed, tell)
    ends: list[tuple[float, Array]] = []

    def refine(starts: Sequence[Array], steps: int, what: str, begin: float, share: float) -> None:
        for place, x in enumerate(starts, 1):
            ends.append(_polish(residual, x, space, steps))
            best = _rms(min(e[0] for e in ends))
            progress(
                begin + share * place / len(starts), f"{what} {place} of {len(starts)}, best {best}"
            )

    chosen = finalists(points, costs, space.low, space.high, FINALISTS)
    refine(chosen, 60 if space.rate_terms else 80, "refinement", 0.5, 0.2)
    # The thresholds make minima of their own, which the viscosity's numbers hide from a sparse
    # population: look along them from the best finalist (measured: docs/identify.md).
    starts = _threshold_minima(residual, min(ends, key=lambda e: e[0])[1], space)
    refine(starts, 60, "thresholds", 0.7, 0.15)
    ends.sort(key=lambda e: e[0])
    evaluations = coarse.evaluations
    best, plant = ends[0], coarse
    fine = device.file.timing.sense_rate_Hz.value
    if fit_rate_Hz is not None and fit_rate_Hz < fine:
        progress(0.87, "refinement at the device's rate")
        plant = FittedPlant(device, recordings, fine, ROWS_REFINE)
        best = _polish(_residual(plant, space), best[1], space, 4)
        evaluations += plant.evaluations
    values, dropped = _parameters(plant, space, best[1])
    return Fit(
        values=values,
        cost=best[0],
        population=count,
        evaluations=evaluations,
        runner_up=runner_up([e[0] for e in ends]),
        rate_dropped=dropped,
        edges=() if dropped else edges_of(space, best[1]),
    )


def _weighted(plant: FittedPlant, space: Space, x: Array) -> tuple[Array, Array, Array]:
    """Basis and target, rows weighted, and the best linear coefficients."""
    basis = plant.basis(space.shape(x)) * plant.weight[:, None]
    target = plant.weight * plant.measured
    return basis, target, solve_linear(basis, target, *linear_bounds(space.rate_terms))


def _residual(plant: FittedPlant, space: Space) -> Residual:
    def residual(x: Array) -> Array:
        basis, target, linear = _weighted(plant, space, x)
        return np.asarray(basis @ linear - target)

    return residual


def _parameters(plant: FittedPlant, space: Space, x: Array) -> tuple[dict[str, float], bool]:
    basis, target, linear = _weighted(plant, space, x)
    share = 0.0
    if space.rate_terms:
        share = float(np.linalg.norm(linear[3] * basis[:, 3]) / np.linalg.norm(target))
    return parameters_of(space, x, linear, share)


def _threshold_minima(residual: Residual, best: Array, space: Space) -> list[Array]:
    """Best few minima along the thresholds, the viscosity's numbers held."""
    spacing = np.linspace(space.low[0], space.high[0], SCAN[0])
    decay = np.linspace(space.low[1], space.high[1], SCAN[1])
    profile = np.empty(len(spacing))
    points = []
    for i, omega in enumerate(spacing):
        trials = [np.concatenate([[omega, beta], best[2:]]) for beta in decay]
        costs = [float(r @ r) for r in map(residual, trials)]
        profile[i] = min(costs)
        points.append(trials[int(np.argmin(costs))])
    padded = np.concatenate([[np.inf], profile, [np.inf]])
    minima = np.flatnonzero((profile <= padded[:-2]) & (profile <= padded[2:]))
    order = minima[np.argsort(profile[minima], kind="stable")]
    return [points[int(i)] for i in order[:SCAN_FINALISTS]]


def _rms(cost: float) -> str:
    return f"{math.sqrt(cost):.4g} Nm"


def _polish(residual: Residual, start: Array, space: Space, steps: int) -> tuple[float, Array]:
    # The thresholds make the cost a little rough: a step well above rounding.
    settings = {"diff_step": 1e-4, "ftol": 1e-7, "xtol": 1e-7, "gtol": 1e-12}
    return polished(residual, start, space.low, space.high, max_nfev=steps, **settings)
