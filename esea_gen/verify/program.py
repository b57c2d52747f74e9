"""A Program's C against its executor: bit for bit in f64, to a stated share in f32.

A comparison in a loop decides how often it is passed: one that rounding turns turns all that
follows, so no bound can be derived in f32. It may say more against itself there, never less.
"""

from __future__ import annotations

import numpy as np

from esea_gen.device import Device
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.program import Program
from esea_gen.language.stream import Stream
from esea_gen.verify.bounds import full_scales
from esea_gen.verify.runs import Run, changed_by_restore, not_finite, run_c
from esea_gen.verify.streams import streams
from esea_gen.verify.verdict import EXACT_PROGRAM, STATED, Comparison

# The executor takes some 30 ms a step of the elbow's controller.
STEPS = 40
# Largest seen over 3200 steps of the elbow's controller on these streams: 1.2e-4.
CLOSENESS = 1e-3


def program_streams(program: Program, seed: int = 1, steps: int = STEPS) -> list[Stream]:
    """The streams of a Program: a Block's, shorter."""
    return streams(program, seed, steps)


def compare_program(
    device: Device, program: Program, library: HostLibrary, stream: Stream, expected: Run
) -> Comparison:
    got = run_c(library.block(program.name), stream)
    scale = full_scales(device, program)
    exact = library.real == "f64"
    judged = [p for p in program.outputs if not p.flags and p.unit != "1"]
    result = Comparison(
        program.name,
        stream.name,
        library.real,
        stream.steps,
        {},
        {p.name: 0.0 if exact else CLOSENESS * scale[p.name] for p in judged},
        rule=EXACT_PROGRAM if exact else STATED,
    )
    result.problems += not_finite((*program.outputs, *program.state), got[0] | got[1])
    for p in judged:
        difference = np.abs(np.asarray(got[0][p.name], float) - expected[0][p.name])
        error = float(np.max(difference, initial=0.0))
        result.errors[p.name] = error
        # A NaN is above every limit.
        if not error <= result.limits[p.name]:
            result.problems.append(f"{p.name}: error {error:.3g} above {result.limits[p.name]:.3g}")
    for p in program.outputs:
        if p.flags:
            said = got[0][p.name].astype(np.int64)
            owed = expected[0][p.name].astype(np.int64)
            less = (owed & ~said) != 0
            more = (said & ~owed) != 0
            result.status_differences += int(np.sum(less | more if exact else less))
            result.turned += 0 if exact else int(np.sum(more))
    if exact:
        result.bit_identical = all(
            np.asarray(c[p.name], float).tobytes() == np.asarray(e[p.name], float).tobytes()
            for c, e, ports in zip(got, expected, (program.outputs, program.state), strict=True)
            for p in ports
            # Where a work array was put in from outside, the executor has another one until it is
            # written; what a step computes from it is compared all the same.
            if not stream.injections or p in program.outputs or p in program.carried
        )
    names = ([p.name for p in ports] for ports in (program.outputs, program.carried))
    result.problems += changed_by_restore(library.block(program.name), stream, got, *names)
    return result
