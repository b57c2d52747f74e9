"""What stands between a procedure and the motor: limits, reasons to stop, and the recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from esea_gen.devices.fields import EncoderSide
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.studies.startup.machine import Machine, Output

# Shares of the device's own limits: a start-up has no reason to come near to them.
COMMAND_SHARE, DEFLECTION_SHARE, SPEED_SHARE = 0.8, 0.8, 0.5
SETUP_RAD = 0.35  # as far as people set a joint up by eye
RATE_TICKS = 5  # over which the rate that the procedures steer by is taken


class StoppedError(Exception):
    """A procedure ended itself; the command is 0.

    reason: what was seen, against its limit.
    fix: what the person at the machine can do.
    """

    def __init__(self, reason: str, fix: str) -> None:
        super().__init__(reason)
        self.reason, self.fix = reason, fix


@dataclass(frozen=True)
class Envelope:
    """Within what a procedure may move a device.

    low_rad, high_rad: of the joint.
    """

    u_Nm: float
    u_rate_Nm_s: float
    deflection_rad: float
    omega_rad_s: float
    low_rad: float
    high_rad: float

    @classmethod
    def of(cls, device: DeviceData) -> Envelope:
        """From the device file's limits."""
        a, s, j = device.file.actuator, device.file.safety, device.file.joint
        assert a is not None
        assert s is not None
        assert j is not None
        margin = 0.5 * s.rom_margin_rad.value
        return cls(
            COMMAND_SHARE * min(a.u_max_Nm.value, s.u_max_Nm.value),
            s.u_rate_Nm_s.value,
            DEFLECTION_SHARE * s.theta_max_rad.value,
            SPEED_SHARE * s.omega_max_rad_s.value,
            max(s.rom_min_rad.value - margin, j.theta_min_rad.value),
            min(s.rom_max_rad.value + margin, j.theta_max_rad.value),
        )


class Seen(NamedTuple):
    """One tick, in angles: what a procedure steers by.

    gear_rad, omega_rad_s: by what the drive has turned the joint, and its rate.
    """

    time_s: float
    gear_rad: float
    omega_rad_s: float
    motor_rad: float
    load_rad: float


@dataclass(frozen=True)
class DriveRecording:
    """What one procedure recorded, a row a tick; ``u_Nm[k]`` is held from tick k to k + 1.

    gear_rad: at the joint, whole turns of the shaft found by the joint's encoder.
    """

    tick_s: float
    u_Nm: Array
    gear_rad: Array
    motor_rad: Array
    load_rad: Array

    def __len__(self) -> int:
        return len(self.u_Nm)


class _Side:
    """Counts of a joint encoder to an angle, as the front end does it."""

    def __init__(self, device: DeviceData, name: str) -> None:
        j = device.file.joint
        assert j is not None
        own: EncoderSide = getattr(device.file.encoder, name) or EncoderSide()
        if own.zero_rad is None:
            raise UserError(
                f"{device.origin}: encoder.{name}.zero_rad is missing: the {name} side's encoder "
                "has no zero, and a start-up needs to know where the joint stands.",
                "Calibrate it first and write the zero into the device file.",
            )
        bits = round(device.file.encoder.resolution_bits.value)
        self.full = 1 << bits
        self.rad = 2 * math.pi / self.full
        self.sign = -1.0 if own.direction is not None and own.direction.value < 0 else 1.0
        self.zero = own.zero_rad.value
        self.middle = 0.5 * (j.theta_min_rad.value + j.theta_max_rad.value)
        self.table = own.correction_rad.values if own.correction_rad else ()

    def angle(self, count: int) -> float:
        raw = count * self.rad
        if self.table:
            place = count / self.full * len(self.table)
            i = int(place)
            a, b = self.table[i], self.table[(i + 1) % len(self.table)]
            raw += a + (b - a) * (place - i)
        theta = self.sign * raw - self.zero - self.middle
        turn = 2 * math.pi
        return theta - turn * math.floor(theta / turn + 0.5) + self.middle


