"""What pages of specimens, identifications and the thesis say: each number worked out by hand."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace as Of

import pytest

from esea_gen.devices.fields import field_facts
from esea_gen.errors import UserError
from esea_gen.report import identification, specimen, specimen_results
from esea_gen.report.specimen_results import SpecimenResults

from .made_findings import said

TWO_SIDED_95 = 1.959964


def results(**changes):
    made = {
        "asked": "rig.toml --data d",
        "source": None,
        "recordings": (),
        "device": Of(title="A rubber", quantities=lambda: iter(())),
        "identified": {},
        "verdict": None,
        "others": {},
        "files": {},
        "coupling": None,
    }
    return SpecimenResults(**(made | changes))


# -- one specimen ----------------------------------------------------------------------------------


def a_source(period=None, name="A3", serial=71):
    return Of(
        origin="rig.toml",
        mapping=Of(
            deflection=Of(scale_rad_per_m=said(12.5, "identified", "a ruler")),
            torque=Of(scale_Nm_per_N=said(0.25, "assumed", "an arm")),
            sampling=Of(period_s=period),
            specimen=Of(name=name, serial=serial),
        ),
    )


def test_scales_stand_with_their_units_and_sources():
    angle = {"what": "deflection", "unit": "rad/m", "value": 12.5}
    angle |= {"status": "identified", "source": "a ruler"}
    force = {"what": "torque", "unit": "Nm/N", "value": 0.25}
    force |= {"status": "assumed", "source": "an arm"}
    time = {"what": "sampling period", "unit": "s", "value": 0.01}
    time |= {"status": "published", "source": "a table"}
    assert specimen._scales(a_source(said(0.01))) == [angle, force, time]
    assert specimen._scales(a_source()) == [angle, force]


@pytest.mark.parametrize(
    ("model", "named"), [({}, "published"), ({"model": {"member": "springs"}}, "springs")]
)
def test_a_specimen_s_page_is_given_all_that_is_known(monkeypatch, model, named):
    given = []
    monkeypatch.setattr(specimen, "render", lambda *a, **k: given.append((a, k)) or "page")
    monkeypatch.setattr(specimen, "device_hash", lambda device: f"hash of {device.title}")
    others = {"identify-compare": {"c": 1}, "host-life": {"l": 2}}
    found = results(source=a_source(), identified={"full": 3.0, **model}, others=others)
    assert specimen.specimen_page(found, "again") == "page"
    (((head, sections, of), shown),) = given
    assert (head.part, sections, of) == ("specimen/head", specimen.SECTIONS, found)
    assert shown == {
        "title": "Specimen: A rubber",
        "f": {"full": 3.0, **model, "command": "again", "content_hash": "hash of A rubber"},
        "facts": found.source.mapping.specimen,
        "scales": specimen._scales(found.source),
        "model": named,
        "compared": {"c": 1},
        "agreed": None,
        "lives": {"l": 2},
        "names": {
            "identify-compare": "model choice",
            "reliability": "reliability",
            "host-life": "life used",
        },
        "wanted": {"reliability": "esea-gen reliability SPECIMENS.toml --json reliability.json"},
    }


def test_a_specimen_s_sections_stand_in_their_order():
    assert [(s.part, s.title) for s in specimen.SECTIONS] == [
        ("identification/notes", "Notes"),
        ("specimen/loops", "Loops"),
        ("identification/errors", "Errors"),
        ("specimen/parameters", "Parameters"),
        ("specimen/models", "Model choice"),
        ("specimen/worth", "What the torque is worth"),
        ("specimen/reliability", "Reliability"),
        ("specimen/life", "Life used"),
        ("specimen/files", "Files"),
    ]


def test_what_is_not_known_is_named_with_the_command_that_would_tell():
    model, agreement, life = (
        "esea-gen identify rig.toml --data d --compare --json compared.json",
        "esea-gen reliability SPECIMENS.toml --json reliability.json",
        "esea-host life ADDRESS --json life.json",
    )
    identified = {"mean_rms": {"held_out_percent": 3.14159, "training_percent": 2.0}}
    assert results(identified=identified).summary() == [
        "A rubber: held out 3.14 % of full scale",
        f"not known: model choice; {model}",
        f"not known: reliability; {agreement}",
        f"not known: life used; {life}",
    ]
    others = {"identify-compare": {}, "reliability": {}}
    assert results(others=others).wanted() == {"host-life": life}
    assert list(results().wanted()) == ["identify-compare", "reliability", "host-life"]


def test_an_interval_is_of_95_per_cent_and_stays_within_what_is_allowed():
    q = said(2.0, "identified", "a fit; standard deviation 0.5; more")

    def ends(value, sigma, low, high):
        return specimen._interval(value, sigma, low, high, q)["interval"]

    assert ends(2.0, 0.5, 0.0, 9.0) == pytest.approx((2 - TWO_SIDED_95 / 2, 2 + TWO_SIDED_95 / 2))
    assert ends(2.0, 0.5, 1.5, 2.25) == (1.5, 2.25)
    assert ends(2.0, 0.0, -9.0, 9.0) == (2.0, 2.0)
    assert specimen._interval(2.0, None, 0.0, 9.0, q) == {
        "value": 2.0,
        "interval": None,
        "status": "identified",
        "source": "a fit",
    }


def test_parameters_of_the_thesis_model_stand_with_intervals():
    known = (
        ("elastomer.k1_Nm_rad", said(9.0, "identified", "a fit; standard deviation 0.5")),
        ("elastomer.maxwell.A_Nms_rad", said(0.25, "assumed", "a guess")),
    )
    parameters = {
        "k1_Nm_rad": {"value": 9.0, "sigma": 0.5, "low": 8.5, "high": 99.0, "unit": "Nm/rad"},
        "A_Nms_rad": {"value": 0.25, "sigma": None, "low": 0, "high": 1, "unit": "Nm s/rad"},
    }
    device = Of(quantities=lambda: iter(known))
    shown = specimen.SECTIONS[3].shown(
        results(device=device, identified={"parameters": parameters})
    )
    assert shown == {
        "parameters": [
            {
                "name": "k1_Nm_rad",
                "meaning": field_facts("elastomer.k1_Nm_rad")["text"],
                "unit": "Nm/rad",
                "value": 9.0,
                "interval": (8.5, pytest.approx(9 + TWO_SIDED_95 / 2)),
                "status": "identified",
                "source": "a fit",
            },
            {
                "name": "A_Nms_rad",
                "meaning": field_facts("elastomer.maxwell.A_Nms_rad")["text"],
                "unit": "Nm s/rad",
                "value": 0.25,
                "interval": None,
                "status": "assumed",
                "source": "a guess",
            },
        ],
        "warmth": None,
    }
    assert identification.dotted("A_Nms_rad") == "elastomer.maxwell.A_Nms_rad"


def test_parameters_of_another_model_are_its_terms_and_its_temperature():
    known = (
        ("family.terms[0].weight_Nm", said(1.0, "identified", "of term 0")),
        ("family.terms[1].weight_Nm", said(0.25, "assumed", "of term 1")),
        ("family.temperature.per_K", said(-0.04, "identified", "of warmth")),
    )
    terms = [
        {"kind": "offset", "term": "a constant", "weight_Nm": 1.0, "sigma_Nm": 2.0},
        {"kind": "spring", "term": "k x", "weight_Nm": 0.25, "sigma_Nm": 1.0},
    ]
    warmth = {"per_K": -0.04, "sigma_per_K": 0.01}
    device = Of(quantities=lambda: iter(known))
    model = {"terms": terms, "temperature": warmth}
    shown = specimen._parameters(results(device=device, identified={"model": model}))
    # An offset may be negative, a weight not; a change a kelvin is within 5 %.
    assert shown["parameters"] == [
        {
            "name": "offset",
            "meaning": "a constant",
            "unit": "Nm",
            "value": 1.0,
            "interval": pytest.approx((1 - 2 * TWO_SIDED_95, 1 + 2 * TWO_SIDED_95)),
            "status": "identified",
            "source": "of term 0",
        },
        {
            "name": "spring",
            "meaning": "k x",
            "unit": "Nm",
            "value": 0.25,
            "interval": (0.0, pytest.approx(0.25 + TWO_SIDED_95)),
            "status": "assumed",
            "source": "of term 1",
        },
        {
            "name": "per_K",
            "meaning": "change a kelvin of every weight but an offset's, by the rubber's "
            "temperature",
            "unit": "1/K",
            "value": -0.04,
            "interval": (-0.05, pytest.approx(-0.04 + 0.01 * TWO_SIDED_95)),
            "status": "identified",
            "source": "of warmth",
        },
    ]
    assert shown["warmth"] == warmth
    cold = specimen._parameters(results(device=device, identified={"model": {"terms": terms}}))
    assert (len(cold["parameters"]), cold["warmth"]) == (2, None)


def test_models_stand_by_condition():
    rows = [
        {"model": m, "condition": c, "held_out": k}
        for k, (m, c) in enumerate((("b", "last"), ("b", "first"), ("a", "last")))
    ]
    found = results(others={"identify-compare": {"compare": rows}})
    assert specimen.SECTIONS[4].shown(found) == {
        "cells": {("b", "last"): rows[0], ("b", "first"): rows[1], ("a", "last"): rows[2]},
        "models": ["b", "a"],
        "conditions": ["last", "first"],
    }
    assert specimen._models(results()) == {}


def worth(torque, rate, samples=0, held_out=0, band=None):
    return {
        "torque": torque,
        "rate": rate,
        "samples": samples,
        "held_out": held_out,
        "band_Nm": band,
    }


def test_classes_of_torque_and_rate_go_as_far_as_was_measured():
    seen = {(None, None): (9, 0, 0.25), (None, "slow"): (9, 0, 0.5), ("low", None): (2, 0, 0.75)}
    seen |= {("high", None): (0, 3, None)}
    rows = [
        worth(t, r, *seen.get((t, r), ()))
        for t in (None, "low", "none", "high", "above")
        for r in (None, "slow", "fast")
    ]
    content = {"worth": rows, "full_scale_Nm": 8.0, "domain": {"omega_max_rad_s": 20.0}}
    shown = specimen.SECTIONS[5].shown(results(identified=content))
    assert shown["classes"] == {(w["torque"], w["rate"]): w for w in rows}
    # In Nm: 5, 25 and 50 % of 8 Nm; an empty class between stays, one above does not.
    assert shown["torques"] == [
        (None, None),
        ("low", (0.0, pytest.approx(0.4))),
        ("none", (pytest.approx(0.4), 2.0)),
        ("high", (2.0, 4.0)),
    ]
    assert shown["rates"] == [(None, None), ("slow", (0.0, 1.0))]
    assert shown["widest"] == 0.75
    assert set(shown) == {"classes", "torques", "rates", "widest"}
    nothing = {"worth": [worth(None, None)], "full_scale_Nm": 8.0}
    nothing |= {"domain": {"omega_max_rad_s": 20.0}}
    empty = specimen._worth(results(identified=nothing))
    assert (empty["torques"], empty["rates"], empty["widest"]) == ([], [], 0.0)


def test_the_last_class_of_all_has_no_end():
    assert specimen._spans((0.0, 0.5, 1.0, math.inf), 4.0) == [(0, 2), (2, 4), (4, None)]
    assert specimen._till_last(["a", "b", "c"], [False, False, True]) == ["a", "b", "c"]
    assert specimen._till_last(["a", "b"], [False, False]) == []


def test_cycles_of_a_life_are_told_by_their_range():
    one = {"width_rad": 0.125, "halves": [0, 5, 0, 8]}
    shown = specimen.SECTIONS[7].shown
    assert shown(results(coupling=one)) == {
        "one": one,
        "ranges": [(0.125, 0.25, 2.5), (0.375, 0.5, 4.0)],
        "cycles": 6.5,
    }
    assert shown(results()) == {"one": None}


# -- where it comes from ---------------------------------------------------------------------------


def test_results_of_other_recordings_are_refused():
    def check(theirs, ours):
        rows = [{"file": f, "sha256": d} for f, d in theirs.items()]
        known = [Of(file=f, digest=d) for f, d in ours.items()]
        specimen_results._check_recordings(Path("r.json"), {"recordings": rows}, a_source(), known)

    check({"a": "1", "b": "2"}, {"b": "2", "a": "1"})
    apart = "r.json: is of other recordings than rig.toml; apart: "
    for theirs, ours, told in (
        ({"b": "1"}, {"b": "2"}, "b."),
        ({"b": "1", "a": "2"}, {"b": "1"}, "a."),
        ({"b": "1"}, {"b": "1", "c": "2"}, "c."),
        ({"b": "1", "d": "2"}, {"b": "3", "c": "2"}, "b and 2 more."),
    ):
        with pytest.raises(UserError) as refused:
            check(theirs, ours)
        assert refused.value.what == apart + told


def test_a_result_of_another_full_scale_or_device_is_refused():
    def scale(theirs):
        content = {"full_scale_Nm": theirs}
        specimen_results._check_scale(Path("c.json"), content, {"full_scale_Nm": 4.0})

    scale(4.0 * (1 + 1e-10))
    with pytest.raises(UserError) as refused:
        scale(5.0)
    assert refused.value.what == (
        "c.json: its full scale is 5 Nm, the identification's 4 Nm: the mapping file has changed "
        "between them."
    )
    with pytest.raises(UserError):
        scale(4.0 * (1 + 1e-8))

    def device(training, held_out, found=(0.5, 0.25)):
        keys = ("training_Nm", "held_out_Nm")
        asked = []

        def means(full_scale):
            asked.append(full_scale)
            return dict(zip(keys, found, strict=True))

        said = {"mean_rms": dict(zip(keys, (training, held_out), strict=True))}
        verdict = Of(misfits=Of(means=means))
        content = said | {"full_scale_Nm": 4.0}
        specimen_results._check_device(Path("r.json"), content, verdict)
        assert asked == [4.0]

    device(0.5 * (1 + 1e-7), 0.25)
    device(0.5, None, (0.5, None))
    for training, held_out, key, one, other in (
        (0.5 * (1 + 1e-5), 0.25, "training_Nm", "0.500005", "0.5"),
        (0.5, 0.75, "held_out_Nm", "0.75", "0.25"),
        (1.5, 0.75, "training_Nm", "1.5", "0.5"),
        (0.5, None, "held_out_Nm", "none", "0.25"),
    ):
        with pytest.raises(UserError) as refused:
            device(training, held_out)
        assert refused.value.what == (
            f"r.json: says {key} = {one} of these recordings, the device file beside it gives "
            f"{other}."
        )


def test_a_specimen_is_known_by_its_name_and_its_coupling_s_number():
    def agreed(name):
        content = {"specimens": ["A3", "B1"]}
        specimen_results._check_agreed(Path("a.json"), content, a_source(name=name))

    def life(serial, *known):
        content = {"couplings": [{"serial": k} for k in known]}
        specimen_results._check_life(Path("l.json"), content, a_source(serial=serial))

    agreed("B1")
    life(71, 7, 71)
    of, tells = "a.json: is of the specimens A3, B1; rig.toml has ", "l.json: tells of coupling "
    for call, told in (
        (lambda: agreed("C"), f"{of}specimen 'C'."),
        (lambda: agreed(None), f"{of}no [specimen] name."),
        (lambda: life(71), "l.json: tells of no coupling."),
        (lambda: life(71, 7, 8), f"{tells}7, 8; rig.toml has serial = 71."),
        (lambda: life(None, 7), f"{tells}7; rig.toml has no [specimen] serial."),
    ):
        with pytest.raises(UserError) as refused:
            call()
        assert refused.value.what == told


def test_the_device_stands_beside_its_identification(tmp_path, monkeypatch):
    monkeypatch.setattr(specimen_results.esea_gen, "load_device", lambda path: ("device", path))
    path, content = tmp_path / "r.json", {"device": {"name": "up/rig"}}
    with pytest.raises(UserError, match=r"its device file rig\.toml is not beside it"):
        specimen_results._device_of(path, content)
    (tmp_path / "rig.toml").touch()
    found = specimen_results._device_of(path, content)
    assert found == ("device", str(tmp_path / "rig.toml"))


class Given:
    """Results by file, and what was done with them."""

    def __init__(self, monkeypatch, source, **files):
        self.files, self.done = files, []
        for name, stand_in in {
            "load_mapping": lambda path, data: source,
            "read_result": self.read,
            "checked": lambda kind, content, origin, fix: self.done.append(("checked", origin)),
            "load_recordings": lambda s: [Of(file="rig.csv", digest="1")],
            "judge": lambda device, recordings: (f"verdict on {device}", recordings),
            "_device_of": lambda path, content: f"device of {path}",
            "_check_device": lambda path, content, verdict: self.done.append(("device", path)),
            "identify": lambda mapping, data, tell: self.made("published", mapping, data),
            "identify_member": lambda mapping, model, data, tell: self.made(model, mapping, data),
        }.items():
            monkeypatch.setattr(specimen_results, name, stand_in)

    def read(self, path, kinds):
        assert kinds == ("identify", "identify-compare", "reliability", "host-life")
        return self.files[path.stem]

    def made(self, model, mapping, data):
        content = {"model": model, "mapping": str(mapping), "data": str(data), "nan": math.nan}
        content["full_scale_Nm"] = 4.0
        return Of(to_dict=lambda: content, device=f"{model} device", verdict=f"{model} verdict")

    def gather(self, *names, data=None):
        told = []
        paths = [Path(f"{n}.json") for n in names]
        found = specimen_results.gather_specimen(
            Path("a rig.toml"), paths, data, lambda share, what: told.append((share, what))
        )
        return found, told


@pytest.fixture
def given(monkeypatch):
    recorded = {"recordings": [{"file": "rig.csv", "sha256": "1"}], "full_scale_Nm": 4.0}
    couplings = [{"serial": 7}, {"serial": 71, "first": True}, {"serial": 71}]
    return Given(
        monkeypatch,
        a_source(),
        one={"schema": "identify", **recorded},
        two={"schema": "identify", **recorded},
        chosen={"schema": "identify-compare", "chosen": "springs", **recorded},
        thesis={"schema": "identify-compare", "chosen": "published", **recorded},
        coarse={"schema": "identify-compare", **recorded, "full_scale_Nm": 5.0},
        alien={"schema": "identify-compare", "recordings": [], "full_scale_Nm": 4.0},
        agreed={"schema": "reliability", "specimens": ["A3"]},
        apart={"schema": "reliability", "specimens": ["B1"]},
        life={"schema": "host-life", "couplings": couplings},
        dead={"schema": "host-life", "couplings": []},
    )


def test_a_specimen_s_results_are_gathered_by_kind(given):
    found, told = given.gather("life", "one", "agreed", "chosen", data=Path("my data"))
    assert found.asked == "'a rig.toml' --data 'my data'"
    assert (found.identified, found.device) == (given.files["one"], "device of one.json")
    assert found.recordings == (Of(file="rig.csv", digest="1"),)
    assert found.verdict == ("verdict on device of one.json", found.recordings)
    names = (("host-life", "life"), ("reliability", "agreed"), ("identify-compare", "chosen"))
    assert found.others == {k: given.files[n] for k, n in names}
    assert found.files == {k: f"{n}.json" for k, n in (*names, ("identify", "one"))}
    assert found.coupling == {"serial": 71, "first": True}
    assert told == [(0.5, "the device's C over the recordings")]
    assert given.done == [
        *(("checked", f"{n}.json") for n in ("life", "one", "agreed", "chosen")),
        ("device", Path("one.json")),
    ]


@pytest.mark.parametrize(
    ("result", "model"), [((), "published"), (("thesis",), "published"), (("chosen",), "springs")]
)
def test_what_was_not_identified_is_identified_by_the_chosen_model(given, result, model):
    found, told = given.gather(*result)
    assert (found.device, found.verdict) == (f"{model} device", f"{model} verdict")
    assert found.identified == {
        "model": model,
        "mapping": "a rig.toml",
        "data": "None",
        "nan": None,
        "full_scale_Nm": 4.0,
    }
    assert (found.asked, found.coupling, told) == ("'a rig.toml'", None, [])


@pytest.mark.parametrize(
    ("files", "says"),
    [
        (("one", "two"), r"two.json: one.json is a result of 'identify' too"),
        (("one", "alien"), "alien.json: is of other recordings"),
        (("coarse", "one"), "coarse.json: its full scale is 5 Nm"),
        (("apart",), "apart.json: is of the specimens B1"),
        (("dead",), "dead.json: tells of no coupling"),
    ],
)
def test_what_does_not_go_together_is_refused(given, files, says):
    with pytest.raises(UserError, match=says):
        given.gather(*files)
