"""Distributions over many cases: percentiles with their bootstrap intervals, failures counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.journal import Configuration, Result, canonical, versions
from esea_gen.errors import UserError
from esea_gen.language.ports import Array

LEVELS = (5.0, 25.0, 50.0, 75.0, 95.0)
RESAMPLES = 2000
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Percentiles:
    """Distribution of one figure.

    Parameters
    ----------
    name : str
        The figure.
    count, failed : int
        Cases that gave it, and cases that failed.
    values : dict of float to float
        Percentile (5, 25, 50, 75, 95) to value, of the cases that gave it.
    low, high : dict of float to float
        95 % bootstrap interval of each.
    largest : float
        Largest value; no interval, since no resample goes beyond it.
    """

    name: str
    count: int
    failed: int
    values: dict[float, float]
    low: dict[float, float]
    high: dict[float, float]
    largest: float

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: ``p5``, ``p5_low``, ``p5_high``, ..., ``max``."""
        content: dict[str, Any] = {"count": self.count, "failed": self.failed}
        for level, value in self.values.items():
            stem = f"p{level:g}"
            content |= {
                stem: value,
                f"{stem}_low": self.low[level],
                f"{stem}_high": self.high[level],
            }
        return content | {"max": self.largest}


def percentiles(name: str, values: npt.ArrayLike, *, failed: int = 0) -> Percentiles:
    """Percentiles of some values, each with its bootstrap interval.

    Parameters
    ----------
    name : str
        What they are.
    values : array_like
        Finite, shape (n,).
    failed : int
        Cases that gave none, for the record.

    Notes
    -----
    Linear interpolation between order statistics; interval: 2.5 and 97.5 % of the percentile over
    2000 resamples with a fixed seed [1]_.  With few cases the outer percentiles' intervals are too
    narrow, since nothing beyond the extremes can be drawn: below 60 cases take the largest value.

    References
    ----------
    .. [1] B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, Chapman & Hall, 1993,
       chapter 13.
    """
    found = np.sort(np.asarray(values, dtype=np.float64).ravel())
    if not found.size or not np.all(np.isfinite(found)):
        raise UserError(
            f"{name}: {found.size} values, {np.count_nonzero(~np.isfinite(found))} not finite.",
            "Count cases without a finite value as failed.",
        )
    rng = np.random.default_rng(20230915)
    point = np.percentile(found, LEVELS)
    drawn = np.empty((RESAMPLES, len(LEVELS)))
    block = max(1, 2_000_000 // found.size)  # 16 MB at a time
    for start in range(0, RESAMPLES, block):
        stop = min(start + block, RESAMPLES)
        picks = rng.integers(0, found.size, (stop - start, found.size))
        drawn[start:stop] = np.percentile(found[picks], LEVELS, axis=1).T
    edge = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(drawn, (edge, 100 - edge), axis=0)

    def named(row: Array) -> dict[float, float]:
        return dict(zip(LEVELS, row.tolist(), strict=True))

    return Percentiles(
        name, found.size, failed, named(point), named(low), named(high), float(found[-1])
    )


@dataclass(frozen=True)
class MonteCarlo:
    """Results of all cases.

    Parameters
    ----------
    configuration : Configuration
        What they were made with.
    results : tuple of Result
        In the order of the cases.
    """

    configuration: Configuration
    results: tuple[Result, ...]

    @property
    def failures(self) -> tuple[Result, ...]:
        return tuple(r for r in self.results if r.values is None)

    def values(self, name: str, where: Mapping[str, Any] | None = None) -> Array:
        """One figure of all cases that did not fail.

        Parameters
        ----------
        name : str
            The figure.
        where : dict, optional
            Only cases with these arguments.
        """
        found = [
            r.values[name] for r in self._chosen(where) if r.values is not None and name in r.values
        ]
        if not found:
            have = sorted({k for r in self.results if r.values is not None for k in r.values})
            raise UserError(f"No case gave '{name}'.", f"Choose from {', '.join(have) or 'none'}.")
        return np.array(found)

    def _chosen(self, where: Mapping[str, Any] | None) -> list[Result]:
        wanted = dict(where or {})
        return [r for r in self.results if all(r.case.get(k) == v for k, v in wanted.items())]

    def summary(self, where: Mapping[str, Any] | None = None) -> dict[str, Percentiles]:
        """Percentiles of every figure.

        Parameters
        ----------
        where : dict, optional
            Only cases with these arguments.

        Returns
        -------
        dict of str to Percentiles
            By figure, sorted; empty when every case failed.  A case without a figure that others
            have counts as failed for it.
        """
        chosen = self._chosen(where)
        names = sorted({k for r in chosen if r.values is not None for k in r.values})
        out = {}
        for name in names:
            have = [r.values[name] for r in chosen if r.values is not None and name in r.values]
            out[name] = percentiles(name, have, failed=len(chosen) - len(have))
        return out

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: configuration, percentiles, failures, every case."""
        return {
            "configuration": self.configuration.parts,
            "key": self.configuration.key,
            "versions": versions(),
            "cases": len(self.results),
            "failed": len(self.failures),
            "summary": {k: p.to_dict() for k, p in self.summary().items()},
            "failures": [{"case": r.case, "failure": r.failure} for r in self.failures],
            "results": [{"case": r.case, "values": r.values} for r in self.results],
        }

    def table(self) -> list[str]:
        """Failures first, then one line a figure: percentiles, the 95 % with its interval, max."""
        lines = [f"{len(self.results)} cases, {len(self.failures)} failed"]
        lines += [f"  FAILED {canonical(r.case)}: {r.failure}" for r in self.failures[:10]]
        if len(self.failures) > 10:
            lines.append(f"  ... {len(self.failures) - 10} more")
        heads = "".join(f"{f'{level:g} %':>10}" for level in LEVELS)
        lines.append(f"{'':28}{heads}{'95 % interval':>22}{'max':>10}")
        for name, p in self.summary().items():
            cells = "".join(f"{p.values[level]:>10.4g}" for level in LEVELS)
            interval = f"{p.low[95.0]:.4g} .. {p.high[95.0]:.4g}"
            lines.append(f"{name:28}{cells}{interval:>22}{p.largest:>10.4g}")
        return lines