class WatchedMachine:
    """A machine with limits before its motor and a recording of what went through.

    total_s: how long the machine has been driven by now.
    """

    def __init__(self, machine: Machine, device: DeviceData) -> None:
        a = device.file.actuator
        assert a is not None
        self.machine, self.envelope = machine, Envelope.of(device)
        self.tick_s = machine.tick_s
        self._sides = _Side(device, "motor"), _Side(device, "load")
        self._full = 1 << round(a.encoder_bits.value)
        self._turn_rad = 2 * math.pi / a.gear_ratio.value
        self._gear_rad = self._turn_rad / self._full
        self._offset: float | None = None
        self.total_s = 0.0

    def run(
        self, output: Output, at_rad: float, command: Callable[[Seen], float | None]
    ) -> DriveRecording:
        """Drive until the command is None; the motor is left without torque, whatever happens.

        command: motor torque from what was seen, once a tick.
        """
        counts = self.machine.begin(output, at_rad)
        motor_rad, load_rad = self._sides[0].angle, self._sides[1].angle
        motor, load = motor_rad(counts.motor), load_rad(counts.load)
        self._check_setup(at_rad, motor, load)
        last, gear = counts.gear, self._start(counts.gear, motor)
        behind = [gear] * RATE_TICKS
        u, tick = 0.0, 0
        limit, most = self.envelope.u_Nm, self.envelope.u_rate_Nm_s * self.tick_s
        columns: list[tuple[float, float, float, float]] = []
        try:
            while True:
                rate = (gear - behind[tick % RATE_TICKS]) / (RATE_TICKS * self.tick_s)
                behind[tick % RATE_TICKS] = gear
                self._check(rate, motor, load, tick)
                wanted = command(Seen(tick * self.tick_s, gear, rate, motor, load))
                if wanted is None:
                    break
                u += min(max(min(max(wanted, -limit), limit) - u, -most), most)
                columns.append((u, gear, motor, load))
                counts = self.machine.step(tick, u)
                tick += 1
                moved = counts.gear - last
                moved -= self._full * math.floor(moved / self._full + 0.5)
                last, gear = counts.gear, gear + moved * self._gear_rad
                motor, load = motor_rad(counts.motor), load_rad(counts.load)
        finally:
            self.machine.step(tick, 0.0)
            self.total_s += tick * self.tick_s
        return DriveRecording(self.tick_s, *np.array(columns).T)

    def _start(self, count: int, motor_rad: float) -> float:
        # Which of its turns the shaft is in, the joint's encoder tells; where its zero is, the
        # first time.
        part = count * self._gear_rad
        if self._offset is None:
            turns = math.floor((motor_rad - part) / self._turn_rad + 0.5)
            self._offset = motor_rad - part - turns * self._turn_rad
            return part + turns * self._turn_rad
        aim = motor_rad - self._offset
        return part + self._turn_rad * math.floor((aim - part) / self._turn_rad + 0.5)

    def _check_setup(self, at_rad: float, motor: float, load: float) -> None:
        # Before any torque: the joint stands where it was set up, and both encoders say so.
        for side, angle in (("motor", motor), ("load", load)):
            if abs(angle - at_rad) <= SETUP_RAD:
                continue
            mirrored = abs(angle + at_rad) <= SETUP_RAD < abs(at_rad)
            raise StoppedError(
                f"the {side}-side encoder says {angle:+.3f} rad where the joint is to be set up at "
                f"{at_rad:+.3f} rad, more than {SETUP_RAD:g} rad off",
                f"It counts the other way: set encoder.{side}.direction to its opposite and "
                "calibrate its zero again."
                if mirrored
                else "Set the joint up where the procedure says; if it is, calibrate the encoder's "
                "zero.",
            )

    def _check(self, rate: float, motor: float, load: float, tick: int) -> None:
        e = self.envelope
        if abs(motor - load) > e.deflection_rad:
            raise StoppedError(
                f"the coupling is deflected by {motor - load:+.3f} rad, more than "
                f"{e.deflection_rad:g} rad, {self._at(tick)}",
                "Look for what holds the output or pulls at it, and whether both joint encoders "
                "are zeroed.",
            )
        if abs(rate) > e.omega_rad_s:
            raise StoppedError(
                f"the drive turns at {rate:+.2f} rad/s, faster than {e.omega_rad_s:g} rad/s, "
                f"{self._at(tick)}",
                "Check that gear_ratio, encoder_bits and the motor's torque constant are right.",
            )
        if not (e.low_rad <= load <= e.high_rad and e.low_rad <= motor <= e.high_rad):
            raise StoppedError(
                f"the joint is at {load:.3f} rad (motor side {motor:.3f} rad), outside of "
                f"{e.low_rad:g} to {e.high_rad:g} rad, {self._at(tick)}",
                "Look for what moves the joint, or a slipping cable.",
            )

    def _at(self, tick: int) -> str:
        return f"{tick * self.tick_s:.3f} s after the start"
