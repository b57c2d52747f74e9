"""Torque of the person on the load side: first-order lag (5.10), and extended-state observer."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.designed import observer_model
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import (
    Array,
    Flag,
    Port,
    around,
    clip,
    f32_inside,
    status_port,
    threshold,
)
from esea_gen.language.stream import OwnStreams, Stream, single
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of
from esea_gen.observe.disturbance import bandwidth_tunable, share_of

# The decay of the torque's rate may be tuned by this factor either way.
DECAY_FACTOR = 5.0
# Slowest error mode that a set of gains may have, as a share of a step: 1 is the border.
SLOWEST_POLE = 0.9999


LAG_EQUATIONS = """
    (5.3) | J_h omega_l' | tau_e + tau_h | load side
    (5.10) | tau_h,k | tau{h,k-1} + (1 - exp(-L * h)) \
        * (J_h * (omega{l,k} - omega{l,k-1}) / h - tau_e - tau{h,k-1}) | \
        torque of the person: a lag of bandwidth L
"""
EQUATIONS = """
    [eso 1] | nu | theta_enc - theta_l | innovation
    [eso 2] | theta_l | theta_l + l_1 * nu | angle, corrected
    [eso 3] | omega_l | omega_l + l_2 * nu | rate, corrected
    [eso 4] | tau_h | tau_h + l_3 * nu | torque of the person, corrected
    [eso 5] | rho | rho + l_4 * nu | its rate, corrected
    [eso 6] | theta_l,k+1 | theta_l + h * omega_l + h**2 * (tau_e + tau_h) / (2 * J_h) | prediction
    [eso 7] | omega_l,k+1 | omega_l + h * (tau_e + tau_h) / J_h | prediction (5.3)
    [eso 8] | tau_h,k+1 | tau_h + T_d * (1 - exp(-h / T_d)) * rho | prediction
    [eso 9] | rho_k+1 | exp(-h / T_d) * rho | prediction
"""


# In float32 an increment below half a unit in the last place is lost: the estimate stops short of
# its end by up to 2^-25 of its size over L h: at 0.25 1/s and 1 kHz 1.2e-4 of the torque.
def lag_observer(device: DeviceData) -> Block:
    """Torque of the person in momentum form, a first-order lag (5.10)."""
    return Block.of(_Lag(device))


class _Lag:
    def __init__(self, device: DeviceData) -> None:
        self.drive = drive_of(device)
        self.h = device.period_s
        self.inertia = self.drive.joint.Jh_kgm2.value
        self.tau_lim, self.tau_h_lim = self.drive.tau_Nm, self.drive.tau_h_Nm
        self.omega_lim = self.drive.omega_rad_s
        self.name = "human_lag"
        self.title = "Torque of the person: first-order lag"
        self.constants = device.constants("joint")
        self.equations = equations(LAG_EQUATIONS)
        self.coefficients = (
            Port("share", 0.0, 1.0, "share taken up in a step", equation="(5.10)"),
        )
        clipped = "the estimate was clipped at its range"
        self.outputs = (
            around("tau_h_Nm", self.tau_h_lim, "torque of the person", equation="(5.10)"),
            status_port(
                "status of this estimate",
                "an input was NaN or outside its range; tau_h is held",
                "the state was corrupt; the observer was restarted",
                Flag("CLIPPED", clipped, True, ("tau_h_Nm",), self.tau_h_lim),
            ),
        )
        rates = self.drive.disturbance.human_1_s, self.drive.joint.load_velocity_Hz
        keys = "disturbance.human_1_s", "joint.load_velocity_Hz"
        self.tunables = (bandwidth_tunable(device, *rates, *keys),)
        self.state = (
            Port.flag("primed", "1 when the last sample was valid"),
            around("omega_last_rad_s", self.omega_lim, "load side's rate, last step"),
            around("tau_last_Nm", self.tau_lim, "interaction torque, last step"),
            around("tau_h_Nm", self.tau_h_lim, "torque of the person", equation="(5.10)"),
        )
        rate, torque = "load side's rate", "interaction torque on the load"
        self.inputs = (
            around("omega_load_rad_s", self.omega_lim, rate, on_invalid="omega_last_rad_s"),
            around("tau_Nm", self.tau_lim, torque, on_invalid="tau_last_Nm"),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return {"share": share_of(t.bandwidth_1_s, self.h)}

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        ok = guard.inputs_ok
        ready = label("ready", ca.logic_and(ok, s.primed), "two valid samples in a row")
        rise = (u.omega_load_rad_s - s.omega_last_rad_s) * (self.inertia / self.h)
        model = label("model_Nm", 0.5 * (u.tau_Nm + s.tau_last_Nm), "(5.3) mean over the step")
        moved = s.tau_h_Nm + c.share * (rise - model - s.tau_h_Nm)
        tau_h = ca.if_else(ready, clip(moved, -self.tau_h_lim, self.tau_h_lim), s.tau_h_Nm)
        tau_h = label("tau_h_Nm", tau_h, "(5.10)")
        next_state = {
            "primed": ok,
            "omega_last_rad_s": u.omega_load_rad_s,
            "tau_last_Nm": u.tau_Nm,
            "tau_h_Nm": tau_h,
        }
        outputs = {
            "tau_h_Nm": tau_h,
            "status": guard.status(ca.logic_and(ready, ca.fabs(moved) > self.tau_h_lim)),
        }
        return next_state, outputs


def error_matrix(device: DeviceData, decay_s: float | None = None) -> Array:
    """How the extended-state observer's error goes on from step to step."""
    drive = drive_of(device)
    d = drive.disturbance
    decay = d.decay_s.value if decay_s is None else decay_s
    model = observer_model(device.period_s, drive.joint.Jh_kgm2.value, decay)
    gains = (d.gain_theta, d.gain_omega_1_s, d.gain_tau_Nm_rad, d.gain_rate_Nm_s_rad)
    correction = np.eye(4)
    correction[:, 0] -= [g.value for g in gains]
    return np.asarray(correction @ model)


