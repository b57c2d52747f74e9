"""Added damping and bounded energy, for every law.

A law that swings a limb up adds a little energy in every period: the mean power of its error is
measured, as a damping, and the missing damping is added to the desired torque.  A law that runs
away adds much at once: the drive's energy is summed, and the command is closed in time.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.reference import largest_gains
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import (
    Array,
    Constant,
    Flag,
    Port,
    around,
    clip,
    in_range,
    status_port,
    threshold,
)
from esea_gen.language.stream import OwnStreams, Stream, coefficient_edges, single
from esea_gen.model.mode import Mode
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of
from esea_gen.observe.rates import filter_delay_s

RISE_1_S, FALL_1_S = 6.0, 0.7
"""How fast the added damping follows what is missing, and what is too much."""
STILL_RAD_S, REST_S = 0.04, 1.0
"""Below that speed a limb rests: nothing can be told, and all damping comes back in that time."""
FADED, SLOW_RAD_S = 0.3, 0.02
"""Share of the damping that a fast swing gets; below that speed, mostly counts, any motion does."""
MOVES_RAD_S = 0.01
"""Above that speed of the limb nothing looks ahead along the set torque: the damping is in it."""
FULL = 30.0  # times energy_J: what given_J can hold; the command is closed long before


# V = E + J omega_m^2/2 + Omega n (T v + h kappa m) is held below E_m: E given beyond the wanted
# torque, v the most the motor may give behind its lag, m the most that the rate limit may have left
# of a command, T the lag and the delay of the speed's filter.  In a sample that is not good E grows
# by the most the motor can have worked.  Proven in docs/energy-bound.md.
def passivity(device: DeviceData) -> Block:
    """Damping that the error of a law lacks, and a bound of the energy that the drive gives."""
    return Block.of(_Passivity(device))


class _Passivity:
    def __init__(self, device: DeviceData) -> None:
        self.own, self.drive = section_of(device, "passivity"), drive_of(device)
        safety = section_of(device, "safety")
        actuator = self.drive.actuator
        self.h = device.period_s
        self.low, self.high = self.drive.theta_low_rad, self.drive.theta_high_rad
        self.tau_set_lim = threshold(device.tau_full_scale_Nm)
        self.kp_high, self.kd_high = largest_gains(device)
        self.damping = threshold(self.own.damping_Nms_rad.value)
        self.tau_lim, self.omega_lim = self.drive.tau_Nm, self.drive.omega_rad_s
        self.error_lim = threshold(
            1.01 * (self.tau_lim + self.tau_set_lim + self.kd_high * self.omega_lim)
        )
        self.power_lim = threshold(1.01 * self.error_lim * self.omega_lim)
        self.keep = math.exp(-self.h / self.own.window_s.value)
        self.still = STILL_RAD_S**2
        # The drive.
        self.J, self.ratio = actuator.J_kgm2.value, actuator.gear_ratio.value
        self.lag_s = actuator.tau_c_s.value
        self.lag_keep = math.exp(-self.h / self.lag_s)
        self.u_max = threshold(safety.u_max_Nm.value)
        self.u_lim = threshold(4 * max(self.u_max, self.drive.u_Nm))
        self.u_step = safety.u_rate_Nm_s.value * self.h
        # The speed is seen late, by its filter's delay and half a difference.
        cutoff = self.drive.joint.motor_velocity_Hz.value
        self.late_s = filter_delay_s(cutoff) + 0.5 * self.h
        self.extra = self.late_s * (1 - self.lag_keep) / self.h
        self.ticks = (1 + self.extra) * self.u_max / self.u_step
        self.energy = threshold(self.own.energy_J.value)
        self.omega_most = math.sqrt(2 * self.energy / self.J)
        self.given_lim = threshold(FULL * self.energy)
        # Energy that one Nm of motor torque may still bring: by its lag, by the rate limit.
        a_tick = self.omega_most * self.h * self.ratio
        self.by_lag_J_Nm = self.omega_most * (self.lag_s + self.late_s) * self.ratio
        # Work of a tick, from the torque at its end: exactly the lag's, backward.
        grown_s = self.lag_s * (1 / self.lag_keep - 1)
        self.by_v_J_Nm = self.omega_most * self.ratio * grown_s
        self.by_most_J_Nm = self.omega_most * self.ratio * (grown_s - self.h)
        self.by_rate_J_Nm = a_tick * self.ticks
        self.open_Nm_J = 1 / (a_tick * (1 + self.extra + self.ticks))
        self.moving_lim = threshold(0.51 * self.J * self.omega_lim**2)
        self.held_lim = threshold(
            1.01
            * (
                self.given_lim
                + self.moving_lim
                + (self.by_lag_J_Nm + self.by_rate_J_Nm) * self.u_max
            )
        )
        self._ports(device)

    def _ports(self, device: DeviceData) -> None:
        self.name = "passivity"
        self.title = "Damping that a law lacks, and a bound of the energy that the drive gives"
        self.prepare = lambda t: {"least_Nms_rad": t.least_Nms_rad, "energy_J": t.energy_J}
        self.equations = equations(EQUATIONS)
        self.streams = STREAMS

        def derived(name: str, value: float, source: str) -> Constant:
            return Constant(name, value, source, "derived")

        self.constants = (
            *device.constants("passivity"),
            derived("omega_most_rad_s", self.omega_most, "speed of the drive at energy_J"),
            derived("by_lag_J_Nm", self.by_lag_J_Nm, "what the motor's lag may still bring"),
            derived("by_rate_J_Nm", self.by_rate_J_Nm, "what the rate limit may still bring"),
            derived("open_Nm_J", self.open_Nm_J, "[pas 6] command let by for the energy left"),
        )
        least, energy = self.own.least_Nms_rad, self.own.energy_J
        felt = "damping that a hand feels at least: more is calmer and less transparent"
        held = "energy that drive and command may hold and give: less is weaker"
        self.tunables = (
            least.tunable("least_Nms_rad", least.value, self.damping, felt, "high"),
            energy.tunable("energy_J", 0.1 * self.energy, self.energy, held, "low"),
        )
        self.coefficients = tuple(
            Port(t.name, t.low, t.high, t.meaning.split(":")[0]) for t in self.tunables
        )
        self.state = self._state()
        self._ends()

    def _state(self) -> tuple[Port, ...]:
        u_room = 1.001 * self.u_max
        slow = (
            around("slow_rad_s", 1.001 * self.omega_lim, "low-frequency part of the limb's speed"),
            Port("slow_rad2_s2", 0.0, 1.01 * self.omega_lim**2, "mean square of that part"),
        )
        return (
            around("power_W", self.power_lim, "mean power of the torque error into the limb"),
            Port("square_rad2_s2", 0.0, 1.01 * self.omega_lim**2, "mean square limb speed"),
            # Room for a fixed-point clip, which rounds its ends.
            Port("damping_Nms_rad", 0.0, 1.001 * self.damping, "damping added", init=self.damping),
            Port("theta_load_last_rad", self.low, self.high, "load-side angle of the last step"),
            around("error_last_Nm", self.error_lim, "torque error of the last step"),
            Port("theta_motor_last_rad", self.low, self.high, "motor-side angle of the last step"),
            around("tau_last_Nm", self.tau_lim, "interaction torque of the last step"),
            Port("given_J", 0.0, 1.001 * self.given_lim, "energy delivered by the drive"),
            Port(
                "moving_J", 0.0, self.moving_lim, "kinetic energy of the drive, last valid sample"
            ),
            Port("v_Nm", 0.0, u_room, "largest |motor torque| behind the lag, at the shaft"),
            Port("most_Nm", 0.0, u_room, "largest |command| after the rate limit"),
            Port.flag("seen", "1 when the last sample was valid"),
            *(slow if self.own.fade_Hz else ()),
        )

    def _ends(self) -> None:
        self.inputs = (
            Port.choice("mode", Mode, "active mode"),
            Port.flag("sensing_ok", "1 while the measurements are valid"),
            Port.flag("request_ok", "1 while the request is valid"),
            around("tau_set_Nm", self.tau_set_lim, "set torque"),
            Port("Kp_Nm_rad", 0.0, self.kp_high, "stiffness of the impedance law"),
            Port("Kd_Nms_rad", 0.0, self.kd_high, "damping of the impedance law"),
            around("tau_Nm", self.tau_lim, "measured interaction torque on the load"),
            Port("theta_load_rad", self.low, self.high, "load side's angle"),
            around("omega_load_rad_s", self.omega_lim, "load side's speed"),
            Port("theta_motor_rad", self.low, self.high, "motor side's angle"),
            around("omega_motor_rad_s", self.omega_lim, "motor side's speed"),
            around("u_command_Nm", self.u_lim, "command with stamp, at the motor shaft"),
        )
        self.outputs = (
            around("tau_set_Nm", self.tau_set_lim, "set torque with the damping, for the law"),
            Port("damping_Nms_rad", 0.0, 1.001 * self.damping, "added damping"),
            Port.choice("mode_ahead", Mode, "2 while the set torque follows the limb's motion"),
            Port.flag("request_ok", "request_ok of the input; 0 with a corrupt state or tunable"),
            around("u_command_Nm", self.u_lim, "command for the limits, at the motor shaft"),
            Port("given_J", 0.0, 1.001 * self.given_lim, "energy beyond the desired torque's"),
            Port("held_J", 0.0, self.held_lim, "energy delivered and still in drive and command"),
            status_port(
                "status of this step",
                "an input was NaN or outside its range; the command is 0",
                "the state was corrupt and was reset; the limits latch",
                Flag("DAMPED", "damping is added"),
                Flag("COMMAND_CLOSED", "the command was reduced: the energy bound is reached"),
                Flag("FAST", "the drive is faster than the energy bound assumes"),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        seen = ca.logic_and(guard.inputs_ok, u.sensing_ok)
        going = label("going", ca.logic_and(seen, s.seen), "two samples in a row are good")
        whole = {p.name: in_range(getattr(c, p.name), p.low, p.high) for p in self.coefficients}
        sound = label("tunables_valid", ca.logic_and(*whole.values()), "else the limits latch")
        # A flipped one counts as the strictest until they have.
        strictest = {"least_Nms_rad": self.damping, "energy_J": 0.1 * self.energy}
        c = SimpleNamespace(
            **{n: ca.if_else(ok, getattr(c, n), strictest[n]) for n, ok in whole.items()}
        )
        on = label("on", ca.logic_and(seen, u.mode != Mode.OFF), "a law acts")
        kp = label("stiffness_Nm_rad", ca.if_else(u.mode == Mode.IMPEDANCE, u.Kp_Nm_rad, 0.0))
        kd = label("wanted_Nms_rad", ca.if_else(u.mode == Mode.IMPEDANCE, u.Kd_Nms_rad, 0.0))
        now = SimpleNamespace(going=going, on=on, kp=kp, kd=kd)
        damped, told = self._damping(c, s, u, now, label)
        held, gated = self._gate(c, s, u, SimpleNamespace(going=going, seen=seen), label)
        passed = label("passed_Nm", ca.if_else(guard.inputs_ok, gated.u_Nm, 0.0))
        m = label(
            "most_Nm",
            ca.fmin(ca.fmax(ca.fabs(passed), s.most_Nm - self.u_step), self.u_max),
            "the largest that the rate limit can have left",
        )
        next_state = {
            **damped,
            **held,
            "v_Nm": m + (s.v_Nm - m) * self.lag_keep,
            "most_Nm": ca.fmax(m, 0.0),
            "seen": seen,
        }
        closed = ca.logic_not(passed == u.u_command_Nm)
        status = guard.status(
            ca.logic_and(on, told["damping_Nms_rad"] > 0),
            ca.logic_and(guard.inputs_ok, closed),
            ca.fabs(u.omega_motor_rad_s) > self.omega_most,
        )
        outputs = told | {
            # What was given is forgotten with the memory, and a bound outside its range bounds
            # nothing: the limits latch.
            "request_ok": ca.logic_and(u.request_ok, ca.logic_and(guard.state_ok, sound)),
            "u_command_Nm": passed,
            "given_J": held["given_J"],
            "held_J": gated.held_J,
            "status": status,
        }
        return next_state, outputs

    def _damping(self, c: Any, s: Any, u: Any, now: SimpleNamespace, label: Labels) -> StepResult:
        error = label(
            "error_Nm",
            u.tau_Nm - u.tau_set_Nm - now.kd * u.omega_load_rad_s,
            "[pas 1] beyond what is wanted, wanted damping aside",
        )
        reach = self.omega_lim * self.h
        moved = clip(u.theta_load_rad - s.theta_load_last_rad, -reach, reach)
        # Angles, not speeds: a speed's filter delays it against the torque.
        power = 0.5 * (error + s.error_last_Nm) * moved * (1 / self.h)
        counted = ca.logic_and(now.going, now.on)
        gain = 1 - self.keep
        P = label(
            "power_W", s.power_W + gain * (ca.if_else(counted, power, 0.0) - s.power_W), "[pas 2]"
        )
        speed2 = ca.if_else(counted, u.omega_load_rad_s * u.omega_load_rad_s, 0.0)
        N = label(
            "square_rad2_s2", s.square_rad2_s2 + gain * (speed2 - s.square_rad2_s2), "[pas 2]"
        )
        most = label("most_Nms_rad", ca.fmax(self.damping - now.kd, 0.0), "all that may be added")
        # A spring that comes late by the motor's lag pushes on behind the turning point.
        least = label("least_Nms_rad", c.least_Nms_rad + self.lag_s * now.kp)
        missing = label("missing_W", P + least * N, "above 0: the hand feels too little")
        rate = ca.if_else(missing > 0, RISE_1_S, FALL_1_S)
        rest = (most - s.damping_Nms_rad) * (self.still / REST_S)
        change = self.h * (rate * missing + rest) / (ca.fmax(N, 0.0) + self.still)
        b = label("damping_Nms_rad", clip(s.damping_Nms_rad + change, 0.0, most), "[pas 3]")
        fade = self._fade(s, u, N, counted)
        added = ca.if_else(now.on, b * fade.pop("share", 1.0), 0.0)
        limit = self.tau_set_lim
        tau_set = clip(u.tau_set_Nm - added * u.omega_load_rad_s, -limit, limit)
        ahead = ca.logic_and(u.mode != Mode.IMPEDANCE, N > MOVES_RAD_S**2)
        next_state = {
            "power_W": P,
            "square_rad2_s2": ca.fmax(N, 0.0),
            "damping_Nms_rad": b,
            "theta_load_last_rad": u.theta_load_rad,
            "error_last_Nm": error,
            **fade,
        }
        told = {
            "tau_set_Nm": tau_set,
            "damping_Nms_rad": added,
            "mode_ahead": ca.if_else(now.on, ca.if_else(ahead, Mode.IMPEDANCE, u.mode), Mode.OFF),
        }
        return next_state, told

    def _fade(self, s: Any, u: Any, N: Any, counted: Any) -> dict[str, Any]:
        # A damping that comes late drives a fast swing, for which more of it would be added.  Its
        # share is taken from mean squares: a filter in its way would make it later still.
        if self.own.fade_Hz is None:
            return {}
        gain = 1 - math.exp(-2 * math.pi * self.own.fade_Hz.value * self.h)
        slow = s.slow_rad_s + gain * (u.omega_load_rad_s - s.slow_rad_s)
        square = ca.if_else(counted, slow * slow, 0.0)
        square = ca.fmax(s.slow_rad2_s2 + (1 - self.keep) * (square - s.slow_rad2_s2), 0.0)
        share = ca.fmin(square / (ca.fmax(N, 0.0) + SLOW_RAD_S**2), 1.0)
        return {"slow_rad_s": slow, "slow_rad2_s2": square, "share": FADED + (1 - FADED) * share}

    def _gate(
        self, c: Any, s: Any, u: Any, now: SimpleNamespace, label: Labels
    ) -> tuple[dict[str, Any], SimpleNamespace]:
        reach = self.omega_lim * self.h
        moved = clip(u.theta_motor_rad - s.theta_motor_last_rad, -reach, reach)
        mean = 0.5 * (u.tau_Nm + s.tau_last_Nm)
        wanted = ca.fmax(u.tau_set_Nm * moved, 0.0)
        moving = 0.5 * self.J * u.omega_motor_rad_s * u.omega_motor_rad_s
        moving = label("moving_J", ca.if_else(now.seen, moving, s.moving_J), "the drive's own")
        # Unseen, the most counts: the motor's work by the torque that there can have been since the
        # last sample, and what the drive's own motion has lost.
        worked = self.by_v_J_Nm * s.v_Nm - self.by_most_J_Nm * s.most_Nm
        unseen = label("unseen_J", worked + ca.fmax(s.moving_J - moving, 0.0), "at most")
        given = label(
            "given_J",
            clip(
                s.given_J + ca.if_else(now.going, mean * moved - wanted, unseen),
                0.0,
                self.given_lim,
            ),
            "[pas 4] beyond what the wanted torque gives",
        )
        base = given + moving + self.by_lag_J_Nm * s.v_Nm
        held = label("held_J", base + self.by_rate_J_Nm * s.most_Nm, "[pas 5]")
        most = label(
            "open_Nm", ca.fmax((c.energy_J - base) * self.open_Nm_J, 0.0), "[pas 6] largest command"
        )
        most = ca.fmin(most, self.u_lim)
        next_state = {
            "given_J": given,
            "moving_J": moving,
            "theta_motor_last_rad": u.theta_motor_rad,
            "tau_last_Nm": u.tau_Nm,
        }
        let = clip(u.u_command_Nm, -most, most)
        return next_state, SimpleNamespace(u_Nm=let, held_J=held)


EQUATIONS = """
    [pas 1] | e | tau_e - tau_w - K_d * omega_l | torque beyond what is wanted
    [pas 2] | b_felt | -P / N | damping that the hand feels, by the error
    [pas 3] | b' | (gamma * (P + b_0 * N) + (b_1 - b) * n_0 / T_r) / (N + n_0) | \
        damping that is added, between 0 and b_1
    [pas 4] | E | Max(0, E + tau_e * Delta_theta_m - Max(0, tau_w * Delta_theta_m)) | \
        energy that was given
    [pas 5] | V | E + J * omega_m**2 / 2 + Omega * n * T * v + Omega * n * h * kappa * m | \
        given, and what may still follow
    [pas 6] | u_most | (E_m - E - J * omega_m**2 / 2 - Omega * n * T * v) \
        / (Omega * n * h * (1 + epsilon + kappa)) | largest command let by
"""


def _bad_coefficients(block: Block, dtype: np.dtype[Any], rng: np.random.Generator) -> list[Stream]:
    cases = coefficient_edges(block, dtype)
    cases.append({p.name: float("nan") for p in block.coefficients})
    each = 8
    count = each * len(cases)
    inputs = {p.name: single(rng.uniform(0.5 * p.low, 0.5 * p.high, count)) for p in block.inputs}
    inputs["mode"] = np.repeat(np.arange(len(cases)) % 3, each).astype(float)
    for name in ("sensing_ok", "request_ok"):
        inputs[name] = np.ones(count)
    changes: dict[int, dict[str, Array]] = {
        k * each: {name: np.array([v]) for name, v in case.items()} for k, case in enumerate(cases)
    }
    return [Stream("coefficients out of their ranges", inputs, {}, changes)]


STREAMS = OwnStreams(memories=_bad_coefficients)
