"""Monitor of noise, stuck bits and swings, for each encoder and the motor separately.

A sound angle is smooth but for the encoder's noise, each low bit of its count changes while the
joint moves, and a motor does not swing from one of its limits to the other all the time.
"""

from __future__ import annotations

import math
from enum import IntEnum
from functools import reduce
from typing import Any, Literal

import casadi as ca
import numpy as np

from esea_gen.control.limits.faults import Doubt
from esea_gen.control.limits.safety import command_range, safety_sections
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Constant, Flag, Port, around, clip, status_port, threshold
from esea_gen.language.stream import OwnStreams, Stream
from esea_gen.model.encoder import FRAME_ERROR_MAX, HELD_MAX, Side, step_max_counts
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

Watched = Side | Literal["gear"]
LOUDER = 2.0  # times the noise of a sound encoder: rougher is no encoder's noise
MOST = 4.0  # largest second difference that counts: one wild frame and the next make no roughness
SWING_S = 1.0  # decay of the count of swings
FULL = 0.9  # of the motor's largest torque: as good as at its limit
# A sound law chatters against a stiff hand, up to 28 times a second, but its torque is right.
MISSED = 0.18  # of the full torque: a swing counts while the set torque is missed by more
MEAN_TICKS = 16  # of the mean step, which tells slow from fast
# Counts without a change of a low bit: of a sound one that is slow enough no more than one block of
# 2^k, but noise may leap a small block again and again.
LEAST_COUNTS, NOISES = 16, 32


class Limit(IntEnum):
    """Limit of the motor's torque that the command was last at."""

    NONE = 0
    LOW = 1
    HIGH = 2


EQUATIONS = """
    [mon 1] | w_k | c_k - c{k-1} | step of the count, the short way round
    [mon 2] | R | R + a * ((w_k - w{k-1})**2 / (4 + 6 * (2 * sigma)**2) - R) | \
        roughness; 1 is that of twice the noise sigma and of a count to and fro at every tick
    [mon 3] | d_i | Sum(Max(-2**i - 1, Min(w_k, 2**i + 1)), (k, 1, n)) | \
        moved since bit i of the count changed, while slow
    [mon 4] | Abs(d_i) | Max(2 * 2**i + 2, 16, 32 * sigma) | at which the bit is stuck
"""
SWINGING = """
    [mon 5] | S | b * S + r / N | swings from limit to limit over the most in a second; r is 1 \
        for one with a torque error of more than 0.18 of the full torque since the last
"""


def encoder_monitor(device: DeviceData, side: Watched) -> Block:
    """Roughness and stuck bits of an encoder's count."""
    return Block.of(_EncoderMonitor(device, side))


def _shaft(device: DeviceData) -> tuple[int, int, float]:
    # Of the motor's encoder: bits, counts that it may turn by in a tick, and what motor and rubber
    # together may bend its path by.
    safety, actuator, *_ = safety_sections(device)
    n, bits = actuator.gear_ratio.value, int(actuator.encoder_bits.value)
    counts_rad = (1 << bits) * n / (2 * math.pi)
    torque_Nm = n * safety.u_max_Nm.value + safety.tau_max_Nm.value
    most = actuator.omega_max_rad_s.value * device.period_s * counts_rad
    bend = torque_Nm / actuator.J_kgm2.value * device.period_s**2 * counts_rad
    return bits, math.ceil(most) + 1, bend


