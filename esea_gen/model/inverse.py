"""Inverse of the elastomer model: desired torque in, deflection set-point out (thesis chapter 4).

Two Blocks.  :func:`exact_inverse` solves the discrete torque sensor itself for its deflection;
:func:`published_inverse` is the generalised play operator of the thesis with its disturbance
observer.  Both carry the forward model by calling the kernel of the sensor Block, so that model and
inverse are one set of equations, whatever the device file says.

The exact inverse is a finite method, not an iteration.  At each step the torque is a strictly
increasing function of the deflection beyond the dead zone, delta: a cubic, one Maxwell term that
is linear until its clip, and stop operators that are linear until they saturate.  Moving away from
the last deflection, the stops saturate in the order of their thresholds, because play states with a
common history are nested, ``|F_i - F_(i-1)| <= r_i - r_(i-1)``.  So the torque at each of the N
breakpoints needs only sums that are carried along, comparing it with the request finds the
segment, and the segment's equation ``k3 x^3 + a x = d`` has one real root in closed form.  One
Newton step, on the torque written out in moves, takes the rounding of the closed form away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, get_args

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, Solved
from esea_gen.language.ports import Constant, Flag, Port, Tunable, clip, flag_word, threshold
from esea_gen.language.system import System, Task
from esea_gen.model.elastomer import (
    BEYOND,
    DEAD_ZONE,
    K1,
    K3,
    TAU_S,
    THETA,
    stop_grid,
    torque_sensor,
)
from esea_gen.model.filters import tracking_observer
from esea_gen.model.plays import NESTING_ROOM_RAD, STREAMS
from esea_gen.model.symbolic import equation, to_casadi

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

Rate = Literal["observer", "extrapolated"]
FilterName = Literal["a", "a_normalised", "b", "b_normalised", "b_rounding"]

# Bandwidth of the exact inverse's own observer: the largest the velocity Block allows.
BANDWIDTH_HZ = 100.0
# A request may be this many times the torque limit and still be clamped instead of refused.
REQUEST_ROOM = 10.0
# Residual above which the exact inverse says it has not converged, as a share of the torque limit:
# far above float32 rounding (4e-7 of it).
RESIDUAL_SHARE = 5e-6

PLAYS = 10
PLAY_DEFAULTS = {"kappa_rad": 0.106, "phi_1_rad": 4.84, "chi_rad": 0.00233}  # table 4.2
FILTER_B = (0.024, 0.12, 0.23, 0.20, 0.0, -0.12, 0.0, 0.20, 0.23, 0.12, 0.024)
# Inside the rounding of the printed digits, and what reproduces the published tables.
KAPPA_ROUNDING_RAD, FILTER_B_ROUNDING_GAIN = 0.10635, 1.0165

LINEAR, LOAD = sp.symbols("a d", real=True)
HALF, THIRD, ROOT, RATIO = sp.symbols("b a_3 c q", positive=True)
KAPPA, PHI, CHI, PLAY_R, PLAY_J = sp.symbols("kappa phi chi r j", positive=True)
# Parts of the real root of k3 x^3 + a x = d, without the cancellation of (4.13) near zero.
ROOT_THIRD = LINEAR / (3 * K3)
ROOT_HALF = sp.Abs(LOAD) / (2 * K3)
ROOT_CUBE = HALF + sp.sqrt(THIRD**3 + HALF**2)
ROOT_RATIO = THIRD / ROOT
ROOT_SIZE = 2 * HALF / (ROOT**2 + THIRD + RATIO**2)
ROOT_WHOLE = ROOT_SIZE.subs(RATIO, ROOT_RATIO)
PLAY_WEIGHT = KAPPA * sp.exp(-PHI * PLAY_R)


def cubic_root(k3: float, linear: Any, load: Any, label: Labels | None = None) -> ca.SX:
    """Real root of ``k3 x^3 + linear x = load``, accurate near zero (4.13 without cancellation).

    Parameters
    ----------
    k3 : float
        Cubic stiffness, not negative.
    linear : float or casadi.SX
        Linear stiffness, above 0.
    load : casadi.SX
        Torque.
    label : Labels, optional
        Names the parts of the root, of which :func:`root_facts` knows the ranges.

    Returns
    -------
    casadi.SX
        The root; relative error below 2e-7 in float32.
    """
    if k3 == 0:
        return ca.SX(load / linear)
    third = to_casadi(ROOT_THIRD, {LINEAR: linear, K3: k3})
    half = to_casadi(ROOT_HALF, {LOAD: load, K3: k3})
    cube = to_casadi(ROOT_CUBE, {HALF: half, THIRD: third})
    root = ca.power(cube, 1.0 / 3.0)
    ratio = to_casadi(ROOT_RATIO, {THIRD: third, ROOT: root})
    if label is not None:
        if not ca.SX(third).is_constant():
            third = label("root_a_rad2", third, "[root 1] linear / (3 k3)")
        root = label("root_c_rad", root, "[root 3] at least sqrt(a)")
        ratio = label("root_ratio_rad", ratio, "a / c, at most sqrt(a)")
    size = to_casadi(ROOT_SIZE, {HALF: half, THIRD: third, ROOT: root, RATIO: ratio})
    if label is not None:
        size = label("root_size_rad", size, "(4.13), stable form")
    return ca.SX(ca.sign(load) * size)


def root_facts(
    k3: float, linear: tuple[float, float], load_high: float
) -> dict[str, tuple[float, float]]:
    """Ranges of the labelled parts of :func:`cubic_root`, which intervals cannot see.

    Parameters
    ----------
    k3 : float
        Cubic stiffness in Nm/rad^3, not negative.
    linear : (float, float)
        Least, above 0, and largest linear stiffness in Nm/rad.
    load_high : float
        Largest torque in Nm.

    Returns
    -------
    dict of str to (float, float)
        By label; empty without a cubic term.

    Notes
    -----
    With ``a = linear / (3 k3) > 0`` and ``b = |load| / (2 k3) >= 0`` the radicand of ``c`` is
    ``b + sqrt(a^3 + b^2) >= sqrt(a^3)``, so ``c >= sqrt(a)`` and ``a / c <= sqrt(a)``; ``c`` rises
    with both.  The torque ``k3 x^3 + linear x`` rises with ``x`` and with ``linear``: the root of
    the largest load at the least stiffness is the largest of all.
    """
    if k3 == 0:
        return {}
    low, high = (x / (3 * k3) for x in linear)
    half = load_high / (2 * k3)
    most = (half + (high**3 + half**2) ** 0.5) ** (1 / 3)
    least = (half + (low**3 + half**2) ** 0.5) ** (1 / 3)
    largest = 2 * half / (least**2 + low + (low / least) ** 2)
    room = 1e-9  # for the rounding of these very numbers
    known = {"root_a_rad2": (low * (1 - room), high * (1 + room))} if low < high else {}
    return known | {
        "root_c_rad": (low**0.5 * (1 - room), most * (1 + room)),
        "root_ratio_rad": (0.0, high**0.5 * (1 + room)),
        "root_size_rad": (0.0, largest * (1 + room)),
    }


def _call(function: ca.Function, values: Mapping[str, Any]) -> dict[str, ca.SX]:
    results = function.call([ca.SX(values[name]) for name in function.name_in()])
    return dict(zip(function.name_out(), results, strict=True))


class _Forward:
    """The sensor Block's kernel, called on symbols: the one place where the model comes in."""

    def __init__(self, device: DeviceData) -> None:
        self.block = torque_sensor(device)
        names = {p.name for p in self.block.state}
        self.state = self.block.state
        self.omega_high = self.block.inputs[1].high
        self.has_rate = "x" in {n for n, _ in self.block.labels}
        if names != {"primed", "theta_prev_rad", "tau_r_Nm", "play_rad"}:
            raise ValueError(f"the sensor's state {sorted(names)} is not what its inverse knows")

    def step(self, state: Mapping[str, Any], theta: Any, omega: Any) -> dict[str, ca.SX]:
        """Next state (``next_...``), outputs (``y_...``) and labelled values (``label_...``)."""
        values = {f"s_{k}": v for k, v in state.items()}
        values |= {"u_theta_rad": theta, "u_omega_rad_s": omega}
        return _call(self.block.labelled_step, values)

    def share(self, known: Mapping[str, ca.SX]) -> ca.SX:
        """(1 - exp(-x))/x of the Maxwell step, as the sensor has it: d tau_r / d theta over kv."""
        return known["label_share"]

    def of(self, s: SimpleNamespace) -> dict[str, Any]:
        """The model's part of a Block's state."""
        return {p.name: getattr(s, p.name) for p in self.state}


