"""Pictures of closed-loop experiments, in the look of the reports.

Each function takes arrays or results and returns a Figure; `save` writes one in the same style.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

from esea_gen.analysis.frequency import Bandwidth, FrequencyResponse, OutputImpedance
from esea_gen.analysis.monte_carlo import Percentiles
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.language.ports import Array
from esea_gen.plotting import BOUND, HELD_OUT, INK, MEASURED, MODEL, ROUNDING, RULE, STYLE, envelope

P = ParamSpec("P")
COLOURS = (MODEL, MEASURED, ROUNDING, BOUND, INK)
POINTS = 4000
DPI = 130
MOST_SAID = 6
CROSS = "\N{BALLOT X}"


def new_figure(width: float, height: float, **kwargs: Any) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height), layout="constrained", dpi=DPI)
    return figure, figure.subplots(**kwargs)


def finished(figure: Figure) -> Figure:
    for axes in figure.axes:
        axes.tick_params(length=3)
    return figure


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(STYLE):
            return finished(draw(*args, **kwargs))

    return drawn


@dataclass(frozen=True)
class Panel:
    """A panel: curves as x, y, label and style; labels, and further settings of ``Axes.set``."""

    curves: Sequence[tuple[Any, Any, str, Mapping[str, Any]]]
    x: str
    y: str
    scales: Mapping[str, Any] = field(default_factory=dict)


def panels(rows: Sequence[Panel], width: float, height: float, **kwargs: Any) -> Figure:
    """Panels beside each other, each with its legend; ``kwargs`` as of ``Figure.subplots``."""
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(1, len(rows), squeeze=False, **kwargs)
    for axes, panel in zip(grid[0], rows, strict=True):
        for x, y, label, look in panel.curves:
            axes.plot(x, y, label=label, **look)
        axes.set(xlabel=panel.x, ylabel=panel.y, **panel.scales)
        axes.legend(fontsize="small")
        axes.grid(alpha=0.3)
    return figure


def save(figure: Figure, path: Path) -> None:
    picture, form = io.BytesIO(), path.suffix.lower().removeprefix(".")
    try:
        with mpl.rc_context(STYLE):
            figure.savefig(picture, format=form or None)
    except ValueError as error:
        raise UserError(f"{path}: cannot be drawn ({error}).", "End it in .png or .svg.") from None
    write_whole(path, picture.getvalue())


def crossed(figure: Figure, ended: Mapping[str, str]) -> Figure:
    """Cases with a run that did not end well: crossed in the figure, and listed below it."""
    if not ended:
        return figure

    def marked(text: str) -> str:
        return f"{CROSS} {text}" if ended.keys() & set(re.split(": |\n", text)) else text

    with mpl.rc_context(STYLE):
        for axes in figure.axes:
            for axis in (axes.xaxis, axes.yaxis):
                names = [t.get_text() for t in axis.get_ticklabels()]
                if any(marked(n) != n for n in names):
                    axis.set_ticks(axis.get_ticklocs(), [marked(n) for n in names])
            for where in ("left", "center"):
                title = axes.get_title(where)
                if marked(title) != title:
                    axes.set_title(marked(title), loc=where)
        said = [f"{CROSS} {name}: {what}" for name, what in ended.items()]
        if len(said) > MOST_SAID:
            said[MOST_SAID:] = [f"and {len(said) - MOST_SAID} more cases"]
        figure.supxlabel("\n".join(said), color=BOUND, fontsize=STYLE["font.size"])
    return figure


def _curve(axes: Axes, time: Array, y: Array, **kwargs: Any) -> None:
    keep = envelope(y, POINTS)
    axes.plot(time[keep], y[keep], **kwargs)


def _torques(axes: Axes, time_s: Array, desired: Array, true: Array, modelled: Array) -> None:
    # The modelled torque carries the encoders' noise: under the others, or it hides them.
    _curve(axes, time_s, modelled, color=MODEL, lw=1.8, alpha=0.45, label="modelled")
    _curve(axes, time_s, true, color=MEASURED, lw=1.3, label="true")
    _curve(axes, time_s, desired, color=INK, lw=0.9, ls=(0, (5, 3)), label="desired")
    axes.set_ylabel("torque, N·m")
    axes.margins(x=0.005)
    axes.yaxis.set_major_locator(MaxNLocator(5))


def _rms(error: Array) -> str:
    return f"{np.sqrt(np.mean(error**2)):.3g} N·m"


@styled
def torque_tracking(
    time_s: Array, desired_Nm: Array, true_Nm: Array, modelled_Nm: Array, *, title: str = ""
) -> Figure:
    """Torque over time: desired, true and modelled, their errors below."""
    figure, (above, below) = new_figure(9.6, 4.4, nrows=2, sharex=True, height_ratios=[1.6, 1.0])
    _torques(above, time_s, desired_Nm, true_Nm, modelled_Nm)
    for name, torque, colour, wide, clear in (
        ("modelled", modelled_Nm, MODEL, 0.8, 0.55),
        ("true", true_Nm, MEASURED, 1.4, 1.0),
    ):
        error = torque - desired_Nm
        label = f"{name}: RMS {_rms(error)}"
        _curve(below, time_s, error, color=colour, lw=wide, alpha=clear, label=label)
    below.axhline(0, color=RULE, lw=0.8, zorder=0)
    below.set(ylabel="error, N·m", xlabel="time, s")
    below.margins(x=0.005)
    below.yaxis.set_major_locator(MaxNLocator(5))
    for axes in (above, below):
        # Outside of the axes, where no curve can run through it.
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
    above.set_title(title)
    figure.align_ylabels([above, below])
    return figure


@styled
def torque_cases(cases: Sequence[tuple[str, Array, Array, Array, Array]], *, title: str) -> Figure:
    """Torque over time, a panel for every case: name, time, desired, true and modelled torque."""
    figure, rows = new_figure(9.6, 0.6 + 1.7 * len(cases), nrows=len(cases), squeeze=False)
    for axes, (name, t, desired, true, modelled) in zip(rows[:, 0], cases, strict=True):
        _torques(axes, t, desired, true, modelled)
        axes.set_title(f"{title}: {name}: RMS of the true error shown {_rms(true - desired)}")
    rows[-1, 0].set_xlabel("time, s")
    handles, labels = rows[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    figure.align_ylabels(rows[:, 0])
    return figure


@styled
def rms_by_case(
    cases: Sequence[str], name: str, ours_Nm: Array, thesis_Nm: Array | None = None
) -> Figure:
    """RMS error by case, the thesis' beside ours; NaN of ours, of a failure, is a cross."""
    bars = [("thesis", thesis_Nm, "white")] if thesis_Nm is not None else []
    every = [*bars, ("ours", ours_Nm, MODEL)]
    wide = min(14.0, 1.5 + 0.28 * len(cases) * (len(every) + 1))
    figure, axes = new_figure(max(6.0, wide), 3.4)
    thick = 0.8 / len(every)
    for k, (kind, values, face) in enumerate(every):
        x = np.arange(len(cases)) + (k - 0.5 * (len(every) - 1)) * thick
        known = np.isfinite(values)
        look: dict[str, Any] = {"facecolor": face, "edgecolor": MODEL, "lw": 1.2}
        axes.bar(x[known], values[known], 0.9 * thick, **look, label=f"{name}, {kind}")
        if kind == "ours" and not known.all():
            axes.plot(x[~known], 0 * x[~known], "x", color=MODEL, ms=6, clip_on=False)
    axes.set_xticks(range(len(cases)), list(cases))
    if max(len(line) for c in cases for line in c.split("\n")) > 4 * (len(every) + 1):
        axes.tick_params(axis="x", rotation=35)
        for text in axes.get_xticklabels():
            text.set(ha="right", rotation_mode="anchor")
    axes.tick_params(axis="x", length=0)
    axes.grid(visible=False, axis="x")
    axes.set(xlim=(-0.6, len(cases) - 0.4), ylabel="RMS error, N·m")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside upper right", ncols=4)
    return figure


