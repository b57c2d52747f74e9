"""Bounds of a family member's rises and first samples: valid and reached."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.family_sensor import unit_terms

LINEAR = Rise("power", 1)
SCALE_RAD, REACH_RAD = 0.5, 0.2
X = REACH_RAD / SCALE_RAD


def most(*weighted):
    member = Member("tried", "tried", tuple(t for _, t in weighted))
    return FittedMember(member, SCALE_RAD, tuple(w for w, _ in weighted)).most_Nm(REACH_RAD)


@pytest.mark.parametrize("term", [Term("maxwell", LINEAR, (3.0,)), Term("stop", LINEAR, (9.0,))])
def test_a_path_gets_there(term):
    block = unit_terms(Member("tried", "tried", (term,)), 0.01)
    path = np.concatenate([np.linspace(0, -X, 20), np.full(6000, -X), np.linspace(-X, X, 3)[1:]])
    y, _ = block.simulator().run({"theta_rad": path})
    largest = np.abs(np.asarray(y["terms_Nm"])).max()
    # The stop has not yet been to the other end on its first way.
    expected = 2 * X if term.kind == "maxwell" else X
    assert largest == pytest.approx(expected, rel=0.01)
    assert largest <= most((1.0, term))


SPAN_RAD, WEIGHT_Nm, COUNT = 0.2, 3.0, 40_001
RISES = [
    Rise(kind, number, side)
    for kind, numbers in (("power", (1, 3)), ("bend", (0.08, 4.0)))
    for number in numbers
    for side in ("both", "positive")
]


def curve(rise: Rise, x: np.ndarray) -> np.ndarray:
    """As its docstring has it."""
    y = x**rise.number if rise.kind == "power" else x / (1 + np.abs(x) / rise.number)
    sides = {"both": y, "positive": np.where(x > 0, y, 0), "negative": np.where(x < 0, y, 0)}
    return sides[rise.side]


def slopes(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.diff(y) / np.diff(x)


@pytest.mark.parametrize("rise", RISES, ids=lambda r: r.text)
@pytest.mark.parametrize("reach", [0.3, 2.5])
def test_a_rise_stays_within_its_bounds_and_reaches_them(rise, reach):
    x = np.linspace(-reach, reach, COUNT)
    y = curve(rise, x)
    assert rise.most(reach) == pytest.approx(np.abs(y).max())
    steep = slopes(y, x)
    assert rise.least_slope(reach) == pytest.approx(steep.min(), abs=4e-3)
    assert rise.least_slope(reach) <= steep.min() + 1e-9
    assert rise.most_slope(reach) == pytest.approx(steep.max(), rel=4e-3)
    assert rise.most_slope(reach) >= steep.max() - 1e-9


@pytest.mark.parametrize("rise", RISES, ids=lambda r: r.text)
@pytest.mark.parametrize("strain", [None, 0.05, 4.0])
@pytest.mark.parametrize("reach", [0.2, 9.0])
def test_the_first_sample_rises_no_less_than_said(rise, strain, reach):
    """At rest a strain softens itself: x over 1 + |x| / a; what follows has softened before."""
    softening = None if strain is None else Softening("strain", strain)
    member = Member("one", "one", (Term("spring", rise, softening=softening),))
    fitted = FittedMember(member, SPAN_RAD, (WEIGHT_Nm,))
    x = np.linspace(-reach, reach, COUNT)
    left = 1.0 if strain is None else 1 / (1 + np.abs(x) / strain)
    steep = slopes(curve(rise, x) * left, x).min() * WEIGHT_Nm / SPAN_RAD
    first = fitted.first_slope_Nm_rad(reach * SPAN_RAD)
    room = 4e-3 * WEIGHT_Nm / SPAN_RAD
    assert first <= steep + 1e-4 * room
    worst = 1.0 if strain is None else 1 / (1 + reach / strain)
    later = slopes(curve(rise, x), x).min() * worst * WEIGHT_Nm / SPAN_RAD
    assert fitted.least_slope_Nm_rad(reach * SPAN_RAD) == pytest.approx(later, abs=room)
    # Exact, but for a bend beyond the middle of both numbers: there at most what it can fall by.
    if rise.kind == "bend" and strain and reach > math.sqrt(strain * rise.number):
        ends = math.sqrt(strain) + math.sqrt(rise.number)
        assert first == pytest.approx(-strain * rise.number / ends**4 * WEIGHT_Nm / SPAN_RAD)
    else:
        assert first == pytest.approx(steep, abs=room)