def _request_port(tau_lim: float) -> Port:
    room = REQUEST_ROOM * tau_lim
    return Port("tau_Nm", -room, room, "desired interaction torque", on_invalid=0.0)


def _exact_flags(device: DeviceData, theta_high: float, omega_high: float) -> tuple[Flag, ...]:
    d = device.file.domain
    held = "an input was NaN or outside its range; the set-point is held"
    afresh = "the state was corrupt; the model was started afresh"
    return (
        Flag("INPUT_INVALID", held, True),
        Flag("STATE_REPAIRED", afresh, True),
        Flag(
            "THETA_OUTSIDE",
            "|set-point| is outside the identified domain",
            False,
            ("theta_rad",),
            threshold(d.theta_max_rad.value),
        ),
        Flag(
            "RATE_OUTSIDE",
            "|rate of the set-point| is outside the identified domain",
            False,
            ("omega_mid_rad_s",),
            threshold(d.omega_max_rad_s.value),
        ),
        Flag("TORQUE_OUTSIDE", "|request| is above full scale"),
        Flag(
            "REQUEST_CLAMPED",
            "the request cannot be reached; the set-point stands at its limit",
            True,
            ("theta_rad",),
            theta_high,
        ),
        Flag(
            "STEP_CLIPPED",
            "the set-point jumps by more than its rate allows; the model's rate torque is clipped",
            True,
            ("step_rad",),
            threshold(omega_high * device.period_s),
        ),
        Flag(
            "NOT_CONVERGED",
            "the model's torque at the set-point misses the request",
            True,
            ("residual_Nm",),
            threshold(RESIDUAL_SHARE * device.file.limits.tau_Nm.value),
            "the inverse is exact: from 60 000 memories of the model its residual stayed below "
            "1e-14 Nm in f64",
        ),
    )


