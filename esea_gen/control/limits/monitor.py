"""Whether joint encoders and motor behave as sound ones do, each looked at by itself.

A sound angle is smooth but for the encoder's noise, each low bit of its count changes while the
joint moves, and a motor does not swing from one of its limits to the other all the time.
"""

from __future__ import annotations

import math
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.limits.safety import command_range, safety_sections
from esea_gen.control.reference import IMPEDANCE, OFF, largest_gains
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Constant, Flag, Port, around, clip, status_port, threshold
from esea_gen.language.stream import OwnStreams, Stream
from esea_gen.model.encoder import FRAME_ERROR_MAX, HELD_MAX, Side, step_max_counts
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

SOUND, SWINGS, ROUGH, STUCK = range(4)
LOUDER = 2.0  # times the noise of a sound encoder: rougher is no encoder's noise
MOST = 4.0  # largest second difference that counts: one wild frame and the next make no roughness
SWING_S = 1.0  # decay of the count of swings
FULL = 0.9  # of the motor's largest torque: as good as at its limit
# With sound sensing, a step of what is wished makes a law swing there and back.
WISHES = ("tau_desired_Nm", "theta_desired_rad", "omega_desired_rad_s")
WISH_STEP = 0.005  # of the full torque in a tick; a sine of that torque has it from 0.8 Hz at 1 kHz
EXCUSED = 2.0  # swings of a step
MEAN_TICKS = 16  # of the mean step, which tells slow from fast
# Counts without a change of a low bit: of a sound one that is slow enough no more than one block of
# 2^k, but noise may leap a small block again and again.
LEAST_COUNTS, NOISES = 16, 32

EQUATIONS = """
    [mon 1] | w_k | c_k - c{k-1} | step of the count, the short way round
    [mon 2] | R | R + a * ((w_k - w{k-1})**2 / (4 + 6 * (2 * sigma)**2) - R) | \
        roughness; 1 is that of twice the noise sigma and of a count to and fro at every tick
    [mon 3] | d_i | Sum(Max(-2**i - 1, Min(w_k, 2**i + 1)), (k, 1, n)) | \
        moved since bit i of the count changed, while slow
    [mon 4] | Abs(d_i) | Max(2 * 2**i + 2, 16, 32 * sigma) | at which the bit is stuck
"""
SWINGING = """
    [mon 5] | S | b * S + r / N | swings from limit to limit over the most in a second; \
        the two after a step of what is wished do not count
"""


def encoder_monitor(device: DeviceData, side: Side) -> Block:
    """Roughness and stuck bits of one joint encoder's count."""
    return Block.of(_EncoderMonitor(device, side))


