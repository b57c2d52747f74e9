"""Simulated impairment: a one-sided damped wall, and resistance to speed.

As printed (thesis 7.1, 7.2) both damping terms drive a motion outward; this form is passive.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.control.limits.safety import JOINT_RAD
from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, Tunable, around, clip, status_port, threshold
from esea_gen.language.stream import OwnStreams, Stream, single
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations, to_casadi

# Switching on or off is for a wrist that rests, and is not in the wall.
REST_RAD_S = 0.1

# Gains of thesis section 7.2.4: 2 Nm/deg, 0.1 and 0.02 Nms/deg.
PUBLISHED = {
    "Kp_Nm_rad": math.degrees(2.0),
    "Kp3_Nm_rad3": 0.0,
    "Kd_Nms_rad": math.degrees(0.1),
    "Kv_Nms_rad": math.degrees(0.02),
}
OF_WALL = ("Kp_Nm_rad", "Kp3_Nm_rad3", "Kd_Nms_rad")

THETA, OMEGA, WALL = sp.symbols("theta omega theta_w", real=True)
KP, KP3, KD, KV = sp.symbols("K_p K_p3 K_d K_v", nonnegative=True)
TAU_MAX = sp.Symbol("tau_max", positive=True)
DEPTH = sp.Max(THETA - WALL, 0)
SPRING = KP * (THETA - WALL) + KP3 * (THETA - WALL) ** 3
PUSH = sp.Max(SPRING + KD * OMEGA, 0)
RESISTANCE = -KV * OMEGA


EQUATIONS = """
    (7.1) | W | wall | push of the wall, with the sign put right
    (7.2) | tau | total | held at the allowed torque
