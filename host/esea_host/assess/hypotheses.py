"""Expected responses of each category: a Gaussian over the complete map.

Each hypothesis has a mean map and a covariance of it: how people of one category differ from each
other.  A strong patient is strong everywhere, and evidence from earlier movements is not counted
twice: each movement conditions the maps on the locations it passed.  Without covariance this is the
thesis' naive Bayes (8.5, 8.6).  "None of these" is one more hypothesis: any smooth map, wide.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.assess.database import LocationGrid, ResponseDataBase
from esea_host.assess.patients import DEG, Array
from esea_host.assess.responses import Location, MovementReadings

NONE = "none of these"
# "None of these": how far a map of no category goes from the middle of all, and how smoothly.
NONE_SCALE = 1.5  # of the spread of all categories' people
NONE_NOISE_NM = 1.5  # and how unsteady it may be: tremor, a leg that is not relaxed; assumed
SMOOTH = np.array([20 * DEG, 35 * DEG]) * 1.6  # rad, rad/s
KINDS = ("people", "distributions", "centroids")


@dataclass(frozen=True)
class Hypotheses:
    """Several hypotheses over the locations of one grid.

    mean: shape (hypotheses, cells); covariance: (hypotheses, cells, cells), of people around it;
    noise_Nm: (hypotheses, cells), of one reading, new each time.
    """

    names: tuple[str, ...]
    grid: LocationGrid
    known: npt.NDArray[np.bool_]
    mean: Array
    covariance: Array
    noise_Nm: Array

    def with_movement_noise(self, fit: Mapping[str, float]) -> Hypotheses:
        """Add the noise that was calibrated on other patients.

        own_Nm, share: how far a person is off the map at one location, for good; people_scale: of
        the covariance; noise_Nm: of a reading.
        """
        cells = np.arange(self.mean.shape[1])
        covariance = fit["people_scale"] * self.covariance
        covariance[:, cells, cells] += fit["own_Nm"] ** 2 + (fit["share"] * self.mean) ** 2
        noise = np.full_like(self.mean, fit["noise_Nm"])
        return dataclasses.replace(self, covariance=covariance, noise_Nm=noise)

    def named(self, names: Sequence[str], *arrays: Array) -> Hypotheses:
        """Other hypotheses over the same grid; arrays: mean, covariance, noise."""
        return Hypotheses(tuple(names), self.grid, self.known, *arrays)

    def only(self, names: Sequence[str]) -> Hypotheses:
        at = [self.names.index(n) for n in names]
        return self.named(names, self.mean[at], self.covariance[at], self.noise_Nm[at])

    def joined(self, other: Hypotheses) -> Hypotheses:
        each = [(h.mean, h.covariance, h.noise_Nm) for h in (self, other)]
        both = map(np.concatenate, zip(*each, strict=True))
        return self.named(self.names + other.names, *both)

    def readings(self, weights: Array, error: Array) -> tuple[Array, Array]:
        """Mean (hypotheses, k) and covariance (hypotheses, k, k) of readings to come."""
        at = np.flatnonzero(weights.any(axis=0))
        w = weights[:, at]
        between = w @ self.covariance[:, at[:, None], at] @ w.T + error
        k = np.arange(len(w))
        between[:, k, k] += self.noise_Nm[:, at] ** 2 @ w.T
        return self.mean[:, at] @ w.T, between


def summarised(data: ResponseDataBase, kind: str = "people") -> Hypotheses:
    """The categories of a database as hypotheses, the reference among them."""
    if kind not in KINDS:
        raise UserError(f"summary: {kind!r}.", "Use people, distributions or centroids.")
    known, cells = data.common, data.grid.cells
    if not known.any():
        raise UserError("database: no location was reached by all.", "Record wider movements.")
    means, noises = [], []
    covariance = np.zeros((len(data.categories), cells, cells))
    for i, name in enumerate(data.categories):
        rows, mean = data.rows(name), data.mean(name)
        off = np.where(np.isfinite(rows) & known, rows - mean, 0.0)
        together = off.T @ off / max(1, len(rows) - 1)
        if kind == "people":
            # The mean is known from so many people only.
            covariance[i] = (1 + 1 / len(rows)) * _of_people(together, data.error_Nm2)
        noise = np.sqrt(np.maximum(np.diag(together), 1e-4))
        means.append(np.where(known, mean, 0.0))
        noises.append(noise if kind != "people" else np.full(cells, 1e-2))
    noise_Nm = np.array(noises)
    if kind == "centroids":
        noise_Nm[:] = np.sqrt(np.mean(noise_Nm[:, known] ** 2))
    return Hypotheses(data.categories, data.grid, known, np.array(means), covariance, noise_Nm)


def _of_people(seen: Array, error: Array | None) -> Array:
    # What people differ by: what is seen, less what the sensor's error makes of it.
    if error is None:
        return seen
    there = np.outer(np.diag(seen) > 0, np.diag(seen) > 0)
    values, vectors = np.linalg.eigh(seen - np.where(there, error, 0.0))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def none_of_these(of: Hypotheses) -> Hypotheses:
    """Any smooth map: around the middle of all categories, wider than they are."""
    people = np.diagonal(of.covariance, axis1=1, axis2=2)
    everybody = np.var(of.mean, axis=0) + np.mean(people, axis=0)
    wide = NONE_SCALE * np.sqrt(float(np.mean(everybody[of.known])))
    off = (of.grid.centres[:, None] - of.grid.centres[None]) / SMOOTH
    # Noisier than any: what is absurd under all is least absurd under this one.
    return of.named(
        (NONE,),
        of.mean.mean(axis=0)[None],
        (wide**2 * np.exp(-0.5 * np.sum(off**2, axis=2)))[None],
        np.hypot(NONE_NOISE_NM, 1.5 * of.noise_Nm.max(axis=0, keepdims=True)),
    )


def disorder_of(name: str) -> tuple[str, float] | None:
    """``S3`` as (S, 3); None for a name that is no disorder with a severity."""
    head, tail = name.rstrip("0123456789."), name[len(name.rstrip("0123456789.")) :]
    return (head, float(tail)) if head and tail else None


def between_severities(
    of: Hypotheses, step: float = 0.25
) -> tuple[Hypotheses, list[tuple[str, float]]]:
    """Hypotheses at severities between the categories, by interpolation along each disorder."""
    ladders: dict[str, dict[float, int]] = {}
    for i, name in enumerate(of.names):
        what = disorder_of(name)
        if what:
            ladders.setdefault(what[0], {})[what[1]] = i
    rows, labels = [], []
    for name, rungs in ladders.items():
        levels = sorted(rungs)
        for s in np.arange(levels[0], levels[-1] + step / 2, step):
            above = int(np.clip(np.searchsorted(levels, s), 1, max(1, len(levels) - 1)))
            low, high = levels[max(0, above - 1)], levels[min(above, len(levels) - 1)]
            share = 0.0 if high == low else float((s - low) / (high - low))
            rows.append((rungs[low], rungs[high], share))
            labels.append((name, float(s)))

    def mixed(x: Array) -> Array:
        return np.array([(1 - w) * x[a] + w * x[b] for a, b, w in rows])

    names = [f"{n}{s:g}" for n, s in labels]
    return of.named(names, *map(mixed, (of.mean, of.covariance, of.noise_Nm))), labels


def mixtures(of: Hypotheses, reference: str) -> Hypotheses:
    """Two disorders at once, each pair of severities: their torques beyond the reference add."""
    base = of.names.index(reference)
    names, means, covariances, noises = [], [], [], []
    parts = [(i, disorder_of(n)) for i, n in enumerate(of.names)]
    rungs = [(i, d) for i, d in parts if d]
    for i, first in rungs:
        for j, second in rungs:
            if first[0] <= second[0]:
                continue
            names.append(f"{of.names[i]}+{of.names[j]}")
            means.append(of.mean[i] + of.mean[j] - of.mean[base])
            covariances.append(of.covariance[i] + of.covariance[j])
            noises.append(np.maximum(of.noise_Nm[i], of.noise_Nm[j]))
    return of.named(names, np.array(means), np.array(covariances), np.array(noises))


class Evidence:
    """Evidence of the movements so far for each hypothesis, and the conditioned maps."""

    def __init__(self, hypotheses: Hypotheses) -> None:
        self.h = hypotheses
        self._movements: list[tuple[Array, Array, Array]] = []
        self._start()

    def _start(self) -> None:
        self.now, self._log = self.h, np.zeros(len(self.h.names))

    def __len__(self) -> int:
        return len(self._movements)

    def add(self, where: Location, response_Nm: float, spread_Nm: float = 0.0) -> bool:
        """One reading; False (and nothing counted) where the map says nothing of the location."""
        return self._take([where], np.array([float(response_Nm)]), np.array([[spread_Nm**2]]))

    def add_movement(self, readings: MovementReadings) -> bool:
        """All readings of one movement, whose errors go together; False as for one."""
        return self._take(readings.locations, readings.responses_Nm, readings.error_Nm2)

    def _take(self, where: Sequence[Location], values: Array, error: Array) -> bool:
        found = [self.h.grid.weights(w, self.h.known) for w in where]
        use = [i for i, w in enumerate(found) if w is not None and np.isfinite(values[i])]
        if not use:
            return False
        weights = np.array([found[i] for i in use])
        self._movements.append((weights, values[use], error[np.ix_(use, use)]))
        self._condition(*self._movements[-1])
        return True

    def _condition(self, weights: Array, values: Array, error: Array) -> None:
        mean, between = self.now.readings(weights, error)
        off = (values - mean)[..., None]
        root = np.linalg.cholesky(between)
        z = np.linalg.solve(root, off)
        size = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        density = -0.5 * np.sum(z[..., 0] ** 2, axis=1) - size
        self._log = self._log + density - 0.5 * len(values) * np.log(2 * np.pi)
        half = np.linalg.solve(root, weights @ self.now.covariance)  # (h, k, cells)
        back = np.swapaxes(half, 1, 2)
        self.now = dataclasses.replace(
            self.now,
            mean=self.now.mean + (back @ z)[..., 0],
            covariance=self.now.covariance - back @ half,
        )

    def under(self, hypotheses: Hypotheses) -> Evidence:
        """The same movements under other hypotheses over the same grid."""
        other = Evidence(hypotheses)
        for m in self._movements:
            other._movements.append(m)
            other._condition(*m)
        return other

    def history(self, hypotheses: Hypotheses, after: Sequence[int]) -> list[Array]:
        """Log likelihoods under other hypotheses after so many movements, of those there were."""
        other, out = Evidence(hypotheses), []
        for n, m in enumerate(self._movements, 1):
            other._condition(*m)
            if n in after:
                out.append(other.log_likelihood())
        return out

    def places(self) -> Array:
        """Where readings were, shape (readings, 2): angle, rate."""
        weights = [w for w, _, _ in self._movements]
        return np.concatenate([np.empty((0, self.h.grid.cells)), *weights]) @ self.h.grid.centres

    def undo(self) -> None:
        self._movements.pop()
        self._start()
        for m in self._movements:
            self._condition(*m)

    def log_likelihood(self) -> Array:
        """Log density of all readings together, shape (hypotheses,)."""
        return self._log


def normalised(log_weights: Array | Mapping[str, float]) -> Array:
    x = np.asarray(list(log_weights.values()) if isinstance(log_weights, Mapping) else log_weights)
    p = np.exp(x - np.max(x))
    return np.asarray(p / p.sum())
