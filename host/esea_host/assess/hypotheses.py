"""What a person of each category would answer: a joint Gaussian over all locations.

A category's responses are mean + factors + noise.  The factors say how people of one category
differ from each other all over the map: a strong patient is strong everywhere, and what was seen
in earlier movements is not counted as news again.  Without factors this is the thesis' naive Bayes
(8.5, 8.6).  "None of these" is one more hypothesis: any smooth map, wide.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.assess.database import LocationGrid, ResponseDataBase
from esea_host.assess.kernel_map import kernel_map, smooth_covariance
from esea_host.assess.patients import Array
from esea_host.assess.responses import Location

NONE = "none of these"
FACTORS = 4
# "None of these": how far a map of no category goes from the middle of all, and how smoothly.
NONE_SCALE = 1.5  # of the spread of all categories' people
NONE_RANK = 14
NONE_NOISE_NM = 3.0  # and how unsteady it may be: tremor, a leg that is not relaxed; assumed


@dataclass(frozen=True)
class Summary:
    """How a data base is summarised.

    kind: ``people`` (joint distribution), ``distributions`` and ``centroids`` (thesis),
        ``kernel`` (Gaussian process: its uncertainty grows away from data).
    """

    kind: str = "people"

    def __post_init__(self) -> None:
        if self.kind not in ("people", "distributions", "centroids", "kernel"):
            raise UserError(
                f"summary: {self.kind!r}.", "people, distributions, centroids or kernel."
            )


@dataclass(frozen=True)
class Hypotheses:
    """Several hypotheses over the locations of one grid.

    mean: shape (hypotheses, cells); factors: (hypotheses, rank, cells); noise_Nm: (hypotheses,
    cells), what neither explains, of one movement.
    """

    names: tuple[str, ...]
    grid: LocationGrid
    known: npt.NDArray[np.bool_]
    mean: Array
    factors: Array
    noise_Nm: Array

    def with_movement_noise(self, own_Nm: float, share: float, factor_scale: float) -> Hypotheses:
        """Noise of one probing movement (calibrated on other patients) in place of the map's."""
        noise = np.sqrt(own_Nm**2 + (share * self.mean) ** 2)
        return dataclasses.replace(
            self, noise_Nm=noise, factors=np.sqrt(factor_scale) * self.factors
        )

    def only(self, names: Sequence[str]) -> Hypotheses:
        """Some of them."""
        at = [self.names.index(n) for n in names]
        return dataclasses.replace(
            self,
            names=tuple(names),
            mean=self.mean[at],
            factors=self.factors[at],
            noise_Nm=self.noise_Nm[at],
        )

    def joined(self, other: Hypotheses) -> Hypotheses:
        """Both, one after the other."""
        rank = max(self.factors.shape[1], other.factors.shape[1])
        parts = [
            np.pad(x.factors, ((0, 0), (0, rank - x.factors.shape[1]), (0, 0)))
            for x in (self, other)
        ]
        return dataclasses.replace(
            self,
            names=self.names + other.names,
            mean=np.concatenate([self.mean, other.mean]),
            factors=np.concatenate(parts),
            noise_Nm=np.concatenate([self.noise_Nm, other.noise_Nm]),
        )


def summarised(data: ResponseDataBase, kind: Summary | str = "people") -> Hypotheses:
    """The categories of a data base as hypotheses, the reference among them."""
    kind = kind if isinstance(kind, Summary) else Summary(kind)
    known, cells = data.common, data.grid.cells
    if not known.any():
        raise UserError("data base: no location was reached by all.", "Record wider movements.")
    means, factors, noises = [], [], []
    for name in data.categories:
        if kind.kind == "kernel":
            m, s = kernel_map(data, name)
            means.append(m)
            noises.append(s)
            factors.append(np.zeros((1, cells)))
            continue
        rows, mean = data.rows(name), data.mean(name)
        off = np.where(np.isfinite(rows), rows - mean, 0.0)
        off[:, ~known] = 0
        rank = FACTORS if kind.kind == "people" else 0
        _, s, v = np.linalg.svd(off, full_matrices=False)
        rank = min(rank, len(s))
        b = s[:rank, None] * v[:rank] / np.sqrt(max(1, len(rows) - 1))
        total = np.sum(off**2, axis=0) / max(1, len(rows) - 1)
        means.append(np.where(known, mean, 0.0))
        factors.append(np.pad(b, ((0, max(FACTORS, 1) - rank), (0, 0))))
        noises.append(np.sqrt(np.maximum(total - np.sum(b**2, axis=0), 1e-4)))
    found = Hypotheses(
        data.categories,
        data.grid,
        known,
        np.array(means),
        np.array(factors),
        np.array(noises),
    )
    if kind.kind == "centroids":
        same = float(np.sqrt(np.mean(found.noise_Nm[:, known] ** 2)))
        found = dataclasses.replace(found, noise_Nm=np.full_like(found.noise_Nm, same))
    return found


