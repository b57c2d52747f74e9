"""A tuning sweep drawn."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from esea_gen.analysis.plots import cell_edges, finished, frequency_axis, new_figure
from esea_gen.plotting import INK, MEASURED, MODEL, ROUNDING, STYLE


def tuning_trade(
    values: npt.ArrayLike,
    error_Nm: npt.ArrayLike,
    overshoot_percent: npt.ArrayLike,
    roughness: npt.ArrayLike,
    *,
    parameter: str,
    roughness_label: str = "roughness, N·m/s",
    chosen: float | None = None,
    log: bool = True,
) -> Figure:
    """What a tuning parameter trades: error, overshoot and roughness of the command."""
    x = np.asarray(values, dtype=float)
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(9.6, 5.0, nrows=3, sharex=True)
        rows = (
            (error_Nm, "RMS error,\nN·m", MODEL),
            (overshoot_percent, "overshoot, %", MEASURED),
            (roughness, roughness_label.replace(", ", ",\n"), ROUNDING),
        )
        broken = np.zeros(len(x), dtype=bool)
        for axes, (numbers, label, colour) in zip(grid, rows, strict=True):
            y = np.asarray(numbers, dtype=float)
            broken |= np.isnan(y)
            axes.plot(x, y, color=colour, lw=1.4, marker="o", ms=3.5)
            axes.set_ylabel(label)
            axes.set_ylim(bottom=0)
            axes.yaxis.set_major_locator(MaxNLocator(4))
            if chosen is not None:
                axes.axvline(
                    chosen,
                    color=INK,
                    lw=1,
                    ls=(0, (4, 2)),
                    label=f"chosen: {chosen:g}" if axes is grid[0] else None,
                )
        if log:
            frequency_axis(grid[-1], float(x[0]), float(x[-1]))
        edges = np.exp(cell_edges(np.log(x))) if log else cell_edges(x)
        for k in np.flatnonzero(broken):
            for axes in grid:
                axes.axvspan(
                    edges[k],
                    edges[k + 1],
                    color="#efc9b0",
                    lw=0,
                    zorder=0,
                    label="unusable"
                    if k == np.flatnonzero(broken)[0] and axes is grid[0]
                    else None,
                )
        grid[-1].set_xlabel(parameter)
        figure.align_ylabels(list(grid))
        if grid[0].get_legend_handles_labels()[0]:
            figure.legend(loc="outside upper right", ncols=3)
        return finished(figure)
