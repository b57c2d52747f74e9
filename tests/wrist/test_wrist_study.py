"""The wrist study: its tasks, the virtual device, virtual people, and the tables."""

from __future__ import annotations

import json
import math
import os
import sys
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest
from jsonschema import ValidationError
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from esea_gen import files
from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.people.person import PersonModel, minimum_jerk, person
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.plan import build_plan
from esea_host.study.protocol import parse_protocol
from esea_host.study.scene import Scene
from esea_host.study.task import Situation, task_named
from esea_host.wrist import analysis
from esea_host.wrist.calibration import calibrated, cursor_maps
from esea_host.wrist.figures import distributions
from esea_host.wrist.moving import Moving, advance, target_distance_deg
from esea_host.wrist.sensitivity import outcome
from esea_host.wrist.virtual import PROTOCOL, run_study, wrist_protocol
from tests.analysis.test_cluster import Dask
from tests.browser import browser, readable

RATE = 18.0 / 5.0

# -- the target ------------------------------------------------------------------------------------


def test_target_dynamics_against_an_integrator():
    """Equation 7.7 by scipy's solver, with a cursor that moves evenly between samples."""
    cursor = np.cumsum(np.random.default_rng(2).normal(size=60)) * 0.4
    target, h = Moving(4.0), 0.01
    for a, b in pairwise(cursor):
        speed = (b - a) / h
        wanted = solve_ivp(
            lambda _, y, v=speed: [y[1], RATE * (v - y[1])],
            (0, h),
            [target.x_deg, target.v_deg_s],
            rtol=1e-11,
            atol=1e-12,
        ).y[:, -1]
        target = advance(target, a, b, h, RATE)
        assert (target.x_deg, target.v_deg_s) == pytest.approx(wanted, abs=1e-9)


def test_a_target_follows_all_of_a_movement_in_the_end():
    target = advance(Moving(4.0), 0.0, 3.0, 0.4, RATE)
    for _ in range(1000):
        target = advance(target, 3.0, 3.0, 0.01, RATE)
    assert target.x_deg == pytest.approx(7.0, abs=1e-9)


@pytest.mark.parametrize(
    ("smallest", "wanted"), [(20.0, 4.0), (10.5, 2.1), (10.0, 2.5), (9.0, 2.25)]
)
def test_where_targets_stand(smallest, wanted):
    assert target_distance_deg(smallest) == pytest.approx(wanted)


def test_too_small_a_range_is_refused_with_advice():
    with pytest.raises(UserError, match="More than 8 deg are needed"):
        target_distance_deg(8.0)


# -- tasks -----------------------------------------------------------------------------------------

SWEEP = np.arange(0, 20, 0.01)


def rows_of(impairment: bool, high: float, rate: float) -> list[dict]:
    def about(**more):
        return {"impairment": impairment, "condition": "", **more}

    rows = [about(task="wrist.neutral", neutral_fe_deg=2.0, neutral_ru_deg=-1.0)]
    for axis, top, low in (("FE", high, -60.0), ("RU", 20.0, -35.0)):
        rows += [about(task="wrist.range", axis=axis, way=1, end_deg=top)]
        rows += [about(task="wrist.range", axis=axis, way=-1, end_deg=low)]
        theta = (top + low) / 2 + (top - low) / 2 * np.sin(2 * np.pi * rate * SWEEP)
        rows += [
            about(task="wrist.velocity", axis=axis, time_s=SWEEP.tolist(), theta_deg=theta.tolist())
        ]
    return rows


PAST = (*rows_of(False, 50.0, 0.25), *rows_of(True, 6.0, 0.2))


def test_a_range_on_a_mirrored_axis_says_so():
    past = [{**r, "end_deg": 0.0} for r in rows_of(False, 50.0, 0.25) if "end_deg" in r]
    with pytest.raises(UserError, match=r"RU is 0.0 to 0.0 deg.*left wrist"):
        calibrated(past, False).range_of("RU")


def catch(**given):
    task = task_named("wrist.catch", "")
    return task, task.begin(Situation(task.Parameters(**given), "", PAST, 1))


