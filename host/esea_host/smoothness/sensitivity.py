"""Sensitivity of a metric to its settings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from esea_host.smoothness.checks import NoAnswerError
from esea_host.smoothness.result import SmoothnessResult


@dataclass(frozen=True)
class Band:
    """A metric over a grid of its settings.

    Parameters
    ----------
    value, low, high : float or ndarray
        With the settings as they are, and smallest and largest over the grid, by movement.
    grid, refused : dict and tuple of str
        The settings with the values that they took; those without an answer, with the reason.
    """

    value: Any
    low: Any
    high: Any
    grid: dict[str, tuple[float, ...]]
    refused: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self).items()
        } | {"refused": list(self.refused)}


def sensitivity_band(metric: Callable[..., SmoothnessResult], **grid: Sequence[float]) -> Band:
    """Lowest and highest value of a metric over every combination of settings.

    Parameters
    ----------
    metric : callable
        Takes the grid's names as keywords, and works without any of them.
    **grid : sequence of float
        Settings with the values that they take, such as ``cutoff_Hz=(5, 10, 20)``.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0, 1, 0.01)
    >>> speed = 30 * t**2 * (1 - t) ** 2
    >>> from esea_host.smoothness import sparc
    >>> band = sensitivity_band(lambda **s: sparc(speed, 100.0, **s), cutoff_Hz=(5, 10, 20))
    >>> band.low <= band.value <= band.high
    True
    """
    value = metric().value
    values, refused = [value], []
    for chosen in product(*grid.values()):
        settings = dict(zip(grid, chosen, strict=True))
        try:
            values.append(metric(**settings).value)
        except NoAnswerError as error:
            refused.append(f"{', '.join(f'{k} = {v:g}' for k, v in settings.items())}: {error}")
    return Band(
        value,
        np.minimum.reduce(values),
        np.maximum.reduce(values),
        {k: tuple(v) for k, v in grid.items()},
        tuple(refused),
    )
