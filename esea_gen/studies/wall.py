"""Wall of the simulated impairment: torque on a hand that pushes against it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from esea_gen.analysis.passivity import energy_balance
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.studies.simulation import ClosedLoopStudy, Simulation
from esea_gen.twin.case import Case
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.trajectories import RATE_HZ, Trajectory, minimum_jerk

PUSH_NM = (0.5, 1.0, 2.0, 3.0, 4.0)
HANDS_NM_RAD = (0.0, 2.0, 8.0, 20.0, 60.0)
LIGHTEST_KGM2, RATIO = 0.006, 0.3  # damping of the intent, of a hand that light
# Where a hand goes that is to push with its muscles and not with its stiffness.
WALL_RAD, WALL_NM_RAD, WALL_NM_RAD3 = 0.0873, 6.0, 60.0
RISE_S, PUSH_S, JUDGED_S, END_S = 0.5, 1.0, 4.5, 6.5


@dataclass(frozen=True)
class Pushed(Trajectory):
    """A hand that goes to the wall and pushes, and a board that is asked for the impairment."""

    tau_muscle_Nm: Array | None = None

    def signals(self) -> dict[str, Array]:
        """As of the base class, with the muscle torque and the request."""
        assert self.tau_muscle_Nm is not None
        asked = np.ones(len(self.tau_muscle_Nm))
        return super().signals() | {"tau_muscle_Nm": self.tau_muscle_Nm, "constrained": asked}


def push_case(push_Nm: float, hand_Nm_rad: float) -> Case:
    """A hand of this stiffness that goes as deep as the torque takes it, and pushes there."""
    depths = np.roots([WALL_NM_RAD3, 0.0, WALL_NM_RAD, -push_Nm])
    place_rad = WALL_RAD + float(depths[np.isreal(depths)].real[0])
    n = round(END_S * RATE_HZ)
    t = np.arange(n) / RATE_HZ
    theta, omega, alpha = (place_rad * x for x in minimum_jerk(t - RISE_S))
    muscle = push_Nm * minimum_jerk(t - PUSH_S)[0]
    start = round(JUDGED_S * RATE_HZ)
    path = Pushed("wall", theta, omega, alpha, np.zeros(n), start, n, tau_muscle_Nm=muscle)
    damping = 2 * RATIO * math.sqrt(hand_Nm_rad * LIGHTEST_KGM2)
    person = {"spring_Nm_rad": hand_Nm_rad, "damping_Nms_rad": damping, "torque_noise_Nm": 0.0}
    return Case(f"{push_Nm:g} Nm, hand of {hand_Nm_rad:g} Nm/rad", path, plant=person)


class Wall(ClosedLoopStudy):
    """A hand, limp to stiff, pushes with 0.5 to 4 Nm against the simulated impairment's wall."""

    name = "wall"
    title = "Pushing against the impairment's wall"
    person = True

    def cases(self) -> list[Case]:
        return [push_case(push, hand) for push in PUSH_NM for hand in HANDS_NM_RAD]

    def of(self, device: Device) -> Self:
        """The study on a device, whose impairment has the wall."""
        if device.file.impairment is None:
            fix = "Give --controller wrist_drive."
            raise UserError(f"{device.origin}: has no section [impairment].", fix)
        return super().of(device)

    def measure(self, case: Case, run: ClosedLoopRun, device: Device) -> dict[str, float]:
        w = case.trajectory.window
        tau = run.plant["tau_e_Nm"][w]
        t = np.linspace(-1, 1, len(tau))
        ripple = tau - np.polyval(np.polyfit(t, tau, 2), t)
        fault = run.controller["fault"][round(0.1 * RATE_HZ) :]
        return {
            "rms_true_Nm": float(np.sqrt(np.mean(ripple**2))),
            "max_true_Nm": float(np.max(np.abs(ripple))),
            "mean_Nm": float(np.mean(tau)),
            "generated_J": energy_balance(
                run.plant["theta_l_rad"], run.plant["tau_e_Nm"]
            ).generated_J,
            "depth_rad": float(np.mean(run.plant["theta_l_rad"][w])),
            "unstable": 0.0,
            "tripped": float(np.max(run.plant["tripped"]) > 0),
            "fault": float(np.max(fault) > 0),
        }

    def table(self, done: Simulation) -> list[str]:
        s = done.setting
        lines = [
            f"{self.title}, simulated: {s.controller}{done.more}, plant {s.plant}, "
            f"hand {s.person}, {len(done.seeds)} runs a case",
            f"{'case':32}{'ripple':>10}{'largest':>10}{'torque':>10}{'angle, deg':>12}",
        ]
        largest = generated = 0.0
        for name, entries in done.by_case().items():
            good = [e for e in entries if e["max_true_Nm"] is not None]
            if not good:
                lines.append(f"{name:32}{'every run ended early':>42}")
                continue
            ripple = [e["max_true_Nm"] for e in good]
            largest = max(largest, *ripple)
            generated = max(generated, *(e["generated_J"] for e in good))
            lines.append(
                f"{name:32}{np.median(ripple):10.3f}{max(ripple):10.3f}"
                f"{np.median([e['mean_Nm'] for e in good]):10.2f}"
                f"{math.degrees(np.median([e['depth_rad'] for e in good])):12.1f}"
            )
        ended = f"; {len(done.ended())} runs ended early" if done.ended() else ""
        return [
            *lines,
            f"Peak of the ripple in Nm, the last 2 s; largest {largest:.3f}. Energy that the wrist "
            f"was given beyond what it had put in: at most {1e3 * generated:.1f} mJ{ended}.",
        ]
