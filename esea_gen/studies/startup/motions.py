"""Commands of the procedures: what is asked of the motor, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.language.ports import Array
from esea_gen.studies.startup.watch import Seen, StoppedError
from esea_gen.studies.torque_check.procedure import static_torque_Nm

Command = Callable[[Seen], "float | None"]

# Of the loop that steers: slow enough for three times the usual lag and 10 ms of delay.
STEER_1_S, STEER_DAMPING = 6.0, 0.8
MOST_OFF_RAD = 0.25  # from the path, before a procedure gives up
REST_S = 0.3


@dataclass(frozen=True)
class GearPath:
    """Where the gear is to be, from the start of a procedure on; one row a tick."""

    theta_rad: Array
    omega_rad_s: Array
    alpha_rad_s2: Array

    @classmethod
    def through(
        cls, legs: Sequence[tuple[float, float]], tick_s: float, accel_rad_s2: float = 4.0
    ) -> GearPath:
        """From 0 through ends: each leg an end and the speed on the way, with a rest behind it.

        legs: (end relative to the start in rad, speed in rad/s).
        """
        rates: list[Array] = []
        at = 0.0
        for end, speed in legs:
            span = end - at
            ramp = min(speed / accel_rad_s2, math.sqrt(abs(span) / accel_rad_s2))
            ramp = max(round(ramp / tick_s), 1) * tick_s
            cruise = max(round((abs(span) / speed - ramp) / tick_s), 0) * tick_s
            top = span / (ramp + cruise)
            n, m = round(ramp / tick_s), round(cruise / tick_s)
            up = top * np.arange(1, n + 1) / n
            rates += [up, np.full(m, top), top - up, np.zeros(round(REST_S / tick_s))]
            at = end
        omega = np.concatenate(rates)
        theta = np.cumsum(omega) * tick_s
        return cls(theta, omega, np.gradient(omega, tick_s))

    def __len__(self) -> int:
        return len(self.theta_rad)


class Steering:
    """Keeps the gear on a path, by the device file's own numbers.

    sign: 1, or -1 where the motor was found to turn the other way.
    coupling: whether the rubber's torque is to be overcome: with the output clamped.
    added_Nm: on top of it, a row a tick.
    """

    def __init__(
        self,
        device: DeviceData,
        path: GearPath,
        *,
        coupling: bool = False,
        added_Nm: Array | None = None,
    ) -> None:
        a = device.file.actuator
        assert a is not None
        # Lists: a number is taken out of an array far more slowly, and once a tick.
        self.path = path
        columns = path.theta_rad, path.omega_rad_s, path.alpha_rad_s2
        self.rows: list[tuple[float, float, float]] = list(
            zip(*(c.tolist() for c in columns), strict=True)
        )
        self.added: list[float] | None = None if added_Nm is None else added_Nm.tolist()
        self.n, self.j = a.gear_ratio.value, a.J_kgm2.value
        self.fv, self.fc = a.fv_Nms_rad.value, a.fc_Nm.value
        self.device, self.coupling = device, coupling
        self.k = 0
        self.start = 0.0

    def __call__(self, seen: Seen) -> float | None:
        k = self.k
        if k >= len(self.rows):
            return None
        if k == 0:
            self.start = seen.gear_rad
        theta, omega, alpha = self.rows[k]
        off = theta - (seen.gear_rad - self.start)
        if abs(off) > MOST_OFF_RAD:
            raise StoppedError(
                f"the drive is {off:+.3f} rad away from its path, more than {MOST_OFF_RAD:g} rad, "
                f"{seen.time_s:.3f} s after the start",
                "Look for what holds it; compare the device file's inertia and friction with the "
                "drive's size.",
            )
        wanted = self.j * (
            alpha + 2 * STEER_DAMPING * STEER_1_S * (omega - seen.omega_rad_s) + STEER_1_S**2 * off
        )
        wanted += self.fv * omega + (math.copysign(self.fc, omega) if omega else 0.0)
        if self.coupling:
            wanted += math.copysign(static_torque_Nm(self.device, 0.9 * abs(theta)), theta)
        self.k = k + 1
        return wanted / self.n + (self.added[k] if self.added is not None else 0.0)


class Feel:
    """A torque that rises until the gear has moved, held, and taken away; then the other way.

    It steers by nothing, so it is safe whichever way motor and encoders count.
    """

    def __init__(self, most_Nm: float, rate_Nm_s: float, moved_rad: float, tick_s: float) -> None:
        self.most, self.step, self.moved = most_Nm, rate_Nm_s * tick_s, moved_rad
        self.hold = round(0.2 / tick_s)
        self.tick_s = tick_s
        self.sign, self.phase, self.left = 1.0, "up", 0
        self.u = self.start = 0.0
        self.reached: list[float] = []

    def __call__(self, seen: Seen) -> float | None:
        if self.phase == "up":
            if self.u == 0.0:
                self.start = seen.gear_rad
            self.u += self.step
            if abs(seen.gear_rad - self.start) >= self.moved:
                self.phase, self.left = "hold", self.hold
                self.reached.append(self.u)
            elif self.u >= self.most:
                raise StoppedError(
                    f"at a command of {self.sign * self.u:+.3f} Nm the motor's encoder has moved "
                    f"by {seen.gear_rad - self.start:+.5f} rad at the joint, less than "
                    f"{self.moved:g} rad",
                    "Check that the drive is enabled, its phases are connected and its encoder is "
                    "read, and that no brake holds the shaft.",
                )
        elif self.phase == "hold":
            self.left -= 1
            if self.left <= 0:
                self.phase = "down"
        elif self.phase == "down":
            self.u = max(self.u - self.step, 0.0)
            if self.u == 0.0:
                self.phase, self.left = "rest", 2 * self.hold
        else:
            self.left -= 1
            if self.left <= 0:
                if self.sign < 0:
                    return None
                self.sign, self.phase = -1.0, "up"
        return self.sign * self.u


def switching(
    ticks: int, shortest: int, longest: int, size_Nm: float, seed: int, pause: int = 0
) -> Array:
    """A torque that jumps between plus and minus (and 0, with a pause) at drawn moments."""
    rng = np.random.default_rng([seed, 7])
    out = np.zeros(ticks)
    at, sign = 0, 1.0
    while at < ticks:
        held = int(rng.integers(shortest, longest + 1))
        out[at : at + held] = sign * size_Nm
        at += held + (pause and int(rng.integers(pause, 2 * pause + 1)))
        sign = -sign
    return out


__all__ = ["Command", "Feel", "GearPath", "Steering", "switching"]
