"""Results of chapters 3 and 4 of the thesis, recomputed: torque model and inverses.

The text has few numbers of the forward model.  They are compared with an independent recomputation
in float64 (``recomputed``), which the thesis does not print.  For tables 4.4 and 4.5 the request
goes through an inverse Block's C, the set-point through the published zero-phase filter, and the
filtered set-point through the sensor's C, whose torque is compared with the request.  Everything
that is stepped is compiled, generated C; numpy makes signals and statistics.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.plots import Panel, panels
from esea_gen.device import Device, load_device
from esea_gen.hostlib.library import CRunner, compile_block, compile_device
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.published_inverse import KAPPA_ROUNDING_RAD, published_inverse
from esea_gen.plotting import INK
from esea_gen.studies.registry import Reproduction
from esea_gen.studies.uncertainty.motions import END_S, SIGNALS, evaluation_filter

SWEEP_HZ_S = 0.5 / 60
HOLD_S = 300.0
RAMP_RAD_S = np.deg2rad(20.0)
SLOW = "largest torque, {} deg at 0.01 Hz"


@dataclass(frozen=True)
class Figure3:
    meaning: str
    unit: str
    thesis: float | None
    recomputed: float | None
    ours: float


@dataclass(frozen=True)
class Chapter3:
    """The forward model's behaviour: numbers by name, deflection and torque, time and torque."""

    figures: dict[str, Figure3]
    loops: dict[str, tuple[Array, Array]]
    relaxation: dict[str, tuple[Array, Array]]

    def to_dict(self) -> dict[str, Any]:
        return {name: vars(f) for name, f in self.figures.items()}

    def table(self) -> list[str]:
        lines = [
            "Chapter 3: the forward model (recomputed: independently, from the same equations)",
            f"{'':62}{'thesis':>9}{'recomputed':>11}{'ours':>9}",
        ]
        for f in self.figures.values():
            cells = [f"{v:.4g}" if v is not None else "-" for v in (f.thesis, f.recomputed, f.ours)]
            label = f"{f.meaning} ({f.unit})"
            lines.append(f"  {label:60}{cells[0]:>9}{cells[1]:>11}{cells[2]:>9}")
        return lines

    def figure(self) -> Figure:
        thin = {"linewidth": 0.8}
        loops = [(np.degrees(x), y, name, thin) for name, (x, y) in self.loops.items()]
        plain: dict[str, Any] = {}
        held = [(x, y, name, plain) for name, (x, y) in self.relaxation.items()]
        figure = panels(
            [
                Panel(loops, "deflection / deg", "torque / N·m"),
                Panel(held, "time since the deflection was held / s", "torque / N·m"),
            ],
            *(11, 4.5),
        )
        figure.axes[1].set_xscale("symlog", linthresh=0.1)
        return figure


def _peak(values: Array) -> float:
    return float(np.max(np.abs(values)))


