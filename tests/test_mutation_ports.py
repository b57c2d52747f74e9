"""Faults of a Block's ports, counters and kernels, line by line of its C."""

from __future__ import annotations

import difflib
from types import SimpleNamespace

import casadi as ca
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task
from esea_gen.verify.mutation.mutants import mutants


def plain_block() -> Block:
    """Without tunables, with one state: there its outputs alone are tried."""
    return Block.define(
        "b",
        "b",
        period_s=0.001,
        state=(Port("m", -4.0, 4.0, "m"),),
        inputs=(Port("x", -1.0, 1.0, "x", on_invalid=0.0),),
        outputs=(Port("y", -4.0, 4.0, "y"), Port("z", -4.0, 4.0, "z")),
        step=lambda c, s, u, guard, label: ({"m": u.x}, {"y": s.m, "z": u.x}),
    )


def small_block() -> Block:
    """Two coefficients, two states, a vector, two numbers and a status word with one counter."""

    def step(c, s, u, _guard, _label):
        word = flag_word([u.x > c.g, u.x < s.m])
        outputs = {"y": ca.vertcat(s.m, s.n, s.n), "z": u.x, "w": c.h, "status": word}
        return {"m": s.n + c.g, "n": s.m * c.h}, outputs

    ends = ("g", 1.0), ("h", 0.5)
    flags = (Flag("ABOVE", "above", counted=True), Flag("BELOW", "below"))
    return Block.define(
        "b",
        "b",
        period_s=0.001,
        tunables=tuple(Tunable(n, d, 0.0, 2.0, n, "test", "assumed") for n, d in ends),
        coefficients=tuple(Port(n, 0.0, 2.0, n) for n, _ in ends),
        prepare=lambda t: {"g": t.g, "h": t.h},
        state=(Port("m", -4.0, 4.0, "m"), Port("n", -4.0, 4.0, "n", init=0.5)),
        inputs=(Port("x", -1.0, 1.0, "x", on_invalid=0.0),),
        outputs=(
            *(Port("z", -4.0, 4.0, "z"), Port("y", -4.0, 4.0, "y", size=3)),
            *(Port("w", -4.0, 4.0, "w"), Port("status", 0, 3, "s", flags=flags)),
        ),
        step=step,
    )


NOW = "state->n_above += (((out->status & ESEA_SMALL_B_ABOVE)"
REST = "&& (state->n_above != UINT32_MAX))"
# Of all that a function writes, the lines that a fault takes out and puts in.
FAULTS = f"""
prepare: assignment dropped: coefficients g
- coeffs->g = g;
prepare: written to the wrong field: coefficients g to h
- coeffs->g = g;
+ coeffs->h = g;
prepare: assignment dropped: coefficients h
- coeffs->h = h;
prepare: written to the wrong field: coefficients h to g
- coeffs->h = h;
+ coeffs->g = h;
init: assignment dropped: state m
- state->m = 0.0f;
init: written to the wrong field: state m to n
- state->m = 0.0f;
+ state->n = 0.0f;
init: assignment dropped: state n
- state->n = 0.5f;
init: written to the wrong field: state n to m
- state->n = 0.5f;
+ state->m = 0.5f;
step: assignment dropped: state m
- state->m = m_next;
step: written to the wrong field: state m to n
- state->m = m_next;
+ state->n = m_next;
step: assignment dropped: state n
- state->n = n_next;
step: written to the wrong field: state n to m
- state->n = n_next;
+ state->m = n_next;
step: assignment dropped: outputs z
- out->z = x_used;
step: written to the wrong field: outputs z to w
- out->z = x_used;
+ out->w = x_used;
step: assignment dropped: outputs y
- out->y[0] = m_used;
- out->y[1] = n_used;
- out->y[2] = n_used;
step: written to the wrong element: outputs y[0] and [1]
- out->y[0] = m_used;
- out->y[1] = n_used;
+ out->y[0] = n_used;
+ out->y[1] = m_used;
step: assignment dropped: outputs w
- out->w = h;
step: written to the wrong field: outputs w to z
- out->w = h;
+ out->z = h;
step: assignment dropped: outputs status
- out->status = (uint32_t)status;
step: counter wraps: ABOVE
- {NOW} != 0u) {REST}
- ? 1u : 0u;
+ {NOW} != 0u)) ? 1u : 0u;
step: counter inverted: ABOVE
- {NOW} != 0u) {REST}
+ {NOW} == 0u) {REST}
step: counter counts always: ABOVE
- {NOW} != 0u) {REST}
- ? 1u : 0u;
+ state->n_above += ((state->n_above != UINT32_MAX)) ? 1u : 0u;
step: counter sticks: ABOVE
- {NOW} != 0u) {REST}
- ? 1u : 0u;
+ {NOW.replace("+=", "=")} != 0u)) ? 1u : 0u;
"""
KERNELS = """
prepare: read from the wrong field: argument 0[0] = argument 0[0]  ->  argument 1[0]
- const float g = params->g;
- coeffs->g = g;
+ coeffs->g = h;
prepare: read from the wrong field: argument 1[0] = argument 1[0]  ->  argument 0[0]
- const float h = params->h;
- coeffs->h = h;
+ coeffs->h = g;
init: constant off by one: result 0[0] = 0.0  ->  1.0
- state->m = 0.0f;
+ state->m = 1.0f;
init: constant off by 1 %: result 1[0] = 0.5  ->  0.5049999952316284
- state->n = 0.5f;
+ state->n = 0.505f;
init: constant off by 1 ulp: result 1[0] = 0.5  ->  0.5000000596046448
- state->n = 0.5f;
+ state->n = 0.50000006f;
"""


