"""Errors by class of torque and rate, and their distribution."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.device import Device
from esea_gen.identify.verdict import RATE_EDGES, TORQUE_EDGES, label
from esea_gen.language.ports import Array
from esea_gen.model.sensing import of_axis
from esea_gen.studies.uncertainty.motions import (
    LOAD_HZ,
    LOAD_RAD,
    RATES,
    TORQUES,
    Encoders,
    Motion,
    Spread,
    assumed_spread,
    compiled_programs,
    elastomer_values,
    motions,
)

GROUPS = 10
# Errors are counted in classes 0.9 % wide above a ten thousandth of full scale.
FINEST, HALF_CLASSES, WIDEST = 1e-4, 1000, 2.0


@dataclass(frozen=True)
class Figures:
    """Error of one source in one class of torque and rate, or over several."""

    bias_Nm: float
    sigma_Nm: float
    low_Nm: float
    high_Nm: float
    bias_error_Nm: float
    sigma_error_Nm: float
    interval_error_Nm: float
    samples: int

    @property
    def half_width_Nm(self) -> float:
        return max(abs(self.low_Nm), abs(self.high_Nm))

    def shares(self, full_scale_Nm: float) -> dict[str, float | int]:
        out: dict[str, float | int] = {}
        for name, value in vars(self).items():
            out[name] = value
            if name.endswith("_Nm"):
                out[name.replace("_Nm", "_percent")] = 100 * value / full_scale_Nm
        return out


class Tally:
    def __init__(self, full_scale_Nm: float) -> None:
        self.finest = FINEST * full_scale_Nm
        self.top = math.log1p(WIDEST / FINEST)
        self.sums: list[Array] = []
        self.squares: list[Array] = []
        self.counts: Any = None
        self.classes = np.zeros((GROUPS, TORQUES * RATES, 2 * HALF_CLASSES), dtype=np.int64)

    def add(self, error: Array, cell: Any) -> None:
        cells = TORQUES * RATES
        self.counts = np.bincount(cell, minlength=cells)
        self.sums.append(np.bincount(cell, error, cells).astype(np.float64))
        self.squares.append(np.bincount(cell, error * error, cells).astype(np.float64))
        place = np.sign(error) * np.log1p(np.abs(error) / self.finest) / self.top
        index = np.floor((np.clip(place, -1, 1 - 1e-12) + 1) * HALF_CLASSES).astype(np.int64)
        flat = np.bincount(cell * 2 * HALF_CLASSES + index, minlength=cells * 2 * HALF_CLASSES)
        self.classes[(len(self.sums) - 1) % GROUPS] += flat.reshape(cells, -1)

    def figures(self, chosen: Any, runs: int | None = None) -> Figures | None:
        """Over some of the classes, for the first runs; None where there is no sample."""
        n = int(self.counts[chosen].sum())
        if n == 0:
            return None
        mean = np.array([s[chosen].sum() for s in self.sums[:runs]]) / n
        square = np.array([s[chosen].sum() for s in self.squares[:runs]]) / n
        bias = float(mean.mean())
        sigma = math.sqrt(max(float(square.mean()) - bias * bias, 0.0))
        count = len(mean)
        bias_error = float(mean.std(ddof=1)) / math.sqrt(count) if count > 1 else 0.0
        # Of the variance round the common mean, then of its root.
        around = square - 2 * bias * mean
        spread = float(around.std(ddof=1)) / math.sqrt(count) if count > 1 else 0.0
        sigma_error = spread / (2 * sigma) if sigma > 0 else 0.0
        groups = self.classes[:, chosen].sum(axis=1)
        low, high = self._interval(groups.sum(axis=0))
        used = [self._interval(g) for g in groups if g.any()]
        ends = np.array(used)
        between = ends.std(axis=0, ddof=1) / math.sqrt(len(used)) if len(used) > 1 else np.zeros(2)
        return Figures(bias, sigma, low, high, bias_error, sigma_error, float(np.max(between)), n)

    def _interval(self, classes: Any) -> tuple[float, float]:
        share = np.cumsum(classes) / classes.sum()
        ends = []
        for wanted in (0.025, 0.975):
            middle = (int(np.searchsorted(share, wanted)) + 0.5) / HALF_CLASSES - 1
            ends.append(math.copysign(self.finest * math.expm1(abs(middle) * self.top), middle))
        return ends[0], ends[1]


RUNS, SEED = 100, 1
ASSUMED_RESIDUAL_DEG = 0.1
PARAMETERS, QUANTISATION, NONLINEARITY = "parameters", "quantisation", "nonlinearity"
RATE, TOGETHER = "rate and sampling", "together"
SOURCES = (PARAMETERS, QUANTISATION, NONLINEARITY, RATE, TOGETHER)

LEVELS: list[Any] = [label(TORQUE_EDGES, i) for i in range(TORQUES)]
SPEEDS: list[Any] = [label(RATE_EDGES, j) for j in range(RATES)]
NOT_INCLUDED = "Not included: temperature (no published data), wear, the Mullins effect, and the"


@dataclass(frozen=True)
class TorqueUncertainty:
    device: str
    full_scale_Nm: float
    omega_max_rad_s: float
    bits: int
    residual_deg: float
    spread: Spread
    runs: int
    seed: int
    clipped: int
    cells: Mapping[str, Mapping[tuple[int | None, int | None], Figures]]
    convergence: list[tuple[int, Figures]]

    def overall(self, source: str = TOGETHER) -> Figures:
        return self.cells[source][None, None]

    def _form(self) -> str:
        band = self.spread.band_Nm
        if band is None:
            return "of this device not known: --recording gives it"
        share = 100 * band / self.full_scale_Nm
        return f"95 % of this device's errors in blocks left out: {band:.3g} Nm, {share:.2g} %"

    def notes(self) -> list[str]:
        notes = [
            f"Parameters, {self.spread.origin}.",
            f"Encoders: {self.bits} bit on both sides, load side moving "
            f"{math.degrees(LOAD_RAD):g} deg at {LOAD_HZ:g} Hz (assumed), zeroed at the start.",
            f"Nonlinearity left by the correction: {self.residual_deg:g} deg (assumed; the encoder "
            "has 1 deg uncorrected), one of the first harmonics of the turn, any phase.",
            f"{NOT_INCLUDED} model's form ({self._form()}).",
        ]
        if self.clipped:
            notes.insert(1, f"{self.clipped} drawn parameters were put on a bound.")
        return notes

    def to_dict(self) -> dict[str, Any]:
        full, levels, speeds = self.full_scale_Nm, [*LEVELS, None], [*SPEEDS, None]
        return {
            "device": self.device,
            "full_scale_Nm": full,
            "omega_max_rad_s": self.omega_max_rad_s,
            "runs": self.runs,
            "seed": self.seed,
            "parameters": {"origin": self.spread.origin, "relative_sigma": self.spread.sigma},
            "encoder": {"bits": self.bits, "residual_deg": self.residual_deg},
            "torque_classes": LEVELS,
            "rate_classes": SPEEDS,
            "sources": {
                source: [
                    {"torque": levels[_last(i)], "rate": speeds[_last(j)]} | f.shares(full)
                    for (i, j), f in cells.items()
                ]
                for source, cells in self.cells.items()
            },
            "convergence": [{"runs": n} | f.shares(full) for n, f in self.convergence],
            "notes": self.notes(),
        }

    def table(self) -> list[str]:
        scale, together = 100 / self.full_scale_Nm, self.cells[TOGETHER]

        def row(name: str, f: Figures) -> str:
            ends = f"{f.low_Nm:+.3f} to {f.high_Nm:+.3f}"
            return (
                f"{name:20}{scale * f.bias_Nm:+9.3f}{scale * f.sigma_Nm:9.3f}"
                f"{scale * f.low_Nm:+11.3f}{scale * f.high_Nm:+9.3f}{ends:>18}"
                f"{scale * f.interval_error_Nm:12.3f}"
            )

        levels = [(n, together.get((i, None))) for i, n in enumerate(LEVELS)]
        speeds = [(n, together.get((None, j))) for j, n in enumerate(SPEEDS)]
        lines = [
            f"{self.device}: torque error in % of full scale ({self.full_scale_Nm:g} Nm), "
            f"{self.runs} runs",
            f"{'':20}{'bias':>9}{'sigma':>9}{'95 % from':>11}{'to':>9}{'in Nm':>18}"
            f"{'std. error':>12}",
            *(row(s, self.overall(s)) for s in SOURCES),
            *("", "together, by torque / full scale", *(row(n, f) for n, f in levels if f)),
            *("", "together, by rate / domain", *(row(n, f) for n, f in speeds if f)),
            *("", "sigma by torque / full scale, % of full scale"),
            " " * 20 + "".join(f"{n:>13}" for n in LEVELS),
        ]
        for s in SOURCES:
            found = [self.cells[s].get((i, None)) for i in range(TORQUES)]
            cells = [f"{scale * f.sigma_Nm:.3f}" if f else "-" for f in found]
            lines.append(f"{s:20}" + "".join(f"{c:>13}" for c in cells))
        return [*lines, "", *(f"note: {n}" for n in self.notes())]

    def figure(self) -> Figure:
        """95 % interval against torque by source, against torque and rate, and convergence."""
        scale, x = 100 / self.full_scale_Nm, np.arange(TORQUES)
        figure = Figure(figsize=(11, 9), layout="constrained")
        a, b, c, d = figure.subplots(2, 2).ravel()
        width = 0.8 / len(SOURCES)
        for k, source in enumerate(SOURCES):
            found = [self.cells[source].get((i, None)) for i in range(TORQUES)]
            rows = [
                (i, f.low_Nm, f.high_Nm, f.bias_Nm, f.sigma_Nm) for i, f in enumerate(found) if f
            ]
            at, low, high, bias, sigma = np.array(rows).T
            middle = at + (k - (len(SOURCES) - 1) / 2) * width
            a.bar(middle, scale * (high - low), width, bottom=scale * low, label=source)
            a.plot(middle, scale * bias, "k_")
            b.plot(at, scale * sigma, "o-", label=source)
        a.axhline(0, color="black", linewidth=0.5)
        a.legend(fontsize="small")
        b.set_yscale("log")
        for axes, title in (
            (a, "interval that holds 95 % (mark: bias)"),
            (b, "standard deviation"),
        ):
            axes.set_title(title, fontsize="medium")
            axes.set_xticks(x, LEVELS, fontsize="small")
            axes.set(xlabel="|torque| / full scale", ylabel="torque error / % of full scale")
            axes.grid(alpha=0.3)
        grid = np.full((RATES, TORQUES), np.nan)
        for (i, j), f in self.cells[TOGETHER].items():
            if i is not None and j is not None:
                grid[j, i] = scale * f.half_width_Nm
                c.text(i, j, f"{grid[j, i]:.2g}", ha="center", va="center", fontsize="small")
        c.imshow(grid, aspect="auto", origin="lower", cmap="YlOrRd", vmin=0)
        c.set_title("together: largest |end| of the 95 % interval, %", fontsize="medium")
        c.set_xticks(x, LEVELS, fontsize="small")
        c.set_yticks(range(RATES), SPEEDS, fontsize="small")
        c.set(xlabel="|torque| / full scale", ylabel="|rate| / domain")
        n = [k for k, _ in self.convergence]
        sigma, error = (
            scale * np.array([(f.sigma_Nm, f.sigma_error_Nm) for _, f in self.convergence]).T
        )
        d.plot(n, sigma, color="C4")
        d.fill_between(n, sigma - error, sigma + error, alpha=0.3, color="C4")
        d.set_title("together: standard deviation and its standard error", fontsize="medium")
        d.set(xlabel="runs", ylabel="% of full scale")
        d.grid(alpha=0.3)
        return figure


def _last(index: int | None) -> int:
    # None stands for all classes, and its name is at the end.
    return -1 if index is None else index


class _Bench:
    """A device's compiled sensor, and the same rubber with other parameters, over the motions."""

    def __init__(self, device: Device, moves: list[Motion]) -> None:
        self.device, self.moves = device, moves
        self.programs = compiled_programs(device)
        self.ideal = [self.sensed(m.theta_rad) for m in moves]
        nominal = elastomer_values(device)
        self.known = [self.rubber(nominal, m) for m in moves]

    def sensed(self, theta: Array) -> Array:
        task = self.programs.sensing
        task.reset()
        inputs = dict.fromkeys((of_axis("theta_rad", a) for a in self.device.axes), theta)
        out, _ = task.run(inputs, trace=False)
        return np.asarray(out[of_axis("tau_Nm", self.device.axes[0])], dtype=np.float64)

    def rubber(self, values: Mapping[str, float], move: Motion) -> Array:
        trial = self.programs.trial
        trial.prepare(values)
        inputs = {"theta_rad": move.theta_rad, "omega_rad_s": move.omega_mid_rad_s}
        return np.asarray(trial.run(inputs, trace=False)[0]["tau_Nm"])

    def errors(self, values: Mapping[str, float], encoders: Encoders) -> dict[str, list[Array]]:
        """Of one coupling with one pair of encoders, by source, a row a motion."""
        found: dict[str, list[Array]] = {s: [] for s in SOURCES if s != RATE}
        for move, free, own in zip(self.moves, self.ideal, self.known, strict=True):
            changed = self.rubber(values, move) - own
            found[PARAMETERS].append(-changed)
            for source, counts, nonlinear in (
                (QUANTISATION, True, False),
                (NONLINEARITY, False, True),
                (TOGETHER, True, True),
            ):
                read = encoders.read(move.theta_rad, counts=counts, nonlinear=nonlinear)
                # The torque that the changed rubber gives: the continuous one, and the change.
                truth = move.continuous_Nm + changed if source == TOGETHER else free
                found[source].append(self.sensed(read) - truth)
        return found


