"""Simulated day in a clinic: the rubber softens over the sessions and recovers overnight.

The protocol is that of the thesis' chapter 3, sixteen sessions at three intensities.  The model is
the smallest that tires and recovers, one share s of the whole torque::

    ds/dt = (most - s) |dtheta/dt| / length - s / recovery

It has three numbers, which no recording here determines: they are fitted to the six published
errors of tables 3.6 and 3.7, and the residual is printed.  A sensor without this effect then errs
by s times the torque; its error in the first session is added by squares.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.plots import new_figure, styled
from esea_gen.device import Device, load_device
from esea_gen.hostlib.library import compile_device
from esea_gen.language.ports import Array
from esea_gen.plotting import INK, MEASURED, MODEL, ROUNDING
from esea_gen.reproduce.measures import (
    FUNCTIONAL_CYCLES,
    SESSIONS,
    SIMPLE_CYCLES,
    FUNCTIONAL_Hz,
    SIMPLE_Hz,
)
from esea_gen.studies.registry import Reproduction

DEVICE, COUNT, APART_S, NIGHT_S = "elbow", 16, 300.0, 12 * 3600.0
AMPLITUDE_rad = np.deg2rad(10.0)
# % of full scale: largest change of a session's error (table 3.6); error of the first session on
# the first and on the second day (table 3.7).
PUBLISHED = {"60 %": (1.39, 3.72, 3.83), "80 %": (2.70, 3.30, 3.35), "100 %": (2.56, 3.52, 4.89)}


@dataclass(frozen=True)
class Tiring:
    most: float
    length_rad: float
    recovery_s: float

    def after(self, share: float, rate_rad_s: float, time_s: float) -> float:
        """The share after so long at a mean |rate|; 0: rest."""
        pull = rate_rad_s / self.length_rad
        fading = pull + 1 / self.recovery_s
        end = self.most * pull / fading
        return float(end + (share - end) * np.exp(-fading * time_s))


def exercises(intensity: str) -> Iterator[tuple[float, float, float]]:
    """A session: frequency in Hz, time in s, and rest behind it in s, of each exercise."""
    simple, functional, rest_s = SESSIONS[intensity]
    rows = [
        (f, SIMPLE_CYCLES / f) for n, f in zip(simple, SIMPLE_Hz, strict=True) for _ in range(n)
    ]
    rows += [(FUNCTIONAL_Hz, FUNCTIONAL_CYCLES / FUNCTIONAL_Hz)] * functional
    for k, (f, time_s) in enumerate(rows, start=1):
        yield f, time_s, rest_s if k < len(rows) else 0.0


def sessions(tiring: Tiring, intensity: str, effect: dict[float, float]) -> tuple[Array, Array]:
    """A day and the next morning, each session's: effective s times torque, and s at its end."""
    share, drift, ends = 0.0, [], []
    for number in range(COUNT + 1):
        squares, total_s = 0.0, 0.0
        for f, time_s, rest_s in exercises(intensity):
            before = share
            share = tiring.after(share, 4 * AMPLITUDE_rad * f, time_s)
            squares += time_s * (0.5 * (before + share) * effect[f]) ** 2
            total_s += time_s
            share = tiring.after(share, 0.0, rest_s)
        drift.append(np.sqrt(squares / total_s))
        ends.append(share)
        share = tiring.after(share, 0.0, NIGHT_S if number == COUNT - 1 else APART_S)
    return np.array(drift), np.array(ends)


def errors(drift: Array, first: float) -> Array:
    """Each session's error, % of full scale, where the first one's is given."""
    own = np.sqrt(max(first**2 - drift[0] ** 2, 0.0))
    return np.asarray(np.hypot(own, drift))


def figures(tiring: Tiring, intensity: str, effect: dict[float, float]) -> tuple[float, float]:
    """Largest change of the day, and error of the next morning, % of full scale."""
    made = errors(sessions(tiring, intensity, effect)[0], PUBLISHED[intensity][1])
    return float(np.max(np.abs(made[:COUNT] - made[0]))), float(made[COUNT])


@dataclass(frozen=True)
class Rubber:
    """The device's sensor, as emitted, at 10 degrees."""

    effect: dict[float, float]
    stiffness_Nm_rad: float
    loss_J: float


def rubber(device: Device) -> Rubber:
    """From the second cycle of a sine."""
    task, h = compile_device(device, "f64").task("sense"), device.period_s
    effect, stiffness, loss = {}, 0.0, 0.0
    for f in sorted({*SIMPLE_Hz, FUNCTIONAL_Hz}):
        task.reset()
        cycle = round(1 / (f * h))
        theta = AMPLITUDE_rad * np.sin(2 * np.pi * f * h * np.arange(2 * cycle + 1))
        tau = np.asarray(task.run({"theta_rad": theta}, trace=False)[0]["tau_Nm"])[cycle:]
        theta = theta[cycle:]
        effect[f] = 100 * float(np.sqrt(np.mean(tau**2))) / device.tau_full_scale_Nm
        if f == 0.5:
            ends = tau[np.argmax(theta)], tau[np.argmin(theta)]
            stiffness = float((ends[0] - ends[1]) / (2 * AMPLITUDE_rad))
            loss = float(np.trapezoid(tau, theta))
    return Rubber(effect, stiffness, loss)


