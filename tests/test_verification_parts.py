"""Parts of the verification by hand: replays under sanitizers, Programs, what verify compares."""

from __future__ import annotations

import os
import struct
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.language.ports import Flag, Port
from esea_gen.language.stream import Stream
from esea_gen.verify import equivalence, program, sanitize
from esea_gen.verify.assumed import UNTRIED
from esea_gen.verify.program import CLOSENESS, compare_program
from esea_gen.verify.sanitize import ReplayProgram, SanitizerRun
from esea_gen.verify.verdict import EXACT_PROGRAM, STATED, Comparison


def thing(**parts):
    return SimpleNamespace(**parts)


# -- sanitizers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reports", "differences", "passed"),
    [((), (), True), (("r",), (), False), ((), ("d", "e"), False)],
)
def test_a_report_or_a_bit_fails_a_run(reports, differences, passed):
    run = SanitizerRun("address", "f32", 3, 40, reports, differences)
    assert run.passed == passed
    assert run.to_dict() == {
        **{"sanitizer": "address", "format": "f32", "runs": 3, "steps": 40, "passed": passed},
        **{"reports": list(reports), "differences": list(differences)},
    }


def test_what_c_writes_to_standard_error_is_read_and_no_more():
    os.write(2, b"before\n")
    with sanitize.standard_error() as said:
        os.write(2, b"one\ntwo \xff\n")
        assert said == []
    os.write(2, b"after\n")
    assert said == ["one", "two \ufffd"]


def test_a_tasks_inputs_are_a_wave_with_what_is_invalid():
    ports = [thing(name="x", port=Port("x", -2.0, 1.0, "x")),
             thing(name="v", port=Port("v", -1.0, 3.0, "v", size=2))]  # fmt: skip
    given = sanitize._task_inputs(thing(task_inputs=lambda task: ports), "task", 360)
    x, v = given["x"], given["v"]
    assert v.shape == (360, 2)
    assert np.array_equal(v[:, 0], v[:, 1], equal_nan=True)
    beyond = range(90, 360, 83)
    assert [x[k] for k in beyond] == [3.0] * 4
    assert [v[k, 1] for k in beyond] == [7.0] * 4
    assert np.flatnonzero(np.isinf(x)).tolist() == [180, 269, 358]
    assert np.flatnonzero(np.isnan(x)).tolist() == [120, 217, 314]
    for k in (1, 17, 359):
        assert x[k] == np.float32(2.0 * 0.6 * np.sin(60.0 * k / 359))
        assert v[k, 0] == np.float32(3.0 * 0.6 * np.sin(60.0 * k / 359))
    nothing = sanitize._task_inputs(thing(task_inputs=lambda task: []), "task", 7)
    assert nothing[""].tolist() == 7 * [0.0]


def test_a_stream_as_bytes_for_the_harness():
    state = np.dtype([("a", "<f4"), ("v", "<f4", (2,)), ("n", "<u4")])
    stream = Stream(
        "s",
        {"x": np.array([1.0, 2.0]), "w": np.array([[3.0, 4.0], [5.0, 6.0]])},
        {1: {"v": np.array([7.0, 8.0]), "n": np.array(9)}},
    )
    inputs = [np.asarray(a, np.float32) for a in stream.inputs.values()]
    assert sanitize._stream_bytes(stream, inputs, state) == (
        struct.pack("=I", 2)
        + struct.pack("=I3f", 0, 1.0, 3.0, 4.0)
        + struct.pack("=I", 2)
        + struct.pack("=II2f", 4, 8, 7.0, 8.0)
        + struct.pack("=III", 12, 4, 9)
        + struct.pack("=3f", 2.0, 5.0, 6.0)
    )
    assert sanitize._packed([np.array([1, 2], np.uint16), np.array([3, 4], np.uint8)], 2) == [
        *(b"\x01\x00\x03", b"\x02\x00\x04"),
    ]


@pytest.fixture
def harness(monkeypatch, tmp_path):
    """A harness whose compiler and program are made up."""
    told = thing(code=0, err="", commands=[], result=b"bits")

    def run(command, cwd, **_):
        told.commands.append(command)
        if command[0] == "./replay":
            told.stream = (cwd / "stream").read_bytes()
            (cwd / "result").write_bytes(told.result)
        return subprocess.CompletedProcess(command, told.code, "", told.err)

    renderer = thing(
        files=lambda: {"b.c": "b", "a.c": "a", "in/c.c": "c", "a.h": ""}, render=lambda name: name
    )
    monkeypatch.setattr(sanitize, "GivenRenderer", lambda device, real, files: renderer)
    monkeypatch.setattr(sanitize, "find_compiler", lambda name, *_: name)
    monkeypatch.setattr(sanitize.subprocess, "run", run)
    told.made = lambda which: ReplayProgram("device", "f32", which, tmp_path)
    return told


