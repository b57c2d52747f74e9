"""A complete day of each application through its real windows.

Enrol, consent, allocate, run, crash, resume, note, adverse event, repeat, stop, resume, second
session, audit, report, export, analyse.  Every session is simulated; nothing depends on the clock.
"""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import wait
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli import app
from esea_host.study.conductor import PAUSED
from esea_host.study.folder import StudyFolder
from esea_host.study.protocol import parse_protocol
from esea_host.study.session import read_session
from tests.assess.test_assess import made_up
from tests.assess.test_assess_tasks import PROTOCOL
from tests.conducted import Stepped, headless
from tests.conftest import ROOT

pytestmark = pytest.mark.ci
HOST = ROOT / "host" / "esea_host"
KNEE = PROTOCOL.replace("seed = 3", 'seed = 3\nlanguage = "de"').replace(
    "repeat = 1", "repeat = 2", 1
)
# A process that dies at a chosen step of a session in its windows, as by a power cut.
DYING = """
import os, signal, sys
from esea_host.study import conductor
at = int(sys.argv.pop(1)), float(sys.argv.pop(1))
class Dying(conductor.Conductor):
    def steps(self, time_s, step):
        super().steps(time_s, step)
        if (self.trial.number, time_s) >= at:
            os.kill(os.getpid(), signal.SIGKILL)
conductor.Conductor = Dying
from esea_host.cli import main
main()
"""


def killed(code: str, *words: object) -> None:
    told = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert told.returncode == -9, told.stdout + told.stderr


def done(*words: object, code: int = 0) -> str:
    """A command, and what it says."""
    found = CliRunner().invoke(app, [str(w) for w in words])
    if code and isinstance(found.exception, UserError):
        return found.output + str(found.exception)
    assert found.exit_code == code, f"{words}: {found.output} {found.exception}"
    return found.output


@dataclass
class Day:
    """An operator at both windows: does what is to be done at chosen times of chosen trials."""

    qtbot: object
    patch: pytest.MonkeyPatch
    folder: Path
    left: list = field(default_factory=list)
    seen: list[str] = field(default_factory=list)
    failed: BaseException | None = None
    repeated: int = 1

    def session(self, *words: object, acts=(), code: int = 0) -> str:
        """A session from the command line, in its windows; acts: (trial, time_s), what to do."""
        from PySide6.QtCore import QTimer

        at = [when for when, _ in acts if isinstance(when, tuple)]
        self.left, made = list(acts), []

        class Operated(Stepped):
            def __init__(self, *given, **more):
                super().__init__(*given, **more, at=at)
                made.append(self)

        self.patch.setattr("esea_host.study.conductor.Conductor", Operated)
        self.patch.setattr("esea_host.windows.study.running.SHOWN_AT_END_MS", 20)
        timer = QTimer()
        timer.timeout.connect(lambda: self.turn(made[0]) if made else None)
        timer.start(2)
        told = done("study", *words, "--close", "--speed", "1e9", code=code)
        timer.stop()
        if self.failed is not None:
            raise self.failed
        assert not self.left, told
        return told

    def turn(self, conductor) -> None:
        """Where the session stands still or waits, the next thing is done."""
        from PySide6.QtWidgets import QApplication

        from esea_host.windows.study.operator import OperatorWindow

        shown = [w for w in QApplication.topLevelWidgets() if isinstance(w, OperatorWindow)]
        shown = [w for w in shown if w.isVisible()]
        if not shown or not self.left:
            return
        operator, (when, act) = shown[0], self.left[0]
        here = conductor.there.is_set() if isinstance(when, tuple) else conductor.phase == when
        if not here:
            return
        if not operator.isActiveWindow():
            operator.activateWindow()
            return
        self.left.pop(0)
        try:
            operator.refresh()
            self.seen += [operator.bar.state.text(), operator.bar.badge.text()]
            act(operator)
        except BaseException as error:
            self.failed = error
            self.left.clear()
            conductor.at.clear()
            conductor.stop("the test failed")
        if conductor.there.is_set():
            conductor.there.clear()
            conductor.go.set()

    # -- with keys and mouse ---------------------------------------------------------------------

    def key(self, operator, key: str) -> None:
        operator.trials.setFocus()
        self.press(operator, key)

    def press(self, widget, key: str) -> None:
        from PySide6.QtGui import QKeySequence

        combination = QKeySequence(key)[0]
        self.qtbot.keyClick(widget, combination.key(), combination.keyboardModifiers())

    def write(self, operator, text: str) -> None:
        self.key(operator, "N")
        self.qtbot.keyClicks(operator.written, text)

    def note(self, operator) -> None:
        self.write(operator, "Riemen nachgestellt")
        self.press(operator.written, "Return")

    def hurt(self, operator) -> None:
        """Something happened: the trial is stopped before anything is written."""
        from PySide6.QtCore import Qt

        self.key(operator, "E")
        self.qtbot.mouseClick(operator.adverse.stop_trial, Qt.MouseButton.LeftButton)

    def report(self, operator) -> None:
        chosen = {"severity": "mild", "relation": "possible", "action": "trial-stopped"}
        for name, key in chosen.items():
            box = operator.adverse.choices[name]
            box.setCurrentIndex(box.findData(key))
        operator.adverse.text.setFocus()  # only a text field takes a space
        self.qtbot.keyClicks(operator.adverse.text, "Krampf im Unterarm")
        operator.adverse.record()
        wait([operator.adverse.writing], 30)
        self.key(operator, "P")

    def again(self, operator) -> None:
        """A trial once more."""
        self.write(operator, "Riemen war lose")
        operator.trials.selectRow(self.repeated - 1)
        self.press(operator, "Ctrl+R")

    def stop(self, operator) -> None:
        self.key(operator, "Space")


