"""Faults of the wiring: of a System small enough to list every one by hand."""

from __future__ import annotations

import difflib

import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task
from esea_gen.verify.mutation.wiring import TEMPLATE, wiring_faults


def block(name, inputs, outputs, tunables=(), period_s=0.001):
    """Every output is the sum of the inputs; ``status`` is a status word."""

    def step(c, s, u, guard, label):
        total = sum(getattr(u, i) for i in inputs)
        word = flag_word([total > 0])
        return {}, {o: word if o == "status" else total for o in outputs}

    flags = (Flag("ABOVE", "above 0"),)
    return Block.define(
        name,
        name,
        period_s=period_s,
        state=(),
        inputs=tuple(Port(i, -1.0, 1.0, i, on_invalid=0.0) for i in inputs),
        outputs=tuple(
            Port(o, 0.0, 1.0, o, flags=flags) if o == "status" else Port(o, -3.0, 3.0, o)
            for o in outputs
        ),
        tunables=tunables,
        coefficients=tuple(Port(t.name, t.low, t.high, "as given") for t in tunables),
        prepare=(lambda t: {x.name: getattr(t, x.name) for x in tunables}) if tunables else None,
        step=step,
    )


@pytest.fixture(scope="module")
def small():
    """Two tasks: 1 kHz and, two ticks later, 250 Hz, which gets a value and gives one."""
    gain = Tunable("gain", 1.0, 0.0, 2.0, "gain", "test", "assumed")
    blocks = {
        "one": block("one", ("a", "b"), ("p", "q", "status")),
        "two": block("two", ("c", "d"), ("z",)),
        "slow": block("slow", ("e",), ("r", "s"), (gain,), 0.004),
    }
    tasks = (Task("fast", ("one", "two")), Task("late", ("slow",), every=4, phase=2))
    wires = {"two.c": "one.p", "two.d": "slow.r", "slow.e": "one.q"}
    inputs = {"x": ("one.a",), "y": ("one.b",)}
    outputs = {"z": "two.z", "p": "one.p", "s": "slow.s"}
    return System("small", 0.001, blocks, tasks, wires, inputs, outputs)