def _cells(tally: Tally) -> dict[tuple[int | None, int | None], Figures]:
    everything = np.arange(TORQUES * RATES).reshape(TORQUES, RATES)
    picks: dict[tuple[int | None, int | None], Any] = {(None, None): everything.ravel()}
    picks |= {(i, None): everything[i] for i in range(TORQUES)}
    picks |= {(None, j): everything[:, j] for j in range(RATES)}
    picks |= {(i, j): everything[i, [j]] for i in range(TORQUES) for j in range(RATES)}
    return {k: f for k, p in picks.items() if (f := tally.figures(p)) is not None}


def torque_uncertainty(
    device: Device,
    runs: int = RUNS,
    seed: int = SEED,
    *,
    spread: Spread | None = None,
    residual_deg: float = ASSUMED_RESIDUAL_DEG,
    limit_s: float = math.inf,
    progress: Callable[[str], None] | None = None,
) -> TorqueUncertainty:
    say = progress or (lambda _: None)
    chosen = spread or assumed_spread(device)
    moves = motions(device, limit_s, say)
    bench = _Bench(device, moves)
    tallies = {s: Tally(device.tau_full_scale_Nm) for s in SOURCES}
    cell = np.concatenate([m.cell for m in moves])

    def count(source: str, errors: list[Array]) -> None:
        kept = [e[m.kept] * m.sign for e, m in zip(errors, moves, strict=True)]
        tallies[source].add(np.concatenate(kept), cell)

    free = zip(bench.ideal, moves, strict=True)
    count(RATE, [a - m.continuous_Nm for a, m in free])
    clipped = 0
    for k in range(runs):
        say(f"run {k + 1} of {runs}")
        rng = np.random.default_rng([seed, k])
        values, hit = chosen.draw(device, rng)
        clipped += hit
        for source, errors in bench.errors(values, Encoders(device, residual_deg, rng)).items():
            count(source, errors)
    everything = np.arange(TORQUES * RATES)
    marks = sorted({*np.unique(np.geomspace(2, runs, 30).astype(int)).tolist(), runs})
    steps = [(n, tallies[TOGETHER].figures(everything, n)) for n in marks]
    return TorqueUncertainty(
        device=device.name,
        full_scale_Nm=device.tau_full_scale_Nm,
        omega_max_rad_s=device.file.domain.omega_max_rad_s.value,
        bits=int(device.file.encoder.resolution_bits.value),
        residual_deg=residual_deg,
        spread=chosen,
        runs=runs,
        seed=seed,
        clipped=clipped,
        cells={source: _cells(tally) for source, tally in tallies.items()},
        convergence=[(n, f) for n, f in steps if f is not None],
    )