def reproduce_chapter3(progress: Callable[[str], None] | None = None) -> Chapter3:
    """Run the published excitations through the emitted C of velocity estimate and sensor."""
    device, say = load_device("elbow"), progress or (lambda _: None)
    task, h = compile_device(device, "f64").task("sense"), device.period_s
    found = Chapter3({}, {}, {})

    def answer(theta: Array) -> dict[str, Array]:
        task.reset()
        outputs, _ = task.run({"theta_rad": theta}, trace=False)
        return {k: np.asarray(v, dtype=np.float64) for k, v in outputs.items()}

    def swept(amplitude_deg: float, end_Hz: float) -> dict[str, Array]:
        t = np.arange(round(end_Hz / SWEEP_HZ_S / h)) * h
        theta = np.asarray(np.deg2rad(amplitude_deg) * np.sin(np.pi * SWEEP_HZ_S * t * t))
        y = answer(theta)
        found.loops[f"{amplitude_deg:g} deg, 0-{end_Hz:g} Hz"] = (theta[::5], y["tau_Nm"][::5])
        return y

    def slow(amplitude_deg: float) -> tuple[Array, Array]:
        t = np.arange(round(200 / h)) * h  # two cycles: the second one is a closed loop
        theta = np.asarray(np.deg2rad(amplitude_deg) * np.sin(2 * np.pi * 0.01 * t))
        return theta, answer(theta)["tau_Nm"]

    say("sweeps to 1 and 1.5 Hz")
    y = swept(11.5, 1.0)
    peak, part = _peak(y["tau_Nm"]), _peak(y["tau_hysteresis_Nm"])
    swept(5.0, 1.5)
    say("slow cycles")
    theta, torque = slow(10.0)
    last = slice(len(theta) // 2, None)
    found.loops["10 deg, 0.01 Hz"] = (theta[last][::50], torque[last][::50])
    work_mJ = 1e3 * float(np.trapezoid(torque[last], theta[last]))
    largest = _peak(slow(11.5)[1])
    swept_text = "largest torque, 11.5 deg swept 0-1 Hz"
    for name, *row in (
        ("sweep_peak_Nm", swept_text, "Nm", 4.47, 4.49, peak),
        ("hysteresis_Nm", "hysteresis part, where it saturates", "Nm", None, 0.118, part),
        ("slow_peak_Nm", SLOW.format(10), "Nm", None, 3.05, _peak(torque)),
        ("loop_mJ", "work of one such cycle", "mJ", None, 87.6, work_mJ),
        ("slow_largest_Nm", SLOW.format(11.5), "Nm", None, 3.97, largest),
    ):
        found.figures[name] = Figure3(*row)
    for amplitude_deg in (5.0, 10.0):
        say(f"relaxation at {amplitude_deg:g} deg")
        amplitude = np.deg2rad(amplitude_deg)
        ramp = np.arange(0.0, amplitude, RAMP_RAD_S * h)
        theta = np.concatenate([np.zeros(1000), ramp, np.full(round(HOLD_S / h), amplitude)])
        held = answer(theta)["tau_Nm"][1000 + len(ramp) :]
        keep = np.unique(np.geomspace(1, len(held), 400).astype(int)) - 1
        found.relaxation[f"{amplitude_deg:g} deg"] = (keep * h, held[keep])
        text = f"torque lost in {HOLD_S:g} s held at {amplitude_deg:g} deg, ramp of 20 deg/s"
        lost = 100 * float(1 - held[-1] / held[0])
        name = f"relaxation_{amplitude_deg:g}deg_percent"
        found.figures[name] = Figure3(text, "%", None, None, lost)
    return found


class ForwardModel(Reproduction[Chapter3]):
    """The forward model's published behaviour: torque range, loops, relaxation."""

    name = "chapter3"
    title = "The forward model"

    def run(self, say: Callable[[str], None], folder: Path | None) -> Chapter3:
        return reproduce_chapter3(say)


SIGNAL_COUNT = 5

THESIS: dict[str, dict[str, list[float]]] = {
    "table_4_4": {
        "no_dob": [18.6, 7.82, 21.5, 8.79, 7.16],
        "filter_a": [7.80, 3.77, 10.0, 5.19, 3.48],
        "filter_b": [0.430, 0.301, 4.20, 3.34, 1.51],
    },
    "table_4_5": {
        "no_dob": [8.15, 4.45, 8.14, 2.32, 2.20],
        "filter_a": [3.59, 2.08, 3.57, 1.08, 1.00],
        "filter_b": [0.125, 0.0904, 0.593, 0.240, 0.143],
    },
}
TITLES = {
    "table_4_4": "Table 4.4: largest |error| in % of the largest request",
    "table_4_5": "Table 4.5: RMS error in % of the largest request",
}
ROWS = {
    "no_dob": "play operators, no observer",
    "filter_a": "observer, filter A",
    "filter_b": "observer, filter B",
    "filter_a_normalised": "observer, filter A scaled to gain 1",
    "filter_b_normalised": "observer, filter B scaled to gain 1",
    "exact": "exact inverse",
}
BARS = ("no_dob", "filter_a", "filter_b")
COLUMNS = {
    "thesis": "thesis",
    "printed": "ours, as published",
    "printed_interior": "  interior",
    "rounding": "ours, within the printed rounding",
    "rounding_interior": "  interior",
    "rounding_unfiltered": "  unfiltered set-point",
    "whole": "ours",
    "interior": "  interior",
    "unfiltered": "  unfiltered set-point",
    "model": "  against the discrete model itself",
}


@dataclass(frozen=True)
class InverseErrors:
    """Errors of one inverse on one signal, in % of the largest request.

    Largest and RMS by part: ``filtered`` as published, its ``interior`` without the ends, and
    ``unfiltered``; the largest of the inverse's own ``model``; and the filtered one in time.
    """

    largest: dict[str, float]
    rms: dict[str, float]
    model: float
    series: Array


def sensed_torque(device: Device, sensor: CRunner, theta_rad: Array) -> Array:
    """Torque of the sensor's C for a motion whose rate is known."""
    sensor.reset()
    omega = np.diff(theta_rad, prepend=theta_rad[:1]) / device.period_s
    y, _ = sensor.run({"theta_rad": theta_rad, "omega_rad_s": omega}, trace=False)
    return np.asarray(y["tau_Nm"], dtype=float)


def evaluate(device: Device, sensor: CRunner, inverse: CRunner, request_Nm: Array) -> InverseErrors:
    inverse.reset()
    y, _ = inverse.run({"tau_Nm": request_Nm}, trace=False)
    theta = np.asarray(y["theta_rad"], dtype=float)
    scale = 100.0 / float(np.max(np.abs(request_Nm)))
    rate_Hz = 1.0 / device.period_s

    def error(motion: Array) -> Array:
        return scale * (sensed_torque(device, sensor, motion) - request_Nm)

    filtered, raw = error(evaluation_filter(theta, rate_Hz)), error(theta)
    ends = round(END_S * rate_Hz)
    inner = filtered[ends:-ends] if len(filtered) > 2 * ends else filtered
    parts = {"filtered": filtered, "interior": inner, "unfiltered": raw}
    own = y.get("residual_Nm")
    return InverseErrors(
        {k: float(np.max(np.abs(e))) for k, e in parts.items()},
        {k: float(np.sqrt(np.mean(e**2))) for k, e in parts.items()},
        math.nan if own is None else scale * float(np.max(np.abs(own))),
        filtered[:: max(1, len(filtered) // 3000)].astype(np.float32),
    )


@dataclass(frozen=True)
class Chapter4:
    device: str
    rate_Hz: float
    real: str
    errors: dict[str, dict[str, list[InverseErrors]]]

    def _cells(self, name: str, kind: str, row: str) -> dict[str, list[float]]:
        # Columns of a row: the thesis', and what is shown of each variant.
        cells = {"thesis": THESIS[name][row]} if row in THESIS[name] else {}
        for variant, errors in self.errors[row].items():
            exact = variant == "exact"
            stem = "" if exact else f"{variant}_"
            for part in ("filtered", "interior", "unfiltered"):
                whole = "whole" if exact else variant
                key = whole if part == "filtered" else f"{stem}{part}"
                if key in COLUMNS:
                    cells[key] = [getattr(e, kind)[part] for e in errors]
            if exact:
                cells["model"] = [e.model for e in errors]
        return cells

    def to_dict(self) -> dict[str, Any]:
        tables = {
            name: {row: self._cells(name, kind, row) for row in self.errors}
            for name, kind in (("table_4_4", "largest"), ("table_4_5", "rms"))
        }
        return {"device": self.device, "rate_Hz": self.rate_Hz, "format": self.real} | tables

    def table(self) -> list[str]:
        content = self.to_dict()
        lines = []
        for name, title in TITLES.items():
            signals = "".join(f"{f'S{i + 1}':>10}" for i in range(SIGNAL_COUNT))
            lines += [title, f"{'':36}{signals}"]
            for row, cells in content[name].items():
                lines.append(ROWS[row])
                for key, label in COLUMNS.items():
                    if key in cells:
                        numbers = "".join(f"{v:>10.3g}" for v in cells[key])
                        lines.append(f"  {label:34}{numbers}")
            lines.append("")
        return lines[:-1]

    def figure(self) -> Figure:
        figure = Figure(figsize=(11, 13.5), layout="constrained")
        axes = figure.subplots(SIGNAL_COUNT + 2, 1)
        for i, ax in enumerate(axes[:SIGNAL_COUNT]):
            for row in (*BARS, "exact"):
                series = self.errors[row]["exact" if row == "exact" else "rounding"][i].series
                t = np.linspace(0, SIGNALS[i].duration_s, len(series))
                ax.plot(t, series, linewidth=0.7, label=ROWS[row])
            ax.set_ylabel(f"S{i + 1} error / %")
            ax.grid(alpha=0.3)
        # Above the panel: inside it would lie on S1's peaks.
        above: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "frameon": False}
        axes[0].legend(ncols=4, fontsize="small", borderaxespad=0.2, **above)
        axes[SIGNAL_COUNT - 1].set_xlabel("time / s")
        content = self.to_dict()
        for ax, (name, title) in zip(axes[SIGNAL_COUNT:], TITLES.items(), strict=True):
            self._bars(ax, content[name])
            ax.set_title(title, fontsize="medium")
        # Matplotlib names the markers first.
        handles, labels = axes[-1].get_legend_handles_labels()
        order = [*range(1, len(labels)), 0]
        shown = [handles[k] for k in order], [labels[k] for k in order]
        figure.legend(*shown, loc="outside lower center", ncols=3, fontsize="small")
        return figure

    def _bars(self, ax: Any, content: dict[str, Any]) -> None:
        bars = [
            (f"{ROWS[row]}, {label}", content[row][key], c, hatch)
            for c, row in enumerate(BARS)
            for key, label, hatch in (("thesis", "thesis", "///"), ("rounding", "ours", ""))
        ]
        exact, places = content["exact"], np.arange(1, SIGNAL_COUNT + 1)
        bars.append((f"{ROWS['exact']}, ours", exact["whole"], 3, ""))
        width = 0.8 / len(bars)
        for k, (label, heights, colour, hatch) in enumerate(bars):
            x = places + (k - 3) * width
            ax.bar(x, heights, width, label=label, color=f"C{colour}", hatch=hatch)
        label = f"{ROWS['exact']}, without the first and the last {END_S:g} s"
        ax.plot(places + 3 * width, exact["interior"], "D", ms=4.5, color=INK, label=label)
        ax.set_yscale("log")
        ax.set_xticks(places, [f"S{i}" for i in places])
        ax.grid(axis="y", alpha=0.3)


def reproduce_chapter4(progress: Callable[[str], None] | None = None) -> Chapter4:
    device, say = load_device("elbow"), progress or (lambda _: None)
    kappa = KAPPA_ROUNDING_RAD
    plan: list[tuple[str, str, Block]] = [
        ("no_dob", "printed", published_inverse(device)),
        ("no_dob", "rounding", published_inverse(device, kappa=kappa)),
        ("filter_a", "printed", published_inverse(device, "a")),
        ("filter_a", "rounding", published_inverse(device, "a", kappa=kappa)),
        ("filter_b", "printed", published_inverse(device, "b")),
        ("filter_b", "rounding", published_inverse(device, "b_rounding", kappa=kappa)),
        ("filter_a_normalised", "rounding", published_inverse(device, "a_normalised", kappa=kappa)),
        ("filter_b_normalised", "rounding", published_inverse(device, "b_normalised", kappa=kappa)),
        ("exact", "exact", exact_inverse(device)),
    ]
    rate_Hz = 1.0 / device.period_s
    requests = [s.sample(rate_Hz) for s in SIGNALS]
    sensor = compile_device(device, "f64").block("sensor")
    errors: dict[str, dict[str, list[InverseErrors]]] = {}
    for row, variant, block in plan:
        say(f"{ROWS[row]}, {variant}: compiling")
        inverse = compile_block(block)
        found = []
        for i, request in enumerate(requests):
            say(f"{ROWS[row]}, {variant}: signal {i + 1} of {SIGNAL_COUNT}")
            found.append(evaluate(device, sensor, inverse, request))
        errors.setdefault(row, {})[variant] = found
    return Chapter4(device.name, rate_Hz, "f64", errors)


@dataclass(frozen=True)
class ThesisTables:
    inverse: Chapter4
    forward: Chapter3

    def table(self) -> list[str]:
        return [*self.inverse.table(), "", *self.forward.table()]

    def to_dict(self) -> dict[str, Any]:
        return self.inverse.to_dict() | {"chapter_3": self.forward.to_dict()}

    def figure(self) -> Figure:
        return self.inverse.figure()


class InverseTables(Reproduction[ThesisTables]):
    """Tables 4.4 and 4.5: the published inverses and the exact one; the forward model's figures."""

    name = "chapter4"
    title = "The inverse models"

    def run(self, say: Callable[[str], None], folder: Path | None) -> ThesisTables:
        return ThesisTables(reproduce_chapter4(say), reproduce_chapter3(say))
