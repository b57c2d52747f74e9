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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.files import locked
from esea_gen.toml_file import read_text
from esea_gen.trust import inside, read_code
from esea_host.study.allocation import Allocations, stratum_named
from esea_host.study.log import EventLog, LogFound, LoggedEvent, read_log
from esea_host.study.plan import build_plan
from esea_host.study.privacy import fingerprint, keyed, study_key
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.records import AUDIT, check_record, consent_date, ends, lack, program
from esea_host.study.session import SessionState, StudySession, state_of
from esea_host.study.source import InputSource
from esea_host.study.task import Row

LONGEST_NAME = 100
REHEARSED = 0  # a rehearsal has the orders of the first place, whoever it is for
CODE = re.compile(r"^[A-Z]{1,3}[0-9]{2,4}$")
EVENTS, PROTOCOL, TASKS, TEXTS = "events.jsonl", "protocol.toml", "tasks", "texts"
NOT_CREATED = "its first entry, 'created', was changed"
WAIT_S = 30.0  # so long at most for another process to write its entry


def check_code(code: str) -> None:
    if not CODE.fullmatch(code):
        form = "one to three capitals and two to four digits, such as P01"
        fix = f"Codes are {form}; never a name or initials."
        raise UserError(f"{code!r} is not a participant code.", fix)


