"""Pieces of text that a renderer gives its templates: a small System of every kind of feed."""

from __future__ import annotations

import re

import casadi as ca
import jinja2
import numpy as np
import pytest

from esea_gen.emit import render
from esea_gen.emit.formats import DEFAULT_FORMATS, FORMATS
from esea_gen.emit.formats.f64 import casadi_c
from esea_gen.emit.render import (
    Renderer,
    block_kernels,
    content_hash,
    environment,
    identity,
    port_text,
)
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import External, System, Task

F32, F64, Q31 = FORMATS["f32"], FORMATS["f64"], FORMATS["q31"]


def block(name: str, period_s: float, *inputs: Port, tuned: bool = False) -> Block:
    """Gives its first input and a word of two flags."""

    def step(c, _s, u, guard, _label):
        first = getattr(u, inputs[0].name)
        y = c.gain * first[0] if tuned else 2 * first[0]
        word = flag_word([ca.logic_not(guard.inputs_ok), y > 1])
        return {}, {"y_Nm": y, "pair_Nm": [y, 3 * y], "status": word}

    flags = (Flag("BAD", "replaced", True), Flag("HIGH", "above 1", compares=("y_Nm",)))
    return Block.define(
        name,
        "Any",
        period_s=period_s,
        tunables=(Tunable("gain", 1.0, 0.5, 2.0, "factor"),) if tuned else (),
        coefficients=(Port("gain", 0.5, 2.0, "factor"),) if tuned else (),
        prepare=(lambda t: {"gain": 1 * t.gain}) if tuned else None,
        state=(),
        inputs=inputs,
        outputs=(
            Port("y_Nm", -8.0, 8.0, "torque", equation="(3.4)"),
            Port("pair_Nm", -24.0, 24.0, "both", 2),
            Port("status", 0, 3, "what is known", flags=flags),
        ),
        step=step,
    )


def feeds() -> System:
    """From outside, from the Block before, from a latch and from the watch."""
    x, both = Port("x_Nm", -4.0, 4.0, "in"), Port("both_Nm", -24.0, 24.0, "in", 2)
    watched = (Port("clock_ok", 0, 1, "ticks"), Port("late_level", 0, 200, "late"))
    wide = Port("x_Nm", -8.0, 8.0, "in")
    blocks = {
        "first": block("one", 1e-3, x, tuned=True),
        "second": block("two", 1e-3, both, wide),
        "slow": block("three", 5e-3, wide, *watched),
    }
    wires = {
        "second.both_Nm": "first.pair_Nm",
        "second.x_Nm": "slow.y_Nm",
        "slow.x_Nm": "second.y_Nm",
        "slow.clock_ok": "watch.clock_ok",
        "slow.late_level": "watch.late_level",
    }
    tasks = (Task("quick", ("first", "second")), Task("lazy", ("slow",), every=5))
    outputs = {"y_Nm": "second.y_Nm", "status": "second.status"}
    return System("feeds", 1e-3, blocks, tasks, wires, {"given_Nm": ("first.x_Nm",)}, outputs)


@pytest.fixture(scope="module")
def system() -> System:
    return feeds()


def renderer(system: System, fmt=F64, digest: str = "0123") -> Renderer:
    return Renderer(system, fmt, digest, "esea-gen build feeds", "Feeds")


def test_what_feeds_an_input(system):
    made = renderer(system)
    for instance, port, at, expected in (
        ("first", "x_Nm", "", "in->given_Nm"),
        ("second", "both_Nm", "[1]", "first_out.pair_Nm[1]"),
        ("second", "x_Nm", "", "state->quick_held.slow_y_Nm"),
        ("slow", "x_Nm", "", "state->lazy_held.second_y_Nm"),
        ("slow", "clock_ok", "", "state->lazy_held.clock_ok == 1u ? 1.0 : 0.0"),
        (
            "slow",
            "late_level",
            "",
            "(double)(state->lazy_held.late_level < 200u ? state->lazy_held.late_level : 200u)",
        ),
    ):
        given = next(p for p in system.blocks[instance].inputs if p.name == port)
        assert made.feed(instance, given, at) == expected
    given = system.blocks["slow"].inputs[1]
    text = renderer(system, F32).feed("slow", given, "")
    assert text == "state->lazy_held.clock_ok == 1u ? 1.0f : 0.0f"


