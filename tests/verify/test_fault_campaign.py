"""Fault campaign: faults, their bounds, and detection of a violated bound."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.board.scripted import TapedBoard, play
from esea_gen.emit.states import TIMES_MS
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.verify.faults import campaign, kinds
from esea_gen.verify.faults.campaign import LimbEnvelope, bound_ticks
from esea_gen.verify.faults.driven import DrivenRig
from esea_gen.verify.faults.emulated import emulated_sample
from esea_gen.verify.faults.rig import AFTER, COMMON, SCENES, SUBJECTS, intended, rig_of
from tests.cli.test_cli import refused, run
from tests.conftest import require_tool

SCENE = SCENES[1]
AT = 1000


@pytest.fixture(scope="module")
def drive():
    return campaign.loaded("elbow_drive")


@pytest.fixture(scope="module")
def rig(drive):
    return rig_of(drive)


def distorted(kind: str, amount: float, values, low=0.0, high=4095.0, wraps=True) -> list[float]:
    """Values from the third on are distorted."""
    wrong = kinds.Distortion(kinds.BoardFault("count_load", kind, amount), low, high, wraps)
    for v in values[:2]:
        wrong(-1, v)
    return [wrong(age, v) for age, v in enumerate(values[2:])]


@pytest.mark.parametrize("halt", [None, 1500, 2200])
@pytest.mark.parametrize("motion", [0, 1])
def test_a_persons_motion_is_one_of_a_body(motion, halt):
    """Its speed is the angle's derivative, its acceleration the speed's, jumps at a halt aside."""
    told = [intended(k, motion, halt) for k in range(4000)]
    angle, speed, wanted = (np.array([t[n] for t in told]) for n in told[0])
    assert np.abs(np.gradient(angle, 1e-3) - speed).max() < 5e-3 * speed.max()
    jumps = np.abs(np.gradient(speed, 1e-3) - wanted) > 1e-2 * np.abs(wanted).max()
    assert np.ptp(angle) > 0.2
    assert jumps.sum() <= (4 if halt is None else 8)


@pytest.mark.parametrize(
    ("kind", "amount", "want"),
    [
        ("freeze", 0, [11, 11, 11, 11]),
        ("jump", 0.5, [2059, 2060, 2061, 2062]),  # half of 4095 counts, and down to a whole one
        ("jump", -0.5, [2060, 2061, 2062, 2063]),
        ("ramp", 1.0, [12, 17, 22, 27]),  # 4.095 counts a tick
        ("sign flip", 0, [4083, 4082, 4081, 4080]),
        ("bit flip", 14, [8, 9, 10, 11]),  # of twelve lines the third
        ("delay", 2, [10, 11, 12, 13]),
        ("duplicate", 2, [12, 12, 14, 14]),
        ("gain", 3.0, [14, 17, 20, 23]),  # of what it moved since
        ("gain", -4.0, [7, 3, 4095, 4091]),  # and past the zero of a turn
    ],
)
def test_a_reading_is_wrong_in_the_way_that_is_said(kind, amount, want):
    assert distorted(kind, amount, [10, 11, 12, 13, 14, 15]) == want


def test_what_is_missing_and_what_is_no_number():
    assert np.isnan(distorted("NaN", 0, [10, 11, 12, 13])).all()
    missing = distorted("drop", 1, [10, 11, 12, 13])
    assert math.isnan(missing[0])
    assert missing[1] == 13
    assert distorted("sign flip", 0, [1, 1, 0.25], -1, 1, wraps=False) == [-0.25]
    # The highest bit of a float is its sign.
    assert distorted("bit flip", 31, [0, 0, 2.5], -5, 5, wraps=False) == [-2.5]


@pytest.mark.ci
def test_a_round_leaves_nothing_out(drive):
    library = compile_system(drive.system, "f32")
    memory = [kinds.words(library.dtype(f"{library.prefix}_{k}_t")) for k in ("state", "coeffs")]
    found = kinds.all_faults(drive, *memory, seed=0, most=2000)
    assert len(found) == 2000
    inputs, wanted = kinds.measured_and_wanted(drive)
    assert {n.partition("_")[0] for n in inputs} == {"count", "frame"}
    assert len(inputs) == 6
    assert "tau_desired_Nm" in wanted
    pairs = {(f.place, f.kind) for f in found}
    assert {(p, k) for p in (*inputs, *wanted) for k in kinds.INPUT_KINDS} <= pairs
    for place, all_ in zip(("state", "coefficients"), memory, strict=True):
        assert {w.name for w in all_} <= {f.word for f in found if f.place == place}
    assert {("clock", "lost ticks"), ("clock", "control starved")} <= pairs
    assert {("link", "cut"), ("stop line", "open"), ("operator", "stop")} <= pairs
    assert kinds.all_faults(drive, *memory, seed=0, most=2000) == found


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.name)
def test_a_sound_drive_follows_to_the_end(rig, scene):
    """Else nothing that is found means anything."""
    felt = rig.run(scene, None, AT, seed=3)
    assert felt.found_ticks is None
    assert felt.peak_torque_Nm < scene.torque_Nm + 0.5


# By hand from the documentation: three bad frames are bridged; a run of control is at most five
# ticks away and its command is released one later; the host speaks every ten ticks.
@pytest.mark.parametrize(
    ("fault", "bound", "reason"),
    [
        (kinds.BoardFault("stop line", "open"), 0, 0),
        (kinds.BoardFault("operator", "stop"), TIMES_MS["STOP_OFF"][0], 0),
        (kinds.BoardFault("link", "cut"), TIMES_MS["DEADLINE"][0], 0),
        (kinds.BoardFault("clock", "lost ticks", 1), 0, 13),
        (kinds.BoardFault("clock", "control starved", 60), 25, 7),
        (kinds.BoardFault("count_load", "NaN"), 3, 6),
        (kinds.BoardFault("frame_error_motor", "jump", 0.3), 3, 6),
        (kinds.BoardFault("count_gear", "NaN"), 3 + 6, 6),
        (kinds.BoardFault("tau_desired_Nm", "NaN"), 10, 5),
        (kinds.BoardFault("coefficients", "bit flip", 3, "smc.x", 0), 6, 15),
    ],
    ids=lambda x: f"{x.place} {x.kind}" if isinstance(x, kinds.BoardFault) else None,
)
def test_what_has_a_bound_is_found_within_it(rig, drive, fault, bound, reason):
    assert bound_ticks(drive, fault) == bound
    for at in (AT, AT + 3):
        felt = rig.run(SCENE, fault, at, seed=1)
        assert felt.found_ticks is not None
        assert felt.found_ticks <= bound
        assert felt.reason == reason


def test_a_run_is_the_same_after_any_other(rig):
    fault = kinds.BoardFault("count_load", "freeze")
    first = rig.run(SCENE, fault, AT, seed=2)
    rig.run(SCENES[0], kinds.BoardFault("state", "bit flip", 7, "any", 400), AT, seed=5)
    rig.run(SCENES[0], kinds.BoardFault("stop line", "open"), AT, seed=5)
    assert rig.run(SCENE, fault, AT, seed=2) == first
    assert first.found_ticks is None or first.found_ticks < AFTER


def test_work_and_torque_against_a_drive_that_only_lets_itself_be_moved(rig):
    """Held output: the true torque is the elastomer's, no work is done on a joint that stands."""
    held = next(s for s in SCENES if s.name == "held at 1.7 Nm")
    felt = rig.run(held, kinds.BoardFault("stop line", "open"), AT, seed=1)
    assert felt.energy_J == pytest.approx(0.0, abs=1e-9)
    assert 0.2 < felt.peak_torque_Nm < 8


