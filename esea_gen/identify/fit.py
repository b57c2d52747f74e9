"""Fit of the torque model, by running the emitted C over populations of parameters.

Given the stops' thresholds and decay and the viscosity's shape, the torque is linear in k1, k3,
alpha and kv (the viscosity being written over kv).  So only the former are searched - two numbers
without the Maxwell element, seven with it - and the latter follow from a bounded linear
least-squares problem (variable projection [1]).

The viscosity eta = (A |theta|^m + eps1) / (B |rate|^n + eps2) does not change when A, eps1, B and
eps2 are multiplied by one number.  Searched is what torque can show: the time constant
T0 = eps1 / (kv eps2), the gains A theta_max^m / eps1 and B omega_max^n / eps2, and m, n.  At the
end eps2 is set to a stated value.

References
----------
.. [1] G. H. Golub and V. Pereyra, "Separable nonlinear least squares: the variable projection
   method and its applications", Inverse Problems 19, 2003.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares, lsq_linear, nnls
from scipy.stats import qmc

from esea_gen.device import Device
from esea_gen.devices.fields import Quantity, field_facts
from esea_gen.hostlib.library import compile_system
from esea_gen.hostlib.runner import CRunner
from esea_gen.identify.recording import Recording, resample
from esea_gen.language.system import System, Task
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS, torque_sensor

Array = npt.NDArray[np.float64]
Progress = Callable[[float, str], None]

EPS2_DEFAULT = 0.013  # the published elbow's value; any other gives the same torque
POPULATION = {False: 256, True: 1024}
FINALISTS = {False: 6, True: 6}
SCAN, SCAN_FINALISTS = (40, 6), 4
# Neighbouring samples say the same: the search compares at most so many a data set, evenly spread.
ROWS_SEARCH, ROWS_REFINE = 4000, 20000
NEGLIGIBLE = 1e-4  # share of the torque below which the Maxwell element is left out
TIME_CONSTANT_S = (1e-3, 1e4)
GAIN = (1e-3, 1e5)


def bounds_of(key: str) -> tuple[float, float]:
    """Bounds of an elastomer parameter, those of the device file."""
    dotted = f"elastomer.maxwell.{key}" if key in RATE_KEYS else f"elastomer.{key}"
    extra = field_facts(dotted)
    return float(extra["low"]), float(extra["high"])


def with_values(
    device: Device, values: Mapping[str, float], **sections: Mapping[str, float]
) -> Device:
    """A device with other numbers, for simulation."""

    def put(section: Any, new: Mapping[str, float]) -> Any:
        return section.model_copy(
            update={
                k: Quantity(value=float(v), status="identified", source="trial")
                for k, v in new.items()
                if k in type(section).model_fields
            }
        )

    elastomer = put(device.file.elastomer, values)
    if elastomer.maxwell is not None:
        elastomer = elastomer.model_copy(update={"maxwell": put(elastomer.maxwell, values)})
    update = {k: put(getattr(device.file, k), v) for k, v in sections.items()}
    return Device(device.file.model_copy(update={"elastomer": elastomer, **update}), device.origin)


def tunable_system(device: Device) -> System:
    """Velocity estimate and torque sensor with the elastomer's parameters as tunables.

    device: rate, limits, number of stops, with or without Maxwell element.
    return: wired like the sensing System, so that it is the same code.
    """
    return System(
        device.name,
        device.period_s,
        {"velocity": device.velocity, "sensor": torque_sensor(device, tunable=True)},
        (Task("sense", ("velocity", "sensor")),),
        wires={"sensor.omega_rad_s": "velocity.omega_mid_rad_s"},
        inputs={"theta_rad": ("velocity.theta_rad", "sensor.theta_rad")},
        outputs={"tau_Nm": "sensor.tau_Nm"},
    )


@dataclass(frozen=True)
class FitStream:
    """A recording on the grid on which the C runs.

    theta_rad, omega_rad_s: inputs of the sensor, shape (n,).
    tau_Nm: measured torque, shape (n,).
    training: grid samples of each data set that trains.
    """

    theta_rad: Array
    omega_rad_s: Array
    tau_Nm: Array
    training: tuple[npt.NDArray[np.intp], ...]


class FittedPlant:
    """The compiled sensor over all recordings at one rate.

    device: template; its limits must hold every recording.
    rate_Hz: grid rate; the recordings' own samples when not given (right without rate terms:
        nothing in the model then depends on time).
    rows: most samples of a data set to compare with, evenly spread; all when not given. The C runs
        over all samples in any case.
    """

    def __init__(
        self,
        device: Device,
        recordings: list[Recording],
        rate_Hz: float | None = None,
        rows: int | None = None,
    ) -> None:
        self.rate_terms = device.file.elastomer.maxwell is not None
        self.rate_Hz = rate_Hz
        fine = device.file.timing.sense_rate_Hz.value
        # The bases below have unit stiffness; nothing in them may clip.
        timing = {"sense_rate_Hz": rate_Hz or fine}
        velocity = {
            "bandwidth_Hz": min(
                device.file.velocity.bandwidth_Hz.value, 0.1 * timing["sense_rate_Hz"]
            )
        }
        wide = {"tau_Nm": 2000.0}
        built = with_values(device, {}, timing=timing, velocity=velocity, limits=wide)
        self.library = compile_system(tunable_system(built), "f64")
        self.sensor: CRunner = self.library.block("sensor")
        self.streams: list[FitStream] = []
        self.evaluations = 0
        estimate: CRunner | None = None
        if rate_Hz is not None:
            estimate = compile_system(
                tunable_system(with_values(device, {}, limits=wide)), "f64"
            ).block("velocity")
        for r in recordings:
            if not any(len(s.training) for s in r.sets):
                continue
            if estimate is None or rate_Hz is None:
                stream = FitStream(
                    r.theta_rad,
                    np.zeros_like(r.theta_rad),
                    r.tau_Nm,
                    tuple(s.training for s in r.sets if len(s.training)),
                )
            else:
                stream = _on_grid(r, estimate, fine, rate_Hz)
            if rows is not None:
                thinned = tuple(x[:: math.ceil(len(x) / rows)] for x in stream.training)
                stream = replace(stream, training=thinned)
            self.streams.append(stream)
        weights, values = [], []
        for stream in self.streams:
            for at in stream.training:
                weights.append(np.full(len(at), 1.0 / len(at)))
                values.append(stream.tau_Nm[at])
        # Every data set counts the same, however long it is.
        w = np.concatenate(weights)
        self.weight = np.sqrt(w / w.sum())
        self.measured = np.concatenate(values)
        self._spring = self._collect([(s.theta_rad, s.theta_rad**3) for s in self.streams])

    def _collect(self, per_stream: list[tuple[Array, ...]]) -> Array:
        """Training rows of some signals, shape (rows, signals)."""
        parts = [
            np.stack([x[rows] for x in signals], axis=1)
            for signals, stream in zip(per_stream, self.streams, strict=True)
            for rows in stream.training
        ]
        return np.concatenate(parts)

    def run(self, values: Mapping[str, float]) -> list[dict[str, Array]]:
        """Run the C over every stream."""
        self.evaluations += 1
        out = []
        for s in self.streams:
            self.sensor.prepare(values)
            y, _ = self.sensor.run(
                {"theta_rad": s.theta_rad, "omega_rad_s": s.omega_rad_s}, trace=False
            )
            out.append(y)
        return out

    def torque(self, values: Mapping[str, float]) -> Array:
        """Model torque at the training rows."""
        torque: Array = self._collect([(y["tau_Nm"],) for y in self.run(values)])[:, 0]
        return torque

    def basis(self, shape: Mapping[str, float]) -> Array:
        """Torque per unit of k1, k3, alpha (and kv) at the training rows.

        shape: ``beta_1_rad``, ``omega_rad`` and, with rate terms, the viscosity over kv.
        """
        unit = {"k1_Nm_rad": 0.0, "k3_Nm_rad3": 0.0, "alpha_Nm_rad": 1.0}
        if self.rate_terms:
            unit["kv_Nm_rad"] = 1.0
        outputs = self.run({**shape, **unit})
        names = ["tau_hysteresis_Nm"] + (["tau_rate_Nm"] if self.rate_terms else [])
        rest = self._collect([tuple(y[n] for n in names) for y in outputs])
        return np.concatenate([self._spring, rest], axis=1)


def _on_grid(r: Recording, estimate: CRunner, fine_Hz: float, rate_Hz: float) -> FitStream:
    """Interpolate a recording; its rate from the firmware's own estimate at the device's rate."""
    every = max(1, round(fine_Hz / rate_Hz))
    steps = int(r.time_s[-1] * fine_Hz) // every
    grid = np.arange(steps * every + 1) / fine_Hz
    theta = resample(r.time_s, r.theta_rad, grid)
    estimate.prepare({})
    omega = estimate.run({"theta_rad": theta}, trace=False)[0]["omega_mid_rad_s"]
    # A coarse step takes the mean of the fine steps' rates that it stands for.
    coarse = np.concatenate([[0.0], omega[1:].reshape(steps, every).mean(axis=1)])
    times = grid[::every]
    role = np.full(len(r.time_s), -1)
    count = 0
    for s in r.sets:
        if len(s.training):
            role[s.training] = count
            count += 1
    at = np.clip(np.searchsorted(r.time_s, times), 0, len(role) - 1)
    rows = tuple(np.flatnonzero(role[at] == n).astype(np.intp) for n in range(count))
    return FitStream(
        theta[::every],
        coarse,
        resample(r.time_s, r.tau_Nm, times),
        tuple(x for x in rows if len(x)),
    )


@dataclass(frozen=True)
class Space:
    """The searched numbers and how they become parameters.

    theta_rad, omega_rad_s: largest deflection and rate in the training data.
    duration_s: longest recording: longer time constants than ten times it cannot be told apart.
    """

    rate_terms: bool
    theta_rad: float
    omega_rad_s: float
    duration_s: float
    low: Array = field(init=False)
    high: Array = field(init=False)

    def __post_init__(self) -> None:
        omega = bounds_of("omega_rad")
        beta = bounds_of("beta_1_rad")
        low = [math.log(max(omega[0], self.theta_rad / 500)), 0.0]
        high = [math.log(min(omega[1], 2 * self.theta_rad)), math.log1p(beta[1] * self.theta_rad)]
        if self.rate_terms:
            slow = min(TIME_CONSTANT_S[1], 10 * self.duration_s)
            low += [math.log(TIME_CONSTANT_S[0]), math.log(GAIN[0]), 0.0, math.log(GAIN[0]), 0.0]
            high += [math.log(slow), math.log(GAIN[1]), 4.0, math.log(GAIN[1]), 1.0]
        object.__setattr__(self, "low", np.array(low))
        object.__setattr__(self, "high", np.array(high))

    def shape(self, x: Array) -> dict[str, float]:
        """Parameters of the basis: stops' thresholds and decay, viscosity over kv.

        x: searched numbers, shape (2,) or (7,).
        """
        out = {"omega_rad": math.exp(x[0]), "beta_1_rad": math.expm1(x[1]) / self.theta_rad}
        if self.rate_terms:
            m, n, eps1 = float(x[4]), float(x[6]), math.exp(x[2])
            out |= {
                "m": m,
                "n": n,
                "eps2": 1.0,
                "eps1_Nms_rad": eps1,
                "A_Nms_rad": math.exp(x[3]) * eps1 / self.theta_rad**m,
                "B": math.exp(x[5]) / self.omega_rad_s**n,
            }
        return out


def solve_linear(basis: Array, target: Array, low: Array, high: Array) -> Array:
    """Bounded linear least squares of few columns.

    basis: shape (rows, columns).
    target: shape (rows,).
    low, high: bounds, shape (columns,); ``low`` is 0.
    """
    size = np.sqrt(np.einsum("ij,ij->j", basis, basis))
    size[size == 0] = 1.0
    scaled = basis / size
    gram = scaled.T @ scaled + 1e-13 * np.eye(len(size))
    root = np.linalg.cholesky(gram).T
    right = solve_triangular(root, scaled.T @ target, trans="T")
    solution: Array = np.asarray(nnls(root, right)[0] / size, dtype=np.float64)
    if np.any(solution > high):
        bounded = lsq_linear(root, right, (low * size, high * size), method="bvls", max_iter=100)
        solution = np.clip(bounded.x / size, low, high)
    return solution


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    values: elastomer parameters by key; without rate terms only the first five.
    cost: mean over data sets of the mean square error, Nm^2, training data.
    population, evaluations: size of the starting population; runs of the C over all training data.
    runner_up: cost of the second best finalist over the best's: near 1 the optimum was found
        repeatedly.
    rate_dropped: the fit gave the Maxwell element no stiffness: it is left out.
    edges: what ended at the edge of the searched space, and what that means.
    """

    values: dict[str, float]
    cost: float
    population: int
    evaluations: int
    runner_up: float
    rate_dropped: bool = False
    edges: tuple[str, ...] = ()


