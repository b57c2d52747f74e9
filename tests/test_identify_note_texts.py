"""Notes of an identification, typed whole, and where each begins."""

from __future__ import annotations

import math
from types import SimpleNamespace as Of

import numpy as np
import pytest

from esea_gen.identify.notes import (
    band_notes,
    notes_of,
    recording_notes,
    specimen_notes,
    temperature_notes,
    told_apart_notes,
)
from esea_gen.identify.parameters import bounds_of
from esea_gen.identify.plays import play_at_bound, play_bounds
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.temperature import TemperatureFactor

VALUES = {"k1_Nm_rad": 10.0, "alpha_Nm_rad": 3.0, "omega_rad": 0.03125}
RATED = VALUES | {"kv_Nm_rad": 5.0, "eps2": 0.0131}


def file(label="one", times=(0.0, 0.25, 0.5), theta=(0.03125, -0.0625, 0.0), **more):
    made = {"dropped": 0, "timed": True, "temperature_C": None, "sets": ()}
    return Of(label=label, time_s=np.array(times), theta_rad=np.array(theta), **made | more)


def source(deflection=None, torque=None, full_scale_Nm=4.0):
    def scale(status):
        return None if status is None else Of(status=status)

    mapping = Of(
        deflection=Of(scale_rad_per_m=scale(deflection)),
        torque=Of(scale_Nm_per_N=scale(torque)),
        sampling=Of(min_step_s=0.002),
        full_scale_Nm=Of(value=full_scale_Nm),
    )
    return Of(mapping=mapping)


def judged(rms_Nm=0.05, asymmetry=(None,), softening=(None,)):
    both = zip(asymmetry, softening, strict=True)
    sets = [(Of(asymmetry=a, softening=s), None, None) for a, s in both]
    return Of(misfits=Of(sets=sets, mean_rms=lambda held_out: rms_Nm if held_out else 99.0))


ONE_SIDE = (
    "Loaded to one side only: asymmetry cannot be judged, and the model's other side is an "
    "assumption."
)
NO_RATE = "Rate terms not identified: the mapping has rate_terms = false."


def told(values=VALUES, files=None, pair=None, sigma=None, edges=(), dropped=False, **scales):
    fit = Of(values=values, rate_dropped=dropped, edges=edges)
    spread = Of(sigma=sigma or {})
    return list(notes_of(source(**scales), files or [file()], fit, spread, judged(), pair))


def test_notes_of_the_published_model_in_their_order():
    notes = told(
        RATED | {"k1_Nm_rad": bounds_of("k1_Nm_rad")[1], "alpha_Nm_rad": 0.0, "omega_rad": 0.0625},
        [file(dropped=3), file("two", timed=False, dropped=1)],
        (judged(0.5), judged(0.25)),
        {"omega_rad": 0.032, "kv_Nm_rad": math.inf, "eps2": math.inf},
        ("omega is low", "beta, too"),
        torque="assumed",
    )
    high = f"{bounds_of('k1_Nm_rad')[1]:.4g}"
    assert notes == [
        "A, eps1, B and eps2 can all be multiplied by one number without changing the torque: "
        "eps2 is fixed at 0.0131, the others are relative to it.",
        "The rate terms rest on a sampling period that is only assumed: their parameters are "
        "marked assumed too.",
        "Held-out error without the Maxwell element 12.50 %, with it 6.25 % of full scale: the "
        "rate terms help. That choice used the held-out data.",
        "The scales from the specimen to a coupling are assumed.",
        "4 of 10 samples dropped by sampling.min_step_s = 0.002 s.",
        ONE_SIDE,
        "Omega is low.",
        "Beta, too.",
        f"k1_Nm_rad = {high} is at its upper bound.",
        "alpha_Nm_rad = 0 is at its lower bound.",
        "omega_rad = 0.0625 is poorly determined (standard deviation 0.032).",
        "kv_Nm_rad = 5 is poorly determined (standard deviation infinite).",
        "eps2 = 0.0131 is poorly determined (standard deviation infinite).",
        "No stop slips within the recorded deflection: the stops are a spring there, not to be "
        "told from k1.",
        "The stop operators carry no torque: beta and omega mean nothing.",
    ]


def test_what_is_just_at_its_end_is_not_told():
    assert told() == [NO_RATE, ONE_SIDE]
    assert told(sigma={"k1_Nm_rad": 5.0, "alpha_Nm_rad": 1.5}) == [NO_RATE, ONE_SIDE]
    assert len(told(sigma={"k1_Nm_rad": 5.0 + 1e-9})) == 3
    slips = [np.nextafter(0.0625, 0), 0.0625]
    assert [len(told(VALUES | {"omega_rad": x})) for x in slips] == [2, 3]


