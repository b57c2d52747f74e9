"""Export of a study's data: rows, Parquet, and BIDS with its motion data.

Codes follow from the study's secret key.  There are no notes, no dates, no times of day and no seed
of the protocol; only what completed trials gave.  Values that reveal the group wait for unblinding.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.files import new_whole
from esea_host.recording.export import BIDS_VERSION
from esea_host.study.folder import StudyFolder
from esea_host.study.log import LoggedEvent, read_log, well_formed
from esea_host.study.plan import PlannedTrial, plan_from
from esea_host.study.privacy import LEFT_OUT, export_codes, keyed
from esea_host.study.protocol import group_decides
from esea_host.study.session import COMPLETED, PENDING, RUNNING, state_of
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
SET = "parameter of the trial, from the protocol"
TRACKED = "device"
LOST = "its end is lost"
NOBODY = "SIMULATED: no person took part."


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
            now.row = now.trial.parameters | e.data["row"]
            found[e.data["trial"]] = now
        elif e.kind == "repeat":
            found.pop(e.data["trial"], None)
    return [found[n] for n in sorted(found)]


def new_codes(study: StudyFolder) -> dict[str, str]:
    """Code in every export to participant."""
    return export_codes(study.key, {c for c, _, _ in study.sessions()})


def veil(study: StudyFolder, labels: bool = False) -> Callable[[Row], dict[str, Any]]:
    """Hides columns that reveal the group, while operator or analyst is blinded.

    labels: conditions are told apart by neutral names, for a blinded analysis.
    """
    file = study.protocol.file
    if not any(study.blinded(role) for role in ("operator", "analyst")):
        return dict
    names = veiled_names(study) if labels else {}
    decided = {k for c in file.conditions.values() for k in c.parameters}

    def veiled(row: Row) -> dict[str, Any]:
        if not group_decides(file, row["session"], row["block"]):
            return {**row}
        shown = {k: v for k, v in row.items() if k not in decided}
        return {**shown, "condition": names.get(row["condition"], LEFT_OUT)}

    return veiled


def veiled_names(study: StudyFolder) -> dict[str, str]:
    """Neutral names of the conditions, in an order that follows from the study's key."""
    key, known = study.key, study.protocol.file.conditions
    order = sorted(known, key=lambda c: keyed(key, "condition", c))
    return {c: f"condition {k}" for k, c in enumerate(order, 1)}


def shared_rows(study: StudyFolder, labels: bool = False) -> list[dict[str, Any]]:
    hide = veil(study, labels)
    return [
        hide(row) | {"participant": new}
        for new, old in new_codes(study).items()
        for row in study.rows(old, strict=False)
    ]


def omissions(study: StudyFolder) -> list[str]:
    """Data that neither exports nor analyses use, and why: a line each."""
    found, gone = list[str](), {}
    entries = study.audited(strict=False)
    if rehearsed := sum(kind == "rehearsal" for kind, _ in entries):
        found.append(f"rehearsals: {rehearsed}, which count for nobody")
    for data in (d for k, d in entries if k == "repair"):
        found.append(f"{data['log']}: {'a broken part, moved aside' if 'aside' in data else LOST}")
    for kind, data in entries:
        if kind in ("delete", "withdraw"):
            words = "data deleted" if kind == "delete" else "withdrew"
            gone[data["participant"]] = f"{words}: {data.get('reason') or 'no reason was given'}"
    found += [f"{code}: {why}" for code, why in gone.items()]
    begun = {c for c, _, _ in study.sessions()}
    missing = [(c, n) for c, n in study.missing() if c not in gone]
    found += [f"{c}, session {n + 1}, whole: its log is missing" for c, n in missing]
    begun |= {c for c, _ in missing}
    idle = [c for c in study.participants() if c not in begun | gone.keys()]
    found += [f"{', '.join(idle)}: no session yet"] if idle else []
    for code, number, path in study.sessions():
        where = f"{code}, session {number + 1}"
        if code in gone:
            continue
        try:
            state = study.read(code, number, path)
        except UserError as error:
            found.append(f"{where}, whole: {error.what}")
            continue
        for trial in state.plan.trials:
            now = state.states[trial.number]
            if now not in (COMPLETED, PENDING):
                no_reason = "not over yet" if now == RUNNING else "no reason was given"
                why = state.reasons.get(trial.number) or no_reason
                found.append(f"{where}, trial {trial.number} {now}: {why}")
        if pending := sum(s == PENDING for s in state.states.values()):
            found.append(f"{where}: {pending} of {len(state.plan.trials)} trials were not run")
    return found


