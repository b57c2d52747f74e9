"""Search for the plan of a Block: which values need 64 bits.

Everything is 32 bits wide where that keeps the proven error of the outputs below the aim.  Else
those values have 64 bits inside the step that would have few significant bits where they are
smallest, that lose bits to a range which a clip cuts off again, or that lead to a root; then one
after the other is put back to 32 bits where the aim, or what could be reached of it, still holds.
For a Block that does not forget its errors the aim is that of one step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from esea_gen.emit.fixed.errors import Propagation, any_bound
from esea_gen.emit.fixed.plan import (
    BlockPlan,
    Planner,
    coefficients_raw,
    defined,
    lowered_values,
    raw_places,
    run_lowered,
)
from esea_gen.emit.fixed.values import LoweringError, best_fraction
from esea_gen.emit.spans import RangeError
from esea_gen.emit.step_errors import BEYOND, linear_bound
from esea_gen.emit.walker import Kernel
from esea_gen.language.block import Block

AIM = 5e-5
"""Aim of the plan: proven error of an output over the larger end of its port's range, unless the
port asks for a finer one."""

SIGNIFICANT_BITS = 28
"""What a value that stays away from zero keeps at its small end, of 31, or is held in 64 bits."""


def _shortfall(block: Block, outputs: Mapping[str, float]) -> float:
    # How far the worst output is above the aim; at most 1 when the aim is met.
    return max(
        (
            outputs[p.name] * p.finer / (AIM * max(abs(p.low), abs(p.high)))
            for p in block.outputs
            if not p.flags
        ),
        default=0.0,
    )


@dataclass(frozen=True)
class _Tried:
    # A plan, how far it is above the aim, and the state errors that a step starts from.
    plan: BlockPlan
    score: float
    states: dict[str, float]
    forgets: bool
    linear: bool = False

    @property
    def rank(self) -> tuple[bool, float]:
        return not self.forgets, self.score


def _try(planner: Planner, wide: Mapping[int, str]) -> _Tried | None:
    try:
        plan = planner.plan(wide)
    except LoweringError:
        if not wide:
            raise
        return None
    try:
        bound = any_bound(plan, planner.known)
    except RangeError:
        return _Tried(plan, math.inf, {}, False)
    forgets = math.isinf(bound.steps)
    states = bound.states if forgets else dict.fromkeys(bound.states, 0.0)
    score = _shortfall(plan.block, bound.outputs)
    return _Tried(plan, score, states, forgets, bound.method == "linear")


def _still_bounded(
    planner: Planner, wide: Mapping[int, str], found: _Tried, ceiling: float
) -> BlockPlan | None:
    # The plan, if its outputs stay below the ceiling: state errors that are a bound already must
    # stay one, which a single step tells; a linear Block's bound is no induction, but summed.
    block, room = planner.block, 0.0 if found.forgets else BEYOND
    errors = [[found.states[p.name] * ceiling / found.score] * p.size for p in block.state]
    try:
        plan = planner.plan(wide)
        step = Propagation(plan, room=room, known=planner.known[room])
        if found.linear:
            local = step.state_errors(step.once(step.zero)[0])
            summed = linear_bound(block, local, step.known)
            assert summed is not None
            errors = summed
        result, _ = step.once(errors)
    except (LoweringError, RangeError):
        return None
    pairs = zip(step.state_errors(result), errors, strict=True)
    holds = all(n <= e for new, old in pairs for n, e in zip(new, old, strict=True))
    holds = holds or found.linear or not found.forgets
    return plan if holds and _shortfall(block, step.outputs(result)) <= ceiling else None


def _small_ends(plan: BlockPlan) -> dict[int, int]:
    # Significant bits at the small end of every value whose computed range stays away from zero.
    out = {}
    for i, v in enumerate(plan.step.values):
        if v is None or v.expr.bits != 32 or plan.step.kernel.nodes[i].op == "input":
            continue
        least = min(abs(v.expr.low), abs(v.expr.high))
        if v.expr.low <= 0 <= v.expr.high:
            # A fact of algebra may exclude zero where intervals do not.
            if i in plan.facts:
                out[i] = 0
            continue
        if plan.step.kernel.nodes[i].op != "sign":
            out[i] = least.bit_length()
    return out


def _clipped(plan: BlockPlan, inner: bool = False) -> dict[int, str]:
    # Values that lose bits to a range which the clip behind them then cuts off, and what they are
    # chosen from; with ``inner`` also the first half of a clip at two ends.
    nodes, out = plan.step.kernel.nodes, {}
    for n in nodes:
        if n.op not in ("fmin", "fmax"):
            continue
        for first, other in (n.args, n.args[::-1]):
            half = nodes[first].op in ("fmin", "fmax")
            if nodes[other].op != "const" or (half and not inner):
                continue
            limit, todo = Fraction(nodes[other].value), [first]
            while todo:
                k = todo.pop()
                v = plan.step.values[k]
                if v is None or nodes[k].op == "input":
                    continue
                lost = best_fraction(limit, limit) - v.fraction
                if lost > 0 and v.expr.bits == 32:
                    out[k] = f"its range before the clip takes {lost} bits that the clip gives back"
                    if nodes[k].op in ("select", "if_else_zero"):
                        todo += nodes[k].args[1:]
    return out


def _with_terms(kernel: Kernel, why: Mapping[int, str]) -> dict[int, str]:
    # A sum is as fine as its terms: what a wide sum is made of is wide too.
    out = dict(why)
    for i in why:
        n = kernel.nodes[i]
        if n.op in ("add", "sub"):
            for a in n.args:
                if kernel.nodes[a].op not in ("input", "const") and not kernel.nodes[a].boolean:
                    out.setdefault(a, f"is a term of v{i}, which is held in 64 bits")
    return out


def _flat_roots(plan: BlockPlan) -> dict[int, str]:
    # A root magnifies what is near zero: its argument, and what that is made of, as fine as can be.
    nodes, out = plan.step.kernel.nodes, {}
    todo = []
    for i, n in enumerate(nodes):
        if n.op == "sqrt" or (n.op == "pow" and 0 < nodes[n.args[1]].value < 1):
            todo.append(n.args[0])
            if n.op == "pow":
                out[i] = "is a root, steep near zero"
    while todo:
        i = todo.pop()
        n, v = nodes[i], plan.step.values[i]
        if (
            v is None
            or i in out
            or n.op not in ("add", "sub", "neg", "fabs", "mul", "if_else_zero")
        ):
            continue
        out[i] = "leads to a root, which magnifies its rounding near zero"
        todo += n.args
    return out


def coarse_values(plan: BlockPlan) -> dict[int, str]:
    """Values that are coarser than the port which they lead to by sums, choices and products.

    An intermediate sum of a filter can be larger than any of its states, and a value before its
    clip larger than the clip lets through.
    """
    nodes, targets = plan.step.kernel.nodes, dict[int, int]()
    fields = (*plan.fields["state"], *plan.fields["out"])
    for r, f in zip(plan.step.kernel.results, fields, strict=True):
        if not f.word:
            for i in r:
                targets[i] = max(f.fraction, targets.get(i, f.fraction))
    out = {}
    for i in reversed(range(len(nodes))):
        v = plan.step.values[i]
        if i not in targets or v is None or nodes[i].boolean or nodes[i].op == "input":
            continue
        if nodes[i].op not in _LINEAR:
            continue
        lost = targets[i] - v.fraction
        if lost > 0 and v.expr.bits == 32:
            out[i] = f"{lost} bits coarser than the port that it leads to"
        for a in nodes[i].args[nodes[i].op in ("select", "if_else_zero") :]:
            targets[a] = max(targets[i], targets.get(a, targets[i]))
    return out


_LINEAR = frozenset({"add", "sub", "neg", "twice", "mul", "fmin", "fmax", "select", "if_else_zero"})


PROBE_STEPS = 48
RESIDUAL_SHARE = 0.25
"""Most that the residual of a solved value may fill of what is allowed, on the probe's steps."""


