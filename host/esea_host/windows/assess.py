"""The clinician's window: proposed movement, probabilities, the clinician's answers."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QApplication,
    QLabel,
    QListWidget,
    QScrollArea,
    QSplitter,
    QTabWidget,
    QWidget,
)

from esea_gen.errors import UserError
from esea_host.assess.desk import ClinicDesk, conclusion, describe, long_name, unit_of
from esea_host.assess.files import KINDS, read_recording
from esea_host.assess.pages import step_text, write_session_page
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort
from esea_host.assess.segments import MovementEvent
from esea_host.assess.tasks import PAUSE_S, leg_scene
from esea_host.windows import frame
from esea_host.windows.assess_controls import (
    BoardPanel,
    ClinicControls,
    HistoryPlot,
    InformationMap,
    ProbabilityBars,
)
from esea_host.windows.bar import StepButton, restyle
from esea_host.windows.meanings import ROLES, refusals
from esea_host.windows.study.scene_view import SceneView
from esea_host.windows.theme import DARK, LIGHT, Theme, plain_label

FRAME_MS, LEAST_HEIGHT_PX = 40, 400
STACKED_PX = 900, 1200  # the width below which, and the height in which
RECORDINGS = f"Recordings (*{' *'.join(KINDS)})"
PAGES = "Page (*.pdf *.png *.html)"


class AssessWindow(frame.StopWindow):
    """A window on a :class:`ClinicDesk`; every step goes through the desk and into its trail."""

    def __init__(self, desk: ClinicDesk, who: str = "", dark: bool = False) -> None:
        super().__init__()
        self.desk, self.who = desk, who
        simulated = "SIMULATED PATIENT" if desk.simulated else ""
        title = " - ".join(filter(None, (simulated, "Knee: assessment", "esea-host")))
        self.setWindowTitle(title)
        self.bar.mark(simulated, desk.session.data.notice)
        self._began_s = time.monotonic()
        self._build()
        self._actions()
        self.set_theme(DARK if dark else LIGHT)
        self.timer.timeout.connect(self.animate)
        self.timer.start(FRAME_MS)

    # -- what there is -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.now, self.settled = plain_label(), QLabel()
        self.now.setWordWrap(True)
        self.now.setMinimumHeight(32)
        self._said, self._refused = "", False
        self.map, self.leg = InformationMap(self.desk.session.hypotheses.grid), SceneView()
        names = [long_name(n) for n in self.desk.session.names]
        self.bars, self.history = ProbabilityBars(names), HistoryPlot(names)
        self.trail = QListWidget()
        self.trail.setMinimumHeight(90)
        self.trail.setAccessibleName("Steps")
        given = self._step, self.move_leg, self.undo, self.limit
        self.controls = ClinicControls(self.desk, *given)
        controls = QScrollArea()
        controls.setWidget(self.controls)
        controls.setWidgetResizable(True)
        controls.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.panel = None if self.desk.board is None else BoardPanel(self.desk.board)
        across, down = Qt.Orientation.Horizontal, Qt.Orientation.Vertical
        self.leg.setMinimumSize(120, 120)
        lower = _split(across, {self.leg: 330, self.bars.view: 420})
        left = _split(down, {self.map.view: 360, lower: 340})
        sizes = (205, 395, 110) if self.panel is None else (340, 260, 110)
        right = _split(down, dict(zip((self._upper(), controls, self.trail), sizes, strict=True)))
        self._seen, self._done, self._both = left, right, _split(across, {left: 760, right: 520})
        self.fill(frame.column_of(frame.row_of((self.now, 1), self.settled), (self._both, 1)))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """On a small screen put the controls above the plots."""
        super().resizeEvent(event)
        small = self.width() < STACKED_PX[0]
        self._both.setOrientation(Qt.Orientation.Vertical if small else Qt.Orientation.Horizontal)
        self._both.insertWidget(0, self._done if small else self._seen)
        self._both.setMinimumHeight(STACKED_PX[1] if small else LEAST_HEIGHT_PX)

    def _upper(self) -> QWidget:
        history: QWidget = self.history.view
        if self.panel is None:
            return history
        tabs = QTabWidget()
        tabs.setAccessibleName("Views")
        tabs.addTab(self.panel, "At the board")
        tabs.addTab(history, "Probability history")
        return tabs

    def _actions(self) -> None:
        jobs: list[tuple[str, str, frame.Job]] = [
            ("Read a recording...", "Ctrl+O", self.open_recording),
            ("Save the page for the file...", "Ctrl+S", self.save_page),
            ("Take back the last step", "Ctrl+Z", self.undo),
            ("Another movement", "Ctrl+N", lambda: self._step(self.desk.leave_out)),
            ("Dark, light", "Ctrl+T", self.toggle_theme),
        ]
        if self.desk.patient is not None:
            jobs.insert(0, ("Move the simulated leg", "Ctrl+M", self.move_leg))
        if self.panel is None:
            self.bar.without_stop()
        else:
            steps = {"Keep": ("K", self.desk.keep), "Repeat": ("R", self.desk.repeat)}
            for name, (key, job) in (steps | {"Zero": ("Ctrl+0", self.panel.board.zero)}).items():
                jobs.append((name, key, partial(self._step, job)))
                self.bar.add_step(name, StepButton(name, key, jobs[-1][2]))
            jobs.append((frame.STOP_NAME, "", self.stop))
        self.add_menu("&Assessment", jobs)

    def stop(self) -> None:
        """End the movement under way: a board for the knee has no motor, hands move the leg."""
        if self.panel is None:
            return
        self._take_events(self.panel, self.panel.board.watch.end("stopped by the operator"))
        self._tell("STOP: no movement is taken. No motor is here: take your hands off.", alarm=True)

    # -- steps -------------------------------------------------------------------------------------

    def _step(self, job: Callable[[], object]) -> None:
        # What is refused is said, and nothing has changed.
        QApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            found = job()
            self._tell(found if isinstance(found, str) else "")
        except UserError as error:
            self._tell(str(error), alarm=True)
        finally:
            QApplication.restoreOverrideCursor()
        self.refresh()

    def _tell(self, text: str, *, alarm: bool = False) -> None:
        self._said, self._refused = text, alarm
        self._show_bar()

    def _show_bar(self) -> None:
        panel, trouble = self.panel, ""
        if panel is not None:
            state, trouble = panel.board.state(), panel.board.trouble()
            self.bar.show_state(state, ROLES.get(state, "rest"))
            no_try = "" if self.desk.attempt else "no movement yet"
            moves = refusals(state)["Zero"]
            self.bar.refuse({"Keep": no_try, "Repeat": no_try, "Zero": moves})
        else:
            self.bar.show_state("BY HAND" if self.desk.patient is None else "SIMULATED LEG", "rest")
        told = trouble or f"Next: {describe(self.desk.proposed)}"
        self.bar.tell(told, self.theme, alarm=bool(trouble), said=self._said)
        restyle(self.bar.said, f"color: {self.theme.alarm if self._refused else self.theme.ink}")

    def move_leg(self) -> None:
        self._step(self.desk.ask_therapist if self.desk.board else self.desk.move)
        self._began_s = time.monotonic()

    def undo(self) -> None:
        self._step(lambda: "" if self.desk.undo() else "There is nothing to take back.")

    def limit(self, low_deg: float, high_deg: float, fastest_deg_s: float) -> None:
        def job() -> None:
            self.desk.comfort = Comfort(low_deg * DEG, high_deg * DEG, fastest_deg_s * DEG)

        self._step(job)
        self.controls.show_limits(self.desk.comfort)

    def open_recording(self, path: Path | str | None = None) -> None:
        if path is None:
            frame.ask_for_file(self, "Recording", RECORDINGS, self.open_recording)
        else:
            self._step(partial(self._read, Path(path)))

    def _read(self, path: Path) -> str:
        recording = read_recording(path, self.desk.height_m, self.desk.mass_kg)
        return "\n".join(filter(None, (self.desk.recording(recording, path.name), recording.read)))

    def save_page(self, path: Path | str | None = None) -> None:
        if path is None:
            frame.ask_for_file(self, "Page", PAGES, self.save_page, "knee.pdf")
        else:
            self._step(partial(self._write, Path(path)))

    def _write(self, path: Path) -> str:
        write_session_page(
            path, self.desk.session, self.desk.about(self.who), self.desk.comfort, self.desk.measure
        )
        return f"{path} is written."

    # -- looking -----------------------------------------------------------------------------------

    def refresh(self) -> None:
        session, theme = self.desk.session, self.theme
        self.now.setText(" ".join(conclusion(session)[:3]))
        settled = session.settled
        change = "have stopped changing" if settled else "are still changing"
        self.settled.setText(f"The probabilities {change}.")
        self.settled.setStyleSheet(f"color: {theme.good if settled else theme.soft}")
        places = session.evidence.places() / DEG
        unit = unit_of(self.desk.measure)
        self.map.draw(self.desk.value, places, self.desk.proposed, self.desk.comfort, unit)
        self.bars.draw(session.probabilities)
        self.history.draw(np.array([list(e.probabilities.values()) for e in session.trail]))
        self.trail.clear()
        self.trail.addItems([f"{e.number:>3}  {step_text(e)}" for e in session.trail])
        self.trail.scrollToBottom()
        self._show_bar()
        self.animate()

    def _take_events(self, panel: BoardPanel, events: list[MovementEvent]) -> None:
        for event in events:
            panel.take(event)
            if event.kind == "broken":
                self._step(partial(self.desk.broken, event.text))
            elif event.segment is not None and self.desk.attempt is None:
                self.desk.judge(event.segment)

    def _take_board(self, panel: BoardPanel) -> float | None:
        # What came since the last frame; where the leg is now.
        self._take_events(panel, panel.board.poll())
        panel.draw(self.desk.attempt)
        self._show_bar()
        return panel.board.rows[-1][1] if panel.board.rows and panel.board.valid else None

    def animate(self) -> None:
        move, moved = self.desk.proposed, self.desk.moved
        since_s = time.monotonic() - self._began_s
        key, angle, target = "knee_watch", None, move
        if self.panel is not None:
            angle = self._take_board(self.panel)
        elif moved is not None:
            end_s = float(moved[1].time_s[-1])
            if since_s < end_s:
                key, target = "knee_moved", moved[0]
                angle = float(np.interp(since_s, moved[1].time_s, moved[1].angle_rad))
            since_s = since_s if since_s < end_s else since_s - end_s
        period_s = target.duration_s + PAUSE_S
        shown = float(target.at(since_s % period_s)[0])
        where = target.location.angle_rad
        self.leg.show_scene(leg_scene((key,), self.desk.comfort, angle, shown, where))

    def set_theme(self, theme: Theme) -> None:
        super().set_theme(theme)
        restyle(self.bar.who, f"color: {theme.limit}; font-weight: bold")
        self.leg.set_dark(theme is DARK)
        for part in (self.map, self.bars, self.history):
            part.show(theme)
        if self.panel is not None:
            self.panel.show_theme(theme)
        self.refresh()


def _split(way: Qt.Orientation, parts: dict[QWidget, int]) -> QSplitter:
    made = QSplitter(way)
    for part in parts:
        made.addWidget(part)
    made.setSizes(list(parts.values()))
    return made


def run_assess(desk: ClinicDesk, who: str = "", dark: bool | None = None) -> None:
    dark = frame.qt_application(dark)
    pg.setConfigOptions(antialias=True)
    window = AssessWindow(desk, who, dark)
    frame.run_until_closed(window)
