"""Pictures of closed-loop experiments, in the look of the reports.

Each function takes arrays or results and returns a Figure; saving is the caller's.  `save` writes
one as a picture with that look.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

from esea_gen.analysis.frequency import Bandwidth, FrequencyResponse
from esea_gen.analysis.monte_carlo import Percentiles
from esea_gen.analysis.passivity import PassivityMap
from esea_gen.analysis.response import Array
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.plotting import (
    BOUND,
    INK,
    MEASURED,
    MODEL,
    ROUNDING,
    RULE,
    STYLE,
    envelope,
)

COLOURS = (MODEL, MEASURED, ROUNDING, BOUND, INK)
MARKERS = ("o", "s", "D", "^", "v")
POINTS = 4000
DPI = 130
MOST_SAID = 6
CROSS = "\N{BALLOT X}"


def new_figure(width: float, height: float, **kwargs: Any) -> tuple[Figure, Any]:
    """A figure in inches and its axes."""
    figure = Figure(figsize=(width, height), layout="constrained", dpi=DPI)
    return figure, figure.subplots(**kwargs)


def finished(figure: Figure) -> Figure:
    """With the look that every picture has."""
    for axes in figure.axes:
        axes.tick_params(length=3)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure as .png, .svg or .pdf."""
    picture, form = io.BytesIO(), path.suffix.lower().removeprefix(".")
    try:
        with mpl.rc_context(STYLE):
            figure.savefig(picture, format=form or None)
    except ValueError as error:
        raise UserError(f"{path}: cannot be drawn ({error}).", "End it in .png or .svg.") from None
    write_whole(path, picture.getvalue())


def crossed(figure: Figure, ended: Mapping[str, str]) -> Figure:
    """Cases that a run of did not end well: crossed where the figure names them, and said below."""
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


def _drawn(axes: Axes, time: Array, y: Array, **kwargs: Any) -> None:
    keep = envelope(y, POINTS)
    axes.plot(time[keep], y[keep], **kwargs)


def torque_tracking(
    time_s: Array,
    desired_Nm: Array,
    true_Nm: Array,
    modelled_Nm: Array | None = None,
    *,
    title: str = "",
) -> Figure:
    """Torque over time: desired, true and modelled, their errors below."""
    with mpl.rc_context(STYLE):
        figure, (above, below) = new_figure(
            9.6, 4.4, nrows=2, sharex=True, height_ratios=[1.6, 1.0]
        )
        # The modelled torque carries the encoders' noise: under the others, or it hides them.
        if modelled_Nm is not None:
            _drawn(above, time_s, modelled_Nm, color=MODEL, lw=2.6, alpha=0.45, label="modelled")
        _drawn(above, time_s, true_Nm, color=MEASURED, lw=1.3, label="true")
        _drawn(above, time_s, desired_Nm, color=INK, lw=0.9, ls=(0, (5, 3)), label="desired")
        above.set_ylabel("torque, N·m")
        for name, torque, colour, wide, clear in (
            ("modelled", modelled_Nm, MODEL, 0.8, 0.55),
            ("true", true_Nm, MEASURED, 1.4, 1.0),
        ):
            if torque is not None:
                error = torque - desired_Nm
                rms = float(np.sqrt(np.mean(error**2)))
                label = f"{name}: RMS {rms:.3g} N·m"
                _drawn(below, time_s, error, color=colour, lw=wide, alpha=clear, label=label)
        below.axhline(0, color=RULE, lw=0.8, zorder=0)
        below.set_ylabel("error, N·m")
        below.set_xlabel("time, s")
        for axes in (above, below):
            axes.margins(x=0.005)
            axes.yaxis.set_major_locator(MaxNLocator(5))
            # Outside of the axes, where no curve can run through it.
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
        if title:
            above.set_title(title)
        figure.align_ylabels([above, below])
        return finished(figure)


def torque_cases(panels: Sequence[tuple[str, Array, Array, Array, Array]], *, title: str) -> Figure:
    """Torque over time, a panel for every case."""
    with mpl.rc_context(STYLE):
        figure, rows = new_figure(9.6, 0.6 + 1.7 * len(panels), nrows=len(panels), squeeze=False)
        for axes, (name, t, desired, true, modelled) in zip(rows[:, 0], panels, strict=True):
            _drawn(axes, t, modelled, color=MODEL, lw=1.0, alpha=0.5, label="modelled")
            _drawn(axes, t, true, color=MEASURED, lw=1.3, label="true")
            _drawn(axes, t, desired, color=INK, lw=0.9, ls=(0, (5, 3)), label="desired")
            rms = float(np.sqrt(np.mean((true - desired) ** 2)))
            axes.set_title(f"{title}: {name}: RMS of the true error shown {rms:.3g} N·m")
            axes.set_ylabel("torque, N·m")
            axes.margins(x=0.005)
            axes.yaxis.set_major_locator(MaxNLocator(5))
        rows[-1, 0].set_xlabel("time, s")
        handles, labels = rows[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=3)
        figure.align_ylabels(rows[:, 0])
        return finished(figure)


