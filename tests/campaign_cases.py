"""Cases for test_campaign: a module of its own, since workers and scripts import it as well."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np


def seeded(count, root=0, **fixed):
    """Cases that differ in their seed only."""
    children = np.random.SeedSequence(root).spawn(count)
    return [{"seed": int(c.generate_state(1, np.uint64)[0]), **fixed} for c in children]


def draw(seed, gain=1.0):
    value = np.random.default_rng(seed).normal()
    if value > 1.5:
        raise RuntimeError(f"tripped at {gain}")
    return {"rms": abs(value) * gain, "odd": np.inf if value < -1.8 else value}


def noted(seed, folder, wait_s=0.0, deadly=None):
    """Leaves a file that names case and process; seeds in ``deadly`` end the process."""
    (Path(folder) / f"{seed}-{os.getpid()}-{time.monotonic_ns()}").touch()
    time.sleep(wait_s)
    if deadly and seed in deadly:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"x": float(np.random.default_rng(seed).normal())}


def compiled(seed):
    """Generated C, compiled by whoever runs the case."""
    from esea_gen import load_device
    from esea_gen.hostlib import compile_device

    theta_rad = np.cumsum(np.random.default_rng(seed).normal(scale=1e-3, size=100))
    got, _ = (
        compile_device(load_device("elbow"), "f32").block("velocity").run({"theta_rad": theta_rad})
    )
    return {"omega_rad_s": float(got["omega_rad_s"][-1])}
