"""A tuning sweep drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from esea_gen.analysis.plots import cell_edges, frequency_axis, new_figure, styled
from esea_gen.language.ports import Array
from esea_gen.plotting import INK, MEASURED, MODEL, ROUNDING

ROWS = (
    ("RMS error,\nN·m", MODEL),
    ("overshoot, %", MEASURED),
    ("roughness,\nN·m/s", ROUNDING),
)


@styled
def tuning_trade(x: Array, figures: Array, *, parameter: str, chosen: float | None) -> Figure:
    """What a parameter trades: the rows of ``figures``, NaN where a value is unusable."""
    figure, grid = new_figure(9.6, 5.0, nrows=3, sharex=True)
    log = bool(x[0] > 0 and x[-1] > 10 * x[0])
    if log:
        frequency_axis(grid[-1], float(x[0]), float(x[-1]))
    edges = np.exp(cell_edges(np.log(x))) if log else cell_edges(x)
    broken = np.flatnonzero(np.isnan(figures).any(axis=0))
    for axes, y, (label, colour) in zip(grid, figures, ROWS, strict=True):
        axes.plot(x, y, color=colour, lw=1.4, marker="o", ms=3.5)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0)
        axes.yaxis.set_major_locator(MaxNLocator(4))
        if chosen is not None:
            axes.axvline(chosen, color=INK, lw=1, ls=(0, (4, 2)), label=f"chosen: {chosen:g}")
        band: dict[str, Any] = {"color": "#efc9b0", "lw": 0, "zorder": 0, "label": "unusable"}
        for k in broken:
            axes.axvspan(edges[k], edges[k + 1], **band)
            band.pop("label", None)
    grid[-1].set_xlabel(parameter)
    figure.align_ylabels(list(grid))
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    return figure
