"""One step of a member of the elastomer family: operators, softening, memory.

The steps are exact for a q that is linear within the step: Maxwell as the convex combination y+ =
(1 - a - b) y + a q+ + b q of its relaxed part y, which stays within the range of its input under
any rounding; slip with exp(v) replaced by its third-order series, which keeps |z| <= L and the
steady state exact; stop in its play form, in which nothing is summed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from esea_gen.language.block import Guard, Labels
from esea_gen.language.ports import Port, around, clip, threshold
from esea_gen.model.family import PATH_BAND, FittedMember, Member, Rise, Softening, Start

_PARTS = {"spring": "spring", "offset": "spring", "maxwell": "rate"}
# Ranges of states are this much wider than what arithmetic without rounding can reach.
ROOM = 1.01
# A slip operator's longest step, over its path.
SLIP_STEP = 8.0

Drive = tuple[tuple[float, Rise], ...]
Gain = tuple[float, Softening | None, int]
Factors = dict[Softening | None, ca.SX]


@dataclass(frozen=True)
class FamilyElement:
    """One operator with one state: its drive and its gains: weight, softening, column."""

    kind: str
    number: float
    drive: Drive
    gains: tuple[Gain, ...]

    def most(self, reach: float) -> float:
        return sum(w * rise.most(reach) for w, rise in self.drive)

    def most_slope(self, reach: float) -> float:
        return sum(w * rise.most_slope(reach) for w, rise in self.drive)


@dataclass(frozen=True)
class OperatorStep:
    element: FamilyElement
    value: ca.SX
    slope: ca.SX
    factors: Factors
    softening: Factors

    def gain(self) -> ca.SX:
        return sum((w * self.factors[soft] for w, soft, _ in self.element.gains), ca.SX(0))

    def torque_slope(self) -> ca.SX:
        """Of its torque over x; only at the first sample does a factor depend on x."""
        total = self.gain() * self.slope
        if self.element.kind == "spring":
            for w, soft, _ in self.element.gains:
                total = total + w * self.softening.get(soft, ca.SX(0)) * self.value
        return total


def unit_elements(member: Member) -> tuple[FamilyElement, ...]:
    out = []
    for column, t in enumerate(member.terms):
        drive: Drive = ((1.0, t.rise),)
        for number, share in t.shares or ((0.0, 1.0),):
            out.append(FamilyElement(t.kind, number, drive, ((share, t.softening, column),)))
    return tuple(out)


def merged_elements(fitted: FittedMember) -> tuple[FamilyElement, ...]:
    """As few operators as give the same torque."""
    linear: dict[tuple[Any, ...], list[tuple[float, Rise]]] = {}
    other: dict[tuple[Any, ...], list[Gain]] = {}
    for weight, t in fitted.used:
        for number, share in t.shares or ((0.0, 1.0),):
            if t.kind in ("spring", "maxwell"):
                key = (t.kind, number, share, t.softening)
                linear.setdefault(key, []).append((weight, t.rise))
            else:
                gain = (share * weight, t.softening, 0)
                other.setdefault((t.kind, number, t.rise), []).append(gain)
    out = [
        FamilyElement(kind, number, tuple(drive), ((share, soft, 0),))
        for (kind, number, share, soft), drive in linear.items()
    ]
    out += [
        FamilyElement(kind, number, ((1.0, rise),), tuple(gains))
        for (kind, number, rise), gains in other.items()
    ]
    return tuple(out)


def maxwell_shares(ratio: float) -> tuple[float, float]:
    """Shares of the new and the last drive in the relaxed part of a Maxwell branch."""
    if ratio < 1e-3:  # the differences would cancel
        return ratio / 2 - ratio**2 / 6, ratio / 2 - ratio**2 / 3
    decay = math.exp(-ratio)
    mean = -math.expm1(-ratio) / ratio
    return 1 - mean, mean - decay


class FamilyStep:
    """The step of any member; with ``derived`` its derivative will be taken, of the same values."""

    def __init__(
        self,
        elements: Sequence[FamilyElement],
        *,
        scale_rad: float,
        theta_lim: float,
        period_s: float,
        start: Start,
        derived: bool = False,
    ) -> None:
        self.elements = elements
        self.derived = derived
        self.h, self.scale, self.theta_lim = period_s, scale_rad, theta_lim
        self.reach = theta_lim / scale_rad
        self.start = start
        self.of = {k: [e for e in elements if e.kind == k] for k in ("maxwell", "stop", "slip")}
        found = {s for e in elements for _, s, _ in e.gains if s}
        self.strains = sorted({s.number for s in found if s.kind == "strain"})
        self.paths = sorted({s.number for s in found if s.kind == "path"})

    def larger(self, a: Any, b: Any) -> ca.SX:
        # CasADi's derivative of a maximum divides by the number of sides that attain it.
        return ca.SX(ca.if_else(a > b, a, b) if self.derived else ca.fmax(a, b))

    def clip(self, x: ca.SX, low: Any, high: Any) -> ca.SX:
        if not self.derived:
            return clip(x, low, high)
        return ca.SX(ca.if_else(x > high, high, ca.if_else(x < low, low, x)))

    def drive(self, e: FamilyElement, x: ca.SX) -> ca.SX:
        total = ca.SX(0)
        for weight, rise in e.drive:
            total = total + (rise(x) if weight == 1.0 else weight * rise(x))
        return total

    def run(
        self, s: Any, theta: ca.SX, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], list[OperatorStep]]:
        # The first valid sample defines where the operators start: nothing is stored in them.
        primed = label("primed", s.primed, "0 until a valid sample has been seen")
        last = label("theta_last_rad", ca.if_else(primed, s.theta_prev_rad, theta), "theta(k-1)")
        x = label("x", theta * (1 / self.scale), "deflection over the largest trained one")
        x_last = label("x_last", last * (1 / self.scale), "x(k-1)")
        state: dict[str, Any] = {"theta_prev_rad": theta}
        state["primed"] = ca.logic_or(primed, guard.inputs_ok)
        factors, softening = self.soften(s, x, primed, state, label)
        given = self.operate(s, x, x_last, primed, state, label)
        pairs = zip(self.elements, given, strict=True)
        return state, [OperatorStep(e, *values, factors, softening) for e, values in pairs]

    def torque(
        self, s: Any, theta: ca.SX, guard: Guard, label: Labels, factor: Any = None
    ) -> tuple[dict[str, Any], dict[str, ca.SX]]:
        """The next state, and the torque of the springs, of the branches and of the hysteresis."""
        state, sums, _ = self.torque_and_slope(s, theta, guard, label, factor)
        return state, sums

    # Written out and not CasADi's: the series of a slip is its own equation's to third order, so
    # that its slope costs a quotient whose factors lie between 0 and 2, which intervals see.
    def torque_and_slope(
        self, s: Any, theta: ca.SX, guard: Guard, label: Labels, factor: Any = None
    ) -> tuple[dict[str, Any], dict[str, ca.SX], ca.SX]:
        """As :meth:`torque`, and the whole torque's slope over this step's deflection, Nm/rad."""
        state, parts = self.run(s, theta, guard, label)
        steady = ca.SX(0)
        sums = {"spring": ca.SX(0), "rate": ca.SX(0), "hysteresis": ca.SX(0)}
        slope = ca.SX(0)
        for p in parts:
            slope = slope + p.torque_slope()
            if factor is not None and p.element.kind == "offset":
                steady = steady + p.gain() * p.value
                continue
            name = _PARTS.get(p.element.kind, "hysteresis")
            sums[name] = sums[name] + p.gain() * p.value
        slope = slope * (1 / self.scale)
        if factor is not None:
            sums = {k: factor * v for k, v in sums.items()}
            sums["spring"] = sums["spring"] + steady
            slope = factor * slope  # an offset has none
        return state, sums, slope

    def soften(
        self, s: Any, x: ca.SX, primed: ca.SX, state: dict[str, Any], label: Labels
    ) -> tuple[Factors, Factors]:
        """Factors of this step, from the memory of the last one, and their slopes; the memory."""
        factors: Factors = {None: ca.SX(1)}
        slopes: Factors = {}
        if self.strains:
            reached = self.larger(s.reached, ca.if_else(primed, 0, ca.fabs(x)))
            label("reached_before", reached, "m, largest |x| before this step")
            grows = ca.logic_and(ca.logic_not(primed), ca.fabs(x) > s.reached)
            for i, a in enumerate(self.strains, 1):
                factor = 1 / (1 + reached * (1 / a))
                text = f"softening by strain, 1/(1 + m/{a:g})"
                factor = factors[Softening("strain", a)] = label(f"strain_{i}", factor, text)
                less = ca.sign(x) * (-1 / a) * (factor * factor)
                slopes[Softening("strain", a)] = ca.if_else(grows, less, 0)
            state["reached"] = label("reached_now", self.larger(reached, ca.fabs(x)), "m")
        if self.paths:
            before = ca.if_else(primed, s.band, x)
            band = label(
                "band_now", self.clip(before, x - PATH_BAND, x + PATH_BAND), "play of the path"
            )
            moved = label("moved", ca.fabs(band - before), "path of this step")
            kept = []
            for i, length in enumerate(self.paths):
                old = s.kept[i]
                factors[Softening("path", length)] = old
                v = ca.fmin(moved * (1 / length), 1)
                new = old * (1 - v * (1 - 0.5 * v))
                kept.append(label(f"kept_{i + 1}", new, f"softening by path, exp(-s/{length:g})"))
            state |= {"band": band, "kept": ca.vertcat(*kept)}
        return factors, slopes

    def operate(
        self, s: Any, x: ca.SX, x_last: ca.SX, primed: ca.SX, state: dict[str, Any], label: Labels
    ) -> list[tuple[ca.SX, ca.SX]]:
        """q(x) - F of every operator and its slope over x; and its memory."""
        values: list[tuple[ca.SX, ca.SX]] = []
        memory: dict[str, list[ca.SX]] = {k: [] for k in self.of}
        for e in self.elements:
            q, rises = ca.SX(1), ca.SX(0)
            if e.kind != "offset":
                q, rises = self.drive(e, x), sum((w * r.slope(x) for w, r in e.drive), ca.SX(0))
            if e.kind in memory:
                place = len(memory[e.kind])
                step = {"maxwell": self.relax, "stop": self.stop, "slip": self.slip}[e.kind]
                inner, value, follows = step(e, s, place, q, self.drive(e, x_last), primed)
                name = {"maxwell": "relaxed", "stop": "play", "slip": "slip"}[e.kind]
                text = {"maxwell": "time, s:", "stop": "threshold", "slip": "path"}[e.kind]
                memory[e.kind].append(
                    label(f"{name}_{place + 1}", inner, f"{e.kind} branch, {text} {e.number:g}")
                )
                # The first sample finds every operator at rest, wherever that is.
                q, rises = value, rises * ca.if_else(primed, follows, 0)
            values.append((q, rises))
        ports = {"maxwell": "relaxed_Nm", "stop": "play", "slip": "slip"}
        state |= {ports[k]: ca.vertcat(*m) for k, m in memory.items() if m}
        return values

    # Of each operator: its memory, q - F, and by how much that follows q.

    def relax(
        self, e: FamilyElement, s: Any, i: int, q: ca.SX, q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        a, b = maxwell_shares(self.h / e.number)
        before = ca.if_else(primed, s.relaxed_Nm[i], q)
        inner = (1 - a - b) * before + a * q + b * q_last
        return inner, q - inner, ca.SX(1 - a)

    def stop(
        self, e: FamilyElement, s: Any, i: int, q: ca.SX, _q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        before = ca.if_else(primed, s.play[i], q)
        inner = self.clip(before, q - e.number, q + e.number)
        return inner, q - inner, ca.fabs(q - before) <= e.number

    def slip(
        self, e: FamilyElement, s: Any, i: int, q: ca.SX, q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        # Of a larger step it remembers next to nothing; so far the series' rounding stays small.
        most = threshold(SLIP_STEP * e.number)
        went = self.clip(q - q_last, -most, most)
        v = ca.fabs(went) * (1 / e.number)
        series = 1 + v * (0.5 + v * (1 / 6))
        t = 1 + v * series
        raw = (ca.if_else(primed, s.slip[i], 0) + went * series) / t
        limit = threshold(e.number)  # only rounding is clipped
        value = self.clip(raw, -limit, limit)
        # z = z(k-1)/T + sign L (T - 1)/T with T(v), so that dz/dq = (1 - sign z/L) T'/T.
        forgets = ca.fmin((1 + v * (1 + v * 0.5)) / t, 1)
        follows = (1 - ca.sign(went) * value * (1 / e.number)) * forgets
        return value, value, ca.if_else(ca.fabs(went) < most, follows, 0)

    def state_slopes(self) -> dict[str, float]:
        """Largest slope of every next state over this step's deflection, 1/rad or Nm/rad."""
        per = 1 / self.scale
        most = {
            k: max((e.most_slope(self.reach) * per for e in es), default=0.0)
            for k, es in self.of.items()
        }
        return {
            **dict.fromkeys(("reached", "band"), per),
            **{"primed": 0.0, "theta_prev_rad": 1.0},
            "kept": per / min(self.paths, default=1.0),
            # A slip that turns back moves twice as far as what drives it.
            **{"relaxed_Nm": most["maxwell"], "play": most["stop"], "slip": 2 * most["slip"]},
        }

    def state(self) -> tuple[Port, ...]:
        rested = self.start == "virgin"
        ports = [
            Port.flag("primed", "1 once a valid sample has been seen"),
            around("theta_prev_rad", self.theta_lim, "deflection of the last step"),
        ]
        if self.strains:
            start = 0.0 if rested else 1.0
            text = "largest deflection so far, over the largest trained one"
            ports.append(Port("reached", 0.0, ROOM * max(self.reach, 1.0), text, init=start))
        if self.paths:
            text = "what the path travelled has left of each softening factor"
            init = 1.0 if rested else 0.0
            ports.append(around("band", 2 * self.reach, "play through which the path is counted"))
            ports.append(Port("kept", 0.0, 1.0, text, len(self.paths), init=init))
        most = {k: max((e.most(self.reach) for e in es), default=0.0) for k, es in self.of.items()}
        if self.of["maxwell"]:
            text = "relaxed parts of the Maxwell branches' drives"
            size = len(self.of["maxwell"])
            ports.append(around("relaxed_Nm", ROOM * most["maxwell"], text, size, repair="block"))
        if self.of["stop"]:
            size, text = len(self.of["stop"]), "play states of the stop operators"
            ports.append(around("play", 2 * most["stop"], text, size, repair="block"))
        if self.of["slip"]:
            size, text = len(self.of["slip"]), "slip operators"
            limit = max(e.number for e in self.of["slip"])
            ports.append(around("slip", limit, text, size, repair="block"))
        return tuple(ports)
