"""The emitted C of the torque sensor over recordings, and how well they determine its numbers."""

from __future__ import annotations

import copy
import hashlib
import math
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device, with_numbers
from esea_gen.hostlib.library import CRunner, HostLibrary, compile_block, compile_system
from esea_gen.identify.published.space import at_bound, bounds_of
from esea_gen.identify.recording.reading import beyond_rad, resample
from esea_gen.identify.recording.recorded import Recording, training_sets
from esea_gen.identify.recording.resampling import (
    CLEAR,
    ROUNDING,
    FitRows,
    LeftOut,
    autocorrelation,
    resampled,
    rows_of,
    whole_conditions,
)
from esea_gen.language.ports import Array
from esea_gen.language.system import System, Task
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS, torque_sensor
from esea_gen.model.slopes import sloped

# Neighbouring samples say the same: the search compares at most so many a data set, evenly spread.
ROWS_SEARCH, ROWS_REFINE = 4000, 20000
# What shapes the basis; the torque's derivatives by these are exact.
STOP_SHAPE = ("omega_rad", "beta_1_rad")
RATE_SHAPE = ("A_Nms_rad", "m", "eps1_Nms_rad", "B", "n")


def tunable_system(device: Device) -> System:
    """Velocity estimate and torque sensor with the elastomer's parameters as tunables."""
    return System(
        device.name,
        device.period_s,
        {"velocity": device.velocity, "sensor": torque_sensor(device, tunable=True)},
        (Task("sense", ("velocity", "sensor")),),
        wires={"sensor.omega_rad_s": "velocity.omega_mid_rad_s"},
        inputs={"theta_rad": ("velocity.theta_rad", "sensor.theta_rad")},
        outputs={"tau_Nm": "sensor.tau_Nm"},
    )


def thinned(rows: npt.NDArray[np.intp], most: int | None) -> npt.NDArray[np.intp]:
    """At most so many, evenly spread; all when not given."""
    return rows if most is None else rows[:: math.ceil(len(rows) / most)]


def equal_weights(sets: Sequence[npt.NDArray[Any]]) -> Array:
    """Weights of residuals under which every data set counts the same, however long it is."""
    w = np.concatenate([np.full(len(x), 1.0 / len(x)) for x in sets])
    return np.asarray(np.sqrt(w / w.sum()))


@dataclass(frozen=True)
class FitStream:
    """A recording on the grid on which the C runs."""

    theta_rad: Array  # inputs of the sensor, shape (n,)
    omega_rad_s: Array
    tau_Nm: Array  # measured torque, shape (n,)
    training: tuple[npt.NDArray[np.intp], ...]  # grid samples of each data set that trains


