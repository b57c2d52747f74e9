"""Board and operator during commissioning: requests to both, and captured data."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_gen.model.sensing import of_axis
from esea_host.commissioning.startup import DriveRecording, GearPath
from esea_host.connection import Batch, ConnectedDevice
from esea_host.recording.layout import Array

TURN_S = 0.02  # from one command to the next
DEADLINE_MS = 500
HEARTBEAT_S, SILENT_S = 1.5, 2.0
ARM_TRIES = 4
ActKind = Literal["rest", "turn", "clamp", "load", "swing"]


class CommissioningEndedError(Exception):
    """Somebody ended a step before it was through."""


@dataclass(frozen=True)
class HandAct:
    kind: ActKind
    text: str
    torque_Nm: float = 0.0  # of the load; of a mass that swings, its weight times its arm
    path: GearPath | None = None  # how the joint is turned, as a simulated hand does it
    hangs_rad: float = 0.0  # where a mass that swings hangs straight down
    inertia_kgm2: float = 0.0  # and its inertia


@dataclass(frozen=True)
class Capture:
    """Rows of the sensing task, its inputs and its outputs, tick by tick."""

    tick_s: float
    given: Array
    told: Array
    axis: str = ""

    def __len__(self) -> int:
        return len(self.told)

    @property
    def time_s(self) -> Array:
        return np.asarray((self.told["sequence"] - self.told["sequence"][0]) * self.tick_s)

    def __getitem__(self, name: str) -> Array:
        own = of_axis(name, self.axis)
        rows = self.told if own in (self.told.dtype.names or ()) else self.given
        name = own if own in (rows.dtype.names or ()) else name
        return np.asarray(rows[name], np.float64)


class CommissioningBench:
    """A connected board, and an operator who follows the instructions."""

    def __init__(
        self,
        device: ConnectedDevice,
        hands: Callable[[HandAct], None],
        say: Callable[[str], None] = lambda _: None,
        pass_time: Callable[[float], None] = time.sleep,
        hands_free: bool = False,
        axis: str | None = None,
    ) -> None:
        self.board = device.identity.device
        self.drives = bool(self.board.laws)
        self.axis = self.board.axes[0] if axis is None else axis
        if self.axis not in self.board.axes:
            named = ", ".join(filter(None, self.board.axes)) or "one without a name"
            raise UserError(f"{self.board.name} has no axis '{axis}'.", f"It has {named}.")
        task = of_axis("sense", self.axis)
        self._streams = f"{task}_in", f"{task}_out"
        missing = [n for n in self._streams if n not in device.streams]
        if missing:
            raise UserError(
                f"{self.board.name} has no stream {missing[0]}.",
                f"Commissioning needs a sensing task named {task}.",
            )
        self.device, self.say = device, say
        self._hands, self.pass_time, self.hands_free = hands, pass_time, hands_free
        self._cancelled = threading.Event()

    def change_hands(self, hands: Callable[[HandAct], None]) -> None:
        self._hands = hands

    def cancel(self) -> None:
        """End the step that runs, from any thread; the motor is stopped by it."""
        self._cancelled.set()

    @property
    def cancelled(self) -> bool:
        return self._cancelled.is_set()

    def begin(self) -> None:
        self._cancelled.clear()

    def ask(self, act: HandAct) -> None:
        self.say(act.text)
        self._hands(act)
        self._check()

    def wait(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / TURN_S))):
            self._check()
            self.pass_time(TURN_S)

    def _check(self) -> None:
        if self.cancelled:
            raise CommissioningEndedError("The step was ended before it was through.")

    def capture(
        self,
        seconds: float,
        each: Callable[[float], bool | None] | None = None,
        turn_s: float = TURN_S,
    ) -> Capture:
        """Inputs and outputs of the sensing task meanwhile, without a gap."""
        self.device.listen(self._streams)
        queue = self.device.subscribe(self._streams)
        found, silent_s = list[Batch](), 0.0
        try:
            for k in range(math.ceil(seconds / turn_s) + 1):
                self._check()
                if each is not None and each(k * turn_s) is False:
                    break
                self.pass_time(turn_s)
                new = queue.take(0.0)
                found += new
                silent_s = 0.0 if new else silent_s + turn_s
                if silent_s > SILENT_S:  # what came before is no measurement of the step
                    raise LinkError(f"nothing has come for {SILENT_S:g} s", "Check its power.")
        finally:
            self.device.receiver.unsubscribe(queue)
        holes = [g for b in found for g in b.gaps]
        if holes:
            raise UserError(f"Rows are missing: {holes[0]}.", "Check the link; repeat the step.")
        rows = {
            name: [b.rows for b in found if b.layout.name == name and len(b.rows)]
            for name in self._streams
        }
        if not all(rows.values()):
            raise LinkError("the board reported no run", "Check its power.")
        given, told = (np.concatenate(rows[n]) for n in self._streams)
        _, i, j = np.intersect1d(given["sequence"], told["sequence"], return_indices=True)
        return Capture(self.device.identity.tick_us * 1e-6, given[i], told[j], self.axis)

    def recording(self, c: Capture) -> DriveRecording:
        """A capture as the checks of a start-up take it."""
        motor, load = c["theta_motor_rad"], c["theta_load_rad"]
        if not self.drives:
            return DriveRecording(c.tick_s, np.zeros(len(c)), motor, motor, load)
        a = self.board.file.actuator
        assert a is not None
        full = 1 << round(a.encoder_bits.value)
        gear_rad = 2 * math.pi / a.gear_ratio.value / full
        gear = np.unwrap(c["count_gear"], period=full) * gear_rad
        return DriveRecording(c.tick_s, c["u_Nm"], gear - gear[0] + motor[0], motor, load)

    def fault_name(self, fault: int) -> str:
        named = self.device.session.dialect.enums["ESEA_FAULT"].get(fault)
        return getattr(named, "name", str(fault)).removeprefix("ESEA_FAULT_")

    # -- what the board is asked -----------------------------------------------------------------

    def reach(self, state: str, seconds: float = 1.0) -> bool:
        """Wait for a state; whether it came."""
        for _ in range(round(seconds / TURN_S)):
            if self.device.state() == state:
                return True
            self.wait(TURN_S)
        return self.device.state() == state

    def make_ready(self) -> None:
        """From any state without torque to READY, the zero taken; refuses where it needs a look."""
        state = self.device.state()
        if state == "UNKNOWN" and not self.reach("READY", 1.5):
            state = self.device.state()
        if state in ("READY", "UNKNOWN"):
            return
        fix = {
            "UNREFERENCED": "Do the step 'zero' first.",
            "STOPPED": "Release the stop first.",
            "FAULT": "Remove its cause, then acknowledge it: esea-host view, Ctrl+L.",
        }.get(state, "Wait until the motor is off.")
        raise UserError(f"The board is {state}.", fix)

    def _arm(self) -> None:
        # The limits refuse while the controller has not quite let go of what was before: once more.
        for _ in range(ARM_TRIES):
            self.device.arm()
            if self.reach("ARMED", 0.2) and not self.reach("READY", 0.1):
                return
            self.wait(0.3)
        said = [f": {text}" for text in self.device.texts]
        raise UserError(
            f"The board took the motor off again {ARM_TRIES} times{''.join(said[-1:])}.",
            "Check 'which limit acts' in the live view: esea-host view.",
        )

    def driven(
        self, seconds: float, wanted_Nm: Callable[[float], float], turn_s: float = TURN_S
    ) -> Capture:
        """Torque mode, armed for as long; motor off afterwards, stopped where something failed."""
        device, name = self.device, of_axis("tau_desired_Nm", self.axis)
        self._arm()
        moved = False

        def turn(at_s: float) -> bool:
            nonlocal moved
            on = device.state() in ("ARMED", "ACTIVE")
            moved = moved or on
            # What the last heartbeat said may be of before it was armed.
            if not on and (moved or at_s > HEARTBEAT_S):
                return False
            device.want(DEADLINE_MS, mode=1.0, **{name: wanted_Nm(at_s)})
            return True

        try:
            found = self.capture(seconds, turn, turn_s)
        except BaseException:
            with contextlib.suppress(LinkError):
                device.stop(again=True)  # a person may have stopped it
            raise
        with contextlib.suppress(LinkError):  # it may have switched itself off
            device.disarm()
            self.reach("READY", 5.0)
        return found
