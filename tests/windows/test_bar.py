"""Bar of every window: STOP visible at any size, its keys, refused steps."""

from __future__ import annotations

import math
import re

import pytest

from esea_gen.device import load_device, parse_device
from esea_host.assess.desk import ClinicDesk
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort
from esea_host.assess.session import Assessment
from esea_host.commissioning import (
    STEPS,
    BoardUnit,
    CommissioningRecord,
    StepOptions,
    simulated_bench,
)
from esea_host.simulated import LockstepDevice
from esea_host.study.conductor import Conductor
from esea_host.study.source import SimulatedSource
from esea_host.windows.feed import LiveFeed, StopSender
from esea_host.windows.meanings import refusals
from tests.assess.test_assess import made_up
from tests.conducted import TRACKING, of_tasks, study_of

# 1440 x 900 at twice the size leaves 720 x 450, less the title of a window.
SIZES_PX = ((1280, 720), (1366, 768), (1920, 1080), (1440, 900), (720, 425), (620, 310))
LONG = "A refusal of the board that is as long as such a text can be, and then longer. " * 3


@pytest.fixture
def feed(simulated_elbow):
    simulated_elbow.restart()
    made = LiveFeed(LockstepDevice(simulated_elbow), None, kept_s=2.0, threaded=False)
    made.came_s = math.inf  # its clock stands still, and it is not away
    yield made
    made.close()


@pytest.fixture
def live(feed, qtbot):
    from esea_host.windows.live import LiveWindow

    window = LiveWindow(feed)
    window.timer.stop()
    qtbot.addWidget(window)
    window.show()
    return window


def live_with_all_docks(feed, live, tmp_path):
    from esea_host.windows.arm import add_arms

    add_arms(live, feed, lambda *_: None)
    for name in ("Channels", "Parameters"):
        live.toggle_dock(name)
    live.toggle_trigger()
    live.toggle_spectrum()
    feed.news.said = LONG
    live.draw()
    return live


def commissioning(feed, live, tmp_path):
    from esea_host.windows.commission import CommissioningWindow

    bench = simulated_bench(feed.device.drive)
    record = CommissioningRecord(tmp_path, "x", BoardUnit("", 1))
    return CommissioningWindow(bench, STEPS, StepOptions(), record)


def operator(feed, live, tmp_path):
    from esea_host.windows.study.operator import OperatorWindow

    study = study_of(tmp_path / "s", of_tasks(TRACKING))
    conductor = Conductor(study, study.session("P01", 0, SimulatedSource(3)))
    conductor.advice, conductor.said = (LONG,), LONG
    window = OperatorWindow(conductor, study.protocol.words("de"))
    conductor.start()  # a session that is not run keeps its folder
    conductor.stop("enough")
    window.adverse.open()
    window.refresh()
    return window


def wrist(feed, live, tmp_path, board="wrist_drive"):
    from esea_host.windows.wrist_running import FilmedWrist

    made = FilmedWrist(board, tmp_path / "w.toml")
    made.draw()
    return made.window


def knee(feed, live, tmp_path):
    from esea_host.windows.assess import AssessWindow

    return AssessWindow(ClinicDesk(Assessment(made_up()), Comfort(0, 120 * DEG)))


WRIST = pytest.param(wrist, marks=pytest.mark.ci)
WINDOWS = live_with_all_docks, commissioning, operator, WRIST, knee


def unnamed(window):
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QAbstractButton, QWidget

    fields = (w for w in window.findChildren(QWidget) if w.focusPolicy() & Qt.FocusPolicy.TabFocus)
    words = ((w, w.text() if isinstance(w, QAbstractButton) else "") for w in fields)
    return [w for w, text in words if not (w.accessibleName() or text)]


@pytest.mark.parametrize("made", WINDOWS)
def test_a_screen_reader_has_a_name_for_everything_that_takes_the_focus(
    feed, live, qtbot, tmp_path, made
):
    from PySide6.QtWidgets import QLineEdit

    window = made(feed, live, tmp_path)
    qtbot.addWidget(window)
    window.timer.stop()
    window.show()
    assert unnamed(window) == []
    planted = QLineEdit(window)
    assert unnamed(window) == [planted]
    window.close()


def test_a_stop_is_sent_though_its_window_closes_at_once(simulated_elbow):
    for _ in range(20):
        stopper = StopSender(LockstepDevice(simulated_elbow))
        stopper.stop()
        stopper.close()
        assert stopper.sent == 1


