"""The float32 error of a Program at an operating point, against the compiled C."""

import pytest

from esea_gen import load_device
from esea_gen.hostlib.library import compile_device
from esea_gen.language.stream import Stream, single
from esea_gen.studies.tracking import TuningCase
from esea_gen.verify.runs import run_c
from tests.benchmarks.predictive_loop import recorded_rows
from tests.operating_point import PointAnalysis


@pytest.fixture(scope="module")
def fed():
    program = load_device("elbow_mpc").system.blocks["predictive"]
    rows = single(recorded_rows("mpc", TuningCase().cases()[0], 60))[::6]
    columns, at = {}, 0
    for p in program.inputs:
        columns[p.name] = rows[:, at] if p.size == 1 else rows[:, at : at + p.size]
        at += p.size
    return program, columns


@pytest.mark.ci
def test_the_compiled_controller_keeps_the_bound(fed):
    program, columns = fed
    runner = compile_device(load_device("elbow_mpc"), "f32").block("predictive")
    analysis = PointAnalysis(program)
    shares = []
    for k in range(len(next(iter(columns.values())))):
        analysis.state = {n: single(v) for n, v in analysis.state.items()}
        before = {p.name: analysis.state[p.name] for p in program.carried}
        now = {n: c[k] if c.ndim > 1 else float(c[k]) for n, c in columns.items()}
        found = analysis.bound(**now)
        one = Stream("one", {n: c[k : k + 1] for n, c in columns.items()}, injections={0: before})
        u_Nm = float(run_c(runner, one)[0]["u_Nm"][0])
        assert found.errors["u_Nm"] < 1e-5
        shares.append(abs(u_Nm - found.exact["u_Nm"]) / found.errors["u_Nm"])
    assert max(shares) < 1
    # Not so wide that it would hold of anything.
    assert max(shares) > 0.005
