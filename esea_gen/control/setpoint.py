"""From the deflection set-point to its rate and acceleration."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Literal

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, Tunable, around, clip, status_port, threshold
from esea_gen.model.filters import triple_pole_gains, triple_pole_ports
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

Kind = Literal["observer", "differences"]

ACCELERATION_ROOM = 3.0
SETPOINT_BANDWIDTH_HZ = 50.0


# At the corners of a set-point all stop operators begin to move at once and the stiffness jumps: a
# second difference makes spikes of these, the observer gives numbers that belong together.
def setpoint_rates(device: DeviceData, kind: Kind = "observer") -> Block:
    """Rate and acceleration of the deflection set-point: observer, or differences as published."""
    return Block.of((_SetObserver if kind == "observer" else _Differences)(device))


TITLE = "Rate and acceleration of the deflection set-point"


class _SetRates:
    name = "setpoint_rates"
    by: str
    held: str
    shown: str

    def __init__(self, device: DeviceData) -> None:
        drive = drive_of(device)
        self.h = device.period_s
        self.delta_lim, self.rate_lim = drive.delta_rad, drive.rate_rad_s
        # What the whole motor torque could do to the bare drive, three times over: a larger one is
        # no acceleration that the drive could follow.
        self.acc_lim = threshold(ACCELERATION_ROOM * drive.d4_rad_s2)
        self.title = f"{TITLE}: {self.by}"
        self.constants = device.constants("timing")
        self.equations = equations(self.shown)
        text = "deflection set-point from the inverse"
        self.inputs = (around("theta_set_rad", self.delta_lim, text, on_invalid=self.held),)
        rate, acc = "delta_rate_rad_s", "delta_acc_rad_s2"
        clipped = "the rate, or the memory of the set-point, was clipped"
        fast = "the acceleration was clipped"
        self.outputs = (
            around("delta_set_rad", self.delta_lim, "deflection set-point"),
            around(rate, self.rate_lim, "rate of the set-point"),
            around(acc, self.acc_lim, "acceleration of the set-point"),
            status_port(
                "status of this set-point",
                "the set-point was NaN or outside its range; the last one is held",
                "the state was corrupt; restarted",
                Flag("RATE_CLIPPED", clipped, True, (rate,), self.rate_lim),
                Flag("ACCELERATION_CLIPPED", fast, True, (acc,), self.acc_lim),
            ),
        )


class _SetObserver(_SetRates):
    by, held = "tracking observer", "held_rad"
    shown = """
        [set 1] | alpha | 1 - p**3 | position gain; p the pole, q = 1 - p
        [set 2] | beta | 3/2 * q**2 * (1 + p) / h | rate gain
        [set 3] | gamma | q**3 / h**2 | acceleration gain
        [set 4] | delta | delta_p + alpha * e | update
    """

    def __init__(self, device: DeviceData) -> None:
        super().__init__(device)
        self.high = 0.1 / self.h
        # The transient of a step over the whole range; an output is clipped, the memory is not.
        self.delta_room, self.rate_room = 2 * self.delta_lim, 4 * self.rate_lim
        self.acc_room = threshold(self.rate_room / self.h)
        text = "bandwidth of the triple pole: higher follows faster, lower smooths the corners"
        own = min(SETPOINT_BANDWIDTH_HZ, self.high)
        self.tunables = (Tunable("bandwidth_Hz", own, 2.0, self.high, text, "docs/control.md"),)
        self.coefficients = triple_pole_ports(self.h)
        self.state = (
            Port.flag("primed", "1 once a valid sample has been seen"),
            around("held_rad", self.delta_lim, "last valid set-point"),
            around("delta_rad", self.delta_room, "filtered set-point"),
            around("rate_rad_s", self.rate_room, "filtered rate"),
            around("acc_rad_s2", self.acc_room, "filtered acceleration"),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return triple_pole_gains(t.bandwidth_Hz, self.h)

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        expected = s.delta_rad + self.h * (s.rate_rad_s + 0.5 * self.h * s.acc_rad_s2)
        ok = guard.inputs_ok
        expected = ca.if_else(s.primed, expected, u.theta_set_rad)
        predicted = label("predicted_rad", expected, "prediction")
        error = label("innovation_rad", u.theta_set_rad - predicted, "innovation")
        rate = s.rate_rad_s + self.h * s.acc_rad_s2 + c.beta_1_s * error
        acc = s.acc_rad_s2 + c.gamma_1_s2 * error
        # Held: a set-point that stands still where the last valid one was.
        delta = ca.if_else(ok, predicted + c.alpha * error, s.held_rad)
        delta = label("delta_raw_rad", delta, "filtered")
        rate = label("rate_raw_rad_s", ca.if_else(ok, rate, 0), "its rate")
        acc = label("acc_raw_rad_s2", ca.if_else(ok, acc, 0), "its acceleration")
        next_state = {
            "primed": ca.logic_or(s.primed, ok),
            "held_rad": u.theta_set_rad,
            "delta_rad": clip(delta, -self.delta_room, self.delta_room),
            "rate_rad_s": clip(rate, -self.rate_room, self.rate_room),
            "acc_rad_s2": clip(acc, -self.acc_room, self.acc_room),
        }
        fast = ca.logic_or(ca.fabs(rate) > self.rate_lim, ca.fabs(delta) > self.delta_room)
        outputs = {
            "delta_set_rad": clip(delta, -self.delta_lim, self.delta_lim),
            "delta_rate_rad_s": clip(rate, -self.rate_lim, self.rate_lim),
            "delta_acc_rad_s2": clip(acc, -self.acc_lim, self.acc_lim),
            "status": guard.status(fast, ca.fabs(acc) > self.acc_lim),
        }
        return next_state, outputs


class _Differences(_SetRates):
    by, held = "plain differences", "delta_rad"
    shown = """
        [set 1] | delta' | (delta_k - delta{k-1}) / h | first difference
        [set 2] | delta'' | (delta_k - 2 * delta{k-1} + delta{k-2}) / h**2 | second difference
    """

    def __init__(self, device: DeviceData) -> None:
        super().__init__(device)
        self.state = (
            Port.flag("primed", "1 once a valid sample has been seen"),
            Port.flag("moving", "1 once a rate is known"),
            around("delta_rad", self.delta_lim, "set-point of the last step"),
            around("rate_rad_s", self.rate_lim, "rate of the last step"),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        per_s = 1 / self.h
        raw = ca.if_else(s.primed, (u.theta_set_rad - s.delta_rad) * per_s, 0)
        rate = clip(raw, -self.rate_lim, self.rate_lim)
        rate = label("delta_rate_rad_s", rate, "first difference")
        change = ca.if_else(s.moving, (rate - s.rate_rad_s) * per_s, 0)
        acc = clip(change, -self.acc_lim, self.acc_lim)
        acc = label("delta_acc_rad_s2", acc, "second difference")
        next_state = {
            "primed": ca.logic_or(s.primed, guard.inputs_ok),
            "moving": s.primed,
            "delta_rad": u.theta_set_rad,
            "rate_rad_s": rate,
        }
        outputs = {
            "delta_set_rad": u.theta_set_rad,
            "delta_rate_rad_s": rate,
            "delta_acc_rad_s2": acc,
            "status": guard.status(ca.fabs(raw) > self.rate_lim, ca.fabs(change) > self.acc_lim),
        }
        return next_state, outputs
