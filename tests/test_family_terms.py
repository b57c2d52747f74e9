"""Terms of the family of elastomer models: how they are written, and what is none."""

from __future__ import annotations

import pytest

from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term, softened


def test_how_terms_are_written():
    bent, cubic = Rise("bend", 0.4), Rise("power", 3, "negative")
    for term, text in (
        (Term("spring"), "spring of x"),
        (Term("spring", cubic), "spring of x^3, negative side"),
        (Term("offset"), "offset"),
        (Term("stop", bent, (0.125,)), "stop of x/(1+|x|/0.4), threshold 0.125"),
        (Term("slip", Rise("power", 5), (2.0,)), "slip of x^5, path 2"),
        (
            Term("maxwell", Rise("power", 1), (0.33333, 12.0), 0.2, Softening("strain", 0.3)),
            "maxwell of x, time, s 0.3333 12, shares T^-0.2, times 1/(1+m/0.3)",
        ),
        (
            Term("stop", Rise("power", 1), (0.1,), softening=Softening("path", 8.0)),
            "stop of x, threshold 0.1, times exp(-s/8)",
        ),
    ):
        assert term.text == text
    fractional = Term("maxwell", Rise("power", 1), (0.25, 4.0), 0.5)
    assert fractional.shares == ((0.25, 2.0), (4.0, 0.5))
    assert Term("stop", Rise("power", 1), (0.1,)).shares == ((0.1, 1.0),)


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


def test_softened_terms_stand_beside_the_plain_ones():
    one, two = Softening("strain", 0.3), Softening("path", 8.0)
    stop = Term("stop", Rise("bend", 0.4), (0.1,), 0.25)
    found = softened([stop, Term("offset")], one, two)
    assert found == (
        stop,
        Term("stop", Rise("bend", 0.4), (0.1,), 0.25, one),
        Term("stop", Rise("bend", 0.4), (0.1,), 0.25, two),
        Term("offset"),
    )
