"""Streams that aim at decisions: every step of theirs lies at one, and shows how it went."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.verify.streams import streams
from esea_gen.verify.ties import aimed_stream

EDGE, INNER = 0.3, 0.45


def decided() -> Block:
    """An edge on 0.7 x + s; one on s alone, which matters for positive x only; one never met."""

    def step(c, s, u, guard, label):
        first = ca.if_else(s.kept_rad + 0.7 * u.x_rad < EDGE, 0.25, 0.75)
        second = ca.if_else(s.kept_rad < INNER, 1.0, 2.0)
        y = ca.if_else(u.x_rad > 0, first + second, first)
        never = u.x_rad * u.x_rad + 0.2 * s.kept_rad * s.kept_rad + 0.25 < 0.24
        y = y + ca.if_else(never, 0.5, 0)
        return {"kept_rad": 0.5 * s.kept_rad + 0.4 * u.x_rad}, {"y_rad": y}

    return Block.define(
        "decided",
        "made up",
        period_s=1e-3,
        state=(Port("kept_rad", -1, 1, "memory"),),
        inputs=(Port("x_rad", -1, 1, "what comes in"),),
        outputs=(Port("y_rad", 0, 4, "what comes out"),),
        step=step,
    )


@pytest.fixture(scope="module", params=[np.float32, np.float64])
def aimed(request):
    """Input, memory and format's unit at the edge, of every aimed step."""
    block = decided()
    (stream,) = aimed_stream(block, streams(block, steps=400), request.param)
    kept = np.array([stream.injections[k]["kept_rad"][0] for k in range(stream.steps)])
    return stream.inputs["x_rad"], kept, float(np.spacing(request.param(EDGE)))


def distances(x: np.ndarray, s: np.ndarray) -> dict[str, np.ndarray]:
    """How far each step is from each threshold, over what it is compared with."""
    return {
        "edge": np.abs(s + 0.7 * x - EDGE) / EDGE,
        "inner": np.abs(s - INNER) / INNER,
        "sign": np.abs(x),
        "guard of x": np.abs(np.abs(x) - 1),
        "guard of s": np.abs(np.abs(s) - 1),
    }


def test_every_step_lies_at_a_threshold(aimed):
    x, s, _ = aimed
    found = distances(x, s)
    # Beside a zero there is no percent; beside all others there is.
    sharp = np.min([d for name, d in found.items() if name != "sign"], axis=0)
    assert np.all((sharp <= 0.01) | (found["sign"] <= 0.1))
    for name in ("edge", "inner"):
        assert np.sum(found[name] <= 0.01) >= 16, name


def test_thresholds_are_met_from_both_sides_to_the_unit(aimed):
    x, s, unit = aimed
    apart = s + 0.7 * x - EDGE
    for side in (apart < 0, apart > 0):
        assert np.any(side & (np.abs(apart) <= 4 * unit))
        assert np.any(side & (np.abs(apart) > 1e-3) & (np.abs(apart) < 0.01 * EDGE))
    for side in (s < INNER, s > INNER):
        assert np.any(side & (np.abs(s - INNER) <= 4 * unit))


def test_a_decision_is_tried_where_it_shows(aimed):
    x, s, _ = aimed
    inner = distances(x, s)["inner"] <= 1e-6
    assert np.mean(x[inner] > 0) > 0.9
