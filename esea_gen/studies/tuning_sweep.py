"""Tuning on the virtual exoskeleton: effect of a parameter, and the value to use.

Without a named parameter it is the thesis' procedure for sliding mode control (5.4.1.2), on its
tuning case: the boundary layer phi as narrow as the surface allows without leaving it, then the
slope lambda with phi fixed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, Unpack

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from esea_gen.analysis.campaign import Running, run_cases
from esea_gen.analysis.journal import Configuration, Result, rooms_digest
from esea_gen.analysis.plots import cell_edges, frequency_axis, new_figure, styled
from esea_gen.device import Device
from esea_gen.devices.numbers import Quantity, toml_entry
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError, choose
from esea_gen.files import plain
from esea_gen.language.ports import Array, Tunable
from esea_gen.model.sensing import of_axis
from esea_gen.plotting import INK, MEASURED, MODEL, ROUNDING
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import Case, Scale, Setting
from esea_gen.twin.controllers import controller_device, controller_system, largest_torque_Nm
from esea_gen.twin.judge import ENDED, ROUGH_HEADS, ROUGHNESS, judge, rough_cells
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.people import PLANT_NAMES
from esea_gen.twin.run import run_case

PHI, LAMBDA = "smc.phi_rad_s", "smc.lambda_1_s"
SOFTENING = "smc.softening"


@dataclass(frozen=True)
class Trial:
    value: float
    rms_Nm: float
    overshoot_percent: float
    reach_percent: float  # 100: the desired amplitude, at the extremes on average
    command_above_20Hz_Nm: float
    noise_above_5Hz_Nm: float
    rate_limited_share: float
    surface_rad_s: float
    outside_share: float  # of the time with abs(s) > phi; NaN without a surface
    limited_share: float
    unusable: str = ""  # why the value cannot be taken


def extremes(case: Case, run: ClosedLoopRun) -> tuple[float, float]:
    """How far the true torque goes at the extremes of a sinusoid."""
    w = case.trajectory.window
    desired, true = case.trajectory.tau_desired_Nm[w], run.plant["tau_e_Nm"][w]
    amplitude = float(np.max(np.abs(desired)))
    # From one zero of the desired torque to the next, an eighth of a cycle late: the extreme then
    # lies inside for any lag from -45 to 135 deg.  What is left at both ends is no whole one.
    sign = np.sign(np.where(desired == 0, 1e-300, desired))
    zeros = np.flatnonzero(np.diff(sign)) + 1
    late = round(0.25 * float(np.mean(np.diff(zeros))))
    peaks = np.array(
        [
            np.max(true[a + late : b + late] * sign[a])
            for a, b in pairwise(zeros)
            if b + late <= len(true)
        ]
    )
    reach = 100 * peaks / amplitude
    return max(0.0, float(np.max(reach)) - 100), float(np.mean(reach))


def run_trial(
    parameter: str, value: float, held: Mapping[str, float], controller: str, plant: str, seed: int
) -> dict[str, float]:
    """Run and judge one value, in a worker."""
    # Gains that swing are to be seen doing it, not softened.
    known = tunables_of(controller)
    softening, phi, limit = moved(controller, SOFTENING, PHI, "limits.u_max_Nm")
    unsoftened = {softening: 0.0} if softening in known else {}
    tunables: dict[str, dict[str, float]] = {}
    settings = {**unsoftened, **held, parameter: value}
    for name, x in settings.items():
        instance, _, key = name.partition(".")
        tunables.setdefault(instance, {})[key] = x
    device = controller_device(controller)
    case = tuning_case(controller)
    run = run_case(case, Setting(controller, plant, "none", tunables=tunables), seed)
    u_max_Nm = settings.get(limit, largest_torque_Nm(device))
    figures = judge(case, run, u_max_Nm, Scale.of(device).torque)
    over, reach = extremes(case, run)
    out = {
        "value": value,
        "rms_Nm": figures["rms_true_Nm"],
        "overshoot_percent": over,
        "reach_percent": reach,
        "limited_share": figures["limited_share"],
    } | {k: figures[k] for k in (*ROUGHNESS, *ENDED)}
    if "surface_rad_s" in run.controller:
        s = np.abs(run.controller["surface_rad_s"][case.trajectory.window])
        outside = s > settings.get(phi, known[phi].default)
        out |= {"surface_rad_s": float(s.max()), "outside_share": float(np.mean(outside))}
    return out


def tuning_case(controller: str) -> Case:
    (case,) = TuningCase().of(controller_device(controller)).cases_run()
    return case


def moved(controller: str, *names: str) -> list[str]:
    """Names of tunables, of the axis that is moved where there are several."""
    axis, parts = controller_device(controller).axes[0], [n.partition(".") for n in names]
    return [f"{of_axis(instance, axis)}.{key}" for instance, _, key in parts]


def tunables_of(controller: str) -> dict[str, Tunable]:
    return {f"{i}.{t.name}": t for i, t in controller_system(controller).tunables}


FAILED = "failed: "
_FIGURES = tuple(f.name for f in fields(Trial) if f.name not in ("value", "unusable"))


def trial_of(result: Result) -> Trial:
    nothing = dict.fromkeys(_FIGURES, math.nan)
    if result.values is None:
        # The class of the error says nothing to who reads the table.
        reason = " ".join(result.failure.removeprefix("esea_gen.errors.UserError: ").split())
        return Trial(result.case["value"], **nothing, unusable=FAILED + reason)
    figures = {k: v for k, v in result.values.items() if k not in ENDED}
    why = ", ".join(text for key, text in ENDED.items() if result.values[key])
    return Trial(**(nothing | figures), unusable=why)


# A value whose error is within this of the least is as good: the smallest such is taken.
NEAR = 0.1
# Percent of overshoot above the least one that a smaller error does not pay for.
OVERSHOOT_ROOM = 5.0
# Values with more than this times the least error do not say what the least overshoot is: a torque
# that is not followed overshoots nothing.
FOLLOWS = 2.0


def _nothing(trials: Sequence[Trial]) -> str:
    """Why no trial is usable; the reason where there is but one."""
    reasons = {t.unusable for t in trials}
    return "no value is usable" + (f", {reasons.pop()}" if len(reasons) == 1 else "")


def choose_layer(trials: Sequence[Trial]) -> tuple[Trial | None, str]:
    """The narrowest boundary layer that the surface never leaves."""
    usable = [t for t in trials if not t.unusable]
    if not usable:
        return None, _nothing(trials)
    good = [t for t in usable if t.surface_rad_s <= t.value]
    if not good:
        return None, "the surface leaves every layer that was tried: try wider ones"
    best = min(good, key=lambda t: t.value)
    below = [t for t in trials if t.value < best.value]
    reason = f"the surface stays within it (largest |s| {best.surface_rad_s:.3g} rad/s)"
    if below:
        worst = max(below, key=lambda t: t.value)
        left = worst.unusable or f"is left for {100 * worst.outside_share:.2g} % of the time"
        reason += f"; the next narrower one, {worst.value:g}, {left}"
    return best, reason


def choose_error(trials: Sequence[Trial]) -> tuple[Trial | None, str]:
    """The smallest value whose error is near the least, without overshoot to pay for it."""
    usable = [t for t in trials if not t.unusable]
    if not usable:
        return None, _nothing(trials)
    least = min(t.rms_Nm for t in usable)
    follow = [t for t in usable if t.rms_Nm <= FOLLOWS * least]
    room = min(t.overshoot_percent for t in follow) + OVERSHOOT_ROOM
    calm = [t for t in follow if t.overshoot_percent <= room]
    best = min(t.rms_Nm for t in calm)
    chosen = min((t for t in calm if t.rms_Nm <= (1 + NEAR) * best), key=lambda t: t.value)
    reason = (
        f"RMS error {chosen.rms_Nm:.3g} Nm, within {100 * NEAR:.0f} % of the least that needs no "
        f"more than {room:.3g} % overshoot ({best:.3g} Nm)"
    )
    above = [t for t in trials if t.value > chosen.value]
    if above:
        last = max(above, key=lambda t: t.value)
        end = last.unusable or (
            f"{last.rms_Nm:.3g} Nm and {last.overshoot_percent:.3g} % overshoot"
        )
        reason += f"; at {last.value:g}: {end}"
    return chosen, reason


PHI_VALUES = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)
LAMBDA_VALUES = (3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.0, 19.0, 21.0, 23.0, 25.0)
FEWEST = 2
# Where a tunable's default stands in the device file.
HOMES = {
    PHI: ("sliding_mode", "phi_rad_s"),
    LAMBDA: ("sliding_mode", "lambda_1_s"),
    "drive.bandwidth_1_s": ("disturbance", "drive_1_s"),
    "human.bandwidth_1_s": ("disturbance", "human_1_s"),
    "human.decay_s": ("disturbance", "decay_s"),
    "motor_rate.cutoff_Hz": ("joint", "motor_velocity_Hz"),
    "load_rate.cutoff_Hz": ("joint", "load_velocity_Hz"),
    "predictive.Q": ("predictive", "Q"),
    "predictive.R": ("predictive", "R"),
    "set_rate.cutoff_Hz": ("sliding_mode", "setpoint_filter_Hz"),
    "velocity.bandwidth_Hz": ("velocity", "bandwidth_Hz"),
}


@dataclass(frozen=True)
class TunableSweep:
    parameter: str
    held: Mapping[str, float]
    trials: tuple[Trial, ...]
    chosen: Trial | None
    reason: str

    @property
    def ran(self) -> bool:
        return any(not t.unusable.startswith(FAILED) for t in self.trials)

    def to_dict(self) -> dict[str, Any]:
        chosen = None if self.chosen is None else self.chosen.value
        found: dict[str, Any] = plain(vars(self) | {"chosen": chosen}, null=True)
        return found

    def table(self) -> list[str]:
        held = ", ".join(f"{k} = {v:g}" for k, v in self.held.items())
        heads = ("RMS Nm", "overshoot", "reach", "max |s|", "|s| > phi", "limited", *ROUGH_HEADS)
        lines = [
            f"{self.parameter}{f', {held} held' if held else ''}",
            f"{'value':>10}" + "".join(f"{h:>12}" for h in heads),
        ]
        columns = (
            ("rms_Nm", 1, ".4f", ""),
            ("overshoot_percent", 1, ".1f", " %"),
            ("reach_percent", 1, ".1f", " %"),
            ("surface_rad_s", 1, ".3f", ""),
            ("outside_share", 100, ".2f", " %"),
            ("limited_share", 100, ".1f", " %"),
        )
        for t in self.trials:
            cells = [_cell(k * getattr(t, n), spec, unit) for n, k, spec, unit in columns]
            cells += rough_cells(vars(t))
            mark = " <" if t is self.chosen else ""
            line = f"{t.value:>10g}" + "".join(f"{c:>12}" for c in cells)
            word, colon, reason = t.unusable.partition(": ")
            lines.append(f"{line}{mark}  {word.upper()}{colon}{reason}".rstrip())
        value = "none" if self.chosen is None else f"{self.chosen.value:g}"
        return [*lines, f"chosen: {value}; {self.reason}"]


def _cell(value: float, spec: str, unit: str) -> str:
    return "-" if math.isnan(value) else f"{value:{spec}}{unit}"


@dataclass(frozen=True)
class Tuning:
    controller: str
    plant: str
    seed: int
    sweeps: tuple[TunableSweep, ...]
    configuration: Configuration

    def to_dict(self) -> dict[str, Any]:
        return {
            "simulated": True,
            "controller": self.controller,
            "plant": self.plant,
            "seed": self.seed,
            "case": tuning_case(self.controller).name,
            "configuration": self.configuration.parts,
            "sweeps": [s.to_dict() for s in self.sweeps],
            "device_file": self.device_lines(),
        }

    def device_lines(self) -> list[str]:
        case = tuning_case(self.controller).name
        source = f"tuned on the virtual exoskeleton, plant {self.plant}, {case}"
        by_section: dict[str, list[str]] = {}
        homes = dict(zip(moved(self.controller, *HOMES), HOMES.values(), strict=True))
        for s in self.sweeps:
            if s.chosen is not None and s.parameter in homes:
                section, key = homes[s.parameter]
                number = Quantity(value=s.chosen.value, status="assumed", source=source)
                by_section.setdefault(section, []).append(toml_entry(key, number))
        return [line for name, lines in by_section.items() for line in (f"[{name}]", *lines)]

    def table(self) -> list[str]:
        case = tuning_case(self.controller).name
        lines = [f"Simulated. {self.controller} tuned on plant {self.plant}: {case}, output fixed"]
        for s in self.sweeps:
            lines += s.table()
        if written := self.device_lines():
            return [*lines, "In the device file:", *written]
        chosen = [(s.parameter, s.chosen.value) for s in self.sweeps if s.chosen]
        return [*lines, *(f"At run time: {name} = {value:g}." for name, value in chosen)]

    def figure(self) -> Figure:
        """Error, overshoot and roughness over the parameter that was swept last."""
        sweep = self.sweeps[-1]
        gone = (math.nan,) * 3
        rows = [
            gone if t.unusable else (t.rms_Nm, t.overshoot_percent, 1e3 * t.command_above_20Hz_Nm)
            for t in sweep.trials
        ]
        chosen = None if sweep.chosen is None else sweep.chosen.value
        values = np.array([t.value for t in sweep.trials])
        return tuning_trade(values, np.array(rows).T, parameter=sweep.parameter, chosen=chosen)


def _values(device: Device, name: str, tunable: Tunable, values: Sequence[float]) -> Array:
    array = np.unique(np.asarray(values, dtype=float))
    if not np.all(np.isfinite(array)) or len(array) < FEWEST:
        shown = ", ".join(f"{v:g}" for v in values) or "none"
        enough = len(array) >= FEWEST
        raise UserError(
            f"{name}: values {shown}"
            + (": not all finite." if enough else f": {FEWEST} or more are needed to compare."),
            f"Give {FEWEST} or more different finite numbers from {tunable.low:g} to "
            f"{tunable.high:g}.",
        )
    taken = np.array([tunable.taken(float(v)) for v in array])
    outside = array[(taken < tunable.low) | (taken > tunable.high)]
    if len(outside):
        raise UserError(
            f"{name} = {', '.join(f'{v:g}' for v in outside)} is outside {tunable.low:g} to "
            f"{tunable.high:g}, what {device.origin} allows ({tunable.meaning}).",
            "Give values in that range.",
        )
    return array


def _parameter(controller: str, asked: str) -> str:
    known = tunables_of(controller)
    same = [n for n in known if asked in (n, n.partition(".")[2])]
    if len(same) == 1:
        return same[0]
    choose(f"tunable of {controller}", asked, same or known)
    return asked


def tune(
    controller: str = "smc",
    plant: str = "real",
    *,
    parameter: str | None = None,
    values: Sequence[float] = (),
    seed: int = 0,
    **how: Unpack[Running],
) -> Tuning:
    choose("plant", plant, PLANT_NAMES)
    device = controller_device(controller)
    known, phi_name, slope = tunables_of(controller), *moved(controller, PHI, LAMBDA)
    hashes = {"controller_hash": device_hash(device), "code": rooms_digest()}
    configuration = Configuration(hashes)

    def sweep(name: str, tried: Sequence[float], held: Mapping[str, float]) -> TunableSweep:
        cases = [
            {"parameter": name, "value": float(v), "held": dict(held)}
            | {"controller": controller, "plant": plant, "seed": seed}
            for v in _values(device, name, known[name], tried)
        ]
        done = run_cases(run_trial, cases, configuration=configuration, **how)
        trials = tuple(trial_of(r) for r in done.results)
        chosen, reason = (choose_layer if name == phi_name else choose_error)(trials)
        usable = [(t.rms_Nm, t.command_above_20Hz_Nm) for t in trials if not t.unusable]
        if len(usable) > len(set(usable)) == 1:
            chosen, reason = None, "it makes no difference in this case"
        return TunableSweep(name, held, trials, chosen, reason)

    def made(*sweeps: TunableSweep) -> Tuning:
        return Tuning(controller, plant, seed, sweeps, configuration)

    if parameter is not None:
        return made(sweep(_parameter(controller, parameter), values, {}))
    if values:
        raise UserError("Values are given, but no parameter.", "Name it with --parameter.")
    if not {phi_name, slope} <= known.keys():
        raise UserError(
            f"The controller {controller} has no {phi_name} and {slope} to tune.",
            f"Name a --parameter; it has {', '.join(known)}.",
        )

    def inside(name: str, row: Sequence[float]) -> list[float]:
        t = known[name]
        return sorted({v for v in (*row, t.default) if t.low <= v <= t.high})

    layer = sweep(phi_name, inside(phi_name, PHI_VALUES), {})
    # No layer wide enough: the slope is then tuned with the one in use, and the table says so.
    phi = layer.chosen.value if layer.chosen else known[phi_name].default
    return made(layer, sweep(slope, inside(slope, LAMBDA_VALUES), {phi_name: phi}))


ROWS = (
    ("RMS error,\nN·m", MODEL),
    ("overshoot, %", MEASURED),
    ("command above\n20 Hz, mN·m", ROUNDING),
)


@styled
def tuning_trade(x: Array, figures: Array, *, parameter: str, chosen: float | None) -> Figure:
    """Effect of a parameter: the rows of ``figures``, NaN where a value is unusable."""
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
