"""Reaching with a rendered spring and damper."""

from __future__ import annotations

from esea_gen.studies import torque_errors
from esea_gen.studies.outcome import Simulation
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin import trajectories
from esea_gen.twin.case import IMPEDANCE, Case

GAINS = ((0.0, 0.0), (0.75, 0.25), (1.5, 0.25))


class ImpedanceStudy(ClosedLoopStudy):
    """Reaching to 90 deg in 2 s and back, three pairs of gains; RMS over the largest torque."""

    name = "impedance"
    title = "Impedance: reaching in 2 s and back"
    person = True

    def cases(self) -> list[Case]:
        return [
            Case(
                f"Kp {kp:g} Kd {kd:g}",
                trajectories.impedance(),
                IMPEDANCE,
                {"reference": {"Kp_Nm_rad": kp, "Kd_Nms_rad": kd}},
            )
            for kp, kd in GAINS
        ]

    def table(self, done: Simulation) -> list[str]:
        return torque_errors.table(done, normalised=True)
