"""Elastomer torque model: deflection in, interaction torque out (thesis chapter 3).

Spring and viscosity are SymPy expressions, printed in reports and carried across to CasADi.  Ours
(evidence: ``docs/sensor-errors.md``): stop operators in play form, F(k) = clip(F(k-1), theta(k) -
r, theta(k) + r) with E = theta - F, in which nothing is summed; and a Maxwell element whose
exponential step has exp(x) to third order: exact at rest, positive and monotone for every x >= 0.

With a dead zone (the knee, 8.7/8.8) the model uses the deflection beyond it, and the rate of that,
0 where the step starts inside.  That gate looks at the stored theta(k-1), which every format
represents exactly, and the viscosity then does not depend on theta(k): torque stays strictly
increasing in it.  The price is the one step that leaves the dead zone: at most kv |thetadot| h too
much, for the knee at 15 deg and 3 Hz 0.06 Nm, which the next step lets go.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca
import sympy as sp

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Equation, Flag, Port, around, clip, status_port, threshold
from esea_gen.model.plays import STREAMS
from esea_gen.model.sections import file_tunable
from esea_gen.model.symbolic import equations, to_casadi

THETA, RATE, TAU_R, DT = sp.symbols("theta omega_m tau_r h", real=True)
K1, K3, KV = sp.symbols("k_1 k_3 k_v", positive=True)
A, B, M, N, EPS1, EPS2 = sp.symbols("A B m n epsilon_1 epsilon_2", positive=True)
DELTA, RATE_DELTA = sp.symbols("delta omega_delta", real=True)
DEAD_ZONE = sp.Symbol("theta_dz", positive=True)
ALPHA, BETA, RADIUS, SPACING, INDEX = sp.symbols("alpha beta r omega i", positive=True)

TAU_S = K3 * THETA**3 + K1 * THETA
ETA = (A * sp.Abs(THETA) ** M + EPS1) / (B * sp.Abs(RATE) ** N + EPS2)
# sign(theta) max(|theta| - theta_dz, 0) without a sign: exactly 0 inside, one rounding outside.
BEYOND = sp.Max(THETA - DEAD_ZONE, 0) + sp.Min(THETA + DEAD_ZONE, 0)
STOP_WEIGHT = ALPHA * sp.exp(-BETA * RADIUS)


MODEL_KEYS = ("k1_Nm_rad", "k3_Nm_rad3", "alpha_Nm_rad", "beta_1_rad", "omega_rad")
RATE_KEYS = ("kv_Nm_rad", "A_Nms_rad", "m", "eps1_Nms_rad", "B", "n", "eps2")


def stop_grid(p: Mapping[str, Any], stops: int) -> tuple[list[Any], list[Any]]:
    """Thresholds and weights of the stop operators (3.10, 3.11)."""
    r = [p["omega_rad"] * i for i in range(1, stops + 1)]
    w = [to_casadi(STOP_WEIGHT, _symbols_of(p) | {RADIUS: ri}) for ri in r]
    return r, w


SYMBOLS = {
    K1: "k1_Nm_rad",
    K3: "k3_Nm_rad3",
    ALPHA: "alpha_Nm_rad",
    BETA: "beta_1_rad",
    KV: "kv_Nm_rad",
    A: "A_Nms_rad",
    B: "B",
    M: "m",
    N: "n",
    EPS1: "eps1_Nms_rad",
    EPS2: "eps2",
}


def _symbols_of(p: Mapping[str, Any]) -> dict[sp.Symbol, Any]:
    return {symbol: p[key] for symbol, key in SYMBOLS.items() if key in p}


def _tunable_ports(device: DeviceData, stops: int, rate_terms: bool) -> dict[str, Any]:
    """The elastomer's parameters as tunables, for identification."""
    keys = MODEL_KEYS + (RATE_KEYS if rate_terms else ())
    given = dict(device.quantities())
    dotted = {k: f"elastomer.maxwell.{k}" if k in RATE_KEYS else f"elastomer.{k}" for k in keys}
    tunables = tuple(file_tunable(n, given[n].constant(k)) for k, n in dotted.items())
    direct = ("k1_Nm_rad", "k3_Nm_rad3") + (RATE_KEYS if rate_terms else ())
    coefficients = (
        Port("r_rad", 0.0, 4.0, "thresholds of the stop operators", stops, "(3.11)"),
        Port("p_Nm_rad", 0.0, 1000.0, "weights of the stop operators", stops, "(3.10)"),
        *(t.port for t in tunables if t.name in direct),
    )

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        r, w = stop_grid(vars(t), stops)
        return {"r_rad": r, "p_Nm_rad": w} | {k: getattr(t, k) for k in direct}

    return {"tunables": tunables, "coefficients": coefficients, "prepare": prepare}


