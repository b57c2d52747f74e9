"""A connected board, for programs, windows and commands."""

from __future__ import annotations

import difflib
import threading
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from esea_gen.emit.dialect import load_dialect
from esea_gen.errors import UserError
from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError, Transport
from esea_gen.portability import uninterrupted
from esea_host.connection.address import BoardAddress, open_patiently
from esea_host.connection.decoder import TICK, TelemetryDecoder
from esea_host.connection.identity import Identity, column_texts, identify
from esea_host.connection.receiver import KEY, Batch, NamedStream, Receiver, Subscription
from esea_host.connection.recording import LiveRecording
from esea_host.recording.layout import StreamColumn, StreamLayout
from esea_host.recording.writer import Recorder

WAIT_S = 1.0
KEY_US = 1e6  # from one key frame to the next
MOST_AWAY_S = 60.0  # a link that broke may take so long to come back


@dataclass(frozen=True)
class RunSample:
    """One run of a task.

    Parameters
    ----------
    stream : str
        Which task's, and whether its input or output.
    tick : int
        Base tick.
    time_s : float
        By the board's clock.
    values : dict of str to float
        By name, in the unit of the name.
    """

    stream: str
    tick: int
    time_s: float
    values: dict[str, Any]

    def __getitem__(self, name: str) -> Any:
        """A value by its name."""
        return self.values[name]


def _run_samples(batch: Batch, wanted: tuple[str, ...]) -> Iterator[RunSample]:
    columns = {n: batch.rows[n].tolist() for n in wanted}
    ticks, times = batch.rows[TICK].tolist(), (batch.board_ns * 1e-9).tolist()
    for i, (tick, time_s) in enumerate(zip(ticks, times, strict=True)):
        yield RunSample(batch.layout.name, tick, time_s, {n: c[i] for n, c in columns.items()})


