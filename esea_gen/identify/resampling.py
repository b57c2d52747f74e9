"""How far parameters and torque may be off, from what the fit says when parts are left out.

A covariance from the Jacobian takes every sample for independent: with slow noise it is far too
narrow, and of friction that the model has no term for it knows nothing.  Here whole blocks are left
out in turn, a cycle or a condition (rate, amplitude, specimen) [1]_; to first order each needs no
fit of its own.  A cycle sees noise, a condition also what the model or the encoder does wrong
differently at each; the variance is the mean of both.  Friction is the same in every block: it is
tried as one more term, and where that stands clear of its own deviation, what it would move the
parameters by is added.

References
----------
.. [1] M. H. Quenouille, Biometrika 43 (1956) 353; J. W. Tukey, Ann. Math. Stat. 29 (1958) 614: the
   jackknife, of blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from esea_gen.identify.conditions import conditions_of
from esea_gen.identify.cycles import DataSet
from esea_gen.language.ports import Array

if TYPE_CHECKING:
    from esea_gen.identify.recorded import Recording

Blocks = npt.NDArray[np.intp]

LEAST_CONDITIONS = 3  # below, conditions say nothing of their own spread
LEAST_BLOCKS = 6  # into which a recording of fewer cycles is cut
CLEAR = 4.0  # friction's deviations
BAND = 0.95


@dataclass(frozen=True)
class FitRows:
    """Which block each row belongs to.

    cycle, condition: numbers of blocks, shape (rows,).
    way: direction of the deflection, -1 to 1, shape (rows,).
    """

    cycle: Blocks
    condition: Blocks
    way: Array

    @classmethod
    def of(cls, sets: Sequence[tuple[int, int, Array]]) -> FitRows:
        """Of data sets, in the order of the rows.

        sets: of each its condition, how many cycles its rows span, and the rows' direction.
        """
        cut = max(1, -(-LEAST_BLOCKS // len(sets))) if len(sets) < LEAST_BLOCKS else 1
        cycle, condition, first = [], [], 0
        for number, cycles, way in sets:
            count = max(cycles, cut)
            cycle.append(first + np.arange(len(way)) * count // max(len(way), 1))
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
            (names.index(c), s.cycles.get("training", 1), way)
            for c, (_, s), way in zip(known, sets, ways, strict=True)
        ]
    )


def whole_conditions(recordings: Sequence[Recording]) -> bool:
    """Whether whole conditions judge, and not the last cycles of those that train."""
    return not any(len(s.training) and len(s.held_out) for r in recordings for s in r.sets)


@dataclass(frozen=True)
class LeftOut:
    """What leaving blocks out says.

    covariance: of the parameters, in their own units.
    band_Nm: half width that holds 95 % of the torque errors in blocks left out.
    friction_Nm: Coulomb friction that the residuals show and the model has not; None where they
        show none.
    conditions: how many there are.
    outside_Nm, weight: error of every row by the fit to the other blocks, measured less modelled,
        and the row's weight in the fit, shape (rows,).
    """

    covariance: Array
    band_Nm: float
    friction_Nm: float | None
    conditions: int
    outside_Nm: Array
    weight: Array

    @property
    def sigma(self) -> Array:
        """Standard deviation of each parameter."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, apart from the deviations."""
        return {
            "assumes": "blocks left out in turn: the mean of the variances over cycles and over "
            "conditions; friction that shows is added",
            "band_Nm": self.band_Nm,
            "band_share": BAND,
            "unmodelled_friction_Nm": self.friction_Nm,
            "conditions": self.conditions,
        }


