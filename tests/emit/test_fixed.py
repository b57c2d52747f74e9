"""Fixed point: plan, C, executor and bounds of the q31 format."""

from __future__ import annotations

import math
import re

import casadi as ca
import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import esea_gen
from esea_gen.emit.build import differences, render_device, write_bundles
from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.errors import block_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import Planner, lowered_values, run_lowered
from esea_gen.emit.fixed.values import LoweringError
from esea_gen.errors import UserError
from esea_gen.hostlib import compile_device
from esea_gen.hostlib.library import compile_system
from esea_gen.language.ports import Port, Tunable, around, clip, in_range
from esea_gen.language.stream import Stream
from esea_gen.language.system import System, Task
from esea_gen.verify.fixed import RawExecutor, bounds_of, compare_fixed, raw_stream
from esea_gen.verify.runs import run_c, run_symbolic
from esea_gen.verify.streams import domain_chirp, recorded_stream, streams
from tests.conftest import require_tool
from tests.made_up import made, port

mpl.use("Agg")

DEVICES = ("elbow", "knee", "knee_printed", "wrist")


@pytest.fixture(scope="module", params=DEVICES)
def device(request):
    require_tool("gcc")
    return esea_gen.load_device(request.param)


@pytest.fixture(scope="module")
def library(device):
    return compile_device(device, "q31")


@pytest.fixture(scope="module")
def elbow_q31(elbow):
    require_tool("gcc")
    return compile_device(elbow, "q31")


@pytest.mark.ci
def test_every_stream_bit_for_bit_and_inside_the_bound(device, library):
    bounds = bounds_of(device)
    extra = recorded_stream(device, domain_chirp(device, 2.0), "chirp in the domain")
    for block in device.system.kinds:
        plan, runner = plan_block(block), library.block(block.name)
        for stream in [*streams(block, steps=600), extra[block.name]]:
            found = compare_fixed(device, plan, runner, stream, bounds[block.name])
            assert found.passed, f"{block.name}, {stream.name}: {found.problems}"


def test_the_derived_torque_bound_is_small(device):
    bound = block_bound(plan_block(device.sensor))
    # The aim: 0.05 % of full scale.
    assert bound.outputs["tau_Nm"] < 0.0005 * device.tau_full_scale_Nm
    assert bound.steps == float("inf")


@given(data=st.data())
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bit_pattern_in_any_input_and_state(elbow, elbow_q31, data):
    """From any state and input, corrupt or not, C and executor give the same bits."""
    word = st.one_of(
        st.integers(-(2**31), 2**31 - 1), st.sampled_from([-(2**31), 2**31 - 1, 0, 1, -1])
    )
    for block in elbow.system.kinds:
        plan, runner = plan_block(block), elbow_q31.block(block.name)

        def draw(fields, count):
            return {
                p.name: np.array(
                    data.draw(st.lists(word, min_size=count * p.size, max_size=count * p.size)),
                    dtype=np.int64,
                )
                .astype(np.int32)
                .reshape((count,) if p.size == 1 else (count, p.size))
                for p in (f.port for f in fields)
            }

        state, inputs = draw(plan.fields["state"], 1), draw(plan.fields["in"], 1)
        runner.put_state(state)
        y, s = runner.run(inputs, raw=True)
        expected_y, expected_s = RawExecutor(plan).steps(state, inputs)
        for name, value in {**expected_y, **{f"s {n}": v for n, v in expected_s.items()}}.items():
            got = s[name[2:]] if name.startswith("s ") else y[name]
            assert np.array_equal(got, value), name