def test_fields_literals_and_counters(system):
    made, single = renderer(system), renderer(system, F32)
    one = system.blocks["first"]
    y, pair, status = one.outputs
    assert made.field(y, one, "out") == "double y_Nm;"
    assert single.field(pair, one, "out") == "float pair_Nm[2];"
    assert single.field(status, one, "out") == "uint32_t status;"
    assert made.field(one.tunables[0], one, "params") == "double gain;"
    assert (made.literal(one, "out", y, 0.25), single.literal(one, "out", y, 0.25)) == (
        "0.25",
        "0.25f",
    )
    bad, high = status.flags
    assert made.counter(one, status, bad) == (
        "state->n_bad += (((out->status & ESEA_FEEDS_ONE_BAD) != 0u) && "
        "(state->n_bad != UINT32_MAX)) ? 1u : 0u;"
    )
    form = "{n} {port} {bit}"
    assert made.counter(one, status, high, form) == "state->n_high status ESEA_FEEDS_ONE_HIGH"
    (given,) = system.inputs
    for r, units, number in (
        (made, "(double)in.given_Nm", "-1.5"),
        (single, "(double)in.given_Nm", "-1.5f"),
    ):
        assert (r.in_units(given, "in.given_Nm"), r.given(given, -1.5)) == (units, number)
    whole = renderer(system, Q31)
    for block, group, port in ((one, "in", one.inputs[0]), (one, "params", one.tunables[0])):
        bits = whole.naming.fraction(block, group, port.name)
        assert bits > 20
        assert whole.literal(block, group, port, 0.75) == str(3 * 2 ** (bits - 2))
        assert whole.field(port, block, group) == f"int32_t {port.name};"
        told = whole.naming.text(block, group, port)
        assert told
        assert whole.port_text(port, block, group) == port_text(port) + told
        assert made.port_text(port, block, group) == port_text(port)
    assert whole.given(given, -1.5) == whole.naming.from_units(given, "-1.5")
    assert whole.in_units(given, "v") == whole.naming.to_units(given, "v")


def test_what_a_header_says_of_a_port():
    flag = Flag("A", "a")
    for port, expected in (
        (Port("x_Nm", -1.5, 2.25, "torque"), "torque; [Nm], range -1.5 to 2.25"),
        (Port("share", 0, 1, "part", 3), "part; 3 elements; [dimensionless], range 0 to 1"),
        (
            Port("x_rad_s", -1e6, 1000003 / 2**20, "rate", 2, "(3.4)"),
            "rate; 2 elements; [rad/s], range -1000000 to 0.953677177; eq. (3.4)",
        ),
        (Port("status", 0, 1, "word", flags=(flag,)), "word; bits below"),
        (Tunable("gain_Nm_rad", 1, 0.5, 2, "factor"), "factor; [Nm/rad], range 0.5 to 2"),
    ):
        assert port_text(port) == expected


def test_names_of_a_text_by_its_hash(system):
    assert identity("esea_a", F32, "0123") == "esea_a_f32_0123"
    assert identity("esea_a", F64, "") == "esea_a_f64"
    assert identity("esea_a", F64, "-") == "esea_a_f64"
    made = renderer(system, F32)
    assert (made.prefix, made.identity) == ("esea_feeds", "esea_feeds_f32_0123")
    assert made.init_name == "esea_feeds_init_f32_0123"
    told = made.env.globals
    assert (told["PREFIX"], told["content_hash"], told["title"]) == ("ESEA_FEEDS", "0123", "Feeds")
    assert told["late"] == {"step": 16, "most": 128, "full": 255}
    assert told["programs"] == []
    assert told["command"] == "esea-gen build feeds"
    assert set(made.emitted) == {"one", "two", "three"}
    # Printed once for every renderer of the same System and format.
    assert renderer(system, F32, "9").emitted is made.emitted
    assert renderer(system, F64).emitted is not made.emitted


