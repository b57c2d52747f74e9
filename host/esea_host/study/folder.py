"""The folder of a study: participants by code, consent, groups, audit, deletion, export.

``protocol.toml`` is the protocol as it was at the start, with the ``tasks`` it names,
``audit.jsonl`` the chained record of all that was done, ``<code>/session-<n>/events.jsonl`` each
session.  No name of a person is anywhere.
"""

from __future__ import annotations

import csv
import hashlib
import json
import re
import shutil
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.files import new_whole
from esea_gen.toml_file import read_text
from esea_host.study.log import EventLog, LoggedEvent, read_log
from esea_host.study.plan import build_plan, generator, group_of
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.session import StudySession, read_session, state_of
from esea_host.study.source import InputSource
from esea_host.study.task import Row
from esea_host.study.trust import inside, read_code

CODE = re.compile(r"^[A-Z]{1,3}[0-9]{2,4}$")
EVENTS, AUDIT, PROTOCOL, TASKS = "events.jsonl", "audit.jsonl", "protocol.toml", "tasks"
TEXTS = "texts"

# What the record of a study must hold, by kind, where it is read again.
_HELD: Mapping[str, Mapping[str, type]] = {
    "enrolled": {"participant": str},
    "deleted": {"participant": str},
    "session_start": {"participant": str, "session": int, "day": int},
    "session_end": {"participant": str, "session": int, "head": str},
}


def _lack(e: LoggedEvent) -> str:
    held = _HELD.get(e.kind, {})
    names = [n for n, kind in held.items() if not isinstance(e.data.get(n), kind)]
    return f"{e.kind} has no {', '.join(names)}" if names else ""


