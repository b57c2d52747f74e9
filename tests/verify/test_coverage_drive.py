"""Branch coverage of the drive's kernels: every side taken, or proven impossible."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.hostlib.library import compile_device
from esea_gen.language.block import Block
from esea_gen.language.stream import SPECIAL
from esea_gen.verify import executor
from esea_gen.verify.coverage import SIDES, branch_coverage, side_masks
from esea_gen.verify.memories import aimed_stream, other_memories
from esea_gen.verify.runs import CasadiOracle, run_c, run_symbolic
from esea_gen.verify.streams import at_the_limits, domain_chirp, recorded_stream, streams

pytestmark = pytest.mark.ci

# Sides that no input can take, per Block, in f32.  None of the others has any.
IMPOSSIBLE = {"encoder": 3, "sensor": 4, "inverse": 21, "torque_lead": 1, "passivity": 4}
IMPOSSIBLE |= {"limits": 1}
BLOCKS = [
    *("encoder", "joint", "velocity", "sensor", "rate"),
    *("reference", "inverse", "setpoint_rates", "limits", "drive_observer", "human_eso"),
    *(
        "encoder_gear",
        "gear_observer",
        "redundancy",
        "encoder_monitor",
        "encoder_monitor_gear",
        "monitor",
        "passivity",
        "adaptation",
        "interpolation",
    ),
    *("torque_lead", "smoothed_setpoint", "set_trend", "sliding_mode", "stamp"),
]


@pytest.fixture(scope="module")
def library(drive):
    return compile_device(drive, "f32")


def tried(drive, block, dtype, memories=True):
    recorded = recorded_stream(drive, domain_chirp(drive, 2.0))
    found = [*streams(block), at_the_limits(block, dtype)]
    found += [recorded[block.name]] if block.name in recorded else []
    return [*found, *other_memories(block, dtype)] if memories else found


def block_of(drive, name):
    return next(b for b in drive.system.kinds if b.name == name)


def test_every_block_is_listed(drive):
    assert sorted(BLOCKS) == sorted(b.name for b in drive.system.kinds)


def check(drive, name, real, library):
    block = block_of(drive, name)
    found = branch_coverage(block, tried(drive, block, FORMATS[real].dtype), library)
    assert found.uncovered == []
    assert found.ratio == 1.0
    # Only the inverse's flag NOT_CONVERGED is argued, not proven.
    assert bool(found.detectors) == (name == "inverse")
    assert all("converge" in x or "exact" in x for x in found.detectors)
    for d in found.decisions:
        assert not any(d.seen[side] for side in (*d.proofs, *d.detectors))
    return found


@pytest.mark.parametrize("name", BLOCKS)
def test_both_sides_of_every_decision_are_taken_in_f32(drive, library, name):
    found = check(drive, name, "f32", library)
    assert len(found.excluded) == IMPOSSIBLE.get(name, 0), found.excluded


@pytest.mark.slow
@pytest.mark.parametrize("name", BLOCKS)
def test_both_sides_of_every_decision_are_taken_in_f64(drive, name):
    check(drive, name, "f64", None)


def test_without_its_own_streams_a_latch_stays_closed(drive, library):
    """Armed: random inputs alone leave sides of the limits open, and none is called impossible."""
    block = block_of(drive, "limits")
    plain = [s for s in streams(block) if s.name in ("random walk", "noise over the range")]
    found = branch_coverage(block, plain, library)
    assert found.ratio < 0.9
    assert any("u_followed_Nm" in text for text in found.uncovered)
    # Nothing is called impossible that the limits check themselves, coefficients in memory too,
    # but that a stop that is no flag is 0.
    assert [text.split()[0] for text in found.excluded] == ["stop_used"]


def wild(block: Block, dtype, seed: int, count: int) -> list[np.ndarray]:
    """Arguments of a step: states and inputs anywhere, in any company, some no numbers at all."""
    rng = np.random.default_rng(seed)
    out = []
    for k, p in enumerate((*block.coefficients, *block.state, *block.inputs)):
        shape = (count, p.size)
        low, high = np.array([p.low, p.high]).astype(dtype)
        inside = np.clip(rng.uniform(p.low, p.high, shape).astype(dtype), low, high)
        small = inside * (10.0 ** rng.uniform(-6, 0, shape)).astype(dtype)
        value = np.where(rng.random(shape) < 0.3, np.clip(small, low, high), inside)
        value = np.where(rng.random(shape) < 0.2, np.rint(value), value)
        ends = rng.choice(np.array([p.low, p.high, p.init]).astype(dtype), shape)
        value = np.where(rng.random(shape) < 0.3, ends, value)
        if k >= len(block.coefficients):
            past = np.array([*SPECIAL, 2 * p.high + 1, 2 * p.low - 1]).astype(dtype)
            value = np.where(rng.random(shape) < 0.02, rng.choice(past, shape), value)
        out.append(np.asarray(value, dtype))
    return out


@pytest.mark.parametrize("real", ["f32", "f64"])
@pytest.mark.parametrize("name", sorted(IMPOSSIBLE))
def test_what_is_proven_impossible_never_happens(drive, library, name, real):
    """The proofs against arithmetic: arguments from anywhere, which no stream was needed for."""
    block, fmt = block_of(drive, name), FORMATS[real]
    found = branch_coverage(block, [], library if real == "f32" else None)
    assert len([(d, side) for d in found.decisions for side in d.proofs]) >= IMPOSSIBLE[name]
    kernel, _ = executor.emitted_kernel(block, fmt)
    values = executor.evaluate(kernel, fmt, wild(block, fmt.dtype, 11, 20000))
    taken = 0
    for d in found.decisions:
        arguments = [values[a] for a in kernel.nodes[d.node].args]
        for side, mask in zip(
            SIDES[d.op], side_masks(d.op, arguments, values[d.node]), strict=True
        ):
            taken += int(np.any(mask))
            assert side not in d.proofs or not np.any(mask), (d.where, d.op, side, d.proofs[side])
    # And it tries: most of the other sides are taken.
    assert taken > 0.5 * found.sides


# -- bits ------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("real", ["f64", "f32"])
@pytest.mark.parametrize("name", BLOCKS)
def test_the_c_gives_every_bit(drive, name, real):
    block, library = block_of(drive, name), compile_device(drive, real)
    oracle = CasadiOracle(drive.system) if real == "f64" else None
    assert executor.setup_difference(block, library) == ""
    for stream in tried(drive, block, FORMATS[real].dtype):
        expected = executor.exact_trajectory(block, library, stream, oracle)
        assert expected.first_difference(*run_c(library.block(name), stream)) == ""


# -- aim -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_aimed_stream_meets_thresholds_to_the_bit(drive, dtype):
    """Of each comparison in the reference: equal operands; and a hair apart, on either side.

    The guard's own comparisons only from inside: what lies outside is for other streams.
    """
    block = block_of(drive, "reference")
    fmt = next(f for f in FORMATS.values() if f.dtype == np.dtype(dtype))
    (stream,) = aimed_stream(block, streams(block, steps=600), dtype)
    kernel, _ = executor.emitted_kernel(block, fmt)
    _, states = run_symbolic(block, stream)
    values = executor.evaluate(kernel, fmt, executor.step_arguments(block, stream, states, fmt))
    seen = 0
    for i, n in enumerate(kernel.nodes):
        if n.op not in ("lt", "le"):
            continue
        guards = "input" in (kernel.nodes[k].op for k in n.args)
        a, b = (values[k] for k in n.args)
        if len(np.unique(a)) + len(np.unique(b)) < 8:
            continue  # a mode among modes
        seen += 1
        assert np.any(a == b), i
        beside = np.abs(a - b) <= 8 * np.spacing(np.maximum(np.abs(a), np.abs(b)))
        assert guards or (np.any(beside & (a < b)) and np.any(beside & (a > b))), i
    assert seen > 10