def test_kernels_of_a_block(system):
    assert set(block_kernels(system.blocks["first"])) == {"init", "step", "prepare"}
    assert set(block_kernels(system.blocks["second"])) == {"init", "step"}
    assert {k: v.name.endswith(k) for k, v in block_kernels(system.blocks["first"]).items()} == {
        "init": True,
        "step": True,
        "prepare": True,
    }


def test_numbers_in_templates_have_nine_digits_and_an_unknown_name_is_an_error():
    env = environment()
    assert env.from_string("{{ v | number }}").render(v=1 / 3) == "0.333333333"
    assert env.from_string("{{ v | bare }}{{ w | comment }}").render(v="(a)", w="b") == "a/* b */"
    assert env.from_string("{{ v | wrap }}\n").render(v="a") == "a\n"
    text = "  {% if true %}\na\n  {% endif %}\nb<&\n"
    assert env.from_string(text).render() == "a\nb<&\n"
    with pytest.raises(Exception, match="'nothing' is undefined"):
        env.from_string("{{ nothing }}").render()


def test_what_formats_say_of_themselves(system):
    assert list(FORMATS) == ["f64", "f32", "q31"]
    assert DEFAULT_FORMATS == ("f64", "f32")
    told = {
        f.name: (f.c_type, f.dtype, f.epsilon, f.default, f.floating, f.needs_libm, f.libraries,
                 f.compiler_flags, f.header, f.verified_by, f.example_share)
        for f in FORMATS.values()
    }  # fmt: skip
    fused = " -ffp-contract=off"
    # Half of the distance from 1 to the number above it, and of whole numbers of the range.
    halves = [float(np.finfo(t).eps) / 2 for t in (np.float64, np.float32)]
    assert told == {
        "f64": ("double", np.dtype("f8"), halves[0], True, True, True, " -lm", fused, "",
                "esea-gen verify", 1e-5),
        "f32": ("float", np.dtype("f4"), halves[1], True, True, False, "", fused, "",
                "esea-gen verify", 1e-5),
        "q31": ("int32_t", np.dtype("i4"), 1 / 2**31, False, False, False, "", "", "esea_q31.h",
                "esea-gen fixed", 5e-5),
    }  # fmt: skip
    assert (F32.joins_words, F64.joins_words) == (True, False)
    assert [Q31.literal(v) for v in (-3, 7.0, 0)] == ["-3", "7", "0"]
    assert F64.sources() == ()
    assert [p.name for p in F32.sources()] == ["esea_f32.h", "esea_f32.c", "esea_f32_tables.h"]
    assert "esea_q31.h" in {p.name for p in Q31.sources()}
    assert F32.casadi_c(system) == Q31.casadi_c(system) == F64.templates("p") == {}
    # Those of single precision are all and one more.
    assert F32.notes[:2] == F64.notes
    assert len(F32.notes) == 3
    for f, zero, one in ((F64, "0.0", "1.0"), (F32, "0.0f", "1.0f")):
        sign = f"return (x > {zero}) ? {one} : ((x < {zero}) ? -{one} : {zero});"
        assert sign in f.operations
        assert f"static inline {f.c_type} esea_fmax({f.c_type} x, {f.c_type} y)" in f.operations