def rms_by_case(
    cases: Sequence[str],
    ours_Nm: Mapping[str, npt.ArrayLike],
    thesis_Nm: Mapping[str, npt.ArrayLike] | None = None,
    *,
    unit: str = "N·m",
) -> Figure:
    """RMS error by case, the thesis' figures beside ours."""
    published = {k: np.asarray(v, dtype=float) for k, v in (thesis_Nm or {}).items()}
    ours = {k: np.asarray(v, dtype=float) for k, v in ours_Nm.items()}
    for name, values in (*ours.items(), *published.items()):
        if values.shape != (len(cases),):
            raise UserError(
                f"{name}: {values.shape} values for {len(cases)} cases.",
                "Give one a case, NaN for none.",
            )
    names = list(dict.fromkeys([*ours, *published]))
    bars = [
        (n, kind, table[n])
        for n in names
        for kind, table in (("thesis", published), ("ours", ours))
        if n in table
    ]
    with mpl.rc_context(STYLE):
        figure, axes = new_figure(
            max(6.0, min(14.0, 1.5 + 0.28 * len(cases) * (len(bars) + 1))), 3.4
        )
        wide = 0.8 / max(len(bars), 1)
        for k, (name, kind, values) in enumerate(bars):
            colour = COLOURS[names.index(name) % len(COLOURS)]
            x = np.arange(len(cases)) + (k - 0.5 * (len(bars) - 1)) * wide
            gone = np.isnan(values)
            axes.bar(
                x[~gone],
                values[~gone],
                0.9 * wide,
                facecolor=colour if kind == "ours" else "white",
                edgecolor=colour,
                lw=1.2,
                label=f"{name}, {kind}",
            )
            if kind == "ours" and gone.any():
                axes.plot(x[gone], np.zeros(gone.sum()), "x", color=colour, ms=6, clip_on=False)
        axes.set_xticks(range(len(cases)), list(cases))
        longest = max((len(line) for c in cases for line in c.split("\n")), default=0)
        if longest > 4 * (len(bars) + 1):
            axes.tick_params(axis="x", rotation=35)
            for text in axes.get_xticklabels():
                text.set(ha="right", rotation_mode="anchor")
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
        axes.set_xlim(-0.6, len(cases) - 0.4)
        axes.set_ylabel(f"RMS error, {unit}")
        axes.set_ylim(bottom=0)
        figure.legend(loc="outside upper right", ncols=4)
        return finished(figure)


def frequency_axis(axes: Axes, low: float, high: float) -> None:
    """Logarithmic, with plain numbers."""
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.minorticks_off()


def bode(
    responses: Sequence[tuple[str, FrequencyResponse]],
    bandwidths: Sequence[tuple[str, Bandwidth]] = (),
) -> Figure:
    """Gain, phase and coherence over frequency."""
    coherent = any(r.coherence is not None for _, r in responses)
    names = [n for n, _ in responses]
    with mpl.rc_context(STYLE):
        figure, grid = new_figure(
            9.6,
            6.2 if coherent else 4.8,
            nrows=2 + coherent,
            sharex=True,
            height_ratios=[1.5, 1.2, 0.7][: 2 + coherent],
        )
        for k, (name, r) in enumerate(responses):
            colour = COLOURS[k % len(COLOURS)]
            f = r.frequency_Hz
            grid[0].plot(f, r.gain_dB, color=colour, lw=1.4, label=name)
            grid[1].plot(f, r.phase_deg, color=colour, lw=1.4)
            if r.sigma is not None:
                part = np.minimum(2 * r.sigma, 0.9)
                low, high = (20 * np.log10(1 + s * part) for s in (-1, 1))
                shade: dict[str, Any] = {"color": colour, "alpha": 0.2, "lw": 0}
                grid[0].fill_between(f, r.gain_dB + low, r.gain_dB + high, **shade)
                turn = np.degrees(part)
                grid[1].fill_between(f, r.phase_deg - turn, r.phase_deg + turn, **shade)
            if r.coherence is not None:
                grid[2].plot(f, r.coherence, color=colour, lw=1.2)
        for name, b in bandwidths:
            if b.bandwidth_Hz is None:
                continue
            colour = COLOURS[names.index(name) % len(COLOURS)] if name in names else INK
            level = 20 * np.log10(b.passband_gain) - b.drop_dB
            # The figure stands in the legend: two loops' marks often fall together.
            grid[0].plot(
                [b.bandwidth_Hz],
                [level],
                "o",
                color=colour,
                ms=6,
                mfc="white",
                mew=1.5,
                label=f"−{b.drop_dB:.3g} dB at {b.bandwidth_Hz:.3g} Hz, from the\n{b.passband}, "
                f"{_signed_dB(b.passband_gain)} dB",
            )
        grid[0].set_ylabel("gain, dB")
        grid[1].set_ylabel("phase, deg")
        grid[1].yaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.5, 3, 4.5, 9, 10]))
        if coherent:
            grid[2].set_ylabel("coherence")
            grid[2].set_ylim(0, 1.05)
        low_Hz = min(float(r.frequency_Hz[0]) for _, r in responses)
        high_Hz = max(float(r.frequency_Hz[-1]) for _, r in responses)
        frequency_axis(grid[-1], low_Hz, high_Hz)
        grid[-1].set_xlabel("frequency, Hz")
        figure.align_ylabels(list(grid))
        figure.legend(loc="outside upper right", ncols=4)
        return finished(figure)


