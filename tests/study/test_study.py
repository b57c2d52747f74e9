"""Study engine: protocols, order, crash-safe logs, participants' rights."""

from __future__ import annotations

import json
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import numpy.random as everybodys
import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.cli.options import know_shipped_tasks
from esea_host.study.exchange import to_rows
from esea_host.study.fitting import uses_of
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.plan import build_plan, explain, group_of
from esea_host.study.protocol import parse_protocol
from esea_host.study.scene import Scene, Shape, Text
from esea_host.study.session import StudySession, read_session, replay
from esea_host.study.source import SimulatedSource
from esea_host.study.task import Actor, TaskEvent, TrialOutcome, task_named
from tests.conducted import EXAMPLE, changed, run_one

# -- protocols -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rest_s = 30", "rest = 30", ["unknown key", "rest_s"]),
        ("rest_s = 30", 'rest_s = "long"', ["rest_s"]),
        ("copies = 2", "copies = 0", ["copies"]),
        ("hold_s = 0.3", "holds = 0.3", ["holds", "hold_s"]),
        ("hold_s = 0.3", "hold_s = -0.3", ["hold_s", "greater than"]),
        ('task = "steady_hold"', 'task = "steady_hld"', ["Did you mean steady_hold"]),
        ('condition = "group"', 'condition = "grp"', ["grp", "near, narrow"]),
        ('A = ["near", "narrow"]', 'A = ["near"]', ["1 conditions", "2 sessions"]),
        ('A = ["near", "narrow"]', 'A = ["near", "wide"]', ["wide"]),
        ("within_deg = 3.0", "within_dg = 3.0", ["within_dg", "within_deg"]),
        ("within_deg = 1.5", "within_deg = 30", ["less than or equal to 20"]),
        ("repeat = 2", "repeat = 0", ["trials[0].repeat"]),
        ('name = "steady-hold"', 'name = "Steady Hold"', ["name"]),
        ("seed = 7", "seed = 7\nseed = 8", ["not valid TOML"]),
    ],
)
def test_a_wrong_protocol_is_told_before_the_first_trial(old, new, words):
    with pytest.raises(UserError) as error:
        changed(old, new)
    text = EXAMPLE.read_text(encoding="utf-8")
    number = text[: text.index(old)].count("\n") + 1
    if "seed" not in new:  # a key that occurs twice is told by the reader of TOML, with its name
        words = [*words, f"line {number}"]
    for word in words:
        assert word in str(error.value)
    assert "problems" not in str(error.value)


# -- order -----------------------------------------------------------------------------------------


def test_the_order_is_the_seeds_and_nobody_elses(protocol):
    plan = build_plan(protocol, 0, 0)
    everybodys.seed(0)
    everybodys.random(100)
    assert build_plan(protocol, 0, 0) == plan
    assert [t.block for t in plan.trials] == ["practice"] * 2 + ["hold 1"] * 5 + ["hold 2"] * 5
    for name in ("hold 1", "hold 2"):
        places = [t.parameters["place_deg"] for t in plan.trials if t.block == name]
        assert Counter(places[:4]) == {10.0: 2, -10.0: 2}
        assert places[4] == 0.0
    assert [t.catch for t in plan.trials].count(True) == 2
    assert [t.rest_before_s for t in plan.trials] == [0, 0, 30, 0, 0, 0, 0, 30, 0, 0, 0, 0]
    orders = {
        tuple(t.parameters["place_deg"] for t in build_plan(protocol, k, 0).trials)
        for k in range(20)
    }
    assert len(orders) > 5


def test_a_changed_block_shifts_no_other_order(protocol):
    """Each block draws from a generator of its own."""
    other = changed("{ repeat = 2, parameters = { place_deg = 5.0 } }", "{ repeat = 3 }")
    a = [t.parameters for t in build_plan(protocol, 3, 0).trials if t.block.startswith("hold")]
    assert a == [t.parameters for t in build_plan(other, 3, 0).trials if t.block.startswith("hold")]


def test_groups_are_balanced_after_every_pair(protocol):
    groups = [group_of(protocol, k) for k in range(40)]
    for k in range(0, 40, 2):
        assert set(groups[k : k + 2]) == {"A", "B"}
    assert len(set(zip(groups[::2], groups[1::2], strict=True))) == 2  # not always A first
    near, narrow = (
        {t.parameters["within_deg"] for t in build_plan(protocol, groups.index("A"), s).trials}
        for s in (0, 1)
    )
    assert (near, narrow) == ({3.0}, {1.5})


# -- sessions --------------------------------------------------------------------------------------


