"""A session: runs the planned trials, writes every event, stops at once, goes on after a crash."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_host.study.edge import checked_step, finite, of_task
from esea_host.study.log import EventLog, LogFound, LoggedEvent, plain, read_log, well_formed
from esea_host.study.plan import Plan, PlannedTrial, plan_from
from esea_host.study.protocol import Stopping
from esea_host.study.scene import Scene
from esea_host.study.source import InputSource, SessionWatcher, SimulatedSource, TrialOnly
from esea_host.study.task import (
    Inputs,
    Row,
    Situation,
    StudyTask,
    TaskBrokenError,
    TaskStep,
    task_named,
)
from esea_host.study.words import keyed

PENDING, RUNNING, COMPLETED = "pending", "running", "completed"
ABORTED, FAILED = "aborted", "failed"
# What every row has, beside the columns of its task.
ABOUT = {"trial", "session", "block", "task", "condition", "catch", "familiarisation"}
ONLY_REHEARSED = "rehearsal"  # in rows that are never data
# So many samples go to disk together; an event, and the end of a trial, takes them along at once.
CHUNK = 50


@dataclass(frozen=True)
class SessionState:
    """State of a session according to its log."""

    participant: str
    plan: Plan
    states: Mapping[int, str]
    reasons: Mapping[int, str]
    running: int | None
    past: tuple[Row, ...]
    ended: str
    torn: int
    last_s: float
    simulated: bool
    rehearsal: bool
    about: Mapping[str, Any]
    content_hash: str

    @property
    def remaining(self) -> tuple[PlannedTrial, ...]:
        over = (COMPLETED, FAILED, "skipped")
        return tuple(t for t in self.plan.trials if self.states[t.number] not in over)


def read_session(path: Path) -> SessionState:
    return state_of(read_log(path).sound(path), path)


def state_of(found: LogFound, path: Path) -> SessionState:
    if not found.entries:
        raise UserError(f"{path}: the log has no complete event.", "Start the session again.")
    with well_formed(path):
        return _state_of(found)


def _state_of(found: LogFound) -> SessionState:
    head = found.entries[0].data
    plan = plan_from(head["plan"])
    states = {t.number: PENDING for t in plan.trials}
    reasons: dict[int, str] = {}
    past: list[Row] = []
    ended = ""
    for e in found.entries:
        if e.kind == "trial":
            states[e.data["trial"]], ended = RUNNING, ""
        elif e.kind == "trial_end":
            states[e.data["trial"]] = e.data["state"]
            reasons[e.data["trial"]] = e.data["reason"]
        elif e.kind == "skip":
            states[e.data["trial"]], reasons[e.data["trial"]] = "skipped", e.data["reason"]
        elif e.kind == "repeat":
            states[e.data["trial"]], reasons[e.data["trial"]] = PENDING, e.data["reason"]
        elif e.kind == "end":
            ended = e.data["reason"]
        past = _rows_after(past, e)
    for row in past:
        if lacking := ABOUT - row.keys():
            raise KeyError(f"row without {', '.join(sorted(lacking))}")
    ready = [e.data for e in found.entries if e.kind == "ready"]
    return SessionState(
        participant=head["participant"],
        plan=plan,
        states=states,
        reasons=reasons,
        running=next((n for n, s in states.items() if s == RUNNING), None),
        past=tuple(past),
        ended=ended,
        torn=len(found.torn),
        last_s=found.entries[-1].time_s,
        simulated=bool(head.get("simulated", True)),  # unmarked: never a person's
        rehearsal=bool(head.get("rehearsal")),
        about=dict(head.get("about", {})),
        content_hash=next(filter(None, (r.get("content_hash") for r in ready)), ""),
    )


def _rows_after(past: list[Row], e: LoggedEvent) -> list[Row]:
    # Rows of completed trials, once an event has happened.
    if e.kind == "trial_end" and e.data["state"] == COMPLETED:
        return [*past, e.data["row"]]
    if e.kind == "repeat":
        return [row for row in past if row["trial"] != e.data["trial"]]
    return past


class StudySession:
    """One participant's session; continues an existing log, whose plan must be the same.

    source: None to change the log only, not to run; about: what it is run with, for the record.
    seal: as of :class:`~esea_host.study.log.EventLog`.
    """

    def __init__(
        self,
        path: Path,
        plan: Plan,
        participant: str,
        source: InputSource | None,
        earlier: Sequence[Row] = (),
        durable: bool = True,
        stopping: Stopping | None = None,
        by: str = "",
        rehearsal: bool = False,
        about: Mapping[str, Any] | None = None,
        seal: bytes | None = None,
    ) -> None:
        self.earlier, self.stopping = tuple(earlier), stopping or Stopping()
        self.about = about or {}
        self._offset_s = 0.0
        self.log = EventLog(path, durable, by)
        self.log.seal = seal
        try:
            if not self.log.found.entries and source is not None:
                marks = {"simulated": source.simulated, "rehearsal": rehearsal}
                data = {"participant": participant, "plan": asdict(plan), "digest": plan.digest()}
                self.log.append(0.0, "session", {**data, **marks, "about": self.about})
            self.state = read_session(path)
            if self.state.plan.digest() != plan.digest():
                raise UserError(
                    f"{path}: the session was begun with another protocol or version of a task.",
                    "Restore the study's files that esea-host study audit names as changed.",
                )
            if source is not None and source.simulated != self.state.simulated:
                was, now = ("simulated", "real")[:: 1 if self.state.simulated else -1]
                raise UserError(
                    f"{path}: the session was begun on a {was} device; this one is {now}.",
                    "Go on with the device that it was begun on: leave --device out.",
                )
        except BaseException:
            self.close()
            raise
        if self.log.found.entries:
            self._offset_s = self.state.last_s
        if self.log.taken_over:
            self.log.append(self._offset_s, "takeover", self.log.taken_over)
        self.source = source or SimulatedSource(0)
        self._content_hash = self.state.content_hash

    def say(self, kind: str, /, **data: Any) -> None:
        """Write an event; it is on disk when this returns. Only in the session's thread."""
        self.log.append(self._offset_s + self.source.now_s(), kind, data)

    def run(
        self,
        show: Callable[[Scene], object] = lambda _: None,
        stop: Callable[[], str] = lambda: "",
        watcher: SessionWatcher | None = None,
    ) -> str:
        watcher = watcher or SessionWatcher(show, stop)
        source = self.source
        source.ask, source.waits, source.say = watcher.turn, watcher.waits, self.say
        if self.state.running is not None:
            self._end(self.state.running, ABORTED, keyed("reason.cut_off"), None)
        if self.log.found.entries:
            torn, running = len(self.log.found.torn), self.state.running
            self.say("resume", torn_bytes=torn, running=running, about=self.about)
        reason = self._make_ready() or self._trials(watcher)
        self.say("end", reason=reason, completed=not reason)
        self._reread()
        return reason

    def _make_ready(self) -> str:
        ready = dict(self.source.ready())
        now = ready.get("content_hash", "")
        self._content_hash = self._content_hash or now
        if now != self._content_hash:
            begun = f"the session was begun with firmware of content hash {self._content_hash}"
            ready["problem"] = f"{begun}; this board, {ready.get('device')}, has {now}"
        self.say("ready", **ready)
        return str(ready.get("problem", ""))

    def _reread(self) -> None:
        self.state = read_session(self.log.path)

    def _trials(self, watcher: SessionWatcher) -> str:
        known, past, failed = None, list[Row](), 0
        todo: list[PlannedTrial] = []
        rules, rested = self.stopping, 0
        while True:
            watcher.between()
            if known is not self.state:  # at first, and where a trial is to be left out or repeated
                known, todo = self.state, list(self.state.remaining)
                past = [*self.earlier, *self.state.past]
            if not todo:
                return ""
            if broken := self.source.broken():
                why = watcher.breaks(broken, self.source.drive) or watcher.turn()
                if why := why or self._make_ready():
                    return why
                continue
            trial = todo[0]
            if trial.rest_before_s and rested != trial.number:
                rested = trial.number
                self.say("rest", seconds=trial.rest_before_s)
                watcher.rests(trial.rest_before_s, self.source.rest)
                if why := watcher.turn():
                    return why
                continue  # it may have been left out meanwhile, or the source have been lost
            rested = 0
            # By the session's own clock: a break between start and resume counts as no time.
            if self._offset_s + self.source.now_s() > 60 * rules.longest_min:
                return keyed("reason.too_long", minutes=rules.longest_min)
            if why := self.source.before(trial):
                return why
            ended, row, reason = self._trial(trial, tuple(past), watcher)
            if ended == COMPLETED and row is not None:
                past.append(row)
            failed = failed + 1 if ended == FAILED else 0
            if ended != ABORTED:
                todo.pop(0)
            elif not isinstance(reason, TrialOnly):
                return reason
            if failed >= rules.failed_in_a_row:
                return keyed("reason.failed_in_a_row", failed=failed, reason=reason)

    def _trial(
        self, trial: PlannedTrial, past: tuple[Row, ...], watcher: SessionWatcher
    ) -> tuple[str, Row | None, str]:
        task = task_named(trial.task, self.log.path.name)
        situation = situation_of(trial, past)
        self.say("trial", trial=trial.number, block=trial.block, version=task.version)
        watcher.begins(trial)
        frames = _Frames(self.say, trial.number)
        ended, row, reason = ABORTED, None, ""
        try:
            actor = self.source.trial(task, situation, trial.number)
            state = of_task(task, task.begin, situation)
            scene = Scene()
            requests: dict[str, float] = {}
            while True:
                reason = watcher.turn()
                if reason:
                    break
                pressed = {k: v for k, v in watcher.pressed().items() if k in task.switches}
                self.source.paused = "pause" in pressed
                time_s, inputs = actor.react(scene, requests)
                watcher.paces(time_s)
                inputs = {**inputs, **pressed}
                lost = [n for n, x in inputs.items() if not finite(x)]
                if lost:
                    ended, reason = FAILED, keyed("reason.no_number", names=", ".join(lost))
                    break
                inputs = plain(inputs, "inputs")  # as they are read back for a replay
                step = checked_step(task, of_task(task, task.step, state, time_s, inputs))
                state, scene, requests = step.state, step.scene, dict(step.requests)
                frames.add(time_s, inputs, step)
                watcher.steps(time_s, step)
                if step.outcome is not None:
                    reason = step.outcome.reason
                    ended = FAILED if step.outcome.row is None else COMPLETED
                    if step.outcome.row is not None:
                        row = self._whole_row(step.outcome.row, trial)
                    break
        except (TaskBrokenError, UserError, LinkError) as error:
            ended, row, reason = FAILED, None, str(error)
        frames.flush()
        self.source.over(trial.number, ended)
        self._end(trial.number, ended, reason, row)
        watcher.ends(trial.number, ended, reason, row or {})
        return ended, row, reason

    def _whole_row(self, row: Row, trial: PlannedTrial) -> dict[str, Any]:
        about = {name: getattr(trial, name) for name in ABOUT - {"trial", "session"}}
        about |= {"trial": trial.number, "session": self.state.plan.session}
        about["simulated"] = self.state.simulated
        return about | ({ONLY_REHEARSED: True} if self.state.rehearsal else {}) | dict(row)

    def _end(self, number: int, state: str, reason: str, row: Row | None) -> None:
        self.say("trial_end", trial=number, state=state, reason=reason, row=row)

    def skip(self, number: int, reason: str) -> None:
        if not reason:
            raise UserError(f"Trial {number} cannot be skipped without a reason.", "Give --reason.")
        self._reread()
        if self.state.states.get(number) in (None, COMPLETED):
            raise UserError(f"Trial {number} is done or does not exist.", "Name a later one.")
        self.say("skip", trial=number, reason=reason)
        self._reread()

    def repeat(self, number: int, reason: str) -> None:
        """Repeat a trial: its earlier data no longer counts, and stays on record."""
        if not reason:
            raise UserError(f"Trial {number} is not repeated without a reason.", "Give --reason.")
        self._reread()
        if self.state.states.get(number) in (None, PENDING):
            raise UserError(f"Trial {number} has not been run.", "Name one that was run.")
        self.say("repeat", trial=number, reason=reason)
        self._reread()

    def note(self, text: str) -> None:
        self.say("note", text=text)

    def close(self) -> None:
        self.log.close()


