"""The virtual test rig: a wrist turns a handle against one compliant element.  Simulated.

The element's torque is that of the emitted torque sensor, 1000 times a second: its law is taken to
be the element's own.  The angle is read as the encoder has it, in whole counts.  The rig has no
motor, so the other end of the element stands still.  Mass of the handle is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.language.system import System, Task
from esea_host.interaction.elements import element_device
from esea_host.people.person import Limb

STEPS = 10  # of 1 ms in a frame of 10 ms
HANDLE_KGM2 = 0.001


@cache
def element_library(element: str) -> HostLibrary:
    """C of an element's torque sensor, compiled once a process."""
    device = element_device(element)
    inputs = {"theta_rad": ("sensor.theta_rad",), "omega_rad_s": ("sensor.omega_rad_s",)}
    task = Task("sense", ("sensor",))
    blocks = {"sensor": device.sensor}
    outputs = {"tau_Nm": "sensor.tau_Nm"}
    name = f"{device.name}_rig"
    return compile_system(
        System(name, device.period_s, blocks, (task,), {}, inputs, outputs), "f64"
    )


@cache
def counts_per_rad(element: str) -> float:
    """Of the rig's encoder."""
    bits = element_device(element).file.encoder.resolution_bits.value
    return float(2**bits / (2 * math.pi))


@cache
def law_ends(element: str) -> tuple[float, float]:
    """How far the element's law goes, rad, and its full scale, Nm."""
    device = element_device(element)
    return float(device.sensor.inputs[0].high), float(device.file.domain.tau_full_scale_Nm.value)


class ElementRig:
    """A wrist on the rig.

    Parameters
    ----------
    element : str
        What is built in: spring, elastomer or equal.
    limb : Limb
        The wrist in flexion and extension.
    """

    def __init__(self, element: str, limb: Limb) -> None:
        library = element_library(element)
        self._lib, self._limb = library, limb
        prefix, ffi = library.prefix, library.ffi
        self._step = library.function(f"{prefix}_sense_step")
        self._state = ffi.new(f"{prefix}_state_t *")
        library.function(f"{prefix}_init")(self._state)
        self._in, self._out = ffi.new(f"{prefix}_sense_in_t *"), ffi.new(f"{prefix}_sense_out_t *")
        self._h, self._counts = library.system.base_period_s, counts_per_rad(element)
        self._most_rad, _ = law_ends(element)
        self.element = element
        self.theta_rad = self.omega_rad_s = self.tau_Nm = 0.0

    @property
    def encoder_rad(self) -> float:
        """The angle as it is read: whole counts."""
        return round(self.theta_rad * self._counts) / self._counts

    def advance(self, muscle: Sequence[float]) -> list[float]:
        """A frame; what the encoder read at each of its milliseconds.

        Parameters
        ----------
        muscle : (stiffness, damping, aim at the start, aim at the end, largest torque)
            Nm/rad, Nms/rad, rad, rad, Nm.

        Raises
        ------
        UserError
            Where the element is bent further than its law goes.
        """
        h, given, out = self._h, self._in, self._out
        inertia, read = self._limb.inertia_kgm2 + HANDLE_KGM2, []
        theta, omega, tau = self.theta_rad, self.omega_rad_s, self.tau_Nm
        for k in range(STEPS):
            hand = self._limb.torque_Nm(theta, omega, muscle, (k + 1) / STEPS, STEPS * h)
            omega += h * (hand + tau) / inertia
            theta += h * omega
            # Motor side minus load side; the motor side stands still.
            given.theta_rad, given.omega_rad_s = -theta, -omega
            self._step(self._state, given, out)
            tau = out.tau_Nm
            self.theta_rad = theta
            read.append(self.encoder_rad)
        self.omega_rad_s, self.tau_Nm = omega, tau
        if abs(theta) > self._most_rad:
            raise UserError(
                f"The {self.element} is bent by {math.degrees(theta):.1f} deg, its law goes to "
                f"{math.degrees(self._most_rad):.1f} deg.",
                "Ask people for less motion.",
            )
        return read
