"""The course of a comparison, each fit put in by hand: what is fitted to what, what is chosen."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.identify import compare as comparing
from esea_gen.identify.compare import CompareRow, choose, compare
from esea_gen.identify.conditions import Split
from esea_gen.identify.search_problem import Searching
from esea_gen.model.family import FittedMember, Member, Term

from .test_identify_course import FILES, asked, device, judged, misfits

QUICK = Member("quick", "Quick", (Term("spring"),))
SLOW = Member("slow", "Slow", (Term("maxwell", numbers=(1.0,)),))
# Errors in training and held out by model and condition, Nm; full scale is 4 Nm.
ERRORS = {
    ("published", "a"): (0.04, 0.40),
    ("published", "b"): (0.05, 0.50),
    ("quick", "a"): (0.06, 0.41),
    ("quick", "b"): (0.07, 0.52),
    ("slow", "a"): (0.01, 0.12),
    ("slow", "b"): (0.02, 0.11),
}


def compared(monkeypatch, timed=True, cost=None, **more):
    """What :func:`compare` does with fits that are put in; calls of each."""
    splits = tuple(
        Split(c, (replace(f, label=c),), c == "b", True) for c, f in zip("ab", FILES, strict=False)
    )
    files, calls = [replace(f, timed=timed) for f in FILES], []

    def fit_split(source, recordings, template, tell, how):
        tell(0.5, "nobody hears")
        (r,) = recordings
        calls.append(("published", r.label, template, how))
        verdict = judged(*ERRORS["published", r.label])
        return None, None, device(f"published {r.label}", 90), verdict

    def fit_member(terms, recordings, full_scale_Nm):
        assert (terms[1], terms[2], full_scale_Nm) == (files, 100.0, 4.0)
        (r,) = recordings
        calls.append((terms[0].name, r.label))
        return FittedMember(terms[0], 0.1, (1.0,))

    def drafted(source, recordings, fitted):
        (r,) = recordings
        return device(f"{fitted.member.name} {r.label}", 40 if fitted.member is QUICK else 300)

    def fit_peer(name, recordings, seed):
        calls.append((name, recordings[0].label, seed))
        return [r.tau_Nm + np.array([0.3, -0.1, 0.2]) for r in recordings]

    put = {
        "load_mapping": lambda path, folder: asked(rate_terms="asked for"),
        "load_recordings": lambda source: files,
        "splits_of": lambda recordings: splits,
        "members": lambda: (QUICK, SLOW),
        "PEERS": {"peer": None},
        "draft": lambda source, recordings, rate_terms: SimpleNamespace(
            tau_full_scale_Nm=4.0, of=(len(recordings), rate_terms)
        ),
        "fit_split": fit_split,
        "UnitTerms": lambda member, recordings, rate: (member, recordings, rate),
        "grid_rate": lambda source: 100.0,
        "fit_member": fit_member,
        "drafted_member": drafted,
        "misfits_of": lambda terms, recordings, fitted: misfits(
            *ERRORS[fitted.member.name, recordings[0].label]
        ),
        "fit_peer": fit_peer,
        "excused_of": lambda of: of.name,
        "gate_notes": lambda recordings, excused: (f"gate, {excused}",),
        "temperature_notes": lambda recordings: ["warm"],
    }
    for name, what in put.items():
        monkeypatch.setattr(comparing, name, what)
    return compare("map.toml", "data", cost, **more), calls


def test_every_model_is_fitted_to_every_split_the_files_own_division_first(monkeypatch):
    told, how = [], Searching("thesis")
    found, calls = compared(
        monkeypatch, progress=lambda share, text: told.append((share, text)), how=how
    )
    (first, second), rest = calls[:2], calls[2:]
    assert (first[1], second[1], first[3], second[3]) == ("b", "a", how, how)
    assert first[2].of == (1, "asked for")
    assert rest == [(m, c) for m in ("quick", "slow") for c in "ba"] + [
        ("peer", "b", 7),
        ("peer", "a", 7),
    ]
    # In % of full scale, 4 Nm; of the peer, by its own errors: sqrt((0.3^2 + 0.1^2) / 2) and 0.2.
    expected = [
        CompareRow(m, c, *(pytest.approx(25 * e) for e in ERRORS[m, c]), None)
        for m in ("published", "quick", "slow")
        for c in "ba"
    ]
    expected += [
        CompareRow("peer", c, pytest.approx(25 * math.sqrt(0.05)), pytest.approx(5.0), None)
        for c in "ba"
    ]
    assert list(found.rows) == expected
    assert told == [
        (pytest.approx((i + 1) / 8), f"{r.model}, {r.condition}") for i, r in enumerate(found.rows)
    ]
    # Of each model the device of the file's own division; no board runs the peer.
    assert {k: d.name for k, d in found.devices.items()} == {
        m: f"{m} b" for m in ("published", "quick", "slow")
    }
    assert (found.chosen, found.best, found.standard_error) == ("slow", "slow", 0.0)
    assert found.full_scale_Nm == 4.0
    assert found.notes == (
        "gate, slow b",
        "2 members of the family were tried with fixed outer numbers; the best of several carries "
        "selection.",
        "warm",
    )
    content = found.to_dict()
    assert content["compare"][0] == {
        "model": "published",
        "condition": "b",
        "training": pytest.approx(1.25),
        "held_out": pytest.approx(12.5),
        "instructions": None,
    }
    assert len(content["compare"]) == 8
    assert [r["label"] for r in content["recordings"]] == ["a", "b", "c"]
    assert {k: content[k] for k in ("mapping", "full_scale_Nm", "chosen", "best", "terms")} == {
        "mapping": "map.toml",
        "full_scale_Nm": 4.0,
        "chosen": "slow",
        "best": "slow",
        "terms": [],
    }
    assert content["notes"] == list(found.notes)
    assert content["standard_error"] == 0.0
    assert found.table()[-4] == (
        "* chosen: the best; no cheaper one is as good within one standard error"
    )


def test_without_time_no_member_that_needs_it_is_tried_and_the_cost_counts(monkeypatch):
    asked_for = []

    def cost(of):
        asked_for.append(of.name)
        return {"published b": 900.0, "quick b": 100.0}[of.name]

    found, calls = compared(monkeypatch, timed=False, cost=cost, peers=False)
    assert {c[0] for c in calls} == {"published", "quick"}
    assert asked_for == ["published b", "quick b"]
    assert {(r.model, r.instructions) for r in found.rows} == {
        ("published", 900.0),
        ("quick", 100.0),
    }
    # 0.25 and 0.5 % more than the published one: mean 0.375, standard error 0.125.
    assert (found.chosen, found.best) == ("published", "published")
    assert found.notes[2] == ("Time was not recorded: members with Maxwell branches are left out.")
    assert found.notes[1].startswith("1 members")


def test_a_choice_by_hand():
    def rows(**errors):
        return [
            CompareRow(m, str(i), 0.0, e, None)
            for m, es in errors.items()
            for i, e in enumerate(es)
        ]

    # Excess 0 and 2: mean 1, standard error sqrt(2)/sqrt(2) = 1: just as good.
    two = rows(best=[1.0, 1.0], cheap=[1.0, 3.0])
    assert choose(two, {"0", "1"}, {"best": 2.0, "cheap": 1.0}) == ("cheap", "best", 1.0)
    more = rows(best=[1.0, 1.0], cheap=[1.001, 3.0])
    assert choose(more, {"0", "1"}, {"best": 2.0, "cheap": 1.0})[0] == "best"
    # Of equal cost the better one.
    assert choose(two, {"0", "1"}, {"best": 1.0, "cheap": 1.0}) == ("best", "best", 0.0)
    # Only whole conditions count, where there is one; of one alone nothing is as good but the best.
    assert choose(two, {"0"}, {"best": 2.0, "cheap": 1.0}) == ("cheap", "best", 0.0)
    assert choose(two, {"1"}, {"best": 2.0, "cheap": 1.0}) == ("best", "best", 0.0)
    assert choose(two, set(), {"best": 2.0, "cheap": 1.0}) == ("cheap", "best", 1.0)


def test_one_condition_only_is_told(monkeypatch):
    monkeypatch.setattr(
        Split, "whole", property(lambda s: False, lambda s, value: None), raising=False
    )
    found, _ = compared(monkeypatch)
    assert found.notes[-2] == (
        "There is one condition only: nothing could be left out as a whole. Give conditions."
    )
