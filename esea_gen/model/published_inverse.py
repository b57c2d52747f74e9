"""The generalised play operator of the thesis with its disturbance observer (chapter 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, Literal

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Constant, Flag, Port, around, clip, status_port, threshold
from esea_gen.model.cubic import ROOT_WHOLE, cubic_root, root_facts
from esea_gen.model.forward import Forward, rate_facts, rate_split, request_port
from esea_gen.model.sections import file_tunable
from esea_gen.model.symbolic import equations, to_casadi

FilterName = Literal["a", "a_normalised", "b", "b_normalised", "b_rounding"]

PLAYS = 10

PLAY_DEFAULTS = {"kappa_rad": 0.106, "phi_1_rad": 4.84, "chi_rad": 0.00233}  # table 4.2

FILTER_B = (0.024, 0.12, 0.23, 0.20, 0.0, -0.12, 0.0, 0.20, 0.23, 0.12, 0.024)

# Inside the rounding of the printed digits, and what reproduces the published tables.
KAPPA_ROUNDING_RAD, FILTER_B_ROUNDING_GAIN = 0.10635, 1.0165

KAPPA, PHI, PLAY_R = sp.symbols("kappa phi r", positive=True)

PLAY_WEIGHT = KAPPA * sp.exp(-PHI * PLAY_R)


def filter_taps(name: FilterName) -> tuple[float, ...]:
    """Low-pass of the disturbance observer, newest first: ``a`` as used, ``b`` as printed."""
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
    """Parameters of the play operators: of section ``[inverse]``, table 4.2 where it has none."""
    given = device.file.inverse
    out = []
    for name, value in PLAY_DEFAULTS.items():
        q = getattr(given, name) if given is not None else None
        if q is None:
            out.append(Constant(name, value, "thesis table 4.2", "published"))
        else:
            out.append(q.constant(name))
    return tuple(out)


def _play_constants(device: DeviceData, arguments: Mapping[str, float | None]) -> list[Constant]:
    return [
        c if (v := arguments[c.name]) is None else Constant(c.name, v, "argument", "assumed")
        for c in play_parameters(device)
    ]


def _play_grid(kappa: Any, phi: Any, chi: Any) -> tuple[list[Any], list[Any]]:
    # Thresholds (4.9) and weights (4.8) of the play operators: numbers or symbols.
    r = [chi * j for j in range(1, PLAYS + 1)]
    return r, [to_casadi(PLAY_WEIGHT, {KAPPA: kappa, PHI: phi, PLAY_R: x}) for x in r]


def _tunable_plays(plays: Sequence[Constant]) -> dict[str, Any]:
    """The play operators' parameters as tunables, for identification."""
    tunables = tuple(file_tunable(f"inverse.{c.name}", c) for c in plays)
    high = {t.name: t.high for t in tunables}
    far, heavy = PLAYS * high["chi_rad"], high["kappa_rad"]
    coefficients = (
        Port("r_rad", 0.0, far, "thresholds of the play operators", PLAYS, "(4.9)"),
        Port("p_rad", 0.0, heavy, "weights of the play operators", PLAYS, "(4.8)"),
    )

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        grid = _play_grid(t.kappa_rad, t.phi_1_rad, t.chi_rad)
        return dict(zip(("r_rad", "p_rad"), grid, strict=True))

    return {"tunables": tunables, "coefficients": coefficients, "prepare": prepare}


# The observer closes a loop inside one step: request less the filtered disturbance of the last
# samples, play operators, forward model driven by the set-point, new disturbance.
def published_inverse(
    device: DeviceData,
    filter: FilterName | None = None,
    *,
    kappa: float | None = None,
    phi: float | None = None,
    chi: float | None = None,
    tunable: bool = False,
) -> Block:
    """The thesis' partial inverse, with or without its disturbance observer, as a Block."""
    given = {"kappa_rad": kappa, "phi_1_rad": phi, "chi_rad": chi}
    law = _Published(device, filter, given, tunable)
    return Block.of(law, **_tunable_plays(law.plays) if tunable else {})


