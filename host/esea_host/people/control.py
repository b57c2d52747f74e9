"""Optimal feedback control of one axis of a wrist, from delayed and noisy senses.  Simulated.

A linear-quadratic-Gaussian controller in frames of 10 ms.  Its internal model is a wrist with
passive stiffness and damping, turned by a muscle that lags twice [1], against a torque from outside
that may drift [2].  Posture and load are compensated; the cost is on the distance to the goal and
on the command beyond that compensation, discounted over time.  The weight of the command is the
one at which each bit of accuracy takes the published time: a linear controller halves the distance
in equal times, which is Fitts' law [3, 4].  Noise in proportion to the command adds to that weight
and changes no gain for a given movement time.

References
----------
[1] E. Todorov, Neural Computation 17, 2005; E. Todorov, M. Jordan, Nature Neuroscience 5, 2002.
[2] F. Crevecoeur, S. Scott, PLoS Computational Biology 9, 2013; with vision, F. Crevecoeur,
    D. Munoz, S. Scott, J. Neuroscience 36, 2016.
[3] R. Balakrishnan, I. MacKenzie, CHI 1997: 4.1 bits a second with the wrist.
[4] E. Crossman, P. Goodeve, Quarterly J. Experimental Psychology 35A, 1983: Fitts' law of a linear
    feedback; N. Qian et al., Neural Computation 25, 2013: of infinite-horizon optimal control.
[5] R. Shadmehr, F. Mussa-Ivaldi, J. Neuroscience 14, 1994: with practice, movements in a field of
    force return to their original form.
[6] R. van Beers, A. Sittig, J. Denier van der Gon, Experimental Brain Research 122, 1998: about 1
    deg; here each sample, independently.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

from esea_host.people.person import Limb, Muscle, PersonModel

Array = npt.NDArray[np.float64]
FRAME_S = 0.01
MUSCLE_S = 0.04  # each of two lags in series [1]
MUSCLE_KEPT = math.exp(-FRAME_S / MUSCLE_S)
# Deviation of the muscle's torque over that of a command that is drawn anew each frame.
MUSCLE_SMOOTHS = 0.2494
RESISTS_NMS_RAD = 0.05  # steps of a device's reckoned damping: fewer gains to solve
# Squared speed, summed over a trial, below which it tells little of what resists; assumed.
FEW_RAD2_S2 = 4.0
MOST_LAG = 50  # frames that are kept, for estimates that come late
END_RAD = math.radians(5.0)  # nearer to the end of the own range, nothing is learnt of a device
DISCOUNT_S = 2.0  # assumed
# Assumed: torque from outside and speed of a target drift by so much in the root of a second.
DRIFT_NM, DRIFT_RAD_S = 0.05, math.radians(40.0)
# Of one sample of 10 ms: felt angle [6], and seen distance; the latter assumed.
FELT_RAD, SEEN_RAD = math.radians(1.0), math.radians(0.2)
TYPICAL_NM = 0.2  # command whose noise the estimator expects; assumed


@dataclass(frozen=True)
class AxisBelief:
    """The hand's internal model of its wrist and the device, on one axis."""

    inertia_kgm2: float
    stiffness_Nm_rad: float
    damping_Nms_rad: float


def _discrete(a: Array, b: Array) -> tuple[Array, Array]:
    # Over a frame with the input held.
    n = len(a)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = a, b
    stepped = expm(FRAME_S * whole)
    return stepped[:n, :n], stepped[:n, n]


def _gain(a: Array, b: Array, weight: float) -> Array:
    cost = np.zeros_like(a)
    cost[0, 0] = 1.0
    kept = math.exp(-FRAME_S / DISCOUNT_S / 2)
    a, b = kept * a, kept * b[:, None]
    p = solve_discrete_are(a, b, cost, np.array([[weight]]))
    return np.asarray((b.T @ p @ a)[0] / (weight + (b.T @ p @ b)[0, 0]))


def _chase(load: AxisBelief, runs_1_s: float) -> tuple[Array, Array]:
    # Distance, speed, torque of the muscle and its drive beyond a steady motion's, target's speed.
    k, b, j, t = load.stiffness_Nm_rad, load.damping_Nms_rad, load.inertia_kgm2, MUSCLE_S
    a = np.array(
        [
            [0.0, -1.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 1 / j, 0.0, 0.0],
            [0.0, 0.0, -1 / t - b / j, 1 / t, 0.0],
            [0.0, 0.0, -(b + t * k) / j, -1 / t, 0.0],
            [0.0, runs_1_s, 0.0, 0.0, -runs_1_s],
        ]
    )
    return _discrete(a, np.array([0.0, 0.0, 0.0, 1 / t, 0.0]))