class FittedPlant:
    def __init__(
        self,
        device: Device,
        recordings: list[Recording],
        rate_Hz: float | None = None,
        rows: int | None = None,
    ) -> None:
        self.rate_terms = device.elastomer.maxwell is not None
        self.rate_Hz = rate_Hz
        fine = device.file.timing.sense_rate_Hz.value
        # The bases below have unit stiffness; nothing in them may clip.
        wide = with_numbers(device, {"limits.tau_Nm": 2000.0})
        bandwidth = min(device.file.velocity.bandwidth_Hz.value, 0.1 * (rate_Hz or fine))
        self.built = with_numbers(
            wide, {"timing.sense_rate_Hz": rate_Hz or fine, "velocity.bandwidth_Hz": bandwidth}
        )
        self.library = compile_system(tunable_system(self.built), "f64")
        self._zone = device.elastomer.dead_zone_rad
        self._fine_Hz = fine
        self._estimate: CRunner | None = None
        if rate_Hz is not None:
            self._estimate = compile_system(tunable_system(wide), "f64").block("velocity")
        self._take(recordings, rows)

    def having(self, recordings: list[Recording], rows: int | None = None) -> FittedPlant:
        """The same C over other recordings."""
        other = copy.copy(self)
        vars(other).pop("digest", None)
        other._take(recordings, rows)
        return other

    def _take(self, recordings: list[Recording], rows: int | None) -> None:
        self._of_thread = threading.local()
        self.streams: list[FitStream] = []
        for r in recordings:
            if not any(len(s.training) for s in r.sets):
                continue
            if self._estimate is None or self.rate_Hz is None:
                stream = FitStream(
                    r.theta_rad,
                    np.zeros_like(r.theta_rad),
                    r.tau_Nm,
                    tuple(s.training for s in r.sets if len(s.training)),
                )
            else:
                stream = _on_grid(r, self._estimate, self._fine_Hz, self.rate_Hz)
            training = tuple(thinned(x, rows) for x in stream.training)
            self.streams.append(replace(stream, training=training))
        self.rows, self.whole = self._rows(recordings), whole_conditions(recordings)
        measured = [s.tau_Nm[at] for s in self.streams for at in s.training]
        self.weight = equal_weights(measured)
        self.measured = np.concatenate(measured)
        beyond = [
            beyond_rad(s.theta_rad, self._zone.value if self._zone else 0.0) for s in self.streams
        ]
        self._spring = self._collect([(x, x**3) for x in beyond])

    @property
    def judged(self) -> tuple[Array, Array] | None:
        """Measured torque and rate at the training rows; None where these are the samples."""
        if self.rate_Hz is None:
            return None
        return self.measured, self._collect([(s.omega_rad_s,) for s in self.streams])[:, 0]

    def _rows(self, recordings: Sequence[Recording]) -> FitRows:
        ways = [np.sign(np.gradient(s.theta_rad))[at] for s in self.streams for at in s.training]
        sets = training_sets(recordings)
        if len(ways) != len(sets):  # a coarse grid lost a data set of very few samples
            return FitRows.of([(i, 1, way) for i, way in enumerate(ways)])
        return rows_of(sets, ways)

    def _collect(self, per_stream: list[tuple[Array, ...]]) -> Array:
        """Training rows of some signals, shape (rows, signals)."""
        parts = [
            np.stack([x[rows] for x in signals], axis=1)
            for signals, stream in zip(per_stream, self.streams, strict=True)
            for rows in stream.training
        ]
        return np.concatenate(parts)

    @property
    def shape_keys(self) -> tuple[str, ...]:
        """Parameters that shape the basis, in the order of :meth:`tangent`."""
        return STOP_SHAPE + (RATE_SHAPE if self.rate_terms else ())

    @cached_property
    def digest(self) -> str:
        """Of the C and of all that it is run on and compared with."""
        of = hashlib.sha256(self.library.path.stem.encode())
        arrays = [a for s in self.streams for a in (s.theta_rad, s.omega_rad_s, *s.training)]
        for a in (*arrays, self.measured, self.weight):
            of.update(np.ascontiguousarray(a).tobytes())
        return of.hexdigest()

    @cached_property
    def _sloped(self) -> HostLibrary:
        sensor = torque_sensor(self.built, tunable=True)
        outputs = ("tau_hysteresis_Nm", "tau_rate_Nm")[: 2 if self.rate_terms else 1]
        return compile_block(sloped(sensor, outputs, self.shape_keys)).library

    def _runner(self, name: str) -> CRunner:
        # A runner has a state: each thread has its own.
        runners = vars(self._of_thread)
        if name not in runners:
            runners[name] = (self._sloped if name == "slopes" else self.library).block(name)
        found: CRunner = runners[name]
        return found

    def run(self, values: Mapping[str, float], name: str = "sensor") -> list[dict[str, Array]]:
        """Run the C over every stream; several threads may do so at once."""
        runner, out = self._runner(name), []
        for s in self.streams:
            runner.prepare(values)
            y, _ = runner.run({"theta_rad": s.theta_rad, "omega_rad_s": s.omega_rad_s}, trace=False)
            out.append(y)
        return out

    def torque(self, values: Mapping[str, float]) -> Array:
        torque: Array = self._collect([(y["tau_Nm"],) for y in self.run(values)])[:, 0]
        return torque

    def basis(self, shape: Mapping[str, float]) -> Array:
        """Torque per unit of k1, k3, alpha (and kv) at the training rows."""
        outputs = self.run({**shape, **self._unit})
        names = ["tau_hysteresis_Nm"] + (["tau_rate_Nm"] if self.rate_terms else [])
        rest = self._collect([tuple(y[n] for n in names) for y in outputs])
        return np.concatenate([self._spring, rest], axis=1)

    @property
    def _unit(self) -> dict[str, float]:
        rate = {"kv_Nm_rad": 1.0} if self.rate_terms else {}
        return {"k1_Nm_rad": 0.0, "k3_Nm_rad3": 0.0, "alpha_Nm_rad": 1.0} | rate

    def tangent(self, shape: Mapping[str, float], linear: Array) -> Array:
        """Derivative of the torque by the shape's parameters, at the training rows."""
        outputs = self.run({**shape, **self._unit}, "slopes")
        stiffness, keys = linear[2:], len(self.shape_keys)
        parts = []
        for y, stream in zip(outputs, self.streams, strict=True):
            slopes = y["slopes"].reshape(len(y["slopes"]), len(stiffness), keys)
            parts += [stiffness @ slopes[rows] for rows in stream.training]
        return np.concatenate(parts)


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
    held_out = np.zeros(len(r.time_s), dtype=bool)
    count = 0
    for s in r.sets:
        held_out[s.held_out] = True
        if len(s.training):
            role[s.training] = count
            count += 1
    at = np.clip(np.searchsorted(r.time_s, times), 0, len(role) - 1)
    # Between two samples both have a part in the torque: a held-out one must have none.
    leaking = held_out[np.maximum(at - 1, 0)] & (times < r.time_s[at])
    role_at = np.where(leaking, -1, role[at])
    rows = tuple(np.flatnonzero(role_at == n).astype(np.intp) for n in range(count))
    return FitStream(
        theta[::every],
        coarse,
        resample(r.time_s, r.tau_Nm, times),
        tuple(x for x in rows if len(x)),
    )


