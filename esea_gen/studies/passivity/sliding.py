"""The sliding condition s s' < 0 outside the boundary layer, along runs of the compiled C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.language.ports import Array
from esea_gen.model.sensing import of_axis
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Scale, Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import run_case
from esea_gen.twin.trajectories import RATE_HZ

Bools = npt.NDArray[np.bool_]
SLIDING_CASES = (
    ("tuning", "1.7 Nm 0.6 Hz"),
    ("grid", "4 Nm 0.5 Hz"),
    ("grid", "3 Nm 1 Hz"),
    ("step", "2 Nm"),
)
NARROW = 0.1  # beside the layer as it is: a tenth of it, which the surface leaves more often


@dataclass(frozen=True)
class SlidingCheck:
    plant: str
    case: str
    phi_rad_s: float
    samples: int
    outside: int
    free: int
    falling: int
    falling_free: int
    worst_rad2_s3: float
    longest_s: float
    largest_rad_s: float

    def line(self) -> str:
        head = f"{self.plant:6} {self.case:14} {self.phi_rad_s:>6.3g} {self.largest_rad_s:>8.3f}"
        if not self.outside:
            return f"{head} {'0':>8}  never left the layer"
        free = f"{100 * self.falling_free / self.free:.0f} %" if self.free else "-"
        return (
            f"{head} {100 * self.outside / self.samples:>7.2f}% "
            f"{100 * self.falling / self.outside:>9.0f} % {free:>12} {self.worst_rad2_s3:>12.3g} "
            f"{1e3 * self.longest_s:>8.0f}"
        )


def sliding_condition(
    s_rad_s: Array, active: Bools, limited: Bools, phi_rad_s: float, period_s: float
) -> dict[str, Any]:
    """How often s s' < 0 outside the boundary layer."""
    s, after = s_rad_s[:-1], s_rad_s[1:]
    both = active[:-1] & active[1:]
    out = both & (np.abs(s) > phi_rad_s)
    product_ = s * (after - s) / period_s
    falls, free = out & (product_ < 0), out & ~limited[:-1]
    # Lengths of the stretches outside: differences of where they begin and end.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], out.astype(int), [0]])))
    stays = edges[1::2] - edges[::2]
    return {
        "phi_rad_s": phi_rad_s,
        "samples": int(np.count_nonzero(both)),
        "outside": int(np.count_nonzero(out)),
        "free": int(np.count_nonzero(free)),
        "falling": int(np.count_nonzero(falls)),
        "falling_free": int(np.count_nonzero(falls & free)),
        "worst_rad2_s3": float(np.max(product_[out])) if out.any() else 0.0,
        "longest_s": float(np.max(stays, initial=0)) * period_s,
        "largest_rad_s": float(np.max(np.abs(s_rad_s[active]), initial=0.0)),
    }


def check_sliding(
    controller: str,
    plants: Sequence[str] = ("ideal", "real"),
    cases: Sequence[tuple[str, str]] = SLIDING_CASES,
    seed: int = 0,
) -> tuple[SlidingCheck, ...]:
    """The sliding condition along logged runs, with the layer as it is and with a tenth of it."""
    device = controller_device(controller)
    system, axis = device.system, device.axes[0]
    smc = system.blocks.get(name := of_axis("smc", axis))
    tunables = {t.name: t for t in smc.tunables} if smc else {}
    if smc is None or "phi_rad_s" not in tunables:
        return ()
    task = next(t for t in system.tasks if name in t.blocks)
    phase, every = (round(x * device.period_s * RATE_HZ) for x in (task.phase, task.every))
    assert smc.status_port is not None
    bits = {f.name: 1 << k for k, f in enumerate(smc.status_port.flags)}
    wide = tunables["phi_rad_s"]
    # No status word before the first run of the control task: ENTERED takes those out as well.
    layers = (wide.default, max(wide.low, NARROW * wide.default))
    found = []
    for plant, phi, (study, case_name) in product(plants, layers, cases):
        study_of = load_study(study, ClosedLoopStudy)
        case = study_of.case(case_name).scaled(Scale.of(device))
        setting = Setting(controller, plant, "none", tunables={name: {"phi_rad_s": phi}})
        run = run_case(case, setting, seed)
        held = slice(phase, None, every)
        status = run.controller["smc_status"][held]
        active = (status & bits["ACTIVE"] > 0) & (status & bits["ENTERED"] == 0)
        limited = status & bits["SATURATED"] > 0
        surface = run.controller["surface_rad_s"][held]
        figures = sliding_condition(surface, active, limited, phi, every / RATE_HZ)
        found.append(SlidingCheck(plant, case_name, **figures))
    return tuple(found)
