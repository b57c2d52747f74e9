"""Torques to be followed: the thesis' experiments, whose table and figure are the usual ones."""

from __future__ import annotations

import dataclasses
from types import MappingProxyType

from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin import trajectories
from esea_gen.twin.case import IMPEDANCE, Case
from esea_gen.twin.published import PLANTS

GRID_NM = {0.25: (1, 2, 3, 4), 0.5: (1, 2, 3, 4), 1.0: (1, 2, 3), 1.5: (0.75,)}
BACKDRIVEN_HZ = (0.1, 0.15, 0.2, 0.25)
GAINS = ((0.0, 0.0), (0.75, 0.25), (1.5, 0.25))


class TuningCase(ClosedLoopStudy):
    """The thesis' tuning case: 1.7 Nm at 0.6 Hz."""

    name = "tuning"
    title = "Tuning case, output fixed"
    scales = True
    thesis_Nm = MappingProxyType(
        {"smc-published": 0.590, "mpc-published": 0.386, "mpc-published-no-preview": 0.386}
    )

    def cases(self) -> list[Case]:
        return [Case("1.7 Nm 0.6 Hz", trajectories.tuning())]


class Grid(ClosedLoopStudy):
    """Twelve sines in the operating space, 0.75 to 4 Nm, 0.25 to 1.5 Hz."""

    name = "grid"
    title = "Twelve points of the operating space, output fixed"
    scales = True

    def cases(self) -> list[Case]:
        points = ((torque, f) for f, torques in GRID_NM.items() for torque in torques)
        sine = trajectories.fixed_sinusoid
        return [Case(f"{torque:g} Nm {f:g} Hz", sine(torque, f)) for torque, f in points]


class Twists(ClosedLoopStudy):
    """The twelve sines at three ways to lead the cable (assumed: the thesis gives no numbers)."""

    name = "twists"
    title = "The twelve points at three cable twists, output fixed"
    scales = True

    def cases(self) -> list[Case]:
        return [
            dataclasses.replace(c, name=f"{c.name}, twist {angle} deg", plant=vars(t))
            for angle, t in PLANTS.twist.items()
            for c in Grid().cases()
        ]


class Backdriven(ClosedLoopStudy):
    """0 Nm while the arm moves 90 deg peak to peak at 0.1, 0.15, 0.2 and 0.25 Hz."""

    name = "backdriven"
    title = "Backdriven at 0 Nm"
    scales = True
    person = True

    def cases(self) -> list[Case]:
        return [Case(f"{f:g} Hz", trajectories.backdriven(f)) for f in BACKDRIVEN_HZ]


class Bread(ClosedLoopStudy):
    """Slices at 0.9 Hz, without help and with 2 Nm."""

    name = "bread"
    title = "Bread cutting at 0 and 2 Nm"
    scales = True
    person = True

    def cases(self) -> list[Case]:
        return [Case(f"{tau:g} Nm", trajectories.bread(tau)) for tau in (0.0, 2.0)]


class ImpedanceStudy(ClosedLoopStudy):
    """Reaching to 90 deg in 2 s and back, three pairs of gains; RMS over the largest torque."""

    name = "impedance"
    title = "Impedance: reaching in 2 s and back"
    scales = True
    person = True
    normalised = True

    def cases(self) -> list[Case]:
        path = trajectories.impedance()
        gains = [{"Kp_Nm_rad": kp, "Kd_Nms_rad": kd} for kp, kd in GAINS]
        return [
            Case(f"Kp {kp:g} Kd {kd:g}", path, IMPEDANCE, {"reference": g})
            for (kp, kd), g in zip(GAINS, gains, strict=True)
        ]
