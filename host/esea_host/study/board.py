"""Session inputs from a connected board, real or simulated; every run is recorded.

The board's limits own safety; this reads, and while armed forwards the task's request, or 0 Nm.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import unused
from esea_gen.link.transport import LinkError
from esea_host.connection import ConnectedDevice
from esea_host.connection.decoder import TICK
from esea_host.connection.receiver import Batch
from esea_host.connection.recording import LiveRecording
from esea_host.recording.layout import Array
from esea_host.study.edge import trial_conditions
from esea_host.study.fitting import ACTS, CONSTRAINED, DEG, TORQUE, DeviceSignals, Tap
from esea_host.study.scene import Scene
from esea_host.study.source import Gauge, InputSource
from esea_host.study.task import Actor, Inputs, Situation, StudyTask
from esea_host.study.words import keyed

TORQUE_MODE, DEADLINE_MS = 1.0, 500
FRAME_S, SILENT_S, READY_S, SETTLE_S = 0.01, 1.0, 8.0, 0.2
AWAY_S, SWITCH_S = 60.0, 30.0
HALTED = ("FAULT", "STOPPING", "STOPPED")
WORKING = ("ARMED", "ACTIVE")  # who lets go does not come back, and is armed again
ASKED = 8  # for the tick, before each trial
REST_SHARE = 0.1  # of the largest torque: more at rest is a zero that is not one; assumed


class LatestRows:
    """Latest value of a signal, from any of the board's streams."""

    def __init__(self, device: ConnectedDevice, always: Iterable[Tap]) -> None:
        self._device, self._always = device, {tap.stream for tap in always}
        self._needed = set(self._always)
        self._queue = device.subscribe([s for s in device.streams if s.endswith("_out")])
        self._waiting: dict[str, list[Batch]] = {}
        self._last_tick: dict[str, int] = {}
        self._new: dict[str, Array] = {}
        self._tick_s, self._zero_s = device.receiver.tick_ns * 1e-9, math.nan
        self.board_ns = self.tick = 0
        self.taken_s: float | None = None
        self.began_again = False

    @property
    def streams(self) -> list[str]:
        return sorted(self._needed)

    def need(self, taps: Iterable[Tap]) -> None:
        self._needed = self._always | {tap.stream for tap in taps}
        self._device.listen(sorted(self._needed))
        if self._device.address is not None:  # else somebody moves its clock by hand
            self._compare_clocks()

    def _compare_clocks(self) -> None:
        # Of several answers the fastest: halfway it was that tick.
        found = []
        for _ in range(ASKED):
            asked_s = time.monotonic()
            tick = self._device.clock()["tick"]
            answered_s = time.monotonic()
            middle_s = (asked_s + answered_s) / 2
            found.append((answered_s - asked_s, middle_s - tick * self._tick_s))
        self._zero_s = min(found)[1]

    def start(self) -> None:
        self._queue.take(0.0)
        self._waiting, self._last_tick, self.began_again = {}, {}, False

    def take(self, timeout_s: float, due_ns: int) -> None:
        """Accept received rows; continue to their common end if it is at or after a time."""
        for batch in self._queue.take(timeout_s):
            name, ticks = batch.layout.name, batch.rows[TICK]
            if int(ticks[0]) <= self._last_tick.get(name, -1) or (ticks[1:] < ticks[:-1]).any():
                self.began_again = True
            self._last_tick[name] = int(ticks[-1])
            self._waiting.setdefault(name, []).append(batch)
        ends = [int(b[-1].board_ns[-1]) if (b := self._waiting.get(s)) else 0 for s in self._needed]
        if (now_ns := min(ends, default=0)) >= due_ns:
            self._go_on(now_ns)

    def _go_on(self, now_ns: int) -> None:
        for name, batches in self._waiting.items():
            if not batches:  # a stream beside those that are needed
                continue
            rows = np.concatenate([b.rows for b in batches])
            times = np.concatenate([b.board_ns for b in batches])
            count = int(np.searchsorted(times, now_ns, "right"))
            self._waiting[name] = []
            if count:
                self._new[name] = rows[:count]
            if count < len(rows):
                left = replace(batches[-1], rows=rows[count:], board_ns=times[count:])
                self._waiting[name] = [left]
        self.board_ns = now_ns
        self.tick = max(int(self._new[s][TICK][-1]) for s in self._needed)
        if self._device.address is None:
            self.taken_s = time.monotonic()
        elif math.isfinite(self._zero_s):
            at_s = self.tick * self._tick_s
            # No row comes before its tick: a simulated board that lagged has caught up.
            self._zero_s = min(self._zero_s, time.monotonic() - at_s)
            self.taken_s = self._zero_s + at_s

    def value(self, tap: Tap) -> float:
        rows = self._new.get(tap.stream)
        return 0.0 if rows is None else tap.factor * float(rows[tap.column][-1])

    def differ(self, tap: Tap, value: float) -> bool:
        """Whether it was another one at any time since the moment before."""
        return bool(np.any(self._new[tap.stream][tap.column] != value))

    def close(self) -> None:
        self._device.receiver.unsubscribe(self._queue)


