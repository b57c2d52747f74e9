"""The wrist display's window, command and page of ten commands, on simulated boards."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from esea_host.cli import app
from esea_host.recording.log import open_log
from esea_host.wrist.calibration import load_calibration
from tests.conftest import ROOT, require_tool, until

PAGE = (ROOT / "docs" / "wrist-display.md").read_text(encoding="utf-8")
WAIT_S, TRIES = 300, 5  # on a busy machine a command comes too late


@pytest.fixture
def shown(qapp, tmp_path):
    """Opens windows on simulated boards whose clock the test moves."""
    from esea_host.windows.wrist_running import FilmedWrist

    made = []

    def show(name, state):
        made.append(FilmedWrist(name, tmp_path / "wrist.toml"))
        made[-1].window.show()
        made[-1].until(state, 10, lambda: made[-1].feed.news.state == state)
        return made[-1]

    yield show
    for one in made:
        one.close()


def turned(s, seconds):
    for _ in range(round(seconds / 0.02)):
        s.turn()
    s.draw()


def test_the_constraint_is_asked_for_by_a_button_and_confirmed_by_the_board(shown):
    s = shown("wrist_drive", "ACTIVE")
    s.window.buttons["Constrained"].click()
    s.draw()
    assert "not confirmed" in s.window.confirmed.text()
    s.until("constrained", 5, lambda: s.display.acts)
    s.feed.came_s -= 10  # on a slow computer
    s.draw()
    assert not s.feed.silent
    assert s.window.confirmed.text().endswith("acts on both axes")
    s.window.buttons["Healthy"].click()
    s.until("free", 20, lambda: not s.display.acts)


def test_stop_stops_the_motors_the_constraint_and_the_calibration(shown):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    s = shown("wrist_drive", "ACTIVE")
    s.window.buttons["Calibrate"].click()
    turned(s, 0.5)
    assert s.display.guide is not None
    assert s.window.stop_button.isVisible()
    QTest.keyClick(s.window, Qt.Key.Key_Space)
    s.until("stopped", 5, lambda: s.feed.news.state == "STOPPED")
    assert s.display.guide is None
    turned(s, 1)
    assert s.feed.news.state == "STOPPED"  # nothing arms it again
    assert s.board.board.motors_Nm == (0.0, 0.0)


def test_a_passive_board_has_no_constraint_and_a_mouse_leads_its_hand(shown):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    s = shown("wrist_board", "READY")
    s.draw()
    assert not any(s.window.buttons[n].isVisible() for n in ("Healthy", "Constrained"))
    assert "Arm" not in s.window.bar.steps
    assert s.window.stop_button.isVisible()
    # Who presses the mouse takes the simulated hand along: right is extension, down is ulnar.
    pane = s.window.panes["raw"]
    scale = pane.scene.half_width / (min(pane.width(), pane.height()) / 2)
    place = pane.rect().center() + QPoint(round(30 / scale), round(10 / scale))
    for act, held in ((QTest.mousePress, True), (QTest.mouseRelease, False)):
        act(pane, Qt.MouseButton.LeftButton, pos=place)
        turned(s, 2)
        assert (s.display.angles_deg == pytest.approx([30.0, -10.0], abs=1.0)) == held


def run(*words):
    return CliRunner().invoke(app, ["wrist", *map(str, words)])


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("sim:elbow_drive --headless --screenshot {}/a.png", "flexion"),
        ("sim:wrist_drive --headless", "--screenshot"),
        ("wrist_drive --headless --screenshot {}/a.png", "not an address"),
        ("sim:wrist_drive --headless --screenshot {}/a.png --calibration {}", "{}"),
    ],
)
def test_what_is_no_wrist_or_no_calibration_is_refused(tmp_path, words, told):
    done = run(*words.format(tmp_path, tmp_path).split())
    assert done.exit_code != 0
    assert told.format(tmp_path) in str(done.exception) + done.output
    assert not (tmp_path / "a.png").exists()


@pytest.mark.ci
def test_the_ten_commands_do_what_the_page_says(tmp_path):
    commands = re.findall(r"```sh\n\s*(.*?)\n\s*```", PAGE, re.DOTALL)
    assert len(commands) == 10
    for tool in ("gcc", "arm-none-eabi-gcc"):
        require_tool(tool)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    how = {"cwd": tmp_path, "env": os.environ | {"QT_QPA_PLATFORM": "offscreen", "PATH": path}}
    board = None
    try:
        for command in commands:
            words = command.replace(re.search(r"--tcp (\d+)", PAGE)[1], port).split()
            if words[-1] == "&":
                board = subprocess.Popen(words[:-1], stdout=subprocess.PIPE, text=True, **how)
                assert port in until(board.stdout.readline)
                continue
            if words[:2] == ["esea-host", "wrist"] and "--headless" not in words:
                words += ["--seconds", "3"]  # a window that nobody closes
            for _ in range(TRIES):
                done = subprocess.run(
                    words, capture_output=True, text=True, timeout=WAIT_S, check=False, **how
                )
                if "too late" not in done.stderr:
                    break
            assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    finally:
        if board is not None:
            board.terminate()
            board.communicate()
    out = tmp_path / "out"
    for name in ("wrist-board.mcap", "wrist-display.mcap", "wrist-display.png"):
        assert (out / name).stat().st_size > 10_000, name
    assert np.ptp(imread(out / "wrist-display.png")[..., :3]) > 0.9
    used = load_calibration(out / "wrist-display.toml")
    assert used.simulated
    assert used.constrained.FE.high_deg < used.healthy.FE.high_deg
    with open_log(out / "wrist-display.mcap") as log:
        assert log.facts["simulated"]
        assert np.all(log["sense_flexion_out"]["acts_flexion"] == 1.0)