def test_a_broken_promise_is_seen(monkeypatch, tmp_path):
    """Armed: with a narrower envelope, or a bound that is a tick too short, runs are outside."""
    few = {"runs": 12, "seed": 1, "folder": tmp_path}
    made = campaign.fault_campaign("elbow_drive", **few)
    assert made.outside == []
    assert made.to_dict()["outside"] == 0
    assert {"input", "kind", "detected", "bound_ticks", "found_ticks"} <= set(
        made.to_dict()["faults"][0]
    )
    assert made.to_dict()["simulated"]
    assert sum(r.runs for r in made.rows()) == 12
    assert made.table()[-1] == "0 outside."
    with monkeypatch.context() as patch:
        patch.setattr(campaign, "envelope", lambda device: LimbEnvelope(0.1, 0.1, 15.0))
        assert len(campaign.fault_campaign("elbow_drive", **few).outside) > 6
    with monkeypatch.context() as patch:
        patch.setattr(campaign, "bound_ticks", lambda device, fault: 2)
        slow = campaign.fault_campaign("elbow_drive", **few)
        assert {r.found_ticks for r in slow.outside} >= {None, 3}
    # The same figures came from the journal: nothing was run again.
    assert [r.found_ticks for r in slow.runs] == [r.found_ticks for r in made.runs]
    assert "simulated" in made.figure().axes[0].get_title(loc="left")


