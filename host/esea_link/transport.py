"""What carries the bytes: a socket, or the standard input and output of a process."""

from __future__ import annotations

import socket
import subprocess
import tempfile
from collections.abc import Sequence
from typing import IO, Protocol

RECEIVE_CHUNK_BYTES = 1 << 16
STOP_S = 3.0


class LinkError(RuntimeError):
    """The board did not answer, or not as the protocol says.

    said: what the other end said beside the link.
    """

    def __init__(self, what: str, fix: str = "", said: str = "") -> None:
        text = f"{what}. {fix}" if fix else what
        super().__init__(f"{text}; it said:\n{said}" if said else text)
        self.what, self.fix, self.said = what, fix, said


class Transport(Protocol):
    """Carries bytes both ways; every method raises :class:`LinkError` when the link is broken."""

    def read(self, timeout_s: float) -> bytes:
        """What has come, at least a byte; nothing when nothing comes in time."""

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of it."""

    def close(self) -> None:
        """Let go of the other end; more than once does no harm."""

    def said(self) -> str:
        """What the other end said beside the link, for an error's text; empty when nothing."""


class SocketTransport:
    """A connected stream socket."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link

    def read(self, timeout_s: float) -> bytes:
        """See :class:`Transport`."""
        self._link.settimeout(timeout_s)
        try:
            data = self._link.recv(RECEIVE_CHUNK_BYTES)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise LinkError(f"the link broke ({error})", said=self.said()) from None
        if not data:
            raise LinkError("the board has stopped", said=self.said())
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        """See :class:`Transport`."""
        self._link.settimeout(timeout_s)
        try:
            self._link.sendall(data)
        except OSError as error:
            what = f"the board does not take data ({error})"
            raise LinkError(what, said=self.said()) from None

    def close(self) -> None:
        """See :class:`Transport`."""
        self._link.close()

    def said(self) -> str:
        """Nothing: a socket has no second channel."""
        return ""


class Process:
    """A process of ours, and what it says beside the link."""

    def __init__(
        self, command: Sequence[str], link: int = subprocess.DEVNULL, log_output: bool = True
    ) -> None:
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed by stop()
        output = self._log if log_output else link
        self._process = subprocess.Popen(command, stdin=link, stdout=output, stderr=self._log)

    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def said(self) -> str:
        """What it has said so far."""
        if self._log.closed:
            return ""
        self._log.seek(0)
        return self._log.read().decode(errors="replace").strip()

    def stop(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()


class ProcessTransport(SocketTransport):
    """A link to a process that ends with the link."""

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
        """See :class:`Transport`."""
        super().close()
        self._process.stop()

    def said(self) -> str:
        """What the process said beside the link."""
        return self._process.said()
