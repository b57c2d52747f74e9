"""Passivity by pushed hands and the sliding condition: physical laws, known signals."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from esea_gen.analysis.passivity import Hand
from esea_gen.errors import UserError
from esea_gen.studies.passivity.push import PushRun, judge_push, push_case, run_push
from esea_gen.studies.passivity.sliding import check_sliding, sliding_condition
from esea_gen.studies.passivity.study import HANDS, push_map, study_interaction
from esea_gen.studies.tracking import Grid
from esea_gen.twin.case import OFF, Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import run_case
from tests.own_device import own_text
from tests.studies.test_tune import command

U_MAX_NM = 0.221


def pushed(hand: Hand, kp: float, kd: float, plant: str = "real", **options):
    case = push_case(controller_device("smc"), hand, kp, kd, **options)
    return run_case(case, Setting("smc", plant, "ideal"), 0)


# -- runs -----------------------------------------------------------------------------------------


def test_the_energy_is_what_the_hand_gave():
    """The plant's own work of the person, less what moves in the hand, went in there."""
    hand = Hand("arm", 0.2, 0.3, 30.0)
    run = pushed(hand, 1.5, 0.25)
    figures = judge_push(run, hand, 1.5, U_MAX_NM)
    work = run.plant["work_person_J"]
    moving = 0.5 * hand.inertia_kgm2 * run.plant["omega_l_rad_s"] ** 2
    into = work - moving
    # Trapezoids of 1 ms against the plant's own sum at 0.2 ms.
    assert figures.absorbed_J == pytest.approx(into[-1], abs=2e-5)
    assert figures.generated_J == pytest.approx(max(0.0, -into.min()), abs=2e-5)
    assert figures.absorbed_J > 100 * 2e-5


def test_a_wall_throws_a_heavy_hand_back():
    """A mass on a spring by hand: it goes in by v sqrt(J/k), comes out as fast, loses nothing."""
    hand, wall = Hand("heavy", 50.0), 1e4
    run = pushed(hand, 0.0, 0.0, wall_Nm_rad=wall)
    moved = run.plant["theta_l_rad"] - run.plant["theta_l_rad"][0]
    assert moved.max() == pytest.approx(0.02 + 0.5 * math.sqrt(50 / wall), rel=0.03)
    # The drive is dragged along after that.
    out = round((1.1 + math.pi * math.sqrt(50 / wall)) * 1000)
    assert run.plant["omega_l_rad_s"][out] == pytest.approx(-0.5, rel=0.05)
    # Held in the wall: all of the push, 50 * 0.5**2 / 2.
    held = 0.5 * wall * (moved[int(np.argmax(moved))] - 0.02) ** 2
    assert held == pytest.approx(6.25, rel=0.03)
    assert not judge_push(run, hand, 0.0, U_MAX_NM, wall).stopped


def test_a_drive_that_is_off_is_passive_with_every_hand():
    """Friction, masses and elastomer only: whatever the hand, nothing can come out."""
    for hand in HANDS[::7]:  # each inertia, damping and stiffness
        figures = judge_push(pushed(hand, 0.0, 0.0, "ideal", mode=OFF), hand, 0.0, U_MAX_NM)
        push_J = 0.5 * hand.inertia_kgm2 * 0.25
        assert figures.generated_J <= 1e-6 * push_J
        assert not figures.swings_up(push_J)
        assert not figures.stopped
        assert figures.limited_share == 0


@pytest.fixture(scope="module")
def study():
    hands = (Hand("light", 0.1, 0.5, 30.0), Hand("arm", 0.2, 0.5), Hand("firm", 0.4, 0.5, 300.0))
    return study_interaction("smc", points=2, hands=hands, sliding=False)


@pytest.mark.ci
def test_the_thesis_gains_are_passive_and_so_are_the_largest(study):
    """The largest are those that the device file lets by."""
    verdicts = {(kp, kd): mark for kp, kd, mark in study.marked}
    assert verdicts[0.75, 0.25] == "P"
    assert verdicts[1.5, 0.25] == "P"
    assert study.region.stable.all()
    push_J = 0.5 * 0.1 * 0.5**2
    quiet = study.runs[1.5, 0.25, "light"]
    assert quiet.held_end_J < 0.01 * push_J
    assert quiet.generated_J < 0.01 * push_J


def test_a_latched_fault_is_a_result():
    """The limits stop a hand that leaves the range of motion; that is not passive, nor stable."""
    hand = Hand("thrown", 0.4)
    figures = judge_push(pushed(hand, 0.0, 0.0, "ideal", push_rad_s=3.0), hand, 0.0, U_MAX_NM)
    assert figures.fault == 11  # range of motion
    region = push_map([0.0], [0.0], [hand], {(0.0, 0.0, "thrown"): figures}, 3.0)
    assert region.mark(0, 0) == "L"
    assert not region.passive[0, 0]
    assert not region.stable[0, 0]


# -- verdicts -------------------------------------------------------------------------------------

