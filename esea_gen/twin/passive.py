"""A passive sensor between two hands and a limb: cuff, coupling with its dead zone, encoders.

The hands' torque acts on a cuff of small inertia, the coupling between cuff and limb on both::

    J omega_m' = tau_hand - b (omega_m - omega_l) - tau_e(theta_m - theta_l)

with the elastomer's torque tau_e as in the virtual exoskeleton: the torque sensor's own step at the
plant's period, fed with the true rate in the middle of the step.  The limb's movement is an input:
the caller simulates the limb.  In the dead zone only J and b resist the cuff, which therefore takes
time to cross it, and strikes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device, compile_system
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Array, Port
from esea_gen.language.system import System, Task
from esea_gen.model.symbolic import equations
from esea_gen.twin.encoders import ANGLE_RAD, encoder_block
from esea_gen.twin.parameters import STEP_S, assumed
from esea_gen.twin.plant import TICK_S, plant_status, sensed, status_port, true_sensor
from esea_gen.twin.published import PLANTS

NAME = "passive_twin"
HAND_Nms_rad = 0.5  # flesh between hands and cuff; assumed
ENCODER_NOISE_RAD = 2e-4  # of each, effective value: an eighth of a count of 12 bits; assumed
SETTLE_S = 0.5  # held as at the start until the cuff is at rest
_SPEED_RAD_S, _TAU_NM = 500.0, 1000.0


def passive_block(device: DeviceData, step_s: float = STEP_S) -> Block:
    sensor = true_sensor(device, step_s)
    inertia = PLANTS.real.motor_side_inertia_kgm2
    tunables = (
        assumed("cuff_inertia_kgm2", inertia, 1e-4, 1, "inertia of the cuff on the hands' side"),
        assumed("hand_damping_Nms_rad", HAND_Nms_rad, 0, 100, "of the cuff against the limb"),
    )
    q = 0.5 * step_s

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        v = label("v_m", s.omega_m_rad_s + q * s.alpha_m_rad_s2, "speed in the middle of the step")
        x = label("x_m", s.theta_m_rad + step_s * v)
        rate = label("rate_rad_s", v - u.omega_l_rad_s)
        shown, memory = sensed(sensor, s, x - u.theta_l_rad, rate)
        tau_e = label("tau_e", shown["tau_Nm"], "(3.1)")
        slope = c.hand_damping_Nms_rad
        force = u.tau_hand_Nm - slope * rate - tau_e
        a = label("a_m", force / (c.cuff_inertia_kgm2 + q * slope), "damping implicit")
        state = {"theta_m_rad": x, "omega_m_rad_s": v + q * a, "alpha_m_rad_s2": a}
        return state | memory, {
            "tau_e_Nm": tau_e,
            "theta_m_rad": x,
            "theta_l_rad": u.theta_l_rad,
            "plant_status": plant_status(guard),
        }

    return Block.define(
        "plant",
        "Passive sensor between hands and limb: cuff and coupling",
        period_s=step_s,
        constants=sensor.constants,
        tunables=tunables,
        coefficients=tuple(t.port for t in tunables),
        prepare=vars,
        state=(
            Port("theta_m_rad", -ANGLE_RAD, ANGLE_RAD, "angle of the cuff"),
            Port("omega_m_rad_s", -_SPEED_RAD_S, _SPEED_RAD_S, "speed of the cuff"),
            Port("alpha_m_rad_s2", -1e7, 1e7, "acceleration of the cuff"),
            *sensor.state,
        ),
        inputs=(
            Port("tau_hand_Nm", -_TAU_NM, _TAU_NM, "torque of the hands on the cuff"),
            Port("theta_l_rad", -ANGLE_RAD, ANGLE_RAD, "angle of the limb", on_invalid=0.0),
            Port("omega_l_rad_s", -_SPEED_RAD_S, _SPEED_RAD_S, "its speed in mid-step"),
        ),
        outputs=(
            Port("tau_e_Nm", -1e5, 1e5, "true torque on the limb", equation="(3.1)"),
            Port("theta_m_rad", -ANGLE_RAD, ANGLE_RAD, "angle of the cuff"),
            Port("theta_l_rad", -ANGLE_RAD, ANGLE_RAD, "angle of the limb"),
            status_port(),
        ),
        equations=equations("(5.2) | J omega_m' | tau_hand - b * omega_ml - tau_e | cuff"),
        step=step,
    )


def passive_system(device: DeviceData, step_s: float = STEP_S, tick_s: float = TICK_S) -> System:
    """Task ``move`` (cuff and coupling) every step, task ``encode`` every tick."""
    plant, encoders = passive_block(device, step_s), encoder_block(device, tick_s)
    return System(
        NAME,
        step_s,
        {"plant": plant, "encoders": encoders},
        (Task("move", ("plant",)), Task("encode", ("encoders",), round(tick_s / step_s))),
        {},
        {p.name: (f"plant.{p.name}",) for p in plant.inputs}
        | {"read_m_rad": ("encoders.theta_m_rad",), "read_l_rad": ("encoders.theta_l_rad",)},
        {p.name: f"plant.{p.name}" for p in plant.outputs}
        | {p.name: f"encoders.{p.name}" for p in encoders.outputs},
    )


@dataclass(frozen=True)
class PassiveRun:
    time_s: Array
    tau_true_Nm: Array
    tau_Nm: Array
    theta_l_rad: Array


class PassiveTwin:
    """A passive device in simulation: plant and encoders compiled, and the C that it ships."""

    def __init__(self, device: Device, encoder_noise_rad: float = ENCODER_NOISE_RAD) -> None:
        if (inputs := [x.name for x in device.system.inputs]) != ["theta_rad"]:
            text = f"{device.name}: inputs {', '.join(inputs)}; the twin has one axis and no motor."
            raise UserError(text, "Give a device whose input is theta_rad, such as knee.")
        self.device, self.encoder_noise_rad = device, encoder_noise_rad
        library = compile_system(passive_system(device, tick_s=device.period_s), "f64")
        self._plant, self._encoders = library.block("plant"), library.block("encoders")
        self._sense = compile_device(device, "f32").task("sense")
        self.count_rad = 2 * np.pi / 2**device.file.encoder.resolution_bits.value

    def run(
        self, time_s: Array, tau_hand_Nm: Array, theta_l_rad: Array, rng: np.random.Generator
    ) -> PassiveRun:
        h, tick_s = STEP_S, self.device.period_s
        every, settle = round(tick_s / h), round(SETTLE_S / tick_s)
        ticks = settle + int((time_s[-1] - time_s[0]) / tick_s + 1e-9)
        # Ends of steps: the last one of a tick is at the tick.
        t = time_s[0] - SETTLE_S + h * np.arange(1, every * ticks + 1)
        theta = np.interp(t, time_s, theta_l_rad)
        plant = {
            "tau_hand_Nm": np.interp(t, time_s, tau_hand_Nm),
            "theta_l_rad": theta,
            "omega_l_rad_s": np.diff(theta, prepend=theta[0]) / h,
        }
        self._plant.reset()
        self._plant.put_state({"theta_m_rad": theta[0]})
        moved, _ = self._plant.run(plant, trace=False)
        if moved["plant_status"].any():
            within = f"{_TAU_NM:g} Nm and {ANGLE_RAD:g} rad"
            raise UserError("The hands leave the plant's ranges.", f"Give numbers within {within}.")
        start, noise = rng.uniform(0, 2 * np.pi, 2), self.encoder_noise_rad
        self._encoders.reset()
        at = slice(every - 1, None, every)
        seen = {
            key: moved[key][at] + first + rng.normal(0, noise, ticks)
            for key, first in zip(("theta_m_rad", "theta_l_rad"), start, strict=True)
        }
        counts, _ = self._encoders.run(seen, trace=False)
        motor, load = (np.unwrap(counts[f"count_{k}"] * self.count_rad) for k in ("motor", "load"))
        # Zeroed once, with nothing in the hands: each within a count.
        zero = [np.floor(x / self.count_rad) * self.count_rad for x in start]
        turn = 2 * np.pi
        motor, load = (
            x - z - turn * np.round((x[0] - z - theta[0]) / turn)
            for x, z in zip((motor, load), zero, strict=True)
        )
        self._sense.reset()
        read, _ = self._sense.run({"theta_rad": motor - load}, trace=False)
        kept = slice(settle - 1, None)
        return PassiveRun(
            t[at][kept],
            moved["tau_e_Nm"][at][kept],
            np.asarray(read["tau_Nm"], dtype=np.float64)[kept],
            load[kept],
        )
