"""Recordings of trials, cut out of what a board recorded in a session."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.interaction.recordings import recording_name, write_recording
from esea_host.recording.integrity import warn_unless_complete
from esea_host.recording.log import Log, open_log
from esea_host.recording.replay import device_of
from esea_host.study.exchange import TrialTrace, traces
from esea_host.study.fitting import DeviceSignals
from esea_host.study.folder import StudyFolder
from esea_host.study.session import COMPLETED
from esea_host.study.task import task_named


def cut_trials(study: StudyFolder) -> int:
    """Write the recording of every completed interaction trial that has none yet.

    Parameters
    ----------
    study : StudyFolder
        With ``device-<n>.mcap`` beside the logs of its sessions.

    Returns
    -------
    int
        How many were written.
    """
    written = 0
    for _, _, path in study.sessions():
        recorded = sorted(path.parent.glob("device-*.mcap"))
        for trace in traces(path) if recorded else []:
            target = path.parent / recording_name(trace.trial.number)
            if trace.trial.task.startswith("interaction.") and not target.exists():
                _cut(trace, recorded, target)
                written += 1
    return written


def _cut(trace: TrialTrace, recorded: Sequence[Path], target: Path) -> None:
    number = trace.trial.number
    # The last one that was completed: a repeated trial may stand in two files.
    for path in reversed(recorded):
        with open_log(path) as log:
            warn_unless_complete(path, log.integrity)
            stretch = _stretch(log, number)
            if stretch is None:
                continue
            # A sample of a run belongs to the end of its millisecond.
            (tap,) = (
                DeviceSignals(device_of(log)).taps(task_named(trace.trial.task, path.name)).values()
            )
            table = log[tap.stream].between(stretch[0] + 5e-4, stretch[1] + 5e-4)
            time_s = table.time_s - stretch[0]
            paused = paused_at(time_s, trace.events)
            simulated = bool(log.facts.get("simulated", False))
            write_recording(target, time_s, table[tap.column].astype(np.float64), paused, simulated)
            return
    raise UserError(
        f"Trial {number} is in none of {', '.join(p.name for p in recorded)}.",
        "Put the recording of that session back beside its log.",
    )


def _stretch(log: Log, number: int) -> tuple[float, float] | None:
    begins = [e["board_ns"] for e in log.events("trial") if e["number"] == number]
    ends = [
        e["board_ns"]
        for e in log.events("trial_end")
        if e["number"] == number and e["state"] == COMPLETED
    ]
    if not ends:
        return None
    begun = max(b for b in begins if b < ends[-1])
    return begun * 1e-9, ends[-1] * 1e-9


def paused_at(
    time_s: npt.NDArray[np.float64], events: Sequence[tuple[float, str]]
) -> npt.NDArray[np.bool_]:
    """At which times a task was held, by its events ``paused`` and ``resumed``."""
    found = np.zeros(len(time_s), bool)
    for at_s, name in events:
        if name in ("paused", "resumed"):
            found[time_s >= at_s] = name == "paused"
    return found
