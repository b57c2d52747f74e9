"""From searched numbers to a file's parameters: the same rubber, inside the bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.identify.published.parameters import bounds_of
from esea_gen.identify.published.space import Space, parameters_of

LINEAR = np.array([12.0, 90.0, 40.0, 5.0])
X = np.array([math.log(0.01), 0.7, math.log(0.5), math.log(20.0), 1.5, math.log(4.0), 0.6])


def viscosity(p, theta, rate):
    over = p["A_Nms_rad"] * theta ** p["m"] + p["eps1_Nms_rad"]
    return over / (p["B"] * rate ** p["n"] + p["eps2"])


def moved(**changed: float) -> np.ndarray:
    x = X.copy()
    for key, value in changed.items():
        x[int(key[1:])] = value
    return x


@pytest.mark.parametrize(
    "x", [X, moved(x2=math.log(1e-3)), moved(x3=math.log(1e4)), moved(x5=math.log(1e4), x2=3.0)]
)
@pytest.mark.parametrize("kv", [5.0, 1e-3, 400.0])
def test_the_viscosity_is_that_of_the_shape_times_the_stiffness(x, kv):
    """A, eps1, B and eps2 may be multiplied by one number: the ratio is what counts."""
    space = Space(True, 0.2, 3.0, 10.0)
    values, dropped = parameters_of(space, x, np.array([*LINEAR[:3], kv]), 0.5)
    assert not dropped
    assert values["kv_Nm_rad"] == kv
    shape = space.shape(x)
    for theta, rate in ((0, 0), (0.2, 0), (0, 3.0), (0.07, 0.4)):
        wanted = kv * viscosity(shape, theta, rate)
        assert viscosity(values, theta, rate) == pytest.approx(wanted, rel=1e-9)
    for key, value in values.items():
        low, high = bounds_of(key)
        assert low <= value <= high, key
    for key, value in {"omega_rad": 0.01, "m": 1.5, "n": 0.6}.items():
        assert values[key] == pytest.approx(value)
    assert [values[k] for k in ("k1_Nm_rad", "k3_Nm_rad3", "alpha_Nm_rad")] == [12, 90, 40]


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
