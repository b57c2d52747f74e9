"""A session in its windows: the same log as without, and what an operator can do meanwhile."""

from __future__ import annotations

import math
import os
import re
import threading
import time
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.interaction.virtual import RigSource
from esea_host.people.person import PersonModel, person
from esea_host.study.conductor import HELD, PAUSED, Conductor, appears
from esea_host.study.folder import StudyFolder
from esea_host.study.frames import FrameTimes, summary
from esea_host.study.log import EventLog, read_log
from esea_host.study.plan import generator
from esea_host.study.protocol import Protocol, load_protocol, parse_protocol
from esea_host.study.scene import COLOURS, ON_WHITE, Scene, Shape, Text, catalogue, said
from esea_host.study.session import replay
from esea_host.study.source import SimulatedSource
from esea_host.study.task import Actor, task_named
from esea_host.wrist.tasks import DIRECTIONS
from esea_host.wrist.virtual import VirtualPerson, wrist_protocol

from .conftest import ROOT, require_tool

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
EXAMPLE = ROOT / "examples" / "steady_hold.toml"
FOREVER = math.inf


def of_tasks(*blocks: str, more: str = "") -> Protocol:
    """A protocol of one session; each block is its lines behind the name."""
    head = f'schema = 1\nname = "short"\ntitle = "short"\nseed = 1\n{more}\n'
    head += '[[session]]\nname = "calibration"\n'
    text = "".join(
        f'[[session.block]]\nname = "{k}: {b.split(chr(34))[1]}"\n{b}\n'
        for k, b in enumerate(blocks, 1)
    )
    return parse_protocol(head + text, "short.toml")


TRACKING = (
    'task = "interaction.tracking"\ntrials = [{ repeat = 3, parameters = { seconds = 1.0 } }]'
)


def study_of(folder: Path, protocol: Protocol) -> StudyFolder:
    study = StudyFolder.create(folder, protocol, simulated=True, durable=False)
    study.enrol("P01", True)
    return study


def logged(study: StudyFolder, *kinds: str) -> list:
    """Events of a session; of all kinds but what a screen tells, where none is named."""
    entries = read_log(study.log_of("P01", 0)).entries
    return [
        (e.kind, e.data) for e in entries if (e.kind in kinds if kinds else e.kind != "display")
    ]


WAIT_S = 120  # a machine may be busy


class Stepped(Conductor):
    """Stands still at chosen times of chosen trials until it is let go, so that a test can look."""

    def __init__(self, *given, at=(), **more):
        super().__init__(*given, **more)
        self.at, self.there, self.go = list(at), threading.Event(), threading.Event()

    def steps(self, time_s, step):
        super().steps(time_s, step)
        if self.at and (self.trial.number, time_s) >= self.at[0]:
            self.at.pop(0)
            self.there.set()
            assert self.go.wait(WAIT_S)
            self.go.clear()

    def arrive(self):
        assert self.there.wait(WAIT_S), self.error
        self.there.clear()


@pytest.fixture
def begin(tmp_path):
    """Starts a session of a protocol; ends it in any case."""
    made = []

    def begin_one(protocol, source=None, at=(), **more) -> Stepped:
        study = study_of(tmp_path / "s", protocol)
        given = source or SimulatedSource(3)
        made.append(Stepped(study, "P01", 0, given, **{"speed": FOREVER, "at": at} | more))
        made[-1].start()
        return made[-1]

    yield begin_one
    for conductor in made:
        conductor.stop("the test is over")
        conductor.at.clear()
        conductor.go.set()
        conductor.join(20)
        assert conductor.over


def until(there) -> None:
    """Wait for something in the session's thread."""
    end_s = time.monotonic() + 10
    while not there():
        assert time.monotonic() < end_s
        time.sleep(0.002)


def ended(conductor: Stepped) -> None:
    conductor.go.set()
    conductor.join(20)
    assert conductor.over
    if conductor.error is not None:
        raise conductor.error