def frequency_axis(axes: Axes, low: float, high: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.minorticks_off()


@styled
def bode(responses: Sequence[tuple[str, FrequencyResponse, Bandwidth]]) -> Figure:
    """Gain, phase and coherence over frequency, two deviations shaded; each bandwidth marked."""
    figure, grid = new_figure(9.6, 6.2, nrows=3, sharex=True, height_ratios=[1.5, 1.2, 0.7])
    gain, phase, coherence = grid
    for k, (name, r, b) in enumerate(responses):
        colour, f = COLOURS[k % len(COLOURS)], r.frequency_Hz
        gain.plot(f, r.gain_dB, color=colour, lw=1.4, label=name)
        phase.plot(f, r.phase_deg, color=colour, lw=1.4)
        if r.sigma is not None:
            part = np.minimum(2 * r.sigma, 0.9)
            low, high = (20 * np.log10(1 + s * part) for s in (-1, 1))
            shade: dict[str, Any] = {"color": colour, "alpha": 0.2, "lw": 0}
            gain.fill_between(f, r.gain_dB + low, r.gain_dB + high, **shade)
            turn = np.degrees(part)
            phase.fill_between(f, r.phase_deg - turn, r.phase_deg + turn, **shade)
        if r.coherence is not None:
            coherence.plot(f, r.coherence, color=colour, lw=1.2)
        if b.bandwidth_Hz is None:
            continue
        level = 20 * np.log10(b.passband_gain) - b.drop_dB
        # The figure stands in the legend: two loops' marks often fall together.
        dot: dict[str, Any] = {"color": colour, "ms": 6, "mfc": "white", "mew": 1.5}
        label = f"−{b.drop_dB:.3g} dB at {b.bandwidth_Hz:.3g} Hz, from the\n{b.passband}, "
        gain.plot(b.bandwidth_Hz, level, "o", **dot, label=label + _signed_dB(b.passband_gain))
    gain.set_ylabel("gain, dB")
    phase.set_ylabel("phase, deg")
    phase.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.5, 3, 4.5, 9, 10]))
    coherence.set(ylabel="coherence", ylim=(0, 1.05), xlabel="frequency, Hz")
    every = [r.frequency_Hz for _, r, _ in responses]
    frequency_axis(coherence, min(f[0] for f in every), max(f[-1] for f in every))
    figure.align_ylabels(list(grid))
    figure.legend(loc="outside upper right", ncols=4)
    return figure


