"""Inverse of the elastomer model: desired torque in, deflection set-point out (thesis chapter 4).

The exact inverse is a finite method, not an iteration, and carries the model by calling the
sensor's kernel.  The torque is a strictly increasing function of the deflection beyond the dead
zone: a cubic, a Maxwell term that is linear until its clip, and stop operators that are linear
until they saturate, in the order of their thresholds, because play states with a common history
are nested, ``|F_i - F_(i-1)| <= r_i - r_(i-1)``.  So sums that are carried along give the torque
at each of N breakpoints, the request finds its segment, and ``k3 x^3 + a x = d`` one real
root.  One Newton step, on the torque written out in moves, takes the rounding of the closed form
away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, Solved, StepResult
from esea_gen.language.ports import Flag, Port, around, clip, flag_word, status_port, threshold
from esea_gen.model.cubic import cubic_root, root_facts, segment_equations
from esea_gen.model.elastomer import BEYOND, DEAD_ZONE, K1, K3, TAU_S, THETA, stop_grid
from esea_gen.model.forward import (
    REQUEST_ROOM,
    Forward,
    name_values,
    rate_facts,
    rate_split,
    request_port,
)
from esea_gen.model.plays import NESTING_ROOM_RAD, STREAMS
from esea_gen.model.published_inverse import published_inverse
from esea_gen.model.set_rate import SetRate
from esea_gen.model.symbolic import to_casadi

# Bandwidth of the exact inverse's own observer: the largest the velocity Block allows.
BANDWIDTH_HZ = 100.0

# Residual above which the exact inverse says it has not converged, as a share of the torque limit:
# far above float32 rounding (4e-7 of it).
RESIDUAL_SHARE = 5e-6


def _exact_status(device: DeviceData, theta_high: float, omega_high: float) -> Port:
    d = device.file.domain
    theta, omega = ("theta_rad",), ("omega_mid_rad_s",)
    outside, faster = "|set-point| is outside", "|rate of the set-point| is outside"
    short = "the request cannot be reached; the set-point stands at its limit"
    jumps = (
        "the set-point jumps by more than its rate allows, or the memory of its rate or of the "
        "model's rate torque is at its range; clipped"
    )
    missed = "the model's torque at the set-point misses the request"
    most_Nm = threshold(RESIDUAL_SHARE * device.file.limits.tau_Nm.value)
    why = (
        "the inverse is exact: from 60 000 memories of the model its residual stayed below 1e-14 "
        "Nm in f64"
    )
    theta_most, omega_most = threshold(d.theta_max_rad.value), threshold(d.omega_max_rad_s.value)
    step_most = threshold(omega_high * device.period_s)
    return status_port(
        "status of this set-point",
        "an input was NaN or outside its range; the set-point is held",
        "the state was corrupt; the model was restarted",
        Flag("THETA_OUTSIDE", f"{outside} the identified domain", False, theta, theta_most),
        Flag("RATE_OUTSIDE", f"{faster} the identified domain", False, omega, omega_most),
        Flag("TORQUE_OUTSIDE", "|request| is above full scale"),
        Flag("REQUEST_CLAMPED", short, True, theta, theta_high),
        Flag("STEP_CLIPPED", jumps, True, ("step_rad",), step_most),
        Flag("NOT_CONVERGED", missed, True, ("residual_Nm",), most_Nm, why),
    )


def exact_inverse(device: DeviceData) -> Block:
    """The exact inverse of the discrete torque sensor, with the sensor's own state."""
    return Block.of(_Exact(device))