def _probe(plan: BlockPlan) -> float:
    # Largest share of the allowed residuals over a run with inputs of growing size, where exact
    # arithmetic solves the equation at all.
    block, fields = plan.block, plan.fields
    node = {name: i for i, (name, _) in plan.labels.items()}
    places = raw_places("coeffs", fields["coeffs"], [[c] for c in coefficients_raw(plan)])
    exact = list(block.simulator().coefficients.values())
    state = run_lowered(plan.init, places, 1)
    worst = 0.0
    for k in range(PROBE_STEPS):
        wave = math.sin(0.4 * k) * 10.0 ** (-3.0 + 2.0 * k / PROBE_STEPS)
        given = [[[f.raw(wave * f.port.high)] * f.port.size] for f in fields["in"]]
        now = [[[int(e[0]) for e in r]] for r in state]
        here = places | raw_places("state", fields["state"], now)
        here |= raw_places("in", fields["in"], given)
        numbers = [
            [x * f.lsb for x in row[0]]
            for group, rows in (("state", now), ("in", given))
            for f, row in zip(fields[group], rows, strict=True)
        ]
        solution = dict(
            zip(
                block.labelled_step.name_out(),
                block.labelled_step.call([*exact, *numbers]),
                strict=True,
            )
        )
        here = defined(plan.step, here, 1)
        values = lowered_values(plan.step, here, 1)
        for s in block.solved.values():
            if abs(float(solution[f"label_{s.residual}"])) > RESIDUAL_SHARE * s.most:
                continue  # the equation has no solution within its limits
            i = node[s.residual]
            if i not in values:
                continue  # its range alone decides its flag, so that nothing computes it
            found = plan.step.values[i]
            assert found is not None
            worst = max(worst, abs(int(values[i][0])) * 2.0**-found.fraction / s.most)
        state = run_lowered(plan.step, here, 1)[: len(fields["state"])]
    return worst