@pytest.fixture
def day(qtbot, monkeypatch, tmp_path) -> Day:
    return Day(qtbot, monkeypatch, tmp_path)


def first_session(day: Day, study: Path, crash, acts, *more: object) -> None:
    """Crash, resume, note, adverse event, repeat, stop; then to the end."""
    killed(DYING, *crash, "study", *("run", study, "P01", "--close", "--speed", "1e9", *more))
    assert read_session(study / "P01" / "session-1" / "events.jsonl").running == crash[0]
    assert "is in use" not in done("study", "status", study)
    wanted = list(zip(acts, (day.note, day.hurt, day.again, day.stop), strict=True))
    wanted.insert(2, (PAUSED, day.report))
    told = day.session("resume", study, "P01", acts=wanted, code=2)
    assert f"Trial {crash[0]} was running; it counts as aborted" in told
    assert "ended early" in told
    assert "SIMULIERT" in day.seen
    assert any("ANGEHALTEN" in state for state in day.seen)
    assert "is in use" not in day.session("resume", study, "P01")


def checked(day: Day, study: Path, trials: int) -> StudyFolder:
    """What is on record of the first participant, and the report."""
    found = StudyFolder.open(study, runs=False)
    assert found.problems() == []
    rows = [r for r in found.rows("P01") if r["session"] == 0]
    assert sorted(r["trial"] for r in rows) == list(range(1, trials + 1))
    assert all(r["simulated"] for r in found.rows("P01"))
    (event,) = [d for k, d in found.audited() if k == "adverse"]
    assert (event["participant"], event["text"]) == ("P01", "Krampf im Unterarm")
    done("study", "audit", study)
    page = day.folder / "report.html"
    done("study", "report", study, page)
    for words in ("SIMULATED", "Krampf im Unterarm", "P01"):
        assert words in page.read_text()
    return found


def content(path: Path) -> bytes:
    """What a file says: three letters occur among packed numbers by chance."""
    if path.suffix != ".parquet":
        return path.read_bytes()
    table = pq.read_table(path)
    return repr((table.to_pydict(), table.schema.metadata)).encode()


def exported(day: Day, study: Path, *forms: str) -> None:
    """Without codes, notes and names of the laboratory; every one is marked as simulated."""
    assert "Could identify" in done("study", "export", study, "--check")
    for form in forms:
        out = day.folder / form
        done("study", "export", study, out, "--as", form)
        text = b"".join(map(content, (p for p in out.rglob("*") if p.is_file())))
        assert b"imulated" in text or b"SIMULATED" in text
        for secret in (b"P01", b"Riemen", b"Krampf", b"Weber"):
            assert secret not in text, form


