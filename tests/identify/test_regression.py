"""Least squares with intervals by blocks, against loops over blocks and another solver."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from esea_gen.identify.drive.regression import CONFIDENCE, Estimate, fit_linear, fit_separable

# Student's t for 97.5 %, from printed tables.
QUANTILES = {1: 12.7062, 2: 4.3027, 4: 2.7764, 9: 2.2622, 30: 2.0423}


@pytest.mark.parametrize("degrees", QUANTILES)
def test_an_interval_is_students_with_a_degree_less_than_blocks(degrees):
    found = Estimate.of(3.0, 0.5, degrees + 1)
    half = QUANTILES[degrees] * 0.5
    assert (found.value, found.low, found.high) == pytest.approx((3, 3 - half, 3 + half), rel=4e-5)
    assert found.half == pytest.approx(half, rel=4e-5)
    assert CONFIDENCE == 0.95
    # One block says no more than two.
    assert Estimate.of(3.0, 0.5, 1) == Estimate.of(3.0, 0.5, 2)


def clustered(jacobian: np.ndarray, residual: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """Sum over blocks, one after another; m/(m-1) and n/(n-p) as of Cameron and Miller."""
    n, p = jacobian.shape
    square = sum(np.outer(row, row) for row in jacobian)
    meat = np.zeros((p, p))
    for b in set(blocks.tolist()):
        pull = sum(jacobian[k] * residual[k] for k in np.flatnonzero(blocks == b))
        meat += np.outer(pull, pull)
    m, inverse = len(set(blocks.tolist())), np.linalg.inv(square)
    return inverse @ meat @ inverse * m / (m - 1) * n / (n - p)


def test_a_linear_fit_is_that_of_singular_values_with_the_blocks_covariance():
    rng = np.random.default_rng(7)
    # The columns are of other sizes, and nearly alike.
    terms = rng.normal(size=(60, 3)) @ np.array([[1, 10, 0], [0, 1, 0.02], [0, 0, 0.1]])
    wanted = terms @ [2.0, -0.01, 300.0] + rng.normal(0, 0.1, 60)
    blocks = np.repeat([4.0, 1.0, 7.0, 2.0, 9.0], [20, 5, 5, 18, 12])
    found = fit_linear(terms, wanted, blocks)
    expected = np.linalg.lstsq(terms, wanted, rcond=None)[0]
    np.testing.assert_allclose(found.values, expected, rtol=1e-9)
    left = wanted - terms @ expected
    np.testing.assert_allclose(found.residual, left, atol=1e-9)
    assert found.blocks == 5
    covariance = clustered(terms, left, blocks)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-6)
    assert found.rms == pytest.approx(math.sqrt(float(left @ left) / 60), rel=1e-9)
    # By Student's t of four degrees.
    for k, e in enumerate(found.estimates()):
        assert e.value == found.values[k]
        assert e.half == pytest.approx(QUANTILES[4] * math.sqrt(covariance[k, k]), rel=4e-5)


LOW, HIGH = np.array([0.2, 1.0]), np.array([1.0, 4.0])


def curved(x: np.ndarray, y: np.ndarray):
    """What is wanted of two parameters; they may never be asked beyond their ends."""
    asked = []

    def wanted(p: np.ndarray) -> np.ndarray:
        assert np.all((p >= LOW) & (p <= HIGH)), p
        asked.append(p.copy())
        return y - 3 * np.exp(-p[0] * x) - np.sin(p[1] * x)

    return wanted, asked


@pytest.mark.parametrize("middle", [(0.503, 0.497), (0.497, 0.503)])
def test_a_fit_of_a_few_more_parameters_is_that_of_another_solver(middle):
    """Both parameters a little beside the middle of their ranges, to either side."""
    rng = np.random.default_rng(11)
    x = np.linspace(0, 4, 80)
    terms, blocks = np.stack([np.ones(80), x], axis=1), np.arange(80) // 8
    true = np.array(middle) * (LOW + HIGH)
    y = 3 * np.exp(-true[0] * x) + np.sin(true[1] * x) + 0.5 - 0.2 * x + rng.normal(0, 1e-4, 80)
    wanted, asked = curved(x, y)
    found = fit_separable(terms, wanted, np.array([2.0, 3.0]), LOW, HIGH, blocks)
    assert asked[0] == pytest.approx([1.0, 3.0])  # started inside

    def model(x, a, b, c, d):
        return 3 * np.exp(-a * x) + np.sin(b * x) + c + d * x

    other = curve_fit(model, x, y, [*true, 0.5, -0.2], xtol=1e-14, ftol=1e-14)[0]
    np.testing.assert_allclose(found.values, other, rtol=1e-5)
    p = found.values[:2]
    # Differences of a hundred-thousandth of the range, towards its middle.
    columns = []
    for k, size in enumerate(1e-5 * (HIGH - LOW)):
        step = np.zeros(2)
        step[k] = size if middle[k] < 0.5 else -size
        before, after = ([3 * np.exp(-q[0] * x) + np.sin(q[1] * x)][0] for q in (p, p + step))
        columns.append((after - before) / step[k])
    jacobian = np.column_stack([*columns, terms])
    left = y - model(x, *found.values)
    np.testing.assert_allclose(found.residual, left, atol=1e-12)
    np.testing.assert_allclose(found.covariance, clustered(jacobian, left, blocks), rtol=2e-8)
    assert found.blocks == 10