# -- the same session ------------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize("of", ["steady_hold", "wrist", "interaction"])
def test_windows_leave_the_log_that_a_headless_run_leaves(tmp_path, qtbot, of):
    from esea_host.windows.study.operator import OperatorWindow
    from esea_host.windows.study.participant import ParticipantWindow

    pong = 'task = "interaction.pong"\ntrials = [{ repeat = 2, parameters = { seconds = 3.0 } }]'
    asked = {
        "steady_hold": load_protocol(EXAMPLE),
        "wrist": calibration(),
        "interaction": of_tasks(TRACKING, pong),
    }[of]
    plain = study_of(tmp_path / "plain", asked)
    session = plain.session("P01", 0, SimulatedSource(3))
    session.run()
    session.close()
    shown = study_of(tmp_path / "shown", asked)
    conductor = Conductor(shown, "P01", 0, SimulatedSource(3), FOREVER)
    windows = ParticipantWindow(conductor, "de"), OperatorWindow(conductor)
    for window in windows:
        qtbot.addWidget(window)
        window.show()
    conductor.start()
    qtbot.waitUntil(lambda: conductor.over, timeout=120_000)
    windows[1].refresh()
    assert conductor.error is None
    assert "DONE" in windows[1].state.text()
    assert logged(shown) == logged(plain)
    assert [r["trial"] for r in shown.rows("P01")] == [r["trial"] for r in plain.rows("P01")]
    assert all(same for _, _, same in replay(shown.log_of("P01", 0)))
    assert shown.problems() == []
    # The screen's own numbers: of every trial, then of the whole session.
    trials = len(conductor.plan.trials)
    told = [d["trial"] for _, d in logged(shown, "display")]
    assert told == [*range(1, trials + 1), None]
    assert {windows[1].trials.item(k, 1).text() for k in range(trials)} == {"completed"}


def calibration() -> Protocol:
    """The healthy calibration, without its rests."""
    return of_tasks(
        'task = "wrist.neutral"\ntrials = [{}]',
        'task = "wrist.range"\ntrials = [{ parameters = { axis = "FE", way = 1 } }, '
        '{ parameters = { axis = "FE", way = -1 } }]',
        'task = "wrist.velocity"\ntrials = [{ repeat = 2, parameters = { axis = "FE" } }]',
    )


def test_a_press_of_a_key_is_seen_in_the_log(begin):
    """Armed: what is compared above does differ where somebody did something."""
    conductor = begin(of_tasks(TRACKING), at=[(2, 0.5)])
    conductor.arrive()
    conductor.note("the strap slipped")
    ended(conductor)
    kinds = [k for k, _ in logged(conductor.study)]
    assert kinds.count("note") == 1
    # On disk within the trial, not at its end.
    assert kinds.index("note") < [k for k, _ in logged(conductor.study)].index("end") - 2


# -- what the operator does ------------------------------------------------------------------------


@pytest.fixture
def windows(qtbot):
    """Both windows of a session."""
    from esea_host.windows.study.operator import OperatorWindow
    from esea_host.windows.study.participant import ParticipantWindow

    def of(conductor, **more):
        made = ParticipantWindow(conductor, **more), OperatorWindow(conductor)
        for window in made:
            qtbot.addWidget(window)
            window.show()
        made[1].activateWindow()
        qtbot.waitUntil(made[1].isActiveWindow, timeout=120_000)
        return made

    return of


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
        operator.words.setFocus()
        qtbot.keyClick(operator.words, Qt.Key.Key_Escape)
    else:
        qtbot.keyClick(participant, Qt.Key.Key_Space)
    ended(conductor)
    (_, last) = logged(conductor.study, "trial_end")[-1]
    assert (last["trial"], last["state"]) == (2, "aborted")
    assert last["reason"] == conductor.reason == "the operator stopped it"
    samples = [
        s for k, d in logged(conductor.study, "frames") if d["trial"] == 2 for s in d["samples"]
    ]
    assert samples[-1][0] == pytest.approx(0.5)  # not one step more
    operator.refresh()
    assert "STOPPED" in operator.state.text()
    assert said(conductor.screen().scene.texts[0]) == "The session was stopped."
    assert operator.stop_button.isVisible() == (how != "closed")