def played(task, state, cursors):
    """Steps of 10 ms with the cursor (RU) at these places; the last step."""
    for k, x in enumerate(cursors):
        step = task.step(state, 0.01 * (k + 1), {"fe_deg": 2.0, "ru_deg": x - 1.0})
        state = step.state
        if step.outcome:
            return step
    return step


def test_a_stationary_target_is_caught_after_750_ms():
    task, state = catch(axis="RU", stationary=True)
    home = [0.0] * 60
    step = played(task, state, home + [4.0] * 200)
    row = task.checked_row(step.outcome.row)
    assert row["distance_deg"] == pytest.approx(4.0)  # a fifth of 20 deg
    assert row["achieved"]
    assert row["reach_time_s"] == pytest.approx(0.75 + 0.11, abs=0.03)
    assert [s.role for s in step.scene.shapes] == ["boundary", "origin", "target", "cursor"]
    assert played(task, state, home + [2.1] * 2000).outcome.row["achieved"]
    far = played(task, state, home + [1.9] * 2000)
    assert not far.outcome.row["achieved"]
    assert far.outcome.row["reach_time_s"] == pytest.approx(10.0, abs=0.02)
    # 10 s at 2.1 deg, 100 samples a second; nine of them still at the origin.
    assert far.outcome.row["sse_deg2"] == pytest.approx(991 * 2.1**2 + 9 * 4.0**2)


def test_a_moving_target_runs_from_the_hand_and_over_the_boundary():
    task, state = catch(axis="RU", boundary_share=1.0)
    slow = np.minimum(np.arange(2000) * 0.05, 30.0)  # 5 deg/s: the distance stays above 2 deg
    step = played(task, state, [0.0] * 60 + list(slow))
    assert step.outcome.row["left"]
    assert not step.outcome.row["achieved"]
    assert any(s.role == "failed" for s in step.scene.shapes)
    fast = np.arange(2000) * 4.0 / (5 / 18) * 0.01  # D / tau: the target is met and stays met
    assert played(task, state, [0.0] * 60 + list(fast)).outcome.row["achieved"]


def test_a_hand_that_does_not_rest_has_no_neutral_position():
    task = task_named("wrist.neutral", "")
    for moves, taken in ((0.0, True), (0.05, False)):  # 5 deg/s
        state = task.begin(Situation(task.Parameters(seconds=2.0), "", (), 1))
        for k in range(2000):
            step = task.step(state, 0.01 * k, {"fe_deg": moves * k, "ru_deg": 1.0})
            state = step.state
            if step.outcome:
                break
        assert (step.outcome.row is not None) == taken
    assert "never rested" in step.outcome.reason


def test_who_pulls_away_first_is_told_apart():
    task, state = catch(axis="RU", stationary=True)
    row = played(task, state, [0.0] * 60 + [-3.0] * 30 + [6.0] * 30 + [4.0] * 100).outcome.row
    assert row["pulled_away"]
    assert analysis.after_effect_deg(row, True) == pytest.approx(-7.0)
    assert analysis.after_effect_deg(row, False) == pytest.approx(-2.0)


def test_the_normalised_cursor_ends_where_the_map_says():
    task, state = catch(axis="FE", impairment=True, stationary=True)
    wanted = cursor_maps(PAST, "rbf")["FE"].position(-40.0 - 2.0)
    step = task.step(state, 0.01, {"fe_deg": -40.0, "ru_deg": 0.0})
    cursor = next(s for s in step.scene.shapes if s.role == "cursor")
    assert cursor.x == pytest.approx(float(wanted))


def swept(turn_deg):
    """A calibration of -62 to 62 deg, nodes to 60, by who turns there; row, and all advice."""
    task = task_named("wrist.velocity", "")
    state = task.begin(Situation(task.Parameters(axis="FE"), "", tuple(WIDE), 1))
    advice = []
    for k in range(3100):
        theta = turn_deg * (abs(k % 400 - 200) / 100 - 1)
        step = task.step(state, 0.01 * k, {"fe_deg": 2.0 + theta, "ru_deg": 0.0})
        state = step.state
        advice += [x for e in step.events for x in e.data["advice"]]
        if step.outcome:
            return step.outcome.row, advice
    raise AssertionError("it never ended")