def resampled(
    jacobian: Array, residual: Array, weight: Array, rows: FitRows, whole_conditions: bool
) -> LeftOut:
    """Leave every cycle and every condition out, in turn.

    jacobian: torque by parameter, shape (rows, parameters).
    residual: measured less modelled torque, shape (rows,).
    weight: of each row in the fit, shape (rows,); residuals are multiplied with it.
    whole_conditions: whether the torque's band is of conditions left out, or of cycles.
    """
    names = (rows.cycle, rows.condition)
    few = len(np.unique(rows.condition)) < LEAST_CONDITIONS
    used = names[:1] if few else names
    covariance = _mean_covariance(jacobian, residual, weight, used)
    if len(np.unique(rows.cycle)) <= jacobian.shape[1]:
        # Fewer blocks than parameters leave directions in which nothing seems to move.
        covariance = covariance + _plain(jacobian, residual, weight)
    friction = None
    more = np.column_stack([jacobian, rows.way])
    found = np.linalg.lstsq(more * weight[:, None], residual * weight, rcond=None)[0]
    left = residual - more @ found
    own = float(_mean_covariance(more, left, weight, used)[-1, -1])
    if abs(found[-1]) > CLEAR * np.sqrt(own) and own > 0:
        friction = float(found[-1])
        covariance = covariance + np.outer(found[:-1], found[:-1])
    by = rows.condition if whole_conditions and not few else rows.cycle
    outside = _left_out(jacobian, residual, weight, by)
    band = half_width_Nm(outside, weight)
    return LeftOut(covariance, band, friction, len(np.unique(names[1])), outside, weight)


def _mean_covariance(
    jacobian: Array, residual: Array, weight: Array, names: Sequence[Blocks]
) -> Array:
    return np.asarray(np.mean([_covariance(jacobian, residual, weight, n) for n in names], axis=0))


def autocorrelation(residual: Array) -> float:
    """Of neighbours, as of a first-order autoregressive noise: from 0 to just below 1."""
    rho = float(residual[1:] @ residual[:-1] / (residual @ residual))
    return min(max(rho, 0.0), 1 - 2.0 / len(residual))


def _plain(jacobian: Array, residual: Array, weight: Array) -> Array:
    # Right form, autoregressive noise.
    j, r = jacobian * weight[:, None], residual * weight
    rho = autocorrelation(r)
    noise = float(r @ r) / max(1, len(r) - j.shape[1]) * (1 + rho) / (1 - rho)
    return np.asarray(noise * np.linalg.pinv(j.T @ j, rcond=1e-12, hermitian=True))


def _moves(jacobian: Array, residual: Array, weight: Array, blocks: Blocks) -> dict[int, Array]:
    # Of the parameters, when a block is left out.
    j, r = jacobian * weight[:, None], residual * weight
    whole = j.T @ j
    out = {}
    for b in np.unique(blocks):
        own = j[blocks == b]
        rest = np.linalg.pinv(whole - own.T @ own, rcond=1e-12, hermitian=True)
        out[int(b)] = -rest @ (own.T @ r[blocks == b])
    return out


def _covariance(jacobian: Array, residual: Array, weight: Array, blocks: Blocks) -> Array:
    moves = np.array(list(_moves(jacobian, residual, weight, blocks).values()))
    count, apart = len(moves), moves - moves.mean(axis=0)
    return np.asarray((count - 1) / count * apart.T @ apart)


def _left_out(jacobian: Array, residual: Array, weight: Array, blocks: Blocks) -> Array:
    # Residuals of every block by the fit to the others.
    out = residual.copy()
    for b, move in _moves(jacobian, residual, weight, blocks).items():
        out[blocks == b] -= jacobian[blocks == b] @ move
    return out


def half_width_Nm(error_Nm: Array, weight: Array) -> float:
    """Half width that holds 95 % of errors, each of them as often as its squared weight says."""
    sizes, often = np.abs(error_Nm), weight**2
    order = np.argsort(sizes)
    share = np.cumsum(often[order]) / often.sum()
    return float(sizes[order][min(int(np.searchsorted(share, BAND)), len(sizes) - 1)])


def covered(error: Array, band_Nm: float) -> float:
    """Share of errors inside a band."""
    return float(np.mean(np.abs(error) <= band_Nm)) if len(error) else float("nan")


__all__ = [
    "FitRows",
    "LeftOut",
    "autocorrelation",
    "covered",
    "half_width_Nm",
    "resampled",
    "rows_of",
    "whole_conditions",
]
