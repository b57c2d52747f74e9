"""Deflection of the coupling: motor-side angle less load-side angle."""

from __future__ import annotations

from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, clip, flag_word, threshold
from esea_gen.language.stream import OwnStreams, Stream, single
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations

CONTRADICTED = "another encoder or the motor's torque says otherwise, or has not been compared yet"


def deflection(device: DeviceData) -> Block:
    """Deflection from the two joint angles, and whether the torque made of it can be trusted."""
    joint = section_of(device, "joint")
    theta_lim = threshold(device.file.limits.theta_rad.value)
    compared = device.file.redundancy is not None
    reach = max(abs(joint.theta_min_rad.value), abs(joint.theta_max_rad.value)) + theta_lim

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        theta = label("raw_rad", u.theta_motor_rad - u.theta_load_rad, "(5.4) deflection")
        outside = label("outside", ca.fabs(theta) > theta_lim)
        usable = ca.logic_and(u.motor_usable, u.load_usable)
        agree = u.agree if compared else ca.SX(1)
        good = ca.logic_and(ca.logic_and(usable, agree), ca.logic_not(outside))
        ok = label("ok", ca.logic_and(good, guard.inputs_ok))
        parts = [ca.logic_not(agree)] if compared else []
        word = flag_word([ca.logic_not(guard.inputs_ok), ca.logic_not(usable), outside, *parts])
        outputs = {
            "theta_rad": clip(theta, -theta_lim, theta_lim),
            "sensing_ok": ok,
            "status": word,
        }
        return {}, outputs

    angle = "joint angle, "
    return Block.define(
        "joint",
        "Deflection from the joint encoders",
        period_s=device.period_s,
        state=(),
        inputs=(
            Port("theta_motor_rad", -reach, reach, angle + "motor side of the coupling"),
            Port("theta_load_rad", -reach, reach, angle + "load side of the coupling"),
            Port.flag("motor_usable", "1 when the motor-side encoder is usable"),
            Port.flag("load_usable", "1 when the load-side encoder is usable"),
            *([Port.flag("agree", "1 when the other sensors agree")] if compared else []),
        ),
        outputs=(
            Port("theta_rad", -theta_lim, theta_lim, "deflection: motor side minus load side"),
            Port.flag("sensing_ok", "1 when the deflection and the torque from it are valid"),
            _status(theta_lim, compared),
        ),
        equations=equations("(5.4) | delta | theta_m - theta_l | deflection"),
        step=step,
        streams=OwnStreams(_events),
    )


def _status(theta_lim: float, compared: bool) -> Port:
    beyond = "the deflection is beyond its physical range and was clipped"
    flags = [
        Flag("INPUT_INVALID", "an angle was NaN or outside its range", True),
        Flag("ENCODER_UNUSABLE", "an encoder reports an unusable angle", True),
        Flag("DEFLECTION_OUTSIDE", beyond, True, ("theta_rad",), theta_lim),
    ]
    if compared:
        flags.append(Flag("CONTRADICTED", CONTRADICTED, True))
    most = 2 ** len(flags) - 1
    return Port("status", 0, most, "status of this sample", flags=tuple(flags))


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # Both sides together, a deflection apart; each encoder usable or not.
    steps = 1500
    low, high = next((p.low, p.high) for p in block.inputs if p.name == "theta_load_rad")
    bent = next(p.high for p in block.outputs if p.name == "theta_rad")
    t = np.arange(steps)
    load = single(0.5 * (low + high) + 0.4 * (high - low) * np.sin(t / 90))
    motor = single(load + 1.2 * bent * np.sin(t / 17))
    names = [p.name for p in block.inputs if p.unit == "1"]
    answers = np.array(list(product((1.0, 0.0, 0.5), repeat=len(names))))
    usable = answers[t // 40 % len(answers)]
    x = {"theta_load_rad": load, "theta_motor_rad": motor}
    x |= {name: usable[:, k] for k, name in enumerate(names)}
    return [Stream("both sides together", x)]
