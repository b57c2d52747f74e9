"""Session in its own thread, with an interface for windows and operators.

All requests run in the session's thread, so that one thread writes the log.  Windows read
attributes that are replaced atomically; no window can block the session.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_host.study.edge import longest_trial_s
from esea_host.study.folder import StudyFolder
from esea_host.study.plan import PlannedTrial
from esea_host.study.scene import Scene, Text
from esea_host.study.session import ABORTED, PENDING, RUNNING, SessionState, StudySession
from esea_host.study.source import SessionWatcher, TrialOnly
from esea_host.study.task import TaskStep
from esea_host.study.words import keyed

STARTING, RESTING, PAUSED, HELD, OVER = "starting", "resting", "paused", "held", "over"
MOST_HAPPENED = 200
PIECE_S = 0.02  # so long at most nobody hears a stop
LATE_S = 0.25  # who is later than that does not hurry to catch up


@dataclass(frozen=True)
class ShownScene:
    """A scene for a screen; made_s, tick_s (of its sample): by the host's monotonic clock."""

    scene: Scene
    number: int = 0
    onsets: int = 0
    made_s: float = 0.0
    tick_s: float | None = None


def appears(before: Scene, now: Scene) -> bool:
    """Whether something is there that was not: a shape of a role, or a text."""

    def roles(scene: Scene) -> set[str]:
        return {s.role for s in scene.shapes} | {f"text {t.key}" for t in scene.texts}

    return bool(roles(now) - roles(before))


def _no_times() -> dict[str, list[float]]:
    return {"interval": [], "onset_delay": [], "tick_to_frame": []}


def summary(times_s: Mapping[str, Sequence[float]], refresh_Hz: float) -> dict[str, Any]:
    found: dict[str, Any] = {"refresh_Hz": refresh_Hz, "intervals": len(times_s["interval"])}
    refreshes = np.round(np.asarray(times_s["interval"], np.float64) * refresh_Hz)
    found["dropped"] = int(np.sum(np.maximum(refreshes - 1, 0)))
    for name, values in times_s.items():
        for share in (50, 95, 99, 100):
            ms = float(np.percentile(values, share)) * 1e3 if len(values) else None
            found[f"{name}_p{share}_ms"] = ms if ms is None else round(ms, 3)
    return found | {"onsets": len(times_s["onset_delay"])}


class FrameTimes:
    """When Qt painted, by the host's clock; light on the screen needs a photodiode."""

    def __init__(self, refresh_Hz: float) -> None:
        self.refresh_Hz = refresh_Hz
        self.facts: dict[str, Any] = {}
        self._last_s: float | None = None
        self._onsets, self._tick_s = 0, -math.inf
        self._trial, self._all = _no_times(), _no_times()

    def painted(self, at_s: float, onsets: int, made_s: float, tick_s: float | None = None) -> bool:
        """A frame was painted; whether something appeared with it."""
        if tick_s is not None and tick_s > self._tick_s:
            self._trial["tick_to_frame"].append(at_s - tick_s)
            self._tick_s = tick_s
        if self._last_s is not None:
            self._trial["interval"].append(at_s - self._last_s)
        self._last_s = at_s
        new = onsets > self._onsets
        if new and made_s > 0:
            self._trial["onset_delay"].append(at_s - made_s)
        self._onsets = onsets
        return new

    def take(self, whole: bool) -> dict[str, Any]:
        """Numbers since the last call, or (whole) of every trial so far."""
        if whole:
            return summary(self._all, self.refresh_Hz) | self.facts
        taken, self._trial = self._trial, _no_times()
        for name, new in taken.items():
            self._all[name] += new
        return summary(taken, self.refresh_Hz)

    def drop(self) -> None:
        self._trial, self._last_s = _no_times(), None