def test_a_stopped_session_goes_on_as_if_it_had_not_been(begin, windows, tmp_path):
    conductor = begin(load_protocol(EXAMPLE), at=[(5, 0.1)])
    conductor.arrive()
    conductor.stop("lunch")
    ended(conductor)
    again = Conductor(conductor.study, "P01", 0, SimulatedSource(3), FOREVER)
    _, operator = windows(again)
    operator.refresh()
    assert operator.trials.item(4, 1).text() == "aborted"
    assert operator.trials.item(4, 5).text() == "lunch"
    assert again.coming.number == 5
    again.start()
    again.join(20)
    assert again.error is None
    plain = study_of(tmp_path / "plain", load_protocol(EXAMPLE))
    session = plain.session("P01", 0, SimulatedSource(3))
    session.run()
    session.close()
    assert conductor.study.rows("P01") == plain.rows("P01")
    assert conductor.study.problems() == []


def test_a_pause_holds_a_task_that_can_be_held_and_shows_the_score(begin, windows, qtbot):
    from PySide6.QtCore import Qt

    conductor = begin(of_tasks(TRACKING), at=[(1, 0.5), (1, 0.9)])
    _, operator = windows(conductor)
    conductor.arrive()
    qtbot.keyClick(operator, Qt.Key.Key_P)
    operator.refresh()
    assert "PAUSED" in operator.state.text()
    conductor.go.set()
    conductor.arrive()
    keys = [t.key for t in conductor.screen().scene.texts]
    assert keys == ["follow", "error", "paused"]
    qtbot.mouseClick(operator.buttons["Pause"], Qt.MouseButton.LeftButton)
    ended(conductor)
    names = [d["name"] for _, d in logged(conductor.study, "event")]
    assert names == ["paused", "resumed"]
    first, second, *_ = conductor.study.rows("P01")
    for row in (first, second):
        assert row["seconds"] == pytest.approx(1.0)  # a pause is no time
    assert all(same for _, _, same in replay(conductor.study.log_of("P01", 0)))


def test_a_pause_of_other_tasks_is_between_two_trials(begin, windows):
    conductor = begin(load_protocol(EXAMPLE), at=[(1, 0.1)])
    _, operator = windows(conductor)
    conductor.arrive()
    operator.pause()
    operator.refresh()
    assert "pause after this trial" in operator.state.text()
    conductor.go.set()
    until(lambda: conductor.phase == PAUSED)
    assert conductor.states[1] == "completed"
    assert conductor.screen().scene.texts == (Text("paused"),)
    operator.pause()
    ended(conductor)
    kinds = [k for k, _ in logged(conductor.study) if k in ("pause", "go_on", "trial_end")]
    assert kinds[:3] == ["trial_end", "pause", "go_on"]
    assert kinds.count("pause") == 1


def test_repeat_and_skip_while_it_runs_with_a_reason_only(begin, windows, qtbot):
    conductor = begin(of_tasks(TRACKING, TRACKING), at=[(2, 0.5), (2, 0.5)])
    _, operator = windows(conductor)
    conductor.arrive()
    operator.repeat()
    assert "without a reason" in conductor.said
    operator.words.setText("a cough")
    operator.repeat()  # the one that runs: nothing is marked
    operator.words.setText("the strap")
    operator.trials.selectRow(0)
    operator.repeat()
    operator.words.setText("no time")
    operator.trials.selectRow(3)
    operator.refresh()
    assert operator.buttons["Skip trial"].text() == "Skip trial 4"
    operator.skip()
    operator.refresh()
    assert operator.buttons["Skip trial"].text() == "Skip trial 2"  # the one that runs
    operator.words.setText("again")
    operator.trials.selectRow(4)
    operator.repeat_block()  # nothing of it was run
    assert "has been run yet" in conductor.said
    conductor.go.set()
    conductor.arrive()
    ended(conductor)
    order = [(d["trial"], d["state"], d["reason"]) for _, d in logged(conductor.study, "trial_end")]
    assert order[:3] == [(1, "completed", ""), (2, "aborted", "a cough"), (1, "completed", "")]
    assert [n for n, s, _ in order[3:] if s == "completed"] == [2, 3, 5, 6]
    assert [d["trial"] for _, d in logged(conductor.study, "skip")] == [4]
    assert sorted(r["trial"] for r in conductor.study.rows("P01")) == [1, 2, 3, 5, 6]
    assert all(same for _, _, same in replay(conductor.study.log_of("P01", 0)))
    operator.refresh()
    assert operator.trials.item(3, 1).text() == "skipped"
    assert operator.trials.item(3, 5).text() == "no time"


