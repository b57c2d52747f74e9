"""The operator's window: progress, next trials, device, STOP."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from html import escape

from PySide6.QtCore import Qt
from PySide6.QtGui import QCloseEvent, QColor
from PySide6.QtWidgets import (
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QListWidget,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
)

from esea_host.connection import ConnectedDevice
from esea_host.study.conductor import HELD, OVER, RESTING, Conductor
from esea_host.study.plan import PlannedTrial
from esea_host.study.protocol import group_decides
from esea_host.study.session import RUNNING
from esea_host.study.source import Gauge
from esea_host.study.task import task_named
from esea_host.study.words import KeyedText, Words, keyed
from esea_host.windows.bar import StepButton
from esea_host.windows.feed import StopSender
from esea_host.windows.frame import Job, StopWindow, column_of, row_of
from esea_host.windows.study.adverse import AdversePanel
from esea_host.windows.study.scene_view import SceneView
from esea_host.windows.theme import DARK, LIGHT, Theme, plain_label, plain_tip

TURN_MS, MOST_READOUTS = 100, 4
COLUMNS = ("", "state", "block", "task", "condition", "reason")
IN_BAR = ("pause", "recentre", "open")
REASONED = ("note", "repeat_this_trial", "repeat_block", "skip_this_trial")
BY_STATE = {"completed": "good", "running": "measured", "failed": "alarm", "aborted": "alarm"}


class OperatorWindow(StopWindow):
    """A window on a :class:`Conductor`: it reads, and commands run beside it."""

    def __init__(
        self,
        conductor: Conductor,
        words: Words,
        board: ConnectedDevice | None = None,
        dark: bool = False,
    ) -> None:
        super().__init__(words("operator.stop"), words("operator.escape_closed"))
        self.conductor, self.words, self.board = conductor, words, board
        self.stopper = StopSender(board) if board is not None else None
        study = conductor.study
        # A rehearsal is nobody's: it has no group.
        rehearsal = "rehearsal" in conductor.banner
        self.group = "" if rehearsal else study.group_shown(conductor.code, "operator")
        self._blind = study.blinded("operator")
        number, name = conductor.number + 1, conductor.plan.session_name
        who = words("operator.who", code=conductor.code, number=number, name=name)
        if self.group:
            group = words("operator.blinded") if self._blind else self.group
            who = words("operator.group", who=who, group=group)
        banner = words(f"banner.{conductor.banner}") if conductor.banner else ""
        self.bar.mark(banner, who)
        self.setWindowTitle(" - ".join(filter(None, (banner, who, "esea-host"))))
        self._build()
        self._actions()
        self.set_theme(DARK if dark else LIGHT)
        self.timer.timeout.connect(self.refresh)
        self.timer.start(TURN_MS)

    # -- what there is -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.now, self.timers, self.coming = QLabel(), plain_label(), plain_label()
        # A reason may be long: it must not widen the window.
        for label in (self.now, self.timers, self.coming):
            label.setWordWrap(True)
        self.scene = SceneView(self.words)
        self.scene.setMinimumSize(200, 160)
        self.adverse = AdversePanel(self.conductor, self.words)
        self._build_trials()
        middle = row_of((column_of(self.adverse, (self.trials, 1)), 3), (self._side(), 2))
        self.fill(column_of((middle, 1), self._build_steps()))
        self.trials.setFocus()  # not where keys are letters

    def _side(self) -> QVBoxLayout:
        self.happened = QListWidget()
        self.happened.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        labels = self.now, self.timers, self.coming
        return column_of((self.scene, 3), *labels, (self.happened, 2))

    def _caption(self, g: Gauge) -> str:
        words = self.words
        name = " ".join(words.or_same("gauge", part) for part in g.name.split())
        ends = (words.format_field(x, ".3g") for x in (g.low, g.high))
        return f"{name} [{words.or_same('gauge', g.unit)}]\n{' … '.join(ends)}"

    def _build_trials(self) -> None:
        plan, words = self.conductor.plan, self.words
        self.trials = QTableWidget(len(plan.trials), len(COLUMNS))
        titles = [words(f"operator.{name}") if name else "" for name in COLUMNS]
        self.trials.setHorizontalHeaderLabels(titles)
        self.trials.setAccessibleName(", ".join(filter(None, titles)))
        self.trials.verticalHeader().hide()
        self.trials.verticalHeader().setDefaultSectionSize(24)
        self.trials.setSelectionBehavior(QTableWidget.SelectionBehavior.SelectRows)
        self.trials.setSelectionMode(QTableWidget.SelectionMode.SingleSelection)
        self.trials.setWordWrap(False)
        self.trials.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self._changing = [(QTableWidgetItem(), QTableWidgetItem()) for _ in plan.trials]
        for row, t in enumerate(plan.trials):
            task, short = task_named(t.task, "plan"), t.task.rpartition(".")[2] + self._details(t)
            told = (str(t.number), t.block, short, self._condition(t))
            items = [QTableWidgetItem(text) for text in told]
            state, reason = self._changing[row]
            for k, item in enumerate((items[0], state, *items[1:], reason)):
                item.setToolTip(plain_tip(words.texts.get(f"task.{t.task}", task.title)))
                self.trials.setItem(row, k, item)
        header = self.trials.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(len(COLUMNS) - 1, QHeaderView.ResizeMode.Stretch)
        self._drawn: dict[int, tuple[str, str]] = {}

    def _details(self, trial: PlannedTrial) -> str:
        # What differs within a block tells nothing of the group.
        block = [t for t in self.conductor.plan.trials if t.block == trial.block]
        differ = [k for k in trial.parameters if len({str(t.parameters[k]) for t in block}) > 1]
        said = ", ".join(f"{k} {self.words.format_field(trial.parameters[k], '')}" for k in differ)
        catch = f" {self.words('operator.catch')}" if trial.catch else ""
        return (f": {said}" if said else "") + catch

    def _hides(self, trial: PlannedTrial) -> bool:
        # A condition that the group decides would tell the group.
        file = self.conductor.study.protocol.file
        return self._blind and group_decides(file, self.conductor.number, trial.block)

    def _condition(self, trial: PlannedTrial) -> str:
        return self.words("operator.hidden") if self._hides(trial) else trial.condition

    def _build_steps(self) -> QHBoxLayout:
        # What a reason is written for stands beside where it is written.
        self.written = QLineEdit()
        self.written.setPlaceholderText(self.words("operator.write_here"))
        self.written.returnPressed.connect(self.note)
        jobs: dict[str, tuple[str, Job]] = {
            "operator.pause": ("P", self.pause),
            "operator.recentre": ("R", self.conductor.recentre),
            "adverse.open": ("E", self.adverse.open),
            "operator.note": ("N", self.note),
            "operator.repeat_this_trial": ("Ctrl+R", self.repeat),
            "operator.repeat_block": ("Ctrl+B", self.repeat_block),
            "operator.skip_this_trial": ("Ctrl+K", self.skip),
        }
        self.buttons = {
            key.partition(".")[2]: StepButton(self.words(key), *job) for key, job in jobs.items()
        }
        for name in IN_BAR:
            self.bar.add_step(name, self.buttons[name])
        return row_of((self.written, 1), *(b for n, b in self.buttons.items() if n not in IN_BAR))

    def _actions(self) -> None:
        jobs: list[tuple[str, str, Job]] = [
            ("operator.stop_keys", "", self.stop),
            ("operator.pause_or_go_on", "P", self.pause),
            ("operator.recentre", "R", self.conductor.recentre),
            ("operator.note", "N", self.written.setFocus),
            ("operator.repeat_this_trial", "Ctrl+R", self.repeat),
            ("operator.repeat_block", "Ctrl+B", self.repeat_block),
            ("operator.skip_this_trial", "Ctrl+K", self.skip),
            ("adverse.title", "E", self.adverse.open),
            ("operator.dark_light", "T", self.toggle_theme),
            ("operator.close", "Ctrl+W", self.close),
        ]
        named = [(self.words(key), keys, job) for key, keys, job in jobs]
        self.add_menu(self.words("operator.menu"), named)

    # -- asking ------------------------------------------------------------------------------------

    def stop(self) -> None:
        if self.stopper is not None:
            self.stopper.stop()
            self.stop_asked_s = time.monotonic()
        self.conductor.stop(keyed("reason.operator_stop"))

    def pause(self) -> None:
        self.conductor.pause(not self.conductor.paused and self.conductor.phase != HELD)

    def note(self) -> None:
        if text := self._written():
            self.conductor.note(text)

    def _written(self) -> str:
        text = self.written.text().strip()
        self.written.clear()
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
        c, words = self.conductor, self.words
        self._tell()
        scene, trial = c.screen().scene, c.trial
        hides = trial is not None and self._hides(trial)
        self.scene.show_scene(replace(scene, shapes=()) if hides else scene)
        if trial is not None:
            of = words("operator.trial", number=trial.number, count=len(c.plan.trials))
            again = words("operator.familiarisation") if trial.familiarisation else ""
            self.now.setText(f"<b>{escape(trial.block)}</b> &nbsp; {of} &nbsp; {again}")
        self.timers.setText(self._times())
        self.coming.setText(self._next())
        for gauge in c.source.gauges()[:MOST_READOUTS]:
            value = words.format_field(gauge.value, ".1f" if gauge.unit == "deg" else ".2f")
            colour = self.theme.alarm if gauge.near else ""
            self.bar.show_value(gauge.name, value, self._caption(gauge), colour)
        self._list_trials()
        self._list_events()
        waits = c.paused or c.phase == HELD
        names = {"pause": words("operator.go_on" if waits else "operator.pause")}
        switches = task_named(trial.task, "plan").switches if trial is not None else ()
        self.buttons["recentre"].setVisible("recentre" in switches)
        if self.chosen is not None:
            for what in ("repeat", "skip"):
                text = words(f"operator.{what}_trial", number=self.chosen.number)
                names[f"{what}_this_trial"] = text
        self._refuse(names)
        self.adverse.stop_trial.setEnabled(c.phase == RUNNING)
        self.adverse.look()

    def _refuse(self, names: Mapping[str, str]) -> None:
        # Each button that would do nothing tells why.
        c, words = self.conductor, self.words
        over = words("operator.is_over") if c.phase == OVER else ""
        reason = "" if self.written.text().strip() else words("operator.needs_reason")
        for name, button in self.buttons.items():
            given = reason if name in REASONED else ""
            button.refuse("" if name == "open" else over or given, names.get(name, ""))

    def _tell(self) -> None:
        c, words = self.conductor, self.words
        word, _, why = self._word().partition(": ")
        self.bar.show_state(word, self._role())
        advice = [words.of(a) for a in c.advice[:3]]
        told = "\n".join(filter(None, (why, *advice)))
        self.bar.tell(told or self._next(), self.theme, alarm=bool(told), said=words.of(c.said))

    def _word(self) -> str:
        c, words = self.conductor, self.words
        if self.board and self.stop_asked_s and self.stop_unconfirmed(self.board.state()):
            return words("operator.not_confirmed")
        if c.phase == OVER and c.error is not None:
            return words("operator.ended", reason=str(c.error))
        if c.phase == OVER:
            return words("operator.stopped" if c.reason else "operator.done", reason=c.reason)
        if c.phase != RUNNING:
            return words(f"operator.{c.phase}")
        if not c.paused:
            return words("operator.running")
        holds = c.trial is not None and "pause" in task_named(c.trial.task, "plan").switches
        return words("operator.paused" if holds else "operator.running_to_pause")

    def _role(self) -> str:
        c = self.conductor
        if c.phase == OVER:
            return "alarm" if c.reason or c.error else "good"
        return "moving" if c.phase == RUNNING else "caution" if c.phase == HELD else "rest"

    def _times(self) -> str:
        c, words = self.conductor, self.words
        parts = [words("operator.session_time", time=_minutes(c.source.now_s()))]
        if c.phase == RESTING:
            parts.append(words("operator.rest_time", seconds=c.rest_left_s))
        elif c.phase == RUNNING and c.trial is not None:
            times = {"now_s": c.trial_s, "longest_s": c.longest_s(c.trial)}
            parts.append(words("operator.trial_time", **times))
        if c.source.status():
            parts.append(words.or_same("board", c.source.status()))
        return "   |   ".join(parts)

    def _next(self) -> str:
        coming, words = self.conductor.coming, self.words
        if coming is None:
            return words("operator.nothing_next")
        about = {"number": coming.number, "block": coming.block}
        if coming.rest_before_s:
            return words("operator.next_after_rest", **about, seconds=coming.rest_before_s)
        return words("operator.next", **about)

    def _list_trials(self) -> None:
        c = self.conductor
        for row, t in enumerate(c.plan.trials):
            now = c.states[t.number], c.reasons.get(t.number, "")
            if self._drawn.get(row) == now:
                continue
            self._drawn[row] = now
            colour = getattr(self.theme, BY_STATE.get(now[0], "soft"))
            shown = self.words.or_same("state", now[0]), self.words.of(now[1])
            for item, text in zip(self._changing[row], shown, strict=True):
                item.setText(text)
                item.setToolTip(plain_tip(text))
                item.setForeground(QColor(colour))
            if now[0] == RUNNING:
                self.trials.scrollToItem(self._changing[row][0])

    def _list_events(self) -> None:
        found = list(self.conductor.happened)[-60:]
        lines = [f"{_minutes(t)}  {self._event(text)}" for t, text in found]
        if lines != [self.happened.item(i).text() for i in range(self.happened.count())]:
            self.happened.clear()
            self.happened.addItems(lines)
            self.happened.scrollToBottom()

    def _event(self, text: str) -> str:
        # What the session tells, or the name of a task's own event.
        known = isinstance(text, KeyedText)
        return self.words.of(text) if known else self.words.or_same("event", text)

    def set_theme(self, theme: Theme) -> None:
        super().set_theme(theme)
        self.scene.set_dark(theme is DARK)
        self._drawn.clear()
        self.adverse.show_theme(theme)
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
