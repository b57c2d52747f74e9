"""What the encoders and the deflection are tried with, event by event, typed a second time."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from esea_gen.language.stream import SPECIAL
from esea_gen.model.encoder import encoder
from esea_gen.model.encoder_streams import STREAMS
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.joint import deflection

TURN = 2 * math.pi
COUNT_RAD = TURN / 4096


def legs(start: float, full: int, *parts: tuple[int, float, tuple[int, ...]]):
    """Whole counts, and which frames are bad, of legs: frames, counts a frame, bad ones."""
    paths, bad, done = [np.array([start])], [], 0
    for n, rate, places in parts:
        bad += [done + k for k in places]
        paths.append(paths[-1][-1] + rate * np.arange(1, n + 1))
        done += n
    return np.floor(np.concatenate(paths[1:])) % full, bad


def jump(n: int, by: float):
    """A jump before so many frames at rest."""
    return (1, by, ()), (n - 1, 0.0, ())


def spoilt(first, second, ends):
    """The second stream is the first but for 4 % of each input, which are no values of it."""
    assert (first.name, second.name) == ends.pop("names")
    assert second.injections.keys() == first.injections.keys()
    for name, beyond in ends.items():
        a, b = first.inputs[name], second.inputs[name]
        hit = ~(a == b)
        assert 0.025 < hit.mean() < 0.055, name
        finite = set(b[hit][np.isfinite(b[hit])])
        assert beyond in finite
        given = [x for x in SPECIAL if np.isfinite(x)]
        assert finite <= {*given, beyond}
        assert set(given) <= finite
        assert np.isnan(b[hit]).any()
        assert {np.inf, -np.inf} <= set(b[hit])


def test_a_joint_encoders_motion_gaps_slips_and_turns(drive):
    """15 counts a frame are believed, 3 bad frames bridged; 4096 counts a turn."""
    first, second = STREAMS.events(encoder(drive, "motor"), np.random.default_rng(3))
    parts = []
    for rate in (13.5, -13.5, 3.0):
        parts += [(60, rate, (20, 30, 31)), (20, rate, (8, 9, 10)), (30, rate, (8, 9, 10, 11))]
    for _ in range(3):
        parts += [*jump(2, 60.0), *jump(12, -60.0)]
    parts += jump(12, 90.0)
    fresh = [sum(n for n, _, _ in parts)]
    parts += [(4, 0.0, ()), *jump(3, 4096 / 3), (12, 1.0, ())]
    for rate in (13.5, -13.5):
        fresh.append(sum(n for n, _, _ in parts))
        parts += [(1820, rate, ()), (5, 0.0, (1, 2))]
    counts, bad = legs(0.37 * 4096, 4096, *parts)
    np.testing.assert_array_equal(first.inputs["count"], counts)
    words = first.inputs["frame_error"]
    assert np.flatnonzero(words).tolist() == bad
    assert {float(w).is_integer() and 1 <= w <= 127 for w in words[bad]} == {True}
    assert max(words) > 100
    assert list(first.injections) == fresh
    names = "motion, gaps and slips", "the same, with invalid inputs"
    spoilt(first, second, {"names": names, "count": 4096.0, "frame_error": 128.0})


def test_a_joint_encoders_edges_of_turn_zero_and_reach(drive):
    block = encoder(drive, "motor")
    (stream,) = STREAMS.memories(block, np.dtype(np.float32), np.random.default_rng(3))
    assert stream.name == "edges of turn, zero and reach"
    wanted: list[tuple[float, dict[str, float], dict[str, float]]] = []
    # The turn of a first frame is (1.2 + zero) / 2 pi - count / 4096, nearest whole number.
    for at in (0, 1, 1365, 4095):
        for half in np.arange(-4.5, 5):
            zero = TURN * (half + at / 4096) - 1.2
            if abs(zero) < math.pi:
                hair = float(np.spacing(np.float32(zero)))  # of its sign
                zeros = [zero + k * hair for k in range(-6, 7)]
                zeros += [zero + TURN * half * s for s in (-4e-3, 4e-3)]
                wanted += [(at, {"offset_rad": z}, {}) for z in zeros]
    hair = float(np.spacing(np.float32(0.5)))
    wanted += [(0, {"zeroed": z}, {}) for z in (0.5 - hair, 0.5, 0.5 + hair, 0.503)]
    for bad, far, way in itertools.product(range(4), (0, 1), (-1, 1)):
        for settled, last in itertools.product((2, 4), (2048, 2, 4093)):
            past = {"held": bad, "settled": settled, "count_last": last, "turn": 1}
            wanted.append(((last + way * (15 * (bad + 1) + far)) % 4096, {}, past))
    assert len(wanted) == stream.steps
    assert not stream.inputs["frame_error"].any()
    start = {p.name: p.init for p in block.state}
    for k, (count, given, past) in enumerate(wanted):
        assert stream.inputs["count"][k] == count
        state = {n: float(v[0]) for n, v in stream.injections[k].items()}
        assert state == start | past
        told = {n: float(v[0]) for n, v in stream.coefficients[k].items()}
        assert told == pytest.approx(given, abs=1e-6)


def test_a_motors_encoder_through_turns_gaps_and_jumps(drive):
    """18526 counts a frame are believed, 2 bad frames bridged; 131072 counts a turn."""
    block = gear_encoder(drive)
    first, second = block.streams.events(block, np.random.default_rng(3))
    full, most = 2**17, 18526
    parts = [
        (40, share * most, tuple(range(20, 20 + bad)))
        for share in (0.9, -0.9, 0.01)
        for bad in (0, 1, 2, 3)
    ]
    span = math.ceil((3.6 + 0.7) * full * 74 / TURN)
    parts += [(1, 0.45 * full, ()), (10, 0.0, ())]
    parts += [(math.floor(1.1 * span / (0.95 * most)), 0.95 * most, ())]
    parts += [(math.floor(2.2 * span / (0.95 * most)), -0.95 * most, ())]
    counts, bad = legs(0.4 * full, full, *parts)
    np.testing.assert_array_equal(first.inputs["count"], counts)
    words = first.inputs["frame_error"]
    assert np.flatnonzero(words).tolist() == bad
    assert {float(w).is_integer() and 1 <= w <= 127 for w in words[bad]} == {True}
    assert max(words) > 90
    names = "turns, gaps and jumps", "with invalid inputs"
    spoilt(first, second, {"names": names, "count": float(full), "frame_error": 128.0})


def test_both_sides_of_the_coupling_together(drive):
    block = deflection(drive)
    (stream,) = block.streams.events(block, np.random.default_rng(3))
    assert stream.name == "both sides together"
    t = np.arange(1500)
    load = 0.8 * 3.35 * np.sin(t / 90)
    x = stream.inputs
    np.testing.assert_allclose(x["theta_load_rad"], load, atol=1e-6)
    np.testing.assert_allclose(x["theta_motor_rad"], load + 0.42 * np.sin(t / 17), atol=1e-6)
    # Each of three answers of each encoder and of the comparison, the last the quickest.
    digits = {"motor_usable": 9, "load_usable": 3, "agree": 1}
    for name, place in digits.items():
        told = [(1.0, 0.0, 0.5)[k // 40 // place % 3] for k in t]
        assert x[name].tolist() == told, name
    assert set(x) == {"theta_load_rad", "theta_motor_rad", *digits}
