"""Judged steps: figures of responses of straight lines, and where each verdict begins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.analysis.step import step_metrics
from esea_gen.errors import UserError

GOOD = np.concatenate([np.zeros(10), np.ones(40)])
T = np.arange(-10.0, 40.0)


def changed(**at: float) -> np.ndarray:
    y = GOOD.copy()
    for k, v in at.items():
        y[int(k[1:])] = v
    return y


def test_what_is_not_finite_has_diverged_there():
    for bad in (math.nan, math.inf, -math.inf):
        m = step_metrics(T, changed(_17=bad, _30=bad), step_s=0.0)
        assert (m.verdict, m.reason, m.initial) == ("diverged", "not finite from 7 s on", None)


def test_steps_that_cannot_be_judged_are_refused():
    with pytest.raises(UserError, match="is not after"):
        step_metrics(np.concatenate([T[:20], T[10:]]), np.zeros(60), step_s=0.0)
    with pytest.raises(UserError, match=r"response: shape \(49,\), time has \(50,\)"):
        step_metrics(T, GOOD[1:], step_s=0.0)
    for wrong, words in (
        ({"before": 1.0}, r"step of 0\.0\. Give two different references"),
        ({"after": math.inf}, "step of inf"),
        ({"after": math.nan}, "step of nan"),
    ):
        with pytest.raises(UserError, match=words):
            step_metrics(T, GOOD, **{"step_s": 0.0} | wrong)
    assert step_metrics(T, GOOD, step_s=0.0, after=0.5).stable
    # 32 samples from the step on; and from the record's first sample on.
    assert step_metrics(T, GOOD, step_s=8.0).final == 1.0
    assert step_metrics(T, GOOD, step_s=-10.0).initial == 0.0
    words = r"step_s: 9 s leaves 31 samples of the record \(-10 to 39 s\); 32 are needed"
    with pytest.raises(UserError, match=words):
        step_metrics(T, GOOD, step_s=9.0)
    with pytest.raises(UserError, match=r"step_s: -10\.5 s leaves 50 samples"):
        step_metrics(T, GOOD, step_s=-10.5)
