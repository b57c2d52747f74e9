"""Choice between fitted models: the cheapest that no other model beats.

A model beats another if its held-out error is smaller by :data:`BETTER` in half of the conditions
or more (never in one alone, where several judge) and in the geometric mean over all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_gen.language.ports import Array

THESIS = "published"
BETTER = 0.05  # share by which an error is smaller
NEGLIGIBLE = 0.1  # % of full scale, added to every error: what is far below does not decide


@dataclass(frozen=True)
class CompareRow:
    """Errors of one model on one split, % of full scale: mean over data sets of the RMS error."""

    model: str
    condition: str
    training: float
    held_out: float
    operations: int | None = None  # of a step; None for a model that no board runs


@dataclass(frozen=True)
class ModelChoice:
    chosen: str
    best: str  # of least geometric mean
    runner_up: str | None  # the best of the others
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return dict(plain(self))


def choose(rows: Sequence[CompareRow], whole: Set[str], costs: Mapping[str, float]) -> ModelChoice:
    """Choose by the conditions left out as a whole, or by the only division there is."""
    judged = [r for r in rows if r.condition in whole] or rows
    conditions = list(dict.fromkeys(r.condition for r in judged))
    cells = {(r.model, r.condition): r.held_out + NEGLIGIBLE for r in judged}
    errors = {m: np.array([cells[m, c] for c in conditions]) for m in costs}
    if not conditions or not np.isfinite(list(errors.values())).all():
        raise UserError(
            "No data are held out to judge the models.",
            "Hold cycles or a condition out, or name the model: --model published.",
        )
    mean = {m: math.exp(float(np.log(e).mean())) for m, e in errors.items()}
    good = [m for m in costs if not any(beats(errors[o], errors[m]) for o in costs)]
    chosen = min(good, key=lambda m: (costs[m], mean[m]))
    best, *_ = ordered = sorted(costs, key=lambda m: mean[m])
    others = [m for m in ordered if m != chosen]
    # A member whose other terms carry nothing is the chosen one again.
    apart = [m for m in others if not np.allclose(errors[m], errors[chosen], rtol=1e-3)]
    second = next(iter(apart or others), None)

    def facts(m: str) -> str:
        return f"{mean[m] - NEGLIGIBLE:.2f} %, {costs[m]:.0f} operations a step"

    def beside(m: str) -> str:
        ratio = errors[m] / errors[chosen]
        ends = dict.fromkeys((f"{ratio.min():.2f}", f"{ratio.max():.2f}"))
        return f"{facts(m)}; by condition {' to '.join(ends)} times the chosen one's error."

    one = len(conditions) == 1
    each = f"{len(conditions)} conditions, each left out of the training as a whole"
    over = f"{conditions[0]} alone" if one else f"geometric mean of {each}"
    reasons = [
        f"Model: '{chosen}', chosen of {len(costs)} by held-out error: {facts(chosen)} ({over}). "
        f"It is the cheapest that no other beats by {100 * BETTER:g} % in half of the conditions "
        "and in the mean. That choice used the held-out data."
    ]
    if second is not None:
        reasons.append(f"Runner-up: '{second}', {beside(second)}")
    if THESIS in costs and THESIS not in (chosen, second):
        reasons.append(f"Published form: {beside(THESIS)}")
    return ModelChoice(chosen, best, second, tuple(reasons))


def beats(errors: Array, other: Array) -> bool:
    """Whether errors, condition by condition, are better than another model's."""
    gain = np.log(errors / other)
    least = math.log(1 - BETTER)
    votes = int(np.sum(gain <= least))
    return votes >= max(len(gain) / 2, min(2, len(gain))) and bool(gain.mean() <= least)
