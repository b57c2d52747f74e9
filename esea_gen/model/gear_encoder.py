"""Motor encoder: from counts of its shaft to the drive's part of the joint angle.

It has no absolute angle: it counts from the first frame on, in integers below 2^24.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Constant, Flag, Port, around, clip, status_port, threshold
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream
from esea_gen.model.encoder import FRAME_ERROR_MAX, HELD_MAX
from esea_gen.model.symbolic import equations

WHOLE = 1 << 24  # every number format holds whole numbers below exactly


EQUATIONS = """
    [wrap] | w | Piecewise((d + F, d < -F / 2), (d - F, d > F / 2), (d, true)) | \
        step, the short way round; F counts a turn
    [angle] | theta_g | 2 * pi / (F * i) * Sum(w_k, (k, 1, n)) | \
        turned since the start, at the joint; ratio i
"""


# A bad frame, or one farther away than the drive can be, is bridged.  After more than can be
# bridged the encoder is not usable for a frame and goes on from there: what was turned meanwhile is
# unknown.
def gear_encoder(device: DeviceData) -> Block:
    """Front end of the encoder on the motor's shaft."""
    return Block.of(_GearEncoder(device))


class _GearEncoder:
    def __init__(self, device: DeviceData) -> None:
        a, j = device.file.actuator, device.file.joint
        assert a is not None  # as of every drive
        assert j is not None
        self.device, self.actuator = device, a
        self.h = device.period_s
        self.full = 1 << int(a.encoder_bits.value)
        self.counts_rad = self.full * a.gear_ratio.value / (2 * math.pi)
        self.omega_max = a.omega_max_rad_s.value
        self.rate_lim = threshold(self.omega_max * 1.01)
        self.step_max = math.ceil(self.omega_max * self.h * self.counts_rad) + 1
        self.held_max = min(HELD_MAX, (self.full // 2 - 1) // self.step_max - 1)
        if self.held_max < 1:
            raise UserError(
                f"{device.origin}: within two periods the motor's shaft may turn by "
                f"{2 * self.step_max} counts, not below half a turn ({self.full // 2}): with one "
                "frame lost, the direction would be ambiguous.",
                "Lower actuator.omega_max_rad_s or raise timing.sense_rate_Hz.",
            )
        span = (
            j.theta_max_rad.value - j.theta_min_rad.value + 2 * device.file.limits.theta_rad.value
        )
        self.moved_max = math.ceil(span * self.counts_rad)
        if self.moved_max + self.step_max * (self.held_max + 1) >= WHOLE:
            bits = math.floor(math.log2((WHOLE - 1) / self.moved_max * self.full))
            raise UserError(
                f"{device.origin}: over the joint's range the motor's encoder counts "
                f"{self.moved_max:.3g}, too many for whole numbers of 24 bits.",
                f"Read its upper {min(bits, int(a.encoder_bits.value) - 1)} bits only, and say so "
                "in actuator.encoder_bits.",
            )
        self.name = "encoder_gear"
        self.title = (
            "Encoder front end, motor's shaft: count to the angle that the drive has turned"
        )
        self.inputs = (
            Port.count("count", self.full - 1, "raw count of the shaft"),
            Port.count("frame_error", FRAME_ERROR_MAX, "frame errors; 0: none"),
        )
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(_events)
        self.constants = (
            self.actuator.encoder_bits.constant("encoder_bits"),
            self.actuator.gear_ratio.constant("gear_ratio"),
            Constant("step_max_counts", self.step_max, "speed limit times period", "derived"),
            Constant("held_max", self.held_max, "short of half a turn of the shaft", "derived"),
        )
        self.state = (
            Port.count("count_last", self.full - 1, "count of the last good frame"),
            Port.count("moved", self.moved_max, "counts since the start", low=-self.moved_max),
            Port.count("held", self.held_max, "bad frames in a row; saturates"),
            Port.flag("started", "1 after the first good frame"),
            around("omega_rad_s", self.rate_lim, "rate of the last step"),
        )
        most = self.moved_max / self.counts_rad * (1 + 1e-6)
        lost = "no frame yet, or more were bad than may be bridged: starts again"
        self.outputs = (
            around("theta_gear_rad", most, "joint angle by the drive's encoder"),
            around("omega_gear_rad_s", self.rate_lim, "rate of that angle, unfiltered"),
            Port.flag("gear_usable", "1 when the angle is continuous with the last step"),
            status_port(
                "status of this sample",
                "count or frame word was NaN or outside its range",
                "the state was corrupt; the encoder was restarted",
                Flag("FRAME_ERROR", "the frame failed its checks; angle held", True),
                Flag("IMPLAUSIBLE_STEP", "the shaft moved faster than it can; angle held", True),
                Flag("NOT_USABLE", lost, True),
                Flag("RANGE_LEFT", "turned by more than the joint's range of motion", True),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        started = s.started
        flagged = label("flagged", u.frame_error > 0, "the frame's own checks failed")
        readable = label("readable", ca.logic_and(guard.inputs_ok, ca.logic_not(flagged)))
        raw = label("raw_step", u.count - s.count_last, "[wrap] counts since the last good frame")
        back = ca.if_else(raw > self.full / 2, -float(self.full), 0.0)
        over = ca.if_else(raw < -self.full / 2, float(self.full), back)
        moved = label("step", raw + over, "the short way round")
        reach, share = ca.SX(self.step_max), ca.SX(1.0)
        for k in range(1, self.held_max + 1):
            reach = ca.if_else(s.held >= k, self.step_max * (k + 1), reach)
            share = ca.if_else(s.held >= k, 1 / (k + 1), share)
        label("reach", reach, "[reach] as far as the drive can have gone, in counts")
        near = ca.fabs(moved) <= reach
        good = label("good", ca.logic_and(readable, ca.logic_and(started, near)), "goes on")
        late = label("late", s.held >= self.held_max, "no more may be bridged")
        first = ca.logic_and(readable, ca.logic_or(ca.logic_not(started), late))
        first = label("first", first, "starts here, at first or again")
        fresh = ca.logic_and(first, ca.logic_not(good))
        total = label("moved_counts", s.moved + ca.if_else(good, moved, 0.0), "[angle]")
        outside = label("outside", ca.fabs(total) > self.moved_max + 0.5, "more than the joint can")
        bad = ca.if_else(late, self.held_max, s.held + 1)
        held = ca.if_else(ca.logic_or(good, fresh), 0, bad)
        rate = moved * share * (1 / (self.h * self.counts_rad))
        rate = label("rate_rad_s", rate, "[rate] a frame that was bridged counts as moved evenly")
        # Of a frame that is farther away; a good one is within, but for two counts' worth.
        rate = clip(rate, -self.rate_lim, self.rate_lim)
        rate = ca.if_else(good, rate, ca.if_else(fresh, 0.0, s.omega_rad_s))
        taken = ca.logic_or(good, fresh)
        kept = ca.logic_or(taken, ca.logic_and(started, ca.logic_not(late)))
        usable = label("usable", ca.logic_and(kept, ca.logic_not(ca.logic_or(fresh, outside))))
        limit = float(self.moved_max)
        next_state = {
            "count_last": ca.if_else(taken, u.count, s.count_last),
            "moved": clip(total, -limit, limit),
            "held": held,
            "started": ca.logic_or(started, taken),
            "omega_rad_s": rate,
        }
        odd = ca.logic_and(ca.logic_and(started, readable), ca.logic_not(near))
        outputs = {
            "theta_gear_rad": clip(total, -limit, limit) * (1 / self.counts_rad),
            "omega_gear_rad_s": rate,
            "gear_usable": usable,
            "status": guard.status(
                ca.logic_and(guard.inputs_ok, flagged), odd, ca.logic_not(usable), outside
            ),
        }
        return next_state, outputs


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # To and fro through many turns, with frames missing, as many as may be bridged and one more,
    # jumps, and on to the end of what is counted.
    port, word = block.inputs
    constant = {c.name: c.value for c in block.constants}
    full, most = round(port.high) + 1, int(constant["step_max_counts"])
    held = int(constant["held_max"])
    span = next(p.high for p in block.state if p.name == "moved")
    counts, frames = [], []
    now = 0.4 * full
    plan = [(40, r * most, bad) for r in (0.9, -0.9, 0.01) for bad in (0, 1, held, held + 1)]
    plan += [(1, 0.45 * full, 0), (10, 0.0, 0), (int(1.1 * span / (0.95 * most)), 0.95 * most, 0)]
    plan += [(int(2.2 * span / (0.95 * most)), -0.95 * most, 0)]
    for steps, rate, bad in plan:
        path = now + rate * np.arange(1, steps + 1)
        frame = np.zeros(steps)
        if bad:
            frame[20 : 20 + bad] = rng.integers(1, round(word.high) + 1, bad)
        counts.append(np.floor(path) % full)
        frames.append(frame)
        now = float(path[-1])
    inputs = {"count": np.concatenate(counts), "frame_error": np.concatenate(frames)}
    broken = {k: v.copy() for k, v in inputs.items()}
    for p in block.inputs:
        hit = rng.random(len(inputs["count"])) < 0.04
        broken[p.name][hit] = rng.choice([*SPECIAL, p.high + 1.0], int(hit.sum()))
    return [Stream("turns, gaps and jumps", inputs), Stream("with invalid inputs", broken)]
