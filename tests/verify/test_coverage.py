"""Branch coverage of the kernels, and its float32 executor."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.stream import SPECIAL, Stream
from esea_gen.verify.coverage import branch_coverage
from esea_gen.verify.executor import exact_trajectory, setup_difference
from esea_gen.verify.runs import CasadiOracle, run_c
from esea_gen.verify.streams import at_the_limits, domain_chirp, recorded_stream, streams
from tests.made_up import made, port
from tests.proof.sanitize import GivenRenderer

BLOCKS = ["velocity", "smoothing", "sensor"]


def block_of(device, name):
    return next(b for b in device.system.kinds if b.name == name)


def shipped(device, block, dtype=np.float32):
    extra = recorded_stream(device, domain_chirp(device, 2.0))[block.name]
    return [*streams(block), extra, at_the_limits(block, dtype)]


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_both_sides_of_every_decision_are_taken(elbow, elbow_f32, real, name):
    block = block_of(elbow, name)
    library = elbow_f32 if real == "f32" else None
    found = branch_coverage(block, shipped(elbow, block), library)
    assert found.uncovered == []
    assert found.ratio == 1.0
    assert found.real == real
    # What cannot happen is stated, proven and counted: the clips of the spring's and the stops'
    # torque at 20 Nm, and one operand of an "and" that follows from the other.
    assert len(found.excluded) == {"velocity": 0, "smoothing": 0, "sensor": 4}[name]
    assert all(": the " in text for text in found.excluded)
    for d in found.decisions:
        assert not any(d.seen[side] for side in d.proofs)


def test_without_a_stream_the_coverage_falls_and_says_where(elbow):
    block = elbow.sensor
    less = branch_coverage(block, streams(block))
    assert 0.9 < less.ratio < 1.0
    assert any(
        "tau_r_Nm ((3.3)): fmax never 'second is greater'" in text for text in less.uncovered
    )
    least = branch_coverage(block, [s for s in streams(block) if s.name == "chirp"])
    assert least.ratio < less.ratio - 0.1
    assert any("state_ok" in text and "never" in text for text in least.uncovered)
    assert least.to_dict()["covered"] == least.sides - len(least.uncovered)
    assert least.to_dict()["streams"] == ["chirp"]


def test_a_tie_takes_neither_side_of_a_minimum_or_maximum():
    def step(c, s, u, guard, label):
        least, most = ca.fmin(u.x_rad, u.y_rad), ca.fmax(u.x_rad, u.y_rad)
        return {}, {"least_rad": label("least", least), "most_rad": label("most", most)}

    x, y, least, most = (port(n, -1, 1) for n in ("x_rad", "y_rad", "least_rad", "most_rad"))
    block = made(step, (), (x, y), (least, most))

    def sides(y: np.ndarray) -> list[tuple[int, ...]]:
        found = branch_coverage(block, [Stream("made up", {"x_rad": np.full(3, 0.5), "y_rad": y})])
        pair = [d for d in found.decisions if d.where.startswith(("least", "most"))]
        return [tuple(d.seen.values()) for d in pair if d.op in ("fmin", "fmax")]

    assert sides(np.full(3, 0.5)) == [(0, 0), (0, 0)]
    assert sides(np.array([0.5, 0.6, 0.2])) == [(1, 1), (1, 1)]


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_the_c_gives_every_bit(elbow, elbow_f64, elbow_f32, real, name):
    """F64 against CasADi's own C, f32 against NumPy, operation by operation; counters too."""
    library = elbow_f64 if real == "f64" else elbow_f32
    oracle = CasadiOracle(elbow.system) if real == "f64" else None
    block = block_of(elbow, name)
    assert setup_difference(block, library) == ""
    for stream in shipped(elbow, block, FORMATS[real].dtype):
        expected = exact_trajectory(block, library, stream, oracle)
        assert expected.first_difference(*run_c(library.block(name), stream)) == ""
        assert set(expected.states) == set(library.block(name).state.dtype.names)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("239.0f", "239.00002f"),  # one unit in the last place
        ("INT32_C(371783107)", "INT32_C(371783108)"),  # 2^-27 in an exponent
        # A counter that wraps.
        ("esea_count_flag(&state->n_step_clipped,", "state->n_step_clipped += 0u != ("),
        ("state->play_rad[3] = 0.0f;", ""),  # a state that init leaves as it was
    ],
)
def test_the_bits_show_a_fault(elbow, old, new):
    files = GivenRenderer(elbow, "f32").files()
    assert files["esea_elbow_sensor.c"].count(old) == 1
    files["esea_elbow_sensor.c"] = files["esea_elbow_sensor.c"].replace(old, new)
    library = HostLibrary(elbow.system, GivenRenderer(elbow, "f32", files))
    found = [setup_difference(elbow.sensor, library)]
    for stream in shipped(elbow, elbow.sensor):
        expected = exact_trajectory(elbow.sensor, library, stream, None)
        found.append(expected.first_difference(*run_c(library.block("sensor"), stream)))
    assert any(found)


@pytest.mark.parametrize("real", ["f64", "f32"])
@pytest.mark.parametrize("value", SPECIAL)
def test_nan_and_infinity_into_every_field_of_the_task(elbow, elbow_f64, elbow_f32, real, value):
    library = elbow_f64 if real == "f64" else elbow_f32
    prefix = f"esea_{elbow.name}"
    for task in elbow.system.tasks:
        names = [x.name for x in elbow.system.task_inputs(task)]
        quiet = {n: np.full(8, 0.01) for n in names}
        cases = [({n: np.where(np.arange(8) == 2, value, quiet[n])}, None) for n in names]
        state_type = library.dtype(f"{prefix}_state_t")
        for instance in state_type.names:
            fields = state_type[instance].fields
            cases += [({}, (instance, f)) for f in fields if fields[f][0].base.kind == "f"]
        for hit, field in cases:
            runner = library.task(task.name)
            runner.run({n: v[:2] for n, v in quiet.items()}, trace=False)
            if field is not None:
                state = runner.state
                with np.errstate(over="ignore"):
                    state[field[0]][field[1]] = value
                runner.state = state
            y, s = runner.run(quiet | hit)
            for a in y.values():
                assert np.all(np.isfinite(a.astype(float)))
            for instance in state_type.names:
                for f in s[instance].dtype.names:
                    assert np.all(np.isfinite(s[instance][f].astype(float))), (instance, f)
            words = [v for k, v in y.items() if k.endswith("status")]
            assert any(np.any(w & 3) for w in words)  # and it is told of
        # A tunable that is not a number is refused.
        for instance, tunable in elbow.system.tunables:
            assert runner.prepare({instance: {tunable.name: value}}) > 0
