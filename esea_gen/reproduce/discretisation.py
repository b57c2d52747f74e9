"""Discretisation of the sensor: three tables of emitted C against continuous models.

Ideal encoders separate the integrators of the Maxwell element; real ones separate the sources of
the rate, and the second table decides the defaults.  The third is of the whole sensing task, rate
and torque together: counts or the smoothed deflection, by bandwidth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from esea_gen.analysis.plots import Panel, panels
from esea_gen.device import Device, load_device, with_numbers
from esea_gen.devices.designed import suited_bandwidth_Hz
from esea_gen.hostlib.library import compile_block, compile_device
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Array, Port
from esea_gen.model.elastomer import EPS1, EPS2, ETA, RATE, THETA, A, B, M, N
from esea_gen.model.symbolic import to_casadi
from esea_gen.studies.registry import Reproduction
from esea_gen.studies.uncertainty.motions import LOAD_HZ, LOAD_RAD, SENSE_RATE
from esea_gen.twin.trajectories import reaches

REFINE_HZ = 20_000.0
RATES_HZ = (1000.0, 500.0)
BITS = (14, 12)
BANDWIDTHS_HZ = (10.0, 12.0, 15.0, 20.0, 30.0)
CHUNK = 200_000


def _rational(terms: int) -> Callable[[ca.SX], tuple[ca.SX, ca.SX]]:
    def step(x: ca.SX) -> tuple[ca.SX, ca.SX]:
        series = 1 + x / 2 + (x * x / 6 if terms > 2 else 0)
        decay = 1 / (1 + x * series)
        return decay, series * decay

    return step


# Per scheme: what x = h kv / eta makes of the last torque, and of kv times the move.
SCHEMES: dict[str, Callable[[ca.SX], tuple[ca.SX, ca.SX]]] = {
    "exponential": lambda x: (ca.exp(-x), (1 - ca.exp(-x)) / x),
    "third order (the sensor's)": _rational(3),
    "second order": _rational(2),
    "trapezoidal": lambda x: ((1 - x / 2) / (1 + x / 2), 1 / (1 + x / 2)),
    "backward Euler": lambda x: (1 / (1 + x), 1 / (1 + x)),
    "explicit Euler": lambda x: (1 - x, ca.SX(1)),
}
OURS = "third order (the sensor's)"


def maxwell_block(device: Device, scheme: str) -> Block:
    """The Maxwell element alone (3.3, 3.4), stepped by one scheme."""
    v = {c.name: c.value for c in device.constants("elastomer.maxwell")}
    h, kv = device.period_s, v["kv_Nm_rad"]
    limits = device.file.limits
    theta, omega, tau = limits.theta_rad.value, limits.omega_rad_s.value, limits.tau_Nm.value

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        middle = s.theta_prev_rad + 0.5 * h * u.omega_rad_s
        eta = to_casadi(
            ETA,
            {
                THETA: middle,
                RATE: u.omega_rad_s,
                A: v["A_Nms_rad"],
                M: v["m"],
                EPS1: v["eps1_Nms_rad"],
                B: v["B"],
                N: v["n"],
                EPS2: v["eps2"],
            },
        )
        decay, weight = SCHEMES[scheme](label("x", h * kv / eta))
        tau_r = decay * s.tau_r_Nm + kv * (u.theta_rad - s.theta_prev_rad) * weight
        return {"theta_prev_rad": u.theta_rad, "tau_r_Nm": tau_r}, {"tau_rate_Nm": tau_r}

    return Block.define(
        "maxwell_" + scheme.lower().replace(" ", "_"),
        f"Maxwell element alone, {scheme}",
        period_s=h,
        state=(
            Port("theta_prev_rad", -theta, theta, "deflection of the last step"),
            Port("tau_r_Nm", -1e6, 1e6, "its torque"),
        ),
        inputs=(
            Port("theta_rad", -theta, theta, "deflection"),
            Port("omega_rad_s", -omega, omega, "rate in the middle of the step"),
        ),
        outputs=(Port("tau_rate_Nm", -tau, tau, "rate torque"),),
        step=step,
    )


@dataclass(frozen=True)
class EncodedMotion:
    amplitude_deg: float
    top_Hz: float
    duration_s: float

    @property
    def name(self) -> str:
        return f"{self.amplitude_deg:g} deg, 0 to {self.top_Hz:g} Hz in {self.duration_s:g} s"

    def theta(self, t: npt.NDArray[Any]) -> Array:
        sweep = self.top_Hz / self.duration_s
        return np.asarray(np.deg2rad(self.amplitude_deg) * np.sin(np.pi * sweep * t * t))

    def omega(self, t: npt.NDArray[Any]) -> Array:
        sweep = self.top_Hz / self.duration_s
        size = np.deg2rad(self.amplitude_deg) * 2 * np.pi * sweep
        return np.asarray(size * t * np.cos(np.pi * sweep * t * t))


# The published training sweeps, and one that reaches deflection and rate limits together.
MOTIONS = (
    EncodedMotion(10.0, 1.0, 120.0),
    EncodedMotion(5.0, 1.5, 180.0),
    EncodedMotion(11.5, 0.85, 60.0),
)


def continuous_torque(device: Device, motion: EncodedMotion) -> Array:
    """Rate torque of the continuous model, on a grid of ``REFINE_HZ``."""
    fine = with_numbers(device, {SENSE_RATE: REFINE_HZ})
    runner = compile_block(maxwell_block(fine, "exponential"))
    count = round(motion.duration_s * REFINE_HZ)
    out = np.empty(count)
    for first in range(0, count, CHUNK):
        k = np.arange(first, min(first + CHUNK, count))
        inputs = {
            "theta_rad": motion.theta(k / REFINE_HZ),
            "omega_rad_s": motion.omega((k - 0.5) / REFINE_HZ),
        }
        y, _ = runner.run(inputs, trace=False)
        out[k] = y["tau_rate_Nm"]
    return out


Errors = dict[str, dict[str, Any]]  # in % of full scale, RMS and largest by rate or bits


@dataclass(frozen=True)
class Discretisation:
    device: str
    ideal: Errors  # by scheme, with whether it is stable and monotone
    real: Errors  # by what feeds the viscosity

    def table(self) -> list[str]:
        yes = {True: "yes", False: "no"}
        heads = "".join(f"{f'{r:g} Hz':>22}" for r in RATES_HZ)
        lines = [
            "Ideal encoders: error of the rate torque in % of full scale, RMS / max",
            f"{'':30}{heads}{'stable':>8}{'monotone':>10}",
        ]
        for scheme, s in self.ideal.items():
            pairs = zip(s["rms_pct"].values(), s["largest_pct"].values(), strict=True)
            cells = "".join(f"{f'{a:.2g} / {b:.2g}':>22}" for a, b in pairs)
            lines.append(f"{scheme:30}{cells}{yes[s['stable']]:>8}{yes[s['monotone']]:>10}")
        lines += [
            "",
            "Real encoders, 1 kHz, moving load side: the same, by what feeds the viscosity",
            f"{'':46}" + "".join(f"{f'{b} bit':>18}" for b in BITS),
        ]
        for source, q in self.real.items():
            pairs = zip(q["rms_pct"].values(), q["largest_pct"].values(), strict=True)
            cells = "".join(f"{f'{a:.3g} / {b:.2g}':>18}" for a, b in pairs)
            lines.append(f"{source:46}{cells}")
        return lines

    def figure(self) -> Figure:
        dots = {"marker": "o"}
        ideal, real = (
            [(x, list(row["rms_pct"].values()), name, dots) for name, row in rows.items()]
            for x, rows in ((RATES_HZ, self.ideal), (BITS, self.real))
        )
        error, logs = "RMS error of the rate torque / % of full scale", {"yscale": "log"}
        rows = [
            Panel(ideal, "rate / Hz, ideal encoders", error, logs | {"xscale": "log"}),
            Panel(real, "encoder / bit, 1 kHz", "", logs | {"xticks": BITS}),
        ]
        return panels(rows, 11, 4.5, sharey=True)


def _growth(scheme: str) -> tuple[bool, bool]:
    x = ca.SX.sym("x")
    decay, weight = ca.Function("step", [x], list(SCHEMES[scheme](x)))(np.logspace(-9, 6, 2000).T)
    d, w = np.asarray(decay).ravel(), np.asarray(weight).ravel()
    return bool(np.all(np.abs(d) <= 1)), bool(np.all(d >= 0) and np.all(w > 0))


def _ideal(device: Device, exact: dict[EncodedMotion, Array], say: Callable[[str], None]) -> Errors:
    full = device.tau_full_scale_Nm
    rows = {}
    for scheme in SCHEMES:
        largest, rms = ({f"{rate:g}": 0.0 for rate in RATES_HZ} for _ in range(2))
        for rate in RATES_HZ:
            say(f"ideal encoders, {scheme}, {rate:g} Hz")
            coarse = with_numbers(device, {SENSE_RATE: rate})
            runner = (
                compile_device(coarse, "f64").block("sensor")
                if scheme == OURS
                else compile_block(maxwell_block(coarse, scheme))
            )
            for motion, fine in exact.items():
                t = np.arange(round(motion.duration_s * rate)) / rate
                runner.reset()
                omega = motion.omega(t - 0.5 / rate)
                y, _ = runner.run({"theta_rad": motion.theta(t), "omega_rad_s": omega}, trace=False)
                error = y["tau_rate_Nm"] - fine[:: round(REFINE_HZ / rate)][: len(t)]
                error = 100 * error / full
                key = f"{rate:g}"
                largest[key] = max(largest[key], float(np.max(np.abs(error))))
                rms[key] = max(rms[key], float(np.sqrt(np.mean(error**2))))
        stable, monotone = _growth(scheme)
        rows[scheme] = {
            "largest_pct": largest,
            "rms_pct": rms,
            "stable": stable,
            "monotone": monotone,
        }
    return rows


def _real(device: Device, motion: EncodedMotion, fine: Array) -> Errors:
    from scipy.signal import butter, sosfilt

    rate_Hz = 1.0 / device.period_s
    t = np.arange(round(motion.duration_s * rate_Hz)) / rate_Hz
    true = fine[:: round(REFINE_HZ / rate_Hz)][: len(t)]
    load = LOAD_RAD * (1 - np.cos(2 * np.pi * LOAD_HZ * t))
    library = compile_device(device, "f64")
    sensor, velocity = library.block("sensor"), library.block("velocity")
    low_pass = butter(2, 60, fs=rate_Hz, output="sos")
    out: Errors = {}

    def add(source: str, bits: int, theta: Array, omega: Array) -> None:
        sensor.reset()
        y, _ = sensor.run({"theta_rad": theta, "omega_rad_s": omega}, trace=False)
        error = 100 * (y["tau_rate_Nm"] - true) / device.tau_full_scale_Nm
        row = out.setdefault(source, {"rms_pct": {}, "largest_pct": {}})
        row["rms_pct"][str(bits)] = float(np.sqrt(np.mean(error**2)))
        row["largest_pct"][str(bits)] = float(np.max(np.abs(error)))

    for bits in BITS:
        count = 2 * np.pi / 2**bits
        motor = np.round((load + motion.theta(t)) / count) * count
        theta = motor - np.round(load / count) * count
        raw = np.diff(theta, prepend=theta[:1]) * rate_Hz
        past = np.concatenate([[0.0, 0.0], 2 * raw[1:-1] - raw[:-2]])
        add("the true rate", bits, theta, motion.omega(t - 0.5 / rate_Hz))
        add("raw differences, extrapolated", bits, theta, past)
        add("difference, 60 Hz second-order low-pass", bits, theta, sosfilt(low_pass, raw))
        for bandwidth in BANDWIDTHS_HZ:
            velocity.prepare({"bandwidth_Hz": bandwidth})
            rates, _ = velocity.run({"theta_rad": theta}, trace=False)
            chosen = bandwidth == device.file.velocity.bandwidth_Hz.value
            mark = " (the device's)" if chosen else ""
            source = f"observer, {bandwidth:g} Hz{mark}"
            add(source, bits, theta, rates["omega_mid_rad_s"])
    return out


class SensorDiscretisation(Reproduction[Discretisation]):
    """The sensor's discretisation: ideal encoders, and real ones with velocity filters."""

    name = "discretisation"
    title = "The sensor's discretisation"

    def run(self, say: Callable[[str], None], folder: Path | None) -> Discretisation:
        device, exact = load_device("elbow"), {}
        for motion in MOTIONS:
            say(f"continuous model: {motion.name}")
            exact[motion] = continuous_torque(device, motion)
        ideal = _ideal(device, exact, say)
        say("real encoders")
        coarse = with_numbers(device, {SENSE_RATE: RATES_HZ[0]})
        return Discretisation(device.name, ideal, _real(coarse, MOTIONS[0], exact[MOTIONS[0]]))


