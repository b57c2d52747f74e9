"""A campaign at a glance: places by kinds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from esea_gen.plotting import BOUND, INK, STYLE
from esea_gen.verify.faults.kinds import INPUT_KINDS


@dataclass(frozen=True)
class FaultRow:
    """All runs of a place and kind."""

    place: str
    kind: str
    runs: int
    found: int
    bound_ticks: int | None
    latest_ticks: int | None
    torque_then_Nm: float
    peak_torque_Nm: float
    energy_J: float
    unfound_torque_Nm: float | None
    unfound_energy_J: float | None
    outside: int


def fault_picture(device: str, rows: Sequence[FaultRow], torque_Nm: float) -> Figure:
    """Inputs by kinds, then what else may break: worst torque, and ticks until found."""
    inputs = [r for r in rows if r.kind in INPUT_KINDS and " of " not in r.place]
    others = [r for r in rows if r not in inputs]
    places = list(dict.fromkeys(r.place for r in inputs))
    heights = [0.45 * len(places) + 1.0, 0.19 * len(others) + 0.5]
    with mpl.rc_context(STYLE):
        figure = Figure((10.5, sum(heights) + 0.6), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=heights)
        worst = np.full((len(places), len(INPUT_KINDS)), np.nan)
        for r in inputs:
            at = places.index(r.place), INPUT_KINDS.index(r.kind)
            worst[at] = r.peak_torque_Nm
            text = f"{_when(r)}\n{r.peak_torque_Nm:.1f} Nm"
            above.text(at[1], at[0], text, ha="center", va="center", fontsize=7.5, color=INK)
        above.imshow(worst, cmap="YlOrBr", vmin=0.0, vmax=1.6 * torque_Nm, aspect="auto")
        above.set_xticks(range(len(INPUT_KINDS)), INPUT_KINDS)
        above.set_yticks(range(len(places)), places)
        above.set_title(
            f"{device}, simulated. Ticks until the motor followed no more (in how many runs),\n"
            f"and largest torque on the limb (envelope {torque_Nm:g} Nm)"
        )
        below.barh(range(len(others)), [r.peak_torque_Nm for r in others], color="#f6c667")
        for k, r in enumerate(others):
            below.text(r.peak_torque_Nm + 0.05, k, _when(r), va="center", fontsize=7.5, color=INK)
        below.axvline(torque_Nm, color=BOUND, linewidth=1.2)
        below.set_yticks(range(len(others)), [f"{r.place}, {r.kind}" for r in others], fontsize=7.5)
        below.set_ylim(len(others) - 0.4, -0.6)
        below.set_xlim(0.0, 1.06 * torque_Nm)
        below.set_xlabel("largest torque on the limb (Nm); line: envelope")
        above.grid(visible=False)
        above.tick_params(length=0)
    return figure


def _when(r: FaultRow) -> str:
    return "not found" if not r.found else f"{r.latest_ticks} ({r.found}/{r.runs})"
