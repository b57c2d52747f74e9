"""Sliding mode torque control of the motor side relative to the load side (5.12 to 5.22)."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.control.setpoint import ACCELERATION_ROOM
from esea_gen.control.sliding_mode.linear_loop import (
    LEAST_DAMPING,
    check_loop,
    least_damped,
    sliding_mode_numbers,
    slope_range,
)
from esea_gen.control.sliding_mode.softening import (
    COEFFICIENT,
    EQUATIONS,
    SOFTENED,
    TUNABLE,
    SwingSoftening,
)
from esea_gen.control.sliding_mode.surface import (
    DELTA,
    ERROR,
    ERROR_RATE,
    ETA,
    FC_UNC,
    FV_UNC,
    J_MAX,
    J_UNC,
    K1_UNC,
    K3_UNC,
    LAMBDA,
    SET_ACC,
    SET_BY_WANTED,
    TAU_UNC,
    TORQUE_UNCERTAINTY,
    WANTED,
    equivalent_control,
    surface_equations,
    switching_gain,
)
from esea_gen.devices.fields import field_facts
from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Array, Flag, Port, Tunable, around, clip, status_port, threshold
from esea_gen.language.stream import OwnStreams, Stream, single
from esea_gen.model.mode import Mode
from esea_gen.model.symbolic import equations, to_casadi
from esea_gen.observe import drive_of
from esea_gen.observe.disturbance import D4, FC, FV, OMEGA_M, TAU_E, WIDTH, J, N

# The share of the largest command by which the applied one may miss it before the integral rests.
LIMITED_SHARE = 1e-3
LEAD, LEAD_HIGH = 2.5, 4.0
# What friction is compensated for comes late by the motor's lag over the lead (14 ms), the rates'
# filter (14 ms), and what a command takes until it acts.
FRICTION_AHEAD_S = 0.035
MARGIN_HIGH = 5.0
SHARE_FALLS = 2.0  # by so many times what it lacks to 1, at the torque's full scale


# e = delta_d - delta.  Kept is lambda^2 times the integral: a rate, which does not jump when lambda
# is tuned.  On entry the integral makes the surface 0, and what is missing to the applied command
# becomes an offset that fades with the motor's lag.  The integral rests while the command is
# clipped, here or behind, and the error would drive it further; the applied command is compared
# with the last two, for which of them it stems from depends on the control task's release.
def sliding_mode(device: DeviceData) -> Block:
    """Sliding mode torque controller of the motor side relative to the load side."""
    return Block.of(_SlidingMode(device))


class _SlidingMode:
    def __init__(self, device: DeviceData) -> None:
        drive = self.drive = drive_of(device)
        sm = self.sm = sliding_mode_numbers(device)
        h = self.h = drive.control_period_s
        self.model_acceleration = sm.setpoint_acceleration == "model"
        self.lambda_low, self.lambda_high = slope_range(device, h)
        self.lead_here = LEAD if self.model_acceleration else 1.0
        check_loop(device, self.lead_here)
        # Against a lag of few samples a larger lead swings by itself.
        stable = least_damped(device, LEAD_HIGH).damping >= LEAST_DAMPING
        self.lead_high = LEAD_HIGH if stable else self.lead_here
        self.u_lim, self.d_lim = drive.u_Nm, drive.d4_rad_s2
        self.tau_lim, self.tau_h_lim = drive.tau_Nm, drive.tau_h_Nm
        self.omega_lim, self.rate_lim = drive.omega_rad_s, drive.rate_rad_s
        self.delta_lim, self.full_Nm = drive.delta_rad, device.tau_full_scale_Nm
        self.acc_lim = threshold(ACCELERATION_ROOM * self.d_lim)
        self.fade = math.exp(-h / drive.actuator.tau_c_s.value)
        self.limited = threshold(LIMITED_SHARE * self.u_lim)
        # A law as published knows no such thing.
        self.softening: SwingSoftening | None = None
        self.numbers = self._numbers()
        self._ranges()
        self._gains()
        self._ports(device)

    def _gains(self) -> None:
        width = field_facts("sliding_mode.phi_rad_s")
        stiffer = "slope of the surface: higher is stiffer and nearer to the drive's own modes"
        narrow = "width of the boundary layer: narrower is stiffer and chatters sooner"
        gain = "factor on the switching gain of (5.20); 1 is its smallest"
        equal, control = "thesis chapter 5: equality in (5.20)", "docs/control.md"
        leads = "how many times faster than the motor's lag the torque follows; 1 takes u_a as u_c"
        load = "share of the load's estimated acceleration in the set-point's acceleration"
        ahead = "share of the desired rate in the rate for friction compensation; 0: measured rate"
        ours, lead = float(self.model_acceleration), self.lead_here
        given = self.sm.load_share or Quantity(value=ours, status="assumed", source=control)
        by = f"1: thesis chapter 5; more: {control}"
        low, high = self.lambda_low, self.lambda_high
        self.tunables: tuple[Tunable, ...] = (
            self.sm.lambda_1_s.tunable("lambda_1_s", low, high, stiffer),
            self.sm.phi_rad_s.tunable("phi_rad_s", width["low"], width["high"], narrow),
            Tunable("margin", 1.0, 1.0, MARGIN_HIGH, gain, equal, "published"),
            Tunable("lead", lead, 1.0, self.lead_high, leads, by),
            given.tunable("load_share", 0.0, 1.0, load),
            Tunable("friction_ahead", ours, 0.0, 1.0, ahead, control),
        )
        self.coefficients: tuple[Port, ...] = (
            Port("lambda_1_s", 0.0, self.lambda_high, "slope of the surface", equation="(5.12)"),
            Port("lambda2_1_s2", 0.0, 1.01 * self.lambda_high**2, "its square"),
            Port(
                "integral_gain_1_s", 0.0, 1.01 * self.h * self.lambda_high**2, "square times period"
            ),
            Port("layer_s_rad", 0.0, 1.01e3, "1/phi", equation="(5.22)"),
            Port("margin", 1.0, MARGIN_HIGH, "factor on the switching gain", equation="(5.20)"),
            # Always 0 where a lead of 1 is the only stable one; a port's range is not empty.
            Port("lead", 0.0, self.lead_high - 1 or 1.0, "gain against the motor's lag"),
            Port("load_share", 0.0, 1.0, "share of the load's acceleration"),
            Port("friction_ahead", 0.0, 1.0, "share of the desired rate in the rate for friction"),
        )

    def _ports(self, device: DeviceData) -> None:
        self.name = "sliding_mode"
        self.title = "Sliding mode torque controller"
        self.constants = (
            *device.constants("actuator"),
            *device.constants("sliding_mode"),
            *(k for k in device.constants("joint") if k.name == "Jh_kgm2"),
        )
        self.equations = surface_equations()
        self.streams = STREAMS
        self.state: tuple[Port, ...] = (
            Port.flag("active", "1 when the controller acted in the last step"),
            around("integral_rad_s", self.integral_lim, "lambda^2 times the integral of e"),
            around("offset_Nm", 2.01 * self.u_lim, "fading offset of the entry"),
            around("u_last_Nm", self.u_lim, "command of the last step"),
            around("u_before_Nm", self.u_lim, "command of the step before"),
        )
        self.inputs = (
            around("delta_set_rad", self.delta_lim, "deflection set-point"),
            around("delta_rate_rad_s", self.rate_lim, "rate of the deflection set-point"),
            around("delta_acc_rad_s2", self.acc_lim, "acceleration of the set-point"),
            around("theta_rad", self.delta_lim, "deflection: motor-side minus load-side angle"),
            around("omega_motor_rad_s", self.omega_lim, "motor side's rate"),
            around("omega_load_rad_s", self.omega_lim, "load side's rate"),
            around("tau_Nm", self.tau_lim, "interaction torque on the load"),
            around("tau_h_Nm", self.tau_h_lim, "torque of the person"),
            around("d4_rad_s2", self.d_lim, "disturbance of the drive", equation="(5.5)"),
            around("u_a_Nm", self.u_lim, "motor torque by its model", equation="(5.1)"),
            Port.choice("mode", Mode, "1 and 2 act alike here"),
            around("u_applied_Nm", self.u_lim, "present motor command"),
        )
        command, phi = ("u_command_Nm",), self.sm.phi_rad_s.value
        rests = "the command is held back, or the integral is at its range: it does not grow"
        clipped = "the command was clipped at the motor's limit"
        entered = "the controller took over in this step, from the applied command"
        self.outputs = (
            around("u_command_Nm", self.u_lim, "command at the motor shaft", equation="(5.22)"),
            around("u_wanted_Nm", self.wanted_u, "command of the law before any limit"),
            around("s_rad_s", self.s_lim, "surface", equation="(5.12)"),
            around("u_eq_Nm", self.eq_lim, "equivalent control", equation="(5.16)"),
            Port("k_smc_Nm", 0.0, self.k_lim, "switching gain", equation="(5.20)"),
            status_port(
                "status of this command",
                "an input was NaN or outside its range; no torque asked for",
                "the state was corrupt; no torque asked for in this step",
                Flag("SATURATED", clipped, True, command, self.u_lim),
                Flag("LAYER_LEFT", "|s| is beyond the boundary layer", False, ("s_rad_s",), phi),
                Flag("INTEGRAL_RESTS", rests, True),
                Flag("ACTIVE", "the controller acts"),
                Flag("ENTERED", entered),
                *([SOFTENED] * self.model_acceleration),
            ),
        )

        if self.model_acceleration:
            self.softening = SwingSoftening(self.h, 2 * self.delta_lim, self.lead_high)
            self.tunables += (TUNABLE,)
            self.coefficients += (COEFFICIENT,)
            self.state += self.softening.state
            self.equations += equations(EQUATIONS)

    def _numbers(self) -> dict[sp.Symbol, float]:
        a, sm = self.drive.actuator, self.sm
        return {
            J: a.J_kgm2.value,
            N: a.gear_ratio.value,
            FV: a.fv_Nms_rad.value,
            FC: a.fc_Nm.value,
            WIDTH: a.coulomb_width_rad_s.value,
            J_UNC: sm.J_unc_kgm2.value,
            FV_UNC: sm.fv_share.value * a.fv_Nms_rad.value,
            FC_UNC: sm.fc_share.value * a.fc_Nm.value,
            J_MAX: a.J_kgm2.value + sm.J_unc_kgm2.value,
            ETA: sm.eta_rad_s2.value,
            K1_UNC: sm.k1_unc_Nm_rad.value,
            K3_UNC: sm.k3_unc_Nm_rad3.value,
        }

    def _ranges(self) -> None:
        """Ranges of surface (5.12), switching gain (5.20), equivalent control (5.16) and wish."""
        x, slope = self.numbers, self.lambda_high
        error_lim, error_rate_lim = 2 * self.delta_lim, self.rate_lim + 2 * self.omega_lim
        self.integral_lim = threshold(error_rate_lim + 2 * slope * error_lim)
        self.s_lim = threshold(2.002 * self.integral_lim)
        wanted_lim = (
            self.acc_lim
            + (self.tau_lim + self.tau_h_lim) / self.drive.joint.Jh_kgm2.value
            + 2 * slope * error_rate_lim
            + slope**2 * error_lim
        )
        self.k_lim = threshold(
            1.01
            * MARGIN_HIGH
            / x[N]
            * (
                x[J_UNC] * (wanted_lim + self.d_lim)
                + x[FV_UNC] * self.omega_lim
                + x[FC_UNC]
                + x[K1_UNC] * self.delta_lim
                + x[K3_UNC] * self.delta_lim**3
                + x[J_MAX] * x[ETA]
            )
            + 1e-6
        )
        self.eq_lim = threshold(
            1.01
            / x[N]
            * (x[J] * (wanted_lim + self.d_lim) + x[FV] * self.omega_lim + x[FC] + self.tau_lim)
        )
        most = LEAD_HIGH * (self.eq_lim + self.k_lim) + LEAD_HIGH * self.u_lim
        self.wanted_u = threshold(1.01 * most)

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return {
            "lambda_1_s": t.lambda_1_s,
            "lambda2_1_s2": t.lambda_1_s * t.lambda_1_s,
            "integral_gain_1_s": self.h * t.lambda_1_s * t.lambda_1_s,
            "layer_s_rad": 1 / t.phi_rad_s,
            "margin": t.margin,
            "lead": t.lead - 1,
            "load_share": t.load_share,
            "friction_ahead": t.friction_ahead,
        } | ({"softening": t.softening} if self.softening else {})

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        sound = ca.logic_and(guard.inputs_ok, guard.state_ok)
        on = label("on", ca.logic_and(sound, u.mode != Mode.OFF), "whether the controller acts")
        entering = label("entering", ca.logic_and(on, ca.logic_not(s.active)), "from off to on")

        e = label("e_rad", u.delta_set_rad - u.theta_rad, "theta_d - theta_m")
        moving = u.omega_motor_rad_s - u.omega_load_rad_s
        e_rate = label("e_rate_rad_s", u.delta_rate_rad_s - moving, "its rate")
        softened: dict[str, Any] = {}
        if self.softening:
            c, softened = self.softening.step(c, s, e, on, entering, label)
        surface, integral = self.surface(c, s, e, e_rate, entering, label)
        u_eq, k_smc = self.torques(c, u, e, e_rate, label)
        reach = label("reach", surface * c.layer_s_rad, "s/phi")
        law = label("law_Nm", u_eq + k_smc * clip(reach, -1, 1), "(5.22) motor torque wanted")
        driven = label("driven_Nm", law + c.lead * (law - u.u_a_Nm), "against the motor's lag")
        raw, missing = self.bumpless(s, u, driven, entering, label)
        command = label("u_command_Nm", ca.if_else(on, clip(raw, -self.u_lim, self.u_lim), 0))
        rests = self.integral_rests(s, u, e, driven, raw, entering, label)
        grown = label(
            "grown_rad_s", integral + ca.if_else(rests, 0, c.integral_gain_1_s * e), "the integral"
        )
        full = ca.fabs(grown) > self.integral_lim
        grown = clip(grown, -self.integral_lim, self.integral_lim)
        beyond = ca.logic_or(ca.fabs(driven) > self.u_lim, ca.fabs(raw) > self.u_lim)
        next_state = {
            **softened,
            "active": on,
            "integral_rad_s": ca.if_else(on, grown, 0),
            "offset_Nm": ca.if_else(on, missing * self.fade, 0),
            "u_last_Nm": command,
            "u_before_Nm": ca.if_else(on, ca.if_else(entering, u.u_applied_Nm, s.u_last_Nm), 0),
        }
        outputs = {
            "u_command_Nm": command,
            "u_wanted_Nm": ca.if_else(on, driven, 0),
            "s_rad_s": ca.if_else(on, surface, 0),
            "u_eq_Nm": ca.if_else(on, u_eq, 0),
            "k_smc_Nm": ca.if_else(on, k_smc, 0),
            "status": guard.status(
                ca.logic_and(on, beyond),
                ca.logic_and(on, ca.fabs(reach) > 1),
                ca.logic_and(on, ca.logic_or(rests, full)),
                on,
                entering,
                *([ca.logic_and(on, c.soft > 0.01)] if self.softening else ()),
            ),
        }
        return next_state, outputs

    @staticmethod
    def surface(
        c: Any, s: Any, e: ca.SX, e_rate: ca.SX, entering: ca.SX, label: Labels
    ) -> tuple[ca.SX, ca.SX]:
        """(5.12): the surface, 0 on entry, and the part of it that is the integral."""
        straight = e_rate + 2 * c.lambda_1_s * e
        straight = label("straight_rad_s", straight, "(5.12) without the integral")
        integral = ca.if_else(entering, -straight, s.integral_rad_s)
        surface = ca.if_else(entering, 0, straight + integral)
        surface = label("s_rad_s", surface, "(5.12); 0 on entry")
        return surface, integral

    def setpoint_acceleration(self, c: Any, u: Any, label: Labels) -> ca.SX:
        """theta_d'': of the set-point and, by (5.3), of the load; 0 as published."""
        if self.model_acceleration:
            load = (u.tau_Nm + u.tau_h_Nm) * (1 / self.drive.joint.Jh_kgm2.value)
            share = c.load_share
            if self.sm.load_share:  # the coupling stiffens, and what comes late weighs more
                loaded = ca.fmin(ca.fabs(u.tau_Nm) * (1 / self.full_Nm), 1)
                share = ca.fmax(share - SHARE_FALLS * (1 - share) * loaded, 0)
            set_acc = u.delta_acc_rad_s2 + share * load
        else:
            set_acc = ca.SX(0)
        return label("set_acc_rad_s2", set_acc, "theta_d''")

    def friction_rate(self, c: Any, u: Any, label: Labels) -> ca.SX:
        """Rate whose friction is compensated: at rest the motor's own says nothing."""
        if not self.model_acceleration:
            return ca.SX(u.omega_motor_rad_s)
        should = u.omega_load_rad_s + u.delta_rate_rad_s + FRICTION_AHEAD_S * u.delta_acc_rad_s2
        mixed = u.omega_motor_rad_s + c.friction_ahead * (should - u.omega_motor_rad_s)
        return label("omega_friction_rad_s", clip(mixed, -self.omega_lim, self.omega_lim))

    def torques(
        self, c: Any, u: Any, e: ca.SX, e_rate: ca.SX, label: Labels
    ) -> tuple[ca.SX, ca.SX]:
        """Equivalent control (5.16, 5.17) and switching gain (5.20)."""
        set_acc = self.setpoint_acceleration(c, u, label)
        omega = self.friction_rate(c, u, label)
        values = self.numbers | {
            LAMBDA: c.lambda_1_s,
            ERROR: e,
            ERROR_RATE: e_rate,
            SET_ACC: set_acc,
            OMEGA_M: omega,
            TAU_E: u.tau_Nm,
            D4: u.d4_rad_s2,
            DELTA: u.theta_rad,
        }
        wanted = set_acc + 2 * c.lambda_1_s * e_rate + c.lambda2_1_s2 * e
        wanted = label("wanted_rad_s2", wanted, "theta_d'' + 2 lambda e' + lambda^2 e")
        compact = equivalent_control().subs(SET_ACC, SET_BY_WANTED)
        u_eq = to_casadi(sp.together(compact), values | {WANTED: wanted})
        u_eq = label("u_eq_Nm", u_eq, "(5.16, 5.17) solution of s' = 0")
        tau_unc = label("tau_unc_Nm", to_casadi(TORQUE_UNCERTAINTY, values), "tau_e,unc")
        least = to_casadi(switching_gain(), values | {WANTED: wanted, TAU_UNC: tau_unc})
        k_smc = label("k_smc_Nm", c.margin * least, "(5.20)")
        return u_eq, k_smc

    def bumpless(
        self, s: Any, u: Any, driven: ca.SX, entering: ca.SX, label: Labels
    ) -> tuple[ca.SX, ca.SX]:
        """The command within the motor's range, with the offset that starts it where it is."""
        bounded = clip(driven, -self.u_lim, self.u_lim)
        missing = ca.if_else(entering, u.u_applied_Nm - bounded, s.offset_Nm)
        raw = label("raw_Nm", bounded + missing, "with the offset of the entry")
        return raw, missing

    def integral_rests(
        self, s: Any, u: Any, e: ca.SX, driven: ca.SX, raw: ca.SX, entering: ca.SX, label: Labels
    ) -> ca.SX:
        """Whether the command is held back, and the error would drive the integral further."""
        # Which way is the command held back?  1: it wanted to be higher.  First here, then by what
        # follows.
        high = ca.logic_or(driven > self.u_lim, raw > self.u_lim)
        low = ca.logic_or(driven < -self.u_lim, raw < -self.u_lim)
        short, before = s.u_last_Nm - u.u_applied_Nm, s.u_before_Nm - u.u_applied_Nm
        nearer = ca.if_else(ca.fabs(short) < ca.fabs(before), short, before)
        nearer = ca.if_else(entering, 0, nearer)
        here = ca.if_else(high, 1.0, ca.if_else(low, -1.0, 0.0))
        low_after = ca.if_else(nearer < -self.limited, -1.0, 0.0)
        after = ca.if_else(nearer > self.limited, 1.0, low_after)
        held_back = ca.if_else(here == 0, after, here)
        held_back = label("held_back", held_back, "sign of what the command lacks")
        return label("rests", held_back * e > 0, "the error would wind the integral up")


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # On and off, the command applied one or two periods late, clipped, or held at zero; errors from
    # a hundredth of the boundary layer to far beyond it.
    steps = 3000
    t = np.arange(steps)
    ports = {p.name: p for p in block.inputs}
    sizes = {p.name: np.zeros(steps) for p in block.inputs}

    def wave(name: str, share: float, period: float) -> Array:
        size = share * ports[name].high
        return np.asarray(size * np.sin(2 * np.pi * t / period + rng.uniform(0, 6)))

    sizes["mode"] = np.where((t // 170) % 4 == 3, 0.0, 1.0 + (t // 700) % 2)
    grow = 10.0 ** (-2 + 2 * (t % 900) / 900)
    for name, period in (("delta_set_rad", 260.0), ("theta_rad", 240.0)):
        sizes[name] = grow * wave(name, 0.3, period)
    for name, share, period in (
        ("delta_rate_rad_s", 0.05, 70.0),
        ("delta_acc_rad_s2", 0.02, 50.0),
        ("omega_motor_rad_s", 0.05, 80.0),
        ("omega_load_rad_s", 0.05, 85.0),
        ("tau_Nm", 0.1, 150.0),
        ("tau_h_Nm", 0.1, 190.0),
        ("d4_rad_s2", 0.1, 110.0),
        ("u_a_Nm", 0.5, 60.0),
    ):
        sizes[name] = (0.2 + grow) * wave(name, share, period)
    applied = ports["u_applied_Nm"].high
    out = []
    for name, late in (("applied one step late", 1), ("applied two steps late", 2)):
        # What the Block itself asked for, so that only a true difference holds it back.
        x = {k: single(v) for k, v in sizes.items()}
        simulator = block.simulator()
        asked = [0.0, 0.0]
        for k in range(steps):
            u = asked[-late] if late <= len(asked) else 0.0
            part = k // 200 % 5
            if part == 3:
                u = float(np.clip(u, -0.3 * applied, 0.3 * applied))
            elif part == 4:
                u = 0.0
            x["u_applied_Nm"][k] = single(u)
            y = simulator.step(**{n: float(v[k]) for n, v in x.items()})
            asked.append(float(single(y["u_command_Nm"])))
        out.append(Stream(name, x))
    return out


STREAMS = OwnStreams(_events)
