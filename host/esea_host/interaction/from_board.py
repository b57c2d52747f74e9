"""Recordings of trials, cut out of what a board recorded in a session."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.interaction.recordings import recording_name, write_recording
from esea_host.study.exchange import TrialTrace, traces
from esea_host.study.folder import StudyFolder
from esea_host.study.recorded import BoardRecordings
from esea_host.study.session import COMPLETED
from esea_host.study.task import task_named

TICK_NS = 1_000_000  # of the sensing task


def cut_trials(study: StudyFolder) -> int:
    """Write the recording of every completed interaction trial that has none yet."""
    written = 0
    for _, _, path in study.sessions():
        recordings = BoardRecordings(path.parent)
        try:
            found = traces(path) if recordings.paths else []
        except UserError as error:
            study.leave_out(path, error)
            found = []
        for trace in found:
            target = path.parent / recording_name(trace.trial.number)
            if trace.trial.task.startswith("interaction.") and not target.exists():
                written += _cut(trace, recordings, target)
        recordings.close()
    return written


def _cut(trace: TrialTrace, recordings: BoardRecordings, target: Path) -> bool:
    number = trace.trial.number
    done = [a for a in recordings.attempts if a.number == number and a.state == COMPLETED]
    if not done:
        raise UserError(
            f"Trial {number} is in none of {', '.join(p.name for p in recordings.paths)}.",
            "Put the recording of that session back beside its log.",
        )
    attempt = done[-1]  # a repeated trial counts as it was done last
    assert attempt.ended_ns is not None
    task = task_named(trace.trial.task, target.name)
    (tap,) = recordings.signals(attempt).taps(task).values()
    table = recordings.table(attempt, tap.stream)
    # A sample belongs to the end of its millisecond.
    of_trial = (table.board_ns > attempt.begun_ns) & (table.board_ns <= attempt.ended_ns)
    time_s = (table.board_ns[of_trial] - attempt.begun_ns) * 1e-9
    ticks = round((attempt.ended_ns - attempt.begun_ns) / TICK_NS)
    if len(time_s) != ticks:
        warnings.warn(
            f"{attempt.path}: trial {number} has {len(time_s)} of {ticks} rows.  Its recording is "
            "left out.",
            stacklevel=2,
        )
        return False
    paused, angle = paused_at(time_s, trace.events), table[tap.column][of_trial]
    given = time_s, angle.astype(np.float64), paused, recordings.simulated(attempt)
    write_recording(target, *given)
    return True


def paused_at(
    time_s: npt.NDArray[np.float64], events: Sequence[tuple[float, str]]
) -> npt.NDArray[np.bool_]:
    """At which times a task was held, by its events ``paused`` and ``resumed``."""
    found = np.zeros(len(time_s), bool)
    for at_s, name in events:
        if name in ("paused", "resumed"):
            found[time_s >= at_s] = name == "paused"
    return found
