"""Messages with a board: frames both ways, waits, commands, requests with a window on the way."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from itertools import islice
from numbers import Integral, Real
from typing import Any, NamedTuple, Self

from esea_gen.link.frames import CHECKSUM_BYTES, HEADER_BYTES, FrameReader, LinkHealth
from esea_gen.link.received import shown
from esea_gen.link.transport import LinkError, Transport

MOST_ON_THE_WAY = 64
UNSIGNED = "If it is paired, sign with its key: use_key(file)."
LATE = (
    "It came more than half a second after the board's time that it carries: the line is full, or "
    "bytes are buffered. Ask for fewer streams, or use a faster line."
)
BUSY = "this board is commanded by "  # and by whom, to those who come beside
OTHERS = "End it, or let it command. A stop is accepted from any program."
AGE_S = 0.5  # as the board has it
FRESH_S = 0.05  # the board's time is asked for again before a single command
SOONEST_S, LATEST_S = 0.05, 1.0  # between two questions for it while set-points are sent
CLOCK_ERROR_MS = 20  # where its clock goes as ours does


class Address(NamedTuple):
    system: int
    component: int


class BoardTime(NamedTuple):
    boot: int  # number of its start: another one after every loss of power
    time_ms: int  # its clock then, and so at least so much
    at_s: float  # our clock when it came

    def time_at(self, now_s: float) -> tuple[int, int]:
        return self.boot, (self.time_ms + int((now_s - self.at_s) * 1e3)) % (1 << 32)


HOST = Address(255, 190)  # a ground station, by MAVLink's custom
BOARD = Address(1, 1)
MOST_TEXTS = 100
TRIES = 3


def _clean(message: Any) -> None:
    # Every text of a board, before anybody prints it or names a file by it.
    for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        text = getattr(message, name) if kind == "char" else None
        if isinstance(text, str):
            setattr(message, name, shown(text.rstrip("\0")))


def _whole(name: str, kind: str, value: Any) -> Any:
    # A number as its field holds it.
    if kind == "float" or not isinstance(value, Real) or isinstance(value, Integral):
        return value
    number = float(value)
    if not (number >= 0 and number % 1 == 0):
        raise ValueError(f"{name} is {number:g}; it takes whole numbers from 0. Give one.")
    return int(number)


class CommandedError(LinkError):
    """Another program commands the board."""


class UnansweredError(LinkError):
    """A request had no answer in time."""


class Messenger:
    """Messages with a board, and commands; as a context manager it waits for the HEARTBEAT.

    A command that may move something carries the board's time, which is asked for before it.
    """

    board = BOARD

    def __init__(
        self, transport: Transport, dialect: Any, timeout_s: float = 10.0, host: Address = HOST
    ) -> None:
        self.transport, self.dialect, self.timeout_s = transport, dialect, timeout_s
        self.heartbeat: Any = None
        self._denied = int(dialect.MAV_RESULT_DENIED)
        self._classes = {c.msgname: c for c in dialect.mavlink_map.values()}
        self._encoder = dialect.MAVLink(None, *host)
        self._key: bytes | None = None
        self.clock_s: Callable[[], float] = time.monotonic  # a board moved by hand: its own
        self._board_time: BoardTime | None = None
        self._asked_s, self._every_s = float("-inf"), SOONEST_S
        self._reader = FrameReader(dialect)
        self._pending: deque[Any] = deque()
        self._asked_again = False
        self.was_late, self.stays = False, True  # stays: beside who commands, for a stop
        self._refusal = ""  # what it said to the last command, if that did not count
        self.texts: deque[str] = deque(maxlen=MOST_TEXTS)

    def __enter__(self) -> Self:
        try:
            self.wait_for("HEARTBEAT")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.transport.close()

    @property
    def counters(self) -> LinkHealth:
        return self._reader.health

    def message(self, name: str, *values: Any) -> Any:
        """A message of the dialect by name, its values in the order of the definition."""
        cls = self._classes[name]
        return cls(*map(_whole, cls.fieldnames, cls.fieldtypes, values))

    def pack(self, message: Any) -> bytes:
        """A message as the next frame from the host."""
        frame = bytes(message.pack(self._encoder))
        # pack() leaves counting to send(), which wants a file.
        self._encoder.seq = (self._encoder.seq + 1) % 256
        return frame

    def send(self, message: Any) -> None:
        self.send_bytes(self.frames(message))

    def frames(self, message: Any) -> bytes:
        """A message as frames from the host, with the board's time where it needs one."""
        if message.get_type() == "ESEA_WANTED":
            if message.mode:
                message.boot, message.time_ms = self.time_now(None)
            elif self._board_time is not None:  # off waits for nothing
                message.boot, message.time_ms = self._board_time.time_at(self.clock_s())
        elif self._expires(message):
            stamp = self.message("ESEA_STAMP", 0, *self.time_now(FRESH_S))
            self._refusal = ""
            return self.pack(stamp) + self.pack(message)
        elif self._key and not self._stops(message):
            self.time_now(LATEST_S)  # from which count on to sign
        return self.pack(message)

    def _stops(self, message: Any) -> bool:
        stop = self.dialect.MAV_CMD_USER_4
        return bool(message.get_type() == "COMMAND_LONG" and message.command == stop)

    def _expires(self, message: Any) -> bool:
        kind, d = message.get_type(), self.dialect
        if kind == "COMMAND_LONG":
            never = (
                d.MAV_CMD_USER_4, d.MAV_CMD_REQUEST_MESSAGE, d.MAV_CMD_SET_MESSAGE_INTERVAL
            )  # fmt: skip
            disarms = message.command == d.MAV_CMD_COMPONENT_ARM_DISARM and message.param1 != 1
            return message.command not in never and not disarms
        if kind == "ESEA_BLACKBOX":
            return bool(message.records == 255)
        return kind in ("PARAM_SET", "SETUP_SIGNING", "ESEA_KEPT", "ESEA_LIFE")

    def time_now(self, fresh_s: float | None) -> tuple[int, int]:
        # The board's start, and its time at this moment: how long its answer takes makes what is
        # sent then as old. None: asked for without waiting.
        known, now_s = self._board_time, self.clock_s()
        old_s = 0.0 if known is None else now_s - known.at_s
        if known is None or old_s < 0 or (fresh_s is not None and old_s >= fresh_s):
            known = self.learn_time()
        elif fresh_s is None:
            known = self._ask_time_in_passing(known)
        return known.time_at(now_s)

    def beat(self) -> list[Any]:
        """HEARTBEAT with the board's time, which keeps a board armed; nothing is asked."""
        known, beat = self._board_time, self.message("HEARTBEAT", 6, 8, 0, 0, 0, 3)
        times = [] if known is None else [known.time_at(self.clock_s())]
        return [*(self.message("ESEA_STAMP", 0, *t) for t in times), beat]

    def _ask_time(self) -> None:
        own = self._encoder.signing
        signs, own.sign_outgoing = own.sign_outgoing, False
        self._asked_s = self.clock_s()
        self.send_bytes(self.pack(self.message("ESEA_STAMP", 0, 0, 0)))
        own.sign_outgoing = signs

    def learn_time(self) -> BoardTime:
        self._board_time = None
        found = partial(self._until, lambda: self._board_time, "ESEA_STAMP")
        told: BoardTime = self.repeated("ESEA_STAMP", self._ask_time, found)
        return told

    def take_time_of(self, other: Messenger) -> None:
        """Adopt the clock of a new connection, possibly to a new board."""
        known = other.learn_time()
        self._board_time = known._replace(at_s=self.clock_s())
        own = self._encoder.signing
        own.timestamp = max(own.timestamp, other._encoder.signing.timestamp)

    def sign_as_well(self, encoder: Any) -> None:
        """Sign with another encoder as this session does, with any key."""
        encoder.signing = self._encoder.signing

    def _ask_time_in_passing(self, known: BoardTime) -> BoardTime:
        if self.clock_s() - max(self._asked_s, known.at_s) >= self._every_s:
            self._ask_time()
        if self._asked_s > known.at_s:
            self._read(0.0)
        return self._board_time or known

    def _take_time(self, message: Any) -> None:
        known, now_s = self._board_time, self.clock_s()
        if known is not None and known.boot == message.boot:
            ahead_ms = message.time_ms - known.time_ms - (now_s - known.at_s) * 1e3
            same = abs(ahead_ms) <= CLOCK_ERROR_MS
            self._every_s = min(2 * self._every_s, LATEST_S) if same else SOONEST_S
        self._board_time = BoardTime(message.boot, message.time_ms, now_s)
        own = self._encoder.signing
        own.timestamp = max(own.timestamp, message.signature + 1)
        own.sign_outgoing = self._key is not None

    def send_bytes(self, data: bytes) -> None:
        try:
            self.transport.write(data, self.timeout_s)
        except LinkError:
            with suppress(LinkError):
                self._read(0.0)  # what it said last
            self._refuse_beside()
            raise

    def pending(self) -> list[Any]:
        """Received messages that nobody has read; does not wait."""
        while self._read(0.0):
            pass
        found = list(self._pending)
        self._pending.clear()
        return found

    def receive(self, timeout_s: float | None = None) -> Any:
        return self._wait(lambda _: True, "message", timeout_s)

    def wait_for(
        self, name: str, timeout_s: float | None = None, wanted: Callable[[Any], bool] | None = None
    ) -> Any:
        """The next message of a name; others stay pending."""

        def fits(message: Any) -> bool:
            return message.get_type() == name and (wanted is None or wanted(message))

        return self._wait(fits, name, timeout_s)

    def _wait(
        self,
        fits: Callable[[Any], bool],
        name: str,
        timeout_s: float | None = None,
        drop_before: bool = False,
    ) -> Any:
        seen = 0

        def found() -> Any:
            nonlocal seen
            for i, message in enumerate(islice(self._pending, seen, None), seen):
                if fits(message):
                    del self._pending[i]
                    for _ in range(i if drop_before else 0):
                        self._pending.popleft()
                    return message
            seen = len(self._pending)
            return None

        return self._until(found, name, self.timeout_s if timeout_s is None else timeout_s)

    def _until(self, found: Callable[[], Any], name: str, limit_s: float) -> Any:
        deadline_s = time.monotonic() + limit_s
        frames, noise_bytes = self.counters.frames, self.counters.noise_bytes
        while (message := found()) is None:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                now = self.counters
                came = now.frames - frames, now.noise_bytes - noise_bytes
                raise self._too_late(name, limit_s, *came)
            self._read(left_s)
        return message

    def _refuse_beside(self) -> None:
        said = [t for t in self.texts if t.startswith(BUSY)]
        if said:
            who = said[-1].removeprefix(BUSY)
            raise CommandedError(f"another program commands this board ({who})", OTHERS) from None

    def _too_late(self, name: str, limit_s: float, frames: int, noise_bytes: int) -> LinkError:
        self._refuse_beside()
        what = f"no {name} came within {limit_s:g} s"
        if frames:
            fix = f"{frames} others of this dialect did: use a faster line, or check the device."
        elif noise_bytes:
            what += f", but {noise_bytes} bytes that are not frames"
            fix = "Check the baud rate, and that the firmware is this device's."
        else:
            what = f"the board was silent for {limit_s:g} s, no {name} came"
            fix = "Check that it has power and runs, and that port and cable are the right ones."
        return UnansweredError(what, fix, self.transport.said())

    def _read(self, timeout_s: float) -> bool:
        # Whether any bytes came.
        try:
            data = self.transport.read(timeout_s)
        except LinkError:
            self._refuse_beside()
            raise
        for message in self._reader.feed(data):
            if message.get_type() == "ESEA_STAMP":
                self._take_time(message)
                continue
            _clean(message)
            self._pending.append(message)
            if message.get_type() == "STATUSTEXT":
                self.texts.append(str(message.text))
                if not self.stays:
                    self._refuse_beside()
                if self.texts[-1].startswith("refused: "):
                    self._refusal = self.texts[-1]
                    self.was_late = "too late" in self._refusal
            if message.get_type() == "HEARTBEAT":
                self.heartbeat = message
                if message.system_status == self.dialect.MAV_STATE_EMERGENCY:
                    what = "the processor took a fault exception and halted"
                    raise LinkError(what, said=self.transport.said())
        return bool(data)

    def command(
        self,
        command: int,
        param1: float = 0.0,
        param2: float = 0.0,
        *,
        again: bool = False,
        drop_before: bool = False,
    ) -> int:
        def fits(message: Any) -> bool:
            return message.get_type() == "COMMAND_ACK" and bool(message.command == command)

        params = (param1, param2, *[0.0] * 5)
        message = self.message("COMMAND_LONG", *self.board, command, int(again), *params)

        def ask() -> None:
            self.send(message)
            message.confirmation = 1

        def answer(limit_s: float) -> Any:
            return self._wait(fits, "COMMAND_ACK", limit_s, drop_before)

        # A stop or a question may come twice; anything else expires.
        once = self._expires(message) or command == self.dialect.MAV_CMD_COMPONENT_ARM_DISARM
        for _ in self.attempts():
            ack = self.repeated("COMMAND_ACK", ask, answer, 1 if once else TRIES)
            self.was_late = bool(ack.result_param2)
        return int(ack.result)

    def repeated(
        self, name: str, ask: Callable[[], None], answer: Callable[[float], Any], tries: int = TRIES
    ) -> Any:
        """Ask, and ask again where the line has lost the question or its answer."""
        if self._asked_again:  # late answers to what was asked before
            self._pending = deque(m for m in self._pending if m.get_type() != name)
        for left in reversed(range(tries)):
            ask()
            with suppress(*[UnansweredError][:left]):
                return answer(self.timeout_s / 10 if left else self.timeout_s)
            self._asked_again = True

    def attempts(self) -> Iterator[None]:
        """Once; again where the board, whose clock may be faster (simulated), says too late."""
        begun_s = self.clock_s()
        self.was_late = True
        while self.was_late and 0 <= self.clock_s() - begun_s < AGE_S:
            self.was_late = False
            yield
            if self.was_late:
                self._board_time = None

    def sign_with(self, key: bytes | None) -> None:
        # Signs what is sent from now on, once the board has said from which count on; without a key
        # no more.
        own = self._encoder.signing
        self._key, own.secret_key, own.link_id, own.timestamp = key, key, 0, 0
        own.sign_outgoing = False
        self._board_time = None

    def _ask(
        self, what: str, command: int, param1: float = 0.0, param2: float = 0.0, again: bool = False
    ) -> None:
        result = self.command(command, param1, param2, again=again)
        if result == self._denied:
            raise LinkError(f"the board does not {what}", LATE if self.was_late else UNSIGNED)
        if result != self.dialect.MAV_RESULT_ACCEPTED:
            raise self._refused(what)

    def _refused(self, what: str) -> LinkError:
        state, meaning = self._entry("ESEA_STATE", self.ask_for("ESEA_CLOCK").state)
        if self._refusal:
            fix = UNSIGNED if "paired" in self._refusal else LATE
            return LinkError(f"the board does not {what}: {self._refusal}", fix)
        return LinkError(f"the board does not {what} now: it is {state}. {meaning}")

    def ask_for(self, name: str, number: int = 0) -> Any:
        """One message that the board sends on request; number: which, where there are several."""
        wanted = float(self._classes[name].id)
        command = self.dialect.MAV_CMD_REQUEST_MESSAGE

        def ask() -> None:
            if self.command(command, wanted, float(number)) == self._denied:
                raise LinkError(f"the board does not send {name}", UNSIGNED)

        return self.repeated(name, ask, lambda limit_s: self.wait_for(name, limit_s))

    def info(self) -> Any:
        return self.ask_for("ESEA_INFO")

    def state(self) -> str:
        return self._entry("ESEA_STATE", self.heartbeat.custom_mode)[0]

    def fault(self) -> str:
        name, meaning = self._entry("ESEA_FAULT", self.info().fault)
        return f"{name}: {meaning}"

    def _entry(self, enum: str, value: int) -> tuple[str, str]:
        entry = self.dialect.enums[enum].get(value)
        if entry is None:
            return str(value), "This version does not know that number."
        return str(entry.name).removeprefix(f"{enum}_"), str(entry.description)

    def window(self, names: Iterable[str]) -> int:
        """How many messages of these names the board's receive buffer holds at once."""
        payload_bytes: int = max(self._classes[name].unpacker.size for name in names)
        room_bytes = int(self.info().receive_buffer_bytes) - 1
        fits = room_bytes // (HEADER_BYTES + payload_bytes + CHECKSUM_BYTES)
        return max(1, min(MOST_ON_THE_WAY, fits))

    def exchange(self, requests: Iterable[tuple[Any, str]], window: int) -> Iterator[Any]:
        """Send requests, a window of them on the way, and give their answers in order."""

        def fits(message: Any) -> bool:
            held = (self.dialect.ESEA_STATE_FAULT, self.dialect.ESEA_STATE_STOPPED)
            kind = message.get_type()
            return bool(kind == name or (kind == "HEARTBEAT" and message.custom_mode in held))

        source = iter(requests)
        awaited: deque[tuple[str, int]] = deque()
        while True:
            # Refill when half of the window has come back: few, large pieces go faster.
            if len(awaited) <= window // 2:
                batch = list(islice(source, window - len(awaited)))
                awaited.extend((name, message.sequence) for message, name in batch)
                if batch:
                    self.send_bytes(b"".join(self.pack(message) for message, _ in batch))
            if not awaited:
                return
            name, sequence = awaited.popleft()
            answer = self._wait(fits, name)
            if answer.get_type() != name and self.state() == "STOPPED":
                raise LinkError("the board was stopped", "Release the stop.")
            if answer.get_type() != name:
                raise LinkError(f"a fault is latched: {self.fault()}")
            if answer.sequence != sequence:
                raise LinkError(f"answer {answer.sequence} came in place of {sequence}")
            yield answer