def test_casadis_own_c_has_every_kernel_once(system):
    files = casadi_c(system)
    assert set(files) == {f"reference/esea_feeds_casadi.{e}" for e in "ch"}
    header = files["reference/esea_feeds_casadi.h"]
    kernels = set(re.findall(r"^int esea_feeds_casadi_(\w+?)\(const", header, re.MULTILINE))
    assert kernels == {"one_prepare", "one_init", "one_step", "two_init", "two_step",
                       "three_init", "three_step"}  # fmt: skip
    # Arguments keep their names.
    names = re.findall(r'return "(\w+)"', files["reference/esea_feeds_casadi.c"])
    assert {"c_gain", "u_x_Nm", "gain"} <= set(names)


def test_fields_in_units_are_their_ports(system):
    (given,), (y, status) = system.inputs, system.outputs
    one, slow = system.blocks["first"], system.blocks["slow"]
    for fmt in (F64, F32):
        made = fmt.naming(system)
        assert made.number(one, "in", "x_Nm", 0.75) == 0.75
        assert made.tunable(one, "gain", 1.25) == ("gain", 1.25)
        assert (made.fraction(one, "in", "x_Nm"), made.external_fraction(given)) == (None, None)
        assert made.block_scales(one, "in") == made.latch_scales() == ()
        assert made.task_scales(system.tasks[0], "in") == ()
        assert (made.external_scale(given), made.text(one, "in", y.port)) == ("", "")
        assert made.from_units(given, "v") == f"({fmt.c_type})v"
        assert made.to_units(given, "v") == "v"
        assert made.convert("v", None, one, one.inputs[0]) == "v"
        assert made.whole("n", slow, slow.inputs[2]) == f"({fmt.c_type})n"
        assert made.stored(y, [0.1, 2]).dtype == fmt.dtype
        assert made.stored(y, [0.1, 2]).tolist() == [float(fmt.dtype.type(0.1)), 2.0]
        assert made.stored(status, 3.0).dtype == np.uint32
    assert F32.naming(system).literal(1.0) == "1.0f"
    assert F64.naming(system).literal(12.0) == "12.0"


def test_compiled_templates_are_kept_by_the_code_that_fills_them(monkeypatch, tmp_path):
    monkeypatch.setattr(render, "cache_folder", lambda: tmp_path)
    digest = "0123456789abcdef0123"
    monkeypatch.setattr(render, "code_digest", lambda rooms: digest if rooms == ("emit",) else "")
    made = render._compiled.__wrapped__()
    folder = tmp_path / f"templates-0123456789abcdef-{jinja2.__version__}"
    assert made.directory == str(folder)
    assert folder.is_dir()
    assert render._compiled.__wrapped__().directory == str(folder)  # it may be there
    seen = []
    monkeypatch.setattr(
        jinja2.FileSystemBytecodeCache, "dump_bytecode", lambda self, bucket: seen.append(bucket)
    )
    made.dump_bytecode("bucket")
    assert seen == ["bucket"]

    def full(self, bucket):
        raise OSError("no room")

    monkeypatch.setattr(jinja2.FileSystemBytecodeCache, "dump_bytecode", full)
    made.dump_bytecode("bucket")
    monkeypatch.setattr(render, "code_digest", lambda rooms: None)
    assert render._compiled.__wrapped__() is None


def test_the_content_hash_covers_all_that_it_is_given(system, monkeypatch):
    folder = {"b.c": "two", "a.c": "one"}
    monkeypatch.setattr(Renderer, "folder", lambda self: folder)
    made = content_hash(system, "digest", "Feeds", [F64, F32])
    assert len(made) == 16
    assert int(made, 16) >= 0
    assert made == content_hash(system, "digest", "Feeds", [F64, F32])
    others = {content_hash(system, "other", "Feeds", [F64, F32])}
    others.add(content_hash(system, "digest", "Feeds", [F64]))
    for changed in (
        {"a.c": "one", "b.c": "twp"},
        {"a.c": "one", "c.c": "two"},
        {"a.c": "oneb.ctwo"},
    ):
        folder.clear()
        folder.update(changed)
        others.add(content_hash(system, "digest", "Feeds", [F64, F32]))
    folder.clear()
    folder.update({"a.c": "one", "b.c": "two"})  # in any order
    assert content_hash(system, "digest", "Feeds", [F64, F32]) == made
    monkeypatch.setattr(render, "versions", lambda: {"casadi": "another"})
    others.add(content_hash(system, "digest", "Feeds", [F64, F32]))
    assert len(others | {made}) == 7