def _signed_dB(gain: float) -> str:
    text = f"{20 * np.log10(gain):.2f}"
    return "0" if float(text) == 0 else text.replace("-", "−") if gain < 1 else f"+{text}"


def cell_edges(values: Array) -> Array:
    """Half way between values, and as far beyond both ends."""
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate(
        [[1.5 * values[0] - 0.5 * values[1]], middle, [1.5 * values[-1] - 0.5 * values[-2]]]
    )


def gain_map(
    region: PassivityMap,
    marks: Sequence[tuple[str, float, float]] = (),
    *,
    title: str = "",
) -> Figure:
    """Where over the gains the port is passive, stable with every hand, or unstable with one."""
    kinds = region.stable.astype(int) + (region.stable & region.passive)
    colours = ("#efc9b0", "#cfdde8", MODEL)
    labels = ("unstable with a hand", "stable with every hand", "passive")
    with mpl.rc_context(STYLE | {"axes.grid": False}):
        figure, axes = new_figure(6.4, 4.6)
        axes.pcolormesh(
            cell_edges(region.kd_Nms_rad),
            cell_edges(region.kp_Nm_rad),
            kinds,
            cmap=ListedColormap(colours),
            vmin=0,
            vmax=2,
            edgecolors="white",
            linewidth=0.4,
        )
        for label, kp, kd in marks:
            axes.plot([kd], [kp], "o", color=INK, mfc="white", mew=1.5, ms=6, zorder=3)
            right = kd > 0.5 * (region.kd_Nms_rad[0] + region.kd_Nms_rad[-1])
            axes.annotate(
                label,
                (kd, kp),
                xytext=(-8 if right else 8, 4),
                textcoords="offset points",
                ha="right" if right else "left",
                bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8},
            )
        axes.set_xlabel("damping Kd, N·m·s/rad")
        axes.set_ylabel("stiffness Kp, N·m/rad")
        if title:
            axes.set_title(title)
        handles = [Patch(fc=c, label=t) for c, t in zip(colours, labels, strict=True)]
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
        return finished(figure)


def percentile_bars(
    rows: Sequence[tuple[str, Percentiles]],
    limits: Mapping[str, float] | None = None,
    *,
    xlabel: str = "RMS error, N·m",
) -> Figure:
    """Monte-Carlo percentiles, one line a case."""
    with mpl.rc_context(STYLE):
        figure, axes = new_figure(9.6, 1.2 + 0.34 * len(rows))
        y = np.arange(len(rows))[::-1]
        for k, (name, p) in zip(y, rows, strict=True):
            v = p.values
            first = k == y[0]
            line: dict[str, Any] = {"color": MODEL, "solid_capstyle": "butt"}
            axes.plot(
                [v[5.0], v[95.0]], [k, k], lw=1.6, label="5 to 95 %" if first else None, **line
            )
            axes.plot(
                [v[25.0], v[75.0]], [k, k], lw=7, label="25 to 75 %" if first else None, **line
            )
            axes.plot(
                [p.low[95.0], p.high[95.0]],
                [k - 0.26, k - 0.26],
                color=ROUNDING,
                lw=2,
                solid_capstyle="butt",
                label="95 % interval of the 95 %" if first else None,
            )
            axes.plot([v[50.0]], [k], "|", color="white", ms=7, mew=2, zorder=3)
            axes.plot(
                [p.largest],
                [k],
                "o",
                color=MEASURED,
                ms=5,
                label="largest" if first else None,
                zorder=3,
                ls="",
            )
            if limits and name in limits:
                drawn = any(t.get_label() == "limit" for t in axes.lines)
                axes.plot(
                    [limits[name]] * 2,
                    [k - 0.38, k + 0.38],
                    color=BOUND,
                    lw=2,
                    label=None if drawn else "limit",
                )
        labels = [
            f"{name}\n{p.failed} of {p.count + p.failed} failed" if p.failed else name
            for name, p in rows
        ]
        axes.set_yticks(y, labels)
        for text, (_, p) in zip(axes.get_yticklabels(), rows, strict=True):
            if p.failed:
                text.set_color(BOUND)
        axes.tick_params(axis="y", length=0)
        axes.set_ylim(-0.6, len(rows) - 0.4)
        axes.set_xlim(left=min(0.0, *(p.values[5.0] for _, p in rows)))
        axes.set_xlabel(xlabel)
        figure.legend(loc="outside upper right", ncols=5)
        return finished(figure)
