"""The assessment on the study engine: its tasks, a session that is cut off, its log."""

from __future__ import annotations

import shutil

import pytest

from esea_host.assess.patients import DEG
from esea_host.assess.tasks import PAUSE_S, SHOWN, TRIES, ProbeTask, assessment_of
from esea_host.cli.options import know_shipped_tasks
from esea_host.study.folder import StudyFolder
from esea_host.study.protocol import load_protocol, parse_protocol
from esea_host.study.session import read_session, replay
from esea_host.study.source import SimulatedSource
from esea_host.study.task import Situation
from tests.assess.test_assess import made_up
from tests.conftest import ROOT

PROTOCOL = """
schema = 1
name = "small"
title = "A small visit"
seed = 3
[[session]]
name = "visit"
[[session.block]]
name = "pendulum"
task = "knee-pendulum"
parameters = {{ seconds = 6.0 }}
trials = [{{ repeat = 1 }}]
[[session.block]]
name = "range"
task = "knee-range"
parameters = {{ seconds = 10.0, period_s = 7.0, low_deg = 30.0, high_deg = 80.0 }}
trials = [{{ repeat = 1 }}]
[[session.block]]
name = "probing"
task = "knee-probe"
parameters = {{ database = "{base}", simulated = "S3", high_deg = 120.0 }}
trials = [{{ repeat = 2 }}]
"""


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    path = tmp_path_factory.mktemp("base") / "base.npz"
    made_up().save(path)
    return path


@pytest.fixture(scope="module")
def visited(base, tmp_path_factory):
    """A whole visit of a simulated patient."""
    know_shipped_tasks()
    protocol = parse_protocol(PROTOCOL.format(base=base), "small.toml")
    study = StudyFolder.create(tmp_path_factory.mktemp("s") / "a", protocol, True, durable=False)
    study.enrol("P01", consent=True)
    session = study.session("P01", 0, SimulatedSource(5))
    assert session.run() == ""
    session.close()
    return study, protocol


@pytest.mark.ci
def test_a_protocol_file_runs_a_whole_visit(visited):
    study, _ = visited
    pendulum, loop, *probes = study.rows("P01")
    assert 1.0 < pendulum["relaxation_index"] < 1.6  # moderate: less than relaxed legs
    assert loop["slow"]
    assert loop["cycles"] == 1
    assert [loop["low_rad"] / DEG, loop["high_rad"] / DEG] == pytest.approx([35, 75], abs=6)
    assert len(probes) == 2
    assert all(p["passed"] and len(p["readings"]) >= 3 for p in probes)
    # The next movement follows from the rows before it, the last answer from all.
    for k, p in enumerate(probes):
        session = assessment_of(p_parameters(study), probes[: k + 1])
        best = max(session.by_name().items(), key=lambda x: x[1])
        assert (p["most_like"], p["probability"]) == (best[0], pytest.approx(best[1]))
    assert probes[0]["asked_rad"] != probes[1]["asked_rad"] or probes[1]["asked_rad_s"] != 0


def p_parameters(study):
    plan = read_session(study.log_of("P01", 0)).plan
    return ProbeTask.Parameters(**plan.trials[-1].parameters)


def test_the_log_replays_to_the_same_scenes(visited):
    study, _ = visited
    found = [same for _, _, same in replay(study.log_of("P01", 0))]
    assert len(found) > 2000
    assert all(found)


@pytest.mark.parametrize("cut", ["within a line", "behind a line"])
def test_a_visit_that_is_cut_off_goes_on_as_it_would_have(visited, tmp_path, cut):
    """Cut within the last probing movement, as a kill leaves it: the same rows in the end."""
    whole, _ = visited
    shutil.copytree(whole.path, tmp_path / "b")
    study = StudyFolder.open(tmp_path / "b", durable=False)
    path = study.log_of("P01", 0)
    lines = path.read_bytes().splitlines(keepends=True)
    at = max(k for k, line in enumerate(lines) if b'"kind":"trial",' in line)
    left = b"".join(lines[: at + 3])
    path.write_bytes(left[:-7] if cut == "within a line" else left)
    done = read_session(path)
    assert len(done.past) == 3
    assert done.running == 4
    assert bool(done.torn) == (cut == "within a line")
    again = study.session("P01", 0, SimulatedSource(5))
    assert again.run() == ""
    again.close()
    assert study.rows("P01") == whole.rows("P01")


def situation(base, **more):
    return Situation(ProbeTask.Parameters(database=str(base), **more), "", (), 1)


def follow(base, speed=1.0, angle=None):
    """Hands that follow what is shown, or are too slow; the outcome and events."""
    task, events = ProbeTask(), []
    state = task.begin(situation(base))
    m = state.movement
    begins = SHOWN * (m.duration_s + PAUSE_S)
    for k in range(4000):
        t = k * 0.01
        inside = (t - begins) % (m.duration_s + PAUSE_S) if t >= begins else 0.0
        now = float(m.at(inside * speed)[0]) if angle is None else angle
        step = task.step(state, t, {"angle_rad": now, "torque_Nm": 3.0})
        assert step.requests == {}
        assert step.scene.texts[-1].key == "knee_notice"
        state = step.state
        events += [e.name for e in step.events]
        if step.outcome is not None:
            return step.outcome, events, t, m
    raise AssertionError("never ended")


def test_the_task_shows_follows_and_reads(base):
    outcome, events, t, m = follow(base)
    row = ProbeTask().checked_row(outcome.row)
    assert events == []
    assert row["passed"]
    assert row["tries"] == 1
    angle, rate, _ = row["readings"][0]
    assert angle == pytest.approx(m.location.angle_rad, abs=3 * DEG)
    assert rate == pytest.approx(m.location.rate_rad_s, rel=0.1)
    period_s = m.duration_s + PAUSE_S
    assert t == pytest.approx((SHOWN + 1) * period_s, abs=0.02)
    assert t <= ProbeTask().longest_s(situation(base).parameters)


def test_a_missed_location_is_asked_again_and_then_left(base):
    outcome, events, _, m = follow(base, speed=0.35)
    assert events == ["missed"] * (TRIES - 1)
    assert not outcome.row["passed"]
    assert outcome.row["tries"] == TRIES
    # What was passed instead counts, and the next movement is another one.
    assert outcome.row["readings"]
    row = {**outcome.row, "task": "knee-probe"}
    state = ProbeTask().begin(Situation(situation(base).parameters, "", (row,), 1))
    assert state.movement.location != m.location


def test_the_shipped_protocol_is_whole():
    know_shipped_tasks()
    protocol = load_protocol(ROOT / "host" / "esea_host" / "assess" / "protocol.toml")
    tasks = {b.task for b in protocol.file.session[0].block}
    assert tasks == {"knee-probe", "knee-pendulum", "knee-range"}
