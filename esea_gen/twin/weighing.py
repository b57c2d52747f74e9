"""An adaptation on the virtual exoskeleton: a known mass on the joint, and nobody in it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from esea_gen.errors import UserError
from esea_gen.twin.case import TORQUE, Case
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

MASS_NM, MASS_KGM2 = 3.5, 0.2
"""1.2 kg on an arm of 0.3 m, and the arm."""
JOINT_NMS_RAD = 0.02
"""Of the joint that bears it; the adaptation is not told."""
WANTED_NM, WANTED_HZ, FADE_S, LENGTH_S = 1.7, 0.3, 5.0, 40.0
"""Wanted meanwhile, to and fro: about what the joint will be used with."""
HANGS_RAD = 1.2
"""Angle of the joint at which it hangs straight down: in the middle of the range of motion."""
LEARNT = {
    "gain": "adapted_gain",
    "loss": "adapted_loss",
    "offset_Nm": "adapted_offset_Nm",
}
INSTANCE = "adaptation"


def weighing_case() -> Case:
    """The mass swung to and fro by the drive."""
    t = np.arange(round(LENGTH_S * RATE_HZ)) / RATE_HZ
    still = np.zeros_like(t)
    wanted = WANTED_NM * np.minimum(t / FADE_S, 1) * np.sin(2 * np.pi * WANTED_HZ * t)
    path = Trajectory("weighing", still, still, still, wanted, round(FADE_S * RATE_HZ), len(t))
    # The plant's mass hangs at 0: its encoders count from elsewhere.
    plant = {
        **dict.fromkeys(("spring_Nm_rad", "damping_Nms_rad", "feedforward"), 0.0),
        "torque_noise_Nm": 0.0,
        "gravity_Nm": MASS_NM,
        "Jh_kgm2": MASS_KGM2,
        "own_damping_Nms_rad": JOINT_NMS_RAD,
        "motor_offset_rad": HANGS_RAD,
        "load_offset_rad": HANGS_RAD,
        "joint_min_rad": -2.0,
        "joint_max_rad": 2.0,
    }
    told = {"mass_Nm": MASS_NM, "mass_kgm2": MASS_KGM2, "mass_angle_rad": HANGS_RAD}
    return Case("weighing", path, TORQUE, {INSTANCE: told}, plant)


def found_by(run: ClosedLoopRun) -> Mapping[str, float]:
    """Tunables of the adaptation as a run of :func:`weighing_case` leaves them, put in force."""
    if run.controller["fault"][-1] > 0:
        raise UserError(
            f"the limits latched (fault {run.controller['fault'][-1]:g}) while the mass was swung.",
            "Nothing was adapted; leave --adapted out.",
        )
    return {"share": 1.0, **{k: float(run.controller[v][-1]) for k, v in LEARNT.items()}}
