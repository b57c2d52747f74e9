"""Passivity of the rendered impedance over its gains, from runs of the compiled controller.

A passive hand at the load port is pushed once, the controller renders a spring and damper to where
the hand was, and the energy that the port took in is added up.  The plant's person is the hand: an
inertia with its own damping and a spring to a place that does not move, without noise or gravity.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.analysis.campaign import Workers, run_cases
from esea_gen.analysis.journal import Configuration, Result, rooms_digest
from esea_gen.analysis.passivity import Bools, Hand, PassivityMap, energy_balance, hand_family
from esea_gen.analysis.response import plain
from esea_gen.control.faults import FAULT_TEXT, Fault
from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError
from esea_gen.language.ports import Array, Tunable
from esea_gen.studies.experiments import (
    GAINS,
    IMPEDANCE,
    ON_S,
    PLANT_NAMES,
    Case,
    Setting,
    controller_device,
    controller_system,
    run_case,
)
from esea_gen.studies.sliding import SlidingCheck, check_sliding
from esea_gen.twin.closed_loop import ClosedLoopRun
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAIN_TUNABLES = ("Kp_Nm_rad", "Kd_Nms_rad")
# From a hand alone to a whole forearm with its load side; limp and tense; let go, holding on, and
# leaning on something firm.
HANDS = hand_family((0.1, 0.2, 0.4), (0.0, 0.5), (0.0, 30.0, 300.0))
PUSH_RAD_S = 0.5
MOST_PUSH_RAD_S = 0.6
PUSH_AT_S, PUSH_S, DURATION_S = 1.0, 0.1, 4.0
# A motion counts from this share of the push's energy on (a fifth of its speed): encoder counts and
# backlash make smaller ones.  It grows when it gains a tenth in size, a fifth in energy.
NOTICE, GROWTH = 0.04, 1.21
# Share of the push's energy that may come out before it counts.  Of the default map's runs half
# give out less than 0.01 %, nearly all others more than 3 %; docs/stability.md has what it changes.
TOLERANCE = 0.01
POINTS, FEWEST_POINTS, MOST_POINTS = 9, 2, 41
RAN_AWAY = "left its ranges"


# -- one run --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class HandRun:
    """What a push came to.

    generated_J: energy that the port gave out beyond what was ever put in.
    held_J, held_end_J: energy of the hand, its spring and the rendered one: mean over the second
        and over the last third after the push. With a passive port it never rises.
    limited_share: share of the samples with the command at the motor's limit.
    fault: first reason of the limits' latch, 0 for none.
    ran_away: 1 when the plant left its ranges; the other figures are 0 then.
    """

    generated_J: float = 0.0
    exchanged_J: float = 0.0
    absorbed_J: float = 0.0
    held_J: float = 0.0
    held_end_J: float = 0.0
    limited_share: float = 0.0
    fault: float = 0.0
    tripped: float = 0.0
    ran_away: float = 0.0

    @property
    def stopped(self) -> bool:
        """Whether the limits' latch or the drive's trip ended the motion."""
        return self.fault > 0 or self.tripped > 0

    def swings_up(self, push_J: float) -> bool:
        """Whether the motion grows, or ends larger than the push made it."""
        grows = self.held_end_J > GROWTH * self.held_J and self.held_end_J > NOTICE * push_J
        return bool(self.ran_away > 0 or grows or self.held_end_J > GROWTH * push_J)


def push_case(
    device: Device,
    hand: Hand,
    kp_Nm_rad: float,
    kd_Nms_rad: float,
    push_rad_s: float = PUSH_RAD_S,
    mode: int = IMPEDANCE,
) -> Case:
    """A hand that is pushed once while the controller renders a spring and damper.

    push_rad_s: speed that the push would give the hand alone: the push is its inertia times that.
    """
    safety = device.file.safety
    assert safety is not None
    n = round(DURATION_S * RATE_HZ)
    t, rest = np.arange(n) / RATE_HZ, np.zeros(n)
    # A quarter up the range of motion: what the push moves stays clear of both ends.
    low, high = safety.rom_min_rad.value, safety.rom_max_rad.value
    theta = np.full(n, low + (high - low) / 4)
    phase = np.pi * (t - PUSH_AT_S) / PUSH_S
    inside = (phase >= 0) & (phase < np.pi)
    # Half a sine; its sum over the samples is exactly what it is to give.
    shape = np.where(inside, np.sin(phase), 0.0)
    alpha = push_rad_s * RATE_HZ * shape / shape.sum()
    start = round((PUSH_AT_S + PUSH_S) * RATE_HZ)
    gains = dict(zip(GAIN_TUNABLES, (kp_Nm_rad, kd_Nms_rad), strict=True))
    return Case(
        f"{hand.name}: Kp {kp_Nm_rad:g}, Kd {kd_Nms_rad:g}",
        Trajectory("push", theta, rest, alpha, rest, start, n),
        mode,
        {"reference": gains} if mode == IMPEDANCE else {},
        {
            "Jh_kgm2": hand.inertia_kgm2,
            "own_damping_Nms_rad": hand.damping_Nms_rad,
            "spring_Nm_rad": hand.stiffness_Nm_rad,
            "damping_Nms_rad": 0.0,
            # The push: the inertia times the acceleration above.  The path itself never moves.
            "feedforward": 1.0,
            "gravity_Nm": 0.0,
            "torque_noise_Nm": 0.0,
        },
    )


def judge_push(run: ClosedLoopRun, hand: Hand, kp_Nm_rad: float, u_max_Nm: float) -> HandRun:
    """The figures of a run."""
    theta, omega = run.plant["theta_l_rad"], run.plant["omega_l_rad_s"]
    balance = energy_balance(theta, run.plant["tau_e_Nm"])
    spring = hand.stiffness_Nm_rad + kp_Nm_rad
    held = 0.5 * (hand.inertia_kgm2 * omega**2 + spring * (theta - theta[0]) ** 2)
    after = held[round((PUSH_AT_S + PUSH_S) * RATE_HZ) :]
    third = len(after) // 3
    on = slice(round(ON_S * RATE_HZ), None)
    faults = run.controller["fault"][on]
    latched = faults[faults > 0]
    return HandRun(
        balance.generated_J,
        balance.exchanged_J,
        float(balance.absorbed_J[-1]),
        float(np.mean(after[third : 2 * third])),
        float(np.mean(after[2 * third :])),
        float(np.mean(np.abs(run.controller["u_Nm"][on]) >= 0.999 * u_max_Nm)),
        float(latched[0]) if len(latched) else 0.0,
        float(np.max(run.plant["tripped"]) > 0),
    )


def _largest_torque(device: Device) -> float:
    assert device.file.actuator is not None
    return device.file.actuator.u_max_Nm.value


def run_push(
    kp_Nm_rad: float,
    kd_Nms_rad: float,
    hand: Mapping[str, Any],
    controller: str,
    plant: str,
    push_rad_s: float,
    seed: int,
) -> dict[str, float]:
    """Run and judge one push: what a worker does."""
    device = controller_device(controller)
    who = Hand(**hand)
    case = push_case(device, who, kp_Nm_rad, kd_Nms_rad, push_rad_s)
    try:
        run = run_case(case, Setting(controller, plant, "ideal"), seed)
    except RuntimeError as error:
        if RAN_AWAY not in str(error):
            raise
        return asdict(HandRun(ran_away=1.0))
    return asdict(judge_push(run, who, kp_Nm_rad, _largest_torque(device)))


# -- the map --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PushMap(PassivityMap):
    """Energy generated over gains and hands, in runs that a push started.

    kp_Nm_rad, kd_Nms_rad, hands, generated_J, index, diverging, tolerance: as in
        :class:`~esea_gen.analysis.passivity.PassivityMap`; ``diverging`` also where limits or drive
        ended the motion, and ``tolerance`` is a share of the push's energy.
    push_J: energy that the push would give each hand alone, shape (h,).
    stopped: limits or drive ended the motion, shape (p, d, h).
    """

    push_J: Array
    stopped: Bools

    @property
    def passive(self) -> Bools:
        """No hand gets more out than the tolerance, and nothing had to stop it; shape (p, d)."""
        quiet = np.all(self.generated_J <= self.tolerance * self.push_J, axis=2)
        return np.asarray(quiet & self.stable)

    @property
    def limits_acted(self) -> Bools:
        """Limits or drive ended the motion with some hand, shape (p, d)."""
        return np.asarray(np.any(self.stopped, axis=2))

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: as the base class, with pushes and stops; null for a run away."""
        generated = [[[_finite(x) for x in row] for row in page] for page in self.generated_J]
        return super().to_dict() | {
            "generated_J": generated,
            "push_J": plain(self.push_J),
            "limits_acted": plain(self.limits_acted),
        }

    def table(self) -> list[str]:
        """The map in letters, one line a stiffness."""
        lines = [
            "P passive, s stable with every hand, . swings up with one, L limits or drive had to "
            "stop one",
            f"{'Kp | Kd':>10}" + "".join(f"{d:>8.3g}" for d in self.kd_Nms_rad),
        ]
        for i, kp in enumerate(self.kp_Nm_rad):
            marks = "".join(f"{self.mark(i, j):>8}" for j in range(len(self.kd_Nms_rad)))
            lines.append(f"{kp:>10.3g}{marks}")
        return lines

    def mark(self, i: int, j: int) -> str:
        """Letter of a pair of gains."""
        if self.limits_acted[i, j]:
            return "L"
        return "P" if self.passive[i, j] else "s" if self.stable[i, j] else "."


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def push_map(
    kp_Nm_rad: Sequence[float] | Array,
    kd_Nms_rad: Sequence[float] | Array,
    hands: Sequence[Hand],
    runs: Mapping[tuple[float, float, str], HandRun],
    push_rad_s: float,
    tolerance: float = TOLERANCE,
) -> PushMap:
    """The map from its runs.

    runs: ``{(kp, kd, hand's name): HandRun}``, every combination.
    """
    kp, kd = np.asarray(kp_Nm_rad, dtype=float), np.asarray(kd_Nms_rad, dtype=float)
    energy = np.array([0.5 * h.inertia_kgm2 * push_rad_s**2 for h in hands])
    shape = (len(kp), len(kd), len(hands))
    generated, index = np.zeros(shape), np.zeros(shape)
    diverging, stopped = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    for at in np.ndindex(*shape):
        i, j, h = at
        r = runs[float(kp[i]), float(kd[j]), hands[h].name]
        stopped[at] = r.stopped
        diverging[at] = r.stopped or r.swings_up(float(energy[h]))
        generated[at] = math.inf if r.ran_away else r.generated_J
        index[at] = r.generated_J / r.exchanged_J if r.exchanged_J > 0 else 0.0
    return PushMap(kp, kd, tuple(hands), generated, index, diverging, tolerance, energy, stopped)


