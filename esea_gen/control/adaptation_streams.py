"""What the adaptation is tried with: a known mass on the joint."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.stream import OwnStreams, Stream, single

COUNT = 1600


def _masses(block: Block, _dtype: np.dtype[Any], rng: np.random.Generator) -> list[Stream]:
    # The arm swings; the sensor shows the mass's torque scaled, within and beyond the bounds, none
    # of it, and after a while it is not to be trusted.
    ports = {p.name: p for p in block.inputs}
    mass = 0.6 * next(t.high for t in block.tunables if t.name == "mass_Nm")
    t = np.arange(COUNT) * block.period_s
    found = []
    ends = {t.name: (t.low, t.high) for t in block.tunables}
    swing = math.pi * t
    angle, rate = 1.2 + 1.3 * np.sin(swing), 1.3 * math.pi * np.cos(swing)
    for name, scale, offset, zero in (
        ("a mass", 1.1, 0.02, 1.2),
        ("a soft rubber", 1.6, 0.4, 1.2),
        ("a stiff rubber", 0.6, -0.4, 1.2),
        ("another mass", -1.0, 0.0, 1.2),
        ("beyond the horizontal", 1.0, 0.0, 0.0),
    ):
        torque = scale * mass * np.sin(angle - zero) + offset + 0.2 * np.sign(rate)
        sound = np.ones(COUNT)
        sound[COUNT // 2 : COUNT // 2 + 5] = 0
        sound[-2:] = np.nan
        inputs = {
            "tau_desired_Nm": rng.uniform(-3, 3, COUNT),
            "tau_Nm": np.clip(torque, 0.9 * ports["tau_Nm"].low, 0.9 * ports["tau_Nm"].high),
            "theta_load_rad": angle,
            "omega_load_rad_s": rate,
            "sensing_ok": sound,
        }
        hung = {"mass_Nm": mass, "mass_angle_rad": zero, "share": 1.0}
        if "rubber" in name:
            # As far as it may be from the start.
            hung |= {n: ends[n]["stiff" not in name] for n in ("gain", "loss", "offset_Nm")}
        changes = {0: {k: np.array([v]) for k, v in hung.items()}}
        if name == "a mass":
            changes[COUNT - 100] = {"mass_Nm": np.array([0.0])}
        found.append(Stream(name, {k: single(v) for k, v in inputs.items()}, {}, changes))
    return found


STREAMS = OwnStreams(memories=_masses)
