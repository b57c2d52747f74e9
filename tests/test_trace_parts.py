"""Traces, piece by piece: the stream's parts in seconds, what a row keeps, how a change is told."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.signal import sawtooth

from esea_gen.device import load_device
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, flag_word
from esea_gen.language.system import External, System, Task
from esea_gen.verify.drive_stream import scalars, task_inputs_at
from esea_gen.verify.traces import PARTS, Trace, check_traces, differences, run_trace, trace_stream

H = 1e-3
FLAGS = (Flag("INVALID", "bad input"), Flag("FIFTIETH", "now and then"), Flag("NEVER", "never"))


def test_the_parts_and_how_long_they_are():
    assert [(p.name, p.duration_s) for p in PARTS] == [
        ("rest at zero", 0.2),
        ("chirp in the domain", 3.0),
        ("shrinking reversals", 1.5),
        ("held deflection", 0.5),
        ("beyond the domain", 1.0),
        ("invalid samples", 0.8),
        ("jumps", 0.4),
        ("back to rest", 0.6),
    ]


def system() -> System:
    """A fast task with a vector and a status word; a slow one that reads what is latched."""

    def quick(c, s, u, guard, label):
        count = s.count + 1
        often = count >= 50
        word = flag_word([ca.logic_not(guard.inputs_ok), often, ca.SX(0)])
        y = {"y_Nm": 2 * u.x_rad, "pair": [u.x_rad, u.w_Nm], "status": word}
        return {"count": ca.if_else(often, 0, count)}, y

    fast = Block.define(
        *("fast", "made up"),
        period_s=H,
        state=(Port("count", 0, 60, "steps"),),
        inputs=(Port("x_rad", -0.25, 0.5, "in", on_invalid=0.125), Port("w_Nm", -3.0, 4.0, "in")),
        outputs=(
            Port("y_Nm", -9, 9, "out"),
            Port("pair", -6, 5, "out", 2),
            Port("status", 0, 7, "status", flags=FLAGS),
        ),
        step=quick,
    )
    slow = Block.define(
        *("slow", "made up"),
        period_s=5 * H,
        state=(),
        inputs=(Port("x_Nm", -9, 9, "in"),),
        outputs=(Port("rate_rad_s", -9, 9, "out"),),
        step=lambda c, s, u, guard, label: ({}, {"rate_rad_s": u.x_Nm + 1}),
    )
    return System(
        *("own", H, {"fast": fast, "slow": slow}),
        (Task("quick", ("fast",)), Task("lazy", ("slow",), every=5, phase=2)),
        wires={"slow.x_Nm": "fast.y_Nm"},
        inputs={"x_rad": ("fast.x_rad",), "w_Nm": ("fast.w_Nm",)},
        outputs={n: f"fast.{n}" for n in ("y_Nm", "pair", "status")}
        | {"rate_rad_s": "slow.rate_rad_s"},
    )


@pytest.fixture(scope="module")
def domain():
    given = {"theta_max_rad": 0.2, "omega_max_rad_s": 1.5, "tau_full_scale_Nm": 4.5}
    return SimpleNamespace(**{k: SimpleNamespace(value=v) for k, v in given.items()})


@pytest.fixture(scope="module")
def device(domain):
    """What a trace asks of a device: no drive, a domain, a System."""
    return SimpleNamespace(
        name="own", laws=(), system=system(), file=SimpleNamespace(domain=domain)
    )


@pytest.fixture(scope="module")
def stream(device):
    return trace_stream(device)


# Input, its place, the amplitude that is its own, the smaller end of its range, and the lattice:
# 15 bits of the next power of two.  An angle reaches 95 % of the domain, all else 55 %.
INPUTS = [("x_rad", 0, 0.95 * 0.2, 0.25, 2.0**-16), ("w_Nm", 1, 0.55 * 3.0, 3.0, 2.0**-13)]


@pytest.mark.parametrize(("name", "n", "reach", "high", "grid"), INPUTS)
def test_each_part_of_the_stream(stream, name, n, reach, high, grid):
    x = stream[name]
    assert x.shape == (8000,)
    np.testing.assert_array_equal(np.nan_to_num(x[:6200] / grid) % 1, 0)
    pieces = np.split(x, [200, 3200, 4700, 5200, 6200, 7000, 7400])
    near = {"abs": 0.51 * grid}
    assert not pieces[0].any()
    assert not pieces[7].any()
    t = np.arange(3000) * H
    # From no frequency to the one whose largest rate is 4/5 of the domain's.
    top_Hz = 0.8 * 1.5 / (2 * np.pi * 0.2)
    chirp = reach * np.sin(np.pi * top_Hz * t**2 / 3.0 + 0.9 * n)
    if n:  # fades in over an eighth of the part
        chirp[:375] *= np.arange(375) / 375
    assert pieces[1] == pytest.approx(chirp, **near)
    # Five triangles, the n-th input a quarter later, from the whole amplitude to three tenths.
    t = np.arange(1500) * H
    triangle = -sawtooth(2 * np.pi * (t / 0.3 + 0.25 * (n + 1)), width=0.5)
    assert pieces[2] == pytest.approx(reach * triangle * (1 - 0.7 * t / 1.5), **near)
    assert pieces[3] == pytest.approx(np.full(500, 0.4 * reach * (1, -1)[n]), **near)
    t = np.arange(1000) * H
    assert pieces[4] == pytest.approx(0.97 * high * np.sin(2 * np.pi * t + 0.9 * n), **near)
    # Two turns in 0.8 s; every 61 samples one, five, or nine that are none, of five kinds in turn.
    t = np.arange(800) * H
    wave = 0.5 * reach * np.sin(2 * np.pi * t / 0.4 + 0.9 * n)
    bad = [np.nan, np.inf, -np.inf, 1.5 * high, -3 * high]
    for k in range(14):
        begin = 7 + 3 * n + 61 * k
        wave[begin : begin + (1, 5, 9)[k % 3]] = bad[(k + n) % 5]
    assert pieces[5] == pytest.approx(wave, nan_ok=True, **near)
    sixth = np.floor(6 * np.arange(400) / 400).astype(int)
    assert pieces[6] == pytest.approx(0.8 * reach * (-1.0) ** (sixth + n), **near)


def test_what_a_row_keeps(device, stream):
    trace = run_trace(device)
    rows = np.arange(19, 8000, 20)
    assert trace.steps.tolist() == rows.tolist()
    assert (trace.device, trace.period_s) == ("own", H)
    assert list(trace.inputs) == ["x_rad", "w_Nm"]
    assert list(trace.outputs) == ["y_Nm", "pair[0]", "pair[1]", "status", "rate_rad_s"]
    for name, column in trace.inputs.items():
        np.testing.assert_array_equal(column, stream[name][rows])
    ok_x = (stream["x_rad"] >= -0.25) & (stream["x_rad"] <= 0.5)
    ok_w = (stream["w_Nm"] >= -3.0) & (stream["w_Nm"] <= 4.0)
    used = np.where(ok_x, stream["x_rad"], 0.125)
    np.testing.assert_array_equal(trace.outputs["y_Nm"], 2 * used[rows])
    np.testing.assert_array_equal(trace.outputs["pair[0]"], used[rows])
    np.testing.assert_array_equal(trace.outputs["pair[1]"], np.where(ok_w, stream["w_Nm"], 0)[rows])
    # Every bit that was set in the twenty steps to the row, once in fifty steps the second one.
    word = (~(ok_x & ok_w)).astype(int) + 2 * (np.arange(1, 8001) % 50 == 0)
    assert trace.outputs["status"].tolist() == [
        np.bitwise_or.reduce(word[r - 19 : r + 1]) for r in rows
    ]
    # The slow task starts at 2, 7 ...; it reads what was released then: of the tick before.
    starts = (rows - 2) // 5 * 5 + 2
    np.testing.assert_array_equal(trace.outputs["rate_rad_s"], 2 * used[starts - 1] + 1)
    assert trace.flags == {"status": ("INVALID", "FIFTIETH", "NEVER")}
    assert trace.full_scale == {**{"y_Nm": 4.5, "pair[0]": 6.0, "pair[1]": 6.0, "rate_rad_s": 1.5}}
    text = trace.text()
    assert differences(trace, text) == []
    lines = text.splitlines()
    assert lines[0] == (
        "# esea-gen trace: own, a tick of 0.001 s, every 20th step.  A status word has all bits "
        "set since the row above."
    )
    assert lines[1] == "step,x_rad,w_Nm,y_Nm,pair[0],pair[1],status,rate_rad_s"
    assert len(lines) == 402


def test_of_vectors_every_element_is_a_column():
    one = External("one", Port("one", -1, 1, "one"), ())
    three = External("three", Port("three", -1, 1, "three", 3), ())
    assert scalars([three, one]) == [
        ("three[0]", three, 0),
        ("three[1]", three, 1),
        ("three[2]", three, 2),
        ("one", one, 0),
    ]
    columns = {"one": [5.0, 6.0], "three[0]": [0, 1], "three[1]": [2, 3], "three[2]": [4, 5]}
    given = task_inputs_at(columns, [three, one], 1)
    assert list(given) == ["three", "one"]
    assert given["three"].tolist() == [1, 3, 5]
    assert given["one"] == 6.0


# -- how a change is told --------------------------------------------------------------------------


def small(**columns) -> Trace:
    """Four rows of a tick of 1 ms, in the first two parts."""
    given = {"a_rad": [0.0, 1.0, 2.0, 3.0], "tau_Nm": [1.0, 2.0, 4.0, 8.0], "status": [0, 1, 2, 6]}
    arrays = {n: np.array(v, float) for n, v in (given | columns).items()}
    return Trace(
        *("small", H, np.array([179, 199, 200, 219])),
        {"a_rad": arrays.pop("a_rad")},
        arrays,
        {"status": ("LOW", "MIDDLE", "HIGH")},
        {"tau_Nm": 4.0},
    )


def test_a_trace_is_read_as_it_was_written():
    whole = small(tau_Nm=[-0.0, 1 / 3, 12345678901.5, np.nan])
    assert whole.text().splitlines()[1:] == [
        "step,a_rad,tau_Nm,status",
        "179,0,0,0",
        "199,1,0.3333333333,1",
        "200,2,1.23456789e+10,2",
        "219,3,nan,6",
    ]
    assert differences(whole, whole.text()) == []


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        (
            {"tau_Nm": [1.0, 2.0, 5.0, 8.5]},
            "tau_Nm from step 200 (chirp in the domain) on: 4 -> 5; 2 of 4 rows differ; largest "
            "change 25 % of full scale, step 200 (chirp in the domain)",
        ),
        (
            {"tau_Nm": [1.0, 1.5, 4.0, 9.0]},
            "tau_Nm from step 199 (rest at zero) on: 2 -> 1.5; 2 of 4 rows differ; largest "
            "change 25 % of full scale, step 219 (chirp in the domain)",
        ),
        (
            {"tau_Nm": [1.0, 2.0, 4.0, 8.5]},
            "tau_Nm at step 219 (chirp in the domain): 8 -> 8.5; 1 of 4 rows differ; largest "
            "change 12.5 % of full scale, step 219 (chirp in the domain)",
        ),
        (
            {"tau_Nm": [1.0, np.nan, 4.0, 9.0]},
            "tau_Nm from step 199 (rest at zero) on: 2 -> nan; 2 of 4 rows differ; largest "
            "change nan % of full scale, step 199 (rest at zero)",
        ),
        (
            {"status": [0, 1, 5, 0]},
            "status from step 200 (chirp in the domain) on: MIDDLE -> LOW|HIGH; 2 of 4 rows differ",
        ),
        (
            {"status": [0, 0, 2, 6]},
            "status at step 199 (rest at zero): LOW -> 0; 1 of 4 rows differ",
        ),
        (
            {"a_rad": [0.0, 1.0, 2.0, -3.0]},
            "a_rad at step 219 (chirp in the domain): 3 -> -3; 1 of 4 rows differ",
        ),
        ({"tau_Nm": [1.0, 2.0, 4.0, 8.0 + 1.2e-8]}, None),  # of full scale and of the value
        (
            {"tau_Nm": [1.0, 2.0, 4.0, 8.0 - 1.3e-8]},
            "tau_Nm at step 219 (chirp in the domain): 8 -> 7.999999987; 1 of 4 rows differ; "
            "largest change 3.25e-07 % of full scale, step 219 (chirp in the domain)",
        ),
    ],
)
def test_a_change_is_told_in_one_line(columns, line):
    found = differences(small(**columns), small().text())
    assert found == ([f"small: {line}"] if line else [])


def test_other_columns_and_rows_are_told():
    text = small().text()
    assert differences(small(more=[0, 0, 0, 0]), text) == ["small: output more added"]
    assert differences(small(), small(more=[0, 0, 0, 0]).text()) == ["small: column more removed"]
    renamed = text.replace("a_rad", "b_rad")
    assert differences(small(), renamed) == [
        "small: input a_rad added",
        "small: column b_rad removed",
    ]
    less = "\n".join(text.splitlines()[:-1])
    other = "the stream is another one: 3 rows to step 200, now 4 to 219"
    assert differences(small(), less) == [f"small: {other}"]
    assert differences(small(), less.replace("a_rad", "b_rad"))[-1] == f"small: {other}"


def test_a_step_past_the_last_part_has_no_part():
    late = Trace("late", H, np.array([7999, 8000]), {"a": np.zeros(2)}, {}, {}, {})
    for row, where in ((0, "step 7999 (back to rest)"), (1, "step 8000")):
        old = Trace("late", H, late.steps, {"a": np.eye(2)[row]}, {}, {}, {}).text()
        assert differences(late, old) == [f"late: a at {where}: 1 -> 0; 1 of 2 rows differ"]


def test_a_device_without_a_stored_trace_is_told(tmp_path, device):
    assert check_traces(tmp_path, {"own": device}) == ["own: no trace is stored yet"]


def test_an_angle_reaches_no_further_than_its_port():
    wrist = load_device("wrist")
    high = max(min(x.port.high, -x.port.low) for x in wrist.system.inputs if x.port.unit == "rad")
    reach = 0.95 * wrist.file.domain.theta_max_rad.value
    for x in trace_stream(wrist).values():
        assert np.max(np.abs(x[:5200])) == pytest.approx(min(reach, high), rel=1e-3)
