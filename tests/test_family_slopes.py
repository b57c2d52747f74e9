"""Bounds of a rise, of a softening and of a member's springs, against values over a fine grid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term

SCALE_rad, WEIGHT_Nm, COUNT = 0.2, 3.0, 40_001
RISES = [
    Rise(kind, number, side)
    for kind, numbers in (("power", (1, 3, 5)), ("bend", (0.08, 0.4, 4.0)))
    for number in numbers
    for side in ("both", "positive", "negative")
]


def curve(rise: Rise, x: np.ndarray) -> np.ndarray:
    """As its docstring has it."""
    y = x**rise.number if rise.kind == "power" else x / (1 + np.abs(x) / rise.number)
    sides = {"both": y, "positive": np.where(x > 0, y, 0), "negative": np.where(x < 0, y, 0)}
    return sides[rise.side]


def slopes(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.diff(y) / np.diff(x)


@pytest.mark.parametrize("rise", RISES, ids=lambda r: r.text)
@pytest.mark.parametrize("reach", [0.3, 1.0, 2.5])
def test_a_rise_stays_within_its_bounds_and_reaches_them(rise, reach):
    x = np.linspace(-reach, reach, COUNT)
    y = curve(rise, x)
    assert rise.most(reach) == pytest.approx(np.abs(y).max())
    steep = slopes(y, x)
    assert rise.least_slope(reach) == pytest.approx(steep.min(), abs=4e-3)
    assert rise.least_slope(reach) <= steep.min() + 1e-9
    assert rise.most_slope(reach) == pytest.approx(steep.max(), rel=4e-3)
    assert rise.most_slope(reach) >= steep.max() - 1e-9


@pytest.mark.parametrize("softening", [Softening("strain", 0.3), Softening("path", 8.0)])
def test_a_softening_leaves_at_least_what_it_says(softening):
    for reach in (0.3, 1.0, 2.5):
        if softening.kind == "strain":
            left = 1 / (1 + np.linspace(0, reach, 100) / 0.3)
        else:  # a path has no end
            left = np.exp(-np.linspace(0, 1e4, 100) / 8.0)
        assert softening.least(reach) == pytest.approx(left.min(), abs=1e-12)


@pytest.mark.parametrize("rise", RISES, ids=lambda r: r.text)
@pytest.mark.parametrize("strain", [None, 0.05, 0.3, 4.0])
@pytest.mark.parametrize("reach", [0.2, 1.0, 9.0])
def test_the_first_sample_rises_no_less_than_said(rise, strain, reach):
    """At rest a strain softens itself: x over 1 + |x| / a; what follows has softened before."""
    softening = None if strain is None else Softening("strain", strain)
    member = Member("one", "one", (Term("spring", rise, softening=softening),))
    fitted = FittedMember(member, SCALE_rad, (WEIGHT_Nm,))
    x = np.linspace(-reach, reach, COUNT)
    left = 1.0 if strain is None else 1 / (1 + np.abs(x) / strain)
    steep = slopes(curve(rise, x) * left, x).min() * WEIGHT_Nm / SCALE_rad
    first = fitted.first_slope_Nm_rad(reach * SCALE_rad)
    room = 4e-3 * WEIGHT_Nm / SCALE_rad
    assert first <= steep + 1e-4 * room
    worst = 1.0 if strain is None else 1 / (1 + reach / strain)
    later = slopes(curve(rise, x), x).min() * worst * WEIGHT_Nm / SCALE_rad
    assert fitted.least_slope_Nm_rad(reach * SCALE_rad) == pytest.approx(later, abs=room)
    # Exact, but for a bend beyond the middle of both numbers: there at most what it can fall by.
    if rise.kind == "bend" and strain and reach > math.sqrt(strain * rise.number):
        ends = math.sqrt(strain) + math.sqrt(rise.number)
        fall = -strain * rise.number / ends**4 * WEIGHT_Nm / SCALE_rad
        assert first == pytest.approx(fall)
    else:
        assert first == pytest.approx(steep, abs=room)
