"""The tests are themselves tested: mutants of the emitted C must be caught."""

from __future__ import annotations

import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.emit.walker import Kernel, Node
from esea_gen.errors import UserError
from esea_gen.verify.mutation import bench
from esea_gen.verify.mutation.campaign import REQUIRED_SCORE, run_mutation
from esea_gen.verify.mutation.edits import Edit
from esea_gen.verify.mutation.equivalent import Prover
from esea_gen.verify.mutation.mutants import mutants

pytestmark = pytest.mark.ci


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_a_sample_of_mutants_is_caught(elbow, real):
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
    report = run_mutation(elbow, real)
    assert report.tried > 1000
    assert report.raw_score >= REQUIRED_SCORE  # equivalent mutants counted as missed
    assert report.score >= 0.99, [str(m) for m in report.survivors]
    assert report.contradicted == []


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_the_mutants_are_what_they_say(elbow, real):
    renderer = Renderer(elbow.system, FORMATS[real], "-", "-", elbow.title)
    files = renderer.files()
    found = mutants(elbow, real)
    texts = [m.text(renderer) for m in found]
    assert all(text != files[m.file] for m, text in zip(found, texts, strict=True))
    for m, text in zip(found, texts, strict=True):
        assert text.count("\nvoid ") == files[m.file].count("\nvoid "), str(m)
    kinds = {m.kind for m in found}
    assert {
        *("+ to -", "* to /", "<= to <", "&& to ||", "fmin to fmax", "operands swapped"),
        *("fmax dropped", "select arms swapped", "constant off by 1 ulp", "result negated"),
        *("sign of a constant", "read from the wrong field", "written to the wrong field"),
        *("assignment dropped", "counter wraps", "! dropped", "fabs dropped", "wires swapped"),
        *("wire cut", "order of Blocks", "tunable not checked", "status flag dropped"),
    } <= kinds
    assert len(kinds) >= 40
    blocks = {f"esea_elbow_{b.name}.c" for b in elbow.system.kinds}
    assert {m.file for m in found} == blocks | {"esea_elbow.c"}


# -- proofs ----------------------------------------------------------------------------------------

X = [Node("input", source=(0, k)) for k in range(2)]


def proof(nodes, result, edit, fmt="f32"):
    return Prover(Kernel("k", tuple(nodes), ((result,),)), FORMATS[fmt])(edit)


def test_a_sign_without_a_reader_is_proven_and_another_is_not():
    nodes = [*X, Node("sub", (0, 1)), Node("fabs", (2,)), Node("mul", (3, 0))]
    negated = Edit("", 2, Node("neg", (~0,)), (nodes[2],))
    assert "only the magnitude is used" in proof(nodes, 4, negated)
    nodes[3] = Node("twice", (2,))
    assert proof(nodes, 4, negated) == ""


def test_an_arm_that_is_masked_is_proven():
    # b ? (a || b ? x : 0) : 0 looks at the inner one only under b.
    a, b = Node("lt", (0, 1)), Node("le", (1, 0))
    inner = [*X, a, b, Node("or", (2, 3)), Node("if_else_zero", (4, 0))]
    masked = [*inner, Node("if_else_zero", (3, 5))]
    always = Edit("select always first", 5, 0)
    assert "no result looks" in proof(masked, 6, always)
    assert proof([*inner, Node("if_else_zero", (2, 5)), Node("add", (6, 5))], 7, always) == ""


def test_an_exponent_is_not_rounded_to_the_format():
    """Taken as a float, 2^-27 more was once proven to be the same exponent."""
    nodes = [X[0], Node("const", value=0.77), Node("pow", (0, 1))]
    exponent = Node("const", value=0.77 + 2.0**-27)
    assert proof(nodes, 2, Edit("", 2, Node("pow", (0, ~0)), (exponent,))) == ""


def test_with_blunt_streams_mutants_survive(elbow, monkeypatch):
    """The score measures the streams: with one quiet stream it falls."""
    real_streams = bench.streams
    monkeypatch.setattr(bench, "streams", lambda block: real_streams(block)[:1])
    monkeypatch.setattr(bench, "at_the_limits", lambda block, _: real_streams(block)[0])
    monkeypatch.setattr(bench, "other_memories", lambda block, _: [])
    report = run_mutation(elbow, "f64", sample=60, seed=1)
    assert report.score < REQUIRED_SCORE
    assert report.survivors


def test_unknown_format(elbow):
    with pytest.raises(UserError, match="f16"):
        run_mutation(elbow, "f16")
