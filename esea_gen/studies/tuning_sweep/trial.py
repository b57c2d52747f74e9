"""One value of a tunable, run and judged in the tuning case."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from esea_gen.analysis.journal import Result
from esea_gen.language.ports import Tunable
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.controllers import controller_device, controller_system, largest_torque_Nm
from esea_gen.twin.judge import ENDED, judge
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.run import run_case

PHI, LAMBDA = "smc.phi_rad_s", "smc.lambda_1_s"
SOFTENING = "smc.softening"


@dataclass(frozen=True)
class Trial:
    value: float
    rms_Nm: float
    overshoot_percent: float
    reach_percent: float  # 100: the desired amplitude, at the extremes on average
    roughness_Nm_s: float
    surface_rad_s: float
    outside_share: float  # of the time with abs(s) > phi; NaN without a surface
    limited_share: float
    unusable: str = ""  # why the value cannot be taken


def extremes(case: Case, run: ClosedLoopRun) -> tuple[float, float]:
    """How far the true torque goes at the extremes of a sinusoid."""
    w = case.trajectory.window
    desired, true = case.trajectory.tau_desired_Nm[w], run.plant["tau_e_Nm"][w]
    amplitude = float(np.max(np.abs(desired)))
    # From one zero of the desired torque to the next, an eighth of a cycle late: the extreme then
    # lies inside for any lag from -45 to 135 deg.  What is left at both ends is no whole one.
    sign = np.sign(np.where(desired == 0, 1e-300, desired))
    zeros = np.flatnonzero(np.diff(sign)) + 1
    late = round(0.25 * float(np.mean(np.diff(zeros))))
    peaks = np.array(
        [
            np.max(true[a + late : b + late] * sign[a])
            for a, b in pairwise(zeros)
            if b + late <= len(true)
        ]
    )
    reach = 100 * peaks / amplitude
    return max(0.0, float(np.max(reach)) - 100), float(np.mean(reach))


def run_trial(
    parameter: str,
    value: float,
    held: Mapping[str, float],
    controller: str,
    plant: str,
    seed: int,
) -> dict[str, float]:
    """Run and judge one value: what a worker does."""
    # Gains that swing are to be seen doing it, not softened.
    unsoftened = {SOFTENING: 0.0} if SOFTENING in tunables_of(controller) else {}
    tunables: dict[str, dict[str, float]] = {}
    for name, x in {**unsoftened, **held, parameter: value}.items():
        instance, _, key = name.partition(".")
        tunables.setdefault(instance, {})[key] = x
    device = controller_device(controller)
    (case,) = TuningCase().cases()
    run = run_case(case, Setting(controller, plant, "none", tunables=tunables), seed)
    figures = judge(case, run, largest_torque_Nm(device))
    over, reach = extremes(case, run)
    out = {
        "value": value,
        "rms_Nm": figures["rms_true_Nm"],
        "overshoot_percent": over,
        "reach_percent": reach,
        "roughness_Nm_s": figures["roughness_Nm_s"],
        "limited_share": figures["limited_share"],
    } | {k: figures[k] for k in ENDED}
    if "surface_rad_s" in run.controller:
        s = np.abs(run.controller["surface_rad_s"][case.trajectory.window])
        phi = tunables.get("smc", {}).get("phi_rad_s", tunables_of(controller)[PHI].default)
        out |= {"surface_rad_s": float(s.max()), "outside_share": float(np.mean(s > phi))}
    return out


def tunables_of(controller: str) -> dict[str, Tunable]:
    return {f"{i}.{t.name}": t for i, t in controller_system(controller).tunables}


FAILED = "failed: "
_FIGURES = tuple(f.name for f in fields(Trial) if f.name not in ("value", "unusable"))


def trial_of(result: Result) -> Trial:
    nothing = dict.fromkeys(_FIGURES, math.nan)
    if result.values is None:
        # The class of the error says nothing to who reads the table.
        reason = " ".join(result.failure.removeprefix("esea_gen.errors.UserError: ").split())
        return Trial(result.case["value"], **nothing, unusable=FAILED + reason)
    figures = {k: v for k, v in result.values.items() if k not in ENDED}
    why = ", ".join(text for key, text in ENDED.items() if result.values[key])
    return Trial(**(nothing | figures), unusable=why)