def test_why_there_are_no_rate_terms_in_words():
    head = "Rate terms not identified: "
    pair = (judged(0.25), judged(0.25))
    equal = (
        "Held-out error without the Maxwell element 6.25 %, with it 6.25 % of full scale: the rate "
        "terms do not help, and are left out. That choice used the held-out data."
    )
    dropped = f"{head}the fit gave the Maxwell element no stiffness, so it is left out."
    assert told(pair=pair, dropped=True)[:-1] == [dropped]
    assert told(pair=pair)[:-1] == [
        f"{head}on held-out data the model without them is as good or better.",
        equal,
    ]
    untimed = [file(), file("two", timed=False)]
    assert told(files=untimed)[:-1] == [
        f"{head}no time was recorded; the sampling period is assumed."
    ]


@pytest.mark.parametrize(
    ("deflection", "torque", "assumed"),
    [
        (None, None, False),
        ("published", "identified", False),
        ("assumed", "published", True),
        ("published", "assumed", True),
        ("assumed", None, True),
        (None, "assumed", True),
    ],
)
def test_one_assumed_scale_is_enough(deflection, torque, assumed):
    notes = recording_notes(source(deflection, torque), [file()])
    assert bool(notes) == assumed


def test_a_gap_is_more_than_ten_median_steps():
    steps = [0.25, 0.25, 0.25]
    for gap, said in ((2.5, []), (2.75, ["one: the largest gap between samples is 2.75 s."])):
        times = np.cumsum([0.0, *steps, gap])
        assert recording_notes(source(), [file(times=times), file("short", (0.0, 99.0))]) == said


def asymmetric(worst, side):
    return (
        f"Asymmetry: stiffness to the two sides differs by up to {worst} %, {side} our limit of "
        "5 % (the thesis discarded asymmetric specimens; it prints no limit)."
    )


def test_asymmetry_and_softening_in_words_and_at_their_ends():
    def of(asymmetry, softening, softens=False):
        asymmetry = (asymmetry, None, 0.01)
        return specimen_notes(judged(0.0, asymmetry, (softening, None, -0.5)), softens)

    seen = (
        "Mullins effect or scragging: the last cycle of a block loses up to {} % less work than "
        "its first full one; the model has {}."
    )
    none = (
        "Mullins effect or scragging: none seen, no block's last cycle loses 1 % less work than "
        "its first full one."
    )
    assert of(0.05, 0.01) == [asymmetric("+5.0", "within"), seen.format(1, "no term for it")]
    assert of(-0.05, 0.0099) == [asymmetric("-5.0", "within"), none]
    assert of(0.0501, 0.25, True) == [
        asymmetric("+5.0", "above"),
        seen.format(25, "softening for it"),
    ]
    assert of(-0.25, None) == [asymmetric("-25.0", "above"), none]
    assert specimen_notes(judged(), False) == [ONE_SIDE]


def test_band_and_friction_in_words():
    r = Of(
        label="a", tau_Nm=np.array([2.0, 1, 3, -4]), sets=[Of(held_out=[0, 2]), Of(held_out=[3])]
    )
    verdict = Of(torque_Nm={"a": np.array([2.5, 9.0, 2.25, -3.75])})

    def of(friction_Nm):
        spread = Of(band_Nm=0.5, friction_Nm=friction_Nm)
        return band_notes([r], verdict, spread, 8.0)

    band = (
        "Torque: 95 % of errors in blocks left out are below 0.5 Nm (6.2 % of full scale); of the "
        "held-out samples 67 % are."
    )
    rest = "friction than the model has; the standard deviations hold what it would move."
    assert of(None) == [band]
    assert of(0.125) == [band, f"The residuals show 0.125 Nm more {rest}"]
    assert of(-0.25) == [band, f"The residuals show 0.25 Nm less {rest}"]


def warm(*known):
    trains = (Of(training=[1]),)
    return [Of(temperature_C=c, sets=trains) for c in known]


