"""Board samples behind a session's scenes, read from its recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_host.recording.integrity import warn_unless_complete
from esea_host.recording.log import Log, Table, open_log
from esea_host.recording.replay import device_of
from esea_host.study.fitting import DeviceSignals
from esea_host.study.log import read_log
from esea_host.study.task import Inputs, StudyTask

CONDITION, MIDDLE = "condition", "middle"


@dataclass(frozen=True)
class TrialAttempt:
    """One attempt at a trial; ended_ns is None if the recording ends within it."""

    number: int
    path: Path
    begun_ns: int
    ended_ns: int | None = None
    state: str = ""


class BoardRecordings:
    """The recordings of a session, ``device-<n>.mcap`` beside its log."""

    def __init__(self, folder: Path) -> None:
        paths = folder.glob("device-*.mcap")
        self.paths = sorted(paths, key=lambda p: (len(p.name), p.name))
        self.attempts: list[TrialAttempt] = []
        self._open: tuple[Path, Log, dict[str, Table]] | None = None
        for path in self.paths:
            log = self._log(path)
            warn_unless_complete(path, log.integrity)
            begins = log.events("trial")
            for e, after in zip_longest(begins, begins[1:]):
                until = after["log_ns"] if after else math.inf
                ends = [x for x in log.events("trial_end") if e["log_ns"] <= x["log_ns"] <= until]
                end = (ends[0]["board_ns"], ends[0]["state"]) if ends else (None, "")
                self.attempts.append(TrialAttempt(e["number"], path, e["board_ns"], *end))

    def _log(self, path: Path) -> Log:
        return self._file(path)[1]

    def _file(self, path: Path) -> tuple[Path, Log, dict[str, Table]]:
        if self._open is None or self._open[0] != path:
            self.close()
            self._open = path, open_log(path), {}
        return self._open

    def signals(self, attempt: TrialAttempt) -> DeviceSignals:
        return DeviceSignals(device_of(self._log(attempt.path)))

    def simulated(self, attempt: TrialAttempt) -> bool:
        return bool(self._log(attempt.path).facts.get("simulated", False))

    def table(self, attempt: TrialAttempt, stream: str) -> Table:
        _, log, tables = self._file(attempt.path)
        if stream not in tables:
            tables[stream] = log[stream]
        return tables[stream]

    def close(self) -> None:
        if self._open is not None:
            self._open[1].close()
            self._open = None


class BoardInputs:
    """A session's inputs as the board recorded them, for :func:`esea_host.study.session.replay`."""

    def __init__(self, path: Path) -> None:
        self.recordings = BoardRecordings(path.parent)
        by_trial: dict[tuple[str, int], list[TrialAttempt]] = {}
        for attempt in self.recordings.attempts:
            by_trial.setdefault((attempt.path.name, attempt.number), []).append(attempt)
        self._there, file = {p.name for p in self.recordings.paths}, ""
        self._files: list[str] = []  # of each attempt
        self.lacking = 0  # samples that a cut recording has no more: the log's stay
        self._of: list[tuple[TrialAttempt | None, int, Mapping[str, float]]] = []
        middle: Mapping[str, float] = {}
        for e in read_log(path).sound(path).entries:
            if e.kind == MIDDLE:
                middle = e.data["inputs"]
            elif e.kind == "ready":
                file = e.data.get("recording", file)
            elif e.kind == "trial":
                waiting = by_trial.get((file, e.data["trial"]), [])
                self._files.append(file)
                found = waiting.pop(0) if waiting else None
                self._of.append((found, found.begun_ns if found else 0, middle))
            elif e.kind == CONDITION:
                self._of[-1] = self._of[-1][0], e.data["board_ns"], middle
        self._now = -1

    def __call__(self, attempt: int, task: StudyTask, time_s: float) -> Inputs:
        found, begun_ns, middle = self._of[attempt]
        if self._files[attempt] not in self._there:
            fix = "Restore that session's recording beside its log."
            raise UserError(f"{self._files[attempt] or 'The recording'} is not there.", fix)
        if found is None:
            self.lacking += 1
            return {}
        if attempt != self._now:
            self._now, self._taps = attempt, self.recordings.signals(found).taps(task)
        at_ns = begun_ns + round(time_s * 1e6) * 1000
        values = {}
        for name, tap in self._taps.items():
            table = self.recordings.table(found, tap.stream)
            if not len(table.board_ns) or at_ns >= table.board_ns[-1] + 1000:
                continue
            row = int(np.searchsorted(table.board_ns, at_ns, "right")) - 1
            told = tap.factor * float(table[tap.column][row]) if row >= 0 else 0.0
            values[name] = told - middle.get(name, 0.0)
        self.lacking += len(values) < len(self._taps)
        return values