WIDE = [row | {"end_deg": 62.0 * row["way"]} if "way" in row else row for row in PAST[:3]]


def test_an_end_is_reached_only_beyond_the_outermost_node():
    """5 % of the range lie before the last node: who turns there was told of 0 crossings."""
    row, advice = swept(60.5)  # one sample beyond
    assert (row["movements"], row["complaints"], advice) == (5, [], [])
    row, advice = swept(57.0)
    assert row["movements"] == 0
    assert "No end of the range was reached" in row["complaints"][0]


def test_a_task_without_its_calibration_says_so():
    task = task_named("wrist.track", "")
    with pytest.raises(UserError, match="no healthy movement block 0"):
        task.begin(Situation(task.Parameters(), "", (), 1))
    with pytest.raises(UserError, match="not measured both ways"):
        task_named("wrist.catch", "").begin(Situation(catch()[1].parameters, "", (), 1))


def test_a_new_neutral_position_begins_a_new_calibration():
    again = (*PAST, {**PAST[0], "neutral_fe_deg": 5.0})
    found = calibrated(again, False)
    assert found.neutral == (5.0, -1.0)
    assert found.ends == {}
    assert calibrated(again, True).neutral == (2.0, -1.0)


# -- metrics ---------------------------------------------------------------------------------------


def test_dominant_component_of_a_sine():
    t = np.arange(0, 20, 0.01)
    frequency, amplitude = analysis.dominant(3.0 * np.sin(2 * np.pi * 0.4 * t) + 0.5, 0.01)
    assert frequency == pytest.approx(0.4, abs=0.005)
    assert amplitude == pytest.approx(3.0, rel=0.01)
    assert analysis.median_peak(3.0 * np.sin(2 * np.pi * 0.4 * t)) == pytest.approx(3.0, rel=1e-3)


def test_tracking_half_as_fast_is_half_the_error():
    t = np.arange(0, 20, 0.01)
    theta = 10 * np.sin(2 * np.pi * 0.25 * t)
    row = {"time_s": list(t), "target_deg": list(theta), "cursor_deg": list(0.5 * theta)}
    found = analysis.tracking(row)
    assert found["peak_c_deg_s"] == pytest.approx(0.5 * found["peak_h_deg_s"])
    assert found["rms_error_percent"] == pytest.approx(100 * 0.5 / math.sqrt(2), rel=1e-3)


def test_learning_takes_medians_over_blocks():
    def row(block, achieved, sse, catch=False, furthest=5.0):
        return {
            **{"block": block, "axis": "RU", "catch": catch, "achieved": achieved},
            **{"sse_deg2": sse, "pulled_away": False, "distance_deg": 4.0},
            **{"furthest_deg": furthest, "nearest_deg": 0.0},
        }

    rows = [row("1", True, 100), row("1", False, 9), row("2", True, 200), row("2", True, 300)]
    rows += [row("3", False, 9), row("3", True, 50, catch=True, furthest=6.5)]
    found = analysis.learning(rows)
    assert found["achieved_RU"] == 7.5  # of 15 if all had been run: of 7.5, 15 and 0
    assert found["sse_RU_deg2"] == pytest.approx(175)  # of 100 and 250
    assert found["after_effect_deg"] == pytest.approx(-2.5)
    assert found["sse_FE_deg2"] is None


# -- device and people -----------------------------------------------------------------------------


def test_minimum_jerk_is_the_closed_form():
    s = np.linspace(0, 1, 11)
    assert np.array([minimum_jerk(v) for v in s]) == pytest.approx(10 * s**3 - 15 * s**4 + 6 * s**5)
    assert (minimum_jerk(-1), minimum_jerk(2)) == (0.0, 1.0)


def test_adaptation_is_the_published_recursion():
    who = person(np.random.default_rng(1), PersonModel(spread=0.0))
    fast = slow = 0.0
    for moved in (1, 1, 1, 0, 1):
        error = moved - fast - slow
        fast, slow = 0.59 * fast + 0.21 * error, 0.992 * slow + 0.02 * error
        who.learn(bool(moved))
    assert who.known == pytest.approx(fast + slow)
    who.forget(7)
    assert who.fast == 0
    assert 0 < who.slow < slow