# Angle, rate, torque of the person, and its rate, which decays.  Without a valid angle it predicts
# only. The predicted angle has room beyond the port's range, which a valid sample never uses up;
# without samples it may rest at the end of that room, and a flag says so.
def extended_state(device: DeviceData) -> Block:
    """Torque of the person, its rate, and the load side's motion, by an extended-state observer."""
    return Block.of(_ExtendedState(device))


def _check_gains(device: DeviceData, decays_s: tuple[float, ...]) -> None:
    for value in decays_s:
        slowest = float(np.max(np.abs(np.linalg.eigvals(error_matrix(device, value)))))
        if slowest > SLOWEST_POLE:
            raise UserError(
                f"{device.origin}: disturbance.gain_...: with a decay of {value:g} s an error of "
                f"the extended-state observer is multiplied by {slowest:.5f} a step; the limit is "
                f"{SLOWEST_POLE:g}.",
                "Raise gain_theta and gain_omega_1_s or lower gain_tau_Nm_rad and "
                "gain_rate_Nm_s_rad.",
            )


class _ExtendedState:
    def __init__(self, device: DeviceData) -> None:
        self.drive = drive_of(device)
        d = self.drive.disturbance
        self.h, self.inertia = device.period_s, self.drive.joint.Jh_kgm2.value
        self.tau_lim, self.tau_h_lim = self.drive.tau_Nm, self.drive.tau_h_Nm
        self.omega_lim = self.drive.omega_rad_s
        self.decay = d.decay_s
        self.decay_low = self.decay.value / DECAY_FACTOR
        self.decay_high = self.decay.value * DECAY_FACTOR
        _check_gains(device, (self.decay_low, self.decay.value, self.decay_high))
        self.gain = {
            "theta": d.gain_theta.value,
            "omega": d.gain_omega_1_s.value,
            "tau": d.gain_tau_Nm_rad.value,
            "rate": d.gain_rate_Nm_s_rad.value,
        }
        # What the largest torque could rise by within the shortest decay.
        self.rate_lim = threshold(2 * self.tau_h_lim / self.decay_low)
        # Predictions lie beyond what is given out by at most a step of the fastest motion.
        most = self.h * (self.tau_lim + self.tau_h_lim) / self.inertia
        self.omega_room = threshold(1.001 * (self.omega_lim + most))
        self.tau_room = threshold(1.001 * (self.tau_h_lim + self.h * self.rate_lim))
        low, high = self.drive.theta_low_rad, self.drive.theta_high_rad
        # A valid sample takes back the share gain_theta of what the angle lies beyond its range,
        # and a step adds at most `moved`: what lies within `room` then stays there unclipped.
        moved = self.h * (self.omega_lim + 0.5 * most)
        room = min(1.01 * moved / max(self.gain["theta"], 1e-9), high - low)
        self.theta_low, self.theta_high = f32_inside(low - room, high + room)
        self._ports(device)

    def _ports(self, device: DeviceData) -> None:
        self.name = "human_eso"
        self.title = "Torque of the person: extended-state observer"
        self.constants = (
            *device.constants("joint"),
            *(k for k in device.constants("disturbance") if k.name.startswith("gain_")),
        )
        self.coefficients = (
            Port("keep", 0.0, 1.0, "share of the torque's rate kept in a step"),
            Port("reach_s", 0.0, self.h, "torque gained in a step, per rate"),
        )
        self.facts = {"theta_load_est_rad": (self.theta_low, self.theta_high)}
        self.equations = equations(EQUATIONS)
        self.streams = STREAMS
        text = "decay of the torque's rate: longer trusts a rate longer and overshoots more"
        self.tunables = (self.decay.tunable("decay_s", self.decay_low, self.decay_high, text),)
        self.state = (
            Port.flag("primed", "1 once a valid sample has been seen"),
            Port("theta_rad", self.theta_low, self.theta_high, "predicted angle"),
            around("omega_rad_s", self.omega_room, "predicted rate"),
            around("tau_h_Nm", self.tau_room, "predicted torque"),
            around("rate_Nm_s", self.rate_lim, "predicted rate of the torque"),
            around("tau_last_Nm", self.tau_lim, "interaction torque, last step"),
        )
        ends = self.drive.theta_low_rad, self.drive.theta_high_rad
        torque = "interaction torque on the load"
        self.inputs = (
            Port("theta_load_rad", *ends, "load side's angle", on_invalid="theta_rad"),
            around("tau_Nm", self.tau_lim, torque, on_invalid="tau_last_Nm"),
        )
        ends = self.theta_low, self.theta_high
        unseen = "an input was NaN or outside its range; the observer predicts without correction"
        past = "the angle was predicted past its range, without a valid sample; it rests there"
        clipped = (
            ("OMEGA", "load side's rate", "omega_load_rad_s", self.omega_lim),
            ("TORQUE", "torque of the person", "tau_h_Nm", self.tau_h_lim),
            ("TORQUE_RATE", "rate of that torque", "tau_h_rate_Nm_s", self.rate_lim),
        )
        self.outputs = (
            around("tau_h_Nm", self.tau_h_lim, "torque of the person"),
            around("tau_h_rate_Nm_s", self.rate_lim, "rate of that torque"),
            around("omega_load_rad_s", self.omega_lim, "load side's rate"),
            Port("theta_load_est_rad", *ends, "load side's angle, corrected"),
            status_port(
                "status of this estimate",
                unseen,
                "the state was corrupt; the observer was restarted",
                *(
                    Flag(
                        f"{word}_CLIPPED", f"the {what} was clipped at its range", True, (n,), most
                    )
                    for word, what, n, most in clipped
                ),
                Flag("ANGLE_CLIPPED", past, True),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        keep = ca.exp(-self.h / t.decay_s)
        return {"keep": keep, "reach_s": t.decay_s * (1 - keep)}

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        seen = guard.inputs_ok
        predicted = ca.if_else(s.primed, s.theta_rad, u.theta_load_rad)
        innovation = ca.if_else(seen, u.theta_load_rad - predicted, 0)
        text = "encoder less prediction; 0 without a valid sample"
        innovation = label("innovation_rad", innovation, text)
        theta = predicted + self.gain["theta"] * innovation
        theta = label("theta_load_est_rad", theta, "corrected")
        omega_raw = s.omega_rad_s + self.gain["omega"] * innovation
        tau_raw = s.tau_h_Nm + self.gain["tau"] * innovation
        rate_raw = s.rate_Nm_s + self.gain["rate"] * innovation
        omega = clip(omega_raw, -self.omega_lim, self.omega_lim)
        omega = label("omega_load_rad_s", omega, "corrected")
        tau_h = label("tau_h_Nm", clip(tau_raw, -self.tau_h_lim, self.tau_h_lim), "corrected")
        rate = label("tau_h_rate_Nm_s", clip(rate_raw, -self.rate_lim, self.rate_lim), "corrected")
        acceleration = (u.tau_Nm + tau_h) * (1 / self.inertia)
        acceleration = label("acceleration_rad_s2", acceleration, "(5.3)")
        start = ca.logic_or(s.primed, seen)
        following = theta + self.h * (omega + 0.5 * self.h * acceleration)
        following = label("theta_next_rad", following, "[eso 6]")
        above, below = following > self.theta_high, following < self.theta_low
        # An angle that rests at an end has no rate towards that end.
        omega_next = omega + self.h * acceleration
        omega_next = ca.if_else(above, ca.fmin(omega_next, 0), omega_next)
        omega_next = ca.if_else(below, ca.fmax(omega_next, 0), omega_next)
        next_state = {
            "primed": start,
            "theta_rad": clip(following, self.theta_low, self.theta_high),
            "omega_rad_s": ca.if_else(start, omega_next, 0),
            "tau_h_Nm": ca.if_else(start, tau_h + c.reach_s * rate, 0),
            "rate_Nm_s": ca.if_else(start, c.keep * rate, 0),
            "tau_last_Nm": u.tau_Nm,
        }
        outputs = {
            "tau_h_Nm": tau_h,
            "tau_h_rate_Nm_s": rate,
            "omega_load_rad_s": omega,
            "theta_load_est_rad": theta,
            "status": guard.status(
                ca.fabs(omega_raw) > self.omega_lim,
                ca.fabs(tau_raw) > self.tau_h_lim,
                ca.fabs(rate_raw) > self.rate_lim,
                ca.logic_or(above, below),
            ),
        }
        return next_state, outputs


# Share of the largest rate and of the largest torque that an ordinary motion takes.
SHARE = 0.3
REST = 200
# Distances from an end at which the joint rests, rad: the end itself, and less than a step away.
BESIDE_rad = (2e-3, 5e-4, 3e-4, 1e-4, 0.0)


def _ramp(a: float, b: float, steps: int) -> Array:
    # Smooth to its third derivative, so that the torque's rate has no steps either.
    x = np.linspace(0.0, 1.0, steps)
    return a + (b - a) * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)


def _numbers(block: Block) -> tuple[Port, Port, int]:
    # Angle and torque, and how many steps a sweep over the whole range takes.
    theta, tau = block.inputs
    outputs = {p.name: p for p in block.outputs}
    width = theta.high - theta.low
    inertia = next(c.value for c in block.constants if c.name == "Jh_kgm2")
    fastest = SHARE * outputs["omega_load_rad_s"].high
    strongest = SHARE * outputs["tau_h_Nm"].high / inertia
    # Largest rate and acceleration of `_ramp` over a time of 1: 35/16, and 7.513.
    time_s = max(35 / 16 * width / fastest, (7.6 * width / strongest) ** 0.5)
    return theta, tau, round(time_s / block.period_s)


def _moves(ends: Sequence[float], steps: int, width: float) -> Array:
    # From each end to the next, as fast as a sweep over the whole range, with a rest after it.
    parts = [np.full(REST, ends[0])]
    for a, b in pairwise(ends):
        parts += [_ramp(a, b, max(REST, round(steps * abs(b - a) / width))), np.full(REST, b)]
    return np.concatenate(parts)


def _within(port: Port, values: Array) -> Array:
    return np.clip(single(values), port.low, port.high)


def _events(block: Block, _rng: np.random.Generator) -> list[Stream]:
    theta, tau, sweep = _numbers(block)
    low, high, width = theta.low, theta.high, theta.high - theta.low
    ends = [0.5 * (low + high), *(high - x for x in BESIDE_rad), *(low + x for x in BESIDE_rad)]
    angles = _within(theta, _moves(ends, sweep, width))
    ordinary = Stream("sweeps and rests at the ends", {theta.name: angles})
    # At a steady rate towards each end, and no samples from the middle on, for longer than the way
    # takes: the angle is predicted on, past the end.
    ways = [np.linspace(a, b, sweep) for a, b in ((low, high), (high, low))]
    unseen = _within(theta, np.concatenate([x for w in ways for x in (w, np.full(REST, w[-1]))]))
    for start in (sweep // 2, sweep + REST + sweep // 2):
        unseen[start : start + sweep // 2 + REST // 2] = np.nan
    coasting = Stream(
        "unseen past the ends", {theta.name: unseen, tau.name: np.zeros(len(unseen))}, rough=True
    )
    wave = 0.2 * min(tau.high, next(p.high for p in block.outputs if p.name == "tau_h_Nm"))
    t = np.arange(ordinary.steps)
    ordinary.inputs[tau.name] = single(wave * np.sin(2 * np.pi * t / 3000) ** 3)
    return [ordinary, coasting]


STREAMS = OwnStreams(events=_events)