class _EncoderMonitor:
    def __init__(self, device: DeviceData, side: Watched) -> None:
        own, bend = section_of(device, "monitor"), 0.0
        self.h, self.bits = device.period_s, int(device.file.encoder.resolution_bits.value)
        if side == "gear":
            self.bits, reach, bend = _shaft(device)
        else:
            reach = step_max_counts(device, side) * (HELD_MAX + 1)
        self.full, self.reach = 1 << self.bits, reach
        sigma = own.noise_rad.value * self.full / (2 * math.pi)
        self.largest = math.sqrt(4 + 6 * (LOUDER * sigma) ** 2 + bend**2)
        self.share = 1 - math.exp(-self.h / own.window_s.value)
        # Of a joint's encoder: a bit that weighs more makes a step that the front end does not
        # believe.  Of the motor's: one that weighs less is rough, and the highest one's step, half
        # a turn, contradicts the other encoders.
        top = min(reach.bit_length(), self.bits)
        self.watched = range(top)
        if side == "gear":
            self.watched, self.reach = range(top - 1, self.bits - 1), self.full // 2
        least = max(LEAST_COUNTS, math.ceil(NOISES * sigma))
        self.room = [float(max((2 << i) + 2, least)) for i in self.watched]
        self.name = f"encoder_monitor_{side}"
        self.title = f"Roughness and stuck bits of the {side}-side encoder"
        if side == "gear":
            self.title = "Roughness and stuck bits of the motor's own encoder"
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(_events)
        bits = Constant("watched_bits", len(self.watched), "a step of these may pass", "derived")
        self.constants = (*device.constants("monitor")[:2], bits)
        n, far, of_bits = len(self.watched), max(self.room), {"equation": "[mon 3]"}
        self.state = (
            Port.flag("followed", "1 when the last frame was good"),
            Port.count("count_last", self.full - 1, "last good count"),
            Port.count("step", self.reach, "last step", low=-self.reach, equation="[mon 1]"),
            Port("roughness", 0.0, MOST**2, "roughness", equation="[mon 2]"),
            around("mean", self.reach, "mean step"),
            Port.flag("ones", "watched bits of the last count, lowest first", size=n),
            Port.count("moved", far, "counts since each changed", low=-far, size=n, **of_bits),
        )
        self.inputs = (
            Port.count("count", self.full - 1, "raw count", on_invalid="count_last"),
            Port.count("frame_error", FRAME_ERROR_MAX, "frame errors; 0: none"),
        )
        self.outputs = (
            Port.choice("doubt", Doubt, "suspected fault"),
            status_port(
                "suspected faults of this encoder",
                "count or frame word was NaN or outside its range; the sample is skipped",
                "the state was corrupt; the monitor restarts",
                Flag("BIT_STUCK", "a bit of the count did not change while the joint moved"),
                Flag("ROUGH", "the angle is noisier than that of an intact encoder"),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        good = label("good", ca.logic_and(guard.inputs_ok, u.frame_error == 0))
        # A bad frame counts as one at rest, and the next one as the first.
        count = ca.if_else(good, u.count, s.count_last)
        raw = count - s.count_last
        back = ca.if_else(raw > self.full / 2, -float(self.full), 0.0)
        now = label("now", raw + ca.if_else(raw < -self.full / 2, float(self.full), back))
        both = ca.logic_and(good, s.followed)
        if self.reach < self.full // 2:  # beyond, every step is near
            both = ca.logic_and(both, ca.fabs(now) < self.reach + 0.5)
        goes_on = label("goes_on", both, "two frames in a row")
        now = ca.if_else(goes_on, now, 0.0)
        bent = (now - ca.if_else(goes_on, s.step, 0.0)) * (1 / self.largest)
        bent = ca.fmin(ca.fabs(bent), MOST)  # so that the proof sees no square below 0
        roughness = s.roughness + self.share * (bent * bent - s.roughness)
        rough = label("rough", label("roughness", roughness, "[mon 2]") > 1.0)
        next_state = {"followed": good, "count_last": count, "step": now, "roughness": roughness}
        mean = label("mean_step", s.mean + (now - s.mean) * (1 / MEAN_TICKS))
        ones, rest = [ca.SX(0)] * self.bits, count
        for i in reversed(range(self.bits)):
            ones[i] = rest > (1 << i) - 0.5
            rest = rest - ca.if_else(ones[i], float(1 << i), 0.0)
        ones, moved = ones[self.watched.start : self.watched.stop], []
        for k, (i, room) in enumerate(zip(self.watched, self.room, strict=True)):
            # A leap counts as a stuck bit's, weight and one: one wild frame does not fill the room.
            leap = float(1 << i) + 1
            slow = ca.logic_and(goes_on, ca.fabs(mean) <= 0.5 * (1 << i))
            on = ca.if_else(slow, clip(s.moved[k] + clip(now, -leap, leap), -room, room), 0.0)
            held = ca.fabs(s.moved[k]) > room - 0.5  # stuck stays so until the bit changes
            same = ones[k] == s.ones[k]
            moved.append(ca.if_else(same, ca.if_else(held, s.moved[k], on), 0.0))
        full = (ca.fabs(x) > room - 0.5 for x, room in zip(moved, self.room, strict=True))
        stuck = label("stuck", reduce(ca.logic_or, full), "[mon 4]")
        next_state |= {"mean": mean, "ones": ones, "moved": moved}
        doubt = ca.if_else(stuck, Doubt.STUCK_BIT, ca.if_else(rough, Doubt.ROUGH, Doubt.NONE))
        return next_state, {"doubt": doubt, "status": guard.status(stuck, rough)}


def monitor(device: DeviceData) -> Block:
    """Detect an unsound joint encoder, or a command that swings too often."""
    return Block.of(_Monitor(device))


class _Monitor:
    def __init__(self, device: DeviceData) -> None:
        own, (safety, *_) = section_of(device, "monitor"), safety_sections(device)
        self.gear = device.file.redundancy is not None
        self.h = device.period_s
        self.u_max = threshold(safety.u_max_Nm.value)
        self.u_step = threshold(safety.u_rate_Nm_s.value * self.h)
        self.decay, self.swing = math.exp(-self.h / SWING_S), 1 / own.swings_1_s.value
        self.name = "monitor"
        self.title = "Whether joint encoders and motor behave as sound ones do"
        self.equations = equations(SWINGING)
        self.streams = OwnStreams(_commands)
        self.constants = tuple(device.constants("monitor")[2:])
        tau, full = drive_of(device).tau_Nm, threshold(device.tau_full_scale_Nm)
        self.missed = threshold(MISSED * full)
        most = math.ceil(self.swing / (1 - self.decay)) + 1.0
        self.state = (
            around("u_last_Nm", self.u_max, "rate-limited command"),
            Port.choice("limit_last", Limit, "limit that it reached last"),
            Port("swings", 0.0, most, "recent swings / swings that trip", equation="[mon 5]"),
            Port(
                "missed_Nm", 0.0, 1.01 * (tau + full), "largest torque error since the last swing"
            ),
        )
        self.inputs = (
            Port.choice("doubt_motor", Doubt, "suspected fault of the motor-side encoder"),
            Port.choice("doubt_load", Doubt, "suspected fault of the load-side encoder"),
            *([Port.choice("doubt_gear", Doubt, "suspected fault, motor's encoder")] * self.gear),
            around("u_command_Nm", command_range(device), "command before the limits"),
            around("tau_set_Nm", full, "set torque"),
            around("tau_Nm", tau, "measured interaction torque"),
        )
        self.outputs = (
            Port.choice("doubt", Doubt, "suspected fault"),
            status_port(
                "suspected fault",
                "an input was NaN or outside its range",
                "the state was corrupt; counting restarts",
                Flag("SWINGS", "the command swings from one limit to the other too often"),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        followed = clip(u.u_command_Nm, s.u_last_Nm - self.u_step, s.u_last_Nm + self.u_step)
        followed = label("u_followed_Nm", clip(followed, -self.u_max, self.u_max))
        high, low = followed > FULL * self.u_max, followed < -FULL * self.u_max
        last = ca.if_else(low, Limit.LOW, ca.if_else(high, Limit.HIGH, s.limit_last))
        swung = ca.logic_and(s.limit_last != Limit.NONE, last != s.limit_last)
        swung = label("swung", swung, "from one limit to the other")
        missed = ca.fmax(s.missed_Nm, ca.fabs(u.tau_set_Nm - u.tau_Nm))
        counts = ca.logic_and(swung, label("missed_Nm", missed, "torque error") > self.missed)
        swings = s.swings * self.decay + ca.if_else(counts, self.swing, 0.0)
        often = label("often", label("swings", swings, "[mon 5]") > 1.0)
        next_state = {"u_last_Nm": followed, "limit_last": last, "swings": swings}
        next_state["missed_Nm"] = ca.if_else(swung, 0.0, missed)
        doubt = u.doubt_motor
        for other in (u.doubt_load, *([u.doubt_gear] if self.gear else [])):
            doubt = ca.if_else(other > doubt, other, doubt)
        doubt = ca.if_else(doubt != Doubt.NONE, doubt, ca.if_else(often, Doubt.SWINGS, Doubt.NONE))
        return next_state, {"doubt": doubt, "status": guard.status(often)}


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # To and fro, slower and faster, sound, with each bit stuck and with noise; frames lost.
    steps, t = 600, np.arange(600)
    full = block.inputs[0].high + 1
    sound = np.floor(full * (0.4 + 0.03 * np.sin(t / 80)))
    watched = next(p.size for p in block.state if p.name == "ones")
    top = round(math.log2(full)) - 1 if block.name.endswith("gear") else watched
    stuck = [sound - sound // 2**bit % 2 * 2**bit for bit in range(top - watched, top)]
    noisy = np.floor(sound + 2e-3 * full * rng.standard_normal(steps)) % full
    count = np.concatenate([sound, *stuck, sound, noisy, sound, sound])
    error = np.zeros(len(count))
    lost = rng.random(steps) < 0.05
    error[-steps:][lost] = rng.choice([1.0, np.nan], lost.sum())
    return [Stream("sound and broken", {"count": count, "frame_error": error})]


def _commands(block: Block, _rng: np.random.Generator) -> list[Stream]:
    # From limit to limit, slower and faster, and each doubt of either side.
    t = np.arange(2400.0)
    high = {p.name: p.high for p in block.inputs}
    u = high["u_command_Nm"] * np.sign(np.sin(t / np.where(t < 800, 60, 12)))
    doubts = [p.name for p in block.inputs if p.name.startswith("doubt")]
    x = {n: np.where(t // 800 == k, t // 100 % 4, 0) for k, n in enumerate(doubts)}
    # The torque is missed by half of the full one, by a little, and with either sign.
    missed = 0.5 * high["tau_set_Nm"] * np.array([1, 0.1, -1])[(t // 300 % 3).astype(int)]
    x |= {"u_command_Nm": u, "tau_set_Nm": missed, "tau_Nm": 0 * t}
    return [Stream("to and fro", x)]
