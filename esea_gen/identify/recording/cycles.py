"""Cycles of a recording, and the data sets that they make."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from esea_gen.identify.recording.tables import Cycles
from esea_gen.language.ports import Array

Role = Literal["lead_in", "transition", "conditioning", "training", "held_out", "rest"]


@dataclass(frozen=True)
class Cycle:
    """One cycle, from a reversal to the next one of the same kind."""

    start: int
    stop: int
    amplitude_rad: float  # half of the deflection's range
    block: int  # number of the block of equal amplitude, from 0
    role: Role


@dataclass(frozen=True)
class DataSet:
    """Samples of one error figure: a block of equal amplitude, or a complete file."""

    label: str
    amplitude_rad: float  # median amplitude of its cycles
    training: npt.NDArray[np.intp]
    held_out: npt.NDArray[np.intp]
    cycles: dict[str, int]
    asymmetry: float | None  # of the stiffness; None: deflection to one side
    work_first_J: float | None  # loss of its first full cycle
    work_last_J: float | None  # and of its last

    @property
    def softening(self) -> float | None:
        """Share of the first cycle's loss that the last one no longer has (Mullins, scragging)."""
        if self.work_first_J is None or self.work_last_J is None or self.work_first_J <= 0:
            return None
        return 1 - self.work_last_J / self.work_first_J


def reversals(theta: Array, threshold: float) -> list[int]:
    """Find the turning points of a deflection, first and last sample included."""
    points = [0]
    direction, best = 0, 0
    low = high = 0
    values = theta.tolist()
    for i, x in enumerate(values):
        if direction == 0:
            low = i if x < values[low] else low
            high = i if x > values[high] else high
            if x > values[low] + threshold:
                direction, best = 1, i
                if low > 0:
                    points.append(low)
            elif x < values[high] - threshold:
                direction, best = -1, i
                if high > 0:
                    points.append(high)
        elif direction * x > direction * values[best]:
            best = i
        elif direction * x < direction * values[best] - threshold:
            points.append(best)
            direction, best = -direction, i
    if points[-1] != len(values) - 1:
        points.append(len(values) - 1)
    return points


def divide(theta: Array, rules: Cycles, use: str) -> tuple[Cycle, ...]:
    """Divide a recording into cycles and give each its role."""
    # A cycle runs from one reversal to the next of the same kind. Before the first reversal is the
    # lead-in; a cycle that no neighbour equals in amplitude leads from one block to the next, and
    # so does the last one of a block that ends where the next, smaller one begins.
    points = reversals(theta, rules.hysteresis * float(np.ptp(theta)))
    # Loaded to one side, a specimen rests at the recording's ends: they are reversals.
    one_sided = theta.min() > -0.1 * theta.max() or theta.max() < -0.1 * theta.min()
    starts = points[::2] if one_sided else points[1:-1:2]
    spans = list(itertools.pairwise(starts))
    amplitude = [0.5 * float(np.ptp(theta[a : b + 1])) for a, b in spans]
    block, blocks = 0, []
    reference = 0.0
    for i, x in enumerate(amplitude):
        if i == 0:
            reference = x
        elif abs(x - reference) > rules.block_tolerance * reference:
            block, reference = block + 1, x
        blocks.append(block)
    # The way down to a smaller amplitude has the range of the larger one, and is no closed loop.
    open_ended = [
        after != block and abs(theta[b] - theta[a]) > rules.block_tolerance * x
        for (a, b), x, block, after in zip(spans, amplitude, blocks, blocks[1:], strict=False)
    ]
    open_ended.append(False)
    roles: list[Role] = []
    for i, b in enumerate(blocks):
        size, place = blocks.count(b), i - blocks.index(b)
        alone = size == 1 and len(blocks) > 1
        size -= open_ended[blocks.index(b) + size - 1]
        if use != "cycles":
            roles.append("training" if use == "train" else "held_out")
        elif open_ended[i] or alone:
            roles.append("transition")
        elif place < rules.skip_first:
            roles.append("conditioning")
        elif place >= size - rules.held_out_last:
            roles.append("held_out")
        else:
            roles.append("training")
    return tuple(
        Cycle(a, b, x, n, role)
        for (a, b), x, n, role in zip(spans, amplitude, blocks, roles, strict=True)
    )


def _stiffness_asymmetry(theta: Array, tau: Array) -> float | None:
    high, low = int(theta.argmax()), int(theta.argmin())
    if min(theta[high], -theta[low]) <= 0.2 * max(theta[high], -theta[low]):
        return None
    positive, negative = tau[high] / theta[high], tau[low] / theta[low]
    return float(2 * (positive - negative) / (positive + negative))


def loop_work_J(theta: Array, tau: Array, cycle: Cycle) -> float:
    x, y = theta[cycle.start : cycle.stop + 1], tau[cycle.start : cycle.stop + 1]
    return float(np.trapezoid(y, x))


def _one_set(
    label: str,
    theta: Array,
    tau: Array,
    cycles: Sequence[Cycle],
    use: str,
    spoilt: npt.NDArray[np.bool_],
) -> DataSet:
    whole = use != "cycles"
    if whole:
        every = np.arange(len(theta), dtype=np.intp)
        none = every[:0]
        training, held_out = (every, none) if use == "train" else (none, every)
    else:
        training, held_out = (
            np.concatenate(
                [np.arange(c.start, c.stop, dtype=np.intp) for c in cycles if c.role == role]
                or [np.zeros(0, dtype=np.intp)]
            )
            for role in ("training", "held_out")
        )
    used = [c for c in cycles if c.role in ("training", "held_out")]
    asymmetries = [
        a
        for c in used
        if (a := _stiffness_asymmetry(theta[c.start : c.stop], tau[c.start : c.stop])) is not None
    ]
    amplitudes = [c.amplitude_rad for c in cycles] or [0.5 * float(np.ptp(theta))]
    # In a whole file (a sweep, say) cycles differ by more than their age.
    several = len(cycles) > 1 and not whole
    work = [loop_work_J(theta, tau, c) for c in cycles]
    # Of a loss that is rounding, no share can be told.
    several = several and work[0] > 1e-3 * float(np.ptp(theta)) * float(np.ptp(tau))
    return DataSet(
        label=label,
        amplitude_rad=float(np.median(amplitudes)),
        training=training[~spoilt[training]],
        held_out=held_out[~spoilt[held_out]],
        cycles=dict(Counter(c.role for c in cycles)),
        asymmetry=float(np.mean(asymmetries)) if asymmetries else None,
        work_first_J=work[0] if several else None,
        work_last_J=work[-1] if several else None,
    )


def data_sets(
    label: str,
    theta: Array,
    tau: Array,
    cycles: tuple[Cycle, ...],
    use: str,
    spoilt: npt.NDArray[np.bool_] | None = None,
) -> tuple[DataSet, ...]:
    """Data sets of the error figures, without corrupt samples."""
    spoilt = np.zeros(len(theta), dtype=bool) if spoilt is None else spoilt
    if use != "cycles":
        return (_one_set(label, theta, tau, cycles, use, spoilt),)
    blocks = sorted({c.block for c in cycles if c.role in ("training", "held_out")})
    out = []
    for n, b in enumerate(blocks):
        name = f"{label} block {n + 1}" if len(blocks) > 1 else label
        own = [c for c in cycles if c.block == b and c.role != "transition"]
        out.append(_one_set(name, theta, tau, own, use, spoilt))
    return tuple(out)