@pytest.fixture(scope="module")
def system():
    block = small_block()
    outputs = {n: f"b.{n}" for n in ("z", "y", "w", "status")}
    return System(
        "small", 0.001, {"b": block}, (Task("run", ("b",)),), {}, {"x": ("b.x",)}, outputs
    )


@pytest.fixture(scope="module")
def made(system):
    return mutants(SimpleNamespace(system=system, name="small"), "f32")


def changes(system, chosen) -> list[str]:
    renderer = Renderer(system, FORMATS["f32"], 64 * "0", "command", "title")
    emitted = renderer.emitted["b"]
    sound = renderer.render(emitted.template, e=emitted).splitlines()
    told = []
    for m in chosen:
        assert (m.file, m.block.name) == ("esea_small_b.c", "b")
        lines = difflib.unified_diff(sound, m.text(renderer).splitlines(), n=0)
        changed = [f"{x[0]} {x[1:].strip()}" for x in lines if x[:3] not in ("---", "+++", "@@ ")]
        told.append(f"{m.function}: {m.kind}: {m.place}")
        told += sorted((x for x in changed if x[2:]), key=lambda x: x[0] == "+")
    return told


def test_a_fault_of_a_port_or_counter_changes_its_lines_and_no_other(system, made):
    ports = [m for m in made if m.block is not None and m.kernel is None]
    assert changes(system, ports) == FAULTS.strip().splitlines()


def test_a_fault_of_a_kernel_is_printed_where_it_stands(system, made):
    of = [m for m in made if m.function in ("prepare", "init") and m.kernel is not None]
    assert changes(system, of) == KERNELS.strip().splitlines()
    step = [m for m in made if m.function == "step" and m.kernel is not None]
    told = {(m.kind, m.place): m for m in step}
    # Values bear the names that a reader of the C sees; status words lose bits, not rounding.
    (swapped,) = (m for (k, _), m in told.items() if k == "+ to -")
    assert changes(system, [swapped])[1:] == [
        *("- const float m_next = n_used + g;", "+ const float m_next = n_used - g;"),
    ]
    dropped = [m for (k, _), m in told.items() if k == "status flag dropped"]
    words = [[x for x in changes(system, [m]) if x.startswith("+ const uint32_t")] for m in dropped]
    assert sorted(words) == [
        ["+ const uint32_t status = esea_bit(g < x_used, 0u);"],
        ["+ const uint32_t status = esea_bit(x_used < m_used, 1u);"],
    ]
    # Coefficients, states and inputs are confused with their like alone.
    wrong = {p for k, p in told if k == "read from the wrong field"}
    assert wrong == {
        f"argument {a}[0] = argument {a}[0]  ->  argument {b}[0]"
        for a, b in ((0, 1), (1, 0), (2, 3), (3, 2))
    }


def test_a_block_without_tunables_prepares_nothing():
    block = plain_block()
    outputs = {n: f"b.{n}" for n in ("y", "z")}
    alone = System(
        "small", 0.001, {"b": block}, (Task("run", ("b",)),), {}, {"x": ("b.x",)}, outputs
    )
    found = [m for m in mutants(SimpleNamespace(system=alone, name="small"), "f32") if m.block]
    assert {m.function for m in found} == {"init", "step"}
    ports = [(m.function, m.place) for m in found if m.kernel is None]
    assert ports == [("step", f"outputs {p}") for p in ("y", "y to z", "z", "z to y")]
