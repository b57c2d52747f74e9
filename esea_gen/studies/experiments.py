"""The thesis' experiments on the virtual exoskeleton: a controller's C against plants and people.

An experiment is a list of cases.  A case is a trajectory with what it is judged by; a run puts the
compiled controller, as it ships, and the plant's C into one loop and compares the torque of the
true elastomer, and the torque that the sensor shows, with the desired one.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen import devices
from esea_gen.analysis.campaign import Workers, run_cases
from esea_gen.analysis.frequency import FrequencyResponse
from esea_gen.analysis.journal import Configuration, files_digest, rooms_digest
from esea_gen.analysis.monte_carlo import MonteCarlo
from esea_gen.analysis.response import StepMetrics, step_metrics
from esea_gen.analysis.sweeps import Impedance, Sweep, impedance, sweep_response
from esea_gen.control.horizon import Horizon
from esea_gen.control.laws.predictive import device_horizon
from esea_gen.device import Device, load_device
from esea_gen.devices.file import read_file
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.language.system import System
from esea_gen.twin import trajectories
from esea_gen.twin.closed_loop import ClosedLoop, ClosedLoopRun
from esea_gen.twin.people import PlantVariant, ideal_plant, random_person, random_plant, real_plant
from esea_gen.twin.published import PEOPLE, PLANTS
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CONTROLLERS = Path(devices.__file__).parent / "controllers"
CONTROLLERS = {
    "smc": "elbow_drive",
} | {
    name: str(_CONTROLLERS / f"{name}.toml")
    for name in (
        "smc-published",
        "mpc",
        "mpc-no-preview",
        "mpc-published",
        "mpc-published-no-preview",
    )
}
FIGURES = (
    "rms_true_Nm",
    "rms_model_Nm",
    "max_true_Nm",
    "unstable",
    "tripped",
    "fault",
    "limited_share",
    "roughness_Nm_s",
    "largest_desired_Nm",
    "rms_normalised",
)
ENDED = ("unstable", "tripped", "fault")
MOST_PANELS = 4  # more cases than this are drawn as bars
# The thesis weighs the impedance experiment otherwise than the torque experiments.
PRINTED_IMPEDANCE = {"Q": 1.0, "R": 0.005}
PLANT_NAMES = ("ideal", "real", "random")
PERSON_NAMES = ("none", "ideal", "uncertain", "random")
GRID_NM = {0.25: (1, 2, 3, 4), 0.5: (1, 2, 3, 4), 1.0: (1, 2, 3), 1.5: (0.75,)}
BACKDRIVEN_HZ = (0.1, 0.15, 0.2, 0.25)
GAINS = ((0.0, 0.0), (0.75, 0.25), (1.5, 0.25))
STEPS_NM = (0.5, 1.0, 2.0)
SWEEP = Sweep(0.05, 10.0, 60.0, start_s=1.0)
MOTION = Sweep(0.1, 5.0, 100.0, start_s=1.0)
SWEEP_NM, SWEEP_RAD = 0.5, 0.1
FIT_HZ = (0.5, 4.0)
SWEEP_MIDDLE_RAD = 0.8
OFF, TORQUE, IMPEDANCE = 0, 1, 2
# The controller is off at first and armed meanwhile, as after a start of the firmware; a slow
# control task must have given two commands before.
ARM_S, ON_S = 0.03, 0.06
ARM_PERIODS, ON_PERIODS = 2.5, 3.0
STEP_AT_S = 1.0
# RMS of the thesis, on its own device and with its own torque sensor.
THESIS_NM = {
    ("smc-published", "tuning"): 0.590,
    ("mpc-published", "tuning"): 0.386,
    ("mpc-published-no-preview", "tuning"): 0.386,
}


@dataclass(frozen=True)
class Case:
    """One run of an experiment.

    trajectory: path, desired torque and analysed window.
    tunables: ``{instance: {tunable: value}}`` of the controller.
    plant: tunables of the plant beside the variant's.
    """

    name: str
    trajectory: Trajectory
    mode: int = TORQUE
    tunables: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    plant: Mapping[str, float] = field(default_factory=dict)


def _fixed(name: str, tau_Nm: Array, start: int) -> Trajectory:
    rest = np.zeros(len(tau_Nm))
    return Trajectory(name, rest, rest, rest, tau_Nm, start, len(tau_Nm), True)


def _tuning() -> list[Case]:
    return [Case("1.7 Nm 0.6 Hz", trajectories.fixed_sinusoid(1.7, 0.6))]


def _grid() -> list[Case]:
    return [
        Case(f"{torque:g} Nm {f:g} Hz", trajectories.fixed_sinusoid(torque, f))
        for f, torques in GRID_NM.items()
        for torque in torques
    ]


def _twists() -> list[Case]:
    return [
        dataclasses.replace(c, name=f"{c.name}, twist {angle} deg", plant=dataclasses.asdict(t))
        for angle, t in PLANTS.twist.items()
        for c in _grid()
    ]


def _backdriven() -> list[Case]:
    return [Case(f"{f:g} Hz", trajectories.backdriven(f)) for f in BACKDRIVEN_HZ]


def _bread() -> list[Case]:
    return [Case(f"{tau:g} Nm", trajectories.bread(tau)) for tau in (0.0, 2.0)]


def _impedance() -> list[Case]:
    return [
        Case(
            f"Kp {kp:g} Kd {kd:g}",
            trajectories.impedance(),
            IMPEDANCE,
            {"reference": {"Kp_Nm_rad": kp, "Kd_Nms_rad": kd}},
        )
        for kp, kd in GAINS
    ]


def _step() -> list[Case]:
    t = np.arange(round(4 * RATE_HZ)) / RATE_HZ
    return [
        Case(f"{tau:g} Nm", _fixed("step", np.where(t >= STEP_AT_S, tau, 0.0), 2000))
        for tau in STEPS_NM
    ]


def _sweep_time(sweep: Sweep) -> Array:
    return np.arange(round((sweep.start_s + sweep.duration_s) * RATE_HZ)) / RATE_HZ


def _frequency() -> list[Case]:
    t = _sweep_time(SWEEP)
    tau = np.where(t >= SWEEP.start_s, SWEEP_NM * np.sin(SWEEP.phase_rad(t)), 0.0)
    return [Case(f"{SWEEP_NM:g} Nm", _fixed("sweep of the torque", tau, 1000))]


def _output_impedance() -> list[Case]:
    t = _sweep_time(MOTION)
    moving = t >= MOTION.start_s
    f = MOTION.start_Hz + MOTION.rate_Hz_s * (t - MOTION.start_s)
    # One acceleration above 1 Hz, so that the motor's limit is not what is measured.
    size = SWEEP_RAD / np.maximum(1.0, f) ** 2
    theta = SWEEP_MIDDLE_RAD + np.where(moving, size * np.sin(MOTION.phase_rad(t)), 0.0)
    omega = np.gradient(theta, 1 / RATE_HZ)
    alpha = np.gradient(omega, 1 / RATE_HZ)
    zero = np.zeros(len(t))
    path = Trajectory("sweep of the angle", theta, omega, alpha, zero, 1000, len(t))
    # A firm hand: the load follows the path, whatever the torque.
    firm = {"spring_Nm_rad": 400.0, "damping_Nms_rad": 10.0, "torque_noise_Nm": 0.0}
    return [Case(f"{SWEEP_RAD:g} rad", path, plant=firm)]


@dataclass(frozen=True)
class Experiment:
    """An experiment.

    person: whether somebody moves the load; else the output is fixed.
    """

    title: str
    cases: Callable[[], list[Case]]
    person: bool = False


EXPERIMENTS = {
    "tuning": Experiment("Tuning case, output fixed", _tuning),
    "grid": Experiment("Twelve points of the operating space, output fixed", _grid),
    "twists": Experiment("The twelve points at three cable twists, output fixed", _twists),
    "backdriven": Experiment("Backdriven at 0 Nm", _backdriven, True),
    "bread": Experiment("Bread cutting at 0 and 2 Nm", _bread, True),
    "impedance": Experiment("Impedance: reaching in 2 s and back", _impedance, True),
    "step": Experiment("Step of the desired torque, output fixed", _step),
    "frequency": Experiment("Frequency response of the torque, output fixed", _frequency),
    "output-impedance": Experiment("Output impedance at 0 Nm, moved", _output_impedance, True),
}


def _choice(what: str, given: str, known: Sequence[str]) -> None:
    if given not in known:
        raise UserError(f"Unknown {what} '{given}'.", f"Choose from {', '.join(known)}.")


def controller_device(controller: str) -> Device:
    """Device of a controller.

    controller: key of ``CONTROLLERS``, or path of a device file with a drive.
    """
    if controller not in CONTROLLERS and not controller.endswith(".toml"):
        raise UserError(
            f"Unknown controller '{controller}'.",
            f"Choose from {', '.join(CONTROLLERS)}, or give the path of a device file.",
        )
    name = CONTROLLERS.get(controller, controller)
    device = _device(name, read_file(name)[0])
    if not device.laws:
        raise UserError(
            f"{device.origin}: the device has no drive to be simulated.",
            'Write extends = "elbow_drive" in it.',
        )
    rate = device.file.timing.sense_rate_Hz.value
    if rate != RATE_HZ:
        raise UserError(
            f"{device.origin}: timing.sense_rate_Hz = {rate:g} Hz; the experiments' signals have a "
            f"sample every {1000 / RATE_HZ:g} ms and would be played at another speed.",
            f"Simulate a device with {RATE_HZ:g} Hz.",
        )
    return device


# By its text as well: a device file may be edited between two runs.  To read one takes longer than
# to simulate two seconds.
@lru_cache(maxsize=8)
def _device(name: str, _text: str) -> Device:
    return load_device(name)


def controller_system(controller: str) -> System:
    """System of a controller: which Blocks it has, and their tunables."""
    return controller_device(controller).system


def default_person(experiment: str, plant: str) -> str:
    """Who takes part when nobody is named.

    return: ``none`` with a fixed output, else the person that goes with the plant.
    """
    if experiment in EXPERIMENTS and not EXPERIMENTS[experiment].person:
        return "none"
    return {"ideal": "ideal", "random": "random"}.get(plant, "uncertain")


def plant_variant(device: Device, plant: str, person: str, seed: int) -> PlantVariant:
    """A plant with a person.

    person: ``none``, ``ideal``, ``uncertain`` or ``random``; none fixes the output.
    """
    _choice("plant", plant, PLANT_NAMES)
    _choice("person", person, PERSON_NAMES)
    made = {
        "ideal": lambda: ideal_plant(device),
        "real": lambda: real_plant(device, seed=seed),
        "random": lambda: random_plant(device, seed),
    }[plant]()
    if person == "none":
        return made.having(PEOPLE["none"], clamped=1.0)
    return made.having(random_person(seed) if person == "random" else PEOPLE[person])


@lru_cache(maxsize=8)
def _loop(device: Device, cable: bool, real: str) -> ClosedLoop:
    variant = real_plant(device) if cable else ideal_plant(device)
    return ClosedLoop(device.system, variant, real)


def previews(path: Trajectory, horizon: Horizon) -> dict[str, Array]:
    """What a predictive controller with a known future is given.

    return: ``tau_preview_Nm``, ``theta_preview_rad`` and ``omega_preview_rad_s``, each of shape
        (ticks, intervals): the values at the end of every interval; the last ones hold.
    """
    # The control task reads what was measured a tick ago.
    ticks = np.rint(np.array(horizon.ends_s) * RATE_HZ).astype(int) - 1
    n = len(path.tau_desired_Nm)
    at = np.minimum(np.arange(n)[:, None] + ticks, n - 1)
    given = {
        "tau_preview_Nm": path.tau_desired_Nm,
        "theta_preview_rad": path.theta_p_rad,
        "omega_preview_rad_s": path.omega_p_rad_s,
    }
    return {name: np.asarray(values[at]) for name, values in given.items()}


@dataclass(frozen=True)
class Setting:
    """What an experiment runs with.

    controller: key of ``CONTROLLERS`` or path of a device file.
    real: number format of the controller's C.
    tunables: ``{instance: {tunable: value}}`` beside each case's own.
    """

    controller: str = "smc"
    plant: str = "real"
    person: str = "none"
    real: str = "f32"
    tunables: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def run_case(case: Case, setting: Setting, seed: int) -> ClosedLoopRun:
    """Run one case."""
    device = controller_device(setting.controller)
    person = "none" if case.trajectory.clamped else setting.person
    variant = plant_variant(device, setting.plant, person, seed)
    return run_on(_loop(device, variant.cable, setting.real), device, variant, case, setting, seed)


def run_on(
    loop: ClosedLoop,
    device: Device,
    variant: PlantVariant,
    case: Case,
    setting: Setting,
    seed: int,
) -> ClosedLoopRun:
    """Run one case on a loop that is compiled already.

    loop: the device's System, or one that shows more of it, with a plant.
    """
    fixed = case.trajectory.clamped
    n = len(case.trajectory.tau_desired_Nm)
    t = np.arange(n) / RATE_HZ
    slow_s = device.system.tasks[-1].every / RATE_HZ
    signals = case.trajectory.signals() | {
        "mode": np.where(t < max(ON_S, ON_PERIODS * slow_s), OFF, case.mode).astype(float),
        "rearm": (t >= max(ARM_S, ARM_PERIODS * slow_s)).astype(float),
        "stop": np.zeros(n),
        "frame_error_motor": np.zeros(n),
        "frame_error_load": np.zeros(n),
    }
    merged = {k: dict(v) for k, v in setting.tunables.items()}
    if "predictive" in device.system.blocks:
        given = previews(case.trajectory, device_horizon(device))
        signals |= {k: v for k, v in given.items() if k in loop.signals}
        chosen = {"load_free": 0.0 if fixed else 1.0}
        if case.mode == IMPEDANCE and setting.controller.startswith("mpc-published"):
            chosen |= PRINTED_IMPEDANCE
        merged["predictive"] = chosen | merged.get("predictive", {})
    for instance, values in case.tunables.items():
        merged.setdefault(instance, {}).update(values)
    # A variant knows only what its plant has: the rigid one has no cable to twist.
    known = {x.name for b in loop.plant.blocks.values() for x in b.tunables}
    extra = {k: v for k, v in case.plant.items() if k in known}
    return loop.run(signals, {**variant.values, **extra}, merged, seed=seed)


def desired_torque(case: Case, run: ClosedLoopRun) -> Array:
    """The torque that a case asks for, from the true motion.

    return: in Nm, one a millisecond: in impedance mode the spring and damper on the true angle.
    """
    path = case.trajectory
    if case.mode != IMPEDANCE:
        return path.tau_desired_Nm
    gains = case.tunables["reference"]
    wanted = gains["Kp_Nm_rad"] * (path.theta_p_rad - run.plant["theta_l_rad"])
    return np.asarray(
        path.tau_desired_Nm
        + wanted
        + gains["Kd_Nms_rad"] * (path.omega_p_rad_s - run.plant["omega_l_rad_s"])
    )


def judge(case: Case, run: ClosedLoopRun, u_max_Nm: float) -> dict[str, float]:
    """The figures of a run.

    return: ``rms_true_Nm``, ``rms_model_Nm``, ``max_true_Nm``, ``unstable``, ``tripped`` and
        ``fault`` (1 or 0), the share of samples with the command at the limit, the command's
        roughness, and ``rms_normalised`` in impedance mode.
    """
    w = case.trajectory.window
    desired = desired_torque(case, run)
    true, model = run.plant["tau_e_Nm"] - desired, run.controller["tau_Nm"] - desired
    speed = np.max(np.abs(run.plant["omega_g_rad_s"]))
    u = run.controller["u_Nm"][w]

    def rms(a: Array) -> float:
        return float(np.sqrt(np.mean(np.square(a))))

    worst = float(np.max(np.abs(true[w])))
    limits = PLANTS.unstable
    out = {
        "rms_true_Nm": rms(true[w]),
        "rms_model_Nm": rms(model[w]),
        "max_true_Nm": worst,
        "unstable": float(worst > limits.max_true_error_Nm or speed > limits.max_gear_speed_rad_s),
        "tripped": float(np.max(run.plant["tripped"]) > 0),
        "fault": float(np.max(run.controller["fault"][w]) > 0),
        "limited_share": float(np.mean(np.abs(u) >= 0.999 * u_max_Nm)),
        "roughness_Nm_s": rms(np.diff(u)) * RATE_HZ,
    }
    if case.mode == IMPEDANCE:
        largest = float(np.max(np.abs(desired[w])))
        out["largest_desired_Nm"] = largest
        if largest > 0:
            out["rms_normalised"] = out["rms_true_Nm"] / largest
    return out


def simulate_case(
    experiment: str,
    case: str,
    seed: int,
    controller: str,
    plant: str,
    person: str,
    real: str,
    tunables: Mapping[str, Mapping[str, float]] | None = None,
) -> dict[str, float]:
    """Run and judge one case by name: what a worker does."""
    setting = Setting(controller, plant, person, real, tunables or {})
    found = next(c for c in EXPERIMENTS[experiment].cases() if c.name == case)
    actuator = controller_device(controller).file.actuator
    assert actuator is not None
    return judge(found, run_case(found, setting, seed), actuator.u_max_Nm.value)


@dataclass(frozen=True)
class Simulation:
    """An experiment's outcome.

    monte_carlo: figures of every case and seed.
    first: every case at the first seed, with its signals.
    steps: per case of the step experiment.
    response: of the frequency experiment, first seed.
    port: of the output-impedance experiment, first seed.
    """

    experiment: str
    setting: Setting
    seeds: tuple[int, ...]
    monte_carlo: MonteCarlo
    first: tuple[tuple[Case, ClosedLoopRun], ...]
    steps: dict[str, StepMetrics]
    response: FrequencyResponse | None
    port: Impedance | None

    def cases(self) -> list[dict[str, Any]]:
        """One entry a case and seed; a run that failed is unstable and says why."""
        entries = []
        for r in self.monte_carlo.results:
            entry: dict[str, Any] = {"name": r.case["case"], "seed": r.case["seed"]}
            if r.values is None:
                entry |= dict.fromkeys(("rms_true_Nm", "rms_model_Nm", "max_true_Nm"))
                entry |= {"unstable": True, "failure": r.failure}
            else:
                # In one order, whether it was run now or comes out of a journal.
                entry |= {k: r.values[k] for k in FIGURES if k in r.values}
                entry |= {k: bool(r.values[k]) for k in ENDED}
            entry["thesis_rms_Nm"] = THESIS_NM.get((self.setting.controller, self.experiment))
            entries.append(entry)
        return entries

    def ended(self) -> list[dict[str, Any]]:
        """Runs that were unstable, tripped, latched or failed: their errors judge no controller."""
        return [e for e in self.cases() if any(e.get(k) for k in ENDED)]

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: ``cases``, percentiles by case, and what the experiment is for."""
        names = list(dict.fromkeys(r.case["case"] for r in self.monte_carlo.results))
        content: dict[str, Any] = {
            "experiment": self.experiment,
            "title": EXPERIMENTS[self.experiment].title,
            "controller": self.setting.controller,
            "plant": self.setting.plant,
            "person": self.setting.person if EXPERIMENTS[self.experiment].person else "none",
            "format": self.setting.real,
            "content_hash": self.monte_carlo.configuration.parts["controller_hash"],
            "seeds": list(self.seeds),
            "cases": self.cases(),
            "ended_runs": len(self.ended()),
        }
        if len(self.seeds) > 1:
            content["percentiles"] = {
                n: {k: p.to_dict() for k, p in self.monte_carlo.summary({"case": n}).items()}
                for n in names
            }
        if self.steps:
            content["steps"] = {k: m.to_dict() for k, m in self.steps.items()}
        if self.response is not None:
            content["frequency_response"] = self.response.to_dict()
            content["bandwidth"] = dataclasses.asdict(self.response.bandwidth())
            content["margins"] = dataclasses.asdict(self.response.open_loop().margins())
        if self.port is not None:
            content["output_impedance"] = self.port.to_dict()
            content["impedance_fit"] = dataclasses.asdict(self.port.fit(*FIT_HZ))
        return content

    def table(self) -> list[str]:
        """The outcome as lines of text."""
        s = self.setting
        person = s.person if EXPERIMENTS[self.experiment].person else "none"
        lines = [
            f"{EXPERIMENTS[self.experiment].title}: {s.controller}, plant {s.plant}, person "
            f"{person}, {len(self.seeds)} run{'s' if len(self.seeds) > 1 else ''} a case"
        ]
        heads: tuple[str, ...] = ("RMS true", "RMS model", "max true", "thesis", "limited")
        normalised = self.experiment == "impedance"
        if normalised:
            heads = (*heads, "of largest")
        lines.append(f"{'case':32}" + "".join(f"{h:>11}" for h in heads))
        by_name: dict[str, list[dict[str, Any]]] = {}
        for entry in self.cases():
            by_name.setdefault(entry["name"], []).append(entry)
        for name, entries in by_name.items():
            good = [e for e in entries if e["rms_true_Nm"] is not None]
            keys = ("rms_true_Nm", "rms_model_Nm", "max_true_Nm")
            cells = [float(np.median([e[k] for e in good])) if good else math.nan for k in keys]
            thesis = entries[0]["thesis_rms_Nm"]
            row = "".join(f"{c:>11.4f}" for c in cells)
            row += f"{thesis:>11.3f}" if thesis else f"{'-':>11}"
            share = float(np.median([e["limited_share"] for e in good])) if good else math.nan
            row += f"{100 * share:>10.1f}%"
            if normalised:
                # The thesis' measure: RMS over the largest desired torque.
                shares = [e["rms_normalised"] for e in good if "rms_normalised" in e]
                row += f"{100 * float(np.median(shares)):>10.1f}%" if shares else f"{'-':>11}"
            words = [
                f"{sum(bool(e.get(k)) for e in entries)} {text}"
                for k, text in (
                    ("unstable", "UNSTABLE"),
                    ("tripped", "drive tripped"),
                    ("fault", "fault latched"),
                )
                if any(e.get(k) for e in entries)
            ]
            lines.append(f"{name:32}{row}  {', '.join(words)}".rstrip())
            reasons = dict.fromkeys(e["failure"] for e in entries if e.get("failure"))
            lines += [f"  failed: {reason}" for reason in reasons]
        runs, ended = len(self.monte_carlo.results), len(self.ended())
        if ended:
            lines.append(
                f"{ended} of {runs} runs were unstable, tripped, latched or failed; what is given "
                "of their errors includes the time after that"
            )
        done = [r for r in self.monte_carlo.results if r.values is not None]
        if len(self.seeds) > 1 and done:
            every = self.monte_carlo.values("rms_true_Nm")
            low, middle, high = np.percentile(every, [5, 50, 95])
            lines.append(
                f"all runs: RMS true 5 % {low:.4f}, median {middle:.4f}, 95 % {high:.4f}, mean "
                f"{every.mean():.4f}, max {every.max():.4f} Nm; medians above"
            )
        for name, metrics in self.steps.items():
            lines += [f"step {name}", *(f"  {x}" for x in metrics.table())]
        if self.response is not None:
            band, margins = self.response.bandwidth(), self.response.open_loop().margins()
            at = f"{band.bandwidth_Hz:.3g} Hz" if band.bandwidth_Hz else "beyond the sweep"
            lines.append(f"bandwidth (-3 dB of the {band.reference}): {at}")
            if margins.phase_margin_deg is not None:
                lines.append(
                    f"open loop from T/(1-T): phase margin {margins.phase_margin_deg:.0f} deg at "
                    f"{margins.phase_margin_Hz:.3g} Hz"
                )
            lines += self.response.table()
        if self.port is not None:
            lines += self.port.table(12, *FIT_HZ)
        return lines

    def csv(self) -> str:
        """Every case and seed, one line each."""
        entries = self.cases()
        keys = list(dict.fromkeys(k for e in entries for k in e))
        rows = [",".join(keys)]
        for e in entries:
            cells = [e.get(k) for k in keys]
            rows.append(
                ",".join(
                    "" if c is None else f'"{c}"' if isinstance(c, str) else f"{c}" for c in cells
                )
            )
        return "\n".join(rows) + "\n"

    def figure(self) -> Figure:
        """What the experiment is for: Bode, impedance, torque in time, or RMS by case."""
        from esea_gen.analysis import plots

        label = f"{self.setting.controller}, {self.setting.plant}"
        if self.response is not None:
            return plots.bode([(label, self.response)], [(label, self.response.bandwidth())])
        if self.port is not None:
            return plots.output_impedance([(label, self.port)])
        if len(self.seeds) > 1:
            names = list(dict.fromkeys(r.case["case"] for r in self.monte_carlo.results))
            found = ((n, self.monte_carlo.summary({"case": n}).get("rms_true_Nm")) for n in names)
            rows = [(n, p) for n, p in found if p is not None]
            if not rows:
                raise UserError("No run finished: there is nothing to draw.", "See the table.")
            return plots.percentile_bars(rows)
        panels = [self._panel(case, run) for case, run in self.first]
        if len(panels) == 1 or self.experiment == "step":
            name, *curves = panels[-1]
            return plots.torque_tracking(*curves, title=f"{name}: {label}")
        if len(panels) <= MOST_PANELS:
            return plots.torque_cases(panels, title=label)
        entries = self.cases()
        thesis = [e["thesis_rms_Nm"] or math.nan for e in entries]
        values = [math.nan if e["rms_true_Nm"] is None else e["rms_true_Nm"] for e in entries]
        return plots.rms_by_case(
            [e["name"] for e in entries],
            {label: np.array(values)},
            {label: np.array(thesis)} if np.isfinite(thesis).any() else None,
        )

    def _panel(self, case: Case, run: ClosedLoopRun) -> tuple[str, Array, Array, Array, Array]:
        w = case.trajectory.window
        w = slice(w.start, min(w.stop, w.start + round(10 * RATE_HZ)))
        if self.experiment == "step":
            w = slice(0, None)
        return (
            case.name,
            run.time_s[w],
            desired_torque(case, run)[w],
            run.plant["tau_e_Nm"][w],
            run.controller["tau_Nm"][w],
        )