@pytest.mark.parametrize("made", WINDOWS[:4])
def test_stop_is_complete_and_at_its_place_at_every_size(feed, live, qtbot, tmp_path, made):
    from PySide6.QtCore import QPoint, QSize
    from PySide6.QtWidgets import QApplication

    window = made(feed, live, tmp_path)
    qtbot.addWidget(window)
    window.timer.stop()
    button = window.stop_button
    for width, height in SIZES_PX:
        window.resize(width, height)
        window.show()
        for _ in range(3):  # letters grow with the window, and ask for room
            QApplication.processEvents()
        assert (window.width(), window.height()) == (width, height)
        corner = button.mapTo(window, QPoint(button.width(), 0))
        assert button.size() == QSize(150, 92)
        assert (width - corner.x(), corner.y()) == (8, window.menus.height() + 4)
        assert button.visibleRegion().boundingRect() == button.rect()
        for step in (s for s in window.bar.steps.values() if s.isVisible() and width > 700):
            assert step.visibleRegion().boundingRect() == step.rect(), step.name
        red = window.grab().toImage().pixelColor(corner - QPoint(12, -12))
        assert (red.red() > 150, red.green() < 80) == (True, True)
    window.close()


def test_without_a_motor_the_place_of_stop_says_so(qtbot):
    window = knee(None, None, None)
    window.timer.stop()
    qtbot.addWidget(window)
    window.resize(720, 425)
    window.show()
    plot = window.map  # a small window cuts nothing of it
    assert plot.item.size().width() <= plot.view.viewport().width()
    assert "nothing to stop" in window.stop_button.text()
    assert not window.stop_button.isEnabled()
    assert window.stop_button.visibleRegion().boundingRect() == window.stop_button.rect()


@pytest.mark.ci
def test_without_a_motor_stop_ends_the_calibration(qtbot, tmp_path):
    window = wrist(None, None, tmp_path, "wrist_board")
    qtbot.addWidget(window)
    assert not window.stop_button.isEnabled()
    window.calibrate()
    assert window.display.guide is not None
    window.stop()
    assert (window.display.guide, window.stop_asked_s) == (None, 0.0)


@pytest.mark.ci
def test_a_motor_that_no_constraint_drives_is_stopped(qtbot, tmp_path):
    text = re.sub(r"(?ms)^\[impairment\].*?(?=^\[|\Z)", "", load_device("wrist_drive").toml())
    window = wrist(None, None, tmp_path, parse_device(text, "mine.toml"))
    qtbot.addWidget(window)
    assert window.stop_button.isEnabled()
    window.stop()
    assert window.stop_asked_s > 0


def test_escape_that_closes_something_does_not_stop_all_else_does(live, qtbot):
    from PySide6.QtCore import QEvent, QPoint, Qt
    from PySide6.QtGui import QKeyEvent
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QApplication, QLineEdit

    from esea_host.windows.frame import ask_for_file

    menu = live.menus.actions()[0].menu()

    def opened():
        live.stop_asked_s = 0.0
        menu.popup(live.mapToGlobal(QPoint(0, 20)))
        qtbot.waitUntil(menu.isVisible, timeout=120_000)

    opened()
    QTest.keyClick(menu, Qt.Key.Key_Escape)
    assert not menu.isVisible()
    assert live.stop_asked_s == 0.0
    live.draw()
    assert "stopped nothing" in live.bar.said.text()
    QTest.keyClick(live, Qt.Key.Key_Escape)
    assert live.stop_asked_s > 0.0
    for key in (Qt.Key.Key_Space, Qt.Key.Key_F12):
        opened()
        QTest.keyClick(menu, key)
        assert live.stop_asked_s > 0.0, key
        menu.close()
    opened()  # held down: it closes the menu, then it stops, and once only
    QTest.keyPress(menu, Qt.Key.Key_Escape)
    pressed = QEvent.Type.KeyPress, Qt.Key.Key_Escape, Qt.KeyboardModifier.NoModifier
    for stops in (True, False):
        live.stop_asked_s = 0.0
        QApplication.sendEvent(live, QKeyEvent(*pressed, "", True))
        assert (live.stop_asked_s > 0.0) == stops
    opened()  # the first press of the mouse is the menu's own
    QTest.mousePress(menu, Qt.MouseButton.LeftButton, pos=menu.mapFromGlobal(
        live.stop_button.mapToGlobal(live.stop_button.rect().center())))  # fmt: skip
    assert live.stop_asked_s > 0.0
    menu.close()
    field = live.channels.search
    live.toggle_dock("Channels")
    live.stop_asked_s = 0.0
    live.activateWindow()
    field.setFocus()
    qtbot.waitUntil(lambda: isinstance(QApplication.focusWidget(), QLineEdit), timeout=120_000)
    QTest.keyClick(field, Qt.Key.Key_Space)
    assert (field.text(), live.stop_asked_s) == (" ", 0.0)
    QTest.keyClick(field, Qt.Key.Key_F12)
    assert live.stop_asked_s > 0.0
    live.toggle_trigger()
    live.toggle_dock("Parameters")
    live.feed.ask()
    table = live.parameters.table
    for begin in (live.trigger_bar.level.setFocus, lambda: table.editItem(table.item(0, 2))):
        begin()  # a number has no space in it
        field, live.stop_asked_s = QApplication.focusWidget(), 0.0
        QTest.keyClick(field, Qt.Key.Key_Space)
        assert isinstance(field, QLineEdit)
        assert (live.stop_asked_s > 0.0, " " in field.text()) == (True, False)
    dialog, live.stop_asked_s = ask_for_file(live, "Recording", "", lambda _: None), 0.0
    qtbot.waitUntil(dialog.isActiveWindow, timeout=120_000)
    QTest.keyClick(dialog, Qt.Key.Key_Escape)
    assert (dialog.isVisible(), live.stop_asked_s) == (False, 0.0)
    dialog.show()  # it takes no press of the mouse from STOP
    at = live.stop_button.mapTo(live, live.stop_button.rect().center())
    QTest.mousePress(live.windowHandle(), Qt.MouseButton.LeftButton, pos=at)
    assert live.stop_asked_s > 0.0


