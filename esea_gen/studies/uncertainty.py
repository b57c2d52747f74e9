"""How far the sensed torque may be from the true one, by Monte-Carlo on the emitted C.

The published torque signals move a coupling whose parameters, encoders and rate differ from what
the device file says; the device's float32 C, as it ships, senses it.  Sources, alone and together:

``parameters``
    The rubber's parameters against the device file's.
``quantisation``
    Counts of the two encoders.
``nonlinearity``
    What a correction table leaves of the encoders' integral nonlinearity.
``rate and sampling``
    The rate estimate and the step of 1 ms against the continuous model; no chance in it.

Not in it: temperature, wear, the Mullins effect and the model's form.  The errors of published
validations (0.7 to 1.6 % of full scale on one elastomer, up to 3.7 % on others) hold those too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device, compile_system
from esea_gen.hostlib.runner import CRunner
from esea_gen.identify.fit import ROWS_REFINE, Plant, at_bound, bounds_of, tunable_system
from esea_gen.identify.mapping import load_mapping
from esea_gen.identify.recording import load_recordings
from esea_gen.language.ports import Array
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS
from esea_gen.model.inverse import exact_inverse, inverse_system
from esea_gen.studies.chapter4 import END_S, SIGNALS, evaluation_filter
from esea_gen.studies.discretisation import LOAD_HZ, LOAD_RAD, at_rate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RUNS, SEED = 100, 1
ELBOW_FULL_SCALE_NM = 4.47  # the published signals are the elbow's; others' are scaled
CYCLE_S = 100.0  # the slow signals repeat after it
FINE_HZ = 10_000.0  # error of the reference a hundredth of that at 1 kHz
CHUNK = 200_000
STRIDE = 5  # statistics look at every fifth sample; the C runs all of them
ASSUMED_SHARE = 0.05
ASSUMED_RESIDUAL_DEG = 0.1
HARMONICS = 4
WEAK = 0.5  # relative spread of a direction that the data do not determine is held to this

PARAMETERS, QUANTISATION, NONLINEARITY = "parameters", "quantisation", "nonlinearity"
RATE, TOGETHER = "rate and sampling", "together"
SOURCES = (PARAMETERS, QUANTISATION, NONLINEARITY, RATE, TOGETHER)

TORQUE_EDGES = (0.0, 0.05, 0.25, 0.5, 0.75, 1.0, math.inf)  # of full scale
RATE_EDGES = (0.0, 0.05, 0.35, 1.0, math.inf)  # of the identified domain's largest rate
TORQUES, RATES = len(TORQUE_EDGES) - 1, len(RATE_EDGES) - 1
GROUPS = 10
# Errors are counted in classes 0.9 % wide above a ten thousandth of full scale.
FINEST, HALF_CLASSES, WIDEST = 1e-4, 1000, 2.0

NOT_INCLUDED = (
    "Not included: temperature (no published data), wear, the Mullins effect, and the model's form "
    "(published validations, which hold it: 0.7 to 1.6 % of full scale on one elastomer)."
)


@dataclass(frozen=True)
class Spread:
    """How the rubber's parameters may lie round the device file's.

    root: square root of the covariance of their logarithms, shape (keys, directions).
    """

    keys: tuple[str, ...]
    root: Array
    origin: str

    @property
    def sigma(self) -> dict[str, float]:
        """Relative standard deviation by parameter."""
        size = np.sqrt(np.sum(self.root**2, axis=1))
        return {k: float(s) for k, s in zip(self.keys, size, strict=True)}

    def draw(self, device: Device, rng: np.random.Generator) -> tuple[dict[str, float], int]:
        """One coupling."""
        values = elastomer_values(device)
        factor = np.exp(self.root @ rng.standard_normal(self.root.shape[1]))
        clipped = 0
        for key, f in zip(self.keys, factor, strict=True):
            low, high = bounds_of(key)
            value = float(values[key] * f)
            values[key] = min(max(value, low), high)
            clipped += values[key] != value
        return values, clipped


def elastomer_values(device: Device) -> dict[str, float]:
    """The elastomer's parameters."""
    known = {c.name: c.value for c in device.constants("elastomer")}
    return {k: known[k] for k in (*MODEL_KEYS, *RATE_KEYS) if k in known}


