"""Output impedance at 0 Nm."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.impedance import ImpedanceFit, OutputImpedance, impedance
from esea_gen.analysis.sweeps import Sweep, sweep_response
from esea_gen.language.ports import Array
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
        return impedance(sweep_response(run.time_s, angle, run.plant["tau_e_Nm"], MOTION))

    def table(self, done: Simulation) -> list[str]:
        rows = [line for p in done.kept.values() for line in p.table(ROWS, *FIT_HZ)]
        return torque_errors.table(done) + rows

    def to_dict(self, done: Simulation) -> dict[str, Any]:
        content = torque_errors.to_dict(done)
        for shown in done.kept.values():
            content["output_impedance"] = shown.to_dict()
            content["impedance_fit"] = dataclasses.asdict(shown.fit(*FIT_HZ))
        return content

    def figure(self, done: Simulation) -> Figure:
        if not done.kept:
            return torque_errors.figure(done)
        (shown,) = done.kept.values()
        return impedance_figure([(torque_errors.label(done), shown)])


def _phase(values: npt.NDArray[np.complex128]) -> Array:
    """Phase in degrees, cut where it jumps from one end of the turn to the other."""
    phase = np.degrees(np.angle(values))
    phase[1:][np.abs(np.diff(phase)) > 180] = np.nan
    return np.asarray(phase)


def impedance_figure(
    impedances: Sequence[tuple[str, OutputImpedance]],
    fits: Sequence[tuple[str, ImpedanceFit]] = (),
) -> Figure:
    """Resisting torque per angle and phase per rate over frequency."""
    names = [n for n, _ in impedances]
    import matplotlib as mpl

    from esea_gen.analysis.plots import COLOURS, finished, frequency_axis, new_figure
    from esea_gen.plotting import HELD_OUT, INK, STYLE

    with mpl.rc_context(STYLE):
        figure, (above, below) = new_figure(
            9.6, 4.8, nrows=2, sharex=True, height_ratios=[1.4, 1.0]
        )
        for k, (name, z) in enumerate(impedances):
            colour = COLOURS[k % len(COLOURS)]
            broad: dict[str, Any] = {"color": colour, "lw": 3.5, "alpha": 0.5}
            above.plot(z.frequency_Hz, np.abs(z.per_angle), label=name, **broad)
            below.plot(z.frequency_Hz, _phase(z.per_rate), **broad)
        for name, fit in fits:
            f = np.geomspace(fit.low_Hz, fit.high_Hz, 200)
            colour = COLOURS[names.index(name) % len(COLOURS)] if name in names else INK
            value = fit.per_angle(f)
            text = (
                f"{fit.inertia_kgm2:.3g} kg·m², {fit.damping_Nms_rad:.3g} N·m·s/rad, "
                f"{fit.stiffness_Nm_rad:.3g} N·m/rad"
            )
            dashes: dict[str, Any] = {"color": colour, "lw": 1.3, "ls": (0, (4, 2))}
            above.plot(f, np.abs(value), label=text, **dashes)
            below.plot(f, _phase(value / (2j * np.pi * f)), **dashes)
        above.set_yscale("log")
        above.minorticks_off()
        above.set_ylabel("torque per angle,\nN·m/rad")
        below.axhspan(-90, 90, color=HELD_OUT, lw=0, zorder=0)
        below.set_ylabel("phase per rate,\ndeg")
        below.set_yticks([-180, -90, 0, 90, 180])
        below.set_ylim(-185, 185)
        low_Hz = min(float(z.frequency_Hz[0]) for _, z in impedances)
        high_Hz = max(float(z.frequency_Hz[-1]) for _, z in impedances)
        frequency_axis(below, low_Hz, high_Hz)
        below.set_xlabel("frequency, Hz (grey: passive)")
        figure.align_ylabels([above, below])
        figure.legend(loc="outside upper right", ncols=2)
        return finished(figure)