@pytest.mark.parametrize("text", ["STOP\n(Space)", "ZATRZYMANIE\n(klawisz odstępu)"])
def test_the_word_on_stop_is_complete_in_any_language(qtbot, text):
    from esea_host.windows.bar import BoardBar

    bar = BoardBar(text)
    qtbot.addWidget(bar)
    bar.show()
    needed = bar.stop_button.fontMetrics().size(0, text)
    assert needed.width() <= 150 - 12
    assert needed.height() <= 92 - 8


def test_a_motor_that_is_off_is_no_limit_that_acts(feed, live):
    """Zeroed and ready: nothing is amiss; the history says since when the motor is off."""
    feed.device.advance(0.3)
    feed.device.zero()
    feed.device.advance(1.0)
    feed.gather()
    feed.came_s = math.inf
    feed.ask()
    live.draw()
    assert (live.bar.state.text(), live.bar.indicators.accessibleDescription()) == ("READY", "")
    assert live.bands.names[0] == (0, "motor off")


def test_zero_during_motion_is_refused_with_the_reason_and_a_failed_one_is_told(feed, live):
    """The simulated person moves from the start; a board does not tell that it took no zero."""
    feed.device.advance(0.3)
    feed.gather()
    assert feed.moves
    live.bar.steps["Zero"].click()
    feed.news.state = "UNREFERENCED"
    live.draw()
    assert live.bar.steps["Zero"].text() == "Zero\nthe joint moves"
    assert not live.bar.steps["Zero"].isEnabled()
    zero = next(a for m in live.menus.actions() for a in m.menu().actions() if a.text() == "Zero")
    zero.trigger()
    live.draw()
    assert live.bar.said.text() == "Zero refused: the joint moves."
    feed.device.state = lambda: "UNREFERENCED"
    feed.device.zero = lambda: None
    feed.zero()
    feed.ask()
    assert feed.news.said == "Zero"
    feed.zero_s -= 1.0
    feed.ask()
    assert feed.news.said.startswith("Zero failed: the joint moved")


@pytest.mark.parametrize(
    ("state", "given", "allowed"),
    [
        ("UNREFERENCED", {}, {"Zero", "Disarm"}),
        ("UNREFERENCED", {"moves": True}, {"Disarm"}),
        ("READY", {}, {"Zero", "Arm", "Disarm"}),
        ("ACTIVE", {}, {"Disarm"}),
        ("STOPPED", {}, {"Release", "Disarm"}),
        ("STOPPING", {}, {"Disarm"}),
        ("FAULT", {"fault": 8}, {"Acknowledge fault", "Disarm"}),
        ("FAULT", {"fault": 104}, {"Disarm"}),
        ("UNKNOWN", {}, {"Disarm"}),
    ],
)
def test_what_a_state_allows(state, given, allowed):
    assert {name for name, reason in refusals(state, **given).items() if not reason} == allowed
