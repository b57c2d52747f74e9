"""The published filters take the rate of their own set-point, cut to what the model is made for."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.model.published_inverse import published_inverse


@pytest.mark.parametrize("name", ["a", "b"])
def test_the_rate_of_the_model_is_that_of_the_set_point_cut_to_its_range(elbow, name):
    block = published_inverse(elbow, name)
    rng = np.random.default_rng(4)
    place = len(block.state) + len(block.outputs)
    labelled = place + [n for n, _ in block.labels].index("omega_rad_s")
    seen = []
    for _ in range(40):
        given = [rng.uniform(p.low, p.high, p.size) / p.size for p in (*block.state, *block.inputs)]
        before = [p.name for p in block.state].index("theta_prev_rad")
        given[[p.name for p in block.state].index("primed")] = np.ones(1)
        out = block.labelled_step.call([ca.DM(x) for x in given])
        rate = (float(out[len(block.state)]) - given[before][0]) / 0.001
        assert float(out[labelled]) == pytest.approx(min(max(rate, -25), 25), rel=1e-9)
        seen.append(rate)
    # Above the range, below it and inside.
    assert min(seen) < -25 < 25 < max(seen)
    assert any(abs(x) < 25 for x in seen)
