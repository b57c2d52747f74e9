"""Plan of the next experiment: D-optimal motions inside the identified domain.

The value of a motion is its information about the parameters, by the derivatives of the identified
C along it; motions are taken one by one, each time the one that raises the determinant of the
information most a minute [1]_.  The value of a minute comes from the recording: how far its blocks,
left out one at a time, move the parameters.

References
----------
.. [1] V. V. Fedorov, "Theory of Optimal Experiments", Academic Press, 1972, chapter 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.identify.identification import Identification
from esea_gen.identify.published.plant import FittedPlant, free_keys, relative_jacobian
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.recorded import Recording
from esea_gen.language.ports import Array

RATE_Hz = 100.0
SHARES = (0.25, 0.5, 0.75, 1.0)  # of the largest deflection
FREQUENCIES_Hz = (0.01, 0.05, 0.2, 0.5, 1.0, 1.5)
UNTIMED_Hz = 0.2  # where nothing depends on time
CYCLES_s, SWEEP_s, HOLD_s, RAMP_s = 20.0, 60.0, 60.0, 0.5
REST_s = 5.0
NEAR = 1e-6  # information of a parameter of which nothing else is known


@dataclass(frozen=True)
class CommandedMotion:
    """A deflection to command: ``cycles``, ``sweep`` or ``hold``."""

    kind: str
    amplitude_rad: float  # largest deflection
    first_Hz: float  # frequencies; 0 of a hold
    last_Hz: float
    seconds: float  # in all, the rest before it included

    @property
    def text(self) -> str:
        deg, lasts = math.degrees(self.amplitude_rad), self.seconds - REST_s
        rest = f"rest {REST_s:g} s, then"
        if self.kind == "hold":
            way = f"go to {deg:.1f} deg in {RAMP_s:g} s and hold {lasts / 2 - 2 * RAMP_s:g} s"
            return f"{rest} {way}; the same to the other side"
        if self.kind == "sweep":
            span = f"from {self.first_Hz:.2g} to {self.last_Hz:.2g} Hz in {lasts:g} s"
            return f"{rest} a sine of {deg:.1f} deg, {span}"
        count = round(lasts * self.first_Hz)
        cycles = f"{count} cycle{'s' if count > 1 else ''}"
        return f"{rest} {cycles} of a sine of {deg:.1f} deg at {self.first_Hz:.2g} Hz"

    def deflection(self) -> tuple[Array, Array]:
        """Time and deflection to command, 100 samples a second."""
        count = round(self.seconds * RATE_Hz)
        t = np.arange(count + 1) / RATE_Hz
        u, lasts = np.maximum(t - REST_s, 0.0), self.seconds - REST_s
        if self.kind == "hold":
            corners = [0.0, RAMP_s, lasts / 2 - RAMP_s, lasts / 2 + RAMP_s, lasts - RAMP_s, lasts]
            return t, self.amplitude_rad * np.interp(u, corners, [0, 1, 1, -1, -1, 0])
        phase = self.first_Hz * u + (self.last_Hz - self.first_Hz) * u * u / (2 * lasts)
        return t, self.amplitude_rad * np.sin(2 * np.pi * phase)


def motions(theta_rad: float, omega_rad_s: float, timed: bool = True) -> list[CommandedMotion]:
    """Motions inside a domain of deflection and rate; one frequency where time does not matter."""
    found = []
    for share in SHARES:
        a = share * theta_rad
        most = omega_rad_s / (2 * math.pi * a)
        asked = FREQUENCIES_Hz if timed else (UNTIMED_Hz,)
        for f in sorted({min(f, most) for f in asked}):
            count = max(1, math.ceil(CYCLES_s * f - 1e-9))
            found.append(CommandedMotion("cycles", a, f, f, REST_s + count / f))
        if not timed:
            continue
        found.append(
            CommandedMotion("sweep", a, 0.0, min(FREQUENCIES_Hz[-1], most), REST_s + SWEEP_s)
        )
        if a / RAMP_s <= omega_rad_s:
            found.append(CommandedMotion("hold", a, 0.0, 0.0, REST_s + 2 * HOLD_s))
    return found


def d_optimal(
    known: Array, gains: Sequence[Array], seconds: Sequence[float], budget_s: float
) -> list[int]:
    """Places of the experiments to take, in order, until the time is spent."""
    information, left, chosen = known.copy(), budget_s, list[int]()
    while True:
        start = np.linalg.slogdet(information)[1]
        worth = [
            (np.linalg.slogdet(information + g)[1] - start) / s if s <= left else -math.inf
            for g, s in zip(gains, seconds, strict=True)
        ]
        best = int(np.argmax(worth)) if worth else 0
        if not worth or worth[best] <= 0:
            return chosen
        chosen.append(best)
        information = information + gains[best]
        left -= seconds[best]


@dataclass(frozen=True)
class Advice:
    title: str
    motions: tuple[tuple[int, CommandedMotion], ...]  # in the order of choice, each with how often
    sigma_now: dict[str, float]
    sigma_then: dict[str, float]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        steps = [{"times": n} | asdict(m) | {"text": m.text} for n, m in self.motions]
        return asdict(self) | {"motions": steps, "notes": list(self.notes)}

    def table(self) -> list[str]:
        minutes = sum(n * m.seconds for n, m in self.motions) / 60
        lines = [f"{self.title}: what to record next, {minutes:.1f} min"]
        for i, (times, m) in enumerate(self.motions, 1):
            lines.append(f"  {i}. {'' if times == 1 else f'{times} times: '}{m.text}")
        lines.append("expected standard deviations, of this recording and with these motions")
        for key, now in self.sigma_now.items():
            lines.append(f"  {key:14} {now:10.3g} {self.sigma_then[key]:10.3g}")
        return [*lines, *(f"note: {n}" for n in self.notes)]


def advise(result: Identification, minutes: float) -> Advice:
    """The motions that tell most of an identified device's parameters."""
    device, values = result.device, result.fit.values
    if result.fit.rate_dropped or device.elastomer.maxwell is None:
        values = {k: v for k, v in values.items() if k in result.spread.sigma}
    free, spread = free_keys(values), result.spread.resampled
    if not free or spread is None:
        raise UserError("No parameter is free: every one is at a bound.", "Give other recordings.")
    domain = device.file.domain
    timed = device.elastomer.maxwell is not None
    possible = motions(domain.theta_max_rad.value, domain.omega_max_rad_s.value, timed)
    own = sum(_informations(device, values, free, list(result.recordings), timed))
    given = [_recording(m) for m in possible]
    gains = _informations(device, values, free, given, timed)
    worth = len(free) / float(np.trace(spread.covariance @ own))
    known = worth * own + NEAR * np.eye(len(free))
    chosen = d_optimal(
        known, [worth * g for g in gains], [m.seconds for m in possible], 60 * minutes
    )
    if not chosen:
        least = min(m.seconds for m in possible) / 60
        raise UserError(
            f"{minutes:g} minutes are too short for any motion.", f"Give {least:.1f} or more."
        )
    then = known + worth * sum(gains[i] for i in chosen)
    shares = np.sqrt(np.diag(np.linalg.inv(then)) / np.diag(np.linalg.inv(known)))
    now = {k: float(s) * values[k] for k, s in zip(free, spread.sigma, strict=True)}
    return Advice(
        device.title,
        tuple((chosen.count(i), possible[i]) for i in dict.fromkeys(chosen)),
        now,
        {k: float(share) * now[k] for k, share in zip(free, shares, strict=True)},
        _notes(result, timed),
    )


