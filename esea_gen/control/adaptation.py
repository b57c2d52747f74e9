"""Adaptation of the wish to the rubber at hand, learnt while a known mass hangs on the drive.

A rubber softer than its model gives less torque than the sensor shows.  Gain, loss and offset of
the wish stand outside every loop.  The motor's side cannot tell them: over the few degrees that the
rubber is wound up, the gear's disturbance looks like a stiffness of ten per cent (docs/control.md).
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.fields import ADAPTATION_STOP_NM as STOP_NM
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import (
    Flag,
    Port,
    Tunable,
    around,
    clip,
    status_port,
    threshold,
)
from esea_gen.language.stream import OwnStreams, Stream, single
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

FILTER_HZ = 2.0
"""One lag for all that is compared; the acceleration of the mass comes out of it."""
MEAN_S, LEAST_NM2 = 5.0, 0.05
"""Learnt is while the known torque's mean square about its mean of so long is above that: at rest
a gain cannot be told from an offset."""
FADE_S = 1.0
MOST_MISSED_NM, MISSED_SHARE = 0.5, 0.5
"""A model that misses the known torque by more is no rubber: the mass is not there, or another."""
SHARES = (0.5, 1.0, 0.5)
"""Of the rate: gain for 1 Nm2, loss for 1 Nm2, offset."""
MOST_RAD = 1.6
"""From where the mass hangs: beyond the horizontal nothing is compared."""


# E is the stop operator of STOP_NM on x.  While a mass hangs on the joint x is known, and gain a,
# loss c and offset o follow its gradient (B. Widrow and S. D. Stearns, "Adaptive Signal
# Processing", 1985).
def adaptation(device: DeviceData) -> Block:
    """What the sensor's model must show for a wanted torque x: a x + c E(x) + o, by LMS."""
    return Block.of(_Adaptation(device))


def shift_limit_Nm(device: DeviceData) -> float:
    """Most that loss and offset add to a wish."""
    own = section_of(device, "adaptation")
    return threshold(1.01 * (own.loss_most.value * STOP_NM + own.offset_Nm.value))


def gain_port(device: DeviceData) -> Port:
    """The wish's gain, with room for rounding beyond what may be learnt."""
    own = section_of(device, "adaptation")
    low, high = 0.99 / own.scale_most.value, 1.01 / own.scale_least.value
    return Port("wish_gain", low, high, "gain of the wish, for the rubber at hand", on_invalid=1.0)