class _Published:
    def __init__(
        self,
        device: DeviceData,
        filter: FilterName | None,
        given: Mapping[str, float | None],
        tunable: bool,
    ) -> None:
        self.tunable = tunable
        self.file = device.file
        self.h = device.period_s
        self.forward = Forward(device)
        e = device.elastomer
        self.k1, self.k3 = e.k1_Nm_rad.value, e.k3_Nm_rad3.value
        if self.k1 <= 0:
            raise UserError(
                f"{device.origin}: elastomer.k1_Nm_rad = 0: the published inverse's envelope has "
                "no slope at zero torque.",
                "Give a positive linear stiffness.",
            )
        self.taps = filter_taps(filter) if filter else ()
        self.theta_high = self.forward.block.inputs[0].high
        self.omega_high = threshold(self.file.limits.omega_rad_s.value)
        self.tau_lim = self.tau_high = threshold(self.file.limits.tau_Nm.value)
        self.plays = _play_constants(device, given)
        self.fixed_r, self.fixed_p = (
            list(map(float, x)) for x in _play_grid(*(c.value for c in self.plays))
        )
        # The envelope of the largest corrected request bounds every play state.
        self.reach = max(2 * self.theta_high, 4 * self.tau_lim / self.k1)
        self.name = "inverse" + (f"_{filter}" if filter else "_plays")
        observer = f", disturbance observer with filter {filter}" if filter else ""
        self.title = f"Published inverse: play operators{observer}"
        self.constants = (() if tunable else tuple(self.plays)) + device.constants("elastomer")
        plays = around("inverse_play_rad", self.reach, "play states", PLAYS, "(4.10, 4.11)")
        what = "model torque less corrected request, newest first"
        past = around("difference_Nm", 2 * self.tau_lim, what, len(self.taps) or 1)
        self.state = (plays, past, *self.forward.state) if self.taps else (plays,)
        self.inputs = (request_port(self.tau_lim),)
        self.equations = equations(
            PLAY_EQUATIONS + OBSERVER_EQUATIONS * bool(self.taps),
            weight=PLAY_WEIGHT.subs(PLAY_R, sp.Symbol("r_j")),
            root=ROOT_WHOLE,
        )
        self.facts, self.split = self._known(device)
        clamped = "the corrected request or the set-point was clamped"
        fast = "the set-point jumps by more than its rate allows; the model's memory is clipped"
        both, high = ("u_Nm", "theta_rad"), self.theta_high
        self.outputs = (
            around("theta_rad", high, "deflection set-point", equation="(4.7)"),
            around("u_Nm", self.tau_lim, "request corrected by the observed disturbance"),
            status_port(
                "status of this set-point",
                "an input was NaN or outside its range; taken as zero",
                "the state was corrupt; restarted",
                Flag("TORQUE_OUTSIDE", "|request| is above full scale"),
                Flag("REQUEST_CLAMPED", clamped, True, both, high),
                *((Flag("STEP_CLIPPED", fast, True),) if self.taps else ()),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        disturbance = ca.SX(0)
        for i, q in enumerate(self.taps):
            disturbance = disturbance + q * s.difference_Nm[i]
        label("disturbance_Nm", disturbance, "low-pass of the past differences")
        wanted = u.tau_Nm - disturbance
        corrected = clip(wanted, -self.tau_high, self.tau_high)
        corrected = label("corrected_Nm", corrected, "corrected request")
        envelope = cubic_root(self.k3, self.k1, corrected, label)
        envelope = label("envelope_rad", envelope, "(4.13) gamma")
        r: list[Any] = ca.vertsplit(c.r_rad) if self.tunable else self.fixed_r
        p: list[Any] = ca.vertsplit(c.p_rad) if self.tunable else self.fixed_p
        held, total = [], ca.SX(0)
        for j in range(PLAYS):
            f = ca.fmax(envelope - r[j], ca.fmin(envelope + r[j], s.inverse_play_rad[j]))
            held.append(label(f"inverse_play_{j + 1}_rad", f, f"(4.10, 4.11) play {j + 1}"))
            total = total + p[j] * f
        label("unclamped_rad", total, "(4.7), as meant")
        theta = label("set_point_rad", clip(total, -self.theta_high, self.theta_high))
        bits = [
            ca.fabs(u.tau_Nm) > threshold(self.file.domain.tau_full_scale_Nm.value),
            ca.logic_or(ca.fabs(wanted) > self.tau_high, ca.fabs(total) > self.theta_high),
        ]
        next_state: dict[str, Any] = {"inverse_play_rad": held}
        if self.taps:
            state = self.forward.of(s)
            last = self.forward.step(state, theta, 0)["label_theta_last_rad"]
            rate = (theta - last) / self.h
            omega = clip(rate, -self.omega_high, self.omega_high)
            label("omega_rad_s", omega, "rate of the step")
            model = self.forward.step(state, theta, omega)
            if self.forward.has_rate:
                label("rate_share", model["label_share"], "(1 - exp(-x))/x, third order")
            missed = model["label_tau_Nm"] - corrected
            difference = clip(missed, -2 * self.tau_high, 2 * self.tau_high)
            fast, far = ca.fabs(rate) > self.omega_high, ca.fabs(missed) > 2 * self.tau_high
            clipped = ca.logic_or(ca.logic_or(fast, far), self.forward.clipped(model))
            bits.append(clipped)
            line = [difference, *ca.vertsplit(s.difference_Nm)[: len(self.taps) - 1]]
            next_state |= {q.name: model[f"next_{q.name}"] for q in self.forward.state}
            next_state["difference_Nm"] = line
        outputs = {"theta_rad": theta, "u_Nm": corrected, "status": guard.status(*bits)}
        return next_state, outputs

    def _known(
        self, device: DeviceData
    ) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, ...]]]:
        """Facts, and where the error analysis cuts."""
        facts = root_facts(self.k3, (self.k1, self.k1), self.tau_high)
        if not self.taps:
            return facts, {}
        # The request less the disturbance is rounded: its sign is open near zero, where the root
        # is small; and the root turns from linear to cubic where b^2 passes a^3.
        high = self.tau_high
        bend = 2 * self.k3 * (self.k1 / (3 * self.k3)) ** 1.5 if self.k3 > 0 else high
        facts["corrected_Nm"] = (-high, high)
        split: dict[str, tuple[float, ...]]
        split = {"corrected_Nm": (1e-6 * high, 0.1 * bend, bend, 4 * bend)}
        split |= rate_split(self.forward, "omega_rad_s")
        if self.forward.has_rate:
            values = {c.name: c.value for c in device.constants("elastomer")}
            facts |= rate_facts(device, values, "omega_rad_s")
        return facts, split


PLAY_EQUATIONS = """
    (4.7), as meant | theta_d | Sum(p_j * F_j, (j, 1, N)) | set-point
    (4.8) | p_j | weight | weight of a play operator
    (4.9) | r_j | chi * j | threshold of a play operator
    (4.10, 4.11) | F_j | Max(gamma - r_j, Min(gamma + r_j, F{j,k-1})) | \
        play operator round the envelope
    (4.13), stable form | |gamma| | root | envelope: inverse of the cubic
"""
OBSERVER_EQUATIONS = """
    [DOB 1] | u | tau_d - d | corrected request
    [DOB 2] | d | Sum(q_i * e{k-1-i}, (i, 0, N)) | low-pass of past differences
    [DOB 3] | e | tau_act - u | new difference
"""
