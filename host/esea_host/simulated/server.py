"""The simulated board behind a socket or a pseudo terminal."""

from __future__ import annotations

import os
import socket
import time
import tty
from collections.abc import Callable
from typing import Protocol

from esea_gen.errors import UserError
from esea_host.simulated.drive import SimulatedBoard

MOST_BACKLOG_BYTES = 1 << 18
MOST_TICKS = 50  # between two looks at the line
IDLE_S = 0.0005
MOST_PUSH_RAD = 1.0


class _Line(Protocol):
    def read(self) -> bytes | None: ...
    def write(self, data: bytes) -> int: ...
    def close(self) -> None: ...


class _Socket:
    def __init__(self, link: socket.socket) -> None:
        link.setblocking(False)
        self._link = link

    def read(self) -> bytes | None:
        try:
            return self._link.recv(65536) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def write(self, data: bytes) -> int:
        try:
            return self._link.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)

    def close(self) -> None:
        self._link.close()


class _Terminal:
    def __init__(self) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.name = os.ttyname(self._theirs)

    def read(self) -> bytes | None:
        try:
            return os.read(self._ours, 65536)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> int:
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)


def serve(
    device: str,
    port: int | None,
    *,
    plant: str = "real",
    person: str = "uncertain",
    seed: int = 0,
    speed: float = 1.0,
    board: str = "sim",
    once: bool = False,
    say: Callable[[str], None] | None = None,
    hands: int | None = None,
) -> None:
    """Serve a simulated board until somebody ends it.

    port: of TCP on this computer, 0 for any; None: a pseudo terminal.
    speed: of the board's time against the clock's; 0: as fast as the host reads.
    board: ``sim``, or ``sim-q31``.
    once: end when the first host has gone.
    hands: where lines ``push RAD`` come from, a file's number: somebody pushes the virtual arm.
    """
    if not 0 <= speed <= 1000:
        raise UserError(f"A speed of {speed:g}.", "Give 0 (as fast as it is read) to 1000.")
    tell = say or (lambda text: print(text, flush=True))
    drive = SimulatedBoard(device, plant, person, seed, board)
    try:
        if port is None:
            terminal = _Terminal()
            tell(f"simulated {device} at pty:{terminal.name}")
            _play(drive, terminal, speed, Hands(hands))
            return
        with socket.create_server(("127.0.0.1", port)) as listener:
            tell(f"simulated {device} at tcp:127.0.0.1:{listener.getsockname()[1]}")
            serve_hosts(drive, listener, speed, once, Hands(hands))
    finally:
        drive.close()


class Hands:
    """Somebody who pushes the virtual arm: lines of text from a file that is read without waiting.

    source: the file's number; None: nobody.
    """

    def __init__(self, source: int | None) -> None:
        self._source, self._rest = source, b""
        if source is not None:
            os.set_blocking(source, False)

    def reach(self, drive: SimulatedBoard) -> None:
        """Do what was said last."""
        if self._source is None:
            return
        try:
            self._rest += os.read(self._source, 4096)
        except BlockingIOError:
            return
        *lines, self._rest = self._rest.split(b"\n")
        for line in lines:
            word, _, number = line.decode("ascii", "replace").partition(" ")
            try:
                push_rad = float(number)
            except ValueError:
                continue
            if word == "push" and abs(push_rad) <= MOST_PUSH_RAD:
                drive.push_rad = push_rad


def serve_hosts(
    drive: SimulatedBoard,
    listener: socket.socket,
    speed: float,
    once: bool,
    hands: Hands | None = None,
) -> None:
    """One host after another; between two the board runs on, in real time, and hears nobody."""
    while True:
        try:
            listener.settimeout(0.01)
            link, _ = listener.accept()
        except OSError as error:
            if not isinstance(error, TimeoutError):
                return  # the listener was closed
            for _ in range(10):
                drive.tick()
            drive.read()
            continue
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        line = _Socket(link)
        try:
            _play(drive, line, speed, hands)
        finally:
            line.close()
        if once:
            return


def _play(drive: SimulatedBoard, line: _Line, speed: float, hands: Hands | None) -> None:
    # Until the host has gone.
    backlog = bytearray()
    started_s, first = time.monotonic(), drive.ticks
    while True:
        data = line.read()
        if data is None:
            return
        if data:
            drive.write(data)
        if hands is not None:
            hands.reach(drive)
        due = MOST_TICKS
        if speed:
            due = int((time.monotonic() - started_s) * 1000 * speed) - (drive.ticks - first)
        elif len(backlog) > MOST_BACKLOG_BYTES // 8:
            due = 0
        for _ in range(min(due, MOST_TICKS)):
            drive.tick()
        backlog += drive.read()
        sent = line.write(bytes(backlog)) if backlog else 0
        del backlog[:sent]
        # Like a serial line that nobody empties: what comes now has no room.
        if len(backlog) > MOST_BACKLOG_BYTES:
            del backlog[MOST_BACKLOG_BYTES // 2 :]
        if due <= 0 or (not sent and not due):
            time.sleep(IDLE_S)


__all__ = ["Hands", "serve", "serve_hosts"]