def test_a_stop_in_a_rest_aborts_no_trial(begin):
    conductor = begin(of_tasks(f"rest_s = 600\n{TRACKING}"), speed=1.0)
    until(lambda: conductor.phase == "resting")
    assert 590 < conductor.rest_left_s <= 600
    assert said(conductor.screen().scene.texts[0]).startswith("Rest, ")
    conductor.stop("the participant asked")
    ended(conductor)
    assert conductor.reason == "the participant asked"
    assert logged(conductor.study, "trial") == []


def test_the_group_is_not_shown_where_the_protocol_says_so(begin, windows):
    text = EXAMPLE.read_text().replace('blinded = ["participant"]', 'blinded = ["operator"]')
    conductor = begin(parse_protocol(text, "p.toml", [EXAMPLE.parent]), at=[(1, 0.1)])
    _, operator = windows(conductor)
    conductor.arrive()
    operator.refresh()
    assert operator.group == "blinded"
    cells = [
        operator.trials.item(r, k).text()
        for r in range(operator.trials.rowCount())
        for k in range(operator.trials.columnCount())
    ]
    labels = [w.text() for w in (operator.who, operator.state, operator.now, operator.coming)]
    for word in ("near", "narrow"):
        assert word not in cells
        assert not any(word in text for text in labels)
    assert "hidden" in cells
    assert not any("group A" in x or "group B" in x for x in labels)


# -- guided calibration ----------------------------------------------------------------------------


class Short(Actor):
    """Sweeps, but stops short of the ends."""

    time_s = 0.0

    def react(self, scene, requests):
        self.time_s = round(self.time_s + 0.01, 6)
        return self.time_s, {"fe_deg": 30.0 * math.sin(self.time_s), "ru_deg": 0.0}


def test_a_calibration_says_at_once_what_is_short_and_waits(begin, windows, monkeypatch, place):
    task = task_named("wrist.velocity", "")
    monkeypatch.setattr(type(task), "simulate", lambda *_: Short())
    conductor = begin(calibration(), at=[(4, 7.5), (4, 8.5)], hold=True)
    _, operator = windows(conductor)
    conductor.arrive()
    operator.refresh()
    assert operator.advice.text() == ""
    conductor.go.set()
    conductor.arrive()
    operator.refresh()
    advice = "No end of the range was reached for 8 s. Ask for larger movements"
    assert advice in operator.advice.text()
    assert "further" in [t.key for t in conductor.screen().scene.texts]
    conductor.go.set()
    until(lambda: conductor.phase == HELD)
    operator.refresh()
    assert "WAITING FOR YOU" in operator.state.text()
    operator.resize(1180, 560)
    operator.toggle_theme()
    assert operator.grab().save(str(place / "study-waiting-dark.png"))
    # Live and at the end: on disk before anything is decided.
    assert advice in logged(conductor.study, "event")[-1][1]["advice"][0]
    (row,) = [r for r in conductor.study.rows("P01") if r["task"] == "wrist.velocity"]
    assert advice in row["complaints"][0]
    monkeypatch.undo()
    operator.words.setText("too short")
    operator.trials.selectRow(3)
    operator.repeat_block()
    operator.pause()
    ended(conductor)
    found = [d for _, d in logged(conductor.study, "trial_end") if d["trial"] == 4]
    assert [d["state"] for d in found] == ["completed", "completed"]
    assert [bool(d["row"]["complaints"]) for d in found] == [True, False]


