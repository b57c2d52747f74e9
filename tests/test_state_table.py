"""The board's states as a table: what is said of each, where events lead, and the texts of it."""

from __future__ import annotations

import itertools
import re

import pytest

from esea_gen import targets
from esea_gen.control.faults import FAULT_CODES
from esea_gen.emit.states import (
    BOARD_FAULTS,
    EVENTS,
    GUARDS,
    STATES,
    TABLE,
    TIMES_MS,
    follow,
    main,
    state_tables,
    states_header,
)

from .test_states import every_guard, rule

TORQUE = {"ARMED", "ACTIVE", "LETTING_GO"}
# Nothing is computed before all is checked, nor while the host clocks.
AT_REST = {"BOOT", "SELF_TEST", "REPLAY"}
MAVLINK = {"BOOT": "BOOT", "SELF_TEST": "BOOT", "FAULT": "CRITICAL", "ZEROING": "CALIBRATING"}
ACTIVE = {"ARMED", "ACTIVE", "LETTING_GO", "REPLAY"}


def test_what_is_said_of_each_state():
    for s in STATES:
        assert s.torque == (s.name in TORQUE)
        assert s.computes == (s.name not in AT_REST)
        assert s.mav == MAVLINK.get(s.name, "ACTIVE" if s.name in ACTIVE else "STANDBY")


def test_what_comes_over_the_link_and_what_the_board_finds():
    told = ["STOP", "RELEASE", "CLEAR", "RESET", "ZERO", "ARM", "DISARM", "OFF", "ON", "INPUT"]
    found = ["STARTED", "PASSED", "ZEROED", "NOT_ZEROED", "REFUSED", "EXPIRED", "LINK_LOST",
             "FADED", "FAILED"]  # fmt: skip
    # From 1 on the link, from 32 on the board.
    numbered = [*enumerate(told, 1), *enumerate(found, 32)]
    assert [(e.value, e.name) for e in EVENTS] == numbered
    assert [e.name for e in EVENTS if e.told] == told


def test_times_of_the_board():
    # A command is good for 100 ms; it may ask for 20 to 1000. The host is gone after a second.
    assert {n: v for n, (v, _) in TIMES_MS.items()} == {
        "DEADLINE": 100,
        "DEADLINE_LEAST": 20,
        "DEADLINE_MOST": 1000,
        "LINK_LOST": 1000,
        "FADE": 500,
        "ZEROING": 200,
        "COMMAND_AGE": 500,
        "FRAME": 200,
    }


def test_events_lead_where_the_rules_say():
    for state, event, guards in itertools.product(STATES, EVENTS, every_guard()):
        expected = rule(state.name, event.name, guards)
        assert follow(state.name, event.name, guards) == expected, (state.name, event.name, guards)


def test_every_way_names_a_state_an_event_and_guards_that_there_are():
    names, events = {s.name for s in STATES}, {e.name for e in EVENTS}
    guards = {g.name for g in GUARDS}
    assert len(guards) == 7
    for state, ways in TABLE.items():
        assert state in names
        assert set(ways) <= events
        for way in itertools.chain(*ways.values()):
            assert way.to in {*names, "same"}
            assert set(way.when) <= guards


# -- as C ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def header() -> str:
    return states_header()


@pytest.mark.parametrize(("name", "members"), [("STATE", STATES), ("EVENT", EVENTS)])
def test_enums_of_the_header(header, name, members):
    body = re.search(rf"typedef enum \{{\n([^}}]*)\}} ESEA_{name};", header)
    assert body is not None
    found = re.findall(rf"    ESEA_{name}_(\w+) = (\d+), /\* (.*) \*/\n", body[1])
    assert found == [(m.name, str(m.value), m.meaning) for m in members]
    assert f"#define HAVE_ENUM_ESEA_{name} " in header


@pytest.mark.parametrize(
    ("name", "among"),
    [
        ("computes", {s.name for s in STATES} - AT_REST),
        ("known", {s.name for s in STATES}),
        ("drives", TORQUE),
    ],
)
def test_questions_of_the_header(header, name, among):
    body = re.search(
        rf"/\* [^\n]* \*/\nstatic inline bool esea_state_{name}\(ESEA_STATE state\)\n"
        r"\{\n    return ([^;]*);\n\}\n",
        header,
    )
    assert body is not None
    tests = body[1].split(" ||\n           ")
    assert {t.removeprefix("state == ESEA_STATE_") for t in tests} == among
    assert len(tests) == len(among)