@pytest.mark.parametrize(("which", "compiler"), [("address", "gcc"), ("memory", "clang")])
def test_each_sanitizer_has_its_compiler(harness, which, compiler):
    harness.made(which)
    (command,) = harness.commands
    assert command[0] == compiler
    assert f"-fsanitize={which}" in " ".join(command)
    assert "-fno-sanitize-recover=all" in command
    assert command[-6:] == ["a.c", "b.c", "main.c", "-o", "replay", "-lm"]


def test_a_harness_that_does_not_build_is_told(harness):
    harness.code, harness.err = 1, "wrong"
    with pytest.raises(RuntimeError, match="does not build:\nwrong"):
        harness.made("address")
    harness.err = "cannot find libclang_rt.msan-x86_64.a"
    with pytest.raises(UserError, match="run-time library"):
        harness.made("memory")


def test_what_a_sanitizer_says_of_a_run(harness):
    replay = harness.made("address")
    assert replay.run("sense", b"in") == (b"bits", "")
    assert harness.commands[-1] == ["./replay", "sense", "stream", "result", "-1"]
    assert harness.stream == b"in"
    replay.run("sense", b"in", 0xA5)
    assert harness.commands[-1][-1] == "165"
    err = "==1==ERROR: heap\n  at x\na.c:3: runtime error: shift\n"
    for code, said, wanted in (
        (1, err, "sense: ==1==ERROR: heap; a.c:3: runtime error: shift"),
        (0, err, "sense: ==1==ERROR: heap; a.c:3: runtime error: shift"),
        (1, "killed", "sense: killed"),
        (-9, "", "sense: ended with -9"),
    ):
        harness.code, harness.err = code, said
        assert replay.run("sense", b"in") == (b"", wanted)


def test_a_result_that_hangs_on_memory_that_nobody_wrote_is_seen(monkeypatch):
    asked = []
    states = [np.array([1, 2], np.uint32)]
    bits = np.array([1, 2], np.uint32).tobytes()

    class NoProgram:
        def __init__(self, device, real, which, folder, files):
            pass

        def run(self, name, data, fill):
            asked.append((name, fill))
            said = "ERROR" if name == "bad" else ""
            return bits if fill != 0x7F or name != "leaks" else b"other", said

    def cases(device, library, fmt, steps, blocks):
        for name in ("good", "leaks", "bad"):
            yield name, Stream(f"s {name}", {"x": np.zeros(2)}), [np.zeros(2, "f4")], None, states

    for name, made in {
        **{"ReplayProgram": NoProgram, "_cases": cases, "GivenRenderer": lambda *a: None},
        "HostLibrary": lambda system, renderer: None,
    }.items():
        monkeypatch.setattr(sanitize, name, made)
    found = sanitize.replay_device(thing(system=None), "f32", "address")
    assert (found.runs, found.steps, found.sanitizer, found.real) == (6, 12, "address", "f32")
    assert found.reports == ("s bad: ERROR", "s bad: ERROR")
    assert found.differences == ("s leaks: leaks, memory filled with 127",)
    assert [fill for _, fill in asked] == 3 * [0xA5, 0x7F]
    asked.clear()
    found = sanitize.replay_device(thing(system=None), "f32", "memory")
    assert (found.runs, found.differences, [fill for _, fill in asked]) == (3, (), [-1, -1, -1])


def test_undefined_behaviour_is_watched_in_every_block_and_task(monkeypatch):
    ran = []

    def run_c(runner, stream):
        ran.append(runner)
        if runner == "b":
            os.write(2, b"b.c:1: runtime error: overflow\nand more\n")

    def task(name):
        return thing(run=lambda inputs, trace: ran.append(f"task {name} {len(inputs[''])}"))

    library = thing(block=lambda name: name, task=task)
    streams = [Stream(n, {"x": np.zeros(k)}) for n, k in (("s", 5), ("t", 7))]
    for name, made in {
        "HostLibrary": lambda system, renderer, flags: ran.append(flags[-1]) or library,
        "GivenRenderer": lambda *a: None,
        "chosen_blocks": lambda device, blocks: [thing(name=n) for n in blocks or "ab"],
        "tried_streams": lambda block, fmt, steps: streams,
        "run_c": run_c,
    }.items():
        monkeypatch.setattr(sanitize, name, made)
    device = thing(system=thing(tasks=[thing(name="sense")], task_inputs=lambda t: []))
    found = sanitize.undefined_behaviour(device, "f32", steps=11)
    assert (found.sanitizer, found.runs, found.steps) == ("undefined", 5, 2 * 12 + 11)
    assert found.reports == 2 * ("b.c:1: runtime error: overflow",)
    assert ran == ["-fsanitize-recover=all", "a", "a", "b", "b", "task sense 11"]
    found = sanitize.undefined_behaviour(device, "f32", blocks=["a"])
    assert (found.runs, found.steps, found.passed) == (2, 12, True)


