"""What the generic streams reach: a test input that no longer tries, tries nothing."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.language.stream import SPECIAL, Stream
from esea_gen.model.inverse import exact_inverse
from esea_gen.observe.human import extended_state
from esea_gen.verify.streams import (
    at_the_limits,
    deflection_inputs,
    domain_chirp,
    first_axis,
    inside,
    recorded_stream,
    streams,
    working_inputs,
)


def named(found: list[Stream]) -> dict[str, Stream]:
    return {s.name: s for s in found}


def test_the_generic_streams_reach_what_they_say(drive):
    block = extended_state(drive)
    found = named(streams(block, seed=3, steps=2000))
    for p in block.inputs:
        middle, half = 0.5 * (p.low + p.high), 0.5 * (p.high - p.low)

        def reach(name, p=p, middle=middle, half=half):
            x = (found[name].inputs[p.name] - middle) / half
            return float(x.min()), float(x.max())

        # A walk and a chirp through the middle half of the range, noise through all of it.
        assert max(map(abs, reach("random walk"))) <= 0.55 + 1e-6
        assert reach("chirp") == pytest.approx((-0.57, 0.57), abs=1e-3)
        assert reach("noise over the range") == pytest.approx((-1, 1), abs=0.01)
        low, high = reach("reversals and plateaus")
        assert -0.6 <= low < -0.5 < 0.5 < high <= 0.6
        assert reach("jumps") == pytest.approx((-1, 1), abs=1e-6)
        jumps = found["jumps"].inputs[p.name]
        assert set(jumps) == {p.low, p.high, float(np.float32(0.5 * p.high)), 0.0}
        # A walk moves by a hundredth of its reach, noise by a third of the range.
        steps = {n: np.std(np.diff(found[n].inputs[p.name])) / half for n in found}
        assert steps["random walk"] == pytest.approx(0.0055, rel=0.1)
        assert steps["noise over the range"] == pytest.approx(np.sqrt(2 / 3), rel=0.1)
        # Its frequency rises: 2 turns a stream at first, 42 at last.
        chirp = found["chirp"].inputs[p.name] - middle
        turns = np.flatnonzero(np.diff(np.sign(chirp)) != 0)
        assert len(turns) == pytest.approx(2 * 22, abs=2)
        assert np.diff(turns)[-4:].mean() < np.diff(turns)[:3].mean() / 4
        marks = np.float32([p.low, p.high, 0.0])
        inner = [np.nextafter(np.float32(p.low), np.float32(0)), np.float32(1e-45)]
        tried = set(found["thresholds"].inputs[p.name])
        assert {float(m) for m in (*marks, *inner)} <= tried
        zeros = [x for x in found["thresholds"].inputs[p.name] if x == 0]
        assert {bool(np.signbit(x)) for x in zeros} == {True, False}
        assert all(p.low <= x <= p.high for x in tried)
    # Inputs do not rise and fall together, nor does each seed give the same.
    a, b = (found["chirp"].inputs[p.name] for p in block.inputs)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.95
    others = named(streams(block, seed=4, steps=2000))
    assert not np.array_equal(
        others["random walk"].inputs["tau_Nm"], found["random walk"].inputs["tau_Nm"]
    )
    held = found["reversals and plateaus"].inputs["tau_Nm"]
    still = [np.ptp(held[k : k + 50]) == 0 for k in range(0, 2000, 50)]
    assert still == [(k // 400) % 3 == 2 for k in range(0, 2000, 50)]


def test_invalid_inputs_and_corrupt_states(drive):
    block = extended_state(drive)
    found = named(streams(block, seed=3, steps=3000))
    invalid = found["invalid inputs"].inputs
    assert np.isnan(next(iter(invalid.values()))[0])
    for p in block.inputs:
        x = invalid[p.name]
        bad = ~((x >= p.low) & (x <= p.high))
        assert np.mean(bad) == pytest.approx(0.08, abs=0.02)
        np.testing.assert_array_equal(x[~bad], found["random walk"].inputs[p.name][~bad])
        assert np.isnan(x).any()
        assert {v for v in SPECIAL if not np.isnan(v)} <= {
            v if np.isinf(v) else float(f"{v:.2g}") for v in x
        }
        # And hardly outside, at either end.
        beyond = {round(float(v), 3) for v in x[bad & (np.abs(x) < 100)]}
        assert beyond == {round(1.5 * p.high + 1e-3, 3), round(1.5 * p.low - 1e-3, 3)}
    corrupt = found["corrupt states"].injections
    assert sorted(corrupt) == list(range(20, 3000, 40))
    ports = {p.name: p for p in block.state}
    outside = [
        not np.all((v >= ports[n].low) & (v <= ports[n].high))
        for one in corrupt.values()
        for n, v in one.items()
    ]
    # Most are what no range holds; the rest are any value inside.
    assert 0.5 < np.mean(outside) < 0.95
    assert {n for one in corrupt.values() for n in one} == set(ports)
    assert [s.rough for s in found.values()][:8] == 8 * [True]
    tau = found["random walk"].inputs["tau_Nm"]
    low, high = float(tau.min()), float(tau.max())
    assert inside(found["random walk"], {"tau_Nm": (low, high), "not_there": (0, 0)})
    assert not inside(found["random walk"], {"tau_Nm": (low, 0.99 * high)})
    assert not inside(found["random walk"], {"tau_Nm": (0.99 * low, high)})


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_every_state_and_counter_at_its_ends_and_beside_them(drive, dtype):
    block = exact_inverse(drive)
    s = at_the_limits(block, dtype)
    put = [(n, v) for one in s.injections.values() for n, v in one.items()]
    tiny = np.nextafter
    for p in block.state:
        values = {float(x) for n, v in put if n == p.name for x in np.ravel(v)}
        for end in (dtype(p.low), dtype(p.high)):
            sides = {float(tiny(end, dtype(s * np.inf))) for s in (-1, 1)}
            assert {float(end), *sides} <= values, (p.name, end)
        if p.size > 1:
            total = float(np.float32(1.001 * p.size * max(abs(p.low), abs(p.high))))
            sums = {float(np.sum(np.abs(v))) for n, v in put if n == p.name}
            assert {total, float(tiny(dtype(total), dtype(0)))} <= sums
            assert any(abs(x - 1.01 * total) < 1e-6 * total for x in sums)
            near = [x / total for x in sums if abs(x / total - 1) < 1e-5]
            assert min(near) < 1 - 5e-7
            assert max(near) > 1 + 5e-7
    counted = [f"n_{f.name.lower()}" for q in block.outputs for f in q.flags if f.counted]
    assert counted
    for name in counted:
        tops = {2**32 - 1 - int(v) for n, v in put if n == name}
        assert {0, 1, 2, 40} == tops
    # All states at one end together, and each input at its end in the same step.
    (p,) = block.inputs
    at = [
        k
        for k, one in s.injections.items()
        if len([n for n in one if not n.startswith("n_")]) == len(block.state)
    ]
    ends = [k for k in at if abs(s.inputs[p.name][k]) == p.high]
    assert len(ends) > 20
    assert {np.sign(s.inputs[p.name][k]) for k in ends} == {-1, 1}
    assert any(np.isnan(s.inputs[p.name][k]) for k in s.injections)


def test_of_devices_and_systems(drive):
    chirp = domain_chirp(drive)
    domain = drive.file.domain
    assert len(chirp) == 8000
    # Up to nearly the largest deflection, and at last nearly as fast as was identified.
    assert np.max(np.abs(chirp)) == pytest.approx(0.95 * domain.theta_max_rad.value, rel=1e-3)
    rate = np.abs(np.diff(chirp)) / drive.period_s
    assert rate.max() == pytest.approx(0.8 * domain.omega_max_rad_s.value, rel=0.08)
    assert np.argmax(rate) > 7000
    recorded = recorded_stream(drive, chirp[:500], "tried")
    assert {s.name for s in recorded.values()} == {"tried"}
    np.testing.assert_array_equal(recorded["velocity"].inputs["theta_rad"], chirp[:500])
    x = recorded["sensor"].inputs
    # The rate in the middle of the step, delayed a little by the observer.
    slope = np.gradient(chirp[:500], drive.period_s)
    assert x["omega_rad_s"][100:] == pytest.approx(slope[100:], abs=0.05 * rate.max())
    np.testing.assert_array_equal(x["theta_rad"], chirp[:500])
    wrist = load_device("wrist").system
    both = deflection_inputs(wrist, chirp[:9])
    assert len(both) == len(wrist.task_inputs(wrist.tasks[0])) == 2
    task = wrist.tasks[0]
    outputs = {o.name: np.full(3, float(k)) for k, o in enumerate(wrist.task_outputs(task))}
    one = first_axis(wrist, outputs)
    first = next(
        k for k, o in enumerate(wrist.task_outputs(task)) if o.name.startswith("tau_flexion")
    )
    assert one["tau_Nm"][0] == first
    for task in drive.system.tasks:
        x = working_inputs(drive.system, task, 900)
        for o in drive.system.task_inputs(task):
            assert np.all((x[o.name] >= o.port.low) & (x[o.name] <= o.port.high)), o.name
        if "count_motor" in x:
            counts = x["count_motor"]
            assert np.array_equal(counts, np.rint(counts))
            # Slowly: below a thousandth of a turn a tick, yet it moves.
            assert 0 < np.max(np.abs(np.diff(counts))) <= 2
            assert x["frame_error_motor"].sum() == pytest.approx(4, abs=1)
        if "mode" in x:
            assert set(x["mode"]) == {0.0, 1.0, 2.0}
            # Asked for while off, on only then, stopped near the end.
            armed, on = (np.flatnonzero(x[n])[0] for n in ("rearm", "mode"))
            assert 10 < armed < on < 100
        if "stop" in x:
            assert np.flatnonzero(x["stop"]).tolist() == list(range(851, 900))
