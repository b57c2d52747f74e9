"""Simulated people for the tasks of the knee: a leg that is moved beforehand, then played."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from esea_host.assess.knee import STEP_S, Knees
from esea_host.assess.patients import CATEGORIES, Array, KneePatient
from esea_host.assess.probing import ProbingMovement
from esea_host.assess.simulated import HOLD_S, knee_sensor, moved_by_hands, patient_named
from esea_host.assess.validation import nominal
from esea_host.study.scene import Scene
from esea_host.study.task import Actor, Inputs

SAMPLE_S = 0.01


class PlayedLeg(Actor):
    """Samples of time, angle and torque, one after the other; then at rest where they ended."""

    def __init__(self, samples: Array) -> None:
        self._samples, self._next = samples, 0

    def react(self, scene: Scene, requests: Any) -> tuple[float, Inputs]:
        """The next one, whatever is shown."""
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
    read = knee_sensor().read(time_s, torque, angle, [*seed, 1])
    every = round(SAMPLE_S / STEP_S)
    return np.stack([time_s, angle, read], axis=1)[::every]


def probing_actor(
    given: Any, move: ProbingMovement, still_s: float, after_s: float, rng: np.random.Generator
) -> Actor:
    """Held still while the movement is shown, then moved by hands."""
    seed = _seed(rng)
    t, angle, torque = moved_by_hands(_patient(given), move, HOLD_S, after_s, seed)
    moved = _sampled(t, angle, torque, seed)
    before = np.repeat(moved[:1], round((still_s - HOLD_S) / SAMPLE_S), axis=0)
    both = np.concatenate([before, moved])
    both[:, 0] = np.arange(len(both)) * SAMPLE_S
    return PlayedLeg(both)


def falling_actor(given: Any, seconds: float, rng: np.random.Generator) -> Actor:
    """Let go from a straight knee."""
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
    """Hands that follow a path of angle and rate over time."""
    seed = _seed(rng)
    t = np.asarray(np.arange(round(seconds / STEP_S)) * STEP_S, dtype=np.float64)
    angle, rate = path(t)
    m = Knees([_patient(given)]).move(angle[:, None], rate[:, None], [seed])
    return PlayedLeg(_sampled(m.time_s, m.angle_rad[:, 0], m.torque_Nm[:, 0], seed))
