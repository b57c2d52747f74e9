"""What the extended-state observer is tried with: a joint that moves, rests at its ends, unseen."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import OwnStreams, Stream, single

# Share of the largest rate and of the largest torque that an ordinary motion takes.
SHARE = 0.3
REST = 200
# Distances from an end at which the joint rests, rad: the end itself, and less than a step away.
BESIDE_rad = (2e-3, 5e-4, 3e-4, 1e-4, 0.0)


def _ramp(a: float, b: float, steps: int) -> Array:
    # Smooth to its third derivative, so that the torque's rate has no steps either.
    x = np.linspace(0.0, 1.0, steps)
    return a + (b - a) * x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)


def _numbers(block: Block) -> tuple[Port, Port, int]:
    # Angle and torque, and how many steps a sweep over the whole range takes.
    theta, tau = block.inputs
    outputs = {p.name: p for p in block.outputs}
    width = theta.high - theta.low
    inertia = next(c.value for c in block.constants if c.name == "Jh_kgm2")
    fastest = SHARE * outputs["omega_load_rad_s"].high
    strongest = SHARE * outputs["tau_h_Nm"].high / inertia
    # Largest rate and acceleration of `_ramp` over a time of 1: 35/16, and 7.513.
    time_s = max(35 / 16 * width / fastest, (7.6 * width / strongest) ** 0.5)
    return theta, tau, round(time_s / block.period_s)


def _moves(ends: Sequence[float], steps: int, width: float) -> Array:
    # From each end to the next, as fast as a sweep over the whole range, with a rest after it.
    parts = [np.full(REST, ends[0])]
    for a, b in pairwise(ends):
        parts += [_ramp(a, b, max(REST, round(steps * abs(b - a) / width))), np.full(REST, b)]
    return np.concatenate(parts)


def _within(port: Port, values: Array) -> Array:
    return np.clip(single(values), port.low, port.high)


def _events(block: Block, _rng: np.random.Generator) -> list[Stream]:
    theta, tau, sweep = _numbers(block)
    low, high, width = theta.low, theta.high, theta.high - theta.low
    ends = [0.5 * (low + high), *(high - x for x in BESIDE_rad), *(low + x for x in BESIDE_rad)]
    angles = _within(theta, _moves(ends, sweep, width))
    ordinary = Stream("sweeps and rests at the ends", {theta.name: angles})
    # At a steady rate towards each end, and no samples from the middle on, for longer than the way
    # takes: the angle is predicted on, past the end.
    ways = [np.linspace(a, b, sweep) for a, b in ((low, high), (high, low))]
    unseen = _within(theta, np.concatenate([x for w in ways for x in (w, np.full(REST, w[-1]))]))
    for start in (sweep // 2, sweep + REST + sweep // 2):
        unseen[start : start + sweep // 2 + REST // 2] = np.nan
    coasting = Stream(
        "unseen past the ends", {theta.name: unseen, tau.name: np.zeros(len(unseen))}, rough=True
    )
    wave = 0.2 * min(tau.high, next(p.high for p in block.outputs if p.name == "tau_h_Nm"))
    t = np.arange(ordinary.steps)
    ordinary.inputs[tau.name] = single(wave * np.sin(2 * np.pi * t / 3000) ** 3)
    return [ordinary, coasting]


STREAMS = OwnStreams(events=_events)