def torque_sensor(device: DeviceData, *, tunable: bool = False) -> Block:
    law = _TorqueSensor(device, tunable)
    if not tunable:
        return Block.of(law)
    return Block.of(law, **_tunable_ports(device, law.stops, law.rate_terms))


class _TorqueSensor:
    def __init__(self, device: DeviceData, tunable: bool) -> None:
        self.tunable = tunable
        file = device.file
        self.stops = int(device.elastomer.stops.value)
        self.rate_terms = device.elastomer.maxwell is not None
        self.h = device.period_s
        # As the ports hold them: a state clipped at a limit must pass its own guard in every
        # format.
        self.theta_lim = threshold(file.limits.theta_rad.value)
        self.omega_lim = threshold(file.limits.omega_rad_s.value)
        self.tau_lim = threshold(file.limits.tau_Nm.value)
        self.values: dict[str, Any] = {c.name: c.value for c in device.constants("elastomer")}
        self.constants = device.constants("elastomer") + device.constants("domain")
        self.dead_zone = threshold(self.values.get("dead_zone_rad", 0.0))
        self.theta_domain = threshold(file.domain.theta_max_rad.value)
        self.omega_domain = threshold(file.domain.omega_max_rad_s.value)
        self.tau_domain = threshold(file.domain.tau_full_scale_Nm.value)
        self.step_max = threshold(self.omega_lim * self.h)
        self.name = "sensor"
        self.title = "Elastomer torque sensor: deflection to interaction torque"
        self.equations = _equations(self.rate_terms, self.dead_zone > 0)
        self.split = self._cuts()
        # With s = 1 + x/2 + x^2/6: s <= 1 + x s, because (1 - x) s = 1 - x/2 - x^2/3 - x^3/6 <= 1.
        self.facts = {"share": (0.0, 1.0)} if self.rate_terms else {}
        self.streams = STREAMS
        plays = "play states F_i = theta - E_i of the stop operators"
        self.state = (
            Port.flag("primed", "1 once a valid sample has been seen"),
            around("theta_prev_rad", self.theta_lim, "deflection of the last step"),
            around("tau_r_Nm", self.tau_lim, "torque of the Maxwell element", equation="(3.3)"),
            around("play_rad", 2 * self.theta_lim, plays, self.stops, "(3.5-3.7)", repair="block"),
        )
        theta = "deflection: motor-side minus load-side angle"
        omega = "deflection rate in the middle of the step, free of theta(k)"
        self.inputs = (
            around("theta_rad", self.theta_lim, theta, on_invalid="theta_prev_rad"),
            around("omega_rad_s", self.omega_lim, omega, on_invalid=0.0),
        )
        torque, tau, full = "part of the torque on the load", self.tau_lim, self.tau_domain
        jumped = "deflection jumped by more than its rate allows; clipped"
        rate = "the Maxwell element's torque was clipped at its limit"
        self.outputs = (
            around("tau_Nm", tau, "interaction torque on the load", equation="(3.1)"),
            around("tau_spring_Nm", tau, f"cubic spring: {torque}", equation="(3.2)"),
            around("tau_rate_Nm", tau, f"Maxwell element: {torque}", equation="(3.3)"),
            around("tau_hysteresis_Nm", tau, f"stop operators: {torque}", equation="(3.9)"),
            status_port(
                "status of this sample",
                "an input was NaN or outside its physical range; the last deflection is held",
                "the state was corrupt; the model was restarted",
                Flag("THETA_OUTSIDE", "|deflection| is outside the identified domain"),
                Flag("RATE_OUTSIDE", "|deflection rate| is outside the identified domain"),
                Flag("TORQUE_OUTSIDE", "|torque| is above full scale", False, ("tau_Nm",), full),
                Flag("STEP_CLIPPED", jumped, True),
                Flag("RATE_TORQUE_CLIPPED", rate, True, ("tau_rate_Nm",), tau),
            ),
        )

    def _cuts(self) -> dict[str, tuple[float, ...]]:
        if not self.rate_terms:
            return {}
        v, reach = self.values, self.theta_lim - self.dead_zone
        by_angle = _power_cuts(v["A_Nms_rad"], v["m"], v["eps1_Nms_rad"], reach)
        return {
            "s_theta_prev_rad": _beyond_cuts(self.dead_zone, by_angle),
            "u_omega_rad_s": _power_cuts(v["B"], v["n"], v["eps2"], self.omega_lim),
        }

    def beyond(self, theta: ca.SX) -> ca.SX:
        if not self.dead_zone:
            return theta
        return to_casadi(BEYOND, {THETA: theta, DEAD_ZONE: self.dead_zone})

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        p = dict(self.values)
        if self.tunable:
            p |= {k: v for k, v in vars(c).items() if k not in ("r_rad", "p_Nm_rad")}
            r, w = ca.vertsplit(c.r_rad), ca.vertsplit(c.p_Nm_rad)
        else:
            r, w = stop_grid(p, self.stops)
        symbols = _symbols_of(p)

        # The first valid sample defines where the operators start: E_i(0) = 0, tau_r(0) = 0.
        primed = label("primed", s.primed, "0 until a valid sample has been seen")
        theta_prev = ca.if_else(primed, s.theta_prev_rad, u.theta_rad)
        theta_prev = label("theta_last_rad", theta_prev, "theta(k-1)")
        moved = u.theta_rad - theta_prev
        theta, dtheta = self.stretch(u.theta_rad, theta_prev, moved, label)
        tau_s = to_casadi(sp.horner(TAU_S, wrt=THETA), symbols | {THETA: theta})
        tau_s = label("tau_s_Nm", tau_s, "(3.2)")

        play, tau_h = self.hysteresis(r, w, s, theta, primed, label)
        tau_r = self.maxwell(p, symbols, s, u, dtheta, label) if self.rate_terms else ca.SX(0)
        label("tau_r_raw_Nm", tau_r, "(3.3) before its limit")
        tau_r_next = label("tau_r_Nm", clip(tau_r, -self.tau_lim, self.tau_lim), "(3.3)")
        tau = label("tau_Nm", tau_s + tau_r_next + tau_h, "(3.1)")

        ready = ca.logic_or(primed, guard.inputs_ok)
        status = guard.status(
            ca.fabs(u.theta_rad) > self.theta_domain,
            ca.fabs(u.omega_rad_s) > self.omega_domain,
            ca.fabs(tau) > self.tau_domain,
            ca.fabs(moved) > self.step_max,
            ca.fabs(tau_r) > self.tau_lim,
        )
        next_state = {
            "primed": ready,
            "theta_prev_rad": u.theta_rad,
            "tau_r_Nm": tau_r_next,
            "play_rad": play,
        }
        outputs = {
            "tau_Nm": clip(tau, -self.tau_lim, self.tau_lim),
            "tau_spring_Nm": clip(tau_s, -self.tau_lim, self.tau_lim),
            "tau_rate_Nm": tau_r_next,
            "tau_hysteresis_Nm": clip(tau_h, -self.tau_lim, self.tau_lim),
            "status": status,
        }
        return next_state, outputs

    def stretch(
        self, sampled: ca.SX, theta_prev: ca.SX, moved: ca.SX, label: Labels
    ) -> tuple[ca.SX, ca.SX]:
        """Deflection that counts, and how far it went: beyond the dead zone (8.7/8.8), if any."""
        theta, stretched = sampled, moved
        if self.dead_zone:
            theta = label("delta_rad", self.beyond(sampled), "(8.7/8.8) beyond the dead zone")
            last = label("delta_last_rad", self.beyond(theta_prev), "delta(k-1)")
            stretched = theta - last
        name = "delta" if self.dead_zone else "theta"
        dtheta = clip(stretched, -self.step_max, self.step_max)
        dtheta = label("dtheta_rad", dtheta, f"{name}(k) - {name}(k-1)")
        return theta, dtheta

    def hysteresis(
        self, r: list[Any], w: list[Any], s: Any, theta: ca.SX, primed: ca.SX, label: Labels
    ) -> tuple[list[ca.SX], ca.SX]:
        """(3.5 to 3.9): stop operators in play form, and their torque."""
        play, tau_h = [], ca.SX(0)
        for i in range(self.stops):
            start = ca.if_else(primed, s.play_rad[i], theta)
            f = clip(start, theta - r[i], theta + r[i])
            play.append(label(f"play_{i + 1}_rad", f, f"(3.5-3.7) play form of stop {i + 1}"))
            tau_h = tau_h + w[i] * (theta - f)
        return play, label("tau_h_Nm", tau_h, "(3.9)")

    def maxwell(
        self,
        p: Mapping[str, Any],
        symbols: dict[sp.Symbol, Any],
        s: Any,
        u: Any,
        dtheta: ca.SX,
        label: Labels,
    ) -> ca.SX:
        """(3.3, 3.4): torque of the Maxwell element after this step, before its clip."""
        # From the stored deflection even on the first sample: tau_r is then 0 whatever x is.
        name = "delta_mid_rad" if self.dead_zone else "theta_mid_rad"
        theta_mid = self.beyond(s.theta_prev_rad) + 0.5 * self.h * u.omega_rad_s
        theta_mid = label(name, theta_mid, "deflection half a step on")
        # x = h kv / eta as one quotient of two positive numbers: eta itself is not needed.
        step_kv, sixth = self.h * p["kv_Nm_rad"], 1.0 / 6.0
        if self.dead_zone and not self.tunable:
            # x spans many orders of magnitude here.  Numbers that every format holds alike leave
            # it a relative error only, and the derived bound stays small.
            symbols = symbols | {k: threshold(symbols[k]) for k in (A, B, EPS1, EPS2)}
            step_kv, sixth = threshold(step_kv), threshold(sixth)
        gain = to_casadi(sp.fraction(ETA)[0], symbols | {THETA: theta_mid})
        drag = to_casadi(sp.fraction(ETA)[1], symbols | {RATE: u.omega_rad_s})
        x = step_kv * drag / gain
        if self.dead_zone:
            # Inside, delta and its rate are 0 and x is one number.
            resting = step_kv * symbols[EPS2] / symbols[EPS1]
            outside = ca.fabs(s.theta_prev_rad) > self.dead_zone
            x = ca.if_else(outside, x, resting if self.tunable else threshold(resting))
        label("x", x, "(3.4) step over time constant")
        series = label("series", 1 + x * (0.5 + x * sixth), "1 + x/2 + x^2/6")
        # One division; kept apart, both factors lie in (0, 1] and every error stays relative.
        growth = label("growth", 1 + x * series, "exp(x), third order")
        decay = label("decay", 1 / growth, "exp(-x), third order")
        share = series * decay
        label("share", share, "(1 - exp(-x))/x, third order")
        tau_r: ca.SX = s.tau_r_Nm * decay + p["kv_Nm_rad"] * dtheta * share
        return tau_r