def run_raw(executor: RawExecutor, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Outputs of a stream from the initial state."""
    state, outs = executor.initial(), []
    for k in range(len(next(iter(inputs.values())))):
        y, state = executor.steps(state, {n: u[k : k + 1] for n, u in inputs.items()})
        outs.append(y)
    return {n: np.concatenate([y[n] for y in outs]) for n in outs[0]}


GAINS = ((-2, 2), (-0.7, 0.7), (0.2, 3))


@given(
    seed=st.integers(0, 2**32 - 1),
    # To six places: an argument of tanh below 2.3e-10 has no format, and is refused.
    gains=st.tuples(*(st.floats(*r).map(lambda v: round(v, 6)) for r in GAINS)),
)
@example(seed=0, gains=(0.0, 5e-324, 1.0))
@settings(max_examples=25)
def test_any_small_block(seed, gains):
    """Blocks that nobody planned for: executor against exact arithmetic, bound never exceeded."""
    a, pole, power = gains

    def step(c, s, u, guard, label):
        mixed = label("mixed", a * u.x_rad + pole * s.m)
        curved = (
            ca.fabs(mixed) ** power / (1.5 + u.x_rad)
            + ca.tanh(mixed)
            + ca.sqrt(ca.fabs(u.x_rad) + 0.01)
        )
        out = ca.if_else(u.x_rad > 0.1, curved, ca.exp(-ca.fabs(mixed)))
        return {"m": clip(mixed, -2, 2)}, {"y": clip(out, -8, 8)}

    block = made(step, (port("m", -2, 2),), outputs=(port("y", -8, 8),))
    plan = Planner(block).plan()
    bound = block_bound(plan)
    x = np.random.default_rng(seed).integers(-(2**30), 2**30 + 1, 60).astype(np.int32)
    y = run_raw(RawExecutor(plan), {"x_rad": x})
    f = plan.field("in", "x_rad").fraction
    exact, _ = run_symbolic(block, Stream("random", {"x_rad": x * 2.0**-f}))
    error = np.abs(y["y"] * plan.field("out", "y").lsb - exact["y"])
    assert error.max() <= bound.outputs["y"] + 1e-12


def _one(step, **ports):
    return made(step, (port("m", -1, 1),), outputs=(port("y", -8, 8),), **ports)


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        (lambda x: 1 / x, ["'div'", "x_rad", "holds zero", "positive offset"]),
        (ca.log, ["'log'", "x_rad", "positive offset"]),
        (lambda x: x**0.5, ["x_rad"]),
        (lambda x: ca.exp(90 * x), ["'exp'", "too wide", "Clip"]),
        (lambda x: (1.5 + x) ** x, ["'pow'", "exponent varies"]),
        (lambda x: ca.tanh(1e12 * x), ["'tanh'", "too wide", "Clip"]),
        (lambda x: ca.tanh(1e-12 * x), ["'tanh'", "x_rad", "2e-12", "2.33e-10", "tanh(x) is x:"]),
        (lambda x: ca.exp(1e-12 * x), ["'exp'", "2e-12", "2.33e-10", "exp(x) is 1 + x:"]),
    ],
)
def test_what_cannot_be_lowered_says_what_where_and_what_would_do(expression, words):
    block = _one(lambda c, s, u, g, label: ({"m": s.m}, {"y": clip(expression(u.x_rad), -8, 8)}))
    with pytest.raises(LoweringError) as error:
        Planner(block).plan()
    for word in words:
        assert word in str(error.value)
    # Every command prints it as bad input, without a traceback.
    assert isinstance(error.value, UserError)
    assert "--real f32" in error.value.fix


@pytest.mark.parametrize(
    "expression", [lambda x: 1e-12 * x, lambda x: 1 + 1e-12 * x, lambda x: ca.tanh(3e-10 * x)]
)
def test_what_the_message_on_a_tiny_argument_advises_can_be_lowered(expression):
    block = _one(lambda c, s, u, g, label: ({"m": s.m}, {"y": clip(expression(u.x_rad), -8, 8)}))
    Planner(block).plan()


def test_the_executor_notices_a_broken_interval():
    lied = ex.add(ex.read("x", 32, 0, 10), ex.literal(1), 32)
    with pytest.raises(ex.OverflowProofError):
        ex.evaluate(lied, {"x": np.array([11], dtype=object)}, 1)


def test_a_wrong_coefficient_is_noticed(elbow, elbow_q31):
    """The comparison can fail: 1e-6 of one coefficient changes bits."""
    stream = streams(elbow.velocity, steps=300)[0]
    plan = plan_block(elbow.velocity)
    y, _ = run_c(elbow_q31.block("velocity"), stream, raw=True)
    for off, same in ((0, True), (64, False)):
        executor = RawExecutor(plan)
        executor.coefficients[1][0] += off
        expected = run_raw(executor, raw_stream(plan, stream))
        assert np.array_equal(y["omega_rad_s"], expected["omega_rad_s"]) is same


def _comments(header, struct):
    """Comment of every number of a struct, on one line, by field."""
    body = re.search(
        rf"typedef struct \{{((?:(?!typedef struct).)*?)\}} {struct};", header, re.DOTALL
    ).group(1)
    return {
        name: " ".join(re.sub(r"\n +\* ", " ", text).split())
        for text, name in re.findall(
            r"/\*((?:(?!\*/).)*)\*/\s*int32_t (\w+)(?:\[\d+\])?;", body, re.DOTALL
        )
    }


def header_problems(device, library):
    """Fields whose comment is not what the C checks, holds and does at the ends of the range."""
    header, wrong = library.files[f"{library.prefix}.h"], []
    for block in device.system.kinds:
        plan, stem = plan_block(block), f"{library.prefix}_{block.name}"
        step = library.files[f"{stem}.c"]
        behaviour = {
            "params": "outside: refused",
            "coeffs": "cut to it by prepare",
            "state": "cannot overflow",
            "in": "outside: ",
            "out": "cannot overflow",
        }
        for group, said in behaviour.items():
            fields = [f for f in plan.fields[group] if not f.whole]
            free = plan.fields[group] if group in ("in", "state") else ()
            flags = [f.name for f in free if f.port.kind == "flag"]
            wrong += [x for x in flags if not re.search(rf"\({x}(_now)? <= 1u\)", step)]
            comments = _comments(header, f"{stem}_{group}_t") if fields else {}
            for f in fields:
                form = "whole number" if f.fraction == 0 else f"Q{31 - f.fraction}.{f.fraction}"
                unit = "" if f.port.unit == "1" else f" {f.port.unit}"
                text = f"raw {f.low} to {f.high}, {form}, one unit is {f.lsb:.3g}{unit};"
                # The guard compares with the very numbers of the comment.
                guarded = group not in ("in", "state") or f.port.size > 1 or f"<= {f.high})" in step
                here = comments.get(f.name, "")
                if f.checked:
                    low, high = (x * 2.0**f.fraction for x in (f.port.low, f.port.high))
                    low, high = math.ceil(low), min(math.floor(high), 2**31 - 1)
                    least = f"({low})" if low < 0 else f"{low}"
                    upper = f"_held_q{f.fraction} <= {high})"
                    lower = rf"\({re.escape(least)} <= \w+_held"
                    guarded = upper in step and re.search(lower, step)
                    text += f" cut to it by prepare; outside {low} to {high}: found by the step"
                if text not in here or said not in here or not (guarded or f.high == 2**31 - 1):
                    wrong.append((block.name, group, f.name))
        wrong += [(block.name, "in", n) for n in _unguarded(plan)]
    return wrong


def _unguarded(plan):
    # Inputs whose last valid raw number is refused, or whose first invalid one is not.
    node = {name: i for i, (name, _) in plan.labels.items()}
    init = {f.port.name: np.zeros((4, f.port.size), np.int32) for f in plan.fields["state"]}
    wrong = []
    for f in plan.fields["in"]:
        if f.port.size > 1 or f"{f.port.name}_ok" not in node:
            continue
        inputs = {
            g.port.name: np.full((4, g.port.size), g.raw(max(g.port.low, 0.0)))
            for g in plan.fields["in"]
        }
        ends = [f.low, f.high, max(f.low - 1, -(2**31)), min(f.high + 1, 2**31 - 1)]
        inputs[f.port.name] = np.array(ends)[:, None]
        places, count = RawExecutor(plan).places(init, inputs)
        ok = lowered_values(plan.step, places, count).get(node[f"{f.port.name}_ok"])
        expected = [1, 1, int(ends[2] == f.low), int(ends[3] == f.high)]
        if ok is not None and [int(v) for v in ok] != expected:
            wrong.append(f.name)
    return wrong


def test_header_says_what_the_plan_holds(device, library):
    """Raw range, unit, format and what happens outside, in every comment, against the C."""
    assert header_problems(device, library) == []


def test_torque_stays_within_the_aim_for_a_whole_task(device, library):
    theta = domain_chirp(device, 10.0)
    task = device.system.tasks[0]
    runner = library.task(task.name)
    inputs = {x.name: theta for x in device.system.task_inputs(task)}
    got, _ = runner.run(inputs, trace=False)
    exact, _ = compile_device(device, "f64").task(task.name).run(inputs, trace=False)
    for name in got:
        if name.startswith("tau") and name.endswith("_Nm"):
            error = np.max(np.abs(got[name] - exact[name]))
            assert 0 < error < 0.0005 * device.tau_full_scale_Nm, name


@pytest.mark.slow
def test_half_an_hour(device, library):
    """30 minutes at 1 kHz: the error does not grow."""
    theta = np.tile(domain_chirp(device, 60.0), 30)
    task = device.system.tasks[0]
    inputs = {x.name: theta for x in device.system.task_inputs(task)}
    got, _ = library.task(task.name).run(inputs, trace=False)
    exact, _ = compile_device(device, "f64").task(task.name).run(inputs, trace=False)
    name = next(n for n in got if n.startswith("tau") and n.endswith("_Nm"))
    error = np.abs(got[name] - exact[name]).reshape(30, -1).max(axis=1)
    assert error.max() < 0.0005 * device.tau_full_scale_Nm
    assert error[-1] < 2 * error[:5].max()


def test_values_of_another_format_are_converted_and_saturate():
    def give(c, s, u, g, label):
        return {"m": s.m}, {"y_rad": clip(4 * u.x_rad, -3, 3)}

    def take(c, s, u, g, label):
        return {"m": s.m}, {"z_rad": u.x_rad}

    memory, half = (port("m", -1, 1),), port("x_rad", -0.5, 0.5, on_invalid=0.25)
    first = made(give, memory, most=3, name="first")
    second = made(take, memory, (half,), (port("z_rad", -1, 1),), name="second")
    require_tool("gcc")
    system = System(
        "pair",
        0.001,
        {"first": first, "second": second},
        (Task("run", ("first", "second")),),
        {"second.x_rad": "first.y_rad"},
        {"x_rad": ("first.x_rad",)},
        {"z_rad": "second.z_rad"},
    )
    z, _ = (
        compile_system(system, "q31")
        .task("run")
        .run({"x_rad": np.array([0.1, -0.1, 0.7, -0.7])}, trace=False)
    )
    # 2.8 rad does not fit the second Block's format: it saturates, and is invalid there.
    assert np.allclose(z["z_rad"], [0.4, -0.4, 0.25, 0.25], atol=1e-8)


def test_tunables_are_prepared_and_refused(elbow, elbow_q31):
    runner = elbow_q31.task("sense")
    assert runner.prepare({"velocity": {"bandwidth_Hz": 40.0}}) == 0
    for bad in (101.0, 1.0, float("nan")):
        assert runner.prepare({"velocity": {"bandwidth_Hz": bad}}) == 1
    plan = plan_block(elbow.velocity)
    for bandwidth in (2.0, 7.7, 15.0, 60.0, 100.0):
        exact = elbow.velocity.simulator({"bandwidth_Hz": bandwidth}).coefficients
        raw = RawExecutor(plan, {"bandwidth_Hz": bandwidth}).coefficients
        for f, (r,) in zip(plan.fields["coeffs"], raw, strict=True):
            value = float(exact[f.port.name][0])
            assert abs(r * f.lsb - value) <= f.lsb + 2e-6 * value, f.name


def test_the_folder_is_written_and_stands_alone(elbow, tmp_path):
    gcc = require_tool("gcc")
    import subprocess

    bundles = render_device(elbow, ["q31"])
    write_bundles(bundles, tmp_path)
    assert differences(bundles, tmp_path) == []
    folder = tmp_path / "q31"
    shipped = [p for p in folder.glob("*.c") if p.name != "main.c"]  # the example is for hosts
    text = "".join(p.read_text() for p in shipped) + "".join(
        p.read_text() for p in folder.glob("esea_elbow*.h") if "_units" not in p.name
    )
    assert not re.search(
        r"\b(float|double)\b(?![^\n]*\*)", re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    )
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    sources = sorted(str(p) for p in folder.glob("*.c"))
    subprocess.run([gcc, *strict, *sources, "-o", str(tmp_path / "example")], check=True)
    done = subprocess.run([str(tmp_path / "example")], capture_output=True, text=True, check=True)
    assert "12 of 12 samples agree" in done.stdout


@pytest.mark.parametrize("checked", [True, False])
def test_a_coefficient_is_free_where_the_step_checks_it_and_nowhere_else(checked):
    """The structure decides: the same Block with its check and without it."""
    gain, most = Port("gain", 0.5, 1.5, "factor"), around("x_Nm", 1.5, "what it multiplies")

    def step(c, s, u, _guard, _label):
        sound = in_range(c.gain, 0.5, 1.5) if checked else ca.SX(1)
        return {"y_Nm": s.y_Nm}, {"y_Nm": ca.if_else(sound, c.gain * u.x_Nm, 0.0)}

    tunable = Tunable("gain", 1.0, 0.5, 1.5, "factor", "here", "assumed")
    prepared = {"tunables": (tunable,), "coefficients": (gain,)}
    prepared |= {"prepare": lambda t: {"gain": t.gain}}
    memory, product = around("y_Nm", 1.5, "unused"), around("y_Nm", 2.25, "product")
    block = made(step, (memory,), (most,), (product,), **prepared)
    plan = plan_block(block)
    (held,), (x,), (y,) = (plan.fields[g] for g in ("coeffs", "in", "out"))
    assert held.checked == checked
    raw = [held.raw(v) for v in (0.5, 1.5)]
    ends = [raw[0], raw[1], raw[0] - 1, raw[1] + 1, -(2**31), 2**31 - 1]
    places = {f"coeffs->{held.name}": np.array(ends, dtype=object)}
    places |= {f"in->{x.name}": np.array([x.raw(1.5)] * 6, dtype=object)}
    places |= {f"state->{f.name}": np.zeros(6, dtype=object) for f in plan.fields["state"]}
    product = run_lowered(plan.step, places, 6)[1][0] * y.lsb
    if checked:
        assert product.astype(float) == pytest.approx([0.75, 2.25, 0, 0, 0, 0], abs=1e-8)
    else:  # trusted: nothing stands between
        assert product.astype(float)[:2] == pytest.approx([0.75, 2.25], abs=1e-8)
        assert not any("held" in s.name for s in plan.step.steps)
