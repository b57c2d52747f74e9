"""What the streams promise that Blocks bring along: each event comes, and is come back from."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from esea_gen.control.limits.block import limits
from esea_gen.control.limits.faults import Fault
from esea_gen.control.limits.streams import STREAMS as OF_LIMITS
from esea_gen.control.reference import STREAMS as OF_REFERENCE
from esea_gen.control.reference import reference
from esea_gen.control.sliding_mode.controller import STREAMS as OF_SLIDING_MODE
from esea_gen.control.sliding_mode.controller import sliding_mode
from esea_gen.language.block import Block
from esea_gen.language.stream import Stream
from esea_gen.model.encoder import STREAMS as OF_ENCODER
from esea_gen.model.encoder import encoder
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.plays import STREAMS as OF_PLAYS
from esea_gen.observe.human import STREAMS as OF_PERSON
from esea_gen.observe.human import extended_state

from .limits_model import SHIPPED


def named(found: list[Stream]) -> dict[str, Stream]:
    return {s.name: s for s in found}


def run(block: Block, stream: Stream) -> dict[str, np.ndarray]:
    """Outputs of the Block, with what is put into its memory."""
    simulator = block.simulator()
    rows = []
    for k in range(stream.steps):
        if k in stream.injections:
            simulator.state = stream.injections[k]
        rows.append(simulator.step(**{n: v[k] for n, v in stream.inputs.items()}))
    return {n: np.array([np.ravel(r[n])[0] for r in rows]) for n in rows[0]}


def raised(block: Block, y: dict[str, np.ndarray]) -> dict[str, int]:
    flags = [(p.name, i, f.name) for p in block.outputs for i, f in enumerate(p.flags)]
    return {f: int(np.sum(y[n].astype(int) >> i & 1)) for n, i, f in flags}


def test_every_fault_of_the_limits_comes_and_is_released(drive):
    block = limits(drive)
    found = named(OF_LIMITS.events(block, np.random.default_rng(1)))
    y = run(block, found["every fault, and its release"])
    fault = y["fault"].astype(int)
    trips = [int(b) for a, b in pairwise(fault) if a == 0 != b]
    # Each cause for one step and for three, from both sides where there are two; stop also by its
    # three invalid values; every other of 15 ports by three, and request, mode and rearm besides.
    assert Counter(trips) == {
        Fault.STOP: 2 * (3 + 3),
        Fault.INPUT_INVALID: 2 * (3 + 15 * 3),
        Fault.SENSING: 2 * 2,
        Fault.CONTROL_STALE: 2 * 1 + 1,
        Fault.DEFLECTION: 2 * 4,
        Fault.TORQUE: 2 * 2,
        Fault.SPEED: 2 * 4,
        Fault.RANGE_OF_MOTION: 2 * 2,
        Fault.CLOCK: 2 * 2,
        Fault.LATE: 2 * 1,
        Fault.COEFFICIENTS: 2 * 2,
    }
    assert fault[-1] == 0
    assert 0.5 * SHIPPED.u < np.max(np.abs(y["u_Nm"])) < SHIPPED.u
    # What trips is tried with the valid values too, and hardly beyond each end of each limit.
    n, x = SHIPPED, found["every fault, and its release"].inputs
    assert {0.0, 0.5, 1.0} <= set(x["stop"]) & set(x["sensing_ok"]) & set(x["coeffs_ok"])
    bent = x["theta_motor_rad"] - x["theta_load_rad"][0]
    for tried, limit in (
        (x["theta_rad"], n.theta),
        (bent, n.theta),
        (x["tau_Nm"], n.tau),
        (x["omega_load_rad_s"], n.omega),
        (x["omega_motor_rad_s"], n.omega),
    ):
        for side in (1, -1):
            share = side * tried[np.isfinite(tried)] / limit
            assert np.min(share[share > 1]) == pytest.approx(1.02, abs=1e-3)
    # Both modes are tried after a release, and the stamp of the control task wraps.
    assert {1.0, 2.0} <= set(x["mode"][fault == 0])
    beat = x["control_beat"]
    assert any(a == 255 and b == 1 for a, b in pairwise(beat))
    # Any two at once: the smaller number is kept, so that cause 1 of 13 wins 13 times, and so on.
    y = run(block, found["two causes at once"])
    fault = y["fault"].astype(int)
    trips = [int(b) for a, b in pairwise(fault) if a == 0 != b]
    won = Counter(trips)
    assert [won[f] for f in sorted(won)] == list(range(13, 0, -1))
    assert sorted(won) == [f for f in Fault if f not in (0, 1, 3)]


def test_of_the_limits_what_holds_the_command_back(drive):
    block, n = limits(drive), SHIPPED
    found = named(OF_LIMITS.events(block, np.random.default_rng(1)))
    stream = found["held back by range of motion and speed"]
    y = run(block, stream)
    assert not np.any(y["fault"][10:])
    flags = raised(block, y)
    for name in ("TORQUE_CLIPPED", "RATE_LIMITED", "ROM_LOW", "ROM_HIGH", "SPEED_LIMITED"):
        assert flags[name] > 30, name
    assert (y["u_Nm"].min(), y["u_Nm"].max()) == pytest.approx((-n.u, n.u))
    x = stream.inputs
    # The joint first stays inside, where the push fades, then goes beyond, where it does not trip.
    first, second = (x["theta_load_rad"][a : a + 400] for a in (17, 417))
    for sweep, low, high in (
        (first, n.low + 0.1 * n.margin, n.high - 0.1 * n.margin),
        (second, n.low - n.margin, n.high + n.margin),
    ):
        assert low < sweep.min()
        assert sweep.max() < high
    assert first.max() > n.high - n.margin
    assert first.min() < n.low + n.margin
    assert second.max() > n.high
    assert second.min() < n.low
    # Its speed: into the fade from 0.8 on, and beyond 0.9, where nothing is let by.
    for name in ("omega_load_rad_s", "omega_motor_rad_s"):
        share = np.abs(x[name]) / n.omega
        assert 0.9 < share.max() < 1
        peaks = [share[17 + 400 * k : 417 + 400 * k].max() for k in range(6)]
        assert any(0.8 < p < 0.9 for p in peaks)
    assert (stream.inputs["mode"] == 0).sum() > 30


def test_of_the_limits_requests_energy_and_memory(drive):
    block = limits(drive)
    found = named(OF_LIMITS.events(block, np.random.default_rng(1)))
    y = run(block, found["requests"])
    fault = y["fault"].astype(int)
    trips, releases = (
        sum((a == 0) == first and (b == 0) != first for a, b in pairwise(fault))
        for first in (True, False)
    )
    # Stopped eight times: three jumps of the number, four conditions not met, and what is no
    # number.  All of these are refused, each time a proper request then releases.
    assert (trips, releases) == (8, 9)
    assert fault[-1] == 0
    assert raised(block, y)["REARM_REFUSED"] == 1 + 3 + 4
    assert raised(block, y)["INPUT_INVALID"] == 1
    y = run(block, found["energy"])
    fault = y["fault"].astype(int)
    (at,) = np.flatnonzero((fault[1:] != 0) & (fault[:-1] == 0))
    assert fault[at + 1] == Fault.ENERGY
    # Braked, it does not trip; what the window remembers first keeps it from being released.
    assert y["energy_J"].max() > SHIPPED.energy
    power = found["energy"].inputs["tau_Nm"] * found["energy"].inputs["omega_load_rad_s"]
    assert power.min() == -power.max() < -40
    assert raised(block, y)["REARM_REFUSED"] >= 1
    assert fault[-1] == 0
    y = run(block, found["memory that contradicts itself"])
    fault = y["fault"].astype(int)
    trips = [int(b) for a, b in pairwise(fault) if a == 0 != b]
    assert Counter(trips) == {Fault.STOP: 17, Fault.STATE_CORRUPT: 13}
    assert raised(block, y)["STATE_REPAIRED"] >= 20
    assert fault[-1] == 0


def test_coefficients_of_the_limits_at_and_beyond_their_ends(drive):
    block = limits(drive)
    dtype = np.dtype(np.float32)
    (stream,) = OF_LIMITS.memories(block, dtype, np.random.default_rng(1))
    changes = [c for c in stream.coefficients.values() if c]
    for p in block.coefficients:
        tried = [float(c[p.name][0]) for c in changes if set(c) == {p.name}]
        low, high = np.float32(p.low), np.float32(p.high)
        inf = np.float32(np.inf)
        for v in (low, high, np.nextafter(low, -inf), np.nextafter(high, inf)):
            assert float(v) in tried, p.name
        assert any(np.isnan(tried))
        assert {np.inf, -np.inf} <= set(tried)
    both = [c for c in changes if set(c) == {"rom_min_rad", "rom_max_rad"}]
    ports = {p.name: p for p in block.coefficients}
    least, most = ports["rom_min_rad"].low, ports["rom_max_rad"].high
    pairs = [(float(c["rom_min_rad"][0]), float(c["rom_max_rad"][0])) for c in both]
    # Turned round, empty, and narrow at either end.
    assert (most, least) in pairs
    assert (most, most) in pairs
    narrow = [(a, b) for a, b in pairs if 0 < b - a < 0.05 * (most - least)]
    assert {a == least for a, _ in narrow} == {True, False}
    # The joint at the edge of a trip that memory has widened a little: both sides of it.
    theta = stream.inputs["theta_load_rad"]
    widened = [
        k
        for k, c in stream.coefficients.items()
        if set(c) & {"trip_low_rad", "trip_high_rad"} and len(c) == 1
    ]
    for edge in (SHIPPED.low - SHIPPED.margin, SHIPPED.high + SHIPPED.margin):
        near = sorted({float(theta[k]) for k in widened if abs(theta[k] - edge) < 1e-5})
        hair = float(np.spacing(np.float32(abs(edge))))
        assert sum(abs(gap - hair) < 1e-9 for gap in np.diff(near)) >= 8
        assert near[0] < edge < near[-1]
        assert len(near) == 10  # and half way to where memory has put it


def test_of_the_person_a_joint_that_sweeps_rests_and_goes_unseen(drive):
    block = extended_state(drive)
    ordinary, unseen = OF_PERSON.events(block, np.random.default_rng(1))
    theta, tau = block.inputs
    x = ordinary.inputs[theta.name]
    # From the middle to rests at both ends and beside them, nearer than a step of the rate.
    rests = [float(x[k]) for k in range(0, len(x) - 150) if np.ptp(x[k : k + 150]) == 0]
    places = list(dict.fromkeys(round(v, 6) for v in rests))
    assert places[0] == pytest.approx(0.5 * (theta.low + theta.high), abs=1e-5)
    beside = sorted(
        round(abs(end - v), 5)
        for end in (theta.low, theta.high)
        for v in places
        if abs(end - v) < 0.01
    )
    assert beside == pytest.approx(sorted(2 * [2e-3, 5e-4, 3e-4, 1e-4, 0.0]), abs=2e-5)
    assert (x.min(), x.max()) == (theta.low, theta.high)
    y = run(block, ordinary)
    # No flag, so that the bound's assumptions hold, at a third of the largest rate and torque.
    assert set(raised(block, y).values()) == {0}
    limit = {p.name: p.high for p in block.outputs}
    for name, share in (("omega_load_rad_s", 0.3), ("tau_h_Nm", 0.254)):
        reached = np.max(np.abs(y[name])) / limit[name]
        assert reached == pytest.approx(share, rel=0.03), name
    pull = ordinary.inputs[tau.name]
    assert np.max(np.abs(pull)) == pytest.approx(0.2 * 20.0, rel=1e-3)
    assert np.diff(np.flatnonzero(np.diff(pull > 0))).tolist() == pytest.approx(
        [1500] * ((len(pull) - 1) // 1500), abs=2
    )
    assert not ordinary.rough
    # Steadily towards each end, and nothing seen from the middle on until well after it.
    assert unseen.rough
    z = unseen.inputs[theta.name]
    gaps = np.flatnonzero(np.diff(np.isnan(z).astype(int)))
    assert len(gaps) == 4
    middle = 0.5 * (theta.low + theta.high)
    assert z[gaps[[0, 2]]] == pytest.approx(middle, abs=0.01)
    assert z[gaps[[1, 3]] + 1] == pytest.approx([theta.high, theta.low])
    way = gaps[1] - gaps[0]
    assert way > 1.05 * abs((theta.high - z[gaps[0]]) / (z[gaps[0]] - z[gaps[0] - 1]))
    y = run(block, unseen)
    assert raised(block, y)["ANGLE_CLIPPED"] > 0
    ends = {p.name: (p.low, p.high) for p in block.outputs}["theta_load_est_rad"]
    assert (y["theta_load_est_rad"].min(), y["theta_load_est_rad"].max()) == pytest.approx(ends)
    assert not np.any(unseen.inputs[tau.name])


def test_of_an_encoder_motion_gaps_slips_and_turns(drive):
    block = encoder(drive, "motor")
    first, second = OF_ENCODER.events(block, np.random.default_rng(1))
    y = run(block, first)
    flags = raised(block, y)
    missing = {"INPUT_INVALID", "STATE_REPAIRED", "NOT_ZEROED"}
    assert {k for k, v in flags.items() if not v} == missing
    assert raised(block, run(block, second))["INPUT_INVALID"] > 100
    most, held, full = 15, 3, 4096
    count = first.inputs["count"]
    assert np.array_equal(count, np.floor(count))
    assert (count.min() >= 0, count.max() < full) == (True, True)
    step = (np.diff(count) + full / 2) % full - full / 2
    # It goes nine tenths of the fastest that is believed, both ways, and round more than five
    # turns each.
    for sign in (1, -1):
        assert np.sum(np.abs(sign * step - 0.9 * most) <= 0.5) > 1000
        assert np.sum(step[np.abs(sign * step - 0.9 * most) <= 0.5]) * sign > 5 * full
    # The last two legs begin afresh and go round six times, one each way.
    begun = [*sorted(first.injections)[1:], len(count)]
    for sign, (start, end) in zip((1, -1), pairwise(begun), strict=True):
        leg = step[start : end - 1]
        assert sign * leg.sum() == pytest.approx(6 * full, abs=2 * most)
    # As many bad frames in a row as may be bridged, and one more.
    bad = first.inputs["frame_error"] != 0
    runs = [len(r) for r in "".join("x" if b else " " for b in bad).split()]
    assert set(runs) == {1, 2, held, held + 1}
    assert (runs.count(held), runs.count(held + 1)) == (3, 3)
    # Jumps there and back, a slip that stays, and an odd frame while settling.
    far = step[np.abs(step) > 1.5 * most]
    assert np.sum(np.abs(far) == 4 * most) == 6
    assert np.sum(far == (held + 3) * most) == 1
    assert np.sum(np.abs(far - full / 3) < 1) == 1
    assert len(first.injections) == 3
    for state in first.injections.values():
        assert {k: v.tolist() for k, v in state.items()} == {
            p.name: [p.init] * p.size for p in block.state
        }
    assert np.min(y["usable"]) == 0
    assert np.mean(y["usable"]) > 0.7


def test_edges_of_an_encoders_decisions(drive):
    block = encoder(drive, "motor")
    (stream,) = OF_ENCODER.memories(block, np.dtype(np.float32), np.random.default_rng(1))
    zeroed = block.coefficients[1].name
    values = [float(c[zeroed][0]) for c in stream.coefficients.values() if zeroed in c]
    half = np.float32(0.5)
    assert values[:3] == [float(half - np.spacing(half)), 0.5, float(half + np.spacing(half))]
    # Steps as far as is believed after so many bad frames, and one count farther.
    y = run(block, stream)
    reached, beyond = [], []
    for k, state in stream.injections.items():
        if "held" not in state or float(state["settled"][0]) != 4:
            continue
        at, last = float(stream.inputs["count"][k]), float(state["count_last"][0])
        way = (at - last + 2048) % 4096 - 2048
        allowed = 15 * (float(state["held"][0]) + 1)
        if abs(way) in (allowed, allowed + 1):
            (reached if abs(way) == allowed else beyond).append(k)
    assert len(reached) == len(beyond) == 4 * 2 * 3
    implausible = 1 << [f.name for p in block.outputs for f in p.flags].index("IMPLAUSIBLE_STEP")
    for ks, is_so in ((reached, False), (beyond, True)):
        assert {bool(int(y["status"][k]) & implausible) for k in ks} == {is_so}
    # Zeros that put a frame a hair to either side of half a turn.
    zeros = [
        float(c[block.coefficients[0].name][0])
        for c in stream.coefficients.values()
        if block.coefficients[0].name in c
    ]
    assert len(zeros) >= 15 * 4
    # Of each half turn thirteen single-precision numbers in a row, and two farther off.
    zeros = np.float32(zeros).reshape(-1, 15)
    assert len(zeros) == 4  # of each of four first frames one
    for tie in zeros:
        near, far = np.sort(tie[:13]), tie[13:]
        assert np.array_equal(np.nextafter(near[:-1], np.float32(np.inf)), near[1:])
        assert far[0] < near[0] < near[-1] < far[1] or far[1] < near[0] < near[-1] < far[0]


def test_of_a_gears_encoder_turns_gaps_jumps_and_the_end_of_the_count(drive):
    block = gear_encoder(drive)
    first, second = block.streams.events(block, np.random.default_rng(1))
    y = run(block, first)
    flags = raised(block, y)
    assert {k for k, v in flags.items() if not v} == {"INPUT_INVALID", "STATE_REPAIRED"}
    assert raised(block, run(block, second))["INPUT_INVALID"] > 50
    constant = {c.name: c.value for c in block.constants}
    most, held = int(constant["step_max_counts"]), int(constant["held_max"])
    full = round(block.inputs[0].high) + 1
    count, bad = first.inputs["count"], first.inputs["frame_error"] != 0
    step = (np.diff(count) + full / 2) % full - full / 2
    # As fast as nine tenths of what is believed, both ways, and hardly moving, each with a frame
    # missing, as many as may be bridged, and one more.
    runs = [len(r) for r in "".join("x" if b else " " for b in bad).split()]
    assert Counter(runs) == Counter(3 * [1, held, held + 1])
    at = np.flatnonzero(np.diff(bad.astype(int)) == 1)
    speeds = np.array([np.mean(step[k - 15 : k]) for k in at]) / most
    assert speeds.tolist() == pytest.approx([*3 * [0.9], *3 * [-0.9], *3 * [0.01]], abs=0.02)
    # One jump of nearly half a turn; then through all that is counted, and back through it twice.
    assert np.sum(np.abs(step) > 1.5 * most) == 1
    assert np.max(np.abs(step)) == pytest.approx(0.45 * full, abs=1)
    fast = np.abs(step) > 0.94 * most
    span = next(p.high for p in block.state if p.name == "moved")
    assert np.sum(step[fast & (step > 0)]) / span == pytest.approx(1.1, abs=0.01)
    assert -np.sum(step[fast & (step < 0)]) / span == pytest.approx(2.2, abs=0.01)
    assert np.array_equal(count, np.floor(count))
    assert (count.min() >= 0, count.max() < full) == (True, True)


def test_of_the_reference_modes_held(drive):
    block = reference(drive)
    (stream,) = OF_REFERENCE.events(block, np.random.default_rng(1))
    held = [stream.inputs["mode"][250 * k : 250 * (k + 1)] for k in range(12)]
    assert [float(np.nanmedian(m)) for m in held] == 2 * [1.0, 2.0, 0.0, 2.0, 1.0, 0.0]
    for p in block.inputs:
        x = stream.inputs[p.name]
        bad = ~((x >= p.low) & (x <= p.high))
        assert 0 < bad.sum() < 20
        if p.name != "mode":
            middle, half = 0.5 * (p.low + p.high), 0.5 * (p.high - p.low)
            share = (x[~bad] - middle) / half
            assert (share.min(), share.max()) == pytest.approx((-0.6, 0.6), abs=0.01)
    a, b = (stream.inputs[n] for n in ("theta_desired_rad", "theta_load_rad"))
    fine = np.isfinite(a) & np.isfinite(b) & (np.abs(a) < 9) & (np.abs(b) < 9)
    assert abs(np.corrcoef(a[fine], b[fine])[0, 1]) < 0.9


def test_of_the_sliding_mode_a_command_that_comes_late(drive):
    block = sliding_mode(drive)
    for late, stream in enumerate(OF_SLIDING_MODE.events(block, np.random.default_rng(1)), 1):
        y = run(block, stream)
        applied, asked = stream.inputs["u_applied_Nm"], np.float32(y["u_command_Nm"])
        part = np.arange(stream.steps) // 200 % 5
        before = np.concatenate([np.zeros(late), asked[:-late]])
        # As asked so many steps ago; clipped at three tenths for a while; then held at zero.
        np.testing.assert_array_equal(applied[part < 3], before[part < 3])
        limit = 0.3 * block.inputs[-1].high
        np.testing.assert_allclose(
            applied[part == 3], np.clip(before, -limit, limit)[part == 3], rtol=1e-6
        )
        assert np.any(np.abs(before[part == 3]) > limit)
        assert not np.any(applied[part == 4])
        flags = raised(block, y)
        for name in ("SATURATED", "LAYER_LEFT", "INTEGRAL_RESTS", "ENTERED"):
            assert flags[name] > 3, name
        # Errors from a hundredth of the largest to all of it.
        mode = stream.inputs["mode"]
        assert set(mode) == {0.0, 1.0, 2.0}
        assert np.mean(mode == 0) == pytest.approx(0.25, abs=0.03)
        error = stream.inputs["delta_set_rad"]
        sizes = [
            np.max(np.abs(error[900 * k + a : 900 * k + a + 150]))
            for k in range(3)
            for a in (0, 700)
        ]
        assert all(large > 10 * small for small, large in zip(sizes[::2], sizes[1::2], strict=True))
        for p in block.inputs:
            x = stream.inputs[p.name]
            assert np.all((x >= p.low) & (x <= p.high)), p.name
            assert np.ptp(x) > 0
        # What moves beside the error is small with it and six times as large at last.
        for name, share in (("tau_Nm", 0.1), ("tau_h_Nm", 0.1), ("u_a_Nm", 0.5)):
            port = next(p for p in block.inputs if p.name == name)
            size = np.abs(stream.inputs[name]) / (share * port.high)
            for k in range(3):
                first, last = size[900 * k : 900 * k + 150], size[900 * k + 750 : 900 * k + 900]
                assert 0.15 < first.max() < 0.25, name
                assert 0.7 < last.max() < 1.2, name


def test_play_states_with_a_common_history_at_and_inside_their_thresholds(drive):
    block = exact_inverse(drive)
    (stream,) = OF_PLAYS.memories(block, np.dtype(np.float64), np.random.default_rng(1))
    gap = next(c.value for c in block.constants if c.name == "omega_rad")
    assert sorted(stream.injections) == list(range(0, 3000, 4))
    moves = []
    for state in stream.injections.values():
        steps = np.diff([float(state["theta_prev_rad"][0]), *state["play_rad"]]) / gap
        moves.append(steps)
    found = np.round(np.array(moves), 2)
    # Each stop at a threshold, hardly beyond it, a little inside, and anywhere, in either
    # direction.
    for mark in (-1.0, 1.0, -0.99, 0.99, 0.0):
        assert np.mean(found == mark) > 0.04, mark
    # Both ends in one memory, and all to one side.
    mixed = [np.any(m == 1) and np.any(m == -1) for m in found]
    assert 0.2 < np.mean(mixed) < 0.8
    one_side = [np.all(m >= 0) or np.all(m <= 0) for m in found]
    assert np.mean(one_side) > 0.4
    beyond = (np.abs(np.array(moves)) - 1) * gap
    assert 0.5e-5 < beyond.max() < 1e-5
    at_rest = [not np.any(s["v_rad_s"]) for s in stream.injections.values()]
    assert 0.5 < np.mean(at_rest) < 0.75
    assert np.mean([float(s["primed"][0]) for s in stream.injections.values()]) == pytest.approx(
        0.9, abs=0.04
    )
    (p,) = block.inputs
    x = stream.inputs[p.name]
    assert np.mean(np.isnan(x)) == pytest.approx(0.02, abs=0.01)
    ends = [np.mean(x == e) for e in (p.low, p.high)]
    assert ends == pytest.approx([0.075, 0.075], abs=0.02)
    assert np.nanmin(np.abs(x)) < 1e-3 * p.high
