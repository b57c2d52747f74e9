"""How far the torque loop is from swinging, with the gains that ship and the drive that was found.

The loop is the one that the law's own check of its gains uses
(:mod:`esea_gen.control.linear_loop`): sliding mode inside its layer, moving, output fixed, with
filter, observer, sampling, hold and release.  Here the drive is not the one that the controller
believes in: its gain, inertia, friction and lag are those found, and the torque comes as late as
was measured.  The loop is cut where the command becomes the motor's torque, behind all that the
observer knows of it: a motor that gives more than was commanded, or later, is just what no observer
sees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from esea_gen.analysis.frequency import FrequencyResponse, Margins
from esea_gen.control.linear_loop import (
    LAMBDA_LOW_1_S,
    LOOP_STATES,
    LoopPeriod,
    sliding_mode_numbers,
)
from esea_gen.control.sliding_mode import LEAD
from esea_gen.device import Device
from esea_gen.identify.regression import Estimate
from esea_gen.language.ports import Array
from esea_gen.model.rubber import stiffness_range_Nm_rad
from esea_gen.studies.startup.drive_model import DriveModel

LOW_HZ, LINES = 0.1, 500
STABLE = 1.0
NOTABLE_DELAY_S = 5e-4


@dataclass(frozen=True)
class LoopDrive:
    """A drive in the loop, at the joint.

    gain: motor's torque over its command.
    stiffness_Nm_rad: of the coupling, here.
    """

    gain: float
    J_kgm2: float
    fv_Nms_rad: float
    tau_c_s: float
    delay_s: float
    stiffness_Nm_rad: float


@dataclass(frozen=True)
class MarginLimit:
    """The least that a margin may be; ``key`` of :class:`~esea_gen.analysis.frequency.Margins`."""

    name: str
    key: str
    unit: str
    least: float
    reason: str


LIMITS = (
    MarginLimit(
        "gain margin", "gain_margin_dB", "dB", 2.0,
        "a torque constant or a rubber that is off by 20 % takes 1.6 dB",
    ),
    MarginLimit(
        "phase margin", "phase_margin_deg", "deg", 10.0,
        "below, a swing takes a second and more to die away",
    ),
    MarginLimit(
        "delay margin", "delay_margin_s", "s", 0.005,
        "a run of the control task that is missed takes 5 ms at 200 Hz",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class LoopMargins:
    """Margins of one drive.

    opened: the cut loop.
    radius: largest eigenvalue's magnitude of the closed loop, over one control period.
    """

    drive: LoopDrive
    opened: FrequencyResponse
    margins: Margins
    radius: float

    @property
    def stable(self) -> bool:
        """Whether the loop dies away."""
        return self.radius < STABLE


class CutLoop(LoopPeriod):
    """One control period of the loop on another drive than the controller's, cut at the motor."""

    def __init__(
        self,
        device: Device,
        drive: LoopDrive,
        lambda_1_s: float | None = None,
        lead: float = LEAD,
    ) -> None:
        from scipy.linalg import expm

        slope = sliding_mode_numbers(device).lambda_1_s.value if lambda_1_s is None else lambda_1_s
        super().__init__(device, lead, slope, drive.stiffness_Nm_rad)
        j, d, h = drive.J_kgm2, drive, self.h
        a = np.zeros((4, 4))
        a[0, 1] = 1.0
        a[1, :3] = -d.stiffness_Nm_rad / j, -d.fv_Nms_rad / j, self.n / j
        a[2, 2:] = -1 / d.tau_c_s, d.gain / d.tau_c_s
        late = max(d.delay_s, 0.0)
        self.ticks = math.floor(late / h + 1e-9)
        part = max(late - self.ticks * h, 0.0)
        whole, rest = expm(a * h), expm(a * (h - part))
        self.moved = whole[:3, :3]
        # Within a tick the torque of the tick before still acts for its last part.
        self.newer = rest[:3, 3]
        self.older = whole[:3, 3] - rest[:3, 3]
        self.line = tuple(f"line_{i}" for i in range(self.ticks + 2))
        self.names = (*LOOP_STATES, *self.line)

    def over(self, state: Array, fed: float | None) -> tuple[Array, float]:
        """State after a control period, and the command released in it.

        fed: what the motor is given in its place; None closes the loop.
        """
        x = dict(zip(self.names, state.tolist(), strict=True))
        fa, fb, fc, fd = self.filter
        command = 0.0
        for tick in range(self.every):
            if tick == 0:
                self._control(x)
            shifted = [x[k] for k in self.line]
            x |= dict(zip(self.line[1:], shifted, strict=False))
            if tick == self.release % self.every:
                command = x["u_now"] = x["u_pending"]
                x[self.line[0]] = command if fed is None else fed
            z = np.array([x["z0"], x["z1"], x["z2"], x["z3"]])
            difference = (x["theta"] - x["theta_last"]) / self.h
            rate = float((fc @ z)[0] + fd[0, 0] * difference)
            x |= dict(zip(("z0", "z1", "z2", "z3"), fa @ z + fb[:, 0] * difference, strict=True))
            self._observe(x, rate)
            x["theta_last"] = x["theta"]
            now = np.array([x["theta"], x["omega"], x["u_a"]])
            now = self.moved @ now + self.newer * x[self.line[self.ticks]]
            now = now + self.older * x[self.line[self.ticks + 1]]
            x |= dict(zip(("theta", "omega", "u_a"), now, strict=True))
        return np.array([x[k] for k in self.names]), command

    def judged(self) -> tuple[FrequencyResponse, float]:
        """The cut loop's response, and the closed loop's largest eigenvalue."""
        unit = np.eye(len(self.names))
        alone = [self.over(x, 0.0) for x in unit]
        a = np.stack([x for x, _ in alone], axis=1)
        c = np.array([u for _, u in alone])
        b = self.over(np.zeros(len(unit)), 1.0)[0]
        closed = np.stack([self.over(x, None)[0] for x in unit], axis=1)
        f = np.geomspace(LOW_HZ, 0.499 / self.control_s, LINES)
        z = np.exp(2j * np.pi * f * self.control_s)
        inner = np.linalg.solve(z[:, None, None] * unit - a, b.astype(complex)[None, :, None])
        response = -(inner[:, :, 0] @ c)
        opened = FrequencyResponse(f, response, None, None, "cut at the motor")
        return opened, float(np.max(np.abs(np.linalg.eigvals(closed))))


