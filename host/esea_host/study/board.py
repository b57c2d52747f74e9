"""Inputs of a session from a connected board, real or simulated, with a recording of every run.

The board's limits own safety; this reads, and while the motor is armed it asks for what the task
asks for, 0 Nm where it asks for nothing.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_host.connection import ConnectedDevice
from esea_host.connection.recording import LiveRecording
from esea_host.study.scene import Scene
from esea_host.study.session import InputSource
from esea_host.study.task import Actor, Inputs, Situation, StudyTask
from esea_host.study.watching import Gauge

STREAM = "sense_out"
# What a task knows, by the board's column and the factor to the unit of the name.
INPUTS = {
    "theta_rad": ("theta_load_rad", 1.0),
    "theta_deg": ("theta_load_rad", 180 / math.pi),
    "tau_Nm": ("tau_Nm", 1.0),
}
# What a task may ask for: torque on the joint.  Anything else is no torque that can be stated.
WANTED = ("tau_desired_Nm",)
TORQUE_MODE, DEADLINE_MS = 1.0, 200
FRAME_S, SILENT_S, READY_S, SETTLE_S = 0.01, 1.0, 8.0, 0.2
WORKING = ("ARMED", "ACTIVE", "LETTING_GO")
REST_SHARE = 0.1  # of the largest torque: more at rest is a zero that is not one; assumed


class BoardSource(InputSource):
    """A board that somebody wears, for a session.

    Parameters
    ----------
    device : ConnectedDevice
        Connected.
    folder : Path
        Of the session: its recording goes there.
    drive : bool
        Zero and arm it before the first trial.
    advance : callable, optional
        Moves the clock of a board whose clock stands still.
    """

    def __init__(
        self,
        device: ConnectedDevice,
        folder: Path,
        drive: bool = False,
        advance: Callable[[float], None] | None = None,
    ) -> None:
        self.device, self.folder, self.drive, self.advance = device, folder, drive, advance
        self.values: dict[str, float] = {}
        self._state = "UNKNOWN"
        self._limits = device.parameters()
        self._most_Nm = self._limits.get("limits.tau_max_Nm", math.inf)
        self._recording: LiveRecording | None = None
        self._queue = device.subscribe([STREAM])
        self._first_ns: int | None = None
        self.board_ns = 0

    # -- before the first trial --------------------------------------------------------------------

    def ready(self) -> Mapping[str, Any]:
        """Whether it tells, zero and limits; armed where it is to be."""
        identity = self.device.identity
        found: dict[str, Any] = {
            "simulated": self.device.simulated,
            "device": identity.device.name,
            "content_hash": identity.content_hash,
            "limits": {k: v for k, v in self._limits.items() if k.startswith("limits.")},
        }
        try:
            if self._recording is None:
                self._recording = self.device.record(self._new_file())
                found["recording"] = self._recording.recorder.path.name
            self.device.listen([STREAM])
            self.pull()
            if self.drive:
                self._arm()
            self._pass(SETTLE_S)
            self._state = state = self.device.state()
        except (LinkError, UserError) as error:
            return found | {"problem": str(error)}
        tau_Nm = self.values["tau_Nm"]
        found |= {"state": state, "tau_Nm": tau_Nm}
        if state in ("FAULT", "STOPPED"):
            found["problem"] = self._trouble(state)
        elif abs(tau_Nm) > REST_SHARE * self._most_Nm:
            found["problem"] = (
                f"at rest the torque is {tau_Nm:.2f} Nm, at most {REST_SHARE * self._most_Nm:.2f} "
                "Nm is taken for unloaded: unload the joint and zero it"
            )
        return found

    def _new_file(self) -> Path:
        # A session that goes on has a recording more.
        numbers = iter(range(1, 10_000))
        return next(p for n in numbers if not (p := self.folder / f"device-{n}.mcap").exists())

    def _arm(self) -> None:
        # Somebody who sways is not zeroed: again, until it is.
        deadline_s = self.now_s() + READY_S
        while (state := self.device.state()) not in WORKING:
            if state in ("FAULT", "STOPPED"):
                raise UserError(self._trouble(state), "See to it, then go on with study resume.")
            if state == "UNREFERENCED":
                self.device.zero()
            elif state == "READY":
                self.device.arm()
            if self.now_s() > deadline_s or self.ask():
                raise UserError(f"The board stays {state}.", "Rest the joint, unloaded.")
            self._pass(0.4)

    def _trouble(self, state: str) -> str:
        number = self.device.fault()
        return f"the board is in {state}" + (f", fault {number}" if number else "")

    # -- time --------------------------------------------------------------------------------------

    def pull(self) -> None:
        """Take the next frame of the board's time in.

        Raises
        ------
        UserError
            When nothing comes.
        """
        due_ns = self.board_ns + round(FRAME_S * 1e9)
        waited_s = time.monotonic() + SILENT_S
        while True:
            if self.advance is not None:
                self.advance(FRAME_S)
            for batch in self._queue.take(0.0 if self.advance else 0.02):
                for name, (column, factor) in INPUTS.items():
                    self.values[name] = factor * float(batch.rows[column][-1])
                self.board_ns = int(batch.board_ns[-1])
            if self._first_ns is None and self.board_ns:
                self._first_ns = self.board_ns
            if self.board_ns >= due_ns:
                return
            if time.monotonic() > waited_s:
                raise UserError(
                    f"Nothing came from the board for {SILENT_S:g} s.", "Look at cable and power."
                )

    def _pass(self, seconds: float) -> None:
        end_ns = self.board_ns + round(seconds * 1e9)
        while self.board_ns < end_ns and not self.ask():
            self.pull()

    def now_s(self) -> float:
        """By the board's clock."""
        return (self.board_ns - (self._first_ns or self.board_ns)) * 1e-9

    def rest(self, seconds: float) -> None:
        """Wait as long, by the board's clock; nothing is asked of the motor."""
        self._pass(seconds)

    # -- trials ------------------------------------------------------------------------------------

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        """Whoever wears the board."""
        missing = sorted(set(task.inputs) - set(INPUTS))
        if missing:
            raise UserError(
                f"{task.name} needs {', '.join(missing)}, which {self.device.identity.device.name} "
                "does not tell.",
                f"It tells {', '.join(INPUTS)}.",
            )
        self._event("trial", number=number, task=task.name)
        return _Wearer(self)

    def over(self, number: int, state: str) -> None:
        """What was wanted holds no longer than its deadline."""
        self._event("trial_end", number=number, state=state)

    def _event(self, topic: str, **content: Any) -> None:
        if self._recording is not None:
            self._recording.event(topic, board_ns=self.board_ns, **content)

    def want(self, requests: Mapping[str, float]) -> None:
        """Ask the board for what the task asks for.

        Raises
        ------
        UserError
            For what it has not, and when it is in no state to do anything.
        """
        unknown = sorted(set(requests) - set(WANTED))
        if unknown:
            raise UserError(
                f"The task asks the board for {', '.join(unknown)}; it takes {', '.join(WANTED)}.",
                "Run it with the device that it is for.",
            )
        self._state = state = self.device.state()
        if state in ("FAULT", "STOPPED"):
            raise UserError(self._trouble(state) + ".", "See to it, then go on with study resume.")
        if state in WORKING:
            wanted = {"tau_desired_Nm": 0.0, **requests}
            self.device.want(DEADLINE_MS, mode=TORQUE_MODE, **wanted)

    def status(self) -> str:
        """The board's own, as it was seen last."""
        return self._state

    def gauges(self) -> tuple[Gauge, ...]:
        """Torque and angle beside the limits in force."""
        now, deg = dict(self.values), 180 / math.pi
        low, high = (self._limits.get(f"limits.rom_{e}_rad", math.nan) for e in ("min", "max"))
        return (
            Gauge("torque", now.get("tau_Nm", 0.0), -self._most_Nm, self._most_Nm, "Nm"),
            Gauge("angle", now.get("theta_deg", 0.0), low * deg, high * deg, "deg"),
        )

    def close(self) -> None:
        """Disarm what was armed here, and end the recording; the connection is not ours to end."""
        if self.drive and self.device.state() in WORKING:
            with contextlib.suppress(LinkError):
                self.device.disarm()
        if self._recording is not None:
            self._recording.close()
        self.device.receiver.unsubscribe(self._queue)


class _Wearer(Actor):
    def __init__(self, source: BoardSource) -> None:
        self._source, self._begun_ns = source, source.board_ns

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        """The next frame, by the board's clock."""
        source = self._source
        try:
            source.want(requests)
            source.pull()
        except LinkError as error:
            raise UserError(f"{error}", "Look at cable and power.") from None
        return round((source.board_ns - self._begun_ns) * 1e-9, 6), dict(source.values)
