"""What the operator holds: where the session is, what comes, what the device does, and the stop."""

from __future__ import annotations

import math
import time
from html import escape

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QCloseEvent, QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QListWidget,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from esea_host.connection import ConnectedDevice
from esea_host.study.conductor import HELD, OVER, PAUSED, RESTING, STARTING, Conductor
from esea_host.study.plan import PlannedTrial
from esea_host.study.protocol import GROUP
from esea_host.study.session import RUNNING
from esea_host.study.source import Gauge
from esea_host.study.task import task_named
from esea_host.windows.feed import StopSender
from esea_host.windows.frame import Job, StopWindow, column_of, push_button, row_of
from esea_host.windows.study.scene_view import SceneView
from esea_host.windows.theme import DARK, LIGHT, Theme, plain_label, plain_tip

TURN_MS = 100
COLUMNS = ("", "state", "block", "task", "condition", "reason")
HIDDEN = "hidden"
NEAR = 0.85  # of the way to a limit
WORDS = {
    STARTING: "STARTING",
    RESTING: "REST",
    PAUSED: "PAUSED",
    HELD: "WAITING FOR YOU: repeat, or go on",
}
BY_STATE = {"completed": "good", "running": "measured", "failed": "alarm", "aborted": "alarm"}


class GaugeBar(QWidget):
    """Name, value, unit; under them a bar from limit to limit with a mark where the value is."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.gauge, self.theme = Gauge("", 0.0, -1.0, 1.0, ""), theme
        self.setMinimumSize(180, 44)

    def sizeHint(self) -> QSize:
        return QSize(260, 44)

    @property
    def near(self) -> bool:
        g = self.gauge
        middle, half = (g.low + g.high) / 2, (g.high - g.low) / 2
        return not abs(g.value - middle) <= NEAR * half

    def paintEvent(self, _: QPaintEvent) -> None:
        painter, g, theme = QPainter(self), self.gauge, self.theme
        painter.setPen(QColor(theme.alarm if self.near else theme.ink))
        painter.drawText(0, 14, f"{g.name}: {round(g.value, 2) + 0.0:.2f} {g.unit}")
        painter.setPen(QColor(theme.soft))
        painter.drawText(0, 42, f"{g.low:.2f}")
        width = float(self.width() - 2)
        high = f"{g.high:.2f}"
        painter.drawText(int(width) - painter.fontMetrics().horizontalAdvance(high), 42, high)
        painter.fillRect(QRectF(0, 19, width, 8), QColor(theme.ground))
        if math.isfinite(g.value) and g.high > g.low:
            share = min(max((g.value - g.low) / (g.high - g.low), 0.0), 1.0)
            colour = QColor(theme.alarm if self.near else theme.measured)
            painter.fillRect(QRectF(share * (width - 6), 17, 6, 12), colour)
        painter.end()


class OperatorWindow(StopWindow):
    """A window on a :class:`Conductor`: it reads, and what it asks for is done beside it."""

    def __init__(
        self,
        conductor: Conductor,
        board: ConnectedDevice | None = None,
        language: str = "en",
        dark: bool = False,
    ) -> None:
        super().__init__()
        self.conductor, self.board = conductor, board
        self.stopper = StopSender(board) if board is not None else None
        study = conductor.study
        self.group = study.group_shown(conductor.code, "operator")
        self._blind = "operator" in study.protocol.file.blinded
        who = f"{conductor.code}, session {conductor.number + 1}: {conductor.plan.session_name}"
        group = f", group {self.group}" if self.group else ""
        self._who = f"{'SIMULATED ' if study.simulated else ''}{who}{group}"
        self.setWindowTitle(f"{self._who} - esea-host")
        self._build(language)
        self._actions()
        self.set_theme(DARK if dark else LIGHT)
        self.timer.timeout.connect(self.refresh)
        self.timer.start(TURN_MS)

    # -- what there is -----------------------------------------------------------------------------

    def _build(self, language: str) -> None:
        self.state, self.who, self.advice = QLabel(), plain_label(self._who), QLabel()
        self.now, self.timers, self.coming = QLabel(), plain_label(), plain_label()
        self.said = plain_label()
        # A reason may be long: it must not widen the window.
        for label in (self.state, self.advice, self.now, self.timers, self.coming, self.said):
            label.setWordWrap(True)
        self.scene = SceneView(language)
        self.scene.setMinimumSize(260, 260)
        self._build_trials()
        top = row_of((column_of(self.state, self.who), 1), self.stop_button)
        middle = row_of((self.trials, 3), (self._side(), 2))
        self.fill(column_of(top, (middle, 1), self._bottom(), self.said))
        self.trials.setFocus()  # not where keys are letters

    def _side(self) -> QVBoxLayout:
        self.gauges = [GaugeBar(LIGHT) for _ in self.conductor.source.gauges()]
        self.happened = QListWidget()
        self.happened.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        labels = self.now, self.timers, self.coming, self.advice
        return column_of((self.scene, 3), *labels, *self.gauges, (self.happened, 2))

    def _build_trials(self) -> None:
        plan = self.conductor.plan
        self.trials = QTableWidget(len(plan.trials), len(COLUMNS))
        self.trials.setHorizontalHeaderLabels(list(COLUMNS))
        self.trials.verticalHeader().hide()
        self.trials.verticalHeader().setDefaultSectionSize(24)
        self.trials.setSelectionBehavior(QTableWidget.SelectionBehavior.SelectRows)
        self.trials.setSelectionMode(QTableWidget.SelectionMode.SingleSelection)
        self.trials.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self._changing = [(QTableWidgetItem(), QTableWidgetItem()) for _ in plan.trials]
        for row, t in enumerate(plan.trials):
            short = t.task.rpartition(".")[2] + self._details(t)
            told = (str(t.number), t.block, short, self._condition(t))
            items = [QTableWidgetItem(text) for text in told]
            state, reason = self._changing[row]
            for k, item in enumerate((items[0], state, *items[1:], reason)):
                item.setToolTip(plain_tip(task_named(t.task, "plan").title))
                self.trials.setItem(row, k, item)
        header = self.trials.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(len(COLUMNS) - 1, QHeaderView.ResizeMode.Stretch)
        self._drawn: dict[int, tuple[str, str]] = {}

    def _details(self, trial: PlannedTrial) -> str:
        # What differs within a block tells nothing of the group.
        block = [t for t in self.conductor.plan.trials if t.block == trial.block]
        differ = [k for k in trial.parameters if len({str(t.parameters[k]) for t in block}) > 1]
        said = ", ".join(f"{k} {trial.parameters[k]}" for k in differ)
        return (f": {said}" if said else "") + (" (catch)" if trial.catch else "")

    def _condition(self, trial: PlannedTrial) -> str:
        # A condition that the group decides would tell the group.
        if not self._blind:
            return trial.condition
        blocks = self.conductor.study.protocol.file.session[self.conductor.number].block
        by_group = {b.name for b in blocks if b.condition == GROUP}
        name = trial.block
        decided = name in by_group or name.rpartition(" ")[0] in by_group
        return HIDDEN if decided else trial.condition

    def _bottom(self) -> QHBoxLayout:
        self.words = QLineEdit()
        self.words.setPlaceholderText("N: a note, or the reason to repeat or skip a trial")
        self.words.returnPressed.connect(self.note)
        jobs: dict[str, Job] = {
            "Note": self.note,
            "Pause": self.pause,
            "Recentre": self.conductor.recentre,
            "Repeat trial": self.repeat,
            "Repeat block": self.repeat_block,
            "Skip trial": self.skip,
        }
        self.buttons = {name: push_button(name, job, focus=False) for name, job in jobs.items()}
        return row_of((self.words, 1), *self.buttons.values())

    def _actions(self) -> None:
        jobs: list[tuple[str, str, Job]] = [
            ("STOP: Space or Escape", "F12", self.stop),
            ("Pause, go on", "P", self.pause),
            ("Recentre", "R", self.conductor.recentre),
            ("Note", "N", self.words.setFocus),
            ("Repeat trial", "Ctrl+R", self.repeat),
            ("Repeat block", "Ctrl+B", self.repeat_block),
            ("Skip trial", "Ctrl+K", self.skip),
            ("Dark, light", "T", self.toggle_theme),
            ("Close", "Ctrl+W", self.close),
        ]
        self.add_menu("&Session", jobs)

    # -- asking ------------------------------------------------------------------------------------

    def stop(self) -> None:
        if self.stopper is not None:
            self.stopper.stop()
            self.stop_asked_s = time.monotonic()
        self.conductor.stop("the operator stopped it")

    def pause(self) -> None:
        self.conductor.pause(not self.conductor.paused and self.conductor.phase != HELD)

    def note(self) -> None:
        if text := self._written():
            self.conductor.note(text)

    def _written(self) -> str:
        text = self.words.text().strip()
        self.words.clear()
        self.trials.clearSelection()
        self.trials.setFocus()
        return text

    @property
    def chosen(self) -> PlannedTrial | None:
        """The trial that is marked in the list, else the one that runs or ran last."""
        row = self.trials.currentRow()
        if row >= 0 and self.trials.selectedItems():
            return self.conductor.plan.trials[row]
        return self.conductor.trial

    def repeat(self) -> None:
        if self.chosen is not None:
            self.conductor.repeat(self.chosen.number, self._written())

    def repeat_block(self) -> None:
        if self.chosen is not None:
            self.conductor.repeat_block(self.chosen.block, self._written())

    def skip(self) -> None:
        if self.chosen is not None:
            self.conductor.skip(self.chosen.number, self._written())

    # -- looking -----------------------------------------------------------------------------------

    def refresh(self) -> None:
        c = self.conductor
        word = escape(self._word())
        self.state.setText(f'<b style="font-size:22px; color:{self._colour()}">{word}</b>')
        self.scene.show_scene(c.screen().scene)
        trial = c.trial
        if trial is not None:
            of = f"trial {trial.number} of {len(c.plan.trials)}"
            again = " &nbsp; familiarisation" if trial.familiarisation else ""
            self.now.setText(f"<b>{escape(trial.block)}</b> &nbsp; {of}{again}")
        self.timers.setText(self._times())
        coming = c.coming
        told = "nothing more" if coming is None else f"{coming.number}, {coming.block}"
        rest = coming.rest_before_s if coming is not None else 0.0
        self.coming.setText(f"Next: {told}" + (f", after {rest:g} s of rest" if rest else ""))
        colour = self.theme.alarm
        advice = (f'<p style="color:{colour}">{escape(a)}</p>' for a in c.advice[:3])
        self.advice.setText("".join(advice))
        self.said.setText(c.said)
        for bar, gauge in zip(self.gauges, c.source.gauges(), strict=False):
            bar.gauge = gauge
            bar.update()
        self._list_trials()
        self._list_events()
        self.buttons["Pause"].setText("Go on (P)" if c.paused or c.phase == HELD else "Pause (P)")
        switches = task_named(trial.task, "plan").switches if trial is not None else ()
        self.buttons["Recentre"].setVisible("recentre" in switches)
        number = self.chosen.number if self.chosen is not None else ""
        for what in ("Repeat trial", "Skip trial"):
            self.buttons[what].setText(f"{what} {number}".strip())
        for button in self.buttons.values():
            button.setEnabled(c.phase != OVER)

    def _word(self) -> str:
        c = self.conductor
        if (
            self.board is not None
            and self.stop_asked_s
            and self.stop_unconfirmed(self.board.state())
        ):
            return "STOP IS NOT CONFIRMED: SWITCH THE BOARD'S POWER OFF"
        if c.phase == OVER and c.error is not None:
            return f"ENDED: {c.error}"
        if c.phase == OVER:
            return f"STOPPED: {c.reason}" if c.reason else "DONE"
        if c.phase != RUNNING:
            return WORDS[c.phase]
        if not c.paused:
            return "RUNNING"
        holds = c.trial is not None and "pause" in task_named(c.trial.task, "plan").switches
        return "PAUSED" if holds else "RUNNING, pause after this trial"

    def _colour(self) -> str:
        c = self.conductor
        if c.phase == OVER:
            return self.theme.alarm if c.reason or c.error else self.theme.good
        return self.theme.measured if c.phase == RUNNING else self.theme.wanted

    def _times(self) -> str:
        c = self.conductor
        parts = [f"session {_minutes(c.source.now_s())}"]
        if c.phase == RESTING:
            parts.append(f"rest: {c.rest_left_s:.0f} s left")
        elif c.phase == RUNNING and c.trial is not None:
            parts.append(f"trial {c.trial_s:.1f} s of at most {c.longest_s(c.trial):g} s")
        if c.source.status():
            parts.append(f"board {c.source.status()}")
        return "   |   ".join(parts)

    def _list_trials(self) -> None:
        c = self.conductor
        for row, t in enumerate(c.plan.trials):
            now = c.states[t.number], c.reasons.get(t.number, "")
            if self._drawn.get(row) == now:
                continue
            self._drawn[row] = now
            colour = getattr(self.theme, BY_STATE.get(now[0], "soft"))
            for item, text in zip(self._changing[row], now, strict=True):
                item.setText(text)
                item.setToolTip(plain_tip(text))
                item.setForeground(QColor(colour))
            if now[0] == RUNNING:
                self.trials.scrollToItem(self._changing[row][0])

    def _list_events(self) -> None:
        lines = [f"{_minutes(t)}  {text}" for t, text in list(self.conductor.happened)[-60:]]
        if lines != [self.happened.item(i).text() for i in range(self.happened.count())]:
            self.happened.clear()
            self.happened.addItems(lines)
            self.happened.scrollToBottom()

    def set_theme(self, theme: Theme) -> None:
        super().set_theme(theme)
        self.scene.set_dark(theme is DARK)
        self._drawn.clear()
        for bar in self.gauges:
            bar.theme = theme
        self.refresh()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Who closes the operator's window stops the session."""
        if not self.conductor.over:
            self.stop()
        if self.stopper is not None:
            self.stopper.close()
        super().closeEvent(event)


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