class _Exact:
    def __init__(self, device: DeviceData) -> None:
        file = device.file
        self.h = device.period_s
        self.forward = Forward(device)
        self.values: dict[str, Any] = {c.name: c.value for c in device.constants("elastomer")}
        self.stops = int(device.elastomer.stops.value)
        self.r, self.w = (list(map(float, x)) for x in stop_grid(self.values, self.stops))
        self.k1, self.k3 = self.values["k1_Nm_rad"], self.values["k3_Nm_rad3"]
        if self.k1 <= 0:
            raise UserError(
                f"{device.origin}: elastomer.k1_Nm_rad = 0: the torque has no unique inverse.",
                "Give a positive linear stiffness.",
            )
        self.dead_zone = threshold(self.values.get("dead_zone_rad", 0.0))
        theta_port, omega_port = self.forward.block.inputs
        self.theta_high, self.omega_high = theta_port.high, omega_port.high
        self.tau_lim = self.tau_high = threshold(file.limits.tau_Nm.value)
        self.step_max = threshold(file.limits.omega_rad_s.value * self.h)
        # The gaps are all equal, r_i = omega i; squares save the magnitudes.
        self.nesting = float(np.float32((self.r[0] + NESTING_ROOM_RAD) ** 2))
        self.known = _exact_status(device, self.theta_high, file.limits.omega_rad_s.value)
        self.limit = {f.name: f.threshold for f in self.known.flags}
        self.tau_domain = threshold(file.domain.tau_full_scale_Nm.value)
        self.set_rate = SetRate(device, BANDWIDTH_HZ)
        self.name = "inverse"
        self.title = "Exact inverse of the torque sensor: desired torque to deflection set-point"
        self.constants = device.constants("elastomer") + device.constants("domain")
        self.tunables = self.set_rate.tunables
        self.coefficients = self.set_rate.coefficients
        self.prepare = self.set_rate.prepare
        # The called kernels guard their own state: these checks and theirs are then shared.
        self.state = tuple(
            replace(p, repair="block") for p in self.forward.state + self.set_rate.state
        )
        self.inputs = (request_port(self.tau_lim),)
        self.equations = segment_equations()
        self.facts = _exact_facts(device, self.forward, self.values, self.w)
        self.split = rate_split(self.forward, "omega_mid_rad_s")
        # The torque rises by k1 at least with the deflection beyond the dead zone, as every other
        # part of it rises or stays: a small residual means a set-point near the exact one.
        jump = 2 * float(self.dead_zone)
        by = Solved("residual_Nm", self.limit["NOT_CONVERGED"], self.k1, jump)
        self.solved = {"set_point_rad": by}
        self.streams = STREAMS
        room = REQUEST_ROOM * self.tau_lim
        self.outputs = (
            around("theta_rad", self.theta_high, "deflection set-point"),
            around("omega_mid_rad_s", self.omega_high, "rate used for the viscous torque"),
            around("tau_model_Nm", self.tau_lim, "the model's torque at the set-point"),
            around("residual_Nm", 2 * room, "request minus the model's torque"),
            around("step_rad", 2 * self.theta_high, "move of the set-point in this step"),
            self.known,
        )

    def beyond(self, theta: Any) -> ca.SX:
        if not self.dead_zone:
            return ca.SX(theta)
        return to_casadi(BEYOND, {THETA: theta, DEAD_ZONE: self.dead_zone})

    def deflection(self, delta: ca.SX) -> ca.SX:
        theta = delta + self.dead_zone * ca.sign(delta) if self.dead_zone else delta
        return clip(theta, -self.theta_high, self.theta_high)

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        nested = self.play_nested(s, label)
        primed = label("ready", ca.logic_and(guard.state_ok, ca.logic_and(s.primed, nested)))
        sound = ca.logic_and(guard.state_ok, nested)
        state = self.forward.of(s) | {"primed": primed}
        if self.forward.has_rate:
            state["tau_r_Nm"] = ca.if_else(primed, s.tau_r_Nm, 0)

        omega = label("omega_mid_rad_s", self.set_rate.predict(c, s, primed), "free of theta(k)")
        known = self.forward.step(state, 0, omega)  # what the model knows before theta(k)
        theta_last = label("theta_from_rad", known["label_theta_last_rad"], "theta(k-1)")
        last = self.beyond(theta_last)
        request = label(
            "request_Nm", clip(u.tau_Nm, -self.tau_high, self.tau_high), "clamped request"
        )
        slope, relaxed = self.rate_slope(state, known, label)
        turn = self.direction(s, primed, last, request, relaxed, label)
        start = label("start_rad", turn * last, "along the move")
        play = [label(f"turned_{i + 1}_rad", turn * s.play_rad[i]) for i in range(self.stops)]
        load = label("pull_Nm", turn * (request - relaxed))
        turned = label("turned_request_Nm", turn * request), label("turned_Nm", turn * relaxed)
        reach, stiff, load = self.rate_clip(start, play, load, slope, turned[1], label)
        linear, constant = self.segment(play, stiff, load, label)
        linear = label("linear_Nm_rad", ca.if_else(primed, linear, self.k1), "a of the segment")
        constant = label("load_Nm", ca.if_else(primed, constant, turned[0]), "d of the segment")
        root = cubic_root(self.k3, linear, constant, label)
        root = label("root_rad", turn * root, "k3 x^3 + a x = d")
        near = label("near_rad", turn * clip(root, -self.theta_high, self.theta_high))
        move = label("move_rad", ca.fmin(near - start, reach))
        rated = turned[1] + slope * move
        better = self.newton(near, play, linear, turned[0], (primed, rated), label)
        refined = label("refined_rad", turn * better, "one Newton step")
        solved = self.deflection(refined)
        theta = label(
            "set_point_rad", ca.if_else(guard.inputs_ok, solved, theta_last), "invalid input: hold"
        )
        end = self.forward.step(state, theta, omega)
        name_values(self.forward.block, "model", end, label)
        tau = end["label_tau_Nm"]
        residual = label("residual_Nm", u.tau_Nm - tau)
        moved = ca.if_else(primed, self.beyond(theta) - last, 0)
        outside = ca.fabs(refined) > self.theta_high - self.dead_zone
        clamped = ca.logic_or(ca.fabs(u.tau_Nm) > self.tau_high, outside)
        missed = ca.logic_and(
            ca.fabs(residual) > self.limit["NOT_CONVERGED"], ca.logic_not(clamped)
        )
        clipped = self.set_rate.clipped(c, s, primed, theta)
        if self.forward.has_rate:
            clipped = ca.logic_or(clipped, self.forward.clipped(end))
        label("memory_clipped", clipped, "of the set-point's rate, or of the model's rate torque")
        status = flag_word(
            [
                ca.logic_not(guard.inputs_ok),
                ca.logic_not(sound),
                ca.fabs(theta) > self.limit["THETA_OUTSIDE"],
                ca.fabs(omega) > self.limit["RATE_OUTSIDE"],
                ca.fabs(u.tau_Nm) > self.tau_domain,
                ca.logic_and(guard.inputs_ok, clamped),
                ca.logic_or(ca.fabs(moved) > self.step_max, clipped),
                ca.logic_and(guard.inputs_ok, missed),
            ]
        )
        next_state = {p.name: end[f"next_{p.name}"] for p in self.forward.state}
        next_state |= self.set_rate.advance(c, s, primed, theta, label)
        next_state["primed"] = ca.logic_or(primed, guard.inputs_ok)
        room = REQUEST_ROOM * self.tau_lim
        outputs = {
            "theta_rad": theta,
            "omega_mid_rad_s": omega,
            "tau_model_Nm": clip(tau, -self.tau_high, self.tau_high),
            "residual_Nm": clip(residual, -2 * room, 2 * room),
            "step_rad": moved,
            "status": status,
        }
        return next_state, outputs

    def play_nested(self, s: Any, label: Labels) -> ca.SX:
        """Whether the play states have a common history; any other were never this model's."""
        gaps = [s.play_rad[0] - self.beyond(s.theta_prev_rad)]
        gaps += [s.play_rad[i] - s.play_rad[i - 1] for i in range(1, self.stops)]
        widest: Any = 0
        for i, gap in enumerate(gaps):
            widest = ca.fmax(widest, label(f"gap_{i + 1}_rad2", gap**2)) if i else gap**2
        return label("nested", widest <= self.nesting, "|F_i - F_i-1| <= r_i - r_i-1")

    def rate_slope(
        self, state: Mapping[str, Any], known: Mapping[str, ca.SX], label: Labels
    ) -> tuple[ca.SX, ca.SX]:
        """Of the Maxwell element: its slope over theta(k) (3.3), its torque if nothing moves."""
        if not self.forward.has_rate:
            return ca.SX(0), ca.SX(0)
        share = label("rate_share", known["label_share"], "(1 - exp(-x))/x, third order")
        slope = self.values["kv_Nm_rad"] * share
        slope = label("rate_slope_Nm_rad", slope, "(3.3) d tau_r / d theta(k)")
        relaxed = state["tau_r_Nm"] * known["label_decay"]
        return slope, label("relaxed_Nm", relaxed, "tau_r if nothing moves")

    def direction(
        self, s: Any, primed: ca.SX, last: ca.SX, request: ca.SX, relaxed: ca.SX, label: Labels
    ) -> ca.SX:
        """1 or -1: turns the axis so that the set-point moves upwards from the last one."""
        total = ca.SX(0)
        for i in range(self.stops):
            total = total + self.w[i] * s.play_rad[i]
        rest = to_casadi(sp.horner(TAU_S, wrt=THETA), {THETA: last, K1: self.k1, K3: self.k3})
        rest = rest + relaxed + ca.if_else(primed, sum(self.w) * last - total, 0)
        label("rest_Nm", rest, "torque of no move")
        return label("turn", ca.if_else(request >= rest, 1.0, -1.0), "direction of the move")

    def rate_clip(
        self, start: Any, play: list[Any], load: Any, slope: Any, relaxed: Any, label: Labels
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The rate torque is linear up to its clip: how far, the stiffness, and the load on it."""
        reach: Any = self.step_max
        if self.forward.has_rate:
            reach = ca.fmin(reach, (self.tau_high - relaxed) / slope)
        edge = label("edge_rad", start + label("reach_rad", reach))
        there = (self.k3 * edge * edge + self.k1) * edge + slope * reach
        for i in range(self.stops):
            stop = self.w[i] * ca.fmin(edge - play[i], self.r[i])
            there = there + label(f"edge_{i + 1}_Nm", stop)
        label("edge_Nm", there)
        beyond_reach = label("beyond_reach", load > there, "the rate torque is at its clip")
        stiff = label("stiff_Nm_rad", self.k1 + ca.if_else(beyond_reach, 0, slope))
        load = load + slope * ca.if_else(beyond_reach, -reach, start)
        return reach, stiff, label("free_load_Nm", load)

    def segment(
        self, play: list[ca.SX], stiff: ca.SX, load: ca.SX, label: Labels
    ) -> tuple[ca.SX, ca.SX]:
        """[segment, breakpoint, a]: stiffness and load of the segment the request falls into."""
        # Torque at each breakpoint F_i + r_i, from the narrowest stop to the widest.
        held, behind, free = 0.0, ca.SX(0), float(sum(self.w))
        stop = [label(f"stop_{i + 1}_Nm", self.w[i] * play[i]) for i in range(self.stops)]
        for torque in stop:
            behind = behind + torque
        linear, constant = stiff, load
        for i in range(self.stops):
            held += self.w[i] * self.r[i]
            free -= self.w[i]
            behind = behind - stop[i] if i + 1 < self.stops else ca.SX(0)
            label(f"behind_{i + 1}_Nm", behind)
            corner = label(f"corner_{i + 1}_rad", play[i] + self.r[i])
            slope = self.k3 * corner * corner + (stiff + max(free, 0.0))
            slope = label(f"corner_{i + 1}_Nm_rad", slope)
            torque = slope * corner + held - behind
            label(f"corner_{i + 1}_Nm", torque)
            passed = label(f"passed_{i + 1}", load > torque, f"stop {i + 1} saturates")
            left = ca.if_else(passed, 0, self.w[i])
            linear = linear + label(f"left_{i + 1}_Nm_rad", left)
            taken = ca.if_else(passed, -self.w[i] * self.r[i], stop[i])
            constant = constant + label(f"taken_{i + 1}_Nm", taken)
        return linear, constant

    def newton(
        self, near: Any, play: list[Any], linear: Any, request: Any, moves: Any, label: Labels
    ) -> ca.SX:
        """One Newton step on the torque written out in moves, in which nothing cancels."""
        (primed, rated), taken = moves, ca.SX(0)
        for i in range(self.stops):
            stop = self.w[i] * ca.fmin(near - play[i], self.r[i])
            taken = taken + label(f"near_{i + 1}_Nm", stop)
        miss = request - (self.k3 * near * near + self.k1) * near
        miss = label("miss_Nm", miss - ca.if_else(primed, rated + taken, 0))
        tangent = 3 * self.k3 * near * near + linear
        tangent = label("tangent_Nm_rad", tangent, "d d / d x, at least a")
        better: ca.SX = near + miss / tangent
        return better


def _exact_facts(
    device: DeviceData, forward: Forward, values: Mapping[str, Any], w: Sequence[float]
) -> dict[str, tuple[float, float]]:
    # What algebra knows of the segment's cubic.  Its stiffness is k1, kv share or nothing, and the
    # weights, positive, of the stops that are not saturated.
    limits = device.file.limits
    theta = threshold(limits.theta_rad.value)
    kv = values["kv_Nm_rad"] if forward.has_rate else 0.0
    room = 1e-6  # for float32 numbers inside the limits and for the rounding of these very numbers
    low = values["k1_Nm_rad"] * (1 - room)
    high = (values["k1_Nm_rad"] + kv + sum(w)) * (1 + room)
    bend = 3 * values["k3_Nm_rad3"] * theta**2 * (1 + room)
    facts = {
        "linear_Nm_rad": (low, high),
        "tangent_Nm_rad": (low, high + bend),
        "set_point_rad": (-theta, theta),
    }
    if forward.has_rate:
        facts |= rate_facts(device, values, "omega_mid_rad_s")
    # Of the load: request and relaxed torque, the rate torque from zero or to its clip, and each
    # stop's threshold or play state, which is no further than that from the last deflection.
    load = 2 * limits.tau_Nm.value + kv * (theta + limits.omega_rad_s.value * device.period_s)
    for i, (a, r) in enumerate(zip(w, stop_grid(values, len(w))[0], strict=True)):
        load += a * (theta + r + (i + 1) * 2 * NESTING_ROOM_RAD)
    return facts | root_facts(values["k3_Nm_rad3"], (low, high), load * (1 + room))


def chosen_inverse(device: DeviceData) -> Block:
    asked = device.file.inverse
    if asked is None or asked.kind == "exact":
        return exact_inverse(device)
    return published_inverse(device, None if asked.filter == "none" else asked.filter)
