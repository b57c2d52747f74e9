"""The wrist display, opened and closed; or run without a screen, for a picture."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from esea_gen.errors import UserError
from esea_gen.files import written_whole
from esea_host.connection import ConnectedDevice
from esea_host.connection.address import SimulatedProcess
from esea_host.connection.recording import LiveRecording
from esea_host.simulated.drive import SimulatedBoard
from esea_host.simulated.lockstep import LockstepDevice
from esea_host.windows.feed import LiveFeed
from esea_host.windows.wrist import TOLD_EVERY, WristWindow
from esea_host.wrist.constraint import WORKING, ConstraintKeeper
from esea_host.wrist.display import WristDisplay
from esea_host.wrist.guide import CalibrationGuide
from esea_host.wrist.stored import WristCalibration

WIDTH, HEIGHT = 1366, 768
TURN_S, ASK_TURNS = 0.02, 10
READY_S, CALIBRATED_S, SWITCHED_S = 10.0, 300.0, 10.0
BRISK = partial(CalibrationGuide, range_s=3.0, movements=3)  # for a hand that waits for no words


def run_wrist(
    device: ConnectedDevice,
    recording: LiveRecording | None,
    calibration: WristCalibration | None,
    save_to: Path,
    dark: bool | None = None,
    seconds: float | None = None,
    screenshot: Path | None = None,
) -> None:
    """Open the display, and return when it is closed, or after some seconds."""
    application = QApplication.instance() or QApplication([])
    assert isinstance(application, QApplication)
    if dark is None:
        dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
    display = WristDisplay(device.identity.device, calibration)
    keeper = ConstraintKeeper(device, arms=device.simulated)
    feed = LiveFeed(device, recording)
    transport = device.receiver.transport
    lead = partial(_lead, transport) if isinstance(transport, SimulatedProcess) else None
    window = WristWindow(feed, display, keeper, dark, lead, save_to)
    window.resize(WIDTH, HEIGHT)
    window.show()
    window.start()
    if seconds is not None:
        QTimer.singleShot(int(seconds * 1000), window.close)
    if screenshot is not None:
        before_ms = max(0, int((seconds or 5.0) * 1000) - 300)
        QTimer.singleShot(before_ms, partial(save_picture, window, screenshot))
    before = signal.signal(signal.SIGINT, lambda *_: window.close())
    try:
        application.exec()
    finally:
        signal.signal(signal.SIGINT, before)
        keeper.close()
        feed.close()


def _lead(transport: SimulatedProcess, fe_deg: float, ru_deg: float) -> None:
    transport.lead(math.radians(fe_deg), math.radians(ru_deg))


def save_picture(window: WristWindow, path: Path) -> None:
    with written_whole(path) as scratch:
        window.grab().save(str(scratch))


def film_wrist(
    name: str,
    calibration: WristCalibration | None,
    save_to: Path,
    picture: Path,
    record: Path | None,
    seconds: float,
    dark: bool = False,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Run a simulated board as fast as it can: calibrate unless done, constrain, draw."""
    if record is not None and record.exists():
        raise UserError(f"{record} is there already.", "Give another name.")
    application = QApplication.instance() or QApplication([])
    assert isinstance(application, QApplication)
    board = SimulatedBoard(name)
    device = LockstepDevice(board)
    try:
        _Film(board, device, calibration, save_to, dark, say).run(picture, record, seconds)
    finally:
        device.close()


class _Film:
    def __init__(
        self,
        board: SimulatedBoard,
        device: LockstepDevice,
        calibration: WristCalibration | None,
        save_to: Path,
        dark: bool,
        say: Callable[[str], None],
    ) -> None:
        self.board, self.device, self.say = board, device, say
        self.display = WristDisplay(device.identity.device, calibration)
        self.keeper = ConstraintKeeper(device, arms=True, threaded=False)
        self.feed = LiveFeed(device, threaded=False)
        given = self.feed, self.display, self.keeper, dark, self._lead, save_to, BRISK
        self.window = WristWindow(*given)
        self.window.resize(WIDTH, HEIGHT)
        board.led = True
        self._turns = 0

    def _lead(self, fe_deg: float, ru_deg: float) -> None:
        self.board.pushes_rad = [math.radians(fe_deg), math.radians(ru_deg)]

    def turn(self) -> None:
        self.device.advance(TURN_S)
        self.keeper.turn(self._turns * TURN_S)
        self.feed.gather()
        self.window.take()
        if self._turns % ASK_TURNS == 0:
            self.feed.ask()
        self._turns += 1

    def until(self, what: str, most_s: float, done: Callable[[], bool]) -> None:
        for _ in range(round(most_s / TURN_S)):
            self.turn()
            if done():
                return
        why = self.window.said or f"the board is in {self.feed.news.state}"
        raise UserError(f"The simulated wrist was not {what} within {most_s:g} s: {why}.", "")

    def run(self, picture: Path, record: Path | None, seconds: float) -> None:
        mark = self.board.device.name
        self.say(f"simulated {mark}, simulated hand")
        ready = WORKING if self.keeper.there else ("READY",)
        self.until("ready", READY_S, lambda: self.feed.news.state in ready)
        if self.display.calibration is None:
            self.window.calibrate()
            self.until("calibrated", CALIBRATED_S, lambda: self.display.guide is None)
            if self.display.calibration is None:
                raise UserError(self.window.said, "")
            self.say(f"simulated calibration, {self.display.time_s:.0f} s: {self.window.said}")
        self.keeper.wanted = self.keeper.there
        if self.keeper.there:
            self.until("constrained", SWITCHED_S, lambda: self.display.acts)
        recording = self.device.record(record) if record is not None else None
        for _ in range(round(seconds / TURN_S)):
            self.turn()
        if recording is not None:
            recording.close()
            self.say(f"{record}: {recording.rows} runs, {recording.gaps} gaps")
        self.feed.ask()
        self.window.show()
        for _ in range(TOLD_EVERY):  # words, and the layout that they ask for
            self.window.draw()
            QApplication.processEvents()
        save_picture(self.window, picture)
        self.say(f"{picture}: the simulated wrist's display")
        self.window.close()
        self.feed.close()
