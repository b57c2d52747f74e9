"""Virtual clinics: simulated patients moved by simulated hands, read by the sensor's own C.

The twin renders the passive sensor: its cuff, the coupling with its dead zone, both encoders with
their counts and noise, and the device's C that makes a torque of that.  How far the model is from a
real coupling comes on top: 3.82 % of full scale, as published for one minute of free motion.  On a
simulated board patient and therapist are in a loop with the coupling: the hands push the cuff by
sight and feel of the leg; the coupling's torque moves the leg.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from scipy.signal import lfilter

from esea_gen.device import Device, load_device
from esea_gen.devices.file import DeviceData
from esea_gen.twin.passive import PassiveTwin
from esea_host.assess.patients import (
    CATEGORIES,
    DEG,
    OUTSIDE_KINDS,
    STEP_S,
    TONE_S,
    TONE_SPREAD,
    Array,
    HANDS_Nm_rad,
    HANDS_Nms_rad,
    KneePatient,
    Knees,
    MovedLegs,
    TREMOR_Hz,
    draw_category,
    draw_outside,
    nominal,
    sweep,
)
from esea_host.assess.probing import ProbingMovement
from esea_host.assess.responses import (
    ERROR_STAYS_S,
    SENSOR_ERROR_NM,
    LegRecording,
    Location,
    Passage,
    passage,
)
from esea_host.simulated.motion import TICK_S, SteppedCoupling
from esea_host.study.scene import Scene
from esea_host.study.task import Actor, Inputs


class KneeSensor:
    """The passive knee sensor in the twin, and how far a real coupling is from its model."""

    def __init__(self, device: Device) -> None:
        self.twin = PassiveTwin(device)
        self.error_Nm = SENSOR_ERROR_NM

    def read(
        self, time_s: Array, torque_Nm: Array, angle_rad: Array, seed: list[int]
    ) -> tuple[Array, Array]:
        """Torque and angle as read, at the times given."""
        rng = np.random.default_rng(seed)
        h = float(time_s[1] - time_s[0])
        keep = float(np.exp(-h / ERROR_STAYS_S))
        new = rng.normal(0, self.error_Nm * np.sqrt(1 - keep**2), len(time_s))
        start = [keep * rng.normal(0, self.error_Nm)]
        error = lfilter([1.0], [1.0, -keep], new, zi=start)[0]
        run = self.twin.run(time_s, torque_Nm + error, angle_rad, rng)
        return (
            np.interp(time_s, run.time_s, run.tau_Nm),
            np.interp(time_s, run.time_s, run.theta_l_rad),
        )


@cache
def knee_sensor() -> KneeSensor:
    return KneeSensor(load_device("knee"))


SOMEBODY = 14  # root of the seed of a patient that is named
HOLD_S, AFTER_S = 0.3, 0.2
# How hands differ from what they were shown: size and speed of the movement, and where; assumed.
SIZE_SPREAD, SPEED_SPREAD, PLACE_RAD = 0.06, 0.08, 0.04


def _read(
    knees: Knees, time_s: Array, angle: Array, torque: Array, seeds: Sequence[Sequence[int]]
) -> list[Passage]:
    sensor = knee_sensor()
    out = []
    for i, p in enumerate(knees.patients):
        known = np.isfinite(angle[:, i])
        t, a, tau = time_s[known], angle[known, i], torque[known, i]
        read, seen = sensor.read(t, tau, a, [*seeds[i], 1])
        out.append(passage(LegRecording(t, seen, read, p.height_m, p.mass_kg)))
    return out


def swept(patients: Sequence[KneePatient], seeds: Sequence[Sequence[int]]) -> list[Passage]:
    """The database's excitation, one passage a patient."""
    path, rate = sweep()
    knees = Knees(patients)
    n = len(patients)
    m = knees.move(np.repeat(path[:, None], n, 1), np.repeat(rate[:, None], n, 1), seeds)
    return _read(knees, m.time_s, m.angle_rad, m.torque_Nm, seeds)


def as_made(m: ProbingMovement, rng: np.random.Generator) -> ProbingMovement:
    """A movement as hands make it that are not perfect."""
    size, speed = np.exp(rng.normal(0, [SIZE_SPREAD, SPEED_SPREAD]))
    middle = 0.5 * (m.start_rad + m.end_rad) + rng.normal(0, PLACE_RAD)
    half = 0.5 * size * (m.end_rad - m.start_rad)
    return ProbingMovement(m.location, middle - half, middle + half, m.duration_s / speed)


