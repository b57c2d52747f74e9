"""The velocity observer against filtered differences, for docs/velocity-errors.md.

python -m tests.benchmarks.velocity --json FILE
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from scipy import signal

import esea_gen
from esea_gen.hostlib.library import compile_device
from esea_gen.language.stream import single

H = 1e-3
FILTERS = ((1, 30.0), (2, 60.0), (2, 30.0), (2, 15.0), (4, 30.0), (4, 10.0))
T = np.arange(round(20 / H)) * H
DELTA, RATE = (np.radians(10) * f(np.pi * T**2 / 20) for f in (np.sin, np.cos))
LOAD = np.radians(45) * np.sin(0.4 * np.pi * T)


def figures(name: str, estimate) -> dict[str, object]:
    """Of a linear estimate, by its impulse response, and of a sweep read by two encoders."""
    impulse = estimate(np.eye(1, 2**13, 1)[0] * 1e-3)[1:] * 1e3
    f = np.linspace(0.05, 480, 20_000)
    gain = np.abs(signal.freqz(impulse, worN=f, fs=1 / H)[1]) / (2 * np.pi * f)
    at = np.argmax(gain < 0.5**0.5) - np.arange(2)
    row = {"rate": name, "noise_rad_s": [], "worst_rad_s": [], "error_rad_s": []}
    # By how much the estimate of a steady acceleration is late.
    row["delay_ms"] = abs(1e3 * float(np.sum(np.arange(len(impulse)) ** 2 * impulse)) * H**2 / 2)
    row["cut_Hz"] = float(np.interp(0.5**0.5, gain[at], f[at]))
    for count in (2 * np.pi / 2**bits for bits in (12, 14)):
        row["noise_rad_s"].append(float(np.sqrt(np.sum(impulse**2) / 6) * count))
        row["worst_rad_s"].append(float(np.sum(np.abs(impulse)) * count))
        read = (np.floor((LOAD + DELTA) / count) - np.floor(LOAD / count)) * count
        row["error_rad_s"].append(float(np.std((estimate(read) - RATE * np.pi * T / 10)[500:])))
    return row


def main() -> None:
    runner = compile_device(esea_gen.load_device("elbow"), "f64").block("velocity")

    def filtered(x, order=0, cut_Hz=0.0):
        b, a = signal.butter(order, cut_Hz, fs=1 / H) if order else ([1.0], [1.0])
        return signal.lfilter(b, a, np.diff(x, prepend=0.0) / H)

    def observed(x, bandwidth_Hz):
        runner.prepare({"bandwidth_Hz": bandwidth_Hz})
        runner.reset()
        return runner.run({"theta_rad": single(x)}, trace=False)[0]["omega_rad_s"].astype(float)

    rows = [figures("raw difference", filtered)]
    for n, hz in FILTERS:
        name = f"difference, Butterworth {n}, {hz:g} Hz"
        rows.append(figures(name, lambda x, n=n, hz=hz: filtered(x, n, hz)))
    for hz in (10.0, 15.0, 20.0, 30.0):
        rows.append(figures(f"observer, {hz:g} Hz", lambda x, hz=hz: observed(x, hz)))
    Path(sys.argv[-1]).write_text(json.dumps({"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
