"""Session in its windows: the same log as without, and the operator's actions."""

from __future__ import annotations

import errno
import math
import os
import time
from concurrent.futures import wait
from pathlib import Path

import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_gen.files import locked
from esea_host.cli import app
from esea_host.study.conductor import HELD, PAUSED, Conductor
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.protocol import load_protocol, parse_protocol
from esea_host.study.scene import Text
from esea_host.study.session import replay
from esea_host.study.source import SimulatedSource
from esea_host.study.task import Actor, Situation, task_named
from esea_host.windows.theme import BANNER_GROUND
from tests.conducted import (
    EXAMPLE,
    TRACKING,
    calibration,
    ended,
    headless,
    logged,
    of_tasks,
    study_of,
    until,
)

# -- the same session ------------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize("of", ["steady_hold", "wrist", "interaction"])
def test_windows_leave_the_log_that_a_headless_run_leaves(tmp_path, qtbot, windows, of):
    pong = 'task = "interaction.pong"\ntrials = [{ repeat = 2, parameters = { seconds = 3.0 } }]'
    asked = {
        "steady_hold": load_protocol(EXAMPLE),
        "wrist": calibration(),
        "interaction": of_tasks(TRACKING, pong),
    }[of]
    plain, shown = headless(tmp_path / "plain", asked), study_of(tmp_path / "shown", asked)
    conductor = Conductor(shown, shown.session("P01", 0, SimulatedSource(3)), math.inf)
    _, operator = windows(conductor, language="de")
    conductor.start()
    qtbot.waitUntil(lambda: conductor.over, timeout=120_000)
    operator.refresh()
    assert conductor.error is None
    assert "BEENDET" in operator.bar.state.text()
    assert logged(shown) == logged(plain)
    assert [r["trial"] for r in shown.rows("P01")] == [r["trial"] for r in plain.rows("P01")]
    assert all(same for _, _, same in replay(shown.log_of("P01", 0)))
    assert shown.problems() == []
    # The screen's own numbers: of every trial, then of the whole session.
    trials = len(conductor.plan.trials)
    assert [d["trial"] for _, d in logged(shown, "display")] == [*range(1, trials + 1), None]
    assert {operator.trials.item(k, 1).text() for k in range(trials)} == {"abgeschlossen"}


def test_simulated_time_waits_for_the_clock(begin):
    """Three trials of 1 s at 10 times the clock's pace."""
    before = time.monotonic()
    ended(begin(of_tasks(TRACKING), speed=10.0))
    assert time.monotonic() - before >= 0.3


# -- what the operator does ------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["space", "escape", "button", "closed"])
def test_stop_acts_within_the_trial_from_either_window(begin, windows, qtbot, how):
    from PySide6.QtCore import Qt

    conductor = begin(of_tasks(TRACKING), at=[(2, 0.5)])
    participant, operator = windows(conductor)
    conductor.arrive()
    if how == "button":
        qtbot.mousePress(operator.stop_button, Qt.MouseButton.LeftButton)
    elif how == "closed":
        operator.close()
    elif how == "escape":
        operator.written.setFocus()
        qtbot.keyClick(operator.written, Qt.Key.Key_Escape)
    else:
        qtbot.keyClick(participant, Qt.Key.Key_Space)
    ended(conductor)
    (_, last) = logged(conductor.study, "trial_end")[-1]
    assert (last["trial"], last["state"]) == (2, "aborted")
    assert last["reason"] == conductor.reason == "the operator stopped it"
    frames = [d for _, d in logged(conductor.study, "frames") if d["trial"] == 2]
    assert frames[-1]["samples"][-1][0] == pytest.approx(0.5)  # not one step more
    operator.refresh()
    assert "STOPPED" in operator.bar.state.text()
    assert conductor.screen().scene.texts == (Text("stopped"),)
    assert operator.stop_button.isVisible() == (how != "closed")


def test_a_stopped_session_goes_on_as_if_it_had_not_been(begin, windows, tmp_path):
    conductor = begin(load_protocol(EXAMPLE), at=[(5, 0.1)])
    conductor.arrive()
    conductor.stop("lunch")
    ended(conductor)
    study = conductor.study
    again = Conductor(study, study.session("P01", 0, SimulatedSource(3)), math.inf)
    _, operator = windows(again)
    operator.refresh()
    assert [operator.trials.item(4, k).text() for k in (1, 5)] == ["aborted", "lunch"]
    assert again.coming.number == 5
    again.start()
    again.join(20)
    assert again.error is None
    plain = headless(tmp_path / "plain", load_protocol(EXAMPLE))
    assert conductor.study.rows("P01") == plain.rows("P01")
    assert conductor.study.problems() == []


