"""A knee on a connected board: samples, movements, state, zero, and the session's recording."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import unused
from esea_gen.link.transport import LinkError
from esea_host.assess.passive_tests import FALLING_rad_s, FALLING_rad_s2, steepest_rad_s2
from esea_host.assess.patients import DEG, MEAN_HEIGHT_M, PULL_N, shank_length_m
from esea_host.assess.probing import Comfort, ProbingMovement
from esea_host.assess.responses import SENSOR_ERROR_NM, LegRecording
from esea_host.assess.segments import HOLE_STEPS, LONGEST_S, MovementEvent, MovementWatch, Segment
from esea_host.connection import ConnectedDevice

STREAM = "sense_out"
COLUMNS = ("theta_load_rad", "omega_load_rad_s", "tau_Nm", "sensing_ok")
USELESS = ("UNREFERENCED", "FAULT", "STOPPED")  # states in which nothing is measured
SILENT_S, KNOWN_S, ZEROED_S, FRAME_S = 0.5, 3.0, 8.0, 0.02
MOST_FRAME_S = 0.1  # of a simulated board's time, however long a window was busy
TRIED_rad_s, FALLEN_RAD = 30 * DEG, 10 * DEG
HANDS_NM = 3 * SENSOR_ERROR_NM  # more than the sensor errs by: hands are on the leg
AT_FASTEST_S = 0.05

Row = tuple[float, float, float, float]  # time, angle, rate, torque
Say = Callable[[str], None]


class Therapist(Protocol):
    """A simulated therapist, who makes the movements that the session proposes."""

    def follow(self, asked: ProbingMovement) -> None: ...


class KneeBoard:
    """Takes the samples of a board that measures a knee."""

    def __init__(
        self,
        device: ConnectedDevice,
        comfort: Comfort,
        session_file: Path | None = None,
        *,
        advance: Callable[[float], None] | None = None,  # moves a clock that stands still
        paced: bool = False,  # such a clock follows the time of the day
        therapist: Therapist | None = None,
        kept_s: float = LONGEST_S,
    ) -> None:
        self._refuse(device)
        self.device, self.watch = device, MovementWatch(comfort, kept_s)
        self._advance, self._paced, self.therapist = advance, paced, therapist
        self.rows: deque[Row] = deque(maxlen=round(kept_s * 1000))
        self.valid, self.problem, self._state = False, "", "UNKNOWN"
        self._fault = 0
        self._now_s = self._seen_s = time.monotonic()
        self._board_s = 0.0
        self._queue = device.subscribe([STREAM])
        self.recording = None
        if session_file is not None:
            stem = session_file.with_suffix("")  # that of the same name has a recording more
            self.recording = device.record(unused(stem.with_name(f"{stem.name}-"), ".mcap"))
        device.listen([STREAM])

    @staticmethod
    def _refuse(device: ConnectedDevice) -> None:
        made = device.identity.device
        names = {c.name for x in device.receiver.decoder.layouts.values() for c in x.columns}
        missing = [c for c in COLUMNS if c not in names]
        most_Nm, pull_Nm = made.file.limits.tau_Nm.value, PULL_N * shank_length_m(MEAN_HEIGHT_M)
        why = f"measures up to {most_Nm:g} Nm, hands at a leg pull {pull_Nm:.0f} Nm"
        if made.laws:
            why = "has a motor"
        elif missing:
            why = f"does not report {', '.join(missing)}"
        elif most_Nm >= pull_Nm:
            return
        what = f"{made.name} {why}: the knee is assessed on a passive board."
        raise UserError(what, "Connect one with the knee_board firmware, or use sim:knee.")

    @property
    def simulated(self) -> bool:
        return self.therapist is not None or self.device.simulated

    @property
    def recorded(self) -> str | None:
        return None if self.recording is None else self.recording.recorder.path.name

    # -- before the first movement -----------------------------------------------------------------

    def state(self) -> str:
        return self.device.state()

    def zero(self) -> None:
        """Take the straight leg as 0 deg: coupling unloaded, at rest."""
        why = ""
        until_s = self.clock_s() + ZEROED_S
        while self.clock_s() < until_s:
            try:
                self.device.zero()
            except LinkError as error:
                why = str(error)
            for _ in range(25):
                self.poll(FRAME_S)
            if self.valid and self.state() == "READY":
                return
        raise UserError(
            f"The board is not zeroed; it is {self.state()}. {why}".strip(),
            "Rest the straight leg, take your hands off the coupling, keep still, zero it again.",
        )

    def trouble(self) -> str:
        """Why no movement can be taken now; empty: all is well."""
        if self.problem:
            return self.problem
        state = self._state
        if state == "UNREFERENCED":
            return (
                "The board is not zeroed: rest the straight leg, take your hands off the coupling, "
                "then zero it."
            )
        if state in USELESS:
            return f"The board is in {state}, fault {self._fault}; esea-host view shows it."
        return "" if self.valid else "The board gives no valid angle (sensing_ok = 0)."

    # -- while it runs -----------------------------------------------------------------------------

    def clock_s(self) -> float:
        """Seconds by whatever clock its samples come."""
        return time.monotonic() if self._advance is None else self._board_s

    def show(self, asked: ProbingMovement) -> None:
        """A movement is proposed: a simulated therapist makes it."""
        if self.therapist is not None:
            self.therapist.follow(asked)

    def start_anew(self) -> None:
        self._queue.take(0.0)
        self.watch.end("")

    def poll(self, timeout_s: float = 0.0) -> list[MovementEvent]:
        """Data received since the last call."""
        events: list[MovementEvent] = []
        try:
            if self._advance is not None:
                self._move_clock(self._advance, timeout_s)
            batches = self._queue.take(0.0 if self._advance is not None else timeout_s)
            before, self._state = self._state, self.state()
            if self._state in USELESS and self._state != before:
                self._fault = 0 if self._state == "UNREFERENCED" else self.device.fault()
                events = self._ended(self.trouble())
        except LinkError as error:
            self.problem = f"The link is broken: {error}"
            return self._ended(self.problem)
        for batch in batches:
            self._seen_s, self.problem = time.monotonic(), ""
            for gap in batch.gaps:
                if gap.missing < 0 or gap.missing >= HOLE_STEPS:
                    rows = "rows" if gap.missing < 0 else f"{gap.missing} rows"
                    events += self._ended(f"{rows} lost: {gap.reason}")
            times = (batch.board_ns * 1e-9).tolist()
            self._board_s = times[-1]
            columns = [batch.rows[c].tolist() for c in COLUMNS]
            for time_s, angle, rate, torque, ok in zip(times, *columns, strict=True):
                self.valid = bool(ok) and self._state not in USELESS
                if self.valid:
                    self.rows.append((time_s, angle, rate, torque))
                events += self.watch.take(time_s, angle, rate, torque, self.valid)
        silent = self._advance is None and time.monotonic() - self._seen_s > SILENT_S
        if silent and not self.problem:
            self.problem = f"No data came for {SILENT_S:g} s: check cable and power."
            events += self._ended(self.problem)
        return events

    def _move_clock(self, advance: Callable[[float], None], timeout_s: float) -> None:
        if self._paced:
            time.sleep(max(0.0, self._now_s + timeout_s - time.monotonic()))
            before_s, self._now_s = self._now_s, time.monotonic()
            timeout_s = min(self._now_s - before_s, MOST_FRAME_S)
        advance(timeout_s)

    def _ended(self, reason: str) -> list[MovementEvent]:
        self.valid = False
        return self.watch.end(reason)

    def note(self, topic: str, **content: Any) -> None:
        if self.recording is not None:
            self.recording.event(topic, **content)

    def close(self) -> None:
        """End the recording; the connection is not ours to end."""
        self.device.receiver.unsubscribe(self._queue)
        if self.recording is not None:
            self.recording.close()
            if self.recording.error is not None:
                what = f"{self.recorded}: {self.recording.error}"
                raise UserError(what, "The file keeps all earlier data.")


def await_state(board: KneeBoard) -> None:
    until_s = board.clock_s() + KNOWN_S
    while board.clock_s() < until_s and (board.state() == "UNKNOWN" or board.trouble()):
        board.poll(FRAME_S)
        if board.state() in USELESS:
            break


def be_ready(board: KneeBoard, say: Say, zero: bool = False) -> None:
    """Refuse a board that cannot be used; zero one that is not, if asked to or simulated."""
    await_state(board)
    if board.state() == "UNREFERENCED":
        if not (zero or board.simulated):
            raise UserError(board.trouble(), "Then start again with --zero.")
        say("The board is being zeroed: leg straight and at rest, hands off the coupling.")
        board.zero()
        say("The board is zeroed: the straight leg is 0°.")
    if trouble := board.trouble():
        raise UserError(trouble, "Inspect it with esea-host view, then start again.")


def _polled(board: KneeBoard, test: str) -> list[MovementEvent]:
    # A board that goes before anything moved has no movement that breaks.
    events = board.poll(FRAME_S)
    ended = [e.text for e in events if e.kind in ("broken", "lost")]
    if why := "".join(ended[:1]) or board.trouble().rstrip("."):
        raise UserError(f"{test}: {why}.", "Repeat the test.")
    return events


def await_fall(board: KneeBoard, say: Say, longest_s: float) -> Segment:
    """A leg that is let go and comes to rest."""
    board.start_anew()
    until_s = board.clock_s() + longest_s
    while board.clock_s() < until_s:
        for event in _polled(board, "pendulum test"):
            s = event.segment
            if s is not None and np.max(s.rate_rad_s) >= TRIED_rad_s:
                if _fell(s):
                    return s
                say("The leg did not fall; hold it straight, keep still, let go.")
    raise UserError(
        f"pendulum test: no leg fell within {longest_s:g} s.", "Hold the leg straight, and let go."
    )


def _fell(s: Segment) -> bool:
    """Whether a leg fell by its own weight: far, as steeply as gravity, without hands."""
    step_s = float(np.median(np.diff(s.time_s)))
    at_fastest = np.abs(s.time_s - s.time_s[np.argmax(s.rate_rad_s)]) <= AT_FASTEST_S
    return bool(
        s.angle_rad[-1] - s.angle_rad[0] >= FALLEN_RAD
        and np.max(s.rate_rad_s) >= FALLING_rad_s
        and steepest_rad_s2(s.rate_rad_s, step_s) >= FALLING_rad_s2
        and np.mean(np.abs(s.torque_Nm[at_fastest])) <= HANDS_NM
    )


def await_cycles(
    board: KneeBoard, say: Say, seconds: float, height_m: float, mass_kg: float
) -> LegRecording:
    """So many seconds of a leg that is bent and straightened, from its first movement on."""
    board.start_anew()
    began_s, until_s = None, board.clock_s() + seconds
    while board.clock_s() < until_s:
        for event in _polled(board, "range of motion"):
            if event.kind == "warning":
                say(f"\a{event.text}")
            if event.kind == "started" and began_s is None:
                say("It moves.")
                began_s, until_s = event.time_s, board.clock_s() + seconds
    if began_s is None:
        raise UserError(
            f"range of motion: no movement within {seconds:g} s.", "Bend and straighten slowly."
        )
    t, angle, _, torque = np.array([r for r in board.rows if r[0] >= began_s]).T
    return LegRecording(t, angle, torque, height_m, mass_kg, simulated=board.simulated)