"""


def has_wall(device: DeviceData, axis: str) -> bool:
    section = device.file.impairment
    return section is not None and (not section.wall_axes or axis in section.wall_axes)


# With d = max(theta - theta_w, 0), P = Kp d + Kp3 d^3 and W = max(P + Kd omega, 0) inside the wall,
# the torque sat(-Kv omega - W) is passive with the storage S(d) = integral_0^d min(P, tau_max) ds:
# for omega >= 0, Kv omega + W >= P; for omega <= 0 it is <= P, and the saturation keeps that order,
# so that -tau omega >= dS/dt either way.  It is switched only where the wrist rests outside the
# wall.  A wall that is softer than the coupling at every torque stays calm; both stiffen.
def impairment(device: DeviceData, *, wall: bool = True) -> Block:
    """Torque of a simulated impairment of one axis (7.1, 7.2; the damping's sign put right)."""
    return Block.of(_Impairment(device, wall))


class _Impairment:
    names = ("wall_rad", *OF_WALL, "Kv_Nms_rad", "tau_max_Nm")

    def __init__(self, device: DeviceData, wall: bool) -> None:
        form = "Add it; wrist_drive.toml shows the form."
        self.section, self.wall = section_of(device, "impairment", fix=form), wall
        self.h, self.theta = device.period_s, threshold(JOINT_RAD)
        self.omega = threshold(device.file.limits.omega_rad_s.value)
        self.tau = threshold(device.tau_full_scale_Nm)
        self.name = "impairment" if wall else "resistance"
        self.title = f"Simulated impairment: {'wall and ' if wall else ''}resistance"
        self.prepare = lambda t: {n: getattr(t, n) for n in self.names}
        self.state = (Port.flag("on", "1 while the impairment is active"),)
        self.streams = OwnStreams(events=_events)

        def given(name: str, low: float, high: float, meaning: str) -> Tunable:
            number = getattr(self.section, name) or Quantity(
                value=0.0, status="assumed", source="a linear wall"
            )
            if name == "Kv_Nms_rad" and not self.wall:
                number = self.section.resistance_Nms_rad or number
            value, source, status = number.value, number.source, number.status
            if self.section.wall == "published" and name in PUBLISHED:
                value, source, status = PUBLISHED[name], "thesis section 7.2.4", "published"
            if not self.wall and name != "Kv_Nms_rad":
                value, source = 0.0 if name in OF_WALL else self.theta, "no wall on this axis"
            return Tunable(name, value, low, high, meaning, source, status)

        self.tunables = (
            given("wall_rad", -self.theta, self.theta, "where the wall begins"),
            given("Kp_Nm_rad", 0.0, 200.0, "stiffness of the wall; 0 for no wall"),
            given("Kp3_Nm_rad3", 0.0, 2000.0, "how much it stiffens with the depth cubed"),
            given("Kd_Nms_rad", 0.0, 20.0, "damping in the wall: higher, less bounce"),
            given("Kv_Nms_rad", 0.0, 5.0, "resistance to speed everywhere"),
            Tunable(
                *("tau_max_Nm", self.tau, 0.01, self.tau, "most that it asks for; held there"),
                *("the elastomer's full scale", "assumed", "low"),
            ),
        )
        self.coefficients = tuple(t.port for t in self.tunables)
        self.inputs = (
            around("theta_rad", self.theta, "angle of the joint from the neutral position"),
            around("omega_rad_s", self.omega, "rate of the joint"),
            Port.flag("constrained", "1 asks for the impairment"),
        )
        self.outputs = (
            around("tau_set_Nm", self.tau, "desired torque on the wrist", equation="(7.1), (7.2)"),
            Port.flag("acts", "1 while the impairment is active"),
            Port.flag("usable", "1 while inputs and state are valid"),
            status_port(
                "status",
                "an input was NaN or outside its range; no torque",
                "the state was corrupt; the impairment is off",
                Flag("IN_WALL", "the wrist is in the wall"),
                Flag("SATURATED", "torque held at its limit", False, ("tau_set_Nm",), self.tau),
                Flag("SWITCH_WAITS", "switched once the wrist rests outside the wall"),
            ),
        )
        shown = sp.Piecewise((PUSH, DEPTH > 0), (0, True))
        total = sp.Max(sp.Min(RESISTANCE - sp.Symbol("W"), TAU_MAX), -TAU_MAX)
        self.equations = equations(EQUATIONS, wall=shown, total=total)

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        depth = label("depth_rad", u.theta_rad - c.wall_rad, "into the wall")
        inside = label("inside", depth > 0)
        resting = ca.logic_and(ca.fabs(u.omega_rad_s) <= threshold(REST_RAD_S), guard.inputs_ok)
        may = label("may_switch", ca.logic_and(resting, ca.logic_not(inside)), "no torque jumps")
        asked = u.constrained
        kept = ca.logic_and(ca.logic_not(may), s.on)
        on = label("on_now", ca.logic_or(ca.logic_and(may, asked), kept))
        values = {
            **{THETA: u.theta_rad, OMEGA: u.omega_rad_s, WALL: c.wall_rad},
            **{KP: c.Kp_Nm_rad, KP3: c.Kp3_Nm_rad3, KD: c.Kd_Nms_rad, KV: c.Kv_Nms_rad},
        }
        push = label("push_Nm", ca.if_else(inside, to_casadi(PUSH, values), 0), "it never pulls")
        raw = label("tau_raw_Nm", to_casadi(RESISTANCE, values) - push, "(7.1), (7.2)")
        torque = clip(raw, -c.tau_max_Nm, c.tau_max_Nm)
        acts = ca.logic_and(on, guard.inputs_ok)
        return {"on": on}, {
            "tau_set_Nm": ca.if_else(acts, torque, 0),
            "acts": acts,
            "usable": ca.logic_and(guard.inputs_ok, guard.state_ok),
            "status": guard.status(
                ca.logic_and(inside, acts),
                ca.logic_and(ca.fabs(raw) > c.tau_max_Nm, acts),
                ca.logic_and(asked != on, guard.inputs_ok),
            ),
        }


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    """A wrist that rests, is constrained, goes into the wall and out again, and is released."""
    import numpy as np

    h, still = block.period_s, 200
    t = np.arange(4000) * h
    theta = single(0.7 * np.sin(2 * np.pi * 1.0 * t))
    omega = single(1.4 * np.pi * np.cos(2 * np.pi * 1.0 * t))
    rest = np.zeros(still)
    wall = next(x for x in block.tunables if x.name == "wall_rad").default
    in_wall = single(np.full(still, wall + 0.01))
    angle = np.concatenate([rest, theta, rest, in_wall, rest, rest])
    rate = np.concatenate([rest, omega, rest, rest, rest, rest])
    asked = np.concatenate([rest + 1, theta * 0 + 1, rest + 1, rest, rest, rest + 1])
    return [
        Stream(
            "into the wall and out", {"theta_rad": angle, "omega_rad_s": rate, "constrained": asked}
        )
    ]
