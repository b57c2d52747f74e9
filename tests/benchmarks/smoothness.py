"""``python -m tests.benchmarks.smoothness FILE``: against the published package, in the same run.

FILE is its ``smoothness.py``, from github.com/siva82kb/SPARC.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_host.smoothness import ldlj, sparc
from esea_host.smoothness.result import Array

FS_HZ = 1000.0


@dataclass(frozen=True)
class RaceRow:
    """Processor time of both for all movements, and the largest difference."""

    metric: str
    ours_s: float
    theirs_s: float
    worst: float


def load_reference(path: Path) -> Any:
    """The published package's file as a module."""
    spec = importlib.util.spec_from_file_location("published_smoothness", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise SystemExit(f"There is no Python file {path}.")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def stack(movements: int) -> Array:
    """Movements of 5 s at 1 kHz, the same every time."""
    rng = np.random.default_rng(1)
    t = np.arange(5000) / FS_HZ
    w = 2 * np.pi * rng.uniform(0.1, 3.0, (movements, 4, 1))
    swings = rng.normal(size=(movements, 4, 1)) * np.sin(w * t + rng.uniform(0, 6, w.shape))
    return np.asarray(np.abs(swings.sum(axis=1)))


def _timed(what: Callable[[], Array]) -> tuple[Array, float]:
    start = time.process_time()
    return what(), time.process_time() - start


def race(package: Any, movements: int = 1000) -> list[RaceRow]:
    """Both on the same stack, one after the other."""
    speed = stack(movements)
    pairs = {
        "SPARC": (
            lambda: sparc(speed, FS_HZ).value,
            lambda: np.array([package.sparc(v, FS_HZ)[0] for v in speed]),
        ),
        "LDLJ": (
            lambda: ldlj(speed, FS_HZ).value,
            lambda: np.array([package.log_dimensionless_jerk(v, FS_HZ) for v in speed]),
        ),
    }
    rows = []
    for name, (ours, theirs) in pairs.items():
        found, ours_s = _timed(ours)
        expected, theirs_s = _timed(theirs)
        rows.append(RaceRow(name, ours_s, theirs_s, float(np.max(np.abs(found - expected)))))
    return rows


def main() -> None:
    """Print the race."""
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    print("1000 movements of 5 s at 1 kHz, processor time")
    for row in race(load_reference(Path(sys.argv[1]))):
        print(
            f"{row.metric:5s}  ours {row.ours_s:.3f} s  published {row.theirs_s:.3f} s  "
            f"largest difference {row.worst:.1e}"
        )


if __name__ == "__main__":
    main()