# -- programs --------------------------------------------------------------------------------------

OUT = (
    Port("u_Nm", -4.0, 4.0, "Torque."), Port("used", 0.0, 9.0, "Count."),
    Port("status", 0.0, 7.0, "Bits.", flags=tuple(Flag(n, n) for n in "ABC")),
)  # fmt: skip
CARRIED, WORK = Port("kept", -1.0, 1.0, "Kept."), Port("work", -1.0, 1.0, "Work.")


def judged(monkeypatch, real="f64", again=None, injections=None, **changes):
    """A Program's run against its executor's; the C's values that are other, by name."""
    expected = {"u_Nm": [0.5, -1.0], "used": [3.0, 4.0], "status": [5, 2], "kept": [0.1, 0.2]}
    expected["work"] = [0.3, 0.4]
    kinds = {n: np.uint32 if n == "status" else float for n in expected}

    def run(values):
        made = {n: np.array(v, kinds[n]) for n, v in values.items()}
        names = [p.name for p in OUT]
        return {n: made[n] for n in names}, {n: made[n] for n in ("kept", "work")}

    runs = {False: run(expected | changes), True: run(expected | changes | (again or {}))}
    monkeypatch.setattr(program, "run_c", lambda runner, s, restore=False: runs[restore])
    monkeypatch.setattr(program, "full_scales", lambda d, p: {"u_Nm": 4.0, "used": 9.0})
    made = thing(name="p", outputs=OUT, state=(CARRIED, WORK), carried=(CARRIED,))
    ports = [Port("used", 0.0, 9.0, "Count.")]
    assert ports[0].unit == "1"
    stream = Stream("s", {"x": np.zeros(2)}, injections or {})
    library = thing(real=real, block=lambda name: name)
    return compare_program("device", made, library, stream, run(expected))


def test_a_programs_double_c_gives_its_executors_bits(monkeypatch):
    found = judged(monkeypatch)
    assert found.passed
    assert (found.rule, found.bit_identical, found.limits) == (EXACT_PROGRAM, True, {"u_Nm": 0.0})
    assert (found.steps, found.block, found.stream, found.real) == (2, "p", "s", "f64")
    for name, values in (("used", [3, 5]), ("kept", [0.1, 0.3]), ("work", [0.0, 0.4])):
        found = judged(monkeypatch, **{name: values})
        assert (found.bit_identical, found.passed) == (False, False), name
    wrong = judged(monkeypatch, u_Nm=[0.5, -1.25])
    assert wrong.errors == {"u_Nm": 0.25}
    assert wrong.problems == ["u_Nm: error 0.25 above 0"]
    # What was put into a work array from outside is not the executor's.
    put = {0: {"work": np.array(1.0)}}
    assert judged(monkeypatch, injections=put, work=[0.0, 0.4]).passed
    assert not judged(monkeypatch, injections=put, kept=[0.1, 0.3]).passed
    assert not judged(monkeypatch, injections=put, used=[3, 5]).passed


def test_a_programs_single_c_keeps_a_share_of_full_scale(monkeypatch):
    limit = CLOSENESS * 4.0
    found = judged(monkeypatch, "f32", u_Nm=[0.5, -1.0 + limit * 0.999], kept=[9, 9])
    assert (found.passed, found.bit_identical, found.rule) == (True, None, STATED)
    assert found.limits == {"u_Nm": 4e-3}
    assert not judged(monkeypatch, "f32", u_Nm=[0.5 - 1.001 * limit, -1.0]).passed
    found = judged(monkeypatch, "f32", u_Nm=[0.5, np.nan])
    assert found.problems[0] == "u_Nm is not finite"
    assert found.problems[1].startswith("u_Nm: error nan above")


@pytest.mark.parametrize(
    ("real", "status", "differ", "turned"),
    [
        ("f64", [5, 2], 0, 0), ("f64", [7, 2], 1, 0), ("f64", [4, 0], 2, 0), ("f64", [2, 5], 2, 0),
        ("f32", [7, 3], 0, 2), ("f32", [4, 2], 1, 0), ("f32", [6, 2], 1, 1), ("f32", [5, 6], 0, 1),
    ],
)  # fmt: skip
def test_float32_may_say_more_against_itself_never_less(monkeypatch, real, status, differ, turned):
    found = judged(monkeypatch, real, status=status)
    assert (found.status_differences, found.turned) == (differ, turned)


def test_a_program_that_is_stopped_and_restored_goes_on_alike(monkeypatch):
    found = judged(monkeypatch, again={"kept": [0.1, 0.5], "used": [3, 9], "work": [7, 7]})
    assert found.problems == [
        *(f"{n}: stop and restore changes it" for n in ("used", "kept")),
    ]