def exact_inverse(
    device: DeviceData, *, rate: Rate = "observer", bandwidth_Hz: float = BANDWIDTH_HZ
) -> Block:
    """The exact inverse of the discrete torque sensor as a Block.

    Parameters
    ----------
    device : DeviceData
        Parameters, domain, limits and rate.
    rate : {"observer", "extrapolated"}
        Where the rate that feeds the viscosity comes from; neither holds anything of theta(k).
        ``observer``: the velocity Block, run on the set-point.  ``extrapolated``: ``2 w(k-1) -
        w(k-2)`` of the set-point's differences w, which chatters at 500 Hz where the motion turns
        round; kept to show that (``docs/inverse.md``).
    bandwidth_Hz : float
        Default of the observer's tunable bandwidth, lowered to what the rate allows.  With the
        bandwidth of the device's velocity Block, sensor and inverse agree through their own rates.

    Returns
    -------
    Block
        Input ``tau_Nm``; outputs the set-point ``theta_rad``, the rate used ``omega_mid_rad_s``,
        the model's torque ``tau_model_Nm``, ``residual_Nm`` (request less model), the move
        ``step_rad`` of the deflection beyond the dead zone, and a status word.

    Raises
    ------
    UserError
        When the device's linear stiffness is 0: torque must rise with deflection everywhere.

    Notes
    -----
    Straight-line: one viscosity, N breakpoints, one cubic root, one Newton step and one run of the
    sensor, whatever the request.  Every state of the model and its clips are the sensor's, so that
    a sensor fed with the set-point and the rate used holds the same state, bit for bit.
    """
    file = device.file
    h = device.period_s
    forward = _Forward(device)
    values: dict[str, Any] = {c.name: c.value for c in device.constants("elastomer")}
    stops = int(file.elastomer.stops.value)
    r, w = (list(map(float, x)) for x in stop_grid(values, stops))
    k1, k3 = values["k1_Nm_rad"], values["k3_Nm_rad3"]
    if k1 <= 0:
        raise UserError(
            f"{device.origin}: elastomer.k1_Nm_rad = 0: the torque has no unique inverse.",
            "Give a positive linear stiffness.",
        )
    dead_zone = threshold(values.get("dead_zone_rad", 0.0))
    theta_port, omega_port = forward.block.inputs
    theta_high, omega_high = theta_port.high, omega_port.high
    tau_lim = tau_high = threshold(file.limits.tau_Nm.value)
    step_max = threshold(file.limits.omega_rad_s.value * h)
    # The gaps are all equal, r_i = omega i; squares save the magnitudes.
    nesting = float(np.float32((r[0] + NESTING_ROOM_RAD) ** 2))
    flags = _exact_flags(device, theta_high, file.limits.omega_rad_s.value)
    limit = {f.name: f.threshold for f in flags}
    tau_domain = threshold(file.domain.tau_full_scale_Nm.value)
    rate_source = _rate_source(device, rate, bandwidth_Hz)

    def beyond(theta: Any) -> ca.SX:
        if not dead_zone:
            return ca.SX(theta)
        return to_casadi(BEYOND, {THETA: theta, DEAD_ZONE: dead_zone})

    def deflection(delta: ca.SX) -> ca.SX:
        theta = delta + dead_zone * ca.sign(delta) if dead_zone else delta
        return clip(theta, -theta_high, theta_high)

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        # Play states with a common history are nested; any other were never this model's.
        widest = (s.play_rad[0] - beyond(s.theta_prev_rad)) ** 2
        for i in range(1, stops):
            widest = ca.fmax(widest, (s.play_rad[i] - s.play_rad[i - 1]) ** 2)
        nested = label("nested", widest <= nesting, "|F_i - F_i-1| <= r_i - r_i-1")
        primed = label("ready", ca.logic_and(guard.state_ok, ca.logic_and(s.primed, nested)))
        sound = ca.logic_and(guard.state_ok, nested)
        state = forward.of(s) | {"primed": primed}
        if forward.has_rate:
            state["tau_r_Nm"] = ca.if_else(primed, s.tau_r_Nm, 0)

        omega = label("omega_mid_rad_s", rate_source.predict(c, s, primed), "free of theta(k)")
        known = forward.step(state, 0, omega)  # what the model knows before theta(k)
        theta_last = label("theta_from_rad", known["label_theta_last_rad"], "theta(k-1)")
        last = beyond(theta_last)
        request = label("request_Nm", clip(u.tau_Nm, -tau_high, tau_high), "clamped request")

        if forward.has_rate:
            share = label("rate_share", forward.share(known), "(1 - exp(-x))/x, third order")
            slope = values["kv_Nm_rad"] * share
            slope = label("rate_slope_Nm_rad", slope, "(3.3) d tau_r / d theta(k)")
            relaxed = label(
                "relaxed_Nm", state["tau_r_Nm"] * known["label_decay"], "tau_r if nothing moves"
            )
        else:
            slope, relaxed = ca.SX(0), ca.SX(0)

        # Turn the axis so that the set-point moves upwards from the last one.
        total = ca.SX(0)
        for i in range(stops):
            total = total + w[i] * s.play_rad[i]
        rest = to_casadi(sp.horner(TAU_S, wrt=THETA), {THETA: last, K1: k1, K3: k3})
        rest = rest + relaxed + ca.if_else(primed, sum(w) * last - total, 0)
        turn = label("turn", ca.if_else(request >= rest, 1.0, -1.0), "direction of the move")
        start = turn * last
        load = turn * (request - relaxed)
        play = [turn * s.play_rad[i] for i in range(stops)]

        # The rate torque is linear up to its clip; is the request beyond it?
        reach: Any = step_max
        if forward.has_rate:
            reach = ca.fmin(reach, (tau_high - turn * relaxed) / slope)
        edge = start + reach
        there = (k3 * edge * edge + k1) * edge + slope * reach
        for i in range(stops):
            there = there + w[i] * ca.fmin(edge - play[i], r[i])
        beyond_reach = label("beyond_reach", load > there, "the rate torque is at its clip")
        stiff = k1 + ca.if_else(beyond_reach, 0, slope)
        load = load + slope * ca.if_else(beyond_reach, -reach, start)

        # Torque at each breakpoint F_i + r_i, from the narrowest stop to the widest.
        held, behind, free = 0.0, ca.SX(0), float(sum(w))
        for i in range(stops):
            behind = behind + w[i] * play[i]
        linear, constant = stiff, load
        for i in range(stops):
            held += w[i] * r[i]
            free -= w[i]
            behind = behind - w[i] * play[i] if i + 1 < stops else ca.SX(0)
            corner = play[i] + r[i]
            torque = (k3 * corner * corner + (stiff + max(free, 0.0))) * corner + held - behind
            passed = label(f"passed_{i + 1}", load > torque, f"stop {i + 1} saturates")
            linear = linear + ca.if_else(passed, 0, w[i])
            constant = constant + ca.if_else(passed, -w[i] * r[i], w[i] * play[i])
        linear = label("linear_Nm_rad", ca.if_else(primed, linear, k1), "a of the segment")
        constant = label(
            "load_Nm", ca.if_else(primed, constant, turn * request), "d of the segment"
        )
        root = cubic_root(k3, linear, constant, label)
        root = label("root_rad", turn * root, "k3 x^3 + a x = d")

        # One Newton step on the torque written out in moves, in which nothing cancels.
        near = turn * clip(root, -theta_high, theta_high)
        move = label("move_rad", ca.fmin(near - start, reach))
        taken = ca.SX(0)
        for i in range(stops):
            taken = taken + w[i] * ca.fmin(near - play[i], r[i])
        miss = turn * request - (k3 * near * near + k1) * near
        miss = miss - ca.if_else(primed, turn * relaxed + slope * move + taken, 0)
        tangent = label("tangent_Nm_rad", 3 * k3 * near * near + linear, "d d / d x, at least a")
        better = near + miss / tangent
        refined = label("refined_rad", turn * better, "one Newton step")
        solved = deflection(refined)
        theta = label(
            "set_point_rad", ca.if_else(guard.inputs_ok, solved, theta_last), "invalid input: hold"
        )
        end = forward.step(state, theta, omega)
        tau = end["label_tau_Nm"]
        residual = label("residual_Nm", u.tau_Nm - tau)
        moved = ca.if_else(primed, beyond(theta) - last, 0)
        outside = ca.fabs(refined) > theta_high - dead_zone
        clamped = ca.logic_or(ca.fabs(u.tau_Nm) > tau_high, outside)
        missed = ca.logic_and(ca.fabs(residual) > limit["NOT_CONVERGED"], ca.logic_not(clamped))
        status = flag_word(
            [
                ca.logic_not(guard.inputs_ok),
                ca.logic_not(sound),
                ca.fabs(theta) > limit["THETA_OUTSIDE"],
                ca.fabs(omega) > limit["RATE_OUTSIDE"],
                ca.fabs(u.tau_Nm) > tau_domain,
                ca.logic_and(guard.inputs_ok, clamped),
                ca.fabs(moved) > step_max,
                ca.logic_and(guard.inputs_ok, missed),
            ]
        )
        next_state = {p.name: end[f"next_{p.name}"] for p in forward.state}
        next_state |= rate_source.advance(c, s, primed, theta, theta_last)
        next_state["primed"] = ca.logic_or(primed, guard.inputs_ok)
        room = REQUEST_ROOM * tau_lim
        outputs = {
            "theta_rad": theta,
            "omega_mid_rad_s": omega,
            "tau_model_Nm": clip(tau, -tau_high, tau_high),
            "residual_Nm": clip(residual, -2 * room, 2 * room),
            "step_rad": moved,
            "status": status,
        }
        return next_state, outputs

    room = REQUEST_ROOM * tau_lim
    return Block.define(
        "inverse",
        "Exact inverse of the torque sensor: desired torque to deflection set-point",
        period_s=h,
        constants=device.constants("elastomer") + device.constants("domain"),
        tunables=rate_source.tunables,
        coefficients=rate_source.coefficients,
        prepare=rate_source.prepare,
        # The called kernels guard their own state: these checks and theirs are then shared.
        state=tuple(replace(p, repair="block") for p in forward.state + rate_source.state),
        inputs=(_request_port(tau_lim),),
        outputs=(
            Port("theta_rad", -theta_high, theta_high, "deflection set-point"),
            Port("omega_mid_rad_s", -omega_high, omega_high, "rate that feeds the viscosity"),
            Port("tau_model_Nm", -tau_lim, tau_lim, "the model's torque at the set-point"),
            Port("residual_Nm", -2 * room, 2 * room, "request less the model's torque"),
            Port("step_rad", -2 * theta_high, 2 * theta_high, "move of the set-point in this step"),
            Port("status", 0, 2 ** len(flags) - 1, "what is known of this set-point", flags=flags),
        ),
        equations=_exact_equations(),
        facts=_exact_facts(device, forward, values, w),
        split=_rate_split(forward, "omega_mid_rad_s"),
        # The torque rises by k1 at least with the deflection beyond the dead zone, as every other
        # part of it rises or stays: a small residual means a set-point near the exact one.
        solved={
            "set_point_rad": Solved("residual_Nm", limit["NOT_CONVERGED"], k1, 2 * float(dead_zone))
        },
        step=step,
        streams=STREAMS,
    )