def probed(
    patients: Sequence[KneePatient],
    movements: Sequence[ProbingMovement],
    seeds: Sequence[Sequence[int]],
) -> list[Passage]:
    """One probing movement for each patient, made by hands that are not perfect."""
    made = [
        as_made(m, np.random.default_rng([*seed, 2]))
        for m, seed in zip(movements, seeds, strict=True)
    ]
    ends = [HOLD_S + m.duration_s + AFTER_S for m in made]
    t = np.asarray(np.arange(round(max(ends) / STEP_S)) * STEP_S, dtype=np.float64)
    both = [m.at(t - HOLD_S) for m in made]
    knees = Knees(patients)
    motion = knees.move(
        np.stack([a for a, _ in both], axis=1), np.stack([r for _, r in both], axis=1), seeds
    )
    angle = motion.angle_rad.copy()
    for i, end in enumerate(ends):
        angle[t > end, i] = np.nan
    return _read(knees, motion.time_s, angle, motion.torque_Nm, seeds)


def patient_named(name: str, body: tuple[float, float] | None = None, seed: int = 1) -> KneePatient:
    """A simulated patient: a category (S3), two (S2+D4), of no category (rigid), or drawn: any."""
    rng = np.random.default_rng([SOMEBODY, seed])
    if name == "any":
        name = str(rng.choice([*CATEGORIES, *OUTSIDE_KINDS]))
    found = (draw_outside if name in OUTSIDE_KINDS else draw_category)(name, rng)
    if body is None:
        return found
    return dataclasses.replace(found, height_m=body[0], mass_kg=body[1])


# -- for the tasks of the study engine: a leg that is moved beforehand, then played ---------------

SAMPLE_S = 0.01


class PlayedLeg(Actor):
    """Samples of time, angle and torque, one after the other; then at rest where they ended."""

    def __init__(self, samples: Array) -> None:
        self._samples, self._next = samples, 0

    def react(self, scene: Scene, requests: Any) -> tuple[float, Inputs]:
        k = min(self._next, len(self._samples) - 1)
        late_s = (self._next - k) * SAMPLE_S
        self._next += 1
        t, angle, torque = (float(x) for x in self._samples[k])
        return t + late_s, {"angle_rad": angle, "torque_Nm": torque}


def _patient(given: Any) -> KneePatient:
    size = given.height_m, given.mass_kg
    if given.simulated not in CATEGORIES:
        return patient_named(given.simulated, size)
    # The one in the middle: whom a protocol names is nobody in particular.
    return dataclasses.replace(nominal(given.simulated), height_m=size[0], mass_kg=size[1])


def _seed(rng: np.random.Generator) -> list[int]:
    return [int(rng.integers(2**31))]


def _sampled(time_s: Array, angle: Array, torque: Array, seed: list[int]) -> Array:
    read, seen = knee_sensor().read(time_s, torque, angle, [*seed, 1])
    every = round(SAMPLE_S / STEP_S)
    return np.stack([time_s, seen, read], axis=1)[::every]


def _led(
    given: Any, path: Callable[[Array], tuple[Array, Array]], seconds: float, seed: list[int]
) -> Array:
    """Samples of a leg whose hands follow a path of angle and rate over time."""
    t = np.asarray(np.arange(round(seconds / STEP_S)) * STEP_S, dtype=np.float64)
    angle, rate = path(t)
    m = Knees([_patient(given)]).move(angle[:, None], rate[:, None], [seed])
    return _sampled(m.time_s, m.angle_rad[:, 0], m.torque_Nm[:, 0], seed)


def probing_actor(
    given: Any, move: ProbingMovement, still_s: float, after_s: float, rng: np.random.Generator
) -> Actor:
    """Held still while the movement is shown, then moved by hands."""
    seed = _seed(rng)
    made = as_made(move, np.random.default_rng([*seed, 2]))
    seconds = HOLD_S + made.duration_s + after_s
    moved = _led(given, lambda t: made.at(t - HOLD_S), seconds, seed)
    before = np.repeat(moved[:1], round((still_s - HOLD_S) / SAMPLE_S), axis=0)
    both = np.concatenate([before, moved])
    both[:, 0] = np.arange(len(both)) * SAMPLE_S
    return PlayedLeg(both)


def falling_actor(given: Any, seconds: float, rng: np.random.Generator) -> Actor:
    seed = _seed(rng)
    m = Knees([_patient(given)]).release(0.0, seconds, [seed])
    angle = m.angle_rad[:, 0]
    return PlayedLeg(_sampled(m.time_s, angle, 0 * angle, seed))


def following_actor(
    given: Any,
    path: Callable[[Array], tuple[Array, Array]],
    seconds: float,
    rng: np.random.Generator,
) -> Actor:
    return PlayedLeg(_led(given, path, seconds, _seed(rng)))


WAY_rad_s, READY_S = 40 * DEG, 1.0  # the way to a start, and how long the leg is held there
GRIP_S = 0.1  # in which hands take the leg over from its support, and let go of it; assumed
EDGE_RAD = 5 * DEG  # a sweep stays so far within the reach, for hands overshoot

Wish = tuple[float, float] | None  # angle and rate that the hands want; None: they let go


