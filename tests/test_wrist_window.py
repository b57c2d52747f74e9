"""The wrist display's window and command, on simulated boards."""

from __future__ import annotations

import os

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from esea_host.cli import app
from esea_host.recording.log import open_log
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.windows.feed import LiveFeed
from esea_host.wrist.constraint import ConstraintKeeper
from esea_host.wrist.display import WristDisplay
from esea_host.wrist.stored import load_calibration

from .conftest import require_tool

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
TURN_S = 0.02


class Shown:
    """A window on a simulated board whose clock the test moves."""

    def __init__(self, name, folder):
        from esea_host.windows.wrist import WristWindow

        self.board = SimulatedBoard(name, seed=1)
        self.board.led = True
        self.device = LockstepDevice(self.board)
        self.keeper = ConstraintKeeper(self.device, arms=True, threaded=False)
        self.feed = LiveFeed(self.device, threaded=False)
        self.display = WristDisplay(self.device.identity.device)
        given = self.feed, self.display, self.keeper, False, self.lead
        self.window = WristWindow(*given, save_to=folder / "wrist.toml")
        self.window.resize(1366, 768)
        self.window.show()
        self.turns = 0

    def run(self, seconds, until=lambda: False):
        for _ in range(round(seconds / TURN_S)):
            self.device.advance(TURN_S)
            self.keeper.turn(self.turns * TURN_S)
            self.feed.gather()
            self.window.take()
            if self.turns % 5 == 0:
                self.feed.ask()
            self.turns += 1
            if until():
                return True
        return False

    def lead(self, *angles_deg):
        self.board.pushes_rad = np.radians(angles_deg).tolist()

    def draw(self):
        for _ in range(6):  # words change less often than pictures
            self.window.draw()

    def close(self):
        self.window.close()
        self.feed.close()
        self.device.close()


@pytest.fixture(scope="module")
def gcc():
    require_tool("gcc")


@pytest.fixture
def shown(qapp, gcc, tmp_path):
    made = []

    def show(name):
        made.append(Shown(name, tmp_path))
        return made[-1]

    yield show
    for one in made:
        one.close()


def test_the_constraint_is_asked_for_by_a_button_and_confirmed_by_the_board(shown):
    s = shown("wrist_drive")
    assert s.run(10, lambda: s.feed.news.state == "ACTIVE")
    s.window.buttons["Constrained"].click()
    s.draw()
    assert "not yet" in s.window.confirmed.text()
    assert s.run(5, lambda: s.display.acts)
    s.draw()
    assert s.window.confirmed.text().endswith("acts on both axes")
    s.window.buttons["Healthy"].click()
    assert s.run(20, lambda: not s.display.acts)


def test_stop_stops_the_motors_the_constraint_and_the_calibration(shown):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    s = shown("wrist_drive")
    assert s.run(10, lambda: s.feed.news.state == "ACTIVE")
    s.window.buttons["Calibrate"].click()
    s.run(0.5)
    assert s.display.guide is not None
    assert s.window.stop_button.isVisible()
    QTest.keyClick(s.window, Qt.Key.Key_Space)
    assert s.run(5, lambda: s.feed.news.state == "STOPPED")
    assert s.display.guide is None
    s.run(1)
    assert s.feed.news.state == "STOPPED"  # nothing arms it again
    assert s.board.board.motors_Nm == (0.0, 0.0)


def test_a_passive_board_has_no_constraint_and_a_mouse_leads_its_hand(shown):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    s = shown("wrist_board")
    assert s.run(10, lambda: s.feed.news.state == "READY")
    s.draw()
    assert not any(s.window.buttons[n].isVisible() for n in ("Arm", "Healthy", "Constrained"))
    assert s.window.stop_button.isVisible()
    # Who presses the mouse takes the simulated hand along: right is extension, down is ulnar.
    pane = s.window.panes["raw"]
    scale = pane.scene.half_width / (min(pane.width(), pane.height()) / 2)
    place = pane.rect().center() + QPoint(round(30 / scale), round(10 / scale))
    QTest.mousePress(pane, Qt.MouseButton.LeftButton, pos=place)
    s.run(2)
    assert s.display.angles_deg == pytest.approx([30.0, -10.0], abs=1.0)
    QTest.mouseRelease(pane, Qt.MouseButton.LeftButton, pos=place)
    s.run(2)
    assert s.display.angles_deg != pytest.approx([30.0, -10.0], abs=1.0)


def run(*words):
    return CliRunner().invoke(app, ["wrist", *map(str, words)])


@pytest.mark.ci
def test_the_headless_run_leaves_a_calibration_a_recording_and_a_picture(gcc, tmp_path):
    picture, recording = tmp_path / "wrist.png", tmp_path / "wrist.mcap"
    stored = tmp_path / "wrist.toml"
    given = ("--headless", "--seconds", 1, "--screenshot", picture, "--record", recording)
    done = run("sim:wrist_drive", *given, "--calibration", stored)
    assert done.exit_code == 0, done.output
    assert all("simulated" in line for line in done.output.splitlines() if str(picture) in line)
    page = imread(picture)
    assert page.shape[:2] == (768, 1366)
    assert np.ptp(page[..., :3]) > 0.9
    used = load_calibration(stored)
    assert used.simulated
    assert used.constrained.FE.high_deg < used.healthy.FE.high_deg
    with open_log(recording) as log:
        assert log.facts["simulated"]
        assert np.all(log["sense_flexion_out"]["acts_flexion"] == 1.0)


def test_what_is_no_wrist_or_no_calibration_is_refused(gcc, tmp_path):
    picture = tmp_path / "a.png"
    given = ("--headless", "--screenshot", picture)
    for words, told in (
        (("sim:elbow_drive", *given), "flexion"),
        (("sim:wrist_drive", "--headless"), "--screenshot"),
        (("wrist_drive", *given), "no address"),
        (("sim:wrist_drive", *given, "--calibration", tmp_path), "wrist"),
    ):
        done = run(*words)
        assert done.exit_code != 0
        assert told in str(done.exception) + done.output
    assert not picture.exists()
