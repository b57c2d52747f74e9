"""The float32 error of a Program at an operating point, against closed forms and the compiled C."""

import casadi as ca
import numpy as np
import pytest

from esea_gen import load_device
from esea_gen.emit.elementary import ACCURACY_ULP
from esea_gen.hostlib.library import compile_device
from esea_gen.language.builder import Builder, declare_ports
from esea_gen.language.ports import Port
from esea_gen.language.program import Program
from esea_gen.language.stream import Stream, single
from esea_gen.studies.tracking import TuningCase
from esea_gen.verify.runs import run_c
from tests.benchmarks.predictive_loop import recorded_rows
from tests.conftest import require_tool
from tests.operating_point import PointAnalysis

U = 2.0**-24


def summing(steps: int) -> Program:
    """y = a + b x + b x + ...: a line whose error has a closed form."""
    b = Builder()
    inputs = (Port("a", -100.0, 100.0, "start"), Port("x", -100.0, 100.0, "what is added"))
    outputs = (Port("y", -1e4, 1e4, "sum"),)
    declare_ports(b, "in", inputs)
    out = declare_ports(b, "out", outputs)
    a, x = b.memory["in.a"], b.memory["in.x"]
    with b.part("step"):
        b.call("copy", [a[0]], [out["y"][0]], lambda v: v)
        with b.loop(0, steps):
            b.call("add", [out["y"][0], x[0]], [out["y"][0]], lambda y, v: y + 0.1 * v)
    return Program.define(
        "summing", "Sum", period_s=1e-3, builder=b, inputs=inputs, outputs=outputs
    )


def test_a_sum_by_hand():
    """Every product is wrong by u |bx| and by b's storing, every sum by u of its value."""
    found = PointAnalysis(summing(3)).bound(a=2.0, x=3.0)
    stored = abs(float(np.float32(0.1)) - 0.1) * 3.0
    sums = (2.3, 2.6, 2.9)
    by_hand = 3 * (U * 0.3 + stored) + U * sum(sums)
    assert found.errors["y"] == pytest.approx(by_hand, rel=1e-9)
    assert found.exact["y"] == pytest.approx(2.9)
    assert found.near == 0


def test_functions_choices_and_quotients_by_hand():
    b = Builder()
    inputs = (Port("p", 0.0, 9.0, "p"), Port("q", 0.0, 9.0, "q"))
    outputs = tuple(Port(n, -1e4, 1e4, n) for n in ("ratio", "curve", "chosen", "beyond"))
    declare_ports(b, "in", inputs)
    out = declare_ports(b, "out", outputs)
    p, q = b.memory["in.p"], b.memory["in.q"]
    with b.part("step"):
        b.call("ratio", [p[0], q[0]], [out["ratio"][0]], lambda x, y: (x * x * y) / (y + x * y))
        b.call("curve", [p[0]], [out["curve"][0]], lambda x: ca.tanh(x * x * x))
        b.call(
            "chosen",
            [p[0], q[0]],
            [out["chosen"][0]],
            lambda x, y: -2 * ca.fmax(x * y * x, ca.fabs(x)),
        )
        b.call(
            "beyond",
            [p[0], q[0]],
            [out["beyond"][0]],
            lambda x, y: ca.if_else(x * y < 1, x * x * y, 0),
        )
    program = Program.define("f", "F", period_s=1e-3, builder=b, inputs=inputs, outputs=outputs)
    x, y = 0.3, 1.7
    x, y = float(np.float32(x)), float(np.float32(y))
    found = PointAnalysis(program).bound(p=x, q=y)
    # Relative errors add up in products and quotients.
    ratio = x * x * y / (y + x * y)
    upper = 2 * U  # of x x y
    lower = U * (x * y) / (y + x * y) + U  # of the product in the sum, and of the sum
    assert found.errors["ratio"] == pytest.approx(ratio * (upper + lower + U), rel=1e-6)
    cube = x**3
    slope = 1 - np.tanh(cube) ** 2
    own = 2 * ACCURACY_ULP["tanh"] * U * np.tanh(cube)
    assert found.errors["curve"] == pytest.approx(slope * cube * 2 * U + own, rel=1e-6)
    # x y x = 0.153 is less than |x|, which is exact, and so is twice it.
    assert found.errors["chosen"] == 0
    assert found.errors["beyond"] == pytest.approx(2 * U * x * x * y, rel=1e-6)
    assert found.near == 0
    close = PointAnalysis(program).bound(p=float(np.float32(1 / y)), q=y)
    assert close.near == 1  # x y against 1


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
    require_tool("gcc")
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


@pytest.mark.ci
def test_what_an_input_loses_is_carried_as_the_step_carries_it(fed):
    """An input between two float32 numbers adds its share times the step's own slope."""
    program, columns = fed
    now = {n: c[1] if c.ndim > 1 else float(c[1]) for n, c in columns.items()}
    for name in ("tau_h_Nm", "d4_rad_s2", "omega_gear_rad_s"):
        lost = 0.4 * float(np.spacing(np.float32(now[name])))
        between = now | {name: now[name] + lost}
        more = (
            PointAnalysis(program).bound(**between).errors["u_Nm"]
            - PointAnalysis(program).bound(**now).errors["u_Nm"]
        )
        nudge = 1e-6
        ends = [
            PointAnalysis(program).step(**now | {name: now[name] + d})["u_Nm"]
            for d in (nudge, -nudge)
        ]
        slope = abs(ends[0] - ends[1]) / (2 * nudge)
        assert more == pytest.approx(slope * abs(lost), rel=0.01)
