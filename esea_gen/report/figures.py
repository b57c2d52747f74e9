"""Plots as inline SVG: the same bytes for the same data, nothing fetched from anywhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from esea_gen.analysis.plots import new_figure, styled
from esea_gen.identify import Recording
from esea_gen.identify.drive.friction import Friction, SteadyRun, run_means
from esea_gen.identify.published.search_problem import PresentBest
from esea_gen.identify.recording.quality import runs
from esea_gen.language.ports import Array
from esea_gen.plotting import BOUND, HELD_OUT, INK, MEASURED, MODEL, ROUNDING, envelope, svg

# An SVG point takes about 12 bytes: this keeps a page with ten recordings below 3 MB.
POINTS_PER_PAGE = 120_000
MOST_PANELS = 16
WHOLE = "whole recording"
MARKS = (
    ("float64 C", "o", MODEL, "white"),
    ("float32 C", "o", MODEL, MODEL),
    ("derived float32 bound", "|", BOUND, BOUND),
)


@dataclass(frozen=True)
class Curve:
    label: str
    time_s: Array  # samples, shape (n,)
    theta_rad: Array
    model_Nm: Array
    measured_Nm: Array | None  # measured torque at the same samples
    parts: tuple[tuple[str, npt.NDArray[np.intp]], ...]  # title and samples of each panel
    held_out: npt.NDArray[np.bool_]  # samples that served no training
    model_name: str = "C, float32"
    components: tuple[tuple[str, Array], ...] = ()


def recorded(r: Recording, model_Nm: Array, model_name: str = "C, float32") -> Curve:
    held = np.zeros(len(r.time_s), dtype=bool)
    parts = []
    for s in r.sets:
        held[s.held_out] = True
        used = np.sort(np.concatenate([s.training, s.held_out]))
        if len(used):
            parts.append((f"{s.label}, amplitude {np.degrees(s.amplitude_rad):.3g}°", used))
    if len(parts) != 1 or len(parts[0][1]) != len(held):
        # Conditioning cycles and transitions too, so that nothing is hidden.
        parts.append((WHOLE, np.arange(len(held))))
    return Curve(r.label, r.time_s, r.theta_rad, model_Nm, r.tau_Nm, tuple(parts), held, model_name)


def plots(
    traces: Sequence[Curve], full_scale_Nm: float, roundings: Sequence[tuple[Array, Array] | None]
) -> list[dict[str, Any]]:
    """Loops and torque over time of every curve, with data for their captions."""
    points = POINTS_PER_PAGE // (2 * max(len(traces), 4))
    shared = _share_loops(traces)
    drawn = []
    for i, (trace, rounding) in enumerate(zip(traces, roundings, strict=True)):
        parts = len((shared or trace).parts)
        # A shared figure stands with the first recording.
        first = shared is None or i == 0
        drawn.append(
            {
                "label": trace.label,
                "measured": trace.measured_Nm is not None,
                "held_out": bool(np.any(trace.held_out)),
                "parts": parts,
                "drawn": min(parts, MOST_PANELS),
                "shared": shared is not None,
                "loops": loops_svg(shared or trace, f"loops{i}", points) if first else "",
                "time": svg(
                    over_time(trace, points, full_scale_Nm, rounding),
                    f"time{i}",
                    f"Torque over time, {trace.label}",
                ),
            }
        )
    return drawn


def _share_loops(traces: Sequence[Curve]) -> Curve | None:
    """Recordings of one loop each as one trace, so that their loops share a figure."""
    if len(traces) < 2 or any(len(t.parts) > 1 or t.components for t in traces):
        return None
    return joined(traces)


def joined(traces: Sequence[Curve]) -> Curve:
    """Recordings as one trace with the parts of all."""
    starts = np.cumsum([0, *(len(t.time_s) for t in traces)])
    measured = [t.measured_Nm for t in traces if t.measured_Nm is not None]
    return Curve(
        "every recording",
        np.concatenate([t.time_s for t in traces]),
        np.concatenate([t.theta_rad for t in traces]),
        np.concatenate([t.model_Nm for t in traces]),
        np.concatenate(measured) if len(measured) == len(traces) else None,
        tuple(
            (title, at + start)
            for t, start in zip(traces, starts, strict=False)
            for title, at in t.parts
        ),
        np.concatenate([t.held_out for t in traces]),
        traces[0].model_name,
    )


def _thin(n: int, most: int) -> npt.NDArray[np.intp]:
    """Samples of a loop to draw: every k-th, the last one too."""
    step = max(1, math.ceil(n / max(most, 2)))
    picked = np.arange(0, n, step)
    return picked if n == 0 or picked[-1] == n - 1 else np.append(picked, n - 1)


def _name_rows(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(np.arange(len(names))[::-1], names)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.6, max(len(names), 1) - 0.4)


def loops_svg(trace: Curve, name: str, points: int) -> Markup:
    return svg(loops(trace, points), name, f"Torque over deflection, {trace.label}")


@styled
def loops(trace: Curve, points: int) -> Figure:
    """Hysteresis loops: torque over deflection, one panel a data set."""
    parts = trace.parts[:MOST_PANELS]
    panels = len(parts) + bool(trace.components)
    columns = panels if panels <= 4 else 3 if panels <= 6 else 4
    rows = math.ceil(panels / columns)
    lines = 1 if trace.measured_Nm is None else 2
    width = 9.6 if columns > 1 else 5.2
    height = 0.5 + rows * max(2.5, min(3.2, 0.85 * width / columns))
    figure, grid = new_figure(
        width, height, nrows=rows, ncols=columns, squeeze=False, sharex=True, sharey=True
    )
    cells: list[Axes] = list(grid.ravel())
    for axes, (title, samples) in zip(cells, parts, strict=False):
        keep = samples[_thin(len(samples), points // (lines * len(parts)))]
        # A jump in the sample numbers is another cycle somewhere else: lift the pen.
        gaps = np.flatnonzero(np.diff(keep) > 3 * max(1, int(np.median(np.diff(keep))))) + 1

        def cut(values: Array, keep: Any = keep, gaps: Any = gaps) -> Array:
            return np.insert(values[keep], gaps, np.nan)

        x = np.degrees(cut(trace.theta_rad))
        if trace.measured_Nm is not None:
            axes.plot(x, cut(trace.measured_Nm), color=MEASURED, lw=2.2, label="measured")
        model = cut(trace.model_Nm)
        unseen = cut(trace.held_out.astype(np.float64)) > 0.5
        for which, colour, what in ((~unseen, MODEL, ""), (unseen, BOUND, ", held out")):
            if what == "" or np.any(trace.held_out):
                shown = np.where(which, model, np.nan)
                axes.plot(x, shown, color=colour, lw=0.9, label=trace.model_name + what)
        axes.set_title(title)
        axes.xaxis.set_major_locator(MaxNLocator(5))
    handles, labels = cells[0].get_legend_handles_labels()
    if trace.components:
        axes = cells[len(parts)]
        keep = _thin(len(trace.time_s), points // (lines * panels))
        x = np.degrees(trace.theta_rad[keep])
        looks = ((INK, 1.4), (BOUND, 1.0), (ROUNDING, 1.0))
        for (what, torque), (colour, broad) in zip(trace.components, looks, strict=False):
            axes.plot(x, torque[keep], color=colour, lw=broad, label=what)
        axes.set_title("its parts")
        more = axes.get_legend_handles_labels()
        handles, labels = [*handles, *more[0]], [*labels, *more[1]]
    for axes in cells[panels:]:
        axes.set_visible(False)
    for row in grid:
        row[0].set_ylabel("torque, N·m")
    for k, axes in enumerate(cells[:panels]):
        axes.tick_params(labelbottom=True)
        if k + columns >= panels:
            axes.set_xlabel("deflection, deg")
    figure.legend(handles, labels, loc="outside upper right", ncols=5)
    return figure


@styled
def over_time(
    trace: Curve, points: int, full_scale_Nm: float, rounding: tuple[Array, Array] | None
) -> Figure:
    t, model, measured = trace.time_s, trace.model_Nm, trace.measured_Nm
    # Of each panel its label, and its curves: times, values, colour, width, name.
    torque: list[tuple[Array, Array, str, float, str]] = [(t, model, MODEL, 0.8, trace.model_name)]
    panels = [("torque, N·m", torque)]
    if measured is not None:
        torque.insert(0, (t, measured, MEASURED, 2.0, "measured"))
        error = 100 * (model - measured) / full_scale_Nm
        panels.append(("C − measured,\n% full scale", [(t, error, INK, 0.7, "")]))
    measured_panels = len(panels)
    if rounding is not None:
        curve = (rounding[0], 1e6 * rounding[1], ROUNDING, 0.6, "")
        panels.append(("float32 −\nfloat64, µN·m", [curve]))
    share = max(points // (len(panels) + 1), 200)
    more = len(panels) - 1
    shape: dict[str, Any] = {"nrows": 1 + more, "height_ratios": [2.0, *[1.0] * more]}
    figure, grid = new_figure(9.6, 2.3 + 1.25 * more, squeeze=False, sharex=True, **shape)
    cells: list[Axes] = list(grid[:, 0])
    for axes, (label, curves) in zip(cells, panels, strict=True):
        for x, y, colour, width, what in curves:
            keep = envelope(y, share)
            axes.plot(x[keep], y[keep], color=colour, lw=width, label=what or "_")
        axes.set_ylabel(label)
        axes.margins(x=0.005)
        axes.yaxis.set_major_locator(MaxNLocator(4))
    handles, labels = cells[0].get_legend_handles_labels()
    bands = [
        axes.axvspan(t[a], t[b - 1], color=HELD_OUT, lw=0, zorder=0)
        for a, b in runs(trace.held_out)
        for axes in cells[:measured_panels]
    ]
    if bands:
        handles, labels = [*handles, bands[0]], [*labels, "held out from training"]
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    cells[-1].set_xlabel("time, s")
    figure.align_ylabels(cells)
    return figure


StreamErrors = tuple[str, float | None, float | None, float | None]


@styled
def error_overview(rows: Sequence[StreamErrors], fit: float | None) -> Figure:
    """Errors of the torque on a logarithmic scale, one line a stream."""
    values = [v for _, *found in rows for v in found if v]
    if fit:
        values.append(fit)
    floor = 10.0 ** (math.floor(math.log10(min(values, default=1e-6))) - 2)
    top = 10.0 ** (math.ceil(math.log10(max(values, default=1.0))) + 0.5)
    figure, axes = new_figure(9.6, 1.0 + 0.27 * len(rows))
    y = np.arange(len(rows))[::-1]
    for i, (label, marker, colour, face) in enumerate(MARKS):
        found = [(r[1 + i], k) for r, k in zip(rows, y, strict=True)]
        # No logarithm of an exact result: it stands on the left edge.
        drawn = [(max(v, floor), k) for v, k in found if v is not None]
        look: dict[str, Any] = {"ms": 5.5, "mew": 1.2} if marker == "o" else {"ms": 11, "mew": 2.2}
        look |= {"marker": marker, "ls": "", "color": colour, "mfc": face}
        x, y_drawn = [v for v, _ in drawn], [k for _, k in drawn]
        axes.plot(x, y_drawn, label=label, clip_on=False, zorder=3, **look)
    if fit:
        axes.axvline(fit, color=MEASURED, lw=2, label="fit to the measured torque, RMS")
    axes.set(xscale="log", xlim=(floor, top))
    _name_rows(axes, [r[0] for r in rows])
    axes.set_xlabel("largest torque error, % of full scale (logarithmic; left edge: exactly 0)")
    decades = range(round(math.log10(floor)), math.floor(math.log10(top)) + 1, 2)
    axes.set_xticks([10.0**d for d in decades])
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: _decade(v, floor)))
    axes.minorticks_off()
    figure.legend(loc="outside upper right", ncols=4)
    return figure


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def _decade(value: float, floor: float) -> str:
    if value <= floor * 1.001:
        return "0"
    power = round(math.log10(value))
    return f"{10.0**power:g}" if -3 <= power <= 2 else "10" + str(power).translate(_RAISED)


@styled
def spread(rows: Sequence[tuple[str, float, float | None]]) -> Figure:
    shown = [(n, abs(s / v)) for n, v, s in rows if s is not None and v != 0]
    figure, axes = new_figure(9.6, 0.75 + 0.27 * max(len(shown), 1))
    y = np.arange(len(shown))[::-1]
    for (_, s), k in zip(shown, y, strict=True):
        half = min(100 * s, 200)
        axes.plot([-half, half], [k, k], color=MODEL, lw=5, solid_capstyle="butt", alpha=0.55)
        axes.plot([0], [k], marker="|", color=MODEL, ms=11, mew=2)
        text = f"±{100 * s:.{1 if s < 0.1 else 0}f} %"
        axes.annotate(text, (205, k), va="center", fontsize=9, annotation_clip=False)
    _name_rows(axes, [n for n, _ in shown])
    axes.set_xlim(-200, 200)
    axes.axvspan(-50, 50, color=HELD_OUT, lw=0, zorder=0)
    axes.set_xlabel("one standard deviation, % of the value (grey: within ±50 %)")
    return figure


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
    title = f"published form, best so far: {np.sqrt(best.cost):.4g} N·m"
    labels = {"xlabel": "runs over all recordings", "ylabel": "RMS error, N·m", "title": title}
    progress.set(yscale="log", **labels)
    for number, (panel, (theta, measured, model)) in enumerate(zip(loops, sets, strict=True), 1):
        panel.plot(theta, measured, color=MEASURED, lw=1.6, label="measured")
        panel.plot(theta, model, color=MODEL, lw=0.8, label="best so far")
        rms_set = float(np.sqrt(np.mean((model - measured) ** 2)))
        title = f"data set {number} of {len(best.sets)}: {rms_set:.3g} N·m"
        panel.set(xlabel="deflection, rad", title=title)
    loops[0].set_ylabel("torque, N·m")
    loops[0].legend(loc="lower right")
    return figure


@styled
def friction_picture(runs: Sequence[SteadyRun], found: Friction) -> Figure:
    figure, axes = new_figure(7.0, 3.6)
    speeds, torques, _ = run_means(runs)
    axes.plot(speeds, 1e3 * torques, "o", color=MEASURED, ms=4, label="recorded, a run each")
    most = float(np.max(np.abs(speeds)))
    for k, way in enumerate((-1.0, 1.0)):
        at = way * np.geomspace(most / 400, most, 200)
        label = None if k else "model"
        axes.plot(at, 1e3 * found.torque_Nm(at), color=MODEL, lw=1.4, label=label)
    axes.set(xlabel="speed of the motor shaft, rad/s", ylabel="mN·m at the motor shaft")
    axes.set_title("torque that the drive takes at steady speeds")
    axes.legend(loc="upper left")
    return figure
