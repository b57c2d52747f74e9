"""Friction of a drive: each run's mean torque over speed, and the model."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.plots import finished, new_figure
from esea_gen.identify.drive.friction import Friction, SteadyRun, run_means
from esea_gen.plotting import MEASURED, MODEL, STYLE


def friction_picture(runs: Sequence[SteadyRun], found: Friction) -> Figure:
    """Torque over speed at the motor shaft."""
    with mpl.rc_context(STYLE):
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
        return finished(figure)
