"""Extrapolation of the desired torque over a horizon, from its past."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, Tunable, around, clip, status_port, threshold
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream, single
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

# On the standard plant 4 Hz lags by too much at 1.5 Hz (0.15 Nm), 24 Hz gives no more than 16.
BANDWIDTH_HZ, BANDWIDTH_LOW_HZ = 16.0, 0.5
# For a governor the rate dies away over it.
FADE_S = 1.0
# Second differences of the increments that halve the bandwidth: what noise of 4 mNm makes.  A sine
# of 3 Nm and 1 Hz makes 0.1 mNm.
QUIET_NM, QUIET_LOW_NM, QUIET_HIGH_NM = 0.018, 1e-3, 1.0
NOISE_S = 0.2
# So many times as much noise, and half of the motion is believed: it is no longer seen in time.
MANY_NOISES, LOUDEST = 10.0, 100.0
# An increment that differs from the median of three by more is a step: it says nothing of what
# follows.  With noise, by more than a multiple of it.
STEP_NM, STEP_NOISES = 0.01, 4.0
# What counts as a whole step, and how long it is remembered.
JUMP_NM, STEPPED_S = 0.1, 0.15
# The fastest that is believed: full torque to and fro at this frequency.
FASTEST_HZ = 3.0
# Frequency of the wish's swing: averaging time, highest value, and the rate below which there is
# no swing.  LAG_S: the longest lag of an observer pole that is compensated, its lag without noise.
SWING_S, SWING_HZ, STILL_NM_S, LAG_S = 0.5, 4.0, 1e-3, 0.012
# The swing decays with SWUNG_S (without decay, 4 Nm at 0.5 Hz has a sixth more error) and is
# continued by TURN_RAD at most; so many terms of the series give single precision there.
SWUNG_S, TURN_RAD, TERMS = 2.0, 1.5 * math.pi, 11
# As the motor's effective torque rises between these shares of its limit, less and less of a fast
# swing is requested; swings slower than SLOW_HZ are requested whole.
EFFORT_S, EFFORTS, SLOW_HZ = 0.5, (0.65, 0.78), 0.5


# A step moves the observer with it and leaves rate and acceleration alone: then the held torque is
# asked for, to the bit.  A step is an increment beside the median of the last three.  Noise, by the
# second difference of the increments, lowers the bandwidth, and much of it the share that is
# believed.  Along the horizon the wish continues as a sine about a middle, with the observer's rate
# and acceleration; a parabola predicted 6 Nm and more for a sine of 2 Nm at 2 Hz.
def trend(device: DeviceData, ends_s: Sequence[float] = (), name: str = "trend") -> Block:
    """Predict the desired torque from its past."""
    return Block.of(_Trend(device, ends_s, name))


class _Trend:
    def __init__(self, device: DeviceData, ends_s: Sequence[float], name: str) -> None:
        drive = drive_of(device)
        self.h, self.tau_lim, self.by = drive.control_period_s, drive.tau_Nm, drive.torque_scale
        self.ends_s = tuple(ends_s)
        self.high_Hz = 0.1 / self.h
        fastest_Hz = SWING_HZ if self.ends_s else FASTEST_HZ
        self.rate_lim, self.acc_lim = motion_limits(device, fastest_Hz)
        self.quiet = self.by * QUIET_NM, self.by * QUIET_LOW_NM, self.by * QUIET_HIGH_NM
        self.keep_noise = math.exp(-self.h / NOISE_S)
        self.keep_step = math.exp(-self.h / STEPPED_S)
        self.step_lim = 2 * self.tau_lim
        # Between two increments of opposite sign and the middle one.
        self.noise_lim = threshold(4.04 * self.step_lim)
        # The observer never needs to be farther off than from one end of the range to the other.
        self.miss_lim = threshold(2 * self.step_lim)
        self.keep_swing = math.exp(-self.h / SWING_S)
        self.keep_effort = math.exp(-self.h / EFFORT_S)
        self.u_lim = drive.u_Nm
        self.name = name
        self.title = "Desired torque, extrapolated from its past"
        self.coefficients = (
            Port("quick", 0.0, 1.0, "1 minus the pole, without noise"),
            Port("noises_1_Nm", 0.0, 1.01 / self.quiet[1], "1 / noise that halves the bandwidth"),
        )
        self.inputs: tuple[Port, ...] = (
            around("tau_wanted_Nm", self.tau_lim, "present desired torque", on_invalid="last_Nm"),
        )
        if self.ends_s:
            self.inputs += (around("u_Nm", self.u_lim, "present command", on_invalid=0.0),)
        self.equations = equations(EQUATIONS + (ALONG if self.ends_s else ""))
        self.streams = OwnStreams(_events)
        own, low = min(BANDWIDTH_HZ, self.high_Hz), min(BANDWIDTH_LOW_HZ, 0.5 * self.high_Hz)
        sees = "bandwidth without noise: higher follows changes sooner"
        quiet = "noise that halves the bandwidth: lower is calmer"
        source = "docs/trend.md"
        self.tunables = (
            Tunable("bandwidth_Hz", own, low, self.high_Hz, sees, source),
            Tunable("quiet_Nm", *self.quiet, quiet, source),
        )
        self.state: tuple[Port, ...] = (
            Port.flag("primed", "1 once a valid value has been seen"),
            around("last_Nm", self.tau_lim, "desired torque of the last step"),
            around("raw_Nm", self.step_lim, "last two increments, newest first", 2),
            around("grown_Nm", self.step_lim, "last two increments without steps", 2),
            Port("noise_Nm", 0.0, self.noise_lim, "mean second difference of the increments"),
            Port("stepped", 0.0, 1.0, "1 after a step, decaying"),
            around("miss_Nm", self.miss_lim, "desired torque minus the observer's estimate"),
            around("rate_Nm_s", self.rate_lim, "rate of the desired torque"),
            around("acc_Nm_s2", self.acc_lim, "second derivative"),
        )
        if self.ends_s:
            most = threshold(1.01 * self.rate_lim**2), threshold(1.01 * self.acc_lim**2)
            self.state += (
                Port("rates_Nm2_s2", 0.0, most[0], "mean square of the rate"),
                Port("accs_Nm2_s4", 0.0, most[1], "mean square of the acceleration"),
                Port("effort", 0.0, 1.01, "mean square of the command relative to the largest"),
            )
        n = len(self.ends_s)
        ahead = around("tau_ahead_Nm", self.tau_lim, "desired torque at interval ends", n or 1)
        self.outputs = (
            *((ahead,) if n else ()),
            around("tau_rate_Nm_s", self.rate_lim, "present rate of the desired torque"),
            around("tau_curve_Nm_s2", self.acc_lim, "present second derivative"),
            Port("trust", 0.0, 1.0, "trust in rate and acceleration, 0 to 1"),
            Port("settled", 0.0, 1.0, "0 after a step, rising to 1"),
            status_port(
                "status",
                "the input was NaN or outside its range; the last one is used",
                "the state was corrupt; restarted",
                Flag("CLIPPED", "rate or acceleration was clipped at its range", True),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return {
            "quick": 1 - ca.exp(-2 * math.pi * self.h * t.bandwidth_Hz),
            "noises_1_Nm": 1 / t.quiet_Nm,
        }

    def increment(self, s: Any, fresh: ca.SX, label: Labels) -> tuple[ca.SX, ca.SX]:
        """The increment without its step part, and that part."""
        first, second = ca.vertsplit(s.raw_Nm)
        least, most = ca.fmin(first, second), ca.fmax(first, second)
        middle = label("median_Nm", ca.fmax(least, ca.fmin(most, fresh)), "median of three")
        aside = label("aside_Nm", fresh - middle, "what a step adds")
        room = label("room_Nm", self.by * STEP_NM + STEP_NOISES * s.noise_Nm, "what counts in full")
        # In full up to the room, less beyond it, nothing from twice the room on.
        left = ca.fmax(2 * room - ca.fabs(aside), 0)
        kept = clip(aside, -left, left)
        step = label("step_Nm", ca.fabs(aside - kept), "what a step has added")
        return label("increment_Nm", middle + kept, "increment without a step"), step

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        ok, h = guard.inputs_ok, self.h
        primed = ca.logic_or(s.primed, ok)
        fresh = label("fresh_Nm", ca.if_else(s.primed, u.tau_wanted_Nm - s.last_Nm, 0), "increment")
        grown, jump = self.increment(s, fresh, label)
        share = ca.fmin(jump * (1 / (self.by * JUMP_NM)), 1)
        stepped = label("stepped", ca.fmax(share, self.keep_step * s.stepped), "a step of late")
        one, two = ca.vertsplit(s.grown_Nm)
        bend = ca.fabs(grown - 2 * one + two)
        keep = self.keep_noise
        noise = label("noise_Nm", (1 - keep) * bend + keep * s.noise_Nm, "what is no motion")
        # At once with the first sample that is off: a rate taken from it would last.
        worst = ca.fmax(noise, bend)
        loud = label("loud", ca.fmin(c.noises_1_Nm * worst, LOUDEST), "noise over what halves it")
        q = label("q", c.quick / (1 + loud), "1 less the pole")
        pole = 1 - q
        moved = h * (s.rate_Nm_s + 0.5 * h * s.acc_Nm_s2)
        miss = label("innovation_Nm", s.miss_Nm + grown - moved, "innovation")
        rate = s.rate_Nm_s + h * s.acc_Nm_s2 + (1.5 / h) * (q * q * (1 + pole)) * miss
        acc = s.acc_Nm_s2 + (1 / h**2) * (q * q * q) * miss
        full = ca.logic_or(ca.fabs(rate) > self.rate_lim, ca.fabs(acc) > self.acc_lim)
        rate = label("rate_Nm_s", clip(rate, -self.rate_lim, self.rate_lim), "rate")
        acc = label("acc_Nm_s2", clip(acc, -self.acc_lim, self.acc_lim), "acceleration")
        left = clip((pole * pole * pole) * miss, -self.miss_lim, self.miss_lim)
        many = ca.fmin(c.noises_1_Nm * noise, LOUDEST) * (1 / MANY_NOISES)
        trust = label("trust", 1 / (1 + many * many), "trust in rate and acceleration")
        seen = SimpleNamespace(rate=rate, acc=acc, trust=trust, q=q)
        ahead, means = self.along(s, u, seen, label) if self.ends_s else ([], {})
        next_state = {
            "primed": primed,
            "last_Nm": u.tau_wanted_Nm,
            "raw_Nm": [fresh, s.raw_Nm[0]],
            "grown_Nm": [grown, one],
            "noise_Nm": noise,
            "stepped": stepped,
            "miss_Nm": left,
            "rate_Nm_s": rate,
            "acc_Nm_s2": acc,
            **means,
        }
        outputs = {
            **({"tau_ahead_Nm": ahead} if ahead else {}),
            "tau_rate_Nm_s": rate,
            "tau_curve_Nm_s2": acc,
            "trust": trust,
            "settled": 1 - stepped,
            "status": guard.status(full),
        }
        return next_state, outputs

    def along(
        self, s: Any, u: Any, seen: SimpleNamespace, label: Labels
    ) -> tuple[list[Any], dict[str, Any]]:
        """Desired torque at interval ends, and the means that it depends on."""

        def mean(name: str, keep: float, value: Any) -> Any:
            return label(name, (1 - keep) * value * value + keep * vars(s)[name], "mean square")

        means = {
            "rates_Nm2_s2": mean("rates_Nm2_s2", self.keep_swing, seen.rate),
            "accs_Nm2_s4": mean("accs_Nm2_s4", self.keep_swing, seen.acc),
            "effort": mean("effort", self.keep_effort, u.u_Nm * (1 / self.u_lim)),
        }
        most = (2 * math.pi * SWING_HZ) ** 2
        # Of the sampled pole, a quarter of a step more than its sum.
        lag = label("lag_s", ca.fmin(self.h * (1 / seen.q - 0.75), LAG_S), "of one pole")
        w2 = ca.fmin(
            means["accs_Nm2_s4"] / (means["rates_Nm2_s2"] + (self.by * STILL_NM_S) ** 2), most
        )
        w2 = ca.fmin(w2 / (1 - 9 * lag * lag * w2), most)
        w2 = label("swing_1_s2", w2, "[trend 5] square of how fast it goes to and fro")
        y = w2 * lag * lag
        first = label("first_Nm_s", seen.rate - 3 * lag * seen.acc, "[trend 6] rate at three lags")
        rate = label("now_Nm_s", (1 - 3 * y) * first + (3 - y) * lag * seen.acc, "[trend 7]")
        acc = (1 - 3 * y) * seen.acc - (3 - y) * lag * w2 * first
        acc = label("now_Nm_s2", acc, "[trend 8]")
        low, high = (x * x for x in EFFORTS)
        room = clip((high - means["effort"]) * (1 / (high - low)), 0.0, 1.0)
        fast = w2 * w2 / (w2 * w2 + (2 * math.pi * SLOW_HZ) ** 4)
        share = 1 - seen.trust * fast * (1 - room)
        share = label("share", share, "[trend 9] what the motor can follow")
        middle = (1 - share) * acc / ca.fmax(w2, 1.0)
        longest_s2 = label("longest_s2", TURN_RAD**2 / ca.fmax(w2, 1.0), "how far it swings on")
        ahead = []
        for t in self.ends_s:
            by_rate, by_acc = swung(w2, t, longest_s2)
            moved = math.exp(-t / SWUNG_S) * seen.trust * (by_rate * rate + by_acc * acc)
            value = u.tau_wanted_Nm + share * moved + middle
            ahead.append(clip(value, -self.tau_lim, self.tau_lim))
        return ahead, means


def swung(w2: Any, t: float, longest_s2: Any) -> tuple[Any, Any]:
    """Increment by rate and acceleration of a sine in a time, TURN_RAD at most: two series."""
    y = -ca.fmin(w2 * t**2, TURN_RAD**2)
    sine = cosine = 0.0
    for k in reversed(range(TERMS)):
        sine = 1 / math.factorial(2 * k + 1) + y * sine
        cosine = 1 / math.factorial(2 * k + 2) + y * cosine
    return t * sine, ca.fmin(longest_s2, t**2) * cosine


def motion_limits(device: DeviceData, fastest_Hz: float = FASTEST_HZ) -> tuple[float, float]:
    """Largest plausible rate and acceleration of a desired torque."""
    turn, full = 2 * math.pi * fastest_Hz, device.tau_full_scale_Nm
    return threshold(turn * full), threshold(turn * turn * full)


def faded(t_s: float) -> tuple[float, float]:
    """Increment by rate and acceleration: integrals to t of exp(-x/T) and x exp(-x/T)."""
    left = math.exp(-t_s / FADE_S)
    by_rate = FADE_S * (1 - left)
    return by_rate, FADE_S * (by_rate - t_s * left)


EQUATIONS = """
    [trend 1] | q | q_0 / (1 + nu / nu_h) | nu: mean second difference; p = 1 - q
    [trend 2] | epsilon_+ | p**3 * epsilon | what the observer still misses
    [trend 3] | r_+ | r + h * a + 3/2 * q**2 * (1 + p) / h * epsilon |
    [trend 4] | a_+ | a + q**3 / h**2 * epsilon | rate and acceleration