def test_a_session_leaves_rows_and_replays_to_the_same_scenes(study):
    shown: list[Scene] = []
    session = run_one(study, show=shown.append)
    assert session.state.remaining == ()
    assert [r["trial"] for r in session.state.past] == list(range(1, 13))
    assert all(r["held"] for r in session.state.past)
    again = list(replay(study.log_of("P01", 0)))
    assert [scene for _, scene, _ in again] == shown
    assert all(same for _, _, same in again)


@pytest.fixture
def kind(protocol):
    """The class of the example's task."""
    return type(task_named("steady_hold", ""))


def test_a_replay_with_another_task_is_seen(study, kind, monkeypatch):
    run_one(study)
    step = kind.step

    def other(self, state, time_s, inputs):
        return step(self, state, time_s, {k: np.nextafter(v, 100) for k, v in inputs.items()})

    monkeypatch.setattr(kind, "step", other)
    assert not all(same for _, _, same in replay(study.log_of("P01", 0)))


def entries(study: StudyFolder, kind: str) -> list:
    return [e.data for e in read_log(study.log_of("P01", 0)).entries if e.kind == kind]


def test_a_stop_acts_at_once_and_the_trial_comes_again(study):
    asked = iter([""] * 30 + ["the participant asked"])
    state = run_one(study, stop=lambda: next(asked)).state
    number = state.remaining[0].number
    assert (state.states[number], state.reasons[number]) == ("aborted", "the participant asked")
    assert sum(len(data["samples"]) for data in entries(study, "frames")) == 30
    assert run_one(study).state.remaining == ()
    ends = [(e["reason"], e["completed"]) for e in entries(study, "end")]
    assert ends == [("the participant asked", False), ("", True)]


class Answers(Actor):
    """A simulated person who always answers the same."""

    def __init__(self, answer) -> None:
        self.answer = answer

    def react(self, scene, requests):
        return self.answer


def circular() -> dict:
    held: dict = {}
    held["itself"] = held
    return held


ODD = {
    "nan": float("nan"), "inf": np.float32("inf"), "object": object(), "bytes": b"1", "set": {1},
    "complex": 1j, "large": 10**5000, "surrogate": "\ud800", "key": {1: 2}, "circular": circular(),
    "deep": [[{"a": np.nan}]], "date": np.datetime64("2026-01-01"),
}  # fmt: skip


def returning(kind, change):
    """A step of a task with something else in what it returns, 0.1 s into each trial."""
    step = kind.step

    def changed_step(self, state, time_s, inputs):
        made = step(self, state, time_s, inputs)
        return change(made) if time_s > 0.1 else made

    return changed_step


def event(data, name="odd"):
    return lambda made: replace(made, events=(TaskEvent(name, data),))


def scene(*parts, **more):
    return lambda made: replace(made, scene=Scene(*parts, **more))