def relative_jacobian(
    run: Callable[[dict[str, float]], Array],
    values: Mapping[str, float],
    keys: Sequence[str],
    share: float,
) -> Array:
    """Effect of a relative change of each parameter, by central differences."""
    columns = []
    for k in keys:
        step = share * values[k]
        up, down = (run({**values, k: values[k] + s}) for s in (step, -step))
        columns.append((up - down) / (2 * step) * values[k])
    return np.column_stack(columns)


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty from the Jacobian at the optimum."""

    sigma: dict[str, float | None]  # inf: no effect; None: fixed or at a bound
    weakest: dict[str, Any]
    correlation_factor: float  # by which neighbouring residuals raise sigma
    resampled: LeftOut | None = None  # None: no parameter is free
    # By how much the optimum moves a free parameter when the bounds that it ended at are lifted,
    # where that is more than its standard deviation.
    moved: Mapping[str, float] = field(default_factory=dict)


def free_keys(values: Mapping[str, float]) -> list[str]:
    """Parameters that a fit can move: neither fixed nor at a bound."""
    keys = (k for k in (*MODEL_KEYS, *RATE_KEYS) if k in values and k != "eps2")
    return [k for k in keys if at_bound(k, values[k]) is None]


def uncertainty(
    plant: FittedPlant, values: Mapping[str, float], edges: Collection[str] = ()
) -> Uncertainty:
    """Standard deviations from blocks left out; edges: what ended at the edge of the search."""
    # The Jacobian says which parameters the torque does not depend on, and in which direction the
    # fit is weakest.
    free = free_keys(values)
    rows = len(plant.measured)
    scale = plant.weight * math.sqrt(rows)  # unit weight on average
    residual = (plant.torque(values) - plant.measured) * scale
    sigma: dict[str, float | None] = {k: None for k in (*MODEL_KEYS, *RATE_KEYS) if k in values}
    rho = autocorrelation(residual)
    factor = math.sqrt((1 + rho) / (1 - rho))
    if not free:
        return Uncertainty(sigma, {}, factor)
    jacobian = relative_jacobian(plant.torque, values, free, 1e-3) * scale[:, None]
    _, singular, v = np.linalg.svd(jacobian, full_matrices=False)
    dead = singular < 1e-9 * singular[0]
    low, high = np.array([bounds_of(k) for k in free]).T / [values[k] for k in free] - 1
    apart = jacobian / scale[:, None], -residual / scale, scale
    found = resampled(*apart, plant.rows, plant.whole, (low, high))
    for i, k in enumerate(free):
        # A direction without effect makes those parameters infinite that take part in it.
        lost = bool(np.any(dead & (np.abs(v[:, i]) > 1e-3)))
        sigma[k] = math.inf if lost else float(found.sigma[i]) * values[k]
    direction = {k: round(float(x), 3) for k, x in zip(free, v[-1], strict=True)}
    weakest = {"direction": direction, "rms_change_Nm": 0.1 * float(singular[-1]) / math.sqrt(rows)}
    inner = [k for k in free if k not in edges]
    own = lifted = jacobian[:, [k in inner for k in free]]
    for key in (k for k in sigma if k in edges or (k not in free and k != "eps2")):
        more = np.column_stack([own, _slope(plant.torque, values, key) * scale])
        step = _step(more, -residual)
        apart = more / scale[:, None], (-residual - more @ step) / scale, scale
        beyond = CLEAR * resampled(*apart, plant.rows, plant.whole).sigma[-1]
        # Below 0 there is no rubber: that bound is true, unless the recording clearly differs.
        if values[key] != 0 or abs(step[-1]) > beyond:
            lifted = np.column_stack([lifted, more[:, -1]])
    shifts = _step(lifted, -residual)[: len(inner)] - _step(own, -residual)
    found_by = {k: float(x) * values[k] for k, x in zip(inner, shifts, strict=True)}
    moved = {k: x for k, x in found_by.items() if abs(x) > (sigma[k] or 0.0)}
    return Uncertainty(sigma, weakest, factor, found, moved)


def _step(jacobian: Array, error: Array) -> Array:
    # Least squares; columns of any unit.
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0] = 1.0
    return np.asarray(np.linalg.lstsq(jacobian / size, error, rcond=ROUNDING)[0] / size)


def _slope(
    run: Callable[[dict[str, float]], Array], values: Mapping[str, float], key: str
) -> Array:
    # To the inside of the bounds; a number that is 0 has no size of its own.
    high = bounds_of(key)[1]
    step = 1e-3 * values[key] or 1e-6 * high
    step = -step if values[key] + step > high else step
    return (run({**values, key: values[key] + step}) - run({**values})) / step
