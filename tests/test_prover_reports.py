"""What is made of a prover's words: z3, Frama-C and Gappa are made up."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.verify import certificates, chain, limits_proof, proof, smt
from esea_gen.verify.chain import ChainError, ChainReport
from esea_gen.verify.limits_proof import LimitsVerdict, prove_limits, show_possible
from esea_gen.verify.smt import FLOAT, Answer, Script, ask


def test_terms_of_nothing_and_of_what_is_settled():
    assert (smt.every(), smt.some()) == ("true", "false")
    assert (smt.every("a"), smt.some("a")) == ("a", "a")
    assert (smt.every("a", "true", "b"), smt.some("a", "false", "b")) == ("(and a b)", "(or a b)")
    assert (smt.every("a", "false", "b"), smt.some("a", "true")) == ("false", "true")
    assert [smt.negated(t) for t in ("true", "false", "a")] == ["false", "true", "(not a)"]
    assert smt.implied("a", "b") == "(=> a b)"
    assert [smt.whole(v, 8) for v in (5, -1, 256, -128)] == [
        *("(_ bv5 8)", "(_ bv255 8)", "(_ bv0 8)", "(_ bv128 8)"),
    ]
    assert smt.word(12) == "(_ BitVec 12)"


def test_what_comes_twice_is_defined_once():
    script = Script()
    assert [script.unknown(n, s) for n, s in (("a.b", "Int"), ("c", "Int"), ("a.b", "Bool"))] == [
        *("|a.b|", "|c|", "|a.b|"),
    ]
    names = [script.define("Int", t) for t in ("(+ 1 2)", "(+ 2 1)", "(+ 1 2)", "x")]
    assert names == ["n0", "n1", "n0", "x"]
    script.fact("(= n0 3)")
    assert script.lines == [
        *("(declare-const |a.b| Int)", "(declare-const |c| Int)"),
        *("(define-fun n0 () Int (+ 1 2))", "(define-fun n1 () Int (+ 2 1))"),
        "(assert (= n0 3))",
    ]
    assert script.texts == {"n0": "(+ 1 2)", "n1": "(+ 2 1)"}
    assert script.declared == {"|a.b|": "Int", "|c|": "Int"}


@pytest.fixture
def prover(monkeypatch):
    """A prover that says what it is told to; what it was given."""
    told = SimpleNamespace(given=[], out="", err="", code=0)

    def run(command, **more):
        told.given.append((command, more))
        out = told.out.pop(0) if isinstance(told.out, list) else told.out
        return subprocess.CompletedProcess(command, told.code, out, told.err)

    for module in (smt, certificates, proof):
        monkeypatch.setattr(module.subprocess, "run", run)
        monkeypatch.setattr(module, "tool", lambda name, package: name)
    return told


VALUES = """sat
((|in.a| (_ bv1 32))
 (|in.b| (fp #b0 #x7f #b00000000000000000000000))
 (|state.c[1]| #x0000000f))
"""


def test_an_answer_with_its_values(prover):
    script = Script()
    for name, sort in (("in.b", FLOAT), ("in.a", "(_ BitVec 32)")):
        script.unknown(name, sort)
    prover.out = VALUES
    assert ask(script, "(= 1 1)", 3) == Answer(
        "sat",
        {"in.a": "(_ bv1 32)", "in.b": "(fp #b0 #x7f #b00000000000000000000000)",
         "state.c[1]": "#x0000000f"},
    )  # fmt: skip
    ((command, given),) = prover.given
    assert command == ["z3", "-in"]
    assert given["input"].splitlines() == [
        *("(set-option :rlimit 2100000)", "(set-logic QF_FPBV)", *script.lines),
        *("(assert (= 1 1))", "(check-sat)", "(get-value (|in.a| |in.b|))"),
    ]
    assert given["timeout"] == 120
    words = Script()
    words.unknown("a", "(_ BitVec 8)")
    prover.out = "unsat\n(error get-value)\n"
    assert ask(words, "true", 1) == Answer("unsat", {})
    assert "(set-logic QF_BV)" in prover.given[-1][1]["input"]


def test_no_answer_is_unknown_and_no_word_is_an_error(prover):
    for out in ("unknown\n", "timeout\n"):
        prover.out = out
        assert ask(Script(), "true", 1) == Answer("unknown", {})
    for out, err in (("(error line 3)\n", ""), ("unsat\n", "wrong"), ("", "")):
        prover.out, prover.err = out, err
        with pytest.raises(RuntimeError, match="z3 did not understand"):
            ask(Script(), "true", 1)


# -- properties ------------------------------------------------------------------------------------


class Steps:
    """Levels of a proof: by the operators that are free, what z3 says of a claim."""

    asked: list[tuple[str, str, int]]

    def __init__(self, c, free="") -> None:
        self.script, self.free, self.cases = free, free, ["run", "halt"]


@pytest.fixture
def claims(monkeypatch):
    """Properties named by letters; ``said(free, letter)`` is z3's word of one."""
    told = SimpleNamespace(asked=[], said=lambda free, name: "unsat")
    named = {n: limits_proof.Property(n, f"claim {n}", lambda s, n=n: n) for n in "abcd"}

    def answer(script, question, limit_s):
        told.asked.append((script, question, limit_s))
        letters = [x for x in "abcd" if x in question.replace("and", "").replace("halt", "")]
        words = {told.said(script, x) for x in letters}
        found = next((w for w in ("sat", "unknown", "unsat") if w in words), "unsat")
        return Answer(found, {"at": question} if found == "sat" else {})

    for name, made in {
        **{"PROPERTIES": named, "Step": Steps, "ask": answer},
        "LimitsC": lambda device, real, change=None: (device, real, change),
    }.items():
        monkeypatch.setattr(limits_proof, name, made)
    return told


def test_what_is_proven_coarsely_is_not_asked_again(claims):
    found = prove_limits("drive", "f32", limit_s=7)
    assert found == [LimitsVerdict(n, f"claim {n}", "proven", "+-*/", {}) for n in "abcd"]
    # Three together and one alone, each in both cases.
    assert claims.asked == [
        ("+-*/", "(and run (not (and a b c)))", 7), ("+-*/", "(and halt (not (and a b c)))", 7),
        ("+-*/", "(and run (not d))", 7), ("+-*/", "(and halt (not d))", 7),
    ]  # fmt: skip


def test_what_is_too_coarse_is_asked_alone_and_then_finely(claims):
    words = {("+-*/", "b"): "sat", ("+-*/", "d"): "unknown", ("*/", "d"): "unknown"}
    claims.said = lambda free, name: words.get((free, name), "unsat")
    found = prove_limits("drive", "f32", ["a", "b", "d"], limit_s=1)
    assert [(v.name, v.said, v.free) for v in found] == [
        *(("a", "proven", "+-*/"), ("b", "proven", "*/"), ("d", "open", "*/")),
    ]
    claims.said = lambda free, name: "sat" if name == "c" else "unsat"
    claims.asked.clear()
    (broken,) = prove_limits("drive", "q31", ["c"], limit_s=1)
    assert (broken.said, broken.free) == ("broken", "*")
    assert broken.example == {"at": "(and run (not c))"}
    assert [a[0] for a in claims.asked] == ["*"]


def test_what_must_be_possible_is_asked_exactly(claims, monkeypatch):
    made = {"x": lambda s: "a", "y": lambda s: "b", "z": lambda s: "c"}
    monkeypatch.setattr(limits_proof, "POSSIBLE", made)
    claims.said = lambda free, name: {"a": "sat", "b": "unsat", "c": "unknown"}[name]
    found = list(show_possible("drive", "f32"))
    assert [(v.name, v.said) for v in found] == [
        *(("x", "possible"), ("y", "impossible"), ("z", "open")),
    ]
    assert claims.asked[0] == ("", "a", 120)
    assert [v.name for v in show_possible("drive", "f32", ["y"])] == ["y"]


# -- the value analysis ----------------------------------------------------------------------------

EVA = """\
[eva:alarm] /tmp/x/esea_a.c:12: Warning:
  signed overflow. assert x + y
    <= 2147483647;
[eva:alarm] eva.c:40: Warning:
  assertion 'kept' got status unknown.
[eva:alarm] /tmp/x/b.c:3: Warning: division by zero. assert y != 0;
[eva:summary] ====== ANALYSIS SUMMARY ======
  12 functions analyzed (out of 14): 85% coverage.
  In these functions, 345 statements reached (out of 400).
  {n} alarms generated by the analysis:
"""


def analysed(prover, n=2, **more):
    prover.out = EVA.format(n=n)
    asked = {"files": {"a.c": "1", "in/b.h": "2"}, "sources": ["a.c"], "defines": ["-DX"]}
    asked |= {"options": ["-o"], "change": None, **more}
    return proof.analysed(*asked.values())


def test_alarms_and_what_is_unproven_by_their_places(prover):
    assert analysed(prover) == (
        ("esea_a.c:12 signed overflow. assert x + y <= 2147483647;",
         "b.c:3 division by zero. assert y != 0;"),
        ("eva.c:40 kept",),
        (345, 12),
    )  # fmt: skip
    ((command, given),) = prover.given
    folder = given["cwd"]
    assert command[0] == "frama-c"
    assert command[-3:] == [
        "-o", f"-cpp-extra-args=-I{folder} -msse2 -mfpmath=sse -DX", f"{folder}/a.c",
    ]  # fmt: skip
    assert "-warn-signed-downcast" in command


def test_a_report_that_counts_more_alarms_than_it_shows_is_not_believed(prover):
    analysed(prover, 1)
    with pytest.raises(RuntimeError, match="was not understood"):
        analysed(prover, 3)
    prover.out = EVA.format(n=2).replace("statements", "lines")
    with pytest.raises(RuntimeError, match="was not understood"):
        proof.analysed({}, [], [], [], None)
    prover.code = 1
    with pytest.raises(RuntimeError, match="frama-c failed:\n"):
        analysed(prover)


def test_a_fault_is_put_into_its_file_and_folders_are_searched(prover, monkeypatch):
    seen = {}

    def change(name, text):
        seen[name] = text
        return text + "!"

    found = []

    def run(command, cwd, **_):
        found.extend(sorted((p.name, p.read_text()) for p in Path(cwd).rglob("*.*")))
        found.append(command)
        return subprocess.CompletedProcess(command, 0, EVA.format(n=2), "")

    monkeypatch.setattr(proof.subprocess, "run", run)
    analysed(prover, change=change, folders=["in", "out"])
    assert seen == {"a.c": "1", "in/b.h": "2"}
    assert found[:2] == [("a.c", "1!"), ("b.h", "2!")]
    (include,) = (a for a in found[2] if a.startswith("-cpp-extra-args="))
    assert [part.rsplit("/", 1)[-1] for part in include.split()[1:3]] == ["in", "out"]


def test_nothing_is_proven_of_what_was_not_analysed():
    made = proof.EvaResult("d", "b", (), (), ("x",), 1, 1)
    assert made.proven
    for change in ({"alarms": ("a",)}, {"unproven": ("u",)}, {"statements": 0}):
        assert not proof.EvaResult(**(vars(made) | change)).proven


# -- certificates ----------------------------------------------------------------------------------

QUOTING = """\
# Rounding to nearest.
# C first.c
#   int a = 1;
#   int b;
# no quotation
#   int c;
# C part/second.h
#   x
{ a in [0, 1] }
"""


def test_the_c_that_a_script_quotes_line_by_line():
    assert certificates._quoted(QUOTING) == [
        ("first.c", "int a = 1;\nint b;\nint c;"), ("part/second.h", "x"),
    ]  # fmt: skip
    assert certificates._quoted("#   a\n# C two words.c\n# C x.py\n") == []


def test_a_script_certifies_the_text_that_it_quotes_and_without_a_warning(prover):
    sources = {"first.c": "z; int  a=1;\nint b;int c; y", "part/second.h": "ax b"}
    assert certificates._gappa(QUOTING, sources) == (True, "")
    assert prover.given[-1][0] == ["gappa"]
    assert prover.given[-1][1]["input"] == QUOTING
    wrong = sources | {"part/second.h": "y"}
    assert certificates._gappa(QUOTING, wrong) == (
        False, "part/second.h is not what the script says:\nx",
    )  # fmt: skip
    assert certificates._gappa("{ }", sources) == (False, "no C is quoted")
    assert len(prover.given) == 1
    for code, out, err in ((1, "", "no proof"), (0, "Warning: x", ""), (0, "", "Warning: y")):
        prover.code, prover.out, prover.err = code, out, err
        assert certificates._gappa(QUOTING, sources) == (False, err)


def test_a_question_is_put_of_the_function_that_it_names(prover, monkeypatch):
    asked = []

    def translated(path, function, defines):
        asked.append((path, function, defines))
        return "(c)"

    monkeypatch.setattr(certificates, "_translated", translated)
    text = "; Goal.\n; C core.c esea_shift WIDE NARROW\n(set-logic QF_BV)\n(check-sat)\n"
    prover.out = "unsat\n"
    assert certificates._z3(text, Path("/f")) == (True, "unsat")
    assert asked == [(Path("/f/core.c"), "esea_shift", ["WIDE", "NARROW"])]
    assert prover.given[-1][1]["input"] == text.replace("_BV)\n", "_BV)\n(c)\n")
    for out, err, code in (("sat\n", "", 0), ("unsat\nsat\n", "", 0), ("unsat", "e", 0),
                           ("unsat", "", 1)):  # fmt: skip
        prover.out, prover.err, prover.code = out, err, code
        assert not certificates._z3(text, Path("/f"))[0]
    assert certificates._z3("(set-logic QF_BV)\n", Path()) == (
        False, "no function of the C is named",
    )  # fmt: skip
    for logic in ("", "(set-logic QF_BV)\n" * 2):
        question = f"; C a.c f\n{logic}(check-sat)"
        assert certificates._z3(question, Path()) == (False, "no line sets the logic")


def test_every_script_is_certified_against_the_texts_as_changed(monkeypatch, tmp_path):
    (tmp_path / "proof").mkdir()
    (tmp_path / "core.c").write_text("core")
    for name, text in (("b.gappa", "# Second goal.\n"), ("a.smt2", "; First; goal #\nx"),
                       ("c.c.j2", "no script")):  # fmt: skip
        (tmp_path / "proof" / name).write_text(text)
    seen = []

    def gappa(text, sources):
        seen.append((text, sources))
        return True, "a note"

    def z3(text, folder):
        seen.append((text, (folder / "core.c").read_text()))
        return False, "sat"

    for name, made in {
        **{"source_files": lambda: [tmp_path / "core.c"], "template_folder": lambda: tmp_path},
        **{"_gappa": gappa, "_z3": z3},
    }.items():
        monkeypatch.setattr(certificates, name, made)
    found = certificates.prove_rounding(lambda name, text: f"{text}{name[0]}")
    assert [(r.script, r.goal, r.proven, r.why) for r in found] == [
        *(("a.smt2", "First; goal #", False, "sat"), ("b.gappa", "Second goal.", True, "")),
    ]
    assert seen == [("; First; goal #\nxa", "corec"), ("# Second goal.\nb", {"core.c": "corec"})]
    certificates.prove_rounding()
    assert seen[2:] == [("; First; goal #\nx", "core"), ("# Second goal.\n", {"core.c": "core"})]


# -- the search ------------------------------------------------------------------------------------


def test_a_search_keeps_the_worst_of_what_it_drew_and_bettered():
    tried = []

    def error(ends, lasting, bits):
        tried.append((ends.copy(), lasting.copy(), bits))
        return np.array([0.0, -9.0, 3.0 * len(tried) if len(tried) in (4, 7) else 1.0])

    found = chain._worst("f32", error, 0.25, 14, 10, np.random.default_rng(3))
    assert (found.real, found.error_Nm) == ("f32", 21.0)
    assert found.rms_Nm == pytest.approx(np.sqrt((81 + 441) / 3))
    assert (found.ends_rad, found.lasting_s) == tuple(tuple(a) for a in tried[6][:2])
    # Half are drawn, ideal encoders and the device's in turn; the others follow the worst so far.
    assert [t[2] for t in tried] == [0, 14, 0, 14, 0, *5 * [14]]
    for ends, lasting, _ in tried:
        assert (len(ends), len(lasting)) == (4, 4)
        assert np.all(np.abs(ends) <= 0.25)
        assert np.all((lasting >= 0.05 * (1 - 1e-12)) & (lasting <= 1.5 * (1 + 1e-12)))
    rng = np.random.default_rng(3)
    for ends, lasting, _ in tried[:5]:
        assert ends == pytest.approx(rng.uniform(-0.25, 0.25, 4))
        assert np.log(lasting) == pytest.approx(rng.uniform(np.log(0.05), np.log(1.5), 4))
    for k, worst in ((5, 3), (6, 3), (7, 6), (8, 6), (9, 6)):
        ends = tried[worst][0] + rng.normal(0, 0.15 * 0.25, 4)
        lasting = tried[worst][1] * np.exp(rng.normal(0, 0.15, 4))
        assert tried[k][0] == pytest.approx(np.clip(ends, -0.25, 0.25))
        assert tried[k][1] == pytest.approx(np.clip(lasting, 0.05, 1.5))
    tried.clear()
    chain._worst("f32", error, 0.25, 14, 1, np.random.default_rng(3))
    assert len(tried) == 1


def test_both_formats_are_given_what_an_encoder_reads(monkeypatch):
    asked = []

    def compiled(device, real):
        def run(inputs, trace):
            asked.append((real, inputs))
            theta = inputs["theta_rad"]
            off = {"f64": 0.0, "f32": 1e-3, "q31": -3e-3}[real]
            return (
                {"tau_a_Nm": theta + off, "tau_b_Nm": theta - 2 * off, "omega": theta + 9 * off},
            )

        return SimpleNamespace(task=lambda name: SimpleNamespace(run=run, reset=lambda: None))

    monkeypatch.setattr(chain, "compile_device", compiled)
    monkeypatch.setattr(chain, "reaches", lambda ends, lasting, period_s: np.array([0.1, *ends]))
    quantity = SimpleNamespace
    system = quantity(
        tasks=[quantity(name="sense")], task_inputs=lambda t: [quantity(name="theta_rad")]
    )
    file = quantity(
        joint=None,
        encoder=quantity(resolution_bits=quantity(value=6.0)),
        domain=quantity(theta_max_rad=quantity(value=0.25)),
    )
    device = quantity(
        **{"system": system, "file": file, "period_s": 0.001, "name": "x", "origin": "x.toml"},
        tau_full_scale_Nm=20.0,
    )
    said = []
    found = chain.search_chain(device, trials=4, say=said.append)
    assert said == ["search, f32", "search, q31"]
    assert [e.error_Nm for e in found.errors] == pytest.approx([2e-3, 6e-3])
    assert (found.device, found.full_scale_Nm, found.trials) == ("x", 20.0, 4)
    assert {real for real, _ in asked} == {"f64", "f32", "q31"}
    firsts = [inputs["theta_rad"][0] for _, inputs in asked]
    # Ideal, and by 64 counts a turn: 0.1 rad is a count of 0.0982.
    assert firsts[0] == firsts[1] == float(np.float32(0.1))
    assert firsts[2] == float(np.float32(2 * np.pi / 64))
    file.joint = object()
    with pytest.raises(UserError, match="needs a measuring device"):
        chain.search_chain(device)


def test_a_search_passes_at_its_aims_and_not_beyond():
    def report(error_Nm, rms_Nm):
        good = ChainError("f32", 0.001, 0.001, (), (), 0)
        return ChainReport("x", 16.0, 1, (good, ChainError("q31", error_Nm, rms_Nm, (), (), 0)))

    assert (chain.AIM_SHARE, chain.AIM_RMS_SHARE) == (5e-4, 2e-4)
    error, rms = 5e-4 * 16, 2e-4 * 16
    assert report(error, rms).passed
    assert not report(np.nextafter(error, 1), rms).passed
    assert not report(error, np.nextafter(rms, 1)).passed
    assert not report(np.nan, 0.0).passed