def simulate(
    experiment: str,
    setting: Setting | None = None,
    *,
    seed: int = 0,
    runs: int = 1,
    workers: int | Workers = 1,
    folder: Path | None = None,
    progress: Callable[[int, int, int], None] | None = None,
) -> Simulation:
    """Run an experiment.

    folder: of the journal: an interrupted experiment goes on where it was.
    progress: ``progress(done, total, failed)``.
    """
    s = setting or Setting()
    _choice("experiment", experiment, tuple(EXPERIMENTS))
    _choice("plant", s.plant, PLANT_NAMES)
    _choice("person", s.person, PERSON_NAMES)
    chosen = EXPERIMENTS[experiment]
    if chosen.person and s.person == "none":
        raise UserError(
            f"{experiment} needs somebody who moves the load, but person is none.",
            "Give --person ideal, uncertain or random.",
        )
    if runs < 1 or seed < 0:
        raise UserError(f"runs = {runs}, seed = {seed}.", "Give 1 run or more, and a seed from 0.")
    device = controller_device(s.controller)
    cases = chosen.cases()
    seeds = tuple(range(seed, seed + runs))
    fixed: dict[str, Any] = {
        "controller": s.controller,
        "plant": s.plant,
        "person": s.person,
        "real": s.real,
        "tunables": {k: dict(v) for k, v in s.tunables.items()},
    }
    # Compile once, before the workers would each do it.
    loop = _loop(device, s.plant != "ideal", s.real)
    monte_carlo = run_cases(
        simulate_case,
        [
            {"experiment": experiment, "case": c.name, "seed": k, **fixed}
            for k in seeds
            for c in cases
        ],
        configuration=Configuration(
            {
                "controller": s.controller,
                "controller_hash": device_hash(device),
                "c": files_digest(loop.files),
                # What the numbers depend on beside the C that runs.
                "code": rooms_digest(),
            }
        ),
        folder=folder,
        workers=workers,
        progress=progress,
    )
    first = tuple(
        (c, run_case(c, s, seed))
        for c, r in zip(cases, monte_carlo.results, strict=False)
        if r.values is not None
    )
    steps: dict[str, StepMetrics] = {}
    response: FrequencyResponse | None = None
    port: Impedance | None = None
    for case, run in first:
        true = run.plant["tau_e_Nm"]
        if experiment == "step":
            tau = float(case.trajectory.tau_desired_Nm[-1])
            steps[case.name] = step_metrics(run.time_s, true, step_s=STEP_AT_S, after=tau)
        elif experiment == "frequency":
            desired = case.trajectory.tau_desired_Nm
            response = sweep_response(run.time_s, desired, true, SWEEP)
        elif experiment == "output-impedance":
            angle = run.plant["theta_l_rad"] - SWEEP_MIDDLE_RAD
            port = impedance(sweep_response(run.time_s, angle, true, MOTION))
    return Simulation(experiment, s, seeds, monte_carlo, first, steps, response, port)