def known_words(study: StudyFolder) -> set[str]:
    """Texts that protocol and tasks can write into a row: free text is not among them."""
    found = {LEFT_OUT, *veiled_names(study).values()}

    def collect(value: Any) -> None:
        if isinstance(value, str):
            found.add(value)
        elif isinstance(value, Mapping):
            collect([*value, *value.values()])
        elif isinstance(value, list | tuple):
            for inner in value:
                collect(inner)

    file = study.protocol.file
    collect(file.model_dump())
    for block in (b for s in file.session for b in s.block):
        collect([f"{block.name} {k + 1}" for k in range(block.copies)])
        with suppress(UserError):  # a task of somebody's own, which is not run here
            collect(task_named(block.task, "protocol").Parameters.model_json_schema())
    return found


def people_of(study: StudyFolder) -> set[str]:
    trail = study.trail(strict=False)
    return {e.by for e in trail} | {str(e.data.get("by", "")) for e in trail}


def protocol_text(study: StudyFolder) -> str:
    """The protocol without its seed: the orders of trials would tell who came when."""
    mark = f"# {NOBODY}\n" if study.simulated else ""
    return mark + re.sub(r"(?m)^seed\s*=.*$", "seed = 0  # left out", study.protocol.text)


def to_rows(study: StudyFolder, out: Path, labels: bool = False) -> int:
    rows = shared_rows(study, labels)
    names = sorted({n for r in rows for n, x in r.items() if not isinstance(x, list | dict)})
    with new_whole(out) as scratch:
        scratch.mkdir()
        lines = "".join(json.dumps(r, sort_keys=True) + "\n" for r in rows)
        (scratch / "rows.jsonl").write_text(lines, encoding="utf-8", newline="\n")
        with (scratch / "rows.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, names, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows)
        (scratch / "protocol.toml").write_text(protocol_text(study), encoding="utf-8", newline="\n")
    return len(rows)


def to_parquet(study: StudyFolder, out: Path, labels: bool = False) -> int:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = shared_rows(study, labels)
    names = sorted({n for r in rows for n in r})
    columns = {}
    for name in names:
        values = [r.get(name) for r in rows]
        try:
            columns[name] = pa.array(values)
        except pa.ArrowException:  # tasks that mean different things by one name: as text
            columns[name] = pa.array([None if v is None else str(v) for v in values])
    with new_whole(out) as scratch:
        scratch.mkdir()
        pq.write_table(pa.table(columns), scratch / "rows.parquet")
    return len(rows)


def to_bids(study: StudyFolder, out: Path, labels: bool = False) -> int:
    """A BIDS data set (bids-specification.readthedocs.io, Motion): one run a completed trial."""
    with new_whole(out) as scratch:
        scratch.mkdir()
        return _bids(study, scratch, labels)


def _bids(study: StudyFolder, out: Path, labels: bool) -> int:
    runs, people, hide = 0, [["participant_id"]], veil(study, labels)
    simulated = study.simulated
    for new, old in new_codes(study).items():
        for code, number, path in study.sessions(old):
            try:
                study.read(code, number, path)
                done = [t for t in traces(path) if t.samples]
            except UserError as error:
                study.leave_out(path, error)
                continue
            if not done:
                continue
            people += [[f"sub-{new}"]] if people[-1] != [f"sub-{new}"] else []
            place = out / f"sub-{new}" / f"ses-{number + 1}"
            names = [_write_run(place, new, number + 1, t, simulated) for t in done]
            rows = [hide(t.row) for t in done]
            _scans(place / f"sub-{new}_ses-{number + 1}_scans.tsv", names, done, rows)
            runs += len(done)
    write_tsv(out / "participants.tsv", people)
    file = study.protocol.file
    about = {
        "Name": ("SIMULATED: " if simulated else "") + file.title,
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "License": "n/a",
        "Authors": ["n/a"],
        "GeneratedBy": [{"Name": "esea-host"}],
    }
    _json(out / "dataset_description.json", about)
    whose = f"{NOBODY}\n" if simulated else ""
    words = f"{file.title}.\n{whose}Each run is one trial; scans.tsv has its outcome.\n"
    (out / "README").write_text(words, encoding="utf-8", newline="\n")
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


def _scans(
    path: Path, names: Sequence[str], done: Sequence[TrialTrace], whole: Sequence[Row]
) -> None:
    # What came of each trial; lists are the samples again, and stay out.
    rows = [{k: v for k, v in row.items() if not isinstance(v, list | dict)} for row in whole]
    columns = list(dict.fromkeys(k for r in rows for k in r))
    lines = [[n, *(r.get(k) for k in columns)] for n, r in zip(names, rows, strict=True)]
    write_tsv(path, [["filename", *columns], *lines])
    kinds = {t.trial.task: task_named(t.trial.task, "log").columns for t in done}
    own = {c.name: c.meaning for columns_ in kinds.values() for c in columns_}
    known = own | _MEANINGS
    _json(path.with_suffix(".json"), {k: {"Description": known.get(k, SET)} for k in columns})


def write_tsv(path: Path, lines: Sequence[Sequence[Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="\n") as file:
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
                raise UserError(f"{text!r} cannot be a table cell.", "Leave tabs out.")
            yield text


def _json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8", newline="\n")
