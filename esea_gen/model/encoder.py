"""Encoder front end: from raw counts to the joint angle and its validity.

Every decision uses integers below 2^24, which every number format represents exactly.
"""

from __future__ import annotations

import math
from enum import IntFlag
from functools import reduce
from itertools import product
from types import SimpleNamespace
from typing import Any, Literal

import casadi as ca
import numpy as np

from esea_gen.devices.fields import EncoderSide
from esea_gen.devices.file import DeviceData
from esea_gen.devices.numbers import Quantity
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import (
    Array,
    Constant,
    Flag,
    Port,
    Status,
    Tunable,
    around,
    clip,
    status_port,
)
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream
from esea_gen.model.symbolic import equations

Side = Literal["motor", "load"]
SIDES: tuple[Side, ...] = ("motor", "load")

TURNS = 4  # either way: four turns and a count stay below 2^24 up to 21 bits
SETTLED = 4  # frames that must agree before an angle is believed: 4 ms at 1 kHz
HELD_MAX = 3  # bad frames bridged: at the elbow's fastest identified rate 3.2 mrad, 0.12 Nm
# Room in the largest believable step for noise.  The data sheet of a Hall encoder of the same maker
# (AS5046) has 0.06 deg RMS a sample, so 0.085 deg for a difference of two; this is six times that.
NOISE_RAD = math.radians(0.5)


class FrameError(IntFlag):
    """Bits of the frame word, from the driver of the encoder's bus; 0 is a good frame."""

    PARITY = 1
    """The parity bit does not fit the frame."""
    ERROR_FLAG = 2
    """The chip set its error flag: a command or frame before this one was wrong."""
    FIELD_WEAK = 4
    """The magnet is too far away or gone."""
    FIELD_STRONG = 8
    """The magnet is too near."""
    OVERFLOW = 16
    """The chip's angle computation overflowed."""
    NOT_READY = 32
    """The chip has not finished its offset compensation."""
    NO_ANSWER = 64
    """Nothing came, or all bits are equal: a broken wire, no supply."""


FRAME_ERROR_MAX = 127


def _snap(x: ca.SX, low: int, high: int) -> ca.SX:
    # Nearest whole number of a few, as a chain of selects: a constant, with no rounding error in
    # any format, so that the error analysis knows that counters do not drift.
    value = ca.SX(low)
    for k in range(low + 1, high + 1):
        value = ca.if_else(x > k - 0.5, float(k), value)
    return value


# Nothing to decide, and the table's own value at every node.  Between nodes an error with n periods
# a turn and amplitude a is missed by at most a (1 - cos(pi n / N)): with 64 values and n = 4, 2 %
# of it.
def correction(values: tuple[float, ...], count: ca.SX, bits: int) -> ca.SX:
    """Periodic piecewise-linear interpolation of a correction table."""
    n = len(values)
    place = count * (n / (1 << bits))  # a power of two: exact
    total = ca.SX(values[0])
    for i, value in enumerate(values):
        rise = values[(i + 1) % n] - value
        if rise:
            total = total + rise * clip(place - i, 0, 1)
    return total


def step_max_counts(device: DeviceData, side: Side) -> int:
    """Largest believable step of the raw count between two samples."""
    own = _side(device, side).step_max_rad
    count_rad = 2 * math.pi / (1 << int(device.file.encoder.resolution_bits.value))
    if own is not None:
        return max(1, math.floor(own.value / count_rad))
    joint = device.file.joint
    speed = (joint.omega_max_rad_s if joint else device.file.limits.omega_rad_s).value
    return math.ceil((speed * device.period_s + NOISE_RAD) / count_rad) + 1


def _side(device: DeviceData, side: Side) -> EncoderSide:
    own: EncoderSide | None = getattr(device.file.encoder, side)
    return own or EncoderSide()


