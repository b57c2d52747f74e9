"""Cascade control: PID on the torque around a loop on the motor's rate.

The inner loop controls the rate and feeds forward torque, friction and disturbance. The outer loop
sets that rate from the torque's error; the coupling's slope schedules its gain.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.law import Base, Law, Parts
from esea_gen.control.setpoint import ACCELERATION_ROOM, setpoint_rates
from esea_gen.control.sliding_mode.governor import governed_wires, smoothed_setpoint, torque_lead
from esea_gen.control.trend import motion_limits, trend
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.component import Component
from esea_gen.language.ports import Array, Flag, Port, Tunable, around, clip, status_port, threshold
from esea_gen.model.mode import Mode
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of
from esea_gen.observe.disturbance import drive_observer_by_gear

LEVELS = 5  # torques between which the slope of the coupling is interpolated
LOADING_STEPS = 400  # from rest to the largest deflection that the model is of
# The share of the largest command by which the applied one may miss it before the integral rests.
LIMITED_SHARE = 1e-3

EQUATIONS = """
    [cas 1] | e | tau_d + T * tau_d' - tau_e | error when the command acts, T = tau_c / g + h / 2
    [cas 2] | omega_d | omega_l + delta_d' + (k_p * e + I) / kappa | kappa: slope at abs(tau_e)
    [cas 3] | I' | k_i * (tau_d - tau_e) | rests while the command is held back
    [cas 4] | alpha | delta_d'' + k_p * (delta_d' - omega_m + omega_l) + (tau_e + tau_h) / J_h | \
        acceleration desired
    [cas 5] | omega_f | omega_d + T * delta_d'' | rate whose friction is compensated
    [cas 6] | n * u | tau_e + e + f_v * omega_f + f_c * tanh(omega_f / w_c) - J * d_4 \
        + J * (alpha + k_v * (omega_d - omega_m)) | torque of the motor
    [cas 7] | u_c | u + (g - 1) * (u - u_a) | against the motor's lag
"""


def slopes(base: Base) -> tuple[Array, Array]:
    """Torques, and the slope of the coupling's model about each while it is loaded slowly."""
    device, sensor = base.device, base.blocks["sensor"]
    theta = np.linspace(0, device.file.domain.theta_max_rad.value, LOADING_STEPS + 1)
    rate = float(theta[1]) / sensor.period_s
    loaded = sensor.simulator()
    loading = [loaded.step(theta_rad=float(x), omega_rad_s=rate)["tau_Nm"] for x in theta[1:]]
    tau = np.array([0.0, *loading])
    levels = np.linspace(0, min(device.tau_full_scale_Nm, tau[-1]), LEVELS)
    ends = np.clip([levels - levels[1] / 2, levels + levels[1] / 2], 0, tau[-1])
    found = np.diff(ends, axis=0)[0] / np.diff(np.interp(ends, tau, theta), axis=0)[0]
    # A slope that falls again would raise the gain where the coupling is stiff.
    return levels, np.maximum.accumulate(found)


class _Cascade:
    name, title = "cascade", "Cascade torque controller"

    def __init__(self, base: Base) -> None:
        device = base.device
        drive = self.drive = drive_of(device)
        self.h = self.period_s = drive.control_period_s
        self.u_lim, self.tau_lim = drive.u_Nm, drive.tau_Nm
        self.limited = threshold(LIMITED_SHARE * self.u_lim)
        self.levels, self.slopes = slopes(base)
        self.constants = (
            *device.constants("actuator"),
            *(k for k in device.constants("joint") if k.name == "Jh_kgm2"),
        )
        self.equations = equations(EQUATIONS)
        outer = "torque error: higher follows closer and passes more noise, then swings"
        inner = "rate of the motor: higher is stiffer and passes more noise, then swings"
        creep = "integral of the torque's error: higher takes an offset away sooner, and overshoots"
        leads = "how many times faster than the motor's lag the torque follows"
        source = "docs/control.md"
        self.tunables = (
            Tunable("gain_1_s", 20.0, 1.0, 40.0, outer, source),
            Tunable("rate_gain_1_s", 14.0, 1.0, 40.0, inner, source),
            Tunable("integral_1_s2", 10.0, 0.0, 200.0, creep, source),
            Tunable("lead", 2.0, 1.0, 4.0, leads, source),
        )
        self.lag_s = drive.actuator.tau_c_s.value
        most_s = threshold(self.lag_s + self.h)
        self.coefficients = (
            *(Port(t.name, t.low, t.high, t.meaning) for t in self.tunables),
            Port("ahead_s", 0.0, most_s, "time until a command takes effect", equation="[cas 1]"),
        )
        # As much as the outer gain makes of the largest torque.
        self.integral_lim = threshold(self.tunables[0].high * self.tau_lim)
        self.state = (
            Port.flag("active", "1 when the controller acted in the last step"),
            around("integral_Nm_s", self.integral_lim, "integral of the torque's error, I"),
            around("u_last_Nm", self.u_lim, "command of the last step"),
        )
        omega, rate = drive.omega_rad_s, drive.rate_rad_s
        turn, _ = motion_limits(device)
        self.inputs = (
            Port.choice("mode", Mode, "active mode"),
            around("tau_set_Nm", self.tau_lim, "set torque"),
            around("tau_rate_Nm_s", turn, "rate of the set torque"),
            Port("governed", 0.0, 1.0, "trust in that rate, 0 to 1"),
            around("delta_rate_rad_s", rate, "rate of the deflection set-point"),
            around(
                "delta_acc_rad_s2", threshold(ACCELERATION_ROOM * drive.d4_rad_s2), "its derivative"
            ),
            around("tau_Nm", self.tau_lim, "interaction torque on the load"),
            around("tau_h_Nm", drive.tau_h_Nm, "torque of the person", equation="(5.10)"),
            around("omega_m_rad_s", threshold(1.01 * omega), "rate of the motor, at the joint"),
            around("omega_l_rad_s", omega, "load side's rate"),
            around("d4_rad_s2", drive.d4_rad_s2, "disturbance of the drive", equation="(5.5)"),
            around("u_a_Nm", self.u_lim, "motor torque", equation="(5.1)"),
            around("u_applied_Nm", self.u_lim, "command that the limits let through"),
        )
        self.outputs = (
            around("u_command_Nm", self.u_lim, "requested motor torque, before the limits"),
            status_port(
                "status of this step",
                "an input was NaN or outside its range; the command is 0",
                "the state was corrupt; the law was entered anew",
                Flag("SATURATED", "the command was clipped", True, ("u_command_Nm",), self.u_lim),
                Flag("INTEGRAL_RESTS", "the integral is held or at its limit", True),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return vars(t) | {"ahead_s": self.lag_s / t.lead + 0.5 * self.h}

    def slope(self, tau_Nm: Any) -> Any:
        """The slope at a torque, by straight lines between the levels."""
        size, found = ca.fabs(tau_Nm), ca.SX(float(self.slopes[0]))
        pairs = zip(self.levels[:-1], self.levels[1:], np.diff(self.slopes), strict=True)
        for low, high, rise in pairs:
            found += float(rise / (high - low)) * clip(size - float(low), 0, float(high - low))
        return found

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        a, inertia = self.drive.actuator, self.drive.actuator.J_kgm2.value
        on = label("on", ca.logic_and(guard.inputs_ok, u.mode != Mode.OFF), "whether it acts")
        integral = ca.if_else(s.active, s.integral_Nm_s, 0)
        now = label("now_Nm", u.tau_set_Nm - u.tau_Nm, "error now")
        e = label("e_Nm", now + c.ahead_s * u.governed * u.tau_rate_Nm_s, "[cas 1]")
        slope = label("slope_Nm_rad", self.slope(u.tau_Nm), "of the coupling, about")
        rate = u.omega_l_rad_s + u.delta_rate_rad_s + (c.gain_1_s * e + integral) / slope
        rate = label("rate_rad_s", rate, "[cas 2] rate desired")
        load = (u.tau_Nm + u.tau_h_Nm) * (1 / self.drive.joint.Jh_kgm2.value)
        twisting = u.delta_rate_rad_s - u.omega_m_rad_s + u.omega_l_rad_s
        acc = label("acc_rad_s2", u.delta_acc_rad_s2 + c.gain_1_s * twisting + load, "[cas 4]")
        rubs = label("rubs_rad_s", rate + c.ahead_s * u.delta_acc_rad_s2, "[cas 5]")
        coulomb = a.fc_Nm.value * ca.tanh(rubs * (1 / a.coulomb_width_rad_s.value))
        moved = acc + c.rate_gain_1_s * (rate - u.omega_m_rad_s) - u.d4_rad_s2
        joint = u.tau_Nm + e + a.fv_Nms_rad.value * rubs + coulomb + inertia * moved
        law = label("law_Nm", joint * (1 / a.gear_ratio.value), "[cas 6]")
        driven = label("driven_Nm", law + (c.lead - 1) * (law - u.u_a_Nm), "[cas 7]")
        command = label("u_command_Nm", ca.if_else(on, clip(driven, -self.u_lim, self.u_lim), 0))
        # Held back here, or by what follows: whether the error would drive it further.
        beyond = ca.fabs(driven) > self.u_lim
        short = ca.if_else(s.active, s.u_last_Nm - u.u_applied_Nm, 0)
        lacks = ca.if_else(beyond, driven, ca.if_else(ca.fabs(short) > self.limited, short, 0))
        # An impedance follows the limb: what integrates its error would let a limp hand drift.
        rests = ca.logic_or(lacks * now > 0, u.mode == Mode.IMPEDANCE)
        rests = label("rests", rests, "the integral would wind up, or an impedance is rendered")
        grown = integral + ca.if_else(rests, 0, self.h * c.integral_1_s2 * now)
        full = ca.fabs(grown) > self.integral_lim
        grown = clip(grown, -self.integral_lim, self.integral_lim)
        next_state = {"active": on, "integral_Nm_s": ca.if_else(on, grown, 0), "u_last_Nm": command}
        status = guard.status(ca.logic_and(on, beyond), ca.logic_and(on, ca.logic_or(rests, full)))
        return next_state, {"u_command_Nm": command, "status": status}


def _parts(base: Base) -> Parts:
    device = base.device
    section_of(device, "redundancy", "cascade control needs the rate of the motor's own encoder")
    after: dict[str, Component] = {}
    wires = governed_wires(device)
    if device.file.cable is not None:
        after["drive_by_gear"] = drive_observer_by_gear(device)
        wires["cascade.d4_rad_s2"] = "drive_by_gear.d4_rad_s2"
    return Parts(
        sense={
            "lead": torque_lead(device),
            "inverse": base.inverse(),
            "setpoint": setpoint_rates(device),
            "smooth": smoothed_setpoint(device),
        },
        after_limits=after,
        control={"set_trend": trend(device, name="set_trend"), "cascade": Block.of(_Cascade(base))},
        command="cascade.u_command_Nm",
        wires=wires,
        signals={
            "omega_m_rad_s": "encoder_gear.omega_gear_rad_s",
            "omega_l_rad_s": "human.omega_load_rad_s",
            "theta_set_rad": "inverse.theta_rad",
            "tau_rate_Nm_s": "set_trend.tau_rate_Nm_s",
            "governed": "lead.governed",
            "delta_rate_rad_s": "smooth.delta_rate_rad_s",
            "delta_acc_rad_s2": "smooth.delta_acc_rad_s2",
        },
        setpoints={"delta_set_rad": "smooth.delta_set_rad"},
    )


LAW = Law("cascade", "Cascade control of the torque", _parts)
