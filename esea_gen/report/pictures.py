"""Pictures that a command draws: friction of a drive, a search under way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.plots import new_figure, styled
from esea_gen.identify.drive.friction import Friction, SteadyRun, run_means
from esea_gen.identify.published.search_problem import PresentBest
from esea_gen.plotting import MEASURED, MODEL

MOST_LOOPS = 5


@styled
def search_picture(best: PresentBest) -> Figure:
    """RMS error over runs of the C, and measured and modelled torque of the first data sets."""
    sets = best.sets[:MOST_LOOPS]
    figure, axes = new_figure(3.2 * (1 + len(sets)), 3.2, ncols=1 + len(sets), squeeze=False)
    progress, *loops = axes[0]
    runs, rms = best.curve.T
    progress.step(runs, rms, where="post", color=MODEL)
    progress.plot(runs[-1:], rms[-1:], "o", color=MODEL, ms=4)
    progress.set_yscale("log")
    progress.set_xlabel("runs over all recordings")
    progress.set_title(f"best so far: {np.sqrt(best.cost):.4g} N·m RMS")
    progress.set_ylabel("error, N·m")
    for number, (panel, (theta, measured, model)) in enumerate(zip(loops, sets, strict=True), 1):
        panel.plot(theta, measured, color=MEASURED, lw=1.6, label="measured")
        panel.plot(theta, model, color=MODEL, lw=0.8, label="best so far")
        panel.set_xlabel("deflection, rad")
        rms_set = float(np.sqrt(np.mean((model - measured) ** 2)))
        panel.set_title(f"data set {number} of {len(best.sets)}: {rms_set:.3g} N·m")
    loops[0].set_ylabel("torque, N·m")
    loops[0].legend(loc="lower right")
    return figure


@styled
def friction_picture(runs: Sequence[SteadyRun], found: Friction) -> Figure:
    """Torque over speed at the motor shaft."""
    figure, axes = new_figure(7.0, 3.6)
    speeds, torques, _ = run_means(runs)
    axes.plot(speeds, 1e3 * torques, "o", color=MEASURED, ms=4, label="recorded, a run each")
    most = float(np.max(np.abs(speeds)))
    for k, way in enumerate((-1.0, 1.0)):
        at = way * np.geomspace(most / 400, most, 200)
        label = None if k else "model"
        axes.plot(at, 1e3 * found.torque_Nm(at), color=MODEL, lw=1.4, label=label)
    axes.set_title("torque that the drive takes at steady speeds")
    axes.set_xlabel("speed of the motor shaft, rad/s")
    axes.set_ylabel("mN·m at the motor shaft")
    axes.legend(loc="upper left")
    return figure
