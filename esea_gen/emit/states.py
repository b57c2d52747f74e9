"""States of the board, what moves it between them, and its own faults: one table.

From it come the C enums (``firmware/app/states.h``), the texts of the dialect, and the tables of
the documentation; ``firmware/app/machine.c`` writes the transitions out by hand and is held against
it, pair by pair.  A number is never used again for something else.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from esea_gen.control.limits.faults import FAULT_CODES
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


STATES = (
    BoardState("BOOT", 0, "Starting.", False, False, "BOOT"),
    BoardState("READY", 1, "All is known; waits to be armed.", True, False, "STANDBY"),
    BoardState(
        "REPLAY",
        2,
        "The host's inputs clock the tasks, one run each; drivers and own clock rest.",
        False,
        False,
        "ACTIVE",
    ),
    BoardState(
        "FAULT", 3, "A fault is latched; its number tells which.", True, False, "CRITICAL"
    ),
    BoardState("SELF_TEST", 4, "Checks itself.", False, False, "BOOT"),
    BoardState(
        "UNREFERENCED", 5, "Encoders have no zero; waits to be zeroed.", True, False, "STANDBY"
    ),
    BoardState(
        "ZEROING",
        6,
        "Takes the present angles, which must stand still, as zero.",
        True,
        False,
        "CALIBRATING",
    ),
    BoardState(
        "ARMED", 7, "The motor is on, without torque; waits for a command.", True, True, "ACTIVE"
    ),
    BoardState("ACTIVE", 8, "Follows the host's commands.", True, True, "ACTIVE"),
    BoardState(
        "LETTING_GO",
        9,
        "No command came in time, or disarmed while active: the torque fades to none.",
        True,
        True,
        "ACTIVE",
    ),
    BoardState("STOPPED", 10, "Stopped by somebody; waits to be released.", True, False, "STANDBY"),
)  # fmt: skip

EVENTS = (
    BoardEvent("STOP", 1, "Stop, from anybody, or the stop line is open.", True),
    BoardEvent("RELEASE", 2, "Take the stop back.", True),
    BoardEvent("CLEAR", 3, "The fault has been seen to.", True),
    BoardEvent("RESET", 4, "Start afresh.", True),
    BoardEvent("ZERO", 5, "The joint is at its zero and unloaded: take the angles.", True),
    BoardEvent("ARM", 6, "Switch the motor on.", True),
    BoardEvent("DISARM", 7, "Switch the motor off, gently where it holds torque.", True),
    BoardEvent("OFF", 8, "A command with mode 0.", True),
    BoardEvent("ON", 9, "A command with mode 1 or 2.", True),
    BoardEvent("INPUT", 10, "An input of a task: the host clocks.", True),
    BoardEvent("STARTED", 32, "Memory and port are set up.", False),
    BoardEvent("PASSED", 33, "The self-test found nothing.", False),
    BoardEvent("ZEROED", 34, "The angles stood still and are taken.", False),
    BoardEvent("NOT_ZEROED", 35, "They did not, or an encoder cannot be used.", False),
    BoardEvent("REFUSED", 36, "The limits did not release.", False),
    BoardEvent("EXPIRED", 37, "The command's deadline has passed.", False),
    BoardEvent("LINK_LOST", 38, "Nothing has come from the host for too long.", False),
    BoardEvent("FADED", 39, "The torque has faded to none.", False),
    BoardEvent("FAILED", 40, "A fault was found.", False),
)

GUARDS = (
    BoardGuard("drive", "the device has a motor"),
    BoardGuard("encoders", "the device has encoders with a zero"),
    BoardGuard("referenced", "every encoder has a zero; true where there is none"),
    BoardGuard("stop_clear", "no stop is held, and the stop line is closed"),
    BoardGuard("link_live", "the host was heard of late"),
    BoardGuard("mode_off", "the last command had mode 0, or none came since the motor was off"),
    BoardGuard("released", "the limits have released, in the tick before"),
    BoardGuard("clearable", "the fault is one of the limits' (below 100)"),
)

# Compiled in; no message widens them.
TIMES_MS = {
    "DEADLINE": (100, "from a command with mode 1 or 2 to the next, where it names no other time"),
    "DEADLINE_LEAST": (20, "shortest that a command may name"),
    "DEADLINE_MOST": (1000, "longest; whatever a command names"),
    "LINK_LOST": (1000, "without anything from the host"),
    "FADE": (500, "of letting go, from the torque that was set to none"),
    "ZEROING": (200, "in which the joint must stand still to be zeroed"),
    "COMMAND_AGE": (500, "oldest that a command with a time may be; as far ahead of the clock"),
    "FRAME": (200, "longest silence within a frame; what came of it is then searched for others"),
}

# The board's own faults share one list of numbers with the reasons of the limits, which stay below
# 100; no number is used again for another fault.
BOARD_FAULTS = (
    Code("NONE", 0, "No fault.", "nothing to do"),
    Code(
        "PREPARE_REFUSED",
        101,
        "A tunable's default is outside its range.",
        "build the firmware from a device file that esea-gen accepts",
        "at start, before anything is computed",
    ),
    Code(
        "STACK_EXHAUSTED",
        102,
        "The stack has been used to its last word.",
        "reset; give the stack more memory in the linker script",
        "1000 ticks; beyond the last word at once, as PROCESSOR",
    ),
    Code(
        "PROCESSOR",
        103,
        "The processor took a fault exception.",
        "reset; if it comes again, service",
        "at once",
    ),
    Code(
        "SELF_TEST",
        104,
        "Freshly started limits did not hold the motor at zero.",
        "service: program memory is not what was built",
        "at start, before the motor can be on",
    ),
    Code(
        "STATE_UNKNOWN",
        105,
        "The board's state was none of its list: memory was overwritten.",
        "reset; if it comes again, service",
        "1 tick",
    ),
    Code(
        "MOTOR_CURRENT",
        106,
        "The motor's current was not what was set.",
        "reset; look at the amplifier, its supply, the wires of motor and current",
        "20 ticks beyond the bound, while the motor is on",
    ),
    Code(
        "WATCHDOG",
        107,
        "The watchdog reset the board: no control cycle had ended in time.",
        "read the black box, reset; if it comes again, service",
        "68 to 188 ms after the last cycle, told after the start",
    ),
    Code(
        "BROWN_OUT",
        108,
        "The board's supply is too low.",
        "look at the supply, then reset",
        "1 tick",
    ),
    Code(
        "SLOW_CLOCK",
        109,
        "The board's clock stayed at the one it starts with, too slow for this device.",
        "reset; if it comes again, service: oscillator or PLL",
        "at start, before the motor can be on",
    ),
)

# Between these comments the documentation's tables are written.
TABLES_FROM = "<!-- from esea_gen/emit/states.py -->"
TABLES_TO = "<!-- to here -->"

_LESS = {"DISARM": (Way("same"),), "OFF": (Way("same"),)}  # who asks for less is never refused
_FAILED = {"FAILED": (Way("FAULT"),)}
_KNOWN = (Way("READY", ("stop_clear", "referenced")), Way("UNREFERENCED", ("stop_clear",)))

# From each state, by event.  An event that is not listed is refused and changes nothing.
TABLE: dict[str, dict[str, tuple[Way, ...]]] = {
    "BOOT": {"STOP": (Way("same"),), "STARTED": (Way("SELF_TEST"),), **_FAILED, **_LESS},
    "SELF_TEST": {
        "STOP": (Way("same"),),
        "PASSED": (*_KNOWN, Way("STOPPED")),
        **_FAILED,
        **_LESS,
    },
    "UNREFERENCED": {
        "STOP": (Way("STOPPED"),),
        "RESET": (Way("BOOT"),),
        "ZERO": (Way("ZEROING", ("encoders",)),),
        "INPUT": (Way("REPLAY"),),
        **_FAILED,
        **_LESS,
    },
    "ZEROING": {
        "STOP": (Way("STOPPED"),),
        "ZEROED": (Way("READY"),),
        "NOT_ZEROED": (Way("UNREFERENCED"),),
        **_FAILED,
        **_LESS,
    },
    "READY": {
        "STOP": (Way("STOPPED"),),
        "RESET": (Way("BOOT"),),
        "ZERO": (Way("ZEROING", ("encoders",)),),
        "ARM": (Way("ARMED", ("drive", "referenced", "stop_clear", "link_live", "mode_off")),),
        "INPUT": (Way("REPLAY"),),
        **_FAILED,
        **_LESS,
    },
    "ARMED": {
        "STOP": (Way("STOPPED"),),
        "DISARM": (Way("READY"),),
        "OFF": (Way("same"),),
        "ON": (Way("ACTIVE", ("link_live", "stop_clear", "released")),),
        "REFUSED": (Way("READY"),),
        "LINK_LOST": (Way("READY"),),
        **_FAILED,
    },
    "ACTIVE": {
        "STOP": (Way("STOPPED"),),
        "DISARM": (Way("LETTING_GO"),),
        "OFF": (Way("ARMED"),),
        "ON": (Way("same", ("link_live", "stop_clear")),),
        "EXPIRED": (Way("LETTING_GO"),),
        "LINK_LOST": (Way("LETTING_GO"),),
        **_FAILED,
    },
    "LETTING_GO": {
        "STOP": (Way("STOPPED"),),
        "FADED": (Way("READY"),),
        **_FAILED,
        **_LESS,
    },
    "STOPPED": {
        "STOP": (Way("same"),),
        "RELEASE": _KNOWN,
        "RESET": (Way("BOOT"),),
        **_FAILED,
        **_LESS,
    },
    "FAULT": {
        "STOP": (Way("same"),),
        "CLEAR": (
            Way("READY", ("clearable", "stop_clear", "referenced")),
            Way("UNREFERENCED", ("clearable", "stop_clear")),
            Way("STOPPED", ("clearable",)),
        ),
        "RESET": (Way("BOOT"),),
        "FAILED": (Way("same"),),
        **_LESS,
    },
    "REPLAY": {
        "STOP": (Way("STOPPED"),),
        "RESET": (Way("BOOT"),),
        "INPUT": (Way("same"),),
        **_FAILED,
        **_LESS,
    },
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
        " * from the table in esea_gen/emit/states.py; do not edit.",
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


def state_tables() -> str:
    lines = ["| state | number | | own clock | motor |", "|---|---|---|---|---|"]
    for s in STATES:
        runs, motor = ("runs" if s.computes else "–"), ("on" if s.torque else "off")
        lines.append(f"| `{s.name}` | {s.value} | {s.meaning} | {runs} | {motor} |")
    lines += ["", "| event | number | from | |", "|---|---|---|---|"]
    lines += [
        f"| `{e.name}` | {e.value} | {'link' if e.told else 'board'} | {e.meaning} |"
        for e in EVENTS
    ]
    lines += ["", "| from | event | to | when |", "|---|---|---|---|"]
    for state, events in TABLE.items():
        for event, ways in events.items():
            for way in ways:
                to = "stays" if way.to == "same" else f"`{way.to}`"
                when = ", ".join(f"`{g}`" for g in way.when)
                lines.append(f"| `{state}` | `{event}` | {to} | {when} |")
    lines += ["", "| time | | |", "|---|---|---|"]
    lines += [f"| `{n}` | {v} ms | {m} |" for n, (v, m) in TIMES_MS.items()]
    lines += ["", "| guard | |", "|---|---|"]
    lines += [f"| `{g.name}` | {g.meaning} |" for g in GUARDS]
    lines += ["", "| fault | number | cause | what to do | found |", "|---|---|---|---|---|"]
    faults = [*BOARD_FAULTS[:1], *FAULT_CODES[1:], *BOARD_FAULTS[1:]]
    lines += [f"| `{c.name}` | {c.value} | {c.cause} | {c.cure} | {c.bound} |" for c in faults]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write what follows from the table: the C header, and the tables of the page on firmware."""
    from esea_gen.targets import firmware_folder

    root = firmware_folder()
    (root / "app" / "states.h").write_text(states_header(), encoding="utf-8")
    page = root.parent / "docs" / "firmware.md"
    text = page.read_text(encoding="utf-8")
    before, rest = text.split(TABLES_FROM)
    _, after = rest.split(TABLES_TO)
    parts = (before, TABLES_FROM, "\n\n", state_tables(), "\n", TABLES_TO, after)
    page.write_text("".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