def test_a_day_of_the_wrist_study(day, monkeypatch):
    """The shipped protocol with fewer trials, in German; the groups from a sealed list."""
    monkeypatch.setenv("ESEA_OPERATOR", "Weber")
    text = (HOST / "wrist" / "protocol.toml").read_text()
    for old, new in (
        ("repeat = 15", "repeat = 2"),
        ("repeat = 4", "repeat = 1"),
        ("copies = 3", "copies = 1"),
        ("after_days = 7", "after_days = 0"),
        ("seed = 1\n", 'seed = 1\nlanguage = "de"\n'),
    ):
        assert old in text
        text = text.replace(old, new)
    file, study, sealed = day.folder / "wrist.toml", day.folder / "s", day.folder / "list.csv"
    file.write_text(text)
    done("study", "create", file, study, "--simulated")
    done("study", "allocate", study, "--keep", sealed, "--operator", "Keller")
    done("study", "enrol", study, "P01", "--consent", "--form", "2")
    day.repeated = 6  # a new neutral position would begin a new calibration
    acts = [(6, 0.5), (8, 1.0), (11, 0.5), (12, 0.5)]
    first_session(day, study, (4, 1.0), acts, "--open", sealed)
    day.session("run", study, "P01", "--session", "2")
    found = checked(day, study, 39)
    # Who sits through all of this leaves what an undisturbed session leaves.
    order = [r for r in found.rows("P01") if r["task"] != "wrist.track"]
    assert {r["condition"] for r in order} == {"healthy", "constrained"}
    assert done("analyse", "wrist", study).count("SIMULATED") == 4
    exported(day, study, "rows", "bids", "parquet")


def test_a_day_of_the_interaction_study(day):
    """On the virtual rig, two people, one in each group."""
    text = (HOST / "interaction" / "protocol.toml").read_text()
    for old, new in (("75.0", "46.0"), ("30.0", "5.0")):
        text = text.replace(f"seconds = {old}", f"seconds = {new}")
    file, study = day.folder / "interaction.toml", day.folder / "s"
    file.write_text(text.replace("seed = 1\n", 'seed = 1\nlanguage = "de"\n'))
    done("study", "create", file, study, "--simulated", "--operator", "Weber")
    for code in ("P01", "P02"):
        done("study", "enrol", study, code, "--consent")
    virtual = "--device", "virtual"
    first_session(day, study, (1, 2.0), [(2, 1.0), (2, 3.0), (2, 5.0), (3, 1.0)], *virtual)
    day.session("run", study, "P01", "--session", "2", *virtual)
    for number in ("1", "2"):
        done("study", "run", study, "P02", "--session", number, *virtual, "--headless")
    checked(day, study, 3)
    assert "2 people, SIMULATED" in done("analyse", "interaction", study)
    page = day.folder / "survey.html"
    done("study", "survey", study, page)
    assert "Mit dem ersten Gerät" in page.read_text()
    exported(day, study, "rows", "bids")


def test_a_day_of_the_knee_assessment(day, tmp_path):
    """A visit as a session, and the probing at the clinician's own window."""
    base, study = tmp_path / "base.npz", day.folder / "s"
    made_up().save(base)
    text = KNEE.format(base=base)
    (day.folder / "knee.toml").write_text(text)
    done("study", "create", day.folder / "knee.toml", study, "--simulated")
    done("study", "enrol", study, "P01", "--consent")
    first_session(day, study, (2, 1.0), [(2, 2.0), (3, 1.0), (4, 1.0), (5, 1.0)], "--seed", 3)
    found = checked(day, study, 5)
    plain = headless(tmp_path / "plain", parse_protocol(text, "knee.toml"))
    by_trial = [sorted(s.rows("P01"), key=lambda r: r["trial"]) for s in (found, plain)]
    assert by_trial[0] == by_trial[1]
    exported(day, study, "rows", "bids")
