"""What chapter 3 of the thesis prints of the forward model, recomputed with the emitted C.

The text gives few numbers of the model itself.  Beside these stand the figures of an independent
recomputation in float64 (``recomputed``), which the thesis does not print.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.plots import Panel, panels
from esea_gen.device import load_device
from esea_gen.hostlib.library import compile_device
from esea_gen.language.ports import Array
from esea_gen.reproduce.reproduction import Reproduction

SWEEP_HZ_S = 0.5 / 60
HOLD_S = 300.0
RAMP_RAD_S = np.deg2rad(20.0)
SLOW = "largest torque, {} deg at 0.01 Hz"


@dataclass(frozen=True)
class Figure3:
    """One number of the forward model, and what the thesis and the recomputation have of it."""

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
