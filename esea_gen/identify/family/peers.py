"""Two models from the literature, fitted by SciPy: what the family is held against.

Bouc-Wen [1]_ (springs x and x^3 and one hysteretic variable) and the generalised Maxwell model with
Coulomb friction (the same springs, three branches, one narrow stop operator for the friction).
Their weights may have either sign, and their shape is searched from several starts.

References
----------
.. [1] M. Ismail, F. Ikhouane, J. Rodellar, "The hysteresis Bouc-Wen model, a survey", Archives of
   Computational Methods in Engineering 16, 2009.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import qmc

from esea_gen.identify.family.fit import trained_scale
from esea_gen.identify.published.plant import equal_weights
from esea_gen.identify.recording.reading import resample
from esea_gen.identify.recording.recorded import Recording
from esea_gen.language.ports import Array

STARTS, STEPS = 4, 20
MOST_SAMPLES = 2000  # of a recording: the loops are Python's
COULOMB_BAND = 0.01  # of the largest trained deflection

Columns = Callable[[Array, Array, Array], Array]


def _springs(x: Array) -> list[Array]:
    # With x^5 too they train better, and are far worse where the largest amplitude is left out.
    return [x, x**3]


def bouc_wen(shape: Array, _t: Array, x: Array) -> Array:
    """Columns for ln(yield), exponent and share of the path's direction."""
    yielded, power, beta = math.exp(shape[0]), shape[1], shape[2]
    u, out = 0.0, [0.0]
    for dx in (np.diff(x) / yielded).tolist():
        turn = 1.0 if dx * u > 0 else -1.0
        u += dx * (1 - abs(u) ** power * (beta * turn + 1 - beta))
        u = min(1.0, max(-1.0, u))
        out.append(u)
    return np.stack([*_springs(x), np.array(out)], axis=1)


def maxwell_coulomb(shape: Array, t: Array, x: Array) -> Array:
    """Columns for the logarithms of three relaxation times."""
    step = t[1] - t[0]
    branches = []
    for time in np.exp(shape):
        decay = math.exp(-step / time)
        mean = (1 - decay) * time / step
        branches.append(np.concatenate([[0.0], lfilter([mean], [1, -decay], np.diff(x))]))
    inner, friction = x[0], []
    for value in x.tolist():
        inner = min(max(inner, value - COULOMB_BAND), value + COULOMB_BAND)
        friction.append(value - inner)
    return np.stack([*_springs(x), *branches, np.array(friction)], axis=1)


PEERS: dict[str, tuple[Columns, Array, Array]] = {
    "Bouc-Wen (SciPy)": (
        bouc_wen,
        np.array([math.log(0.01), 0.3, 0.0]),
        np.array([math.log(3.0), 4.0, 1.0]),
    ),
    "Maxwell + Coulomb (SciPy)": (
        maxwell_coulomb,
        np.log([0.03, 0.3, 3.0]),
        np.log([3.0, 30.0, 1000.0]),
    ),
}


def fit_peer(name: str, recordings: Sequence[Recording], seed: int) -> list[Array]:
    """Fit a peer on the training samples."""
    columns, low, high = PEERS[name]
    scale = trained_scale(recordings)
    grids = [np.linspace(0, r.time_s[-1], min(len(r.time_s), MOST_SAMPLES)) for r in recordings]
    paths = [
        resample(r.time_s, r.theta_rad, g) / scale for r, g in zip(recordings, grids, strict=True)
    ]
    at = [
        [np.clip(np.searchsorted(g, r.time_s[s.training]), 0, len(g) - 1) for s in r.sets]
        for r, g in zip(recordings, grids, strict=True)
    ]
    sets = [r.tau_Nm[s.training] for r in recordings for s in r.sets if len(s.training)]
    weight = equal_weights(sets)
    target = np.concatenate(sets) * weight

    def solved(shape: Array) -> tuple[Array, Array, list[Array]]:
        every = [columns(shape, g, x) for g, x in zip(grids, paths, strict=True)]
        rows = np.concatenate(
            [c[i] for c, places in zip(every, at, strict=True) for i in places if len(i)]
        )
        basis = rows * weight[:, None]
        linear: Array = np.asarray(np.linalg.lstsq(basis, target, rcond=None)[0], np.float64)
        return basis @ linear - target, linear, every

    starts = qmc.scale(qmc.Sobol(len(low), seed=seed).random(STARTS), low, high)
    ends = [
        least_squares(
            lambda p: solved(p)[0], x0, bounds=(low, high), diff_step=1e-3, max_nfev=STEPS
        )
        for x0 in starts
    ]
    _, linear, every = solved(min(ends, key=lambda e: float(e.cost)).x)
    return [
        resample(g, c @ linear, r.time_s) for r, g, c in zip(recordings, grids, every, strict=True)
    ]
