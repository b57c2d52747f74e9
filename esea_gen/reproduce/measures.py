"""Recomputed values by the names of the published ones.

No value is stored here: the emitted C runs, or the Blocks, or arithmetic on printed numbers.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from esea_gen.device import load_device
from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity
from esea_gen.hostlib.library import compile_block
from esea_gen.language.ports import Array
from esea_gen.model.published_inverse import FILTER_B, PLAY_DEFAULTS, FilterName, published_inverse
from esea_gen.reproduce.torque_model import Chapter3, reproduce_chapter3, reproduce_chapter4
from esea_gen.studies.simulation import default_person, simulate
from esea_gen.studies.uncertainty.motions import SIGNALS
from esea_gen.twin.case import Setting

Numbers = dict[str, float]
SMC, MPC, BLIND = "smc-published", "mpc-published", "mpc-published-no-preview"
READINGS = {"reference known ahead": MPC, "not known ahead": BLIND}
PLANT = "real"
SYMBOLS = "alpha", "beta", "omega", "k1", "k3", "A", "B", "m", "n", "eps1", "eps2", "kv"
# Table 3.5: simple exercises at 0.2, 0.5 and 0.75 Hz, functional ones, rest between two in s.
SESSIONS = {"60 %": ((5, 5, 5), 5, 40), "80 %": ((7, 7, 7), 7, 12), "100 %": ((8, 8, 8), 10, 0)}
SIMPLE_Hz, SIMPLE_CYCLES = (0.2, 0.5, 0.75), 20
FUNCTIONAL_Hz, FUNCTIONAL_CYCLES = 0.2, 10  # five repetitions of four compressions


class Measures:
    def __init__(self, say: Callable[[str], None]) -> None:
        self.say = say
        self._errors: dict[tuple[str, str], dict[str, dict[str, Any]]] = {}

    def __call__(self, name: str) -> Numbers:
        self.say(name.replace("_", " "))
        found: Numbers = getattr(self, name)()
        return found

    # -- chapters 3 and 4 ------------------------------------------------------------------------

    @cached_property
    def _chapter3(self) -> Chapter3:
        return reproduce_chapter3(self.say)

    @cached_property
    def _chapter4(self) -> dict[str, Any]:
        return reproduce_chapter4(self.say).to_dict()

    def elbow_parameters(self) -> Numbers:
        return _parameters(load_device("elbow"))

    def knee_parameters(self) -> Numbers:
        device = load_device("knee_printed")
        dead = device.elastomer.dead_zone_rad
        assert dead is not None
        return _parameters(device) | {"dead_zone_deg": math.degrees(dead.value)}

    def session_minutes(self) -> Numbers:
        """Minutes of use and of rest by the counts of table 3.5."""
        found = {}
        for name, (simple, functional, rest_s) in SESSIONS.items():
            exercises = sum(simple) + functional
            active_s = functional * FUNCTIONAL_CYCLES / FUNCTIONAL_Hz + sum(
                n * SIMPLE_CYCLES / f for n, f in zip(simple, SIMPLE_Hz, strict=True)
            )
            found[f"{name} active"] = active_s / 60
            found[f"{name} rest"] = (exercises - 1) * rest_s / 60
        return found

    def rest_at_80(self) -> Numbers:
        return {"minutes": self.session_minutes()["80 % rest"]}

    def _of_chapter3(self, *names: str) -> Numbers:
        figures = self._chapter3.figures.items()
        return {f.meaning: f.ours for name, f in figures if name.startswith(names)}

    def torque_range(self) -> Numbers:
        (value,) = self._of_chapter3("sweep_peak").values()
        return {"largest torque": value}

    def relaxation(self) -> Numbers:
        return self._of_chapter3("relaxation")

    def loops(self) -> Numbers:
        return self._of_chapter3("slow", "loop")

    def inverse_parameters(self) -> Numbers:
        return {k.split("_")[0]: v for k, v in PLAY_DEFAULTS.items()}

    def torque_signals(self) -> Numbers:
        found = {f"S{i} amplitude": s.amplitude_Nm for i, s in enumerate(SIGNALS, 1)}
        return found | {f"S{i} end": s.end_Hz for i, s in enumerate(SIGNALS, 1)}

    def _inverse_errors(self, table: str) -> Numbers:
        rows = {"no observer": "no_dob", "filter A": "filter_a", "filter B": "filter_b"}
        errors = {name: self._chapter4[table][row] for name, row in rows.items()}

        def named(variant: str, more: str = "") -> Numbers:
            return {
                f"{name}, S{i}{more}": float(e)
                for name, row in errors.items()
                for i, e in enumerate(row[variant], 1)
            }

        # Inside the rounding of the printed coefficients, which is what was run then.
        return named("rounding") | named("printed", ", coefficients to the printed digit")

    def table_4_4(self) -> Numbers:
        return self._inverse_errors("table_4_4")

    def table_4_5(self) -> Numbers:
        return self._inverse_errors("table_4_5")

    def _setpoint(self, filter_name: FilterName | None, signal: int) -> Array:
        # As the published inverse gives it, rad, with its emitted C.
        device = load_device("elbow")
        runner = compile_block(published_inverse(device, filter_name))
        given = {"tau_Nm": SIGNALS[signal - 1].sample(1 / device.period_s)}
        return np.asarray(runner.run(given, trace=False)[0]["theta_rad"], dtype=float)

    def chatter(self) -> Numbers:
        """Roughness of the set-points: RMS of their second difference, ends left out."""

        def rough(values: Array) -> float:
            return float(np.sqrt(np.mean(np.diff(values, 2)[1000:-1000] ** 2)))

        a, b = ({k: rough(self._setpoint(f, k)) for k in (3, 4, 5)} for f in ("a", "b"))
        found: Numbers = {f"times rougher, S{k}": b[k] / a[k] for k in b}
        return {"set-point of signal 3 rougher with B than with A (1 yes)": b[3] > a[3]} | found

    def crossings(self) -> Numbers:
        """Largest speed of the set-points of signal 4, deg/s."""
        device = load_device("elbow")
        names: dict[str, FilterName | None] = {"none": None, "A": "a", "B": "b"}
        found: Numbers = {}
        for name, chosen in names.items():
            speed = np.abs(np.diff(self._setpoint(chosen, 4))) / device.period_s
            found[f"{name} / deg/s"] = math.degrees(float(speed.max()))
        known = math.degrees(device.file.domain.omega_max_rad_s.value)
        beyond = sum(x > known for x in found.values())
        return {"procedures beyond 61.6 deg/s, of 3": beyond} | found

    def filter_b_gain(self) -> Numbers:
        """Gain of the printed coefficients, over their gain at rest."""

        def gain(f_Hz: float) -> float:
            turn = -2j * math.pi * f_Hz / 1000
            return abs(sum(c * cmath.exp(turn * k) for k, c in enumerate(FILTER_B)))

        found = {f"gain at {f:g} Hz": gain(f) / gain(0) for f in (50, 160)}
        return {"sum of the coefficients": sum(FILTER_B)} | found

    def cubic_root(self) -> Numbers:
        p = _parameters(load_device("elbow"))
        roots = np.roots([p["k3"], 0, p["k1"], -4.5])
        return {"root at 4.5 Nm / rad": float(roots[np.abs(roots.imag) < 1e-9].real[0])}

    # -- chapter 5, simulated --------------------------------------------------------------------

    def _runs(self, study: str, controller: str) -> dict[str, dict[str, Any]]:
        key = study, controller
        if key not in self._errors:
            self.say(f"{study} with {controller}, simulated")
            setting = Setting(controller, PLANT, default_person(study, PLANT))
            self._errors[key] = {c["name"]: c for c in simulate(study, setting).cases()}
        return self._errors[key]

    def tuning(self) -> Numbers:
        """Tuning case by the device's own sensor, as in the thesis."""
        names = {"SMC": SMC, "MPC, reference known ahead": MPC, "MPC, not known ahead": BLIND}
        found = {}
        for name, controller in names.items():
            (run,) = self._runs("tuning", controller).values()
            found[name] = float(run["rms_model_Nm"])
        return found

    def tuning_order(self) -> Numbers:
        smc, known, blind = self.tuning().values()
        return {
            "MPC below SMC, reference known ahead (1 yes)": known < smc,
            "MPC below SMC, not known ahead (1 yes)": blind < smc,
        }

    def _ahead(self, study: str, better: str, worse: str, without: str = "-") -> int:
        # Cases in which one controller has the smaller error; a run that ended has lost.
        ones, others = self._runs(study, better), self._runs(study, worse)
        compared = [n for n in ones if not n.startswith(without)]
        return sum(_error(ones[n]) < _error(others[n]) for n in compared)

    def grid(self) -> Numbers:
        excepted = "3 Nm 1 Hz"
        failed = [r for n, r in self._runs("twists", SMC).items() if n.startswith(excepted)]
        found: Numbers = {
            f"points at which MPC is below SMC, {reading}, of 33": self._ahead(
                "twists", law, SMC, excepted
            )
            for reading, law in READINGS.items()
        }
        return found | {
            "twists at which 3 Nm 1 Hz trips SMC's drive, of 3": sum(r["tripped"] for r in failed),
            "the same with an error beyond 3 Nm": sum(r["unstable"] for r in failed),
        }

    def backdriven(self) -> Numbers:
        found = self._ahead("backdriven", SMC, MPC)
        return {"frequencies at which SMC is below MPC, of 4": found}

    def bread(self) -> Numbers:
        return {"set torques at which SMC is below MPC, of 2": self._ahead("bread", SMC, MPC)}

    def impedance(self) -> Numbers:
        name = "gains other than 0 at which MPC is below SMC"
        found: Numbers = {
            f"{name}, {reading.replace('reference', 'path')}, of 2": self._ahead(
                "impedance", law, SMC, "Kp 0 Kd 0"
            )
            for reading, law in READINGS.items()
        }
        for law in (SMC, MPC):
            share = self._runs("impedance", law)["Kp 0 Kd 0"]["rms_model_Nm"]
            found[f"{law}, both gains 0 / Nm"] = float(share)
        return found

    # -- chapter 8 -------------------------------------------------------------------------------

    def knee_swapped(self) -> Numbers:
        return {name: _maxwell_peak(load_device(name)) for name in ("knee_printed", "knee")}

    def knee_speed(self) -> Numbers:
        """Largest speed of a sine of 0.3 Hz, deg/s: 130 deg as amplitude, and peak to peak."""
        turn = 2 * math.pi * 0.3
        return {"as amplitude / deg/s": 130 * turn, "peak to peak / deg/s": 65 * turn}