RANGES = ", ".join(
    f'{{ parameters = {{ axis = "{a}", way = {w}, seconds = 5.0 }} }}'
    for a in ("FE", "RU")
    for w in (1, -1)
)
BOTH = ", ".join(f'{{ parameters = {{ axis = "{a}" }} }}' for a in ("FE", "RU"))
CATCHES = (
    '{ repeat = 2, parameters = { axis = "RU" } }, '
    '{ catch = true, parameters = { axis = "RU", stationary = true } }'
)
CALIBRATION = (
    ("wrist.neutral", "{ parameters = { seconds = 1.5 } }"),
    ("wrist.range", RANGES),
    ("wrist.velocity", BOTH),
)
BLOCKS = [
    *((state, *block) for state in ("healthy", "constrained") for block in CALIBRATION),
    ("constrained", "wrist.track", BOTH),
    ("constrained", "wrist.catch", CATCHES),
]


def short(blocks=BLOCKS):
    """The shipped study in one session of these blocks."""
    text = PROTOCOL.read_text(encoding="utf-8")
    head = text[: text.index("[groups]")]
    head += (
        text[text.index("[stopping]") : text.index("[[session]]")] + '[[session]]\nname = "one"\n'
    )
    own = (
        f'[[session.block]]\nname = "{state} {task}"\ntask = "{task}"\ncondition = "{state}"\n'
        f"trials = [{trials}]\n"
        for state, task, trials in blocks
    )
    return parse_protocol(head + "".join(own), "short.toml")


def all_rows(folder):
    study = StudyFolder.open(folder, durable=False, runs=False)
    return [row for code in study.participants() for row in study.rows(code)]


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wrist") / "s"
    assert run_study(folder, 1, 1, protocol=short()) == []
    return folder


@pytest.fixture(scope="module")
def result(studied):
    return analysis.analyse(studied)


@pytest.mark.ci
def test_from_calibration_to_the_tables(studied, result):
    assert result.simulated
    (fe,) = result.people["7.2 validation, FE"].values()
    assert all(math.isfinite(x) for x in fe.values())
    found = calibrated(all_rows(studied), True)
    low, high = found.range_of("FE")
    assert 5.0 < high + found.neutral[0] < 30.0  # the wall, and how far a person pushes into it
    assert low < -50.0
    table = result.tables["7.1 validation, RU"]
    assert [x.n for x in table] == [1, 1, 1, 1]
    assert table[0].published == (0.24, 0.24)


@pytest.mark.ci
def test_figures_show_every_participant(result):
    figure = distributions(result, "7.2 validation, FE")
    assert [len(a.lines) for a in figure.axes] == [2, 2, 2]


@pytest.mark.ci
def test_what_a_method_gives(studied, result):
    found = outcome("rbf", studied, [])
    (fe,) = result.people["7.2 validation, FE"].values()
    assert found.rms_percent["FE"] == pytest.approx(fe["rms_error_percent"])
    assert found.peak_ratio["FE"] == pytest.approx(fe["peak_c_deg_s"] / fe["peak_h_deg_s"])
    assert found.achieved_gap == {"FE": None, "RU": None}  # healthy, no target was shown


@pytest.mark.ci
def test_the_number_of_workers_changes_nothing(tmp_path):
    """And another seed does."""
    rows = []
    for name, seed, jobs in (("a", 1, 1), ("b", 1, 2), ("c", 2, 1)):
        run_study(tmp_path / name, 2, seed, jobs, protocol=short(BLOCKS[:2]))
        rows.append(json.dumps(all_rows(tmp_path / name)))
    assert rows[0] == rows[1]
    assert rows[0] != rows[2]


