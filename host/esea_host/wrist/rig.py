"""The virtual wrist device: two axes, the controller's emitted C in the loop.  Simulated.

Each axis: a hand with the handle (inertia, passive wrist), an elastomeric coupling, and a motor
that turns the coupling's other side until the sensed torque is the wanted one.  The wanted torque
is that of the emitted impairment, the sensed one that of the emitted torque sensor, 1000 times a
second.  The coupling's own torque is the sensor's model too: a perfect sensor is assumed, and so
are the motor (its rate follows at once, up to its limit) and every number of the device.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import esea_gen
from esea_gen.control.impairment import impairment
from esea_gen.hostlib.library import HostLibrary, compile_system
from esea_gen.language.system import System, Task
from esea_host.people.person import Limb

NAMES = ("fe", "ru")
STEPS = 10  # of 1 ms in a frame of 10 ms
TORQUE_LOOP_1_S = 2 * math.pi * 15.0
MOTOR_RAD_S = 15.0
HANDLE_KGM2 = 0.006


def rig_system() -> System:
    """Sensor and impairment of both axes, as one task."""
    device = esea_gen.load_device("wrist")
    sensor, wall = device.sensor, impairment(device)
    blocks: dict[str, Any] = {}
    inputs: dict[str, tuple[str, ...]] = {}
    outputs: dict[str, str] = {}
    for axis in NAMES:
        blocks |= {f"sensor_{axis}": sensor, f"impairment_{axis}": wall}
        inputs[f"deflection_{axis}_rad"] = (f"sensor_{axis}.theta_rad",)
        inputs[f"deflection_{axis}_rad_s"] = (f"sensor_{axis}.omega_rad_s",)
        inputs[f"theta_{axis}_rad"] = (f"impairment_{axis}.theta_rad",)
        inputs[f"omega_{axis}_rad_s"] = (f"impairment_{axis}.omega_rad_s",)
        inputs[f"constrained_{axis}"] = (f"impairment_{axis}.constrained",)
        outputs[f"tau_{axis}_Nm"] = f"sensor_{axis}.tau_Nm"
        outputs[f"tau_set_{axis}_Nm"] = f"impairment_{axis}.tau_set_Nm"
        outputs[f"acts_{axis}"] = f"impairment_{axis}.acts"
    task = Task("sense", tuple(blocks))
    return System("wrist_rig", device.period_s, blocks, (task,), {}, inputs, outputs)


@cache
def rig_library() -> HostLibrary:
    """Its C, compiled once a process."""
    return compile_system(rig_system(), "f64")


@dataclass
class AxisState:
    """One axis; angles from the device's zero."""

    theta_rad: float = 0.0
    omega_rad_s: float = 0.0
    deflection_rad: float = 0.0
    deflection_rad_s: float = 0.0
    tau_Nm: float = 0.0
    tau_set_Nm: float = 0.0


class Rig:
    """The device with a wrist in it.

    Parameters
    ----------
    limbs : sequence of Limb
        FE and RU.
    """

    def __init__(self, limbs: Sequence[Limb]) -> None:
        library = rig_library()
        self._lib, self._limbs = library, tuple(limbs)
        prefix, ffi = library.prefix, library.ffi
        self._step = library.function(f"{prefix}_sense_step")
        params = ffi.new(f"{prefix}_params_t *")
        self._coeffs = ffi.new(f"{prefix}_coeffs_t *")
        self._state = ffi.new(f"{prefix}_state_t *")
        library.function(f"{prefix}_default_params")(params)
        # No wall in RU: resistance to speed alone.
        params.impairment_ru.Kp_Nm_rad = params.impairment_ru.Kd_Nms_rad = 0.0
        if library.function(f"{prefix}_prepare")(params, self._coeffs):
            raise AssertionError("the impairment refuses its tunables")
        library.function(f"{prefix}_init")(self._coeffs, self._state)
        self.most_Nm = float(params.impairment_fe.tau_max_Nm)
        self._in = ffi.new(f"{prefix}_sense_in_t *")
        self._out = ffi.new(f"{prefix}_sense_out_t *")
        self._h = library.system.base_period_s
        self.axes = (AxisState(), AxisState())
        # Small deflections: the loop's gain in rate per torque.
        sensor = library.system.blocks["sensor_fe"]
        k1 = next(c.value for c in sensor.constants if c.name.endswith("k1_Nm_rad"))
        self._gain = TORQUE_LOOP_1_S / k1

    def advance(self, muscle: Sequence[Sequence[float]], constrained: bool) -> None:
        """A frame.

        Parameters
        ----------
        muscle : sequence of (stiffness, damping, aim at the start, aim at the end)
            Per axis, Nm/rad, Nms/rad, rad, rad; then the largest torque, Nm.
        constrained : bool
            Whether the impairment is asked for.
        """
        given, out, h = self._in, self._out, self._h
        given.constrained_fe = given.constrained_ru = 1.0 if constrained else 0.0
        a, b = self.axes
        for k in range(STEPS):
            given.deflection_fe_rad, given.deflection_fe_rad_s = (
                a.deflection_rad,
                a.deflection_rad_s,
            )
            given.deflection_ru_rad, given.deflection_ru_rad_s = (
                b.deflection_rad,
                b.deflection_rad_s,
            )
            given.theta_fe_rad, given.omega_fe_rad_s = a.theta_rad, a.omega_rad_s
            given.theta_ru_rad, given.omega_ru_rad_s = b.theta_rad, b.omega_rad_s
            self._step(self._coeffs, self._state, given, out)
            a.tau_Nm, a.tau_set_Nm = out.tau_fe_Nm, out.tau_set_fe_Nm
            b.tau_Nm, b.tau_set_Nm = out.tau_ru_Nm, out.tau_set_ru_Nm
            share = (k + 1) / STEPS
            for axis, limb, m in zip(self.axes, self._limbs, muscle, strict=True):
                self._axis(axis, limb, m, share, h)

    def _axis(self, x: AxisState, limb: Limb, m: Sequence[float], share: float, h: float) -> None:
        theta, omega = x.theta_rad, x.omega_rad_s
        hand = limb.torque_Nm(theta, omega, m, share, STEPS * h)
        omega += h * (hand + x.tau_Nm) / (limb.inertia_kgm2 + HANDLE_KGM2)
        x.omega_rad_s = omega
        x.theta_rad = theta + h * omega
        motor = self._gain * (x.tau_set_Nm - x.tau_Nm)
        motor = (
            MOTOR_RAD_S if motor > MOTOR_RAD_S else -MOTOR_RAD_S if motor < -MOTOR_RAD_S else motor
        )
        x.deflection_rad_s = motor - omega
        x.deflection_rad += h * x.deflection_rad_s

    @property
    def acts(self) -> bool:
        """Whether the impairment acts on both axes."""
        return bool(self._out.acts_fe > 0.5 and self._out.acts_ru > 0.5)