class StudyFolder:
    def __init__(self, path: Path, protocol: Protocol, durable: bool = True) -> None:
        self.path, self.protocol, self.durable = path, protocol, durable
        self.left_out: list[Path] = []

    @classmethod
    def create(
        cls, path: Path, protocol: Protocol, simulated: bool, durable: bool = True
    ) -> StudyFolder:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(
                f"{path}: cannot be made ({error.strerror}).", "Name a new folder."
            ) from None
        if any(path.iterdir()):
            raise UserError(f"{path} is not empty.", "Name a new folder; nothing is overwritten.")
        (path / PROTOCOL).write_text(protocol.text, encoding="utf-8")
        for folder, files in ((TASKS, protocol.code), (TEXTS, protocol.texts)):
            for file in files:
                (path / folder).mkdir(exist_ok=True)
                (path / folder / file.path.name).write_bytes(file.content)
        study = cls(path, protocol, durable)
        content = study.content()
        study.audit("created", protocol=protocol.file.name, simulated=simulated, content=content)
        return study

    @classmethod
    def open(cls, path: Path, durable: bool = True, runs: bool = True) -> StudyFolder:
        """A study that is there."""
        if not (path / PROTOCOL).exists():
            raise UserError(f"{path} is no study.", "Name the folder with protocol.toml.")
        tasks, texts = sorted((path / TASKS).glob("*.py")), sorted((path / TEXTS).glob("*.toml"))
        for file in (path / PROTOCOL, path / AUDIT, *tasks, *texts):
            inside(path, file.relative_to(path), str(path))
        text = read_text(path / PROTOCOL, "Name a study's folder.")
        given = [read_code(p) for p in tasks], runs, [read_code(p) for p in texts]
        return cls(path, parse_protocol(text, PROTOCOL, (), *given), durable)

    def content_at_first(self) -> Mapping[str, str]:
        """As :meth:`content` when the study was created; empty where it was not recorded."""
        created = next((d for k, d in self.audited_anyway() if k == "created"), {})
        content = created.get("content")
        return content if isinstance(content, dict) else {}

    def content(self) -> dict[str, str]:
        found = {PROTOCOL: hashlib.sha256((self.path / PROTOCOL).read_bytes()).hexdigest()}
        found |= {f"{TASKS}/{c.path.name}": c.sha256 for c in self.protocol.code}
        return found | {f"{TEXTS}/{t.path.name}": t.sha256 for t in self.protocol.texts}

    # -- audit --------------------------------------------------------------------------------

    def audit(self, kind: str, **data: Any) -> None:
        log = EventLog(self.path / AUDIT, self.durable)
        log.append(0.0, kind, data)
        log.close()

    def audited(self) -> list[tuple[str, Mapping[str, Any]]]:
        path = self.path / AUDIT
        entries = read_log(path).sound(path).entries
        if problems := [f"line {e.number + 1}: {_lack(e)}" for e in entries if _lack(e)]:
            raise UserError(f"{path}: {'; '.join(problems)}.", "Restore the file from a copy.")
        return [(e.kind, e.data) for e in entries]

    @property
    def simulated(self) -> bool:
        return any(k == "created" and bool(d.get("simulated")) for k, d in self.audited())

    def problems(self) -> list[str]:
        """Every break of a chain, each with file and line; sessions shorter than was recorded."""
        record = read_log(self.path / AUDIT)
        found = [f"{AUDIT}: {b}" for b in record.breaks]
        found += [f"{AUDIT}: line {e.number + 1}: {_lack(e)}" for e in record.entries if _lack(e)]
        begun = self.content_at_first()
        now = self.content() if begun else {}
        for name in sorted({*now, *begun}):
            if now.get(name) != begun.get(name):
                change = "added" if name not in begun else "changed" if name in now else "removed"
                found.append(f"{name}: {change} since the study was created")
        heads = {
            (d["participant"], d["session"]): d["head"]
            for k, d in self.audited_anyway()
            if k == "session_end"
        }
        gone = {d["participant"] for k, d in self.audited_anyway() if k == "deleted"}
        for code, session, path in self.sessions():
            log = read_log(path)
            faults = list(log.breaks)
            if log.entries and not faults:
                try:
                    state_of(log, path)
                except UserError as error:
                    faults = [error.what.removeprefix(f"{path}: ").rstrip(".")]
            found += [f"{path.relative_to(self.path)}: {b}" for b in faults]
            head = heads.get((code, session))
            if head is not None and head not in {e.hash for e in log.entries}:
                found.append(f"{path.relative_to(self.path)}: not what it was when it ended")
        present = {(c, s) for c, s, _ in self.sessions()}
        for code, session in sorted(set(heads) - present):
            if code not in gone:
                found.append(f"{code}, session {session + 1}: its log is missing")
        return found

    def audited_anyway(self) -> list[tuple[str, Mapping[str, Any]]]:
        """As :meth:`audited`, of a broken record too: what can be read of it."""
        return [(e.kind, e.data) for e in read_log(self.path / AUDIT).entries if not _lack(e)]

    # -- people -------------------------------------------------------------------------------

    def participants(self) -> dict[str, int]:
        """Codes in order of coming, those deleted since too: their places are not given again."""
        codes = [d["participant"] for k, d in self.audited() if k == "enrolled"]
        return {code: k for k, code in enumerate(codes)}

    def enrol(self, code: str, consent: bool) -> None:
        if not CODE.match(code):
            raise UserError(
                f"{code!r} is no participant code.",
                "Codes are one to three capitals and two to four digits, such as P01; never a "
                "name or initials.",
            )
        if not consent:
            raise UserError(
                f"{code} has not consented.", "Without written consent nothing starts: --consent."
            )
        if code in self.participants():
            raise UserError(f"{code} is taken.", "Give the next code.")
        self.audit("enrolled", participant=code, consent=True)

    def log_of(self, code: str, session: int) -> Path:
        return self.path / code / f"session-{session + 1}" / EVENTS

    def sessions(self) -> Iterator[tuple[str, int, Path]]:
        for path in sorted(self.path.glob(f"*/session-*/{EVENTS}")):
            number = path.parent.name.removeprefix("session-")
            if re.fullmatch("[1-9][0-9]{0,8}", number):
                yield path.parents[1].name, int(number) - 1, path

    def leave_out(self, path: Path, error: UserError) -> None:
        if path not in self.left_out:
            self.left_out.append(path)
            warnings.warn(f"{error.what} Its session is left out.", stacklevel=2)

    def rows(self, code: str, before: int | None = None, strict: bool = True) -> tuple[Row, ...]:
        """Rows of a participant's completed trials, in order; of sessions ``before`` one only."""
        found: list[Row] = []
        for c, session, path in self.sessions():
            if c == code and (before is None or session < before):
                try:
                    past = read_session(path).past
                except UserError as error:
                    if strict:
                        raise
                    self.leave_out(path, error)
                    continue
                found += [{**row, "participant": code} for row in past]
        return tuple(found)

    def session(
        self, code: str, number: int, source: InputSource, day: int | None = None, early: str = ""
    ) -> StudySession:
        index = self.participants().get(code)
        if index is None or any(
            k == "deleted" and d["participant"] == code for k, d in self.audited()
        ):
            raise UserError(f"{code} is not in this study.", "Enrol the participant first.")
        for earlier in range(number):
            path = self.log_of(code, earlier)
            if not path.exists() or read_session(path).remaining:
                raise UserError(
                    f"{code} has not done session {earlier + 1}.", "Sessions come in their order."
                )
        self._washout(code, number, day, early)
        plan = build_plan(self.protocol, index, number)
        log, rows = self.log_of(code, number), self.rows(code, number)
        stopping = self.protocol.file.stopping
        return StudySession(log, plan, code, source, rows, self.durable, stopping)

    def _washout(self, code: str, number: int, day: int | None, early: str) -> None:
        if day is None:
            return
        wanted = self.protocol.file.session[number].after_days
        begun = [d for k, d in self.audited() if k == "session_start" and d["participant"] == code]
        last = [d["day"] for d in begun if d["session"] < number]
        if last and day - max(last) < wanted and not early:
            raise UserError(
                f"{code}: {day - max(last)} days since the last session, {wanted:g} are planned.",
                "Come back then, or say why not.",
            )
        self.audit("session_start", participant=code, session=number, day=day, early=early)

    def finish(self, code: str, number: int, session: StudySession) -> None:
        self.audit("session_end", participant=code, session=number, head=session.log.head)

    def group_shown(self, code: str, to: str) -> str:
        """The group as it may be shown to ``operator`` or ``participant``."""
        if to in self.protocol.file.blinded:
            return "blinded"
        return group_of(self.protocol, self.participants()[code])

    def delete(self, code: str, reason: str) -> int:
        """Delete a participant's data on demand; that it was done stays on record."""
        if code not in self.participants():
            raise UserError(f"{code} is not in this study.", "Name a participant of it.")
        files = [p for p in (self.path / code).rglob("*") if p.is_file()]
        shutil.rmtree(self.path / code, ignore_errors=True)
        self.audit("deleted", participant=code, files=len(files), reason=reason)
        return len(files)

    # -- export -------------------------------------------------------------------------------

    def new_codes(self, seed: int) -> dict[str, str]:
        codes = sorted({c for c, _, _ in self.sessions()})
        order = generator(seed, 3).permutation(len(codes))
        return {f"S{k + 1:03d}": codes[int(place)] for k, place in enumerate(order)}

    def scrubbed(self, seed: int) -> list[dict[str, Any]]:
        named = self.new_codes(seed).items()
        return [
            {**r, "participant": new} for new, old in named for r in self.rows(old, strict=False)
        ]

    def export(self, out: Path, seed: int = 0) -> int:
        """Write data for others: new codes in random order, no notes, no audit, no group order."""
        rows = self.scrubbed(seed)
        names = sorted({n for r in rows for n, x in r.items() if not isinstance(x, list | dict)})
        with new_whole(out) as scratch:
            scratch.mkdir()
            with (scratch / "rows.jsonl").open("w", encoding="utf-8") as file:
                file.writelines(json.dumps(r, sort_keys=True) + "\n" for r in rows)
            with (scratch / "rows.csv").open("w", encoding="utf-8", newline="") as file:
                writer = csv.DictWriter(file, names, extrasaction="ignore")
                writer.writeheader()
                writer.writerows(rows)
            (scratch / "protocol.toml").write_text(self.protocol.text, encoding="utf-8")
        return len(rows)