def assumed_spread(device: Device, share: float = ASSUMED_SHARE) -> Spread:
    """Every parameter on its own, by a stated share.

    share: relative standard deviation; eps2 stays, because A, eps1, B and eps2 have a common factor
        that torque does not show.
    """
    keys = tuple(k for k, v in elastomer_values(device).items() if v > 0 and k != "eps2")
    origin = f"assumed: {100 * share:g} % (standard deviation) of each parameter, independent"
    return Spread(keys, share * np.eye(len(keys)), origin)


def identified_spread(device: Device, mapping: Path, data: Path | None = None) -> Spread:
    """The covariance of an identification, recomputed from its recording.

    data: folder of the recordings; the mapping file's own when not given.
    return: with correlations. As in the identification, the model form is taken as right and the
        residuals as a first-order autoregressive noise.
    """
    source = load_mapping(mapping, data)
    if source.mapping.device.name != device.name:
        raise UserError(
            f"{source.origin}: the recording identified '{source.mapping.device.name}', not "
            f"'{device.name}': its covariance says nothing of this device.",
            "Give the identified device's file, or leave --recording out for an assumed spread.",
        )
    recordings = load_recordings(source)
    reach = max(float(np.abs(r.theta_rad).max()) for r in recordings)
    limit = device.file.limits.theta_rad.value
    if reach > limit:
        raise UserError(
            f"{source.origin}: a recorded deflection of {reach:.3g} rad is above {device.name}'s "
            f"limits.theta_rad = {limit:g} rad.",
            "Give the recording that the device was identified with.",
        )
    rate_terms = device.file.elastomer.maxwell is not None
    fine = device.file.timing.sense_rate_Hz.value
    plant = Plant(device, recordings, fine if rate_terms else None, ROWS_REFINE)
    values = elastomer_values(device)
    free = [k for k, v in values.items() if k != "eps2" and v > 0 and at_bound(k, v) is None]
    scale = plant.weight * math.sqrt(len(plant.measured))
    residual = (plant.torque(values) - plant.measured) * scale
    columns = []
    for k in free:
        step = 1e-3
        up, down = (plant.torque({**values, k: values[k] * (1 + s)}) for s in (step, -step))
        columns.append((up - down) / (2 * step) * scale)
    if not free or not np.any(columns):
        raise UserError(
            f"{source.origin}: the torque depends on none of the parameters.",
            "Leave --recording out for an assumed spread.",
        )
    rho = float(residual[1:] @ residual[:-1] / (residual @ residual))
    rho = min(max(rho, 0.0), 1 - 2.0 / len(residual))
    noise = float(residual @ residual) / max(1, len(residual) - len(free))
    noise *= (1 + rho) / (1 - rho)
    _, singular, v = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    with np.errstate(divide="ignore"):
        spread = np.minimum(math.sqrt(noise) / singular, WEAK)
    weak = int(np.sum(math.sqrt(noise) > WEAK * singular))
    held = f"; {weak} directions that it does not determine held to {100 * WEAK:g} %" * (weak > 0)
    origin = f"covariance of the identification by {source.origin}{held}"
    return Spread(tuple(free), v.T * spread, origin)


@dataclass(frozen=True)
class Motion:
    """One published signal as a motion of the coupling.

    theta_rad: true deflection at the device's samples, shape (steps,).
    omega_mid_rad_s: its true rate in the middle of the step that ends there.
    continuous_Nm: torque of the continuous model.
    kept: samples that enter the statistics.
    cell: their class of torque and rate.
    """

    name: str
    theta_rad: Array
    omega_mid_rad_s: Array
    continuous_Nm: Array
    kept: Any
    cell: Any
    sign: Array


@dataclass(frozen=True)
class _Programs:
    """Everything compiled for a device; each is reset before it is used."""

    inverse: CRunner
    fine: CRunner
    dense: int
    velocity: CRunner
    sensor: CRunner
    trial: CRunner


@cache
def _programs(device: Device) -> _Programs:
    block = exact_inverse(device)
    dense = max(1, round(FINE_HZ * device.period_s))
    finer = at_rate(device, dense / device.period_s)
    shipped = compile_device(device, "f32")
    return _Programs(
        compile_system(inverse_system(device, block), "f64").block(block.name),
        compile_device(finer, "f64").block("sensor"),
        dense,
        shipped.block("velocity"),
        shipped.block("sensor"),
        compile_system(tunable_system(device), "f64").block("sensor"),
    )


