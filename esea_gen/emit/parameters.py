"""Parameters on the link: ids of 16 characters for the tunables, and MAVLink's metadata of them."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from dataclasses import dataclass

from esea_gen.emit.roles import board_roles
from esea_gen.language.ports import UNIT_SUFFIXES, Tunable, unit_of
from esea_gen.language.system import System

ID_CHARACTERS = 16
METADATA_VERSION = 3  # of MAVLink's parameter.schema.json


def fnv1a(text: str) -> int:
    found = 0x811C9DC5
    for byte in text.encode():
        found = (found ^ byte) * 0x01000193 % (1 << 32)
    return found


@dataclass(frozen=True)
class LinkParameter:
    """A tunable of a System as a parameter of the link."""

    id: str  # at most 16 characters, of its own
    instance: str
    block: str
    tunable: Tunable
    fixed: bool  # whether only a calibration sets it

    @property
    def name(self) -> str:
        """Full name, ``velocity.bandwidth_Hz``."""
        return f"{self.instance}.{self.tunable.name}"

    @property
    def key(self) -> int:
        """Key under which a board stores the value."""
        return fnv1a(self.name)

    @property
    def enum_name(self) -> str:
        return f"ESEA_PARAM_{self.instance}_{self.tunable.name}".upper()

    @property
    def unit(self) -> str:
        return unit_of(self.tunable.name)


def _squeezed(text: str) -> str:
    # Without the vowels inside of its words.
    return "_".join(w[:1] + re.sub("[aeiou]", "", w[1:]) for w in text.split("_"))


def _short(instance: str, name: str) -> str:
    # The first of some spellings that is short enough; the unit goes first.
    suffix = max((s for s in UNIT_SUFFIXES if name.endswith(s)), key=len, default="")
    stem = name.removesuffix(suffix)
    left, right = _squeezed(instance), _squeezed(stem)
    for pair in ((instance, name), (instance, stem), (left, stem), (instance, right)):
        if sum(map(len, pair)) + 1 <= ID_CHARACTERS:
            return ".".join(pair)
    return f"{left[:7]}.{right}"[:ID_CHARACTERS]


def link_parameters(system: System) -> tuple[LinkParameter, ...]:
    """Every tunable, in the order of the params struct.

    An id depends on its own name alone, unless two are alike: these end in a digest of the name.
    """
    zeroed = {e.instance for e in board_roles(system).encoders}
    ids = _ids([(i, t.name) for i, t in system.tunables])
    return tuple(
        LinkParameter(
            own,
            instance,
            system.blocks[instance].name,
            tunable,
            instance in zeroed and tunable.name in ("zero_rad", "zeroed"),
        )
        for own, (instance, tunable) in zip(ids, system.tunables, strict=True)
    )


def _ids(names: list[tuple[str, str]]) -> list[str]:
    short = [_short(*n) for n in names]
    alike = {s for s, n in Counter(short).items() if n > 1}
    digests = [hashlib.sha256(".".join(n).encode()).hexdigest() for n in names]
    for digits in range(3, 9):  # as few as part them
        found = [
            f"{own[: ID_CHARACTERS - 1 - digits]}_{digest[:digits]}" if own in alike else own
            for own, digest in zip(short, digests, strict=True)
        ]
        if len(set(found)) == len(found):
            return found
    raise ValueError(f"two parameters have one id: {names}")


def parameter_metadata(system: System) -> str:
    """The standard parameter metadata, JSON; ``shortDesc`` is the full name."""
    parameters = []
    for p in link_parameters(system):
        t = p.tunable
        parameters.append(
            {
                "name": p.id,
                "type": "Float",
                "shortDesc": p.name,
                "longDesc": f"{t.meaning}. Default {t.status}"
                + (f": {t.source}." if t.source else "."),
                "units": "" if p.unit == "1" else p.unit,
                "default": t.default,
                "min": t.low,
                "max": t.high,
                "group": p.instance,
                "readOnly": p.fixed,
            }
        )
    content = {"version": METADATA_VERSION, "parameters": parameters}
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"