def test_a_device_without_a_drive_is_refused(tmp_path):
    assert "no drive" in refused(run("faults", "elbow", cwd=tmp_path))


@pytest.mark.slow
def test_two_thousand_faults():
    made = campaign.fault_campaign("elbow_drive", workers=2)
    assert len(made.runs) == 2000
    assert made.outside == []
    assert {r.person for r in made.runs} == set(SUBJECTS)


# -- below the inputs ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def driven(drive):
    return rig_of(drive, DrivenRig)


def test_with_its_drivers_a_sound_drive_follows_to_the_end(driven):
    felt = driven.run(SCENE, None, AT, seed=3)
    assert felt.found_ticks is None
    assert felt.peak_torque_Nm < SCENE.torque_Nm + 0.5


# By hand: three bad frames are bridged, from the tick after the fault on; the chip's diagnostics
# are asked for every other tick, their answer comes a tick later; 20 ticks of a wrong current.
@pytest.mark.parametrize(
    ("fault", "bound", "reason"),
    [
        (kinds.BoardFault("encoder motor", "stuck low"), 4, 6),
        (kinds.BoardFault("encoder load", "one wrong bit"), 4, 6),
        (kinds.BoardFault("encoder load", "dead bus"), 4, 6),
        (kinds.BoardFault("encoder motor", "magnet weak"), 7, 6),
        (kinds.BoardFault("encoder gear", "stuck high"), 10, 6),
        (kinds.BoardFault("current", "saturated high"), 20, 106),
    ],
    ids=lambda x: getattr(x, "input", None),
)
def test_what_a_driver_finds_is_found_in_time(drive, driven, fault, bound, reason):
    assert bound_ticks(drive, fault) == bound
    felt = driven.run(SCENE, fault, AT, seed=3)
    assert felt.found_ticks is not None
    assert felt.found_ticks <= bound
    assert felt.reason == reason


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_after_a_cut_while_storing_the_drive_is_sound(driven, share):
    assert (
        driven.run(SCENE, kinds.BoardFault("store", "power cut", share), AT, 3).found_ticks is None
    )


def test_a_store_that_mixes_two_sets_is_seen(driven, monkeypatch):
    """Parameters of a third value come back."""
    monkeypatch.setattr(driven.board, "parameter", lambda name: 15.0)
    with pytest.raises(UserError, match="mixes sets"):
        driven.run(SCENE, kinds.BoardFault("store", "power cut", 0.5), AT, 3)


def taped(drive, fault):
    rig = DrivenRig(drive)
    rig.board.close()
    rig.board = TapedBoard(drive)
    rig.run(SCENES[1], fault, 900, 3)
    tape = rig.board.taken()
    rig.close()
    return tape


@pytest.mark.slow
def test_the_emulator_does_what_the_board_in_this_process_does(drive):
    require_tool("qemu-system-arm")
    require_tool("arm-none-eabi-gcc")
    fault = kinds.BoardFault("encoder load", "stuck high")
    case = {"place": fault.place, "kind": fault.kind, "amount": 0.0, "at": 900, "seed": 3}
    case |= {"scene": SCENES[1].name, "person": COMMON, "sign": 1}
    (found,) = emulated_sample(drive, [case], 1, 0)
    assert found.same
    assert (found.fault, found.off_tick) == (6, 904)
    # Armed: another command on the way is another torque.
    tape = taped(drive, fault)
    tape.measured[600][0] += 40
    there = play(drive, "mps2-an500", tape)
    assert there.motor[:600] == tape.motor[:600]
    assert there.motor != tape.motor
