"""States of the board under any order of commands and time, against a model of a person's view."""

from __future__ import annotations

import contextlib

from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.emit.states import TIMES_MS
from esea_gen.link.transport import LinkError
from tests.board.test_states import TORQUE, rule
from tests.sim_drive import ANGLES


class Person:
    """What the states should be, from what was done to the board; time in ticks."""

    def __init__(self) -> None:
        self.state, self.referenced, self.held, self.line = "UNREFERENCED", False, False, False
        self.mode_on = False
        self.link = self.deadline = self.fade = self.still = 0

    def guards(self, event: str) -> set[str]:
        held = self.held and event != "RELEASE"
        found = {
            "drive": True,
            "encoders": True,
            "referenced": self.referenced,
            "stop_clear": not held and not self.line,
            "link_live": self.link > 0,
            "mode_off": not self.mode_on,
            "released": True,  # a tick passes before every deed
            "clearable": True,
        }
        return {n for n, holds in found.items() if holds}

    def event(self, event: str) -> None:
        before, after = self.state, rule(self.state, event, self.guards(event))
        if event == "STOP":
            self.held = True
        if after is None:
            return
        self.held = self.held and event != "RELEASE"
        self.state = after
        if before == after:
            return
        if after == "BOOT":
            self.state, self.referenced, self.mode_on = "UNREFERENCED", False, False
            self.state = "STOPPED" if self.held or self.line else "UNREFERENCED"
            return
        if after not in TORQUE or after == "ARMED":
            self.mode_on, self.deadline = False, 0
        if after in ("LETTING_GO", "STOPPING"):
            self.fade = TIMES_MS["FADE" if after == "LETTING_GO" else "STOP_OFF"][0]
        if after == "ZEROING":
            self.referenced, self.still = False, TIMES_MS["ZEROING"][0]

    def tick(self) -> None:
        if self.line:
            self.event("STOP")
        self.link = max(0, self.link - 1)
        if self.link == 0:
            self.event("LINK_LOST")
        if self.deadline:
            self.deadline -= 1
            if self.deadline == 0:
                self.event("EXPIRED")
        if self.state in ("LETTING_GO", "STOPPING"):
            self.fade -= 1
            if self.fade == 0:
                self.event("FADED")
        if self.state == "ZEROING":
            self.still -= 1
            if self.still == 0:
                self.referenced = True
                self.event("ZEROED")

    def told(self, event: str) -> None:
        self.link = TIMES_MS["LINK_LOST"][0]
        if event in ("ON", "OFF"):
            self.mode_on = event == "ON"
        self.event(event)
        if event == "ON" and self.state == "ACTIVE":
            self.deadline = TIMES_MS["DEADLINE"][0]


DEEDS = {
    "STOP": lambda b: b.stop(),
    "RELEASE": lambda b: b.release(),
    "CLEAR": lambda b: b.clear(),
    "RESET": lambda b: b.reset(),
    "ZERO": lambda b: b.zero(),
    "ARM": lambda b: b.arm(),
    "DISARM": lambda b: b.disarm(),
    "OFF": lambda b: b.want(mode=0.0),
    "ON": lambda b: b.want(mode=1.0),
}
# A controller needs a moment before the limits take its word: those who arm or zero wait for it.
deeds = st.one_of(
    st.sampled_from([*DEEDS, *["ARM", "ON", "ZERO"] * 2]),
    st.sampled_from(["open", "close", "close"]),
    st.sampled_from([1, 7, 99, 100, 101, 200, 499, 501, 1001]),
)


@settings(max_examples=60, deadline=None)
@given(done=st.lists(deeds, min_size=3, max_size=25))
def test_any_order_of_commands_and_time_gives_the_states_of_the_model(powered, done):
    board, person = powered, Person()
    board.restart()
    board.lib.sim_stop_line(False)
    board.measure(**ANGLES)

    def wait(ticks):
        for _ in range(ticks):
            board.ticks()
            person.tick()
            assert board.state_now == person.state
            on, u_Nm = board.motor
            assert on == (person.state in TORQUE)
            assert u_Nm == 0 or person.state in TORQUE

    for deed in ["ZERO", 230, *done]:
        if isinstance(deed, int):
            wait(deed)
        elif deed in ("open", "close"):
            person.line = deed == "open"
            board.lib.sim_stop_line(person.line)
        else:
            wait(30 if deed in ("ARM", "ZERO") else 1)
            with contextlib.suppress(LinkError):
                DEEDS[deed](board)
            person.told(deed)
            assert board.state_now == person.state, deed
    board.pending()