def _exact_facts(
    device: DeviceData, forward: _Forward, values: Mapping[str, Any], w: Sequence[float]
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
        facts |= _rate_facts(device, values, "omega_mid_rad_s")
    # Of the load: request and relaxed torque, the rate torque from zero or to its clip, and each
    # stop's threshold or play state, which is no further than that from the last deflection.
    load = 2 * limits.tau_Nm.value + kv * (theta + limits.omega_rad_s.value * device.period_s)
    for i, (a, r) in enumerate(zip(w, stop_grid(values, len(w))[0], strict=True)):
        load += a * (theta + r + (i + 1) * 2 * NESTING_ROOM_RAD)
    return facts | root_facts(values["k3_Nm_rad3"], (low, high), load * (1 + room))


def _rate_facts(
    device: DeviceData, values: Mapping[str, Any], rate: str
) -> dict[str, tuple[float, float]]:
    # share(x) = s / (1 + x s), s = 1 + x/2 + x^2/6, is at most 1 and falls, its derivative having
    # the sign of s' - s^2 < 0; x is largest at the largest rate and no deflection.
    omega = threshold(device.file.limits.omega_rad_s.value)
    drag = values["B"] * omega ** values["n"] + values["eps2"]
    x = device.period_s * values["kv_Nm_rad"] * drag / values["eps1_Nms_rad"]
    s = 1 + x * (0.5 + x / 6)
    return {rate: (-omega, omega), "rate_share": (s / (1 + x * s) * (1 - 1e-6), 1.0)}


def _rate_split(forward: _Forward, rate: str) -> dict[str, tuple[float, ...]]:
    # As the sensor, whose viscosity spans orders of magnitude; but its rate is no input here.
    own = dict(forward.block.split)
    if forward.has_rate:
        own[rate] = own.pop("u_omega_rad_s")
    return own


class _RateSource:
    """Predicts the set-point's rate in the middle of a step from past set-points."""

    tunables: tuple[Tunable, ...] = ()
    coefficients: tuple[Port, ...] = ()
    state: tuple[Port, ...] = ()
    prepare: Any = None

    def predict(self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX) -> ca.SX:
        raise NotImplementedError

    def advance(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> dict[str, ca.SX]:
        raise NotImplementedError


class _Extrapolated(_RateSource):
    # The last difference belongs to the middle of the last step; on by one step, linearly.
    def __init__(self, device: DeviceData) -> None:
        self.h = device.period_s
        high = device.file.limits.omega_rad_s.value
        self.limit = threshold(high)
        self.state = (
            Port("w1_rad_s", -high, high, "rate of the set-point in the last step"),
            Port("w2_rad_s", -high, high, "rate of the set-point in the step before"),
        )

    def predict(self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX) -> ca.SX:
        return clip(2 * s.w1_rad_s - s.w2_rad_s, -self.limit, self.limit)

    def advance(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> dict[str, ca.SX]:
        w = ca.if_else(primed, clip((theta - last) / self.h, -self.limit, self.limit), 0)
        return {"w1_rad_s": w, "w2_rad_s": ca.if_else(primed, s.w1_rad_s, 0)}


class _Observer(_RateSource):
    # The velocity Block itself, on the set-point; its mid-step rate needs past samples only.
    def __init__(self, device: DeviceData, bandwidth_Hz: float) -> None:
        block = self.block = tracking_observer(device)
        (tunable,) = block.tunables
        source = "docs/inverse.md: a set-point has no encoder noise, the fastest follows best"
        default = min(bandwidth_Hz, tunable.high)
        self.tunables = (replace(tunable, default=default, source=source, status="assumed"),)
        self.coefficients = block.coefficients
        self.state = tuple(p for p in block.state if p.name != "primed")

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        results = self.block.prepare.call([getattr(t, x.name) for x in self.tunables])
        return dict(zip((p.name for p in self.coefficients), results, strict=True))

    def _step(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: Any
    ) -> dict[str, ca.SX]:
        values = {f"c_{p.name}": getattr(c, p.name) for p in self.coefficients}
        values |= {f"s_{p.name}": getattr(s, p.name) for p in self.state}
        return _call(self.block.step, values | {"s_primed": primed, "u_theta_rad": theta})

    def predict(self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX) -> ca.SX:
        return self._step(c, s, primed, 0)["y_omega_mid_rad_s"]

    def advance(
        self, c: SimpleNamespace, s: SimpleNamespace, primed: ca.SX, theta: ca.SX, last: ca.SX
    ) -> dict[str, ca.SX]:
        results = self._step(c, s, primed, theta)
        return {p.name: results[f"next_{p.name}"] for p in self.state}


def _rate_source(device: DeviceData, rate: Rate, bandwidth_Hz: float) -> _RateSource:
    if rate not in get_args(Rate):
        raise ValueError(f"rate must be one of {get_args(Rate)}, got {rate!r}")
    return _Observer(device, bandwidth_Hz) if rate == "observer" else _Extrapolated(device)


def _exact_equations() -> tuple[Any, ...]:
    x, f_i, r_i, p_i = sp.symbols("x F_i r_i p_i")
    s = sp.Symbol("s")
    return (
        equation(
            "[segment]",
            "d",
            K3 * x**3 + LINEAR * x,
            "the torque between two breakpoints, of the deflection beyond the dead zone",
        ),
        equation(
            "[breakpoint]", "x_i", s * f_i + r_i, "where stop i saturates; s is the direction"
        ),
        equation(
            "[a]",
            "a",
            K1 + sp.Symbol("g") + sp.Sum(p_i, (sp.Symbol("i"), 1, sp.Symbol("N"))),
            "linear stiffness: spring, Maxwell element, stops not saturated",
        ),
        equation("[root 1]", THIRD, ROOT_THIRD, "real root of the segment's cubic, first part"),
        equation("[root 2]", HALF, ROOT_HALF, "second part"),
        equation("[root 3]", "c", sp.cbrt(ROOT_CUBE), "third part"),
        equation("(4.13), stable form", "|x|", ROOT_WHOLE, "the root, with the sign of d"),
    )


def filter_taps(name: FilterName) -> tuple[float, ...]:
    """Coefficients of the disturbance observer's low-pass, newest sample first.

    Parameters
    ----------
    name : str
        ``a``: order 30, 10 Hz at 1 kHz, rectangular window, unscaled, as it was used (gain 0.588 at
        rest).  ``b``: the eleven printed numbers.  ``..._normalised``: scaled to gain 1 at rest.
        ``b_rounding``: scaled to 1.0165, inside the rounding of the printed digits.

    Returns
    -------
    tuple of float
        The coefficients.

    Raises
    ------
    ValueError
        For an unknown name.
    """
    if name not in get_args(FilterName):
        raise ValueError(f"filter must be one of {get_args(FilterName)}, got {name!r}")
    if name.startswith("a"):
        # Ideal low-pass, cut off after 31 taps: sin(2 pi f n h) / (pi n).
        taps = 2 * 10.0 / 1000.0 * np.sinc(2 * 10.0 / 1000.0 * np.arange(-15, 16))
    else:
        taps = np.array(FILTER_B)
    gain = {"a_normalised": 1.0, "b_normalised": 1.0, "b_rounding": FILTER_B_ROUNDING_GAIN}
    if name in gain:
        taps = taps * (gain[name] / taps.sum())
    return tuple(float(t) for t in taps)


def play_parameters(device: DeviceData) -> tuple[Constant, ...]:
    """Parameters of the play operators: the device file's, table 4.2 where it has none.

    Parameters
    ----------
    device : DeviceData
        Its section ``[inverse]`` may hold ``kappa_rad``, ``phi_1_rad`` and ``chi_rad``.

    Returns
    -------
    tuple of Constant
        These three, in this order, with source and status.
    """
    given = device.file.inverse
    out = []
    for name, value in PLAY_DEFAULTS.items():
        q = getattr(given, name) if given is not None else None
        if q is None:
            out.append(Constant(name, value, "thesis table 4.2", "published"))
        else:
            out.append(Constant(name, q.value, q.source, q.status))
    return tuple(out)


def _play_constants(device: DeviceData, arguments: Mapping[str, float | None]) -> list[Constant]:
    return [
        c if (v := arguments[c.name]) is None else Constant(c.name, v, "argument", "assumed")
        for c in play_parameters(device)
    ]


def _play_tunable(c: Constant) -> Tunable:
    from esea_gen.devices.fields import field_facts

    f = field_facts(f"inverse.{c.name}")
    return Tunable(c.name, c.value, f["low"], f["high"], f["text"], c.source, c.status)


def _play_grid(kappa: Any, phi: Any, chi: Any) -> tuple[list[Any], list[Any]]:
    # Thresholds (4.9) and weights (4.8) of the play operators: numbers or symbols.
    r = [chi * j for j in range(1, PLAYS + 1)]
    return r, [to_casadi(PLAY_WEIGHT, {KAPPA: kappa, PHI: phi, PLAY_R: x}) for x in r]


def published_inverse(
    device: DeviceData,
    filter: FilterName | None = None,
    *,
    kappa: float | None = None,
    phi: float | None = None,
    chi: float | None = None,
    tunable: bool = False,
) -> Block:
    """The thesis' partial inverse, with or without its disturbance observer, as a Block.

    Parameters
    ----------
    device : DeviceData
        Parameters of the forward model, limits and rate.
    filter : str, optional
        Low-pass of the disturbance observer (:func:`filter_taps`); none leaves the observer out.
    kappa, phi, chi : float, optional
        Weight (rad), decay (1/rad) and spacing (rad) of the play operators in place of the device
        file's (:func:`play_parameters`).
    tunable : bool
        Make these three tunables instead of constants: what identification runs.

    Returns
    -------
    Block
        Input ``tau_Nm``; outputs the set-point ``theta_rad``, the corrected request ``u_Nm`` and a
        status word.

    Raises
    ------
    UserError
        When the device's linear stiffness is 0: the envelope's slope at zero torque is then
        infinite.

    Notes
    -----
    The observer closes a loop inside one step: request less the filtered disturbance of the last
    samples, play operators, forward model driven by the set-point, new disturbance.  The forward
    model's viscosity takes the set-point's difference over this step as its rate.
    """
    file = device.file
    h = device.period_s
    forward = _Forward(device)
    k1, k3 = file.elastomer.k1_Nm_rad.value, file.elastomer.k3_Nm_rad3.value
    if k1 <= 0:
        raise UserError(
            f"{device.origin}: elastomer.k1_Nm_rad = 0: the published inverse's envelope has no "
            "slope at zero torque.",
            "Give a positive linear stiffness.",
        )
    taps = filter_taps(filter) if filter else ()
    theta_high = forward.block.inputs[0].high
    omega_high = threshold(file.limits.omega_rad_s.value)
    tau_lim = tau_high = threshold(file.limits.tau_Nm.value)
    plays = _play_constants(device, {"kappa_rad": kappa, "phi_1_rad": phi, "chi_rad": chi})
    fixed_r, fixed_p = (list(map(float, x)) for x in _play_grid(*(c.value for c in plays)))
    tunables: tuple[Tunable, ...] = ()
    coefficients: tuple[Port, ...] = ()
    prepare = None
    if tunable:
        tunables = tuple(_play_tunable(c) for c in plays)
        high = {t.name: t.high for t in tunables}
        far, heavy = PLAYS * high["chi_rad"], high["kappa_rad"]
        coefficients = (
            Port("r_rad", 0.0, far, "thresholds of the play operators", PLAYS, "(4.9)"),
            Port("p_rad", 0.0, heavy, "weights of the play operators", PLAYS, "(4.8)"),
        )

        def prepare(t: SimpleNamespace) -> dict[str, Any]:
            grid = _play_grid(t.kappa_rad, t.phi_1_rad, t.chi_rad)
            return dict(zip(("r_rad", "p_rad"), grid, strict=True))

    # The envelope of the largest corrected request bounds every play state.
    reach = max(2 * theta_high, 4 * tau_lim / k1)
    flags = (
        Flag("INPUT_INVALID", "an input was NaN or outside its range; taken as zero", True),
        Flag("STATE_REPAIRED", "the state was corrupt; started afresh", True),
        Flag("TORQUE_OUTSIDE", "|request| is above full scale"),
        Flag(
            "REQUEST_CLAMPED",
            "the corrected request or the set-point was clamped",
            True,
            ("u_Nm", "theta_rad"),
            theta_high,
        ),
    )

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        disturbance = ca.SX(0)
        for i, q in enumerate(taps):
            disturbance = disturbance + q * s.difference_Nm[i]
        label("disturbance_Nm", disturbance, "low-pass of the past differences")
        wanted = u.tau_Nm - disturbance
        corrected = label("corrected_Nm", clip(wanted, -tau_high, tau_high), "corrected request")
        envelope = label("envelope_rad", cubic_root(k3, k1, corrected, label), "(4.13) gamma")
        r: list[Any] = ca.vertsplit(c.r_rad) if tunable else fixed_r
        p: list[Any] = ca.vertsplit(c.p_rad) if tunable else fixed_p
        held, total = [], ca.SX(0)
        for j in range(PLAYS):
            f = ca.fmax(envelope - r[j], ca.fmin(envelope + r[j], s.inverse_play_rad[j]))
            held.append(label(f"inverse_play_{j + 1}_rad", f, f"(4.10, 4.11) play {j + 1}"))
            total = total + p[j] * f
        label("unclamped_rad", total, "(4.7), as meant")
        theta = label("set_point_rad", clip(total, -theta_high, theta_high))
        outputs = {
            "theta_rad": theta,
            "u_Nm": corrected,
            "status": flag_word(
                [
                    ca.logic_not(guard.inputs_ok),
                    ca.logic_not(guard.state_ok),
                    ca.fabs(u.tau_Nm) > threshold(file.domain.tau_full_scale_Nm.value),
                    ca.logic_or(ca.fabs(wanted) > tau_high, ca.fabs(total) > theta_high),
                ]
            ),
        }
        next_state: dict[str, Any] = {"inverse_play_rad": held}
        if taps:
            state = forward.of(s) | {"primed": ca.logic_and(s.primed, guard.state_ok)}
            last = forward.step(state, theta, 0)["label_theta_last_rad"]
            omega = label(
                "omega_rad_s", clip((theta - last) / h, -omega_high, omega_high), "rate of the step"
            )
            model = forward.step(state, theta, omega)
            if forward.has_rate:
                label("rate_share", forward.share(model), "(1 - exp(-x))/x, third order")
            difference = clip(model["label_tau_Nm"] - corrected, -2 * tau_high, 2 * tau_high)
            line = [difference, *ca.vertsplit(s.difference_Nm)[: len(taps) - 1]]
            next_state |= {q.name: model[f"next_{q.name}"] for q in forward.state}
            next_state["difference_Nm"] = line
        return next_state, outputs

    facts = root_facts(k3, (k1, k1), tau_high)
    split: dict[str, tuple[float, ...]] = {}
    if taps:
        # The request less the disturbance is rounded: its sign is open near zero, where the root
        # is small; and the root turns from linear to cubic where b^2 passes a^3.
        bend = 2 * k3 * (k1 / (3 * k3)) ** 1.5 if k3 > 0 else tau_high
        facts["corrected_Nm"] = (-tau_high, tau_high)
        split = {"corrected_Nm": (1e-6 * tau_high, 0.1 * bend, bend, 4 * bend)}
        split |= _rate_split(forward, "omega_rad_s")
    if taps and forward.has_rate:
        values = {c.name: c.value for c in device.constants("elastomer")}
        facts |= _rate_facts(device, values, "omega_rad_s")
    state: tuple[Port, ...] = (
        Port("inverse_play_rad", -reach, reach, "play states", PLAYS, "(4.10, 4.11)"),
    )
    if taps:
        state += (
            Port(
                "difference_Nm",
                -2 * tau_lim,
                2 * tau_lim,
                "model torque less corrected request, newest first",
                len(taps),
            ),
            *forward.state,
        )
    return Block.define(
        "inverse" + (f"_{filter}" if filter else "_plays"),
        "Published inverse: play operators"
        + (f", disturbance observer with filter {filter}" if filter else ""),
        period_s=h,
        constants=(() if tunable else tuple(plays)) + device.constants("elastomer"),
        tunables=tunables,
        coefficients=coefficients,
        prepare=prepare,
        state=state,
        inputs=(_request_port(tau_lim),),
        outputs=(
            Port("theta_rad", -theta_high, theta_high, "deflection set-point", equation="(4.7)"),
            Port("u_Nm", -tau_lim, tau_lim, "request corrected by the observed disturbance"),
            Port("status", 0, 15, "what is known of this set-point", flags=flags),
        ),
        equations=_published_equations(bool(taps)),
        facts=facts,
        split=split,
        step=step,
    )


def _published_equations(observer: bool) -> tuple[Any, ...]:
    f_j, gamma, p_j, r_j = sp.symbols("F_j gamma p_j r_j")
    f_p = sp.Symbol("F_j,k-1")
    j, n = sp.Symbol("j"), sp.Symbol("N")
    out = (
        equation("(4.7), as meant", "theta_d", sp.Sum(p_j * f_j, (j, 1, n)), "set-point"),
        equation("(4.8)", "p_j", PLAY_WEIGHT.subs(PLAY_R, r_j), "weight of a play operator"),
        equation("(4.9)", "r_j", CHI * PLAY_J, "threshold of a play operator"),
        equation(
            "(4.10, 4.11)",
            "F_j",
            sp.Max(gamma - r_j, sp.Min(gamma + r_j, f_p)),
            "play operator round the envelope",
        ),
        equation("(4.13), stable form", "|gamma|", ROOT_WHOLE, "envelope: inverse of the cubic"),
    )
    if not observer:
        return out
    d, q_i, e_i = sp.symbols("d q_i e_k-1-i")
    i = sp.Symbol("i")
    return (
        *out,
        equation("[DOB 1]", "u", sp.Symbol("tau_d") - d, "corrected request"),
        equation("[DOB 2]", "d", sp.Sum(q_i * e_i, (i, 0, n)), "low-pass of past differences"),
        equation("[DOB 3]", "e", sp.Symbol("tau_act") - sp.Symbol("u"), "new difference"),
    )


def chosen_inverse(device: DeviceData) -> Block:
    """The inverse that the device file's section ``[inverse]`` asks for.

    Parameters
    ----------
    device : DeviceData
        The device; without such a section the exact inverse is built.

    Returns
    -------
    Block
        From :func:`exact_inverse` or :func:`published_inverse`.

    Raises
    ------
    UserError
        As these two.
    """
    asked = device.file.inverse
    if asked is None or asked.kind == "exact":
        return exact_inverse(device)
    return published_inverse(device, None if asked.filter == "none" else asked.filter)


def inverse_system(device: DeviceData, *blocks: Block) -> System:
    """A System of inverse Blocks beside each other, all on one request.

    Parameters
    ----------
    device : DeviceData
        Gives the name.
    *blocks : Block
        From :func:`exact_inverse` and :func:`published_inverse`, of different names.

    Returns
    -------
    System
        Task ``invert``: request in, set-point and status of each Block out.
    """
    given: Sequence[Block] = blocks or (exact_inverse(device),)
    names = [b.name for b in given]
    outputs = {}
    for n in names:
        short = n.removeprefix("inverse").strip("_")
        outputs[f"theta_{short}_rad" if short else "theta_rad"] = f"{n}.theta_rad"
        outputs[f"{n}_status"] = f"{n}.status"
    return System(
        f"{device.name}_inverse",
        device.period_s,
        dict(zip(names, given, strict=True)),
        (Task("invert", tuple(names)),),
        {},
        {"tau_Nm": tuple(f"{n}.tau_Nm" for n in names)},
        outputs,
    )


__all__ = [
    "chosen_inverse",
    "cubic_root",
    "exact_inverse",
    "filter_taps",
    "inverse_system",
    "play_parameters",
    "published_inverse",
]