def test_nodes_fill_and_words_tell_while_it_goes_on():
    """Movements of 40 deg in 10 s: 4 deg/s."""
    task = task_named("wrist.velocity", "")
    past = [{"task": "wrist.neutral", "impairment": False, "neutral_fe_deg": 0.0}]
    past[0]["neutral_ru_deg"] = 0.0
    for way in (1, -1):
        past.append({"task": "wrist.range", "impairment": False, "axis": "FE"})
        past[-1] |= {"way": way, "end_deg": 20.0 * way}
    from esea_host.study.task import Situation

    def after(length_s: float) -> tuple:
        state, events = task.begin(Situation(task.Parameters(axis="FE"), "", tuple(past), 1)), []
        for k in range(int(2.2 * length_s / 0.01)):
            share = k * 0.01 / length_s
            theta = 20.0 - 40.0 * abs(1 - share % 2) if share < 2 else -20.0
            step = task.step(state, k * 0.01, {"fe_deg": -theta, "ru_deg": 0.0})
            state = step.state
            events += step.events
        return step.scene, events

    slow, said_slow = after(10.0)
    assert "faster" in [t.key for t in slow.texts]
    assert (
        "mean speed is 4.0 deg/s, 5 are wanted. Ask for faster" in said_slow[-1].data["advice"][0]
    )
    good, said_good = after(1.0)
    assert [t.key for t in good.texts] == ["sweep"]
    assert said_good[-1].data["advice"] == []
    kinds = [{s.kind for s in scene.shapes if s.role == "node"} for scene in (slow, good)]
    assert kinds == [{"ring"}, {"disc"}]


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
    written, write = [], EventLog._write

    def full(self, line):
        written.append(line)
        if len(written) > 20:
            raise OSError(28, "No space left on device")
        write(self, line)

    monkeypatch.setattr(EventLog, "_write", full)
    monkeypatch.setattr("esea_host.windows.study.running.SHOWN_AT_END_MS", 50)
    for more in (["--headless"], ["--close", "--speed", "500"]):
        words = ["study", "run", str(folder), "P01", *more]
        words[1] = "resume" if (folder / "P01").exists() else "run"
        done = CliRunner().invoke(app, words)
        assert isinstance(done.exception, UserError)
        assert "No space left on device" in str(done.exception)
        assert read_log(folder / "P01" / "session-1" / "events.jsonl").breaks == ()


# -- time ------------------------------------------------------------------------------------------


def test_frames_in_numbers():
    """60 Hz; two refreshes without a picture, then one."""
    refresh = 1 / 60
    found = summary([refresh] * 96 + [3 * refresh, 2 * refresh, refresh], [0.01], 60.0)
    assert found["dropped"] == 3
    assert found["intervals"] == 99
    assert found["interval_p50_ms"] == pytest.approx(1000 / 60, abs=1e-3)
    assert found["interval_p100_ms"] == pytest.approx(50.0, abs=1e-3)
    assert found["onset_delay_p50_ms"] == 10.0
    none = summary([], [], 60.0)
    assert (none["dropped"], none["interval_p50_ms"], none["onsets"]) == (0, None, 0)


def test_frames_between_trials_are_of_no_trial():
    frames = FrameTimes(100.0)
    for k in range(5):
        frames.painted(k * 0.01, 0, 0.0)
    frames.drop()
    assert not frames.painted(1.0, 0, 1.0)
    assert frames.painted(1.01, 1, 1.004)
    one = frames.take(False)
    assert (one["intervals"], one["dropped"], one["onset_delay_p100_ms"]) == (1, 0, 6.0)
    frames.painted(1.02, 1, 1.004)
    frames.painted(1.06, 1, 1.004)
    assert frames.take(False)["dropped"] == 3
    assert (frames.take(True)["intervals"], frames.take(True)["dropped"]) == (3, 3)


