"""The map over gains and hands that the pushes make."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, Unpack

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from esea_gen.analysis.campaign import Running, run_cases
from esea_gen.analysis.journal import Configuration, Result, rooms_digest
from esea_gen.analysis.passivity import Hand, hand_family
from esea_gen.analysis.plots import cell_edges, new_figure, styled
from esea_gen.control.limits.faults import FAULT_TEXT, Fault
from esea_gen.devices import BEST_CONTROLLER
from esea_gen.emit.build import device_hash
from esea_gen.errors import UserError, choose
from esea_gen.files import plain
from esea_gen.language.ports import Array, Tunable
from esea_gen.observe import torque_scale
from esea_gen.plotting import BOUND, INK, MODEL
from esea_gen.studies.passivity.push import GAIN_TUNABLES, PUSH_RAD_S, PushRun, run_push
from esea_gen.studies.passivity.sliding import Bools, SlidingCheck, check_sliding
from esea_gen.studies.tracking import GAINS
from esea_gen.twin.case import Setting
from esea_gen.twin.controllers import controller_device, controller_system
from esea_gen.twin.people import PLANT_NAMES
from esea_gen.twin.run import axis_of

# Share of the push's energy that may come out before it counts.  Of the default map's runs half
# give out less than 0.01 %, nearly all others more than 3 %.
TOLERANCE = 0.01
KINDS = {"unstable with a hand": "#efc9b0", "stable with every hand": "#cfdde8", "passive": None}


@dataclass(frozen=True)
class PushMap:
    """Energy generated over gains (p, d) and hands (h), in runs that a push started."""

    kp_Nm_rad: Array
    kd_Nms_rad: Array
    hands: tuple[Hand, ...]
    generated_J: Array  # (p, d, h), infinite where the plant ran away
    diverging: Bools  # also where limits or drive ended the motion
    tolerance: float  # share of the push's energy
    push_J: Array  # that the push would give each hand alone, (h,)
    stopped: Bools

    @property
    def stable(self) -> Bools:
        """No hand makes it swing up, shape (p, d)."""
        return np.asarray(~np.any(self.diverging, axis=2))

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
        content = {k: v for k, v in vars(self).items() if k != "stopped"}
        derived = {k: getattr(self, k) for k in ("stable", "passive", "limits_acted")}
        found: dict[str, Any] = plain(content | derived, null=True)
        return found

    def table(self) -> list[str]:
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
        if self.limits_acted[i, j]:
            return "L"
        return "P" if self.passive[i, j] else "s" if self.stable[i, j] else "."

    @styled
    def figure(self, marks: Sequence[tuple[float, float]], title: str) -> Figure:
        """Where the port is passive, stable with every hand, or unstable with one; gains in use."""
        colours = [c or MODEL for c in KINDS.values()]
        x, y = self.kd_Nms_rad, self.kp_Nm_rad
        figure, axes = new_figure(6.4, 4.6)
        axes.grid(visible=False)
        axes.pcolormesh(
            cell_edges(x),
            cell_edges(y),
            self.stable.astype(int) + self.passive,
            cmap=ListedColormap(colours),
            vmin=0,
            vmax=2,
            edgecolors="white",
            linewidth=0.4,
        )
        box = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8}
        for kp, kd in marks:
            axes.plot([kd], [kp], "o", color=INK, mfc="white", mew=1.5, ms=6, zorder=3)
            way, side = (-8, "right") if kd > 0.5 * (x[0] + x[-1]) else (8, "left")
            there: dict[str, Any] = {"xytext": (way, 4), "textcoords": "offset points"}
            axes.annotate(f"{kp:g}, {kd:g}", (kd, kp), ha=side, bbox=box, **there)
        axes.set(xlabel="damping Kd, N·m·s/rad", ylabel="stiffness Kp, N·m/rad", title=title)
        # The gains rise as squares: so the cells are equal, and those in use in no corner.
        for axis, gains in ((axes.xaxis, x), (axes.yaxis, y)):
            getattr(axes, f"set_{axis.axis_name}scale")("function", functions=(_root, _square))
            axis.set_ticks(list(gains), [f"{g:.2g}" for g in gains])
            axis.set_minor_locator(NullLocator())
        i, j = np.nonzero(self.limits_acted)
        axes.plot(x[j], y[i], "x", color=BOUND, ms=5, mew=1)
        handles = [Patch(fc=c, label=t) for c, t in zip(colours, KINDS, strict=True)]
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
        return figure


def _root(x: Array) -> Array:
    return np.asarray(np.sign(x) * np.sqrt(np.abs(x)))


def _square(x: Array) -> Array:
    return np.asarray(np.sign(x) * np.square(x))


def push_map(
    kp_Nm_rad: Sequence[float] | Array,
    kd_Nms_rad: Sequence[float] | Array,
    hands: Sequence[Hand],
    runs: Mapping[tuple[float, float, str], PushRun],
    push_rad_s: float,
    tolerance: float = TOLERANCE,
) -> PushMap:
    """The map from its runs, by gains and the hand's name: every combination."""
    kp, kd = np.asarray(kp_Nm_rad, dtype=float), np.asarray(kd_Nms_rad, dtype=float)
    energy = np.array([0.5 * h.inertia_kgm2 * push_rad_s**2 for h in hands])
    every = [runs[p, d, h.name] for p in kp.tolist() for d in kd.tolist() for h in hands]
    shape = (len(kp), len(kd), len(hands))
    stopped = np.reshape([r.stopped for r in every], shape)
    generated = np.reshape([math.inf if r.ran_away else r.generated_J for r in every], shape)
    given = np.tile(energy, len(kp) * len(kd)).tolist()
    grows = [r.swings_up(e) for r, e in zip(every, given, strict=True)]
    diverging = stopped | np.reshape(grows, shape)
    return PushMap(kp, kd, tuple(hands), generated, diverging, tolerance, energy, stopped)