def _power_cuts(gain: float, exponent: float, offset: float, limit: float) -> tuple[float, ...]:
    # Where gain |x|^exponent + offset has grown by another factor of 3: the viscosity spans orders
    # of magnitude, and one interval over all of it would tell the error analysis little.  A larger
    # factor where that would make more than six steps: the analysis takes its time for each pair.
    cuts = []
    top = gain * limit**exponent + offset
    factor = max(3.0, (top / offset) ** (1 / 6))
    level = factor * offset
    while gain > 0 and exponent > 0 and level < 0.999 * top:
        cuts.append(((level - offset) / gain) ** (1 / exponent))
        level *= factor
    return tuple(cuts)


def _beyond_cuts(dead_zone: float, cuts: tuple[float, ...]) -> tuple[float, ...]:
    # The first cut is the dead zone's edge, where the rate is switched.
    return (dead_zone, *(dead_zone + c for c in cuts)) if dead_zone else cuts


COMMON = """
    (3.1) | tau_e | {total} | torque: spring, rate terms, hysteresis
    (3.2) | tau_s | spring | cubic spring
    (3.9) | tau_h | Sum(p_i * E_i, (i, 1, N)) | hysteresis
    (3.10) | p_i | weight | weight of a stop operator
    (3.11) | r_i | omega * i | threshold of a stop operator
    (3.5-3.7), play form | F_i | Max(Min(F{{i,k-1}}, {now} + r_i), {now} - r_i) | \
        stop operator E = theta - F, nothing summed
"""
MAXWELL = """
    (3.3) | tau_r | (tau{{r,k-1}} + k_v * ({now} - {last}) * sigma) / (1 + x * sigma) | \
        Maxwell element, exponential step, series of third order
    [series] | sigma | 1 + x / 2 + x**2 / 6 | (exp(x) - 1)/x to third order
    [step] | x | h * k_v / eta | step over time constant
    (3.4) | eta | eta | viscosity, from mid-step deflection and rate
"""
BEYOND_ZONE = """
    (8.7/8.8) | delta | beyond | deflection beyond the dead zone; stands for theta in what follows
"""
GATE = """
    [gate] | omega_delta | Piecewise((omega_m, Abs(theta{{k-1}}) > theta_dz), (0, true)) | \
        its rate, from where the step starts
"""


def _equations(rate_terms: bool, dead_zone: bool) -> tuple[Equation, ...]:
    standing = {THETA: DELTA, RATE: RATE_DELTA} if dead_zone else {}
    rows = (BEYOND_ZONE + GATE * rate_terms) * dead_zone + COMMON + MAXWELL * rate_terms
    angle = "delta" if dead_zone else "theta"
    total = "tau_s + tau_r + tau_h" if rate_terms else "tau_s + tau_h"
    return equations(
        rows.format(total=total, now=f"{angle}_k", last=f"{angle}{{k-1}}"),
        beyond=BEYOND,
        spring=TAU_S.subs(standing),
        weight=STOP_WEIGHT.subs(RADIUS, sp.Symbol("r_i")),
        eta=ETA.subs(standing),
    )