def loop_margins(device: Device, drive: LoopDrive, lambda_1_s: float | None = None) -> LoopMargins:
    """Margins of a device's gains on a drive; ``lambda_1_s`` in place of its own."""
    opened, radius = CutLoop(device, drive, lambda_1_s).judged()
    return LoopMargins(drive, opened, opened.margins(), radius)


def enough(found: LoopMargins) -> bool:
    """Whether a loop dies away with every margin."""
    return found.stable and all(_size(getattr(found.margins, x.key)) >= x.least for x in LIMITS)


def slope_with_margins(device: Device, drive: LoopDrive) -> float | None:
    """Largest lambda (1/s) below the device's own that has every margin; None where none has."""
    low, high = LAMBDA_LOW_1_S, sliding_mode_numbers(device).lambda_1_s.value
    if high <= low or not enough(loop_margins(device, drive, low)):
        return None
    for _ in range(8):
        middle = math.sqrt(low * high)
        fits = enough(loop_margins(device, drive, middle))
        low, high = (middle, high) if fits else (low, middle)
    return low


def _corners(model: DriveModel, softest: float, hardest: float) -> Iterator[LoopDrive]:
    def ends(e: Estimate) -> tuple[float, float]:
        return e.low, e.high

    fv = max(model.fv_Nms_rad.low, 0.0)  # less friction damps less
    # The loop's gain is that of motor over inertia: both ends of it.
    pairs = (model.gain.low, model.J_kgm2.high), (model.gain.high, model.J_kgm2.low)
    for (g, j), lag, delay, k in product(
        pairs,
        ends(model.tau_c_s),
        ends(model.delay_s),
        (softest, hardest),
    ):
        yield LoopDrive(g, j, fv, lag, max(delay, 0.0), k)