def test_a_pause_holds_a_task_that_can_be_held_and_shows_the_score(begin, windows, qtbot):
    from PySide6.QtCore import Qt

    conductor = begin(of_tasks(TRACKING), at=[(1, 0.5), (1, 0.9)])
    _, operator = windows(conductor)
    conductor.arrive()
    qtbot.keyClick(operator, Qt.Key.Key_P)
    operator.refresh()
    assert "PAUSED" in operator.bar.state.text()
    conductor.go_on()
    assert [t.key for t in conductor.screen().scene.texts] == ["follow", "error", "paused"]
    qtbot.mouseClick(operator.buttons["pause"], Qt.MouseButton.LeftButton)
    ended(conductor)
    assert [d["name"] for _, d in logged(conductor.study, "event")] == ["paused", "resumed"]
    # A pause is no time.
    assert [r["seconds"] for r in conductor.study.rows("P01")] == pytest.approx([1.0] * 3)
    assert all(same for _, _, same in replay(conductor.study.log_of("P01", 0)))


def test_a_pause_of_other_tasks_is_between_two_trials(begin, windows):
    conductor = begin(load_protocol(EXAMPLE), at=[(1, 0.1)])
    _, operator = windows(conductor)
    conductor.arrive()
    operator.pause()
    operator.refresh()
    assert "pause after this trial" in operator.bar.words.text()
    conductor.go.set()
    until(lambda: conductor.phase == PAUSED)
    assert conductor.states[1] == "completed"
    assert conductor.screen().scene.texts == (Text("paused"),)
    operator.pause()
    ended(conductor)
    kinds = [k for k, _ in logged(conductor.study, "pause", "go_on", "trial_end")]
    assert kinds[:3] == ["trial_end", "pause", "go_on"]
    assert kinds.count("pause") == 1


def test_repeat_and_skip_while_it_runs_with_a_reason_only(begin, windows):
    conductor = begin(of_tasks(TRACKING, TRACKING), at=[(2, 0.5), (2, 0.5)])
    _, operator = windows(conductor)
    conductor.arrive()
    operator.repeat()
    assert "first write a reason" in conductor.said
    operator.written.setText("a cough")
    operator.repeat()  # the one that runs: nothing is marked
    for words, row, job in (("the strap", 0, operator.repeat), ("no time", 3, operator.skip)):
        operator.written.setText(words)
        operator.trials.selectRow(row)
        operator.refresh()
        assert operator.buttons["skip_this_trial"].name == f"Skip trial {row + 1}"
        job()
    operator.refresh()
    assert operator.buttons["skip_this_trial"].name == "Skip trial 2"  # the one that runs
    operator.written.setText("again")
    operator.trials.selectRow(4)
    operator.repeat_block()  # nothing of it was run
    assert "has been run yet" in conductor.said
    conductor.go_on()
    ended(conductor)
    order = [(d["trial"], d["state"], d["reason"]) for _, d in logged(conductor.study, "trial_end")]
    assert order[:3] == [(1, "completed", ""), (2, "aborted", "a cough"), (1, "completed", "")]
    assert [n for n, s, _ in order[3:] if s == "completed"] == [2, 3, 5, 6]
    assert [d["trial"] for _, d in logged(conductor.study, "skip")] == [4]
    assert sorted(r["trial"] for r in conductor.study.rows("P01")) == [1, 2, 3, 5, 6]
    assert all(same for _, _, same in replay(conductor.study.log_of("P01", 0)))
    operator.refresh()
    assert [operator.trials.item(3, k).text() for k in (1, 5)] == ["skipped", "no time"]


def test_a_stop_in_a_rest_aborts_no_trial(begin):
    conductor = begin(of_tasks(f"rest_s = 600\n{TRACKING}"), speed=1.0)
    until(lambda: conductor.phase == "resting")
    assert 590 < conductor.rest_left_s <= 600
    assert conductor.screen().scene.texts[0].key == "rest"
    conductor.stop("the participant asked")
    ended(conductor)
    assert conductor.reason == "the participant asked"
    assert logged(conductor.study, "trial") == []