class _EncoderMonitor:
    def __init__(self, device: DeviceData, side: Side) -> None:
        own = section_of(device, "monitor")
        self.h, self.bits = device.period_s, int(device.file.encoder.resolution_bits.value)
        self.full = 1 << self.bits
        sigma = own.noise_rad.value * self.full / (2 * math.pi)
        self.largest = math.sqrt(4 + 6 * (LOUDER * sigma) ** 2)
        self.share = 1 - math.exp(-self.h / own.window_s.value)
        reach = self.reach = step_max_counts(device, side) * (HELD_MAX + 1)
        # A bit that weighs more makes a step that the encoder's front end does not believe.
        self.low = range(min(reach.bit_length(), self.bits))
        least = max(LEAST_COUNTS, math.ceil(NOISES * sigma))
        self.room = [float(max((2 << i) + 2, least)) for i in self.low]
        self.name = f"encoder_monitor_{side}"
        self.title = f"Roughness and stuck bits of the {side}-side encoder"
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(_events)
        bits = Constant("low_bits", len(self.low), "steps of these are believed", "derived")
        self.constants = (*device.constants("monitor")[:2], bits)
        n, most = len(self.low), max(self.room)
        self.state = (
            Port("followed", 0.0, 1.0, "1 when the last frame was good"),
            Port("count_last", 0, self.full - 1, "last good count"),
            around("step", reach, "last step, in counts", equation="[mon 1]"),
            around("mean", reach, "mean step"),
            Port("roughness", 0.0, MOST**2, "roughness", equation="[mon 2]"),
            Port("ones", 0.0, 1.0, "low bits of the last count, lowest first", n),
            Port("moved", -most, most, "counts since each changed", n, equation="[mon 3]"),
        )
        self.inputs = (
            Port("count", 0, self.full - 1, "raw count", on_invalid="count_last"),
            Port("frame_error", 0, FRAME_ERROR_MAX, "what is wrong with the frame; 0 when good"),
        )
        self.outputs = (
            Port("doubt", SOUND, STUCK, "0 none, 2 rough reading, 3 bit stuck"),
            status_port(
                "what is doubted of this encoder",
                "count or frame word was NaN or outside its range: nothing is judged by it",
                "the state was corrupt; watched afresh",
                Flag("BIT_STUCK", "a bit of the count stays while the joint moves"),
                Flag("ROUGH", "the angle is rougher than a sound encoder's noise makes it"),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        good = label("good", ca.logic_and(guard.inputs_ok, u.frame_error < 0.5))
        # A bad frame counts as one at rest, and the next one as the first.
        count = ca.if_else(good, u.count, s.count_last)
        raw = count - s.count_last
        back = ca.if_else(raw > self.full / 2, -float(self.full), 0.0)
        now = label("now", raw + ca.if_else(raw < -self.full / 2, float(self.full), back))
        near = ca.fabs(now) < self.reach + 0.5
        both = ca.logic_and(good, s.followed > 0.5)
        goes_on = label("goes_on", ca.logic_and(both, near), "two frames in a row")
        now = ca.if_else(goes_on, now, 0.0)
        bent = (now - ca.if_else(goes_on, s.step, 0.0)) * (1 / self.largest)
        bent = ca.fmin(ca.fabs(bent), MOST)  # so that the proof sees no square below 0
        roughness = s.roughness + self.share * (bent * bent - s.roughness)
        mean = label("mean_step", s.mean + (now - s.mean) * (1 / MEAN_TICKS))
        ones, rest = [ca.SX(0)] * self.bits, count
        for i in reversed(range(self.bits)):
            ones[i] = rest > (1 << i) - 0.5
            rest = rest - ca.if_else(ones[i], float(1 << i), 0.0)
        moved = []
        for i, room in zip(self.low, self.room, strict=True):
            # A leap counts as a stuck bit's, weight and one: one wild frame does not fill the room.
            leap = float(1 << i) + 1
            slow = ca.logic_and(goes_on, ca.fabs(mean) <= 0.5 * (1 << i))
            on = ca.if_else(slow, clip(s.moved[i] + clip(now, -leap, leap), -room, room), 0.0)
            held = ca.fabs(s.moved[i]) > room - 0.5  # stuck stays so until the bit changes
            same = ca.fabs(ones[i] - s.ones[i]) < 0.5
            moved.append(ca.if_else(same, ca.if_else(held, s.moved[i], on), 0.0))
        full = (ca.fabs(x) > room - 0.5 for x, room in zip(moved, self.room, strict=True))
        stuck = label("stuck", reduce(ca.logic_or, full), "[mon 4]")
        rough = label("rough", label("roughness", roughness, "[mon 2]") > 1.0)
        next_state: dict[str, Any] = {
            "followed": good,
            "count_last": count,
            "step": now,
            "mean": mean,
        }
        next_state |= {"roughness": roughness, "ones": ones[: len(moved)], "moved": moved}
        doubt = ca.if_else(stuck, float(STUCK), ca.if_else(rough, float(ROUGH), float(SOUND)))
        return next_state, {"doubt": doubt, "status": guard.status(stuck, rough)}


def monitor(device: DeviceData) -> Block:
    """What is doubted: of either joint encoder, or that the command swings too often."""
    return Block.of(_Monitor(device))


class _Monitor:
    def __init__(self, device: DeviceData) -> None:
        own, (safety, *_) = section_of(device, "monitor"), safety_sections(device)
        self.h = device.period_s
        self.u_max = threshold(safety.u_max_Nm.value)
        self.u_step = threshold(safety.u_rate_Nm_s.value * self.h)
        self.decay, self.swing = math.exp(-self.h / SWING_S), 1 / own.swings_1_s.value
        self.name = "monitor"
        self.title = "Whether joint encoders and motor behave as sound ones do"
        self.equations = equations(SWINGING)
        self.streams = OwnStreams(_commands)
        self.constants = tuple(device.constants("monitor")[2:])
        drive, (self.kp, self.kd) = drive_of(device), largest_gains(device)
        self.wish_step = threshold(WISH_STEP * device.tau_full_scale_Nm)
        low, high, omega = drive.theta_low_rad, drive.theta_high_rad, drive.omega_rad_s
        wish = 1.01 * (drive.tau_Nm + self.kp * max(-low, high) + self.kd * omega)
        most = math.ceil(self.swing / (1 - self.decay)) + 1.0
        self.state = (
            around("u_last_Nm", self.u_max, "command at the rate that the limits let by"),
            Port("limit_last", -1.0, 1.0, "limit at which that was last"),
            Port("swings", 0.0, most, "swings of late, over the most", equation="[mon 5]"),
            around("wish_last_Nm", threshold(wish), "what was wished, by the largest gains"),
            Port("excused", 0.0, EXCUSED, "swings that its last step may still make"),
        )
        self.inputs = (
            Port("doubt_motor", SOUND, STUCK, "of the motor-side encoder"),
            Port("doubt_load", SOUND, STUCK, "of the load-side encoder"),
            around("u_command_Nm", command_range(device), "command before the limits"),
            Port("mode", OFF, IMPEDANCE, "mode that holds in this step"),
            around("tau_desired_Nm", drive.tau_Nm, "wanted interaction torque"),
            Port("theta_desired_rad", low, high, "wanted angle of the joint"),
            around("omega_desired_rad_s", omega, "wanted rate of the joint"),
        )
        self.outputs = (
            Port("doubt", SOUND, STUCK, "0 none, 1 motor swings, 2 rough reading, 3 bit stuck"),
            status_port(
                "what is doubted",
                "an input was NaN or outside its range",
                "the state was corrupt; counted afresh",
                Flag("SWINGS", "the command swings from one limit to the other too often"),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        followed = clip(u.u_command_Nm, s.u_last_Nm - self.u_step, s.u_last_Nm + self.u_step)
        followed = label("u_followed_Nm", clip(followed, -self.u_max, self.u_max))
        at = ca.if_else(followed > FULL * self.u_max, 1.0, 0.0)
        at = ca.if_else(followed < -FULL * self.u_max, -1.0, at)
        swung = label("swung", at * s.limit_last < -0.5, "from one limit to the other")
        moved = self.kp * u.theta_desired_rad + self.kd * u.omega_desired_rad_s
        wish = u.tau_desired_Nm + ca.if_else(u.mode > 1.5, moved, 0.0)
        wish = label("wish_Nm", wish, "what is wished, by the largest gains")
        stepped = label("stepped", ca.fabs(wish - s.wish_last_Nm) > self.wish_step)
        excused = label("excuses", ca.if_else(stepped, EXCUSED, s.excused))
        counts = ca.logic_and(swung, excused < 0.5)
        swings = s.swings * self.decay + ca.if_else(counts, self.swing, 0.0)
        often = label("often", label("swings", swings, "[mon 5]") > 1.0)
        last = ca.if_else(ca.fabs(at) > 0.5, at, s.limit_last)
        next_state = {"u_last_Nm": followed, "limit_last": last, "swings": swings}
        next_state["wish_last_Nm"] = wish
        next_state["excused"] = ca.fmax(excused - ca.if_else(swung, 1.0, 0.0), 0.0)
        doubt = ca.fmax(ca.fmax(u.doubt_motor, u.doubt_load), often)
        return next_state, {"doubt": doubt, "status": guard.status(often)}


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # To and fro, slower and faster, sound, with each bit stuck and with noise; frames lost.
    steps, t = 600, np.arange(600)
    full = block.inputs[0].high + 1
    sound = np.floor(full * (0.4 + 0.03 * np.sin(t / 80)))
    low = next(p.size for p in block.state if p.name == "ones")
    stuck = [sound - sound // 2**bit % 2 * 2**bit for bit in range(low)]
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
    motor, load = (np.where(part, t // 100 % 4, 0) for part in (t > 1600, t < 800))
    x = {"doubt_motor": motor, "doubt_load": load, "u_command_Nm": u, "mode": 1 + t // 1200 % 2}
    # Wishes that stand still, then each in steps, with the swings of the command.
    for i, name in enumerate(WISHES):
        x[name] = 0.5 * high[name] * np.where(t // 300 % 4 == i, t // 37 % 2, 1)
    return [Stream("to and fro", x)]
