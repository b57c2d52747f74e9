"""Virtual clinics: simulated patients moved by simulated hands, read by the sensor's own C.

The coupling twists as the exact inverse of the model says (its play is crossed at once), both
encoders count whole steps, and the device's C makes a torque of that.  How far the model is from a
real coupling comes on top: 3.82 % of full scale, as published for one minute of free motion.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cache

import numpy as np

from esea_gen.device import Device, load_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device, compile_system
from esea_gen.hostlib.runner import CRunner
from esea_gen.model.inverse import exact_inverse, inverse_system
from esea_host.assess.knee import STEP_S, Knees, sweep
from esea_host.assess.patients import (
    CATEGORIES,
    OUTSIDE_KINDS,
    Array,
    KneePatient,
    draw,
    draw_outside,
)
from esea_host.assess.probing import ProbingMovement
from esea_host.assess.responses import (
    ERROR_STAYS_S,
    SENSOR_ERROR_NM,
    LegRecording,
    Passage,
    passage,
)


class KneeSensor:
    """The passive knee sensor, compiled once; encoders start anywhere in a step."""

    def __init__(self, device: Device) -> None:
        self.device = device
        block = exact_inverse(device)
        self._coupling: CRunner = compile_system(inverse_system(device, block), "f64").block(
            block.name
        )
        self._sense: CRunner = compile_device(device, "f32").task("sense")
        self.rate_Hz = 1.0 / device.period_s
        self.count_rad = 2 * np.pi / 2**device.file.encoder.resolution_bits.value
        self.error_Nm = SENSOR_ERROR_NM

    def read(self, time_s: Array, torque_Nm: Array, angle_rad: Array, seed: list[int]) -> Array:
        """Torque as read, at the times given.

        torque_Nm, angle_rad: true torque through the coupling and angle of the joint.
        """
        rng = np.random.default_rng(seed)
        t = np.arange(time_s[0], time_s[-1], self.device.period_s)
        error = self._error(len(t), rng)
        self._coupling.reset()
        twist, _ = self._coupling.run(
            {"tau_Nm": np.interp(t, time_s, torque_Nm) + error}, trace=False
        )
        load = np.interp(t, time_s, angle_rad) + rng.uniform(0, 2 * np.pi)
        # Zeroed when put on: only the change counts.
        motor = load + twist["theta_rad"] + rng.uniform(0, self.count_rad)
        counts = np.floor(motor / self.count_rad) - np.floor(load / self.count_rad)
        self._sense.reset()
        out, _ = self._sense.run({"theta_rad": counts * self.count_rad}, trace=False)
        return np.interp(time_s, t, np.asarray(out["tau_Nm"], dtype=np.float64))

    def _error(self, steps: int, rng: np.random.Generator) -> Array:
        from scipy.signal import lfilter

        keep = float(np.exp(-self.device.period_s / ERROR_STAYS_S))
        start = rng.normal(0, self.error_Nm)
        new = rng.normal(0, self.error_Nm * np.sqrt(1 - keep**2), steps)
        return np.asarray(lfilter([1.0], [1.0, -keep], new, zi=[keep * start])[0])


@cache
def knee_sensor() -> KneeSensor:
    """The shipped device ``knee``."""
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
    """One probing movement for each patient, made by hands that are not perfect.

    It is simulated until shortly after its end.
    """
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


def moved_by_hands(
    patient: KneePatient, m: ProbingMovement, still_s: float, after_s: float, seed: Sequence[int]
) -> tuple[Array, Array, Array]:
    """Time, angle and true torque of one leg that is held still first and then moved."""
    made = as_made(m, np.random.default_rng([*seed, 2]))
    steps = round((still_s + made.duration_s + after_s) / STEP_S)
    t = np.asarray(np.arange(steps) * STEP_S, dtype=np.float64)
    angle, rate = made.at(t - still_s)
    motion = Knees([patient]).move(angle[:, None], rate[:, None], [seed])
    return motion.time_s, motion.angle_rad[:, 0], motion.torque_Nm[:, 0]


def patient_named(name: str, body: tuple[float, float] | None = None, seed: int = 1) -> KneePatient:
    """A simulated patient: a category (S3), two (S2+D4), of no category (rigid), or drawn: any.

    body: height in m and mass in kg; by default drawn, too.
    """
    rng = np.random.default_rng([SOMEBODY, seed])
    if name == "any":
        name = str(rng.choice([*CATEGORIES, *OUTSIDE_KINDS]))
    if name in OUTSIDE_KINDS:
        found = draw_outside(name, rng)
    else:
        found = draw(*_severities(name), rng, name)
    if body is None:
        return found
    return dataclasses.replace(found, height_m=body[0], mass_kg=body[1])


def _severities(name: str) -> tuple[float, float]:
    levels = {"S": 0.0, "D": 0.0}
    for part in name.split("+"):
        try:
            what, level = part[:1], float(part[1:])
        except ValueError:
            what, level = "", 0.0
        if what not in levels or not 0 < level <= 5:
            raise UserError(
                f"simulated patient {name!r}.",
                f"S1 to S5, D1 to D5, two such as S2+D4, {', '.join(OUTSIDE_KINDS)}, or any.",
            )
        levels[what] = level
    return levels["S"], levels["D"]
