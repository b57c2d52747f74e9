"""Temperature of the motor's winding and case from its copper loss, and the derated torque.

A drive's sensor may lag or be missing: it only raises the estimate, no faster than copper warms.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.limits.safety import LimitNumbers
from esea_gen.devices.drive_relations import COPPER_1_K, COPPER_C, LEAST_SHARE
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Constant, Flag, Port, around, clip, status_port, threshold
from esea_gen.language.stream import OwnStreams, Stream
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

STEP_S = 0.1  # in steps of a control period float32 would lose what the case gains
MEASURED_C = 300.0  # enamel has failed by then: beyond it the sensor's wire is cut or shorted
RISE_K_S = 100.0  # copper warms so fast at 120 A/mm2, adiabatically: faster is a wrong reading
BEYOND_K = 20.0  # above the largest temperature: as far as it is followed

EQUATIONS = """
    [hot 1] | P | R_25 / k_t**2 * (1 + a * (T_w - 25)) * u**2 | copper loss, mean over a step
    [hot 2] | C_w * Derivative(T_w, t) | P - (T_w - T_c) / R_wc | winding
    [hot 3] | C_c * Derivative(T_c, t) | (T_w - T_c) / R_wc - (T_c - T_a) / R_ca | case
    [hot 4] | u_+ | U * (1/20 + 19/20 * Max(0, Min(1, (T_m - T_w) / (T_m - T_d)))) | \
        largest motor torque; 0 above T_m