def _error(run: Mapping[str, Any]) -> float:
    ended = run["unstable"] or run["tripped"]
    return math.inf if ended else float(run["rms_model_Nm"])


def _parameters(device: DeviceData) -> Numbers:
    # By their symbols: what a key has before its unit.
    sections = device.elastomer, device.elastomer.maxwell
    numbers = {k: q for part in sections for k, q in vars(part).items() if isinstance(q, Quantity)}
    short = {k.partition("_")[0]: q.value for k, q in numbers.items()}
    return {k: short[k] for k in SYMBOLS}


def _maxwell_peak(device: DeviceData) -> float:
    # (3.3) and (3.4) by small steps, exact for a viscosity that is held over one.
    p = _parameters(device)
    dead = device.elastomer.dead_zone_rad
    zone = dead.value if dead else 0.0
    h, turn, most = 1e-4, 2 * math.pi * 3.0, math.radians(15)
    t = np.arange(0, 1.0, h)
    theta = most * np.sin(turn * t)
    theta = np.sign(theta) * np.maximum(np.abs(theta) - zone, 0)
    rate = np.gradient(theta, h)
    eta = (p["A"] * np.abs(theta) ** p["m"] + p["eps1"]) / (
        p["B"] * np.abs(rate) ** p["n"] + p["eps2"]
    )
    torque, peak = 0.0, 0.0
    for viscosity, speed in zip(eta, rate, strict=True):
        keep = math.exp(-h * p["kv"] / viscosity)
        torque = keep * torque + (1 - keep) * viscosity * speed
        peak = max(peak, abs(torque))
    return peak