def _middle(device: DeviceData) -> float:
    # Of the range of motion: at the start the joint is taken to stand within half a turn of it.
    joint = device.file.joint
    if joint is None:
        return 0.0
    low, high = joint.theta_min_rad.value, joint.theta_max_rad.value
    room = high - low + 2 * device.file.limits.theta_rad.value
    if room >= 2 * math.pi:
        raise UserError(
            f"{device.origin}: the joint's range of motion, joint.theta_min_rad to theta_max_rad, "
            f"with a deflection either way spans {room:g} rad, not below one turn "
            f"({2 * math.pi:g} rad): at power-up an encoder cannot tell in which turn it stands.",
            "Narrow the range of motion.",
        )
    return (low + high) / 2


EQUATIONS = """
    [wrap] | w | Piecewise((d + F, d < -F / 2), (d - F, d > F / 2), (d, true)) | \
        step, wrapped to half a turn; F counts a turn
    [reach] | Abs(w) | d_max * (k + 1) | largest believable step after k bad frames
"""
PLAIN = """
    [angle] | theta | sigma * (2 * pi * (n + c / F)) - theta_0 | \
        joint angle: n turns, count c, direction sigma, zero
"""
CORRECTED = """
    [angle] | theta | sigma * (2 * pi * (n + c / F) + e_c) - theta_0 | \
        joint angle: n turns, count c, direction sigma, zero
    [table] | e_c | e_0 + Sum(r_i * Min(Max(x - i, 0), 1), (i, 0, N - 1)) | \
        correction: x = N c / F, rise r_i a cell
"""


# With c the last good count, a frame is good when its word is 0 and its wrapped step from c is at
# most the largest believable one times the frames since.  At the start the turn is the one within
# half a turn of the middle of the range of motion, and SETTLED frames in a row must agree.  After
# more than held_max bad frames the encoder is not usable: where they could not be read it starts
# again from the absolute angle; readable but implausible ones say that something slipped, and the
# reference is lost until init.
def encoder(device: DeviceData, side: Side) -> Block:
    """Front end of one encoder."""
    return Block.of(_Encoder(device, side))


