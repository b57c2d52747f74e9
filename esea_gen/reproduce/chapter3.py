"""What chapter 3 of the thesis prints of the forward model, recomputed with the emitted C.

The text gives few numbers of the model itself: the torque range, and the deflections and rates
that it was trained on.  Beside these stand the figures of an independent recomputation in float64
(``recomputed``), which the thesis does not print.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.device import Device, load_device
from esea_gen.hostlib.library import compile_device
from esea_gen.language.ports import Array
from esea_gen.reproduce.reproduction import Reproduction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SWEEP_HZ_S = 0.5 / 60
HOLD_S = 300.0
RAMP_RAD_S = np.deg2rad(20.0)


@dataclass(frozen=True)
class Figure3:
    """One number of the forward model."""

    name: str
    meaning: str
    unit: str
    ours: float
    thesis: float | None = None
    recomputed: float | None = None


@dataclass(frozen=True)
class Chapter3:
    """The forward model's behaviour."""

    device: str
    figures: tuple[Figure3, ...]
    loops: dict[str, tuple[Array, Array]]
    relaxation: dict[str, tuple[Array, Array]]

    def to_dict(self) -> dict[str, Any]:
        return {
            f.name: {
                "meaning": f.meaning,
                "unit": f.unit,
                "thesis": f.thesis,
                "recomputed": f.recomputed,
                "ours": f.ours,
            }
            for f in self.figures
        }

    def table(self) -> list[str]:
        lines = [
            "Chapter 3: the forward model (recomputed: independently, from the same equations)",
            f"{'':62}{'thesis':>9}{'recomputed':>11}{'ours':>9}",
        ]
        for f in self.figures:
            cells = [f"{v:.4g}" if v is not None else "-" for v in (f.thesis, f.recomputed, f.ours)]
            label = f"{f.meaning} ({f.unit})"
            lines.append(f"  {label:60}{cells[0]:>9}{cells[1]:>11}{cells[2]:>9}")
        return lines

    def figure(self) -> Figure:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(11, 4.5), layout="constrained")
        left, right = figure.subplots(1, 2)
        for name, (theta, torque) in self.loops.items():
            left.plot(np.degrees(theta), torque, linewidth=0.8, label=name)
        left.set_xlabel("deflection / deg")
        left.set_ylabel("torque / N·m")
        left.legend(fontsize="small")
        for name, (time_s, torque) in self.relaxation.items():
            right.plot(time_s, torque, label=name)
        right.set_xscale("symlog", linthresh=0.1)
        right.set_xlabel("time since the deflection was held / s")
        right.set_ylabel("torque / N·m")
        right.legend(fontsize="small")
        for ax in (left, right):
            ax.grid(alpha=0.3)
        return figure


