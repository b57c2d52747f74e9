"""Virtual normalisation: its map by numerical integration, properties, rejected input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from esea_gen.errors import UserError
from esea_host.wrist.calibration import crossings, node_speeds, quality
from esea_host.wrist.normalisation import NodeSpeeds, fit_rbf, node_places, normalise

FORMS = [{}, {"slope": True}, {"base": False}, {"base": False, "slope": True}]


def speeds(low, high, values=None, scale=1.0):
    nodes = node_places(low, high)
    given_ = [50 + 30 * np.cos(np.radians(n)) for n in nodes] if values is None else values
    return NodeSpeeds(low, high, tuple(nodes), tuple(scale * v for v in given_))


HEALTHY = speeds(-62.0, 55.0)
CONSTRAINED = speeds(-58.0, 13.0, [38, 44, 52, 55, 49, 40, 22])


@pytest.mark.parametrize("form", FORMS)
def test_map_and_derivative_against_numerical_integration(form):
    found = normalise(HEALTHY, CONSTRAINED, **form)
    middle = (-58.0 + 13.0) / 2
    f = found.factor

    def factor(theta):
        """The published sum, term by term."""
        total = f.base + f.slope_1_deg * theta
        for a, c in zip(f.weights, f.centres_deg, strict=True):
            total += a * np.exp(-((theta - c) ** 2) / (2 * f.sigma_deg**2))
        return total

    for theta in np.linspace(-58, 13, 23):
        wanted, _ = quad(factor, 0, theta - middle, epsabs=1e-12, epsrel=1e-12)
        assert found.position(theta) == pytest.approx(wanted, abs=1e-9)
        assert found.scaling(theta) == pytest.approx(factor(theta - middle), abs=1e-9)
        h = 1e-4
        slope = (found.position(theta + h) - found.position(theta - h)) / (2 * h)
        if -57 < theta < 12:
            assert slope == pytest.approx(found.scaling(theta), rel=1e-6)


def test_the_network_goes_through_every_node_and_sigma_is_the_mean_distance():
    nodes, values = [-20.0, -10.0, 0.0, 15.0], [1.0, 2.0, 1.5, 3.0]
    for form in FORMS:
        f = fit_rbf(nodes, values, **form)
        assert f.sigma_deg == pytest.approx(35 / 3)
        assert f.value(nodes) == pytest.approx(values, abs=1e-10)


def test_the_linear_term_is_the_least_of_all_that_fit():
    """Moving along the one free direction makes the sum of squares larger, either way."""
    nodes, values = np.array([-20.0, -10.0, 0.0, 15.0]), np.array([1.0, 2.0, 1.5, 3.0])
    f = fit_rbf(nodes, values, slope=True, base=False)
    d = (nodes[:, None] - nodes) / f.sigma_deg
    free = np.append(np.linalg.solve(np.exp(-d * d / 2), -nodes / f.sigma_deg), 1.0)
    own = np.append(f.weights, f.slope_1_deg * f.sigma_deg)
    for step in (1e-3, -1e-3):
        assert np.sum((own + step * free) ** 2) > np.sum(own**2)
    assert f.slope_1_deg != 0


def test_equal_states_give_the_identity():
    found = normalise(CONSTRAINED, CONSTRAINED)
    theta = np.linspace(-58, 13, 400)
    assert found.position(theta) == pytest.approx(theta + 22.5, abs=1e-9)
    # The published form is 1 at its nodes only, and falls off beyond the outermost.
    published = normalise(CONSTRAINED, CONSTRAINED, base=False)
    assert published.scaling(CONSTRAINED.nodes_deg) == pytest.approx(1, abs=1e-9)
    assert np.min(published.scaling(theta)) < 0.97


@pytest.mark.ci
@settings(max_examples=60)
@given(st.lists(st.floats(20, 120), min_size=7, max_size=7), st.floats(0.5, 3))
def test_accepted_maps_are_monotone_and_scale_as_speeds_do(values, scale):
    constrained = speeds(-58.0, 13.0, values)
    try:
        found = normalise(HEALTHY, constrained)
    except UserError as error:
        assume("would reverse" not in str(error))
        raise
    theta = np.linspace(-70, 25, 4001)
    assert np.all(np.diff(found.position(theta)) > 0)
    assert found.position(-22.5) == pytest.approx(0, abs=1e-12)
    # Both speeds in another unit: the same map.  Only the healthy ones: so many times the map.
    both = normalise(speeds(-62.0, 55.0, scale=scale), speeds(-58.0, 13.0, values, scale))
    assert both.position(theta) == pytest.approx(found.position(theta), rel=1e-9, abs=1e-9)
    faster = normalise(speeds(-62.0, 55.0, scale=scale), constrained)
    assert faster.position(theta) == pytest.approx(
        scale * found.position(theta), rel=1e-9, abs=1e-9
    )


@pytest.mark.parametrize("form", FORMS)
def test_the_unit_of_the_angle_does_not_matter(form):
    k = np.pi / 180

    def other(s):
        nodes = tuple(k * n for n in s.nodes_deg)
        return NodeSpeeds(
            k * s.low_deg, k * s.high_deg, nodes, tuple(k * v for v in s.speeds_deg_s)
        )

    theta = np.linspace(-58, 13, 50)
    a = normalise(HEALTHY, CONSTRAINED, **form).position(theta)
    b = normalise(other(HEALTHY), other(CONSTRAINED), **form).position(k * theta)
    assert k * a == pytest.approx(b, abs=1e-9)


def test_a_drift_free_map_comes_back_where_it_was():
    """Integrating the scaled speed step by step does not."""
    found = normalise(HEALTHY, CONSTRAINED)
    t = np.arange(0, 60, 0.01)
    theta = -22.5 + 30 * np.sin(2 * np.pi * 0.9 * t) * np.sin(2 * np.pi * 0.05 * t)
    x = found.position(theta)
    assert x[np.argmin(np.abs(theta[1:] - theta[0])) + 1] == pytest.approx(x[0], abs=0.5)
    summed = np.cumsum(found.scaling(theta[:-1]) * np.diff(theta))
    assert np.max(np.abs(summed - (x[1:] - x[0]))) > 0.01


@pytest.mark.parametrize(
    ("healthy", "constrained", "form", "words"),
    [
        (HEALTHY, speeds(-8.0, 13.0, [30.0, 30.0]), {}, "2 nodes, 3 are needed"),
        (HEALTHY, speeds(-58.0, 13.0, [30.0] * 6 + [0.0]), {}, "10.0 deg is 0 deg/s"),
        (HEALTHY, speeds(-80.0, 60.0), {}, "constrained range, 140.0 deg, is larger"),
        (
            HEALTHY,
            speeds(-58.0, 13.0, [2.0, 200, 2, 200, 2, 200, 2]),
            {"base": False},
            "would reverse",
        ),
    ],
)
def test_what_cannot_be_normalised_is_refused_with_the_reason(healthy, constrained, form, words):
    with pytest.raises(UserError, match=words):
        normalise(healthy, constrained, **form)


def test_a_node_that_was_never_crossed_is_named():
    never = NodeSpeeds(-58.0, 13.0, CONSTRAINED.nodes_deg, (30.0,) * 6 + (None,))
    with pytest.raises(UserError, match=r"never crossed the node at 10\.0 deg"):
        normalise(HEALTHY, never)


# -- calibration -----------------------------------------------------------------------------------


def swing(size_deg, rate_Hz, seconds=10.0, middle=0.0):
    t = np.arange(0, seconds, 0.01)
    return t, middle + size_deg * np.sin(2 * np.pi * rate_Hz * t)


def test_speeds_at_nodes_of_a_swing():
    """At an angle x a swing of size A goes with 2 pi f sqrt(A^2 - x^2)."""
    t, theta = swing(40.0, 0.3)
    found = node_speeds(-40.0, 40.0, [(t, theta)])
    assert found.nodes_deg == (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0)
    wanted = [2 * np.pi * 0.3 * np.sqrt(1600 - n * n) for n in found.nodes_deg]
    assert found.speeds_deg_s == pytest.approx(wanted, rel=5e-3)
    assert len(crossings([(t, theta)], 10.0)) == 6  # three periods, either way


@pytest.mark.parametrize(
    ("trace", "keys"),
    [
        (swing(40.0, 0.3), set()),
        (swing(25.0, 0.3), {"further", "more"}),
        (swing(40.0, 0.3, 3.3), {"more"}),
        (swing(40.0, 0.02, 200.0), {"faster"}),
    ],
)
def test_live_quality_says_what_to_do(trace, keys):
    found = quality(-40.0, 40.0, [trace])
    assert {c.key for c in found} == keys
    assert all(c.words for c in found)