# Every fault, as it is told, and the lines of C that it takes out and puts in.
FAULTS = """
wire from the wrong source: one.a from y instead of x
- one_in.a = in->x;
+ one_in.a = in->y;
wires swapped: one.a and one.b
- one_in.a = in->x;
- one_in.b = in->y;
+ one_in.a = in->y;
+ one_in.b = in->x;
wire cut: one.a
- one_in.a = in->x;
wire from the wrong source: one.b from x instead of y
- one_in.b = in->y;
+ one_in.b = in->x;
wire cut: one.b
- one_in.b = in->y;
wire from the wrong source: two.c from one.q instead of one.p
- two_in.c = one_out.p;
+ two_in.c = one_out.q;
wires swapped: two.c and two.d
- two_in.c = one_out.p;
- two_in.d = state->fast_held.slow_r;
+ two_in.c = state->fast_held.slow_r;
+ two_in.d = one_out.p;
wire cut: two.c
- two_in.c = one_out.p;
wire cut: two.d
- two_in.d = state->fast_held.slow_r;
wire cut: slow.e
- slow_in.e = state->late_held.one_q;
output dropped: z
- out->z = two_out.z;
output dropped: p
- out->p = one_out.p;
output from the wrong source: p from one.q
- out->p = one_out.p;
+ out->p = one_out.q;
output from the wrong source: s from slow.r
- out->s = slow_out.s;
+ out->s = slow_out.r;
latch dropped: slow_r
- state->pending.slow_r = 0.0f;
- state->latched.slow_r = 0.0f;
- if (running == 0u) { /* else half of it may be written */
- state->latched.slow_r = state->pending.slow_r;
- }
- state->pending.slow_r = slow_out.r;
latch from the wrong source: slow_r from s
- state->pending.slow_r = slow_out.r;
+ state->pending.slow_r = slow_out.s;
latch dropped: one_q
- state->pending.one_q = 0.0f;
- state->latched.one_q = 0.0f;
- if (running == 0u) { /* else half of it may be written */
- state->latched.one_q = state->pending.one_q;
- }
- state->pending.one_q = one_out.q;
latch from the wrong source: one_q from p
- state->pending.one_q = one_out.q;
+ state->pending.one_q = one_out.p;
order of Blocks: fast: two before one
- esea_small_two_in_t two_in;
- esea_small_two_out_t two_out;
- two_in.c = one_out.p;
- two_in.d = state->fast_held.slow_r;
- esea_small_two_step(&state->two, &two_in, &two_out);
+ esea_small_two_in_t two_in;
+ esea_small_two_out_t two_out;
+ two_in.c = one_out.p;
+ two_in.d = state->fast_held.slow_r;
+ esea_small_two_step(&state->two, &two_in, &two_out);
release of a task: fast: {'release': 2}
- /* Task fast: 1 ticks after the start of each of its runs. */
- if (tick >= 1u) {
+ /* Task fast: 2 ticks after the start of each of its runs. */
+ if (tick >= 2u) {
period of a task: fast: {'every': 2, 'release': 1}
- if (tick >= 1u) {
- {
+ if (tick >= 1u && (tick - 1u) % 2u == 0u) {
+ if (tick % 2u == 0u) {
release of a task: late: {'release': 3}
- /* Task late: 4 ticks after the start of each of its runs. */
- if (tick >= 6u && (tick - 6u) % 4u == 0u) {
+ /* Task late: 3 ticks after the start of each of its runs. */
+ if (tick >= 5u && (tick - 5u) % 4u == 0u) {
release of a task: late: {'release': 5}
- /* Task late: 4 ticks after the start of each of its runs. */
- if (tick >= 6u && (tick - 6u) % 4u == 0u) {
+ /* Task late: 5 ticks after the start of each of its runs. */
+ if (tick >= 7u && (tick - 7u) % 4u == 0u) {
period of a task: late: {'every': 5, 'release': 4}
- if (tick >= 6u && (tick - 6u) % 4u == 0u) {
- if (tick >= 2u && (tick - 2u) % 4u == 0u) {
+ if (tick >= 6u && (tick - 6u) % 5u == 0u) {
+ if (tick >= 2u && (tick - 2u) % 5u == 0u) {
phase of a task: late: {'phase': 3}
- if (tick >= 6u && (tick - 6u) % 4u == 0u) {
- if (tick >= 2u && (tick - 2u) % 4u == 0u) {
+ if (tick >= 7u && (tick - 7u) % 4u == 0u) {
+ if (tick >= 3u && (tick - 3u) % 4u == 0u) {
tunable's default off by 1 %: slow.gain: 1.0099999904632568 instead of 1.0
- params->slow.gain = 1.0f;
+ params->slow.gain = 1.01f;
tunable's default off by 1 ulp: slow.gain: 1.0000001192092896 instead of 1.0
- params->slow.gain = 1.0f;
+ params->slow.gain = 1.0000001f;
tunable's low off by 1 %: slow.gain: 1.0 instead of 0.0
- if (!(params->slow.gain >= 0.0f && params->slow.gain <= 2.0f))
+ if (!(params->slow.gain >= 1.0f && params->slow.gain <= 2.0f))
tunable's low off by 1 ulp: slow.gain: 1.401298464324817e-45 instead of 0.0
- if (!(params->slow.gain >= 0.0f && params->slow.gain <= 2.0f))
+ if (!(params->slow.gain >= 1.0e-45f && params->slow.gain <= 2.0f))
tunable not checked: slow.gain: -3.0000000054977558e+38 instead of 0.0
- if (!(params->slow.gain >= 0.0f && params->slow.gain <= 2.0f))
+ if (!(params->slow.gain >= -3.0e+38f && params->slow.gain <= 2.0f))
tunable's high off by 1 %: slow.gain: 2.0199999809265137 instead of 2.0
- if (!(params->slow.gain >= 0.0f && params->slow.gain <= 2.0f))
+ if (!(params->slow.gain >= 0.0f && params->slow.gain <= 2.02f))
tunable's high off by 1 ulp: slow.gain: 1.9999998807907104 instead of 2.0
- if (!(params->slow.gain >= 0.0f && params->slow.gain <= 2.0f))
+ if (!(params->slow.gain >= 0.0f && params->slow.gain <= 1.9999999f))
tunable not checked: slow.gain: 3.0000000054977558e+38 instead of 2.0
- if (!(params->slow.gain >= 0.0f && params->slow.gain <= 2.0f))
+ if (!(params->slow.gain >= 0.0f && params->slow.gain <= 3.0e+38f))
"""


def test_every_fault_changes_the_lines_that_it_names(small):
    renderer = Renderer(small, FORMATS["f32"], 64 * "0", "command", "title")
    sound = renderer.render(TEMPLATE).splitlines()
    told = []
    for kind, place, text in wiring_faults(small, FORMATS["f32"]):
        lines = difflib.unified_diff(sound, text(renderer).splitlines(), n=0)
        changed = [f"{x[0]} {x[1:].strip()}" for x in lines if x[:3] not in ("---", "+++", "@@ ")]
        # What goes before what comes: the order is the listing's, not the file's.
        told += [
            f"{kind}: {place}",
            *sorted((x for x in changed if x[2:]), key=lambda x: x[0] == "+"),
        ]
    assert told == FAULTS.strip().splitlines()