class BoardSource(InputSource):
    """A worn board; drive: zero and arm it; advance: moves the clock of a board in lockstep."""

    def __init__(
        self,
        device: ConnectedDevice,
        folder: Path | None,
        drive: bool = False,
        advance: Callable[[float], None] | None = None,
    ) -> None:
        self.device, self.folder, self.drive, self.advance = device, folder, drive, advance
        self.signals = DeviceSignals(device.identity.device)
        self._torques = self.signals.of_axes("tau_Nm")
        self._angles = self.signals.of_axes("theta_load_rad")
        self._acts = self.signals.of_axes(ACTS)
        self._taps: Mapping[str, Tap] = {}
        self._limits = device.parameters()
        self._recording: LiveRecording | None = None
        always = [*self._torques.values(), *self._angles.values(), *self._acts.values()]
        self._rows = LatestRows(device, always)
        self._state, self._boot = "UNKNOWN", 0
        self._none = {n: 0.0 for n in self.signals.wanted_names if n.startswith(TORQUE)}
        self._broken, self.middle_rad = "", math.nan  # the angle's, for who takes it: of this zero
        self._asked: dict[str, float] = {}
        self._held: float | None = None
        self._armed, self._reconnects = False, 0
        self._first_ns: int | None = None

    @property
    def simulated(self) -> bool:
        return self.device.simulated

    @property
    def board_ns(self) -> int:
        return self._rows.board_ns

    def _limit(self, name: str, axis: str) -> float:
        instance = f"limits_{axis}" if axis else "limits"
        return self._limits.get(f"{instance}.{name}", math.inf)

    # -- before the first trial, and after the board was lost --------------------------------------

    def ready(self) -> Mapping[str, Any]:
        """Whether it tells, zero and limits; armed where it is to be."""
        identity = self.device.identity
        found: dict[str, Any] = {
            "simulated": self.simulated,
            "device": identity.device.name,
            "content_hash": identity.content_hash,
            "limits": {k: v for k, v in self._limits.items() if k.startswith("limits")},
        }
        try:
            boot = self._wait_for_link()
            self._reconnects = self.device.receiver.reconnects
            found |= {"boot": boot, "restarted": self._boot not in (0, boot)}
            self._boot = boot
            if found["restarted"]:
                self.middle_rad = math.nan
            if self._recording is None and self.folder is not None:
                self._recording = self.device.record(unused(self.folder / "device-", ".mcap"))
                found["recording"] = self._recording.recorder.path.name
            self._must_record()
            # A board that has restarted tells nothing unasked.
            self.device.listen(self._rows.streams if self._recording is None else None)
            self._rows.start()
            self.pull()
            if self.drive:
                self._arm()
            self._pass(SETTLE_S)
            self._state = state = self._state_now()
        except (LinkError, UserError) as error:
            if "boot" in found and self.device.receiver.away:  # since then: it is waited for again
                return self.ready()
            return found | {"problem": str(error)}
        self._broken, self._rows.began_again = "", False
        tau_Nm = {a: self._rows.value(tap) for a, tap in self._torques.items()}
        found |= {"state": state, "board_ns": self.board_ns}
        found["tau_Nm"] = tau_Nm if len(tau_Nm) != 1 else next(iter(tau_Nm.values()))
        most_Nm = {a: REST_SHARE * self._limit("tau_max_Nm", a) for a in tau_Nm}
        loaded = [
            f"{f'of {a} ' if a else ''}is {x:.2f} Nm, at most {most_Nm[a]:.2f} Nm"
            for a, x in tau_Nm.items()
            if abs(x) > most_Nm[a]
        ]
        if state in HALTED:
            found["problem"] = self._trouble(state)
        elif loaded:
            found["problem"] = (
                f"at rest the torque {' and '.join(loaded)} is taken for unloaded: unload the "
                "joint and zero it"
            )
        return found

    def _wait_for_link(self) -> int:
        # The board's boot number.  Who writes may see a break before who listens.
        until_s, receiver = time.monotonic() + AWAY_S, self.device.receiver
        while True:
            try:
                if not receiver.away:
                    boot = self.device.boot_number()
                    self.waits("")
                    return boot
            except LinkError:
                if receiver.error is not None:
                    raise
            if receiver.error is not None or time.monotonic() > until_s or self.ask():
                raise UserError("The link to the board is broken.", "Check cable and power.")
            self.waits(keyed("advice.link_broken"))
            time.sleep(0.05)

    def _arm(self) -> None:
        # Somebody who sways is not zeroed: again, until it is.
        if not self.signals.drive:
            name = self.signals.device.name
            raise UserError(f"{name} has no motor to arm.", "Leave --arm out.")
        deadline_s, why = self.now_s() + READY_S, ""
        while (state := self._state_now()) not in WORKING or self.device.state() not in WORKING:
            if state in HALTED:
                raise UserError(self._trouble(state), "Correct the cause, then continue.")
            if state == "UNREFERENCED":
                self.device.zero()
                self.middle_rad = math.nan
            elif state == "READY":
                # Refused while the controller has not quite let go of what was before: once more.
                try:
                    self.device.arm()
                except LinkError as error:
                    why = f" ({error.what})"
            elif state in WORKING:
                self.device.disarm()
            self._state = state
            if self.now_s() > deadline_s or self.ask():
                raise UserError(f"The board stays {state}{why}.", "Rest the joint, unloaded.")
            self._pass(0.4)

    def _state_now(self) -> str:
        # Asked: the last that was told may be of before a pause, or a broken link.
        return self._named("ESEA_STATE", self.device.clock()["state"]) or "UNKNOWN"

    def _named(self, enum: str, value: int) -> str:
        # As the device's dialect has it.
        entry = self.device.session.dialect.enums[enum].get(value)
        return "" if entry is None else str(entry.name).removeprefix(f"{enum}_")

    def _trouble(self, state: str) -> str:
        number = self.device.fault()
        name = self._named("ESEA_FAULT", number).lower().replace("_", " ") if number else ""
        return f"the board is in {state}" + (f": {name} (fault {number})" if name else "")

    # -- time --------------------------------------------------------------------------------------

    def pull(self) -> None:
        """Take the next frame of the board's time in."""
        due_ns = self.board_ns + round(FRAME_S * 1e9)
        until_s, tries = time.monotonic() + SILENT_S, round(SILENT_S / FRAME_S)
        while True:
            if self.advance is not None:
                self.advance(FRAME_S)
                tries -= 1
            self._rows.take(0.0 if self.advance else 0.02, due_ns)
            if self._first_ns is None and self.board_ns:
                self._first_ns = self.board_ns
            if self.board_ns >= due_ns:
                return
            # A board that is moved by hand is silent by its own clock, however busy the machine is.
            if tries < 0 if self.advance else time.monotonic() > until_s:
                raise UserError(
                    f"Nothing came from the board for {SILENT_S:g} s.", "Check cable and power."
                )

    def _pass(self, seconds: float) -> None:
        end_ns = self.board_ns + round(seconds * 1e9)
        while self.board_ns < end_ns and not self.ask():
            self.pull()

    def now_s(self) -> float:
        return (self.board_ns - (self._first_ns or self.board_ns)) * 1e-9

    def rest(self, seconds: float) -> None:
        """Wait as long, by the board's clock, backdriven where it is armed."""
        end_ns = self.board_ns + round(seconds * 1e9)
        while self.board_ns < end_ns and not self.ask():
            try:
                self.want({})
                self.pull()
            except (LinkError, UserError) as error:
                self._broken = str(error)
                return

    # -- trials ------------------------------------------------------------------------------------

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        self.begin(task, situation, number)
        return _Wearer(self)

    def begin(self, task: StudyTask, situation: Situation, number: int) -> None:
        """Set the task's conditions on the board and make its inputs available."""
        asked = trial_conditions(task, situation.parameters)
        self.signals.must_fit([(task, asked)])
        self._taps, self._asked = self.signals.taps(task), self.signals.wanted(asked)
        try:
            try:
                self._rows.need(self._taps.values())
                state = self._state_now()
                if self.drive and state in ("READY", "LETTING_GO"):  # nobody has asked in a pause
                    self._arm()
                    state = self._state_now()
            finally:  # arming takes time: a replay reads the recording from here on
                self._event("trial", number=number, task=task.name)
            self._armed = state in WORKING
            if CONSTRAINED in self._asked:
                self._establish(number)
        except (LinkError, UserError) as error:
            self._lost(error)

    def _establish(self, number: int) -> None:
        begun_ns, wanted = self.board_ns, self._asked[CONSTRAINED]
        if not self._armed:
            raise UserError(
                f"The board is {self.device.state()}: the motor is off, so no condition acts.",
                "Arm it, or add --arm.",
            )
        while waiting := [a for a, tap in self._acts.items() if self._rows.value(tap) != wanted]:
            passed_s = (self.board_ns - begun_ns) * 1e-9
            axes = " and ".join(waiting)
            if passed_s > SWITCH_S:
                what = f"has not switched within {SWITCH_S:g} s"  # which way: not to a blinded
                fix = "Let the joint rest, outside the wall, and repeat the trial."
                raise UserError(f"The impairment of {axes} {what}.", fix)
            if passed_s > SETTLE_S:
                self.waits(keyed("advice.switch", axes=axes))
            if self.ask():
                return
            self.want({})
            self.pull()
        self.waits("")
        self._held = wanted
        told = {a or "joint": self._rows.value(tap) for a, tap in self._acts.items()}
        now = {"tick": self._rows.tick, "board_ns": self.board_ns}
        self.say("condition", trial=number, asked=self._asked, acts=told, **now)

    def over(self, number: int, state: str) -> None:
        """End the request: the last command expires at its deadline."""
        self._asked, self._held = {}, None
        self._event("trial_end", number=number, state=state)
        self.say("link", trial=number, **self.device.health())

    def _event(self, topic: str, **content: Any) -> None:
        if self._recording is not None:
            with contextlib.suppress(UserError):  # ended: the next frame fails, with the reason
                self._recording.event(topic, board_ns=self.board_ns, **content)

    def _must_record(self) -> None:
        if self._recording is not None and self._recording.error is not None:
            raise UserError(f"The recording failed: {self._recording.error}", "")

    def want(self, requests: Mapping[str, float]) -> None:
        wanted = self._none | self._asked | self.signals.wanted(requests)
        self._state = state = self.device.state()
        if state in HALTED:
            raise UserError(self._trouble(state) + ".", "Correct the cause, then continue.")
        if self._armed and state not in WORKING:
            raise UserError(
                f"The board is {state}: the motor has been switched off.", "Arm it again."
            )
        if state in WORKING:
            self.device.want(DEADLINE_MS, mode=TORQUE_MODE, **wanted)

    def frame(self, requests: Mapping[str, float]) -> Inputs:
        try:
            self._must_record()
            self.want(requests)
            self.pull()
            if self.device.receiver.reconnects != self._reconnects:
                raise LinkError("the link broke for a while")
            if self._rows.began_again:
                raise UserError("The board's clock restarted.", "")
            if self._held is not None:
                for axis, tap in self._acts.items():
                    if self._rows.differ(tap, self._held):
                        raise UserError(
                            f"The impairment of {axis or 'the joint'} did not stay "
                            f"{'on' if self._held else 'off'}.",
                            "Check the board's limits, and repeat the trial.",
                        )
        except (LinkError, UserError) as error:
            self._lost(error)
        return {name: self._rows.value(tap) for name, tap in self._taps.items()}

    def _lost(self, error: Exception) -> None:
        # Why, as far as it can be told: who has no power says nothing.
        what, fix = str(error), "Check cable and power."
        state = self.device.state()
        if self.device.receiver.away:
            what = f"The link to the board broke. {what}"
        elif self._rows.began_again or (self._armed and state == "UNREFERENCED"):
            what = "The board restarted without a fault, not armed: it lost power or was zeroed."
        elif not isinstance(error, LinkError):
            fix = ""
        if what.endswith(fix):  # the error says it itself
            fix = ""
        self._broken = f"{what} {fix}".strip()
        raise UserError(what, fix) from None

    def status(self) -> str:
        return self._state

    def broken(self) -> str:
        receiver, again = self.device.receiver, self._rows.began_again
        if again or receiver.away or receiver.reconnects != self._reconnects:
            self._broken = self._broken or keyed("advice.link_broken")
        return self._broken

    def tick_s(self) -> float | None:
        return self._rows.taken_s

    def gauges(self) -> tuple[Gauge, ...]:
        found = []
        for axis, tap in self._torques.items():
            most, of = self._limit("tau_max_Nm", axis), f" {axis}" if axis else ""
            found.append(Gauge(f"torque{of}", self._rows.value(tap), -most, most, "Nm"))
        for axis, tap in self._angles.items():
            low, high = (self._limit(f"rom_{e}_rad", axis) * DEG for e in ("min", "max"))
            of, low = f" {axis}" if axis else "", low if math.isfinite(low) else -high
            found.append(Gauge(f"angle{of}", DEG * self._rows.value(tap), low, high, "deg"))
        return tuple(found)

    def close(self) -> None:
        """Disarm a motor that was armed here, and end the recording; keep the connection open."""
        with contextlib.suppress(LinkError):
            if self.drive and self.device.state() in WORKING:
                self.device.disarm()
        if self._recording is not None:
            self._recording.close()
        self._rows.close()


class _Wearer(Actor):
    def __init__(self, source: BoardSource) -> None:
        self._source, self._begun_ns = source, source.board_ns

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        inputs = self._source.frame(requests)
        return round((self._source.board_ns - self._begun_ns) * 1e-9, 6), inputs