def test_simulated_time_waits_for_the_clock(begin):
    """Three trials of 1 s at 10 times the clock's pace."""
    before = time.monotonic()
    ended(begin(of_tasks(TRACKING), speed=10.0))
    assert time.monotonic() - before >= 0.3


# -- pictures --------------------------------------------------------------------------------------


def painted(scene: Scene, width: int, height: int, language: str = "en", dark: bool = True):
    """A scene as an array of pixels."""
    from PySide6.QtGui import QImage, QPainter

    from esea_host.windows.study.scene_view import paint_scene

    image = QImage(width, height, QImage.Format.Format_RGB32)
    painter = QPainter(image)
    colours = COLOURS if dark else ON_WHITE
    paint_scene(painter, width, height, scene, language, colours)
    painter.end()
    return np.array(image.constBits()).reshape(height, width, 4)[:, :, 2::-1]


def rgb(colour: str) -> list[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


@pytest.mark.parametrize(("width", "height"), [(400, 300), (300, 900)])
def test_a_scene_keeps_its_proportions_whatever_the_window(qtbot, width, height):
    """10 right and 20 up of 40: from the middle by as many quarters of half the smaller side."""
    scene = Scene(
        (Shape("disc", "target", 10.0, 20.0, 4.0), Shape("square", "failed", -20, -20, 4))
    )
    pixels = painted(scene, width, height)
    half = min(width, height) / 2
    for role, x, y in (("target", 10, 20), ("failed", -20, -20)):
        there = np.argwhere((pixels == rgb(COLOURS[role])).all(axis=2)).mean(axis=0)
        wanted = [height / 2 - y / 40 * half, width / 2 + x / 40 * half]
        assert there == pytest.approx(wanted, abs=1.0)
    assert pixels[0, 0].tolist() == rgb(COLOURS["background"])


def test_texts_are_the_languages_own_and_no_role_is_lost(qtbot):
    scene = Scene((Shape("disc", "no such role", 0, 0, 8.0),), (Text("error", {"error_deg": 1.5}),))
    en, de = painted(scene, 300, 300), painted(scene, 300, 300, "de")
    assert not np.array_equal(en, de)
    assert said(scene.texts[0], "de") == "mittlerer Fehler 1,5 Grad"
    assert said(scene.texts[0]) == "mean error 1.5 degrees"
    assert en[150, 150].tolist() == rgb(COLOURS["text"])


def test_every_text_of_a_shipped_task_is_in_the_catalogue():
    rooms = (ROOT / "host" / "esea_host" / room for room in ("study", "wrist", "interaction"))
    used = {
        k
        for r in rooms
        for p in r.glob("*.py")
        for k in re.findall(r'Text\("(\w+)"', p.read_text())
    }
    assert {"paused", "follow", "neutral", "reached"} <= used
    assert used <= set(catalogue("de"))
    assert {*DIRECTIONS.values(), "faster", "further", "more"} <= set(catalogue("de"))


# Machado, Oliveira, Fernandes, IEEE TVCG 15, 2009: what is seen without one kind of cone, linear.
BLIND = {
    "none": "1 0 0 0 1 0 0 0 1",
    "protan": "0.152286 1.052583 -0.204868 0.114503 0.786281 0.099216 -0.003882 -0.048116 1.051998",
    "deutan": "0.367322 0.860646 -0.227968 0.280085 0.672501 0.047413 -0.011820 0.042940 0.968881",
    "tritan": "1.255528 -0.076749 -0.178779 -0.078411 0.930809 0.147602 0.004733 0.691367 0.303900",
}


def lab(colour: str, blind: str) -> np.ndarray:
    """CIELAB of a colour as somebody sees it (sRGB, D65)."""
    value = np.array(rgb(colour)) / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(blind.split(), float).reshape(3, 3) @ linear, 0, 1)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(np.array(to_xyz) @ seen / [0.9505, 1.0, 1.089])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("dark", [True, False])
