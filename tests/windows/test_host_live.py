"""The live view: its words, its window, and its stop."""

from __future__ import annotations

import importlib
import math
import os
import socket
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import esea_host
from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_host.connection import PlayedBoard
from esea_host.simulated import LockstepDevice
from esea_host.simulated.server import Hands, serve_hosts
from esea_host.windows.feed import LiveFeed
from esea_host.windows.meanings import fault_text, limit_flags, mode_text, state_text
from esea_host.windows.operator import DemoOperator
from tests.conftest import require_tool
from tests.typed import host_command


def test_numbers_become_words(lockstep):
    device, dialect = lockstep.identity.device, lockstep.session.dialect
    flags = {f.name: f for f in limit_flags(device)}
    assert flags["rom low"].meaning == "the command towards the lower end was reduced"
    rows = np.array([(0,), (1 << 13,), (1 << 12,)], [("limits_status", "u4")])  # as in the header
    assert flags["rom low"].held(rows).tolist() == [False, True, False]
    assert flags["passivity input invalid"].word == "passivity_status"
    every = [n for n in dialect.enums["ESEA_FAULT"] if n != 109]
    assert all(fault_text(dialect, n).cure and fault_text(dialect, n).meaning for n in every)
    assert (fault_text(dialect, 8).name, fault_text(dialect, 77).cure) == ("DEFLECTION", "service")
    assert "released" in state_text(dialect, "STOPPED")
    assert state_text(dialect, "UNKNOWN") == ""
    assert [mode_text(m) for m in (0, 1, 2, 9)] == ["off", "torque", "impedance", "9"]


