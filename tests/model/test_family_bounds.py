"""Bounds of a family member's rises, softenings, slopes and torques; what is no term is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.family_sensor import unit_terms

LINEAR, CUBIC = Rise("power", 1), Rise("power", 3)
SCALE_RAD, REACH_RAD = 0.5, 0.2
X = REACH_RAD / SCALE_RAD


def most(*weighted):
    member = Member("tried", "tried", tuple(t for _, t in weighted))
    fitted = FittedMember(member, SCALE_RAD, tuple(w for w, _ in weighted))
    return fitted.most_Nm(REACH_RAD)


@pytest.mark.parametrize(
    ("term", "size"),
    [
        (Term("spring", LINEAR), X),
        (Term("spring", CUBIC), X**3),
        # Relaxed at one end and moved to the other before it forgets: the whole way there.
        (Term("maxwell", LINEAR, (3.0,)), 2 * X),
        (Term("maxwell", CUBIC, (3.0,)), 2 * X**3),
        # A stop gives up at its threshold, if it gets as far.
        (Term("stop", LINEAR, (0.1,)), 0.1),
        (Term("stop", LINEAR, (9.0,)), 2 * X),
        (Term("offset", LINEAR), 1.0),
    ],
)
def test_each_term_by_hand(term, size):
    assert most((1.5, term)) == pytest.approx(1.5 * size)
    # Terms add up, whatever their sign; one without weight has none.
    both = most((1.5, term), (2.0, Term("spring", LINEAR)), (0.0, Term("spring", CUBIC)))
    assert both == pytest.approx(1.5 * size + 2.0 * X)


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


@pytest.mark.parametrize(("way", "met"), [(3.0, 3.0), (7.9, 7.9), (8.0, 8.0), (20.0, 8.0)])
def test_a_slip_forgets_over_its_path_and_a_step_counts_for_eight_of_them(way, met):
    """One step from rest: 1 - exp(-v) with e^v to its third power, v paths long, 8 at most."""
    path = X / 30
    block = unit_terms(Member("tried", "tried", (Term("slip", LINEAR, (path,)),)), 0.01)
    y, _ = block.simulator().run({"theta_rad": np.array([0.0, way * path])})
    growth = sum(met**k / math.factorial(k) for k in range(4))
    assert float(np.ravel(y["terms_Nm"])[-1]) == pytest.approx(path * (1 - 1 / growth), rel=1e-6)


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


@pytest.mark.parametrize("softening", [Softening("strain", 0.3), Softening("path", 8.0)])
def test_a_softening_leaves_at_least_what_it_says(softening):
    for reach in (0.3, 1.0, 2.5):
        if softening.kind == "strain":
            left = 1 / (1 + np.linspace(0, reach, 100) / 0.3)
        else:  # a path has no end
            left = np.exp(-np.linspace(0, 1e4, 100) / 8.0)
        assert softening.least(reach) == pytest.approx(left.min(), abs=1e-12)


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
        fall = -strain * rise.number / ends**4 * WEIGHT_Nm / SPAN_RAD
        assert first == pytest.approx(fall)
    else:
        assert first == pytest.approx(steep, abs=room)


def test_what_is_no_term_is_refused():
    for kind, numbers in (
        ("spring", (1.0,)),
        ("offset", (1.0,)),
        ("stop", ()),
        ("stop", (1.0, 2.0)),
        ("slip", ()),
        ("slip", (0.0,)),
        ("maxwell", ()),
        ("maxwell", (1.0, -1.0)),
        ("maxwell", (1.0, 0.0, 2.0)),
    ):
        with pytest.raises(ValueError, match=f"a {kind} cannot have the numbers"):
            Term(kind, Rise("power", 1), numbers)
    Term("maxwell", Rise("power", 1), (1.0, 1e-9))
    for number in (0, 2, 4, 6, 1.5):
        with pytest.raises(ValueError, match="no odd power up to 5"):
            Rise("power", number)
    for wrong in (0.0, -0.1, float("nan")):
        with pytest.raises(ValueError, match="must be above 0"):
            Rise("bend", wrong)
        with pytest.raises(ValueError, match="must be above 0"):
            Softening("strain", wrong)


def test_a_member_has_one_weight_a_term_and_none_that_gives_energy():
    terms = (Term("spring"), Term("maxwell", Rise("power", 1), (1.0,)), Term("offset"))
    member = Member("m", "m", terms)
    assert member.timed
    assert not Member("m", "m", terms[::2]).timed
    kept = FittedMember(member, 0.2, (0.0, 2.0, -0.1))
    assert kept.used == ((2.0, terms[1]), (-0.1, terms[2]))
    assert kept.factors == (1.0, 1.0)
    for weights in ((1.0,), (1.0, 2.0), (1.0, 2.0, 3.0, 4.0)):
        with pytest.raises(ValueError, match="not one weight a term"):
            FittedMember(member, 0.2, weights)
    with pytest.raises(ValueError, match="no scale"):
        FittedMember(member, 0.0, (1.0, 2.0, 3.0))
    for weights in ((-1e-9, 0.0, 0.0), (0.0, float("nan"), 0.0)):
        with pytest.raises(ValueError, match="would give energy away"):
            FittedMember(member, 0.2, weights)
