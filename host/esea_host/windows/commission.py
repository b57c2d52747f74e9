"""Guided screens of a commissioning: steps on the left, instruction and result beside."""

from __future__ import annotations

import contextlib
import html
import io
import threading
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread
from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QCloseEvent, QImage, QKeyEvent, QPixmap
from PySide6.QtWidgets import QLabel, QListWidget

from esea_host.commissioning import (
    CommissioningBench,
    CommissioningEndedError,
    CommissioningRecord,
    CommissioningStep,
    HandAct,
    StepOptions,
    StepResult,
    guide,
    run_step,
)
from esea_host.commissioning.bench import TURN_S
from esea_host.commissioning.record import done_at
from esea_host.windows import frame
from esea_host.windows.bar import StepButton
from esea_host.windows.feed import StopSender
from esea_host.windows.meanings import CLEAR, NEXT, RELEASE, ROLES, refusals
from esea_host.windows.theme import DARK, LIGHT, Theme

LOOK_MS, MARGIN_PX, FIGURE_DPI = 200, 24, 80
STANDS = ("STOPPING", "STOPPED", "FAULT")


class CommissioningWindow(frame.StopWindow):
    """Each step runs in a thread; unless simulated, the bench asks this window."""

    # From the thread that works to the one that draws.
    said, asked, ended = Signal(str), Signal(str), Signal(object)

    def __init__(
        self,
        bench: CommissioningBench,
        steps: tuple[CommissioningStep, ...],
        options: StepOptions,
        record: CommissioningRecord,
        dark: bool = False,
    ) -> None:
        super().__init__()
        self.bench, self.steps, self.options, self.record = bench, steps, options, record
        self.result: StepResult | None = None
        self.done: dict[str, StepResult] = {}
        self._thread: threading.Thread | None = None
        self._go_on, self._answer = threading.Event(), record.notice()
        self.said.connect(self._show_said)
        self.asked.connect(self._show_asked)
        self.ended.connect(self._show_ended)
        # A board whose clock the steps move is stopped by the step; else past all that waits.
        self._stopper = None if bench.hands_free else StopSender(bench.device)
        bench.say = self.said.emit
        if not bench.hands_free:
            bench.change_hands(self._wait_for_person)
        kind = "SIMULATED" if bench.device.simulated else ""
        who = f"{bench.board.name}: commissioning"
        self.setWindowTitle(f"{kind} {who} - esea-host".strip())
        self.bar.mark(kind, who)
        self._build()
        self.set_theme(DARK if dark else LIGHT)
        self.timer.timeout.connect(self.refresh)
        self.timer.start(LOOK_MS)
        self.refresh()

    def _build(self) -> None:
        self.list = QListWidget()
        self.list.setAccessibleName("Steps")
        self.list.currentRowChanged.connect(self._choose)
        self.head, self.text, self.picture = QLabel(), QLabel(), QLabel()
        for label in (self.head, self.text):
            label.setWordWrap(True)
            label.setTextFormat(Qt.TextFormat.RichText)
        self.picture.setAlignment(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft)
        self.start_button = StepButton("Start", "S", self.start)
        self.ready_button = StepButton("Done, continue", "Return", self.go_on)
        for made in (self.start_button, self.ready_button):
            self.bar.add_step(made.name, made)
        device = self.bench.device
        for name, job in ((RELEASE, device.release), (CLEAR, device.clear)):
            self.bar.add_step(name, StepButton(name, "", partial(self._command, name, job)))
        self.add_menu("&View", [("Dark, light", "T", self.toggle_theme)])
        self.add_menu("&Board", [(frame.STOP_NAME, "", self.stop)])
        right = frame.column_of(self.head, self.text, (self.picture, 1))
        self.fill(frame.row_of(self.list, (right, 1)), reads=True)
        self.list.addItems([s.title for s in self.steps])
        self._rename()
        self.list.setCurrentRow(0)

    def set_theme(self, theme: Theme) -> None:
        super().set_theme(theme)
        if not self.busy:
            self._choose(0)

    @property
    def step(self) -> CommissioningStep:
        return self.steps[max(0, self.list.currentRow())]

    @property
    def busy(self) -> bool:
        return self._thread is not None

    def _rename(self) -> None:
        for i, step in enumerate(self.steps):
            entry = self.record.last(step.name, self.bench.board.digest)
            mark = "  " if entry is None else "✓ " if entry["passed"] else "✗ "
            word = "" if entry is None else "  passed" if entry["passed"] else "  FAILED"
            self.list.item(i).setToolTip("" if entry is None else done_at(entry))
            self.list.item(i).setText(f"{mark}{i + 1}. {step.title}{word}")
        self.list.setFixedWidth(self.list.sizeHintForColumn(0) + MARGIN_PX)

    def _choose(self, _: int) -> None:
        step = self.step
        motor = " <b>The motor moves.</b>" if step.motor else ""
        self.head.setText(f"<h2>{step.title}</h2>{step.finds[:1].upper()}{step.finds[1:]}.{motor}")
        result = self.done.get(step.name)
        self.text.setText("")
        self.picture.clear()
        if result is not None:
            self._show_result(result)
        elif self.list.currentRow() == 0:
            lines = "<br>".join(html.escape(x) for x in guide(self.bench.board))
            self.text.setText(f'<span style="color:{self.theme.soft}">{lines}</span>')
        self._enable()

    def _enable(self, asking: bool = False) -> None:
        lacks = self.step.lacks(self.options)
        self.start_button.refuse("runs" if self.busy else "see below" if lacks else "")
        self.ready_button.refuse("" if asking else "nothing to do")
        self.list.setEnabled(not self.busy)
        if lacks:
            self.text.setText(f"Start again with {lacks} to do this one.")

    # -- a step ----------------------------------------------------------------------------------

    def start(self) -> None:
        if self.busy or not self.start_button.isEnabled():
            return
        self.picture.clear()
        self.text.setText("")
        step = self.step
        self._thread = threading.Thread(
            target=self._work, args=(step,), name="esea-commission", daemon=True
        )
        self._enable()
        self._thread.start()

    def _work(self, step: CommissioningStep) -> None:
        try:
            result = run_step(self.bench, step, self.options)
            self.record.add(result, self.bench.device)
        except Exception as error:
            if isinstance(error, CommissioningEndedError):
                with contextlib.suppress(Exception):
                    self.bench.device.stop(again=True)
            self.ended.emit(error)
        else:
            self.ended.emit(result)

    def _wait_for_person(self, act: HandAct) -> None:
        self._go_on.clear()
        self.asked.emit(act.text)
        while not self._go_on.wait(0.05):
            if self.bench.cancelled:
                return

    def go_on(self) -> None:
        if not self.ready_button.isEnabled():
            return
        self.ready_button.refuse("nothing to do")
        self._go_on.set()

    def stop(self) -> None:
        """End the step that runs, and stop the motor; returns at once."""
        if self._stopper is not None:
            self._stopper.stop()
            self.stop_asked_s = time.monotonic()
        self.bench.cancel()

    def _command(self, name: str, job: Callable[[], None]) -> None:
        # No step runs, and the motor is off: nothing has to be stopped meanwhile.
        try:
            job()
            self.bench.pass_time(5 * TURN_S)
            self._answer = name
        except Exception as error:
            self._answer = f"{name}: {error}"

    # -- shown -----------------------------------------------------------------------------------

    def refresh(self) -> None:
        """The state by the heartbeat that came last: a running step holds the board."""
        session = self.bench.device.session
        state = session.state() if session.heartbeat is not None else "UNKNOWN"
        self.bar.show_state(state, ROLES.get(state, "rest"))
        reasons = refusals(state)
        for name in (RELEASE, CLEAR):
            self.bar.steps[name].refuse("a step runs" if self.busy else reasons[name])
        alarm = frame.NOT_CONFIRMED if self.stop_unconfirmed(state) else ""
        receiver = self.bench.device.receiver
        if receiver.away and not alarm:
            alarm = f"{receiver.away_text()}. Last state: {state}."
        words = alarm or NEXT.get(state if state in STANDS else "", "") or self._next()
        self.bar.tell(words, self.theme, alarm=bool(alarm), said=self._answer)

    def _next(self) -> str:
        if self.ready_button.isEnabled():
            return "Next: follow the steps below, then Done."
        if self.busy:
            return f"{self.step.title} runs; STOP ends it."
        return f"Next: Start {self.step.title}." if self.start_button.isEnabled() else ""

    def _show_asked(self, text: str) -> None:
        self._show_said(text)
        self._enable(asking=True)

    def _show_said(self, text: str) -> None:
        self.text.setText(f'<p style="font-size:17px">{html.escape(text)}</p>')

    def _show_ended(self, end: object) -> None:
        if self._thread is not None:
            self._thread.join()
        self._thread = None
        if isinstance(end, StepResult):
            self.done[end.step] = end
            self._show_result(end)
        else:
            said = html.escape(str(end))
            self.text.setText(f'<p style="color:{self.theme.alarm}; font-size:17px">{said}</p>')
        self._rename()
        self._enable()

    def _show_result(self, result: StepResult) -> None:
        colour = self.theme.good if result.passed else self.theme.alarm
        first, *rest = (html.escape(x) for x in result.lines(self.bench.device.simulated))
        more = "<br>".join(x.replace("  ", "&nbsp;&nbsp;") for x in rest)
        self.text.setText(f'<p style="color:{colour}; font-size:17px"><b>{first}</b></p>{more}')
        self.picture.setPixmap(self._drawn(result.picture))

    def _drawn(self, figure: Figure) -> QPixmap:
        # As it is printed; on a dark ground the lightness is turned over, and hues stay.
        drawn, scale = io.BytesIO(), self.devicePixelRatioF()
        figure.savefig(drawn, format="png", dpi=FIGURE_DPI * scale)
        drawn.seek(0)
        pixels = imread(drawn)[..., :3]
        if self.theme is DARK:
            pixels += 1 - pixels.max(-1, keepdims=True) - pixels.min(-1, keepdims=True)
            ground = np.array([*bytes.fromhex(DARK.ground[1:])]) / 255
            pixels = ground + pixels * (1 - ground)
        height, width, _ = pixels.shape
        data = (255 * pixels).round().astype(np.uint8).tobytes()
        picture = QPixmap(QImage(data, width, height, 3 * width, QImage.Format.Format_RGB888))
        picture.setDevicePixelRatio(scale)
        return picture

    # -- keys ------------------------------------------------------------------------------------

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """S starts, Return goes on, whatever has the focus."""
        if event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent):
            keys = Qt.Key
            jobs = {keys.Key_S: self.start, keys.Key_Return: self.go_on, keys.Key_Enter: self.go_on}
            job = jobs.get(keys(event.key()))
            if job is not None and not event.isAutoRepeat():
                job()
            if job is not None:
                return True
        return super().eventFilter(watched, event)

    def closeEvent(self, event: QCloseEvent) -> None:
        """A step that runs is ended first."""
        if self.busy:
            self.stop()
            assert self._thread is not None
            self._thread.join(3.0)
        if self._stopper is not None:
            self._stopper.close()
        super().closeEvent(event)


def run_commissioning(
    bench: CommissioningBench,
    steps: tuple[CommissioningStep, ...],
    options: StepOptions,
    record: CommissioningRecord,
) -> None:
    window = CommissioningWindow(bench, steps, options, record, frame.qt_application())
    frame.run_until_closed(window, size_px=(1180, 860))
