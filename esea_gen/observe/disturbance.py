"""Disturbance of the drive: what its model does not explain of the motor side's motion (5.5)."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca
import sympy as sp

from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import (
    Constant,
    Equation,
    Flag,
    Port,
    Tunable,
    around,
    clip,
    status_port,
)
from esea_gen.model.symbolic import equations, to_casadi
from esea_gen.observe import drive_of
from esea_gen.observe.rates import cutoff_range, filter_delay_s

J, N, FV, FC, WIDTH = sp.symbols("J n f_v f_c w_c", positive=True)
U_A, OMEGA_M, TAU_E, D4 = sp.symbols("u_a omega_m tau_e d_4", real=True)
SIG = sp.tanh(OMEGA_M / WIDTH)
# (5.2) without its disturbance, and with it: the sliding mode controller solves the same line.
MODEL_ACCELERATION = (N * U_A - FV * OMEGA_M - FC * SIG - TAU_E) / J
ACCELERATION = MODEL_ACCELERATION + D4

EQUATIONS = """
    (5.1) | tau_c u_a' | u_c - u_a | lag of the motor's torque
    (5.2) | a_model | model | motion of the motor side
    (5.5) | d_4,k | d{4,k-1} + (1 - exp(-L * h)) \
        * ((omega{m,k} - omega{m,k-1}) / h - a_model - d{4,k-1}) | \
        disturbance: a lag of bandwidth L behind what the model leaves unexplained
"""

MOVED_S = 0.1  # decay of the largest acceleration: longer than a swing of the cable
# Largest product of an observer's bandwidth and its velocity filter's delay.
DELAY_SHARE = 0.5
MEANING = "bandwidth L of the observer: higher follows faster and passes more noise; 0 holds it"


# A controller that takes the estimate off its command closes a loop through the filter F.  With Q =
# L/(s + L) and a motor A that follows its command, d (1 - Q A (1 - F)) = Q F d_true: stable
# whatever A's phase while |Q (1 - F)| < 1.  That gain is below L T, T being the filter's delay at
# rest, the largest of |1 - F| / omega.  L T = 1/2 leaves a gain margin of two, at the lowest cut-
# off that may be tuned.
def bandwidth_limit_1_s(device: DeviceData, cutoff: Quantity) -> float:
    """Largest bandwidth that the velocity filter allows a disturbance observer."""
    low, _ = cutoff_range(device, cutoff)
    return DELAY_SHARE / filter_delay_s(low)


def bandwidth_tunable(
    device: DeviceData, bandwidth: Quantity, cutoff: Quantity, key: str, cutoff_key: str
) -> Tunable:
    """Tunable bandwidth of a disturbance observer, within what its velocity filter allows."""
    limit = bandwidth_limit_1_s(device, cutoff)
    if bandwidth.value > limit:
        low, _ = cutoff_range(device, cutoff)
        need = cutoff.value * bandwidth.value / limit
        raise UserError(
            f"{device.origin}: {key} = {bandwidth.value:g} 1/s is above its limit {limit:.3g} 1/s: "
            f"the velocity filter, whose cut-off {cutoff_key} = {cutoff.value:g} Hz may be tuned "
            f"down to {low:g} Hz, delays too much for a faster observer.",
            f"Lower it to {math.floor(100 * limit) / 100:g} or raise {cutoff_key} to "
            f"{math.ceil(10 * need) / 10:g} Hz.",
        )
    return bandwidth.tunable("bandwidth_1_s", 0.0, limit, MEANING)


def share_of(bandwidth_1_s: Any, h: float) -> Any:
    """Share of the difference that a first-order lag takes up in one step."""
    return 1 - ca.exp(-h * bandwidth_1_s)


# d4 = L (omega_m - integral(a_model + d4)) has the state z = omega_m - d4/L.  Kept is d4 itself:
#
#         d4 += (1 - exp(-L h)) ((omega_m(k) - omega_m(k-1))/h - a_model - d4)
#
# A difference of two near rates is exact, and with L = 0 the estimate rests instead of drifting.
# a_model is the mean over the step.
def drive_observer(device: DeviceData) -> Block:
    """Disturbance of the drive in momentum form, without an acceleration signal (5.5)."""
    law = _DriveObserver(device)
    return Block.of(
        law,
        "drive_observer",
        "Disturbance of the drive, and the motor's torque behind its lag",
        constants=device.constants("actuator"),
        outputs=(
            around("d4_rad_s2", law.d_lim, "disturbance of the drive", equation="(5.5)"),
            around("u_a_Nm", law.u_lim, "motor torque by the model of its lag", equation="(5.1)"),
            law.status(),
        ),
    )


# Late by half a period only: the bandwidth may be twenty times what the motor side's filter allows.
def drive_observer_by_gear(device: DeviceData) -> Block:
    """Disturbance of the drive (5.5) from the unfiltered rate of the motor's own encoder."""
    law = _DriveObserver(device, by_gear=True)
    return Block.of(
        law,
        "drive_by_gear",
        "Disturbance of the drive, by the motor's own encoder",
        constants=(*device.constants("actuator"), *law.cable_constants()),
        outputs=(
            around("d4_rad_s2", law.d_lim, "disturbance of the drive", equation="(5.5)"),
            law.status(),
        ),
    )