def fitted(effect: dict[float, float]) -> Tiring:
    """The three numbers that leave least of the six published ones."""
    from scipy.optimize import least_squares

    def left(p: Array) -> Array:
        tiring = Tiring(*np.exp(p))
        pairs = [(figures(tiring, k, effect), (v[0], v[2])) for k, v in PUBLISHED.items()]
        return np.array([a - b for made, told in pairs for a, b in zip(made, told, strict=True)])

    low, high = np.log([1e-3, 10.0, 600.0]), np.log([0.5, 1e5, 1e6])
    starts = [np.log([0.1, n, r]) for n in (300.0, 3e3) for r in (1e4, 8e4)]
    done = [least_squares(left, s, bounds=(low, high)) for s in starts]
    return Tiring(*(float(x) for x in np.exp(min(done, key=lambda d: d.cost).x)))


@dataclass(frozen=True)
class ClinicDay:
    tiring: Tiring
    rubber: Rubber
    days: dict[str, tuple[Array, Array]]

    def rows(self) -> list[dict[str, Any]]:
        found = []
        for name, (error, share) in self.days.items():
            change, first, morning = PUBLISHED[name]
            left = 1 - share
            found.append(
                {
                    "intensity": name,
                    "change_percent": float(np.max(np.abs(error[:COUNT] - error[0]))),
                    "change_published_percent": change,
                    "first_percent": first,
                    "morning_percent": float(error[COUNT]),
                    "morning_published_percent": morning,
                    "error_percent": error.tolist(),
                    "stiffness_Nm_rad": (self.rubber.stiffness_Nm_rad * left).tolist(),
                    "loss_J": (self.rubber.loss_J * left).tolist(),
                }
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        more = {"tiring": self.tiring, "intensities": self.rows()}
        return {"simulated": True, "device": DEVICE} | more

    def table(self) -> list[str]:
        t = self.tiring
        lines = [
            f"Clinic day, simulated: {DEVICE}, {COUNT} sessions; errors in % of full scale",
            f"fitted to the published errors: at most {100 * t.most:.1f} % softer, over "
            f"{t.length_rad:.0f} rad of path, recovery in {t.recovery_s / 3600:.1f} h",
            f"{'intensity':10}{'change':>8}{'(publ.)':>9}{'12 h later':>12}{'(publ.)':>9}"
            f"{'stiffness':>11}{'loss':>8}",
        ]
        for r in self.rows():
            k, d = r["stiffness_Nm_rad"], r["loss_J"]
            lines.append(
                f"{r['intensity']:10}{r['change_percent']:8.2f}{r['change_published_percent']:9.2f}"
                f"{r['morning_percent']:12.2f}{r['morning_published_percent']:9.2f}"
                f"{k[COUNT - 1]:11.2f}{1e3 * d[COUNT - 1]:8.1f}"
            )
        k, d = self.rubber.stiffness_Nm_rad, self.rubber.loss_J
        lines.append(
            f"stiffness in Nm/rad and loss in mJ a cycle (10 deg, 0.5 Hz) after the last session; "
            f"fresh {k:.2f} and {1e3 * d:.1f}"
        )
        return lines

    @styled
    def figure(self) -> Figure:
        figure, (left, right) = new_figure(9.0, 3.6, ncols=2)
        at = np.arange(1, COUNT + 1)
        looks = (("-", MODEL), ("--", ROUNDING), (":", MEASURED))
        for r, (line, color) in zip(self.rows(), looks, strict=True):
            for axes, key in ((left, "stiffness_Nm_rad"), (right, "error_percent")):
                day = r[key]
                axes.plot(at, day[:COUNT], line, color=color, lw=1.6, label=r["intensity"])
                axes.plot(COUNT + 2, day[COUNT], "o", color=color, ms=5)
            most = r["first_percent"] + r["change_published_percent"]
            for x, y in ((COUNT + 2.7, r["morning_published_percent"]), (COUNT + 0.7, most)):
                right.plot(x, y, "x", color=color, ms=6)
        for axes, text in ((left, "stiffness, N·m/rad"), (right, "error of the sensor, % FSR")):
            axes.set_xlabel("session; dot: first of the next day")
            axes.set_title(f"{text}, simulated")
            axes.set_xticks([1, 4, 8, 12, 16, COUNT + 2], ["1", "4", "8", "12", "16", "+12 h"])
        left.legend()
        cross = right.plot([], [], "x", color=INK, label="published: largest, next morning")
        right.legend(handles=cross, loc="lower right")
        right.set_ylim(bottom=0)
        return figure


class ClinicDayStudy(Reproduction[ClinicDay]):
    """A clinic day: sixteen sessions tire the rubber, twelve hours let it recover (simulated)."""

    name = "clinic-day"
    title = "Repeated sessions: drift of stiffness and loss, recovery"

    def run(self, say: Callable[[str], None], folder: Path | None) -> ClinicDay:
        say("rubber")
        fresh = rubber(load_device(DEVICE))
        say("fitting")
        tiring = fitted(fresh.effect)
        days = {}
        for name, (_, first, _) in PUBLISHED.items():
            drift, share = sessions(tiring, name, fresh.effect)
            days[name] = errors(drift, first), share
        return ClinicDay(tiring, fresh, days)
