"""Search problem of a fit: costs of many points on all cores, residuals, exact gradients.

The linear parameters are solved at each point [1]_: the cost of a point is the residual with the
best of them within their bounds, and its gradient that of the torque with these fixed, because a
small change of them has no first-order effect there.

References
----------
.. [1] L. Kaufman, "A variable projection method for solving separable nonlinear least squares
   problems", BIT 15, 1975.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.errors import UserError
from esea_gen.identify.published.plant import FittedPlant
from esea_gen.identify.published.space import Space, linear_bounds
from esea_gen.language.ports import Array
from esea_gen.portability import processors

Residual = Callable[[Array], Array]


def sobol_points(low: Array, high: Array, count: int, seed: int) -> Array:
    """Points of a Sobol sequence over a box, shape (count, numbers)."""
    sobol = scipy.stats.qmc.Sobol(len(low), seed=seed)
    return np.asarray(scipy.stats.qmc.scale(sobol.random(count), low, high))


def finalists(points: Array, costs: Array, low: Array, high: Array, most: int) -> list[Array]:
    """The best points that are not neighbours of a better one."""
    unit = (points - low) / (high - low)
    chosen: list[int] = []
    for i in np.argsort(costs, kind="stable"):
        if all(np.abs(unit[i] - unit[j]).max() > 0.1 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == most:
            break
    return [points[i] for i in chosen]


def polished(
    residual: Residual, start: Array, low: Array, high: Array, **settings: Any
) -> tuple[float, Array]:
    """Square sum and place of the bounded least-squares minimum next to a start."""
    width = high - low
    inside = np.clip(start, low + 1e-6 * width, high - 1e-6 * width)
    done = scipy.optimize.least_squares(
        residual, inside, bounds=(low, high), x_scale=width, **settings
    )
    return 2 * float(done.cost), np.asarray(done.x, dtype=np.float64)


def runner_up(costs: list[float]) -> float:
    """Cost of the second best over the best's, in ascending order: near 1 when found repeatedly."""
    return costs[1] / costs[0] if len(costs) > 1 and costs[0] > 0 else float("inf")


TABLE = "CREATE TABLE IF NOT EXISTS search (name TEXT PRIMARY KEY, numbers BLOB) WITHOUT ROWID"