# -- the study ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class InteractionStudy:
    """Passivity over the gains, and the sliding condition.

    marked: the thesis' gains and their letter.
    runs: ``{(kp, kd, hand's name): HandRun}``, the thesis' gains included.
    """

    controller: str
    plant: str
    push_rad_s: float
    seed: int
    region: PushMap
    marked: tuple[tuple[float, float, str], ...]
    runs: Mapping[tuple[float, float, str], HandRun]
    sliding: tuple[SlidingCheck, ...]
    configuration: Configuration

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: the map, every run, the thesis' gains, the sliding condition."""
        return {
            "controller": self.controller,
            "plant": self.plant,
            "push_rad_s": self.push_rad_s,
            "seed": self.seed,
            "configuration": self.configuration.parts,
            "map": self.region.to_dict(),
            "thesis_gains": [
                {"Kp_Nm_rad": kp, "Kd_Nms_rad": kd, "verdict": _VERDICTS[mark]}
                for kp, kd, mark in self.marked
            ],
            "runs": [
                {"Kp_Nm_rad": kp, "Kd_Nms_rad": kd, "hand": hand} | asdict(r)
                for (kp, kd, hand), r in self.runs.items()
            ],
            "sliding": [asdict(c) for c in self.sliding],
        }

    def table(self) -> list[str]:
        """The study as lines of text."""
        m = self.region
        count = m.stable.size
        lines = [
            f"Rendered impedance: {self.controller}, plant {self.plant}, {len(m.hands)} passive "
            f"hands, a push of {self.push_rad_s:g} rad/s",
            *m.table(),
            f"passive {np.count_nonzero(m.passive)}, stable with every hand "
            f"{np.count_nonzero(m.stable)} of {count} pairs of gains",
        ]
        if not m.stable.all():
            worst = np.argmax(np.sum(m.diverging, axis=(0, 1)))
            lines.append(f"swings up or is stopped most often with: {m.hands[worst].name}")
        for kp, kd, mark in self.marked:
            lines.append(f"thesis Kp {kp:g}, Kd {kd:g}: {_VERDICTS[mark]}{self._why(kp, kd)}")
        stops = Counter(r.fault for r in self.runs.values() if r.fault)
        total = len(self.runs)
        trips = sum(r.tripped > 0 for r in self.runs.values())
        at_limit = sum(r.limited_share > 0 for r in self.runs.values())
        reasons = ", ".join(f"{n} {FAULT_TEXT[Fault(int(k))]}" for k, n in stops.items())
        lines.append(
            f"limits: latched in {stops.total()} of {total} runs{f' ({reasons})' if stops else ''}"
            f", drive tripped in {trips}, command at the motor's limit at times in {at_limit}"
        )
        lines.append(
            "A run can show that gains are active; that none did is no proof of passivity."
        )
        if self.sliding:
            lines += [
                "Sliding condition s s' < 0 (falling): share of the control periods outside the "
                "layer that keep it,",
                "the same with the motor off its limit, and the largest s s' in rad^2/s^3",
                f"{'plant':6} {'case':14} {'phi':>6} {'max |s|':>8} {'outside':>8} "
                f"{'falling':>11} {'motor free':>12} {'worst':>12} {'stay ms':>8}",
                *(c.line() for c in self.sliding),
            ]
        return lines

    def _why(self, kp: float, kd: float) -> str:
        m = self.region
        every = [self.runs[kp, kd, h.name] for h in m.hands]
        share = [r.generated_J / e for r, e in zip(every, m.push_J, strict=True)]
        k = int(np.argmax(share))
        return f" (at most {100 * share[k]:.2f} % of the push came out, hand {m.hands[k].name})"

    def figure(self) -> Figure:
        """The map, with the thesis' gains and a cross where limits or drive had to stop a run."""
        from matplotlib.ticker import NullLocator

        from esea_gen.analysis import plots
        from esea_gen.plotting import BOUND

        marks = [(f"{kp:g}, {kd:g}", kp, kd) for kp, kd, _ in self.marked]
        i, j = np.nonzero(self.region.limits_acted)
        title = f"{self.controller}, plant {self.plant}: {len(self.region.hands)} hands"
        if len(i):
            title += "; × limits or drive had to stop one"
        figure = plots.gain_map(self.region, marks, title=title)
        axes = figure.axes[0]
        # The gains rise as squares: so the cells are equal, and those in use are not in a corner.
        axes.set_xscale("function", functions=(_root, _square))
        axes.set_yscale("function", functions=(_root, _square))
        for axis, gains in (
            (axes.xaxis, self.region.kd_Nms_rad),
            (axes.yaxis, self.region.kp_Nm_rad),
        ):
            axis.set_ticks(list(gains), [f"{g:.2g}" for g in gains])
            axis.set_minor_locator(NullLocator())
        at = self.region.kd_Nms_rad[j], self.region.kp_Nm_rad[i]
        axes.plot(*at, "x", color=BOUND, ms=5, mew=1)
        return figure


