"""The folder of a study: participants by code, consent, groups, audit, deletion.

``protocol.toml`` is the protocol as it was at the start, with the ``tasks`` it names,
``audit.jsonl`` the chained record of all that was done, ``<code>/session-<n>/events.jsonl`` each
session.  No name of a person is anywhere.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.toml_file import read_text
from esea_host.study.allocation import Allocations, stratum_named
from esea_host.study.log import EventLog, LoggedEvent, read_log
from esea_host.study.plan import build_plan
from esea_host.study.privacy import fingerprint, keyed, study_key
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.session import StudySession, read_session, state_of
from esea_host.study.source import InputSource
from esea_host.study.task import Row
from esea_host.study.trust import inside, read_code

CODE = re.compile(r"^[A-Z]{1,3}[0-9]{2,4}$")
EVENTS, AUDIT, PROTOCOL, TASKS = "events.jsonl", "audit.jsonl", "protocol.toml", "tasks"

# What the record of a study must hold, by kind, where it is read again.
_HELD: Mapping[str, Mapping[str, type]] = {
    "enrol": {"participant": str},
    "delete": {"participant": str},
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
        for code in protocol.code:
            (path / TASKS).mkdir(exist_ok=True)
            (path / TASKS / code.path.name).write_bytes(code.content)
        study = cls(path, protocol, durable)
        content = study.content()
        known = {} if simulated else {"key": fingerprint(study_key(path)), "allocation": "list"}
        known |= {"protocol": protocol.file.name, "simulated": simulated, "content": content}
        study.audit("created", **known)
        return study

    @classmethod
    def open(cls, path: Path, durable: bool = True, runs: bool = True) -> StudyFolder:
        """A study that is there."""
        if not (path / PROTOCOL).exists():
            raise UserError(f"{path} is no study.", "Name the folder with protocol.toml.")
        files = [path / PROTOCOL, path / AUDIT, *sorted((path / TASKS).glob("*.py"))]
        for file in files:
            inside(path, file.relative_to(path), str(path))
        text = read_text(path / PROTOCOL, "Name a study's folder.")
        codes = [read_code(p) for p in files[2:]]
        return cls(path, parse_protocol(text, PROTOCOL, (), codes, runs), durable)

    def content_at_first(self) -> Mapping[str, str]:
        """As :meth:`content` when the study was created; empty where it was not recorded."""
        created = next((d for k, d in self.audited_anyway() if k == "created"), {})
        content = created.get("content")
        return content if isinstance(content, dict) else {}

    def content(self) -> dict[str, str]:
        found = {PROTOCOL: hashlib.sha256((self.path / PROTOCOL).read_bytes()).hexdigest()}
        return found | {f"{TASKS}/{c.path.name}": c.sha256 for c in self.protocol.code}

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
        gone = {d["participant"] for k, d in self.audited_anyway() if k == "delete"}
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
        codes = [d["participant"] for k, d in self.audited() if k == "enrol"]
        return {code: k for k, code in enumerate(codes)}

    by = ""  # SHIM

    def trail(self, strict: bool = True) -> list[LoggedEvent]:
        return list(read_log(self.path / AUDIT).entries)

    def record(self, kind: str, **data: Any) -> None:
        self.audit(kind, **data)

    @property
    def key(self) -> bytes:
        """The secret key of codes, orders and sealed values."""
        key = study_key(self.path)
        created = next((d for k, d in self.audited_anyway() if k == "created"), {})
        if created.get("key", fingerprint(key)) != fingerprint(key):
            raise UserError(
                f"{self.path}: private/key is not the study's.", "Restore that file from a copy."
            )
        return key

    @property
    def allocations(self) -> Allocations:
        return Allocations(self.path, self.protocol, self.trail(), self.key)

    def disclose(self, code: str, opening: str = "") -> str:
        """Disclose the group for the first session; what may be told of it to the operator."""
        found = self.allocations
        if found.group(code) is not None:
            return ""
        told = found.disclose(code, opening, self.by, self.blinded("operator"))
        self.record("disclose", **told)
        group = self.group_shown(code, "operator")
        return f"{code}: place {told['place']} of the list, group {group}"

    def blinded(self, role: str) -> bool:
        """Whether a role is blinded by the protocol, and has not been unblinded."""
        unblinded = {d["role"] for k, d in self.audited() if k == "unblind"}
        return role in self.protocol.file.blinded and role not in unblinded

    def enrol(self, code: str, consent: bool, strata: Sequence[str] = ()) -> None:
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
        stratum = stratum_named(self.protocol.file, strata)
        self.audit("enrol", participant=code, consent=True, stratum=stratum)

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
            k == "delete" and d["participant"] == code for k, d in self.audited()
        ):
            raise UserError(f"{code} is not in this study.", "Enrol the participant first.")
        for earlier in range(number):
            path = self.log_of(code, earlier)
            if not path.exists() or read_session(path).remaining:
                raise UserError(
                    f"{code} has not done session {earlier + 1}.", "Sessions come in their order."
                )
        self._washout(code, number, day, early)
        allocations = self.allocations
        group = allocations.group(code)
        if group is None:
            raise UserError(f"{code} has no group yet.", "Begin with the first session.")
        if allocations.needs_list:  # else the exported orders would tell who came when
            index = int.from_bytes(keyed(self.key, "order", code))
        plan = build_plan(self.protocol, index, number, group)
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
        if self.blinded(to):
            return "blinded"
        group = self.allocations.group(code)
        return "not disclosed yet" if group is None else group

    def delete(self, code: str, reason: str) -> int:
        """Delete a participant's data on demand; that it was done stays on record."""
        if code not in self.participants():
            raise UserError(f"{code} is not in this study.", "Name a participant of it.")
        files = [p for p in (self.path / code).rglob("*") if p.is_file()]
        shutil.rmtree(self.path / code, ignore_errors=True)
        self.audit("delete", participant=code, files=len(files), reason=reason)
        return len(files)