WRONG = {f"event {n}": event({"x": x}) for n, x in ODD.items()} | {
    "the engine's name": event({"trial": 1}),
    "event's name": event({}, np.nan),
    "advice": event({"advice": 3}),
    "no events": lambda made: replace(made, events=3),
    "no step": lambda made: None,
    "raises": lambda made: {}["theta"],
    "exits": lambda made: sys.exit(3),
    "no scene": lambda made: replace(made, scene=None),
    "request": lambda made: replace(made, requests={"tau_desired_Nm": np.float64("nan")}),
    "request's kind": lambda made: replace(made, requests={"tau_desired_Nm": "1"}),
    "shape": scene((Shape("disc", "cursor", np.nan, 0.0),)),
    "role": scene((Shape("disc", "nobody", 0.0, 0.0),)),
    "width": scene(half_width=0.0),
    "text": scene((), (Text("rest"),)),
    "outcome": lambda made: replace(made, outcome="over"),
    "row": lambda made: replace(made, outcome=TrialOutcome({"held": True, "after_s": np.nan})),
    "row's columns": lambda made: replace(made, outcome=TrialOutcome({"held": True})),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_a_task_returns_wrongly_fails_its_trial(study, kind, monkeypatch, wrong):
    monkeypatch.setattr(kind, "step", returning(kind, WRONG[wrong]))
    state = run_one(study).state
    assert state.ended.startswith("2 trials in a row failed, the last one: task steady_hold: ")
    assert [state.states[n] for n in (1, 2, 3)] == ["failed", "failed", "pending"]
    if wrong not in ("raises", "exits"):  # it would be raised in the replay again
        assert all(same for _, _, same in replay(study.log_of("P01", 0)))


@pytest.mark.parametrize(
    "part", [lambda *_: 1 / 0, lambda *_: None, lambda *_: {"x": np.nan}, lambda *_: np.inf]
)
def test_a_task_that_does_not_say_what_it_needs_is_told(kind, monkeypatch, protocol, part):
    monkeypatch.setattr(kind, "longest_s", part)
    with pytest.raises(UserError, match="task steady_hold: "):
        explain(protocol)
    monkeypatch.setattr(kind, "conditions", part)
    with pytest.raises(UserError, match="task steady_hold: "):
        uses_of(protocol)


@pytest.mark.parametrize(
    "answer",
    [(0.02, {"theta_deg": "1"}), (0.02, {"theta_deg": np.nan}), (np.nan, {}), (None, {}), (1, 2)],
)
def test_what_a_simulated_person_answers_wrongly_fails_the_trial(study, kind, monkeypatch, answer):
    monkeypatch.setattr(kind, "simulate", lambda *_: Answers(answer))
    assert "trials in a row failed" in run_one(study).state.ended


def test_numpys_scalars_are_written_as_numbers(study, kind, monkeypatch):
    odd = {"k": np.argmax([0, 1]), "f": np.float32(0.5), "b": np.bool_(True), "a": np.eye(2)}
    monkeypatch.setattr(kind, "step", returning(kind, event(odd | {"kind": None})))
    assert run_one(study).state.ended == ""
    told = next(data for data in entries(study, "event") if data["name"] == "odd")
    wanted = {"k": 1, "f": 0.5, "b": True, "a": [[1.0, 0.0], [0.0, 1.0]], "kind": None}
    assert {k: told[k] for k in wanted} == wanted


class NotReady(SimulatedSource):
    def ready(self):
        return {"problem": "the torque at rest is 0.4 Nm, at most 0.1 Nm is allowed"}


def test_a_device_that_is_not_ready_starts_nothing(study):
    session = study.session("P01", 0, NotReady(1))
    assert "0.4 Nm" in session.run()
    assert set(session.state.states.values()) == {"pending"}


def test_only_a_trial_to_come_is_skipped_and_with_a_reason(study):
    run_one(study)
    session = study.session("P01", 0, SimulatedSource(1))
    with pytest.raises(UserError, match="is done"):
        session.skip(4, "shown twice")
    with pytest.raises(UserError, match="reason"):
        session.skip(5, "")
    session.close()


def test_a_trial_comes_again_in_its_place(study):
    run_one(study)
    session = study.session("P01", 0, SimulatedSource(9))
    with pytest.raises(UserError, match="reason"):
        session.repeat(4, "")
    session.repeat(4, "the strap was open")
    assert [t.number for t in session.state.remaining] == [4]
    assert 4 not in [r["trial"] for r in session.state.past]
    session.run()
    session.close()
    again = read_session(study.log_of("P01", 0))
    assert [r["trial"] for r in again.past] == [1, 2, 3, *range(5, 13), 4]
    assert all(same for _, _, same in replay(study.log_of("P01", 0)))


def test_a_repeat_leaves_the_earlier_sessions_rows(tmp_path):
    """They have the same numbers: trial 1 of the session before is where the neutral comes from."""
    text = 'schema = 1\nname = "r"\ntitle = "r"\nseed = 1\n[[session]]\nname = "a"\n'
    text += '[[session.block]]\nname = "b"\ntask = "wrist.range"\ntrials = [{ repeat = 2 }]\n'
    know_shipped_tasks()
    plan = build_plan(parse_protocol(text, "r.toml"), 0, 0)
    neutral = {"neutral_fe_deg": 9.0, "neutral_ru_deg": 0.0, "trial": 1, "impairment": False}
    earlier = ({**neutral, "task": "wrist.neutral"},)
    path = tmp_path / "events.jsonl"
    session = StudySession(path, plan, "P01", SimulatedSource(1), earlier, durable=False)
    session.run()
    session.repeat(1, "a cough")
    session.run()
    session.close()
    assert all(same for _, _, same in replay(path, earlier))


# -- people ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "consent", "words"),
    [("Anna", True, "never a name"), ("P01", True, "taken"), ("P02", False, "not consented")],
)
def test_codes_and_consent(study, code, consent, words):
    with pytest.raises(UserError, match=words):
        study.enrol(code, consent)


def test_washout_and_order_of_sessions(study):
    with pytest.raises(UserError, match="has not done session 1"):
        study.session("P01", 1, SimulatedSource(1))
    session = study.session("P01", 0, SimulatedSource(3), day=100)
    session.run()
    session.close()
    with pytest.raises(UserError, match="6 days since the last session, 7 are planned"):
        study.session("P01", 1, SimulatedSource(1), day=106)
    study.session("P01", 1, SimulatedSource(1), day=106, early="leaves the country").close()
    assert ("session_start", "leaves the country") in [
        (k, d.get("early")) for k, d in study.audited()
    ]


