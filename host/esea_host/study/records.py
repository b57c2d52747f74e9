"""Required contents of an entry of the audit trail, with the version of the program."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from datetime import date as calendar_date
from functools import cache
from pathlib import Path
from typing import Any

import esea_gen
import esea_host
from esea_gen.errors import UserError
from esea_gen.version import __version__
from esea_host.study.log import read_log

AUDIT = "audit.jsonl"

# Of an adverse event: CTCAE's grades in words; relation to the device as in ISO 14155.
SEVERITIES = ("mild", "moderate", "severe", "life-threatening", "fatal")
RELATIONS = ("not-related", "possible", "probable", "causal")
# By kind: of which type a value is, or which words it may be.
RECORDS: Mapping[str, Mapping[str, type | tuple[str, ...]]] = {
    "enrol": {"participant": str},
    "consent": {"participant": str, "date": str, "form": str, "by": str},
    "withdraw": {"participant": str},
    "delete": {"participant": str},
    "session_start": {"participant": str, "session": int},
    "session_end": {"participant": str, "session": int, "head": str},
    "deviation": {"text": str},
    "adverse": {
        "participant": str,
        "severity": SEVERITIES,
        "relation": RELATIONS,
        "action": str,
        "text": str,
    },
    "allocate": {"file": str, "sha256": str, "places": int},
    "disclose": {"participant": str, "stratum": str, "place": int},
    "unblind": {"role": str, "reason": str},
    "repair": {"log": str},
}


def lack(kind: str, data: Mapping[str, Any]) -> str:
    """Missing or wrong fields of an entry; empty: it is correct."""
    found = []
    for name, kind_of in RECORDS.get(kind, {}).items():
        value = data.get(name)
        if not isinstance(kind_of, tuple):
            found += [] if isinstance(value, kind_of) else [name]
        elif value not in kind_of:
            found.append(f"{name} ({', '.join(kind_of)})")
    return f"{kind} has no {', '.join(found)}" if found else ""


def check_record(kind: str, data: Mapping[str, Any]) -> None:
    empty = [
        n for n in RECORDS.get(kind, {}) if isinstance(x := data.get(n), str) and not x.strip()
    ]
    if wrong := lack(kind, data) or (f"{kind} has an empty {', '.join(empty)}" if empty else ""):
        raise UserError(f"Not recorded: {wrong}.", "Add it.")


@cache
def program() -> dict[str, str]:
    """Version of this program, and the SHA-256 of its Python and TOML files."""
    digest = hashlib.sha256()
    for top in (Path(str(m.__file__)).parent for m in (esea_gen, esea_host)):
        for file in sorted(top.rglob("*")):
            if file.suffix in (".py", ".toml"):
                name = file.relative_to(top.parent).as_posix()
                digest.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return {"version": __version__, "sha256": digest.hexdigest()}


def gone_from(folder: Path) -> set[str]:
    """Who has withdrawn, or whose data was deleted, by the study's audit trail if there is one."""
    path = folder / AUDIT
    entries = read_log(path).entries if path.exists() else ()
    return {str(e.data.get("participant")) for e in entries if e.kind in ("withdraw", "delete")}


def ends(entries: Iterable[tuple[str, Mapping[str, Any]]]) -> dict[tuple[str, int], set[str]]:
    """As :meth:`~esea_host.study.folder.StudyFolder.ends`."""
    found: dict[tuple[str, int], set[str]] = {}
    for kind, d in entries:
        if kind in ("session_start", "session_end"):
            known = found.setdefault((d["participant"], d["session"]), set())
            known |= {d["head"]} if kind == "session_end" else set()
        elif kind == "repair":  # its end may be in the part that was moved aside
            found.pop((str(d.get("participant", "")), d.get("session", 0)), None)
    return found


def consent_date(text: str) -> str:
    """Today, or a date in the form 2026-11-26 that is not in the future."""
    today = calendar_date.today()
    try:
        found = calendar_date.fromisoformat(text) if text else today
    except ValueError:
        raise UserError(f"{text!r} is not a date.", "Give it as 2026-11-26.") from None
    if found > today:
        raise UserError(f"{text} is in the future.", "Give the day on which it was signed.")
    return found.isoformat()
