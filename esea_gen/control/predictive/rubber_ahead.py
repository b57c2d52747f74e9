"""The coupling's torque over a horizon: of the published model, or of a member of the family."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.control.predictive.horizon import Stops, Tape
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Guard, Labels
from esea_gen.language.ports import Constant, Port, around, clip
from esea_gen.model.elastomer import BEYOND, DEAD_ZONE, THETA, stop_grid
from esea_gen.model.family_sensor import (
    factor_in,
    family_constants,
    family_step,
    temperature_parts,
    torque_limit,
)
from esea_gen.model.family_step import FamilyStep
from esea_gen.model.rubber import fitted_of
from esea_gen.model.symbolic import to_casadi
from esea_gen.observe import drive_of

# |x|^n becomes (x^2 + eps^2)^(n/2): the derivative of |x|^0.77 is infinite at 0.  At this rate the
# term is a twentieth of eps2, and at this angle a millionth of eps1.
SMOOTH_RAD_S = 1e-4
SMOOTH_RAD = 1e-4


# What predictive control asks of a torque model.  ``states``: memory in the rollout beside the stop
# operators, which the Model keeps; ``soft_Nm_rad``: one stiffness that stands for it where the
# cable is balanced; ``choices``: numbers that are not the device file's; ``temperature``: tunables,
# coefficients and prepare; ``start``, ``step``: states and torque ``tau_e`` at the measurement, and
# after a step to ``delta``, named on the tape last.


class PublishedAhead:
    """Spring, stop operators, Maxwell element and dead zone of the published model."""

    choices: tuple[Constant, ...] = (
        Constant("smooth_rad_s", SMOOTH_RAD_S, "differentiable viscosity", "assumed"),
    )
    temperature: Mapping[str, Any] = {}

    def __init__(self, device: DeviceData) -> None:
        self.device, e = device, device.elastomer
        numbers = {c.name: c.value for c in device.constants("elastomer")}
        r, shares = stop_grid(numbers, int(e.stops.value))
        self.stops = Stops(tuple(map(float, r)), tuple(float(w) for w in shares))
        self.dead = numbers.get("dead_zone_rad", 0.0)
        self.k1, self.k3 = numbers["k1_Nm_rad"], numbers["k3_Nm_rad3"]
        self.maxwell = (
            {c.name: c.value for c in device.constants("elastomer.maxwell")} if e.maxwell else None
        )
        # Half of the Maxwell element's spring: its dashpot gives way within a substep or not.
        give = 0.5 * self.maxwell["kv_Nm_rad"] if self.maxwell else 0.0
        self.soft_Nm_rad = self.k1 + sum(self.stops.p) + give
        self.states: tuple[str, ...] = ("tau_r",) * (self.maxwell is not None)
        self.stop_operators: Mapping[str, Any] = {
            "stops": self.stops,
            "play": "play_rad",
            "deflection": lambda u: self.beyond(u.delta_rad),
        }

    def constants(self) -> tuple[Constant, ...]:
        return self.device.constants("elastomer")

    def ports(self) -> tuple[Port, ...]:
        drive = drive_of(self.device)
        tau_rate = around("tau_rate_Nm", drive.tau_Nm, "sensor: Maxwell element's torque")
        text = "sensor: play states of the stop operators"
        play = around("play_rad", 2 * drive.delta_rad, text, len(self.stops.r), "(3.5-3.7)")
        return (*((tau_rate,) if self.maxwell else ()), play)

    def beyond(self, delta: Any) -> Any:
        """(8.7/8.8): the deflection beyond the dead zone."""
        return to_casadi(BEYOND, {THETA: delta, DEAD_ZONE: self.dead}) if self.dead else delta

    def spring(self, d: Any) -> Any:
        """(3.2)."""
        return d * (self.k1 + self.k3 * d * d)

    def start(self, u: SimpleNamespace, tau_memory: Any) -> dict[str, Any]:
        tau_r = u.tau_rate_Nm if self.maxwell else 0.0
        return {
            **({"tau_r": tau_r} if self.maxwell else {}),
            "tau_e": self.spring(self.beyond(u.delta_rad)) + tau_r + tau_memory,
        }

    def step(
        self, t: Tape, h: float, x: SimpleNamespace, delta: Any, moved: Any, p: SimpleNamespace
    ) -> dict[str, Any]:
        stretch = t.let("stretch", self.beyond(delta)) if self.dead else delta
        tau_memory = t.memory(stretch)
        if moved is None:
            moved = t.keep("followed", delta - x.delta)
        tau_r = self.rate_torque(t, h, x, stretch, moved) if self.maxwell else 0.0
        tau_e = t.let("tau_e_next", self.spring(stretch) + tau_r + tau_memory)
        return {**({"tau_r": tau_r} if self.maxwell else {}), "tau_e": tau_e}

    def rate_torque(self, t: Tape, h: float, x: SimpleNamespace, stretch: Any, moved: Any) -> Any:
        """(3.3, 3.4): the Maxwell element as the sensor has it, viscosity at mid-step."""
        m = self.maxwell
        assert m is not None
        last = self.beyond(x.delta) if self.dead else x.delta
        change = t.keep("change", stretch - last) if self.dead else moved
        rate = change * (1 / h)
        middle = t.keep("middle", last + 0.5 * change)
        by_angle = t.power("by_angle", middle**2 + SMOOTH_RAD**2, m["m"] / 2)
        by_rate = t.power("by_rate", rate**2 + SMOOTH_RAD_S**2, m["n"] / 2)
        gain = m["A_Nms_rad"] * by_angle + m["eps1_Nms_rad"]
        drag = m["B"] * by_rate + m["eps2"]
        ratio = t.keep("ratio", h * m["kv_Nm_rad"] * drag / gain)
        series = t.keep("series", 1 + ratio * (0.5 + ratio * (1 / 6)))
        decay = t.keep("decay", 1 / (1 + ratio * series))
        share = t.keep("share", m["kv_Nm_rad"] * series * decay)

        def relaxed_by(_: Any) -> Any:
            by_series = 0.5 + ratio * (1 / 3)
            gained = m["kv_Nm_rad"] * change * (by_series - series * series)
            return decay * decay * (gained - x.tau_r * (series + ratio * by_series))

        slopes = {x.tau_r: lambda _: decay, change: lambda _: share, ratio: relaxed_by}
        relaxed = t.keep("relaxed", x.tau_r * decay + change * share, slopes)
        return t.let("tau_r_next", relaxed)


class FamilyAhead:
    """A member of the family: the sensor Block's own step and states, at the substep's length."""

    choices: tuple[Constant, ...] = ()
    stop_operators: Mapping[str, Any] = {}

    def __init__(self, device: DeviceData) -> None:
        self.device, self.fitted = device, fitted_of(device)
        self.temperature: Mapping[str, Any] = temperature_parts(device, self.fitted)
        steps = self._step(device.period_s)
        self.reach = steps.theta_lim
        # The deflection of the last step is the rollout's own; its start is always a valid one.
        own = ("primed", "theta_prev_rad")
        self.kept = tuple(p for p in steps.state() if p.name not in own)
        self.states = tuple(n for p in self.kept for n in _elements(p))
        self.soft_Nm_rad = self._soft(device.file.domain.theta_max_rad.value)

    def _soft(self, theta_rad: float) -> float:
        # Between the least and the largest near 0, where slips and stops count most; and half of
        # the springs' largest, so that a balance at large deflections comes nearer at each step.
        fitted = self.fitted
        near = fitted.least_slope_Nm_rad(0.0) + fitted.most_slope_Nm_rad(0.0)
        springs = (
            w * t.rise.most_slope(theta_rad / fitted.scale_rad)
            for w, t in fitted.used
            if t.kind == "spring"
        )
        return 0.5 * max(near, fitted.factors[1] * sum(springs) / fitted.scale_rad)

    def _step(self, h: float) -> FamilyStep:
        family = self.device.file.family
        assert family is not None
        return family_step(self.device, self.fitted, family.start, derived=True, period_s=h)

    def constants(self) -> tuple[Constant, ...]:
        return family_constants(self.device, self.fitted)

    def ports(self) -> tuple[Port, ...]:
        limit = torque_limit(self.device, self.fitted)
        return (
            around("tau_Nm", limit, "sensor: torque"),
            *(Port(p.name, p.low, p.high, f"sensor: {p.meaning}", p.size) for p in self.kept),
        )

    def start(self, u: SimpleNamespace, tau_memory: Any) -> dict[str, Any]:
        found = {n: x for p in self.kept for n, x in _split(p, getattr(u, p.name))}
        return found | {"tau_e": u.tau_Nm}

    def _within(self, t: Tape, name: str, d: Any) -> Any:
        # Terms of high powers would make a plan that leaves the sensor's range worth nothing.
        held = clip(d, -self.reach, self.reach)
        return t.keep(name, held, {d: lambda _: ca.fabs(d) < self.reach})

    def step(
        self, t: Tape, h: float, x: SimpleNamespace, delta: Any, moved: Any, p: SimpleNamespace
    ) -> dict[str, Any]:
        memory = {p.name: ca.vertcat(*(getattr(x, n) for n in _elements(p))) for p in self.kept}
        last = self._within(t, "last_within", x.delta)
        s = SimpleNamespace(primed=ca.SX(1), theta_prev_rad=last, **memory)
        guard = Guard(inputs_ok=ca.SX(1), state_ok=ca.SX(1))
        within = self._within(t, "within", delta)
        state, sums = self._step(h).torque(s, within, guard, _OnTape(t), factor_in(p))
        found = {n: v for p in self.kept for n, v in _split(p, state[p.name])}
        return found | {"tau_e": t.let("tau_e_next", sum(sums.values()))}


class _OnTape(Labels):
    # What the sensor's step names is kept for its derivatives.
    def __init__(self, tape: Tape) -> None:
        super().__init__()
        self.tape = tape

    def __call__(self, name: str, value: ca.SX, comment: str = "") -> ca.SX:
        return self.tape.keep(f"rubber_{name}", value)


def _elements(port: Port) -> list[str]:
    return [port.name] if port.size == 1 else [f"{port.name}_{i}" for i in range(port.size)]


def _split(port: Port, column: Any) -> list[tuple[str, Any]]:
    return list(zip(_elements(port), ca.vertsplit(ca.SX(column)), strict=True))


RubberAhead = PublishedAhead | FamilyAhead


def rubber_ahead(device: DeviceData) -> RubberAhead:
    return PublishedAhead(device) if device.file.family is None else FamilyAhead(device)
