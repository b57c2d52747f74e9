"""Disturbance of the drive: motion of the motor side that its model does not explain (5.5)."""

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
from esea_gen.language.ports import Flag, Port, Tunable, around, clip, status_port
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations, to_casadi
from esea_gen.observe import Drive, drive_of
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
    """Tunable bandwidth of a disturbance observer, within its velocity filter's limit."""
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
    return Block.of(_DriveObserver(device, "drive_observer"))


# Late by half a period only: the bandwidth may be twenty times what the motor side's filter allows.
def drive_observer_by_gear(device: DeviceData) -> Block:
    """Disturbance of the drive (5.5) from the unfiltered rate of the motor's own encoder."""
    return Block.of(_DriveObserver(device, "drive_by_gear"))


def gear_observer(device: DeviceData) -> Block:
    """Motion of the motor's encoder that (5.2) does not explain (De Luca, Mattone, ICRA 2003)."""
    return Block.of(_DriveObserver(device, "gear_observer"))


TITLES = {
    "drive_observer": "Disturbance of the drive, and the motor's torque behind its lag",
    "drive_by_gear": "Disturbance of the drive, by the motor's own encoder",
    "gear_observer": "What motor and coupling leave unexplained of the drive's motion",
}


class _DriveObserver:
    def __init__(self, device: DeviceData, name: str) -> None:
        self.name, self.title = name, TITLES[name]
        # The gear's bandwidth is fixed, and it tells how hard the drive was moved of late.
        self.fixed, self.by_gear = name == "gear_observer", name == "drive_by_gear"
        by_motor = name == "drive_observer"
        drive = self.drive = drive_of(device)
        a, h = drive.actuator, device.period_s
        self.h, self.d_lim, self.u_lim = h, drive.d4_rad_s2, drive.u_Nm
        self.a_lim = 4 * self.d_lim  # motor, friction, coupling and a blow together
        self.omega = "omega_motor_rad_s" if by_motor else "omega_gear_rad_s"
        self.d = "d_gear_rad_s2" if self.fixed else "d4_rad_s2"
        self.decay_moved = math.exp(-h / MOVED_S)
        self.decay = math.exp(-h / a.tau_c_s.value)
        # Mean of the lag over a step: u + (u_a - u) (1 - exp(-h/tau_c)) tau_c/h.
        self.mean = (1 - self.decay) * a.tau_c_s.value / h
        self.numbers = {
            J: a.J_kgm2.value,
            N: a.gear_ratio.value,
            FV: a.fv_Nms_rad.value,
            FC: a.fc_Nm.value,
            WIDTH: a.coulomb_width_rad_s.value,
        }
        self.constants = device.constants("actuator")
        self.loss = 0.0
        self.tunables: tuple[Tunable, ...] = ()
        if self.fixed:
            bandwidth = section_of(device, "redundancy").rate_1_s.value
            self.share = 1 - math.exp(-h * bandwidth)
        elif self.by_gear:
            cable = section_of(device, "cable")
            self.loss = cable.loss.value
            own = [c for c in device.constants("cable") if c.name in ("loss", "drive_1_s")]
            self.constants += tuple(own)
            # By bandwidth_limit_1_s, whose filter is here a difference over one period.
            limit = DELAY_SHARE / h
            self.tunables = (cable.drive_1_s.tunable("bandwidth_1_s", 0.0, limit, MEANING),)
        else:
            keys = "disturbance.drive_1_s", "joint.motor_velocity_Hz"
            rates = drive.disturbance.drive_1_s, drive.joint.motor_velocity_Hz
            self.tunables = (bandwidth_tunable(device, *rates, *keys),)
        self.equations = equations(EQUATIONS, model=MODEL_ACCELERATION)
        self._ports(drive)

    def _ports(self, drive: Drive) -> None:
        self.coefficients = (
            Port("share", 0.0, 1.0, "share taken up in a step", equation="(5.5)"),
            Port("keep", 0.0, 1.0, "share kept in one step", equation="(5.5)"),
        )[: 2 * len(self.tunables)]
        # Every part of (5.2) at its largest; the port's range only, nothing is clipped there.
        x = self.numbers
        most = x[N] * self.u_lim + x[FV] * drive.omega_rad_s + x[FC]
        reach = (most + drive.tau_Nm * (1 + self.loss)) / x[J] * 1.001
        moving = (
            around("a_rad_s2", self.a_lim, "acceleration after the lag"),
            Port("moved_rad_s2", 0.0, self.a_lim, "largest recent acceleration"),
        )
        self.state = (
            Port.flag("primed", "1 when the last sample was valid"),
            around("omega_last_rad_s", drive.omega_rad_s, "motor side's rate, last step"),
            around("passive_rad_s2", reach, "friction and coupling, last step"),
            around("u_held_Nm", self.u_lim, "present motor command"),
            around("u_a_Nm", self.u_lim, "motor torque", equation="(5.1)"),
            around("d4_rad_s2", self.d_lim, "disturbance", equation="(5.5)"),
            *(moving if self.fixed else ()),
        )
        by_gear = self.omega == "omega_gear_rad_s"
        rate = "rate of the motor's encoder" if by_gear else "motor side's rate"
        command = "motor command from this tick on, at the motor shaft"
        self.inputs = (
            around("u_Nm", self.u_lim, command, on_invalid=0.0),
            around(self.omega, drive.omega_rad_s, rate, on_invalid="omega_last_rad_s"),
            around("tau_Nm", drive.tau_Nm, "interaction torque on the load", on_invalid=0.0),
        )
        d = "unexplained acceleration" if self.fixed else "disturbance of the drive"
        lag = "motor torque by the model of its lag"
        late = "largest recent acceleration, after the lag"
        more = () if by_gear else (around("u_a_Nm", self.u_lim, lag, equation="(5.1)"),)
        self.outputs = (
            around(self.d, self.d_lim, d, equation="(5.5)"),
            *((Port("moves_rad_s2", 0.0, self.a_lim, late),) if self.fixed else more),
            status_port(
                "status of this estimate",
                "an input was NaN or outside its range; d4 is held",
                "the state was corrupt; the observer was restarted",
                Flag(
                    "CLIPPED", "the estimate was clipped at its range", True, (self.d,), self.d_lim
                ),
            ),
        )

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
        outputs = {self.d: d4}
        if self.fixed:
            lagged = s.a_rad_s2 * keep + share * seen
            clipped = ca.logic_or(clipped, ca.fabs(lagged) > self.a_lim)
            lagged = clip(lagged, -self.a_lim, self.a_lim)
            a = ca.if_else(ready, lagged, s.a_rad_s2)
            a = label("a_rad_s2", a, "acceleration after the lag")
            moves = ca.fmax(ca.fabs(a), s.moved_rad_s2 * self.decay_moved)
            outputs["moves_rad_s2"] = label("moves_rad_s2", moves, "largest of late")
            next_state |= {"a_rad_s2": a, "moved_rad_s2": moves}
        elif not self.by_gear:
            outputs["u_a_Nm"] = u_a
        return next_state, outputs | {"status": guard.status(ca.logic_and(ready, clipped))}