"""
ALONG = """
    [trend 5] | w**2 | A / (R - 9 * T**2 * A) | R, A: means of r**2 and a**2; T: lag of a pole
    [trend 6] | r_1 | r - 3 * T * a | rate, as late as the acceleration
    [trend 7] | r_0 | (1 - 3 * T**2 * w**2) * r_1 + (3 - T**2 * w**2) * T * a | rate now
    [trend 8] | a_0 | (1 - 3 * T**2 * w**2) * a - (3 - T**2 * w**2) * T * w**2 * r_1 |
    [trend 9] | s | 1 - beta * w**4 / (w**4 + w_0**4) * Max(0, Min(1, (U - U_0) / (U_1 - U_0))) | \
        U: mean square of the command; beta: share believed
    [trend 10] | tau(t) | tau_d + (1 - s) * a_0 / w**2 + s * beta * exp(-t / T_w) \
        * (r_0 * sin(w * t) / w + a_0 * (1 - cos(w * t)) / w**2) | along the horizon
"""


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # Smooth, steps of all sizes, noise that comes and goes, what is not a number, and full scale.
    steps = 3000
    t = np.arange(steps)
    port, *others = block.inputs
    x = 0.2 * port.high * np.sin(t / 60.0)
    x += np.cumsum(np.where(rng.random(steps) < 0.004, rng.normal(0, 0.02 * port.high, steps), 0))
    x += np.where(t // 500 % 2 == 1, rng.normal(0, 2e-3 * port.high, steps), 0)
    x[2600:] = port.high * np.sign(np.sin(t[2600:] / 7.0))
    x = np.clip(x, port.low, port.high)
    hit = rng.random(steps) < 0.003
    x[hit] = rng.choice(SPECIAL, int(hit.sum()))
    held = {p.name: single(p.high * np.sin(t / 200.0)) for p in others}
    return [Stream("steps, noise and motion", {port.name: single(x)} | held)]
