"""Movements cut out of a stream: ends, limits, holes; no movement of a hand at rest."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort, ProbingMovement, probing_movement
from esea_host.assess.responses import Location
from esea_host.assess.segments import MovementWatch, judge

RATES = st.sampled_from([50, 100, 333, 1000])
WIDE = Comfort(-1.0 + 1.0, 150 * DEG, 300 * DEG)
SEED = st.integers(0, 2**16)


def played(watch, t, angle, *, rate=None, ok=None):
    """All events of a stream."""
    rate = np.gradient(angle, t) if rate is None else rate
    ok = np.ones(len(t), bool) if ok is None else ok
    events = []
    for k in range(len(t)):
        for e in watch.take(t[k], angle[k], rate[k], 0.1 * angle[k], bool(ok[k])):
            events.append((float(t[k]), e))
    return events


def stream(move: ProbingMovement, hz: int, rest_s: float, after_s: float, start_s: float = 0.0):
    t = np.arange(0, rest_s + move.duration_s + after_s, 1 / hz)
    return start_s + t, *move.at(t - rest_s)


def kinds(events):
    return [e.kind for _, e in events]


@settings(max_examples=20, deadline=None)
@given(
    hz=RATES,
    middle=st.floats(40, 90),
    speed=st.floats(8, 200),
    bends=st.booleans(),
    noise=st.floats(0, 0.25),
    start_s=st.floats(0, 1e5),
    seed=SEED,
)
def test_one_movement_is_cut_out_whole_at_any_rate(hz, middle, speed, bends, noise, start_s, seed):
    where = Location(middle * DEG, (1 if bends else -1) * speed * DEG)
    move = probing_movement(where, Comfort(0, 130 * DEG, 300 * DEG, shortest_s=0.2))
    if move is None:
        return
    t, angle, rate = stream(move, hz, 1.0, 1.5, start_s)
    angle = angle + noise * DEG * np.random.default_rng(seed).standard_normal(len(t))
    events = played(MovementWatch(WIDE), t, angle, rate=rate)
    assert kinds(events) == ["started", "moved"]
    cut = events[1][1].segment
    # The fast middle, where all is read, is in; and the rest around it is not long.
    assert cut.begin_s - start_s <= 1.0 + 0.4 * move.duration_s
    assert cut.end_s - start_s >= 1.0 + 0.6 * move.duration_s
    assert cut.end_s - cut.begin_s <= move.duration_s + 0.9
    verdict = judge(cut, move, 1.7, 70)
    assert verdict.tried
    if speed <= 120:  # the local cubic over 0.16 s flattens the very shortest
        assert verdict.passed


@settings(max_examples=15, deadline=None)
@given(hz=RATES, noise=st.floats(0, 0.3), drift=st.floats(-1, 1), sway=st.floats(0, 0.4), seed=SEED)
def test_a_hand_at_rest_is_no_movement(hz, noise, drift, sway, seed):
    """Noise, drift in deg/s, sway at 0.7 Hz and a tremor at 5 Hz in deg."""
    t = np.arange(0, 20, 1 / hz)
    white = np.random.default_rng(seed).standard_normal(len(t))
    shaken = sway * (np.sin(2 * np.pi * 0.7 * t) + 2 * np.sin(2 * np.pi * 5 * t))
    angle = 60 + noise * white + drift * t + shaken
    assert not played(MovementWatch(WIDE), t, np.round(angle / 0.088) * 0.088 * DEG, rate=0 * t)


@settings(max_examples=15, deadline=None)
@given(hz=RATES, speed=st.floats(20, 200), limit=st.floats(30, 120), way=st.sampled_from([1, -1]))
def test_a_limit_is_warned_of_at_once_and_once(hz, speed, limit, way):
    t = np.arange(0, 2, 1 / hz)
    angle, rate = (limit + speed * (t - 1)) * DEG, np.full(len(t), speed * DEG)
    comfort = Comfort(0, limit * DEG, 300 * DEG)
    if way < 0:
        comfort, angle, rate = (
            Comfort(limit * DEG, 150 * DEG, 300 * DEG),
            2 * limit * DEG - angle,
            -rate,
        )
    found = [
        (s, e)
        for s, e in played(MovementWatch(comfort), t, angle, rate=rate)
        if e.kind == "warning"
    ]
    found = [(s, e) for s, e in found if f" {limit:.0f}°." in e.text]
    beyond = t[way * (angle - limit * DEG) > 2 * DEG][0]
    assert len(found) == 1
    assert 0 <= found[0][0] - beyond <= 0.05
    # Speed: a step beyond its limit.
    slow = Comfort(0, 150 * DEG, speed * DEG)
    rate = np.where(t > 1, (speed + 6) * DEG, 0.9 * speed * DEG)
    found = [s for s, e in played(MovementWatch(slow), t, 0 * t + 1, rate=rate) if "fast" in e.text]
    assert len(found) == 1
    assert 0 <= found[0] - 1 <= 0.05


@settings(max_examples=15, deadline=None)
@given(
    hz=RATES, what=st.sampled_from(["hole", "nan", "invalid", "cable"]), share=st.floats(0.45, 0.9)
)
def test_what_breaks_the_stream_ends_the_movement_with_its_reason(hz, what, share):
    move = ProbingMovement(Location(60 * DEG, 60 * DEG), 30 * DEG, 90 * DEG, 2.0)
    t, angle, rate = stream(move, hz, 1.0, 1.5)
    ok, k = np.ones(len(t), bool), int((1.0 + 2.0 * share) * hz)
    watch = MovementWatch(WIDE)
    if what == "hole":
        kept = (np.arange(len(t)) < k) | (np.arange(len(t)) > k + 8)
        t, angle, rate, ok = t[kept], angle[kept], rate[kept], ok[kept]
    elif what == "nan":
        angle[k] = math.nan
    elif what == "invalid":
        ok[k] = False
    else:
        events = played(watch, t[:k], angle[:k], rate=rate[:k])
        assert watch.moving
        (ended,) = watch.end("the cable is off")
        assert (kinds(events), ended.kind, ended.text) == (
            ["started"],
            "broken",
            "the cable is off",
        )
        assert not watch.moving
        return
    events = played(watch, t, angle, rate=rate, ok=ok)
    assert kinds(events)[:2] == ["started", "broken"]
    assert events[1][1].text
    assert "moved" not in kinds(events)[2:] or share < 0.75  # of what is left a new one may come


def test_a_leg_that_never_rests_ends_the_movement_only_after_the_longest_one():
    t = np.arange(0, 40, 0.02)
    angle = np.abs((t / 8 + 0.5) % 1 - 0.5) * 2
    assert kinds(played(MovementWatch(WIDE), t, angle)) == ["started", "broken", "started"]
    assert kinds(played(MovementWatch(WIDE, 48), t, angle)) == ["started"]


def test_pause_reversal_and_way_to_the_start():
    there = ProbingMovement(Location(60 * DEG, 60 * DEG), 30 * DEG, 90 * DEG, 2.0)
    back = ProbingMovement(Location(60 * DEG, -60 * DEG), 90 * DEG, 30 * DEG, 2.0)
    t = np.arange(0, 9, 1 / 200)
    (a, _), (b, _) = there.at(t - 1), back.at(t - 5)
    events = played(MovementWatch(WIDE), t, np.where(t < 5, a, b))
    assert kinds(events) == ["started", "moved"] * 2
    first, second = (e.segment for _, e in events if e.segment)
    assert judge(first, there, 1.7, 70).passed
    assert judge(second, back, 1.7, 70).passed
    # The way back to the start is no try of the movement forth, and is never asked for again.
    assert not judge(second, there, 1.7, 70).tried
    # Without a pause it is one movement, and passes both.
    (b, _) = back.at(t - 3)
    (moved,) = [e for _, e in played(MovementWatch(WIDE), t, np.where(t < 3, a, b)) if e.segment]
    assert judge(moved.segment, there, 1.7, 70).passed
    assert judge(moved.segment, back, 1.7, 70).passed
    # Too slow: a try that missed, and the words say what to change.
    slow = ProbingMovement(there.location, there.start_rad, there.end_rad, 6.0)
    (moved,) = [e for _, e in played(MovementWatch(WIDE), t, slow.at(t - 1)[0]) if e.segment]
    verdict = judge(moved.segment, there, 1.7, 70)
    assert (verdict.tried, verdict.passed) == (True, False)
    assert "faster" in verdict.text
