"""Every metric of one recording of anybody's, each with its settings and their band."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from esea_gen.errors import UserError
from esea_gen.language.ports import UNIT_SUFFIXES
from esea_gen.tables import SIMULATED, FileTable, read_table
from esea_gen.tables.table import listed
from esea_host import smoothness
from esea_host.interaction.metrics import Metric
from esea_host.interaction.recordings import Array
from esea_host.recording.export import longest_run
from esea_host.recording.log import TICK

# What a joint's angle is called, the surest first; boards call it ``theta_load_rad``.
ANGLES = ("theta_load", "theta", "angle", "knee")
TIMES = ("time", "t", "timestamp", "seconds")
POSITIONS = ("rad", "deg", "m", "cm", "mm", "px")
# No name of a position.
OTHER = re.compile("speed|veloc|omega|accel|jerk|torque|tau|force|current|status|count")
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Beside those of ports.
SUFFIXES = {f"_{u}": u for u in (*POSITIONS, *SECONDS)}
SUFFIXES |= {f"_{u}_s": f"{u}/s" for u in POSITIONS} | {f"_{u}_s2": f"{u}/s^2" for u in POSITIONS}
WORDS = {"\N{DEGREE SIGN}": "deg", "\N{DEGREE SIGN}/s": "deg/s", "degrees": "deg", "radians": "rad"}
WORDS |= {"sec": "s", "seconds": "s", "msec": "ms", "milliseconds": "ms", "\N{MICRO SIGN}s": "us"}


@dataclass(frozen=True)
class NamedColumn:
    """A column: its name in the file, without a unit in brackets, and its unit, if it names one."""

    column: str
    name: str
    unit: str | None

    @classmethod
    def of(cls, column: str) -> NamedColumn:
        """The unit in brackets, or a unit as the last part of the name."""
        cut = column.rfind({"]": "[", ")": "("}.get(column[-1:], "\n"))
        name, unit = column[:cut].rstrip(), column[cut + 1 : -1].strip()
        if cut > 0 and name and unit and not unit.isdigit():  # else an index
            return cls(column, name, WORDS.get(unit, unit))
        known = UNIT_SUFFIXES | SUFFIXES
        ends = [s for s in known if column.endswith(s) and s.startswith("_")]
        return cls(column, column, known[max(ends, key=len)] if ends else None)

    @property
    def stem(self) -> str:
        """Its name without its unit, in lower case."""
        unit = (self.unit or "").replace("^", "").replace("/", "_")
        last = re.split(r"[./]", self.name)[-1].lower()  # of a struct or group
        return last.removesuffix(f"_{unit}") if unit else last

    @property
    def is_position(self) -> bool:
        return self.unit in POSITIONS

    @property
    def is_speed(self) -> bool:
        return (self.unit or "").removesuffix("/s") in POSITIONS and not self.is_position

    def __str__(self) -> str:
        return (
            self.column if self.column != self.name else f"{self.name} [{self.unit or 'no unit'}]"
        )


@dataclass(frozen=True)
class OwnSmoothness:
    """Results and bands of one file; refused: metrics without an answer, and why."""

    file: str
    simulated: bool
    column: NamedColumn
    time: NamedColumn
    read: tuple[str, ...]
    resampling: smoothness.Resampling | None
    results: tuple[tuple[smoothness.SmoothnessResult, smoothness.Band], ...]
    refused: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "file": self.file,
            "simulated": self.simulated,
            "column": self.column.column,
            "unit": self.column.unit,
            "time": self.time.column,
            "read": list(self.read),
            "resampled": None if self.resampling is None else self.resampling.to_dict(),
            "metrics": [r.to_dict() | {"band": b} for r, b in self.results],
            "refused": list(self.refused),
        }

    def lines(self) -> list[str]:
        first = self.results[0][0]
        whose = f"{self.file}{', SIMULATED' if self.simulated else ''}"
        out = [*self.read]
        if self.resampling is not None:
            out.append(self.resampling.line())
        out.append(
            f"{whose}: {self.column} over {self.time}: {first.duration_s:g} s at {first.fs_Hz:g} "
            f"Hz; {first.filter}"
        )
        for r, b in self.results:
            unit = "" if r.unit == "1" else f" {r.unit}"
            cut = "" if r.cutoff_Hz is None else f", up to {r.cutoff_Hz:g} Hz"
            over = ", ".join(b.grid)
            out.append(
                f"  {r.metric:18s} {r.value:10.5g}{unit}  ({r.convention}, {r.sign}{cut};  "
                f"{b.low:.4g} to {b.high:.4g} over {over})"
            )
        return out + [f"  no answer: {r}" for r in self.refused]


def measure_file(
    path: Path,
    column: str | None = None,
    time: str | None = None,
    stop_Hz: float = 4.0,
    last_s: float | None = None,
    resample_Hz: float | None = None,
    time_unit: str | None = None,
) -> OwnSmoothness:
    table = read_table(path)
    over = _time(table, time, time_unit)
    moved = _position(table, column, over)
    read = [] if column else [f"column chosen: {moved}; --column names another"]
    if over.unit is None:
        read.append(f"the time '{over.column}' names no unit: read as seconds")
    table = longest_run(table.timed(over.column))
    t = table.numbers(over.column) * SECONDS[over.unit or "s"]
    x = table.numbers(moved.column, holes=resample_Hz is not None)
    read.append(table.report())
    made = None
    try:
        if resample_Hz is not None:
            made = smoothness.resampled(t, x, resample_Hz, stop_Hz)
            t, x = made.time_s, made.values
        fs_Hz = smoothness.steady_rate(t)
        x, unit = _integrated(x, fs_Hz, moved, read)

        def chain(stop: float) -> smoothness.Derivatives:
            found = smoothness.derivatives(x, fs_Hz, stop, time_s=t)
            return found if last_s is None else found.last(last_s)

        others = (s for s in (0.8 * stop_Hz, 1.5 * stop_Hz) if s < fs_Hz / 2)
        chains = {stop_Hz: chain(stop_Hz)} | {s: chain(s) for s in others}
        results, refused = _measured(path, chains, stop_Hz, f"{unit}/s^2")
    except smoothness.NoAnswerError as error:
        fix = error.fix
        if error.reason == "gap" and resample_Hz is None:
            length_s = float(np.ptp(t))
            rate_Hz = (len(t) - 1) / length_s if length_s > 0 else 100.0
            fix += f" --resample {rate_Hz:.3g} interpolates, and reports what it did."
        if error.reason == "cutoff" and over.unit is None:
            fix += f" If '{over.column}' is in milliseconds, give --time-unit ms."
        raise UserError(f"{path.name}: {error.what}", fix) from None
    return OwnSmoothness(
        path.name, table.simulated, moved, over, tuple(read), made, results, refused
    )


def _named(table: FileTable, wanted: str) -> NamedColumn:
    fits = [q for q in map(NamedColumn.of, table.names) if wanted in (q.column, q.name)]
    if len(fits) != 1:
        raise UserError(
            f"{table.name}: "
            + (
                f"'{wanted}' may be {listed([q.column for q in fits])}."
                if fits
                else f"there is no column '{wanted}'; the columns are {listed(table.names)}."
            ),
            "Give the name as the header has it.",
        )
    return fits[0]


def _time(table: FileTable, wanted: str | None, unit: str | None) -> NamedColumn:
    if wanted is not None:
        found = _named(table, wanted)
    else:
        named = (q for q in map(NamedColumn.of, table.names) if q.stem in TIMES)
        fits = [q for q in named if q.unit is None or q.unit in SECONDS]
        if len(fits) != 1:
            raise UserError(
                f"{table.name}: {'several columns' if fits else 'no column'} of the time: "
                f"{listed([q.column for q in fits] or table.names)}.",
                "Name it with --time.",
            )
        found = fits[0]
    if unit is not None:
        found = replace(found, unit=unit)
    if found.unit not in (*SECONDS, None):
        raise UserError(
            f"{table.name}: the time '{found.column}' has the unit {found.unit}.",
            f"Give a column in {', '.join(SECONDS)}.",
        )
    return found


def _position(table: FileTable, wanted: str | None, over: NamedColumn) -> NamedColumn:
    apart = ("", over.column, TICK, SIMULATED)
    others = [q for q in map(NamedColumn.of, table.names) if q.column not in apart]
    if wanted is not None:
        others = [_named(table, wanted)]
    positions = [q for q in others if q.is_position]
    for stem in ANGLES:
        fits = [q for q in positions if q.stem == stem]
        if len(fits) == 1:
            return fits[0]
    bare = [q for q in others if q.unit is None and not OTHER.search(q.name.lower())]
    fits = positions or [q for q in others if q.is_speed] or bare
    if len(fits) != 1:
        raise UserError(
            f"{table.name}: {'several columns' if fits else 'no column'} may be the movement: "
            f"{listed([q.column for q in fits or others])}.",
            "Name one with --column: an angle, a position, or their speed, with a unit (rad, deg, "
            "mm, px, deg/s) behind its name.",
        )
    return fits[0]


def _integrated(x: Array, fs_Hz: float, moved: NamedColumn, read: list[str]) -> tuple[Array, str]:
    # Position and its unit; a speed's integral is one.
    if moved.unit is None:
        read.append(f"'{moved.column}' names no unit: taken as an angle or position")
        return x, f"({moved.name})"
    if not moved.is_speed:
        return x, moved.unit
    read.append(f"'{moved.column}' is a speed: integrated once")
    return cumulative_trapezoid(x, dx=1 / fs_Hz, initial=0.0), moved.unit.removesuffix("/s")


# Metric, convention, and its name in the list of refusals.
WANTED = (
    *(("RMS acceleration", "", "rms"), ("VDV", "iso2631", "vdv"), ("VDV", "thesis", "vdv")),
    *(
        (name, convention, kind)
        for name, kind in (("LDLJ", "ldlj"), ("dimensionless jerk", "jerk"), ("SPARC", "sparc"))
        for convention in ("reference", "thesis")
    ),
    *(("submovements", "", "submovements"), ("peak-speed ratio", "", "ratio")),
)


def _measured(
    path: Path, chains: dict[float, smoothness.Derivatives], stop_Hz: float, unit: str
) -> tuple[tuple[tuple[smoothness.SmoothnessResult, smoothness.Band], ...], tuple[str, ...]]:
    results, refused = [], []
    for name, convention, kind in WANTED:
        metric, more = Metric(name, convention), {"unit": unit} if kind in ("rms", "vdv") else {}

        def measure(
            stop_Hz: float = stop_Hz, metric: Metric = metric, more: Any = more, **settings: Any
        ) -> smoothness.SmoothnessResult:
            return metric.measure(chains[stop_Hz], **more, **settings)

        grid: dict[str, tuple[float, ...]] = {"stop_Hz": tuple(chains)}
        if kind == "sparc":
            grid |= {"cutoff_Hz": (4.0, 10.0)}
        if kind in ("sparc", "submovements"):
            grid |= {"threshold": (0.02, 0.05, 0.1)}
        try:
            results.append((measure(), smoothness.sensitivity_band(measure, **grid)))
        except smoothness.NoAnswerError as error:
            refused.append(f"{kind} ({convention}): {error}")
    if not results:
        raise UserError(f"{path.name}: {refused[0]}", "Check the recording.")
    return tuple(results), tuple(refused)