def situation_of(trial: PlannedTrial, past: tuple[Row, ...]) -> Situation:
    return Situation(trial.asked()[1], trial.condition, past, trial.seed)


class _Frames:
    def __init__(self, say: Callable[..., None], trial: int) -> None:
        self._say, self._trial = say, trial
        self._samples: list[list[Any]] = []
        self._names: list[str] = []
        self._scenes = hashlib.sha256()

    def add(self, time_s: float, inputs: Mapping[str, float], step: TaskStep) -> None:
        if self._names != list(inputs):
            self.flush()
            self._names = list(inputs)
        self._samples.append([time_s, *inputs.values()])
        self._scenes.update(step.scene.digest())
        for event in step.events:
            self.flush()
            self._say("event", trial=self._trial, name=event.name, at_s=time_s, **event.data)
        if len(self._samples) >= CHUNK:
            self.flush()

    def flush(self) -> None:
        if self._samples:
            scenes = self._scenes.hexdigest()
            self._say(
                "frames", trial=self._trial, names=self._names, samples=self._samples, scenes=scenes
            )
            self._samples = []


def replay(
    path: Path,
    earlier: Sequence[Row] = (),
    told: Callable[[int, StudyTask, float], Inputs] | None = None,
) -> Iterator[tuple[int, Scene, bool]]:
    with well_formed(path):
        yield from _replay(read_log(path).sound(path).entries, path, earlier, told)


def _replay(
    entries: Sequence[LoggedEvent],
    path: Path,
    earlier: Sequence[Row],
    told: Callable[[int, StudyTask, float], Inputs] | None,
) -> Iterator[tuple[int, Scene, bool]]:
    plan = plan_from(entries[0].data["plan"])
    past: list[Mapping[str, Any]] = []  # of this session: only its own rows are repeated
    attempt = -1
    for e in entries:
        if e.kind == "trial":
            attempt += 1
            trial = plan.trials[e.data["trial"] - 1]
            task, state, digest = task_named(trial.task, path.name), None, hashlib.sha256()
        elif e.kind == "frames":
            if state is None:  # one that could not begin has shown nothing
                state = task.begin(situation_of(trial, (*earlier, *past)))
            for k, sample in enumerate(e.data["samples"], 1):
                inputs = dict(zip(e.data["names"], sample[1:], strict=True))
                inputs |= told(attempt, task, sample[0]) if told is not None else {}
                step = task.step(state, sample[0], inputs)
                state = step.state
                digest.update(step.scene.digest())
                whole = k == len(e.data["samples"])
                same = not whole or digest.hexdigest() == e.data["scenes"]
                yield trial.number, step.scene, same
        past = _rows_after(past, e)