@pytest.mark.slow
def test_a_cluster_records_the_same(tmp_path):
    """Workers of a real scheduler on this machine; one address that is none is told."""
    dask = Dask(tmp_path)
    try:
        dask.worker(PYTHONPATH=os.pathsep.join(sys.path))
        run_study(tmp_path / "here", 2, 1, protocol=short(BLOCKS[:2]))
        run_study(tmp_path / "there", 2, 1, protocol=short(BLOCKS[:2]), cluster=dask.address)
    finally:
        dask.close()
    here, there = (
        [
            (e.time_s, e.kind, e.data)
            for p in sorted((tmp_path / n).glob("V*/*/*.jsonl"))
            for e in read_log(p).entries
        ]
        for n in ("here", "there")
    )
    assert len(here) > 100
    assert here == there
    with pytest.raises(UserError, match="No Dask scheduler at"):
        run_study(tmp_path / "no", 1, 1, protocol=short(BLOCKS[:2]), cluster="tcp://127.0.0.1:1")


def test_the_shipped_protocol_is_the_published_design():
    protocol = wrist_protocol(1)
    plan = build_plan(protocol, 0, 0)
    catches = [t for t in plan.trials if t.task == "wrist.catch"]
    assert len([t for t in catches if t.familiarisation]) == 16
    for block in (1, 2, 3):
        own = [t for t in catches if t.block == f"acquisition {block}"]
        assert [t.parameters["axis"] for t in own].count("FE") == 15
        assert own[-1].catch
        assert own[-1].parameters["stationary"]
        assert own[-1].parameters["axis"] == "RU"
        assert len(own) == 31
    velocity = [t for t in plan.trials if t.task == "wrist.velocity" and t.condition == "healthy"]
    assert [t.parameters["axis"] for t in velocity] == ["FE", "RU"] * 4
    assert {t.condition for t in build_plan(protocol, 0, 1).trials} == {"healthy", "constrained"}


def test_every_wrist_task_is_simulated_by_itself():
    """The simplest participant of each task, without a device."""
    for name in ("wrist.neutral", "wrist.range", "wrist.velocity", "wrist.track", "wrist.catch"):
        task = task_named(name, "")
        situation = Situation(task.Parameters(), "healthy", PAST, 1)
        actor = task.simulate(situation, np.random.default_rng(1))
        state, scene, asked = task.begin(situation), Scene(), {}
        for _ in range(4000):
            step = task.step(state, *actor.react(scene, asked))
            state, scene, asked = step.state, step.scene, step.requests
            if step.outcome:
                break
        assert step.outcome is not None, name
        assert step.outcome.row is None or task.checked_row(step.outcome.row)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["study", "virtual", "wrist", "--method", "magic"], "no method"),
        (["study", "virtual", "wrist", "--compare", "--sensitivity"], "--sensitivity has no"),
        (["analyse", "wrist", "nowhere"], "not a study"),
    ],
)
def test_bad_input_is_told(words, said):
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, UserError)
    assert said in str(done.exception)


@pytest.mark.ci
def test_a_methods_outcome_follows_its_schema(studied):
    told = files.plain(outcome("none", studied, ["V009: why"]))
    assert (told["people"], told["refused"]) == (1, ["V009: why"])
    for wrong in ({}, {"people": "1"}):
        content = {"simulated": True, "methods": [told | wrong]}
        with pytest.raises(ValidationError) if wrong else nullcontext():
            files.stamped("host-wrist-methods", content)


@pytest.mark.ci
def test_the_command_writes_tables_and_files(studied, tmp_path):
    named = {k: str(tmp_path / f"r.{k}") for k in ("json", "csv")}
    report = str(tmp_path / "r.html")
    words = ["analyse", "wrist", str(studied), "--json", named["json"], "--csv", named["csv"]]
    done = CliRunner().invoke(app, [*words, "--report", report])
    assert done.exit_code == 0, done.output
    assert "SIMULATED" in done.output
    assert "amplitude there" in done.output  # whole, however narrow the terminal is
    assert json.loads((tmp_path / "r.json").read_text())["simulated"] is True
    assert (tmp_path / "r.csv").read_text().endswith(",True\n")
    page = (tmp_path / "r.html").read_text()
    assert page.count("<svg") == 4
    assert "SIMULATED" in page
    with browser(tmp_path / "profile") as b:
        readable(b, page, tmp_path)