class ConnectedDevice:
    """A connected and identified board, whose telemetry is received.

    ``texts`` is what the board said in words, the oldest first; take away what you have read.

    Parameters
    ----------
    identity : Identity
        Who it is.
    transport : Transport
        Open.
    address : BoardAddress, optional
        Where it is, to open the link anew when it breaks.
    threaded : bool
        Listen in a thread; a board whose clock the caller moves is listened to by :meth:`pump`.
    """

    def __init__(
        self,
        identity: Identity,
        transport: Transport,
        address: BoardAddress | None = None,
        threaded: bool = True,
    ) -> None:
        self.identity, self.address = identity, address
        dialect = load_dialect(identity.device)
        decoder = TelemetryDecoder(dialect, *column_texts(identity.device))
        reopen = self._open_again if address is not None and address.kind != "file" else None
        self.receiver = Receiver(transport, decoder, identity.tick_us * 1000, reopen)
        self.session = Session(self.receiver, dialect)
        self.texts = self.session.texts
        self._lock = threading.RLock()
        self.most_away_s = MOST_AWAY_S
        self._start = identity.start
        self._told: dict[str, float] = {}
        self.rates_Hz: dict[str, float] = {}  # of the streams asked for, as the board rounds them
        self._ids = {c.msgname: n for n, c in dialect.mavlink_map.items()}
        self._recordings: list[LiveRecording] = []
        self._beats = dialect.MAVLink(None, 255, 191)
        self.session.sign_as_well(self._beats)
        if identity.key is not None:
            self.session.use_key(identity.key)
        self._dialect, self._threaded, self._closing = dialect, threaded, False
        self.receiver.keep_alive, self.receiver.on_reconnect = self._heartbeat, self._tell_again
        if threaded:
            self.receiver.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End recordings and let go of the board; more than once does no harm."""
        self._closing = True
        for recording in list(self._recordings):
            recording.close()
        with suppress(LinkError):  # who connects next has the line for its own questions
            self._tell(on=False)
        self.receiver.close()

    @contextmanager
    def _ask(self) -> Iterator[None]:
        with self._lock, self.receiver.asking():
            yield

    # -- staying connected -----------------------------------------------------------------------

    def _heartbeat(self) -> bytes:
        return b"".join(map(self._packed, self.session.beat()))

    def _packed(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._beats))
        self._beats.seq = (self._beats.seq + 1) % 256
        return frame

    def _open_again(self) -> Transport:
        # A link that breaks again while the board is asked who it is counts as not yet there.
        deadline_s = time.monotonic() + self.most_away_s
        while True:
            left_s = max(0.0, deadline_s - time.monotonic())
            try:
                return self._same_board(left_s)
            except LinkError as error:
                self.receiver.away_why = error.what
                if self._closing or time.monotonic() + WAIT_S >= deadline_s:
                    raise
            time.sleep(0.2)

    def _same_board(self, most_s: float) -> Transport:
        assert self.address is not None
        transport = open_patiently(self.address, lambda: self._closing, most_s)
        try:
            found = identify(transport, self.identity.device, self.identity.key)
            if found.content_hash != self.identity.content_hash:
                raise UserError("Another board answers on this link now.", "Connect again.")
            self.session.take_time_of(Session(transport, self._dialect, WAIT_S))
            self.receiver.restarted, self._start = found.start != self._start, found.start
        except BaseException:
            transport.close()
            raise
        return transport

    def _tell_again(self) -> None:
        self.session.heartbeat = None  # of before: its state is not known until the next one
        self._tell(on=True)

    def _tell(self, *, on: bool) -> None:
        # All that this client has asked for, or nothing of it any more; waits for no answer.
        long, command = self.session.message, self._dialect.MAV_CMD_SET_MESSAGE_INTERVAL
        wanted = [
            long("COMMAND_LONG", 1, 1, command, 0, float(self._ids[n]), on * us, *[0.0] * 5)
            for n, us in self._told.items()
        ]
        for message in wanted + self.session.stream_messages(on=on):
            self.receiver.write(self._packed(message), WAIT_S)

    def pump(self, timeout_s: float = 0.0) -> bool:
        """Listen once, where no thread does.

        Parameters
        ----------
        timeout_s : float
            Longest wait.
        """
        came = self.receiver.pump(timeout_s)
        for recording in self._recordings:
            recording.drain(0.0)
        return came

    # -- looking ---------------------------------------------------------------------------------

    @property
    def simulated(self) -> bool:
        """Whether no hardware is behind it."""
        return self.identity.simulated

    def fault(self) -> int:
        """Number of the latched fault, as the dialect's ESEA_FAULT; 0: none."""
        with self._ask():
            return int(self.session.info().fault)

    @property
    def _layouts(self) -> list[StreamLayout]:
        return list(self.receiver.decoder.layouts.values())

    @property
    def streams(self) -> list[str]:
        """Names of the streams that it can be asked for."""
        return [layout.name for layout in self._layouts]

    def health(self) -> dict[str, int]:
        """Counters of the link: frames, losses, wrong checksums, new connections, gaps."""
        own = {"reconnects": self.receiver.reconnects, "gaps": self.receiver.gap_count}
        dropped = sum(r.subscription.dropped_rows for r in self._recordings)
        return asdict(self.receiver.health) | own | {"dropped_rows": dropped}

    def state(self) -> str:
        """State of the board in its last HEARTBEAT, such as ``READY``; first ``UNKNOWN``."""
        with self._ask():
            self.session.pending()
            return self.session.state() if self.session.heartbeat is not None else "UNKNOWN"

    def clock(self) -> dict[str, int]:
        """The board's own counters: ticks, and lost, dropped and refused messages."""
        with self._ask():
            told = self.session.clock()
        return {name: int(getattr(told, name)) for name in told.get_fieldnames()}

    def boot_number(self) -> int:
        """Number of the board's start: another one after a loss of power."""
        with self._ask():
            return self.session.learn_time().boot

    def _stream_of(self, name: str) -> str:
        """A stream by its own name, or by that of one of its columns."""
        if name in self.streams:
            return name
        # A task's output before what it was given.
        for layout in sorted(self._layouts, key=lambda x: x.name.endswith("_in")):
            if name in [c.name for c in layout.columns]:
                return layout.name
        raise UserError(
            f"{self.identity.device.name} has neither a stream nor a signal '{name}'.",
            f"Streams: {', '.join(self.streams)}; signals are their columns, such as tau_Nm.",
        )

    def listen(
        self, streams: Collection[str] | None = None, rate_Hz: float | None = None
    ) -> list[str]:
        """Ask the board to tell of runs.

        Parameters
        ----------
        streams : collection of str, optional
            Default: input and output of every task.
        rate_Hz : float, optional
            Default: every run.
        """
        chosen, names = self._told_streams(streams)
        system = self.identity.device.system
        for stream in chosen:
            message = self._dialect.mavlink_map[names[stream]].msgname
            interval_us = KEY_US if stream == KEY else 1e6 / rate_Hz if rate_Hz else 1.0
            self.receiver.clock.expect(stream, 0)
            with self._ask():
                self.session.tell(message, interval_us)
            if stream != KEY:
                every = system.task(stream.rpartition("_")[0]).every
                runs = -(int(interval_us) // self.identity.tick_us // -every)
                self.receiver.clock.expect(stream, ticks := max(1, runs) * every)
                self.rates_Hz[stream] = 1e6 / (ticks * self.identity.tick_us)
            self._told[message] = interval_us
        return chosen

    def _told_streams(self, streams: Collection[str] | None) -> tuple[list[str], dict[str, int]]:
        # Those that the board does not tell already, and the message of each stream.
        named = {s.layout.name for s in self.receiver.named.values()}
        chosen = [s for s in (self.streams if streams is None else streams) if s not in named]
        names = {layout.name: n for n, layout in self.receiver.decoder.layouts.items()}
        if unknown := [s for s in chosen if s not in names]:
            raise UserError(f"There is no stream '{unknown[0]}'.", f"Use {', '.join(names)}.")
        return chosen, names

    def listen_named(
        self, signals: Iterable[str], rate_Hz: float = 0.0, name: str = "chosen"
    ) -> list[str]:
        """Have the board send some values of its tasks, and make rows of them.

        Parameters
        ----------
        signals : iterable of str
            Such as ``sense.tau_Nm``.
        rate_Hz : float
            Default: every run.
        name : str
            Of the stream; of several, their beginning.
        """
        try:
            with self._ask():
                boards = list(self.session.stream(signals, rate_Hz))
        except ValueError as error:
            fix = "Name signals of one task, such as sense.tau_Nm."
            raise UserError(f"{error}.", fix) from None
        found = []
        for i, board in enumerate(boards):
            own = [x for x in self._layouts if x.name.rpartition("_")[0] == board.task]
            known = {c.name: c for layout in own for c in layout.columns}
            columns = [StreamColumn(TICK, "u4")]
            for s in board.signals:
                column = known.get(s.array, StreamColumn(""))
                plain = s.name.replace("[", "_").replace("]", "")
                kind = "u4" if s.whole else "f4"
                columns.append(StreamColumn(plain, kind, column.unit, column.meaning))
            found.append(name if len(boards) == 1 else f"{name}_{board.task}_{i}")
            stream = NamedStream(StreamLayout(found[-1], tuple(columns)), board)
            self.receiver.add_named(stream, self._dialect.MAVLINK_MSG_ID_ESEA_DATA)
        return found

    def subscribe(self, streams: Collection[str] | None = None) -> Subscription:
        """Queue of rows as they arrive, as arrays.

        Parameters
        ----------
        streams : collection of str, optional
            Default: all that is told.
        """
        return self.receiver.subscribe(streams)

    def samples(self, *names: str, timeout_s: float = 5.0) -> Iterator[RunSample]:
        """Runs of one stream, one after another, as long as they come.

        Parameters
        ----------
        *names : str
            A stream, or signals of one stream.
        timeout_s : float
            Longest silence.

        Raises
        ------
        LinkError
            When the board is silent for longer, or the link has gone.
        """
        stream, wanted = self._chosen(names)
        subscription = self.receiver.subscribe([stream])
        try:
            while True:
                batches = subscription.take(timeout_s)
                if not batches:
                    what = f"no {stream} came within {timeout_s:g} s"
                    raise LinkError(what, "Check that the board runs.")
                for batch in batches:
                    yield from _run_samples(batch, wanted)
        finally:
            self.receiver.unsubscribe(subscription)

    def _chosen(self, names: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
        # The stream that signals are of, asked for, and the signals; all where it is named.
        if not names:
            raise UserError("No signal is named.", "Name one, such as tau_Nm.")
        if len(found := {self._stream_of(n) for n in names}) > 1:
            raise UserError(
                f"{', '.join(names)} are of several streams: {', '.join(sorted(found))}.",
                "Request each stream separately.",
            )
        (stream,) = found
        layout = next(x for x in self._layouts if x.name == stream)
        everything = tuple(c.name for c in layout.columns if c.name != TICK)
        self.listen([stream])
        return stream, everything if stream in names else names

    def stop(self, *, again: bool = False) -> None:
        """Stop the motor; taken in every state, held until :meth:`release`.

        Parameters
        ----------
        again : bool
            Not a second stop, which switches off at once: one that is under way goes on.
        """
        with self._ask():
            self.session.stop(again=again)

    def release(self) -> None:
        """Take a stop back; the motor stays off."""
        with self._ask():
            self.session.release()

    def zero(self) -> None:
        """Take the present angles as zero: unloaded, at the joint's zero, standing still."""
        with self._ask():
            self.session.zero()

    def arm(self) -> None:
        """Switch the motor on."""
        with self._ask():
            self.session.arm()

    def disarm(self) -> None:
        """Switch the motor off; torque fades first."""
        with self._ask():
            self.session.disarm()

    def clear(self) -> None:
        """Acknowledge a fault."""
        with self._ask():
            self.session.clear()

    def want(self, deadline_ms: int = 0, **wanted: Any) -> None:
        """Send a command, which is valid until its deadline, at most a second.

        Parameters
        ----------
        deadline_ms : int
            Until the next must have come; 0: as the board has it.
        **wanted : float
            ``mode``, ``tau_desired_Nm`` ...; what is left out is 0.
        """
        with self._ask():
            self.session.want(deadline_ms, **wanted)

    def parameters(self) -> dict[str, float]:
        """The values in force, by full name such as ``smc.lambda_1_s``, in the unit of the name."""
        with self._ask():
            return self.session.parameters()

    def parameter_name(self, name: str) -> str:
        """Full name of a parameter.

        Parameters
        ----------
        name : str
            Full, or what stands behind its dot where only one has that.
        """
        known = [p.name for p in self.session.known_parameters()]
        found = [n for n in known if name == n] or [n for n in known if n.endswith(f".{name}")]
        if len(found) != 1:
            near = ", ".join(found or difflib.get_close_matches(name, known, 3, 0.4) or known)
            many = "is not the name of one parameter" if found else "is not a parameter"
            raise UserError(f"'{name}' {many} of {self.identity.device.name}.", f"Use one: {near}.")
        return found[0]

    def set(self, name: str, value: float) -> float:
        """Set a parameter, also in running recordings; returned is the value in force.

        Parameters
        ----------
        name : str
            Full, or what stands behind its dot.
        value : float
            Within its bounds, in the unit of the name.

        Raises
        ------
        UserError
            When there is no such parameter.
        LinkError
            When the board refuses: outside its bounds, or not in this state.
        """
        full = self.parameter_name(name)
        with self._ask():
            taken = self.session.set_parameter(full, value)
        for recording in self._recordings:
            recording.event("parameter", name=full, asked=value, value=taken)
        return taken

    def record(
        self, path: str | Path, streams: Collection[str] | None = None, compress: bool = False
    ) -> LiveRecording:
        """Record from now on, until the recording is closed.

        Parameters
        ----------
        path : str or Path
            Must not exist.
        streams : collection of str, optional
            Default: input and output of every task, every run.
        compress : bool
            With zstandard.
        """
        self._told_streams(streams)  # a wrong name begins no file
        attachments = self.identity.attachments()
        with uninterrupted():  # what has begun is closed with this connection
            recorder = Recorder(Path(path), attachments, compress)
            given = recorder, self.receiver, streams, self.health, self._forget
            recording = LiveRecording(*given, threaded=self._threaded)
            self._recordings.append(recording)
        if self.address is None or self.address.kind != "file":
            with recording.beginning():
                recording.event("parameters", **self.parameters())
                self.listen(streams)
        return recording

    def _forget(self, recording: LiveRecording) -> None:
        self._recordings = [r for r in self._recordings if r is not recording]
