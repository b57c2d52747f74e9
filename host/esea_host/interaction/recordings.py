"""Folder of recordings from any rig: a manifest, as in docs/interaction.md, and tables.

A recording has the columns ``time_s`` and ``theta_rad`` or ``theta_deg`` at a steady rate; if it
has ``paused``, only the rows after the last pause count.
"""

from __future__ import annotations

import json
import warnings
from codecs import BOM_UTF8
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from esea_gen.errors import UserError
from esea_gen.files import refuse_copies, write_whole
from esea_gen.tables import FileTable, read_table
from esea_gen.toml_file import checked, parse_toml, read_text
from esea_host.interaction.design import element_of
from esea_host.recording.export import column_of, longest_run
from esea_host.smoothness import NoAnswerError, steady_rate
from esea_host.smoothness.checks import rows
from esea_host.study.exchange import TrialTrace, traces
from esea_host.study.folder import StudyFolder
from esea_host.study.privacy import PRIVATE
from esea_host.study.recorded import BoardRecordings
from esea_host.study.records import gone_from
from esea_host.study.session import COMPLETED
from esea_host.study.task import task_named

Array = npt.NDArray[np.float64]
MANIFEST, PREFIX = "interaction.toml", "interaction."
SETTINGS = ("last_s", "stop_Hz", "survey", "comments")
SIMULATED = "# simulated\n"
SETTLE_S = 3.0  # before the analysed part, for the filter to settle


class RecordingEntry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    file: str
    participant: str = Field(min_length=1)
    group: Literal["A", "B"]
    block: Literal[1, 2]
    element: Literal["spring", "elastomer"]
    task: str = Field(min_length=1)

    def swapped(self) -> RecordingEntry:
        element = {"spring": "elastomer", "elastomer": "spring"}[self.element]
        other = {"element": element, "group": {"A": "B", "B": "A"}[self.group]}
        return self.model_copy(update=other)


