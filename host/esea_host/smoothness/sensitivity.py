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
    """A metric over a grid of its settings: as they are, smallest and largest, by movement.

    refused: the settings without an answer, with the reason.
    """

    value: Any
    low: Any
    high: Any
    grid: dict[str, tuple[float, ...]]
    refused: tuple[str, ...]


def sensitivity_band(metric: Callable[..., SmoothnessResult], **grid: Sequence[float]) -> Band:
    """Lowest and highest value of a metric over every combination of settings.

    metric: takes the grid's names as keywords, and works without any of them.
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