def _notes(result: Identification, timed: bool) -> tuple[str, ...]:
    notes = [
        "Inside the domain of the recording; the expected figures assume a correct model form."
    ]
    if not timed and not all(r.timed for r in result.recordings):
        notes.append("Record the time: without it no rate term can be identified.")
    elif not timed:
        notes.append("The model has no rate terms: frequencies do not matter to this advice.")
    return tuple(notes)


def _recording(m: CommandedMotion) -> Recording:
    t, theta = m.deflection()
    rows = np.flatnonzero(t >= REST_s)
    # The last sample of a coarse grid may be missing.
    data = DataSet(m.text, m.amplitude_rad, rows[:-1], rows[:0], {}, None, None, None)
    return Recording(m.text, "", "", t, theta, np.zeros_like(t), True, 0, (), (data,))


def _informations(
    device: Device,
    values: dict[str, float],
    free: Sequence[str],
    recordings: list[Recording],
    timed: bool,
) -> list[Array]:
    """Of each recording that trains, the integral over its training time; by relative change."""
    plant = FittedPlant(device, recordings, RATE_Hz if timed else None)
    jacobian = relative_jacobian(plant.torque, values, free, 1e-3)
    trained = [r for r in recordings if any(len(s.training) for s in r.sets)]
    out, first = [], 0
    for r, stream in zip(trained, plant.streams, strict=True):
        count = sum(len(rows) for rows in stream.training)
        part = jacobian[first : first + count]
        first += count
        step = 1 / RATE_Hz if timed else float(np.median(np.diff(r.time_s)))
        out.append(part.T @ part * step)
    return out
