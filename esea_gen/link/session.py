"""Session with a board: requests and received messages."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from copy import copy
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from esea_gen.link import signing, streams
from esea_gen.link.messenger import BOARD, HOST, Address, Messenger, UnansweredError
from esea_gen.link.parameters import BoardParameter, find_parameter, known_parameters
from esea_gen.link.streams import BoardStream, StreamSamples, StreamSignal
from esea_gen.link.transport import LinkError, Transport

__all__ = ["BOARD", "HOST", "Address", "Session", "TimeSync"]

STREAMS, STREAM_WORDS = 6, 59  # side by side, and values that a message holds
RESETS = 20


class TimeSync(NamedTuple):
    offset_ns: int  # device clock minus host clock (time.monotonic_ns)
    round_trip_ns: int  # of the fastest question; the offset is off by less than half of it
    host_ns: int  # host clock at that moment


class Session(Messenger):
    def __init__(
        self, transport: Transport, dialect: Any, timeout_s: float = 10.0, host: Address = HOST
    ) -> None:
        super().__init__(transport, dialect, timeout_s, host)
        self._streams: dict[int, BoardStream] = {}
        self._asked: dict[int, Any] = {}  # messages that asked for streams, by number
        self._choice = time.monotonic_ns() % 256  # so that samples for a session before are known

    def reset(self) -> None:
        """Return the board to its initial state; drop its earlier messages."""
        for _ in range(RESETS):  # moves nothing: on a busy machine it may be asked again
            result = self.command(self.dialect.MAV_CMD_USER_1, drop_before=True)
            if not self.was_late:
                break
        if result == self.dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            raise self._refused("reset")
        if result != self.dialect.MAV_RESULT_ACCEPTED:
            raise LinkError(f"the board cannot reset: {self.fault()}")

    def zero(self) -> None:
        """Zero the encoders at the present angles: the joint is at its zero, unloaded, at rest."""
        self._ask("zero", self.dialect.MAV_CMD_USER_2)

    def arm(self) -> None:
        """Switch the motor on; from the next tick on the board follows commands."""
        self._ask("arm", self.dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)

    def disarm(self) -> None:
        """Switch the motor off; where it holds torque, gently."""
        self._ask("disarm", self.dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)

    def stop(self, *, again: bool = False) -> None:
        """Stop; taken in every state, and held until :meth:`release`.

        A second one switches off at once, but not ``again``: one that is under way goes on.
        """
        self._ask("stop", self.dialect.MAV_CMD_USER_4, again=again)

    def release(self) -> None:
        """Take a stop back; the motor stays off."""
        self._ask("release the stop", self.dialect.MAV_CMD_USER_5)

    def clear(self) -> None:
        """Say that a fault of the limits has been seen to; the motor stays off."""
        self._ask("clear the fault", self.dialect.MAV_CMD_USER_3)

    def want(self, deadline_ms: int = 0, **wanted: Any) -> None:
        """Send a command, which is valid until its deadline, without waiting for an answer."""
        cls = self._classes.get("ESEA_WANTED")
        if cls is None:
            raise LinkError("this device has no motor: it accepts no commands")
        own = ("deadline_ms", "boot", "time_ms")
        names = [n for n in cls.fieldnames if n not in own]
        unknown = set(wanted) - set(names)
        if unknown:
            raise ValueError(f"{sorted(unknown)} cannot be commanded; there is {names}")
        sizes = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
        values = {n: wanted.get(n, [0.0] * sizes[n] if sizes[n] else 0.0) for n in names}
        fields = values | {"deadline_ms": deadline_ms, "boot": 0, "time_ms": 0}
        self.send(self.message("ESEA_WANTED", *(fields[n] for n in cls.fieldnames)))

    def tell(self, name: str, interval_us: float) -> None:
        """Stream the runs of a task: its ``ESEA_<TASK>_IN`` or ``_OUT``."""
        wanted = (float(self._classes[name].id), interval_us)
        self._ask(f"tell {name}", self.dialect.MAV_CMD_SET_MESSAGE_INTERVAL, *wanted)

    # -- streams -----------------------------------------------------------------------------------

    def signals(self) -> list[StreamSignal]:
        """Everything that can be streamed: inputs and outputs of every task."""
        return streams.signals(self.dialect)

    def stream(self, names: Iterable[str], rate_Hz: float = 0.0) -> tuple[BoardStream, ...]:
        """Stream values at a rate (0: every run), rounded to complete runs; a stream a task."""
        tick_s = self.info().tick_us * 1e-6
        interval = max(1, round(1 / (rate_Hz * tick_s))) if rate_Hz > 0 else 1
        made = []
        numbers = streams.tasks(self.dialect)
        for task, chosen in streams.choose(self.signals(), names).items():
            for i in range(0, len(chosen), STREAM_WORDS):
                part = tuple(chosen[i : i + STREAM_WORDS])
                made.append(self._choose(numbers.index(task), task, part, interval, tick_s))
        return tuple(made)

    def _choose(
        self, at: int, task: str, chosen: tuple[StreamSignal, ...], interval: int, tick_s: float
    ) -> BoardStream:
        free = [n for n in range(STREAMS) if n not in self._streams]
        if not free:
            raise LinkError(f"all {STREAMS} streams are in use", "End some: stop_streams().")
        self._choice = (self._choice + 1) % 256
        answer = self._ask_stream(
            free[0], at, self._choice, min(interval, 65535), [s.number for s in chosen]
        )
        rate_Hz = 1 / (answer.interval * tick_s)
        made = BoardStream(
            free[0], self._choice, task, chosen, answer.interval, answer.samples, rate_Hz
        )
        self._streams[made.number] = made
        return made

    def _ask_stream(
        self, number: int, task: int, choice: int, interval: int, numbers: list[int]
    ) -> Any:
        filled = numbers + [0] * (STREAM_WORDS - len(numbers))
        cls = self._classes["ESEA_STREAM"]
        values = {
            "interval": interval, "stream": number, "task": task, "choice": choice,
            "count": len(numbers), "samples": 0, "result": 0, "signals": filled,
        }  # fmt: skip
        self._asked[number] = cls(*(values[n] for n in cls.fieldnames))
        self.send(self._asked[number])
        answer = self.wait_for(
            "ESEA_STREAM", wanted=lambda m: m.stream == number and m.choice == choice
        )
        if answer.result != self.dialect.MAV_RESULT_ACCEPTED:
            raise LinkError("the board does not stream that")
        return answer

    def stream_messages(self, *, on: bool) -> list[Any]:
        """Messages that start this session's streams again on the board, or stop them."""
        asked = [copy(self._asked[n]) for n in self._streams]
        for message in asked:
            message.interval *= on
        return asked

    def stop_streams(self) -> None:
        self._streams.clear()
        for number in range(STREAMS):
            self._ask_stream(number, 0, self._choice, 0, [])

    def samples(self, message: Any) -> StreamSamples | None:
        """The samples in a message; None when it holds none of a stream of this session."""
        if message.get_type() != "ESEA_DATA":
            return None
        stream = self._streams.get(message.stream)
        if stream is None or stream.choice != message.choice:
            return None
        return stream.decode(message)

    # -- parameters --------------------------------------------------------------------------------

    def known_parameters(self) -> list[BoardParameter]:
        """Parameters of the board, with unit, bounds, default and meaning."""
        return known_parameters(self.dialect)

    def parameters(self) -> dict[str, float]:
        known = self.known_parameters()
        found: dict[int, float] = {}
        self.send(self.message("PARAM_REQUEST_LIST", *self.board))
        with suppress(UnansweredError):
            while len(found) < len(known):
                value = self.wait_for("PARAM_VALUE", min(1.0, self.timeout_s))
                found[value.param_index] = float(value.param_value)
        # A frame may have been lost on the way.
        lost = (p for p in known if p.index not in found)
        found |= {p.index: self.parameter(p.name) for p in lost}
        return {p.name: found[p.index] for p in known}

    def parameter(self, name: str) -> float:
        p = find_parameter(self.known_parameters(), name)
        question = self.message("PARAM_REQUEST_READ", *self.board, p.id.encode(), -1)
        told = partial(self._told_of, p)
        answer = self.repeated("PARAM_VALUE", lambda: self.send(question), told)
        if answer.get_type() == "PARAM_ERROR":
            raise LinkError(f"the board has no {p.name}", "Use its firmware's device file.")
        return float(answer.param_value)

    def set_parameter(self, name: str, value: float) -> float:
        """Set a parameter, by full name or id; a refusal is an error with the board's reason."""
        p = find_parameter(self.known_parameters(), name)
        kind = self.dialect.MAV_PARAM_TYPE_REAL32
        for _ in self.attempts():
            self.send(self.message("PARAM_SET", *self.board, p.id.encode(), value, kind))
            answer = self._told_of(p)
        if answer.get_type() == "PARAM_VALUE":
            return float(answer.param_value)
        error = answer.error
        if error == self.dialect.MAV_PARAM_ERROR_READ_ONLY:
            raise LinkError(f"{p.name} is set by a calibration only", "Zero the joint instead.")
        if error == self.dialect.MAV_PARAM_ERROR_PERMISSION_DENIED:
            raise self._refused(f"set {p.name}")
        if error == self.dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST:
            raise LinkError(f"the board has no {p.name}", "Use its firmware's device file.")
        what = f"{p.name} = {value:g} {p.unit} is outside {p.low:g} to {p.high:g}"
        raise LinkError(f"{what}; it was left as it is")

    def _told_of(self, p: BoardParameter, limit_s: float | None = None) -> Any:
        def fits(message: Any) -> bool:
            kind = message.get_type()
            return kind in ("PARAM_VALUE", "PARAM_ERROR") and bool(message.param_id == p.id)

        # An answer to an earlier question is no answer to this one.
        self._pending = deque(m for m in self._pending if not fits(m))
        return self._wait(fits, "PARAM_VALUE", limit_s)

    def save_parameters(self) -> None:
        """Have the board keep the values in force without power."""
        self._store("save its parameters", 1.0, "This board has no permanent memory.")

    def load_parameters(self) -> None:
        """Put those in force that the board keeps."""
        self._store("load its parameters", 0.0, "Save them first with this firmware.")

    def default_parameters(self) -> None:
        """Put all defaults in force; stored values stay."""
        self._store("take its defaults", 2.0, "")

    def _store(self, what: str, action: float, failed: str) -> None:
        result = self.command(self.dialect.MAV_CMD_PREFLIGHT_STORAGE, action)
        if result == self.dialect.MAV_RESULT_FAILED:
            raise LinkError(f"the board cannot {what}", failed)
        if result != self.dialect.MAV_RESULT_ACCEPTED:
            raise self._refused(what)

    # -- time and trust ----------------------------------------------------------------------------

    def time_sync(self, rounds: int = 8) -> TimeSync:
        """Compare the clocks; of some questions the one that was answered fastest counts."""
        found = []
        for _ in range(rounds):
            asked_ns = time.monotonic_ns()
            self.send(self.message("TIMESYNC", 0, asked_ns))
            answer = self.wait_for("TIMESYNC", wanted=_answers(asked_ns))
            now_ns = time.monotonic_ns()
            middle_ns = (asked_ns + now_ns) // 2
            found.append(TimeSync(answer.tc1 - middle_ns, now_ns - asked_ns, middle_ns))
        return min(found, key=lambda s: s.round_trip_ns)

    def pair(self, path: Path) -> None:
        """Give the board a key; from then on it takes signed commands only, beside a stop.

        The key goes over the wire as it is: pair over a cable that nobody listens to.
        """
        if self.traffic().paired:
            raise LinkError("the board is paired already", "Use its key: use_key(file).")
        key = signing.new_key()
        signing.write_key(path, key)
        self.send(self.message("SETUP_SIGNING", *self.board, list(key), 0))
        self.sign_with(key)
        if not self.traffic().paired:
            self.sign_with(None)
            path.unlink()
            raise self._refused("pair")

    def unpair(self) -> None:
        """Take the key away; from then on the board takes commands from anybody."""
        self.send(self.message("SETUP_SIGNING", *self.board, [0] * signing.KEY_BYTES, 0))
        if self.traffic().paired:
            raise self._refused("forget its key")
        self.sign_with(None)

    def use_key(self, path: Path) -> None:
        """Sign from now on, with the key of a board that is paired."""
        self.sign_with(signing.read_key(path))

    def traffic(self) -> Any:
        """Counters of the link: streams dropped, signatures refused, whether it is paired."""
        return self.ask_for("ESEA_TRAFFIC")

    def clock(self) -> Any:
        """The board's own clock: ticks, lost and late ones, its state."""
        return self.ask_for("ESEA_CLOCK")


def _answers(asked_ns: int) -> Callable[[Any], bool]:
    return lambda message: bool(message.ts1 == asked_ns)
