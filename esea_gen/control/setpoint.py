"""From the deflection set-point to its rate and acceleration."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, get_args

import casadi as ca
import sympy as sp

from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import (
    Equation,
    Flag,
    Port,
    Tunable,
    around,
    clip,
    threshold,
)
from esea_gen.model.symbolic import equation
from esea_gen.observe import drive_of

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

Kind = Literal["observer", "differences"]


# At the corners of a set-point all stop operators begin to move at once and the stiffness jumps: a
# second difference makes spikes of these, the observer gives numbers that belong together.
def setpoint_rates(
    device: DeviceData, kind: Kind = "observer", *, bandwidth_Hz: float | None = None
) -> Block:
    """Rate and acceleration of the deflection set-point: observer, or differences as published."""
    if kind not in get_args(Kind):
        raise ValueError(f"kind must be one of {get_args(Kind)}, got {kind!r}")
    drive = drive_of(device)
    h = device.period_s
    delta_lim, rate_lim = drive.delta_rad, drive.rate_rad_s
    # What the whole motor torque could do to the bare drive, three times over: a larger one is no
    # acceleration that the drive could follow.
    acc_lim = threshold(ACCELERATION_ROOM * drive.d4_rad_s2)
    return (_observer if kind == "observer" else _differences)(
        device, h, delta_lim, rate_lim, acc_lim, bandwidth_Hz
    )


ACCELERATION_ROOM = 3.0
SETPOINT_BANDWIDTH_HZ = 50.0


def _set_flags(rate_lim: float, acc_lim: float) -> tuple[Flag, ...]:
    return (
        Flag("INPUT_INVALID", "the set-point was NaN or outside its range; it is held", True),
        Flag("STATE_REPAIRED", "the state was corrupt; started afresh", True),
        Flag(
            "RATE_CLIPPED",
            "the rate, or the memory of the set-point, was clipped",
            True,
            ("delta_rate_rad_s",),
            rate_lim,
        ),
        Flag(
            "ACCELERATION_CLIPPED",
            "the acceleration was clipped",
            True,
            ("delta_acc_rad_s2",),
            acc_lim,
        ),
    )


def _set_ports(
    delta_lim: float, rate_lim: float, acc_lim: float, held: str
) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
    inputs = (
        around(
            "theta_set_rad", delta_lim, "deflection set-point from the inverse", on_invalid=held
        ),
    )
    outputs = (
        around("delta_set_rad", delta_lim, "deflection set-point"),
        around("delta_rate_rad_s", rate_lim, "its rate"),
        around("delta_acc_rad_s2", acc_lim, "its acceleration"),
        Port(
            "status", 0, 15, "what is known of this set-point", flags=_set_flags(rate_lim, acc_lim)
        ),
    )
    return inputs, outputs


def _observer(
    device: DeviceData,
    h: float,
    delta_lim: float,
    rate_lim: float,
    acc_lim: float,
    bandwidth_Hz: float | None,
) -> Block:
    law = _Observer(device, h, delta_lim, rate_lim, acc_lim, bandwidth_Hz)
    inputs, outputs = _set_ports(delta_lim, rate_lim, acc_lim, "held_rad")
    return Block.of(
        law,
        "setpoint_rates",
        "Rate and acceleration of the deflection set-point: tracking observer",
        constants=device.constants("timing"),
        coefficients=(
            Port("alpha", 0.0, 1.0, "position gain"),
            Port("beta_1_s", 0.0, 3.0 / h, "velocity gain"),
            Port("gamma_1_s2", 0.0, 1.0 / h**2, "acceleration gain"),
        ),
        inputs=inputs,
        outputs=outputs,
    )


class _Observer:
    def __init__(
        self,
        device: DeviceData,
        h: float,
        delta_lim: float,
        rate_lim: float,
        acc_lim: float,
        bandwidth_Hz: float | None,
    ) -> None:
        self.h = h
        self.delta_lim = delta_lim
        self.rate_lim = rate_lim
        self.acc_lim = acc_lim
        self.bandwidth_Hz = bandwidth_Hz
        self.high = 0.1 / h
        # The transient of a step over the whole range; an output is clipped, the memory is not.
        self.delta_room, self.rate_room = 2 * delta_lim, 4 * rate_lim
        self.acc_room = threshold(self.rate_room / h)

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        pole = ca.exp(-2 * math.pi * self.h * t.bandwidth_Hz)
        q = 1 - pole
        return {
            "alpha": 1 - pole * pole * pole,
            "beta_1_s": 1.5 * q * q * (1 + pole) / self.h,
            "gamma_1_s2": q * q * q / (self.h * self.h),
        }

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        expected = s.delta_rad + self.h * (s.rate_rad_s + 0.5 * self.h * s.acc_rad_s2)
        ok = guard.inputs_ok
        predicted = label(
            "predicted_rad", ca.if_else(s.primed, expected, u.theta_set_rad), "prediction"
        )
        error = label("innovation_rad", u.theta_set_rad - predicted, "innovation")
        rate = s.rate_rad_s + self.h * s.acc_rad_s2 + c.beta_1_s * error
        acc = s.acc_rad_s2 + c.gamma_1_s2 * error
        # Held: a set-point that stands still where the last valid one was.
        next_delta = label(
            "delta_raw_rad", ca.if_else(ok, predicted + c.alpha * error, s.held_rad), "filtered"
        )
        next_rate = label("rate_raw_rad_s", ca.if_else(ok, rate, 0), "its rate")
        next_acc = label("acc_raw_rad_s2", ca.if_else(ok, acc, 0), "its acceleration")
        next_state = {
            "primed": ca.logic_or(s.primed, ok),
            "held_rad": u.theta_set_rad,
            "delta_rad": clip(next_delta, -self.delta_room, self.delta_room),
            "rate_rad_s": clip(next_rate, -self.rate_room, self.rate_room),
            "acc_rad_s2": clip(next_acc, -self.acc_room, self.acc_room),
        }
        outputs = {
            "delta_set_rad": clip(next_delta, -self.delta_lim, self.delta_lim),
            "delta_rate_rad_s": clip(next_rate, -self.rate_lim, self.rate_lim),
            "delta_acc_rad_s2": clip(next_acc, -self.acc_lim, self.acc_lim),
            "status": guard.status(
                ca.logic_or(
                    ca.fabs(next_rate) > self.rate_lim, ca.fabs(next_delta) > self.delta_room
                ),
                ca.fabs(next_acc) > self.acc_lim,
            ),
        }
        return next_state, outputs

    def tunables(self) -> tuple[Tunable, ...]:
        return (
            Tunable(
                "bandwidth_Hz",
                min(self.bandwidth_Hz or SETPOINT_BANDWIDTH_HZ, self.high),
                2.0,
                self.high,
                "bandwidth of the triple pole: higher follows faster, lower smooths the corners",
                "docs/control.md",
            ),
        )

    def state(self) -> tuple[Port, ...]:
        return (
            Port("primed", 0.0, 1.0, "1 once a valid sample has been seen"),
            around("held_rad", self.delta_lim, "last valid set-point"),
            around("delta_rad", self.delta_room, "filtered set-point"),
            around("rate_rad_s", self.rate_room, "its rate"),
            around("acc_rad_s2", self.acc_room, "its acceleration"),
        )

    def equations(self) -> tuple[Equation, ...]:
        e, p, q, hs = sp.symbols("e p q h")
        return (
            equation("[set 1]", "alpha", 1 - p**3, "position gain; p the pole, q = 1 - p"),
            equation("[set 2]", "beta", sp.Rational(3, 2) * q**2 * (1 + p) / hs, "rate gain"),
            equation("[set 3]", "gamma", q**3 / hs**2, "acceleration gain"),
            equation("[set 4]", "delta", sp.Symbol("delta_p") + sp.Symbol("alpha") * e, "update"),
        )


def _differences(
    device: DeviceData,
    h: float,
    delta_lim: float,
    rate_lim: float,
    acc_lim: float,
    bandwidth_Hz: float | None,
) -> Block:
    if bandwidth_Hz is not None:
        raise ValueError("plain differences have no bandwidth_Hz")

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        ok = guard.inputs_ok
        raw = ca.if_else(s.primed, (u.theta_set_rad - s.delta_rad) * (1 / h), 0)
        rate = label("delta_rate_rad_s", clip(raw, -rate_lim, rate_lim), "first difference")
        change = ca.if_else(s.moving, (rate - s.rate_rad_s) * (1 / h), 0)
        acc = label("delta_acc_rad_s2", clip(change, -acc_lim, acc_lim), "second difference")
        next_state = {
            "primed": ca.logic_or(s.primed, ok),
            "moving": s.primed,
            "delta_rad": u.theta_set_rad,
            "rate_rad_s": rate,
        }
        outputs = {
            "delta_set_rad": u.theta_set_rad,
            "delta_rate_rad_s": rate,
            "delta_acc_rad_s2": acc,
            "status": guard.status(ca.fabs(raw) > rate_lim, ca.fabs(change) > acc_lim),
        }
        return next_state, outputs

    inputs, outputs = _set_ports(delta_lim, rate_lim, acc_lim, "delta_rad")
    d_k, d_1, d_2, hs = (sp.Symbol(n) for n in ("delta_k", "delta_k-1", "delta_k-2", "h"))
    return Block.define(
        "setpoint_rates",
        "Rate and acceleration of the deflection set-point: plain differences",
        period_s=h,
        constants=device.constants("timing"),
        state=(
            Port("primed", 0.0, 1.0, "1 once a valid sample has been seen"),
            Port("moving", 0.0, 1.0, "1 once a rate is known"),
            around("delta_rad", delta_lim, "set-point of the last step"),
            around("rate_rad_s", rate_lim, "rate of the last step"),
        ),
        inputs=inputs,
        outputs=outputs,
        equations=(
            equation("[set 1]", "delta'", (d_k - d_1) / hs, "first difference"),
            equation("[set 2]", "delta''", (d_k - 2 * d_1 + d_2) / hs**2, "second difference"),
        ),
        step=step,
    )