# -- what is verified ------------------------------------------------------------------------------


def test_blocks_by_name_in_the_systems_order():
    kinds = [thing(name=n) for n in ("one", "two", "three")]
    device = thing(system=thing(kinds=kinds), origin="x.toml")
    assert equivalence.chosen_blocks(device, None) == kinds
    assert equivalence.chosen_blocks(device, []) == kinds
    assert equivalence.chosen_blocks(device, ["three", "one"]) == [kinds[0], kinds[2]]
    with pytest.raises(UserError, match=r"x\.toml: there is no Block 'tow'") as error:
        equivalence.chosen_blocks(device, ["one", "tow"])
    assert "two" in error.value.fix


def verified(monkeypatch, beyond=(), **more):
    """A verification of one Block and one Program whose parts are made up; what was asked."""
    asked = {"symbolic": [], "executor": [], "compared": [], "said": []}

    def compare(device, block, library, stream, held, oracle, rule, expected):
        asked["compared"].append((block.name, library, stream.name, held, oracle, rule, expected))
        found = Comparison(block.name, stream.name, library, 1, {}, {})
        found.beyond = int((library, stream.name) in beyond)
        return found

    def compare_program_(device, made, library, stream, expected):
        asked["compared"].append((made.name, library, stream.name, expected))
        return Comparison(made.name, stream.name, library, 1, {}, {})

    def ran(what):
        return lambda block, stream: asked[what].append(stream.name) or f"{what} {stream.name}"

    def stream(name):
        return Stream(name, {"x": np.zeros(1)})

    for name, made in {
        "compile_device": lambda device, real: real,
        "CasadiOracle": lambda system: "oracle",
        "program_streams": lambda p, seed: [stream(f"p{seed}")],
        "streams": lambda b, seed: [stream(f"a{seed}")],
        "domain_chirp": lambda device: "chirp",
        "recorded_stream": lambda device, theta, name: {"b": stream(name), "other": stream("no")},
        "run_executor": ran("executor"),
        "run_symbolic": ran("symbolic"),
        "bounds_or_rule": lambda device, block: ({"domain": "bound"}, "rule"),
        "compare": compare,
        "compare_program": compare_program_,
        "full_scales": lambda device, block: {
            "y": 2.0 if block.name == "b" else 3.0,
            block.name: 1,
        },
        "device_hash": lambda device: "hash",
    }.items():
        monkeypatch.setattr(equivalence, name, made)
    kinds = [thing(name="p", kind="program"), thing(name="b", kind="block")]
    device = thing(system=thing(kinds=kinds), origin="x.toml", name="x")
    return equivalence.verify(device, progress=asked["said"].append, **more), asked


def test_every_stream_in_every_format_and_the_symbolic_side_once(monkeypatch):
    found, asked = verified(monkeypatch, recorded={"walk": "theta"}, seed=3)
    assert asked["executor"] == ["p3"]
    names = ["a3", "chirp in the domain", "walk"]
    assert asked["symbolic"] == names
    assert asked["compared"] == [
        ("p", "f64", "p3", "executor p3"),
        *(("b", "f64", n, {}, "oracle", None, f"symbolic {n}") for n in names),
        ("p", "f32", "p3", "executor p3"),
        *(("b", "f32", n, {"domain": "bound"}, None, "rule", f"symbolic {n}") for n in names),
    ]
    assert asked["said"][:2] == ["p, f64: p3", "b, f64: a3"]
    assert "deriving the float32 bound of b" in asked["said"]
    assert (found.device, found.content_hash, found.bounds) == (
        "x",
        "hash",
        {"b": {"domain": "bound"}},
    )
    # Of several Blocks with a port of one name, the smallest is all of it.
    assert found.full_scale == {"y": 2.0, "p": 1, "b": 1}
    assert found.full_scales == {"p": {"y": 3.0, "p": 1}, "b": {"y": 2.0, "b": 1}}
    only, asked = verified(monkeypatch, reals=["f32"], blocks=["b"])
    assert [c.block for c in only.comparisons] == ["b", "b"]
    assert asked["symbolic"] == ["a1", "chirp in the domain"]


def test_a_bound_that_no_stream_tries_fails(monkeypatch):
    streams = ("a1", "chirp in the domain")
    found, _ = verified(monkeypatch, {("f32", s) for s in streams})
    told = {(c.block, c.real, c.stream): c.problems for c in found.comparisons}
    assert told["b", "f32", "a1"] == [UNTRIED]
    assert sum(map(bool, told.values())) == 1
    found, _ = verified(monkeypatch, {("f32", "a1"), ("f64", "chirp in the domain")})
    assert found.passed
