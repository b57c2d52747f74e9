"""Encoder faults in closed loop with the shipped controllers: detection and its time."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import asdict

import numpy as np
import pytest

from esea_gen.control.limits.faults import Fault
from esea_gen.devices import BEST_CONTROLLER
from esea_gen.errors import UserError
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy, default_person
from esea_gen.twin.case import Setting
from esea_gen.twin.faults import parse_fault
from esea_gen.twin.judge import fault_figures
from esea_gen.twin.run import run_case
from esea_gen.verify.faults import everyone
from esea_gen.verify.faults.kinds import BoardFault
from esea_gen.verify.faults.rig import SUBJECTS, rig_of
from tests.cli.test_cli import run as run_cli
from tests.conftest import ROOT, without

SIMULATE = ("simulate", "--controller", "smc")


def run(fault: str, study: str = "bread", case: str = "0 Nm", controller: str = "smc"):
    found = load_study(study, ClosedLoopStudy).case(case)
    setting = Setting(controller, "real", default_person(study, "real"), fault=fault)
    return run_case(found, setting, 0)


# -- the fault itself ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sound():
    return run("")


def moved(a, b, full):
    """By how many counts, the short way round."""
    d = a - b
    return d - full * np.round(d / full)


@pytest.mark.parametrize(
    ("side", "counts", "full"), [("load", ["count_load"], 4096), ("gear", ["count_gear"], 2**17)]
)
def test_a_fault_begins_at_its_tick_and_touches_its_encoder_alone(sound, side, counts, full):
    wrong = run(f"slip:{side}@4=0.0838")
    for name in ("count_load", "count_motor", "count_gear"):
        assert np.array_equal(wrong.plant[name][:4000], sound.plant[name][:4000])
        same = wrong.plant[name][4000] == sound.plant[name][4000]
        assert same == (name not in counts), name
    turns = 0.0838 / (2 * np.pi) * (74 if side == "gear" else 1)
    step = moved(wrong.plant[counts[0]][4000], sound.plant[counts[0]][4000], full)
    assert step == pytest.approx((turns - np.round(turns)) * full, abs=1)


def test_what_each_kind_makes_of_the_angle(sound):
    after = slice(4000, 4005)  # before the loop can answer
    truth = sound.plant["count_load"]
    assert set(run("freeze:load@4").plant["count_load"][4000:]) == {truth[4000]}
    # The gear's encoder turns 74 times as far as the joint and has 17 bits.
    gear = run("drift:gear@4=0.05").plant["count_gear"]
    expected = np.floor(0.05e-3 * np.arange(5) * 74 * 2**17 / (2 * np.pi))
    step = moved(gear[after], sound.plant["count_gear"][after], 2**17)
    assert step == pytest.approx(expected, abs=1)
    drift = run("drift:load@4=10").plant["count_load"]
    expected = np.floor(10 * 1e-3 * np.arange(5) * 4096 / (2 * np.pi))
    assert moved(drift[after], truth[after], 4096) == pytest.approx(expected, abs=1)
    # Whole counts of a turn, also of one that drifts past its zero.
    far = run("drift:load@4=10").plant["count_load"]
    assert (far.min(), far.max()) == (0, 4095)
    load = run("gain:load@4=0.5")
    theta = load.plant["theta_l_rad"][4000:4200]
    seen = moved(load.plant["count_load"][4000:4200], load.plant["count_load"][4000], 4096)
    assert seen * 2 * np.pi / 4096 == pytest.approx(
        0.5 * (theta - theta[0]), abs=2 * 2 * np.pi / 4096
    )
    assert np.ptp(theta) > 0.02
    for kind, bit in (("zero", 0), ("one", 1)):
        stuck = run(f"{kind}:load@4=5").plant["count_load"].astype(int)[after]
        assert set(stuck >> 5 & 1) == {bit}
        assert set((stuck ^ truth[after].astype(int)) & ~32) == {0}
    noisy = moved(run("noise:load@4=0.01").plant["count_load"][4000:4010], truth[4000:4010], 4096)
    assert 2 < np.std(noisy) * 2 * np.pi / 4096 / 1e-3 < 20
    both = run("freeze:both@4").plant
    for name in ("count_load", "count_motor"):
        assert len(set(both[name][4000:])) == 1
    assert len(set(both["count_gear"][4000:4100])) > 10


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("freeze:load", "is not a fault"),
        ("freze:load@4", "Did you mean freeze"),
        ("freeze:lod@4", "Did you mean load"),
        ("freeze:load@4=1", "has no amount"),
        ("slip:load@4=inf", "not a number from -10 to 10"),
        ("slip:load@-1", "not a number from 0"),
        ("one:load@4=1.5", "whole"),
        ("zero:load@4=-1", "not a number from 0 to 23"),
    ],
)
def test_what_is_no_fault_is_refused(text, said):
    with pytest.raises(UserError, match=said):
        parse_fault(text)
    assert str(parse_fault("drift:gear@2=0.1")) == "drift:gear@2=0.1"
    assert str(parse_fault("freeze:both@2")) == "freeze:both@2"
    with pytest.raises(UserError, match="count_load has 12 bits"):
        run("one:load@4=12")


# -- in closed loop --------------------------------------------------------------------------------


def page_rows(page: str, table: str) -> dict[str, dict[str, str]]:
    """A page's table by row and column."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    part = text[text.index(f"<!-- figures:{table}") :]
    part = part[part.index("\n|") + 1 :]
    lines = [x.strip("| ").split(" | ") for x in part[: part.index("\n\n")].splitlines()]
    return {row[0]: dict(zip(lines[0], row, strict=True)) for row in lines[2:]}


