"""Segment a stream of samples into movements, warn at the limits, and judge a movement.

Neither clock nor window: samples in, events out.  Speed that decides on rest is the difference of
two means of 0.2 s: noise, counts and a tremor of 5 Hz cancel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess.patients import DEG, MEAN_HEIGHT_M, MEAN_MASS_KG, Array
from esea_host.assess.probing import Comfort, ProbingMovement
from esea_host.assess.responses import NEAR_RAD, LegRecording, NEAR_rad_s, Passage, nearest, passage

WINDOW_S, STILL_rad_s, REST_S = 0.4, 3 * DEG, 0.3
LEAST_RAD = 6 * DEG  # half of the smallest movement that is proposed
LEAD_S, KEPT_S, LONGEST_S = 0.2, 2.0, 30.0
HOLE_STEPS, LEARNT_STEPS = 5.0, 15  # a longer step than so many usual ones has lost samples
# Beyond the limit by so much: a leg that rests at its limit, and noise of the rate, do not warn.
OVER_RAD, OVER_rad_s, OVER_SAMPLES = 2 * DEG, 5 * DEG, 2


@dataclass(frozen=True)
class Segment:
    """A movement and the rest around it; begin_s, end_s: of the movement itself."""

    begin_s: float
    end_s: float
    time_s: Array
    angle_rad: Array
    rate_rad_s: Array
    torque_Nm: Array

    def recording(
        self, height_m: float = MEAN_HEIGHT_M, mass_kg: float = MEAN_MASS_KG
    ) -> LegRecording:
        return LegRecording(self.time_s, self.angle_rad, self.torque_Nm, height_m, mass_kg)


@dataclass(frozen=True)
class MovementEvent:
    """Event that a sample caused; segment: of ``moved``."""

    kind: Literal["started", "moved", "broken", "lost", "warning"]
    time_s: float
    text: str = ""
    segment: Segment | None = None


class MovementWatch:
    """Takes samples one by one at 50 Hz to 1 kHz."""

    def __init__(self, comfort: Comfort, longest_s: float = LONGEST_S) -> None:
        self.comfort, self._longest_s = comfort, longest_s
        self._over = {"low": 0, "high": 0, "fast": 0}
        self._forget()

    def _forget(self) -> None:
        self._rows: list[tuple[float, float, float, float]] = []
        self._sums = [0.0]
        self._low = self._middle = 0
        self._begin: int | None = None
        self._far, self._still_s = False, math.nan
        self._steps: list[float] = []
        self._hole_s = math.inf

    @property
    def moving(self) -> bool:
        return self._begin is not None and self._far

    def end(self, reason: str) -> list[MovementEvent]:
        """The stream ends for a reason, and the movement with it if there is one."""
        if not self._rows:
            return []
        moving, at_s = self.moving, self._rows[-1][0]
        self._forget()
        return [MovementEvent("broken" if moving else "lost", at_s, reason.rstrip("."))]

    def take(
        self, time_s: float, angle_rad: float, rate_rad_s: float, torque_Nm: float, ok: bool = True
    ) -> list[MovementEvent]:
        """Process one sample; return the event it causes, mostly None."""
        row = (time_s, angle_rad, rate_rad_s, torque_Nm)
        if not ok or not all(map(math.isfinite, row)):
            return self.end("angle or torque is not valid")
        events = self._after(time_s)
        self._rows.append(row)
        self._sums.append(self._sums[-1] + angle_rad)
        return events + self._warned(time_s, angle_rad, rate_rad_s) + self._moved(time_s)

    def _after(self, time_s: float) -> list[MovementEvent]:
        if not self._rows:
            return []
        step_s = time_s - self._rows[-1][0]
        if step_s <= 0:
            return self.end("the time of a sample does not rise")
        if step_s > self._hole_s:
            return self.end(f"no data for {1e3 * step_s:.0f} ms")
        if len(self._steps) < LEARNT_STEPS:
            self._steps.append(step_s)
            if len(self._steps) == LEARNT_STEPS:
                self._hole_s = HOLE_STEPS * sorted(self._steps)[LEARNT_STEPS // 2]
        return []

    def _warned(self, time_s: float, angle: float, rate: float) -> list[MovementEvent]:
        c = self.comfort
        low, high, most = c.low_rad / DEG, c.high_rad / DEG, c.rate_rad_s / DEG
        beyond = f"Beyond the comfort range: {angle / DEG:.0f}°"
        limits = {
            "low": (c.low_rad - angle, OVER_RAD, f"{beyond}, at least {low:.0f}°."),
            "high": (angle - c.high_rad, OVER_RAD, f"{beyond}, at most {high:.0f}°."),
            "fast": (
                abs(rate) - c.rate_rad_s,
                OVER_rad_s,
                f"Too fast: {abs(rate) / DEG:.0f}°/s, at most {most:.0f}°/s.",
            ),
        }
        out = []
        for name, (over, margin, text) in limits.items():
            if over > margin:
                self._over[name] += 1
                if self._over[name] == OVER_SAMPLES:
                    out.append(MovementEvent("warning", time_s, text))
            elif over <= 0 or self._over[name] < OVER_SAMPLES:
                self._over[name] = 0  # only who was back inside is warned again
        return out

    def _speed(self, now_s: float) -> float | None:
        rows, sums = self._rows, self._sums
        while rows[self._low][0] <= now_s - WINDOW_S:
            self._low += 1
        while rows[self._middle][0] <= now_s - WINDOW_S / 2:
            self._middle += 1
        a, b, n = self._low, self._middle, len(rows)
        if a in (0, b):  # not a whole window yet
            return None
        return ((sums[n] - sums[b]) / (n - b) - (sums[b] - sums[a]) / (b - a)) * 2 / WINDOW_S

    def _moved(self, now_s: float) -> list[MovementEvent]:
        speed = self._speed(now_s)
        if speed is None:
            return []
        if self._begin is None:
            if abs(speed) >= STILL_rad_s:
                self._begin, self._far, self._still_s = self._low, False, math.nan
            elif self._rows[self._low][0] - self._rows[0][0] > KEPT_S:
                self._drop(self._low // 2)
            return []
        start_s, start_rad = self._rows[self._begin][:2]
        if not self._far and abs(self._rows[-1][1] - start_rad) >= LEAST_RAD:
            self._far = True
            return [MovementEvent("started", start_s)]
        if abs(speed) >= STILL_rad_s:
            self._still_s = math.nan
        elif math.isnan(self._still_s):
            self._still_s = now_s
        if now_s - start_s > self._longest_s:
            return self.end(f"the leg did not come to rest within {self._longest_s:g} s")
        if not now_s - self._still_s >= REST_S:
            return []
        events = []
        if self._far:
            end_s = self._still_s - WINDOW_S / 2
            t, *others = np.array(self._rows).T
            kept = t >= start_s - LEAD_S
            segment = Segment(start_s, end_s, t[kept], *(x[kept] for x in others))
            events = [MovementEvent("moved", now_s, segment=segment)]
        self._begin = None
        self._drop(self._low)
        return events

    def _drop(self, count: int) -> None:
        del self._rows[:count], self._sums[:count]
        self._low, self._middle = max(0, self._low - count), self._middle - count


@dataclass(frozen=True)
class MovementVerdict:
    passage: Passage | None
    tried: bool  # an attempt at all, and not the way to its start
    passed: bool
    text: str


def judge(
    segment: Segment, asked: ProbingMovement, height_m: float, mass_kg: float
) -> MovementVerdict:
    """Compare a movement with the one proposed: passed within a tolerance, or to be tried again."""
    try:
        p = passage(segment.recording(height_m, mass_kg))
    except UserError as error:
        return MovementVerdict(None, True, False, str(error))
    at, distance = nearest(p, asked.location)
    first, inside = segment.angle_rad[0], segment.angle_rad
    way = asked.end_rad - asked.start_rad
    went = float(np.max((inside - first) * np.sign(way)))
    tried = abs(first - asked.start_rad) <= NEAR_RAD and went >= abs(way) / 2
    if not math.isfinite(distance):
        text = "Your hands were at the limit of their pull: nothing could be read."
        return MovementVerdict(p, tried, False, text)
    angle, rate, wanted = float(p.angle_rad[at]), float(p.rate_rad_s[at]), asked.location
    text = (
        f"Reached {abs(rate) / DEG:.0f}°/s at {angle / DEG:.0f}° (asked: "
        f"{abs(wanted.rate_rad_s) / DEG:.0f}°/s at {wanted.angle_rad / DEG:.0f}°)"
    )
    passed = distance <= 1
    if passed:
        text += ", passed."
    elif abs(rate - wanted.rate_rad_s) / NEAR_rad_s > abs(angle - wanted.angle_rad) / NEAR_RAD:
        slow = abs(rate) < abs(wanted.rate_rad_s)
        text += f", missed: try again, {'faster' if slow else 'slower'}."
    else:
        text += ", missed: try again."
    return MovementVerdict(p, tried or passed, passed, text)