def _signed_dB(gain: float) -> str:
    text = f"{20 * np.log10(gain):.2f}"
    shown = "0" if float(text) == 0 else text.replace("-", "−") if gain < 1 else f"+{text}"
    return f"{shown} dB"


@styled
def impedance_panels(name: str, found: OutputImpedance) -> Figure:
    """Resisting torque per angle and phase per rate, whose passive band is grey, over frequency."""
    figure, (above, below) = new_figure(9.6, 4.8, nrows=2, sharex=True, height_ratios=[1.4, 1.0])
    broad: dict[str, Any] = {"color": MODEL, "lw": 3.5, "alpha": 0.5}
    f = found.angle.frequency_Hz
    phase = np.degrees(np.angle(found.per_rate))
    phase[1:][np.abs(np.diff(phase)) > 180] = np.nan  # from one end of the turn to the other
    above.plot(f, found.angle.gain, label=name, **broad)
    below.plot(f, phase, **broad)
    above.set(yscale="log", ylabel="torque per angle,\nN·m/rad")
    above.minorticks_off()
    below.axhspan(-90, 90, color=HELD_OUT, lw=0, zorder=0)
    below.set(ylabel="phase per rate,\ndeg", yticks=[-180, -90, 0, 90, 180], ylim=(-185, 185))
    frequency_axis(below, float(f[0]), float(f[-1]))
    below.set_xlabel("frequency, Hz (grey: passive)")
    figure.align_ylabels([above, below])
    figure.legend(loc="outside upper right", ncols=2)
    return figure


def cell_edges(values: Array) -> Array:
    """Half way between values, and as far beyond both ends."""
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middle = 0.5 * (values[1:] + values[:-1])
    ends = 1.5 * values[0] - 0.5 * values[1], 1.5 * values[-1] - 0.5 * values[-2]
    return np.concatenate([ends[:1], middle, ends[1:]])


@styled
def percentile_bars(rows: Sequence[tuple[str, Percentiles]]) -> Figure:
    """Monte-Carlo percentiles of RMS errors, one line a case."""
    figure, axes = new_figure(9.6, 1.2 + 0.34 * len(rows))
    y = np.arange(len(rows))[::-1]
    bar: dict[str, Any] = {"solid_capstyle": "butt"}
    for k, (_, p) in zip(y, rows, strict=True):
        v = p.values
        for x, at, label, look in (
            ((v[5.0], v[95.0]), k, "5 to 95 %", {"color": MODEL, "lw": 1.6}),
            ((v[25.0], v[75.0]), k, "25 to 75 %", {"color": MODEL, "lw": 7}),
            (
                (p.low[95.0], p.high[95.0]),
                k - 0.26,
                "95 % interval of the 95 %",
                {"color": ROUNDING, "lw": 2},
            ),
        ):
            axes.plot(x, (at, at), label=label if k == y[0] else None, **look, **bar)
        axes.plot(v[50.0], k, "|", color="white", ms=7, mew=2, zorder=3)
        last = "largest" if k == y[0] else None
        axes.plot(p.largest, k, "o", color=MEASURED, ms=5, label=last, zorder=3)
    failed = [f"\n{p.failed} of {p.count + p.failed} failed" * (p.failed > 0) for _, p in rows]
    axes.set_yticks(y, [name + why for (name, _), why in zip(rows, failed, strict=True)])
    for text, why in zip(axes.get_yticklabels(), failed, strict=True):
        if why:
            text.set_color(BOUND)
    axes.tick_params(axis="y", length=0)
    axes.set(ylim=(-0.6, len(rows) - 0.4), xlabel="RMS error, N·m")
    axes.set_xlim(left=min(0.0, *(p.values[5.0] for _, p in rows)))
    figure.legend(loc="outside upper right", ncols=5)
    return figure
