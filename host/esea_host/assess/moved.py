"""Simulated knee on a simulated board: patient and therapist in a loop with the coupling.

The hands push the cuff by sight and feel of the leg; the coupling's torque moves the leg.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from esea_gen.devices.file import DeviceData
from esea_host.assess.patients import (
    DEG,
    TONE_S,
    TONE_SPREAD,
    HANDS_Nm_rad,
    HANDS_Nms_rad,
    KneePatient,
    Knees,
    MovedLegs,
    TREMOR_Hz,
)
from esea_host.assess.probing import ProbingMovement
from esea_host.assess.responses import ERROR_STAYS_S, SENSOR_ERROR_NM, Location
from esea_host.assess.simulated import as_made
from esea_host.simulated.motion import TICK_S, SteppedCoupling

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
