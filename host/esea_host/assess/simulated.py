"""Virtual clinics: simulated patients moved by simulated hands, read by the sensor's own C."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from esea_host.assess.knee import STEP_S, Knees, sweep
from esea_host.assess.patients import Array, KneePatient
from esea_host.assess.probing import ProbingMovement
from esea_host.assess.responses import LegRecording, Passage, passage
from esea_host.assess.sensing import knee_sensor

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
        read = sensor.read(t, tau, a, [*seeds[i], 1])
        # The joint's own encoder is as coarse as the coupling's.
        seen = np.round(a / sensor.count_rad) * sensor.count_rad
        out.append(passage(LegRecording(t, seen, read, p.height_m, p.mass_kg)))
    return out


def swept(patients: Sequence[KneePatient], seeds: Sequence[Sequence[int]]) -> list[Passage]:
    """The data base's excitation, one passage a patient."""
    path, rate = sweep()
    knees = Knees(patients)
    n = len(patients)
    m = knees.move(np.repeat(path[:, None], n, 1), np.repeat(rate[:, None], n, 1), seeds)
    return _read(knees, m.time_s, m.angle_rad, m.torque_Nm, seeds)


def probed(
    patients: Sequence[KneePatient],
    movements: Sequence[ProbingMovement],
    seeds: Sequence[Sequence[int]],
) -> list[Passage]:
    """One probing movement for each patient, made by hands that are not perfect.

    It is simulated until shortly after its midpoint, which is where it is looked at.
    """
    ends = []
    made = []
    for m, seed in zip(movements, seeds, strict=True):
        rng = np.random.default_rng([*seed, 2])
        size, speed = np.exp(rng.normal(0, [SIZE_SPREAD, SPEED_SPREAD]))
        middle = 0.5 * (m.start_rad + m.end_rad) + rng.normal(0, PLACE_RAD)
        half = 0.5 * size * (m.end_rad - m.start_rad)
        movement = ProbingMovement(m.location, middle - half, middle + half, m.duration_s / speed)
        made.append(movement)
        ends.append(HOLD_S + movement.duration_s / 2 + AFTER_S)
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
