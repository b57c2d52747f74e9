"""Pictures of the steps."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from esea_gen.plotting import BOUND, INK, MEASURED, MODEL, RULE, STYLE
from esea_gen.studies.torque_check.check import TorqueCheck
from esea_host.recording.layout import Array

Line = tuple[str, Array]  # label, values
COLOURS = (MODEL, MEASURED, BOUND)


def new_picture(title: str, simulated: bool, rows: int = 1) -> tuple[Figure, list[Axes]]:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.2, 2.4 + 2.2 * rows), layout="constrained")
        axes = [figure.add_subplot(rows, 1, k + 1) for k in range(rows)]
        kind = "Simulated: " if simulated else ""
        figure.suptitle(f"{kind}{title}", x=0.01, ha="left", color=INK, fontsize=11)
    return figure, axes


def over(
    axes: Axes, x: Array, lines: Sequence[Line], x_label: str, y_label: str, limit: float = 0.0
) -> None:
    """Lines over the same values; a limit either way, where there is one."""
    with mpl.rc_context(STYLE):
        for (label, values), colour in zip(lines, COLOURS, strict=False):
            axes.plot(x, values, color=colour, lw=1.1, label=label)
        for side in (-limit, limit) if limit else ():
            axes.axhline(side, color=INK, lw=0.8, ls=(0, (4, 3)))
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1), borderpad=0)


def torque_bars(axes: Axes, check: TorqueCheck) -> None:
    with mpl.rc_context(STYLE):
        worst: dict[str, float] = {}
        for d in check.decisions:
            worst[d.criterion] = max(worst.get(d.criterion, 0.0), d.value_Nm / d.limit_Nm)
        names = list(worst)
        shares = np.array([100 * worst[n] for n in names])
        colours = [MODEL if s <= 100 else "#b3261e" for s in shares]
        axes.barh(range(len(names)), shares, color=colours, height=0.6)
        axes.axvline(100, color=INK, lw=0.8, ls=(0, (4, 3)))
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        axes.grid(color=RULE, axis="x")
        axes.set(xlabel="% of its limit, the worst of all phases")
