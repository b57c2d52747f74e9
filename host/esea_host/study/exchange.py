"""A study's data for other programs, scrubbed: Parquet, and BIDS with its motion data.

New codes in random order, no notes, no times of day; only what completed trials gave.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.files import new_whole
from esea_host.recording.export import BIDS_VERSION
from esea_host.study.folder import StudyFolder
from esea_host.study.log import LoggedEvent, read_log, well_formed
from esea_host.study.plan import PlannedTrial, plan_from
from esea_host.study.session import COMPLETED, state_of
from esea_host.study.task import Row, task_named

# What BIDS calls a channel's kind, and its unit, by the end of our names.
_KINDS = {
    "_deg": ("JNTANG", "deg"),
    "_rad": ("JNTANG", "rad"),
    "_rad_s": ("VEL", "rad/s"),
    "_Nm": ("MISC", "N m"),
}
_COUNTED = ("ACCEL", "ANGACCEL", "GYRO", "JNTANG", "LATENCY", "MAGN", "MISC", "ORNT", "POS", "VEL")
# Beside a task's own columns, which declare their meaning.
_MEANINGS = {
    "trial": "number in the planned order of the session",
    "session": "number of the session, from 0",
    "block": "name of the block",
    "task": "name of the task",
    "condition": "name of the condition",
    "catch": "whether it was a catch trial",
    "familiarisation": "whether it is not meant for analysis",
    "simulated": "whether no real person, or no real device, was behind it",
}
TRACKED = "device"


@dataclass
class TrialTrace:
    trial: PlannedTrial
    row: Row = field(default_factory=dict)
    samples: list[tuple[float, Mapping[str, float]]] = field(default_factory=list)
    events: list[tuple[float, str]] = field(default_factory=list)

    @property
    def names(self) -> list[str]:
        """Of the inputs, in the order of their coming; a switch is there only while pressed."""
        return list(dict.fromkeys(n for _, values in self.samples for n in values))


def traces(path: Path) -> list[TrialTrace]:
    """The completed trials of a session's log; of a repeated one the last time."""
    with well_formed(path):
        found = read_log(path).sound(path)
        state_of(found, path)  # whatever it lacks is said of the whole session
        return _traces(found.entries)


def _traces(entries: Sequence[LoggedEvent]) -> list[TrialTrace]:
    plan = plan_from(entries[0].data["plan"])
    now = TrialTrace(plan.trials[0])
    found: dict[int, TrialTrace] = {}
    for e in entries:
        if e.kind == "trial":
            now = TrialTrace(plan.trials[e.data["trial"] - 1])
        elif e.kind == "frames":
            names = e.data["names"]
            now.samples += [
                (0.0 + s[0], dict(zip(names, s[1:], strict=True))) for s in e.data["samples"]
            ]
        elif e.kind == "event":
            now.events.append((0.0 + e.data["at_s"], str(e.data["name"])))
        elif e.kind == "trial_end" and e.data["state"] == COMPLETED:
            now.row = e.data["row"]
            found[e.data["trial"]] = now
        elif e.kind == "repeat":
            found.pop(e.data["trial"], None)
    return [found[n] for n in sorted(found)]


def to_parquet(study: StudyFolder, out: Path, seed: int = 0) -> int:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = study.scrubbed(seed)
    names = sorted({n for r in rows for n in r})
    columns = {n: pa.array([r.get(n) for r in rows]) for n in names}
    with new_whole(out) as scratch:
        scratch.mkdir()
        pq.write_table(pa.table(columns), scratch / "rows.parquet")
    return len(rows)


def to_bids(study: StudyFolder, out: Path, seed: int = 0) -> int:
    """A BIDS data set (bids-specification.readthedocs.io, Motion): one run a completed trial."""
    with new_whole(out) as scratch:
        scratch.mkdir()
        return _bids(study, scratch, seed)