FINE = 16  # steps of the continuous model in a period
LASTING_S = 40.0
CHAIN_BANDWIDTHS_HZ = (10.0, 12.0, 15.0, 20.0, 30.0, 60.0)
# Ideal: the finest that a device file takes, a count of 0.4 microradians.
ENCODERS = {"12 bit": 12, "14 bit": 14, "ideal": 24}
RESOLUTION = "encoder.resolution_bits"
COUNTS, SMOOTHED = "counts", "smoothed"
BLOCKS = "velocity", "smoothing", "sensor"
START_S = 1.0
MOVES = 10


def motions(most_rad: float, h: float) -> dict[str, Array]:
    """Deflections, rad at the fine step: a sweep, a slow sine, reaches of half a second."""
    t = np.arange(round(LASTING_S / h)) * h
    rng = np.random.default_rng(0)
    ends = 0.87 * most_rad * rng.uniform(-1, 1, MOVES)
    return {
        "sweep to 1 Hz": 0.87 * most_rad * np.sin(np.pi * t * t / LASTING_S),
        "0.01 Hz": 0.87 * most_rad * np.sin(2 * np.pi * 0.01 * t),
        "reaches": reaches(ends, np.full(MOVES, 0.5), h),
    }


@dataclass(frozen=True)
class ChainRow:
    """One deflection for the sensor and one bandwidth; None: the one that suits each encoder."""

    deflection: str
    bandwidth_Hz: float | None
    rms_pct: dict[str, dict[str, float]]


