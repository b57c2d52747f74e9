"""What the whole sensing task makes of encoders: counts or the smoothed deflection, by bandwidth.

Rate and torque together, emitted C, against the continuous model of the whole torque.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.plots import Panel, panels
from esea_gen.device import load_device, with_numbers
from esea_gen.devices.designed import suited_bandwidth_Hz
from esea_gen.hostlib.library import compile_device
from esea_gen.language.ports import Array
from esea_gen.reproduce.reproduction import Reproduction
from esea_gen.studies.uncertainty.motions import LOAD_HZ, LOAD_RAD, SENSE_RATE
from esea_gen.twin.trajectories import reaches

FINE = 16  # steps of the continuous model in a period
LASTING_S = 40.0
BANDWIDTHS_HZ = (10.0, 12.0, 15.0, 20.0, 30.0, 60.0)
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
    """One deflection for the sensor and one bandwidth; none: what suits each encoder."""

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
    """The whole sensing task against the continuous model, by encoder, deflection and bandwidth."""

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
            for b in (*BANDWIDTHS_HZ, None)
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
