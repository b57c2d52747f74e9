"""The list of allocations: drawn by a third person, sealed, opened one place at a time.

The study's folder holds a commitment for each place: SHA-256 over stratum, place, group and an
opening code of 80 random bits.  The list with groups and codes is a file of the third person.  A
code opens its place and no other, and no other group can be read into it.
"""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
import os
import re
import secrets
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.toml_file import read_text
from esea_host.study.log import LoggedEvent
from esea_host.study.plan import group_of
from esea_host.study.privacy import SEALED, keyed, readable, sealed, unsealed, write_secret
from esea_host.study.protocol import Protocol, ProtocolFile, block_sizes


@dataclass(frozen=True)
class Envelope:
    """A place of the list; the code opens it."""

    stratum: str
    place: int
    group: str
    code: str

    @property
    def commitment(self) -> str:
        return hashlib.sha256("|".join(map(str, astuple(self))).encode()).hexdigest()


def strata_of(file: ProtocolFile) -> list[str]:
    """Every combination of levels: ``sex=f,site=Bern``; without strata, one unnamed."""
    factors = file.allocation.strata
    each = itertools.product(*factors.values())
    return [",".join(f"{f}={x}" for f, x in zip(factors, levels, strict=True)) for levels in each]


def stratum_named(file: ProtocolFile, given: Sequence[str]) -> str:
    """The stratum of ``factor=level`` words, in whatever order."""
    wanted = sorted(filter(None, (w.strip() for text in given for w in text.split(","))))
    for stratum in strata_of(file):
        if sorted(filter(None, stratum.split(","))) == wanted:
            return stratum
    factors = file.allocation.strata
    told = "; ".join(f"{f}: {' or '.join(levels)}" for f, levels in factors.items())
    raise UserError(
        f"{', '.join(given) or 'No stratum'}: the protocol's strata are {told or 'none'}.",
        "Give each factor once: " + " ".join(f"--stratum {f}=..." for f in factors)
        if factors
        else "Leave --stratum out.",
    )


