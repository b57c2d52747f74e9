"""The cross-over's tasks on the study engine, the virtual rig, and virtual people on it."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from joblib import parallel_config
from scipy.integrate import solve_ivp

from esea_gen.errors import UserError
from esea_host.cli import main
from esea_host.interaction import tasks
from esea_host.interaction.analysis import analyse_interaction
from esea_host.interaction.design import element_of
from esea_host.interaction.figures import render_report
from esea_host.interaction.recordings import read_angle, read_manifest, write_manifest
from esea_host.interaction.rig import HANDLE_KGM2, ElementRig, RigPlayer
from esea_host.interaction.virtual import PROTOCOL, RigSource, run_crossover
from esea_host.interaction.words import lines
from esea_host.people.person import Limb, PersonModel, person
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.plan import build_plan
from esea_host.study.protocol import load_protocol, parse_protocol
from esea_host.study.scene import Scene
from esea_host.study.task import Situation, TaskBrokenError, task_named
from tests.typed import host_command as called
from tests.typed import typed

pytestmark = pytest.mark.ci

STEP_S = 0.01


def begun(name, seed=1, **given_):
    """The task, and its first state."""
    task = task_named(f"interaction.{name}", "")
    return task, task.begin(Situation(task.Parameters(**given_), "spring", (), seed))


# -- tasks ----------------------------------------------------------------------------------------


def test_the_paddle_is_its_equation():
    """Against a stiff integrator, with one step and with a thousand."""
    c, inertia, force = 0.011, 1e-5, 0.03

    def right(_, y):
        return [y[1], (force - c * y[1]) / inertia]

    exact = solve_ivp(right, (0, 0.05), [0.2, -4.0], method="Radau", rtol=1e-10, atol=1e-12)
    start = tasks.Paddle(0.2, -4.0)
    once = tasks.paddle_step(start, force, 0.05)
    many = start
    for _ in range(1000):
        many = tasks.paddle_step(many, force, 5e-5)
    for found in (once, many):
        assert found.x == pytest.approx(exact.y[0, -1], rel=1e-7)
        assert found.speed_1_s == pytest.approx(exact.y[1, -1], rel=1e-7)
    # Nearly x' = 90.9 F after a few milliseconds.
    assert once.speed_1_s == pytest.approx(90.909 * force, rel=1e-4)


def played(seed=1, until_s=40.0, hand=None, step_s=STEP_S):
    """Last step of a game and the names of its events; a hand is told the state."""
    task, state = begun("pong", seed, seconds=until_s)
    events, k = [], 0
    while True:
        k += 1
        theta = 0.0 if hand is None else hand(state)
        step = task.step(state, k * step_s, {"theta_rad": theta})
        state = step.state
        events += [e.name for e in step.events]
        if step.outcome is not None:
            return task, step, events


def chase(state):
    """The angle is a speed: to the ball, within a third of a second."""
    return (state.ball_y - state.paddle_y) * state.parameters.half_screen / 90.9 / 0.3


def test_a_good_player_saves_more_and_the_game_replays():
    _, still, _ = played(3)
    task, good, events = played(3, hand=chase)
    row = task.checked_row(good.outcome.row)
    assert row["score"] > 0.9 > still.outcome.row["score"]
    assert events.count("saved") == row["saved"]
    assert events.count("missed") == row["missed"]
    assert events.count("served") == row["missed"] + 1
    assert row["score"] == row["saved"] / (row["saved"] + row["missed"])
    assert row["seconds"] == pytest.approx(40.0)
    assert played(3, hand=chase)[1] == good
    assert played(4)[1].state != still.state


def test_a_lost_paddle_is_recentred_on_request():
    """At 0.2 rad it goes 18.2 units a second: off a half screen of 10 after 0.65 s."""
    task, state = begun("pong")
    names, when = [], None
    for k in range(1, 101):
        step = task.step(state, k * STEP_S, {"theta_rad": 0.2})
        state = step.state
        names += [e.name for e in step.events]
        if state.lost and when is None:
            when = k * STEP_S
    assert when == pytest.approx(1.18 * 10 / (0.2 / 0.011), abs=0.011)
    assert names.count("paddle_lost") == state.times_lost == 1
    back = task.step(state, 1.01, {"theta_rad": 0.0, "recentre": 1.0})
    assert [e.name for e in back.events] == ["paddle_recentred"]
    assert back.state.paddle == tasks.Paddle()
    # Where it is not lost, asking changes nothing.
    assert not task.step(back.state, 1.02, {"theta_rad": 0.0, "recentre": 1.0}).events


@pytest.mark.parametrize("name", ["pong", "tracking"])
def test_a_pause_stops_the_task_and_no_time_goes_back(name):
    task, state = begun(name, seconds=2.0)
    moving = task.step(state, 1.0, {"theta_rad": 0.01}).state
    held = task.step(moving, 9.0, {"theta_rad": 0.2, "pause": 1.0})
    assert [e.name for e in held.events] == ["paused"]
    assert held.outcome is None
    assert dataclasses.replace(held.state, last_s=moving.last_s, paused=False) == moving
    on = task.step(held.state, 9.0, {"theta_rad": 0.01})
    assert [e.name for e in on.events] == ["resumed"]
    # The pause does not count: one second is still to do.
    assert task.step(on.state, 9.9, {"theta_rad": 0.0}).outcome is None
    end = task.step(on.state, 10.0, {"theta_rad": 0.0}).outcome
    assert task.checked_row(end.row)["seconds"] == pytest.approx(2.0)
    with pytest.raises(TaskBrokenError, match="goes back"):
        task.step(moving, 0.5, {"theta_rad": 0.0})


@pytest.mark.parametrize(
    ("target", "law"), [("four sines", tasks.tracked_rad), ("one sine", tasks.familiar_rad)]
)
def test_the_score_of_tracking(target, law):
    """A steady offset is that offset."""
    task, state = begun("tracking", target=target, seconds=5.0, element="elastomer")
    for k in range(1, 501):
        step = task.step(state, k * 0.01, {"theta_rad": law(k * 0.01) + 0.02})
        state = step.state
    row = task.checked_row(step.outcome.row)
    assert row["rms_error_deg"] == pytest.approx(math.degrees(0.02))
    assert (row["element"], row["target"]) == ("elastomer", target)
    by_role = {s.role: s for s in step.scene.shapes}
    apart = by_role["cursor"].x - by_role["target"].x
    assert apart * tasks.screen_deg(target) == pytest.approx(math.degrees(0.02))
    assert step.requests == {}


# -- protocol -------------------------------------------------------------------------------------


def test_the_shipped_protocol_is_the_published_design():
    protocol = load_protocol(PROTOCOL)
    for group in ("A", "B"):
        for block in (1, 2):
            assert protocol.file.groups[group][block - 1] == element_of(group, block)
    for session in (0, 1):
        plan = build_plan(protocol, 0, session)
        first, *rest = plan.trials
        assert first.familiarisation
        assert (first.parameters["target"], first.parameters["seconds"]) == ("one sine", 30.0)
        assert [t.task for t in rest] == ["interaction.tracking", "interaction.pong"]
        assert all(60 <= t.parameters["seconds"] <= 90 for t in rest)
        assert {t.parameters["element"] for t in plan.trials} == {plan.trials[0].condition}
        if session:
            assert 120 <= first.rest_before_s <= 180


@pytest.mark.ci
def test_check_explains_it_and_names_a_wrong_element(tmp_path):
    code, shown, _ = called("study", "check", PROTOCOL)
    assert code == 0
    assert "group B: elastomer, then spring" in shown
    assert "last 45 s analysed" in shown
    for given_, words in (
        (("--jobs", 0), "not a number of processes"),
        (("--keep", PROTOCOL), "cannot be made"),
    ):
        code, _, error = called("study", "virtual", "interaction", *given_)
        assert code == 2
        assert words in error
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(PROTOCOL.read_text().replace('element = "spring"', 'element = "springs"'))
    code, _, error = called("study", "check", wrong)
    assert code == 2
    assert "springs" in error


# -- rig and people -------------------------------------------------------------------------------


FREE = Limb(0.003, 0.0, 0.0, 0.0, -1.4, 1.0)
LIMP = (0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_hand_on_the_spring_is_an_oscillator():
    """Published stiffness, no damping: its period, and its way by the closed form."""
    k, inertia = math.degrees(0.0502), FREE.inertia_kgm2 + HANDLE_KGM2
    rig = ElementRig("spring", FREE)
    rig.wrist.omega_rad_s = 2.0
    read = [x for _ in range(100) for x in rig.advance(LIMP)]
    w = math.sqrt(k / inertia)
    t = np.arange(1, 1001) / 1000
    exact = 2.0 / w * np.sin(w * t)
    assert read == pytest.approx(exact, abs=0.035 * 2.0 / w)  # symplectic steps of 1 ms
    half = np.flatnonzero(np.diff(np.array(read) >= 0))
    assert np.mean(np.diff(half)) / 1000 == pytest.approx(math.pi / w, rel=2e-3)
    # Whole counts of 14 bits, as a board of single precision has them.
    counts = np.round(np.array(read) * 2**14 / (2 * np.pi))
    assert np.array_equal(read, np.float32(counts * 2 * np.pi / 2**14).astype(float))


def test_more_than_the_law_knows_is_refused():
    rig = ElementRig("spring", FREE)
    for _ in range(5):
        rig.advance((8.0, 0.5, 0.3, 0.3, 9.0))
    with pytest.raises(UserError, match=r"its law ends at 20\.1 deg"):
        _ = [rig.advance((20.0, 0.5, 0.6, 0.6, 9.0)) for _ in range(100)]


def test_what_is_known_of_the_rig_is_what_the_firmware_makes_of_it():
    """A tick of its clock each millisecond; in its fault a frozen angle is not recorded."""
    rig = ElementRig("elastomer", FREE)
    muscle = (8.0, 0.3, 0.1, 0.1, 3.0)
    _ = [rig.advance(muscle) for _ in range(200)]
    assert rig.board.clock().tick == 2000
    assert rig.theta_rad == pytest.approx(rig.wrist.theta_rad, abs=0.5 * 2 * math.pi / 2**14)
    assert rig.tau_Nm == pytest.approx(rig.wrist.tau_Nm, abs=0.002)
    assert abs(rig.tau_Nm) > 0.15
    rig.board.lib.sim_fail(105)
    with pytest.raises(UserError, match="simulated board of rig_elastomer is FAULT"):
        rig.advance(muscle)
    rig.start()
    assert rig.advance(muscle)[-1] == rig.theta_rad != 0


def test_a_person_brings_a_lost_paddle_back_after_a_while():
    who = person(np.random.default_rng(1), PersonModel())
    task, state = begun("pong")
    situation = Situation(state.parameters, "spring", (), 1)
    player = RigPlayer(who, ElementRig("spring", who.limbs[0]).advance, [0.0], situation)
    state = dataclasses.replace(state, paddle=tasks.Paddle(80.0))
    scene, when = Scene(), None
    for _ in range(500):
        time_s, inputs = player.react(scene, {})
        step = task.step(state, time_s, inputs)
        state, scene = step.state, step.scene
        if any(e.name == "paddle_recentred" for e in step.events):
            when = time_s
            break
    assert when == pytest.approx(3.0, abs=0.1)


def test_the_trial_says_which_element_is_in_and_only_whole_trials_are_kept(tmp_path):
    source = RigSource(person(np.random.default_rng(1), PersonModel()), tmp_path)
    for element in ("elastomer", "spring"):
        task, state = begun("tracking", element=element)
        hand = source.trial(task, Situation(state.parameters, element, (), 1), 1)
        assert hand.advance.__self__.element == element
        hand.react(Scene(), {})
    for state in ("aborted", "failed"):
        source.over(1, state)
    assert list(tmp_path.iterdir()) == []
    source.over(2, "completed")
    (kept,) = tmp_path.iterdir()
    assert kept.name == "encoder-2.csv"
    assert kept.read_text().startswith("# simulated\ntime_s,theta_rad\n0.001,")
    assert len(read_angle(kept)[0]) == 10


def short(seed=1, seconds=8.0):
    """The shipped protocol with tasks of a few seconds."""
    text = PROTOCOL.read_text(encoding="utf-8").replace("seed = 1\n", f"seed = {seed}\n", 1)
    for long_ in ("75.0", "30.0"):
        text = text.replace(f"seconds = {long_}", f"seconds = {seconds}")
    return parse_protocol(text, "short.toml")


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    folder = tmp_path_factory.mktemp("interaction") / "s"
    told = []
    assert run_crossover(folder, 2, 1, protocol=short(), last_s=5.0, say=told.append) == []
    assert told == [f"{k} of 2 simulated participants" for k in (1, 2)]
    return folder


@pytest.mark.ci
def test_recordings_are_the_encoder_at_1_kHz(studied):
    """And each tenth is what the task was given; familiarisation is kept, and not analysed."""
    manifest = read_manifest(studied)
    assert manifest.simulated
    assert manifest.last_s == 5.0
    assert len(manifest.recording) == 8
    study = StudyFolder.open(studied)
    assert study.problems() == []
    entry = next(e for e in manifest.recording if e.task == "tracking" and e.block == 2)
    time_s, theta_deg, _ = read_angle(studied / entry.file)
    assert len(time_s) == 8000
    assert np.diff(time_s) == pytest.approx(0.001)
    row = next(
        r
        for r in study.rows(entry.participant)
        if r["session"] == 1 and not r["familiarisation"] and "rms_error_deg" in r
    )
    assert row["element"] == entry.element == element_of(entry.group, 2)
    frames = np.degrees([tasks.tracked_rad(t) for t in time_s[9::10]])
    error = math.sqrt(np.mean((theta_deg[9::10] - frames) ** 2))
    assert row["rms_error_deg"] == pytest.approx(error, rel=1e-6)
    assert (studied / entry.participant / "session-1" / "encoder-1.csv").exists()


@pytest.mark.ci
def test_it_ends_in_the_analysis_and_says_what_it_is(studied):
    found = analyse_interaction(studied)
    assert found.simulated
    assert len(found.comparisons) == 8
    said = "\n".join(lines(found))
    assert said.count("SIMULATED") >= 8 + 4
    assert "Table 6.2, block 1 and block 2" in said
    assert "Table 6.3, spring and elastomer" in said
    assert "How large a difference could 2 SIMULATED people have shown" in said
    assert render_report(found).count("(simulated)</h2>") == 6
    real = dataclasses.replace(found, simulated=False)
    assert "imulated" not in "\n".join(lines(real))
    assert "(simulated)" not in render_report(real)


@pytest.mark.ci
def test_the_number_of_workers_changes_nothing(tmp_path):
    """And another seed does.  Threads, who share more than processes do."""
    found = []
    for name, seed, jobs in (("a", 1, 1), ("b", 1, 2), ("c", 2, 1)):
        folder = tmp_path / name
        with parallel_config(backend="threading"):
            run_crossover(folder, 2, seed, jobs, protocol=short(seed, 2.0), last_s=1.0)
        logs = sorted(folder.glob("*/*/events.jsonl"))
        told = [[(e.time_s, e.kind, e.data) for e in read_log(p).entries] for p in logs]
        found.append((told, [p.read_bytes() for p in sorted(folder.glob("*/*/*.csv"))]))
    assert found[0] == found[1]
    assert found[0] != found[2]


def test_a_person_who_stopped_early_is_left_out_by_name(studied, tmp_path):
    folder = tmp_path / "copy"
    for path in [p for p in studied.rglob("*") if p.is_file()]:
        to = folder / path.relative_to(studied)
        to.parent.mkdir(parents=True, exist_ok=True)
        to.write_bytes(path.read_bytes())
    (folder / "V002" / "session-2" / "events.jsonl").unlink()
    write_manifest(folder, 5.0)
    assert len(read_manifest(folder).recording) == 6
    with pytest.raises(UserError, match="people with both elements: 1"):
        analyse_interaction(folder)


@pytest.mark.ci
def test_the_command(monkeypatch, tmp_path):
    monkeypatch.setattr("esea_host.interaction.virtual.interaction_protocol", short)
    monkeypatch.setattr("esea_host.interaction.virtual.LAST_S", 5.0)
    answer = tmp_path / "answer.json"
    arguments = ("--participants", 2, "--seed", 3, "--jobs", 1, "--json", answer)
    done = typed("study", "virtual", "interaction", *arguments, program=main)
    told = "1 of 2 simulated participants\n2 of 2 simulated participants\n"
    assert (done.returncode, done.stderr) == (0, told)
    assert "SIMULATED: no person took part" in done.stdout
    assert json.loads(answer.read_text())["simulated"] is True
