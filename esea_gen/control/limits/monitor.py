"""Whether joint encoders and motor behave as sound ones do, each looked at by itself.

A sound angle is smooth but for the encoder's noise, each low bit of its count changes while the
joint moves, and a motor does not swing from one of its limits to the other all the time.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.limits.safety import command_range
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Array, Constant, Flag, Port, around, clip, status_port
from esea_gen.language.stream import OwnStreams, Stream
from esea_gen.model.encoder import FRAME_ERROR_MAX, HELD_MAX, SIDES, Side, step_max_counts
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations

SOUND, SWINGS, ROUGH, STUCK = range(4)
LOUDER = 2.0  # times the noise of a sound encoder: rougher is no encoder's noise
MOST = 8.0  # times the largest second difference: what is farther counts as that
SWING_S = 1.0  # decay of the count of swings
FULL = 0.9  # of the motor's largest torque: as good as at its limit
MEAN_TICKS = 16  # of the mean step, which tells slow from fast
# Counts without a change of a low bit: of a sound one that is slow enough no more than one block of
# 2^k, but noise may leap a small block again and again.
LEAST_COUNTS, NOISES = 16, 32

EQUATIONS = """
    [mon 1] | w_k | c_k - c{k-1} | step of the count, the short way round
    [mon 2] | R | R + a * ((w_k - w{k-1})**2 / (1 + 6 * (2 * sigma)**2) - R) | \
        roughness; 1 is that of twice the noise sigma, in counts, and of whole counts
    [mon 3] | d_i | Sum(w_k, (k, 1, n)) | moved since bit i of the count changed, while slow
    [mon 4] | Abs(d_i) | Max(2 * 2**i, 16, 32 * sigma) | at which the bit is stuck
    [mon 5] | S | b * S + r / N | swings from limit to limit over the most in a second
"""


class _Watched:
    """Numbers of one side's encoder, in counts."""

    def __init__(self, device: DeviceData, side: Side, noise_rad: float) -> None:
        self.bits = int(device.file.encoder.resolution_bits.value)
        self.full = 1 << self.bits
        sigma = noise_rad * self.full / (2 * math.pi)
        self.largest = math.sqrt(1 + 6 * (LOUDER * sigma) ** 2)
        self.reach = step_max_counts(device, side) * (HELD_MAX + 1)
        # A bit that weighs more makes a step that the encoder's front end does not believe.
        self.low = range(min(self.reach.bit_length(), self.bits))
        least = max(LEAST_COUNTS, math.ceil(NOISES * sigma))
        self.room = [float(max(2 << i, least)) for i in self.low]


def monitor(device: DeviceData) -> Block:
    """Roughness and stuck bits of both joint encoders, and a command that swings too often."""
    return Block.of(_Monitor(device))