def test_blinding_and_scrubbed_export(tmp_path, study):
    assert study.group_shown("P01", "participant") == "blinded"
    assert study.group_shown("P01", "operator") == "A"
    session = study.session("P01", 0, SimulatedSource(3))
    session.note("came with Anna")
    session.run()
    session.close()
    assert to_rows(study, tmp_path / "out") == 12
    held = "".join(p.read_text() for p in (tmp_path / "out").iterdir())
    assert "P01" not in held
    assert "Anna" not in held
    assert len([json.loads(x) for x in (tmp_path / "out" / "rows.jsonl").open()]) == 12
    with pytest.raises(UserError, match="not empty"):
        to_rows(study, tmp_path / "out")


# -- command line ----------------------------------------------------------------------------------


def test_from_an_empty_folder_to_the_data(tmp_path):
    def call(*words: str) -> str:
        done = CliRunner().invoke(app, ["study", *words])
        assert done.exit_code == 0, done.output + str(done.exception)
        return done.output

    folder = str(tmp_path / "s")
    assert "at most 2 min" in call("check", str(EXAMPLE))
    call("create", str(EXAMPLE), folder, "--simulated")
    assert "group" not in call("enrol", folder, "P01", "--consent")
    assert "Simulated participant: 12 of 12" in call("run", folder, "P01", "--headless")
    assert "REHEARSAL: " in call("run", folder, "P09", "--headless", "--rehearsal")
    assert "the same, bit for bit" in call("replay", folder, "P01")
    call("event", folder, "deviation", "An hour late", "--participant", "P01", "--session", "1")
    grave = ("--severity", "mild", "--relation", "possible", "--action", "Padded the cuff")
    call("event", folder, "adverse", "Red skin", "--participant", "P01", *grave)
    assert "adverse action=Padded the cuff participant=P01" in call("audit", folder)
    assert "nothing was changed" in call("repair", folder)
    assert "Every log is as it was written" in call("audit", folder)
    assert "12 of 12 trials are done" in call("resume", folder, "P01", "--headless")
    assert "repeats trial 3" in call("repeat", folder, "P01", "3", "--reason", "a cough")
    assert "Remaining, as planned: 3" in call("resume", folder, "P01", "--headless")
    call("repeat", folder, "P01", "2", "--reason", "a cough")
    call("skip", folder, "P01", "2", "--reason", "no time")
    assert "12 of 12 trials are done" in call("resume", folder, "P01", "--headless")
    told = call("export", folder, str(tmp_path / "out"))
    assert told.startswith("Left out:\n  rehearsals: 1, which count for nobody\n")
    assert "  P01, session 1, trial 2 skipped: no time\n" in told
    assert "11 rows" in told
    assert "1 participants" in call("export", folder, "--check")
    assert "Session 1, first; begun: 1, complete: 1" in call("status", folder)
    assert "no more sessions" in call("withdraw", folder, "P01")
    gone = call("delete", folder, "P01", "--reason", "asked")
    assert "1 files deleted" in gone
    shared = json.loads((tmp_path / "out" / "rows.jsonl").read_text().splitlines()[0])
    assert f"exports on record: 1; delete {shared['participant']} there too" in gone


def test_the_task_file_may_be_named_on_the_command_line(tmp_path):
    text = EXAMPLE.read_text().replace('tasks = ["steady_hold.py"]\n', "")
    (tmp_path / "p.toml").write_text(text)
    done = CliRunner().invoke(
        app, ["study", "check", str(tmp_path / "p.toml"), "--task", str(EXAMPLE.with_suffix(".py"))]
    )
    assert done.exit_code == 0


@pytest.mark.ci
def test_many_simulated_participants_whatever_the_workers(tmp_path):
    said = []
    for name, jobs in (("a", "1"), ("b", "2")):
        words = ["study", "virtual", str(EXAMPLE), "--participants", "4", "--jobs", jobs]
        done = CliRunner().invoke(app, [*words, "--keep", str(tmp_path / name)])
        assert done.exit_code == 0, str(done.exception)
        study = StudyFolder.open(tmp_path / name)
        assert study.problems() == []
        said.append((done.output, [study.rows(c) for c in study.participants()]))
    assert said[0] == said[1]
    assert "4 SIMULATED participants: 56 trials completed" in said[0][0]