QUIET = PushRun(held_J=2e-3, held_end_J=1e-3)


@pytest.mark.parametrize(
    ("change", "mark"),
    [
        ({}, "P"),
        ({"generated_J": 0.9e-4}, "P"),
        ({"generated_J": 1.1e-4}, "s"),
        ({"held_end_J": 2.3e-3}, "P"),
        ({"held_end_J": 2.5e-3, "moving_J": 2.5e-3}, "."),
        # It rests elsewhere, as friction leaves it.
        ({"held_end_J": 2.5e-3}, "P"),
        # Too small to be more than encoder counts, although it grows.
        ({"held_J": 1e-4, "held_end_J": 3e-4, "moving_J": 3e-4}, "P"),
        # As large all along: it grew before.
        ({"held_J": 2e-2, "held_end_J": 2e-2}, "."),
        ({"fault": 9.0}, "L"),
        ({"tripped": 1.0}, "L"),
        ({"ran_away": 1.0}, "."),
    ],
)
def test_verdicts(change, mark):
    # 0.08 kg m^2 at 0.5 rad/s are 1e-2 J: a hundredth of it may come out.
    hands = (Hand("a", 0.08), Hand("b", 0.08))
    runs = {(0.0, 1.0, "a"): QUIET, (0.0, 1.0, "b"): dataclasses.replace(QUIET, **change)}
    region = push_map([0.0], [1.0], hands, runs, 0.5)
    assert region.push_J == pytest.approx([1e-2, 1e-2])
    assert region.mark(0, 0) == mark
    assert bool(region.passive[0, 0]) is (mark == "P")
    assert bool(region.stable[0, 0]) is (mark in "Ps")
    json.dumps(region.to_dict(), allow_nan=False)


# -- sliding condition ----------------------------------------------------------------------------


@given(
    s=hnp.arrays(np.float64, 30, elements=st.floats(-5, 5)),
    active=hnp.arrays(np.bool_, 30),
    limited=hnp.arrays(np.bool_, 30),
)
def test_counts_agree_with_counting(s, active, limited):
    found = sliding_condition(s, active, limited, 1.0, 0.005)
    outside = [k for k in range(29) if active[k] and active[k + 1] and abs(s[k]) > 1.0]
    products = {k: s[k] * (s[k + 1] - s[k]) / 0.005 for k in outside}
    assert found["outside"] == len(outside)
    assert found["free"] == sum(not limited[k] for k in outside)
    assert found["falling"] == sum(p < 0 for p in products.values())
    assert found["falling_free"] == sum(p < 0 and not limited[k] for k, p in products.items())
    assert found["worst_rad2_s3"] == (max(products.values()) if products else 0.0)


@pytest.mark.filterwarnings("ignore:.*designed for")
def test_what_is_outside_agrees_with_the_controllers_own_flag(tmp_path):
    """The C sets LAYER_LEFT itself, in its own number format; a faster sensor changes nothing."""
    cases = (("grid", "3 Nm 1 Hz"),)
    wide, narrow = check_sliding("smc", ("ideal",), cases)
    assert (wide.phi_rad_s, narrow.phi_rad_s) == (1.5, pytest.approx(0.15))
    run = run_case(Grid().case("3 Nm 1 Hz"), Setting("smc", "ideal", "none"), 0)
    smc = controller_device("smc").system.blocks["smc"]
    bit = [f.name for f in smc.status_port.flags].index("LAYER_LEFT")
    flagged = run.controller["smc_status"][::5][:-1] >> bit & 1
    assert abs(int(flagged.sum()) - wide.outside) <= 1
    assert narrow.outside > wide.outside
    assert "3 Nm 1 Hz" in wide.line()
    (tmp_path / "fast.toml").write_text(own_text(timing={"sense_rate_Hz": 2000}))
    fast, _ = check_sliding(str(tmp_path / "fast.toml"), ("ideal",), cases)
    assert fast.samples == wide.samples


# -- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--plant", "moon"], ["Unknown plant 'moon'", "ideal, real, random"]),
        (["--points", 1], ["--points", "equal to 2"]),
        (["--push", 0], ["push is 0 rad/s", "at most 0.6"]),
        (["--wall", -1], ["--wall", "equal to 0"]),
        (["--push", 5], ["push is 5 rad/s", "range of motion"]),
        (["--figure", "a.txt"], [".png, .svg or .pdf"]),
        (["--jobs", 0, "--no-sliding", "--points", 2], ["--jobs 0", "-1"]),
    ],
)
def test_passivity_refuses(arguments, words):
    code, shown, error = command("passivity", *arguments)
    assert (code, shown) == (2, "")
    assert "Traceback" not in error
    for word in words:
        assert word in error


def test_a_hand_that_is_not_passive_is_refused():
    with pytest.raises(UserError, match="0 or more"):
        run_push(0.0, 0.0, {"name": "x", "damping_Nms_rad": -1.0}, "smc", "ideal", 0.5, 0)