def test_the_content_hash_covers_the_dialects_templates(system, monkeypatch, tmp_path):
    monkeypatch.setattr(Renderer, "folder", lambda self: {})
    monkeypatch.setattr(render, "template_folder", lambda: tmp_path)
    folder = tmp_path / "dialect"
    folder.mkdir()
    made = []
    for name, text in (("a.j2", "one"), ("a.j2", "two"), ("b.j2", "two"), ("c.txt", "no template")):
        for old in folder.glob("?.j2"):
            if name.endswith(".j2"):
                old.unlink()
        (folder / name).write_text(text)
        made.append(content_hash(system, "digest", "Feeds", [F32]))
    assert len(set(made)) == 3
    assert made[-1] == made[-2]


def test_files_of_every_format(system):
    own = ["esea_feeds.c", "esea_feeds.h", "esea_feeds_one.c", "esea_feeds_real.h",
           "esea_feeds_three.c", "esea_feeds_two.c"]  # fmt: skip
    made = renderer(system, F32)
    made.render = lambda template, **context: template
    assert sorted(made.own_files()) == own
    assert made.own_files()["esea_feeds_one.c"] == "device/esea_block.c.j2"
    assert made.own_files()["esea_feeds_real.h"] == "device/esea_real.h.j2"
    more = ["esea_f32.c", "esea_f32.h", "esea_f32_tables.h"]
    assert sorted(made.files()) == sorted([*own, *more])
    double = renderer(system, F64)
    double.render = made.render
    reference = [f"reference/esea_feeds_casadi.{end}" for end in "ch"]
    assert sorted(double.files()) == [*own, *reference]
    assert sorted(double.folder()) == sorted([*own, *reference, "main.c"])
    whole = renderer(system, Q31)
    whole.render = made.render
    units = {"esea_feeds_units.h": "device/esea_units.h.j2",
             "esea_feeds_units_link.h": "device/esea_units_link.h.j2"}  # fmt: skip
    assert units.items() <= whole.files().items()
    names = [f.link_header("esea_feeds") for f in (F64, F32, Q31)]
    assert names == ["esea_feeds_link.h", "esea_feeds_link.h", "esea_feeds_units_link.h"]


def test_the_example_is_given_its_tolerances_and_the_way_to_its_values(system):
    made, seen = renderer(system, F32), {}
    made.render = lambda template, **context: seen.update(context, template=template)
    made.example()
    assert seen["template"] == "device/main.c.j2"
    # A hundred-thousandth of 8 Nm, to one digit.
    assert seen["tolerances"] == [8e-5]
    assert seen["tunable"]("first", "gain").default == 1.0
    assert seen["task_of"](system.outputs[0]) == "quick"
    (given,) = system.inputs
    assert isinstance(given, External)
    assert seen["from_units"](given, "1.5") == "(float)1.5"
    assert seen["to_units"](given, "x") == "(double)x"
    assert seen["given"](given, 1.0) == "1.0f"


def test_c_is_wrapped_and_other_text_is_not(system, monkeypatch):
    made = renderer(system)
    line = "x = " + "a" * 60 + " + " + "b" * 60 + ";"

    class Template:
        def render(self, **context):
            return f"{line} /* {context['template']} {context['more']} */"

    monkeypatch.setattr(made.env, "get_template", lambda name: Template())
    for name, broken in (("a.c.j2", True), ("b.h.j2", True), ("c.xml.j2", False)):
        text = made.render(name, more="said")
        assert f"/* {name} said */" in text
        assert ("\n" in text) is broken