class Conductor(SessionWatcher):
    """speed: simulated time over the clock's; hold: wait after a poor calibration."""

    def __init__(
        self, study: StudyFolder, session: StudySession, speed: float = 1.0, hold: bool = False
    ) -> None:
        super().__init__()
        self.study, self.source, self.speed, self.hold = study, session.source, speed, hold
        self._session, self.plan = session, session.state.plan
        self.code, self.number = session.state.participant, self.plan.session
        simulated = session.state.simulated or study.simulated
        marks = {"rehearsal": session.state.rehearsal, "simulated": simulated}
        # Both windows show it all the time.
        self.banner = "_".join(m for m, on in marks.items() if on)
        self.states: Mapping[int, str] = dict(session.state.states)
        self.reasons: Mapping[int, str] = dict(session.state.reasons)
        self.phase, self.trial, self.trial_s = STARTING, None, 0.0
        self.shown, self.rest_until_s = ShownScene(Scene()), 0.0
        self.advice: tuple[str, ...] = ()
        self.said, self.reason = "", ""
        self.error: Exception | None = None
        self.happened: deque[tuple[float, str]] = deque(maxlen=MOST_HAPPENED)
        self.display: FrameTimes | None = None
        self._begun_s = 0.0
        self.paused = False
        self._pause_told = False
        self._recentre = False
        self._stopped, self._again = "", TrialOnly()
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._remarks: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="esea-session", daemon=True)

    trial: PlannedTrial | None

    # -- asked from outside ------------------------------------------------------------------------

    def start(self) -> None:
        self._thread.start()

    def join(self, timeout_s: float | None = None) -> None:
        self._thread.join(timeout_s)

    @property
    def state(self) -> SessionState:
        """State from the log; while the session runs, as of the last read."""
        return self._session.state

    @property
    def over(self) -> bool:
        return self.phase == OVER

    def stop(self, reason: str) -> None:
        """End the running trial and the session; returns at once."""
        self._stopped = self._stopped or reason

    def pause(self, on: bool) -> None:
        """Pause the task if it can pause, else the session after this trial; or resume."""
        self.paused = on
        if not on and self.phase == HELD:
            self.phase = PAUSED

    def recentre(self) -> None:
        self._recentre = True

    def note(self, text: str) -> None:
        self._remarks.put(partial(self._session.note, text))
        self._tell(keyed("happened.note", text=text))

    def hold_now(self) -> None:
        """End the running trial, if any, and wait: it comes again once the session goes on."""
        self.paused = True
        self._abort(set(self.states), keyed("reason.adverse"))

    def adverse(self, severity: str, relation: str, action: str, text: str) -> None:
        """On the study's record when this returns, whatever the session does."""
        about = {"participant": self.code, "session": self.number}
        about |= {"trial": self.trial.number if self.trial else None}
        about |= {"rehearsal": True} if self.state.rehearsal else {}
        said = {"severity": severity, "relation": relation, "action": action, "text": text}
        self.study.record("adverse", **about, **said)
        self._remarks.put(partial(self._session.say, "adverse", severity=severity))
        self._tell(keyed("happened.adverse", severity=keyed(f"adverse.{severity}")))
        self.said = keyed("adverse.recorded")

    def skip(self, number: int, reason: str) -> None:
        """Leave a trial out; one that runs is aborted first."""
        if self._needs_reason(keyed("operator.not_skipped", number=number), reason):
            self._abort({number}, reason)
            self._jobs.put(partial(self._session.skip, number, reason))

    def repeat(self, number: int, reason: str) -> None:
        """Repeat a trial; a running one is aborted and restarted."""
        if self._needs_reason(keyed("operator.not_repeated", number=number), reason):
            self._repeat({number}, reason)

    def repeat_block(self, block: str, reason: str) -> None:
        """Have all trials of a block again that have been run."""
        if self._needs_reason(keyed("operator.block_not_repeated", block=block), reason):
            self._repeat({t.number for t in self.plan.trials if t.block == block}, reason)

    def _needs_reason(self, what: str, reason: str) -> bool:
        self.said = "" if reason else what
        return bool(reason)

    def _repeat(self, numbers: set[int], reason: str) -> None:
        running = self._abort(numbers, reason)
        again = [n for n in sorted(numbers) if n != running and self.states[n] != PENDING]
        if not again and running is None:
            self.said = keyed("operator.nothing_run")
        for number in again:
            self._jobs.put(partial(self._session.repeat, number, reason))

    def _abort(self, numbers: set[int], reason: str) -> int | None:
        running = next((n for n, s in self.states.items() if s == RUNNING), None)
        if running not in numbers:
            return None
        self._again = TrialOnly(reason)
        return running

    # -- what the participant sees -----------------------------------------------------------------

    def screen(self) -> ShownScene:
        words = {STARTING: "wait", PAUSED: "paused", HELD: "paused"}
        if self.phase == OVER:
            words[OVER] = "stopped" if self.reason or self.error else "thanks"
        if self.phase == RESTING:
            text = Text("rest", {"seconds": self.rest_left_s})
        elif self.phase in words:
            text = Text(words[self.phase])
        else:
            return self.shown
        return ShownScene(Scene((), (text,)), self.shown.number, self.shown.onsets)

    @property
    def rest_left_s(self) -> float:
        speed = self.speed if math.isfinite(self.speed) else 1.0
        return max(0.0, (self.rest_until_s - time.monotonic()) * speed)

    @property
    def coming(self) -> PlannedTrial | None:
        left = (t for t in self.plan.trials if self.states[t.number] in (PENDING, "aborted"))
        return next((t for t in left if t is not self.trial), None)

    def longest_s(self, trial: PlannedTrial) -> float:
        task, parameters = trial.asked()
        return longest_trial_s(task, parameters)

    # -- in the session's thread -------------------------------------------------------------------

    def _run(self) -> None:
        session = self._session
        try:
            self.reason = session.run(watcher=self)
            self._write_remarks()
            if self.display is not None:
                session.say("display", trial=None, **self.display.take(True))
            self.study.finish(session)
        except Exception as error:
            # A full disk, for one; whoever holds the conductor sees it.
            self.error = error
        finally:
            session.close()
            self.phase = OVER

    def pressed(self) -> Mapping[str, float]:
        found = {"pause": 1.0} if self.paused else {}
        if self._recentre:
            self._recentre = False
            found["recentre"] = 1.0
        return found

    def _wait(self, until_s: float) -> None:
        while (left_s := until_s - time.monotonic()) > 0 and not self.turn():
            time.sleep(min(left_s, PIECE_S))

    def paces(self, time_s: float) -> None:
        """Not before its time, by the clock."""
        if not math.isfinite(self.speed):
            return
        due_s = self._begun_s + time_s / self.speed
        late_s = time.monotonic() - due_s
        if late_s > LATE_S:
            self._begun_s += late_s
        self._wait(due_s)

    def turn(self) -> str:
        self._write_remarks()
        return self._stopped or self._again

    def _write_remarks(self) -> None:
        while not self._remarks.empty():
            self._remarks.get()()

    def _tell(self, text: str) -> None:
        self.happened.append((self.source.now_s(), text))

    def between(self) -> None:
        session = self._session
        while True:
            self._again = TrialOnly()
            while not self._jobs.empty():
                try:
                    self._jobs.get()()
                    self.states = dict(session.state.states)
                    self.reasons = dict(session.state.reasons)
                except UserError as error:
                    self.said = str(error)
            waits = (self.paused or self.phase == HELD) and not self.turn()
            if waits != self._pause_told:
                self._pause_told = waits
                session.say("pause" if waits else "go_on", held=self.phase == HELD)
            if not waits:
                return
            self.phase = HELD if self.phase == HELD else PAUSED
            time.sleep(PIECE_S)

    def waits(self, words: str) -> None:
        self.advice = (words,) if words else ()

    def rests(self, seconds: float, rest: Callable[[float], None]) -> None:
        self.rest_until_s = time.monotonic() + seconds / min(self.speed, 1e9)
        self.phase = RESTING
        self._tell(keyed("happened.rest", seconds=seconds))
        if math.isfinite(self.speed):
            self._wait(self.rest_until_s)
        rest(seconds)

    def breaks(self, words: str, drive: bool) -> str:
        """Wait for the operator."""
        self.advice, self.phase = (words,), HELD
        self.between()
        return ""

    def begins(self, trial: PlannedTrial) -> None:
        self.trial, self.trial_s, self.advice = trial, 0.0, ()
        self._begun_s = time.monotonic()
        self.states = {**self.states, trial.number: RUNNING}
        self.shown = ShownScene(Scene(), self.shown.number, self.shown.onsets)
        self.phase = RUNNING
        if self.display is not None:
            self.display.drop()
        self._tell(keyed("happened.trial", number=trial.number, block=trial.block))

    def steps(self, time_s: float, step: TaskStep) -> None:
        before = self.shown
        self.trial_s = time_s
        onsets = before.onsets + appears(before.scene, step.scene)
        told = time.monotonic(), self.source.tick_s()
        self.shown = ShownScene(step.scene, before.number + 1, onsets, *told)
        for event in step.events:
            if "advice" in event.data:
                self.advice = tuple(event.data["advice"] or ())
            self._tell(event.name)

    def ends(self, number: int, state: str, reason: str, row: Mapping[str, Any]) -> None:
        session = self._session
        self.states = {**self.states, number: state}
        self.reasons = {**self.reasons, number: reason}
        if self.display is not None:
            session.say("display", trial=number, **self.display.take(False))
        if self._again and state != ABORTED:  # it was over before the word was heard
            self._jobs.put(partial(session.repeat, number, str(self._again)))
        self.advice = tuple(row.get("complaints") or ())
        ended = {"number": number, "state": keyed(f"state.{state}")}
        why = keyed("happened.trial_ended_why", **ended, reason=reason)
        self._tell(why if reason else keyed("happened.trial_ended", **ended))
        if self.hold and self.advice:
            self.phase = HELD
