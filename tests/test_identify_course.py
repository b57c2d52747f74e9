"""The course of an identification, each fit put in by hand: what follows what, what is told."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify import family_identification as of_family
from esea_gen.identify import identification as of_published
from esea_gen.identify.family_identification import FamilyIdentification, identify_member
from esea_gen.identify.fit import Fit
from esea_gen.identify.identification import Identification, fit_split, identify
from esea_gen.identify.identified import Identified
from esea_gen.identify.misfit import Misfit, Misfits
from esea_gen.identify.uncertainty import Uncertainty
from esea_gen.identify.verdict import Verdict
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.temperature import TemperatureFactor

from .test_family_weights import recorded


def misfits(trained: float, held_out: float) -> Misfits:
    (data,) = recorded([0.0], [0.0]).sets
    return Misfits("Nm", ((data, Misfit(trained, 1.0), Misfit(held_out, 1.0)),))


def judged(trained: float, held_out: float, largest_rate_Nm: float = 0.0) -> Verdict:
    return Verdict(misfits(trained, held_out), {}, {}, largest_rate_Nm)


def asked(**more) -> SimpleNamespace:
    """A mapping file, as far as it is asked."""
    table = {"rate_terms": True, "title": "Rig", "sense_rate_Hz": SimpleNamespace(value=1000.0)}
    return SimpleNamespace(
        origin="map.toml",
        mapping=SimpleNamespace(
            device=SimpleNamespace(**{**table, **more}),
            search=SimpleNamespace(seed=7, population=32),
            sampling=SimpleNamespace(fit_rate_Hz=None),
            deflection=SimpleNamespace(dead_zone_rad=None),
            full_scale_Nm=None,
        ),
    )


def device(name: str, operations: int = 50, family=None) -> SimpleNamespace:
    step = SimpleNamespace(n_instructions=lambda: operations)
    return SimpleNamespace(
        name=name,
        sensor=SimpleNamespace(step=step),
        file=SimpleNamespace(family=family),
        tau_full_scale_Nm=4.0,
    )


FILES = [recorded([0.1, 0.2, 0.3], [1.0, 2.0, 3.0], slice(2), slice(2, 3), n) for n in "abc"]


# One model.


def published(monkeypatch, rate_terms, errors, dropped=False, band="band"):
    """What :func:`identify` does with fits that are put in: bare and with rate terms."""
    calls, told = [], []
    source = asked(rate_terms=rate_terms)
    mended = asked(rate_terms=rate_terms)

    def settled(given, model):
        assert given is source
        calls.append(("settled", model(source, FILES)))
        return mended, FILES, (SimpleNamespace(note="lag"),)

    def fit_split(given, recordings, template, tell, how):
        assert (given, recordings, how) == (mended, FILES, "how")
        tell(0.0, f"{template.rate} from")
        tell(1.0, f"{template.rate} to")
        fit = Fit({"k": 1.0}, 0.0, 1, 1, 1.0, rate_dropped=dropped and template.rate)
        plant = SimpleNamespace(judged=f"rows {template.rate}")
        return fit, plant, device(f"rate {template.rate}"), errors[template.rate]

    def noted(name, *own):
        calls.append((name, *own))
        return (name,)

    spread = Uncertainty({}, {}, 1.0, band)
    put = {
        "load_mapping": lambda path, folder: source,
        "settled": settled,
        "draft": lambda given, recordings, rate: SimpleNamespace(rate=rate),
        "_searched": lambda given, template, recordings: (f"space {template.rate}", 50.0),
        "PublishedChannels": lambda *given: given,
        "fit_split": fit_split,
        "uncertainty": lambda plant, values: calls.append((plant.judged, values)) or spread,
        "sourced_device": lambda s, r, d, fit, spread: device(f"sourced {d.name}"),
        "gated": lambda d, recordings: device(f"gated {d.name}"),
        "excused_of": lambda d: d.name,
        "gate_notes": lambda recordings, excused: (f"gate, {excused}",),
        "notes_of": lambda s, r, fit, spread, verdict, pair: noted("notes", verdict, pair),
        "band_notes": lambda r, verdict, band, full: noted("band", verdict, band, full),
        "worth_of": lambda d, r, verdict, band, rows: (d.name, verdict, band, rows),
    }
    for name, what in put.items():
        monkeypatch.setattr(of_published, name, what)
    found = identify("map.toml", "data", lambda share, text: told.append((share, text)), "how")
    return found, {c[0]: c[1:] for c in calls}, told


BARE, RATED = judged(0.1, 0.5), judged(0.05, 0.4)


def test_without_rate_terms_one_fit_is_all(monkeypatch):
    found, calls, told = published(monkeypatch, False, {False: BARE})
    assert calls["settled"] == ((SimpleNamespace(rate=False), "space False", 50.0, 7, 32, "how"),)
    assert [share for share, _ in told] == [0.0, 0.0, 1.0, 0.95, 1.0]
    assert [text for _, text in told] == [
        "reading",
        "False from",
        "False to",
        "uncertainty",
        "done",
    ]
    assert found.device.name == "gated sourced rate False"
    assert (found.verdict, found.without_rate, found.with_rate) == (BARE, None, None)
    assert found.notes == ("gate, gated sourced rate False", "lag", "notes", "band")
    assert calls["notes"] == (BARE, None)
    assert calls["band"] == (BARE, "band", 4.0)
    assert found.worth == (found.device.name, BARE, "band", "rows False")
    assert found.recordings == tuple(FILES)
    assert 0 <= found.seconds < 60
    none, calls, _ = published(monkeypatch, False, {False: BARE}, band=None)
    assert "band" not in calls
    assert none.notes[-1] == "notes"


@pytest.mark.parametrize(
    ("held_out", "dropped", "rated"),
    [(0.4, False, True), (0.5, False, False), (0.6, False, False), (0.6, True, True)],
)
def test_rate_terms_are_kept_where_they_help_on_held_out_data(
    monkeypatch, held_out, dropped, rated
):
    """Less error, not as much; a fit that dropped them is the simpler one already."""
    with_it = judged(0.05, held_out)
    found, calls, told = published(monkeypatch, True, {False: BARE, True: with_it}, dropped)
    shares = [0.0, 0.0, 0.1, 0.1, 0.95, 0.95, 1.0]
    assert [share for share, _ in told] == pytest.approx(shares)
    assert calls["settled"][0][0].rate
    assert found.device.name == f"gated sourced rate {rated}"
    assert f"rows {rated}" in calls
    assert found.verdict is (with_it if rated else BARE)
    assert found.without_rate is (BARE if rated else None)
    assert found.with_rate is (None if rated else with_it)
    # The notes hear of both, without rate terms first.
    assert calls["notes"] == (found.verdict, (BARE, with_it))


def test_an_identification_as_json(monkeypatch):
    monkeypatch.setattr(Identified, "to_dict", lambda self: {"own": 1, "parameters": 0})
    monkeypatch.setattr(Identified, "errors", lambda self, verdict: ("errors of", verdict))
    values = {"k1_Nm_rad": 0.0, "alpha_Nm_rad": 3.0, "kv_Nm_rad": 2.0, "eps2": 0.013}
    sigma = {"k1_Nm_rad": None, "alpha_Nm_rad": math.inf, "kv_Nm_rad": 0.25, "eps2": None}
    left_out = SimpleNamespace(to_dict=lambda: {"band_Nm": 0.5})
    found = Identification(
        device=None,
        source=asked(),
        recordings=(),
        verdict=RATED,
        notes=(),
        seconds=0.0,
        fit=Fit(values, 0.1, 64, 500, 1.25, method="thesis"),
        spread=Uncertainty(sigma, {"direction": {}}, 1.5, left_out),
        without_rate=BARE,
    )
    content = found.to_dict()
    assert content["own"] == 1
    none = {"unit": "Nm/rad", "fixed": False, "at_bound": None, "sigma": None}
    rows = content["parameters"].items()
    told = {k: {n: row[n] for n in none} | {"value": row["value"]} for k, row in rows}
    assert told == {
        "k1_Nm_rad": none | {"value": 0.0, "at_bound": "lower"},
        "alpha_Nm_rad": none | {"value": 3.0},
        "kv_Nm_rad": none | {"value": 2.0, "sigma": 0.25},
        "eps2": none | {"value": 0.013, "unit": "1", "fixed": True},
    }
    assert content["uncertainty"] == {
        "band_Nm": 0.5,
        "correlation_factor": 1.5,
        "weakest": {"direction": {}},
    }
    assert content["search"] == {
        "fitness": "mean over data sets of the mean square error",
        "method": "thesis",
        "seed": 7,
        "population": 64,
        "evaluations": 500,
        "runner_up": 1.25,
    }
    assert content["without_rate_terms"] == ("errors of", BARE)
    assert content["with_rate_terms"] is None
    other = replace(
        found,
        fit=replace(found.fit, runner_up=math.inf),
        spread=Uncertainty(sigma, {}, 1.0),
        without_rate=None,
        with_rate=RATED,
    ).to_dict()
    assert other["search"]["runner_up"] is None
    assert other["uncertainty"] == {"correlation_factor": 1.0, "weakest": {}}
    assert (other["without_rate_terms"], other["with_rate_terms"]) == (None, ("errors of", RATED))


@pytest.mark.parametrize(
    ("rated", "dropped", "asked_Hz", "fine_Hz", "rate_Hz"),
    [
        (False, False, None, 1000.0, None),
        (True, False, None, 1000.0, 100.0),
        (True, False, 300.0, 1000.0, 1000 / 3),  # a whole part of the device's own
        (True, False, None, 80.0, 80.0),
        (True, True, None, 1000.0, None),
    ],
)
def test_what_is_searched_and_what_the_device_is_judged_with(
    monkeypatch, rated, dropped, asked_Hz, fine_Hz, rate_Hz
):
    source, built = asked(sense_rate_Hz=SimpleNamespace(value=fine_Hz)), []
    source.mapping.sampling.fit_rate_Hz = asked_Hz
    domain = SimpleNamespace(
        theta_max_rad=SimpleNamespace(value=0.2), omega_max_rad_s=SimpleNamespace(value=3.0)
    )
    template = SimpleNamespace(
        elastomer=SimpleNamespace(maxwell=1 if rated else None), file=SimpleNamespace(domain=domain)
    )
    verdict, searched = judged(0.1, 0.2, 2.5), []

    def search(*given):
        searched.append(given)
        return Fit({}, 0.0, 1, 1, 1.0, rate_dropped=dropped)

    def fitted_device(source, recordings, template, fit, largest_rate_Nm):
        built.append((template, largest_rate_Nm))
        return len(built)

    put = {
        "search": search,
        "draft": lambda source, recordings, rate: f"draft {rate}",
        "fitted_device": fitted_device,
        "FittedPlant": lambda *given: given,
        "judge": lambda device, recordings: verdict if device == 1 else None,
    }
    for name, what in put.items():
        monkeypatch.setattr(of_published, name, what)
    fit, plant, device, found = fit_split(source, FILES, template, "tell", "how")
    (given,) = searched
    assert given[:2] == (template, FILES)
    assert given[3] == pytest.approx(100.0 if dropped else rate_Hz)
    assert given[4:] == ("tell", 7, 32, "how")
    space = given[2]
    assert (space.rate_terms, space.theta_rad, space.omega_rad_s) == (rated, 0.2, 3.0)
    assert space.duration_s == pytest.approx(0.02)  # three samples, 10 ms apart
    used = "draft False" if dropped else template
    # First without a torque of the Maxwell element, then with what it gave.
    assert built == [(used, 0.0), (used, 2.5)]
    assert (device, found) == (2, verdict)
    assert plant == (used, FILES, pytest.approx(rate_Hz))
    assert fit.rate_dropped == dropped


# A member of the family.

WORN = Member(
    "worn",
    "Worn springs",
    (Term("spring"), Term("spring", softening=Softening("strain", 0.3)), Term("offset")),
)
BRANCH = Member("slow", "Slow", (Term("spring"), Term("maxwell", Rise("power", 3), (1.0,))))


def of_member(monkeypatch, member, fitted, dead_zone=None, timed=True):
    calls, told, source = {}, [], asked()
    source.mapping.deflection.dead_zone_rad = dead_zone
    files = [replace(f, timed=timed) for f in FILES]
    sigma = {0: 0.25, 1: math.inf}
    spread = SimpleNamespace(sigma=np.array([0.25, np.inf, 0.125]), to_dict=lambda: {"band_Nm": 1})

    def settled(given, model):
        calls["settled"] = model(source, files)
        return source, files, (SimpleNamespace(note="lag"),)

    def drafted(source, recordings, fitted, sigma, per_K):
        calls["drafted"] = sigma, per_K
        return device("drafted")

    put = {
        "members": lambda: (WORN, BRANCH),
        "load_mapping": lambda path, folder: source,
        "settled": settled,
        "draft": lambda source, recordings, rate: SimpleNamespace(tau_full_scale_Nm=4.0),
        "grid_rate": lambda source: 100.0,
        "UnitTerms": lambda *given: given,
        "MemberChannels": lambda *given: given,
        "fit_member": lambda terms, recordings, full: calls.update(fit=(terms, full)) or fitted,
        "member_spread": lambda terms, recordings, fitted: (sigma, spread),
        "drafted_member": drafted,
        "gated": lambda d, recordings: device(f"gated {d.name}"),
        "judge": lambda d, recordings: BARE,
        "excused_of": lambda d: d.name,
        "gate_notes": lambda recordings, excused: (f"gate, {excused}",),
        "recording_notes": lambda source, recordings: ["recordings"],
        "specimen_notes": lambda verdict, softens: [f"softens {softens}"],
        "not_seen": lambda terms, recordings, fitted: {1: 0},
        "told_apart_notes": lambda fitted, twins, sigma: (f"twins {twins}",),
        "temperature_notes": lambda recordings, factor, per_K: (f"per K {per_K}",),
        "band_notes": lambda recordings, verdict, spread, full: (f"band {full}",),
        "worth_of": lambda d, recordings, verdict, spread: (d.name,),
    }
    for name, what in put.items():
        monkeypatch.setattr(of_family, name, what)
    found = identify_member("m", member.name, "d", lambda share, text: told.append((share, text)))
    return found, calls, told


def test_a_member_is_fitted_judged_and_told_of(monkeypatch):
    fitted = FittedMember(WORN, 0.1, (1.0, 2.0, 0.0))
    found, calls, told = of_member(monkeypatch, WORN, fitted)
    assert told == [(0.0, "reading"), (0.2, "weights"), (0.7, "the device's C"), (1.0, "done")]
    assert calls["settled"] == ((WORN, FILES, 100.0), 4.0)
    assert calls["fit"] == ((WORN, FILES, 100.0), 4.0)
    assert calls["drafted"] == ({0: 0.25, 1: math.inf}, None)
    assert found.sigma_per_K is None
    assert found.device.name == "gated drafted"
    assert found.worth == ("gated drafted",)
    assert found.notes == (
        "gate, gated drafted",
        "lag",
        "Model: Worn springs; 2 of its 3 terms carry torque. Its outer numbers were fixed "
        "beforehand.",
        "recordings",
        "softens True",
        'The model softens and does not recover while it runs. start = "virgin" in the device '
        "file is the specimen at the recording's start; a coupling that has been worked wants "
        'start = "conditioned".',
        "twins {1: 0}",
        "per K None",
        "band 4.0",
    )
    assert 0 <= found.seconds < 60


def test_a_member_that_needs_time_and_knows_its_temperature(monkeypatch):
    factor = TemperatureFactor(20.0, -0.01, 10.0, 30.0)
    fitted = FittedMember(BRANCH, 0.1, (1.0, 2.0), factor)
    found, calls, _ = of_member(monkeypatch, BRANCH, fitted, timed=False)
    assert calls["drafted"][1] == found.sigma_per_K == 0.125
    assert "softens False" in found.notes
    assert "per K 0.125" in found.notes
    assert found.notes[5] == (
        "The relaxation times count an assumed sampling period: with another one they are others."
    )
    monkeypatch.setattr(Identified, "to_dict", lambda self: {"own": 1})
    section = SimpleNamespace(member="slow", title="Slow", start="virgin")
    limits = SimpleNamespace(theta_rad=SimpleNamespace(value=0.3))
    shown = replace(
        found, device=SimpleNamespace(file=SimpleNamespace(family=section, limits=limits))
    )
    content = shown.to_dict()
    assert content["own"] == 1
    assert content["uncertainty"] == {"band_Nm": 1}
    model = content["model"]
    assert [(t["weight_Nm"], t["sigma_Nm"]) for t in model["terms"]] == [(1.0, 0.25), (2.0, None)]
    assert (model["member"], model["title"], model["start"]) == ("slow", "Slow", "virgin")
    assert model["scale_rad"] == 0.1
    # The spring's slope where the factor is least, at 30 degC: 1 Nm over 0.1 rad, less 10 %.
    assert model["least_slope_Nm_rad"] == pytest.approx(9.0)
    assert model["temperature"] == {
        "reference_C": 20.0,
        "per_K": -0.01,
        "low_C": 10.0,
        "high_C": 30.0,
        "sigma_per_K": 0.125,
    }


def test_a_member_that_is_unknown_or_has_no_dead_zone_is_refused(monkeypatch):
    fitted = FittedMember(WORN, 0.1, (1.0, 2.0, 0.0))
    with pytest.raises(UserError, match="There is no model 'Worm'") as caught:
        of_member(monkeypatch, Member("Worm", "", ()), fitted)
    assert "Known: published, 'worn', 'slow'." in caught.value.fix
    with pytest.raises(UserError, match=r"map\.toml: deflection\.dead_zone_rad: the model 'worn'"):
        of_member(monkeypatch, WORN, fitted, dead_zone=1)
    assert isinstance(of_member(monkeypatch, WORN, fitted)[0], FamilyIdentification)