# Of a device with the elbow's torque. From fingers to a whole forearm with its load side; limp and
# tense; let go, holding on by little and by more, and leaning on something firm.
HANDS = hand_family((0.05, 0.1, 0.2, 0.4), (0.0, 0.5), (0.0, 10.0, 30.0, 100.0, 1000.0))
# Of a wrist: a finger's touch on the handle to a heavy hand, relaxed to tense.
WRIST_HANDS = hand_family((0.006, 0.009, 0.015, 0.03), (0.0, 0.05), (0.0, 2.0, 8.0, 20.0, 60.0))
MOST_PUSH_RAD_S = 0.6


@dataclass(frozen=True)
class InteractionStudy:
    controller: str
    plant: str
    push_rad_s: float
    seed: int
    wall_Nm_rad: float
    axis: str
    region: PushMap
    marked: tuple[tuple[float, float, str], ...]
    runs: Mapping[tuple[float, float, str], PushRun]
    sliding: tuple[SlidingCheck, ...]
    configuration: Configuration

    def to_dict(self) -> dict[str, Any]:
        names = ("controller", "plant", "push_rad_s", "seed", "wall_Nm_rad", "axis", "sliding")
        return {k: getattr(self, k) for k in names} | {
            "simulated": True,
            "configuration": self.configuration.parts,
            "map": self.region.to_dict(),
            "thesis_gains": [
                {"Kp_Nm_rad": kp, "Kd_Nms_rad": kd, "verdict": _VERDICTS[mark]}
                for kp, kd, mark in self.marked
            ],
            "runs": [
                {"Kp_Nm_rad": kp, "Kd_Nms_rad": kd, "hand": hand} | vars(r)
                for (kp, kd, hand), r in self.runs.items()
            ],
        }

    def table(self) -> list[str]:
        m = self.region
        count = m.stable.size
        lines = [
            f"Simulated. Rendered impedance: {' '.join((self.controller, self.axis)).strip()}, "
            f"plant {self.plant}, {len(m.hands)} passive hands, a push of {self.push_rad_s:g} rad/s"
            + f", against a wall of {self.wall_Nm_rad:g} Nm/rad"
            * (self.wall_Nm_rad > 0),
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
            "A run can show that gains are active; if no run does, that does not prove passivity."
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
        title = f"{self.controller}, plant {self.plant}: {len(self.region.hands)} hands"
        if self.region.limits_acted.any():
            title += "; × limits or drive had to stop one"
        return self.region.figure([(kp, kd) for kp, kd, _ in self.marked], title)


_VERDICTS = {
    "P": "passive",
    "s": "stable with every hand, not passive",
    ".": "swings up with a hand",
    "L": "limits or drive had to stop it",
}


def gain_axis(tunable: Tunable, points: int) -> Array:
    """Gains from 0 to a tunable's largest, closer near 0, where the gains in use are."""
    return np.asarray(tunable.high * (np.arange(points) / (points - 1)) ** 2)


def _gains(controller: str) -> list[Tunable]:
    blocks = controller_system(controller).blocks
    block = next((b for n, b in blocks.items() if n.partition("_")[0] == "reference"), None)
    known = {t.name: t for t in block.tunables} if block else {}
    if not known.keys() >= set(GAIN_TUNABLES):
        raise UserError(
            f"{controller} controls torque; it renders no impedance whose gains could be mapped.",
            "Choose a controller that does, such as --controller smc.",
        )
    return [known[n] for n in GAIN_TUNABLES]


def study_interaction(
    controller: str = BEST_CONTROLLER,
    plant: str = "real",
    *,
    points: int = 9,
    hands: Sequence[Hand] | None = None,
    push_rad_s: float = PUSH_RAD_S,
    seed: int = 0,
    wall_Nm_rad: float = 0.0,
    sliding: bool = True,
    axis: str = "",
    **how: Unpack[Running],
) -> InteractionStudy:
    """Passivity of the rendered impedance over its gains, by runs of the compiled controller."""
    choose("plant", plant, PLANT_NAMES)
    if not 0 < abs(push_rad_s) <= MOST_PUSH_RAD_S:
        raise UserError(
            f"The push is {push_rad_s:g} rad/s.",
            f"Give at most {MOST_PUSH_RAD_S:g} rad/s, up or down, not 0: a faster hand would "
            "leave the range of motion.",
        )
    device = controller_device(controller)
    axis = axis_of(device, Setting(axis=axis))
    if hands is None:
        hands = HANDS if len(device.axes) == 1 else WRIST_HANDS
        hands = [h.scaled(torque_scale(device)) for h in hands]
    kp, kd = (gain_axis(t, points) for t in _gains(controller))
    marks = [g for g in GAINS if g[0] <= kp[-1] and g[1] <= kd[-1]]
    pairs = dict.fromkeys([*product(kp.tolist(), kd.tolist()), *marks])
    hashes = {"controller_hash": device_hash(device), "code": rooms_digest()}
    configuration = Configuration(hashes)
    fixed = {"controller": controller, "plant": plant, "push_rad_s": push_rad_s, "seed": seed}
    fixed |= {"wall_Nm_rad": wall_Nm_rad, **({"axis": axis} if axis else {})}
    cases = [
        {"kp_Nm_rad": p, "kd_Nms_rad": d, "hand": asdict(h)} | fixed
        for p, d in pairs
        for h in hands
    ]
    # The sliding condition first: it compiles, before the workers would each do it.
    checks = check_sliding(controller, seed=seed) if sliding else ()
    run_push(**cases[0])
    done = run_cases(run_push, cases, configuration=configuration, **how)
    runs = {_key(r): _finished(r) for r in done.results}
    region = push_map(kp, kd, hands, runs, push_rad_s)
    marked = tuple((p, d, push_map([p], [d], hands, runs, push_rad_s).mark(0, 0)) for p, d in marks)
    asked = controller, plant, push_rad_s, seed, wall_Nm_rad, axis
    return InteractionStudy(*asked, region, marked, runs, checks, configuration)


def _key(result: Result) -> tuple[float, float, str]:
    case = result.case
    return float(case["kp_Nm_rad"]), float(case["kd_Nms_rad"]), str(case["hand"]["name"])


def _finished(result: Result) -> PushRun:
    # A run that failed otherwise than by running away says nothing about its gains.
    if result.values is None:
        raise RuntimeError(f"a run of the map failed: {result.failure}")
    return PushRun(**result.values)
