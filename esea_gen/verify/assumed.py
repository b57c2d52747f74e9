"""Where a linear Block's bound over many steps holds: the same matrix at every step.

Where a clip of a state acts or an invalid input is bridged, another matrix acts.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.step_errors import Bound, started_flags, state_jacobian, state_matrix
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream
from esea_gen.verify.executor import step_arguments


def steps_beyond(block: Block, bound: Bound, stream: Stream, states: Mapping[str, Array]) -> int:
    """Steps of a run that violate a bound's assumption on the state's matrix."""
    matrix = state_matrix(block) if bound.method == "linear" else None
    if matrix is None:
        return 0
    given = step_arguments(block, stream, states, FORMATS["f64"])
    mapped = state_jacobian(block).map(stream.steps)
    found = np.asarray(mapped(*[ca.DM(a.T) for a in given]), dtype=float)
    each = found.reshape(len(matrix), stream.steps, len(matrix)).transpose(1, 0, 2)
    flags = started_flags(block)
    each[:, flags, :] = 0.0
    each[:, :, flags] = 0.0
    near = np.abs(each - matrix) <= 1e-9 * np.max(np.abs(matrix), initial=1e-300)
    same = np.all(near, axis=(1, 2))
    afresh = ~np.any(each, axis=(1, 2))
    # Before the first valid sample the state is what it was made, without an error.
    for k, p in enumerate(block.state):
        if p.name == "primed":
            before = given[len(block.coefficients) + k][:, 0]
            afresh |= ~np.logical_or.accumulate(before != 0)
    return int(np.count_nonzero(~same & ~afresh))


def broken(bound: Bound, steps: int) -> str:
    """Message of a run that violates its bound's assumption without being declared rough."""
    assumed = "; ".join(bound.assumptions)
    return f"{steps} steps break what the bound assumes ({assumed})"


UNTRIED = "no stream keeps to what its bound assumes: the bound was not tried"
