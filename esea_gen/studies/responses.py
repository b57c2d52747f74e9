"""Torque responses: steps, a swept torque, and a swept motion at 0 Nm."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis import plots
from esea_gen.analysis.frequency import FrequencyResponse, OutputImpedance
from esea_gen.analysis.step import StepMetrics, step_metrics
from esea_gen.analysis.sweeps import Sweep, sweep_response
from esea_gen.studies.simulation import ClosedLoopStudy, Simulation, panel
from esea_gen.twin.case import Case
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.trajectories import RATE_HZ, Trajectory, fixed_output

STEPS_NM = (0.5, 1.0, 2.0)
STEP_AT_S = 1.0


class StepStudy(ClosedLoopStudy):
    """Steps of 0.5, 1 and 2 Nm: rise, settling, overshoot, steady error."""

    name = "step"
    title = "Step of the desired torque, output fixed"
    scales = True
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
        lines = super().table(done)
        for name, metrics in self.metrics(done).items():
            lines += [f"step {name}", *(f"  {x}" for x in metrics.table())]
        return lines

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        steps = self.metrics(done)
        return super().to_dict(done) | ({"steps": steps} if steps else {})

    def figure(self, done: Simulation) -> Figure:
        if len(done.seeds) > 1 or not done.kept:
            return super().figure(done)
        last, run = list(done.kept.items())[-1]
        name, *curves = panel(self.case(last), run, whole=True)
        return plots.torque_tracking(*curves, title=f"{name}: {done.label}")


SWEEP = Sweep(0.05, 10.0, 60.0, start_s=1.0)
SWEEP_NM = 0.5


class Frequency(ClosedLoopStudy):
    """A sweep of 0.5 Nm from 0.05 to 10 Hz: bandwidth, and margins of T/(1 - T)."""

    name = "frequency"
    title = "Frequency response of the torque, output fixed"
    scales = True
    keeps = True

    def cases(self) -> list[Case]:
        t = np.arange(round((SWEEP.start_s + SWEEP.duration_s) * RATE_HZ)) / RATE_HZ
        tau = np.where(t >= SWEEP.start_s, SWEEP_NM * np.sin(SWEEP.phase_rad(t)), 0.0)
        return [Case(f"{SWEEP_NM:g} Nm", fixed_output("sweep of the torque", tau, 1000))]

    def keep(self, case: Case, run: ClosedLoopRun) -> FrequencyResponse:
        # A motor that is off follows nothing: only up to there is the response the controller's.
        w = case.trajectory.window
        off = np.flatnonzero((run.plant["tripped"][w] > 0) | (run.controller["fault"][w] > 0))
        on = slice(w.start + off[0] if len(off) else None)
        desired, true = case.trajectory.tau_desired_Nm, run.plant["tau_e_Nm"]
        return sweep_response(run.time_s[on], desired[on], true[on], SWEEP)

    def table(self, done: Simulation) -> list[str]:
        lines = super().table(done)
        for response in done.kept.values():
            if done.ended():
                last_Hz = response.frequency_Hz[-1]
                lines.append(f"the motor went off: the response ends at {last_Hz:.3g} Hz")
            band, margins = response.bandwidth(), response.open_loop().margins()
            at = f"{band.bandwidth_Hz:.3g} Hz" if band.bandwidth_Hz else "beyond the sweep"
            lines.append(f"bandwidth (-3 dB of the {band.passband}): {at}")
            if margins.phase_margin_deg is not None:
                lines.append(
                    f"open loop from T/(1-T): phase margin {margins.phase_margin_deg:.0f} deg at "
                    f"{margins.phase_margin_Hz:.3g} Hz"
                )
            lines += response.table()
        return lines

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        content = super().to_dict(done)
        for response in done.kept.values():
            content["frequency_response"] = response.to_dict()
            content["bandwidth"] = response.bandwidth()
            content["margins"] = response.open_loop().margins()
        return content

    def figure(self, done: Simulation) -> Figure:
        if not done.kept:
            return super().figure(done)
        (response,) = done.kept.values()
        return plots.bode([(done.label, response, response.bandwidth())])


MOTION = Sweep(0.1, 5.0, 100.0, start_s=1.0)
SWEEP_RAD = 0.1
SWEEP_MIDDLE_RAD = 0.8
FIT_HZ = (0.5, 4.0)
ROWS = 12


class OutputImpedanceStudy(ClosedLoopStudy):
    """Move the load by a firm hand, 0.1 to 5 Hz, at a desired torque of 0 Nm."""

    name = "output-impedance"
    title = "Output impedance at 0 Nm, moved"
    scales = True
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
        angle = run.plant["theta_l_rad"] - case.trajectory.start_rad
        return OutputImpedance.of(sweep_response(run.time_s, angle, run.plant["tau_e_Nm"], MOTION))

    def table(self, done: Simulation) -> list[str]:
        rows = [line for p in done.kept.values() for line in p.table(ROWS, *FIT_HZ)]
        return super().table(done) + rows

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        content = super().to_dict(done)
        for shown in done.kept.values():
            content["output_impedance"] = shown.to_dict()
            content["impedance_fit"] = shown.fit(*FIT_HZ)
        return content

    def figure(self, done: Simulation) -> Figure:
        if not done.kept:
            return super().figure(done)
        (shown,) = done.kept.values()
        return plots.impedance_panels(done.label, shown)