def test_times_and_guards_of_the_header(header):
    for name, (value, meaning) in TIMES_MS.items():
        assert f"#define ESEA_{name}_MS {value}u /* {meaning} */\n" in header
    members = "".join(f"    bool {g.name}; /* {g.meaning} */\n" for g in GUARDS)
    assert f"typedef struct {{\n{members}}} esea_guards_t;\n" in header
    assert header.endswith("#endif\n")


# -- as documentation ------------------------------------------------------------------------------


def rows() -> dict[str, list[list[str]]]:
    """Cells of every table, by its first title."""
    found: dict[str, list[list[str]]] = {}
    for block in state_tables().split("\n\n"):
        head, line, *body = block.strip().splitlines()
        assert set(line) == {"|", "-"}
        cells = [[c.strip() for c in r.strip("|").split(" |")] for r in body]
        assert {r.count("|") - r.count(" | ") for r in body} == {2}
        found[head.split("|")[1].strip()] = cells
    return found


def test_tables_of_the_documentation():
    found = rows()
    assert list(found) == ["state", "event", "from", "time", "guard", "fault"]
    for s, cells in zip(STATES, found["state"], strict=True):
        runs = "–" if s.name in AT_REST else "runs"
        motor = "on" if s.name in TORQUE else "off"
        assert cells == [f"`{s.name}`", str(s.value), s.meaning, runs, motor]
    for e, cells in zip(EVENTS, found["event"], strict=True):
        given = "link" if e.value < 32 else "board"
        assert cells == [f"`{e.name}`", str(e.value), given, e.meaning]
    for (name, (value, meaning)), cells in zip(TIMES_MS.items(), found["time"], strict=True):
        assert cells == [f"`{name}`", f"{value} ms", meaning]
    assert [c[0] for c in found["guard"]] == [f"`{g.name}`" for g in GUARDS]
    # None, the limits' own, then the board's: no number twice.
    numbers = [int(c[1]) for c in found["fault"]]
    assert numbers == [0, *range(1, len(FAULT_CODES)), *range(101, 101 + len(BOARD_FAULTS) - 1)]
    for cells in found["fault"]:
        assert len(cells) == 5
        assert cells[2]


def test_the_ways_of_the_documentation_are_those_of_the_rules():
    # Of each state and event the first way whose guards are met.
    ways: dict[tuple[str, str], list[tuple[set[str], str]]] = {}
    for state, event, to, when in rows()["from"]:
        plain = [x.strip("`") for x in (state, event)]
        target = plain[0] if to == "stays" else to.strip("`")
        ways.setdefault((plain[0], plain[1]), []).append(
            (set(re.findall(r"`(\w+)`", when)), target)
        )
    for state, event, guards in itertools.product(STATES, EVENTS, every_guard()):
        found = [to for when, to in ways.get((state.name, event.name), ()) if when <= guards]
        assert (found[0] if found else None) == rule(state.name, event.name, guards)


def test_what_is_written_stands_between_its_marks_and_in_the_header(tmp_path, monkeypatch):
    monkeypatch.setattr(targets, "firmware_folder", lambda: tmp_path / "firmware")
    (tmp_path / "firmware" / "app").mkdir(parents=True)
    (tmp_path / "docs").mkdir()
    page = tmp_path / "docs" / "firmware.md"
    marks = "<!-- from esea_gen/emit/states.py -->", "<!-- to here -->"
    page.write_text(f"– before\n{marks[0]}\nold\n{marks[1]}\nafter\n", encoding="utf-8")
    for _ in range(2):  # again: the same
        main()
        assert page.read_text(encoding="utf-8") == (
            f"– before\n{marks[0]}\n\n{state_tables()}\n{marks[1]}\nafter\n"
        )
        header = (tmp_path / "firmware" / "app" / "states.h").read_text(encoding="utf-8")
        assert header == states_header()
