"""Output impedance at 0 Nm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.analysis.impedance import OutputImpedance
from esea_gen.analysis.sweeps import Sweep, sweep_response
from esea_gen.studies import torque_errors
from esea_gen.studies.outcome import Simulation
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Case
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOTION = Sweep(0.1, 5.0, 100.0, start_s=1.0)
SWEEP_RAD = 0.1
SWEEP_MIDDLE_RAD = 0.8
FIT_HZ = (0.5, 4.0)
ROWS = 12


class OutputImpedanceStudy(ClosedLoopStudy):
    """The load is moved by a firm hand, 0.1 to 5 Hz, while 0 Nm are wanted."""

    name = "output-impedance"
    title = "Output impedance at 0 Nm, moved"
    person = True
    keeps = True

    def cases(self) -> list[Case]:
        t = np.arange(round((MOTION.start_s + MOTION.duration_s) * RATE_HZ)) / RATE_HZ
        moving = t >= MOTION.start_s
        f = MOTION.start_Hz + MOTION.rate_Hz_s * (t - MOTION.start_s)
        # One acceleration above 1 Hz, so that the motor's limit is not what is measured.
        size = SWEEP_RAD / np.maximum(1.0, f) ** 2
        theta = SWEEP_MIDDLE_RAD + np.where(moving, size * np.sin(MOTION.phase_rad(t)), 0.0)
        omega = np.gradient(theta, 1 / RATE_HZ)
        alpha = np.gradient(omega, 1 / RATE_HZ)
        path = Trajectory("sweep of the angle", theta, omega, alpha, np.zeros(len(t)), 1000, len(t))
        # A firm hand: the load follows the path, whatever the torque.
        firm = {"spring_Nm_rad": 400.0, "damping_Nms_rad": 10.0, "torque_noise_Nm": 0.0}
        return [Case(f"{SWEEP_RAD:g} rad", path, plant=firm)]

    def keep(self, case: Case, run: ClosedLoopRun) -> OutputImpedance:
        angle = run.plant["theta_l_rad"] - SWEEP_MIDDLE_RAD
        return OutputImpedance.of(sweep_response(run.time_s, angle, run.plant["tau_e_Nm"], MOTION))

    def table(self, done: Simulation) -> list[str]:
        rows = [line for p in done.kept.values() for line in p.table(ROWS, *FIT_HZ)]
        return torque_errors.table(done) + rows

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        content = torque_errors.to_dict(done)
        for shown in done.kept.values():
            content["output_impedance"] = shown.to_dict()
            content["impedance_fit"] = shown.fit(*FIT_HZ)
        return content

    def figure(self, done: Simulation) -> Figure:
        if not done.kept:
            return torque_errors.figure(done)
        (shown,) = done.kept.values()
        from esea_gen.analysis.plots import impedance_panels

        return impedance_panels(torque_errors.label(done), shown)
