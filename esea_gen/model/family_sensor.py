"""A member of the elastomer family as a Block, and the Block of its unit terms, which fits it.

Both are the same step.  The first has the weights folded in, and terms that share an operator
merged: Maxwell branches are linear in what drives them, so that those of one time and one softening
need one state, whatever number of rises drives them.  The second gives one output for each term, so
that the weights can be solved for from what the very code makes of a recording.

The steps are exact for a q that is linear within the step: Maxwell as the convex combination
y+ = (1 - a - b) y + a q+ + b q of its relaxed part y, which stays inside what has driven it however
it is rounded; slip with exp(v) replaced by its third-order series, which keeps |z| <= L and the
steady state exact; stop in its play form, in which nothing is summed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import sympy as sp

from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Constant, Flag, Port, around, clip, flag_word, threshold
from esea_gen.model.family import PATH_BAND, FittedMember, Member, Rise, Softening, Start
from esea_gen.model.symbolic import equation

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

_PARTS = {"spring": "spring", "offset": "spring", "maxwell": "rate"}
# Ranges of states are this much wider than what arithmetic without rounding can reach.
ROOM = 1.01
# A slip operator's longest step, over its path.
SLIP_STEP = 8.0
# Of the Block of unit terms: x, far beyond any recording.
UNIT_REACH = 16.0

Drive = tuple[tuple[float, Rise], ...]
Gain = tuple[float, Softening | None, int]


@dataclass(frozen=True)
class _Element:
    """One operator with one state: what drives it, and what its value is multiplied with.

    gains: weight, softening and column of the result.
    """

    kind: str
    number: float
    drive: Drive
    gains: tuple[Gain, ...]

    def most(self, reach: float) -> float:
        return sum(w * rise.most(reach) for w, rise in self.drive)


def _unit_elements(member: Member) -> tuple[_Element, ...]:
    """Every term by itself, with weight 1."""
    out = []
    for column, t in enumerate(member.terms):
        drive: Drive = ((1.0, t.rise),)
        for number, share in t.shares or ((0.0, 1.0),):
            out.append(_Element(t.kind, number, drive, ((share, t.softening, column),)))
    return tuple(out)


def merged_elements(fitted: FittedMember) -> tuple[_Element, ...]:
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
        _Element(kind, number, tuple(drive), ((share, soft, 0),))
        for (kind, number, share, soft), drive in linear.items()
    ]
    out += [
        _Element(kind, number, ((1.0, rise),), tuple(gains))
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
        elements: Sequence[_Element],
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
        return ca.if_else(a > b, a, b) if self.derived else ca.fmax(a, b)

    def clip(self, x: ca.SX, low: Any, high: Any) -> ca.SX:
        if not self.derived:
            return clip(x, low, high)
        return ca.if_else(x > high, high, ca.if_else(x < low, low, x))

    def drive(self, e: _Element, x: ca.SX) -> ca.SX:
        total = ca.SX(0)
        for weight, rise in e.drive:
            total = total + (rise(x) if weight == 1.0 else weight * rise(x))
        return total

    def run(
        self, s: Any, theta: ca.SX, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], list[tuple[_Element, ca.SX, dict[Softening | None, ca.SX]]]]:
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
        self, s: Any, theta: ca.SX, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, ca.SX]]:
        """The next state, and the torque of the springs, of the branches and of the hysteresis."""
        state, parts = self.run(s, theta, guard, label)
        sums = {"spring": ca.SX(0), "rate": ca.SX(0), "hysteresis": ca.SX(0)}
        for e, value, factors in parts:
            gain = ca.SX(0)
            for weight, softening, _ in e.gains:
                gain = gain + weight * factors[softening]
            part = _PARTS.get(e.kind, "hysteresis")
            sums[part] = sums[part] + gain * value
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
        self, e: _Element, s: Any, i: int, q: ca.SX, q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        a, b = maxwell_shares(self.h / e.number)
        before = ca.if_else(primed, s.relaxed_Nm[i], q)
        inner = (1 - a - b) * before + a * q + b * q_last
        return inner, q - inner

    def stop(
        self, e: _Element, s: Any, i: int, q: ca.SX, _q_last: ca.SX, primed: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        inner = self.clip(ca.if_else(primed, s.play[i], q), q - e.number, q + e.number)
        return inner, q - inner

    def slip(
        self, e: _Element, s: Any, i: int, q: ca.SX, q_last: ca.SX, primed: ca.SX
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


def unit_terms(member: Member, period_s: float) -> Block:
    """A member's terms, each with weight 1: what its weights are solved from.

    Parameters
    ----------
    member : Member
        Its form.
    period_s : float
        Of the grid of the recordings.

    Returns
    -------
    Block
        Input ``theta_rad``, here the scaled deflection x; output ``terms_Nm``, one element a term.
    """
    steps = FamilyStep(
        _unit_elements(member),
        scale_rad=1.0,
        theta_lim=UNIT_REACH,
        period_s=period_s,
        start="virgin",
    )
    count = len(member.terms)

    def step(
        c: Any, s: Any, u: Any, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        state, parts = steps.run(s, u.theta_rad, guard, label)
        columns = [ca.SX(0)] * count
        for e, value, factors in parts:
            for weight, softening, column in e.gains:
                columns[column] = columns[column] + weight * value * factors[softening]
        return state, {"terms_Nm": ca.vertcat(*columns)}

    reach = 4 * max(1.0, *(e.most(UNIT_REACH) * len(steps.elements) for e in steps.elements))
    return Block.define(
        "terms",
        f"Unit terms of {member.name}",
        period_s=period_s,
        state=steps.state(),
        inputs=(around("theta_rad", UNIT_REACH, "x", on_invalid="theta_prev_rad"),),
        outputs=(around("terms_Nm", reach, "terms of weight 1", count),),
        step=step,
    )


def torque_limit(device: DeviceData, fitted: FittedMember) -> float:
    """The device's limit, or what the model can reach: the inverse is of an unclipped torque.

    Parameters
    ----------
    device : DeviceData
        Limits.
    fitted : FittedMember
        The model.

    Returns
    -------
    float
        Nm, a float32 number.
    """
    reach = fitted.most_Nm(device.file.limits.theta_rad.value)
    return threshold(max(device.file.limits.tau_Nm.value, ROOM * reach))


def family_step(
    device: DeviceData, fitted: FittedMember, start: Start, derived: bool = False
) -> FamilyStep:
    """The step of a fitted member: the one place where sensor and inverse have it from.

    Parameters
    ----------
    device : DeviceData
        Limits and rate.
    fitted : FittedMember
        The model.
    start : {"virgin", "conditioned"}
        As in :func:`family_sensor`.
    derived : bool
        Whether its derivative will be taken.

    Returns
    -------
    FamilyStep
        With the weights folded in, terms merged.
    """
    return FamilyStep(
        merged_elements(fitted),
        scale_rad=fitted.scale_rad,
        theta_lim=threshold(device.file.limits.theta_rad.value),
        period_s=device.period_s,
        start=start,
        derived=derived,
    )


def family_sensor(device: DeviceData, fitted: FittedMember, start: Start = "virgin") -> Block:
    """A fitted member as a torque sensor Block, with the ports of the thesis' one.

    Parameters
    ----------
    device : DeviceData
        Domain, limits and rate.
    fitted : FittedMember
        The model.
    start : {"virgin", "conditioned"}
        What the softening remembers at the start: nothing, or a long time at the largest trained
        deflection.

    Returns
    -------
    Block
        Inputs ``theta_rad`` and ``omega_rad_s`` (which only the status word looks at); outputs the
        torque, its parts and a status word.
    """
    file = device.file
    theta_lim = threshold(file.limits.theta_rad.value)
    omega_lim = threshold(file.limits.omega_rad_s.value)
    tau_lim = torque_limit(device, fitted)
    domain = file.domain
    steps = family_step(device, fitted, start)
    full_scale = threshold(domain.tau_full_scale_Nm.value)
    theta_most = threshold(domain.theta_max_rad.value)
    omega_most = threshold(domain.omega_max_rad_s.value)

    def step(
        c: Any, s: Any, u: Any, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        state, sums = steps.torque(s, u.theta_rad, guard, label)
        sums = {k: label(f"tau_{k}_Nm", v, f"{k}: sum of its terms") for k, v in sums.items()}
        tau = label("tau_Nm", sums["spring"] + sums["rate"] + sums["hysteresis"], "torque")
        status = flag_word(
            [
                ca.logic_not(guard.inputs_ok),
                ca.logic_not(guard.state_ok),
                ca.fabs(u.theta_rad) > theta_most,
                ca.fabs(u.omega_rad_s) > omega_most,
                ca.fabs(tau) > full_scale,
            ]
        )
        outputs = {f"tau_{k}_Nm": clip(v, -tau_lim, tau_lim) for k, v in sums.items()}
        outputs |= {"tau_Nm": clip(tau, -tau_lim, tau_lim), "status": status}
        return state, outputs

    return Block.define(
        "sensor",
        f"Elastomer torque sensor: {fitted.member.title}",
        period_s=device.period_s,
        constants=_constants(fitted),
        state=steps.state(),
        inputs=_inputs(theta_lim, omega_lim),
        outputs=_outputs(tau_lim, full_scale),
        equations=_equations(),
        step=step,
    )


def _constants(fitted: FittedMember) -> tuple[Constant, ...]:
    scale = Constant("scale_rad", fitted.scale_rad, "largest trained deflection", "identified")
    weights = (
        Constant(f"w{i}_Nm", w, t.text, "identified") for i, (w, t) in enumerate(fitted.used, 1)
    )
    return (scale, *weights)


def _inputs(theta_lim: float, omega_lim: float) -> tuple[Port, ...]:
    text = "deflection: motor-side minus load-side angle"
    rate = "deflection rate in the middle of the step"
    return (
        around("theta_rad", theta_lim, text, on_invalid="theta_prev_rad"),
        around("omega_rad_s", omega_lim, rate, on_invalid=0.0),
    )


def _outputs(tau_lim: float, full_scale: float) -> tuple[Port, ...]:
    flags = (
        Flag("INPUT_INVALID", "an input was NaN or outside its physical range", True),
        Flag("STATE_REPAIRED", "the state was corrupt; the model was started afresh", True),
        Flag("THETA_OUTSIDE", "|deflection| is outside the identified domain"),
        Flag("RATE_OUTSIDE", "|deflection rate| is outside the identified domain"),
        Flag("TORQUE_OUTSIDE", "|torque| is above full scale", False, ("tau_Nm",), full_scale),
    )
    part = "part of the torque on the load"
    return (
        around("tau_Nm", tau_lim, "interaction torque on the load"),
        around("tau_spring_Nm", tau_lim, f"springs and offset: {part}"),
        around("tau_rate_Nm", tau_lim, f"Maxwell branches: {part}"),
        around("tau_hysteresis_Nm", tau_lim, f"stop and slip operators: {part}"),
        Port("status", 0, 2 ** len(flags) - 1, "what is known of this sample", flags=flags),
    )


def _equations() -> tuple[Any, ...]:
    x, q, last, inner = sp.symbols("x q q_k-1 F_k-1")
    a, b, r, length, m, moved = sp.symbols("a b r L m s", positive=True)
    weight, factor, value, index = (
        sp.Symbol("w_i"),
        sp.Symbol("d_i"),
        sp.Symbol("z_i"),
        sp.Symbol("i"),
    )
    total = sp.Sum(weight * factor * value, (index, 1, sp.Symbol("N")))
    return (
        equation("[family]", "tau", total, "every weight 0 or above"),
        equation(
            "[rise]", "q", x / (1 + sp.Abs(x) / a), "a rise that bends; others are x, x^3, x^5"
        ),
        equation("[maxwell]", "F", (1 - a - b) * inner + a * q + b * last, "z = q - F"),
        equation("[stop]", "F", sp.Max(sp.Min(inner, q + r), q - r), "z = q - F"),
        equation("[slip]", "z'", 1 - sp.Symbol("z") * sp.sign(q - last) / length, "over q; Dahl"),
        equation("[strain]", "d", 1 / (1 + m / a), "m: largest |x| before this step"),
        equation("[path]", "d", sp.exp(-moved / length), "s: path before this step"),
    )


__all__ = [
    "FamilyStep",
    "family_sensor",
    "family_step",
    "maxwell_shares",
    "torque_limit",
    "unit_terms",
]