"""


# The command stands for the current: iron loss and friction are not in it.  Warmer nodes stay
# warmer under any torque, so a start that is warm enough is so for good.
def motor_temperature(device: DeviceData) -> Block:
    """Two-node model of winding and case; it only lowers the torque that the limits let by."""
    return Block.of(_MotorTemperature(device))


class _MotorTemperature:
    name = "motor_temperature"
    title = "Temperature of the motor's winding and case, and the torque that it leaves"
    starts_latched = True  # an old state knows nothing of the heat since

    def __init__(self, device: DeviceData) -> None:
        own, self.h = section_of(device, "motor_thermal"), drive_of(device).control_period_s
        self.rise_K = RISE_K_S * self.h
        self.u_max = LimitNumbers(device).u_max
        self.ambient, self.max = own.ambient_C.value, threshold(own.max_C.value)
        self.derate = threshold(own.derate_C.value)
        self.square = 1.001 * self.u_max**2
        self.loss_W_Nm2 = own.resistance_Ohm.value / own.k_t_Nm_A.value**2
        self.ticks = max(1, round(STEP_S / self.h))
        inner, outer = own.winding_case_K_W.value, own.case_ambient_K_W.value
        # Shares of the neighbours' temperatures in a node's next one, by explicit steps.
        step_s = self.ticks * self.h
        self.of_case = step_s / own.winding_s.value
        self.of_ambient = step_s / own.case_s.value
        self.of_winding = self.of_ambient * outer / inner
        self.gain_K_W = self.of_case * inner
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(_work)
        self.constants = device.constants("motor_thermal")
        self.constants += (Constant("copper_per_K", COPPER_1_K, "copper at 25 degC", "published"),)
        # What is unknown is as hot as the latch lets the winding be, and the case by that.
        case = self.ambient + (self.max - self.ambient) * outer / (inner + outer)
        self.hottest = self.max, case
        self._ports(*([own.start_C.value] * 2 if own.start_C else self.hottest))

    def _ports(self, winding_C: float, case_C: float) -> None:
        most = self.max + BEYOND_K

        def node(name: str, text: str, init: float = 0.0) -> Port:
            meaning = f"temperature of the {text}"
            return Port(f"{name}_C", self.ambient - 1, most, meaning, init=init)

        self.state = (
            node("winding", "winding", init=winding_C),
            node("case", "case", init=case_C),
            Port("square_Nm2", 0.0, self.square, "mean square of the torque so far"),
            Port.count("ticks", self.ticks, "periods of the present step"),
        )
        told = "temperature that the drive measures in the winding; 0 where it measures none"
        self.inputs = (
            around("u_Nm", self.u_max, "motor torque", on_invalid=self.u_max),
            Port("motor_C", -MEASURED_C, MEASURED_C, told, on_invalid=0.0),
        )
        largest = "the motor's largest torque"
        self.outputs = (
            Port("u_thermal_Nm", 0.0, self.u_max, "largest motor torque at this temperature"),
            node("winding", "winding, modelled"),
            node("case", "case, modelled"),
            Port("capacity", 0.0, 1.0, f"share of {largest} that the temperature leaves"),
            status_port(
                "status of the temperature",
                "torque or measured temperature was NaN or outside its range; the largest torque, "
                "the model's temperature",
                "the state was corrupt; both nodes are as hot as they may be",
                Flag("DERATED", f"less than {largest}", False, ("winding_C",), self.derate),
                Flag("HOT", "no torque is left; the limits latch", False, ("winding_C",), self.max),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        winding, case = (
            ca.if_else(guard.state_ok, at, hottest)
            for at, hottest in zip((s.winding_C, s.case_C), self.hottest, strict=True)
        )
        square = s.square_Nm2 + u.u_Nm * u.u_Nm * (1 / self.ticks)
        square = label("square_Nm2", ca.fmin(square, self.square))
        ends = label("ends", s.ticks >= self.ticks - 1, "a step of the model")
        factor = self.loss_W_Nm2 * (1 + COPPER_1_K * (winding - COPPER_C))
        loss = label("loss_W", factor * square, "[hot 1]")

        warmed = self.of_case * case + self.gain_K_W * loss + (1 - self.of_case) * winding
        shared = self.of_winding * winding + self.of_ambient * self.ambient
        shared = shared + (1 - self.of_winding - self.of_ambient) * case
        measured = ca.fmin(u.motor_C, winding + self.rise_K)
        winding = ca.fmax(ca.if_else(ends, warmed, winding), measured)
        winding = ca.fmin(winding, self.max + BEYOND_K)
        winding = label("winding", winding, "[hot 2]")
        case = label("case", ca.if_else(ends, shared, case), "[hot 3]")
        hot = label("hot", winding > self.max)
        share = clip((self.max - winding) * (1 / (self.max - self.derate)), 0.0, 1.0)
        share = ca.if_else(hot, 0.0, LEAST_SHARE + (1 - LEAST_SHARE) * share)
        capacity = label("share", share, "[hot 4]")
        return {
            "winding_C": winding,
            "case_C": case,
            "square_Nm2": ca.if_else(ends, 0.0, square),
            "ticks": ca.if_else(ends, 0.0, s.ticks + 1),
        }, {
            "u_thermal_Nm": self.u_max * capacity,
            "winding_C": winding,
            "case_C": case,
            "capacity": capacity,
            "status": guard.status(winding > self.derate, hot),
        }


def _work(block: Block, _rng: np.random.Generator) -> list[Stream]:
    # Full torque, rest, half torque backward, from the start and from cold, warm and hot nodes.
    # In the second half a drive measures: more than the model, less, and beyond all bounds.
    (u, _), (winding, case, square, _), steps = block.inputs, block.state[:4], 4000
    torque = u.high * np.repeat([1.0, 0.0, -0.5, 1.0], steps // 4)
    share = [(0.0, 0.0), (0.7, 0.5), (0.85, 0.9), (0.999, 0.5), (0.8, 0.8), (1.0, 1.0), (0.9, 0.8)]
    at = {
        500 * k: {
            p.name: np.array([p.low + x * (p.high - p.low)])
            for p, x in ((winding, w), (case, c), (square, w))
        }
        for k, (w, c) in enumerate(share, 1)
    }
    measured = np.repeat([0.0, 0.0, 0.0, 0.0, winding.high - 30, 25.0, -5.0, 999.0], steps // 8)
    return [Stream("work and rest", {"u_Nm": torque, "motor_C": measured}, at)]
