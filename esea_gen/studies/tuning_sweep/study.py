"""Tuning against the virtual exoskeleton: what a parameter trades, and which value to take.

Without a named parameter it is the thesis' procedure for sliding mode control (5.4.1.2), on its
tuning case: the boundary layer phi as narrow as the surface allows without leaving it, then the
slope lambda with phi held.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.analysis.campaign import Workers, run_cases
from esea_gen.analysis.journal import Configuration, rooms_digest
from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError, choose
from esea_gen.files import plain
from esea_gen.language.ports import Array, Tunable
from esea_gen.studies.registry import Study
from esea_gen.studies.tracking import TuningCase
from esea_gen.studies.tuning_sweep.choice import choose_error, choose_layer
from esea_gen.studies.tuning_sweep.trial import (
    FAILED,
    LAMBDA,
    PHI,
    Trial,
    run_trial,
    trial_of,
    tunables_of,
)
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import PLANT_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        heads = ("RMS Nm", "overshoot", "reach", "rough Nm/s", "max |s|", "|s| > phi", "limited")
        lines = [
            f"{self.parameter}{f', {held} held' if held else ''}",
            f"{'value':>10}" + "".join(f"{h:>11}" for h in heads),
        ]
        columns = (
            ("rms_Nm", 1, ".4f", ""),
            ("overshoot_percent", 1, ".1f", " %"),
            ("reach_percent", 1, ".1f", " %"),
            ("roughness_Nm_s", 1, ".2f", ""),
            ("surface_rad_s", 1, ".3f", ""),
            ("outside_share", 100, ".2f", " %"),
            ("limited_share", 100, ".1f", " %"),
        )
        for t in self.trials:
            cells = [_cell(k * getattr(t, n), spec, unit) for n, k, spec, unit in columns]
            mark = " <" if t is self.chosen else ""
            line = f"{t.value:>10g}" + "".join(f"{c:>11}" for c in cells)
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
            "controller": self.controller,
            "plant": self.plant,
            "seed": self.seed,
            "case": TuningCase().cases()[0].name,
            "configuration": self.configuration.parts,
            "sweeps": [s.to_dict() for s in self.sweeps],
            "device_file": self.device_lines(),
        }

    def device_lines(self) -> list[str]:
        """What to write in a device file to have the chosen values, section by section."""
        case = TuningCase().cases()[0].name
        source = f"tuned on the virtual exoskeleton, plant {self.plant}, {case}"
        by_section: dict[str, list[str]] = {}
        for s in self.sweeps:
            if s.chosen is None or s.parameter not in HOMES:
                continue
            section, key = HOMES[s.parameter]
            by_section.setdefault(section, []).append(
                f'{key} = {{ value = {s.chosen.value!r}, status = "assumed", source = "{source}" }}'
            )
        return [line for name, lines in by_section.items() for line in (f"[{name}]", *lines)]

    def table(self) -> list[str]:
        case = TuningCase().cases()[0].name
        lines = [f"Tuning of {self.controller} on plant {self.plant}: {case}, output fixed"]
        for s in self.sweeps:
            lines += s.table()
        written = self.device_lines()
        if written:
            lines += ["In the device file:", *written]
        for s in self.sweeps:
            if s.chosen is not None and s.parameter not in HOMES:
                lines.append(
                    f"{s.parameter} has no key in the device file: set it at run time to "
                    f"{s.chosen.value:g}."
                )
        return lines

    def figure(self) -> Figure:
        """Error, overshoot and roughness over the parameter that was swept last."""
        from esea_gen.studies.tuning_sweep.figure import tuning_trade

        sweep = self.sweeps[-1]
        gone = (math.nan,) * 3
        rows = [
            gone if t.unusable else (t.rms_Nm, t.overshoot_percent, t.roughness_Nm_s)
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
            "Give values inside.",
        )
    return array


def _parameter(controller: str, asked: str) -> str:
    known = tunables_of(controller)
    if asked in known:
        return asked
    same = [n for n in known if n.partition(".")[2] == asked]
    if len(same) == 1:
        return same[0]
    if same:
        raise UserError(f"Several Blocks have a tunable {asked}.", f"Choose {' or '.join(same)}.")
    raise UserError(
        f"The controller {controller} has no tunable '{asked}'.",
        f"Choose from {', '.join(known)}.",
    )


def tune(
    controller: str = "smc",
    plant: str = "real",
    *,
    parameter: str | None = None,
    values: Sequence[float] = (),
    seed: int = 0,
    workers: int | Workers = 1,
    progress: Callable[[int, int, int], None] | None = None,
) -> Tuning:
    """Sweep parameters against the virtual exoskeleton and choose."""
    choose("plant", plant, PLANT_NAMES)
    if seed < 0:
        raise UserError(f"seed = {seed}.", "Give 0 or more.")
    device = controller_device(controller)
    known = tunables_of(controller)
    configuration = Configuration(
        {
            "controller_hash": device_hash(device),
            "code": rooms_digest(),
        }
    )

    def sweep(name: str, tried: Sequence[float], held: Mapping[str, float]) -> TunableSweep:
        cases = [
            {"parameter": name, "value": float(v), "held": dict(held)}
            | {"controller": controller, "plant": plant, "seed": seed}
            for v in _values(device, name, known[name], tried)
        ]
        done = run_cases(
            run_trial, cases, configuration=configuration, workers=workers, progress=progress
        )
        trials = tuple(trial_of(r) for r in done.results)
        chosen, reason = (choose_layer if name == PHI else choose_error)(trials)
        return TunableSweep(name, held, trials, chosen, reason)

    def made(*sweeps: TunableSweep) -> Tuning:
        return Tuning(controller, plant, seed, sweeps, configuration)

    if parameter is not None:
        return made(sweep(_parameter(controller, parameter), values, {}))
    if values:
        raise UserError("Values are given, but no parameter.", "Name it with --parameter.")
    if PHI not in known or LAMBDA not in known:
        raise UserError(
            f"The controller {controller} has no {PHI} and {LAMBDA} to tune.",
            f"Name a --parameter; it has {', '.join(known)}.",
        )

    def inside(name: str, row: Sequence[float]) -> list[float]:
        t = known[name]
        return sorted({v for v in (*row, t.default) if t.low <= v <= t.high})

    layer = sweep(PHI, inside(PHI, PHI_VALUES), {})
    # No layer wide enough: the slope is then tuned with the one in use, and the table says so.
    phi = layer.chosen.value if layer.chosen else known[PHI].default
    return made(layer, sweep(LAMBDA, inside(LAMBDA, LAMBDA_VALUES), {PHI: phi}))


class TuningSweep(Study):
    """Sweep tunables in the tuning case: error, overshoot, roughness; choose, and say why."""

    name = "tune"
    title = "What a tunable trades"
