"""The largest torque that a member of the family can give: by hand, and met by a path."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.model.family import FittedMember, Member, Rise, Term
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


def test_an_offset_counts_by_its_size_and_branches_by_their_shares():
    assert most((-0.3, Term("offset", LINEAR))) == pytest.approx(0.3)
    slow = Term("maxwell", LINEAR, (1.0, 4.0), exponent=0.5)  # shares 1 and 1/2
    assert most((1.0, slow)) == pytest.approx(2 * X * 1.5)


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