def gear_observer(device: DeviceData) -> Block:
    """What (5.2) leaves unexplained of the motor's own encoder (De Luca, Mattone, ICRA 2003)."""
    if device.file.redundancy is None:
        raise UserError(f"{device.origin}: section [redundancy] is missing.", "Add it.")
    law = _DriveObserver(device, device.file.redundancy.rate_1_s.value)
    return Block.of(
        law,
        "gear_observer",
        "What motor and coupling leave unexplained of the drive's motion",
        constants=device.constants("actuator"),
        outputs=(
            around("d_gear_rad_s2", law.d_lim, "unexplained acceleration", equation="(5.5)"),
            Port("moves_rad_s2", 0.0, law.a_lim, "largest acceleration of late, behind the lag"),
            law.status(),
        ),
    )


class _DriveObserver:
    def __init__(
        self, device: DeviceData, bandwidth_1_s: float | None = None, *, by_gear: bool = False
    ) -> None:
        self.device, self.by_gear = device, by_gear
        cable = device.file.cable
        self.loss = cable.loss.value if by_gear and cable else 0.0
        self.fixed = bandwidth_1_s is not None
        self.share = 1 - math.exp(-device.period_s * (bandwidth_1_s or 0.0))
        self.omega = "omega_gear_rad_s" if self.fixed or by_gear else "omega_motor_rad_s"
        self.d = "d_gear_rad_s2" if self.fixed else "d4_rad_s2"
        self.decay_moved = math.exp(-device.period_s / MOVED_S)
        self.drive = drive_of(device)
        a = self.drive.actuator
        self.h = device.period_s
        self.d_lim, self.u_lim = self.drive.d4_rad_s2, self.drive.u_Nm
        self.tau_lim, self.omega_lim = self.drive.tau_Nm, self.drive.omega_rad_s
        self.a_lim = 4 * self.d_lim  # motor, friction, coupling and a blow together
        tau_c = a.tau_c_s.value
        self.decay = math.exp(-self.h / tau_c)
        # Mean of the lag over a step: u + (u_a - u) (1 - exp(-h/tau_c)) tau_c/h.
        self.mean = (1 - self.decay) * tau_c / self.h
        self.numbers = {
            J: a.J_kgm2.value,
            N: a.gear_ratio.value,
            FV: a.fv_Nms_rad.value,
            FC: a.fc_Nm.value,
            WIDTH: a.coulomb_width_rad_s.value,
        }
        # Every part of (5.2) at its largest; the port's range only, nothing is clipped there.
        most = self.numbers[N] * self.u_lim + self.numbers[FV] * self.omega_lim + self.numbers[FC]
        self.reach = (most + self.tau_lim * (1 + self.loss)) / self.numbers[J] * 1.001

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        share = share_of(t.bandwidth_1_s, self.h)
        return {"share": share, "keep": 1 - share}

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        ok = guard.inputs_ok
        ready = label("ready", ca.logic_and(ok, s.primed), "two valid samples in a row")
        omega = vars(u)[self.omega]
        keep, share = (1 - self.share, self.share) if self.fixed else (c.keep, c.share)
        values = self.numbers | {OMEGA_M: omega, TAU_E: u.tau_Nm}
        passive_model = to_casadi(MODEL_ACCELERATION.subs(U_A, 0), values)
        if self.loss:
            rubbed = self.loss / self.numbers[J] * ca.fabs(u.tau_Nm)
            passive_model = passive_model - rubbed * ca.tanh(omega / self.numbers[WIDTH])
        passive = label("passive_rad_s2", passive_model, "(5.2) without motor and disturbance")
        driven = s.u_held_Nm + (s.u_a_Nm - s.u_held_Nm) * self.mean
        model = self.numbers[N] / self.numbers[J] * driven + 0.5 * (passive + s.passive_rad_s2)
        model = label("model_rad_s2", model, "(5.2) mean of the model over the step")
        seen = (omega - s.omega_last_rad_s) * (1 / self.h)
        moved = s.d4_rad_s2 * keep + share * (seen - model)
        d4 = ca.if_else(ready, clip(moved, -self.d_lim, self.d_lim), s.d4_rad_s2)
        d4 = label("d4_rad_s2", d4, "(5.5) disturbance")
        u_a = s.u_held_Nm + (s.u_a_Nm - s.u_held_Nm) * self.decay
        u_a = label("u_a_Nm", u_a, "(5.1) the motor's torque, exact for a held command")
        next_state = {
            "primed": ok,
            "omega_last_rad_s": omega,
            "passive_rad_s2": passive,
            "u_held_Nm": u.u_Nm,
            "u_a_Nm": u_a,
            "d4_rad_s2": d4,
        }
        clipped = ca.fabs(moved) > self.d_lim
        extra = {} if self.fixed or self.by_gear else {"u_a_Nm": u_a}
        if self.fixed:
            lagged = s.a_rad_s2 * keep + share * seen
            clipped = ca.logic_or(clipped, ca.fabs(lagged) > self.a_lim)
            extra = self.moves(s, ready, clip(lagged, -self.a_lim, self.a_lim), label)
            next_state |= {"a_rad_s2": extra.pop("a_rad_s2"), "moved_rad_s2": extra["moves_rad_s2"]}
        outputs = {
            self.d: d4,
            **extra,
            "status": guard.status(ca.logic_and(ready, clipped)),
        }
        return next_state, outputs

    def moves(self, s: Any, ready: ca.SX, lagged: ca.SX, label: Labels) -> dict[str, Any]:
        a = label("a_rad_s2", ca.if_else(ready, lagged, s.a_rad_s2), "acceleration behind the lag")
        moves = ca.fmax(ca.fabs(a), s.moved_rad_s2 * self.decay_moved)
        return {"a_rad_s2": a, "moves_rad_s2": label("moves_rad_s2", moves, "largest of late")}

    def cable_constants(self) -> tuple[Constant, ...]:
        return tuple(c for c in self.device.constants("cable") if c.name in ("loss", "drive_1_s"))

    def coefficients(self) -> tuple[Port, ...]:
        if self.fixed:
            return ()
        return (
            Port("share", 0.0, 1.0, "taken up in one step", equation="(5.5)"),
            Port("keep", 0.0, 1.0, "kept in one step", equation="(5.5)"),
        )

    def tunables(self) -> tuple[Tunable, ...]:
        if self.fixed:
            return ()
        if self.by_gear:
            cable = self.device.file.cable
            if cable is None:
                raise UserError(f"{self.device.origin}: section [cable] is missing.", "Add it.")
            # By bandwidth_limit_1_s, whose filter is here a difference over one period.
            return (cable.drive_1_s.tunable("bandwidth_1_s", 0.0, DELAY_SHARE / self.h, MEANING),)
        return (
            bandwidth_tunable(
                self.device,
                self.drive.disturbance.drive_1_s,
                self.drive.joint.motor_velocity_Hz,
                "disturbance.drive_1_s",
                "joint.motor_velocity_Hz",
            ),
        )

    def state(self) -> tuple[Port, ...]:
        return (
            Port("primed", 0.0, 1.0, "1 when the last sample was valid"),
            around("omega_last_rad_s", self.omega_lim, "motor side's rate, last step"),
            around("passive_rad_s2", self.reach, "friction and coupling, last step"),
            around("u_held_Nm", self.u_lim, "command that the motor holds"),
            around("u_a_Nm", self.u_lim, "motor torque", equation="(5.1)"),
            around("d4_rad_s2", self.d_lim, "disturbance", equation="(5.5)"),
            *self.moving(),
        )

    def moving(self) -> tuple[Port, ...]:
        if not self.fixed:
            return ()
        return (
            around("a_rad_s2", self.a_lim, "acceleration behind the lag"),
            Port("moved_rad_s2", 0.0, self.a_lim, "its largest of late"),
        )

    def inputs(self) -> tuple[Port, ...]:
        by_motor = self.omega == "omega_motor_rad_s"
        rate = "motor side's rate" if by_motor else "rate of the motor's encoder"
        command = "command that the motor holds from this tick on, at the motor shaft"
        return (
            around("u_Nm", self.u_lim, command, on_invalid=0.0),
            around(self.omega, self.omega_lim, rate, on_invalid="omega_last_rad_s"),
            around("tau_Nm", self.tau_lim, "interaction torque on the load", on_invalid=0.0),
        )

    def equations(self) -> tuple[Equation, ...]:
        return equations(EQUATIONS, model=MODEL_ACCELERATION)

    def status(self) -> Port:
        return status_port(
            "what is known of this estimate",
            "an input was NaN or outside its range; d4 is held",
            "the state was corrupt; the observer was started afresh",
            Flag("CLIPPED", "the estimate was clipped at its range", True, (self.d,), self.d_lim),
        )