@dataclass(frozen=True)
class MarginCheck:
    """The shipped gains on what was found.

    middle: of the estimates themselves, the coupling at its softest.
    nearest: the corner that is nearest to swinging.
    worst: least of each margin over the corners of the intervals and the coupling's stiffness;
        the radius is the largest.
    corners: how many were looked at.
    slope_1_s: lambda that would do in the nearest corner; None where none does, or this one does.
    """

    middle: LoopMargins
    nearest: LoopMargins
    worst: Mapping[str, float]
    radius: float
    corners: int
    asked_1_s: float
    slope_1_s: float | None

    def fix(self) -> str:
        """What to do about the problems."""
        late = self.middle.drive.delay_s
        out = ""
        if self.slope_1_s is not None:
            out = (
                f"Lower sliding_mode.lambda_1_s from {self.asked_1_s:g} to "
                f"{0.99 * self.slope_1_s:.3g} 1/s and build again; esea-gen tune shows what that "
                "costs."
            )
        if late > NOTABLE_DELAY_S:
            out += f"  Better: shorten the {1e3 * late:.2g} ms between command and motor."
        return out.strip() or "No slope from 1 1/s on has them: a drive with less lag is needed."

    def problems(self) -> list[str]:
        """What is below its limit."""
        if self.radius >= STABLE:
            return [
                "the loop swings up in the worst corner: its largest eigenvalue over a control "
                f"period is {self.radius:.5f}"
            ]
        return [
            f"{x.name} {self.worst[x.key]:.3g} {x.unit} in the worst corner, below {x.least:g} "
            f"{x.unit} ({x.reason})"
            for x in LIMITS
            if not self.worst[x.key] >= x.least
        ]

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "allowed": not self.problems(),
            "problems": self.problems(),
            "limits": [asdict(x) for x in LIMITS],
            "worst": _plain(dict(self.worst)),
            "worst_radius": self.radius,
            "corners": self.corners,
            "lambda_1_s": self.asked_1_s,
            "lambda_with_margins_1_s": self.slope_1_s,
            "at_the_estimates": _plain(asdict(self.middle.margins)),
            "drive": asdict(self.middle.drive),
        }


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()
    }


def check_margins(device: Device, model: DriveModel) -> MarginCheck:
    """Margins of a device's gains on the drive that was found, worst corner of its intervals."""
    soft, stiff = stiffness_range_Nm_rad(device)
    found = [loop_margins(device, d) for d in _corners(model, soft, stiff)]
    at = (model.gain, model.J_kgm2, model.fv_Nms_rad, model.tau_c_s, model.delay_s)
    g, j, fv, lag, delay = (e.value for e in at)
    middle = loop_margins(device, LoopDrive(g, j, fv, lag, max(delay, 0.0), soft))
    worst = {x.key: min(_size(getattr(m.margins, x.key)) for m in [*found, middle]) for x in LIMITS}
    radius = max(m.radius for m in [*found, middle])
    nearest = min(found, key=lambda m: (m.stable, m.margins.modulus_margin))
    short = not all(enough(m) for m in found)
    slope = slope_with_margins(device, nearest.drive) if short else None
    asked = sliding_mode_numbers(device).lambda_1_s.value
    return MarginCheck(middle, nearest, worst, radius, len(found), asked, slope)


def _size(margin: float | None) -> float:
    # None: the gain or the phase crosses nowhere, so nothing is near.
    return math.inf if margin is None else abs(margin)


__all__ = [
    "LIMITS",
    "CutLoop",
    "LoopDrive",
    "LoopMargins",
    "MarginCheck",
    "check_margins",
    "enough",
    "loop_margins",
    "slope_with_margins",
    "stiffness_range_Nm_rad",
]