class _Excited:
    """Velocity estimate and sensor of a device, as emitted, and the published excitations."""

    def __init__(self, device: Device, real: str) -> None:
        self.task = compile_device(device, real).task("sense")
        self.h = device.period_s
        self.figures: list[Figure3] = []
        self.loops: dict[str, tuple[Array, Array]] = {}
        self.relaxation: dict[str, tuple[Array, Array]] = {}

    def answer(self, theta: Array) -> dict[str, Array]:
        self.task.reset()
        outputs, _ = self.task.run({"theta_rad": theta}, trace=False)
        return {k: np.asarray(v, dtype=np.float64) for k, v in outputs.items()}

    def swept(self, amplitude_deg: float, end_Hz: float) -> dict[str, Array]:
        t = np.arange(round(end_Hz / SWEEP_HZ_S / self.h)) * self.h
        theta = np.asarray(np.deg2rad(amplitude_deg) * np.sin(np.pi * SWEEP_HZ_S * t * t))
        y = self.answer(theta)
        self.loops[f"{amplitude_deg:g} deg, 0-{end_Hz:g} Hz"] = (theta[::5], y["tau_Nm"][::5])
        return y

    def slow(self, amplitude_deg: float) -> tuple[Array, Array]:
        t = np.arange(round(200 / self.h)) * self.h  # two cycles: the second one is a closed loop
        theta = np.asarray(np.deg2rad(amplitude_deg) * np.sin(2 * np.pi * 0.01 * t))
        return theta, self.answer(theta)["tau_Nm"]

    def add(
        self,
        name: str,
        meaning: str,
        unit: str,
        ours: float,
        thesis: float | None = None,
        recomputed: float | None = None,
    ) -> None:
        self.figures.append(Figure3(name, meaning, unit, ours, thesis, recomputed))

    def sweeps(self) -> None:
        y = self.swept(11.5, 1.0)
        peak = _peak(y["tau_Nm"])
        self.add("sweep_peak_Nm", "largest torque, 11.5 deg swept 0-1 Hz", "Nm", peak, 4.47, 4.49)
        part = _peak(y["tau_hysteresis_Nm"])
        self.add(
            "hysteresis_Nm", "hysteresis part, where it saturates", "Nm", part, recomputed=0.118
        )
        self.swept(5.0, 1.5)

    def slow_cycles(self) -> None:
        theta, torque = self.slow(10.0)
        last = slice(len(theta) // 2, None)
        self.loops["10 deg, 0.01 Hz"] = (theta[last][::50], torque[last][::50])
        loop_mJ = 1e3 * float(np.trapezoid(torque[last], theta[last]))
        largest = "largest torque, {} deg at 0.01 Hz"
        self.add("slow_peak_Nm", largest.format(10), "Nm", _peak(torque), recomputed=3.05)
        self.add("loop_mJ", "work of one such cycle", "mJ", loop_mJ, recomputed=87.6)
        _, torque = self.slow(11.5)
        self.add("slow_largest_Nm", largest.format(11.5), "Nm", _peak(torque), recomputed=3.97)

    def relax(self, amplitude_deg: float) -> None:
        amplitude = np.deg2rad(amplitude_deg)
        ramp = np.arange(0.0, amplitude, RAMP_RAD_S * self.h)
        theta = np.concatenate([np.zeros(1000), ramp, np.full(round(HOLD_S / self.h), amplitude)])
        held = self.answer(theta)["tau_Nm"][1000 + len(ramp) :]
        keep = np.unique(np.geomspace(1, len(held), 400).astype(int)) - 1
        self.relaxation[f"{amplitude_deg:g} deg"] = (keep * self.h, held[keep])
        self.add(
            f"relaxation_{amplitude_deg:g}deg_percent",
            f"torque lost in {HOLD_S:g} s held at {amplitude_deg:g} deg, ramp of 20 deg/s",
            "%",
            100 * float(1 - held[-1] / held[0]),
        )


def _peak(values: Array) -> float:
    return float(np.max(np.abs(values)))


def reproduce_chapter3(
    progress: Callable[[str], None] | None = None,
    *,
    device: Device | None = None,
    real: str = "f64",
) -> Chapter3:
    """Run the published excitations through the emitted C of velocity estimate and sensor."""
    device = device or load_device("elbow")
    say = progress or (lambda _: None)
    excited = _Excited(device, real)
    say("sweeps to 1 and 1.5 Hz")
    excited.sweeps()
    say("slow cycles")
    excited.slow_cycles()
    for amplitude_deg in (5.0, 10.0):
        say(f"relaxation at {amplitude_deg:g} deg")
        excited.relax(amplitude_deg)
    return Chapter3(device.name, tuple(excited.figures), excited.loops, excited.relaxation)


class ForwardModel(Reproduction[Chapter3]):
    """The forward model's published behaviour: torque range, loops, relaxation."""

    name = "chapter3"
    title = "The forward model"

    def run(self, say: Callable[[str], None], folder: Path | None) -> Chapter3:
        return reproduce_chapter3(say)
