"""Adaptation of the desired torque to the specimen, with values from commissioning.

A rubber softer than its model gives less torque than the sensor shows.  Gain, loss and offset of
the desired torque are outside every loop.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.fields import ADAPTATION_STOP_NM as STOP_NM
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Port, Tunable, around, clip, status_port, threshold
from esea_gen.language.stream import OwnStreams, Stream, single
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

FADE_S = 1.0


def adaptation(device: DeviceData) -> Block:
    """Model torque for a desired torque x: a x + c E(x) + o."""
    return Block.of(_Adaptation(device))


def shift_limit_Nm(device: DeviceData) -> float:
    """Most that loss and offset add to a wish."""
    own = section_of(device, "adaptation")
    return threshold(1.01 * (own.loss_most.value * STOP_NM + own.offset_Nm.value))


def gain_port(device: DeviceData) -> Port:
    """Gain of the desired torque, with room for rounding beyond its range."""
    own = section_of(device, "adaptation")
    low, high = 0.99 / own.scale_most.value, 1.01 / own.scale_least.value
    return Port("wish_gain", low, high, "gain on the desired torque, identified", on_invalid=1.0)


class _Adaptation:
    name = "adaptation"
    title = "Wish for the rubber at hand"

    def __init__(self, device: DeviceData) -> None:
        own, self.h = section_of(device, "adaptation"), device.period_s
        self.fade = 1 - math.exp(-self.h / FADE_S)
        self.constants = device.constants("adaptation")
        self.prepare = vars
        self.equations = equations(EQUATIONS)
        self.streams = OwnStreams(memories=_wishes)
        tau = drive_of(device).tau_Nm
        gains = threshold(1 / own.scale_most.value), threshold(1 / own.scale_least.value)
        loss, offset = threshold(own.loss_most.value), threshold(own.offset_Nm.value)
        self.tunables = tuple(
            Tunable(*row, "docs/control.md")
            for row in (
                ("share", 0.0, 0.0, 1.0, "1: the wish is adapted; 0: it is taken as it is"),
                ("gain", 1.0, *gains, "model's torque over the true one, as identified"),
                ("loss", 0.0, -loss, loss, "loss that the model misses, as identified"),
                ("offset_Nm", 0.0, -offset, offset, "offset, as identified"),
            )
        )
        self.coefficients = tuple(t.port for t in self.tunables)
        gain = gain_port(device)
        self.state = (
            Port("wish_gain", gain.low, gain.high, "value in use", init=1.0),
            around("wish_loss", 1.01 * loss, "value in use"),
            around("wish_offset_Nm", 1.01 * offset, "value in use"),
            around("stop_wish_Nm", 1.01 * (tau + STOP_NM), "state of the stop operator"),
            Port.flag("wished", "1 once a desired torque was received"),
        )
        self.inputs = (around("tau_desired_Nm", tau, "desired interaction torque"),)
        self.outputs = (
            gain,
            around("wish_shift_Nm", shift_limit_Nm(device), "added hysteresis and offset"),
            status_port(
                "status",
                "the input was NaN or outside its range",
                "the state was corrupt; the adaptation fades in again",
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        now: dict[str, Any] = {}
        for name, neutral, asked in (
            ("wish_gain", 1.0, c.gain),
            ("wish_loss", 0.0, c.loss),
            ("wish_offset_Nm", 0.0, c.offset_Nm),
        ):
            last = vars(s)[name]
            missing = neutral + c.share * (asked - neutral) - last
            now[name] = label(f"next_{name}", last + self.fade * missing, "fading")
        x = u.tau_desired_Nm
        play = clip(s.stop_wish_Nm, x - STOP_NM, x + STOP_NM)
        shift = now["wish_loss"] * (x - play) + now["wish_offset_Nm"]
        now |= {"stop_wish_Nm": ca.if_else(s.wished, play, x), "wished": 1}
        outputs = {"wish_gain": now["wish_gain"], "wish_shift_Nm": shift, "status": guard.status()}
        return now, outputs


EQUATIONS = """
    [adapt 1] | E | x - Max(Min(F, x + r), x - r) | stop operator of the wish x, r 0.8 Nm
    [adapt 2] | tau_model | a * tau_d + c * E + o | wish for the rubber at hand
"""


def _wishes(block: Block, _dtype: np.dtype[Any], rng: np.random.Generator) -> list[Stream]:
    # Rubbers as soft and as stiff as they may be, put in force and taken out again.
    count = 1600
    wish = single(rng.uniform(-3, 3, count // 40).repeat(40))
    wish[-2:] = np.nan
    ends = {t.name: (t.low, t.high) for t in block.tunables}
    found = []
    for k, name in enumerate(("a stiff rubber", "a soft rubber")):
        on = {n: np.array([e[k] if n != "share" else 1.0]) for n, e in ends.items()}
        changes = {0: on, count - 300: {"share": np.array([0.0])}}
        found.append(Stream(name, {"tau_desired_Nm": wish}, {}, changes))
    return found