def _root(x: Array) -> Array:
    return np.asarray(np.sign(x) * np.sqrt(np.abs(x)))


def _square(x: Array) -> Array:
    return np.asarray(np.sign(x) * np.square(x))


_VERDICTS = {
    "P": "passive",
    "s": "stable with every hand, not passive",
    ".": "swings up with a hand",
    "L": "limits or drive had to stop it",
}


def gain_axis(tunable: Tunable, points: int) -> Array:
    """Gains from 0 to a tunable's largest, closer near 0, where the gains in use are."""
    steps: Array = np.arange(points) / (points - 1)
    return np.asarray(tunable.high * steps**2)


def _gains(controller: str) -> tuple[Tunable, Tunable]:
    block = controller_system(controller).blocks.get("reference")
    known = {t.name: t for t in block.tunables} if block else {}
    if any(n not in known for n in GAIN_TUNABLES):
        raise UserError(
            f"{controller} controls torque; it renders no impedance whose gains could be mapped.",
            "Choose a controller that does, such as --controller smc.",
        )
    return known[GAIN_TUNABLES[0]], known[GAIN_TUNABLES[1]]


def study_interaction(
    controller: str = "smc",
    plant: str = "real",
    *,
    points: int = POINTS,
    hands: Sequence[Hand] = HANDS,
    push_rad_s: float = PUSH_RAD_S,
    seed: int = 0,
    sliding: bool = True,
    workers: int | Workers = 1,
    progress: Callable[[int, int, int], None] | None = None,
) -> InteractionStudy:
    """Passivity of the rendered impedance over its gains, by runs of the compiled controller.

    seed: of the gear disturbance, and of the plant where it is random.
    progress: ``progress(done, total, failed)``.
    """
    if plant not in PLANT_NAMES:
        raise UserError(f"Unknown plant '{plant}'.", f"Choose from {', '.join(PLANT_NAMES)}.")
    if not FEWEST_POINTS <= points <= MOST_POINTS:
        raise UserError(
            f"{points} points along each axis.", f"Give {FEWEST_POINTS} to {MOST_POINTS}."
        )
    if not 0 < push_rad_s <= MOST_PUSH_RAD_S:
        raise UserError(
            f"A push of {push_rad_s:g} rad/s.",
            f"Give more than 0 and at most {MOST_PUSH_RAD_S:g} rad/s: a faster hand would leave "
            "the range of motion.",
        )
    if seed < 0:
        raise UserError(f"seed = {seed}.", "Give 0 or more.")
    device = controller_device(controller)
    kp, kd = (gain_axis(t, points) for t in _gains(controller))
    marks = [g for g in GAINS if g[0] <= kp[-1] and g[1] <= kd[-1]]
    pairs = dict.fromkeys([*product(kp.tolist(), kd.tolist()), *marks])
    configuration = Configuration(
        {
            "controller_hash": device_hash(device),
            "code": rooms_digest(),
        }
    )
    fixed = {"controller": controller, "plant": plant, "push_rad_s": push_rad_s, "seed": seed}
    cases = [
        {"kp_Nm_rad": p, "kd_Nms_rad": d, "hand": asdict(h)} | fixed
        for p, d in pairs
        for h in hands
    ]
    # The sliding condition first: it compiles, before the workers would each do it.
    checks = check_sliding(controller, seed=seed) if sliding else ()
    run_push(**cases[0])
    done = run_cases(
        run_push, cases, configuration=configuration, workers=workers, progress=progress
    )
    runs = {_key(r): _finished(r) for r in done.results}
    region = push_map(kp, kd, hands, runs, push_rad_s)
    marked = tuple((p, d, push_map([p], [d], hands, runs, push_rad_s).mark(0, 0)) for p, d in marks)
    return InteractionStudy(
        controller, plant, push_rad_s, seed, region, marked, runs, checks, configuration
    )


def _key(result: Result) -> tuple[float, float, str]:
    case = result.case
    return float(case["kp_Nm_rad"]), float(case["kd_Nms_rad"]), str(case["hand"]["name"])


def _finished(result: Result) -> HandRun:
    # A run that failed otherwise than by running away says nothing about its gains.
    if result.values is None:
        raise RuntimeError(f"a run of the map failed: {result.failure}")
    return HandRun(**result.values)
