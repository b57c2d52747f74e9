"""The forward model's published behaviour, recomputed with the emitted C."""

from __future__ import annotations

import json

import numpy as np
import pytest

from esea_gen.reproduce.torque_model import reproduce_chapter3
from tests.model.test_elastomer import P
from tests.observed import filtered


@pytest.fixture(scope="module")
def chapter3():
    return reproduce_chapter3()


def test_the_numbers_recomputed_independently(chapter3):
    content = chapter3.to_dict()
    for name, tolerance in (
        ("sweep_peak_Nm", 0.005),
        ("hysteresis_Nm", 0.0005),
        ("slow_peak_Nm", 0.005),
        ("loop_mJ", 0.1),
        ("slow_largest_Nm", 0.005),
    ):
        entry = content[name]
        assert entry["ours"] == pytest.approx(entry["recomputed"], abs=tolerance), name
    assert content["sweep_peak_Nm"]["ours"] == pytest.approx(
        content["sweep_peak_Nm"]["thesis"], 0.01
    )
    json.dumps(content, allow_nan=False)


def test_relaxation_ends_at_the_spring_and_the_stops(chapter3):
    # At rest the Maxwell element has nothing: cubic and saturated stops are left (spec/3).
    # The ramp's end is sudden: the observer goes past it, by a count at most, and the saturated
    # stops keep how far it came back.
    for name, (time_s, torque) in chapter3.relaxation.items():
        theta = np.deg2rad(float(name.split()[0]))
        ramp = np.arange(0.0, theta, np.deg2rad(20.0) * 1e-3)
        motion = np.concatenate([np.zeros(1000), ramp, np.full(2000, theta)])
        past = np.max(filtered(motion, 2 * np.pi / 2**12)) - theta
        assert 0 < past <= 2 * np.pi / 2**12
        stops = sum(
            P["alpha"] * np.exp(-P["beta"] * r) * (min(theta + past, r) - past)
            for r in P["omega"] * np.arange(1, 11)
        )
        assert time_s[-1] > 299
        assert torque[-1] == pytest.approx(P["k3"] * theta**3 + P["k1"] * theta + stops, abs=1e-6)
        # It only falls, once the observer has come back; 0.2 s are 19 of its time constants.
        assert np.all(np.diff(torque[time_s > 0.2]) <= 1e-12)