@lru_cache(maxsize=256)
def effort_weight(load: AxisBelief, bits_s: float) -> float:
    """Weight of the command, rad²/Nm², at which a resting target takes 1/bits_s a bit."""
    a, b = (x[:4, ...] for x in _chase(load, 0.0))
    a = a[:, :4]

    def excess(exponent: float) -> float:
        closed = a - np.outer(b, _gain(a, b, 10.0**exponent))
        rate = -math.log(max(abs(np.linalg.eigvals(closed)))) / FRAME_S
        return rate - bits_s * math.log(2)

    return float(10.0 ** brentq(excess, -6.0, 3.0, xtol=1e-3))


@dataclass(frozen=True)
class Gains:
    """Of one load and one kind of target.

    command: of the chase's state.  hand, drive, felt: the hand's estimator; lag: frames by which
    its torque from outside comes late.  prey, pushed, seen: the target's; ahead, moved: from its
    delayed state and the hand's speeds since, to now.
    """

    load: AxisBelief
    command: Array
    hand: Array
    drive: Array
    felt: Array
    lag: int
    prey: Array
    pushed: Array
    seen: Array
    ahead: Array
    moved: Array


def _wrist(load: AxisBelief) -> tuple[Array, Array]:
    # Angle, speed, muscle, its drive, torque from outside.
    j, t = load.inertia_kgm2, MUSCLE_S
    a = np.zeros((5, 5))
    a[0, 1] = 1.0
    a[1] = np.array([-load.stiffness_Nm_rad, -load.damping_Nms_rad, 1.0, 0.0, 1.0]) / j
    a[2, 2:4] = -1 / t, 1 / t
    a[3, 3] = -1 / t
    return _discrete(a, np.array([0.0, 0.0, 0.0, 1 / t, 0.0]))


def _estimator(a: Array, c: Array, process: Array, noise: float) -> Array:
    p = solve_discrete_are(a.T, c[:, None], process, np.array([[noise**2]]))
    return np.asarray(a @ p @ c / (c @ p @ c + noise**2))


@lru_cache(maxsize=1024)
def gains(
    load: AxisBelief,
    bits_s: float,
    runs_1_s: float,
    delays: tuple[int, int],
    noise: float,
    contracted: AxisBelief,
) -> Gains:
    """Solve for the controller and both estimators, once a combination."""
    felt_frames, seen_frames = delays
    a, drive = _wrist(load)
    # What is off from the estimate is met by the impedance, too; angles are under way behind it.
    off, _ = _wrist(contracted)
    n = 5 + felt_frames
    hand, wrong, driven = (np.zeros((n, n)), np.zeros((n, n)), np.zeros(n))
    hand[:5, :5], wrong[:5, :5], driven[:5] = a, off, drive
    for x in (hand, wrong):
        x[5, 0] = 1.0
        x[6:, 5:-1] = np.eye(felt_frames - 1)
    process = (noise * TYPICAL_NM) ** 2 * np.outer(driven, driven)
    process[4, 4] += DRIFT_NM**2 * FRAME_S
    felt = _estimator(wrong, np.eye(n)[-1], process, FELT_RAD)
    closed = np.eye(n) - hand + np.outer(felt, np.eye(n)[-1])
    lag = round(float(np.linalg.inv(closed)[4, 4]))  # of a torque that grows steadily
    moving = np.array([[0.0, 1.0], [0.0, -runs_1_s]])
    f, pushed = _discrete(moving, np.array([0.0, runs_1_s]))
    drift = np.diag([0.0, DRIFT_RAD_S**2 * FRAME_S])
    seen = _estimator(f, np.array([1.0, 0.0]), drift, SEEN_RAD)
    powers = [np.linalg.matrix_power(f, m) for m in range(seen_frames)]
    moved = np.stack([p @ pushed for p in powers[-2::-1]], axis=1)
    command = _gain(*_chase(load, runs_1_s), effort_weight(load, bits_s))
    return Gains(load, command, hand, driven, felt, lag, f, pushed, seen, powers[-1], moved)


