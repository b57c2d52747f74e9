"""Several tests that answer one question."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from esea_host.statistics.checks import Array, NoStatisticError, numbers


def holm(p_values: ArrayLike) -> Array:
    """Holm's adjusted p values: each below alpha is significant over the whole family at alpha."""
    p = numbers(p_values, "The p values")
    if ((p < 0) | (p > 1)).any():
        raise NoStatisticError("A p value outside 0 to 1.", "Give probabilities.")
    order = np.argsort(p, kind="stable")
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    out = np.empty(len(p))
    out[order] = np.minimum(1.0, steps)
    return out
