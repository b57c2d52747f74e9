"""The simulated knee in motion: moved by a clinician's hands, or let go.

    J a = hands + weight cos(angle) + passive - damping rate + muscles

The stretch reflex has a static threshold angle, a dynamic threshold speed and a gain [He1997]; its
stiffness grows with speed [McPherson2018]; delay, then two lags.  Sources: ``patients``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from esea_host.assess.patients import (
    DEG,
    GRAVITY_M_S2,
    LEG_CENTRE,
    LEG_LENGTH,
    LEG_MASS,
    LEG_RADIUS,
    PULL_N,
    RANGE_RAD,
    Array,
    KneePatient,
    columns,
    passive_torque_Nm,
    shank_length_m,
)

STEP_S = 2e-3
# Hands that follow a path, assumed; limited to the pull.
HANDS_Nm_rad, HANDS_Nms_rad = 300.0, 14.0
EDGE_rad_s = 3 * DEG  # over which the reflex sets in
FRICTION_rad_s = 8 * DEG  # over which friction and help set in
TREMOR_Hz = 5.0  # assumed
TONE_SPREAD, TONE_S = 0.05, 1.0  # how the tone wanders, and how fast; assumed


@dataclass(frozen=True)
class KneeMotion:
    """What happened: arrays of shape (steps, patients).

    torque_Nm: of the hands on the leg, positive towards flexion.
    """

    time_s: Array
    angle_rad: Array
    rate_rad_s: Array
    torque_Nm: Array


class Knees:
    """Several simulated knees, stepped together."""

    def __init__(self, patients: Sequence[KneePatient]) -> None:
        self.patients = tuple(patients)
        c = self.columns = columns(patients)
        mass = LEG_MASS * c["mass_kg"] * c["leg_scale"]
        length = LEG_LENGTH * c["height_m"]
        self.inertia = mass * (LEG_RADIUS * length) ** 2
        self.weight = mass * GRAVITY_M_S2 * LEG_CENTRE * length
        self.size = np.array([p.size for p in patients])
        self.pull_Nm = PULL_N * np.asarray(shank_length_m(c["height_m"]))
        self.late = np.rint(c["delay_s"] / STEP_S).astype(int)

    def reflex_Nm(self, angle: Array, rate: Array) -> Array:
        """Reflex drive of extensors and flexors, shape (2, patients), both positive."""
        c = self.columns
        stretch = np.stack([angle, RANGE_RAD - angle])
        speed = np.stack([rate, -rate])
        over = speed - c["dynamic_threshold_rad_s"]
        moving = 0.5 * (1 + np.tanh(over / EDGE_rad_s))
        threshold = c["threshold_rad"].T - c["threshold_rate_s"] * np.maximum(speed, 0)
        stiffness = c["gain_Nms_rad2"] * np.maximum(over, 0)
        drive = moving * stiffness * np.maximum(stretch - threshold, 0)
        most = c["reflex_max_Nm"].T
        return np.asarray(most * -np.expm1(-drive / most))

    def still_Nm(self, angle: Array, rate: Array, tone: Array | float = 1.0) -> Array:
        """Torque on the leg of all but hands and reflex, positive towards flexion."""
        c = self.columns
        away = np.tanh((angle - c["posture_rad"]) / c["posture_width_rad"])
        muscles = -c["tone_Nm"] * tone * (away + c["tone_damping_s"] * rate)
        muscles = muscles + (c["helping_Nm"] - c["friction_Nm"]) * np.tanh(rate / FRICTION_rad_s)
        short = np.maximum(angle - c["contracture_rad"], 0)
        own = c["passive_scale"] * passive_torque_Nm(angle) - c["damping_Nms_rad"] * rate
        held = own + muscles - c["contracture_Nm_rad"] * short
        return np.asarray(self.size * held + self.weight * np.cos(angle))

    def move(self, path: Array, rate: Array, seeds: Sequence[Sequence[int]]) -> KneeMotion:
        """Follow a path with the hands; without hands: see :meth:`release`.

        path, rate: what the hands want, shape (steps, patients).
        seeds: one per patient, for what wanders.
        """
        return self._run(len(path), path[0], path, rate, seeds)

    def release(
        self, start_rad: float, duration_s: float, seeds: Sequence[Sequence[int]]
    ) -> KneeMotion:
        """Let the leg fall from an angle, as in the pendulum test."""
        start = np.full(len(self.patients), start_rad)
        return self._run(round(duration_s / STEP_S), start, None, None, seeds)

    def _tone(self, steps: int, seeds: Sequence[Sequence[int]]) -> tuple[Array, Array]:
        n = len(self.patients)
        tone, tremor = np.ones((steps, n)), np.zeros((steps, n))
        keep = float(np.exp(-STEP_S / TONE_S))
        t = np.arange(steps) * STEP_S
        for i, seed in enumerate(seeds):
            rng = np.random.default_rng(list(seed))
            wander = rng.normal(0, TONE_SPREAD)
            phase = rng.uniform(0, 2 * np.pi)
            if self.patients[i].tone_Nm > 0:
                from scipy.signal import lfilter

                new = rng.normal(0, TONE_SPREAD * np.sqrt(1 - keep**2), steps)
                tone[:, i] += lfilter([1.0], [1.0, -keep], new, zi=[keep * wander])[0]
            if self.patients[i].tremor_Nm > 0:
                tremor[:, i] = self.patients[i].tremor_Nm * np.sin(
                    2 * np.pi * TREMOR_Hz * t + phase
                )
        return tone, tremor

    def _run(
        self,
        steps: int,
        start: Array,
        path: Array | None,
        path_rate: Array | None,
        seeds: Sequence[Sequence[int]],
    ) -> KneeMotion:
        n, h = len(self.patients), STEP_S
        tone, tremor = self._tone(steps, seeds)
        angle, rate = np.empty((steps, n)), np.empty((steps, n))
        torque = np.zeros((steps, n))
        x, v = np.array(start, dtype=np.float64), np.zeros(n)
        first = second = np.zeros((2, n))
        who = np.arange(n)
        lag = -np.expm1(-h / self.columns["activation_s"])
        most = self.pull_Nm
        for k in range(steps):
            angle[k], rate[k] = x, v
            then = np.maximum(k - self.late, 0)
            drive = self.size * self.reflex_Nm(angle[then, who], rate[then, who])
            first = first + lag * (drive - first)
            second = second + lag * (first - second)
            own = self.still_Nm(x, v, tone[k]) - second[0] + second[1] + tremor[k]
            if path is not None and path_rate is not None:
                # Hands carry what the leg weighs, as far as they are strong enough.
                wanted = HANDS_Nm_rad * (path[k] - x) + HANDS_Nms_rad * (path_rate[k] - v)
                held = np.clip(wanted - self.weight * np.cos(x), -most, most)
                torque[k] = held
                own = own + held
            v = v + h / self.inertia * own
            x = x + h * v
        return KneeMotion(np.asarray(np.arange(steps) * h, dtype=np.float64), angle, rate, torque)


def sweep(duration_s: float = 36.0, top_Hz: float = 0.3) -> tuple[Array, Array]:
    """Excitation of the data base: a sine swept 0 to 0.3 Hz at 0.5 Hz/min, 130 deg peak to peak."""
    t = np.arange(round(duration_s / STEP_S)) * STEP_S
    slope = top_Hz / duration_s
    phase, speed = np.pi * slope * t**2, 2 * np.pi * slope * t
    return RANGE_RAD / 2 * (1 - np.cos(phase)), RANGE_RAD / 2 * np.sin(phase) * speed