@dataclass(frozen=True)
class WholeChain:
    device: str
    rows: list[ChainRow]
    suited_Hz: dict[str, float]

    def table(self) -> list[str]:
        names = list(next(iter(self.rows[0].rms_pct.values())))
        lines = [
            f"{self.device}: torque of rate and sensor together against the continuous model, RMS "
            f"in % of full scale: {' / '.join(names)}",
            f"{'deflection':12}{'observer':>10}" + "".join(f"{e:>24}" for e in ENCODERS),
        ]
        for r in self.rows:
            cells = (" / ".join(f"{x:.3f}" for x in v.values()) for v in r.rms_pct.values())
            at = f"{r.bandwidth_Hz:g} Hz" if r.bandwidth_Hz else "suited"
            lines.append(f"{r.deflection:12}{at:>10}" + "".join(f"{c:>24}" for c in cells))
        suited = ", ".join(f"{f:g} Hz for {e}" for e, f in self.suited_Hz.items())
        return [*lines, f"suited: by the encoder's resolution, {suited}"]

    def figure(self) -> Figure:
        curves = []
        for what, line in ((COUNTS, "--"), (SMOOTHED, "-")):
            rows = [r for r in self.rows if r.deflection == what and r.bandwidth_Hz]
            at = [r.bandwidth_Hz for r in rows]
            for encoder in ENCODERS:
                y = [next(iter(r.rms_pct[encoder].values())) for r in rows]
                curves.append((at, y, f"{encoder}, {what}", {"ls": line, "marker": "o"}))
        labels = (
            "bandwidth of the observer / Hz",
            "RMS error of the torque, sweep / % of full scale",
        )
        return panels([Panel(curves, *labels, {"xscale": "log", "yscale": "log"})], 7, 4.5)


