"""From a recording of a moved leg to responses at locations: angle and rate in, extra torque out.

The leg's weight and inertia, from the tables' shares of body height and mass, are subtracted; the
rest is divided by body size, so that legs of any size are comparable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import savgol_filter

from esea_gen.errors import UserError
from esea_host.assess.patients import (
    DEG,
    MEAN_HEIGHT_M,
    MEAN_MASS_KG,
    PULL_N,
    Array,
    body_size,
    leg_inertia_kgm2,
    leg_weight_Nm,
    shank_length_m,
)

SMOOTH_S = 0.16
SLOWEST_S = SMOOTH_S / 4  # of a recording, from sample to sample: a local cubic needs five
TORQUE_SMOOTH_S = 0.04  # longer, and a tremor of 5 Hz would be smoothed away and not be seen
SENSOR_ERROR_NM = 0.0382 * 47.8  # rms over a minute of free motion, thesis chapter 8
ERROR_STAYS_S = 1.0  # how long that error lasts, assumed
MOST_READINGS = 12  # of one movement: farther apart than a tolerance, or nothing new is read
STRAINED = 0.95  # of the hands' pull: beyond it a leg goes its own way, and for some time after
AFTER_STRAIN_S = 0.5
# A reflex answers to where the leg was this long ago (delay, and lags of the muscle).  Without it
# one location gives other torques while speeding up than while slowing down: 20 and 26 Nm at S5.
LATENCY_S = 0.06


def check_body(height_m: float, mass_kg: float) -> None:
    """Reject an implausible height or mass."""
    if not (1.0 <= height_m <= 2.3 and 15 <= mass_kg <= 250):
        raise UserError(
            f"body: height {height_m:g} m, mass {mass_kg:g} kg.",
            "Give 1.0 to 2.3 m and 15 to 250 kg.",
        )


@dataclass(frozen=True)
class LegRecording:
    """A moved leg.  angle_rad: flexion from full extension; torque_Nm: hands on leg, to flexion."""

    time_s: Array
    angle_rad: Array
    torque_Nm: Array
    height_m: float = MEAN_HEIGHT_M
    mass_kg: float = MEAN_MASS_KG
    level: bool = True  # thigh level: weight acts; False: leg on its side
    error_Nm: float = SENSOR_ERROR_NM  # how far a torque may be off throughout a movement
    read: str = ""
    simulated: bool = False

    def __post_init__(self) -> None:
        steps = np.diff(self.time_s)
        if len(self.time_s) < 20 or np.any(steps <= 0):
            raise UserError(
                f"recording: {len(self.time_s)} samples, times must rise.",
                "Give at least 20 samples with rising times.",
            )
        for name in ("time_s", "angle_rad", "torque_Nm"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise UserError(f"recording: {name} has gaps.", "Cut the recording at its gaps.")
        usual_s = float(np.median(steps))
        if usual_s > SLOWEST_S:
            raise UserError(
                f"recording: a sample every {usual_s:.3g} s, at most {SLOWEST_S:g} s.",
                f"Record at {1 / SLOWEST_S:.0f} Hz or more: speed is taken over {SMOOTH_S:g} s.",
            )
        check_body(self.height_m, self.mass_kg)


@dataclass(frozen=True)
class Passage:
    """A recording seen as locations passed: arrays of shape (samples,).

    response_Nm: what the hands must add 60 ms later, per body size, beyond carrying and
        accelerating a standard leg; positive towards flexion.
    strained: where the hands were, or have just been, at the limit of their pull: nothing counts.
    error_Nm: how far all responses of the movement may be off together.
    """

    time_s: Array
    angle_rad: Array
    rate_rad_s: Array
    response_Nm: Array
    strained: npt.NDArray[np.bool_]
    error_Nm: float


def passage(recording: LegRecording) -> Passage:
    """Angle, rate and acceleration by a local cubic over 0.16 s; then weight and inertia off."""
    r = recording
    h = float(np.median(np.diff(r.time_s)))
    t = np.arange(r.time_s[0], r.time_s[-1], h)
    raw = np.interp(t, r.time_s, r.angle_rad)
    window = max(5, 2 * round(SMOOTH_S / h / 2) + 1)
    if window + round(LATENCY_S / h) >= len(t):
        raise UserError(
            f"recording: {r.time_s[-1] - r.time_s[0]:.2f} s long.", f"Record at least {SMOOTH_S} s."
        )
    angle, rate, acceleration = (savgol_filter(raw, window, 3, deriv=k, delta=h) for k in range(3))
    short = max(3, 2 * round(TORQUE_SMOOTH_S / h / 2) + 1)
    torque = savgol_filter(np.interp(t, r.time_s, r.torque_Nm), short, 1)
    weight = leg_weight_Nm(r.height_m, r.mass_kg) * np.cos(angle) if r.level else 0.0
    carried = leg_inertia_kgm2(r.height_m, r.mass_kg) * acceleration - weight
    size = body_size(r.height_m, r.mass_kg)
    limit = STRAINED * PULL_N * float(shank_length_m(r.height_m))
    after = round(AFTER_STRAIN_S / h)
    strains = np.cumsum(np.abs(torque) > limit)
    strained = strains > np.concatenate([np.zeros(after), strains])[: len(strains)]
    late = round(LATENCY_S / h)
    response, strained = ((torque - carried) / size)[late:], strained[late:]
    n = len(response)
    return Passage(t[:n], angle[:n], rate[:n], response, strained, r.error_Nm / size)


def effective_samples(x: Array) -> float:
    """How many independent samples a correlated stretch is worth.

    n / (1 + 2 sum of autocorrelations), summed until first below 0 (Geyer's initial positive
    sequence: pairs of lags).
    """
    n = len(x)
    d = np.asarray(x) - np.mean(x)
    power = float(d @ d)
    if n < 3 or power == 0:
        return float(min(n, 1)) if power == 0 else float(n)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(d, size)
    rho = np.fft.irfft(spectrum * spectrum.conj(), size)[:n] / power
    pairs = rho[1 : n - 1 : 2] + rho[2:n:2]
    ends = np.flatnonzero(pairs <= 0)
    total = float(np.sum(pairs[: ends[0]] if len(ends) else pairs))
    return float(np.clip(n / (1 + 2 * total), 1.0, n))


@dataclass(frozen=True)
class Location:
    """Where a movement is looked at: angle and rate of the joint."""

    angle_rad: float
    rate_rad_s: float

    def text(self) -> str:
        way = "bending" if self.rate_rad_s > 0 else "straightening"
        speed = abs(self.rate_rad_s) / DEG
        return f"{self.angle_rad / DEG:.0f}° while {way} at {speed:.0f}°/s"


# One tolerance: how near is near enough, and the scale on which locations are compared.
NEAR_RAD, NEAR_rad_s = 10 * DEG, 20 * DEG


@dataclass(frozen=True)
class MovementReadings:
    """Locations that one movement passed, farther from each other than a tolerance.

    locations, responses_Nm: one a location.  error_Nm2: covariance of their errors, for an error of
    the sensor stays for a while.  distance: from what was asked, in tolerances.
    """

    locations: tuple[Location, ...]
    responses_Nm: Array
    error_Nm2: Array
    distance: float

    @property
    def passed(self) -> bool:
        """Whether the requested location was passed, within a tolerance."""
        return self.distance <= 1


def nearest(p: Passage, wanted: Location) -> tuple[int, float]:
    """Sample nearest to a location, and how far it is in tolerances; infinite: strained."""
    angle, rate = p.angle_rad - wanted.angle_rad, p.rate_rad_s - wanted.rate_rad_s
    off = np.where(p.strained, np.inf, np.hypot(angle / NEAR_RAD, rate / NEAR_rad_s))
    first = int(np.argmin(off))
    return first, float(off[first])


def along(p: Passage, wanted: Location, most: int = MOST_READINGS) -> MovementReadings | None:
    """Locations that a movement passed, outwards from the requested one; None: strained all along.

    Where the location was missed by more than a tolerance, all else that was passed still counts.
    """
    first, distance = nearest(p, wanted)
    if not np.isfinite(distance):
        return None
    x = np.stack([p.angle_rad / NEAR_RAD, p.rate_rad_s / NEAR_rad_s], axis=1)
    half = max(1, round(0.02 / float(p.time_s[1] - p.time_s[0])))
    taken = [first]
    others = np.arange(half, len(x) - half, half)
    for k in others[np.argsort(np.abs(others - first), kind="stable")]:
        if len(taken) == most:
            break
        if not p.strained[k] and np.min(np.hypot(*(x[taken] - x[k]).T)) >= 1:
            taken.append(int(k))
    found = [_reading(p, k, half) for k in taken]
    t = p.time_s[taken]
    common = p.error_Nm**2 * np.exp(-np.abs(t[:, None] - t) / ERROR_STAYS_S)
    return MovementReadings(
        tuple(where for where, _, _ in found),
        np.array([response for _, response, _ in found]),
        common + np.diag([spread**2 for _, _, spread in found]),
        distance,
    )


def _reading(p: Passage, k: int, half: int) -> tuple[Location, float, float]:
    # Mean of a short stretch around a sample, and its standard error.
    around = slice(max(0, k - half), k + half + 1)
    y = p.response_Nm[around]
    where = Location(float(np.mean(p.angle_rad[around])), float(np.mean(p.rate_rad_s[around])))
    line = np.polyval(np.polyfit(np.arange(len(y)), y, 1), np.arange(len(y)))
    return where, float(np.mean(y)), float(np.std(y - line) / np.sqrt(effective_samples(y - line)))