class SearchMemo:
    """Numbers by digest, in memory or, where a file is named, in it (SQLite).

    Every search is the same computation each time: one that was cut off is begun again, and takes
    from the file what is there.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        with self._usable():
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._kept = sqlite3.connect(path or ":memory:")
            self._kept.execute(TABLE)
            if self._kept.execute("PRAGMA quick_check").fetchone() != ("ok",):
                raise sqlite3.DatabaseError("it is damaged")

    @contextmanager
    def _usable(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            raise UserError(
                f"{self.path}: cannot be used ({error}).", "Name another file for --resume."
            ) from None

    def name(self, *parts: str | bytes) -> str:
        joined = b"\0".join(p if isinstance(p, bytes) else p.encode() for p in parts)
        return hashlib.sha256(joined).hexdigest()[:32]

    def get(self, name: str) -> tuple[float, ...] | None:
        with self._usable():
            asked = "SELECT numbers FROM search WHERE name = ?"
            found = self._kept.execute(asked, (name,)).fetchone()
        return tuple(np.frombuffer(found[0]).tolist()) if found else None

    def put(self, found: Iterable[tuple[str, Sequence[float] | Array]]) -> None:
        """Keep some, on the disk before this returns."""
        rows = [(n, np.asarray(values, dtype=np.float64).tobytes()) for n, values in found]
        with self._usable(), self._kept:
            self._kept.executemany("INSERT OR REPLACE INTO search VALUES (?, ?)", rows)


BATCH = 64  # points between two words of progress


@dataclass(frozen=True)
class PresentBest:
    cost: float  # mean over data sets of the mean square error, Nm^2
    curve: Array  # RMS error after so many points, at each improvement; shape (improvements, 2)
    sets: tuple[tuple[Array, Array, Array], ...]  # deflection, torque, modelled


Watch = Callable[[PresentBest, bool], None]


@dataclass(frozen=True)
class Searching:
    method: str = "multi-start"  # a name of :data:`esea_gen.identify.published.fit.SEARCHES`
    jobs: int = -1  # threads; -1 for all cores.  The answer does not depend on it
    resume: Path | None = None  # file that keeps what was computed
    watch: Watch | None = None  # called at each improvement, and at the end


def solve_linear(basis: Array, target: Array, low: Array, high: Array) -> Array:
    """Bounded linear least squares of few columns."""
    if not len(high):  # SciPy's nnls ends the whole process here
        return np.zeros(0)
    size = np.sqrt(np.einsum("ij,ij->j", basis, basis))
    size[size == 0] = 1.0
    scaled = basis / size
    gram = scaled.T @ scaled + 1e-13 * np.eye(len(size))
    root = np.linalg.cholesky(gram).T
    right = scipy.linalg.solve_triangular(root, scaled.T @ target, trans="T")
    solution: Array = np.asarray(scipy.optimize.nnls(root, right)[0] / size, dtype=np.float64)
    if np.any(solution > high):
        bounded = scipy.optimize.lsq_linear(
            root, right, (low * size, high * size), method="bvls", max_iter=100
        )
        solution = np.clip(bounded.x / size, low, high)
    return solution


class SearchProblem:
    """The torque model over recordings, as a function of the searched numbers alone."""

    def __init__(
        self,
        plant: FittedPlant,
        space: Space,
        memo: SearchMemo,
        how: Searching,
        tell: Callable[[int, float], None],
    ) -> None:
        self.plant, self.space, self.memo, self.how, self.tell = plant, space, memo, how, tell
        self.low, self.high = space.low, space.high
        self.threads = how.jobs if how.jobs > 0 else processors()
        self.evaluations = 0
        self.best: tuple[float, Array] = (np.inf, space.low)
        self._curve: list[tuple[float, float]] = []

    @contextmanager
    def _pool(self) -> Iterator[Callable[..., Iterator[Any]]]:
        if self.threads == 1:
            yield map
            return
        with ThreadPoolExecutor(self.threads) as pool:
            yield pool.map

    def weighted(self, x: Array) -> tuple[Array, Array, Array]:
        """Basis and target, rows weighted, and the best linear coefficients."""
        plant = self.plant
        basis = plant.basis(self.space.shape(x)) * plant.weight[:, None]
        target = plant.weight * plant.measured
        linear = solve_linear(basis, target, *linear_bounds(self.space.rate_terms))
        return basis, target, linear

    def residual(self, x: Array) -> Array:
        """Weighted torque error at the training rows; its square sum is the cost."""
        basis, target, linear = self.weighted(x)
        return np.asarray(basis @ linear - target)

    def jacobian(self, x: Array, basis: Array, linear: Array) -> Array:
        """Derivative of the residual by the searched numbers, shape (rows, numbers)."""
        by_shape = self.plant.tangent(self.space.shape(x), linear) * self.plant.weight[:, None]
        chain = np.zeros((by_shape.shape[1], len(x)))
        slopes = self.space.shape_slopes(x)
        for i, key in enumerate(self.plant.shape_keys):
            for k, slope in slopes[key].items():
                chain[i, k] = slope
        moved = by_shape @ chain
        # What the free linear coefficients take up again.
        high = linear_bounds(self.space.rate_terms)[1]
        free = np.linalg.qr(basis[:, (linear > 0) & (linear < high)])[0]
        return np.asarray(moved - free @ (free.T @ moved))

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Cost, and its exact gradient by the searched numbers."""
        name = self.memo.name(self.plant.digest, "gradient", x.tobytes())
        if self.memo.get(name) is None:
            basis, target, linear = self.weighted(x)
            error = basis @ linear - target
            slope = 2 * self.jacobian(x, basis, linear).T @ error
            self.memo.put([(name, np.array([error @ error, *slope]))])
        cost, *rest = self._kept(name)
        self._seen(cost, x, 1)
        return cost, np.array(rest)

    def costs(self, points: Array) -> Array:
        """Costs of many points, shape (points, numbers), on all cores."""
        names = [self.memo.name(self.plant.digest, "cost", p.tobytes()) for p in points]
        with self._pool() as spread:
            for first in range(0, len(points), BATCH):
                part = slice(first, first + BATCH)
                missing = [
                    i
                    for i in range(first, min(first + BATCH, len(points)))
                    if self.memo.get(names[i]) is None
                ]
                found = list(spread(lambda i: self.residual(points[i]), missing))
                self.memo.put((names[i], [e @ e]) for i, e in zip(missing, found, strict=True))
                for name, x in zip(names[part], points[part], strict=True):
                    self._seen(self._kept(name)[0], x, 1)
                self.tell(self.evaluations, self.best[0])
        return np.array([self._kept(n)[0] for n in names])

    def refined(self, starts: Sequence[Array], steps: int) -> list[tuple[float, Array]]:
        """Least-squares minima next to starts, each on a core, with exact gradients."""
        names = [self.memo.name(self.plant.digest, f"refined {steps}", x.tobytes()) for x in starts]
        missing = [i for i, n in enumerate(names) if self.memo.get(n) is None]
        with self._pool() as spread:
            for i, end in zip(
                missing, spread(lambda i: self._refined(starts[i], steps), missing), strict=True
            ):
                self.memo.put([(names[i], end)])
                self._seen(end[0], np.array(end[2:]), 0)
                self.tell(self.evaluations, self.best[0])
        ends = []
        for n in names:
            cost, count, *x = self._kept(n)
            self._seen(cost, np.array(x), int(count))
            ends.append((cost, np.array(x)))
        return ends

    def _refined(self, start: Array, steps: int) -> list[float]:
        count, last = 0, (start, self.weighted(start))

        def residual(x: Array) -> Array:
            nonlocal count, last
            count, last = count + 1, (x.copy(), self.weighted(x))
            basis, target, linear = last[1]
            return np.asarray(basis @ linear - target)

        def jacobian(x: Array) -> Array:
            basis, _, linear = last[1] if np.array_equal(last[0], x) else self.weighted(x)
            return self.jacobian(x, basis, linear)

        settings = {"jac": jacobian, "ftol": 1e-7, "xtol": 1e-7, "gtol": 1e-12}
        cost, x = polished(residual, start, self.low, self.high, max_nfev=steps, **settings)
        return [cost, float(count), *x]

    def _kept(self, name: str) -> tuple[float, ...]:
        found = self.memo.get(name)
        assert found is not None
        return found

    def _seen(self, cost: float, x: Array, count: int) -> None:
        self.evaluations += count
        if cost < self.best[0]:
            self.best = cost, x
            self._curve.append((self.evaluations, float(np.sqrt(cost))))
            if self.how.watch is not None:
                self.how.watch(self._present(), False)

    def over(self) -> None:
        """Say that the search is over, to whom watches."""
        if self.how.watch is not None:
            self.how.watch(self._present(), True)

    def _present(self) -> PresentBest:
        basis, _, linear = self.weighted(self.best[1])
        model, sets, first = (basis @ linear) / self.plant.weight, [], 0
        for s in self.plant.streams:
            for rows in s.training:
                part = slice(first, first + len(rows))
                sets.append((s.theta_rad[rows], self.plant.measured[part], model[part]))
                first += len(rows)
        return PresentBest(self.best[0], np.array(self._curve), tuple(sets))
