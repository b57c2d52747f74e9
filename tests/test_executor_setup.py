"""What surrounds the second executor's steps: settings, counters, arguments, streams at ties."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.stream import Stream, single
from esea_gen.language.system import System, Task
from esea_gen.verify.coverage import recorded_arguments
from esea_gen.verify.executor import (
    KernelTrajectory,
    coefficients_of,
    counter_fields,
    emitted_kernel,
    expected_counters,
    expected_setup,
    float32_trajectory,
    initial_state,
    step_arguments,
)
from esea_gen.verify.runs import CasadiOracle, changed, run_symbolic
from esea_gen.verify.ties import aimed_stream

from .conftest import require_tool

F32, F64 = FORMATS["f32"], FORMATS["f64"]


def made_up(prepare=None) -> Block:
    """Two tunables, three coefficients, a vector state, a vector input, a counted flag."""

    def step(c, s, u, guard, label):
        total = s.sum + c.gain * (u.v[1] - c.pair[0] * u.x)
        pair = [s.last[1], u.x]
        word = flag_word([ca.logic_not(guard.inputs_ok), total > 1.5, u.x < c.pair[1]])
        return {"sum": ca.fmin(ca.fmax(total, -2), 2), "last": pair}, {
            "y": total,
            "both": [s.last[0], total],
            "status": word,
        }

    return Block.define(
        *("made", "made up"),
        period_s=1e-3,
        tunables=(Tunable("a", 0.5, 0.25, 2.25, "a"), Tunable("b", 0.1, -1.0, 3.0, "b")),
        coefficients=(Port("gain", -9, 9, "gain"), Port("pair", -9, 9, "pair", 2)),
        prepare=prepare or (lambda t: {"gain": t.a * t.b, "pair": [t.a, t.b]}),
        state=(Port("sum", -2, 2, "sum", init=0.3), Port("last", -1, 1, "last", 2, init=-0.5)),
        inputs=(Port("x", -1, 1, "x"), Port("v", -3, 3, "v", 2)),
        outputs=(
            Port("y", -9, 9, "y"),
            Port("both", -9, 9, "both", 2),
            Port(
                *("status", 0, 7, "status"),
                flags=(
                    Flag("BAD", "bad", True),
                    Flag("HIGH", "high"),
                    Flag("LOW", "low", True),
                ),
            ),
        ),
        step=step,
    )


def test_settings_that_a_block_is_prepared_with():
    found = expected_setup(made_up(), F64)
    settings = [values for values, _ in found.prepared]

    def f(v):
        return float(np.float32(v))

    assert settings[0] == {"a": 0.5, "b": 0.1}
    shares = (0.0, 0.11, 0.37, 0.5, 0.83, 1.0)
    assert settings[1:7] == [{"a": f(0.25 + 2 * s), "b": f(-1 + 4 * s)} for s in shares]
    chance = settings[7:47]
    for name, low, high in (("a", 0.25, 2.25), ("b", -1.0, 3.0)):
        values = np.array([v[name] for v in chance])
        assert np.all((values >= low) & (values <= high))
        assert len(set(values)) == 40
        assert np.array_equal(values, single(values))
        assert np.mean(values) == pytest.approx((low + high) / 2, abs=0.15 * (high - low))
        assert np.std(values) == pytest.approx((high - low) / np.sqrt(12), rel=0.3)
    times = (1e-3, 0.03, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3)
    assert settings[47:] == [{"a": f(0.5 * t), "b": f(0.1 * t)} for t in times]
    for values, columns in found.prepared:
        a, b = values["a"], values["b"]
        assert [c.tolist() for c in columns] == [[a * b], [a, b]]
    assert [s.tolist() for s in found.start] == [[0.3], [-0.5, -0.5]]
    # In f32 they are rounded as its C rounds: the tunable, then the product.
    a, b = np.float32(0.5), np.float32(0.1)
    found = expected_setup(made_up(), F32)
    columns = found.prepared[0][1]
    assert [c.tolist() for c in columns] == [[float(a * b)], [float(a), float(b)]]
    assert {c.dtype for c in columns} == {np.dtype(np.float32)}
    assert found.start[0].tobytes() == np.array([0.3], np.float32).tobytes()


def test_settings_that_give_no_number_are_left_out():
    logs = made_up(lambda t: {"gain": ca.log(t.b), "pair": [t.a, t.b]})
    for fmt in (F64, F32):
        kept = [values["b"] for values, _ in expected_setup(logs, fmt).prepared]
        assert min(kept) > 0
        assert len(kept) < 55
        assert kept[0] == 0.1


def test_coefficients_and_states_at_the_start():
    block = made_up()
    assert [c.tolist() for c in coefficients_of(block, F64, {})] == [[0.5 * 0.1], [0.5, 0.1]]
    assert [c.tolist() for c in coefficients_of(block, F64, {"b": 2.0})] == [[1.0], [0.5, 2.0]]
    found = coefficients_of(block, F32, {"b": 2.0})
    assert [c.tolist() for c in found] == [[1.0], [0.5, 2.0]]
    assert [s.tolist() for s in initial_state(block, F64, found)] == [[0.3], [-0.5, -0.5]]
    plain = replace(block, tunables=())
    assert coefficients_of(plain, F32, {}) == coefficients_of(plain, F64, {}) == []
    assert counter_fields(block) == {"n_bad": ("status", 0), "n_low": ("status", 2)}


def streams_of(steps=6, **more) -> Stream:
    rng = np.random.default_rng(4)
    x, v = single(rng.uniform(-1, 1, steps)), single(rng.uniform(-3, 3, (steps, 2)))
    return Stream("made", {"x": x, "v": v}, **more)


def test_counters_count_and_stay_at_their_end():
    block, top = made_up(), 2**32 - 1
    word = np.array([1, 0, 5, 4, 5, 7], np.uint32)
    stream = streams_of()
    found = expected_counters(block, stream, {"status": word})
    assert {n: c.tolist() for n, c in found.items()} == {
        **{"n_bad": [1, 1, 2, 2, 3, 4], "n_low": [0, 0, 1, 2, 3, 4]}
    }
    assert {c.dtype for c in found.values()} == {np.dtype(np.uint32)}
    put = streams_of(injections={2: {"n_bad": np.array(top - 1)}, 4: {"n_low": np.array(7)}})
    found = expected_counters(block, put, {"status": word})
    assert {n: c.tolist() for n, c in found.items()} == {
        **{"n_bad": [1, 1, top, top, top, top], "n_low": [0, 0, 1, 2, 8, 9]}
    }


@pytest.mark.parametrize("fmt", [F32, F64], ids=["f32", "f64"])
def test_arguments_of_every_step(fmt):
    block = made_up()
    put = {3: {"last": np.array([0.25, 0.75])}, 4: {"sum": np.array([1.0])}}
    other = {2: {"pair": np.array([0.7, 0.8])}, 5: {"gain": np.array([3.0])}}
    stream = streams_of(injections=put, coefficients=other)
    coefficients, initial = coefficients_of(block, fmt, {}), [np.array([0.3]), np.full(2, -0.5)]
    sums = np.arange(6) / 7
    pairs = np.arange(12).reshape(6, 2) / 13
    states = {"sum": sums, "last": pairs}
    plain = step_arguments(block, stream, states, initial, coefficients, fmt)
    recorded = recorded_arguments(block, stream, states, initial, coefficients, fmt)
    assert {a.dtype for a in (*plain, *recorded)} == {fmt.dtype}
    assert [a.shape for a in plain] == [(6, 1), (6, 2), (6, 1), (6, 2), (6, 1), (6, 2)]
    kind = fmt.dtype.type
    gain, pair = coefficients
    np.testing.assert_array_equal(plain[0], np.tile(gain, (6, 1)))
    np.testing.assert_array_equal(plain[1], np.tile(pair, (6, 1)))
    # The state before a step is the one after the step before, or what was put in.
    before = [kind(0.3), *sums.astype(kind)[:3], kind(1.0), kind(sums[4])]
    np.testing.assert_array_equal(plain[2][:, 0], np.array(before))
    before = [[-0.5, -0.5], *pairs[:2].tolist(), [0.25, 0.75], *pairs[3:5].tolist()]
    np.testing.assert_array_equal(plain[3], np.array(before).astype(kind))
    np.testing.assert_array_equal(plain[4][:, 0], stream.inputs["x"])
    np.testing.assert_array_equal(plain[5], stream.inputs["v"])
    # Of coefficients, those put in last; what is not named is as prepared.
    assert recorded[1].tolist() == [*2 * [pair.tolist()], *3 * [[kind(0.7), kind(0.8)]], [*pair]]
    assert recorded[0].ravel().tolist() == [*5 * gain.tolist(), 3.0]
    for a, b in zip(plain[2:], recorded[2:], strict=True):
        np.testing.assert_array_equal(a, b)
    one = changed(block, [gain, pair], {"pair": np.array([[1.0], [2.0]])})
    assert [c.tolist() for c in one] == [gain.tolist(), [1.0, 2.0]]


def test_a_run_in_float32_by_hand():
    block, f = made_up(), np.float32
    stream = streams_of(injections={2: {"n_bad": np.array(5), "sum": np.array([9.0])}})
    stream.inputs["x"][4] = np.nan
    coefficients = coefficients_of(block, F32, {})
    initial = initial_state(block, F32, coefficients)
    states = {"sum": f([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), "last": np.zeros((6, 2), f)}
    given = step_arguments(block, stream, states, initial, coefficients, F32)
    kernel, names = emitted_kernel(block, F32)
    assert {"x_ok", "x_used", "v_ok", "inputs_ok", "state_ok"} <= {n for n, _ in names.values()}
    found = float32_trajectory(kernel, block, stream, given)
    gain, (p, q) = f(0.5) * f(0.1), (f(0.5), f(0.1))
    sums = [f(0.3), f(0.1), f(0.3), f(0.3), f(0.4), f(0.5)]  # 9 is outside: it starts afresh
    x = f(np.nan_to_num(stream.inputs["x"]))
    v = f(stream.inputs["v"])[:, 1]
    total = [s + gain * (b - p * a) for s, a, b in zip(sums, x, v, strict=True)]
    np.testing.assert_array_equal(found.outputs["y"], np.array(total))
    np.testing.assert_array_equal(found.states["sum"], np.clip(np.array(total), f(-2), f(2)))
    np.testing.assert_array_equal(found.outputs["both"][:, 1], np.array(total))
    assert found.outputs["both"][0, 0] == f(-0.5)
    word = (np.arange(6) == 4) + 2 * (np.array(total) > 1.5) + 4 * (x < q)
    np.testing.assert_array_equal(found.outputs["status"], word)
    assert found.outputs["status"].dtype == np.uint32
    assert found.states["n_bad"].tolist() == [0, 0, 5, 5, 6, 6]
    assert found.states["n_low"].tolist() == np.cumsum(x < q).tolist()
    np.testing.assert_array_equal(found.states["last"][:, 1], x)


def test_the_first_difference_in_any_bit():
    stream = Stream("tried", {"x": np.zeros(4)})
    y, pair = np.float32([0, 1, 2, 3]), np.arange(8, dtype=float).reshape(4, 2)
    whole = KernelTrajectory(stream, {"y": y}, {"pair": pair, "n": np.arange(4, dtype=np.uint32)})
    states = {"pair": pair, "n": np.arange(4), "more": np.zeros(1)}
    assert whole.first_difference({"y": y}, states) == ""
    other = y.copy()
    other[3] = 9
    negative = y.copy()
    negative[0] = -0.0
    said = whole.first_difference({"y": other}, states)
    assert said == f"tried: output y at step 3: {other[3]!r} instead of {y[3]!r}"
    assert whole.first_difference({"y": negative}, states).startswith("tried: output y at step 0: ")
    moved = pair.copy()
    moved[2, 1] += 1e-15
    said = whole.first_difference({"y": other}, states | {"pair": moved})
    assert said.startswith("tried: state pair at step 2: ")
    assert whole.first_difference({"y": y}, states | {"n": np.array([0, 1, 2, 4])}).endswith(
        f"{np.uint32(4)!r} instead of {np.uint32(3)!r}"
    )


# -- streams at ties -------------------------------------------------------------------------------


def deciding(init: float = 0.25, edge: float = 0.5, b: float = 0.75) -> Block:
    """Decides on the second element of a vector times a coefficient, and on a state."""

    def step(c, s, u, guard, label):
        first = ca.if_else(c.gain * u.v[1] < edge, 1.0, 2.0)
        return {"s": ca.fmin(s.s + 0.25 * u.v[0], 0.9)}, {"y": first + 0.0 * s.s}

    return Block.define(
        *("deciding", "made up"),
        period_s=1e-3,
        tunables=(Tunable("b", b, 0.5, 1.0, "b"),),
        coefficients=(Port("gain", 0, 1, "gain"),),
        prepare=lambda t: {"gain": 1 * t.b},
        state=(Port("s", -1, 1, "s", init=init),),
        inputs=(Port("v", -1, 1, "v", 2),),
        outputs=(Port("y", 0, 4, "y"),),
        step=step,
    )


def walk(seed=1, **more) -> Stream:
    rng = np.random.default_rng(seed)
    return Stream("walk", {"v": single(rng.uniform(-0.9, 0.9, (80, 2)))}, **more)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_vectors_element_is_moved_to_the_edge(dtype):
    block = deciding()
    (found,) = aimed_stream(block, [walk()], dtype, trials=4)
    v, s = found.inputs["v"], np.array([found.injections[k]["s"][0] for k in range(found.steps)])
    assert found.name == "aimed at every decision"
    assert sorted(found.injections) == list(range(found.steps))
    assert np.all((np.abs(v) <= 1) & (np.abs(s) <= 1)[:, None])
    unit = float(np.spacing(dtype(0.5)))
    apart = dtype(0.75) * v[:, 1].astype(dtype) - dtype(0.5)
    at = np.abs(apart) <= 2 * unit
    for side in (apart < 0, apart > 0):
        assert np.sum(at & side) >= 3
        # And 0.4 % of the edge beside it, whatever the slope.
        beside = side & (np.abs(apart) > 1e-4) & (np.abs(apart) < 0.01 * 0.5)
        assert np.median(np.abs(apart[beside])) == pytest.approx(0.004 * 0.5, rel=0.02)
    # The clip of the state, by the state or by the other element.
    clipped = np.abs(s + 0.25 * v[:, 0] - 0.9)
    assert np.sum(clipped <= 4 * unit) >= 4
    # The other element is anywhere, as it was in the streams.
    assert set(single(v[at, 0])) <= set(walk().inputs["v"][:, 0])
    assert found.steps <= 4 * 4 * 2 * 20


@pytest.mark.ci
def test_what_was_found_serves_an_equal_block_and_no_other():
    first = aimed_stream(deciding(), [walk()], trials=2)
    assert aimed_stream(deciding(), [walk()], trials=2) is first
    one = {1: {"s": np.array([0.5])}}
    narrower = replace(deciding(), inputs=(Port("v", -1, 0.95, "v", 2),))
    for other in (
        aimed_stream(deciding(), [walk()], trials=3),
        aimed_stream(deciding(), [walk()], trials=2, seed=6),
        aimed_stream(deciding(), [walk()], np.float64, trials=2),
        aimed_stream(deciding(), [walk(2)], trials=2),
        aimed_stream(deciding(), [walk(), walk()], trials=2),
        aimed_stream(deciding(), [walk(injections=one)], trials=2),
        aimed_stream(deciding(), [walk(injections={2: one[1]})], trials=2),
        aimed_stream(deciding(init=0.5), [walk()], trials=2),
        aimed_stream(deciding(edge=0.4), [walk()], trials=2),
        aimed_stream(deciding(b=0.8), [walk()], trials=2),
        aimed_stream(narrower, [walk()], trials=2),
    ):
        assert other is not first


def test_only_steps_inside_all_ranges_are_gone_out_from():
    block = deciding()
    outside = Stream("far", {"v": np.full((5, 2), 1.5)})
    half = Stream("half", {"v": np.tile([0.5, -1.5], (5, 1))})
    other = walk(coefficients={0: {"gain": np.array([0.5])}})
    assert aimed_stream(block, [outside, half, other]) == []
    _, states = run_symbolic(block, walk())
    assert np.max(states["s"]) <= 0.9
    edge = Stream("edge", {"v": np.tile([1.0, -1.0], (5, 1))})  # the ends are inside
    assert aimed_stream(block, [edge], trials=2) != []


def test_casadis_own_c_has_the_steps_of_the_symbolic_block():
    """With coefficients and states put in from outside, at the steps where they are."""
    require_tool("gcc")
    block = made_up()
    assert not block.starts_latched  # nothing to release where nobody says so
    put = {3: {"last": np.array([0.25, 0.75])}, 4: {"sum": np.array([1.0])}}
    other = {2: {"pair": np.array([0.7, 0.8])}, 5: {"gain": np.array([3.0])}}
    stream = streams_of(injections=put, coefficients=other)
    system = System("made", 1e-3, {"made": block}, (Task("run", ("made",)),), {}, *wired(block))
    initial = [np.array([0.3]), np.full(2, -0.5)]
    oracle = CasadiOracle(system)
    found = oracle.run(block, coefficients_of(block, F64, {}), initial, stream)
    for ours, theirs in zip(run_symbolic(block, stream), found, strict=True):
        assert sorted(ours) == sorted(theirs)
        for name, values in ours.items():
            np.testing.assert_array_equal(np.squeeze(theirs[name]), np.squeeze(values))
    # And by hand: y = sum + gain (v[1] - pair[0] x), gain 0.05 and pair (0.5, 0.1) at first.
    x, v, y = stream.inputs["x"], stream.inputs["v"][:, 1], np.ravel(found[0]["y"])
    total, steps = 0.3, []
    for k in range(6):
        total = 1.0 if k == 4 else total
        gain, share = 3.0 if k == 5 else 0.05, 0.5 if k < 2 or k == 5 else 0.7
        steps.append(total + gain * (v[k] - share * x[k]))
        total = min(max(steps[-1], -2), 2)
    assert y == pytest.approx(steps, rel=1e-12)


def wired(block):
    return (
        {p.name: (f"made.{p.name}",) for p in block.inputs},
        {p.name: f"made.{p.name}" for p in block.outputs},
    )
