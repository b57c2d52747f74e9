"""Plan of a Block in q31: formats of its ports, its kernels in integers, their execution."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from esea_gen.emit.checks import coefficient_checks
from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.lowering import Kept, Lowering, rewrite
from esea_gen.emit.fixed.values import FieldPlan, LoweredKernel, Source, best_fraction
from esea_gen.emit.local_names import meanings, parts, stem
from esea_gen.emit.printed import field_type
from esea_gen.emit.spans import Known
from esea_gen.emit.step_errors import BEYOND
from esea_gen.emit.walker import Kernel, fuse_selects, labelled_kernel, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, Tunable

MOST_PORT_FRACTION = 31


def port_fraction(port: Port | Tunable) -> int:
    """Fraction bits of a port, from its range alone."""
    if field_type(port, ""):
        return 0
    return min(best_fraction(Fraction(port.low), Fraction(port.high)), MOST_PORT_FRACTION)


@dataclass(frozen=True)
class BlockPlan:
    block: Block
    fields: Mapping[str, tuple[FieldPlan, ...]]
    prepare: LoweredKernel | None
    init: LoweredKernel
    step: LoweredKernel
    facts: Mapping[int, tuple[float, float]]  # algebraic ranges of nodes of the step
    why_wide: Mapping[int, str]  # nodes of the step held in 64 bits
    labels: Mapping[int, tuple[str, str]]

    @property
    def wide(self) -> frozenset[int]:
        return frozenset(self.why_wide)

    def field(self, group: str, name: str) -> FieldPlan:
        return next(f for f in self.fields[group] if f.port.name == name)


def _field(port: Port | Tunable, fraction: int) -> FieldPlan:
    scale = Fraction(2) ** fraction
    low, high = math.ceil(Fraction(port.low) * scale), math.floor(Fraction(port.high) * scale)
    return FieldPlan(port, fraction, low, high)


def _place(pointer: str, f: FieldPlan, element: int) -> str:
    index = "" if f.port.size == 1 else f"[{element}]"
    text = f"{pointer}->{f.name}{index}"
    return f"(int32_t){text}" if f.word else text


def _sources(*groups: tuple[str, tuple[FieldPlan, ...]]) -> Any:
    flat = [(pointer, f) for pointer, fields in groups for f in fields]

    def source(argument: int, element: int) -> Source:
        pointer, f = flat[argument]
        base = stem(f.port.name) + ("_now" if pointer == "state" else "")
        base += "" if f.port.size == 1 else f"_{element}"
        # Inputs and states can hold any bit pattern, as coefficients can that the step checks; what
        # prepare made of the others is trusted.
        free = pointer in ("state", "in")
        low, high = ex.INT32 if free else f.port_range if f.checked else (f.low, f.high)
        bits = 32
        if f.whole and not f.word:
            bits, (low, high) = -32, ex.UINT32
        port = f.port.name + ("" if f.port.size == 1 else f"[{element}]")
        return Source(
            base, _place(pointer, f, element), f.fraction, low, high, port, f.port, f.checked, bits
        )

    return source


def _prepare(
    block: Block, params: tuple[FieldPlan, ...]
) -> tuple[LoweredKernel | None, tuple[FieldPlan, ...]]:
    if not block.tunables:
        return None, ()
    kernel = rewrite(fuse_selects(walk(block.prepare)))
    source = _sources(("params", params))
    # It runs only when a tunable changes: 64 bits throughout.
    wide = range(len(kernel.nodes))
    nodes = Kernel(kernel.name, kernel.nodes, ())
    ranges = Lowering(nodes, source, wide=wide, block=block.name).run(())
    fields = []
    for p, r in zip(block.coefficients, kernel.results, strict=True):
        low, high = Fraction(p.high), Fraction(p.low)
        for i in r:
            v = ranges.values[i]
            ends = (v.low, v.high) if v else (Fraction(kernel.nodes[i].value),) * 2
            low, high = min(low, ends[0]), max(high, ends[1])
        low, high = max(low, Fraction(p.low)), min(high, Fraction(p.high))
        fraction = 0 if p.whole else min(best_fraction(low, high), MOST_PORT_FRACTION)
        f = _field(p, fraction)
        scale = Fraction(2) ** fraction
        least, most = math.floor(low * scale), math.ceil(high * scale)
        fields.append(FieldPlan(p, fraction, max(f.low, least), min(f.high, most)))
    others = meanings(block, "prepare", kernel, stem)
    made = Lowering(kernel, source, wide=wide, block=block.name, others=others).run(fields, True)
    return made, tuple(fields)


def _fields(ports: Iterable[Any]) -> tuple[FieldPlan, ...]:
    return tuple(_field(p, port_fraction(p)) for p in ports)


class Planner:
    """Makes plans of one Block with different sets of wide values.

    known: what analyses of its plans found, by the room of a Propagation.
    """

    def __init__(self, block: Block) -> None:
        self.block = block
        self.kernel, labels = labelled_kernel(block, lambda k: rewrite(fuse_selects(k)))
        self.labels = {node: (name, comment) for node, name, comment in labels}
        self.facts = {node: block.facts[n] for node, n, _ in labels if n in block.facts}
        self.kept = Kept()
        self.known = {room: Known() for room in (0.0, BEYOND)}
        others = meanings(block, "step", self.kernel, stem)
        self.others = parts(self.kernel, others | {i: name for i, (name, _) in self.labels.items()})
        params = _fields(block.tunables)
        self.prepare, made = _prepare(block, params)
        checked = coefficient_checks(block, self.kernel)
        self.checks = frozenset[int]().union(*checked.values())
        coeffs = tuple(replace(f, checked=k in checked) for k, f in enumerate(made))
        self.fields = {
            "params": params,
            "coeffs": coeffs,
            "state": _fields(block.state),
            "in": _fields(block.inputs),
            "out": _fields(block.outputs),
        }
        init = rewrite(fuse_selects(walk(block.init)))
        lowering = Lowering(init, _sources(("coeffs", coeffs)), block=block.name, ports=block.state)
        self.init = lowering.run(self.fields["state"])

    def plan(self, why: Mapping[int, str] | None = None) -> BlockPlan:
        """Lower the step with a set of wide values, and why each is wide."""
        wide, block = dict(why or {}), self.block
        lowering = Lowering(
            self.kernel,
            _sources(*((g, self.fields[g]) for g in ("coeffs", "state", "in"))),
            self.labels,
            self.facts,
            frozenset(wide),
            block.flag_results,
            self.checks,
            block.name,
            self.others,
            (*block.state, *block.outputs),
            self.kept,
        )
        step = lowering.run((*self.fields["state"], *self.fields["out"]))
        made = self.prepare, self.init, step
        return BlockPlan(block, self.fields, *made, self.facts, wide, self.labels)


# -- running a plan --------------------------------------------------------------------------------


def run_lowered(
    lowered: LoweredKernel, places: Mapping[str, ex.Array], count: int
) -> list[list[ex.Array]]:
    """Evaluate a lowered kernel with the bits of its C."""
    values = defined(lowered, places, count)
    return [[ex.evaluate(e, values, count) for e in r] for r in lowered.results]


def lowered_values(
    lowered: LoweredKernel, places: Mapping[str, ex.Array], count: int
) -> dict[int, ex.Array]:
    """Raw number of every value of a lowered kernel that its results need."""
    values = defined(lowered, places, count)
    there = values.keys()
    return {
        i: ex.evaluate(v.expr, values, count)
        for i, v in enumerate(lowered.values)
        if v is not None and ex.names(v.expr) <= there
    }


def defined(
    lowered: LoweredKernel, places: Mapping[str, ex.Array], count: int
) -> dict[str, ex.Array]:
    """``places`` with every name that the C of a lowered kernel defines."""
    values = dict(places)
    for s in lowered.steps:
        if s.name not in values:
            values[s.name] = ex.evaluate(s.expr, values, count)
    return values


def raw_places(
    pointer: str, fields: Sequence[FieldPlan], columns: Sequence[Any]
) -> dict[str, ex.Array]:
    out = {}
    for f, c in zip(fields, columns, strict=True):
        table = np.asarray(c, dtype=object).reshape(-1, f.port.size)
        for k in range(f.port.size):
            held = [int(v) & ex.UINT32[1] if f.whole else int(v) for v in table[:, k]]
            out[_place(pointer, f, k)] = np.array(held, dtype=object)
    return out


def coefficients_raw(
    plan: BlockPlan, tunables: Mapping[str, float] | None = None
) -> list[list[int]]:
    """Raw coefficients that the C's ``prepare`` gives."""
    if plan.prepare is None:
        return []
    values = plan.block.default_tunables() | dict(tunables or {})
    raw = [[f.raw(values[f.port.name])] for f in plan.fields["params"]]
    results = run_lowered(plan.prepare, raw_places("params", plan.fields["params"], raw), 1)
    return [[int(e[0]) for e in r] for r in results]