def motions(
    device: Device, limit_s: float = math.inf, say: Callable[[str], None] | None = None
) -> list[Motion]:
    """The published signals as motions: the exact inverse's set-point, filtered as published.

    device: the device; its full scale over the elbow's scales the torques.
    """
    tell = say or (lambda _: None)
    h, rate_Hz = device.period_s, 1.0 / device.period_s
    size = device.tau_full_scale_Nm / ELBOW_FULL_SCALE_NM
    programs = _programs(device)
    omega_max = device.file.domain.omega_max_rad_s.value
    out = []
    for i, signal in enumerate(SIGNALS):
        tell(f"motion {i + 1} of {len(SIGNALS)}")
        wanted = size * signal.sample(rate_Hz, min(limit_s, CYCLE_S if i < 2 else limit_s))
        programs.inverse.reset()
        y, _ = programs.inverse.run({"tau_Nm": wanted}, trace=False)
        t = np.arange(len(wanted)) * h
        path = CubicSpline(t, evaluation_filter(np.asarray(y["theta_rad"]), rate_Hz))
        torque = _continuous(programs.fine, path, len(t), programs.dense, h)
        omega = np.asarray(path(t - 0.5 * h, 1))
        omega[0] = 0.0
        ends = min(round(END_S * rate_Hz), len(t) // 4)
        kept = np.arange(ends, len(t) - ends, STRIDE)
        level = np.digitize(np.abs(torque[kept]) / device.tau_full_scale_Nm, TORQUE_EDGES) - 1
        speed = np.digitize(np.abs(path(t[kept], 1)) / omega_max, RATE_EDGES) - 1
        sign = np.where(torque[kept] < 0, -1.0, 1.0)
        theta = np.asarray(path(t))
        cell = level * RATES + speed
        out.append(Motion(f"S{i + 1}", theta, omega, torque, kept, cell, sign))
    return out


def _continuous(sensor: CRunner, path: CubicSpline, steps: int, dense: int, h: float) -> Array:
    # The sensor at a rate at which its step no longer matters, with the true rate.
    sensor.reset()
    out = np.empty(steps)
    fine = h / dense
    total = (steps - 1) * dense + 1
    for first in range(0, total, CHUNK):
        k = np.arange(first, min(first + CHUNK, total))
        omega = np.asarray(path((k - 0.5) * fine, 1))
        y, _ = sensor.run({"theta_rad": path(k * fine), "omega_rad_s": omega}, trace=False)
        at = np.flatnonzero(k % dense == 0)
        out[k[at] // dense] = y["tau_Nm"][at]
    return out


class _Encoders:
    """Two encoders on a coupling whose load side moves; zeroed at the start, at rest."""

    def __init__(self, device: Device, residual_deg: float, rng: np.random.Generator) -> None:
        self.count = 2 * math.pi / 2**device.file.encoder.resolution_bits.value
        self.size = math.radians(residual_deg)
        self.start, self.phase = rng.uniform(0, 2 * math.pi, 2)
        self.harmonic = rng.integers(1, HARMONICS + 1, 2)
        self.offset = rng.uniform(0, 2 * math.pi, 2)
        self.h = device.period_s

    def read(self, theta_rad: Array, *, counts: bool, nonlinear: bool) -> Array:
        t = np.arange(len(theta_rad)) * self.h
        load = self.start + LOAD_RAD * np.cos(2 * math.pi * LOAD_HZ * t + self.phase)
        sides = [load + theta_rad, load]
        if nonlinear:
            for i in range(2):
                k, at = self.harmonic[i], sides[i]
                error = np.sin(k * at + self.offset[i]) - np.sin(k * load[0] + self.offset[i])
                sides[i] = at + self.size * error
        if counts:
            sides = [np.round(s / self.count) * self.count for s in sides]
        return np.asarray(sides[0] - sides[1])


@dataclass(frozen=True)
class Figures:
    """Error of one source in one class of torque and rate, or over several.

    bias_Nm, sigma_Nm: mean and standard deviation; positive where the sensor reads too large a
        magnitude.
    low_Nm, high_Nm: ends of the interval that holds 95 % of the errors.
    bias_error_Nm, sigma_error_Nm, interval_error_Nm: standard errors of these, from run to run (of
        the worse end for the interval); 0 for a source without chance.
    """

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
        """Largest |error| of the 95 % interval."""
        return max(abs(self.low_Nm), abs(self.high_Nm))

    def to_dict(self, full_scale_Nm: float) -> dict[str, float | int]:
        """In Nm and in % of full scale."""
        out: dict[str, float | int] = {}
        for name in ("bias", "sigma", "low", "high", "bias_error", "sigma_error", "interval_error"):
            value = getattr(self, f"{name}_Nm")
            out[f"{name}_Nm"] = value
            out[f"{name}_percent"] = 100 * value / full_scale_Nm
        return out | {"samples": self.samples}


class _Tally:
    """Errors of one source, counted as the runs come in."""

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


@dataclass(frozen=True)
class TorqueUncertainty:
    """Torque uncertainty of a device.

    full_scale_Nm, omega_max_rad_s: torque and rate that count as 100 %.
    runs, seed, clipped: of the Monte-Carlo; drawn parameters that were put on a bound.
    cells: ``{source: {(torque class, rate class): Figures}}``; None stands for all classes.
    convergence: all sources together, over all classes, after so many runs.
    """

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
        """Over all torques and rates."""
        return self.cells[source][None, None]

    def notes(self) -> list[str]:
        """What is assumed and what is left out."""
        notes = [
            f"Parameters, {self.spread.origin}.",
            f"Encoders: {self.bits} bit on both sides, load side moving "
            f"{math.degrees(LOAD_RAD):g} deg at {LOAD_HZ:g} Hz (assumed), zeroed at the start.",
            f"Nonlinearity left by the correction: {self.residual_deg:g} deg (assumed; the encoder "
            "has 1 deg uncorrected), one of the first harmonics of the turn, any phase.",
            NOT_INCLUDED,
        ]
        if self.clipped:
            notes.insert(1, f"{self.clipped} drawn parameters were put on a bound.")
        return notes

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content, the same for the same device, runs and seed."""
        return {
            "device": self.device,
            "full_scale_Nm": self.full_scale_Nm,
            "omega_max_rad_s": self.omega_max_rad_s,
            "runs": self.runs,
            "seed": self.seed,
            "parameters": {"origin": self.spread.origin, "relative_sigma": self.spread.sigma},
            "encoder": {"bits": self.bits, "residual_deg": self.residual_deg},
            "torque_classes": [label(TORQUE_EDGES, i) for i in range(TORQUES)],
            "rate_classes": [label(RATE_EDGES, i) for i in range(RATES)],
            "sources": {
                source: [
                    {
                        "torque": None if i is None else label(TORQUE_EDGES, i),
                        "rate": None if j is None else label(RATE_EDGES, j),
                        **figures.to_dict(self.full_scale_Nm),
                    }
                    for (i, j), figures in cells.items()
                ]
                for source, cells in self.cells.items()
            },
            "convergence": [
                {"runs": n, **f.to_dict(self.full_scale_Nm)} for n, f in self.convergence
            ],
            "notes": self.notes(),
        }

    def table(self) -> list[str]:
        """The figures as lines of text."""
        lines = [
            f"{self.device}: torque error in % of full scale ({self.full_scale_Nm:g} Nm), "
            f"{self.runs} runs",
            f"{'':20}{'bias':>9}{'sigma':>9}{'95 % from':>11}{'to':>9}{'in Nm':>18}"
            f"{'std. error':>12}",
        ]
        scale = 100 / self.full_scale_Nm

        def row(name: str, f: Figures) -> str:
            ends = f"{f.low_Nm:+.3f} to {f.high_Nm:+.3f}"
            return (
                f"{name:20}{scale * f.bias_Nm:+9.3f}{scale * f.sigma_Nm:9.3f}"
                f"{scale * f.low_Nm:+11.3f}{scale * f.high_Nm:+9.3f}{ends:>18}"
                f"{scale * f.interval_error_Nm:12.3f}"
            )

        lines += [row(s, self.overall(s)) for s in SOURCES]
        for what, edges, count, at in (
            ("torque / full scale", TORQUE_EDGES, TORQUES, lambda i: (i, None)),
            ("rate / domain", RATE_EDGES, RATES, lambda i: (None, i)),
        ):
            lines += ["", f"together, by {what}"]
            for i in range(count):
                found = self.cells[TOGETHER].get(at(i))
                if found is not None:
                    lines.append(row(label(edges, i), found))
        lines += ["", "sigma by torque / full scale, % of full scale"]
        lines.append(" " * 20 + "".join(f"{label(TORQUE_EDGES, i):>13}" for i in range(TORQUES)))
        for s in SOURCES:
            found_cells = [self.cells[s].get((i, None)) for i in range(TORQUES)]
            lines.append(
                f"{s:20}"
                + "".join(f"{scale * f.sigma_Nm:13.3f}" if f else f"{'-':>13}" for f in found_cells)
            )
        return [*lines, "", *(f"note: {n}" for n in self.notes())]

    def figure(self) -> Figure:
        """95 % interval against torque by source, against torque and rate, and convergence."""
        from matplotlib.figure import Figure

        scale = 100 / self.full_scale_Nm
        figure = Figure(figsize=(11, 9), layout="constrained")
        a, b, c, d = figure.subplots(2, 2).ravel()
        names = [label(TORQUE_EDGES, i) for i in range(TORQUES)]
        x = np.arange(TORQUES)
        width = 0.8 / len(SOURCES)
        for k, source in enumerate(SOURCES):
            found = [self.cells[source].get((i, None)) for i in range(TORQUES)]
            at = [i for i, f in enumerate(found) if f]
            middle = x[at] + (k - (len(SOURCES) - 1) / 2) * width
            lows = np.array([scale * f.low_Nm for f in found if f])
            highs = np.array([scale * f.high_Nm for f in found if f])
            a.bar(middle, highs - lows, width, bottom=lows, label=source, color=f"C{k}")
            a.plot(middle, [scale * f.bias_Nm for f in found if f], "k_")
            b.plot(x[at], [scale * f.sigma_Nm for f in found if f], "o-", label=source)
        a.axhline(0, color="black", linewidth=0.5)
        a.set_title("interval that holds 95 % (mark: bias)", fontsize="medium")
        a.legend(fontsize="small")
        b.set_title("standard deviation", fontsize="medium")
        b.set_yscale("log")
        for axes in (a, b):
            axes.set_xticks(x, names, fontsize="small")
            axes.set_xlabel("|torque| / full scale")
            axes.set_ylabel("torque error / % of full scale")
            axes.grid(alpha=0.3)
        grid = np.full((RATES, TORQUES), np.nan)
        for i in range(TORQUES):
            for j in range(RATES):
                f = self.cells[TOGETHER].get((i, j))
                if f is not None:
                    grid[j, i] = scale * f.half_width_Nm
                    c.text(i, j, f"{grid[j, i]:.2g}", ha="center", va="center", fontsize="small")
        c.imshow(grid, aspect="auto", origin="lower", cmap="YlOrRd", vmin=0)
        c.set_title("together: largest |end| of the 95 % interval, %", fontsize="medium")
        c.set_xticks(x, names, fontsize="small")
        c.set_yticks(range(RATES), [label(RATE_EDGES, j) for j in range(RATES)], fontsize="small")
        c.set_xlabel("|torque| / full scale")
        c.set_ylabel("|rate| / domain")
        n = np.array([k for k, _ in self.convergence])
        sigma = scale * np.array([f.sigma_Nm for _, f in self.convergence])
        error = scale * np.array([f.sigma_error_Nm for _, f in self.convergence])
        d.plot(n, sigma, color="C4")
        d.fill_between(n, sigma - error, sigma + error, alpha=0.3, color="C4")
        d.set_title("together: standard deviation and its standard error", fontsize="medium")
        d.set_xlabel("runs")
        d.set_ylabel("% of full scale")
        d.grid(alpha=0.3)
        return figure


def label(edges: tuple[float, ...], i: int) -> str:
    """A class in words."""
    if math.isinf(edges[i + 1]):
        return f"> {100 * edges[i]:g} %"
    return f"{100 * edges[i]:g}-{100 * edges[i + 1]:g} %"


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
    """Torque uncertainty by Monte-Carlo over the published signals.

    device: what senses; it must have an inverse, which makes the motions.
    residual_deg: largest nonlinearity that the encoders' correction leaves, 0 to 5.
    """
    if not 2 <= runs <= 100_000:
        raise UserError(
            f"{runs} runs: a spread needs 2 to 100000 of them.", "Give --runs 100, for example."
        )
    if not 0 <= residual_deg <= 5:
        raise UserError(
            f"A nonlinearity of {residual_deg:g} deg is not from 0 to 5 deg.", "Give 0.1."
        )
    say = progress or (lambda _: None)
    chosen = spread or assumed_spread(device)
    moves = motions(device, limit_s, say)
    programs = _programs(device)
    velocity, sensor, trial = programs.velocity, programs.sensor, programs.trial
    nominal = elastomer_values(device)

    def sensed(theta: Array) -> Array:
        velocity.reset()
        sensor.reset()
        rates, _ = velocity.run({"theta_rad": theta}, trace=False)
        inputs = {"theta_rad": theta, "omega_rad_s": rates["omega_mid_rad_s"]}
        return np.asarray(sensor.run(inputs, trace=False)[0]["tau_Nm"], dtype=np.float64)

    def rubber(values: Mapping[str, float], move: Motion) -> Array:
        trial.prepare(values)
        inputs = {"theta_rad": move.theta_rad, "omega_rad_s": move.omega_mid_rad_s}
        return np.asarray(trial.run(inputs, trace=False)[0]["tau_Nm"])

    tallies = {s: _Tally(device.tau_full_scale_Nm) for s in SOURCES}
    cell = np.concatenate([m.cell for m in moves])

    def count(source: str, errors: list[Array]) -> None:
        kept = [e[m.kept] * m.sign for e, m in zip(errors, moves, strict=True)]
        tallies[source].add(np.concatenate(kept), cell)

    ideal = [sensed(m.theta_rad) for m in moves]
    known = [rubber(nominal, m) for m in moves]
    count(RATE, [a - m.continuous_Nm for a, m in zip(ideal, moves, strict=True)])
    clipped = 0
    for k in range(runs):
        say(f"run {k + 1} of {runs}")
        rng = np.random.default_rng([seed, k])
        values, hit = chosen.draw(device, rng)
        clipped += hit
        encoders = _Encoders(device, residual_deg, rng)
        found: dict[str, list[Array]] = {s: [] for s in SOURCES if s != RATE}
        for move, free, own in zip(moves, ideal, known, strict=True):
            changed = rubber(values, move) - own
            found[PARAMETERS].append(-changed)
            for source, counts, nonlinear in (
                (QUANTISATION, True, False),
                (NONLINEARITY, False, True),
                (TOGETHER, True, True),
            ):
                got = sensed(encoders.read(move.theta_rad, counts=counts, nonlinear=nonlinear))
                # The torque that the changed rubber gives: the continuous one, and the change.
                truth = move.continuous_Nm + changed if source == TOGETHER else free
                found[source].append(got - truth)
        for source, errors in found.items():
            count(source, errors)
    everything = np.arange(TORQUES * RATES).reshape(TORQUES, RATES)
    cells: dict[str, dict[tuple[int | None, int | None], Figures]] = {}
    for source, tally in tallies.items():
        picks: dict[tuple[int | None, int | None], Any] = {(None, None): everything.ravel()}
        picks |= {(i, None): everything[i] for i in range(TORQUES)}
        picks |= {(None, j): everything[:, j] for j in range(RATES)}
        picks |= {(i, j): everything[i, [j]] for i in range(TORQUES) for j in range(RATES)}
        cells[source] = {k: f for k, p in picks.items() if (f := tally.figures(p)) is not None}
    marks = sorted({*np.unique(np.geomspace(2, runs, 30).astype(int)).tolist(), runs})
    steps = [(n, tallies[TOGETHER].figures(everything.ravel(), n)) for n in marks]
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
        cells=cells,
        convergence=[(n, f) for n, f in steps if f is not None],
    )


__all__ = [
    "Spread",
    "TorqueUncertainty",
    "assumed_spread",
    "identified_spread",
    "torque_uncertainty",
]
