"""Loading curves of a compliant element: branches, stiffness with interval, hysteresis."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d
from scipy.signal import find_peaks
from scipy.stats import t as student

from esea_gen.errors import UserError

Array = npt.NDArray[np.float64]

# An extreme rises above what lies round it by this share of the range: no tremor of a hand does.
PROMINENCE = 0.25
LEAST_LOSS = -0.02  # noise of an ideal spring; below it the record breaks a law of physics


@dataclass(frozen=True)
class LoadingProtocol:
    """How the published curves were driven: 10 deg, 0.01 Hz, three cycles."""

    amplitude_rad: float = float(np.deg2rad(10.0))
    frequency_Hz: float = 0.01
    cycles: int = 3

    def motion(self, fs_Hz: float) -> tuple[Array, Array, Array]:
        """Times, angle and rate half a step earlier, as the sensor of a device takes them."""
        if not (self.amplitude_rad > 0 and self.frequency_Hz > 0 and self.cycles >= 1):
            raise UserError(f"{self} has no motion.", "Give more than 0.")
        if fs_Hz < 20 * self.frequency_Hz:
            raise UserError(
                f"{fs_Hz:g} Hz for a sine of {self.frequency_Hz:g} Hz.", "Give 20 a cycle or more."
            )
        w, step = 2 * np.pi * self.frequency_Hz, 1 / fs_Hz
        time = np.arange(round(self.cycles / self.frequency_Hz * fs_Hz) + 1) * step
        angle = np.asarray(self.amplitude_rad * np.sin(w * time))
        rate = np.asarray(self.amplitude_rad * w * np.cos(w * (time - step / 2)))
        return np.asarray(time), angle, rate


@dataclass(frozen=True)
class Branch:
    """Samples ``start`` to ``stop`` (not included): loading, from rest to an extreme."""

    start: int
    stop: int
    positive: bool
    first: bool  # from the start of the record, before the element was ever bent


@dataclass(frozen=True)
class LoadingCurve:
    """Stiffness and loss of an element from its loading curve.

    stiffness_Nm_rad: slope of one straight line through all loading branches, the published way;
    at_rest_Nm: that line at rest.  low, high: 95 % interval, the branches left out one by one.
    between_Nm_rad: the slope when either direction has an offset of its own.  area_J: mean work
    lost in a cycle; area_low_J, area_high_J: 95 % interval over the cycles, None with fewer than
    two.  loss_factor: area over pi times stiffness times amplitude squared.
    """

    branches: tuple[Branch, ...]
    stiffness_Nm_rad: float
    at_rest_Nm: float
    low_Nm_rad: float
    high_Nm_rad: float
    between_Nm_rad: float
    offset_Nm: float
    amplitude_rad: float
    areas_J: tuple[float, ...]
    area_low_J: float | None
    area_high_J: float | None
    loss_factor: float

    @property
    def stiffness_Nm_deg(self) -> float:
        """In the unit of the published values."""
        return self.stiffness_Nm_rad * np.pi / 180

    @property
    def area_J(self) -> float:
        return float(np.mean(self.areas_J))

    def line_Nm(self, theta_rad: ArrayLike) -> Array:
        return self.at_rest_Nm + self.stiffness_Nm_rad * np.asarray(theta_rad, dtype=np.float64)

    def to_dict(self) -> dict[str, Any]:
        return vars(self) | {"stiffness_Nm_deg": self.stiffness_Nm_deg, "area_J": self.area_J}

    def lines(self) -> list[str]:
        k, low, high, between = (
            np.pi / 180 * v
            for v in (self.stiffness_Nm_rad, self.low_Nm_rad, self.high_Nm_rad, self.between_Nm_rad)
        )
        cycles = f"{len(self.areas_J)} cycle{'s' if len(self.areas_J) > 1 else ''}"
        least_J, most_J = self.area_low_J, self.area_high_J
        spread = "" if least_J is None else f" ({_mJ(least_J)} to {_mJ(most_J or 0)})"
        return [
            f"loading stiffness   {k:.4f} Nm/deg, 95 % {low:.4f} to {high:.4f}, "
            f"{len(self.branches)} branches",
            f"  with an offset for each direction {between:.4f} Nm/deg",
            f"hysteresis          {_mJ(self.area_J)} mJ a cycle{spread}, {cycles}, "
            f"loss factor {self.loss_factor:z.3f}",
        ]


def _mJ(work_J: float) -> str:
    # Below a nanojoule it is rounding.
    return f"{1e3 * work_J if abs(work_J) > 1e-9 else 0.0:.4g}"


def loading_branches(theta_rad: ArrayLike) -> tuple[Branch, ...]:
    """Loading branches of a record: from the last passage through rest to each extreme."""
    theta = _smoothed(_finite(theta_rad, "theta_rad"))
    extremes = _extremes(theta)
    found, last = [], 0
    for at in extremes:
        side = theta[at] > 0
        # Where it was on the other side for the last time; at the very start it was at rest.
        before = np.flatnonzero((theta[last:at] > 0) != side)
        start = last + int(before[-1]) + 1 if len(before) else last
        # Between two extremes of one side nothing was unloaded to rest.
        if last == 0 or len(before):
            found.append(Branch(start, int(at) + 1, bool(side), last == 0))
        last = int(at)
    return tuple(b for b in found if b.stop - b.start >= 5)


def _finite(values: ArrayLike, name: str) -> Array:
    found = np.asarray(values, dtype=np.float64)
    if found.ndim != 1 or len(found) < 20 or not np.isfinite(found).all():
        raise UserError(
            f"{name}: {found.shape} samples, {int(np.sum(~np.isfinite(found)))} of them missing.",
            "Give one column of at least 20 numbers, without gaps.",
        )
    return found


def _smoothed(theta: Array) -> Array:
    # Mean over a twentieth of a sweep: else a tremor near an extreme moves the end of its branch.
    extremes = _extremes(theta)
    sweep = np.median(np.diff(extremes))
    return np.asarray(uniform_filter1d(theta, max(1, int(sweep / 20)), mode="nearest"))


def _extremes(theta: Array) -> list[int]:
    reach = float(np.ptp(theta))
    if reach <= 0:
        raise UserError("The angle never changes.", "Record whole cycles of loading.")
    # The record's ends count as well where they are extremes: a level beyond on either side.
    padded = np.concatenate([[0.0], theta, [0.0]])
    up, _ = find_peaks(padded, prominence=PROMINENCE * reach, height=PROMINENCE * reach)
    down, _ = find_peaks(-padded, prominence=PROMINENCE * reach, height=PROMINENCE * reach)
    found = sorted(int(i) - 1 for i in (*up, *down))
    if len(found) < 2:
        raise UserError(
            f"{len(found)} extremes on either side of rest.",
            "Record at least one whole cycle; --rest sets the angle at rest.",
        )
    return found


def analyse_loading(
    theta_rad: ArrayLike, tau_Nm: ArrayLike, *, rest_rad: float = 0.0, skip_first: bool = False
) -> LoadingCurve:
    """Loading stiffness and hysteresis of a torque-displacement record; skip_first: see Branch."""
    theta = _finite(theta_rad, "theta_rad") - rest_rad
    tau = _finite(tau_Nm, "tau_Nm")
    if np.max(np.abs(theta)) > np.pi:
        raise UserError(
            f"theta_rad: {np.max(np.abs(theta)):.3g} rad from rest.",
            "Give radians, at most half a turn, and the angle at rest.",
        )
    if theta.shape != tau.shape:
        raise UserError(f"{len(theta)} angles and {len(tau)} torques.", "Give one per angle.")
    branches = [b for b in loading_branches(theta) if not (skip_first and b.first)]
    if len({b.positive for b in branches}) < 2 or len(branches) < 3:
        raise UserError(
            f"{len(branches)} loading branches.", "Record at least 3, on both sides of rest."
        )
    pieces = [(theta[b.start : b.stop], tau[b.start : b.stop]) for b in branches]
    whole, at_rest = _line(pieces)
    if not whole > 0:
        raise UserError(
            f"Loading stiffness {whole:.3g} Nm/rad: the torque does not rise with the angle.",
            "Check both columns and the torque's sign: positive where it holds the angle.",
        )
    # The samples of one branch hang together; the branches are what was repeated.
    n = len(pieces)
    left = np.array([_line(pieces[:i] + pieces[i + 1 :])[0] for i in range(n)])
    se = float(np.sqrt((n - 1) / n * np.sum((left - left.mean()) ** 2)))
    half = float(student.isf(0.025, n - 1)) * se
    between, offset = _slope_with_offsets(pieces)
    smooth = _smoothed(theta)
    extremes = _extremes(smooth)
    areas = _areas(theta, tau, extremes)
    low, high = _interval(areas)
    amplitude = float(np.mean(np.abs(smooth[extremes])))
    loss = float(np.mean(areas)) / (np.pi * whole * amplitude**2)
    if loss < LEAST_LOSS:
        raise UserError(
            f"Loss factor {loss:.3f}: less than {LEAST_LOSS:g}, the element would give energy.",
            "Check that the rows are in order of time, and that the torque does not lag.",
        )
    return LoadingCurve(
        tuple(branches),
        whole,
        at_rest,
        whole - half,
        whole + half,
        between,
        offset,
        amplitude,
        areas,
        low,
        high,
        loss,
    )


def _line(pieces: list[tuple[Array, Array]]) -> tuple[float, float]:
    x, y = (np.concatenate(v) for v in zip(*pieces, strict=True))
    slope, offset = np.polyfit(x, y, 1)
    return float(slope), float(offset)


def _slope_with_offsets(pieces: list[tuple[Array, Array]]) -> tuple[float, float]:
    x, y = (np.concatenate(v) for v in zip(*pieces, strict=True))
    side = np.concatenate([np.full(len(v), np.sign(v.mean())) for v, _ in pieces])
    columns = np.column_stack([x, np.ones(len(x)), side])
    slope, _, offset = np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(slope), float(offset)


def _areas(theta: Array, tau: Array, extremes: list[int]) -> tuple[float, ...]:
    tops = [i for i in extremes if theta[i] > 0]
    bottoms = [i for i in extremes if theta[i] <= 0]
    side = tops if len(tops) >= len(bottoms) else bottoms
    found = tuple(float(np.trapezoid(tau[a : b + 1], theta[a : b + 1])) for a, b in pairwise(side))
    if not found:
        raise UserError("No whole cycle from extreme to extreme.", "Record at least two cycles.")
    return found


def _interval(values: tuple[float, ...]) -> tuple[float | None, float | None]:
    n = len(values)
    if n < 2:
        return None, None
    half = float(student.isf(0.025, n - 1) * np.std(values, ddof=1) / np.sqrt(n))
    return float(np.mean(values)) - half, float(np.mean(values)) + half