ROWS, SEEDS = ("freeze:load", "drift:load=2.0"), (1002, 1004)  # of the page's command
CASES = [*itertools.product(ROWS, SUBJECTS, SEEDS, (BEST_CONTROLLER, "cascade", "smc"))]


@pytest.mark.ci
def test_what_a_fault_does_is_within_the_pages_table():
    gear_ratio = everyone.loaded("elbow_drive", "smc").file.actuator.gear_ratio.value
    rows = page_rows("fault-injection.md", "encoder-faults")
    for row, person, seed, law in CASES:
        fault = asdict(everyone.board_fault(row, gear_ratio))
        case = {"controller": law, "person": person, "ticks": (everyone.WATCHED, 100)}
        felt = everyone.felt_by("elbow_drive", seed=seed, halts=False, fault=fault, **case)
        column = person if law == BEST_CONTROLLER else f"`{law}`, most"
        most = rows[row].get(column, rows[row]["most"])
        assert felt["torque_then_Nm"] <= float(most) + 0.06, (row, person, seed, law)
        latest = rows[row]["latest, ticks"]
        if law == BEST_CONTROLLER:
            assert felt["found_ticks"] <= (0 if latest == "–" else int(latest)), (row, person, seed)


def test_in_a_controlled_stop_who_halts_meets_no_drive_that_is_off():
    rows = page_rows("stop-results.md", "stops")
    cells = {r: " / ".join(list(row.values())[1:]).split(" / ") for r, row in rows.items()}
    assert list(rows) == sorted(rows, key=lambda r: -max(map(float, cells[r])))
    peaks = []
    for fault in (BoardFault("stop line", "open"), BoardFault("operator", "stop")):
        scene = everyone.drawn_scene("60 Nm/rad", 4, halts=True)
        felt = rig_of(everyone.loaded("elbow_drive", BEST_CONTROLLER)).run(
            scene, fault, 1300, 4, (2100, 1500)
        )
        peaks.append(felt.peak_torque_Nm)
    assert peaks[1] < 2.4  # 2 Nm were desired
    assert peaks[0] > 3.0


