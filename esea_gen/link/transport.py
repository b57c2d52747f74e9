"""Transports of the link: socket, serial port, pseudo-terminal, file, process."""

from __future__ import annotations

import errno
import os
import select
import socket
import subprocess
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from esea_gen.portability import TERMINALS, lock_holder, raw_terminal

RECEIVE_CHUNK_BYTES = 1 << 16
STOP_S = 3.0
BAUD, LEAST_BAUD, MOST_BAUD = 115_200, 50, 99_999_999
SERIAL = "Write one such as serial:COM3:921600 or serial:/dev/ttyACM0:921600."


class LinkError(RuntimeError):
    def __init__(self, what: str, fix: str = "", said: str = "") -> None:
        text = f"{what}. {fix}" if fix else what
        super().__init__(f"{text}; it said:\n{said}" if said else text)
        self.what, self.fix, self.said = what, fix, said


def _why(error: Exception) -> str:
    # In words, without the number of the error; TypeError: of what another thread has closed.
    if isinstance(error, TypeError):
        return "closed meanwhile"
    return str(getattr(error, "strerror", None) or error)


class Transport(ABC):
    """Carries bytes both ways; every method raises :class:`LinkError` when the link is broken."""

    @abstractmethod
    def read(self, timeout_s: float) -> bytes:
        """Received bytes, at least one; empty after the timeout."""

    @abstractmethod
    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of it."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the other end; more than once does no harm."""

    def said(self) -> str:
        """Output of the other end beside the link, for an error's text; may be empty."""
        return ""


class SocketTransport(Transport):
    def __init__(self, link: socket.socket) -> None:
        self.link = link

    def read(self, timeout_s: float) -> bytes:
        try:
            self.link.settimeout(timeout_s)
            data = self.link.recv(RECEIVE_CHUNK_BYTES)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise LinkError(f"the link broke ({_why(error)})", said=self.said()) from None
        if not data:
            raise LinkError("the other end has closed the link", said=self.said())
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        try:
            self.link.settimeout(timeout_s)  # closed meanwhile: an error as well
            self.link.sendall(data)
        except OSError as error:
            what = f"the board does not take data ({_why(error)})"
            raise LinkError(what, said=self.said()) from None

    def close(self) -> None:
        self.link.close()


class TcpTransport(SocketTransport):
    def __init__(self, port: int, host: str = "127.0.0.1", timeout_s: float = STOP_S) -> None:
        try:
            link = socket.create_connection((host, port), timeout_s)
        except (OSError, UnicodeError) as error:  # a name that cannot be one
            what = f"nothing answers at {host}:{port} ({_why(error)})"
            raise LinkError(what, "Check that the board, or its simulation, listens.") from None
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().__init__(link)


def _taken(path: str | Path) -> LinkError:
    number = lock_holder(path)
    who = f"process {number}" if number else "another program"
    return LinkError(f"{path} is in use: {who} is connected to the board", "End it first.")


class SerialTransport(Transport):
    def __init__(self, port: str, baud: int = BAUD) -> None:
        try:
            import serial
        except ModuleNotFoundError:
            fix = 'Install it with: pip install "esea-gen[link]"'
            raise LinkError(f"{port}: pyserial is not installed", fix) from None
        try:
            self._port: Any = serial.Serial(port, baud, exclusive=True)
        except (OSError, ValueError) as error:  # pyserial's own is an OSError
            if getattr(error, "errno", 0) == errno.EWOULDBLOCK:
                raise _taken(port) from None
            what = f"{port} cannot be opened ({_why(error)})"
            raise LinkError(
                what, "Check the name, your access rights, and other programs that use it."
            ) from None

    def read(self, timeout_s: float) -> bytes:
        try:
            self._port.timeout = timeout_s
            first = self._port.read(1)
            return bytes(first + self._port.read(self._port.in_waiting)) if first else b""
        except (OSError, TypeError) as error:
            raise LinkError(f"the serial link broke ({_why(error)})") from None

    def write(self, data: bytes, timeout_s: float) -> None:
        try:
            self._port.write_timeout = timeout_s
            if self._port.write(data) != len(data):  # it ends early, or raises, where it was closed
                raise OSError(errno.EBADF, "closed meanwhile")
        except (OSError, TypeError, ValueError) as error:
            raise LinkError(f"the board does not take data ({_why(error)})") from None

    def close(self) -> None:
        self._port.close()


