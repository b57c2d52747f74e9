"""Boundary to a task's own code: its exceptions fail only the trial."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from esea_gen.errors import UserError
from esea_host.study.log import plain
from esea_host.study.scene import COLOURS, Kind, Scene, Shape, Text
from esea_host.study.task import StudyTask, TaskBrokenError, TaskEvent, TaskStep, TrialOutcome
from esea_host.study.words import ENGLISH, words_of

_KINDS = get_args(Kind)
_OWN = ("trial", "name", "at_s")  # the engine's, in every event


def of_task(task: StudyTask, part: Callable[..., Any], *given: Any) -> Any:
    """Result of a part of a task; an exception fails the trial, and the session continues."""
    try:
        return part(*given)
    except (TaskBrokenError, UserError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise TaskBrokenError(f"task {task.name}: {type(error).__name__}: {error}") from error


def longest_trial_s(task: StudyTask, parameters: Any) -> float:
    """How long a trial can take, by the task's own word."""
    return _numbers_of(task, lambda: {"longest_s": task.longest_s(parameters)})["longest_s"]


def trial_conditions(task: StudyTask, parameters: Any) -> dict[str, float]:
    """Conditions of the device during a trial, as declared by the task."""
    return _numbers_of(task, lambda: task.conditions(parameters))


def _numbers_of(task: StudyTask, ask: Callable[[], Any]) -> dict[str, float]:
    try:
        told = of_task(task, ask)
        _is(isinstance(told, Mapping), "conditions", told, "a mapping")
        return {str(n): number(x, str(n)) for n, x in told.items()}
    except TaskBrokenError as error:
        raise UserError(f"{error}.", "Correct the task.") from None
    except UserError as error:
        raise UserError(f"task {task.name}: {error.what}", error.fix) from None


def checked_step(task: StudyTask, step: Any) -> TaskStep:
    """A step as it may be shown, asked of the device and written: NumPy scalars are numbers."""
    try:
        _is(isinstance(step, TaskStep), "step", step, "a TaskStep")
        _scene(step.scene)
        _is(isinstance(step.requests, Mapping), "requests", step.requests, "a mapping")
        requests = {str(n): number(x, f"request {n}") for n, x in step.requests.items()}
        _is(isinstance(step.events, tuple | list), "events", step.events, "a tuple")
        events = tuple(_event(e) for e in step.events)
        outcome = step.outcome
        if outcome is not None:
            _is(isinstance(outcome, TrialOutcome), "outcome", outcome, "a TrialOutcome")
            _is(isinstance(outcome.reason, str), "reason", outcome.reason, "a text")
        if outcome is not None and outcome.row is not None:
            row = task.checked_row(_mapping(outcome.row, "row"))
            _words(row, "complaints")
            outcome = replace(outcome, row=row)
    except UserError as error:
        raise TaskBrokenError(f"task {task.name}: {error.what}") from None
    return TaskStep(step.state, step.scene, requests, events, outcome)


def number(value: Any, where: str) -> float:
    found: float = plain(value, where)
    _is(isinstance(found, int | float), where, value, "a number")
    return found


def _is(right: bool, where: str, value: Any, what: str) -> None:
    if not right:
        raise UserError(f"{where} is {type(value).__name__}, not {what}.", "Correct the task.")


def _mapping(value: Any, where: str) -> dict[str, Any]:
    _is(isinstance(value, Mapping), where, value, "a mapping")
    found: dict[str, Any] = plain(value, where)
    return found


def _words(data: Mapping[str, Any], key: str) -> None:
    # What an operator reads.
    words = data.get(key) or ()
    right = isinstance(words, list) and all(isinstance(w, str) for w in words)
    _is(right or not words, key, words, "a list of texts")


def _event(event: Any) -> TaskEvent:
    _is(isinstance(event, TaskEvent), "event", event, "a TaskEvent")
    _is(isinstance(event.name, str), "event's name", event.name, "a text")
    data = _mapping(event.data, f"event {event.name}")
    if own := sorted(set(data) & set(_OWN)):
        raise UserError(f"event {event.name}: the engine sets {', '.join(own)}.", "Rename it.")
    _words(data, "advice")
    return TaskEvent(event.name, data)


def _scene(scene: Any) -> None:
    # Only looked at: its digest is of what the task gave.
    _is(isinstance(scene, Scene), "scene", scene, "a Scene")
    for s in scene.shapes:
        _is(isinstance(s, Shape), "shape", s, "a Shape")
        if s.kind not in _KINDS or s.role not in COLOURS:
            raise UserError(f"scene: there is no {s.kind!r} of the role {s.role!r}.", "")
        lengths = (s.x, s.y, s.size, s.to_x, s.to_y)
        if not all(map(finite, lengths)):
            raise UserError(f"scene: {s.role} at {lengths}: no finite numbers.", "")
    if not finite(scene.half_width) or not scene.half_width > 0:
        raise UserError(f"scene: a half width of {scene.half_width}.", "")
    for t in scene.texts:
        _is(isinstance(t, Text), "text", t, "a Text")
        try:
            words_of(ENGLISH).scene(t.key, t.values)
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            raise UserError(f"scene: text {t.key!r} cannot be written ({what}).", "") from None


def finite(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and math.isfinite(value)