@pytest.mark.parametrize("controller", ["smc", pytest.param("mpc", marks=pytest.mark.ci)])
@pytest.mark.parametrize(
    ("fault", "reason", "ticks"),
    [
        ("one:load@4=3", Fault.STUCK_BIT, 50),
        ("zero:load@4=4", Fault.STUCK_BIT, 50),
        ("zero:motor@4=2", Fault.STUCK_BIT, 50),
        ("zero:gear@4=7", Fault.ROUGH, 330),
        ("one:gear@4=15", Fault.STUCK_BIT, 700),
        ("noise:load@4=0.008", Fault.ROUGH, 30),
        ("noise:motor@4=0.004", Fault.ROUGH, 100),
    ],
)
def test_a_stuck_bit_and_noise_are_found_before_they_push(fault, reason, ticks, controller):
    for case, wanted_Nm in (("0 Nm", 0.0), ("2 Nm", 2.0)):
        figures = fault_figures(run(fault, case=case, controller=controller), parse_fault(fault))
        assert figures["detected_fault"] == reason
        assert figures["detected_ticks"] <= ticks
        assert figures["torque_then_Nm"] <= wanted_Nm + 0.5


def test_without_the_comparison_a_frozen_encoder_is_not_found(tmp_path):
    """What the comparison is for: the same device without it holds still against the person."""
    import esea_gen

    text = esea_gen.load_device("elbow_drive").toml()
    bare = tmp_path / "bare.toml"
    bare.write_text(without(text, "redundancy", "cable"))
    case = ("freeze:load@4", "backdriven", "0.1 Hz")
    blind, with_ = (
        fault_figures(run(*case, controller=c), parse_fault(case[0])) for c in (str(bare), "smc")
    )
    # The limit of the interaction torque, on the torque that is shown: 8 Nm.
    assert blind["detected_fault"] == 9
    assert blind["torque_then_Nm"] > 8.0
    assert blind["peak_torque_Nm"] > 10.0
    assert with_["detected_fault"] == 6
    assert with_["peak_torque_Nm"] < 6.0
    assert with_["detected_ticks"] < 0.6 * blind["detected_ticks"]


def test_the_command_says_what_came_of_it(tmp_path):
    out = tmp_path / "fault.json"
    done = run_cli(*SIMULATE, "bread", "--fault", "freeze:load@4", "--json", out, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "simulated" in done.stdout
    content = json.loads(out.read_text())
    assert content["simulated"] is True
    assert content["fault"] == "freeze:load@4"
    still, pushed = content["cases"]  # 0 and 2 Nm
    assert 0 < still["detected_ticks"] < 1000
    assert still["detected_fault"] == 6
    assert pushed["peak_torque_Nm"] < 4.0  # found or within the room
    assert min(still["energy_J"], pushed["energy_J"]) >= 0
    done = run_cli(*SIMULATE, "tuning", "--fault", "freeze:load@4", "--json", out, cwd=tmp_path)
    (case,) = json.loads(out.read_text())["cases"]
    assert case["detected_ticks"] is None  # the output is fixed: what is read is right
    done = run_cli(*SIMULATE, "bread", "--fault", "freeze:load@40", cwd=tmp_path)
    assert done.returncode == 2
    assert "outside 0.1 to 25 s" in re.sub(r"\s+", " ", done.stderr)


@pytest.mark.ci
def test_the_command_writes_the_table_by_person(tmp_path):
    out = tmp_path / "stops.json"
    call = ("faults", "elbow_drive", "--table", "stops", "--runs", "1", "--jobs", "1")
    done = run_cli(*call, "--controller", "cascade,smc", "--json", out, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "simulated" in done.stdout
    worst, *people = json.loads(out.read_text())["people"]
    assert {r["name"] for r in people} == set(SUBJECTS)
    for column, by_law_Nm in worst["by_law_Nm"].items():
        assert list(by_law_Nm) == ["cascade", "smc"]
        for law, torque_Nm in by_law_Nm.items():
            assert torque_Nm == max(r["by_law_Nm"][column][law] for r in people)
    for wrong in (
        ("--table", "stop"),
        ("--controller", "smc"),
        ("--table", "stops", "--emulator", "1"),
    ):
        assert run_cli("faults", "elbow_drive", *wrong, cwd=tmp_path).returncode == 2, wrong