class _Monitor:
    def __init__(self, device: DeviceData) -> None:
        own = section_of(device, "monitor")
        self.h = device.period_s
        self.watched = {side: _Watched(device, side, own.noise_rad.value) for side in SIDES}
        self.share = 1 - math.exp(-self.h / own.window_s.value)
        self.decay, self.swing = math.exp(-self.h / SWING_S), 1 / own.swings_1_s.value
        assert device.file.safety is not None
        self.full_Nm = FULL * device.file.safety.u_max_Nm.value
        self.name = "monitor"
        self.title = "Whether joint encoders and motor behave as sound ones do"
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(_events)
        found = (
            Constant(f"{side}_bits", len(w.low), "a step of theirs would be believed", "derived")
            for side, w in self.watched.items()
        )
        self.constants = (*device.constants("monitor"), *found)
        most = math.ceil(self.swing / (1 - self.decay)) + 1.0
        self.state = (
            Port("followed", 0.0, 1.0, "1 when the last frames were good"),
            Port("limit_last", -1.0, 1.0, "limit at which the motor was last"),
            Port("swings", 0.0, most, "swings of late, over the most", equation="[mon 5]"),
            *(p for side in SIDES for p in self._memory(side)),
        )
        frame = "what is wrong with its frame; 0 when good"
        self.inputs = (
            *(
                p
                for side, w in self.watched.items()
                for p in (
                    Port(f"count_{side}", 0, w.full - 1, f"raw count, {side} side"),
                    Port(f"frame_error_{side}", 0, FRAME_ERROR_MAX, frame),
                )
            ),
            around("u_command_Nm", command_range(device), "command before the limits"),
        )
        self.outputs = (
            Port("doubt", SOUND, STUCK, "0 none, 1 motor swings, 2 rough reading, 3 bit stuck"),
            status_port(
                "what is doubted",
                "an input was NaN or outside its range: nothing is judged by it",
                "the state was corrupt; watched afresh",
                Flag("MOTOR_BIT_STUCK", "motor side: a bit of the count stays while it moves"),
                Flag("LOAD_BIT_STUCK", "load side: a bit of the count stays while it moves"),
                Flag("MOTOR_ROUGH", "motor side: the angle is rougher than noise makes it"),
                Flag("LOAD_ROUGH", "load side: the angle is rougher than noise makes it"),
                Flag("SWINGS", "the command swings from one limit to the other too often"),
            ),
        )

    def _memory(self, side: Side) -> tuple[Port, ...]:
        w, n = self.watched[side], len(self.watched[side].low)
        most = max(w.room)
        return (
            Port(f"{side}_last", 0, w.full - 1, "last good count"),
            around(f"{side}_step", w.reach, "last step", equation="[mon 1]"),
            around(f"{side}_mean", w.reach, "mean step"),
            Port(f"{side}_rough", 0.0, MOST**2, "roughness", equation="[mon 2]"),
            Port(f"{side}_bits", 0.0, 1.0, "low bits of the last count, lowest first", n),
            Port(f"{side}_moved", -most, most, "since each changed", n, equation="[mon 3]"),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        frames = ca.logic_and(u.frame_error_motor < 0.5, u.frame_error_load < 0.5)
        good = label("good", ca.logic_and(guard.inputs_ok, frames), "frames to be judged")
        next_state, stuck, rough = {}, [], []
        for side in SIDES:
            own, bit, loud = self._encoder(side, s, u, good, label)
            next_state |= own
            stuck.append(label(f"{side}_stuck", bit, "[mon 4]"))
            rough.append(label(f"{side}_is_rough", loud, "[mon 2]"))
        at = ca.if_else(u.u_command_Nm > self.full_Nm, 1.0, 0.0)
        at = ca.if_else(u.u_command_Nm < -self.full_Nm, -1.0, at)
        swung = label("swung", at * s.limit_last < -0.5, "from one limit to the other")
        swings = s.swings * self.decay + ca.if_else(swung, self.swing, 0.0)
        often = label("often", label("swings", swings, "[mon 5]") > 1.0)
        next_state |= {
            "followed": good,
            "limit_last": ca.if_else(ca.fabs(at) > 0.5, at, s.limit_last),
            "swings": swings,
        }
        doubt = ca.if_else(often, float(SWINGS), float(SOUND))
        doubt = ca.if_else(ca.logic_or(*rough), float(ROUGH), doubt)
        doubt = ca.if_else(ca.logic_or(*stuck), float(STUCK), doubt)
        return next_state, {"doubt": doubt, "status": guard.status(*stuck, *rough, often)}

    def _encoder(
        self, side: Side, s: Any, u: Any, good: ca.SX, label: Labels
    ) -> tuple[dict[str, Any], ca.SX, ca.SX]:
        w = self.watched[side]
        last, step, mean, rough, bits, moved = (
            getattr(s, f"{side}_{n}") for n in ("last", "step", "mean", "rough", "bits", "moved")
        )
        # A bad frame counts as one at rest, and the next one as the first.
        count = ca.if_else(good, getattr(u, f"count_{side}"), last)
        raw = count - last
        back = ca.if_else(raw > w.full / 2, -float(w.full), 0.0)
        now = label(f"{side}_now", raw + ca.if_else(raw < -w.full / 2, float(w.full), back))
        near = ca.fabs(now) < w.reach + 0.5
        both = ca.logic_and(good, s.followed > 0.5)
        goes_on = label(f"{side}_goes_on", ca.logic_and(both, near), "two frames in a row")
        now = ca.if_else(goes_on, now, 0.0)
        before = ca.if_else(goes_on, step, 0.0)
        bent = clip((now - before) * (1 / w.largest), -MOST, MOST)
        smoothed = mean + (now - mean) * (1 / MEAN_TICKS)
        speed = ca.fabs(label(f"{side}_speed", smoothed, "mean step"))

        ones, rest = [ca.SX(0)] * w.bits, count
        for i in reversed(range(w.bits)):
            ones[i] = rest > (1 << i) - 0.5
            rest = rest - ca.if_else(ones[i], float(1 << i), 0.0)
        way = []
        for i, room in zip(w.low, w.room, strict=True):
            slow = ca.logic_and(goes_on, speed <= 0.5 * (1 << i))
            on = ca.if_else(slow, clip(moved[i] + now, -room, room), 0.0)
            held = ca.fabs(moved[i]) > room - 0.5  # stuck stays so until the bit changes
            same = ca.fabs(ones[i] - bits[i]) < 0.5
            way.append(ca.if_else(same, ca.if_else(held, moved[i], on), 0.0))
        stuck = ca.SX(0)
        for x, room in zip(way, w.room, strict=True):
            stuck = ca.logic_or(stuck, ca.fabs(x) > room - 0.5)

        loud = rough + self.share * (bent * bent - rough)

        own = {
            "last": count,
            "step": now,
            "mean": smoothed,
            "rough": loud,
            "bits": ones[: len(w.low)],
            "moved": way,
        }
        return {f"{side}_{n}": x for n, x in own.items()}, stuck, loud > 1.0


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # To and fro, slower and faster, one side after the other with each bit stuck and with noise;
    # frames lost; a command between the limits and from one to the other.
    ports = {p.name: p for p in block.inputs}
    steps = 600
    parts: list[dict[str, Array]] = []

    def move(side: str = "", bit: int = -1, noise: float = 0.0, lost: bool = False) -> None:
        t = np.arange(steps)
        x = {n: np.zeros(steps) for n in ports}
        for each in SIDES:
            full = ports[f"count_{each}"].high + 1
            count = np.floor(full * (0.4 + 0.03 * np.sin(t / 80)))
            if each == side:
                count = np.floor(count + noise * full * rng.standard_normal(steps)) % full
                if bit >= 0:
                    count = np.where(count // 2**bit % 2 == 1, count - 2**bit, count)
            x[f"count_{each}"] = count
        x["u_command_Nm"] = ports["u_command_Nm"].high * np.sign(np.sin(t / (12 if lost else 60)))
        if lost:
            x["frame_error_motor"][rng.random(steps) < 0.05] = 1
            x["frame_error_load"][rng.random(steps) < 0.05] = np.nan
        parts.append(x)

    move()
    for side in SIDES:
        for p in block.state:
            if p.name == f"{side}_bits":
                for bit in range(p.size):
                    move(side, bit)
        move(side, noise=2e-3)
        move()
    move(lost=True)
    return [Stream("sound and broken", {n: np.concatenate([x[n] for x in parts]) for n in ports})]