class AxisController:
    """Controller of one axis of a wrist: muscle, estimates and goal, continued over trials."""

    def __init__(
        self, model: PersonModel, limb: Limb, handle_kgm2: float, rng: np.random.Generator
    ) -> None:
        self.model, self._limb, self._rng = model, limb, rng
        self._inertia_kgm2 = limb.inertia_kgm2 + handle_kgm2
        stiff = model.contracted_Nm_rad
        damping = 2 * model.damping_ratio * math.sqrt(stiff * self._inertia_kgm2)
        self._contracted = (stiff, damping)
        self._command_noise = model.torque_noise / MUSCLE_SMOOTHS
        self._felt_frames = round(model.felt_s / FRAME_S)
        self.seen_frames = round((model.delay_s - MUSCLE_S) / FRAME_S)
        self._estimate = np.zeros(5 + self._felt_frames)
        self._felt = deque([0.0] * (self._felt_frames + 1), self._felt_frames + 1)
        self._past = deque([(0.0, 0.0)] * self.seen_frames, self.seen_frames)
        self._muscle_Nm = self._drive_Nm = 0.0
        self._prey: Array | None = None
        self._sums, self._ways = np.zeros((5, 5)), deque([(0.0, 0.0)], MOST_LAG)
        self.goal_rad = self.goal_rad_s = 0.0
        self._learns, self._state, self.resists_Nms_rad = True, False, {False: 0.0, True: 0.0}
        self.expect(0.0)

    def _load(self, more_Nms_rad: float) -> AxisBelief:
        x = self._limb
        return AxisBelief(self._inertia_kgm2, x.stiffness_Nm_rad, x.damping_Nms_rad + more_Nms_rad)

    def expect(self, runs_1_s: float) -> None:
        """Be ready for a target whose speed goes to the hand's at a rate; at 0 it keeps its own."""
        self._runs_1_s, self._prey = runs_1_s, None
        self._tune()

    def _tune(self) -> None:
        resists = self.resists_Nms_rad[self._state] / RESISTS_NMS_RAD
        load = self._load(RESISTS_NMS_RAD * round(resists))
        delays = self._felt_frames, self.seen_frames
        stiffer = AxisBelief(
            self._inertia_kgm2,
            load.stiffness_Nm_rad + self._contracted[0],
            load.damping_Nms_rad + self._contracted[1],
        )
        args = (self.model.bits_s, self._runs_1_s, delays, self._command_noise, stiffer)
        self._gains = gains(load, *args)

    def enter(self, state: bool, learns: bool = True) -> None:
        """Begin a trial in a state of the device: stop pushing, and recall how it resists."""
        self._get_used()
        self._learns = learns
        self._state, self.goal_rad, self.goal_rad_s = state, self.angle_rad, 0.0
        self.expect(0.0)

    def _get_used(self) -> None:
        # Of the torque from outside, what goes with the speed at the same place is damping of the
        # device.  Only ways there and back tell it from a wall, so that whole trials are compared.
        told = self._sums[:4, :4] + np.diag([1e-6, 1e-6, 1e-6, FEW_RAD2_S2])
        more = -self.model.gain_rate * float(np.linalg.solve(told, self._sums[:4, 4])[3])
        self.resists_Nms_rad[self._state] = max(self.resists_Nms_rad[self._state] + more, 0.0)
        self._sums[:] = 0.0

    @property
    def angle_seen_rad(self) -> float:
        """:attr:`angle_rad` at the time of the present visual input."""
        return self._past[0][0]

    @property
    def angle_rad(self) -> float:
        """Where the hand is taken to be."""
        return float(self._estimate[0])

    def see(self, distance_rad: float) -> None:
        """A target, as it was before the delay of vision; its motion since then is predicted."""
        angle, speed = self._past[0]
        at = angle + distance_rad + self._noise(SEEN_RAD)
        g, prey = self._gains, self._prey
        if prey is None:
            prey = np.array([at, 0.0])
        self._prey = g.prey @ prey + g.pushed * speed + g.seen * (at - prey[0])
        speeds = np.array([x[1] for x in self._past])[1:]
        now = g.ahead @ self._prey + g.moved @ speeds
        self.goal_rad, self.goal_rad_s = float(now[0]), float(now[1])

    def _noise(self, deviation: float) -> float:
        return deviation * self.model.sense_noise * float(self._rng.normal())

    def frame(self, angle_rad: float) -> Muscle:
        """Muscle of the next frame; ``angle_rad`` is felt after its own delay."""
        self._felt.append(angle_rad + self._noise(FELT_RAD))
        m, g, x = self.model, self._gains, self._estimate
        angle, speed, muscle, drive, outside = x[:5].tolist()
        self._past.append((angle, speed))
        self._ways.append((angle, speed))
        k, b = g.load.stiffness_Nm_rad, g.load.damping_Nms_rad
        steady, lag = k * angle + b * speed - outside, MUSCLE_S * k * speed
        chase = (self.goal_rad - angle, speed, muscle - steady, drive - steady - lag)
        command = steady + 2 * lag - float(g.command @ (*chase, self.goal_rad_s))
        command = min(max(command, -m.effort_Nm), m.effort_Nm)
        self._estimate = g.hand @ x + g.drive * command + g.felt * (self._felt[0] - x[-1])
        if self._learns and self._limb.low_rad + END_RAD < angle < self._limb.high_rad - END_RAD:
            then, at = self._ways[-1 - min(g.lag, len(self._ways) - 1)]
            told = np.array([1.0, then, then * then, at, outside])
            self._sums += told[:, None] * told
        before = self._muscle_Nm
        noisy = command * (1.0 + self._command_noise * float(self._rng.normal()))
        kept, share = MUSCLE_KEPT, FRAME_S / MUSCLE_S
        above = self._drive_Nm - noisy
        self._muscle_Nm = noisy + kept * (before - noisy + share * above)
        self._drive_Nm = noisy + kept * above
        path = (angle, float(self._estimate[0]))
        return Muscle(*self._contracted, *path, m.effort_Nm, before, self._muscle_Nm)