def test_temperature_in_words():
    apart = (
        "Temperature: the recordings are at 20 to 23 degC, and the published model has no factor "
        "of temperature: it takes them for one."
    )
    near = (
        "Temperature: what it changes is not known; training is at 20 to 22.9 degC, and two at "
        "least 3 K apart would tell."
    )
    assert temperature_notes(warm(None)) == []
    assert temperature_notes(warm(23.0, 20.0, None, 21.0)) == [apart]
    assert temperature_notes(warm(22.9, 20.0, 21.0)) == [near]
    factor = TemperatureFactor(20.0, 0.015625, 10.0, 30.0)
    assert temperature_notes(warm(20.0, 22.9), factor) == [near]
    first = (
        "Temperature: every weight but an offset's changes by 1.56 % a kelvin (95 %: {}), trained "
        "from 10 to 30 degC. On the board temperature_C is the reference until somebody sets it, "
        "in every Block that has it."
    )
    none = "The change by temperature is not to be told from none."
    # 1.5625 % -+ 1.959964 x 0.5 %
    assert temperature_notes(warm(10.0, 30.0), factor, 0.005) == [first.format("0.583 to 2.54")]
    wide = temperature_notes(warm(10.0, 30.0, 25.0), factor, 0.01)
    assert wide == [first.format("-0.397 to 3.52"), none]
    falls = temperature_notes(
        warm(10.0, 30.0), TemperatureFactor(20.0, -0.015625, 10.0, 30.0), 0.005
    )
    assert falls[1:] == []
    assert "(95 %: -2.54 to -0.583)" in falls[0]
    unused = [Of(temperature_C=40.0, sets=(Of(training=[]),))]
    assert temperature_notes(warm(20.0, 22.9) + unused) == [near]
    nothing = TemperatureFactor(20.0, 0.0, 10.0, 30.0)
    assert temperature_notes(warm(10.0, 30.0), nothing, 0.0)[1:] == [none]


X, X3 = Rise("power", 1.0), Rise("power", 3.0)
TERMS = (
    Term("spring", X),
    Term("spring", X, softening=Softening("strain", 2.0)),
    Term("spring", X3),
    Term("spring", X3, softening=Softening("strain", 2.0)),
    Term("spring", X3, softening=Softening("path", 4.0)),
    Term("stop", X, (0.5,)),
)


def test_terms_that_are_not_told_apart_in_words():
    fitted = FittedMember(Member("m", "M", TERMS), 0.25, (1.0,) * 6)
    seen = "the model does not soften by it, the rubber may."
    carry = "not to be told from unsoftened ones, which carry that torque:"
    many = (
        "Softening by strain is not seen: the largest deflection did not grow in what trains. 2 "
        f"softened terms are {carry} {seen} Train from the first cycle (cycles.skip_first = 0), or "
        "with growing amplitudes."
    )
    one = (
        "Softening by path is not seen: hardly any path was travelled in what trains. 1 softened "
        f"term is {carry} {seen} Train over more cycles."
    )
    text = [t.text for t in TERMS]
    alike = (
        "Not told apart by what trains, so that the simpler one in brackets carries the torque: "
        f"{text[5]} ({text[0]}); {text[4]} ({text[3]})."
    )
    lost = (
        "Not determined, other weights of these give the same torque in what trains (standard "
        f"deviation infinite): {text[2]}; {text[0]}."
    )
    assert told_apart_notes(fitted, {1: 0, 3: 2, 4: 2}, {0: 1.0}) == [many, one]
    sigma = {2: math.inf, 1: 0.5, 0: math.inf}
    assert told_apart_notes(fitted, {5: 0, 4: 3}, sigma) == [alike, lost]
    assert told_apart_notes(fitted, {}, {}) == []


def test_bounds_of_play_operators_at_their_ends():
    for key, share in (("kappa_rad", 1e-4), ("phi_1_rad", 1e-4), ("chi_rad", None)):
        low, high = play_bounds(key)
        margin = 1e-9 if share is None else share * (high - low)
        ends = (low, low + 0.99 * margin, low + 1.01 * margin)
        assert [play_at_bound(key, x) for x in ends] == ["lower", "lower", None]
        ends = (high, high - 0.99 * margin, high - 1.01 * margin)
        assert [play_at_bound(key, x) for x in ends] == ["upper", "upper", None]


@pytest.mark.parametrize(("per_K", "end"), [(-0.05, "low"), (0.05, "high")])
def test_a_change_at_an_end_of_its_search_says_nothing_by_its_interval(per_K, end):
    factor = TemperatureFactor(20.0, per_K, 10.0, 30.0)
    _, note = temperature_notes(warm(10.0, 30.0), factor, 9.0)
    assert note.startswith(f"The change a kelvin is at the {end} end of what is searched, beyond")
    assert "between 10 and 30 degC" in note
    assert note.endswith("may lie beyond, and its interval says nothing.")


def test_softening_and_temperature_of_the_published_model_are_told():
    fit, spread = Of(values=VALUES, rate_dropped=False, edges=()), Of(sigma={})
    verdict = judged(0.0, (0.01,), (0.25,))
    files = [file(temperature_C=c, sets=warm(c)[0].sets) for c in (20.0, 23.0)]
    notes = notes_of(source(), files, fit, spread, verdict, None)
    assert [n.split(":")[0] for n in notes] == [
        "Rate terms not identified",
        "Asymmetry",
        "Mullins effect or scragging",
        "Temperature",
    ]
    assert notes[2].endswith("the model has no term for it.")
