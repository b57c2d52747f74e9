"""Steps of the desired torque."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.analysis.step import StepMetrics, step_metrics
from esea_gen.studies import torque_errors
from esea_gen.studies.outcome import Simulation
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Case
from esea_gen.twin.trajectories import RATE_HZ, fixed_output

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPS_NM = (0.5, 1.0, 2.0)
STEP_AT_S = 1.0


class StepStudy(ClosedLoopStudy):
    """Steps of 0.5, 1 and 2 Nm: rise, settling, overshoot, steady error."""

    name = "step"
    title = "Step of the desired torque, output fixed"
    keeps = True

    def cases(self) -> list[Case]:
        t = np.arange(round(4 * RATE_HZ)) / RATE_HZ
        return [
            Case(f"{tau:g} Nm", fixed_output("step", np.where(t >= STEP_AT_S, tau, 0.0), 2000))
            for tau in STEPS_NM
        ]

    def metrics(self, done: Simulation) -> dict[str, StepMetrics]:
        """Of the true torque, by case, first seed."""
        return {
            name: step_metrics(
                run.time_s,
                run.plant["tau_e_Nm"],
                step_s=STEP_AT_S,
                after=float(self.case(name).trajectory.tau_desired_Nm[-1]),
            )
            for name, run in done.kept.items()
        }

    def table(self, done: Simulation) -> list[str]:
        lines = torque_errors.table(done)
        for name, metrics in self.metrics(done).items():
            lines += [f"step {name}", *(f"  {x}" for x in metrics.table())]
        return lines

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        steps = self.metrics(done)
        return torque_errors.to_dict(done) | ({"steps": steps} if steps else {})

    def figure(self, done: Simulation) -> Figure:
        from esea_gen.analysis import plots

        if len(done.seeds) > 1 or not done.kept:
            return torque_errors.figure(done)
        last, run = list(done.kept.items())[-1]
        name, *curves = torque_errors.panel(self.case(last), run, whole=True)
        return plots.torque_tracking(*curves, title=f"{name}: {torque_errors.label(done)}")
