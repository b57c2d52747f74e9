"""Rejects data that cannot be tested."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

Array = npt.NDArray[np.float64]
# Of the largest value: numbers closer than this are equal.  How a difference is rounded depends on
# the unit.
ROUNDING = 1e-12
TAIL = 0.025  # beyond either end of an interval: 95 %


class NoStatisticError(ValueError):
    """The numbers do not answer the question: the error states the reason and the remedy."""

    def __init__(self, what: str, fix: str) -> None:
        super().__init__(f"{what} {fix}")
        self.what, self.fix = what, fix


def numbers(values: ArrayLike, name: str, least: int = 1) -> Array:
    """A row of finite numbers, shape (n,)."""
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise NoStatisticError(f"{name}: no numbers.", "Give one number per person.") from None
    if found.ndim != 1 or len(found) < least:
        raise NoStatisticError(f"{name}: shape {found.shape}.", f"Give at least {least} numbers.")
    if not np.isfinite(found).all():
        raise NoStatisticError(
            f"{name}: {int(np.sum(~np.isfinite(found)))} of {len(found)} are missing or infinite.",
            "Leave these people out, and report it.",
        )
    return found


def differences(x: ArrayLike, y: ArrayLike | None, least: int) -> tuple[Array, float]:
    """x - y of the same people, or x itself, and the largest magnitude that went into them."""
    one = numbers(x, "The first condition", least)
    if y is None:
        return one, largest(one)
    other = numbers(y, "The second condition", least)
    if one.shape != other.shape:
        raise NoStatisticError(
            f"{len(one)} people in one condition and {len(other)} in the other.",
            "Give both values of each person, in the same order.",
        )
    return one - other, largest(one, other)


def largest(*values: Array) -> float:
    """The largest magnitude, at most 1e150: squares must be numbers, too."""
    found = max(float(np.max(np.abs(v))) for v in values)
    if found > 1e150:
        raise NoStatisticError(f"A value of {found:g}.", "Give at most 1e150: take a larger unit.")
    return found


def levels(values: Array, scale: float) -> npt.NDArray[np.int64]:
    """The rank of each value, 0 upwards; equal for those within 1e-12 of the scale."""
    order = np.argsort(values, kind="stable")
    out = np.zeros(len(values), dtype=np.int64)
    out[order[1:]] = np.cumsum(np.diff(values[order]) > ROUNDING * scale)
    return out


def share(value: float, name: str) -> float:
    """A probability strictly between 0 and 1."""
    if not 0 < value < 1:
        raise NoStatisticError(f"{name} of {value}.", "Give more than 0 and less than 1.")
    return float(value)


class StatisticResult:
    """A result for JSON: infinite or missing values become null."""

    def to_dict(self) -> dict[str, Any]:
        """Fields by name, in JSON's own types."""
        return {k: _plain(v) for k, v in vars(self).items()}


def _plain(value: Any) -> Any:
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if is_dataclass(value):
        return _plain(vars(value))
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value
