"""The samples of generated streams, one by one, of a Block whose ranges are all different."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from esea_gen.language.block import Block
from esea_gen.language.ports import Constant, Flag, Port, Tunable
from esea_gen.language.stream import SPECIAL, single
from esea_gen.language.system import System, Task
from esea_gen.verify import memories
from esea_gen.verify.streams import at_the_limits, inside, streams, working_inputs

MARK, EDGE = 0.3, 2.75
X = Port("x_rad", 1.0, 4.0, "off its middle")
N = Port("n", 0.0, 9.0, "counts")
V = Port("v_rad_s", -2.0, 6.0, "two of them", 2)
STATE = (
    Port("s_rad", -0.5, 8.0, "a state", init=0.25),
    Port("m", 0.0, 5.0, "a state that counts", init=2.0),
    Port("w_Nm", -3.0, 2.0, "three of them", 3, init=0.125),
)
FLAGS = (Flag("BAD", "counted", True), Flag("FAR", "not counted", threshold=EDGE))


def made_up(state=STATE) -> Block:
    def step(c, s, u, guard, label):
        return vars(s), {"y_rad": u.x_rad, "tau_Nm": 0, "status": 0}

    return Block.define(
        *("made", "made up"),
        period_s=1e-3,
        constants=(
            Constant("mark_rad", MARK, "made up", "assumed"),
            Constant("other_Nm", 0.7, "made up", "assumed"),
        ),
        state=state,
        inputs=(X, N, V),
        outputs=(
            Port("y_rad", -0.375, 2.5, "out"),
            Port("tau_Nm", -1.5, 1.75, "out"),
            Port("status", 0, 3, "status", flags=FLAGS),
        ),
        step=step,
    )


@pytest.fixture(scope="module")
def found():
    return {s.name: s for s in streams(made_up(), seed=2, steps=3000)}


def folded(x: np.ndarray, port: Port, reach: float) -> np.ndarray:
    """In halves of the port's range, from its middle, over what is to be reached."""
    middle, half = (port.low + port.high) / 2, (port.high - port.low) / 2
    return (x - middle) / (half * reach)


def test_every_sample_is_a_float32_number_and_what_counts_is_whole(found):
    for stream in found.values():
        assert stream.steps == 3000
        assert stream.rough
        for p in (X, N, V):
            x = stream.inputs[p.name]
            assert x.shape == ((3000,) if p.size == 1 else (3000, 2))
            usual = ~(np.abs(x) > 1e38)  # all but what is near the end of float32
            np.testing.assert_array_equal(x[usual], single(x)[usual])
    for name in ("random walk", "noise over the range", "chirp", "reversals and plateaus"):
        whole = found[name].inputs["n"]
        np.testing.assert_array_equal(whole, np.rint(whole))
        assert not np.any(np.signbit(whole))


