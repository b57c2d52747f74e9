"""Uncertainty of parameters and torque, from fits with parts left out.

A covariance from the Jacobian takes every sample for independent: with slow noise it is far too
narrow, and it ignores friction, for which the model has no term.  Here whole blocks are left out in
turn, a cycle or a condition (rate, amplitude, specimen) [1]_; to first order each needs no fit of
its own.  A cycle sees noise, a condition also what the model or the encoder does wrong differently
at each; the variance is the mean of both.  Friction is the same in every block: it is tried as one
more term, and where that clearly exceeds its own deviation, its effect on the parameters is added.

References
----------
.. [1] M. H. Quenouille, Biometrika 43 (1956) 353; J. W. Tukey, Ann. Math. Stat. 29 (1958) 614: the
   jackknife, of blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy  # its parts are read on first use

from esea_gen.identify.recording.conditions import conditions_of
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.recorded import Recording, training_sets
from esea_gen.language.ports import Array

Blocks = npt.NDArray[np.intp]

LEAST_CONDITIONS = 3  # below, conditions say nothing of their own spread
LEAST_BLOCKS = 6  # into which a recording of fewer cycles is cut
CLEAR = 4.0  # friction's deviations
BAND = 0.95
# A direction of the parameters is not determined where it changes the torque by less than this
# share of what the strongest does: that is rounding, and the error of a derivative by differences.
ROUNDING = 1e-6
TAKES_PART = 1e-3  # component in such a direction above which a parameter is in it
# Left of what determines a direction when a block is left out; below, its deviation would be a
# hundred times as large, and what it moves by says nothing of the whole.
ALONE = 1e-4


@dataclass(frozen=True)
class FitRows:
    """Which block each row belongs to."""

    cycle: Blocks  # numbers of blocks, shape (rows,)
    condition: Blocks
    way: Array  # direction of the deflection, -1 to 1, shape (rows,)
    alone: bool = False  # whether cycles alone say how far parameters may be off

    @classmethod
    def of(cls, sets: Sequence[tuple[int, int, Array]]) -> FitRows:
        """Of data sets, in the order of the rows."""
        cut = -(-LEAST_BLOCKS // len(sets))
        cycle, condition, first = [], [], 0
        for number, cycles, way in sets:
            count = max(cycles, cut)
            cycle.append(first + np.arange(len(way)) * count // len(way))
            condition.append(np.full(len(way), number))
            first += count
        ways = np.concatenate([w for _, _, w in sets])
        return cls(
            np.concatenate(cycle).astype(np.intp), np.concatenate(condition).astype(np.intp), ways
        )


def rows_of(sets: Sequence[tuple[Recording, DataSet]], ways: Sequence[Array]) -> FitRows:
    """Of data sets that train, with the direction of the deflection at their rows."""
    known = [conditions_of(r, s)[0] for r, s in sets]
    names = list(dict.fromkeys(known))
    return FitRows.of(
        [
            (names.index(c), s.cycles.get("training", 0), way)
            for c, (_, s), way in zip(known, sets, ways, strict=True)
        ]
    )


def whole_conditions(recordings: Sequence[Recording]) -> bool:
    """Whether whole conditions judge, and not the last cycles of those that train."""
    return not any(len(s.training) and len(s.held_out) for r in recordings for s in r.sets)


def rests_on_one(
    recordings: Sequence[Recording], lost: Callable[[list[Recording]], object]
) -> bool:
    """Whether some condition alone tells: left out, its move would be no deviation."""
    used = {conditions_of(r, s)[0] for r, s in training_sets(recordings)}

    def left(r: Recording, condition: str) -> Recording:
        sets = (
            replace(s, training=s.training[:0]) if conditions_of(r, s)[0] == condition else s
            for s in r.sets
        )
        return replace(r, sets=tuple(sets))

    return any(lost([left(r, c) for r in recordings]) for c in used)


@dataclass(frozen=True)
class LeftOut:
    covariance: Array  # of the parameters, in their own units
    band_Nm: float  # half width that holds 95 % of the torque errors in blocks left out
    friction_Nm: float | None  # that the model has not
    conditions: int
    outside_Nm: Array  # error of each row by the fit to the other blocks
    weight: Array  # of each row in the fit
    unknown: npt.NDArray[np.bool_]  # parameters that the rows do not determine

    @property
    def sigma(self) -> Array:
        """Standard deviation of each parameter; infinite for one that the data do not determine."""
        return np.where(self.unknown, np.inf, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    def to_dict(self) -> dict[str, Any]:
        return {
            "assumes": "blocks left out in turn: the mean of the variances over cycles and over "
            "conditions; friction that shows is added",
            "band_Nm": self.band_Nm,
            "band_share": BAND,
            "unmodelled_friction_Nm": self.friction_Nm,
            "conditions": self.conditions,
        }


def resampled(
    jacobian: Array,
    residual: Array,
    weight: Array,
    rows: FitRows,
    whole_conditions: bool,
    room: tuple[Array, Array] | None = None,
) -> LeftOut:
    """Leave every cycle and every condition out, in turn."""
    few = len(np.unique(rows.condition)) < LEAST_CONDITIONS
    used = (rows.cycle,) if few or rows.alone else (rows.cycle, rows.condition)
    fit = Determined.of(jacobian, residual, weight)
    covariance = fit.covariance(used)
    if len(np.unique(rows.cycle)) <= jacobian.shape[1]:
        # Fewer blocks than parameters leave directions in which nothing seems to move.
        covariance = covariance + fit.plain()
    friction = None
    more = np.column_stack([jacobian, rows.way])
    found = np.linalg.lstsq(more * weight[:, None], residual * weight, rcond=None)[0]
    beside = Determined.of(more, residual - more @ found, weight)
    own = float(beside.covariance(used)[-1, -1])
    if abs(found[-1]) > CLEAR * np.sqrt(own) and own > 0 and not beside.unknown[-1]:
        friction = float(found[-1])
        covariance = covariance + np.outer(found[:-1], found[:-1])
    by = rows.condition if whole_conditions and not few else rows.cycle
    outside = fit.left_out(by, room)
    band = half_width_Nm(outside, weight)
    count = len(np.unique(rows.condition))
    return LeftOut(covariance, band, friction, count, outside, weight, fit.unknown)


@dataclass(frozen=True)
class Determined:
    """A fit in coordinates in which its information is the identity."""

    basis: Array  # torque by coordinate, orthonormal
    back: Array  # parameters by coordinate, shape (parameters, coordinates)
    error: Array  # residuals with their weight, shape (rows,)
    weight: Array
    unknown: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, jacobian: Array, residual: Array, weight: Array) -> Determined:
        j = jacobian * weight[:, None]
        # Of parameters of any unit; one without effect stays 0.
        size = np.sqrt(np.einsum("ij,ij->j", j, j))
        size[size == 0] = 1.0
        u, s, v = np.linalg.svd(j / size, full_matrices=False)
        kept = s > ROUNDING * s[0]
        # Of all directions, in fewer rows than parameters too.
        unknown = 1 - np.sum(v[kept] ** 2, axis=0) > TAKES_PART**2
        back = v[kept].T / s[kept] / size[:, None]
        return cls(u[:, kept], back, residual * weight, weight, unknown)

    def plain(self) -> Array:
        """Covariance of the right form and autoregressive noise."""
        return self.back @ self._noise() @ self.back.T

    def _noise(self) -> Array:
        r, coordinates = self.error, self.basis.shape[1]
        rho = autocorrelation(r)
        noise = float(r @ r) / max(1, len(r) - coordinates) * (1 + rho) / (1 - rho)
        return np.asarray(noise * np.eye(coordinates))

    def covariance(self, names: Sequence[Blocks]) -> Array:
        """Mean over kinds of blocks, the finest first."""
        # In a direction that a block alone determines, leaving it out moves nothing that could be
        # compared: there the finer blocks speak, below the finest the plain covariance.
        finer, every = None, []
        for blocks in names:
            moves, seen = self._moves(blocks)
            known = np.array(list(moves.values())) @ seen
            count, apart = len(known), known - known.mean(axis=0)
            own = (count - 1) / count * apart.T @ apart
            lost = np.eye(len(seen)) - seen
            if np.trace(lost) > 0.5:
                own = own + lost @ (self._noise() if finer is None else finer) @ lost
            finer = own
            every.append(own)
        return np.asarray(self.back @ np.mean(every, axis=0) @ self.back.T)

    def _moves(self, blocks: Blocks) -> tuple[dict[int, Array], Array]:
        # Of the coordinates, when a block is left out; and the projection onto those directions
        # that no block determines alone.
        out, alone = {}, []
        for b in np.unique(blocks):
            own = self.basis[blocks == b]
            share, v = np.linalg.eigh(own.T @ own)
            left = 1 - share
            kept = left > ALONE
            alone.append(v[:, ~kept].T)
            inverse = np.divide(1, left, out=np.zeros(len(left)), where=kept)
            out[int(b)] = -(v * inverse) @ (v.T @ (own.T @ self.error[blocks == b]))
        _, s, v = np.linalg.svd(np.concatenate(alone), full_matrices=True)
        free = v[np.count_nonzero(s > 1e-3) :]
        return out, free.T @ free

    def left_out(self, blocks: Blocks, room: tuple[Array, Array] | None) -> Array:
        """Residuals of every block by the fit to the others, inside the parameters' bounds."""
        out = self.error.copy()
        for b, free in self._moves(blocks)[0].items():
            own = self.basis[blocks == b]
            move = free if room is None else self._bounded(own, free, room)
            out[blocks == b] -= own @ move
        return np.asarray(out / self.weight)

    def _bounded(self, own: Array, move: Array, room: tuple[Array, Array]) -> Array:
        # The move inside the bounds that is best for the other rows; what they do not tell stays.
        low, high = room
        change = self.back @ move
        if np.all(change >= low) and np.all(change <= high):
            return move
        share, v = np.linalg.eigh(own.T @ own)
        left = np.where(1 - share > ALONE, 1 - share, 1.0)
        root = np.sqrt(left)[:, None] * v.T
        place = np.linalg.pinv(self.back)
        found = scipy.optimize.lsq_linear(root @ place, root @ move, room, method="bvls")
        return np.asarray(place @ found.x)


def autocorrelation(residual: Array) -> float:
    """Of neighbours, as of a first-order autoregressive noise: from 0 to just below 1."""
    rho = float(residual[1:] @ residual[:-1] / (residual @ residual))
    return min(max(rho, 0.0), 1 - 2.0 / len(residual))


def half_width_Nm(error_Nm: Array, weight: Array) -> float:
    """Half width that holds 95 % of errors, each of them as often as its squared weight says."""
    sizes = np.abs(error_Nm)
    return float(np.quantile(sizes, BAND, weights=weight**2, method="inverted_cdf"))


def covered(error: Array, band_Nm: float) -> float:
    """Share of errors inside a band."""
    return float(np.mean(np.abs(error) <= band_Nm)) if len(error) else float("nan")
