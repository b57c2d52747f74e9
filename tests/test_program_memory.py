"""What predictive control's program keeps: sizes and tables, from the problem's own numbers."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.verify.program import program_streams

# Intervals, states (both sides' angles and rates, ...), stop operators; substeps of an interval.
N, STATES, STOPS, SUBSTEPS = 10, 8, 10, 4
ROLLED = 1 + N * SUBSTEPS  # the substep before the new command takes effect, and all others
PACKED = N * (N + 1) // 2


@pytest.fixture(scope="module")
def program():
    kinds = load_device("elbow_mpc").system.kinds
    return next(b for b in kinds if b.kind == "program")


def test_every_array_has_the_size_that_is_used(program):
    symmetric = dict.fromkeys(("qp_H", "qp_T", "effort_0_rows", "error_0_rows"), PACKED)
    by_input = ("qp_f", "qp_low", "qp_high", "qp_x", "qp_y", "qp_side", "qp_p", "back")
    by_input += ("effort_0_value", "error_0_value")
    states = {"x": STATES, "p": 8, "dx": N * STATES, "ref": 3, "named": 10, "k": 9}
    # Groups of operators let go at once: at most one for each, and those never tied.
    stops = {"play": STOPS, "group_end": STOPS + 1, "group_since": STOPS + 1}
    sizes = symmetric | dict.fromkeys(by_input, N) | states | stops | {"history": N * ROLLED}
    guarded = {p.name: p.size for p in program.inputs}
    assert {n: s for n, s in guarded.items() if s > 1} == {
        "play_rad": STOPS,
        **dict.fromkeys(("tau_d_Nm", "theta_d_rad", "omega_d_rad_s"), N),
    }
    sizes |= {f"g_{n}": s for n, s in guarded.items()}
    found = {m.name: m.size for m in program.work}
    assert {n: s for n, s in found.items() if s > 1} == {n: s for n, s in sizes.items() if s > 1}
    assert program.memory["state.plan"].size == N


def test_tables_of_whole_numbers(program):
    memory = program.memory
    lower = [max(i, j) * (max(i, j) + 1) // 2 + min(i, j) for i in range(N) for j in range(N)]
    assert list(memory["qp_pair"].values) == lower
    assert list(memory["qp_row"].values) == [i * (i + 1) // 2 for i in range(N)]
    # Inputs that a substep's deflection may depend on: none before the first one acts.
    active = [0] + [k // SUBSTEPS + 1 for k in range(N * SUBSTEPS)]
    assert list(memory["columns"].values) == active
    assert memory["number"].values["f64"] == tuple(range(ROLLED))


def test_tables_of_the_stop_operators(program):
    table = {
        n: np.array(m.values["f64"])
        for n, m in program.memory.items()
        if n[:5] == "stop_" and m.region == "table"
    }
    r, p = 0.0197 * np.arange(1, STOPS + 1), table["stop_p"]
    assert table["stop_r"] == pytest.approx(r)
    assert p == pytest.approx(p[0] * np.exp(-62.5 * 0.0197 * np.arange(STOPS)))
    assert table["stop_gap"] == pytest.approx(np.full(STOPS, 0.0197))
    for tied in range(STOPS + 1):
        assert table["stop_tied"][tied] == pytest.approx(p[:tied] @ r[:tied])
        assert table["stop_let"][tied] == pytest.approx(p[:tied].sum())
        assert table["stop_free"][tied] == pytest.approx(p[tied:].sum(), abs=1e-12)


def test_the_persons_torque_goes_on_with_a_rate_that_fades(program):
    # In the middle of each interval of 20 ms, 3 ms from now on, and of those 3 ms: it has grown
    # by its rate times 0.3 s (1 - exp(-t / 0.3 s)).
    t = [0.003 + 0.02 * (k + 0.5) for k in range(N)] + [0.0015]
    grown = 0.3 * (1 - np.exp(-np.array(t) / 0.3))
    assert program.memory["middle"].values["f64"] == pytest.approx(grown)
    assert program.memory["middle"].values["f32"] == pytest.approx(grown)


def test_a_step_reads_nothing_that_an_earlier_one_left_in_working_memory(program):
    rng = np.random.default_rng(1)
    passing = {m.name for m in program.work}
    kept = [p.name for p in program.state if p.name not in passing]
    assert kept == ["plan"]
    for stream in program_streams(program, steps=2):
        clean, spoilt = program.simulator(), program.simulator()
        for k in range(2):
            given = {n: v[k] for n, v in stream.inputs.items()}
            for m in program.work:
                spoilt._arrays[m.name][:] = rng.uniform(-5.0, 5.0, m.size)
            assert clean.step(**given) == spoilt.step(**given)
            for name in kept:
                assert np.array_equal(clean.state[name], spoilt.state[name])
