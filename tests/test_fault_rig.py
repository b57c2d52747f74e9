"""The fault campaign without a board: what is drawn, done at which tick, and counted."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.verify.driven import CURRENT_FAULTS
from esea_gen.verify.faults import campaign, driven, rig
from esea_gen.verify.faults.bounds import LimbEnvelope, bound_ticks, envelope
from esea_gen.verify.faults.campaign import FaultCampaign, FaultRun
from esea_gen.verify.faults.emulated import EmulatedFault
from esea_gen.verify.faults.kinds import (
    AMOUNTS,
    CLOCK_KINDS,
    INPUT_KINDS,
    MOST_DELAY,
    BoardFault,
    Distortion,
    Word,
    all_faults,
    measured_and_wanted,
    ranges,
    words,
)
from esea_gen.verify.faults.picture import FaultRow, fault_picture

AT, AFTER = 300, 800
MOVED = rig.SCENES[1]


@pytest.fixture(scope="module")
def drive():
    return campaign.loaded("elbow_drive")


# -- what may break --------------------------------------------------------------------------------


def test_words_of_a_struct_by_their_bytes():
    inner = np.dtype([("a", "<f4"), ("b", "<f4", (3,))])
    outer = np.dtype([("one", inner), ("pair", inner, (2,)), ("n", "<u4")])
    names = ["a", "b[0]", "b[1]", "b[2]"]
    expected = [f"one.{n}" for n in names]
    expected += [f"pair[{k}].{n}" for k in (0, 1) for n in names] + ["n"]
    assert words(outer) == [Word(n, 4 * k) for k, n in enumerate(expected)]


def test_amounts_go_both_ways_and_from_one_tick_to_what_no_watch_may_miss():
    for kind in ("jump", "ramp"):
        amounts = AMOUNTS[kind]
        assert sorted(-a for a in amounts) == sorted(amounts)
        assert {abs(a) for a in amounts} == {0.02, 0.3}
    # Frames that are lost: one, as many as are bridged, and most of a second.
    assert AMOUNTS["drop"] == (1, 3, 5, 20, 700)
    assert AMOUNTS["delay"] == (2, 5, 10, MOST_DELAY)
    assert AMOUNTS["duplicate"] == (2, 3, 5)
    assert CLOCK_KINDS == {"lost ticks": (1, 2, 7, 60), "control starved": (5, 10, 25, 60, 200)}
    # Both ends of a converter of twelve bits.
    assert CURRENT_FAULTS == {"saturated low": 0, "saturated high": 2**12 - 1}


def test_a_round_has_every_input_four_times_and_every_word_once(drive):
    state, coefficients = [Word("s.a", 0), Word("s.b", 4)], [Word("c", 8)]
    more = [BoardFault("extra", "one")]
    measured, wanted = measured_and_wanted(drive)
    assert measured == [
        f"{kind}_{side}" for side in ("motor", "load", "gear") for kind in ("count", "frame_error")
    ]
    assert not {"stop", "rearm"} & set(wanted)
    assert {"mode", "tau_desired_Nm"} <= set(wanted)
    given = ranges(drive)
    assert given["count_load"] == (0.0, 4095.0)
    assert given["count_gear"] == (0.0, 2.0**17 - 1)
    inputs = [*measured, *wanted]
    quarter = [(p, k) for p in inputs for k in INPUT_KINDS]
    quarter += [("clock", "lost ticks"), ("clock", "control starved"), ("link", "cut")]
    quarter += [("stop line", "open"), ("extra", "one")]
    memory = [("state", "bit flip")] * 2 + [("coefficients", "bit flip")]
    once = 4 * quarter + memory
    most = 2 * len(once) + 5
    found = all_faults(drive, state, coefficients, 3, most, more)
    assert [(f.place, f.kind) for f in found] == (3 * once)[:most]
    flips = [f for f in found if f.word]
    assert [(f.word, f.byte) for f in flips] == 2 * [("s.a", 0), ("s.b", 4), ("c", 8)]
    assert [f.input for f in flips[:3]] == ["state.s.a", "state.s.b", "coefficients.c"]
    assert found[0].input == "count_motor"
    amounts = {k: {f.amount for f in found if f.kind == k and not f.word} for k in INPUT_KINDS}
    assert amounts["jump"] == amounts["ramp"] == {-0.3, -0.02, 0.02, 0.3}
    assert amounts["drop"] == {1, 3, 5, 20, 700}
    assert amounts["delay"] == {2, 5, 10, 40}
    assert amounts["duplicate"] == {2, 3, 5}
    for kind in ("bit flip", "freeze"):  # a bit, of 32
        assert amounts[kind] <= {float(k) for k in range(32)}
        assert len(amounts[kind]) > 20
        assert {0.0, 31.0} & {
            f.amount for f in all_faults(drive, [], [], 1, 4000) if f.kind == kind
        }
    clock = {(f.kind, f.amount) for f in all_faults(drive, [], [], 1, 2000) if f.place == "clock"}
    assert clock == {
        *(("lost ticks", n) for n in (1, 2, 7, 60)),
        *(("control starved", n) for n in (5, 10, 25, 60, 200)),
    }
    assert all_faults(drive, state, coefficients, 4, most, more) != found
    assert all_faults(drive, state, coefficients, 3, 7, more) == found[:7]


@pytest.mark.parametrize(
    ("kind", "amount", "wraps", "want"),
    [
        ("freeze", 0, False, 3 * [50.0]),
        ("jump", 0.25, False, [110.0, 120.0, 130.0]),  # a quarter of 200
        ("jump", 0.25, True, [-91.0, -81.0, -71.0]),  # 110 is beyond the 201 counts there are
        ("ramp", -5.0, False, [60.0, 69.0, 78.0]),  # a share a second: a count a tick
        ("sign flip", 0, False, [-60.0, -70.0, -80.0]),
        ("sign flip", 0, True, [-60.0, -70.0, -80.0]),  # of a range from -100 to 100 alike
        ("drop", 2, False, [math.nan, math.nan, 80.0]),
        ("delay", 1, False, [50.0, 60.0, 70.0]),
        ("delay", 40, False, [20.0, 30.0, 40.0]),
        ("duplicate", 3, False, [60.0, 60.0, 60.0]),
        ("NaN", 0, True, 3 * [math.nan]),
    ],
)
def test_what_becomes_of_a_reading(kind, amount, wraps, want):
    wrong = Distortion(BoardFault("place", kind, amount), -100.0, 100.0, wraps)
    for k in range(-60, 0):  # long before there were others
        wrong.sound(float(k))
    for k in range(38):
        wrong.sound(20.0 if k == 0 else 30.0 if k == 1 else 40.0 if k == 2 else 45.0)
    wrong.sound(45.0)
    wrong.sound(50.0)
    found = [wrong(age, v) for age, v in enumerate((60.0, 70.0, 80.0))]
    assert found == pytest.approx(want, nan_ok=True)


@pytest.mark.parametrize("bit", range(32))
def test_one_bit_of_a_number_or_of_the_lines_of_a_chip(bit):
    fault = BoardFault("place", "bit flip", bit)
    flipped = Distortion(fault, -9.0, 9.0, False)(0, 0.7)
    a, b = (struct.unpack("<I", struct.pack("<f", x))[0] for x in (0.7, flipped))
    assert a ^ b == 1 << bit
    count = Distortion(fault, 0.0, 4095.0, True)(0, 1234.0)
    assert int(count) ^ 1234 == 1 << bit % 12
    assert Distortion(fault, 0.0, 2.0**17 - 1, True)(0, 0.0) == 2.0 ** (bit % 17)


# Control every five ticks, its command a tick later: six from a measurement to the limits by it.
@pytest.mark.parametrize(
    ("place", "kind", "amount", "bound"),
    [
        ("stop line", "open", 0, 0),
        ("link", "cut", 0, 100),
        ("mode", "NaN", 0, 100),
        ("mode", "jump", 0.3, None),
        ("current", "any", 0, 20),
        ("coefficients", "bit flip", 3, 6),
        ("clock", "lost ticks", 7, 0),
        ("clock", "control starved", 25, 25),
        ("clock", "control starved", 60, 25),
        ("clock", "control starved", 24, None),
        ("count_load", "NaN", 0, 3),
        ("count_gear", "NaN", 0, 9),
        ("frame_error_motor", "jump", 0.02, 3),
        ("frame_error_gear", "jump", 0.02, 9),
        ("frame_error_motor", "jump", -0.02, None),
        ("frame_error_motor", "ramp", 0.02, None),
        ("frame_error_gear", "NaN", 0, 9),
        ("count_load", "jump", 0.3, None),
        ("tau_desired_Nm", "NaN", 0, 10),
        ("tau_desired_Nm", "jump", 0.3, None),
        ("encoder load", "one wrong bit", 0, 4),
        ("encoder load", "swapped bytes", 0, None),
        ("encoder gear", "one wrong bit", 0, None),
        ("encoder gear", "swapped bytes", 0, None),
        ("encoder gear", "silent", 0, 10),
        ("encoder motor", "silent", 0, 4),
        ("encoder motor", "magnet too far", 0, 7),
        ("state", "bit flip", 0, None),
    ],
)
def test_when_a_fault_has_to_be_found(drive, place, kind, amount, bound):
    assert bound_ticks(drive, BoardFault(place, kind, amount)) == bound


def test_the_envelope_is_the_limits_own(drive):
    found = envelope(drive)
    # 8 Nm trips; 65 % more is the run-out; 15 J trips.
    assert (found.torque_Nm, found.energy_J) == (8.0, 15.0)
    assert found.run_out_Nm == pytest.approx(13.2)
    bare = SimpleNamespace(file=SimpleNamespace(safety=None), origin="bare.toml")
    with pytest.raises(UserError, match=r"bare.toml: no section \[safety\]"):
        envelope(bare)


# -- one run, tick by tick -------------------------------------------------------------------------


class NoBoard:
    """Records what is done to it."""

    def __init__(self, device) -> None:
        self.inputs = measured_and_wanted(device)[0]
        self.drivers = [0.0] * len(self.inputs)
        self.lib = self
        self.done: list[tuple] = []
        self.measured: list[dict[str, float]] = []
        self.ticks: list[tuple[int, bool]] = []
        self.lost_at, self.reason, self.on = 10**9, 0, True

    def restart(self):
        self.done, self.measured, self.ticks = [], [], []

    def at(self) -> int:
        return len(self.ticks)

    def show(self, counts):
        for k, c in zip((0, 2, 4), counts, strict=True):
            self.drivers[k] = c

    def measure(self, **readings):
        self.measured.append(readings)

    def zero(self):
        self.done.append((self.at(), "zero"))

    def arm(self):
        self.done.append((self.at(), "arm"))

    def want(self, **wanted):
        self.done.append((self.at(), "want", wanted))

    def pending(self):
        self.done.append((self.at(), "pending"))

    def sim_flip(self, *what):
        self.done.append((self.at(), "flip", *what))

    def sim_stop_line(self, on):
        self.done.append((self.at(), "stop", on))

    def sim_fault(self):
        return self.reason

    def sim_measure(self, drivers):
        assert drivers is self.drivers

    def sim_tick(self, count, control):
        self.ticks.append((count, control))

    def sim_poll(self):
        pass

    @property
    def motor(self):
        return self.on and self.at() % 2 == 1, 0.125 * self.at()

    @property
    def state_now(self) -> str:
        return "ACTIVE" if self.at() <= self.lost_at else "FAULT"


class NoPlant:
    """Counts that rise by the tick, a torque and a speed that are known."""

    made: ClassVar[list[NoPlant]] = []

    def __init__(self, plant) -> None:
        self.plant = plant
        self.intended, self.given = [], []
        NoPlant.made.append(self)

    def start(self, theta_rad, clamped, person):
        self.started = theta_rad, clamped, person
        return [0, 1000, 2000]

    def intend(self, wanted):
        self.intended.append(wanted)

    def step(self, u_Nm):
        self.given.append(u_Nm)
        k = len(self.given)
        return [k, 1000 + k, 2000 + k]

    def torque_and_speed(self):
        k = len(self.given) - 1 - AT
        return 2.0 * math.sin(0.01 * k), 0.5 * math.cos(0.013 * k)


@pytest.fixture
def bench(drive, monkeypatch):
    monkeypatch.setattr(rig, "SimBoard", NoBoard)
    monkeypatch.setattr(rig, "SteppedPlant", NoPlant)
    monkeypatch.setattr(rig, "real_plant", lambda device, seed: ("plant", seed))
    NoPlant.made.clear()
    return rig.FaultRig(drive)


def wanted_at(done) -> dict[int, dict]:
    return {entry[0]: entry[2] for entry in done if entry[1] == "want"}


def test_a_sound_run_by_its_clock(bench):
    felt = bench.run(MOVED, None, AT, seed=5)
    board, (plant,) = bench.board, NoPlant.made
    assert plant.plant == ("plant", 5)
    assert plant.started == (0.0, False, rig.PEOPLE["uncertain"])
    assert board.ticks == (AT + AFTER) * [(1, True)]
    assert [d for d in board.done if d[1] != "want"] == [
        (20, "zero"),
        (260, "arm"),
        (AT + AFTER, "pending"),
    ]
    wanted = wanted_at(board.done)
    assert list(wanted) == list(range(264, AT + AFTER, 10))
    for k, one in wanted.items():
        swell = 2.0 * 0.5 * (1 - math.cos(2 * math.pi * 0.6 * (k - 264) * 1e-3))
        assert one == {"mode": 1.0, "tau_desired_Nm": pytest.approx(swell)}
    # Half a radian to and fro once in two seconds, and noise while the joint is moved.
    noise = np.random.default_rng([5, 3]).standard_normal(AT + AFTER)
    for k, one in enumerate(plant.intended):
        t = max(k - 264, 0) * 1e-3
        moving = k >= 264
        assert one["theta_p_rad"] == pytest.approx(0.5 * (1 - math.cos(math.pi * t)))
        assert one["omega_p_rad_s"] == pytest.approx(0.5 * math.pi * math.sin(math.pi * t))
        assert one["alpha_p_rad_s2"] == pytest.approx(
            0.5 * math.pi**2 * math.cos(math.pi * t) * moving
        )
        assert one["noise"] == (noise[k] if moving else 0.0)
    # The motor's torque while it is on; what is measured is what the plant showed before.
    assert plant.given == [0.125 * (k + 1) if k % 2 == 0 else 0.0 for k in range(AT + AFTER)]
    names = bench.measured
    assert [m[names[2]] for m in board.measured] == [1000 + k for k in range(AT + AFTER)]
    assert [m[names[1]] for m in board.measured] == [0.0] * (AT + AFTER)
    assert (felt.found_ticks, felt.reason) == (None, 0)


def test_what_is_felt_by_its_definition(bench):
    k = np.arange(AFTER)
    tau, omega = 2 * np.sin(0.01 * k), 0.5 * np.cos(0.013 * k)
    work = np.concatenate([[0], np.cumsum(tau * omega) * 1e-3])
    most = max(work[j] - work[i] for i in range(len(work)) for j in range(i, len(work)))
    felt = bench.run(MOVED, None, AT, seed=5)
    assert felt.energy_J == pytest.approx(most)
    assert felt.peak_torque_Nm == felt.torque_then_Nm == pytest.approx(np.max(np.abs(tau)))
    bench.board.lost_at, bench.board.reason = AT + 30, 7
    found = bench.run(MOVED, BoardFault("stop line", "open"), AT, seed=5)
    # Seen at the end of the 31st tick; until then the torque has risen with its sine.
    assert (found.found_ticks, found.reason) == (30, 7)
    assert found.torque_then_Nm == pytest.approx(2 * math.sin(0.3))
    assert found.peak_torque_Nm == felt.peak_torque_Nm
    held = next(s for s in rig.SCENES if s.person == "none")
    bench.board.lost_at = AT - 1
    with pytest.raises(UserError, match=r"held at 1\.7 Nm, seed 2: the board is FAULT before the"):
        bench.run(held, None, AT, seed=2)
    assert NoPlant.made[-1].started[1]


@pytest.mark.parametrize(
    ("fault", "done"),
    [
        (BoardFault("stop line", "open"), (AT, "stop", True)),
        (BoardFault("state", "bit flip", 13, "w", 40), (AT, "flip", False, 41, 1 << 5)),
        (BoardFault("state", "bit flip", 0, "w", 40), (AT, "flip", False, 40, 1)),
        (BoardFault("coefficients", "bit flip", 31, "w", 4), (AT, "flip", True, 7, 1 << 7)),
    ],
)
def test_what_is_struck_once(bench, fault, done):
    bench.run(MOVED, fault, AT, seed=1)
    others = [d for d in bench.board.done if d[1] not in ("want", "zero", "arm", "pending")]
    assert others == [done]
    assert bench.board.ticks == (AT + AFTER) * [(1, True)]


def test_clock_link_and_inputs(bench):
    bench.run(MOVED, BoardFault("clock", "lost ticks", 7), AT, seed=1)
    assert bench.board.ticks == [(8 if k == AT else 1, True) for k in range(AT + AFTER)]
    bench.run(MOVED, BoardFault("clock", "control starved", 10), AT, seed=1)
    assert bench.board.ticks == [(1, not AT <= k < AT + 10) for k in range(AT + AFTER)]
    bench.run(MOVED, BoardFault("link", "cut"), AT, seed=1)
    assert list(wanted_at(bench.board.done)) == [264, 274, 284, 294]
    # An encoder holds what it read last; the others read on.
    bench.run(MOVED, BoardFault("count_load", "freeze"), AT, seed=1)
    load, motor = ([m[n] for m in bench.board.measured] for n in ("count_load", "count_motor"))
    assert load == [1000 + min(k, AT - 1) for k in range(AT + AFTER)]
    assert motor == list(range(AT + AFTER))
    bench.run(MOVED, BoardFault("frame_error_gear", "jump", 0.3), AT, seed=1)
    low, high = bench.ranges["frame_error_gear"]
    seen = [m["frame_error_gear"] for m in bench.board.measured]
    assert seen == pytest.approx(AT * [0.0] + AFTER * [0.3 * (high - low)])
    bench.run(MOVED, BoardFault("frame_error_gear", "ramp", 0.5), AT, seed=1)
    seen = [m["frame_error_gear"] for m in bench.board.measured]
    rising = [0.5 * (high - low) * 1e-3 * age for age in range(AFTER)]
    assert seen == pytest.approx(AT * [0.0] + rising)
    # What the host wants is wrong from its next command on; the rest of the command stays.
    sound = bench.run(MOVED, None, AT, seed=1)
    right = wanted_at(bench.board.done)
    assert sound.found_ticks is None
    bench.run(MOVED, BoardFault("tau_desired_Nm", "jump", -0.3), AT, seed=1)
    low, high = bench.ranges["tau_desired_Nm"]
    wrong = wanted_at(bench.board.done)
    for k, one in right.items():
        off = -0.3 * (high - low) if k >= AT else 0.0
        assert wrong[k]["tau_desired_Nm"] == pytest.approx(one["tau_desired_Nm"] + off)
        assert wrong[k]["mode"] == 1.0
    bench.run(MOVED, BoardFault("theta_desired_rad", "jump", 0.02), AT, seed=1)
    low, high = bench.ranges["theta_desired_rad"]
    told = [one["theta_desired_rad"] for one in wanted_at(bench.board.done).values()]
    assert told == pytest.approx(4 * [0.0] + (len(told) - 4) * [0.02 * (high - low)])


def test_the_four_scenes_and_a_device_without_a_drive(drive):
    assert [(s.name, s.person, s.mode, s.torque_Nm) for s in rig.SCENES] == [
        ("moved at 0 Nm", "uncertain", 1.0, 0.0),
        ("moved at 2 Nm", "uncertain", 1.0, 2.0),
        ("held at 1.7 Nm", "none", 1.0, 1.7),
        ("moved, impedance", "uncertain", 2.0, 0.0),
    ]
    # In motion, in any phase of the two seconds to and fro but its first third.
    assert (rig.EARLIEST, rig.LATEST, rig.AFTER) == (900, 1700, 800)
    timing = SimpleNamespace(sense_rate_Hz=SimpleNamespace(value=1000))
    no_law = SimpleNamespace(laws=(), file=SimpleNamespace(timing=timing), origin="a.toml")
    timing = SimpleNamespace(sense_rate_Hz=SimpleNamespace(value=500))
    slow = SimpleNamespace(laws=("mpc",), file=SimpleNamespace(timing=timing), origin="a.toml")
    for device in (no_law, slow):
        with pytest.raises(UserError, match=r"a\.toml: no drive that senses at 1 kHz"):
            rig.FaultRig(device)


# -- what a campaign says --------------------------------------------------------------------------

ONE = FaultRun("state.x.a", "bit flip", 3.0, "s", 900, 1, True, 6, 4, 15, 1.0, 2.0, 0.5, True)
RUNS = (
    ONE,
    replace(ONE, input="state.x.b", found_ticks=None, detected=False, bound_ticks=None,
            torque_then_Nm=3.0, peak_torque_Nm=3.0, energy_J=0.25),
    replace(ONE, input="state.y", bound_ticks=9, found_ticks=11, inside=False, energy_J=1.0),
    replace(ONE, input="count_load", kind="jump", bound_ticks=3, found_ticks=2),
    replace(ONE, input="count_load", kind="jump", bound_ticks=4, found_ticks=4, seed=8),
)  # fmt: skip


def test_rows_tables_and_what_is_outside():
    made = FaultCampaign("d", "hash", LimbEnvelope(8.0, 13.2, 15.0), RUNS)
    assert made.rows() == [
        FaultRow("state of x", "bit flip", 2, 1, None, 4, 3.0, 3.0, 0.5, 3.0, 0.25, 0),
        FaultRow("state of y", "bit flip", 1, 1, 9, 11, 1.0, 2.0, 1.0, None, None, 1),
        FaultRow("count_load", "jump", 2, 2, 4, 4, 1.0, 2.0, 0.5, None, None, 0),
    ]
    assert made.outside == [RUNS[2]]
    table = made.table()
    assert table[0].count("|") == 12
    assert table[2:5] == [
        "| state of x | bit flip | 2 | 1 | – | 4 | 3.0 | 3.0 | 0.50 | 3.0 | 0.25 |",
        "| state of y | bit flip | 1 | 1 | 9 | 11 | 1.0 | 2.0 | 1.00 | – | – |",
        "| count_load | jump | 2 | 2 | 4 | 4 | 1.0 | 2.0 | 0.50 | – | – |",
    ]
    assert table[5:] == [
        "d, simulated: 5 faults, 4 found; 4 with a stated bound.",
        "Envelope 8 Nm until the motor is off, 13.2 Nm after, 15 J; largest 3.0 Nm, 3.0 Nm, 1.0 J.",
        "OUTSIDE: state.y bit flip 3, s, seed 1, tick 900: found after 11 ticks, bound "
        "9, 2.0 Nm, 1.0 J",
        "1 outside.",
    ]
    shown = made.to_dict()
    assert (shown["outside"], shown["envelope"]["run_out_Nm"], len(shown["table"])) == (1, 13.2, 3)
    fields = EmulatedFault.__dataclass_fields__
    assert {"same"} | set(fields) >= set(shown["emulated"])


def test_the_picture_shows_worst_torque_and_when_it_was_found():
    rows = FaultCampaign("d", "hash", LimbEnvelope(8.0, 13.2, 15.0), RUNS).rows()
    lost = replace(rows[2], kind="freeze", found=0, latest_ticks=None, peak_torque_Nm=5.0)
    figure = fault_picture("d", [*rows, lost], 13.2)
    above, below = figure.axes
    (image,) = above.images
    shown = np.asarray(image.get_array().filled(np.nan))
    expected = np.full((1, len(INPUT_KINDS)), np.nan)
    expected[0, INPUT_KINDS.index("jump")] = 2.0
    expected[0, INPUT_KINDS.index("freeze")] = 5.0
    np.testing.assert_array_equal(shown, expected)
    assert image.get_clim() == (0.0, pytest.approx(1.6 * 13.2))
    texts = {t.get_text(): t.get_position() for t in above.texts}
    assert texts == {
        "4 (2/2)\n2.0 Nm": (INPUT_KINDS.index("jump"), 0),
        "not found\n5.0 Nm": (INPUT_KINDS.index("freeze"), 0),
    }
    assert below.get_ylim() == (1.6, -0.6)  # the first bar above
    assert below.get_xlim() == (0.0, pytest.approx(1.06 * 13.2))
    assert [p.get_width() for p in below.patches] == [3.0, 2.0]
    assert [t.get_text() for t in below.texts] == ["4 (1/2)", "11 (1/1)"]
    assert [t.get_position() for t in below.texts] == [(3.05, 0), (2.05, 1)]
    assert [t.get_text() for t in below.get_yticklabels()] == [
        *("state of x, bit flip", "state of y, bit flip"),
    ]
    (line,) = below.lines
    assert set(line.get_xdata()) == {13.2}
    assert "envelope 13.2 Nm" in above.get_title() + above.get_title(loc="left")


@pytest.mark.parametrize(("share", "flash"), [(0.0, "aaaa"), (0.5, "AAaa"), (1.0, "AAAA")])
def test_a_power_cut_leaves_the_first_share_of_what_was_written(share, flash):
    class Flash(bytearray):
        def __setitem__(self, i, byte):  # as an array of char takes it
            super().__setitem__(i, byte[0])

    class Board:
        def __init__(self):
            self.flash, self.value, self.told = [Flash(b"xaxa"), Flash(b"aax")], 0.0, []

        def set_parameter(self, _name, value):
            self.value = value

        def save_parameters(self):
            text = (self.told and b"A") or b"a"
            self.told.append(self.value)
            for area, places in zip(self.flash, ((1, 3), (0, 1)), strict=True):
                for i in places:
                    area[i] = text

        def restart(self):
            pass

        def parameter(self, _name):
            return self.told[0]

    board = Board()
    driven.DrivenRig._cut(SimpleNamespace(board=board), share)
    written = "".join(bytes(a).decode() for a in board.flash).replace("x", "")
    assert written == flash
    assert len(set(board.told)) == 2
    board.told.insert(0, 99.0)
    with pytest.raises(UserError, match="came back as 99"):
        driven.DrivenRig._cut(SimpleNamespace(board=board), share)
