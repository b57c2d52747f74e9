"""One step of a member of the elastomer family: its operators, its softening, its memory.

The steps are exact for a q that is linear within the step: Maxwell as the convex combination
y+ = (1 - a - b) y + a q+ + b q of its relaxed part y, which stays inside what has driven it however
it is rounded; slip with exp(v) replaced by its third-order series, which keeps |z| <= L and the
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


@dataclass(frozen=True)
class FamilyElement:
    """One operator with one state: what drives it, and what its value is multiplied with.

    gains: weight, softening and column of the result.
    """

    kind: str
    number: float
    drive: Drive
    gains: tuple[Gain, ...]

    def most(self, reach: float) -> float:
        return sum(w * rise.most(reach) for w, rise in self.drive)


def unit_elements(member: Member) -> tuple[FamilyElement, ...]:
    """Every term by itself, with weight 1."""
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
    """What of the new and of the last drive goes into the relaxed part of a Maxwell branch.

    Parameters
    ----------
    ratio : float
        Step over relaxation time.

    Returns
    -------
    a, b : float
        With g = (1 - e^-ratio) / ratio: 1 - g, and g - e^-ratio.
    """
    if ratio < 1e-3:  # the differences would cancel
        return ratio / 2 - ratio**2 / 6, ratio / 2 - ratio**2 / 3
    decay = math.exp(-ratio)
    mean = -math.expm1(-ratio) / ratio
    return 1 - mean, mean - decay


class FamilyStep:
    """The step of any member: operators, softening, memory.

    derived: whether its derivative will be taken; the values are the same.
    """

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
    ) -> tuple[dict[str, Any], list[tuple[FamilyElement, ca.SX, dict[Softening | None, ca.SX]]]]:
        """The next state, and each operator's value with the softenings."""
        # The first valid sample defines where the operators start: nothing is stored in them.
        primed = ca.logic_and(s.primed, guard.state_ok)
        primed = label("primed", primed, "0 until a valid sample has been seen")
        last = label("theta_last_rad", ca.if_else(primed, s.theta_prev_rad, theta), "theta(k-1)")
        x = label("x", theta * (1 / self.scale), "deflection over the largest trained one")
        x_last = label("x_last", last * (1 / self.scale), "x(k-1)")
        state: dict[str, Any] = {"theta_prev_rad": theta}
        state["primed"] = ca.logic_or(primed, guard.inputs_ok)
        factors = self.soften(s, x, primed, state, label)
        values = self.operate(s, x, x_last, primed, state, label)
        return state, [(e, values[i], factors) for i, e in enumerate(self.elements)]

    def torque(
        self, s: Any, theta: ca.SX, guard: Guard, label: Labels, factor: Any = None
    ) -> tuple[dict[str, Any], dict[str, ca.SX]]:
        """The next state, and the torque of the springs, of the branches and of the hysteresis.

        factor: of temperature, for all but the offset; None for a member without one.
        """
        state, parts = self.run(s, theta, guard, label)
        steady = ca.SX(0)
        sums = {"spring": ca.SX(0), "rate": ca.SX(0), "hysteresis": ca.SX(0)}
        for e, value, factors in parts:
            gain = ca.SX(0)
            for weight, softening, _ in e.gains:
                gain = gain + weight * factors[softening]
            if factor is not None and e.kind == "offset":
                steady = steady + gain * value
                continue
            part = _PARTS.get(e.kind, "hysteresis")
            sums[part] = sums[part] + gain * value
        if factor is not None:
            sums = {k: factor * v for k, v in sums.items()}
            sums["spring"] = sums["spring"] + steady
        return state, sums

    def soften(
        self, s: Any, x: ca.SX, primed: ca.SX, state: dict[str, Any], label: Labels
    ) -> dict[Softening | None, ca.SX]:
        """Factors of this step, from the memory of the last one; then the memory itself."""
        factors: dict[Softening | None, ca.SX] = {None: ca.SX(1)}
        if self.strains:
            reached = self.larger(s.reached, ca.if_else(primed, 0, ca.fabs(x)))
            label("reached_before", reached, "m, largest |x| before this step")
            for i, a in enumerate(self.strains, 1):
                factor = 1 / (1 + reached * (1 / a))
                text = f"softening by strain, 1/(1 + m/{a:g})"
                factors[Softening("strain", a)] = label(f"strain_{i}", factor, text)
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
        return factors

    def operate(
        self, s: Any, x: ca.SX, x_last: ca.SX, primed: ca.SX, state: dict[str, Any], label: Labels
    ) -> list[ca.SX]:
        """q(x) - F of every operator, and its memory."""
        values: list[ca.SX] = []
        memory: dict[str, list[ca.SX]] = {k: [] for k in self.of}
        for e in self.elements:
            q = ca.SX(1) if e.kind == "offset" else self.drive(e, x)
            if e.kind in memory:
                place = len(memory[e.kind])
                step = {"maxwell": self.relax, "stop": self.stop, "slip": self.slip}[e.kind]
                inner, value = step(e, s, place, q, self.drive(e, x_last), primed)
                name = {"maxwell": "relaxed", "stop": "play", "slip": "slip"}[e.kind]
                text = {"maxwell": "time, s:", "stop": "threshold", "slip": "path"}[e.kind]
                memory[e.kind].append(
                    label(f"{name}_{place + 1}", inner, f"{e.kind} branch, {text} {e.number:g}")
                )
                q = value if e.kind != "slip" else inner
            values.append(q)
        ports = {"maxwell": "relaxed_Nm", "stop": "play", "slip": "slip"}
        state |= {ports[k]: ca.vertcat(*m) for k, m in memory.items() if m}
        return values

    def relax(
        self, e: FamilyElement, s: Any, i: int, q: ca.SX, q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        a, b = maxwell_shares(self.h / e.number)
        before = ca.if_else(primed, s.relaxed_Nm[i], q)
        inner = (1 - a - b) * before + a * q + b * q_last
        return inner, q - inner

    def stop(
        self, e: FamilyElement, s: Any, i: int, q: ca.SX, _q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        inner = self.clip(ca.if_else(primed, s.play[i], q), q - e.number, q + e.number)
        return inner, q - inner

    def slip(
        self, e: FamilyElement, s: Any, i: int, q: ca.SX, q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        # Of a larger step it remembers next to nothing; so far the series' rounding stays small.
        most = threshold(SLIP_STEP * e.number)
        went = self.clip(q - q_last, -most, most)
        v = ca.fabs(went) * (1 / e.number)
        series = 1 + v * (0.5 + v * (1 / 6))
        raw = (ca.if_else(primed, s.slip[i], 0) + went * series) / (1 + v * series)
        limit = threshold(e.number)  # only rounding is clipped
        return self.clip(raw, -limit, limit), q

    def state(self) -> tuple[Port, ...]:
        rested = self.start == "virgin"
        ports = [
            Port("primed", 0.0, 1.0, "1 once a valid sample has been seen"),
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


__all__ = [
    "ROOM",
    "FamilyElement",
    "FamilyStep",
    "maxwell_shares",
    "merged_elements",
    "unit_elements",
]