class _Encoder:
    def __init__(self, device: DeviceData, side: Side) -> None:
        self.h, self.side = device.period_s, side
        self.own = _side(device, side)
        self.bits = int(device.file.encoder.resolution_bits.value)
        self.full, self.count_rad = 1 << self.bits, 2 * math.pi / (1 << self.bits)
        self.step_max = step_max_counts(device, side)
        self.held_max = int(self.own.held_max.value) if self.own.held_max else HELD_MAX
        self.sign = -1.0 if self.own.direction and self.own.direction.value < 0 else 1.0
        self.table = self.own.correction_rad.values if self.own.correction_rad else ()
        self.middle = _middle(device)
        # Every angle that turns, count, correction and zero can make, so that the clip never acts.
        largest = max((abs(v) for v in self.table), default=0.0)
        self.theta_max = math.ceil(2 * math.pi * (TURNS + 1) + math.pi + largest + 0.01)
        if self.step_max * (self.held_max + 1) >= self.full // 2:
            raise UserError(
                f"{device.origin}: encoder.{side}: the largest believable step, {self.step_max} "
                f"counts ({self.step_max * self.count_rad:.3g} rad), times {self.held_max + 1} "
                f"(held_max + 1) reaches half a turn ({self.full // 2} counts): the "
                "direction would be ambiguous.",
                f"Lower encoder.{side}.step_max_rad, held_max or the joint's speed limit, or raise "
                "the sensing rate.",
            )
        self.name = f"encoder_{side}"
        self.title = f"Encoder front end, {side} side: count to joint angle"
        self.constants = _constants(device, side, self.bits, self.step_max, self.held_max)
        self.tunables = _tunables(self.own)
        self.coefficients = (
            around("offset_rad", math.pi, "encoder angle at joint angle 0"),
            Port.flag("zeroed", "1 when the zero has been calibrated"),
        )
        self.inputs = (
            Port.count("count", self.full - 1, "raw count of the encoder chip"),
            Port.count("frame_error", FRAME_ERROR_MAX, "frame errors; 0: none"),
        )
        self.equations = equations(EQUATIONS + (CORRECTED if self.table else PLAIN))
        self.streams = STREAMS
        self.state = (
            Port.count("count_last", self.full - 1, "count of the last good frame"),
            Port.count("turn", TURNS, "whole turns of the encoder", low=-TURNS),
            Port.count("held", self.held_max + 1, "bad frames in a row; saturates"),
            Port.count("settled", SETTLED, "consistent frames since the start; saturates"),
            Port.flag("lost", "1 when the reference is lost; until init"),
        )
        angle = f"joint angle, {self.side} side of the coupling; held, at first at count 0, while "
        away = "the angle jumped and stayed away, or left its range of turns: not usable until init"
        late = "more bad frames in a row than may be bridged: not usable"
        fast = "the angle moved faster than the joint can; angle held"
        self.outputs = (
            around("theta_rad", self.theta_max, f"{angle}the encoder is not usable"),
            Port.flag("usable", "1 when the angle is usable"),
            status_port(
                "status of this sample",
                "count or frame word was NaN or outside its range",
                "the state was corrupt; the encoder was restarted",
                Flag("FRAME_ERROR", "the frame failed its checks; angle held", True),
                Flag("IMPLAUSIBLE_STEP", fast, True),
                Flag("HELD_TOO_LONG", late, True),
                Flag("SETTLING", "too few consistent frames since the start; not usable"),
                Flag("NOT_ZEROED", "the zero has not been calibrated; not usable"),
                Flag("REFERENCE_LOST", away),
            ),
        )

    def prepare(self, t: SimpleNamespace) -> dict[str, Any]:
        return {"offset_rad": t.zero_rad, "zeroed": t.zeroed >= 0.5}

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        started, settled, lost = s.settled > 0, s.settled >= SETTLED, s.lost
        flagged = label("flagged", u.frame_error > 0, "the frame's own checks failed")
        readable = label("readable", ca.logic_and(guard.inputs_ok, ca.logic_not(flagged)))

        raw = label("raw_step", u.count - s.count_last, "[wrap] counts since the last good frame")
        up = label("wrapped_up", ca.logic_and(started, raw < -self.full / 2), "past the last count")
        down = label("wrapped_down", ca.logic_and(started, raw > self.full / 2), "past count 0")
        wrap = ca.if_else(up, 1.0, ca.if_else(down, -1.0, 0.0))
        moved = label("step", raw + ca.if_else(up, self.full, ca.if_else(down, -self.full, 0.0)))
        reach = ca.SX(self.step_max)
        for k in range(1, self.held_max + 1):
            reach = ca.if_else(s.held >= k, self.step_max * (k + 1), reach)
        label("reach", reach, "[reach] as far as the joint can have gone, in counts")
        near = ca.fabs(moved) <= reach

        # A frame that disagrees: before the encoder has settled it becomes the new reference.
        odd = ca.logic_and(started, ca.logic_and(readable, ca.logic_not(near)))
        odd = label("implausible", odd, "readable, but farther away than the joint can be")
        fresh = ca.logic_or(ca.logic_not(started), ca.logic_not(near))
        start = label("start", ca.logic_and(readable, fresh))
        start = ca.logic_and(start, ca.logic_not(settled))
        good = ca.logic_and(readable, ca.logic_or(start, near))
        good = label("good", ca.logic_and(good, ca.logic_not(lost)), "becomes the reference")

        # The turn: nearest to the middle of the range at the start, then by the wraps.
        ahead = self.middle + c.offset_rad - self.sign * self.count_rad * u.count
        nearest = ahead * (self.sign / (2 * math.pi))
        wanted = label("turn_wanted", ca.if_else(start, nearest, s.turn + wrap))
        turn = ca.if_else(good, _snap(wanted, -TURNS, TURNS), s.turn)
        label("turn", turn, "[turn] whole turns")
        count = label("count_good", ca.if_else(good, u.count, s.count_last), "last good count")
        away = ca.logic_and(good, ca.fabs(wanted) > TURNS + 0.5)

        held = ca.if_else(s.held > self.held_max, self.held_max + 1, s.held + 1)
        held = ca.if_else(good, 0, held)
        held = label("bad_in_a_row", held, "bad frames in a row")
        late = label("late", held > self.held_max, "more than may be bridged")
        # Readable and implausible with nothing left to bridge: it slipped.  Unreadable: start anew.
        slipped = ca.logic_and(ca.logic_and(settled, odd), late)
        lost_now = label("reference_lost", ca.logic_or(lost, ca.logic_or(slipped, away)))
        agreed = ca.if_else(settled, SETTLED, s.settled + 1)
        kept = ca.if_else(late, 0, s.settled)
        settled_now = ca.if_else(good, ca.if_else(start, 1, agreed), kept)
        label("agreeing", settled_now, "frames that agree")
        settling = settled_now < SETTLED
        unzeroed = ca.logic_not(c.zeroed)

        angle = (turn * self.full + count) * self.count_rad
        if self.table:
            corrected = correction(self.table, count, self.bits)
            angle = angle + label("correction_rad", corrected, "[table]")
        theta = label("theta_rad", self.sign * angle - c.offset_rad, "[angle] of the joint")
        doubts = [late, settling, unzeroed, lost_now]
        usable = ca.logic_not(reduce(ca.logic_or, doubts))
        next_state = {"count_last": count, "turn": turn, "held": held, "settled": settled_now}
        next_state |= {"lost": lost_now}
        outputs = {
            "theta_rad": clip(theta, -self.theta_max, self.theta_max),
            "usable": usable,
            "status": guard.status(ca.logic_and(guard.inputs_ok, flagged), odd, *doubts),
        }
        return next_state, outputs