@pytest.mark.parametrize("kind", BLIND)
def test_roles_are_told_apart_without_one_kind_of_cone(kind, dark):
    """Difference in CIELAB: 2 can just be seen side by side, 15 is plain."""
    colours = COLOURS if dark else ON_WHITE
    together = ("cursor", "target", "failed", "origin", "background")
    for a, b in combinations(together, 2):
        apart = np.linalg.norm(lab(colours[a], BLIND[kind]) - lab(colours[b], BLIND[kind]))
        assert apart > 15, (a, b, apart)


def test_the_patch_changes_with_each_frame_or_at_an_onset(begin, windows):
    before, after = Scene((Shape("disc", "cursor", 0, 0),)), Scene((Shape("disc", "target", 0, 0),))
    assert appears(before, after)
    assert not appears(Scene((*before.shapes, *after.shapes)), after)
    assert appears(Scene(), Scene((), (Text("caught"),)))
    conductor = begin(of_tasks(TRACKING), at=[(1, 0.3), (1, 0.5)])
    conductor.arrive()
    for patch, wanted in (("frame", [1, 0, 1, 0]), ("onset", [1, 1, 1, 1]), ("off", [None] * 4)):
        participant, _ = windows(conductor, patch=patch)
        participant.timer.stop()
        participant.lit, seen = False, []
        participant.frames.drop()
        participant.frames._onsets = 0
        for _ in range(4):
            participant.turn()
            corner = participant.grab().toImage()
            colour = corner.pixelColor(5, corner.height() - 5).name()
            seen.append({"#ffffff": 1, "#000000": 0}.get(colour))
        assert seen == wanted


def test_on_a_second_monitor_it_is_full_screen(begin, windows, monkeypatch):
    from PySide6.QtCore import QRect

    from esea_host.windows.study import participant as module

    class Screen:
        def __init__(self, x: int, rate: float) -> None:
            self.x, self.rate = x, rate

        def geometry(self) -> QRect:
            return QRect(self.x, 0, 700, 600)

        def refreshRate(self) -> float:
            return self.rate

    both = [Screen(0, 60.0), Screen(800, 120.0)]

    class Desk:
        screens = staticmethod(lambda: both)
        primaryScreen = staticmethod(lambda: both[0])

    monkeypatch.setattr(module, "QGuiApplication", Desk)
    conductor = begin(of_tasks(TRACKING), at=[(1, 0.1)])
    participant, _ = windows(conductor)
    assert participant.frames.refresh_Hz == 60.0
    participant.place()
    assert participant.isFullScreen()
    assert participant.frames.refresh_Hz == 120.0
    assert participant.timer.interval() == 8
    both.pop()
    other, _ = windows(conductor)
    other.place()
    assert not other.isFullScreen()


# -- somebody points -------------------------------------------------------------------------------


@pytest.mark.ci
def test_who_points_moves_the_hand_in_the_virtual_rig_and_it_is_recorded(tmp_path, begin):
    """Held half way to the right of 11.46 deg; the spring takes some of it."""
    require_tool("gcc")
    who = person(np.random.default_rng(1), PersonModel())
    folder = tmp_path / "s" / "P01" / "session-1"
    conductor = begin(of_tasks(TRACKING), RigSource(who, folder, lambda: (0.5, 0.0)))
    ended(conductor)
    table = np.loadtxt(folder / "encoder-2.csv", delimiter=",", skiprows=2)
    assert len(table) == 1000
    assert np.allclose(np.diff(table[:, 0]), 1e-3)
    held = math.degrees(table[-200:, 1].mean())
    k = math.degrees(0.0502) + who.limbs[0].stiffness_Nm_rad
    own = who.model.stiffness_Nm_rad
    assert held == pytest.approx(0.5 * math.degrees(0.16) / 0.8 * own / (own + k), abs=0.25)