class MovedKnee:
    """Moves as it is asked to; until then the straight leg lies on its support."""

    def __init__(self, patient: KneePatient, device: DeviceData, seed: int = 1) -> None:
        self.patient = patient
        self._knees = Knees([patient])
        self._legs = MovedLegs(self._knees, np.zeros(1), TICK_S)
        self._coupling = SteppedCoupling(device)
        self._rng = np.random.default_rng([seed, 12])
        self._tone = _Wandering(TONE_SPREAD, TONE_S, self._rng)
        self._error = _Wandering(SENSOR_ERROR_NM, ERROR_STAYS_S, self._rng)
        self._phase = float(self._rng.uniform(0, 2 * math.pi))
        self._wishes: Iterator[Wish] | None = None
        self._wish: Wish = (0.0, 0.0)
        self._moved, self._ticks = (0.0, 0.0), 0
        self._pushed_Nm = self._wanted_Nm = self._grip = 0.0
        self._held = True  # by the support

    # -- what the hands are asked for --------------------------------------------------------------

    def follow(self, asked: ProbingMovement) -> None:
        """Go to the start of a movement, hold, and make it as people do."""
        made = as_made(asked, self._rng)
        self._wishes = self._chain(made.start_rad, made)

    def let_fall(self) -> None:
        self._wishes = self._chain(0.0, None)

    def sweep(self, low_rad: float, high_rad: float, period_s: float) -> None:
        """Bend and straighten slowly, on and on."""
        low_rad, high_rad = low_rad + EDGE_RAD, high_rad - EDGE_RAD
        there = _minimum_jerk(low_rad, high_rad, period_s / 2)
        back = _minimum_jerk(high_rad, low_rad, period_s / 2)
        self._wishes = self._chain(low_rad, there, back, again=True)

    def _chain(
        self, start_rad: float, *moves: ProbingMovement | None, again: bool = False
    ) -> Iterator[Wish]:
        now_rad = self._moved[1] if self._wish is None else self._wish[0]
        way_s = max(0.5, 1.875 * abs(start_rad - now_rad) / WAY_rad_s)
        yield from _ticks(_minimum_jerk(now_rad, start_rad, way_s), READY_S)
        while True:
            for move in moves:
                if move is None:
                    yield None
                else:
                    yield from _ticks(move, 0.0)
            if not again:
                return

    # -- time --------------------------------------------------------------------------------------

    def step(self) -> Mapping[str, tuple[float, float]]:
        """See :class:`esea_host.simulated.motion.JointMotion`."""
        if self._wishes is None:
            return {"": self._moved}
        self._wish = next(self._wishes, self._wish and (self._wish[0], 0.0))
        self._ticks += 1
        legs, patient = self._legs, self.patient
        x, v = float(legs.angle_rad[0]), float(legs.rate_rad_s[0])
        shaken = math.sin(2 * math.pi * TREMOR_Hz * self._ticks * TICK_S + self._phase)
        own_Nm = legs.own_Nm(1 + self._tone.step()) + patient.tremor_Nm * shaken
        self._held = self._held and self._grip < 1
        if not self._held:
            legs.move(own_Nm + self._pushed_Nm)
        error_Nm, wanted_Nm = self._error.step(), 0.0
        if self._wish is not None:
            angle, rate = self._wish
            wanted = HANDS_Nm_rad * (angle - x) + HANDS_Nms_rad * (rate - v)
            most = float(self._knees.pull_Nm[0])
            carried = float(self._knees.weight[0]) * math.cos(x)
            wanted_Nm = min(max(wanted - carried, -most), most)
        step = TICK_S / GRIP_S
        if self._wish is not None:
            self._wanted_Nm = wanted_Nm
        self._grip += min(max((self._wish is not None) - self._grip, -step), step)
        hands_Nm = self._grip * self._wanted_Nm
        now = float(legs.angle_rad[0])
        cuff_rad, torque_Nm = self._coupling.step(hands_Nm + error_Nm, now)
        self._pushed_Nm = torque_Nm - error_Nm
        self._moved = cuff_rad, now
        return {"": self._moved}


class _Wandering:
    # Noise of a given effective value that stays for a time.
    def __init__(self, spread: float, stays_s: float, rng: np.random.Generator) -> None:
        self._keep, self._rng = math.exp(-TICK_S / stays_s), rng
        self._new = spread * math.sqrt(1 - self._keep**2)
        self._now = spread * float(rng.standard_normal())

    def step(self) -> float:
        self._now = self._keep * self._now + self._new * float(self._rng.standard_normal())
        return self._now


def _minimum_jerk(start_rad: float, end_rad: float, duration_s: float) -> ProbingMovement:
    middle = 0.5 * (start_rad + end_rad)
    rate = 1.875 * (end_rad - start_rad) / duration_s
    return ProbingMovement(Location(middle, rate), start_rad, end_rad, duration_s)


def _ticks(move: ProbingMovement, hold_s: float) -> Iterator[tuple[float, float]]:
    ticks = round((move.duration_s + hold_s) / TICK_S)
    time_s = np.arange(ticks, dtype=np.float64) * TICK_S
    angle, rate = move.at(np.asarray(time_s, dtype=np.float64))
    yield from zip(angle.tolist(), rate.tolist(), strict=True)
