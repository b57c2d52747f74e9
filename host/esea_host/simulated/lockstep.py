"""A simulated board in this process: its time moves only when it is told to.

So a whole session, commands and recording included, repeats to the last bit, and runs as fast as
the computer can.
"""

from __future__ import annotations

from esea_gen.link.transport import Transport
from esea_host.connection.device import ConnectedDevice
from esea_host.connection.identity import identify
from esea_host.simulated.drive import SimulatedBoard

TICKS_A_READ = 20
BEAT_TICKS = 250


class LockstepTransport(Transport):
    """The line to a :class:`SimulatedBoard`; waiting for it is what moves its clock."""

    def __init__(self, drive: SimulatedBoard) -> None:
        self.drive = drive

    def read(self, timeout_s: float) -> bytes:
        data = self.drive.read()
        last = self.drive.ticks + round(timeout_s * 1000)
        while not data and self.drive.ticks < last:
            self.drive.tick()
            data = self.drive.read()
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        self.drive.write(data)

    def close(self) -> None:
        self.drive.close()


class LockstepDevice(ConnectedDevice):
    """A simulated board, connected, moved by :meth:`advance`."""

    def __init__(self, drive: SimulatedBoard) -> None:
        self.drive = drive
        transport = LockstepTransport(drive)
        super().__init__(identify(transport, None), transport, threaded=False)
        self.session.clock_s = lambda: drive.ticks * 1e-3

    def advance(self, time_s: float) -> None:
        for i in range(round(time_s * 1000)):
            if self.drive.ticks % BEAT_TICKS == 0:
                self.drive.write(self._heartbeat())
            self.drive.tick()
            if i % TICKS_A_READ == TICKS_A_READ - 1:
                self.pump()
        self.pump()