def _bids(study: StudyFolder, out: Path, seed: int) -> int:
    runs, people = 0, ["participant_id"]
    simulated = study.simulated
    for new, old in study.new_codes(seed).items():
        people.append(f"sub-{new}")
        for code, number, path in study.sessions():
            if code == old:
                try:
                    done = [t for t in traces(path) if t.samples]
                except UserError as error:
                    study.leave_out(path, error)
                    continue
                place = out / f"sub-{new}" / f"ses-{number + 1}"
                names = [_write_run(place, new, number + 1, t, simulated) for t in done]
                _scans(place / f"sub-{new}_ses-{number + 1}_scans.tsv", names, done)
                runs += len(done)
    write_tsv(out / "participants.tsv", [[p] for p in people])
    file = study.protocol.file
    about = {
        "Name": file.title,
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "License": "n/a",
        "Authors": ["n/a"],
        "GeneratedBy": [{"Name": "esea-host"}],
    }
    _json(out / "dataset_description.json", about)
    whose = "SIMULATED: no person took part.\n" if simulated else ""
    words = f"{file.title}.\n{whose}Each run is one trial; scans.tsv has what came of it.\n"
    (out / "README").write_text(words, encoding="utf-8")
    return runs


def _write_run(place: Path, code: str, session: int, trace: TrialTrace, simulated: bool) -> str:
    trial, names = trace.trial, trace.names
    label = re.sub("[^0-9a-zA-Z]", "", trial.task)
    head = f"sub-{code}_ses-{session}_task-{label}_tracksys-{TRACKED}_run-{trial.number}"
    start_s = trace.samples[0][0]
    lines = [[time_s - start_s, *(v.get(n) for n in names)] for time_s, v in trace.samples]
    write_tsv(place / "motion" / f"{head}_motion.tsv", lines)
    channels = [["name", "component", "type", "tracked_point", "units"]]
    channels.append(["time_s", "n/a", "LATENCY", "n/a", "s"])
    kinds = [next((k for e, k in _KINDS.items() if n.endswith(e)), ("MISC", "n/a")) for n in names]
    channels += [[n, "n/a", k, "n/a", u] for n, (k, u) in zip(names, kinds, strict=True)]
    write_tsv(place / "motion" / f"{head}_channels.tsv", channels)
    length_s = trace.samples[-1][0] - start_s
    rate_Hz = round((len(lines) - 1) / length_s, 6) if length_s > 0 else 0.0
    counted = ["LATENCY", *(k for k, _ in kinds)]
    about: dict[str, Any] = {
        "TaskName": trial.task,
        "TaskDescription": "Run with esea-host" + (", simulated" if simulated else ""),
        "SamplingFrequency": rate_Hz,
        "SamplingFrequencyEffective": rate_Hz,
        "TrackingSystemName": TRACKED,
        "RecordingType": "continuous",
        "RecordingDuration": length_s,
        "MotionChannelCount": len(channels) - 1,
        "MissingValues": "n/a",
    }
    about |= {f"{k}ChannelCount": counted.count(k) for k in _COUNTED}
    _json(place / "motion" / f"{head}_motion.json", about)
    events: list[list[Any]] = [["onset", "duration", "trial_type"]]
    events += [[at_s - start_s, 0, name] for at_s, name in trace.events]
    write_tsv(place / "motion" / f"{head}_events.tsv", events)
    return f"motion/{head}_motion.tsv"


def _scans(path: Path, names: Sequence[str], done: Sequence[TrialTrace]) -> None:
    # What came of each trial; lists are the samples again, and stay out.
    rows = [{k: v for k, v in t.row.items() if not isinstance(v, list | dict)} for t in done]
    columns = list(dict.fromkeys(k for r in rows for k in r))
    lines = [[n, *(r.get(k) for k in columns)] for n, r in zip(names, rows, strict=True)]
    write_tsv(path, [["filename", *columns], *lines])
    kinds = {t.trial.task: task_named(t.trial.task, "log").columns for t in done}
    own = {c.name: c.meaning for columns_ in kinds.values() for c in columns_}
    known = own | _MEANINGS
    _json(path.with_suffix(".json"), {k: {"Description": known[k]} for k in columns})


def write_tsv(path: Path, lines: Sequence[Sequence[Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        file.writelines("\t".join(_cells(line)) + "\n" for line in lines)


def _cells(line: Sequence[Any]) -> Iterator[str]:
    for value in line:
        if value is None or value == "":
            yield "n/a"
        elif isinstance(value, bool):
            yield str(value).lower()
        else:
            text = f"{value:.9g}" if isinstance(value, float) else str(value)
            if "\t" in text or "\n" in text:
                raise UserError(f"{text!r} cannot stand in a table.", "Leave the tab out.")
            yield text


def _json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