def reported(operator, severity="mild", relation="possible", action="trial-stopped", text="cramp"):
    """Fill in the part of the window for an adverse event, and record it."""
    chosen = {"severity": severity, "relation": relation, "action": action}
    for name, key in chosen.items():
        box = operator.adverse.choices[name]
        box.setCurrentIndex(box.findData(key))
    operator.adverse.text.setText(text)
    operator.adverse.record()
    wait([operator.adverse.writing], 30)
    operator.adverse.look()
    return chosen | {"text": text}


def test_an_adverse_event_stops_the_trial_first_and_is_on_record(begin, windows, qtbot):
    from PySide6.QtCore import Qt

    conductor = begin(of_tasks(TRACKING), at=[(2, 0.5), (2, 0.5)])
    _, operator = windows(conductor)
    conductor.arrive()
    panel, study = operator.adverse, conductor.study
    qtbot.keyClick(operator, Qt.Key.Key_E)
    assert panel.isVisible()
    assert operator.stop_button.isVisible()
    panel.record()
    assert "choose severity" in panel.told.text()
    operator.refresh()
    qtbot.mouseClick(panel.stop_trial, Qt.MouseButton.LeftButton)
    conductor.go.set()
    until(lambda: conductor.phase == PAUSED)
    assert (conductor.states[2], conductor.reasons[2]) == ("aborted", "adverse event")
    given = reported(operator)
    (event,) = [d for k, d in study.audited() if k == "adverse"]
    assert event == {"participant": "P01", "session": 0, "trial": 2, **given}
    operator.refresh()
    assert (panel.isVisible(), panel.text.text()) == (False, "")
    assert operator.bar.said.text() == "The adverse event is recorded."
    operator.pause()
    conductor.arrive()  # the same trial, again
    ended(conductor)
    assert [r["trial"] for r in study.rows("P01")] == [1, 2, 3]
    kinds = [k for k, _ in logged(study, "adverse", "trial_end")]
    assert kinds == ["trial_end", "trial_end", "adverse", "trial_end", "trial_end"]
    operator.refresh()
    assert operator.buttons["open"].isEnabled()  # after the end, too
    reported(operator, severity="severe")
    assert [d["severity"] for k, d in study.audited() if k == "adverse"] == ["mild", "severe"]
    assert study.problems() == []


def test_the_stop_does_not_wait_for_the_record(begin, windows):
    """Another program holds the study's record meanwhile."""
    conductor = begin(of_tasks(TRACKING), at=[(2, 0.5)])
    _, operator = windows(conductor)
    conductor.arrive()
    operator.adverse.open()
    with locked(conductor.study.path / "audit.lock", "an export"):
        for box in operator.adverse.choices.values():
            box.setCurrentIndex(1)
        operator.adverse.text.setText("cramp")
        operator.adverse.record()
        operator.stop()
        conductor.go.set()
        until(lambda: conductor.states[2] == "aborted")
        operator.adverse.look()
        assert operator.adverse.writing is not None
        assert operator.adverse.text.text() == "cramp"
    wait([operator.adverse.writing], 30)
    assert [d["text"] for k, d in conductor.study.audited() if k == "adverse"] == ["cramp"]


def test_an_adverse_event_that_cannot_be_written_stays_in_its_fields(begin, windows, monkeypatch):
    conductor = begin(of_tasks(TRACKING), at=[(1, 0.5)])
    _, operator = windows(conductor, language="de")
    conductor.arrive()
    operator.adverse.open()

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(conductor.study, "record", full)
    reported(operator, text="Krampf")
    assert "NICHT eingetragen" in operator.adverse.told.text()
    assert "No space left" in operator.adverse.told.text()
    assert operator.adverse.text.text() == "Krampf"
    monkeypatch.undo()
    operator.adverse.record()
    wait([operator.adverse.writing], 30)
    assert [d["text"] for k, d in conductor.study.audited() if k == "adverse"] == ["Krampf"]
    ended(conductor)


