"""Temperatures of recordings, and how far a change a kelvin is searched."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.identify.recording.conditions import (
    at_edge,
    at_temperature,
    far_apart,
    scaled_terms,
    searched_factor,
    tells_none,
    temperature_name,
    temperatures_of,
)
from esea_gen.model.family import Member, Rise, Term
from esea_gen.model.temperature import TemperatureFactor


def recording(temperature_C, *trained):
    sets = [SimpleNamespace(training=np.arange(n)) for n in trained]
    return SimpleNamespace(temperature_C=temperature_C, sets=sets)


SOME = [
    *(recording(25.0, 0, 3), recording(None, 5), recording(19.0, 0), recording(22.0, 1)),
    recording(25.0, 2),
]
SPRING = Term("spring", Rise("power", 1))
MEMBER = Member("m", "made up", (SPRING, Term("offset"), Term("spring", Rise("power", 3))))


def test_temperatures_are_sorted_once_each_and_of_what_trains_where_asked():
    assert temperatures_of(SOME) == [19.0, 22.0, 25.0]
    assert temperatures_of(SOME, training=True) == [22.0, 25.0]
    assert not tells_none(SOME)
    assert tells_none(SOME[:3])
    for known, apart in (
        ([], False),
        ([20.0], False),
        ([20.0, 22.99], False),
        ([20, 21, 23], True),
    ):
        assert far_apart(known) == apart
    assert [temperature_name(recording(t)) for t in (None, 21.4, -3.6)] == [
        "",
        "21 degC",
        "-4 degC",
    ]


def test_an_offset_has_no_temperature():
    assert scaled_terms(MEMBER).tolist() == [1, 0, 1]
    terms = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    assert at_temperature(MEMBER, None, 30.0, terms) is terms
    factor = TemperatureFactor(20.0, -0.01, 10.0, 40.0)
    # A hundredth less a kelvin: 0.9 of it at 30 degC, 1.05 at 15 degC.
    assert [float(factor.at(np.array(t))) for t in (30.0, 15.0)] == pytest.approx([0.9, 1.05])
    found = at_temperature(MEMBER, factor, np.array([30.0, 15.0]), terms)
    assert found == pytest.approx(np.array([[0.9, 2, 2.7], [4.2, 5, 6.3]]))
    assert at_temperature(MEMBER, factor, 30.0, terms)[1] == pytest.approx([3.6, 5, 5.4])


def weights(basis, target):
    return np.linalg.lstsq(basis, target, rcond=None)[0]


@pytest.mark.parametrize("per_K", [-0.012, 0.004])
@pytest.mark.parametrize("warm_C", [25.0, 31.0])
def test_the_factor_of_exact_torques_is_found(per_K, warm_C):
    recordings = [recording(19.0, 1), recording(22.0, 1), recording(warm_C, 1), recording(40.0, 0)]
    reference = round((19 + 22 + warm_C) / 3, 1)
    x = np.random.default_rng(4).normal(size=(90, 3))
    rows = np.repeat([19.0, 22.0, warm_C], 30)
    g = 1 + per_K * (rows - reference)
    target = g * (2 * x[:, 0] - 5 * x[:, 2]) + 3 * x[:, 1]
    found = searched_factor(MEMBER, recordings, rows, x, target, weights)
    # It is to hold from the coldest to the warmest recording, whether that trains or not.
    assert (found.reference_C, found.low_C, found.high_C) == (reference, 19.0, 40.0)
    assert found.per_K == pytest.approx(per_K, abs=1e-6)
    assert at_edge(found) is None
    near = [recording(t, 1) for t in (19.0, 21.0, None)]
    assert searched_factor(MEMBER, near, rows, x, target, weights) is None


@pytest.mark.parametrize(
    ("low_C", "high_C", "least", "most"),
    [
        # A twentieth a kelvin at most; and a fifth of the torque, all but a thousandth of the
        # fall to it, is left at the warmest or the coldest.
        (10.0, 22.0, -0.05, 0.05),
        (10.0, 40.0, -0.999 * 0.8 / 20, 0.05),
        (-10.0, 22.0, -0.05, 0.999 * 0.8 / 30),
        (-20.0, 70.0, -0.999 * 0.8 / 50, 0.999 * 0.8 / 40),
    ],
)
def test_the_ends_of_what_is_searched_are_told(low_C, high_C, least, most):
    near = 1e-4 * (most - least)
    for per_K, end in (
        *((least + 0.98 * near, "low"), (least + 1.02 * near, None), (0.0, None)),
        *((most - 1.02 * near, None), (most - 0.98 * near, "high")),
    ):
        assert at_edge(TemperatureFactor(20.0, per_K, low_C, high_C)) == end
