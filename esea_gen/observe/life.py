"""Cycles of the coupling, counted on the board: rainflow of the deflection, and Miner's damage.

A running reversal counter after ASTM E1049 (5.4.4): turning points wait on a stack; a range that a
later one encloses is a cycle, one that holds the first point is half a cycle.  Cycles go into
classes of their range as whole numbers of halves, so that nothing is lost however long it runs, and
damage is made of the numbers, each range taken at its class' upper edge.

In one period at most one range is taken off the stack and one point put on it.  Each reversal adds
one point, so the stack never lags by more; where it is full the oldest range is counted as half,
and a flag tells.

References
----------
.. [1] ASTM E1049-85 (2017), Standard practices for cycle counting in fatigue analysis.
.. [2] M. A. Miner, "Cumulative damage in fatigue", J. Appl. Mech. 12 (1945) A159.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Array, Equation, Flag, Port, around, flag_word, threshold
from esea_gen.language.stream import OwnStreams, Stream, single
from esea_gen.model.symbolic import equation

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

DEPTH = 16
CLASSES = 10
MOST_HALVES = 2.0**24  # whole numbers that float32 holds
MOST_DAMAGE = 1e3


def class_edges_rad(device: DeviceData) -> Array:
    """Lower edges of the classes of range: ten equal parts of the identified domain, end to end.

    return: rad; the last class is open, up to what the deflection's port allows.
    """
    return 2 * device.file.domain.theta_max_rad.value * np.arange(CLASSES) / CLASSES


def class_damage(device: DeviceData) -> Array:
    """Share of the life that half a cycle of each class takes, by the device's fatigue curve.

    return: N = cycles (range/range_rad)^-exponent at the class' upper edge; zeros where no curve is
        known.
    """
    life = device.file.life
    if life is None:
        raise UserError(f"{device.origin}: section [life] is missing.", "Add it.")
    if life.curve is None:
        return np.zeros(CLASSES)
    last = 2 * device.file.limits.theta_rad.value
    upper = np.append(class_edges_rad(device)[1:], last)
    curve = life.curve
    cycles = curve.cycles.value * (upper / curve.range_rad.value) ** -curve.exponent.value
    return np.asarray(0.5 / cycles)


def life_counter(device: DeviceData) -> Block:
    """Rainflow counter of the deflection.

    Parameters
    ----------
    device : DeviceData
        With ``[life]``.

    Returns
    -------
    Block
        Input ``theta_rad``; outputs ``halves``, half cycles by class of range, ``damage``, the
        share of the life used (0 where no fatigue curve is known), and a status word.

    Raises
    ------
    UserError
        When the device has no ``[life]``, or half a cycle of the largest class takes all of it.
    """
    law = _Life(device)
    return Block.define(
        "life",
        "Cycles of the coupling: rainflow, Miner's damage",
        period_s=device.period_s,
        constants=device.constants("life"),
        state=law.state(),
        inputs=(around("theta_rad", law.limit, "deflection", on_invalid="extreme_rad"),),
        outputs=(
            Port("halves", 0.0, MOST_HALVES, "half cycles by class of range", CLASSES),
            Port("damage", 0.0, MOST_DAMAGE, "share of the life used; 1: as the curve ends"),
            Port("status", 0, 31, "what is known of this count", flags=law.flags()),
        ),
        equations=_equations(),
        step=law.step,
        streams=OwnStreams(_events),
    )


class _Life:
    """Numbers, step and ports."""

    def __init__(self, device: DeviceData) -> None:
        self.edges = [threshold(float(e)) for e in class_edges_rad(device)]
        self.half = class_damage(device)
        if self.half.max() >= 1:
            raise UserError(
                f"{device.origin}: life.curve: half a cycle of the largest range takes "
                f"{self.half.max():.3g} of the life.",
                "Give the curve's range in rad end to end, and its cycles there.",
            )
        life = device.file.life
        assert life is not None
        self.least = threshold(life.least_rad.value)
        self.limit = threshold(device.file.limits.theta_rad.value)

    def step(
        self, c: Any, s: Any, u: Any, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        points = ca.vertsplit(s.points_rad)
        # One range off the stack: the newest encloses the one before it.
        newest = label("newest_rad", ca.fabs(points[0] - points[1]), "range of the last two points")
        before = label("before_rad", ca.fabs(points[1] - points[2]), "range before it")
        closed = label("closed", ca.logic_and(s.depth > 2.5, newest >= before), "[life 1]")
        whole = ca.logic_and(closed, s.depth > 3.5)
        kept = [points[0]]
        for k in range(1, DEPTH):
            twice = points[k + 2] if k + 2 < DEPTH else points[-1]
            kept.append(ca.if_else(whole, twice, points[k]))
        depth = s.depth - ca.if_else(whole, 2.0, 0.0) - ca.if_else(closed, 1.0, 0.0)
        depth = label("left", depth + ca.if_else(whole, 1.0, 0.0), "points left")

        seen = label("seen", ca.logic_or(s.seen, guard.inputs_ok), "a sample has been seen")
        first = ca.logic_and(seen, ca.logic_not(s.seen))
        way = label("way", ca.if_else(s.seen, s.way, 0.0), "1 up, -1 down, 0 not known yet")
        extreme = ca.if_else(s.seen, s.extreme_rad, u.theta_rad)
        moved = u.theta_rad - extreme
        back = label("back_rad", -way * moved, "back from the last extreme")
        turned = label("turned", back > self.least, "[life 2] a turning point")
        started = ca.logic_and(way * way < 0.5, ca.fabs(moved) > self.least)
        ahead = ca.logic_or(back < 0, started)
        sign = ca.if_else(moved > 0, 1.0, -1.0)
        new_way = ca.if_else(ca.logic_or(turned, started), sign, way)
        taken = ca.logic_or(turned, ahead)

        push = label("push", ca.logic_or(turned, first), "a point goes on the stack")
        full = label("full", ca.logic_and(push, depth > DEPTH - 0.5), "no room for it")
        oldest = ca.fabs(kept[-1] - kept[-2])
        stack = [ca.if_else(push, extreme, kept[0])]
        stack += [ca.if_else(push, kept[k - 1], kept[k]) for k in range(1, DEPTH)]
        depth = depth + ca.if_else(push, 1.0, 0.0) - ca.if_else(full, 1.0, 0.0)

        add = ca.if_else(whole, 2.0, 0.0) + ca.if_else(
            ca.logic_and(closed, ca.logic_not(whole)), 1.0, 0.0
        )
        counted = [
            ca.fmin(
                s.halves[k]
                + ca.if_else(self.within(before, k), add, 0.0)
                + ca.if_else(ca.logic_and(full, self.within(oldest, k)), 1.0, 0.0),
                MOST_HALVES,
            )
            for k in range(CLASSES)
        ]
        damage = ca.SX(0)
        for k in range(CLASSES):
            damage = damage + float(self.half[k]) * counted[k]
        damage = label("damage_raw", damage, "[life 3]")
        next_state = {
            "seen": seen,
            "way": new_way,
            "extreme_rad": ca.if_else(taken, u.theta_rad, extreme),
            "depth": depth,
            "points_rad": stack,
            "halves": counted,
        }
        most = counted[0]
        for k in range(1, CLASSES):
            most = ca.fmax(most, counted[k])
        outputs = {
            "halves": counted,
            "damage": ca.fmin(damage, MOST_DAMAGE),
            "status": flag_word(
                [
                    ca.logic_not(guard.inputs_ok),
                    ca.logic_not(guard.state_ok),
                    full,
                    most >= MOST_HALVES,
                    ca.SX(1.0 if not self.half.any() else 0.0),
                ]
            ),
        }
        return next_state, outputs

    def within(self, size: ca.SX, k: int) -> ca.SX:
        above = size >= self.edges[k]
        if k + 1 == CLASSES:
            return above
        return ca.logic_and(above, size < self.edges[k + 1])

    def state(self) -> tuple[Port, ...]:
        return (
            Port("seen", 0.0, 1.0, "1 once a valid sample has been seen"),
            Port("way", -1.0, 1.0, "which way the deflection goes; 0 before it has moved"),
            around("extreme_rad", self.limit, "the farthest since the last turning point"),
            Port("depth", 0.0, DEPTH, "how many turning points wait"),
            around("points_rad", self.limit, "turning points, the newest first", DEPTH),
            Port("halves", 0.0, MOST_HALVES, "half cycles by class of range", CLASSES),
        )

    def flags(self) -> tuple[Flag, ...]:
        return (
            Flag("INPUT_INVALID", "the deflection was NaN or outside its range; not counted", True),
            Flag("STATE_REPAIRED", "the state was corrupt; the count was started afresh", True),
            Flag("STACK_FULL", "more ranges were open than are kept; the oldest is half", True),
            Flag("COUNT_FULL", "a class holds all that it can; what is more is not counted"),
            Flag("CURVE_UNKNOWN", "no fatigue curve is known: damage says nothing"),
        )


def _equations() -> tuple[Equation, ...]:
    x, y = sp.symbols("X Y", positive=True)
    n, life = sp.symbols("n_k N_k", positive=True)
    k = sp.Symbol("k")
    return (
        equation("[life 1]", "c", sp.Ge(x, y), "the range Y before the last one X is closed"),
        equation("[life 3]", "D", sp.Sum(n / (2 * life), (k, 1, CLASSES)), "Miner's damage"),
    )


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    limit = next(p.high for p in block.inputs)
    walk = np.cumsum(rng.normal(0, 0.2, 1500))
    spiral = np.concatenate([(-1) ** k * np.full(3, 0.95 * (1 - k / 60)) for k in range(50)])
    return [
        Stream("cycles of any size", {"theta_rad": single(0.95 * limit * np.sin(walk))}),
        Stream("ever smaller", {"theta_rad": single(limit * spiral)}),
    ]


__all__ = ["CLASSES", "DEPTH", "class_damage", "class_edges_rad", "life_counter"]
