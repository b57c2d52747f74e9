"""Stop, past everything that waits: commands under way, drawing, recording."""

from __future__ import annotations

import contextlib
import threading
import time

from esea_gen.link.transport import LinkError
from esea_host.connection import ConnectedDevice

COMPONENT = 192  # its frames are counted apart from the session's
EVERY_S, FOR_S = 0.05, 2.0


class StopSender:
    """Sends stop onto the link for two seconds or until confirmed; waits for no lock."""

    def __init__(self, device: ConnectedDevice) -> None:
        self._device = device
        self._dialect = device.session.dialect
        self._encoder = self._dialect.MAVLink(None, 255, COMPONENT)
        self._wanted, self._closed = threading.Event(), False
        self.sent = 0
        self._thread = threading.Thread(target=self._run, name="esea-stop", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._wanted.set()

    def close(self) -> None:
        self._closed = True
        self._wanted.set()
        self._thread.join(1.0)

    def send(self) -> None:
        command = self._dialect.MAV_CMD_USER_4
        message = self._dialect.MAVLink_command_long_message(1, 1, command, 0, *[0.0] * 7)
        frame = bytes(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        self._device.receiver.write(frame, 1.0)
        self.sent += 1

    def _stopped(self) -> bool:
        # Without the lock: the heartbeat that somebody has read last.
        session = self._device.session
        return session.heartbeat is not None and session.state() == "STOPPED"

    def _run(self) -> None:
        while True:
            self._wanted.wait()
            if self._closed:
                return
            self._wanted.clear()
            end_s = time.monotonic() + FOR_S
            # Once at least: what the heartbeat says may be old.
            while not self._closed:
                with contextlib.suppress(LinkError):
                    self.send()
                time.sleep(EVERY_S)
                if self._stopped() or time.monotonic() >= end_s:
                    break