def _tunables(own: EncoderSide) -> tuple[Tunable, ...]:
    zero = own.zero_rad or Quantity(value=0.0, source="no calibration", status="assumed")
    zeroed = zero.model_copy(update={"value": 1.0 if own.zero_rad else 0.0})
    turns = "corrected angle of the encoder, times direction, where the joint is at 0: set it, "
    says = "1 says that zero_rad comes from a calibration; 0 keeps the encoder unusable"
    return (
        zero.tunable(
            "zero_rad", -math.pi, math.pi, f"{turns}then init; higher lowers the joint angle"
        ),
        zeroed.tunable("zeroed", 0.0, 1.0, says),
    )


def _constants(
    device: DeviceData, side: Side, bits: int, step_max: int, held_max: int
) -> tuple[Constant, ...]:
    own, resolution = _side(device, side), device.file.encoder.resolution_bits

    def given(name: str, value: int, q: Quantity | None, source: str, status: Status) -> Constant:
        return Constant(name, value, q.source if q else source, q.status if q else status)

    by_speed = "speed limit times period, 0.5 deg of noise, one count"
    bridged = "3.2 mrad at the elbow's fastest identified rate"
    return (
        Constant("resolution_bits", bits, resolution.source, resolution.status),
        given("step_max_counts", step_max, own.step_max_rad, by_speed, "derived"),
        given("held_max", held_max, own.held_max, bridged, "assumed"),
    )


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # A joint that moves slower than is believed, with frames missing, jumps that are bridged, a
    # slip that stays, and turns beyond what is counted; back to the start by memory as after init.
    port = next(p for p in block.inputs if p.name == "count")
    word = next(p for p in block.inputs if p.name == "frame_error")
    constant = {c.name: c.value for c in block.constants}
    full, most = round(port.high) + 1, int(constant["step_max_counts"])
    held = int(constant["held_max"])
    parts: list[tuple[Array, Array]] = []
    fresh: list[int] = []
    now = 0.37 * full

    def go(steps: int, rate: float, bad: tuple[int, ...] = (), jump: float = 0.0) -> None:
        nonlocal now
        path = now + jump + rate * np.arange(1, steps + 1)
        frame = np.zeros(steps)
        frame[list(bad)] = rng.integers(1, round(word.high) + 1, len(bad))
        parts.append((np.floor(path) % full, frame))
        now = float(path[-1])

    def length() -> int:
        return sum(len(a) for a, _ in parts)

    def restart() -> None:
        fresh.append(length())

    for rate in (0.9 * most, -0.9 * most, 3.0):
        go(60, rate, bad=(20, 30, 31))
        # As many bad frames as may be bridged, and one more: then it starts again.
        go(20, rate, bad=tuple(range(8, 8 + held)))
        go(30, rate, bad=tuple(range(8, 9 + held)))
    for _ in range(3):  # a jump and back: held, and good again
        go(held - 1, 0.0, jump=4.0 * most)
        go(12, 0.0, jump=-4.0 * most)
    go(12, 0.0, jump=(held + 3.0) * most)  # a slip: it settles, the reference is lost
    restart()
    go(4, 0.0)
    go(3, 0.0, jump=full / 3)  # while settling: the odd frame becomes the reference
    go(12, 1.0)
    for rate in (0.9 * most, -0.9 * most):  # more turns than are counted
        restart()
        go(int(6.0 * full / (0.9 * most)), rate)
        go(5, 0.0, bad=(1, 2))
    start = {p.name: np.full(p.size, p.init) for p in block.state}
    count = np.concatenate([a for a, _ in parts])
    frame = np.concatenate([b for _, b in parts])
    inputs = {"count": count, "frame_error": frame}
    broken = {k: v.copy() for k, v in inputs.items()}
    for p in block.inputs:
        hit = rng.random(len(count)) < 0.04
        broken[p.name][hit] = rng.choice([*SPECIAL, p.high + 1.0], int(hit.sum()))
    again = dict.fromkeys(fresh, start)
    return [
        Stream("motion, gaps and slips", inputs, again),
        Stream("the same, with invalid inputs", broken, again),
    ]