class Manifest(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    simulated: bool
    recording: tuple[RecordingEntry, ...] = Field(min_length=1)
    last_s: float = Field(default=45.0, gt=0)
    stop_Hz: float = Field(default=4.0, gt=0)
    survey: str | None = None
    comments: str | None = None


@dataclass(frozen=True)
class TaskRecordings:
    """All complete recordings of a task: angles in degrees, shape (people, 2, samples)."""

    task: str
    people: tuple[str, ...]
    groups: tuple[str, ...]
    theta_deg: Array  # second axis: spring, elastomer
    fs_Hz: float


@dataclass(frozen=True)
class Recordings:
    folder: Path
    manifest: Manifest
    tasks: tuple[TaskRecordings, ...]
    left_out: tuple[str, ...]
    read: tuple[str, ...]


def _document(folder: Path) -> tuple[Path, str, dict[str, Any]]:
    path = folder / MANIFEST
    if not path.exists() and (sealed := folder / PRIVATE / MANIFEST).exists():
        path = sealed  # its operator is blinded
    text = read_text(path, f"Give a folder with {MANIFEST}; see the page on interaction quality.")
    return path, text, parse_toml(text, path.name, "the page on interaction quality")


def read_manifest(folder: Path) -> Manifest:
    """The manifest, checked against the cross-over's design."""
    path, text, document = _document(folder)
    manifest = checked(Manifest, document, path.name, lambda _: None, text)
    seen: dict[tuple[str, str, int], str] = {}
    groups: dict[str, str] = {}
    for e in manifest.recording:
        if groups.setdefault(e.participant, e.group) != e.group:
            raise UserError(f"{path.name}: {e.participant} is in two groups.", "Keep one group.")
    for e in manifest.recording:
        if e.element != element_of(e.group, e.block):
            raise UserError(
                f"{path.name}: {e.file}: group {e.group} has the {element_of(e.group, e.block)} in "
                f"block {e.block}, not the {e.element}.",
                "Correct group, block or element.",
            )
        other = seen.setdefault((e.participant, e.task, e.block), e.file)
        if other != e.file:
            raise UserError(
                f"{path.name}: {other} and {e.file} are the same person, task and block.",
                "Remove the invalid one.",
            )
    return manifest


def write_manifest(folder: Path, last_s: float) -> None:
    """Name the study's recordings for the analysis, not familiarisation; settings there stay."""
    there = (folder / MANIFEST).exists() or (folder / PRIVATE / MANIFEST).exists()
    given = {"last_s": last_s} | (_document(folder)[2] if there else {})
    study = StudyFolder.open(folder, durable=False, runs=False)
    lines, groups, simulated = list[str](), study.allocations, False
    for code in study.participants():
        for row in study.rows(code, strict=False):
            block = row["session"] + 1
            file = f"{code}/session-{block}/{recording_name(row['trial'])}"
            if row["familiarisation"] or not (folder / file).exists():
                continue
            simulated |= is_simulated(folder / file)  # one makes the study so
            entry: dict[str, Any] = {"file": file, "participant": code, "block": block}
            entry |= {"group": groups.group(code), "element": row["element"]}
            lines += ["[[recording]]", *_keys(entry | {"task": row["task"].removeprefix(PREFIX)})]
    own = {"simulated": simulated, **{k: given[k] for k in SETTINGS if k in given}}
    place = folder / PRIVATE if study.blinded("operator") else folder
    write_whole(place / MANIFEST, "\n".join([*_keys(own), *lines, ""]))


def _keys(values: Mapping[str, Any]) -> list[str]:
    return [f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in values.items()]


def recording_name(trial: int | str) -> str:
    """File of a trial's recording, beside the session's log."""
    return f"encoder-{trial}.csv"


def write_recording(
    path: Path,
    time_s: npt.ArrayLike,
    theta_rad: npt.ArrayLike,
    paused: npt.ArrayLike,
    simulated: bool,
) -> None:
    """A recording as it is read here; ``paused`` is there where something was."""
    rows = list(zip(np.ravel(time_s), np.ravel(theta_rad), np.ravel(paused), strict=True))
    held = any(p for _, _, p in rows)
    head = (SIMULATED if simulated else "") + "time_s,theta_rad" + ",paused" * held + "\n"
    lines = (f"{t:.3f},{x:.9g}" + f",{int(p)}" * held + "\n" for t, x, p in rows)
    write_whole(path, head + "".join(lines))


def is_simulated(path: Path) -> bool:
    """Whether a recording's first line says so."""
    with path.open("rb") as file:
        return file.readline(100).removeprefix(BOM_UTF8).split() == SIMULATED.encode().split()


def read_angle(path: Path) -> tuple[Array, Array, FileTable]:
    """Times and angle in degrees of a recording, and its table."""
    table = longest_run(read_table(path, name=path.name))
    time, *angles = (column_of(table, n) for n in ("time_s", "theta_deg", "theta_rad"))
    angle = next((c for c in angles if c in table.names), None)
    if time not in table.names or angle is None:
        raise UserError(
            f"{path.name}: columns {', '.join(table.names)}.",
            "It needs time_s and theta_rad or theta_deg.",
        )
    if "paused" in table.names:
        paused = np.flatnonzero(table.numbers("paused"))
        if len(paused):
            table = table.kept(np.arange(len(table)) > paused[-1], "a pause in or behind them")
    theta = table.numbers(angle)
    theta_deg = theta if angle.startswith("theta_deg") else np.rad2deg(theta)
    return table.numbers(time), theta_deg, table


def steady_angle(path: Path) -> tuple[Array, float, FileTable]:
    """Angle in degrees and sampling rate; a gap in time or a missing sample is refused."""
    time, theta, table = read_angle(path)
    try:
        fs_Hz = steady_rate(time)
        rows(theta, "The angle", fs_Hz, time)
    except NoAnswerError as error:
        raise UserError(f"{path.name}: {error.what}", error.fix) from None
    return theta, fs_Hz, table


def read_recordings(folder: Path, swapped: bool = False) -> Recordings:
    """Manifest and all recordings; of each the analysed part with room for the filter.

    swapped: either element by the other's name, for a blinded analysis.
    """
    manifest = read_manifest(folder)
    if swapped:
        recording = tuple(e.swapped() for e in manifest.recording)
        manifest = manifest.model_copy(update={"recording": recording})
    gone, tasks, tables = gone_from(folder), list[TaskRecordings](), list[FileTable]()
    named = {e.participant for e in manifest.recording}
    left_out = [f"{p} (withdrawn)" for p in sorted(gone & named)]
    there = [e for e in manifest.recording if e.participant not in gone]
    for task in sorted({e.task for e in there}):
        entries = [e for e in there if e.task == task]
        people = sorted({e.participant for e in entries})
        both = [p for p in people if sum(e.participant == p for e in entries) == 2]
        left_out += [f"{p} ({task})" for p in people if p not in both]
        if whole := [e for e in entries if e.participant in both]:
            tasks.append(_stacked(folder, manifest, whole, tables))
    if not tasks:
        known = ", ".join(left_out) or "no recordings"
        raise UserError(
            f"{folder}: nobody has both elements in any task: {known}.",
            "Add the missing recordings.",
        )
    refuse_copies(folder / e.file for e in there)
    # A comment is no data; a simulated recording begins with one.
    cut = [t.report() for t in tables if any("comment line" not in x for x in t.left_out)]
    read = (f"{len(tables)} recordings read, {len(tables) - len(cut)} completely", *cut)
    return Recordings(folder, manifest, tuple(tasks), tuple(left_out), read)


def _stacked(
    folder: Path, manifest: Manifest, entries: list[RecordingEntry], tables: list[FileTable]
) -> TaskRecordings:
    task = entries[0].task
    people = sorted({e.participant for e in entries})
    groups = {e.participant: e.group for e in entries}
    angles: dict[tuple[str, str], Array] = {}
    rates = {}
    for e in entries:
        angles[e.participant, e.element], rates[e.file], table = steady_angle(folder / e.file)
        tables.append(table)
        if table.simulated and not manifest.simulated:
            raise UserError(
                f"{MANIFEST}: {e.file} is marked as simulated.", "Write simulated = true."
            )
    rate = next(iter(rates.values()))
    odd = [f for f, r in rates.items() if abs(r / rate - 1) > 1e-3]
    if odd:
        raise UserError(
            f"{odd[0]}: {rates[odd[0]]:g} Hz, the others {rate:g} Hz.",
            "The metrics depend on the rate: resample all to one.",
        )
    shortest = min(len(a) for a in angles.values())
    if shortest < manifest.last_s * rate:
        raise UserError(
            f"{folder.name}: a recording of {task} has {shortest / rate:.1f} s.",
            f"The last {manifest.last_s:g} s are analysed; set last_s, or leave the person out.",
        )
    kept = min(shortest, round((manifest.last_s + SETTLE_S) * rate))
    stack = [[angles[p, e][-kept:] for e in ("spring", "elastomer")] for p in people]
    return TaskRecordings(
        task, tuple(people), tuple(groups[p] for p in people), np.array(stack), rate
    )


TICK_NS = 1_000_000  # of the sensing task


def cut_trials(study: StudyFolder) -> int:
    """Write the recording of every completed interaction trial that has none, or was repeated."""
    written = 0
    for code, number, path in study.sessions():
        recordings = BoardRecordings(path.parent)
        try:
            study.read(code, number, path)
            found = traces(path) if recordings.paths else []
        except UserError as error:
            study.leave_out(path, error)
            found = []
        for trace in found:
            if trace.trial.task.startswith(PREFIX):
                written += _cut(trace, recordings, path.parent)
        recordings.close()
    return written


def _cut(trace: TrialTrace, recordings: BoardRecordings, folder: Path) -> bool:
    number, target = trace.trial.number, folder / recording_name(trace.trial.number)
    done = [a for a in recordings.attempts if a.number == number and a.state == COMPLETED]
    if target.exists() and len(done) < 2:
        return False
    target.unlink(missing_ok=True)  # of a repeated trial: may be of its first attempt
    if not done:
        raise UserError(
            f"Trial {number} is in none of {', '.join(p.name for p in recordings.paths)}.",
            "Restore that session's recording beside its log.",
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
    """Times of a task's pauses, by its events ``paused`` and ``resumed``."""
    found = np.zeros(len(time_s), bool)
    for at_s, name in events:
        if name in ("paused", "resumed"):
            found[time_s >= at_s] = name == "paused"
    return found