class StudyFolder:
    """by: the operator, for the record; a real study takes no entry without one."""

    def __init__(self, path: Path, protocol: Protocol, durable: bool = True, by: str = "") -> None:
        self.path, self.protocol, self.durable, self.by = path, protocol, durable, by.strip()
        self.left_out: list[Path] = []
        self._found, self._entries = LogFound(), list[LoggedEvent]()
        if len(self.by) > LONGEST_NAME or not self.by.isprintable():
            raise UserError(f"{by!r} is not an operator's name.", "Give at most 100 letters.")

    @classmethod
    def create(
        cls, path: Path, protocol: Protocol, simulated: bool, durable: bool = True, by: str = ""
    ) -> StudyFolder:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            what = f"{path}: cannot be made ({error.strerror})."
            raise UserError(what, "Name a new folder.") from None
        if any(path.iterdir()):
            raise UserError(f"{path} is not empty.", "Name a new folder; nothing is overwritten.")
        study = cls(path, protocol, durable, by)
        study.simulated = simulated
        study.must_know_operator()
        (path / PROTOCOL).write_text(protocol.text, encoding="utf-8", newline="\n")
        for folder, files in ((TASKS, protocol.code), (TEXTS, protocol.texts)):
            for file in files:
                (path / folder).mkdir(exist_ok=True)
                (path / folder / file.path.name).write_bytes(file.content)
        about: dict[str, Any] = {"content": study.content(), "program": program()}
        if not simulated:
            about |= {"key": fingerprint(study_key(path)), "allocation": "list"}
        study.record("created", protocol=protocol.file.name, simulated=simulated, **about)
        return study

    @classmethod
    def open(cls, path: Path, durable: bool = True, runs: bool = True, by: str = "") -> StudyFolder:
        if not (path / PROTOCOL).exists():
            raise UserError(f"{path} is not a study.", "Name the folder with protocol.toml.")
        tasks, texts = sorted((path / TASKS).glob("*.py")), sorted((path / TEXTS).glob("*.toml"))
        for file in (path / PROTOCOL, path / AUDIT, *tasks, *texts):
            inside(path, file.relative_to(path), str(path))
        text = read_text(path / PROTOCOL, "Name a study's folder.")
        given = [read_code(p) for p in tasks], runs, [read_code(p) for p in texts]
        return cls(path, parse_protocol(text, PROTOCOL, (), *given), durable, by)

    def content_at_first(self) -> Mapping[str, str]:
        """As :meth:`content` when the study was created."""
        created = next((d for k, d in self.audited(strict=False) if k == "created"), {})
        content = created.get("content")
        return content if isinstance(content, dict) else {}

    def content(self) -> dict[str, str]:
        found = {PROTOCOL: hashlib.sha256((self.path / PROTOCOL).read_bytes()).hexdigest()}
        found |= {f"{TASKS}/{c.path.name}": c.sha256 for c in self.protocol.code}
        return found | {f"{TEXTS}/{t.path.name}": t.sha256 for t in self.protocol.texts}

    # -- audit --------------------------------------------------------------------------------

    @cached_property
    def simulated(self) -> bool:
        """Whether no real person takes part; decided when the study was created."""
        first = next(iter(self.trail(strict=False)), None)
        if first is None or first.kind != "created" or not self._found.sound_bytes:
            raise UserError(f"{self.path / AUDIT}: {NOT_CREATED}.", "Restore the file from a copy.")
        return bool(first.data.get("simulated"))

    def must_know_operator(self) -> None:
        if not self.simulated and not self.by:
            fix = "Say who you are: --operator NAME, or ESEA_OPERATOR."
            raise UserError("In a real study every entry names who made it.", fix)

    def record(self, kind: str, **data: Any) -> None:
        """Add to the audit trail; :data:`~esea_host.study.records.RECORDS` says what a kind needs.

        On disk when this returns; other processes wait meanwhile.
        """
        self.record_all([(kind, data)])

    def record_all(self, entries: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        entries = list(entries)
        for kind, data in entries:
            check_record(kind, data)
        with self._trail() as log:
            for kind, data in entries:
                log.append(None, kind, data)

    @contextmanager
    def _trail(self) -> Iterator[EventLog]:
        # Between a look and the entry that depends on it no other process writes.
        self.must_know_operator()
        given = self.path / AUDIT, self.durable, self.by, WAIT_S
        with EventLog(*given, known=self._found) as log:
            if log.taken_over:
                log.append(None, "takeover", log.taken_over)
            yield log

    def trail(self, strict: bool = True) -> list[LoggedEvent]:
        """Entries of the audit trail; strict=False: the readable ones of a broken trail."""
        path = self.path / AUDIT
        found = read_log(path, self._found)
        if found is not self._found:
            self._found, self._entries = found, list(found.entries)
        if strict:
            found.sound(path)
        wrong = {e.number: words for e in self._entries if (words := lack(e.kind, e.data))}
        if strict and wrong:
            told = "; ".join(f"line {n + 1}: {words}" for n, words in wrong.items())
            raise UserError(f"{path}: {told}.", "Restore the file from a copy.")
        return [e for e in self._entries if e.number not in wrong]

    def audited(self, strict: bool = True) -> list[tuple[str, Mapping[str, Any]]]:
        """Kind and data of each entry of :meth:`trail`."""
        return [(e.kind, e.data) for e in self.trail(strict)]

    def changes(self) -> list[str]:
        """Protocol, tasks and texts that are not what the study was created with."""
        begun = self.content_at_first()
        now, since = self.content() if begun else {}, "since the study was created"
        how = {n: "changed" if n in begun else "added" for n in now if now[n] != begun.get(n)}
        how |= {n: "removed" for n in begun if n not in now}
        return [f"{name}: {how[name]} {since}" for name in sorted(how)]

    def problems(self) -> list[str]:
        """Every break of a chain, each with file and line; sessions shorter than was recorded."""
        record = read_log(self.path / AUDIT)
        found = [f"{AUDIT}: {b}" for b in record.breaks]
        lacks = [(e.number, lack(e.kind, e.data)) for e in record.entries]
        found += [f"{AUDIT}: line {n + 1}: {words}" for n, words in lacks if words]
        if not (record.breaks or self.content_at_first()):
            found.append(f"{AUDIT}: {NOT_CREATED}")
        found += self.changes()
        found += Allocations(self.path, self.protocol, self.trail(strict=False)).problems()
        gone = self._with("delete")
        for code, session, path in self.sessions(every=True):
            log = read_log(path)
            faults = list(log.breaks)
            if log.entries and not faults and code not in gone:
                try:
                    self.read(code, session, path)
                except UserError as error:
                    faults = [error.what.removeprefix(f"{path}: ").rstrip(".")]
            if code in gone:
                faults.append("of a participant whose data was deleted: delete it again")
            found += [f"{path.relative_to(self.path)}: {b}" for b in faults]
        missing = (f"{c}, session {n + 1}: its log is missing" for c, n in self.missing())
        return [*found, *missing]

    def ends(self) -> dict[tuple[str, int], set[str]]:
        """Of each session that has begun: the last hashes that it had whenever it ended."""
        return ends(self.audited(strict=False))

    def missing(self) -> list[tuple[str, int]]:
        """Sessions that have begun and have no log."""
        gone = self._with("delete")
        return sorted(k for k in self.ends() if k[0] not in gone and not self.begun(*k))

    def read(self, code: str, session: int, path: Path) -> SessionState:
        """State from the log in this place, if it belongs here and is as it was when it ended."""
        log, wrong = read_log(path).sound(path), ""
        state = state_of(log, path)
        if code not in self._with("enrol"):
            wrong = f"no participant with the code {code} is enrolled"
        elif (state.participant, state.plan.session, state.rehearsal) != (code, session, False):
            wrong = "the log of another session"
        elif self.ends().get((code, session), set()) - {e.hash for e in log.entries}:
            wrong = "changed since it ended"
        if wrong:
            fix = "Restore the file from a copy; what is lost: esea-host study repair FOLDER."
            raise UserError(f"{path}: {wrong}.", fix)
        return state

    # -- people -------------------------------------------------------------------------------

    def participants(self) -> dict[str, int]:
        """Codes in order of coming, those deleted since too: their places are not given again."""
        codes = [d["participant"] for k, d in self.audited() if k == "enrol"]
        return {code: k for k, code in enumerate(codes)}

    def _with(self, kind: str) -> set[str]:
        return {d["participant"] for k, d in self.audited(strict=False) if k == kind}

    def enrol(
        self,
        codes: str | Sequence[str],
        consent: bool,
        form: str = "",
        date: str = "",
        obtained_by: str = "",
        strata: Sequence[str] = (),
    ) -> None:
        """Take participants in; of the consent: the form's version, its date, who obtained it.

        strata: ``factor=level`` words of the allocation.
        """
        codes = [codes] if isinstance(codes, str) else codes
        stratum = stratum_named(self.protocol.file, strata)
        for code in codes:
            check_code(code)
            if not consent:
                fix = "Obtain written consent, then add --consent."
                raise UserError(f"{code} has not consented.", fix)
        self.must_know_operator()
        if not self.simulated and not form.strip():
            what = "A real study records which version of the consent form was signed."
            raise UserError(what, "Give --form VERSION.")
        given = {"date": consent_date(date), "form": form, "by": obtained_by or self.by}
        with self._trail() as log:
            self.allocations.must_not_have_made(self.by)
            known = self.participants()
            for code in codes:
                if code in known:
                    raise UserError(f"{code} is taken.", "Give the next code.")
                # In this order: an interrupt leaves nobody enrolled without a consent.
                log.append(None, "consent", {"participant": code, **given})
                log.append(None, "enrol", {"participant": code, "stratum": stratum})

    def withdraw(self, code: str, reason: str = "") -> None:
        """A participant withdraws: no more sessions, and the data is used no longer; it is kept."""
        with self._trail() as log:
            self._must_be_here(code)
            log.append(None, "withdraw", {"participant": code, "reason": reason})

    def _must_be_here(self, code: str) -> int:
        index = self.participants().get(code)
        if index is None or code in self._with("delete"):
            raise UserError(f"{code} is not in this study.", "Enrol the participant first.")
        if code in self._with("withdraw"):
            raise UserError(f"{code} has withdrawn.", "Choose another participant.")
        return index

    def log_of(self, code: str, session: int) -> Path:
        return self.path / code / f"session-{session + 1}" / EVENTS

    def begun(self, code: str, session: int) -> bool:
        """Whether its log has an event; one that was killed before the first has not begun."""
        path = self.log_of(code, session)
        return path.exists() and bool(read_log(path).entries)

    def sessions(self, code: str = "*", every: bool = False) -> Iterator[tuple[str, int, Path]]:
        """Code, number and log of each; of participants who have withdrawn only with every=True."""
        without = set() if every else self._with("withdraw")
        for path in sorted(self.path.glob(f"{code}/session-*/{EVENTS}")):
            number, whose = path.parent.name.removeprefix("session-"), path.parents[1].name
            if whose in without or not path.stat().st_size:  # killed before its first event
                continue
            if re.fullmatch("[1-9][0-9]{0,8}", number):
                yield whose, int(number) - 1, path

    def leave_out(self, path: Path, error: UserError) -> None:
        if path not in self.left_out:
            self.left_out.append(path)
            warnings.warn(f"{error.what} Its session is left out.", stacklevel=2)

    def rows(self, code: str, before: int | None = None, strict: bool = True) -> tuple[Row, ...]:
        """Rows of completed trials with their parameters, in order; of sessions ``before`` one."""
        found: list[Row] = []
        for _, session, path in self.sessions(code):
            if before is None or session < before:
                try:
                    state = self.read(code, session, path)
                except UserError as error:
                    if strict:
                        raise
                    self.leave_out(path, error)
                    continue
                given = {t.number: t.parameters for t in state.plan.trials}
                found += [{**given[r["trial"]], **r, "participant": code} for r in state.past]
        return tuple(found)

    def session(
        self,
        code: str,
        number: int,
        source: InputSource | None,
        day: int | None = None,
        early: str = "",
        rehearsal: Path | None = None,
        device: Mapping[str, Any] | None = None,
    ) -> StudySession:
        """Open a session for one writer; source: None only to change its log.

        rehearsal: its log, of :meth:`new_rehearsal`; it is nobody's session: any device, any code,
        and no data.  device: how it was named, so that the session goes on with the same.
        """
        stopping = self.protocol.file.stopping
        about = {"program": program(), "content": self.content(), "device": device or {}}
        given = self.durable, stopping, self.by, rehearsal is not None, about
        with self._trail() as trail:
            if rehearsal is not None:
                check_code(code)
                plan = build_plan(self.protocol, REHEARSED, number)
                session = StudySession(rehearsal, plan, code, source, (), *given)
                where = rehearsal.relative_to(self.path).as_posix()
                entry: dict[str, Any] = {"participant": code, "session": number, "log": where}
                return self._begun(session, trail, "rehearsal", entry)
            index = self._must_be_here(code)
            for earlier in range(number):
                path = self.log_of(code, earlier)
                if not self.begun(code, earlier) or self.read(code, earlier, path).remaining:
                    fix = "Run the sessions in order."
                    raise UserError(f"{code} has not done session {earlier + 1}.", fix)
            log = self.log_of(code, number)
            if self.begun(code, number):
                self.read(code, number, log)
            elif (code, number) in self.ends():
                fix = "Restore it from a copy; if it is lost: esea-host study repair FOLDER."
                raise UserError(f"{log} is missing, and the session was begun.", fix)
            elif source is None:
                raise UserError(f"{code} has not begun session {number + 1}.", "Name another one.")
            if source is not None:
                self.must_suit(source.simulated)
                self._washout(code, number, day, early)
            if not self.allocations.by_seed(code):  # else orders would tell who came when
                index = int.from_bytes(keyed(self.key, "order", code))
            plan = build_plan(self.protocol, index, number, self.group(code))
            rows = self.rows(code, number)
            seal = self.key if self.blinded("operator") else None
            session = StudySession(log, plan, code, source, rows, *given, seal)
            if source is None:
                return session
            entry = {"participant": code, "session": number, "day": day, "early": early}
            return self._begun(session, trail, "session_start", entry)

    def _begun(
        self, session: StudySession, trail: EventLog, kind: str, entry: Mapping[str, Any]
    ) -> StudySession:
        try:
            trail.append(None, kind, entry)
        except BaseException:
            session.close()
            raise
        return session

    def new_rehearsal(self, number: int) -> Path:
        """Where the log of a rehearsal goes: beside the sessions, in a folder of its own."""
        for k in count(1):
            with suppress(FileExistsError):
                folder = self.path / "rehearsals" / str(k)
                folder.mkdir(parents=True)
                break
        return folder / f"session-{number + 1}" / EVENTS

    def must_suit(self, simulated: bool) -> None:
        """Refuse a simulated device in a study of real people, and the other way round."""
        if simulated == self.simulated:
            return
        study, device = ("simulated", "real")[:: 1 if self.simulated else -1]
        raise UserError(
            f"{self.path} is a {study} study, and this device is {device}.",
            f"Name a {study} device, or rehearse with --rehearsal, which gives no data.",
        )

    def _washout(self, code: str, number: int, day: int | None, early: str) -> None:
        if day is None:
            return
        wanted = self.protocol.file.session[number].after_days
        begun = [d for k, d in self.audited() if k == "session_start" and d["participant"] == code]
        last = [d["day"] for d in begun if d["session"] < number and isinstance(d["day"], int)]
        if last and day < max(last) and not early:
            what = f"{code}: this computer's date is before that of the last session."
            raise UserError(what, "Set its clock, or add --early REASON.")
        if last and day - max(last) < wanted and not early:
            what = f"{code}: {day - max(last)} days since the last session, {wanted:g} are planned."
            raise UserError(what, "Wait until then, or add --early REASON.")

    def finish(self, session: StudySession) -> None:
        state = session.state
        if not state.rehearsal:
            who = {"participant": state.participant, "session": state.plan.session}
            self.record("session_end", **who, head=session.log.head)

    # -- groups -------------------------------------------------------------------------------

    @property
    def key(self) -> bytes:
        """The secret key of codes, orders and sealed values."""
        created = next((d for k, d in self.audited(strict=False) if k == "created"), {})
        key = study_key(self.path, make="key" not in created)
        if created.get("key", fingerprint(key)) != fingerprint(key):
            what = f"{self.path}: private/key is not the study's."
            raise UserError(what, "Restore that file from a copy.")
        return key

    @property
    def allocations(self) -> Allocations:
        return Allocations(self.path, self.protocol, self.trail(), lambda: self.key)

    def allocate(self, keep: Path, places: int, reason: str = "") -> list[str]:
        """Draw the sealed list, as a third person; returns its strata."""
        with self._trail() as trail:
            entry = self.allocations.make(self.by, keep, places, reason)
            trail.append(None, "allocate", entry)
        return list(entry["strata"])

    def disclose(self, code: str, opening: str = "") -> str:
        """Disclose the group for the first session; return the part that the operator may see."""
        with self._trail() as trail:
            self._must_be_here(code)
            allocations = self.allocations
            if allocations.group(code) is not None:
                return ""
            entry = allocations.disclose(code, opening, self.by, self.blinded("operator"))
            trail.append(None, "disclose", entry)
        group = self.group_shown(code, "operator")
        return f"{code}: place {entry['place']} of the list, group {group}"

    def group(self, code: str) -> str:
        group = self.allocations.group(code)
        if group is None:
            raise UserError(f"{code} has no group yet.", "Begin with the first session.")
        return group

    def blinded(self, role: str) -> bool:
        """Whether a role is blinded by the protocol, and has not been unblinded."""
        unblinded = {d["role"] for k, d in self.audited(strict=False) if k == "unblind"}
        return role in self.protocol.file.blinded and role not in unblinded

    def group_shown(self, code: str, to: str) -> str:
        """The group as it may be shown to ``operator`` or ``participant``."""
        if self.blinded(to):
            return "blinded"
        group = self.allocations.group(code)
        return "not disclosed yet" if group is None else group

    def delete(self, code: str, reason: str) -> int:
        """Delete a participant's data on demand; that it was done stays on record."""
        with self._trail() as trail:
            if code not in self.participants():
                raise UserError(f"{code} is not in this study.", "Name a participant of it.")
            for _, _, log in self.sessions(code, every=True):
                with locked(log.with_suffix(".lock"), self.by):
                    pass  # nobody writes it
            logs = [d for k, d in self.audited() if k == "rehearsal" and d["participant"] == code]
            tried = {name for d in logs for name in Path(d["log"]).parts[1:2]}
            folders = [p for p in self.path.glob("rehearsals/*") if p.name in tried]
            folders.append(self.path / code)
            found = (p for folder in folders for p in folder.rglob("*"))
            files = [p for p in found if p.is_file() and p.suffix != ".lock"]
            # First on record: what an interrupt leaves is named by audit, and deleted again.
            entry = {"participant": code, "files": len(files), "reason": reason}
            trail.append(None, "delete", entry)
            for folder in folders:
                shutil.rmtree(folder, ignore_errors=True)
        if left := [str(folder) for folder in folders if folder.exists()]:
            raise UserError(
                f"{', '.join(left)}: not everything could be deleted.",
                "Check its permissions and the programs that use it; then delete again.",
            )
        return len(files)
