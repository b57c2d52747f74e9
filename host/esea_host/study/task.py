"""Task of a study: a pure step, like a Block on the board.

It has no clock, window or file, and no random numbers but those of its seed, so a log of its inputs
replays to the same scenes.  Every task can be simulated.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from esea_gen.errors import UserError, nearest
from esea_gen.python_file import import_file
from esea_gen.trust import TaskCode, must_be_trusted
from esea_host.study.scene import Scene

Row = Mapping[str, Any]
Inputs = Mapping[str, float]


class TaskParameters(BaseModel):
    """Parameters of a task: unknown keys and wrong types are errors before the first trial."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


@dataclass(frozen=True)
class DataColumn:
    """A column of the data that a task gives: its name carries its unit."""

    name: str
    kind: type
    meaning: str


@dataclass(frozen=True)
class TaskEvent:
    """Something that happened in a trial: on disk at once."""

    name: str
    data: Row = field(default_factory=dict)


@dataclass(frozen=True)
class TrialOutcome:
    """How a trial ended by itself: with its row of data, or failed with the reason."""

    row: Row | None
    reason: str = ""


@dataclass(frozen=True)
class TaskStep:
    """outcome: None while the trial continues; the device's limits decide on requests."""

    state: Any
    scene: Scene
    requests: Mapping[str, float] = field(default_factory=dict)
    events: tuple[TaskEvent, ...] = ()
    outcome: TrialOutcome | None = None


@dataclass(frozen=True)
class Situation:
    """Checked parameters, rows of completed trials (earlier sessions too), seed."""

    parameters: Any
    condition: str
    past: tuple[Row, ...]
    seed: int


class Actor(ABC):
    """Someone, real or simulated, who sees a scene and answers with inputs."""

    @abstractmethod
    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        """Time since the trial began, and the inputs."""


@dataclass(frozen=True)
class TaskSignal:
    """A quantity of the device; in degrees where the input's name ends in _deg."""

    quantity: str
    axis: str = ""


class StudyTask(ABC):
    """A task of a study. A new one is one file: a subclass with ``@register``."""

    name: ClassVar[str]
    version: ClassVar[str] = "1"
    title: ClassVar[str] = ""
    Parameters: ClassVar[type[TaskParameters]] = TaskParameters
    columns: ClassVar[tuple[DataColumn, ...]]
    inputs: ClassVar[Mapping[str, TaskSignal]] = {}
    switches: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def longest_s(self, parameters: Any) -> float:
        """How long a trial can take."""

    def conditions(self, parameters: Any) -> Mapping[str, float]:
        """Conditions of the device from before the first step to the last."""
        return {}

    @abstractmethod
    def begin(self, situation: Situation) -> Any:
        """The first state, frozen."""

    @abstractmethod
    def step(self, state: Any, time_s: float, inputs: Inputs) -> TaskStep:
        """One step; pure."""

    @abstractmethod
    def simulate(self, situation: Situation, rng: np.random.Generator) -> Actor:
        """Somebody who does this task."""

    def checked_row(self, row: Row) -> Row:
        wanted = {c.name: c.kind for c in self.columns}
        wrong = [n for n, k in wanted.items() if n in row and not _is_a(row[n], k)]
        if set(row) != set(wanted) or wrong:
            odd = sorted(set(row) ^ set(wanted)) + wrong
            raise TaskBrokenError(f"task {self.name}: columns not as declared: {', '.join(odd)}")
        return row


def _is_a(value: Any, kind: type) -> bool:
    # None is a value that there is not; a NaN no log can hold.
    right = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
    return right or value is None


class TaskBrokenError(Exception):
    """A task that violates its declaration: the trial fails with this as its reason."""


_TASKS: dict[str, StudyTask] = {}
_OF_MODULE: dict[str, list[StudyTask]] = {}


def register(kind: type[StudyTask]) -> type[StudyTask]:
    _TASKS[kind.name] = kind()
    _OF_MODULE.setdefault(kind.__module__, []).append(_TASKS[kind.name])
    return kind


def load_tasks(codes: Sequence[TaskCode]) -> None:
    must_be_trusted(codes)
    for code in codes:
        tasks = _OF_MODULE.get(import_file(code.path, code.content).__name__, [])
        if not tasks:
            raise UserError(f"{code.path}: registers no task.", "Put @register above the class.")
        _TASKS.update({t.name: t for t in tasks})


def task_named(name: str, where: str) -> StudyTask:
    if name not in _TASKS:
        raise UserError(
            f"{where}: there is no task {name!r}.",
            f"{nearest(name, _TASKS)}There are: {', '.join(sorted(_TASKS))}; a file of your own "
            "is named with tasks = [...] in the protocol or --task FILE.py.",
        )
    return _TASKS[name]
