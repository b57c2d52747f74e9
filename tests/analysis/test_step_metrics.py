"""Judged steps: figures of responses of straight lines, and where each verdict begins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.analysis.step import step_metrics
from esea_gen.errors import UserError

# From 0 to 1: 0.1 at 0.6 s, 0.9 at 1.667 s; last beyond 5 % on the way from 1.15 to 1.04, beyond
# 2 % on the way from 1.03 to 1.01.
WAY = [0, 0.05, 0.3, 0.8, 1.1, 1.15, 1.04, 0.97, 1.03, 1.01, 0.99, *[1.0] * 17]
TAIL = [1.004, 0.996] * 4


@pytest.mark.parametrize(("start", "step_s"), [(2.0, 0.0), (2.0, 1.25), (-9.0, -3.5)])
@pytest.mark.parametrize("sign", [1, -1])
def test_figures_of_a_response_of_straight_lines(start, step_s, sign):
    way = np.array(WAY + TAIL)
    t = step_s + 0.5 * np.arange(-8, len(way))
    early = start + np.array([0.4, -0.3, 0.2, -0.1, 0.1, -0.2, 0.3, -0.4])
    y = sign * np.concatenate([early, start + 3.6 * way])
    m = step_metrics(t, y, step_s=step_s, before=sign * start, after=sign * (start + 4.0))
    assert m.verdict == "stable"
    assert m.stable
    assert m.reason == f"ends at {sign * (start + 3.6):.4g} of {sign * (start + 4):.4g}"
    assert (m.initial, m.final) == pytest.approx((sign * start, sign * (start + 3.6)))
    low, high = 0.5 + 0.5 * 0.05 / 0.25, 1.5 + 0.5 * 0.1 / 0.3
    assert m.rise_s == pytest.approx(high - low)
    assert m.settling_5_s == pytest.approx(2.5 + 0.5 * 0.10 / 0.11)
    assert m.settling_2_s == pytest.approx(4.0 + 0.5 * 0.01 / 0.02)
    assert m.overshoot_percent == pytest.approx(15)
    assert (m.steady_error, m.steady_error_percent) == pytest.approx((0.4 * sign, 10))
    # The tail is the last fifth of what comes after the step, its first sample included.
    assert m.tail_rms == pytest.approx(0.004 * 3.6)
    assert m.oscillation_Hz is None
    # A tail of two fifths: fifteen samples, of which four are cut and four below.
    longer = step_metrics(
        *(t, np.minimum(sign * y, start + 3.6) * sign),
        **{"step_s": step_s, "tail": 0.4, "before": sign * start, "after": sign * (start + 4.0)},
    )
    assert longer.final == pytest.approx(sign * (start + 3.6 * (1 - 4 * 0.004 / 15)))
    assert longer.overshoot_percent == pytest.approx(100 * (1 / (1 - 4 * 0.004 / 15) - 1))


def spectrum(values: np.ndarray) -> tuple[float, np.ndarray]:
    """RMS without the straight line of least squares, and powers of its lines, by sums."""
    n = len(values)
    k = np.arange(n)
    flat = values - np.polyval(np.polyfit(k, values, 1), k)
    windowed = flat * (0.5 - 0.5 * np.cos(2 * np.pi * k / (n - 1)))
    lines = np.exp(-2j * np.pi * np.outer(np.arange(n // 2 + 1), k) / n) @ windowed
    return math.sqrt(np.mean(flat**2)), np.abs(lines) ** 2


LATE = np.arange(0, 24.25, 0.25)  # 32, 32 and 33 samples in its thirds


def ring(middle: np.ndarray, end: np.ndarray, level: float = 1.0):
    y = np.full(len(LATE), level)
    y[32:64] += middle
    y[64:] += end
    t = np.concatenate([[-2.0, -1.0], LATE])
    # Twice as large: all is judged by the step.
    return step_metrics(t, 2 * np.concatenate([[0.0, 0.0], y]), step_s=0.0, after=2.0)


def test_an_oscillation_by_its_size_and_by_what_it_was_before():
    wave = np.sin(2 * np.pi * LATE)
    middle, end = wave[32:64], wave[64:]
    before, after = spectrum(middle)[0], spectrum(end)[0]
    for grown, verdict in (
        *((0.897, "stable"), (0.903, "sustained oscillation")),
        *((1.097, "sustained oscillation"), (1.103, "growing")),
    ):
        m = ring(0.1 / before * middle, 0.1 * grown / after * end)
        assert m.verdict == verdict
        if verdict != "stable":
            assert m.oscillation_Hz == pytest.approx(1.0)
            assert m.rise_s is m.settling_2_s is m.settling_5_s is m.overshoot_percent is None
            assert m.reason == (
                f"{0.2 * grown:.3g} RMS at 1 Hz in the last third, 0.2 in the middle third"
            )
            assert m.final == pytest.approx(np.mean(2 + 0.2 * grown / after * wave[-20:]))
    for rms, verdict in ((0.01995, "stable"), (0.02005, "sustained oscillation")):
        assert ring(rms / before * middle, rms / after * end).verdict == verdict


GOOD = np.concatenate([np.zeros(10), np.ones(40)])
T = np.arange(-10.0, 40.0)


def changed(**at: float) -> np.ndarray:
    y = GOOD.copy()
    for k, v in at.items():
        y[int(k[1:])] = v
    return y


def test_a_response_has_diverged_beyond_ten_steps():
    for far in (10.0, -10.0):
        assert step_metrics(T, changed(_20=far), step_s=0.0).verdict != "diverged"
        m = step_metrics(T, changed(_20=1.001 * far, _30=99.0), step_s=0.0)
        assert (m.verdict, m.reason, m.initial) == (
            *("diverged", "more than 10 steps away at 10 s", 0.0),
        )
        assert m.final is m.rise_s is m.steady_error is m.tail_rms is None
    for far, verdict in ((6.0, "stable"), (6.01, "diverged")):
        m = step_metrics(T, changed(_12=far), step_s=0.0, limit=3.0, after=2.0)
        assert m.verdict == verdict
    assert m.reason == "more than 3 steps away at 2 s"
    # From its first level, which is the mean before the step where there is nothing before.
    y = changed(_0=-0.5, _20=9.6)
    m = step_metrics(T, y, step_s=0.0)
    assert (m.verdict, m.initial) == ("diverged", pytest.approx(-0.05))
    assert step_metrics(T, changed(_0=-0.5, _20=9.5), step_s=0.0).verdict != "diverged"
    assert step_metrics(T[10:], changed(_20=11.0)[10:], step_s=0.0).verdict != "diverged"
    assert step_metrics(T[10:], changed(_20=11.1)[10:], step_s=0.0).verdict == "diverged"


def test_what_moves_by_a_step_before_the_step_has_diverged():
    assert step_metrics(T, changed(_3=0.75, _5=-0.25), step_s=0.0).verdict != "diverged"
    m = step_metrics(T, changed(_3=0.75, _5=-0.5), step_s=0.0)
    assert (m.verdict, m.reason) == ("diverged", "moved by 1.25 before the step of 1")
    assert m.initial == pytest.approx(0.025)
    assert step_metrics(T, changed(_3=2.75), step_s=0.0, after=-3.0).verdict != "diverged"


def test_what_is_not_finite_has_diverged_there():
    for bad in (math.nan, math.inf, -math.inf):
        m = step_metrics(T, changed(_17=bad, _30=bad), step_s=0.0)
        assert (m.verdict, m.reason, m.initial) == ("diverged", "not finite from 7 s on", None)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_twentieth_of_a_step_is_a_response(sign):
    for level, verdict in ((0.0995, "no response"), (0.1005, "stable")):
        m = step_metrics(T, sign * level * GOOD, step_s=0.0, after=2.0)
        assert m.verdict == verdict
    m = step_metrics(T, sign * 0.09 * GOOD, step_s=0.0, before=-1.0, after=2.0)
    assert m.reason == f"the level moved by {sign * 0.09:.3g} of 3"
    assert (m.final, m.steady_error) == pytest.approx((sign * 0.09, 2 - sign * 0.09))
    assert m.steady_error_percent == pytest.approx(100 * (2 - sign * 0.09) / 3)


def test_steps_that_cannot_be_judged_are_refused():
    with pytest.raises(UserError, match="is not after"):
        step_metrics(np.concatenate([T[:20], T[10:]]), np.zeros(60), step_s=0.0)
    with pytest.raises(UserError, match=r"response: shape \(49,\), time has \(50,\)"):
        step_metrics(T, GOOD[1:], step_s=0.0)
    for wrong, words in (
        ({"before": 1.0}, r"step of 0\.0, tail 0\.2, limit 10\.0\. Give two different references"),
        ({"after": math.inf}, "step of inf"),
        ({"after": math.nan}, "step of nan"),
        ({"tail": 0.0}, r"tail 0\.0"),
        ({"tail": 0.9}, r"tail 0\.9"),
        ({"limit": 1.0}, r"limit 1\.0"),
    ):
        with pytest.raises(UserError, match=words):
            step_metrics(T, GOOD, **{"step_s": 0.0} | wrong)
    for allowed in ({"tail": 0.001}, {"tail": 0.899}, {"limit": 1.001}, {"after": 0.5}):
        assert step_metrics(T, GOOD, **{"step_s": 0.0} | allowed).stable
    # 32 samples from the step on; and from the record's first sample on.
    assert step_metrics(T, GOOD, step_s=8.0).final == 1.0
    assert step_metrics(T, GOOD, step_s=-10.0).initial == 0.0
    words = r"step_s: 9 s leaves 31 samples of the record \(-10 to 39 s\); 32 are needed"
    with pytest.raises(UserError, match=words):
        step_metrics(T, GOOD, step_s=9.0)
    with pytest.raises(UserError, match=r"step_s: -10\.5 s leaves 50 samples"):
        step_metrics(T, GOOD, step_s=-10.5)