def _edges(block: Block, dtype: np.dtype[Any], _rng: np.random.Generator) -> list[Stream]:
    # Zeros that put a first frame half way between two turns, a hair to either side, and a little
    # less than a percent; whether zeroed, at its threshold; and steps as far as is believed after
    # so many bad frames, and one count farther.
    count, word = block.inputs
    constant = {c.name: c.value for c in block.constants}
    most, held = int(constant["step_max_counts"]), int(constant["held_max"])
    offset, zeroed = block.coefficients
    start = {p.name: np.full(p.size, p.init) for p in block.state}
    full = count.high + 1
    turn = block.step.n_out() + [name for name, _ in block.labels].index("turn_wanted")

    def wanted(zero: float, at: float) -> float:
        # The Block's own formula: the turn that a first frame asks for.
        first = [zero, 0.0, *(p.init for p in block.state), at, 0.0]
        return float(block.labelled_step.call([ca.DM(x) for x in first])[turn])

    frames: list[tuple[dict[str, Array], dict[str, Array], float]] = []
    for at in (0.0, 1.0, np.floor(full / 3), full - 1):
        here, slope = wanted(0.0, at), wanted(1.0, at) - wanted(0.0, at)
        for half in np.arange(-5, 5) + 0.5:
            zero = (half - here) / slope
            if not offset.low < zero < offset.high:
                continue
            tie = dtype.type(zero)
            near = [tie + k * np.spacing(tie) for k in range(-6, 7)]
            near += [dtype.type((half * (1 + s) - here) / slope) for s in (-4e-3, 4e-3)]
            frames += [(start, {offset.name: np.array([float(z)])}, at) for z in near]
    frames += [(start, {zeroed.name: np.array([value])}, 0.0) for value in (0.0, 1.0)]
    for bad in range(held + 1):
        for far in (0, 1):
            for way in (-1, 1):
                step = way * (most * (bad + 1) + far)
                for settled, last in product((2.0, 4.0), (full // 2, 2.0, full - 3.0)):
                    past = {"held": bad, "settled": settled, "count_last": last, "turn": 1.0}
                    state = start | {k: np.array([float(v)]) for k, v in past.items()}
                    frames.append((state, {}, (last + step) % full))
    return [
        Stream(
            "edges of turn, zero and reach",
            {count.name: np.array([f[2] for f in frames]), word.name: np.zeros(len(frames))},
            {k: f[0] for k, f in enumerate(frames)},
            {k: f[1] for k, f in enumerate(frames)},
        )
    ]


STREAMS = OwnStreams(_events, _edges)