def _linear_bounds(rate_terms: bool) -> tuple[Array, Array]:
    keys = ["k1_Nm_rad", "k3_Nm_rad3", "alpha_Nm_rad"] + (["kv_Nm_rad"] if rate_terms else [])
    pairs = [bounds_of(k) for k in keys]
    return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])


def _finalists(population: Array, costs: Array, space: Space) -> list[int]:
    """The best ones that are not neighbours of a better one."""
    unit = (population - space.low) / (space.high - space.low)
    chosen: list[int] = []
    for i in np.argsort(costs, kind="stable"):
        if all(np.abs(unit[i] - unit[j]).max() > 0.1 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == FINALISTS[space.rate_terms]:
            break
    return chosen


def search(
    device: Device,
    recordings: list[Recording],
    space: Space,
    fit_rate_Hz: float | None,
    progress: Progress,
    seed: int,
    population_size: int | None = None,
) -> Fit:
    """Global search from a seeded population, then refinement.

    A Sobol population over the whole space is run through the C; bounded least squares starts from
    its best members (apart from each other), and from the best of these again at the device's rate.
    """
    low, high = _linear_bounds(space.rate_terms)
    coarse = FittedPlant(device, recordings, fit_rate_Hz, ROWS_SEARCH)

    def residual(plant: FittedPlant, x: Array) -> Array:
        basis = plant.basis(space.shape(x)) * plant.weight[:, None]
        y = plant.weight * plant.measured
        error: Array = basis @ solve_linear(basis, y, low, high) - y
        return error

    count = population_size or POPULATION[space.rate_terms]
    sampler = qmc.Sobol(len(space.low), seed=seed)
    population = qmc.scale(sampler.random(count), space.low, space.high)
    costs = np.empty(count)
    for i, x in enumerate(population):
        r = residual(coarse, x)
        costs[i] = r @ r
        if i % 32 == 0:
            progress(0.5 * i / count, f"population: {i} of {count}, best {_rms(costs[: i + 1])}")

    chosen = _finalists(population, costs, space)
    ends: list[tuple[float, Array]] = []
    for place, i in enumerate(chosen):
        done = _polish(coarse, residual, population[i], space, 60 if space.rate_terms else 80)
        ends.append(done)
        reached = np.array([e[0] for e in ends])
        progress(
            0.5 + 0.2 * (place + 1) / len(chosen),
            f"refinement {place + 1} of {len(chosen)}, best {_rms(reached)}",
        )
    # The thresholds make minima of their own, which the viscosity's numbers hide from a sparse
    # population: look along them from the best finalist (measured: docs/identify.md).
    starts = _threshold_minima(coarse, residual, min(ends, key=lambda e: e[0])[1], space)
    for place, x in enumerate(starts):
        ends.append(_polish(coarse, residual, x, space, 60))
        progress(
            0.7 + 0.15 * (place + 1) / len(starts),
            f"thresholds {place + 1} of {len(starts)}, best {_rms(np.array([e[0] for e in ends]))}",
        )
    ends.sort(key=lambda e: e[0])
    evaluations = coarse.evaluations
    best, plant = ends[0], coarse
    fine = device.file.timing.sense_rate_Hz.value
    if fit_rate_Hz is not None and fit_rate_Hz < fine:
        progress(0.87, "refinement at the device's rate")
        plant = FittedPlant(device, recordings, fine, ROWS_REFINE)
        best = _polish(plant, residual, best[1], space, 4)
        evaluations += plant.evaluations
    basis = plant.basis(space.shape(best[1])) * plant.weight[:, None]
    target = plant.weight * plant.measured
    linear = solve_linear(basis, target, low, high)
    share = 0.0
    if space.rate_terms:
        share = float(np.linalg.norm(linear[3] * basis[:, 3]) / np.linalg.norm(target))
    values, dropped = parameters_of(space, best[1], linear, share)
    return Fit(
        values=values,
        cost=best[0],
        population=count,
        evaluations=evaluations,
        runner_up=ends[1][0] / ends[0][0] if len(ends) > 1 and ends[0][0] > 0 else math.inf,
        rate_dropped=dropped,
        edges=() if dropped else _edges(space, best[1]),
    )


def _edges(space: Space, x: Array) -> tuple[str, ...]:
    names = (
        ("the stops are as close as the search allows", "the stops are as far apart as allowed"),
        ("the stops' weight does not decay", "the stops' weight decays as fast as allowed"),
        ("the time constant is as short as allowed", "the time constant is as long as allowed"),
        (
            "the viscosity does not depend on deflection (A, m mean nothing)",
            "the viscosity at zero deflection is as small as allowed",
        ),
        ("the exponent m is at its lower bound", "the exponent m is at its upper bound"),
        (
            "the viscosity does not depend on rate (B, n mean nothing)",
            "the viscosity depends on rate as strongly as allowed",
        ),
        ("the exponent n is at its lower bound", "the exponent n is at its upper bound"),
    )
    margin = 1e-3 * (space.high - space.low)
    found = []
    for value, low, high, m, text in zip(x, space.low, space.high, margin, names, strict=False):
        if value <= low + m:
            found.append(text[0])
        elif value >= high - m:
            found.append(text[1])
    return tuple(found)


def _threshold_minima(
    plant: FittedPlant, residual: Callable[[FittedPlant, Array], Array], best: Array, space: Space
) -> list[Array]:
    """Best few minima along the thresholds, the viscosity's numbers held."""
    spacing = np.linspace(space.low[0], space.high[0], SCAN[0])
    decay = np.linspace(space.low[1], space.high[1], SCAN[1])
    profile = np.empty(len(spacing))
    points = []
    for i, omega in enumerate(spacing):
        trials = [np.concatenate([[omega, beta], best[2:]]) for beta in decay]
        costs = [float(r @ r) for r in (residual(plant, x) for x in trials)]
        profile[i] = min(costs)
        points.append(trials[int(np.argmin(costs))])
    padded = np.concatenate([[np.inf], profile, [np.inf]])
    minima = np.flatnonzero((profile <= padded[:-2]) & (profile <= padded[2:]))
    order = minima[np.argsort(profile[minima], kind="stable")]
    return [points[int(i)] for i in order[:SCAN_FINALISTS]]


def _rms(costs: Array) -> str:
    return f"{math.sqrt(float(costs.min())):.4g} Nm"


def _polish(
    plant: FittedPlant,
    residual: Callable[[FittedPlant, Array], Array],
    start: Array,
    space: Space,
    steps: int,
) -> tuple[float, Array]:
    width = space.high - space.low
    inside = np.clip(start, space.low + 1e-6 * width, space.high - 1e-6 * width)
    done = least_squares(
        lambda x: residual(plant, x),
        inside,
        bounds=(space.low, space.high),
        x_scale=width,
        # The thresholds make the cost a little rough: a step well above rounding.
        diff_step=1e-4,
        max_nfev=steps,
        ftol=1e-7,
        xtol=1e-7,
        gtol=1e-12,
    )
    return 2 * float(done.cost), np.asarray(done.x, dtype=np.float64)


def parameters_of(
    space: Space, x: Array, linear: Array, rate_share: float
) -> tuple[dict[str, float], bool]:
    """Turn searched numbers and linear coefficients into the device file's parameters.

    x: searched numbers, shape (2,) or (7,).
    linear: k1, k3, alpha (and kv), shape (3,) or (4,).
    rate_share: RMS of the Maxwell element's torque over that of the measured torque.
    return: whether the Maxwell element was left out because it carries next to nothing.
    """
    shape = space.shape(x)
    values = {
        "k1_Nm_rad": float(linear[0]),
        "k3_Nm_rad3": float(linear[1]),
        "alpha_Nm_rad": float(linear[2]),
        "beta_1_rad": shape["beta_1_rad"],
        "omega_rad": shape["omega_rad"],
    }
    if space.rate_terms:
        kv = float(linear[3])
        if kv <= 0 or rate_share < NEGLIGIBLE:
            return _inside(values), True
        values["kv_Nm_rad"] = kv
        values |= _viscosity(shape, kv)
    return _inside(values), False


def _viscosity(shape: Mapping[str, float], kv: float) -> dict[str, float]:
    """Viscosity in the device file's bounds: the free common factor is chosen here."""
    per_eps2 = {
        "A_Nms_rad": kv * shape["A_Nms_rad"],
        "eps1_Nms_rad": kv * shape["eps1_Nms_rad"],
        "B": shape["B"],
        "eps2": 1.0,
    }
    smallest = max(bounds_of(k)[0] / v for k, v in per_eps2.items() if v > 0)
    largest = min(bounds_of(k)[1] / v for k, v in per_eps2.items() if v > 0)
    # Well inside the bounds, so that none is reported as reached which only this choice reaches.
    inside = 2 * smallest < EPS2_DEFAULT < 0.5 * largest
    factor = EPS2_DEFAULT if inside else math.sqrt(smallest * largest)
    return {k: v * factor for k, v in per_eps2.items()} | {"m": shape["m"], "n": shape["n"]}


def _inside(values: Mapping[str, float]) -> dict[str, float]:
    out = {}
    for key, v in values.items():
        low, high = bounds_of(key)
        out[key] = min(max(v, low), high)
    return out


@dataclass(frozen=True)
class Uncertainty:
    """What the Jacobian says at the optimum.

    sigma: standard deviation by key; infinite where the torque does not depend on the parameter;
        None for one that is fixed or at a bound.
    weakest: relative direction in which the fit is weakest, and what a change by a tenth along it
        does to the torque: ``{"direction": {key: share}, "rms_change_Nm": ...}``.
    correlation_factor: by how much the deviations were raised because neighbouring residuals are
        alike.
    """

    sigma: dict[str, float | None]
    weakest: dict[str, Any]
    correlation_factor: float


def at_bound(key: str, value: float) -> str | None:
    """Whether a parameter sits at a bound."""
    low, high = bounds_of(key)
    # The viscosity's numbers have no scale of their own: only 0 itself is a lower bound of 0.
    if value <= low * (1 + 1e-6):
        return "lower"
    return "upper" if value >= high * (1 - 1e-6) else None


def uncertainty(plant: FittedPlant, values: Mapping[str, float]) -> Uncertainty:
    """Standard deviations from the Jacobian of the torque by the parameters.

    Assumed: the model form is right and the residuals are a first-order autoregressive noise of
    constant variance.  Where the model form is wrong (it is, for real rubber) the figures say how
    sharply the data determine the fit, not how true it is.
    """
    keys = [k for k in (*MODEL_KEYS, *RATE_KEYS) if k in values and k != "eps2"]
    free = [k for k in keys if at_bound(k, values[k]) is None and values[k] > 0]
    rows = len(plant.measured)
    scale = plant.weight * math.sqrt(rows)  # unit weight on average
    residual = (plant.torque(values) - plant.measured) * scale
    columns = []
    for k in free:
        step = 1e-3 * values[k]
        up, down = ({**values, k: values[k] + s} for s in (step, -step))
        columns.append((plant.torque(up) - plant.torque(down)) / (2 * step) * values[k] * scale)
    sigma: dict[str, float | None] = {k: None for k in (*keys, "eps2") if k in values}
    rho = float(residual[1:] @ residual[:-1] / (residual @ residual))
    rho = min(max(rho, 0.0), 1 - 2.0 / rows)
    factor = math.sqrt((1 + rho) / (1 - rho))
    if not free:
        return Uncertainty(sigma, {}, factor)
    jacobian = np.stack(columns, axis=1)
    _, singular, v = np.linalg.svd(jacobian, full_matrices=False)
    noise = float(residual @ residual) / max(1, rows - len(free)) * factor**2
    dead = singular < 1e-9 * singular[0]
    inverse = np.where(dead, 1e300, 1 / np.where(dead, 1, singular) ** 2)
    for i, k in enumerate(free):
        # A direction without effect makes those parameters infinite that take part in it.
        taking_part = (np.abs(v[:, i]) > 1e-3) | ~dead
        spread = np.where(taking_part, v[:, i] ** 2 * inverse, 0.0)
        total = float(spread.sum())
        sigma[k] = math.sqrt(noise * total) * values[k] if total < 1e200 else math.inf
    direction = {k: round(float(x), 3) for k, x in zip(free, v[-1], strict=True)}
    weakest = {"direction": direction, "rms_change_Nm": 0.1 * float(singular[-1]) / math.sqrt(rows)}
    return Uncertainty(sigma, weakest, factor)
