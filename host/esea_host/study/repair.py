"""Repair of broken logs: the part after a break is moved aside, never deleted."""

from __future__ import annotations

from typing import Any

from esea_gen.errors import UserError
from esea_host.study.folder import WAIT_S, StudyFolder
from esea_host.study.log import EventLog, MovedAside
from esea_host.study.records import AUDIT


def repair(study: StudyFolder) -> list[str]:
    """Cut every log before its first break; return the actions, a sentence each.

    Entries of the audit trail behind the break that are intact in themselves are entered again.
    """
    study.must_know_operator()
    said = []
    with EventLog(study.path / AUDIT, study.durable, study.by, WAIT_S, mend=True) as trail:
        if trail.moved_aside:
            trail.append(None, "repair", _entry(AUDIT, trail.moved_aside, trail))
            again = _enter_again(trail, trail.moved_aside)
            said.append(f"{_told(AUDIT, trail.moved_aside)}; {again} of its entries are back")
        for code, number, log in study.sessions(every=True):
            name = log.relative_to(study.path).as_posix()
            who = {"participant": code, "session": number}
            try:
                session = EventLog(log, study.durable, study.by, mend=True)
            except UserError as error:
                said.append(f"{name}: not repaired: {error}")
                continue
            with session:
                if session.moved_aside:
                    entry = _entry(name, session.moved_aside, session)
                    if session.found.entries:
                        session.append(session.found.entries[-1].time_s, "repair", entry)
                    trail.append(None, "repair", entry | who)
                    said.append(_told(name, session.moved_aside))
            hashes = {e.hash for e in session.found.entries}
            if not session.moved_aside and study.ends().get((code, number), set()) - hashes:
                trail.append(None, "repair", {"log": name, "kept": len(hashes)} | who)
                said.append(f"{name}: its end is lost; the session continues from what remains")
            if session.moved_aside and not session.found.entries:
                log.unlink()  # the session begins anew
        for code, number in study.missing():
            name = study.log_of(code, number).relative_to(study.path).as_posix()
            who = {"participant": code, "session": number}
            trail.append(None, "repair", {"log": name, "kept": 0} | who)
            said.append(f"{name}: it is lost; the session starts again")
    return said


def _entry(name: str, moved: MovedAside, log: EventLog) -> dict[str, Any]:
    found = {"log": name, "aside": moved.file, "sha256": moved.sha256}
    return found | {"breaks": moved.breaks, "kept": len(log.found.entries)}


def _told(name: str, moved: MovedAside) -> str:
    return f"{name}: what was behind the break ({moved.breaks[0]}) is in {moved.file} beside it"


def _enter_again(trail: EventLog, moved: MovedAside) -> int:
    once = ("created", "enrol")
    known = {(e.kind, e.data.get("participant")) for e in trail.found.entries}
    count = 0
    for e in moved.lines:
        key = e.kind, e.data.get("participant")
        if e.kind not in once or key not in known:
            was = {"utc": e.utc, "by": e.by, "n": e.number}
            trail.append(None, e.kind, {**e.data, "restored": was})
            count += 1
        known.add(key)
    return count