class PtyTransport(Transport):
    """A terminal without a device behind it, as a simulated board offers one."""

    def __init__(self, path: str | Path) -> None:
        if not TERMINALS:
            raise LinkError("this system has no pseudo terminals", "Use tcp:HOST:PORT.")
        try:
            self._handle = raw_terminal(path)
        except BlockingIOError:
            raise _taken(path) from None
        except OSError as error:
            raise LinkError(f"{path} cannot be opened ({error.strerror})") from None

    def read(self, timeout_s: float) -> bytes:
        try:
            ready, _, _ = select.select([self._handle], [], [], timeout_s)
            if not ready:
                return b""
            data = os.read(self._handle, RECEIVE_CHUNK_BYTES)
        except (OSError, ValueError) as error:  # ValueError: closed by another thread
            raise LinkError(f"the link broke ({_why(error)})") from None
        if not data:
            raise LinkError("the other end has closed the link")
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        end_s = time.monotonic() + timeout_s
        left = memoryview(data)
        while left:
            wait_s = end_s - time.monotonic()
            try:
                if wait_s <= 0 or not select.select([], [self._handle], [], wait_s)[1]:
                    raise LinkError(f"the board did not take data within {timeout_s:g} s")
                left = left[os.write(self._handle, left) :]
            except BlockingIOError:
                continue
            except (OSError, ValueError) as error:
                raise LinkError(f"the link broke ({_why(error)})") from None

    def close(self) -> None:
        handle, self._handle = self._handle, -1  # at once: two threads may close it
        if handle >= 0:
            os.close(handle)


FROM_FILE = "Give a board; for a recording use esea-host show or esea-host replay."


class FileTransport(Transport):
    """Recorded bytes of a link, read from a file; it accepts no bytes."""

    def __init__(self, path: str | Path) -> None:
        try:
            self._file = Path(path).open("rb")  # noqa: SIM115 - closed by close()
        except OSError as error:
            raise LinkError(f"{path} cannot be read ({error.strerror})") from None

    def read(self, timeout_s: float) -> bytes:
        data = self._file.read(RECEIVE_CHUNK_BYTES)
        if not data:
            raise LinkError("the file has ended")
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        raise LinkError(f"{self._file.name} is a file, and takes no commands", FROM_FILE)

    def close(self) -> None:
        self._file.close()


def open_transport(address: str) -> Transport:
    """A transport by its address, such as ``serial:/dev/ttyUSB0:921600`` or ``tcp:host:5760``."""
    kind, _, rest = address.partition(":")
    if kind == "serial" and rest:
        return SerialTransport(*serial_port(rest))
    if kind == "tcp" and rest:
        host, port = tcp_place(rest)
        return TcpTransport(port, host)
    if kind == "pty" and rest:
        return PtyTransport(rest)
    if kind == "file" and rest:
        return FileTransport(rest)
    kinds = "serial:PORT[:BAUD], tcp:[HOST:]PORT, pty:PATH, file:PATH"
    raise LinkError(f"{address!r} is not an address of a board", f"There is {kinds}.")


def tcp_place(place: str) -> tuple[str, int]:
    """Host and port of ``127.0.0.1:5760``, ``[::1]:5760``; without a host this computer's."""
    host, _, port = place.rpartition(":")
    if not (port.isascii() and port.isdigit()) or not 0 < int(port[:6]) < 65536:
        raise LinkError(f"'{place}' names no host and port", "Write tcp:127.0.0.1:5760.")
    return host.removeprefix("[").removesuffix("]") or "127.0.0.1", int(port)


def serial_port(place: str) -> tuple[str, int]:
    """Port and bits a second of ``COM3:921600``, ``/dev/ttyACM0``; PORT as pyserial names it."""
    port, colon, baud = place.rpartition(":")
    digits = baud.isascii() and baud.isdigit()
    if not colon or (":" in port and not digits):  # names of /dev/serial/by-path hold colons
        port, baud, digits = place, str(BAUD), True
    if not port or port != port.strip():
        raise LinkError(f"'{place}' names no serial port", SERIAL)
    if not digits or not LEAST_BAUD <= int(baud[:9]) <= MOST_BAUD:
        what = f"'{baud}' is not a rate of a serial port ({LEAST_BAUD} to {MOST_BAUD} baud)"
        raise LinkError(what, SERIAL)
    return port, int(baud)


class Process:
    """A child process and its output beside the link."""

    def __init__(
        self, command: Sequence[str], link: int = subprocess.DEVNULL, log_output: bool = True
    ) -> None:
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed by stop()
        output = self._log if log_output else link
        self._process = subprocess.Popen(command, stdin=link, stdout=output, stderr=self._log)

    def runs(self) -> bool:
        return self._process.poll() is None

    def said(self) -> str:
        """Output so far."""
        if self._log.closed:
            return ""
        self._log.seek(0)
        return self._log.read().decode(errors="replace").strip()

    def stop(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()


class ProcessTransport(SocketTransport):
    def __init__(self, process: Process, link: socket.socket) -> None:
        super().__init__(link)
        self._process = process

    @classmethod
    def over_stdio(cls, command: Sequence[str]) -> ProcessTransport:
        """Start a process that reads frames on its standard input and writes them to its output."""
        ours, theirs = socket.socketpair()
        with theirs:
            return cls(Process(command, theirs.fileno(), log_output=False), ours)

    def close(self) -> None:
        super().close()
        self._process.stop()

    def said(self) -> str:
        return self._process.said()