def test_walks_chirps_and_reversals_about_the_middle(found):
    for p in (X, V):
        walk = folded(found["random walk"].inputs[p.name], p, 0.55)
        assert np.max(np.abs(walk)) <= 1 + 1e-6
        assert np.std(np.diff(walk, axis=0)) == pytest.approx(0.01, rel=0.05)
        noise = folded(found["noise over the range"].inputs[p.name], p, 1.0)
        assert np.mean(noise) == pytest.approx(0, abs=0.05)
        assert np.std(noise) == pytest.approx(3**-0.5, rel=0.03)
        assert np.max(np.abs(noise)) <= 1
        turns = folded(found["reversals and plateaus"].inputs[p.name], p, 1.0)
        for k in range(0, 2999, 25):
            if (k // 400) % 3 != 2 and k % 400 < 375:  # straight from one knot to the next
                assert np.max(np.abs(np.diff(turns[k : k + 26], 2, axis=0))) < 1e-5
        assert 0.5 < np.max(turns) <= 0.6
        assert -0.6 <= np.min(turns) < -0.5
    # A chirp of phase 0.7 times the input's place: 2 turns a stream at first, 42 at last.
    t = np.linspace(0, 1, 3000)
    for i, p in ((0, X), (2, V)):
        by_hand = np.sin(2 * np.pi * t * (2 + 20 * t) + 0.7 * i)
        chirp = found["chirp"].inputs[p.name]
        for column in chirp.reshape(3000, -1).T:
            assert folded(column, p, 0.57) == pytest.approx(by_hand, abs=1e-5)
    # The elements of a vector walk each for itself, and share one plateau.
    one, other = found["random walk"].inputs["v_rad_s"].T
    assert not np.array_equal(one, other)
    one, other = found["reversals and plateaus"].inputs["v_rad_s"].T
    assert np.array_equal(one, other)
    assert set(np.unique(found["jumps"].inputs["x_rad"])) == {1.0, 4.0, 2.0, 0.0}
    assert set(np.unique(found["jumps"].inputs["v_rad_s"])) == {-2.0, 6.0, 3.0, 0.0}


def test_what_is_tried_of_thresholds_is_each_of_them_and_its_neighbours(found):
    def beside(marks):
        f = np.float32
        every = [f(m) for m in marks]
        sides = [np.nextafter(m, f(s * np.inf)) for m in every for s in (-1, 1)]
        return {float(m) for m in (*every, *sides)}

    common = [0.0, 1e-45, -1e-45, 1.2e-38, EDGE, -EDGE]
    multiples = [k * MARK * s for k in range(1, 12) for s in (-1, 1)]
    for p, marks in ((X, multiples), (V, [])):
        expected = {x for x in beside([p.low, p.high, *common, *marks]) if p.low <= x <= p.high}
        tried = found["thresholds"].inputs[p.name]
        assert {float(x) for x in np.unique(tried)} == expected
        # Each is held for one to three steps.
        column = tried.reshape(3000, -1)[:, 0]
        held = np.diff(np.flatnonzero(np.diff(column)))
        share = np.bincount(held, minlength=4)[1:4] / len(held)
        assert share == pytest.approx(np.full(3, 1 / 3), abs=0.06)


def test_what_is_put_in_is_of_each_kind(found):
    bad = found["invalid inputs"].inputs
    for p in (X, V):
        beyond = {float(single(1.5 * p.high + 1e-3)), float(single(1.5 * p.low - 1e-3))}
        walk = found["random walk"].inputs[p.name]
        changed = bad[p.name][~(bad[p.name] == walk)]
        assert {float(x) for x in changed if abs(x) < 1e38} - beyond == set()
        assert {float(x) for x in changed if not np.isnan(x)} == beyond | set(SPECIAL[1:])
        assert np.sum(np.isnan(changed)) / len(changed) == pytest.approx(1 / 7, abs=0.05)
    many = {s.name: s for s in streams(made_up(), seed=2, steps=40_000)}["corrupt states"]
    assert list(many.injections) == list(range(20, 40_000, 40))
    put = {p.name: [] for p in STATE}
    for one in many.injections.values():
        ((name, value),) = one.items()
        put[name].append(value)
    for p in STATE:
        values = np.array(put[p.name])
        assert values.shape[1:] == (p.size,)
        assert len(values) == pytest.approx(1000 / 3, rel=0.2)
        outside = ~((values >= p.low) & (values <= p.high))
        assert np.max(outside.sum(axis=1)) == 1  # at most one element
        expected = {*SPECIAL[1:], 1e6, -1e6, 3 * p.high + 1}
        assert {float(x) for x in values[outside] if not np.isnan(x)} == expected
        assert np.mean(outside.any(axis=1)) == pytest.approx(0.8, abs=0.07)
        assert np.isnan(values).any()
        within = values[~outside]
        half = (p.high - p.low) / 2
        assert np.std(within) == pytest.approx(half * 3**-0.5, rel=0.2)
        if p.name == "m":
            np.testing.assert_array_equal(within, np.rint(within))
    assert "corrupt states" not in [s.name for s in streams(made_up(()), steps=500)]
    assert inside(many, {"x_rad": (1.0, 4.0), "v_rad_s": (-2.0, 6.0), "gone": (0.0, 0.0)})
    lowest = float(many.inputs["v_rad_s"].min())
    assert inside(many, {"v_rad_s": (lowest, 6.0)})
    assert not inside(many, {"x_rad": (1.0, 4.0), "v_rad_s": (lowest + 1e-6, 6.0)})


# -- at the limits ---------------------------------------------------------------------------------


def sides(dtype, *marks) -> set[float]:
    values = [dtype(m) for m in marks]
    return {
        float(x)
        for m in values
        for x in (m, np.nextafter(m, dtype(-np.inf)), np.nextafter(m, dtype(np.inf)))
    }


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_states_stand_at_each_limit_alone_and_among_others(dtype):
    s = at_the_limits(made_up(), dtype, seed=3, steps=3000)
    names = [p.name for p in STATE]
    initial = {p.name: np.full(p.size, p.init) for p in STATE}
    # Ends, zero, a thousandth of the upper end, and the ends of outputs of the same unit.
    limits = {
        "s_rad": sides(dtype, -0.5, 8.0, 0.0, 8e-3, -0.375, 2.5),
        "m": sides(dtype, 0.0, 5.0, 5e-3),
        "w_Nm": sides(dtype, -3.0, 2.0, 0.0, 2e-3, -1.5, 1.75),
    }
    assert s.name == "at the limits"
    alone, among = (
        {(n, e): set() for p in STATE for n, e in [(p.name, k) for k in range(p.size)]}
        for _ in range(2)
    )
    for one in s.injections.values():
        for p in STATE:
            if p.name not in one:
                continue
            for e in range(p.size):
                rest = {n: v for n, v in one.items() if n != p.name and not n.startswith("n_")}
                others = np.delete(one[p.name], e)
                if not np.array_equal(others, np.delete(initial[p.name], e)):
                    continue
                if not rest:
                    alone[p.name, e].add(float(one[p.name][e]))
                elif all(np.array_equal(v, initial[n]) for n, v in rest.items()):
                    among[p.name, e].add(float(one[p.name][e]))
    for (name, e), values in alone.items():
        assert limits[name] <= values, (name, e)
        assert limits[name] <= among[name, e], (name, e)
    # The guard of a vector: three times the larger magnitude and a thousandth.
    total = float(np.float32(1.001 * 3 * 3.0))
    single_ = [one["w_Nm"] for one in s.injections.values() if list(one) == ["w_Nm"]]
    lone = {float(np.sum(v)) for v in single_ if np.count_nonzero(v) == 1}
    assert sides(dtype, total) <= lone
    for e in range(3):
        at_e = {float(v[e]) for v in single_ if np.count_nonzero(v) == 1 and v[e] != 0}
        assert {float(single(1.01 * total)), float(single(-1.01 * total))} <= at_e
    spread = [v for v in single_ if np.count_nonzero(v) == 3 and np.all(v != 0.125)]
    sums = sorted(float(np.sum(np.abs(v))) / total for v in spread)
    assert [x for x in sums if abs(x - 1) < 1e-5] == pytest.approx([0.999999, 1.000001], abs=3e-7)
    # Everything that was made up has its step, from the third on.
    cases = 2 * (len(limits["s_rad"]) + len(limits["m"]) + 3 * len(limits["w_Nm"]))
    cases += 3 + 2 * 3 + 2 + 3 + 40 + 120
    at = list(s.injections)
    assert len(at) == cases
    assert at == list(range(3, 3 + cases * (at[1] - 3), at[1] - 3))
    assert at[1] - 3 == (3000 - 3) // cases
    # Of the rest forty put every state anywhere in its range.
    whole = [
        one
        for one in itertools.islice(s.injections.values(), 120, None)
        if list(one) == names
        and all(p.low <= x <= p.high for p in STATE for x in one[p.name])
        and not any(np.array_equal(one[n], initial[n]) for n in names)
    ]
    assert len(whole) == 40
    assert np.std([w["w_Nm"] for w in whole]) == pytest.approx(2.5 * 3**-0.5, rel=0.2)


def test_inputs_and_states_at_their_ends_together():
    s = at_the_limits(made_up(), np.float32, seed=3, steps=3000)
    at = list(s.injections)
    ends = {"x_rad": (1.0, 4.0), "n": (9.0, 9.0), "v_rad_s": (-2.0, 6.0)}
    states = {"s_rad": (-0.5, 8.0), "m": (5.0, 5.0), "w_Nm": (-3.0, 2.0)}
    middle = {"x_rad": 2.5, "n": 4.5, "v_rad_s": 2.0}
    kinds = {"one end": 0, "mixed": 0, "middle": 0, "near": 0}
    for k, step in enumerate(at[:120]):
        given = {n: s.inputs[n][step] for n in ends}
        held = s.injections[step]
        assert list(held)[:3] == list(states)
        if k < 4:  # all at the lower end, then all at the upper; 0 is no end
            for n, pair in ends.items():
                assert np.all(given[n] == pair[k % 2])
            for n, pair in states.items():
                assert np.array_equal(held[n], np.full(len(held[n]), pair[k % 2]))
            kinds["one end"] += 1
        for n, pair in states.items():
            assert len(set(held[n])) == 1
            share = [float(held[n][0]) / e for e in pair]
            assert any(x == 1 for x in share) if k < 64 else any(0.97 <= x <= 1 for x in share)
            kinds["near"] += all(x != 1 for x in share)
        for n, pair in ends.items():
            if np.all(given[n] == middle[n]) and n != "v_rad_s":
                kinds["middle"] += 1
            elif k < 64:
                assert np.all(given[n] == pair[0]) or np.all(given[n] == pair[1]) or n == "v_rad_s"
        kinds["mixed"] += (held["s_rad"][0] > 0) != (held["w_Nm"][0] > 0)
        # Every second one has counters at their top.
        assert ("n_bad" in held) == (k % 2 == 1)
        if k % 2:
            assert int(held["n_bad"]) == 2**32 - 1 - (k // 2) % 3
    assert kinds["one end"] == 4
    assert kinds["mixed"] == pytest.approx(0.5 * 116, rel=0.35)
    assert kinds["middle"] == pytest.approx(0.4 * 2 * 116, rel=0.25)
    assert kinds["near"] == pytest.approx(3 * 56, rel=0.05)
    # Later, in every sixth, no input is a number; between, inputs go to their ends now and then.
    nans = np.flatnonzero(np.isnan(s.inputs["x_rad"]))
    assert nans.tolist() == list(range(3, 3000, at[1] - 3))[120::6]
    usual = np.ones(3000, bool)
    usual[[*at, *nans]] = False
    for p in (X, V):
        x = s.inputs[p.name][usual]
        walk = np.abs(folded(x, p, 0.55)) <= 1 + 1e-6
        marks = sides(np.float32, p.low, p.high, *(m for m in (0.0, 1e-3 * p.high) if p is V))
        if p is X:
            marks |= sides(np.float32, 2.5)  # an output of the same unit ends there
        hit = np.isin(x, sorted(marks))
        assert np.all(walk | hit)
        assert np.mean(hit) == pytest.approx(0.2, abs=0.03)
    tops = [int(v["n_bad"]) for v in s.injections.values() if list(v) == ["n_bad"]]
    assert sorted(2**32 - 1 - t for t in tops) == [0, 1, 40]


def test_a_controlling_system_is_worked_as_it_says(drive):
    for task in drive.system.tasks:
        found = working_inputs(drive.system, task, 2000)
        t = np.arange(2000)
        for i, x in enumerate(drive.system.task_inputs(task)):
            value, high = found[x.name], x.port.high
            if x.name.startswith("count"):
                # Between none and a 25th of the range, a turn of its sine every 942 steps.
                assert 0 <= value.min() < 0.001 * high < 0.039 * high < value.max() <= 0.04 * high
                risen = np.sin(t / 150 + 0.9 * i)
                assert value == pytest.approx(0.02 * high * (1 + risen), abs=1)
            elif x.name.startswith("frame_error"):
                at = np.flatnonzero(value)
                assert at.tolist() == [k for k in range(7 * i, 2000, 211) if k]
                assert set(value) == {0.0, 1.0}
            elif x.name == "mode":
                starts = {k: float(value[k]) for k in (0, 59, 60, 299, 300, 599, 600, 1999)}
                assert starts == {0: 0, 59: 0, 60: 1, 299: 1, 300: 2, 599: 2, 600: 1, 1999: 1}
            elif x.name == "rearm":
                assert np.flatnonzero(value)[0] == 30
                assert set(value) == {0.0, 1.0}
            elif x.name != "stop":
                size = np.max(np.abs(value))
                assert size == pytest.approx(0.2 * high, rel=0.01), x.name
                column = value.reshape(2000, -1)[:, -1]
                crossed = np.flatnonzero(np.diff(np.sign(column[1:])))
                assert np.diff(crossed).mean() == pytest.approx(np.pi * (37 + 5 * i), rel=0.01)
    # A vector's elements move as one.
    wires = {"inputs": {p.name: (f"made.{p.name}",) for p in (X, N, V)}, "wires": {}, "outputs": {}}
    system = System("own", 1e-3, {"made": made_up()}, (Task("all", ("made",)),), **wires)
    found = working_inputs(system, system.tasks[0], 50)
    assert {n: v.shape for n, v in found.items()} == {
        **{"x_rad": (50,), "n": (50,), "v_rad_s": (50, 2)}
    }
    for k, name in enumerate(found):
        high = {"x_rad": 4.0, "n": 9.0, "v_rad_s": 6.0}[name]
        by_hand = 0.2 * high * np.sin(np.arange(50) / (37 + 5 * k))
        for column in found[name].reshape(50, -1).T:
            assert column == pytest.approx(by_hand, abs=1e-6)


# -- other memories --------------------------------------------------------------------------------


def tuned() -> Block:
    """Four tunables that stand as they are in its coefficients; two counters."""
    names, flags = "abcd", (Flag("ONE", "one", True), Flag("NONE", "no"), Flag("TWO", "two", True))
    ends = {n: (0.1 * k, 1.0 + k) for k, n in enumerate(names, 1)}
    return Block.define(
        *("tuned", "made up"),
        period_s=1e-3,
        tunables=tuple(Tunable(n, 0.75, *ends[n], n) for n in names),
        coefficients=tuple(Port(n, 0, 9, n) for n in names),
        prepare=lambda t: {n: 1 * getattr(t, n) for n in names},
        state=(Port("s_rad", -1, 1, "s"),),
        inputs=(Port("x_rad", -1, 1, "x"),),
        outputs=(Port("y", -9, 9, "y"), Port("status", 0, 7, "status", flags=flags)),
        step=lambda c, s, u, guard, label: ({"s_rad": u.x_rad}, {"y": c.a, "status": 0}),
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tunables_and_counters_at_their_ends(dtype, monkeypatch):
    aimed = []

    def recorded(block, tried, kind):
        aimed.append(([s.name for s in tried], [s.steps for s in tried], np.dtype(kind)))
        return []

    monkeypatch.setattr(memories, "aimed_stream", recorded)
    block = tuned()
    first, *counted = memories.other_memories(block, dtype, steps=81)
    # Aimed from a thousand steps of each stream.
    ordinary = [s.name for s in streams(block, steps=30)]
    assert aimed == [(ordinary, len(ordinary) * [1000], np.dtype(dtype))]
    # The first three in every combination of their ends, for as long as each other.
    base = at_the_limits(block, dtype, seed=2, steps=81)
    np.testing.assert_array_equal(first.inputs["x_rad"], base.inputs["x_rad"])
    assert list(first.injections) == list(base.injections)
    assert first.name == "tunables at their ends"
    assert list(first.coefficients) == [81 * k // 8 for k in range(8)]
    ends = {t.name: (t.low, t.high) for t in block.tunables}
    seen = [tuple(float(c[n][0]) for n in "abc") for c in first.coefficients.values()]
    assert sorted(seen) == sorted(itertools.product(*(ends[n] for n in "abc")))
    last = {float(c["d"][0]) for c in first.coefficients.values()}
    assert len(last) > 1
    assert last <= {*ends["d"], 0.75}
    # Each counter full in turn, the other at none, beside what is put in anyway.
    names = [n for n in ordinary if n not in ("corrupt states", "chirp", "random walk")]
    assert [s.name for s in counted] == [f"{n}, counters at their ends" for n in names]
    for s in counted:
        assert s.steps == 600
        assert list(s.injections) == list(range(10, 600, 30))
        tops = [(int(one["n_one"]), int(one["n_two"])) for one in s.injections.values()]
        assert tops == [(2**32 - 1, 0), (0, 2**32 - 1)] * 10


def test_a_block_without_tunables_or_counters_has_no_such_memories(monkeypatch):
    monkeypatch.setattr(memories, "aimed_stream", lambda *given: [])
    plain = replace(tuned(), tunables=())
    names = [s.name for s in memories.other_memories(plain)]
    assert names
    assert "tunables at their ends" not in names
    no_flags = replace(plain, outputs=plain.outputs[:1])
    assert memories.other_memories(no_flags) == []
