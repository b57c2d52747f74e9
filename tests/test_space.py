"""From searched numbers to a file's parameters: the same rubber, inside the bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.identify.published.parameters import bounds_of
from esea_gen.identify.published.space import Space, parameters_of

LINEAR = np.array([12.0, 90.0, 40.0, 5.0])
X = np.array([math.log(0.01), 0.7, math.log(0.5), math.log(20.0), 1.5, math.log(4.0), 0.6])


@pytest.mark.parametrize(
    ("kv", "share", "dropped"),
    [
        (5.0, 1e-4, False),
        (5.0, 0.999e-4, True),
        (0.0, 0.5, True),
        (-1.0, 0.5, True),
        (1e-3, 0.5, False),
    ],
)
def test_a_maxwell_element_that_carries_next_to_nothing_is_left_out(kv, share, dropped):
    space = Space(True, 0.2, 3.0, 10.0)
    values, left_out = parameters_of(space, X, np.array([*LINEAR[:3], kv]), share)
    assert left_out is dropped
    assert ("kv_Nm_rad" in values) is not dropped
    # One that was not asked for is not left out.
    assert parameters_of(Space(False, 0.2, 3.0, 10.0), X[:2], LINEAR[:3], share)[1] is False


def test_parameters_are_cut_to_the_files_bounds():
    space = Space(False, 0.2, 3.0, 10.0)
    values, _ = parameters_of(space, X[:2], np.array([1e9, -1.0, 40.0]), 0.0)
    assert values["k1_Nm_rad"] == bounds_of("k1_Nm_rad")[1]
    assert values["k3_Nm_rad3"] == bounds_of("k3_Nm_rad3")[0]
    assert values["alpha_Nm_rad"] == 40


def test_slopes_of_the_shape_are_those_by_differences():
    space, h = Space(True, 0.2, 3.0, 10.0), 1e-6
    slopes = space.shape_slopes(X)
    for i in range(len(X)):
        step = h * np.eye(len(X))[i]
        up, down = space.shape(X + step), space.shape(X - step)
        for key in up:
            by = (up[key] - down[key]) / (2 * h)
            assert slopes.get(key, {}).get(i, 0.0) == pytest.approx(by, rel=1e-6, abs=1e-7), (
                key,
                i,
            )
