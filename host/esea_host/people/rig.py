"""Limbs in a device of elastomeric couplings, which the firmware's application senses.  Simulated.

On one side of a coupling is a limb with the handle that it holds, on the other what the device has
there: a motor, or nothing that moves.  Each millisecond the application on the board ``sim`` reads
the encoders, in whole counts, and runs whole: schedule, latches, tasks, main loop.  What is known
of torque and angle is what it makes of that.  The coupling itself has the torque of the device's
model at its true deflection.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache

from esea_gen.board.sim import SimBoard
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.language.system import System, Task
from esea_host.people.person import Limb

STEPS = 10  # of 1 ms in a frame of 10 ms
RUNS = ("READY", "UNREFERENCED", "ARMED", "ACTIVE", "LETTING_GO", "STOPPED")


@lru_cache(maxsize=8)
def _law(device: Device) -> HostLibrary:
    inputs = {"theta_rad": ("sensor.theta_rad",), "omega_rad_s": ("sensor.omega_rad_s",)}
    blocks, task = {"sensor": device.sensor}, Task("bend", ("sensor",))
    outputs = {"tau_Nm": "sensor.tau_Nm"}
    name, period = f"{device.name}_law", device.period_s
    return compile_system(System(name, period, blocks, (task,), {}, inputs, outputs), "f64")


class CoupledLimb:
    """A limb that holds a handle on one side of a coupling; angles from the device's zero."""

    def __init__(self, device: Device, limb: Limb, handle_kgm2: float) -> None:
        library = self._library = _law(device)
        prefix, ffi = library.prefix, library.ffi
        self._bend = library.function(f"{prefix}_bend_step")
        self._state = ffi.new(f"{prefix}_state_t *")
        library.function(f"{prefix}_init")(self._state)
        self._in, self._out = ffi.new(f"{prefix}_bend_in_t *"), ffi.new(f"{prefix}_bend_out_t *")
        self._h, self._limb = device.period_s, limb
        self._inertia_kgm2 = limb.inertia_kgm2 + handle_kgm2
        self.theta_rad = self.omega_rad_s = self.tau_Nm = 0.0
        self.deflection_rad = self.deflection_rad_s = 0.0

    def step(self, muscle: Sequence[float], share: float, other_rad_s: float) -> None:
        h, given, theta, omega = self._h, self._in, self.theta_rad, self.omega_rad_s
        given.theta_rad, given.omega_rad_s = self.deflection_rad, self.deflection_rad_s
        self._bend(self._state, given, self._out)
        self.tau_Nm = tau = self._out.tau_Nm
        hand = self._limb.torque_Nm(theta, omega, muscle, share, STEPS * h)
        self.omega_rad_s = omega = omega + h * (hand + tau) / self._inertia_kgm2
        self.theta_rad = theta + h * omega
        self.deflection_rad_s = rate = other_rad_s - omega
        self.deflection_rad += h * rate


def compile_rig(device: Device) -> None:
    """Once, before the processes start."""
    _law(device)
    SimBoard(device).close()


class SensedRig(ABC):
    """A device with a limb on every axis, and its board."""

    def __init__(self, device: Device, limbs: Sequence[Limb], handle_kgm2: float) -> None:
        self.device, self._limbs, self._handle_kgm2 = device, tuple(limbs), handle_kgm2
        self.board = SimBoard(device)
        self._still = (0.0,) * len(self._limbs)
        self._count_rad = 2 * math.pi / 2**device.file.encoder.resolution_bits.value
        self.start()

    def start(self) -> None:
        """From rest at zero, the board just powered on."""
        self.axes = tuple(CoupledLimb(self.device, x, self._handle_kgm2) for x in self._limbs)
        self.board.restart()

    def counted(self, angle_rad: float) -> float:
        return round(angle_rad / self._count_rad) * self._count_rad

    @abstractmethod
    def show(self) -> None:
        """Give the drivers of the board what there is to read."""

    def turning_rad_s(self) -> Sequence[float]:
        """How fast the other side of each coupling turns; without a motor it stands still."""
        return self._still

    def frame(self, muscles: Sequence[Sequence[float]], signal: str = "") -> list[float]:
        """A frame; a signal of the board at each of its milliseconds, where one is asked for."""
        board, read = self.board, []
        place = board.places[signal] if signal else None
        for k in range(STEPS):
            for axis, muscle, rate in zip(self.axes, muscles, self.turning_rad_s(), strict=True):
                axis.step(muscle, (k + 1) / STEPS, rate)
            self.show()
            board.step()
            if place is not None:
                read.append(board.values[place])
        if board.state_now not in RUNS:
            raise UserError(
                f"The simulated board of {self.device.name} is {board.state_now}.",
                "Nothing that it says of angle and torque is true now; begin the session again.",
            )
        return read
