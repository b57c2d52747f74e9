"""A start-up drawn: the gear's disturbance, numbers over the device file's, a jump, the loop."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from esea_gen.analysis.plots import finished, new_figure
from esea_gen.errors import UserError
from esea_gen.plotting import BOUND, INK, MEASURED, MODEL, ROUNDING, RULE, STYLE
from esea_gen.studies.startup.margins import LoopMargins
from esea_gen.studies.startup.outcome import Startup

SHOWN = (
    ("gain", "motor gain"),
    ("fc_Nm", "Coulomb friction"),
    ("fv_Nms_rad", "viscous friction"),
    ("J_kgm2", "inertia"),
    ("tau_c_s", "lag"),
)
REACH = 2.0  # of the locus, in its plane


def startup_figure(result: Startup) -> Figure:
    """Four panels; nothing to draw where the start-up ended early."""
    if result.model is None:
        raise UserError(
            "The start-up ended before there was anything to draw.", "Leave --figure out."
        )
    with mpl.rc_context(STYLE):
        figure, rows = new_figure(10.4, 6.6, nrows=2, gridspec_kw={"height_ratios": [1, 1.05]})
        _map(rows[0], result)
        spec = rows[1].get_subplotspec().subgridspec(1, 3, width_ratios=[1.1, 1, 1.15])
        rows[1].remove()
        _numbers(figure.add_subplot(spec[0]), result)
        _jump(figure.add_subplot(spec[1]), result)
        _locus(figure.add_subplot(spec[2]), result)
        return finished(figure)


def _map(axes: Axes, result: Startup) -> None:
    assert result.model is not None
    d = result.model.disturbance
    mean = np.mean(d.torque_Nm)
    axes.fill_between(
        d.gear_rad, d.torque_Nm - mean - d.half_Nm, d.torque_Nm - mean + d.half_Nm,
        color=MODEL, alpha=0.35, lw=0,
    )  # fmt: skip
    axes.plot(d.gear_rad, d.torque_Nm - mean, color=MODEL, lw=1.2, label="found, 95 % band")
    if result.true_map_Nm is not None:
        axes.plot(
            d.gear_rad, result.true_map_Nm, color=MEASURED, lw=1.0, ls=(0, (3, 2)),
            label="simulated truth",
        )  # fmt: skip
    axes.set_title("torque that gear and cable add over the motor's angle")
    axes.set_xlabel("angle of the gear at the joint, rad")
    axes.set_ylabel("N·m at the joint")
    axes.set_ylim(top=1.3 * float(np.max(d.torque_Nm - mean)))
    axes.legend(ncols=2, loc="upper right")


def _numbers(axes: Axes, result: Startup) -> None:
    m, a = result.model, result.device.file.actuator
    assert m is not None
    for k, (name, _) in enumerate(SHOWN):
        e = getattr(m, name)
        base = 1.0 if name == "gain" else getattr(a, name).value
        y = len(SHOWN) - 1 - k
        axes.plot([e.low / base, e.high / base], [y, y], color=MODEL, lw=3, solid_capstyle="butt")
        axes.plot(e.value / base, y, "o", color=MODEL, ms=5, label=None if k else "found, 95 %")
        if name in result.truth:
            axes.plot(
                result.truth[name] / base, y, "|", color=MEASURED, ms=16, mew=1.6,
                label=None if k else "simulated truth",
            )  # fmt: skip
    axes.axvline(1.0, color=INK, lw=0.8)
    axes.set_yticks(range(len(SHOWN)), [text for _, text in reversed(SHOWN)])
    axes.set_ylim(-0.6, len(SHOWN) - 0.1)
    axes.set_title("found over the device file's number")
    axes.legend(loc="lower right")


def _jump(axes: Axes, result: Startup) -> None:
    assert result.model is not None
    j = result.model.jump
    ms = 1e3 * j.time_s
    axes.plot(ms, j.seen_rad_s2, "o", color=MEASURED, ms=2.4, label="counts")
    axes.plot(ms, j.model_rad_s2, color=MODEL, lw=1.2, label="model as found")
    axes.axvline(1e3 * result.model.delay_s.value, color=ROUNDING, lw=1, ls=(0, (4, 2)))
    axes.set_title(f"mean of {j.jumps} jumps of the command")
    axes.set_xlabel("ms after the jump; dashed: delay")
    axes.set_ylabel("rad/s²")
    axes.legend(loc="lower right")


def _locus(axes: Axes, result: Startup) -> None:
    if result.margins is None:
        axes.axis("off")
        return
    turn = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color=RULE, lw=1)
    rows: tuple[tuple[LoopMargins, Any, str], ...] = (
        (result.margins.middle, MODEL, "at the estimates"),
        (result.margins.nearest, BOUND, "nearest corner"),
    )
    for found, colour, label in rows:
        z = found.opened.response
        near = np.abs(z) < 4 * REACH
        axes.plot(z[near].real, z[near].imag, color=colour, lw=1.3, label=label)
    axes.plot(-1, 0, "x", color=ROUNDING, ms=8, mew=2)
    axes.annotate("−1", (-1, 0), (-5, 7), textcoords="offset points", ha="right")
    axes.set_xlim(-REACH, 0.6 * REACH)
    axes.set_ylim(-1.2, 0.6)
    axes.set_aspect("equal")
    axes.set_title("loop cut at the motor")
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")
    axes.legend(loc="lower right")


__all__ = ["startup_figure"]