def draw_list(file: ProtocolFile, secret: bytes, places: int, first: int = 1) -> list[Envelope]:
    """Permuted blocks of random sizes, in every stratum; the last block may be cut."""
    groups, sizes = sorted(file.groups), block_sizes(file)
    found = []
    for stratum in strata_of(file):
        order: list[str] = []
        while len(order) < places:
            at = first + len(order)
            draw = int.from_bytes(keyed(secret, "size", stratum, at))
            block = groups * (sizes[draw % len(sizes)] // len(groups))
            # In the order of keyed digests: without the secret every order is as likely.
            by_digest = sorted((keyed(secret, stratum, at, k), g) for k, g in enumerate(block))
            order += [group for _, group in by_digest]
        for place, group in enumerate(order[:places], first):
            code = readable(keyed(secret, "code", stratum, place), 16)
            found.append(Envelope(stratum, place, group, code))
    return found


# -- the third person's file -----------------------------------------------------------------------

_HEAD = (
    "# SEALED LIST of allocations: for the person who made it, not for those who run sessions.\n"
)


def write_list(path: Path, envelopes: Sequence[Envelope], secret: bytes) -> None:
    """The seed makes the list again."""
    text = io.StringIO()
    text.write(_HEAD + f"# seed: {secret.hex()}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f.name for f in fields(Envelope)])
    for e in envelopes:
        code = "-".join(e.code[k : k + 4] for k in range(0, len(e.code), 4))
        writer.writerow([e.stratum, e.place, e.group, code])
    write_secret(path, text.getvalue())


def code_in(path: Path, stratum: str, place: int) -> str:
    """The opening code of a place, out of the sealed list."""
    text = read_text(path, "Name the file that study allocate wrote.")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    for row in csv.DictReader(lines):
        if (row.get("stratum"), row.get("place")) == (stratum, str(place)):
            return str(row.get("code"))
    raise UserError(
        f"{path} has no place {place}{_of(stratum)}.", "Name this study's complete list."
    )


def _of(stratum: str) -> str:
    return f" of stratum {stratum}" if stratum else ""


# -- of one study ----------------------------------------------------------------------------------


class Allocations:
    """Group allocations in a study's record.

    A study of real people has a list.  A simulated one has the groups that follow from the
    protocol's seed until a list is made, and who has begun keeps them.
    """

    def __init__(
        self,
        folder: Path,
        protocol: Protocol,
        trail: Sequence[LoggedEvent],
        key: Callable[[], bytes] = bytes,
    ) -> None:
        self.folder, self.protocol, self.trail, self.key = folder, protocol, trail, key
        self.lists = [e for e in trail if e.kind == "allocate"]
        self._strict = any(
            e.kind == "created" and e.data.get("allocation") == "list" for e in trail
        )
        self.needs_list = bool(protocol.file.groups) and (self._strict or bool(self.lists))
        until = self.lists[0].number if self.lists else len(trail)
        self._begun = {
            e.data["participant"]
            for e in trail
            if e.kind in ("session_start", "session_end") and e.number < until
        }
        enrolled = [e.data for e in trail if e.kind == "enrol"]
        self._strata = {d["participant"]: d.get("stratum", "") for d in enrolled}
        self._opened = {e.data["participant"]: e.data for e in trail if e.kind == "disclose"}

    def by_seed(self, code: str) -> bool:
        """Whether group and orders follow from the protocol's seed."""
        return not self._strict and (not self.lists or code in self._begun)

    def group(self, code: str) -> str | None:
        """The group; None until it is disclosed."""
        if not self.protocol.file.groups:
            return ""
        if self.by_seed(code):
            return group_of(self.protocol, list(self._strata).index(code))
        told = self._opened.get(code)
        if told is None:
            return None
        return str(unsealed(self.key(), told[SEALED])[0] if SEALED in told else told["group"])

    def stratum(self, code: str) -> str:
        return str(self._strata[code])

    def places(self) -> int:
        return sum(int(e.data["places"]) for e in self.lists)

    def make(self, by: str, keep: Path, places: int, reason: str) -> dict[str, Any]:
        """Draw a list: commitments into the study, the list into the third person's file."""
        file = self.protocol.file
        if not file.groups:
            raise UserError("The protocol has no groups to allocate.", "Add [groups].")
        if not by or by in {e.by for e in self.trail if e.kind not in ("created", "allocate")}:
            fix = "Give --operator with the name of somebody who neither enrols nor runs sessions."
            raise UserError(f"The list is made by a third person, not by {by or 'nobody'}.", fix)
        if keep.resolve().is_relative_to(self.folder.resolve()):
            fix = "Keep the list where those who run sessions cannot read it."
            raise UserError(f"{keep} is in the study's folder.", fix)
        if self.lists and not reason:
            raise UserError(
                f"There is a list of {self.places()} places; {len(self._opened)} are open.",
                "It is not drawn again. If a stratum has no place left, give --reason: further "
                "places are added behind.",
            )
        secret = secrets.token_bytes(32)
        envelopes = draw_list(file, secret, places, self.places() + 1)
        name = f"allocation-{len(self.lists) + 1}.json"
        committed: dict[str, list[str]] = {}
        for e in envelopes:
            committed.setdefault(e.stratum, []).append(e.commitment)
        text = json.dumps(committed, indent=1) + "\n"
        write_list(keep, envelopes, secret)
        write_whole(self.folder / name, text)
        return {
            "places": places,
            "strata": strata_of(file),
            "blocks": list(block_sizes(file)),
            "file": name,
            "sha256": hashlib.sha256(text.encode()).hexdigest(),
            "reason": reason,
        }

    def _seals(self, made: LoggedEvent) -> dict[str, list[str]]:
        path, fix = self.folder / str(made.data["file"]), "Restore the file from a copy."
        text = read_text(path, fix)
        if hashlib.sha256(text.encode()).hexdigest() != made.data["sha256"]:
            raise UserError(f"{path} is not what study allocate wrote.", fix)
        return dict(json.loads(text))

    def problems(self) -> list[str]:
        """Sealed lists that differ from the written ones."""
        found = []
        for made in self.lists:
            try:
                self._seals(made)
            except UserError as error:
                found.append(error.what.rstrip("."))
        return found

    def must_not_have_made(self, by: str) -> None:
        if by and by in {e.by for e in self.lists}:
            fix = "Let somebody else enrol people and run the sessions."
            raise UserError(f"{by} made the list of allocations.", fix)

    def disclose(self, code: str, opening: str, by: str, blinded: bool) -> dict[str, Any]:
        """Open the next place of the participant's stratum, by its code or the sealed list."""
        stratum = self._strata[code]
        place = 1 + [d["stratum"] for d in self._opened.values()].count(stratum)
        committed = [seal for made in self.lists for seal in self._seals(made)[stratum]]
        if not self.lists:
            raise UserError(
                "The study has no list of allocations, so nobody has a group.",
                f"A third person makes it: esea-host study allocate {self.folder} --keep FILE "
                "--operator NAME",
            )
        if place > len(committed):
            fix = "The third person adds further ones: study allocate with --reason."
            raise UserError(f"All {len(committed)} places{_of(stratum)} are open.", fix)
        self.must_not_have_made(by)
        if not opening:
            raise UserError(
                f"{code} has no group yet: place {place}{_of(stratum)} is to be opened.",
                f"Ask {self.lists[-1].by or 'the third person'} for the code of that place, then "
                "add --open CODE; or name the sealed list, --open FILE.",
            )
        listed = os.path.isfile(opening)  # no name that is too long is an error to it
        given = code_in(Path(opening), stratum, place) if listed else opening
        given = re.sub("[^0-9A-Z]", "", given.upper())
        for group in sorted(self.protocol.file.groups):
            if Envelope(stratum, place, group, given).commitment == committed[place - 1]:
                known = {"participant": code, "stratum": stratum, "place": place}
                if blinded:
                    return {**known, SEALED: sealed(self.key(), [group, given])}
                return {**known, "group": group, "code": given}
        fix = "Read the code of that place again."
        raise UserError(f"{given or 'That'} does not open place {place}{_of(stratum)}.", fix)