def _with_way(planner: Planner, plan: BlockPlan) -> BlockPlan:
    # The way to a solved value in 64 bits where 32 leave too large a residual.  The bound does not
    # depend on it, so that it may be tried.
    share = _probe(plan) if plan.block.solved else 0.0
    if share <= RESIDUAL_SHARE:
        return plan
    followed = Propagation(plan).followed
    why = dict(plan.why_wide)
    for i, n in enumerate(planner.kernel.nodes):
        if i not in followed and n.op not in ("input", "const", "sign") and not n.boolean:
            why[i] = f"leads to a solved value whose residual would fill {100 * share:.0f} %"
    return planner.plan(why)


def search(planner: Planner) -> BlockPlan:
    return _with_way(planner, _searched(planner))


def _searched(planner: Planner) -> BlockPlan:
    first = _try(planner, {})
    assert first is not None
    plan = first.plan
    significant, roots, clipped = _small_ends(plan), _flat_roots(plan), _clipped(plan)
    short = {
        i: f"would keep {b} significant bits of 31 where it is smallest"
        for i, b in significant.items()
        if b < SIGNIFICANT_BITS
    }
    wide = clipped | _with_terms(planner.kernel, short)
    halves = clipped | _clipped(plan, inner=True)
    coarse = {i: f"would be {why}" for i, why in coarse_values(plan).items()}
    # What merely leads to a solved value is judged by its residual: 64 bits there gain no bound.
    followed = Propagation(plan).followed
    levels = [
        {i: why for i, why in level.items() if i in followed}
        for level in (
            clipped,
            halves,
            wide,
            wide | roots,
            coarse | halves,
            coarse | halves | wide | roots,
        )
    ]
    found, seen = first, [frozenset[int]()]
    for level in levels:
        if found.forgets and found.score <= 1:
            break
        if frozenset(level) in seen:
            continue
        seen.append(frozenset(level))
        tried = _try(planner, level)
        if tried is not None and tried.rank < found.rank:
            found = tried
    best, score = found.plan, found.score
    if not best.wide or not math.isfinite(score):
        return best
    ceiling = max(1.0, 1.02 * score)
    # Back to 32 bits as many together as may be, for most may: where one too many does, the halves.
    waiting, many = sorted(best.wide), 1
    while waiting:
        group = waiting[:many]
        fewer = {k: r for k, r in best.why_wide.items() if k not in group}
        narrower = _still_bounded(planner, fewer, found, ceiling)
        if narrower is None and len(group) > 1:
            many = len(group) // 2
        else:
            best, waiting, many = narrower or best, waiting[many:], 2 * many if narrower else 1
    return best