class _Adaptation:
    def __init__(self, device: DeviceData) -> None:
        self.own, drive = section_of(device, "adaptation"), drive_of(device)
        self.h = device.period_s
        self.tau_lim, self.omega_lim = drive.tau_Nm, drive.omega_rad_s
        self.low, self.high = drive.theta_low_rad, drive.theta_high_rad
        self.full = threshold(device.tau_full_scale_Nm)
        self.gain_low = threshold(1 / self.own.scale_most.value)
        self.gain_high = threshold(1 / self.own.scale_least.value)
        self.gain_port = gain_port(device)
        self.loss_lim = threshold(self.own.loss_most.value)
        self.offset_lim = threshold(self.own.offset_Nm.value)
        self.shift_lim = shift_limit_Nm(device)
        self.follow = 1 - math.exp(-2 * math.pi * FILTER_HZ * self.h)
        self.mean = 1 - math.exp(-self.h / MEAN_S)
        self.fade = 1 - math.exp(-self.h / FADE_S)
        self.rate = self.h * self.own.rate_1_s.value
        # Gain, loss, stop's whole reach and offset at their largest, and the sensor's.
        self.missed_lim = threshold(
            1.01 * (self.tau_lim + self.gain_high * self.full + self.shift_lim)
        )
        self._ports(device)

    def _ports(self, device: DeviceData) -> None:
        self.name = "adaptation"
        self.title = "Wish for the rubber at hand, learnt with a known mass"
        self.constants = device.constants("adaptation")
        self.prepare = vars
        self.equations = equations(EQUATIONS)
        self.streams = STREAMS
        rows = (
            ("share", 0.0, 0.0, 1.0, "1: the wish is adapted; 0: it is taken as it is"),
            ("mass_Nm", 0.0, 0.0, self.full, "weight on the joint times its arm; 0: none hangs"),
            ("mass_angle_rad", 0.0, -1.57, 1.57, "angle at which it hangs straight down"),
            ("mass_kgm2", 0.0, 0.0, 2.0, "inertia of the mass and of what bears it"),
            ("mass_Nms_rad", 0.0, 0.0, 1.0, "damping of the joint that bears it"),
        )
        texts = ("model's torque over the true one", "loss that the model misses", "offset")
        names, starts = ("gain", "loss", "offset_Nm"), (1.0, 0.0, 0.0)
        found = tuple(
            (name, start, low, high, f"{text}, as an earlier adaptation found it")
            for name, start, (low, high), text in zip(
                names, starts, self.ends(), texts, strict=True
            )
        )
        self.tunables = tuple(Tunable(*row, "docs/control.md") for row in (*rows, *found))
        self.coefficients = tuple(t.port for t in self.tunables)
        ends = zip(("gain", "loss", "offset_Nm"), self.ends(), strict=True)
        more = [
            around(f"more_{name}", 1.01 * (high - low), f"{name}: learnt since the start")
            for name, (low, high) in ends
        ]
        stop = 1.01 * (self.tau_lim + STOP_NM)
        self.state = (
            Port("weighed", 0.0, 1.0, "1 when a known mass was compared in the last step"),
            around("weight_lag_Nm", 1.01 * self.full, "its torque at rest, behind the lag"),
            around("omega_lag_rad_s", 1.01 * self.omega_lim, "load side's rate behind the lag"),
            around("tau_lag_Nm", 1.01 * self.tau_lim, "sensor's torque behind the lag"),
            around("stop_known_Nm", 1.01 * (self.full + STOP_NM), "memory of its stop operator"),
            around("mean_Nm", 1.01 * self.full, "mean of the known torque"),
            Port("square_Nm2", 0.0, 4.1 * self.full**2, "mean square about it"),
            *more,
            Port("wish_gain", self.gain_port.low, self.gain_port.high, "in force", init=1.0),
            around("wish_loss", 1.01 * self.loss_lim, "in force"),
            around("wish_offset_Nm", 1.01 * self.offset_lim, "in force"),
            around("stop_wish_Nm", stop, "memory of the wish's stop operator"),
            Port("wished", 0.0, 1.0, "1 once there was a wish"),
        )
        self.inputs = (
            around("tau_desired_Nm", self.tau_lim, "wanted interaction torque"),
            around("tau_Nm", self.tau_lim, "interaction torque that the sensor shows"),
            Port("theta_load_rad", self.low, self.high, "load side's angle"),
            around("omega_load_rad_s", self.omega_lim, "load side's rate"),
            Port("sensing_ok", 0.0, 1.0, "1 while torque and angles can be trusted"),
        )
        self.outputs = (
            self.gain_port,
            around("wish_shift_Nm", self.shift_lim, "loss and offset of the wish, in force"),
            Port("gain", self.gain_low, self.gain_high, "model's torque over the true one"),
            around("loss", self.loss_lim, "stop operator's share in the model's torque"),
            around("offset_Nm", self.offset_lim, "what the model shows without torque"),
            around("missed_Nm", self.missed_lim, "sensor less what is expected of the known mass"),
            status_port(
                "what is known of it",
                "an input was NaN or outside its range; nothing is learnt",
                "the state was corrupt; what was learnt is lost",
                Flag("LEARNS", "the known mass moves: gain, loss and offset are learnt"),
                Flag("AT_BOUND", "what would be learnt lies beyond its bound"),
                Flag(
                    "IMPLAUSIBLE", "no rubber misses the known torque by so much: nothing is learnt"
                ),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        hangs = label("hangs", c.mass_Nm > 0, "a mass is known to hang on the joint")
        sound = ca.logic_and(guard.inputs_ok, u.sensing_ok >= 0.5)
        weighs = label("weighs", ca.logic_and(hangs, sound), "its torque can be compared")
        turned = u.theta_load_rad - c.mass_angle_rad
        known, filters = self.known(c, s, u, turned, weighs, label)
        near = ca.fabs(turned) <= MOST_RAD
        within = label("within", ca.logic_and(near, ca.fabs(known) <= self.full))
        x = label("known_Nm", clip(known, -self.full, self.full), "[adapt 1] true torque")
        stop, stopped = self.stop(s.stop_known_Nm, x)
        began = ca.logic_not(s.weighed)
        stopped = ca.if_else(began, x, stopped)
        stop = label("loss_Nm", ca.if_else(began, 0.0, stop), "[adapt 2] its stop operator")
        gain, loss, offset = self.totals(c, s, label)
        model = gain * x + loss * stop + offset
        missed = label("missed_Nm", filters["tau_lag_Nm"] - model, "[adapt 3]")
        off_mean = ca.if_else(began, 0.0, x - s.mean_Nm)
        square = (1 - self.mean) * s.square_Nm2 + self.mean * (off_mean * off_mean)
        square = label("square_Nm2", ca.if_else(began, 0.0, square), "of its change")
        plausible = ca.fabs(missed) <= MOST_MISSED_NM + MISSED_SHARE * ca.fabs(x)
        changes = label("changes", square > LEAST_NM2, "enough for gain and offset to be told")
        informed = ca.logic_and(ca.logic_and(weighs, within), changes)
        learns = label("learns", ca.logic_and(informed, plausible))
        step = label("step_Nm", ca.if_else(learns, self.rate * missed, 0.0), "[adapt 4]")
        by: tuple[Any, ...] = (SHARES[0] * x, SHARES[1] * stop, SHARES[2])
        ends = self.ends()
        raw = [t + step * b for t, b in zip((gain, loss, offset), by, strict=True)]
        beyond = ca.SX(0)
        learnt = {}
        for name, value, (low, high), start in zip(
            ("gain", "loss", "offset_Nm"), raw, ends, (c.gain, c.loss, c.offset_Nm), strict=True
        ):
            kept = clip(value, low, high)
            beyond = beyond + ca.fabs(value - kept)
            learnt[f"more_{name}"] = ca.if_else(learns, kept - start, vars(s)[f"more_{name}"])
        given, applied = self.applied(c, s, u, (gain, loss, offset), label)
        next_state = {
            **filters,
            "weighed": weighs,
            "stop_known_Nm": stopped,
            "mean_Nm": ca.if_else(began, x, s.mean_Nm + self.mean * off_mean),
            "square_Nm2": square,
            **learnt,
            **applied,
        }
        outputs = given | {
            "gain": gain,
            "loss": loss,
            "offset_Nm": offset,
            "missed_Nm": ca.if_else(weighs, missed, 0.0),
            "status": guard.status(
                learns, beyond > 0, ca.logic_and(informed, ca.logic_not(plausible))
            ),
        }
        return next_state, outputs

    def known(
        self, c: Any, s: Any, u: Any, turned: Any, weighs: Any, label: Labels
    ) -> tuple[ca.SX, dict[str, Any]]:
        """The mass's torque behind the lag that the sensor's goes through, and the lags."""
        angle = label("angle_rad", clip(turned, -MOST_RAD, MOST_RAD), "from where it hangs")
        square = angle * angle
        sine = angle * (1 + square * (-1 / 6 + square * (1 / 120 - square * (1 / 5040))))
        weight = label("weight_Nm", c.mass_Nm * sine, "[adapt 1] at rest")
        began = ca.logic_not(ca.logic_and(weighs, s.weighed))
        now: dict[str, Any] = {
            "weight_lag_Nm": weight,
            "omega_lag_rad_s": u.omega_load_rad_s,
            "tau_lag_Nm": u.tau_Nm,
        }
        lags: dict[str, Any] = {}
        for name, value in now.items():
            last = vars(s)[name]
            lagged = ca.if_else(began, value, last + self.follow * (value - last))
            lags[name] = label(f"next_{name}", lagged, "behind the lag")
        moves = u.omega_load_rad_s - s.omega_lag_rad_s
        alpha = ca.if_else(began, 0.0, (self.follow / self.h) * moves)
        alpha = label("alpha_rad_s2", alpha, "acceleration behind the lag")
        moved = c.mass_kgm2 * alpha + c.mass_Nms_rad * lags["omega_lag_rad_s"]
        return lags["weight_lag_Nm"] + moved, lags

    def stop(self, kept: Any, x: Any) -> tuple[Any, Any]:
        """Stop operator in play form: what it gives, and its memory."""
        play = clip(kept, x - STOP_NM, x + STOP_NM)
        return x - play, play

    def totals(self, c: Any, s: Any, label: Labels) -> list[Any]:
        names = ("gain", "loss", "offset_Nm")
        out = []
        for name, (low, high) in zip(names, self.ends(), strict=True):
            total = clip(vars(c)[name] + vars(s)[f"more_{name}"], low, high)
            out.append(label(f"total_{name}", total, "as set, and what was learnt"))
        return out

    def ends(self) -> tuple[tuple[float, float], ...]:
        return (
            (self.gain_low, self.gain_high),
            (-self.loss_lim, self.loss_lim),
            (-self.offset_lim, self.offset_lim),
        )

    def applied(self, c: Any, s: Any, u: Any, totals: tuple[Any, ...], label: Labels) -> StepResult:
        """What turns the wish, fading to it."""
        gain, loss, offset = totals
        now = {}
        for name, neutral, total in (
            ("wish_gain", 1.0, gain),
            ("wish_loss", 0.0, loss),
            ("wish_offset_Nm", 0.0, offset),
        ):
            last = vars(s)[name]
            asked = neutral + c.share * (total - neutral)
            now[name] = label(f"next_{name}", last + self.fade * (asked - last), "fading")
        stop, stopped = self.stop(s.stop_wish_Nm, u.tau_desired_Nm)
        shift = now["wish_loss"] * stop + now["wish_offset_Nm"]
        kept = {"stop_wish_Nm": ca.if_else(s.wished, stopped, u.tau_desired_Nm), "wished": 1}
        return {"wish_gain": now["wish_gain"], "wish_shift_Nm": shift}, now | kept


EQUATIONS = """
    [adapt 1] | x | tau_M + J_M * alpha + d_M * omega_l | known torque; \
        tau_M is the weight times the sine of its angle
    [adapt 2] | E | x - Max(Min(F, x + r), x - r) | stop operator, r 0.8 Nm
    [adapt 3] | e | tau_e - (a * x + c * E + o) | missed by the model
    [adapt 4] | a_k+1 | a + 0.5 * L * h * e * x | gain, by LMS
    [adapt 5] | c_k+1 | c + L * h * e * E | loss
    [adapt 6] | o_k+1 | o + 0.5 * L * h * e | offset
    [adapt 7] | tau_model | a * tau_d + c * E + o | wish, E of it
"""


COUNT = 1600


def _masses(block: Block, _dtype: np.dtype[Any], rng: np.random.Generator) -> list[Stream]:
    # The arm swings; the sensor shows the mass's torque scaled, within and beyond the bounds, none
    # of it, and after a while it is not to be trusted.
    ports = {p.name: p for p in block.inputs}
    mass = 0.6 * next(t.high for t in block.tunables if t.name == "mass_Nm")
    t = np.arange(COUNT) * block.period_s
    found = []
    ends = {t.name: (t.low, t.high) for t in block.tunables}
    swing = math.pi * t
    angle, rate = 1.2 + 1.3 * np.sin(swing), 1.3 * math.pi * np.cos(swing)
    for name, scale, offset, zero in (
        ("a mass", 1.1, 0.02, 1.2),
        ("a soft rubber", 1.6, 0.4, 1.2),
        ("a stiff rubber", 0.6, -0.4, 1.2),
        ("another mass", -1.0, 0.0, 1.2),
        ("beyond the horizontal", 1.0, 0.0, 0.0),
    ):
        torque = scale * mass * np.sin(angle - zero) + offset + 0.2 * np.sign(rate)
        sound = np.ones(COUNT)
        sound[COUNT // 2 : COUNT // 2 + 5] = 0
        sound[-2:] = np.nan
        inputs = {
            "tau_desired_Nm": rng.uniform(-3, 3, COUNT),
            "tau_Nm": np.clip(torque, 0.9 * ports["tau_Nm"].low, 0.9 * ports["tau_Nm"].high),
            "theta_load_rad": angle,
            "omega_load_rad_s": rate,
            "sensing_ok": sound,
        }
        hung = {"mass_Nm": mass, "mass_angle_rad": zero, "share": 1.0}
        if "rubber" in name:
            # As far as it may be from the start.
            hung |= {n: ends[n]["stiff" not in name] for n in ("gain", "loss", "offset_Nm")}
        changes = {0: {k: np.array([v]) for k, v in hung.items()}}
        if name == "a mass":
            changes[COUNT - 100] = {"mass_Nm": np.array([0.0])}
        found.append(Stream(name, {k: single(v) for k, v in inputs.items()}, {}, changes))
    return found


STREAMS = OwnStreams(memories=_masses)