@pytest.mark.parametrize(
    ("real", "rehearsed", "mark"),
    [(False, False, "SIMULIERT"), (True, True, "PROBELAUF, SIMULIERT"), (True, False, "")],
)
def test_both_windows_say_what_is_simulated_or_a_rehearsal(
    tmp_path, windows, real, rehearsed, mark
):
    study = StudyFolder.create(tmp_path / "s", of_tasks(TRACKING), not real, by="Weber")
    study.enrol("P01", consent=True, form="1")
    source = SimulatedSource(3)
    if real and not rehearsed:
        source.simulated = False
    log = study.new_rehearsal(0) if rehearsed else None
    conductor = Conductor(study, study.session("P01", 0, source, rehearsal=log), math.inf)
    participant, operator = windows(conductor, language="de")
    assert operator.windowTitle().startswith(f"{mark} - P01" if mark else "P01")
    assert (operator.bar.badge.text(), operator.bar.badge.isVisible()) == (mark, bool(mark))
    painted = participant.grab().toImage()
    strip = [painted.pixelColor(x, painted.height() - 16) for x in range(painted.width())]
    assert (BANNER_GROUND in {c.name() for c in strip}) == bool(mark)
    conductor.start()
    conductor.join(20)
    assert conductor.error is None


def test_the_group_is_not_shown_where_the_protocol_says_so(begin, windows):
    text = EXAMPLE.read_text().replace('blinded = ["participant"]', 'blinded = ["operator"]')
    conductor = begin(parse_protocol(text, "p.toml", [EXAMPLE.parent]), at=[(1, 0.1)])
    _, operator = windows(conductor)
    conductor.arrive()
    operator.refresh()
    assert operator.group == "blinded"
    table = operator.trials
    cells = [
        table.item(r, k).text() for r in range(table.rowCount()) for k in range(table.columnCount())
    ]
    labels = [
        w.text() for w in (operator.bar.who, operator.bar.words, operator.now, operator.coming)
    ]
    assert "hidden" in cells
    # Its size is the condition's: the participant sees it, and the operator does not.
    assert conductor.screen().scene.shapes
    assert operator.scene.scene.shapes == ()
    for word in ("near", "narrow", "group A", "group B"):
        assert not any(word in text for text in (*cells, *labels))


# -- guided calibration ----------------------------------------------------------------------------


class Short(Actor):
    """Sweeps, but stops short of the ends."""

    time_s = 0.0

    def react(self, scene, requests):
        self.time_s = round(self.time_s + 0.01, 6)
        return self.time_s, {"fe_deg": 30.0 * math.sin(self.time_s), "ru_deg": 0.0}


def test_a_calibration_says_at_once_what_is_short_and_waits(begin, windows, monkeypatch, tmp_path):
    from PySide6.QtWidgets import QApplication

    monkeypatch.setattr(type(task_named("wrist.velocity", "")), "simulate", lambda *_: Short())
    conductor = begin(calibration(), at=[(4, 7.5), (4, 8.5)], hold=True)
    _, operator = windows(conductor)
    conductor.arrive()
    operator.refresh()
    assert operator.bar.words.text().startswith("Next: ")
    conductor.go_on()
    operator.refresh()
    advice = "No end of the range was reached for 8 s. Ask for larger movements"
    assert advice in operator.bar.words.text()
    assert "further" in [t.key for t in conductor.screen().scene.texts]
    conductor.go.set()
    until(lambda: conductor.phase == HELD)
    operator.refresh()
    assert "WAITING FOR YOU" in operator.bar.state.text()
    operator.resize(1180, 560)
    operator.toggle_theme()
    for _ in range(3):  # letters grow with the window, and ask for room
        QApplication.processEvents()
    place = Path(os.environ.get("ESEA_PICTURES") or tmp_path)
    assert operator.grab().save(str(place / "study-waiting-dark.png"))
    # Live and at the end: on disk before anything is decided.
    assert advice in logged(conductor.study, "event")[-1][1]["advice"][0]
    (row,) = [r for r in conductor.study.rows("P01") if r["task"] == "wrist.velocity"]
    assert advice in row["complaints"][0]
    monkeypatch.undo()
    operator.written.setText("too short")
    operator.trials.selectRow(3)
    operator.repeat_block()
    operator.pause()
    ended(conductor)
    found = [d for _, d in logged(conductor.study, "trial_end") if d["trial"] == 4]
    assert [d["state"] for d in found] == ["completed", "completed"]
    assert [bool(d["row"]["complaints"]) for d in found] == [True, False]


