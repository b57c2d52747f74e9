"""The wrist display, opened and closed; or run without a screen, for a picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QApplication

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_host.connection import ConnectedDevice, hands_at
from esea_host.connection.address import SimulatedProcess
from esea_host.connection.recording import LiveRecording
from esea_host.simulated.drive import LockstepDevice, SimulatedBoard
from esea_host.windows.feed import LiveFeed
from esea_host.windows.frame import qt_application, run_until_closed, save_picture
from esea_host.windows.operator import WORKING, ConstraintKeeper
from esea_host.windows.wrist import TOLD_EVERY, WristWindow
from esea_host.wrist.calibration import WristCalibration
from esea_host.wrist.display import CalibrationGuide, WristDisplay

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
    dark = qt_application(dark)
    display = WristDisplay(device.identity.device, calibration)
    keeper = ConstraintKeeper(device, arms=device.simulated)
    feed = LiveFeed(device, recording)
    lead = None
    if isinstance(device.receiver.transport, SimulatedProcess):
        act = hands_at(device)

        def lead(*angles_deg: float) -> None:
            act("lead", *map(math.radians, angles_deg))

    window = WristWindow(feed, display, keeper, dark, lead, save_to)
    window.start()
    try:
        run_until_closed(window, seconds, screenshot, (WIDTH, HEIGHT))
    finally:
        keeper.close()
        feed.close()


class FilmedWrist:
    """The display of a simulated board whose clock is moved by :meth:`turn`, with a hand in it."""

    def __init__(
        self,
        name: Device | str,
        save_to: Path,
        calibration: WristCalibration | None = None,
        dark: bool = False,
    ) -> None:
        self.board = SimulatedBoard(name)
        self.board.led = True
        self.device = LockstepDevice(self.board)
        self.display = WristDisplay(self.device.identity.device, calibration)
        self.keeper = ConstraintKeeper(self.device, arms=True, threaded=False)
        self.feed = LiveFeed(self.device, threaded=False)
        given = self.feed, self.display, self.keeper, dark, self._lead, save_to, BRISK
        self.window = WristWindow(*given)
        self.window.resize(WIDTH, HEIGHT)
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

    def until(self, what: str, most_s: float, done: Callable[[], object]) -> None:
        for _ in range(round(most_s / TURN_S)):
            self.turn()
            if done():
                return
        why = self.window.said or f"the board is in {self.feed.news.state}"
        raise UserError(f"The simulated wrist was not {what} within {most_s:g} s: {why}.", "")

    def draw(self) -> None:
        """Words too, which change less often than pictures, and the layout that they ask for."""
        self.feed.came_s = math.inf  # a board moved by turns is not silent between them
        for _ in range(TOLD_EVERY):
            self.window.draw()
            QApplication.processEvents()

    def close(self) -> None:
        self.window.close()
        self.feed.close()
        self.device.close()


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
        raise UserError(f"{record} already exists.", "Give another name.")
    qt_application()
    filmed = FilmedWrist(name, save_to, calibration, dark)
    display, keeper = filmed.display, filmed.keeper
    try:
        say(f"simulated {filmed.board.device.name}, simulated hand")
        ready = WORKING if keeper.there else ("READY",)
        filmed.until("ready", READY_S, lambda: filmed.feed.news.state in ready)
        if display.calibration is None:
            filmed.window.calibrate()
            filmed.until("calibrated", CALIBRATED_S, lambda: display.guide is None)
            if display.calibration is None:
                raise UserError(filmed.window.said, "")
            say(f"simulated calibration, {display.time_s:.0f} s: {filmed.window.said}")
        keeper.wanted = keeper.there
        if keeper.there:
            filmed.until("constrained", SWITCHED_S, lambda: display.acts)
        recording = filmed.device.record(record) if record is not None else None
        for _ in range(round(seconds / TURN_S)):  # by the board's clock
            filmed.turn()
        if recording is not None:
            recording.close()
            say(f"{record}: {recording.rows} runs, {recording.gaps} gaps")
        filmed.feed.ask()
        filmed.window.show()
        filmed.draw()
        save_picture(filmed.window.grab(), picture)
        say(f"{picture}: the simulated wrist's display")
    finally:
        filmed.close()
