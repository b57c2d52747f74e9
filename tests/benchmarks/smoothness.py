"""``python -m tests.benchmarks.smoothness FILE``: against the published package, in the same run.

FILE is its ``smoothness.py``, from github.com/siva82kb/SPARC.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from esea_host.smoothness import ldlj, sparc

FS_HZ = 1000.0


def load_reference(path: Path) -> Any:
    """The published package's file as a module."""
    spec = importlib.util.spec_from_file_location("published_smoothness", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise SystemExit(f"There is no Python file {path}.")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def race(package: Any, movements: int = 1000) -> dict[str, tuple[float, float, float]]:
    """Processor seconds of ours and theirs for movements of 5 s, and the largest difference."""
    rng = np.random.default_rng(1)
    t = np.arange(5000) / FS_HZ
    w = 2 * np.pi * rng.uniform(0.1, 3.0, (movements, 4, 1))
    swings = rng.normal(size=(movements, 4, 1)) * np.sin(w * t + rng.uniform(0, 6, w.shape))
    speed = np.abs(swings.sum(axis=1))
    found = {}
    for name, ours, theirs in (
        ("SPARC", sparc, lambda v: package.sparc(v, FS_HZ)[0]),
        ("LDLJ", ldlj, lambda v: package.log_dimensionless_jerk(v, FS_HZ)),
    ):
        start = time.process_time()
        mine = ours(speed, FS_HZ).value
        middle = time.process_time()
        other = np.array([theirs(v) for v in speed])
        end = time.process_time()
        found[name] = (middle - start, end - middle, float(np.max(np.abs(mine - other))))
    return found


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    for name, (ours_s, theirs_s, worst) in race(load_reference(Path(sys.argv[1]))).items():
        print(f"{name:5s}  ours {ours_s:.3f} s  published {theirs_s:.3f} s  difference {worst:.1e}")