@pytest.mark.parametrize(("length_s", "good"), [(10.0, False), (1.0, True)])
def test_nodes_fill_and_words_tell_while_it_goes_on(length_s, good):
    """Movements of 40 deg, in 10 s: 4 deg/s."""
    task = task_named("wrist.velocity", "")
    past = [{"task": "wrist.neutral", "neutral_fe_deg": 0.0, "neutral_ru_deg": 0.0}]
    for way in (1, -1):
        past.append({"task": "wrist.range", "axis": "FE", "way": way, "end_deg": 20.0 * way})
    rows = tuple(row | {"impairment": False} for row in past)
    state, events = task.begin(Situation(task.Parameters(axis="FE"), "", rows, 1)), []
    for k in range(int(2.2 * length_s / 0.01)):
        share = k * 0.01 / length_s
        theta = 20.0 - 40.0 * abs(1 - share % 2) if share < 2 else -20.0
        step = task.step(state, k * 0.01, {"fe_deg": -theta, "ru_deg": 0.0})
        state = step.state
        events += step.events
    keys, advice = [t.key for t in step.scene.texts], events[-1].data["advice"]
    assert {s.kind for s in step.scene.shapes if s.role == "node"} == {"disc" if good else "ring"}
    if good:
        assert (keys, advice) == (["sweep"], [])
    else:
        assert "faster" in keys
        assert "mean speed is 4.0 deg/s, 5 are required. Ask for faster" in advice[0]


# -- what goes wrong -------------------------------------------------------------------------------


def test_a_window_that_fails_does_not_stop_the_session(begin, windows, monkeypatch):
    conductor = begin(of_tasks(TRACKING), at=[(1, 0.5)])
    participant, _ = windows(conductor)
    conductor.arrive()

    def broken(_) -> None:
        raise RuntimeError("drawing failed")

    participant.timer.stop()
    monkeypatch.setattr(participant, "painted", broken)
    with pytest.raises(RuntimeError, match="drawing failed"):
        participant.repaint()
    monkeypatch.undo()
    ended(conductor)
    assert [r["trial"] for r in conductor.study.rows("P01")] == [1, 2, 3]


def test_a_full_disk_is_told_and_what_was_written_is_whole(tmp_path, monkeypatch):
    folder = tmp_path / "s"
    study_of(folder, load_protocol(EXAMPLE))
    written, write = [], os.write

    def full(file, line):
        if Path(f"/proc/self/fd/{file}").readlink().name == "events.jsonl":
            written.append(line)
            if len(written) > 20:
                raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, line)

    monkeypatch.setattr(os, "write", full)
    monkeypatch.setattr("esea_host.windows.study.running.SHOWN_AT_END_MS", 50)
    for words in (["run", "--headless"], ["resume", "--close", "--speed", "500"]):
        done = CliRunner().invoke(app, ["study", words[0], str(folder), "P01", *words[1:]])
        assert isinstance(done.exception, UserError)
        assert "No space left on device" in str(done.exception)
        assert read_log(folder / "P01" / "session-1" / "events.jsonl").breaks == ()


# -- command line ----------------------------------------------------------------------------------


def test_a_session_in_windows_from_the_command_line(tmp_path, qtbot, monkeypatch):
    monkeypatch.setattr("esea_host.windows.study.running.SHOWN_AT_END_MS", 50)
    folder = str(tmp_path / "s")
    run = ["run", folder, "P01", "--speed", "200", "--language", "de", "--patch", "onset"]
    for words, told in (
        (["create", str(EXAMPLE), folder, "--simulated"], ""),
        (["enrol", folder, "P01", "--consent"], ""),
        ([*run, "--close"], "Simulated participant: 12 of 12"),
        (["replay", folder, "P01"], "the same, bit for bit"),
    ):
        done = CliRunner().invoke(app, ["study", *words])
        assert done.exit_code == 0, done.output + str(done.exception)
        assert told in done.output


@pytest.mark.parametrize(
    ("words", "said_there"),
    [
        (["--device", "pointer", "--headless"], "needs a window"),
        (["--device", "virtual", "--headless"], "no virtual device for steady_hold"),
        (["--device", "sin:elbow", "--headless"], "is not an address"),
        (["--language", "xx", "--headless"], "de, en"),
    ],
)
def test_bad_words_are_told_before_anything_is_written(tmp_path, words, said_there):
    folder = tmp_path / "s"
    study_of(folder, load_protocol(EXAMPLE))
    done = CliRunner().invoke(app, ["study", "run", str(folder), "P01", *words])
    assert said_there in str(done.exception)
    assert not (folder / "P01").exists()
