"""Interpolation of set-points between messages."""

from __future__ import annotations

from functools import partial, reduce
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, around, status_port
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream, single
from esea_gen.model.mode import Mode
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

DESIRED = ("tau_desired_Nm", "theta_desired_rad", "omega_desired_rad_s")
LONGEST_S = 0.125
"""Between two changes that belong together; a change after a longer rest is a step of its own.
Longer than the 100 ms after which a command expires that names no other time."""
INTERVALS = 3
"""Of so many intervals the longest counts: of the last alone, messages that come late or are lost
make steps again."""

EQUATIONS = """
    [wish 1] | n | Max(a_1, a_2, a_3) | periods of the ramp: the longest of the last intervals
    [wish 2] | y_k | y{k-1} + (x - y{k-1}) / (n - j) | ramp, j periods after the change of x
"""


# A changed value is a message's: a law that follows the steps of seldom messages swings.  With
# changes in each period n is 1 and nothing is added, and so it is after a change of mode.
def interpolation(device: DeviceData) -> Block:
    """Linear interpolation of the set-point from one message to the next."""
    return Block.of(_Interpolation(device))


class _Interpolation:
    name = "interpolation"
    title = "Set-points between messages, by linear interpolation"

    def __init__(self, device: DeviceData) -> None:
        drive = drive_of(device)
        self.h = device.period_s
        self.most = round(LONGEST_S / self.h)
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(_messages)
        low, high = drive.theta_low_rad, drive.theta_high_rad

        def desired(end: str, text: str) -> tuple[Port, ...]:
            return (
                around(f"tau_{end}_Nm", drive.tau_Nm, f"{text}interaction torque"),
                Port(f"theta_{end}_rad", low, high, f"{text}angle of the joint"),
                around(f"omega_{end}_rad_s", drive.omega_rad_s, f"{text}rate of the joint"),
            )

        periods = partial(Port.count, high=self.most, low=1, init=1)
        self.state = (
            Port.choice("mode_last", Mode, "mode of the last step"),
            *desired("last", "as received: desired "),
            *desired("now", "interpolated: desired "),
            Port.count("age", self.most, "periods since the last change", init=self.most),
            periods("intervals", meaning="last intervals, newest first", size=INTERVALS),
            periods("left", meaning="periods until the ramp ends"),
        )
        self.inputs = (Port.choice("mode", Mode, "desired mode"), *desired("desired", "desired "))
        self.outputs = (
            *desired("desired", "interpolated: desired "),
            Port.flag("wish_ok", "1 while all inputs and the state are valid"),
            status_port(
                "status",
                "an input was NaN or outside its range; the limits latch",
                "the state was corrupt; the limits latch",
                Flag("INTERPOLATES", "interpolating between two desired values"),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        x = [getattr(u, n) for n in DESIRED]
        last, now = (
            [getattr(s, n.replace("desired", end)) for n in DESIRED] for end in ("last", "now")
        )
        differs = ca.logic_not(ca.logic_and(x[0] == last[0], x[1] == last[1]))
        changed = label("changed", ca.logic_or(differs, ca.logic_not(x[2] == last[2])))
        soon = s.age < self.most
        follows = label("follows", ca.logic_and(changed, soon), "and soon after one")
        age = s.age + 1
        intervals = ca.vertsplit(s.intervals)
        intervals = [
            ca.if_else(changed, ca.if_else(follows, new, 1), old)
            for new, old in zip([age, *intervals], intervals, strict=False)
        ]
        longest = reduce(lambda a, b: ca.if_else(a < b, b, a), intervals)
        left = ca.if_else(changed, longest, s.left)
        left = ca.if_else(u.mode == s.mode_last, left, 1)
        left = label("left", left, "[wish 1] periods of the ramp")
        ends = label("ends", left < 1.5, "in this step")
        share = label("share", 1 / left)
        y = [
            ca.if_else(ends, new, old + share * (new - old))
            for new, old in zip(x, now, strict=True)
        ]
        outputs: dict[str, Any] = dict(zip(DESIRED, y, strict=True))
        next_state = {
            "mode_last": u.mode,
            **{n.replace("desired", "last"): v for n, v in zip(DESIRED, x, strict=True)},
            **{n.replace("desired", "now"): v for n, v in zip(DESIRED, y, strict=True)},
            "age": ca.if_else(changed, 0, ca.if_else(soon, age, self.most)),
            "intervals": intervals,
            "left": ca.if_else(ends, 1, left - 1),
        }
        outputs["wish_ok"] = ca.logic_and(guard.inputs_ok, guard.state_ok)
        outputs["status"] = guard.status(ca.logic_not(ends))
        return next_state, outputs


def _messages(block: Block, rng: np.random.Generator) -> list[Stream]:
    # At intervals from each period to longer than any that counts; then some that are not a number.
    steps, mode = 3000, np.repeat([1.0, 2.0, 1.0, 0.0, 1.0], 600)
    t = np.arange(steps)
    held = t - t % np.repeat([1, 20, 50, 7, 160], 600)
    x = {"mode": mode} | {
        p.name: single(0.4 * (p.high + p.low) + 0.3 * p.high * np.sin(held / (90.0 + 7 * i)))
        for i, p in enumerate(block.inputs[1:])
    }
    for p in block.inputs:
        hit = rng.random(steps) < 0.002
        x[p.name][hit] = rng.choice(SPECIAL, int(hit.sum()))
    return [Stream("messages", x)]
