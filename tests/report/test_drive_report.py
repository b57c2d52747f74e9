"""The page of a device with a drive: true to the commands it draws on, and able to fail."""

from __future__ import annotations

import copy
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from esea_gen import load_device
from esea_gen.board.emulator import Difference
from esea_gen.files import plain
from esea_gen.plotting import svg
from esea_gen.report import builder, drive, reach
from esea_gen.report.builder import gather
from esea_gen.report.findings import BoardRun, run_board
from esea_gen.studies.simulation import simulate
from esea_gen.twin.case import Setting
from esea_gen.verify import equivalence
from esea_gen.verify.streams import streams
from tests.browser import browser, readable
from tests.conftest import ROOT
from tests.own_device import own_text
from tests.report.test_report import Page, shorten

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def elbow_drive(drive):
    # By another name: here ``drive`` is the report's.
    return drive


@pytest.fixture(scope="module")
def findings(elbow_drive):
    """The shipped drive, one compared experiment, its board left out."""
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch)
        # Shorter still: a drive has many Blocks.
        patch.setattr(equivalence, "streams", lambda block, seed: streams(block, seed, 200))
        patch.setattr(drive, "COMPARED", ("tuning",))
        patch.setattr(reach, "FREQUENCIES_HZ", (1.0,))
        patch.setattr(
            builder, "run_board", lambda *_: BoardRun("none", "a board", skipped="no tool")
        )
        yield gather(elbow_drive)


@pytest.fixture(scope="module")
def page(findings):
    """Its text, and the figures of its experiments by name."""
    drawn = {}

    def kept(figure, name, title):
        drawn[name] = svg(figure, name, title)
        return drawn[name]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive, "svg", kept)
        return findings.html(), drawn


@pytest.fixture(scope="module")
def html(page) -> str:
    return page[0]


@pytest.fixture
def figures_kept(monkeypatch, page):
    """No experiment's figure is drawn again where only what stands round it is looked at."""
    monkeypatch.setattr(drive, "svg", lambda figure, name, title: page[1][name])


def test_the_page_is_self_contained_and_well_formed(html):
    page = Page(html)
    assert page.outward == []
    assert page.tags.count("script") == 1  # zooms figures
    assert len(page.ids) == len(set(page.ids)), "an id occurs twice"
    assert len(html) < 3e6
    assert str(ROOT) not in html
    for target in re.findall(r'(?:href="#|url\(#)([^")]+)', html):
        assert target in page.ids
    assert page.tags.count("svg") == 4


def test_it_is_read_on_a_telephone_by_day_and_by_night(html, tmp_path):
    with browser(tmp_path / "profile") as b:
        readable(b, html, tmp_path)


def test_its_numbers_are_those_of_the_commands(findings, html):
    (row,) = findings.to_dict()["experiments"]
    for controller, key in (("smc", "rms_true_Nm"), ("smc-published", "printed_rms_true_Nm")):
        (case,) = simulate("tuning", Setting(controller)).cases()
        assert row[key] == case["rms_true_Nm"]
    assert row["ratio"] == pytest.approx(row["rms_true_Nm"] / row["printed_rms_true_Nm"])
    assert row["thesis_rms_Nm"] == 0.590
    assert f"{row['rms_true_Nm']:.4f}" in Page(html).text
    step = plain(simulate("step", Setting("smc")).to_dict()["steps"], null=True)
    assert findings.to_dict()["response"]["steps"] == step


def test_every_block_parameter_and_task_is_there(findings, html):
    text = Page(html).text
    device = findings.device
    for block in device.system.kinds:
        assert f"{block.name}: {block.title}" in text
    for key, q in device.quantities():
        row = re.search(rf"<tr[^>]*>\s*<th[^>]*><span[^>]*>{re.escape(key)}</span>.*?</tr>", html)
        assert row is not None, key
        assert f"badge {q.status}" in row.group()
    tasks = {t["name"]: t for t in findings.to_dict()["tasks"]}
    assert tasks["sense"]["period_ms"] == 1
    assert tasks["control"]["period_ms"] == 5
    assert tasks["control"]["blocks"] == ["set_trend", "smc", "redundancy", "stamp"]
    checks = {c["block"]: c for c in findings.to_dict()["checks"]}
    assert set(checks) == {b.name for b in device.system.kinds}
    assert all(c["steps"] > 100 and c["bits_equal"] and c["passed"] for c in checks.values())


def test_the_same_twice(findings, html):
    assert findings.html() == html
    assert json.dumps(findings.to_dict()) == json.dumps(findings.to_dict())


def test_it_passes_and_says_that_no_board_ran(findings, html):
    assert findings.passed
    assert 'class="banner passed partial"' in html
    assert "The drive reaches 4.47 of 4.47 N·m up to 1 Hz (RMS error" in Page(html).text
    assert "skipped: no tool" in Page(html).text
    assert any("skipped: no tool" in line for line in findings.summary())


