"""What each gate makes of an object file: its symbols, instructions and stacks are made up."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from esea_gen.errors import UserError
from esea_gen.verify import gates
from esea_gen.verify.gates import CONTROL_STACK_BYTES, PROGRAM_STACK_BYTES, TARGETS, find_target

from .test_image_tables import graph_file, node

HOST, M3, M4 = (TARGETS[n] for n in ("host", "cortex-m3", "cortex-m4f"))


def wanted(monkeypatch, names, target, libm=False):
    """Rules that are broken by asking for some names, by name."""
    monkeypatch.setattr(gates, "double_arithmetic", lambda o, t: [f"a.o: {n}" for n in names])
    found = gates._unwanted([], target, libm)
    assert all(f.startswith("a.o: asks for ") for f in found)
    return dict(f.removeprefix("a.o: asks for ").split(": ", 1) for f in found)


def test_what_f32_must_not_ask_for_by_its_rule(monkeypatch):
    heap = ("malloc", "calloc", "realloc", "free", "aligned_alloc", "sbrk", "_sbrk")
    stdio = ("printf", "vprintf", "fprintf", "vsnprintf", "__sprintf_chk", "puts", "putchar")
    stdio += ("fopen", "fwrite", "fputc", "fputs", "stderr", "stdout", "_printf")
    double = ("__aeabi_dmul", "__aeabi_f2d", "__muldf3")
    other = ("sinf", "powf", "fabs", "xprintf", "printfx", "freed", "memcmp")
    found = wanted(monkeypatch, (*heap, *stdio, *double, *other), HOST)
    assert found == {
        **dict.fromkeys(heap, "heap"),
        **dict.fromkeys(stdio, "input and output"),
        **dict.fromkeys(double, "double arithmetic"),
        **dict.fromkeys(other, "a library function"),
    }


def test_a_processor_without_floats_may_ask_for_single_ones(monkeypatch):
    names = ("fadd", "fsub", "frsub", "fmul", "fdiv", "fcmplt", "cfcmple", "cfrcmple", "f2iz")
    names += ("f2uiz", "f2ulz", "f2lz", "i2f", "ui2f", "l2f", "ul2f")
    single = [f"__aeabi_{n}" for n in names]
    assert wanted(monkeypatch, single, M3) == {}
    assert wanted(monkeypatch, single, M4) == dict.fromkeys(single, "a library function")
    for name in ("__aeabi_dadd", "__aeabi_f2d", "__aeabi_faddx", "__aeabi_f2dz"):
        assert name in wanted(monkeypatch, [name], M3)


def test_f64_may_ask_for_libm_and_doubles_and_for_nothing_else(monkeypatch):
    functions = ["pow", "exp", "log", "tanh", "sqrt", "fmin", "fmax", "fabs", "__aeabi_dmul"]
    others = {"sin": "a library function", "powf": "a library function", "free": "heap"}
    others |= {"__muldf3": "a library function", "puts": "input and output"}
    assert wanted(monkeypatch, [*functions, *others], HOST, True) == others
    assert set(wanted(monkeypatch, functions, HOST)) == set(functions)


def test_writable_data_and_exports_without_the_prefix(monkeypatch):
    table = [(f"{k}.o", f"{p}{k}", k) for k in "DdBbCGgSsTtRrVvWwUiN" for p in ("esea_", "x_")]
    monkeypatch.setattr(gates, "symbols", lambda objects, toolchain: table)
    found = gates._symbols([], HOST)
    data = {f"{k}.o: {p}{k}: writable data" for k in "DdBbCGgSs" for p in ("esea_", "x_")}
    exports = {f"{k}.o: x_{k}: an export without the prefix esea_" for k in "TDBRCVWGSi"}
    assert set(found) == data | exports
    assert len(found) == len(data) + len(exports)


ARM = """
   0:\tvadd.f32\ts0, s0, s1
   4:\tvmul.f64\td0,   d0, d1
   8:\tvcvt.f64.f32\td0, s0
   c:\tvmov.f64\td1, d0
  10:\tldr\tr0, [r1]
