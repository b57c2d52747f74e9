"""Every metric of one recording of anybody's, each with its settings and their band."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_host.interaction.design import read_numbers
from esea_host.interaction.recordings import is_simulated, rate_of
from esea_host.smoothness import (
    Band,
    Derivatives,
    NoAnswerError,
    SmoothnessResult,
    derivatives,
    dimensionless_jerk,
    ldlj,
    peak_speed_ratio,
    rms_acceleration,
    sensitivity_band,
    sparc,
    submovements,
    vdv,
)


@dataclass(frozen=True)
class OwnSmoothness:
    """Results and bands of one file; refused: metrics without an answer, and why."""

    file: str
    simulated: bool
    results: tuple[tuple[SmoothnessResult, Band], ...]
    refused: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "file": self.file,
            "simulated": self.simulated,
            "metrics": [r.to_dict() | {"band": b.to_dict()} for r, b in self.results],
            "refused": list(self.refused),
        }

    def lines(self) -> list[str]:
        """For a terminal."""
        first = self.results[0][0]
        whose = f"{self.file}{', SIMULATED' if self.simulated else ''}"
        out = [f"{whose}: {first.duration_s:g} s at {first.fs_Hz:g} Hz; {first.filter}"]
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
    path: Path, column: str, time: str, stop_Hz: float, last_s: float | None
) -> OwnSmoothness:
    """Metrics of a column of a CSV file."""
    t, x = read_numbers(path, (time, column))
    unit = column.rsplit("_", 1)[-1] if "_" in column else "unit"
    try:
        fs_Hz = rate_of(t)

        def chain(stop: float) -> Derivatives:
            found = derivatives(x, fs_Hz, stop, time_s=t)
            return found if last_s is None else found.last(last_s)

        others = (s for s in (0.8 * stop_Hz, 1.5 * stop_Hz) if s < fs_Hz / 2)
        chains = {stop_Hz: chain(stop_Hz)} | {s: chain(s) for s in others}
        return _measured(path, chains, stop_Hz, f"{unit}/s^2")
    except NoAnswerError as error:
        raise UserError(f"{path.name}: {error.what}", error.fix) from None


def _measured(
    path: Path, chains: dict[float, Derivatives], stop_Hz: float, unit: str
) -> OwnSmoothness:
    def of(kind: str, convention: str = "") -> Any:
        def measure(stop_Hz: float = stop_Hz, **settings: Any) -> SmoothnessResult:
            d = chains[stop_Hz]
            more = settings | {"processing": d.processing}
            match kind:
                case "rms":
                    return rms_acceleration(d.acceleration, d.fs_Hz, unit=unit, **more)
                case "vdv":
                    return vdv(d.acceleration, d.fs_Hz, convention, unit=unit, **more)
                case "ldlj":
                    return ldlj(d.velocity, d.fs_Hz, convention, jerk=d.jerk, **more)
                case "jerk":
                    return dimensionless_jerk(d.velocity, d.fs_Hz, convention, jerk=d.jerk, **more)
                case "sparc":
                    return sparc(d.speed, d.fs_Hz, convention, **more)
                case "submovements":
                    return submovements(d.speed, d.fs_Hz, **more)
                case _:
                    return peak_speed_ratio(d.speed, d.fs_Hz, **more)

        return measure

    both = ("reference", "thesis")
    wanted = [("rms", ""), ("vdv", "iso2631"), ("vdv", "thesis")]
    wanted += [(kind, c) for kind in ("ldlj", "jerk", "sparc") for c in both]
    wanted += [("submovements", ""), ("ratio", "")]
    results, refused = [], []
    for kind, convention in wanted:
        measure = of(kind, convention)
        grid: dict[str, tuple[float, ...]] = {"stop_Hz": tuple(chains)}
        if kind == "sparc":
            grid |= {"cutoff_Hz": (4.0, 10.0), "threshold": (0.02, 0.05, 0.1)}
        if kind == "submovements":
            grid |= {"threshold": (0.02, 0.05, 0.1)}
        try:
            results.append((measure(), sensitivity_band(measure, **grid)))
        except NoAnswerError as error:
            refused.append(f"{kind} ({convention}): {error}")
    if not results:
        raise UserError(f"{path.name}: {refused[0]}", "Look at the recording.")
    return OwnSmoothness(path.name, is_simulated(path), tuple(results), tuple(refused))