@pytest.mark.ci
def test_the_host_tool_loads_without_windows():
    code = (
        "import sys, esea_gen, esea_host.cli, esea_host.windows.feed, esea_host.windows.operator\n"
        "assert not {'PySide6', 'pyqtgraph'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], env=dict(os.environ), check=True)


def test_without_a_screen_the_view_says_what_else_there_is(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    code, _, said = host_command("view", "sim:elbow_drive")
    assert code == 2
    assert "esea-host monitor" in said


def test_arming_that_the_limits_refuse_is_told(lockstep):
    """Again at once behind torque: the controller has not let go, and the motor stays off."""
    feed = LiveFeed(lockstep, threaded=False)
    run_for(lockstep, feed, 0.5)
    assert "says" not in feed.news.said
    lockstep.disarm()
    while lockstep.drive.board.state_now != "READY":
        lockstep.advance(0.001)
    feed.do("Arm", lockstep.arm)
    feed.ask()
    lockstep.advance(0.02)
    feed.ask()
    assert lockstep.state() == "READY"
    assert feed.news.said == "the board says: not armed: a limit acts, or the drive still moves"
    feed.close()


# -- with a window ---------------------------------------------------------------------------------


def run_for(device: LockstepDevice, feed: LiveFeed, seconds: float) -> None:
    """Zeroed, armed, and following a sine of torque."""
    device.advance(0.3)
    device.zero()
    device.advance(0.4)
    device.arm()
    device.advance(0.01)
    for i in range(round(seconds / 0.004)):  # sliding mode swings at steps of 20 ms
        device.want(mode=1.0, tau_desired_Nm=1.5 * np.sin(i * 0.016))
        device.advance(0.004)
        feed.gather()
    feed.ask()


@pytest.fixture
def seen(lockstep, qtbot, tmp_path):
    """A window on a board whose clock stands still, after two seconds of work."""
    from esea_host.windows.live import LiveWindow

    recording = lockstep.record(tmp_path / "a.mcap")
    feed = LiveFeed(lockstep, recording, kept_s=5.0, threaded=False)
    run_for(lockstep, feed, 2.2)
    feed.came_s = math.inf  # its clock stands still, and it is not away
    window = LiveWindow(feed)
    window.window_s = 2.0
    window.resize(1180, 760)
    qtbot.addWidget(window)
    window.show()
    feed.ask()  # for the limits
    window.draw()
    yield window, feed
    feed.close()
    recording.close()


def test_the_picture_is_of_what_came_and_stands_still_while_paused(seen, qtbot, tmp_path):
    from PySide6.QtCore import Qt

    from esea_host.windows.frame import run_until_closed

    window, feed = seen
    torque = window.panels[0]
    assert [s.label for s in torque.signals] == ["wanted", "set", "measured"]
    assert np.nanmax(torque.curves[0].getData()[1]) == pytest.approx(1.5, abs=0.01)
    degrees = window.panels[1].curves[0].getData()[1]
    bend_rad = feed.rings["sense_out"].last(2000).rows["theta_rad"]
    assert np.nanmax(degrees) == pytest.approx(np.degrees(bend_rad.max()), rel=1e-5)
    bar = window.bar
    assert (bar.state.text(), bar.badge.text()) == ("ACTIVE", "SIMULATED")
    assert "mode: torque  |  Link: 0 messages lost" in bar.who.text()
    acting = bar.indicators.accessibleDescription().split(", ")
    assert "damped" in acting
    assert "deflection" in bar.indicators.text()
    assert "deflection" not in acting
    assert any(name == "rate limited" for _, name in window.bands.names)
    # A motor command of 0.2 Nm stands at 0.2 of its axis, also when that is dressed anew.
    window.set_theme(window.theme)
    window.draw()
    command = window.panels[3].item.getAxis("left")
    assert 0 < max(map(abs, command.range)) < 1
    step, values = command.tickValues(*command.range, 100)[0]
    labels = command.tickStrings(values, command.scale * command.autoSIPrefixScale, step)
    assert [float(x) for x in labels] == pytest.approx(values)
    qtbot.keyClick(window, Qt.Key.Key_P)
    assert window.paused
    held, total = torque.curves[2].getData()[1].copy(), feed.rings["sense_out"].total
    feed.device.advance(0.5)
    feed.gather()
    window.draw()
    assert np.array_equal(held, torque.curves[2].getData()[1], equal_nan=True)
    assert feed.rings["sense_out"].total == total + 500  # kept meanwhile
    now_Nm = feed.rings["sense_out"].newest()["tau_Nm"]  # large numbers do not stand still
    assert float(bar.readouts["torque [Nm]"].accessibleName()) == pytest.approx(now_Nm, abs=0.006)
    qtbot.keyClick(window, Qt.Key.Key_P)
    window.draw()
    assert not np.array_equal(held, torque.curves[2].getData()[1], equal_nan=True)
    with pytest.raises(UserError, match=r"a\.odd: the picture cannot be written"):
        run_until_closed(window, 0.4, tmp_path / "a.odd")


def test_cursors_channels_notes_themes_and_zoom_by_key(seen, qtbot, tmp_path):
    from PySide6.QtCore import Qt

    window, feed = seen
    qtbot.keyClick(window, Qt.Key.Key_C)
    window.draw()
    assert "apart: 0.400 s" in window.readout.text()
    qtbot.keyClick(window, Qt.Key.Key_Left)
    window.draw()
    assert "apart: 0.420 s" in window.readout.text()
    qtbot.keyClick(window, Qt.Key.Key_P)
    qtbot.keyClick(window, Qt.Key.Key_Minus)
    assert window.window_s == 5.0
    qtbot.keyClick(window, Qt.Key.Key_K)
    window.channels.search.setText("energy window")
    items = window.channels.items
    energy = items["sense_out", "energy_J"]
    assert energy in [i for i in items.values() if not i.isHidden()]
    assert sum(not i.isHidden() for i in items.values()) < 5
    window.channels.tree.setCurrentItem(energy)
    qtbot.keyClick(window.channels.tree, Qt.Key.Key_Return)
    window.draw()
    assert [s.name for s in window.chosen.signals] == ["sense_out.energy_J"]
    assert len(window.chosen.curves[0].getData()[0]) > 100
    window.note.setFocus()
    qtbot.keyClicks(window.note, "a cough")
    qtbot.keyClick(window.note, Qt.Key.Key_Return)
    feed.ask()
    feed.recording.close()
    with esea_host.open_log(tmp_path / "a.mcap") as log:
        assert log.events("note")[0]["text"] == "a cough"
    qtbot.keyClick(window, Qt.Key.Key_T)
    assert window.theme.name == "dark"


def test_a_fault_is_told_with_what_to_do_and_a_stop_that_is_not_confirmed(seen):
    window, feed = seen
    feed.news.fault = fault_text(feed.device.session.dialect, 8)
    feed.news.state = "FAULT"
    feed.stopper.close()  # nothing goes out any more
    window.stop()
    window.stop_asked_s -= 2.0
    window.draw()
    assert "What to do: unload the coupling" in window.bar.words.text()
    assert "switch its power off" in window.bar.words.text()


def test_parameters_out_of_bounds_are_not_sent_and_changes_are_shown_first(seen):
    window, feed = seen
    editor = window.parameters
    feed.device.stop()
    feed.device.advance(0.7)
    feed.device.release()
    feed.device.advance(0.1)
    editor.read()
    feed.ask()
    row = [p.name for p in editor.known].index("smc.lambda_1_s")
    low, new = editor.known[row].low, editor.table.item(row, 2)
    held = feed.device.parameters()["smc.lambda_1_s"]
    assert float(new.text()) == pytest.approx(held)
    new.setText("1e9")
    assert "is outside" in editor.changes.text()
    assert not editor.write_button.isEnabled()
    new.setText("many")
    assert "is not a number" in editor.changes.text()
    wanted = (held + low) / 2
    new.setText(f"{wanted:g}")
    assert editor.changes.text().startswith(f"smc.lambda_1_s: {held:g} -> {wanted:g}")
    editor.write()
    feed.ask()
    assert feed.device.parameters()["smc.lambda_1_s"] == pytest.approx(wanted, rel=1e-5)


@pytest.fixture
def pictures(tmp_path) -> Path:
    return Path(os.environ.get("ESEA_PICTURES") or tmp_path)


@pytest.mark.parametrize("dark", [False, True])
def test_pictures_for_the_manual(seen, dark, pictures):
    from esea_host.windows.theme import DARK, LIGHT

    window, _ = seen
    window.set_theme(DARK if dark else LIGHT)
    window.draw()
    picture = window.grab()
    assert picture.save(str(pictures / ("host-live-dark.png" if dark else "host-live.png")))
    image = picture.toImage()
    assert (image.pixelColor(image.width() // 3, image.height() // 2 - 4).lightness() < 90) == dark


def test_what_a_board_says_is_text(seen):
    """Also where it looks like a page with a picture from elsewhere."""
    from PySide6.QtCore import Qt

    window, feed = seen
    tag = "<img src='x'>"
    feed.news = replace(feed.news, state=tag, said=tag, error=tag, fault=None)
    window.draw()
    for label in (window.bar.said, window.bar.state, window.bar.words):
        assert (label.textFormat(), label.text()) == (Qt.TextFormat.PlainText, tag)


def test_a_recording_is_played_in_the_window_at_any_speed(seen, qtbot, tmp_path):
    """To the last row, holes as holes; there is nothing to stop or to command."""
    from PySide6.QtCore import Qt

    from esea_host.windows.live import LiveWindow

    seen[1].recording.close()
    whole = (tmp_path / "a.mcap").read_bytes()
    with esea_host.open_log(tmp_path / "a.mcap") as log:
        piece = log.pieces[len(log.pieces) // 2]
        before = log["sense_out"]
        with PlayedBoard(log, 3.0) as board:
            steps = list(board.steps())
    parts = [b for _, batches in steps for b in batches if b.layout.name == "sense_out"]
    assert np.concatenate([b.rows for b in parts]).tobytes() == before.rows.tobytes()
    assert np.all(np.diff([at_s for at_s, _ in steps]) >= 0)
    assert len(steps) > 0.9 * (before.time_s[-1] - before.time_s[0]) / (3 * 0.03)
    at = (piece.offset + piece.end) // 2  # a damaged piece is left out, and is a hole
    (tmp_path / "b.mcap").write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    with esea_host.open_log(tmp_path / "b.mcap") as log, PlayedBoard(log, 8.0) as board:
        holes = [g for g in log.gaps if g.stream == "sense_out"]
        assert [g.reason for g in holes] == ["recording"]
        feed = LiveFeed(board)
        window = LiveWindow(feed)
        qtbot.addWidget(window)
        window.show()
        board.play()
        qtbot.waitUntil(lambda: board.ended, timeout=120_000)
        rows = len(log["sense_out"])
        assert len(before) - 1000 < rows < len(before)
        qtbot.waitUntil(lambda: feed.rings["sense_out"].total == rows, timeout=120_000)
        assert feed.rings["sense_out"].last().after_gap.sum() == 1
        qtbot.waitUntil(window.panels[0].limit_lines[1].isVisible, timeout=120_000)
        qtbot.waitUntil(
            lambda: "b.mcap (damaged), at its end" in window.bar.words.text(), timeout=120_000
        )
        assert not window.stop_button.isEnabled()
        qtbot.keyClick(window, Qt.Key.Key_Space)
        assert window.paused
        assert board.held
        with pytest.raises(LinkError, match="no board to command"):
            board.arm()
        feed.close()
    with esea_host.open_log(tmp_path / "a.mcap") as log, pytest.raises(UserError, match="of range"):
        PlayedBoard(log, 0.0)


@pytest.fixture
def server(simulated_elbow):
    simulated_elbow.restart()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve_hosts, args=(simulated_elbow, listener, 3.0, False))
        thread.start()
        yield listener.getsockname()[1]
        listener.close()
        thread.join(5.0)


@pytest.mark.ci
@pytest.mark.parametrize("key", ["space", "escape", "button"])
def test_stop_reaches_the_board_past_everything_that_waits(server, simulated_elbow, qtbot, key):
    """Paused, another command waits for its answer, the cursor blinks in a text field."""
    from PySide6.QtCore import Qt

    from esea_host.windows.live import LiveWindow

    answer = threading.Event()
    with esea_host.connect(f"tcp:127.0.0.1:{server}") as device:
        feed = LiveFeed(device)
        window = LiveWindow(feed)
        qtbot.addWidget(window)
        window.show()
        window.pause(True)
        assert simulated_elbow.board.state_now != "STOPPED"
        feed.do("wait", answer.wait)
        if key == "button":
            qtbot.mousePress(window.stop_button, Qt.MouseButton.LeftButton)
        elif key == "escape":
            window.note.setEnabled(True)
            window.note.setFocus()
            qtbot.keyClick(window.note, Qt.Key.Key_Escape)
        else:
            qtbot.keyClick(window, Qt.Key.Key_Space)
        qtbot.waitUntil(lambda: simulated_elbow.board.state_now == "STOPPED", timeout=120_000)
        answer.set()
        qtbot.waitUntil(lambda: "STOPPED" in window.bar.state.text(), timeout=120_000)
        feed.close()


def test_a_space_in_a_note_is_a_space(seen, qtbot):
    from PySide6.QtCore import Qt

    window, _ = seen
    window.activateWindow()
    window.note.setFocus()
    qtbot.waitUntil(window.note.hasFocus, timeout=120_000)
    qtbot.keyClick(window.note, Qt.Key.Key_Space)
    assert window.note.text() == " "
    assert window.stop_asked_s == 0.0


def test_only_simulated_boards_are_demonstrated(lockstep):
    class Real:
        simulated = False

    with pytest.raises(UserError, match="simulated boards only"):
        DemoOperator(Real())


def test_a_view_that_fails_leaves_the_recording_running(lockstep, qtbot, tmp_path, monkeypatch):
    from esea_host.windows.live import LiveWindow

    with lockstep.record(tmp_path / "a.mcap") as recording:
        feed = LiveFeed(lockstep, recording, kept_s=0.1, threaded=False)
        window = LiveWindow(feed)
        window.timer.stop()
        qtbot.addWidget(window)

        def broken(_):
            raise RuntimeError("drawing failed")

        monkeypatch.setattr(window.panels[0], "draw", broken)
        with pytest.raises(RuntimeError):
            window.turn()
        assert window.timer.isActive()  # it tries again
        window.timer.stop()
        lockstep.advance(0.3)
        feed.close()
    with esea_host.open_log(tmp_path / "a.mcap") as log:
        assert len(log["sense_out"]) >= 290
        assert log.gaps == ()


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="they are not counted")
@pytest.mark.parametrize("one", [None, True, False, NotImplemented])
def test_qt_does_not_use_up_the_references_to(one):
    """PySide6 6.12.0 gives back what it never took; when none is left, Python ends."""
    importlib.import_module("esea_host.windows")
    assert sys.getrefcount(one) > 1 << 44  # some hundreds a picture: a hundred years and more


def test_trigger_and_spectrum_by_key(seen, qtbot, pictures):
    window, _ = seen
    window.zoom(-1)
    assert window.window_s == 1.0
    window.toggle_trigger()
    assert window.trigger.on
    bar = window.trigger_bar
    bar.source.setCurrentIndex(bar.source.findText("sense_out.tau_Nm"))
    bar.level.setValue(0.5)
    assert bar.level.suffix() == " Nm"
    bar.trigger.arm(-math.inf)
    window.draw()
    left_s, right_s = window.bands.item.viewRange()[0]
    at_s = window.trigger.last_s
    assert (left_s, right_s) == pytest.approx((at_s - 0.2, at_s + 0.8), abs=1e-6)
    # What stands there is what the recorded signal does: below before it, above after it.
    ring = window.feed.rings["sense_out"].last()
    i = int(np.searchsorted(ring.time_s, at_s))
    assert ring.rows["tau_Nm"][i - 1] < 0.5 <= ring.rows["tau_Nm"][i]
    assert "trigger at" in window.bar.who.text()
    window.toggle_spectrum()
    window.draw()
    qtbot.wait(20)
    f_Hz, size = window.spectrum.curves[0].getOriginalDataset()
    assert len(f_Hz) == len(size) > 100
    window.grab().save(str(pictures / "host-trigger.png"))
    bar.offer([replace(bar.signal, stream=str(i)) for i in range(9)])  # another axis'
    assert (bar.signal.stream, window.trigger.last_s) == ("2", pytest.approx(math.nan, nan_ok=True))
    window.toggle_trigger()
    assert not window.trigger.on


def test_the_virtual_arm_is_pushed_by_mouse_and_keys(simulated_elbow, lockstep, qtbot, pictures):
    from PySide6.QtCore import QPoint, Qt

    from esea_host.windows.arm import add_arms
    from esea_host.windows.live import LiveWindow

    ours, theirs = os.pipe()
    hands = Hands(ours)
    feed = LiveFeed(lockstep, None, kept_s=2.0, threaded=False)
    window = LiveWindow(feed)
    qtbot.addWidget(window)
    window.resize(1280, 760)
    (arm,) = add_arms(
        window, feed, lambda rad: os.write(theirs, f"push {rad:.4f}\n".encode()) and None
    )
    window.show()
    lockstep.advance(1.0)
    feed.gather()
    before_rad = arm.angle_rad
    elbow, hand = (p.toPoint() for p in (arm.elbow(), arm.at(0.0)))
    qtbot.mousePress(arm, Qt.MouseButton.LeftButton, pos=hand)
    qtbot.mouseMove(arm, elbow + QPoint(round(0.5 * (hand - elbow).y()), (hand - elbow).y()))
    assert arm.push_rad == pytest.approx(math.atan(0.5), abs=0.02)
    board = simulated_elbow  # a thread reads the lines
    qtbot.waitUntil(lambda: hands.reach(board) or board.pushes_rad[0] > 0, timeout=120_000)
    lockstep.advance(1.0)
    feed.gather()
    window.draw()
    window.grab().save(str(pictures / "host-arm.png"))
    # The virtual person's spring is softer than the drive's friction is nothing: most of the way.
    assert arm.angle_rad - before_rad > 0.1
    qtbot.mouseRelease(arm, Qt.MouseButton.LeftButton, pos=hand)
    assert arm.push_rad == 0.0
    os.write(theirs, b"push 7\npush x\npu")  # too far, no number, half a line
    qtbot.waitUntil(lambda: hands.reach(board) or board.pushes_rad == [0.0], timeout=120_000)
    os.close(theirs)
    feed.close()
    simulated_elbow.pushes_rad = [0.0]


@pytest.mark.ci
def test_the_live_view_on_an_x_server(tmp_path):
    """The platform that people have, beside the one that the other tests take."""
    xvfb = require_tool("Xvfb")
    shot = tmp_path / "x.png"
    with tempfile.TemporaryFile() as said:
        # It chooses a display that is free, and says which once it listens.
        server = subprocess.Popen([xvfb, "-displayfd", "1", "-screen", "0", "1400x1000x24"],
                                  stdout=subprocess.PIPE, stderr=said)  # fmt: skip
        try:
            display = server.stdout.readline().decode().strip()
            assert display.isdigit()
            env = {k: v for k, v in os.environ.items() if k != "QT_QPA_PLATFORM"}
            env |= {"DISPLAY": f":{display}", "QT_QPA_PLATFORM": "xcb"}
            words = ["view", "sim:elbow_drive", "--seconds", "2", "--screenshot", str(shot)]
            command = [sys.executable, "-m", "esea_host.cli", *words]
            done = subprocess.run(
                command, check=False, env=env, capture_output=True, text=True, timeout=180
            )
        finally:
            server.terminate()
            server.communicate(timeout=10)
    assert done.returncode == 0, done.stderr
    assert shot.read_bytes().startswith(b"\x89PNG")
    assert shot.stat().st_size > 20_000  # curves, not an empty window