def none_of_these(of: Hypotheses) -> Hypotheses:
    """Any smooth map: around the middle of all categories, wider than they are."""
    middle = of.mean.mean(axis=0)
    everybody = np.var(of.mean, axis=0) + np.mean(np.sum(of.factors**2, axis=1), axis=0)
    wide = NONE_SCALE * np.sqrt(float(np.mean(everybody[of.known])))
    covariance = wide**2 * smooth_covariance(of.grid.centres, of.grid.centres, wide=True)
    values, vectors = np.linalg.eigh(covariance)
    top = np.argsort(values)[::-1][:NONE_RANK]
    factors = np.sqrt(np.maximum(values[top], 0))[:, None] * vectors[:, top].T
    return Hypotheses(
        (NONE,),
        of.grid,
        of.known,
        middle[None],
        factors[None],
        # Noisier than any: what is absurd under all is least absurd under this one.
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

    # Factors of neighbours may turn the other way round: taken of the nearer one.
    near = [a if w < 0.5 else b for a, b, w in rows]
    found = dataclasses.replace(
        of,
        names=tuple(f"{n}{s:g}" for n, s in labels),
        mean=mixed(of.mean),
        factors=of.factors[near],
        noise_Nm=mixed(of.noise_Nm),
    )
    return found, labels


def mixtures(of: Hypotheses, reference: str) -> Hypotheses:
    """Two disorders at once, each pair of severities: their torques beyond the reference add."""
    base = of.names.index(reference)
    names, means, factors, noises = [], [], [], []
    parts = [(i, disorder_of(n)) for i, n in enumerate(of.names)]
    rungs = [(i, d) for i, d in parts if d]
    for i, first in rungs:
        for j, second in rungs:
            if first[0] <= second[0]:
                continue
            names.append(f"{of.names[i]}+{of.names[j]}")
            means.append(of.mean[i] + of.mean[j] - of.mean[base])
            factors.append(np.concatenate([of.factors[i], of.factors[j]]))
            noises.append(np.maximum(of.noise_Nm[i], of.noise_Nm[j]))
    return dataclasses.replace(
        of,
        names=tuple(names),
        mean=np.array(means),
        factors=np.array(factors),
        noise_Nm=np.array(noises),
    )


class Evidence:
    """What readings so far say under each hypothesis, and what the next would be."""

    def __init__(self, hypotheses: Hypotheses) -> None:
        self.h = hypotheses
        self._weights: list[Array] = []
        self._values: list[float] = []
        self._extra: list[float] = []

    def __len__(self) -> int:
        return len(self._values)

    def add(self, where: Location, response_Nm: float, spread_Nm: float = 0.0) -> bool:
        """One reading; False (and nothing counted) where the map says nothing of the location."""
        w = self.h.grid.weights(where, self.h.known)
        if w is None or not np.isfinite(response_Nm):
            return False
        self._weights.append(w)
        self._values.append(float(response_Nm))
        self._extra.append(float(spread_Nm) ** 2)
        return True

    def under(self, hypotheses: Hypotheses) -> Evidence:
        """The same readings under other hypotheses over the same grid."""
        other = Evidence(hypotheses)
        other._weights, other._values = list(self._weights), list(self._values)
        other._extra = list(self._extra)
        return other

    def places(self) -> Array:
        """Where readings were, shape (readings, 2): angle, rate."""
        return np.array(self._weights).reshape(-1, self.h.grid.cells) @ self.h.grid.centres

    def undo(self) -> None:
        """Forget the last reading."""
        for x in (self._weights, self._values, self._extra):
            x.pop()

    def _moments(self) -> tuple[Array, Array, Array, Array]:
        w = np.array(self._weights)
        b = self.h.factors @ w.T  # (h, rank, k)
        off = np.array(self._values) - self.h.mean @ w.T
        noise = self.h.noise_Nm**2 @ w.T + np.array(self._extra)
        c = np.einsum("hrk,hrl->hkl", b, b)
        k = np.arange(len(w))
        c[:, k, k] += noise
        return w, b, off, c

    def log_likelihood(self) -> Array:
        """Log density of all readings together, shape (hypotheses,)."""
        if not self._values:
            return np.zeros(len(self.h.names))
        _, _, off, c = self._moments()
        root = np.linalg.cholesky(c)
        z = np.linalg.solve(root, off[..., None])[..., 0]
        size = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return np.asarray(
            -0.5 * np.sum(z**2, axis=1) - size - 0.5 * off.shape[1] * np.log(2 * np.pi)
        )

    def predicted(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the next reading at every cell, given all so far."""
        mean, variance = self.h.mean, np.sum(self.h.factors**2, axis=1) + self.h.noise_Nm**2
        if not self._values:
            return mean, np.sqrt(variance)
        _, b, off, c = self._moments()
        cross = np.einsum("hrc,hrk->hck", self.h.factors, b)
        gain = np.linalg.solve(c, np.swapaxes(cross, 1, 2))  # (h, k, cells)
        after = variance - np.einsum("hck,hkc->hc", cross, gain)
        return mean + np.einsum("hkc,hk->hc", gain, off), np.sqrt(np.maximum(after, 1e-9))


def normalised(log_weights: Array | Mapping[str, float]) -> Array:
    """Probabilities from logs, whatever their size."""
    x = np.asarray(list(log_weights.values()) if isinstance(log_weights, Mapping) else log_weights)
    p = np.exp(x - np.max(x))
    return np.asarray(p / p.sum())