@pytest.mark.usefixtures("figures_kept")
@pytest.mark.parametrize("how", ["comparison", "unstable", "tripped", "fault", "board", "silent"])
def test_a_failure_turns_the_banner(findings, how):
    if how == "comparison":
        verification = copy.deepcopy(findings.verification)
        verification.comparisons[3].problems.append("u_Nm: error 1 above 0.1")
        failed = replace(findings, verification=verification)
    elif how in ("unstable", "tripped", "fault"):
        tuning = findings.simulations["tuning"]
        (result,) = tuning.monte_carlo.results
        why = {how: 1.0} | ({"fault_reason": 9.0} if how == "fault" else {})
        lost = replace(result, values=dict(result.values or {}) | why)
        runs = replace(tuning.monte_carlo, results=(lost,))
        simulations = findings.simulations | {"tuning": replace(tuning, monte_carlo=runs)}
        failed = replace(findings, simulations=simulations)
    elif how == "board":
        native = run_board(findings.device, "host", {}, lambda _: None, ticks=40)
        assert native.passed
        assert set(native.results) == {"sense", "control"}
        shown = replace(findings, board=native)
        assert shown.passed
        assert "bits equal" in Page(shown.html()).text
        wrong = replace(
            native.results["sense"],
            identical=False,
            first_difference=Difference(7, "tau_Nm", "0x3f800000", "0x00000000"),
        )
        board = replace(native, results={**native.results, "sense": wrong})
        failed = replace(findings, board=board)
    else:
        failed = replace(findings, board=BoardRun("x", "a board", failed="silent for 10 s"))
    assert not failed.passed
    text = failed.html()
    assert 'class="banner failed"' in text
    assert all(p in Page(text).text for p in failed.problems)
    assert how != "fault" or "latched TORQUE, the interaction torque" in failed.problems[-1]
    # Two verdicts: a run that ended is not the C's fault, nor a wrong bit the drive's.
    code, does = failed.summary()[1:3]
    ended = how in ("unstable", "tripped", "fault")
    assert failed.to_dict()["verdicts"]["code"]["matches"] is ended
    assert [x.startswith("FAILED: ") for x in (code, does)] == [not ended, ended]


def test_a_drive_that_errs_by_a_fifth_does_not_reach(monkeypatch, elbow_drive):
    """Armed: the same run with a limit below its error."""
    monkeypatch.setattr(reach, "SHARES", (0.5,))
    monkeypatch.setattr(reach, "FREQUENCIES_HZ", (1.0,))
    (point,) = reach.tried(elbow_drive, "elbow_drive", "real", lambda _: None)
    share = point["rms_true_Nm"] / (point["torque_Nm"] / 2**0.5)
    assert point["followed"]
    assert 0 < share < reach.FOLLOWED
    monkeypatch.setattr(reach, "FOLLOWED", 0.99 * share)
    (point,) = reach.tried(elbow_drive, "elbow_drive", "real", lambda _: None)
    assert not point["followed"]


def test_as_printed_runs_on_the_own_devices_plant(tmp_path: Path, findings, monkeypatch):
    # A stiffer coupling; the yardstick in a second way: the same device under that controller.
    stiff = {"elastomer": {"k1_Nm_rad": 12.0}}
    own, printed = tmp_path / "stiff.toml", tmp_path / "printed.toml"
    own.write_text(own_text(name="stiff", **stiff))
    printed.write_text(own_text('controller = "smc-published"\n', name="stiff", **stiff))
    monkeypatch.setattr(drive, "COMPARED", ("tuning",))
    monkeypatch.setattr(drive, "ALONE", ())
    _, yardsticks = drive.close_loop(load_device(own), lambda _: None)
    (case,) = yardsticks["tuning"].cases()
    (expected,) = simulate("tuning", Setting(str(printed))).cases()
    (elbows,) = findings.yardsticks["tuning"].cases()
    assert case["rms_true_Nm"] == expected["rms_true_Nm"] != elbows["rms_true_Nm"]


@pytest.mark.slow
def test_a_predictive_controller_has_a_page(findings, monkeypatch):
    device = load_device("elbow_drive", "mpc")
    board = run_board(device, "host", {}, lambda _: None, ticks=40)
    assert board.passed
    assert set(board.results) == {"sense", "control"}
    shorten(monkeypatch)
    monkeypatch.setattr(builder, "run_board", lambda *_: board)
    simulated = findings.simulations, findings.yardsticks
    monkeypatch.setattr(drive, "close_loop", lambda *_: simulated)
    found = gather(device)
    assert found.passed
    assert found.command == "esea-gen report elbow_drive --controller mpc"
    assert "predictive: " in Page(found.html()).text
    kernels = {k["block"] for k in found.to_dict()["code"]["kernels"]}
    assert {b.name for b in device.system.kinds} - kernels == {"predictive"}