"""
X86 = """
   0:\taddss  %xmm0,%xmm1
   4:\tmulsd  %xmm0,%xmm1
   8:\tvaddpd %ymm0,%ymm1,%ymm2
   c:\tcvtss2sd %xmm0,%xmm0
  10:\tfldl   (%rsp)
  14:\tsqrtss %xmm0,%xmm0
  18:\tucomisd %xmm0,%xmm1
  1c:\tmovsd  %xmm0,(%rsp)
"""


def test_double_instructions_are_counted_and_the_first_is_shown(monkeypatch):
    monkeypatch.setattr(gates, "find_compiler", lambda name, *_: name)
    said = {"a.o": ARM, "b.o": "vadd.f32 s0, s0, s1\n", "c.o": X86}
    asked = []

    def output(*command):
        asked.append(command)
        return said[command[-1].name]

    monkeypatch.setattr(gates, "_output", output)
    monkeypatch.setattr(gates, "_HOST_DOUBLE", gates._X86_DOUBLE)
    paths = [Path("/x") / n for n in said]
    assert gates._instructions(paths[:2], M4) == [
        "a.o: 3 double instructions, first 'vmul.f64 d0, d0, d1'"
    ]
    assert gates._instructions(paths[1:], HOST) == [
        "c.o: 5 double instructions, first 'mulsd %xmm0,%xmm1'",
    ]
    assert asked[0][1:] == ("-d", "--no-show-raw-insn", paths[0])
    assert gates._A64_DOUBLE.search("fadd\td0, d1, d2")
    assert not gates._A64_DOUBLE.search("fadd\ts0, s1, s2")


def device(latches=(), kinds=("block",), tasks=("sense", "law")):
    system = SimpleNamespace(
        latches=latches,
        kinds=[SimpleNamespace(kind=k) for k in kinds],
        tasks=[SimpleNamespace(name=n) for n in tasks],
    )
    return SimpleNamespace(name="x", system=system)


def test_a_stack_has_room_for_control_and_for_programs():
    assert (CONTROL_STACK_BYTES, PROGRAM_STACK_BYTES) == (256, 448)
    limits = [
        gates._stack_limit(device(a, k), M4)
        for a in ((), ("l",))
        for k in (("block",), ("block", "program"))
    ]
    assert limits == [640, 640 + 448, 640 + 256, 640 + 256 + 448]
    assert gates._stack_limit(device(), M3) == 768
    assert gates._stack_limit(device(), HOST) == 1024


def test_what_the_stack_needs_and_what_makes_it_unknown(tmp_path):
    own = {"esea_x_sense_step": 600, "esea_x_law_step": 641, "leaf": 40}
    graph_file(tmp_path / "a.ci", own, [("esea_x_sense_step", "leaf")])
    (tmp_path / "a.su").write_text("a.c:1:5:f\t16\tstatic\na.c:9:5:g\t24\tdynamic,bounded\n")
    used, found = gates._stack(device(), tmp_path, M4, True)
    assert used == {"sense": 640, "law": 641}
    assert found == [
        "a.c:9:5:g: stack use depends on data (dynamic,bounded)",
        "task law: 641 bytes of stack, above the limit of 640",
    ]
    assert gates._stack(device(("l",)), tmp_path, M4, True)[1] == found[:1]
    assert gates._stack(device(), tmp_path, M4, False)[1] == found[:1]
    graph_file(tmp_path / "b.ci", {"late": 1}, [("late", "__indirect_call")])
    (tmp_path / "c.ci").write_text(node("wild", "8 bytes (dynamic)"))
    used, found = gates._stack(device(tasks=("law",)), tmp_path, M4, True)
    assert used == {}
    assert found[1:] == [
        "b.o: calls through a pointer: stack use unknown",
        "task law: wild uses a stack of unknown size",
    ]


def test_targets_by_name():
    assert find_target("cortex-m7").stack_limit_bytes == 640
    with pytest.raises(UserError, match="no target 'cortex-m8'") as error:
        find_target("cortex-m8")
    assert "cortex-m7" in error.value.fix
    assert "host (" in error.value.fix


@pytest.fixture
def compiler(monkeypatch):
    """A compiler that makes empty objects; its commands, and what it says of a file."""
    told = SimpleNamespace(commands=[], says={}, folders=[])

    def run(command, cwd, **_):
        told.commands.append([str(c) for c in command])
        told.folders.append(sorted(p.name for p in Path(cwd).iterdir()))
        name = command[command.index("-c") + 1]
        code, said = told.says.get(name, (0, ""))
        return SimpleNamespace(returncode=code, stderr=said, stdout="")

    monkeypatch.setattr(gates.subprocess, "run", run)
    monkeypatch.setattr(gates, "find_compiler", lambda name, *_: name)
    monkeypatch.setattr(gates, "compiler_version", lambda gcc: f"{gcc} 1")
    return told


FILES = {"main.c": "", "b.c": "", "a.c": "", "a.h": "", "cmake/z.c": ""}


def test_every_gate_is_asked_of_every_object(monkeypatch, compiler):
    asked = []

    def asks(name, answer):
        def made(*arguments):
            asked.append((name, *arguments))
            return answer

        monkeypatch.setattr(gates, name, made)

    asks("_unwanted", ["1"])
    asks("_symbols", ["2"])
    asks("_instructions", ["3"])
    asks("_stack", ({"sense": 99}, ["5"]))
    asks("run_example", SimpleNamespace(problems=("4",)))
    asks("_output", "text data\n100 2 a.o\n23 1 b.o\n")
    report = gates.check_objects(device(), "host", files=FILES)
    assert report.problems == ("1", "2", "3", "4", "5")
    assert not report.passed
    assert (report.text_bytes, report.stack_bytes, report.compiler) == (123, {"sense": 99}, "gcc 1")
    assert (report.device, report.real, report.target) == ("x", "f32", "host")
    assert [c[c.index("-c") + 1 :] for c in compiler.commands] == [
        *(["a.c", "-o", "a.o"], ["b.c", "-o", "b.o"]),
    ]
    assert compiler.folders[0] == ["a.c", "a.h", "b.c", "main.c"]
    assert "-fcallgraph-info=su" in compiler.commands[0]
    objects = asked[0][1]
    assert [p.name for p in objects] == ["a.o", "b.o"]
    assert [(a[0], a[3:]) for a in asked[:1]] == [("_unwanted", (False,))]
    assert asked[3][-1] is True
    asked.clear()
    report = gates.check_objects(device(), "host", "f64", files=FILES)
    assert [a[0] for a in asked] == ["_unwanted", "_symbols", "_stack", "run_example", "_output"]
    assert (asked[0][3], asked[2][-1]) == (True, False)
    assert report.problems == ("1", "2", "4", "5")
    asked.clear()
    gates.check_objects(device(), "cortex-m4f", files=FILES)
    gates.check_objects(device(), "host", files={"a.c": ""})
    assert "run_example" not in [a[0] for a in asked]
    compiler.says["b.c"] = 1, "wrong"
    with pytest.raises(RuntimeError, match=r"b\.c does not compile for host:\nwrong"):
        gates.check_objects(device(), "host", files=FILES)


def test_what_a_strict_compiler_says_of_every_file(compiler):
    assert gates.compiler_warnings(device(), "f32", files=FILES) == ""
    of = {c[c.index("-c") + 1]: c for c in compiler.commands}
    assert list(of) == ["a.c", "b.c", "main.c"]
    single = {"-Wdouble-promotion", "-Wfloat-conversion", "-Wunsuffixed-float-constants"}
    assert single <= set(of["a.c"])
    assert not single & set(of["main.c"])
    assert "-Wconversion" in of["main.c"]
    compiler.commands.clear()
    gates.compiler_warnings(device(), "f64", files=FILES)
    assert not single & set(compiler.commands[0])
    compiler.commands.clear()
    gates.compiler_warnings(device(), "f32", "clang", files=FILES)
    assert compiler.commands[0][0] == "clang"
    assert single & set(compiler.commands[0]) == single - {"-Wunsuffixed-float-constants"}
    # A warning counts though the compiler goes on, and so does a refusal without words.
    compiler.says |= {"a.c": (0, "one\n"), "b.c": (1, "two\n"), "main.c": (1, "")}
    assert gates.compiler_warnings(device(), "f32", files=FILES) == "one\ntwo\n"
