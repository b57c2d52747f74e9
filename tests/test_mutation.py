"""The tests are themselves tested: mutants of the emitted C must be caught."""

from __future__ import annotations

import pytest

from esea_gen.emit.build import render_device
from esea_gen.errors import UserError
from esea_gen.verify import mutation
from esea_gen.verify.mutation import REQUIRED_SCORE, mutants, run_mutation

from .conftest import require_tool


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_a_sample_of_mutants_is_caught(elbow, real):
    require_tool("gcc")
    said = []
    report = run_mutation(elbow, real, sample=40, seed=1, progress=said.append)
    assert report.tried + report.rejected == 40
    assert report.rejected == 0
    assert report.score >= REQUIRED_SCORE, [str(m) for m in report.survivors]
    assert report.killed + len(report.survivors) + len(report.equivalent) == report.tried
    assert said
    assert report.contradicted == []
    found = report.to_dict()
    assert found["killed"] == report.killed
    assert len(found["survivors"]) == len(report.survivors)


@pytest.mark.slow
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_all_mutants(elbow, real):
    require_tool("gcc")
    report = run_mutation(elbow, real)
    assert report.tried > 1000
    assert report.raw_score >= REQUIRED_SCORE  # equivalent mutants counted as missed
    assert report.score >= 0.99, [str(m) for m in report.survivors]
    assert report.contradicted == []


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_the_mutants_are_what_they_say(elbow, real):
    files = render_device(elbow, [real])[0].files
    found = mutants(elbow, real, files)
    assert len({(m.file, m.apply(files[m.file])) for m in found}) == len(found)
    assert all(m.apply(files[m.file]) != files[m.file] for m in found)
    kinds = {m.kind for m in found}
    assert {
        *("+ to -", "* to /", "<= to <", "&& to ||", "esea_fmin to esea_fmax"),
        *("esea_fmax dropped", "select arms swapped", "constant off by 1 ulp", "result negated"),
        *("sign of a constant", "read from the wrong field", "written to the wrong field"),
        *("assignment dropped", "counter wraps", "! dropped", "esea_fabs dropped"),
    } <= kinds
    blocks = {f"esea_elbow_{b.name}.c" for b in elbow.system.kinds}
    assert {m.file for m in found} == blocks | {"esea_elbow.c"}
    with pytest.raises(ValueError, match="is not"):
        found[0].apply("\n" * 500)


def test_with_blunt_streams_mutants_survive(elbow, monkeypatch):
    """The score measures the streams: with one quiet stream it falls."""
    require_tool("gcc")
    real_streams = mutation.streams
    monkeypatch.setattr(mutation, "streams", lambda block: real_streams(block)[:1])
    monkeypatch.setattr(mutation, "at_the_limits", lambda block, _: real_streams(block)[0])
    report = run_mutation(elbow, "f64", sample=40, seed=1)
    assert report.score < REQUIRED_SCORE
    assert report.survivors


def test_unknown_format(elbow):
    with pytest.raises(UserError, match="f16"):
        run_mutation(elbow, "f16")
