"""Where the wanted torque is going: along a horizon, from its own past alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

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
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream, single
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

# On the standard plant 4 Hz lags by too much at 1.5 Hz (0.15 Nm), 24 Hz gives no more than 16.
BANDWIDTH_HZ, BANDWIDTH_LOW_HZ = 16.0, 0.5
# The rate dies away over it: 0.2 s costs the tuning case 0.08 Nm, for ever gains nothing.
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


# A step moves the observer with it and leaves rate and acceleration alone: then the held torque is
# asked for, to the bit.  A step is an increment beside the median of the last three.  Noise, by the
# second difference of the increments, lowers the bandwidth, and much of it the share that is
# believed.
def trend(device: DeviceData, ends_s: Sequence[float] = (), name: str = "trend") -> Block:
    """Where the wanted torque goes, when only its past is known."""
    return Block.of(_Trend(device, ends_s, name))


class _Trend:
    def __init__(self, device: DeviceData, ends_s: Sequence[float], name: str) -> None:
        drive = drive_of(device)
        self.h, self.tau_lim = drive.control_period_s, drive.tau_Nm
        self.ends_s = tuple(ends_s)
        self.high_Hz = 0.1 / self.h
        self.rate_lim, self.acc_lim = motion_limits(device)
        self.keep_noise = math.exp(-self.h / NOISE_S)
        self.keep_step = math.exp(-self.h / STEPPED_S)
        self.step_lim = 2 * self.tau_lim
        # Between two increments of opposite sign and the middle one.
        self.noise_lim = threshold(4.04 * self.step_lim)
        # The observer never needs to be farther off than from one end of the range to the other.
        self.miss_lim = threshold(2 * self.step_lim)
        self.name = name
        self.title = "Wanted torque ahead, from its past"
        self.coefficients = (
            Port("quick", 0.0, 1.0, "1 less the pole, without noise"),
            Port("noises_1_Nm", 0.0, 1.01 / QUIET_LOW_NM, "1 over what halves it"),
        )
        self.inputs = (
            around("tau_wanted_Nm", self.tau_lim, "wanted torque now", on_invalid="last_Nm"),
        )
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(_events)
        own, low = min(BANDWIDTH_HZ, self.high_Hz), min(BANDWIDTH_LOW_HZ, 0.5 * self.high_Hz)
        sees = "bandwidth without noise: higher sees sooner where it goes"
        quiet = "noise that halves the bandwidth: lower is calmer, and trusts less"
        source = "docs/predictive.md"
        self.tunables = (
            Tunable("bandwidth_Hz", own, low, self.high_Hz, sees, source),
            Tunable("quiet_Nm", QUIET_NM, QUIET_LOW_NM, QUIET_HIGH_NM, quiet, source),
        )
        self.state = (
            Port("primed", 0.0, 1.0, "1 once a valid value has been seen"),
            around("last_Nm", self.tau_lim, "wanted torque of the last step"),
            around("raw_Nm", self.step_lim, "last two increments, newest first", 2),
            around("grown_Nm", self.step_lim, "the same without steps", 2),
            Port("noise_Nm", 0.0, self.noise_lim, "mean second difference of the increments"),
            Port("stepped", 0.0, 1.0, "1 after a step, fading"),
            around("miss_Nm", self.miss_lim, "wanted torque less the observer's"),
            around("rate_Nm_s", self.rate_lim, "rate of the wanted torque"),
            around("acc_Nm_s2", self.acc_lim, "its acceleration"),
        )
        n = len(self.ends_s)
        ahead = around("tau_ahead_Nm", self.tau_lim, "wanted torque at the intervals' ends", n or 1)
        self.outputs = (
            *((ahead,) if n else ()),
            around("tau_rate_Nm_s", self.rate_lim, "its rate now"),
            around("tau_curve_Nm_s2", self.acc_lim, "its acceleration now"),
            Port("trust", 0.0, 1.0, "share of both that is believed"),
            Port("settled", 0.0, 1.0, "0 after a step, 1 when it is long ago"),
            status_port(
                "what is known of it",
                "the input was NaN or outside its range; the last one counts",
                "the state was corrupt; started afresh",
                Flag("CLIPPED", "rate or acceleration is at its range", True),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return {
            "quick": 1 - ca.exp(-2 * math.pi * self.h * t.bandwidth_Hz),
            "noises_1_Nm": 1 / t.quiet_Nm,
        }

    def increment(self, s: Any, fresh: ca.SX, label: Labels) -> tuple[ca.SX, ca.SX]:
        """The increment without what it has of a step, and that part of it."""
        first, second = ca.vertsplit(s.raw_Nm)
        least, most = ca.fmin(first, second), ca.fmax(first, second)
        middle = label("median_Nm", ca.fmax(least, ca.fmin(most, fresh)), "median of three")
        aside = label("aside_Nm", fresh - middle, "what a step adds")
        room = label("room_Nm", STEP_NM + STEP_NOISES * s.noise_Nm, "what counts in full")
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
        share = ca.fmin(jump * (1 / JUMP_NM), 1)
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
        trust = label("trust", 1 / (1 + many * many), "share of the motion that is believed")
        ahead = []
        for end_s in self.ends_s:
            by_rate, by_acc = faded(end_s)
            value = u.tau_wanted_Nm + trust * (by_rate * rate + by_acc * acc)
            ahead.append(clip(value, -self.tau_lim, self.tau_lim))
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


def motion_limits(device: DeviceData) -> tuple[float, float]:
    """Largest rate and acceleration of a wanted torque that are believed."""
    turn, full = 2 * math.pi * FASTEST_HZ, device.tau_full_scale_Nm
    return threshold(turn * full), threshold(turn * turn * full)


def faded(t_s: float) -> tuple[float, float]:
    """What rate and acceleration add: integrals to t of exp(-x/T) and x exp(-x/T)."""
    left = math.exp(-t_s / FADE_S)
    by_rate = FADE_S * (1 - left)
    return by_rate, FADE_S * (by_rate - t_s * left)


EQUATIONS = """
    [trend 1] | q | q_0 / (1 + nu / nu_h) | nu: mean second difference; p = 1 - q
    [trend 2] | epsilon_+ | p**3 * epsilon | what the observer still misses
    [trend 3] | r_+ | r + h * a + 3/2 * q**2 * (1 + p) / h * epsilon |
    [trend 4] | a_+ | a + q**3 / h**2 * epsilon | rate and acceleration
    [trend 5] | tau(t) | tau_d + 1 / (1 + (nu / (10 * nu_h))**2) \
        * Integral((r + a * x) * exp(-x / T_f), (x, 0, t)) | along the horizon
"""


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # Smooth, steps of all sizes, noise that comes and goes, what is no number, and full scale.
    steps = 3000
    t = np.arange(steps)
    (port,) = block.inputs
    x = 0.2 * port.high * np.sin(t / 60.0)
    x += np.cumsum(np.where(rng.random(steps) < 0.004, rng.normal(0, 0.02 * port.high, steps), 0))
    x += np.where(t // 500 % 2 == 1, rng.normal(0, 2e-3 * port.high, steps), 0)
    x[2600:] = port.high * np.sign(np.sin(t[2600:] / 7.0))
    x = np.clip(x, port.low, port.high)
    hit = rng.random(steps) < 0.003
    x[hit] = rng.choice(SPECIAL, int(hit.sum()))
    return [Stream("steps, noise and motion", {port.name: single(x)})]
