"""A search under way: how far it has come, and the loops of the best so far."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.plots import finished, new_figure
from esea_gen.identify.published.search_problem import PresentBest
from esea_gen.plotting import MEASURED, MODEL, STYLE

MOST_LOOPS = 5


def search_picture(best: PresentBest) -> Figure:
    """RMS error over runs of the C, and measured and modelled torque of the first data sets."""
    sets = best.sets[:MOST_LOOPS]
    with mpl.rc_context(STYLE):
        figure, axes = new_figure(3.2 * (1 + len(sets)), 3.2, ncols=1 + len(sets), squeeze=False)
        progress, *loops = axes[0]
        runs, rms = best.curve.T
        progress.step(runs, rms, where="post", color=MODEL)
        progress.plot(runs[-1:], rms[-1:], "o", color=MODEL, ms=4)
        progress.set_yscale("log")
        progress.set_xlabel("runs over all recordings")
        progress.set_title(f"best so far: {np.sqrt(best.cost):.4g} N·m RMS")
        progress.set_ylabel("error, N·m")
        for number, (panel, (theta, measured, model)) in enumerate(
            zip(loops, sets, strict=True), 1
        ):
            panel.plot(theta, measured, color=MEASURED, lw=1.6, label="measured")
            panel.plot(theta, model, color=MODEL, lw=0.8, label="best so far")
            panel.set_xlabel("deflection, rad")
            rms_set = float(np.sqrt(np.mean((model - measured) ** 2)))
            panel.set_title(f"data set {number} of {len(best.sets)}: {rms_set:.3g} N·m")
        loops[0].set_ylabel("torque, N·m")
        loops[0].legend(loc="lower right")
        return finished(figure)