def test_the_mouse_points_in_shares_of_the_scene(begin, windows, qtbot):
    from PySide6.QtCore import QPoint

    conductor = begin(of_tasks(TRACKING), at=[(1, 0.1)])
    participant, _ = windows(conductor)
    found = []
    participant.point = found.append
    participant.resize(600, 400)
    qtbot.mouseMove(participant, QPoint(400, 100))
    qtbot.waitUntil(lambda: bool(found), timeout=120_000)
    assert found[-1] == pytest.approx((0.5, 0.5))


# -- command line ----------------------------------------------------------------------------------


def call(*words: str) -> str:
    done = CliRunner().invoke(app, ["study", *words])
    assert done.exit_code == 0, done.output + str(done.exception)
    return done.output


def test_a_session_in_windows_from_the_command_line(tmp_path, qtbot, monkeypatch):
    from esea_host.windows.study import running

    monkeypatch.setattr(running, "SHOWN_AT_END_MS", 50)
    folder = str(tmp_path / "s")
    call("create", str(EXAMPLE), folder, "--simulated")
    call("enrol", folder, "P01", "--consent")
    words = ["run", folder, "P01", "--speed", "200", "--language", "de", "--patch", "onset"]
    assert "Simulated participant: 12 of 12" in call(*words, "--close")
    assert "the same, bit for bit" in call("replay", folder, "P01")


@pytest.mark.parametrize(
    ("words", "said_there"),
    [
        (["--device", "pointer", "--headless"], "nobody can point"),
        (["--device", "virtual", "--headless"], "no virtual device for steady_hold"),
        (["--device", "sin:elbow", "--headless"], "is no address"),
        (["--language", "xx", "--headless"], "de, en"),
    ],
)
def test_bad_words_are_told_before_anything_is_written(tmp_path, words, said_there):
    folder = tmp_path / "s"
    study_of(folder, load_protocol(EXAMPLE))
    done = CliRunner().invoke(app, ["study", "run", str(folder), "P01", *words])
    assert said_there in str(done.exception)
    assert not (folder / "P01").exists()


# -- pictures for the manual -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return Path(os.environ.get("ESEA_PICTURES") or tmp_path_factory.mktemp("pictures"))


@pytest.mark.ci
def test_pictures_of_a_calibration_for_the_manual(begin, windows, place):
    from esea_host.windows.theme import DARK, LIGHT

    require_tool("gcc")
    who = person(generator(1, 4, 0), PersonModel())
    conductor = begin(wrist_protocol(1), VirtualPerson(who), at=[(6, 3.2)])
    participant, operator = windows(conductor)
    conductor.arrive()
    operator.resize(1180, 700)
    for theme, name in ((DARK, "study-operator-dark.png"), (LIGHT, "study-operator.png")):
        operator.set_theme(theme)
        picture = operator.grab()
        assert picture.save(str(place / name))
        ground = picture.toImage().pixelColor(3, 300)
        assert (ground.lightness() < 90) == (theme is DARK)
    participant.resize(480, 480)
    for dark in (False, True):
        participant.set_dark(dark)
        participant.turn()
        picture = participant.grab()
        assert (picture.toImage().pixelColor(3, 3).lightness() < 90) == dark
    assert picture.save(str(place / "study-calibration.png"))
    assert operator.gauges[0].gauge.name == "torque flexion"
    assert not operator.gauges[0].near


@pytest.mark.ci
def test_pictures_of_the_game_for_the_manual(begin, windows, place):
    require_tool("gcc")
    pong = 'task = "interaction.pong"\ntrials = [{ parameters = { seconds = 20.0 } }]'
    who = person(generator(1, 4, 0), PersonModel())
    source = RigSource(who, place / "s")
    conductor = begin(of_tasks(pong), source, at=[(1, 15.0)])
    participant, operator = windows(conductor, language="de")
    conductor.arrive()
    participant.resize(480, 480)
    participant.set_dark(False)
    participant.turn()
    assert participant.grab().save(str(place / "study-pong.png"))
    operator.refresh()
    assert operator.buttons["Recentre"].isVisible()
    conductor.stop("that is enough")
    ended(conductor)
