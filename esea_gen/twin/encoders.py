"""Encoders of the virtual exoskeleton, with the rounding and sines that they need.

The walker has neither rounding nor sines.  This file builds both from its operations, only for
double precision, the virtual exoskeleton's format.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Port, Tunable
from esea_gen.twin.parameters import assumed

_ROUND = 1.5 * 2.0**52
# Odd polynomial nearest to sin(2 pi x) for |x| <= 1/4 (Lawson's iteration): error 1.4e-11.
_SINE = (
    6.283185306487509,
    -41.34170192977261,
    81.60520943107718,
    -76.70366782767897,
    41.9999898298898,
    -14.337024718128749,
)


def nearest_whole(x: ca.SX) -> ca.SX:
    """Nearest whole number, ties to even; double precision only."""
    return (x + _ROUND) + ca.SX(-_ROUND)


def whole_below(x: ca.SX) -> ca.SX:
    """Largest whole number not above a value; double precision only."""
    near = nearest_whole(x)
    return near - (near > x)


def sine_of_turns(turns: ca.SX) -> ca.SX:
    """sin(2 pi t), error below 2e-11; double precision only."""
    # sin(2 pi t) = cos(2 pi (t - 1/4)); the cosine is even, so a quarter turn either way is enough.
    t = turns - 0.25
    x = 0.25 - ca.fabs(t - nearest_whole(t))
    square = x * x
    series: Any = _SINE[-1]
    for c in _SINE[-2::-1]:
        series = c + square * series
    return ca.SX(x * series)


ANGLE_RAD = 20.0
SIDES = ("motor", "load")
ENCODERS = {"motor": "theta_m_rad", "load": "theta_l_rad", "gear": "theta_g_rad"}


def _tunables(joint_bits: float, motor_bits: float | None) -> tuple[Tunable, ...]:
    errors = ("offset_rad", "wave_1_rad", "phase_1_rad", "wave_2_rad", "phase_2_rad")
    texts = ("offset", *(f"{w} of harmonic {i}" for i in (1, 2) for w in ("amplitude", "phase")))
    text = "bits of both joint encoders"
    joint = assumed("joint_encoder_bits", joint_bits, 4, joint_bits, text)
    motor: tuple[Tunable, ...] = ()
    gear: tuple[Tunable, ...] = ()
    if motor_bits is not None:
        text_m = "bits of the motor's encoder"
        motor = (assumed("motor_encoder_bits", motor_bits, 4, motor_bits, text_m),)
        text_g = "offset of the motor's encoder, at its shaft"
        gear = (assumed("gear_offset_rad", 0, -500, 500, text_g),)
    return (
        joint,
        *motor,
        *(
            assumed(f"{side}_{e}", 0, -7, 7, f"{text} of the {side}-side encoder's error")
            for side in SIDES
            for e, text in zip(errors, texts, strict=True)
        ),
        *gear,
    )


def encoder_block(device: DeviceData, tick_s: float = 1e-3) -> Block:
    """Encoders on both sides of the coupling and, where there is a motor, on its shaft."""
    file, drive = device.file, device.file.actuator
    joint_bits = file.encoder.resolution_bits.value
    motor_bits = drive.encoder_bits.value if drive else None
    bits, turns = dict.fromkeys(SIDES, joint_bits), dict.fromkeys(SIDES, 1.0)
    if drive:
        bits["gear"], turns["gear"] = drive.encoder_bits.value, drive.gear_ratio.value
    angles = {side: ENCODERS[side] for side in bits}
    tunables = _tunables(joint_bits, motor_bits)

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        out = {x.name: getattr(t, x.name) for x in tunables if not x.name.endswith("_bits")}
        for key in ("joint", "motor") if drive else ("joint",):
            bits_of = nearest_whole(getattr(t, f"{key}_encoder_bits"))
            out[f"{key}_steps"] = nearest_whole(ca.power(2.0, bits_of))
        return out

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        out, turn = {}, 1 / (2 * math.pi)
        for side, angle in angles.items():
            theta = turns[side] * vars(u)[angle] + vars(c)[f"{side}_offset_rad"]
            if side in SIDES:
                raw = vars(u)[angle]
                for i in (1, 2):
                    amplitude = vars(c)[f"{side}_wave_{i}_rad"]
                    phase = vars(c)[f"{side}_phase_{i}_rad"]
                    theta = theta + amplitude * sine_of_turns(turn * (i * raw + phase))
            steps = c.joint_steps if side in SIDES else c.motor_steps
            # Steps are a power of two and counts whole numbers: all but the first product is exact.
            count = whole_below((turn * theta) * steps)
            count = count - steps * whole_below(count / steps)
            out[f"count_{side}"] = count * (2.0 ** bits[side] / steps)
        return {}, out

    names = {"motor": "motor-side part", "load": "load side", "gear": "motor's shaft"}
    return Block.define(
        "encoders",
        "Encoders on both sides of the coupling" + (" and on the motor's shaft" if drive else ""),
        period_s=tick_s,
        tunables=tunables,
        coefficients=(
            *(t.port for t in tunables if not t.name.endswith("_bits")),
            Port("joint_steps", 0, 2.0**joint_bits, "steps of a joint encoder in a turn"),
            *(
                Port("motor_steps", 0, 2.0 ** bits[k], "steps of the motor's encoder in a turn")
                for k in bits
                if k not in SIDES
            ),
        ),
        prepare=prepare,
        state=(),
        inputs=tuple(
            Port(a, -ANGLE_RAD, ANGLE_RAD, f"angle read by the encoder on the {names[k]}")
            for k, a in angles.items()
        ),
        outputs=tuple(
            Port(f"count_{k}", 0, 2.0 ** bits[k] - 1, f"encoder on the {names[k]}") for k in angles
        ),
        step=step,
    )