class ChainStudy(Reproduction[WholeChain]):
    """The complete sensing task against the continuous model, by encoder, input and bandwidth."""

    name = "chain"
    title = "The sensing task's error by encoder and deflection"

    def run(self, say: Callable[[str], None], folder: Path | None) -> WholeChain:
        device = load_device("elbow")
        h, full = device.period_s, device.tau_full_scale_Nm
        exact = compile_device(with_numbers(device, {SENSE_RATE: FINE / h}), "f64").block("sensor")
        read = {e: with_numbers(device, {RESOLUTION: b}) for e, b in ENCODERS.items()}
        libraries = {e: compile_device(d, "f64") for e, d in read.items()}
        rows = [
            ChainRow(what, b, {e: {} for e in ENCODERS})
            for what in (COUNTS, SMOOTHED)
            for b in (*CHAIN_BANDWIDTHS_HZ, None)
        ]
        suited = {e: suited_bandwidth_Hz(b) for e, b in ENCODERS.items()}
        fine = motions(device.file.domain.theta_max_rad.value, h / FINE)
        for name, dense in fine.items():
            say(name)
            exact.reset()
            # The difference over a fine step is the rate in its middle.
            omega = np.diff(dense, prepend=dense[:1]) * FINE / h
            y, _ = exact.run({"theta_rad": dense, "omega_rad_s": omega}, trace=False)
            true, theta = y["tau_Nm"][::FINE], dense[::FINE]
            t = np.arange(len(theta)) * h
            kept = t >= START_S
            load = LOAD_RAD * (1 - np.cos(2 * np.pi * LOAD_HZ * t))
            for encoder, bits in ENCODERS.items():
                velocity, smoothing, sensor = (libraries[encoder].block(n) for n in BLOCKS)
                count = 2 * np.pi / 2**bits
                seen = (np.round((load + theta) / count) - np.round(load / count)) * count
                for row in rows:
                    velocity.prepare({"bandwidth_Hz": row.bandwidth_Hz or suited[encoder]})
                    velocity.reset()
                    sensor.reset()
                    rates, _ = velocity.run({"theta_rad": seen}, trace=False)
                    inputs = {"theta_rad": seen, "omega_rad_s": rates["omega_mid_rad_s"]}
                    if row.deflection == SMOOTHED:
                        smoothing.reset()
                        given = smoothing.run(inputs, trace=False)[0]["theta_smooth_rad"]
                        inputs["theta_rad"] = given
                    error = sensor.run(inputs, trace=False)[0]["tau_Nm"] - true
                    rms = float(np.sqrt(np.mean(error[kept] ** 2)))
                    row.rms_pct[encoder][name] = 100 * rms / full
        return WholeChain(device.name, rows, suited)
