"""Stop operators over a horizon, with sensitivities: the elastomer's memory in a rollout.

In a sound state |E_i - E_j| <= |r_i - r_j|: the saturated (tied) operators are always the first
few, all on the same side, and their play states follow the deflection.  Work arises only when one
is tied or let go.  The sensitivity of a free one's play state is that of the deflection when it
was let go.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.predictive.horizon import Horizon, Stops
from esea_gen.control.predictive.kernels import plus, same, take_from, zero
from esea_gen.language.builder import Builder
from esea_gen.language.ports import clip
from esea_gen.language.statements import Ix, Memory, Ref


# delta, ahead: deflection, last and next; tau, slope: torque, and stiffness of the free ones; back:
# by input, the sensitivity of the free ones' play torque.
class StopRollout:
    """Writes the parts that carry stop operators from one deflection to the next."""

    def __init__(self, b: Builder, stops: Stops, horizon: Horizon, *shared: Memory) -> None:
        self.b, self.z, self.n = b, horizon, horizon.intervals
        self.delta, self.ahead, self.tau, self.slope, self.back = shared
        n, steps = self.n, horizon.intervals * horizon.substeps
        self.steps = steps
        self.count = count = len(stops.r)
        self.play = b.array("play", count, meaning="play states of the stop operators")
        self.tied = b.count("tied", count, "how many are tied: the first ones")
        self.sense = b.array("sense", 1, meaning="side on which they are tied, 1 or -1")
        self.base = b.array("base", 1, meaning="play torque of the free ones")
        self.weight = b.array("weight", 1, meaning="weight of those tied together")
        # Those let go together are a group.  Groups are stacked: the newest is first in order.
        self.groups = b.count("groups", count + 1, "how many groups of free operators", low=1)
        self.first = b.count("first", count + 1, "first one whose history is not yet taken")
        self.group_end = b.count("group_end", count + 1, "where each group ends", count + 1)
        let_go = "substep in which each was let go"
        self.group_since = b.count("group_since", steps, let_go, count + 1)
        sensitivity = "sensitivity of the deflection, by substep"
        self.history = b.array("history", (steps + 1) * n, meaning=sensitivity)
        r, p = np.array(stops.r), np.array(stops.p)
        upto = [float(np.sum((r * p)[:i])) for i in range(count + 1)]
        free = [float(np.sum(p[i:])) for i in range(count + 1)]
        let = [float(np.sum(p[:i])) for i in range(count + 1)]
        active = [-(-t // horizon.substeps) for t in range(steps + 1)]
        self.t_r = b.table("stop_r", r, "thresholds")
        self.t_p = b.table("stop_p", p, "weights")
        self.t_gap = b.table("stop_gap", np.diff(r, prepend=0.0), "threshold differences")
        self.t_tied = b.table("stop_tied", upto, "torque of the tied ones, by their number")
        self.t_free = b.table("stop_free", free, "stiffness of the free ones, by the number tied")
        self.t_let = b.table("stop_let", let, "what is let go")
        # Inputs that can matter at the end of substep t: those of intervals begun before it.
        self.columns = b.index_table("columns", active, "active inputs")
        self.number = b.index_table("number", range(steps + 1), "an index, for a kernel")

    def write(self) -> None:
        """The parts; ``roll`` with the number of the substep is one step of all operators."""
        z, count, steps = self.z, self.count, self.steps
        turn, more, stop = (self.b.flag(n, region="local") for n in ("turn", "more", "stop_here"))
        self._let_go(count, 2 * sum(-(-t // z.substeps) for t in range(steps)))
        self._tie(count, steps + z.delay_substeps, stop)
        self._roll_on(count, turn, more)

    def _let_go(self, count: int, most: int) -> None:
        # Each call lets go at most one group, and leaves at most one of them partly tied.
        b, weight = self.b, self.weight
        tied, groups = self.tied.at(0), self.groups.at(0)
        with (
            b.part(
                "lose", "since", comment="Take the history of a group of operators that are tied."
            ) as (since,),
            b.loop(0, self.columns.at(since), most=self.n, total=most) as j,
        ):
            b.call(
                "lose",
                [self.back[j], weight[0], self.history[since * self.n + j]],
                [self.back[j]],
                take_from,
            )

        # Both are rare: what nearly every call needs stands alone in "roll".
        with b.part(
            "let_go", "t", comment="Let go all that are tied, where the deflection was: one group."
        ) as (t,):
            with b.loop(0, tied, most=count) as i:
                b.call(
                    "let_go",
                    [self.delta[0], self.sense[0], self.t_r[i], self.t_p[i], self.base[0]],
                    [self.play[i], self.base[0]],
                    _let_go,
                )
            b.call(
                "push",
                [
                    *(self.t_let[tied], self.tied[0], self.number[t]),
                    *(self.groups[0], self.sense[0]),
                ],
                [
                    *(weight[0], self.group_end[groups], self.group_since[groups]),
                    *(self.groups[0], self.tied[0], self.sense[0]),
                ],
                lambda weight, tied, now, count, sense: (weight, tied, now, count + 1, 0, -sense),
            )
            with b.loop(0, self.columns.at(t), most=self.n) as j:
                b.call(
                    "gain",
                    [self.back[j], weight[0], self.history[t * self.n + j]],
                    [self.back[j]],
                    plus,
                )

    def _tie(self, count: int, rolls: int, stop: Memory) -> None:
        b, tied, first = self.b, self.tied.at(0), self.first.at(0)
        with b.part("tie", comment="Tie those that the deflection has moved beyond their stops."):
            b.call("first", [self.tied[0]], [self.first[0]], same)
            with b.loop(tied, count, most=count) as i:
                b.call(
                    "stays",
                    [self.ahead[0], self.sense[0], self.play[i], self.t_r[i]],
                    [stop[0]],
                    lambda *known: ca.logic_not(_beyond(*known)),
                )
                b.exit_if(stop[0])
                b.call(
                    "tie",
                    [self.play[i], self.t_p[i], self.base[0], self.tied[0]],
                    [self.base[0], self.tied[0]],
                    lambda play, p, base, tied: (base - p * play, tied + 1),
                )
            with b.when((first, "<", tied)):
                self._take_histories(count, rolls)

    def _roll_on(self, count: int, turn: Memory, more: Memory) -> None:
        b, tied = self.b, self.tied.at(0)
        with b.part(
            "roll",
            "t",
            comment="Stop operators, exactly, from one deflection to the next, with sensitivities.",
        ) as (t,):
            with b.when((0, "<", tied)):
                b.call(
                    "turned",
                    [self.ahead[0], self.delta[0], self.sense[0]],
                    [turn[0]],
                    lambda new, old, sense: sense * (new - old) < 0,
                )
                with b.when(turn[0]):
                    b.invoke("let_go", t)
            with b.otherwise():
                b.call(
                    "direction",
                    [self.ahead[0], self.delta[0]],
                    [self.sense[0]],
                    lambda new, old: ca.if_else(new < old, -1, 1),
                )
            with b.when((tied, "<", count)):
                b.call(
                    "beyond",
                    [self.ahead[0], self.sense[0], self.play[tied], self.t_r[tied]],
                    [more[0]],
                    _beyond,
                )
                with b.when(more[0]):
                    b.invoke("tie")
            b.call(
                "torque",
                [self.t_tied[tied], self.t_free[tied], self.base[0], self.sense[0], self.ahead[0]],
                [self.tau[0], self.slope[0]],
                lambda held, free, base, sense, new: (sense * held + (free * new - base), free),
            )
            b.call("on", [self.ahead[0]], [self.delta[0]], same)

    def _take_histories(self, count: int, rolls: int) -> None:
        b, weight = self.b, self.weight
        tied, first, groups = self.tied.at(0), self.first.at(0), self.groups.at(0)
        stop = b.flag("whole", region="local")
        # What groups were tied whole; each had been let go in a call before.
        with b.loop(0, count + 1, total=2 * rolls) as _:
            b.call(
                "whole",
                [self.group_end[groups - 1], self.tied[0]],
                [stop[0]],
                lambda end, tied: end > tied,
            )
            b.exit_if(stop[0])
            b.call(
                "weight",
                [
                    *(self.t_let[self.group_end.at(groups - 1)], self.t_let[first]),
                    self.group_end[groups - 1],
                ],
                [weight[0], self.first[0]],
                lambda end, start, first: (end - start, first),
            )
            b.invoke("lose", self.group_since.at(groups - 1))
            b.call("pop", [self.groups[0]], [self.groups[0]], lambda k: k - 1)
        with b.when((first, "<", tied)):
            b.call(
                "weight",
                [self.t_let[tied], self.t_let[first]],
                [weight[0]],
                lambda end, start: end - start,
            )
            b.invoke("lose", self.group_since.at(groups - 1))

    def sensitivity(self, t: Ix, j: Ix) -> Ref:
        """Where the deflection's sensitivity to an input goes at the end of a substep."""
        return self.history[(t + 1) * self.n + j]

    def start(self, play: Memory) -> None:
        """Take over measured play states; the deflection is known."""
        b = self.b
        stop = b.array("stop_state", 1, "local")
        # Nested as the operators themselves keep it, whatever the input holds.
        b.call("none", [], [stop[0]], zero)
        b.call("none", [], [self.base[0]], zero)
        with b.loop(0, self.count, unroll=True) as i:
            b.call(
                "nest",
                [*(self.delta[0], play[i], self.t_gap[i], self.t_p[i]), *(stop[0], self.base[0])],
                [stop[0], self.play[i], self.base[0]],
                _nest,
            )
        # Those that were never let go have no history; their group is never taken whole.
        b.call(
            "bottom",
            [],
            [self.groups[0], self.group_end[0], self.group_since[0]],
            lambda: (1, self.count + 1, 0),
        )
        b.call(
            "loose",
            [self.t_free[0], self.base[0], self.delta[0]],
            [self.tau[0], self.tied[0], self.sense[0], self.slope[0]],
            lambda free, base, delta: (free * delta - base, 0, 1, free),
        )


def _beyond(new: Any, sense: Any, play: Any, r: Any) -> Any:
    return sense * (new - play) > r


def _let_go(delta: Any, sense: Any, r: Any, weight: Any, base: Any) -> Any:
    # As it will be taken again, so that the rounding goes too.
    play = delta - sense * r
    return play, base + weight * play


def _nest(delta: Any, play: Any, gap: Any, weight: Any, stop: Any, base: Any) -> Any:
    held = clip(delta - play, stop - gap, stop + gap)
    kept = delta - held
    return held, kept, base + weight * kept
