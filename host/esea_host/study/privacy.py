"""Secret key of a study: export codes, sealed values, search for personal data.

``private/key`` is random and made with the study.  Nothing in ``private`` is ever exported: the
laboratory's list of names and consents belongs there too.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import hmac
import json
import os
import re
import secrets
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from esea_gen.errors import UserError

NONCE_BYTES = 12  # NIST SP 800-38D, 5.2.1.1
PRIVATE, KEY, SEALED = "private", "key", "sealed"
LEFT_OUT = "left out"  # in place of a value that a blinded person would see


def write_secret(path: Path, text: str) -> None:
    """Write a new file that only its owner can read; an error if there is one."""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise UserError(f"{path}: cannot be made ({error.strerror}).", "Name a new file.") from None
    with os.fdopen(file, "w", encoding="utf-8", newline="\n") as out:
        out.write(text)
        out.flush()
        os.fsync(out.fileno())


def study_key(folder: Path, make: bool = True) -> bytes:
    """The study's secret key; make: a study that has none gets one."""
    path = folder / PRIVATE / KEY
    if make and not path.exists():
        write_secret(path, secrets.token_hex(32) + "\n")
    try:
        key = bytes.fromhex(path.read_text(encoding="ascii"))
        if len(key) == 32:
            return key
    except (OSError, ValueError):
        pass
    raise UserError(f"{path}: cannot be read as a key.", "Restore the file from a copy.")


def key_above(path: Path) -> bytes:
    """The key of the study that a file is of."""
    for folder in path.parents:
        if (folder / PRIVATE / KEY).exists():
            return study_key(folder)
    raise UserError(
        f"{path} is sealed, and no {PRIVATE}/{KEY} is there.", "Restore that file from a copy."
    )


def fingerprint(key: bytes) -> str:
    return hashlib.sha256(key).hexdigest()[:16]


def keyed(key: bytes, *words: object) -> bytes:
    """32 bytes that follow from key and words, and that nobody without the key can compute."""
    return hmac.digest(key, json.dumps([str(w) for w in words]).encode(), "sha256")


def readable(digest: bytes, length: int) -> str:
    """Letters and digits, 5 bits each."""
    return base64.b32encode(digest).decode()[:length]


def export_codes(key: bytes, codes: Iterable[str]) -> dict[str, str]:
    """New code to participant, in the new codes' order: the same in every export of a study."""
    found = {f"S{readable(keyed(key, 'export', c), 8)}": c for c in codes}
    return dict(sorted(found.items()))


def sealed(key: bytes, value: Any) -> str:
    """A value that only who has the key can read or change (AES-256-GCM)."""
    plain = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    plain += b" " * (-len(plain) % 256)  # the length would tell
    nonce = secrets.token_bytes(NONCE_BYTES)
    return base64.b64encode(nonce + AESGCM(key).encrypt(nonce, plain, None)).decode()


def unsealed(key: bytes, text: str) -> Any:
    raw = base64.b64decode(text, validate=True)
    try:
        return json.loads(AESGCM(key).decrypt(raw[:NONCE_BYTES], raw[NONCE_BYTES:], None))
    except InvalidTag:
        raise UserError(
            f"A sealed value does not open with {PRIVATE}/{KEY}.", "Restore that file from a copy."
        ) from None


# -- what could identify a person ------------------------------------------------------------------

_PATTERNS = {
    "a date": r"\b(19|20)\d\d-[01]\d-[0-3]\d\b|\b[0-3]?\d[./][01]?\d[./](19|20)?\d\d\b",
    "a time of day": r"\b[0-2]\d:[0-5]\d(:[0-5]\d)?\b",
    "a time since 1970": r"(?<![\d.])1[5-9]\d{8}(\d{3}|\d{6}|\d{9})?(\.\d+)?(?![\d.])",
    "an e-mail address": r"[\w.+-]+@[\w-]+\.\w+",
    "a telephone number": r"\+\d[\d ()/-]{7,}\d",
}
_ABOUT_PEOPLE = re.compile(
    r"(^|_)(age|birth\w*|born|sex|gender|height|mass|weight|name|initials|address|city|site|centre|"
    r"hand\w*|diagnos\w*|race|ethnic\w*|occupation|date|time_of_day)(_|$)"
)
_PLAIN = re.compile(r"[-+\d.eE]+|True|False|true|false|n/a")
_OURS = ("participant", "participant_id", "filename", "trial_type")  # codes, names of events
FEW = 5
SHOWN = 6


def findings(
    folder: Path, codes: Collection[str], people: Collection[str], words: Collection[str]
) -> list[str]:
    """Content of exported files that could identify a person; words: those of the protocol."""
    found = []
    holders: dict[tuple[str, str], dict[str, set[str]]] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        if path.suffix == ".parquet" or path.name.endswith(("_motion.tsv", "_channels.tsv")):
            continue  # looked at as rows; numbers without a head; names and units of signals
        name, text = path.relative_to(folder).as_posix(), path.read_text(encoding="utf-8")
        patterns = dict(_PATTERNS)
        for what, known in (("a participant's code", codes), ("a person of the record", people)):
            if names := "|".join(map(re.escape, sorted(filter(None, known)))):
                patterns[what] = rf"(?<!\w)({names})(?!\w)"
        for what, pattern in patterns.items():
            if hits := sorted({m[0] for m in re.finditer(pattern, text)}):
                found.append(f"{name}: {what}: {', '.join(hits[:SHOWN])}")
        if path.suffix == ".toml" and (notes := re.findall(r"(?m)^\s*#(?! SIMULATED).*$", text)):
            found.append(f"{name}: {len(notes)} lines of comments: read them")
        for column, value, who in _cells_of(path):
            holders.setdefault((path.suffix, column), {}).setdefault(value, set()).add(who)
    for (_, column), values in holders.items():
        texts = sorted(v for v in values if v not in words and not _PLAIN.fullmatch(v))
        if texts and column not in _OURS:
            shown = ", ".join(repr(t[:60]) for t in texts[:SHOWN])
            found.append(f"column {column}: free text, {len(texts)} different: {shown}")
        if _ABOUT_PEOPLE.search(column):
            alone = sum(len(people) == 1 for people in values.values())
            found.append(f"column {column}: about the person; {alone} values occur in one only")
    count = len({w for values in holders.values() for ws in values.values() for w in ws})
    if count < FEW:
        found.append(f"{count} participants: those who know who took part may recognise them")
    return list(dict.fromkeys(found))


def _cells_of(path: Path) -> Iterator[tuple[str, str, str]]:
    # Column, value and whose it is, of tables with a head.
    if path.suffix in (".csv", ".tsv"):
        with path.open(encoding="utf-8", newline="") as file:
            table = csv.DictReader(file, delimiter="\t" if path.suffix == ".tsv" else ",")
            for row in table:
                who = row.get("participant") or path.name.partition("_")[0]
                yield from ((k, v, who) for k, v in row.items() if k and v)
    elif path.name == "rows.jsonl":
        for line in path.read_text(encoding="utf-8").splitlines():
            whole: Mapping[str, Any] = json.loads(line)
            nested = ((k, v) for k, x in whole.items() if isinstance(x, list) for v in x)
            yield from ((k, v, whole["participant"]) for k, v in nested if isinstance(v, str))
