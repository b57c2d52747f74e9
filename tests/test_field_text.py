"""Fields as C: names, declarations, formats, conversions and what a header says of them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.fixed.kept import plan_block, raw_tunable
from esea_gen.emit.fixed.plan import FieldPlan, Planner, coefficients_raw
from esea_gen.emit.fixed.render import field_text, format_text, print_lowered, quantity
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer, block_kernels, identity, port_text
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task

ALL = ("f64", "f32", "q31")


def gain(name: str, given: Port, made: Port, every: int = 1, **more) -> Block:
    def step(c, _s, u, _guard, _label):
        y = 0.25 * getattr(u, given.name)
        if given.size > 1:
            y = y[0]
        out = {made.name: y * (c.gain if more else 1)}
        return {}, out | {"status": flag_word([y > 0, y < -0.25])}

    flags = (Flag("RISES", "it rises", True), Flag("FALLS", "it falls"))
    return Block.define(
        name,
        name.title(),
        period_s=0.001 * every,
        state=(),
        inputs=(given,),
        outputs=(made, Port("status", 0, 3, "what it does", flags=flags)),
        step=step,
        **more,
    )


@pytest.fixture(scope="module")
def system() -> System:
    tuned = {
        "tunables": (Tunable("gain", 1.0, 0.5, 1.5, "factor"),),
        "coefficients": (Port("gain", 0.5, 1.5, "factor"),),
        "prepare": lambda t: {"gain": 1 * t.gain},
    }
    blocks = {
        "first": gain(
            "first",
            Port("x_rad", -1.0, 1.0, "angles", 2, "3.1"),
            Port("a_Nm", -4.0, 4.0, "torque", equation="4.2"),
            **tuned,
        ),
        "second": gain("second", Port("a_Nm", -1.0, 1.0, "in"), Port("b_Nm", -64.0, 64.0, "out")),
        "third": gain("third", Port("b_Nm", -1e9, 1e9, "in", ), Port("c", -1e10, 1e10, "out")),
        "same": gain("same", Port("a_Nm", -4.0, 4.0, "in"), Port("e_Nm", -1.0, 1.0, "out")),
        "last": gain("last", Port("a_Nm", -16.0, 16.0, "in"), Port("d_Nm", -1.0, 1.0, "out"), 2),
    }  # fmt: skip
    return System(
        "tiny",
        0.001,
        blocks,
        (Task("quick", ("first", "second", "third", "same")), Task("slow", ("last",), every=2)),
        {
            "second.a_Nm": "first.a_Nm",
            "third.b_Nm": "second.b_Nm",
            "last.a_Nm": "first.a_Nm",
            "same.a_Nm": "first.a_Nm",
        },
        {"x_rad": ("first.x_rad",)},
        {"c": "third.c", "d_Nm": "last.d_Nm", "status": "first.status"},
    )


@pytest.fixture(scope="module")
def rendered(system) -> dict[str, Renderer]:
    return {r: Renderer(system, FORMATS[r], "0123", "esea-gen build", "Tiny") for r in ALL}


def ports(system: System) -> dict[str, Port]:
    return {f"{i}.{p.name}": p for i, b in system.blocks.items() for p in (*b.inputs, *b.outputs)}


def test_declarations(system, rendered):
    block, found = system.blocks["first"], ports(system)
    for real, c_type in (("f64", "double"), ("f32", "float"), ("q31", "int32_t")):
        field = rendered[real].field
        assert field(found["first.x_rad"], block, "in") == f"{c_type} x_rad[2];"
        assert field(found["first.a_Nm"], block, "out") == f"{c_type} a_Nm;"
        assert field(found["first.status"], block, "out") == "uint32_t status;"


def test_what_feeds_an_input(system, rendered):
    found = ports(system)
    latch = system.latches[0].name
    plain = {
        ("first", "x_rad", "[1]"): "in->x_rad[1]",
        ("second", "a_Nm", ""): "first_out.a_Nm",
        ("third", "b_Nm", ""): "second_out.b_Nm",
        ("same", "a_Nm", ""): "first_out.a_Nm",
        ("last", "a_Nm", ""): f"state->slow_held.{latch}",
    }
    # Torques of 4 in 28 bits behind the point go to 30 of one of 1, and to 26 of 16; 64 has 24 of
    # them, a thousand million one.
    whole = plain | {
        ("second", "a_Nm", ""): "esea_q31_saturate(first_out.a_Nm * (INT64_C(1) << 2))",
        ("third", "b_Nm", ""): "esea_q31_round(second_out.b_Nm, 23)",
        ("last", "a_Nm", ""): f"esea_q31_round(state->slow_held.{latch}, 2)",
    }
    for real in ALL:
        for (instance, name, at), text in (whole if real == "q31" else plain).items():
            assert rendered[real].feed(instance, found[f"{instance}.{name}"], at) == text


def test_scales_of_structs_tasks_and_latches(system, rendered):
    naming = rendered["q31"].naming
    first, third = system.blocks["first"], system.blocks["third"]
    assert naming.block_scales(first, "in") == (
        "#define ESEA_TINY_FIRST_IN_X_RAD_FRACTION 30 /* Q1.30, one unit is 9.31e-10 rad */",
    )
    assert naming.block_scales(first, "out") == (
        "#define ESEA_TINY_FIRST_OUT_A_NM_FRACTION 28 /* Q3.28, one unit is 3.73e-09 Nm */",
    )
    assert naming.block_scales(third, "out") == (
        "#define ESEA_TINY_THIRD_OUT_C_FRACTION (-3) /* Q34.-3, one unit is 8 */",
    )
    whole = FieldPlan(Port("n", 0, 9, "count"), 0, 0, 9)
    assert naming._scale("N", whole) == "#define N 0 /* whole number, one unit is 1 */"
    quick, slow = system.tasks
    assert [s.split(" /*")[0] for s in naming.task_scales(quick, "in")] == [
        "#define ESEA_TINY_QUICK_IN_X_RAD_FRACTION 30"
    ]
    assert [s.split(" /*")[0] for s in naming.task_scales(quick, "out")] == [
        "#define ESEA_TINY_QUICK_OUT_C_FRACTION (-3)"
    ]
    assert [s.split(" /*")[0] for s in naming.task_scales(slow, "out")] == [
        "#define ESEA_TINY_SLOW_OUT_D_NM_FRACTION 30"
    ]
    (latch,) = system.latches
    (scale,) = naming.latch_scales()
    assert scale.startswith(f"#define ESEA_TINY_LATCHES_{latch.name.upper()}_FRACTION 28 ")
    for real in ("f64", "f32"):
        plain = rendered[real].naming
        assert plain.block_scales(first, "in") == plain.task_scales(quick, "in") == ()
        assert plain.latch_scales() == ()


def test_numbers_of_external_values(system, rendered):
    (x,) = system.inputs
    c, d, status = system.outputs
    naming = rendered["q31"].naming
    macros = [naming.external_scale(e) for e in (x, d)]
    assert macros == ["ESEA_TINY_QUICK_IN_X_RAD_FRACTION", "ESEA_TINY_SLOW_OUT_D_NM_FRACTION"]
    assert [naming.external_fraction(e) for e in (x, c, d, status)] == [30, -3, 30, None]
    assert naming.from_units(x, "v") == f"ESEA_Q31_FROM(v, {macros[0]})"
    assert naming.to_units(d, "v") == f"ESEA_Q31_TO(v, {macros[1]})"
    assert naming.to_units(status, "v") == "v"
    assert naming.stored(x, [0.5, -0.25]).tolist() == [2**29, -(2**28)]
    assert naming.stored(status, [3]).dtype == np.uint32
    assert naming.fraction(system.blocks["first"], "out", "a_Nm") == 28
    for real, c_type in (("f64", "double"), ("f32", "float")):
        plain = rendered[real].naming
        assert plain.from_units(x, "v") == f"({c_type})v"
        assert (plain.to_units(d, "v"), plain.external_scale(d)) == ("v", "")
        assert (plain.external_fraction(d), plain.fraction(None, "in", "x")) == (None, None)
        assert plain.stored(x, 0.5).dtype == FORMATS[real].dtype
        assert plain.stored(status, 1).dtype == np.uint32
    renderer = rendered["q31"]
    assert renderer.in_units(d, "v") == f"ESEA_Q31_TO(v, {macros[1]})"
    assert renderer.given(x, 0.5) == f"ESEA_Q31_FROM(0.5, {macros[0]})"
    assert rendered["f32"].in_units(d, "v") == "(double)v"
    assert rendered["f32"].given(x, 0.5) == "0.5f"


def test_numbers_of_fields_and_of_the_watch(system, rendered):
    first, third = system.blocks["first"], system.blocks["third"]
    found = ports(system)
    a, b = found["first.a_Nm"], found["third.b_Nm"]
    for real, half, billion in (
        ("f64", "0.5", "10.0"),
        ("f32", "0.5f", "10.0f"),
        ("q31", str(2**27), "20"),
    ):
        assert rendered[real].literal(first, "out", a, 0.5) == half
        assert rendered[real].literal(third, "in", b, 10.0) == billion
    on = Block.define(
        "on",
        "On",
        period_s=0.001,
        state=(),
        inputs=(Port("ok", 0, 1, "ok"), Port("level", 0, 12, "level")),
        outputs=(Port("y", 0, 1, "y"),),
        step=lambda c, s, u, g, label: ({}, {"y": u.ok * 0.5 + 0 * u.level}),
    )
    ok, level = on.inputs
    for real, one, least, text in (
        ("f64", "1.0", "0.0", "(double)(w < 12u ? w : 12u)"),
        ("f32", "1.0f", "0.0f", "(float)(w < 12u ? w : 12u)"),
        # 1 in 30 bits behind the point; 12 in 27.
        ("q31", "1073741824", "0", "(int32_t)((w < 12u ? w : 12u) << 27)"),
    ):
        naming = rendered[real].naming
        assert naming.watched("w", on, ok) == f"w == 1u ? {one} : {least}"
        assert naming.watched("w", on, level) == text


def test_a_tunable_of_any_value(system, rendered):
    first = system.blocks["first"]
    for value, raw in (
        (1.0, 2**30),
        (-0.25, -(2**28)),
        (1.0 + 2.0**-31, 2**30 + 1),  # a half upwards
        (1.0 + 2.0**-32, 2**30),
        (2.0 - 2.0**-29, 2**31 - 2),
        (2.0 - 2.0**-30, -(2**31)),  # refused by prepare, as is all that does not fit
        (-2.0, -(2**31)),
        (float("nan"), -(2**31)),
        (float("inf"), -(2**31)),
    ):
        assert raw_tunable(first, "gain", value) == ("gain", raw)
        assert rendered["q31"].naming.tunable(first, "gain", value) == ("gain", raw)
    assert rendered["f32"].naming.tunable(first, "gain", 0.5) == ("gain", 0.5)


def test_what_a_header_says_of_a_port(system, rendered):
    found = ports(system)
    x, a = found["first.x_rad"], found["first.a_Nm"]
    assert port_text(x) == "angles; 2 elements; [rad], range -1 to 1; eq. 3.1"
    assert port_text(a) == "torque; [Nm], range -4 to 4; eq. 4.2"
    assert port_text(found["third.c"]) == "out; [dimensionless], range -1e+10 to 1e+10"
    assert port_text(found["first.status"]) == "what it does; bits below"
    first = system.blocks["first"]
    raw = "raw -1073741824 to 1073741824, Q3.28, one unit is 3.73e-09 Nm; cannot overflow"
    assert rendered["q31"].port_text(a, first, "out") == f"{port_text(a)}; {raw}"
    assert (
        rendered["q31"].port_text(a) == rendered["f32"].port_text(a, first, "out") == port_text(a)
    )


def test_what_is_said_of_a_fields_numbers():
    assert (quantity(0.001234, "Nm"), quantity(8.0, "1")) == ("0.00123 Nm", "8")
    whole = FieldPlan(Port("n", 0, 9, "count"), 0, 0, 9)
    assert format_text(whole) == "whole number, one unit is 1"
    m = FieldPlan(Port("m_rad", -1, 1, "m"), 30, -(2**30), 2**30)
    text = "raw -1073741824 to 1073741824, Q1.30, one unit is 9.31e-10 rad"
    for group, more in (
        ("params", "; outside: refused"),
        ("coeffs", "; cut to it by prepare"),
        ("state", "; cannot overflow; outside: corrupt"),
        ("in", ""),
        ("out", "; cannot overflow"),
    ):
        assert field_text(m, group) == text + more
    pair = FieldPlan(Port("m_rad", -1, 1, "m", 2), 30, -(2**30), 2**30)
    assert field_text(pair, "state") == text + "; cannot overflow"  # checked by its sum
    held = FieldPlan(m.port, 30, -5, 7, True)
    assert field_text(held, "coeffs") == (
        "raw -5 to 7, Q1.30, one unit is 9.31e-10 rad; cut to it by prepare; "
        "outside -1073741824 to 1073741824: found by the step"
    )
    word = FieldPlan(Port("s", 0, 1, "w", flags=(Flag("A", "a"),)), 0, 0, 1)
    assert field_text(word, "out") == ""


def test_counters_names_and_kernels(system, rendered):
    first = system.blocks["first"]
    renderer = rendered["f32"]
    status = next(p for p in first.outputs if p.flags)
    bit = "ESEA_TINY_FIRST_RISES"
    assert renderer.counter(first, status, status.flags[0]) == (
        f"state->n_rises += (((out->status & {bit}) != 0u) && (state->n_rises != UINT32_MAX)) "
        "? 1u : 0u;"
    )
    assert renderer.counter(first, status, status.flags[0], "{n} {port} {bit}") == (
        f"state->n_rises status {bit}"
    )
    assert (renderer.prefix, renderer.identity) == ("esea_tiny", "esea_tiny_f32_0123")
    assert renderer.init_name == "esea_tiny_init_f32_0123"
    assert identity("esea_tiny", FORMATS["f64"], "") == "esea_tiny_f64"
    assert set(block_kernels(first)) == {"init", "step", "prepare"}
    assert set(block_kernels(system.blocks["second"])) == {"init", "step"}
    files = {f"esea_tiny_{n}.c" for n in ("first", "second", "third", "same", "last")}
    files |= {"esea_tiny.h", "esea_tiny.c", "esea_tiny_real.h"}
    assert set(renderer.own_files()) == files
    beside = {
        "f64": {f"reference/esea_tiny_casadi{e}" for e in (".c", ".h")},
        "f32": {"esea_f32.h", "esea_f32.c", "esea_f32_tables.h"},
        "q31": {"esea_q31.h", "esea_q31.c", "esea_f32_tables.h", "esea_q31_units.h",
                "esea_tiny_units.h", "esea_tiny_units_link.h"},
    }  # fmt: skip
    for real, more in beside.items():
        found = rendered[real].files()
        assert set(found) == files | more
        assert all(found[p.name] == p.read_text() for p in FORMATS[real].sources())


def test_a_printed_plan_reads_what_it_uses(system):
    plan = plan_block(system.blocks["first"])
    made = print_lowered(plan.step)
    # Of coefficients and inputs: two structs.
    assert made.used_arguments == frozenset({0, 1})
    reads = {s.expression for s in made.statements if "->" in s.expression}
    assert reads == {"coeffs->gain", "in->x_rad[0]", "in->x_rad[1]"}
    assert [s.c_type for s in made.statements if s.name == "status"] == ["uint32_t"]
    assert {s.c_type for s in made.statements} <= {"int32_t", "int64_t", "uint32_t", "bool"}
    prepared = print_lowered(plan.prepare)
    assert prepared.used_arguments == frozenset({0})
    assert {s.expression for s in prepared.statements if "->" in s.expression} == {"params->gain"}


def test_formats_of_prepared_coefficients_come_from_what_prepare_can_make():
    """Of t from 0.5 to 1.5: thirds, a square cut by its port, a number, and what fills its port."""
    made = (
        # Name, what it is, port, bits of the fraction, ends.
        ("third", lambda t: t / 3, (0.0, 9.0), 31, (1 / 6, 0.5)),
        ("square", lambda t: t * t, (0.5, 2.0), 29, (0.5, 2.0)),
        ("fixed", lambda t: ca.SX(0.375), (0.0, 9.0), 32 - 1, (0.375, 0.375)),
        ("most", lambda t: 40 * t, (0.0, 50.0), 25, (20.0, 50.0)),
        ("minus", lambda t: -t, (-9.0, 9.0), 30, (-1.5, -0.5)),
    )
    block = Block.define(
        "prepared",
        "Prepared",
        period_s=0.001,
        tunables=(Tunable("t", 1.0, 0.5, 1.5, "tunes"),),
        coefficients=tuple(Port(n, *ends, n) for n, _, ends, _, _ in made),
        prepare=lambda t: {n: f(t.t) for n, f, *_ in made},
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "in"),),
        outputs=(Port("y", -999.0, 999.0, "out"),),
        step=lambda c, s, u, g, label: (
            {}, {"y": u.x_rad * (c.third + c.square + c.fixed + c.most + c.minus)},
        ),
    )  # fmt: skip
    plan = Planner(block).plan()
    for (name, _, _, fraction, ends), f in zip(made, plan.fields["coeffs"], strict=True):
        assert (f.name, f.fraction) == (name, fraction)
        assert (f.low * f.lsb, f.high * f.lsb) == pytest.approx(ends, abs=4 * f.lsb)
    given = {n: f(0.75) for n, f, *_ in made} | {"fixed": 0.375, "square": 0.5625}
    for f, (raw,) in zip(plan.fields["coeffs"], coefficients_raw(plan, {"t": 0.75}), strict=True):
        assert raw * f.lsb == pytest.approx(given[f.name], abs=2 * f.lsb)
    # Cut where the port ends: a square of 0.25 is told as 0.5, and forty of 1.5 as 50.
    low, high = coefficients_raw(plan, {"t": 0.5}), coefficients_raw(plan, {"t": 1.5})
    fields = plan.fields["coeffs"]
    assert low[1][0] == fields[1].low
    assert high[3][0] == fields[3].high
