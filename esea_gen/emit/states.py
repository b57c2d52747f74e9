"""States, transitions and faults of the board, from ``states.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from esea_gen.language.ports import Code


@dataclass(frozen=True)
class BoardState:
    name: str
    value: int
    meaning: str
    computes: bool  # whether the board's own clock runs the tasks
    torque: bool  # whether the motor may be driven
    mav: str  # MAVLink's word for it


@dataclass(frozen=True)
class BoardEvent:
    name: str
    value: int
    meaning: str
    told: bool  # whether it comes over the link; else the board finds it itself


@dataclass(frozen=True)
class BoardGuard:
    name: str
    meaning: str


@dataclass(frozen=True)
class Way:
    to: str
    when: tuple[str, ...] = ()  # guards that must all hold


_DATA = tomllib.loads(Path(__file__).with_name("states.toml").read_text(encoding="utf-8"))
STATES = tuple(BoardState(**row) for row in _DATA["states"])
EVENTS = tuple(BoardEvent(**row) for row in _DATA["events"])
GUARDS = tuple(BoardGuard(name, meaning) for name, meaning in _DATA["guards"].items())
TIMES_MS: dict[str, tuple[int, str]] = {n: (v, m) for n, (v, m) in _DATA["times_ms"].items()}
BOARD_FAULTS = tuple(Code(**row) for row in _DATA["faults"])


def _ways(given: str | list[str]) -> tuple[Way, ...]:
    parts = [w.partition(" if ") for w in ([given] if isinstance(given, str) else given)]
    return tuple(Way(to, tuple(when.split(", ")) if when else ()) for to, _, when in parts)


# From each state, by event.
TABLE: dict[str, dict[str, tuple[Way, ...]]] = {
    state: {event: _ways(given) for event, given in row.items()}
    for state, row in _DATA["transitions"].items()
}


def follow(state: str, event: str, holds: Collection[str]) -> str | None:
    """Where an event leads by the table; None when it is refused."""
    for way in TABLE[state].get(event, ()):
        if set(way.when) <= set(holds):
            return state if way.to == "same" else way.to
    return None


def _enum(name: str, members: tuple[BoardState, ...] | tuple[BoardEvent, ...]) -> Iterator[str]:
    yield f"#define HAVE_ENUM_ESEA_{name} /* the dialect's own has an entry more */"
    yield "typedef enum {"
    for member in members:
        yield f"    ESEA_{name}_{member.name} = {member.value}, /* {member.meaning} */"
    yield f"}} ESEA_{name};"
    yield ""


def _asks(name: str, comment: str, states: list[BoardState]) -> Iterator[str]:
    yield f"/* {comment} */"
    yield f"static inline bool esea_state_{name}(ESEA_STATE state)"
    yield "{"
    tests = [f"state == ESEA_STATE_{s.name}" for s in states]
    yield "    return " + " ||\n           ".join(tests) + ";"
    yield "}"
    yield ""


def states_header() -> str:
    lines = [
        "/* States of the board and what moves it: written by `python -m esea_gen.emit.states`",
        " * from the table in esea_gen/emit/states.toml; do not edit.",
        " *",
        " * License: MIT. */",
        "#ifndef ESEA_STATES_H",
        "#define ESEA_STATES_H",
        "",
        "#include <stdbool.h>",
        "",
        *_enum("STATE", STATES),
        *_enum("EVENT", EVENTS),
        "/* Times, compiled in. */",
        *(f"#define ESEA_{n}_MS {v}u /* {m} */" for n, (v, m) in TIMES_MS.items()),
        "",
        "/* What must hold for some transitions. */",
        "typedef struct {",
        *(f"    bool {g.name}; /* {g.meaning} */" for g in GUARDS),
        "} esea_guards_t;",
        "",
        *_asks(
            "computes",
            "Whether the board's own clock runs the tasks.",
            [s for s in STATES if s.computes],
        ),
        *_asks("known", "Whether it is one of the list.", list(STATES)),
        *_asks("drives", "Whether the motor may be on.", [s for s in STATES if s.torque]),
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the C header from the table."""
    from esea_gen.targets import firmware_folder

    header = firmware_folder() / "app" / "states.h"
    header.write_text(states_header(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
