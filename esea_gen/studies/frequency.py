"""Frequency response of the torque."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.analysis.frequency import FrequencyResponse
from esea_gen.analysis.sweeps import Sweep, sweep_response
from esea_gen.studies import torque_errors
from esea_gen.studies.outcome import Simulation
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Case
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.trajectories import RATE_HZ, fixed_output

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SWEEP = Sweep(0.05, 10.0, 60.0, start_s=1.0)
SWEEP_NM = 0.5


class Frequency(ClosedLoopStudy):
    """A sweep of 0.5 Nm from 0.05 to 10 Hz: bandwidth, and margins of T/(1 - T)."""

    name = "frequency"
    title = "Frequency response of the torque, output fixed"
    keeps = True

    def cases(self) -> list[Case]:
        t = np.arange(round((SWEEP.start_s + SWEEP.duration_s) * RATE_HZ)) / RATE_HZ
        tau = np.where(t >= SWEEP.start_s, SWEEP_NM * np.sin(SWEEP.phase_rad(t)), 0.0)
        return [Case(f"{SWEEP_NM:g} Nm", fixed_output("sweep of the torque", tau, 1000))]

    def keep(self, case: Case, run: ClosedLoopRun) -> FrequencyResponse:
        desired = case.trajectory.tau_desired_Nm
        return sweep_response(run.time_s, desired, run.plant["tau_e_Nm"], SWEEP)

    def table(self, done: Simulation) -> list[str]:
        lines = torque_errors.table(done)
        for response in done.kept.values():
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
        content = torque_errors.to_dict(done)
        for response in done.kept.values():
            content["frequency_response"] = response.to_dict()
            content["bandwidth"] = response.bandwidth()
            content["margins"] = response.open_loop().margins()
        return content

    def figure(self, done: Simulation) -> Figure:
        from esea_gen.analysis.plots import bode

        if not done.kept:
            return torque_errors.figure(done)
        (response,) = done.kept.values()
        return bode([(torque_errors.label(done), response, response.bandwidth())])
