"""The firmware's application with the moteus driver, in lockstep with an emulated drive."""

from __future__ import annotations

import os
import pty
import re
import socket
import struct
import threading
import tty

from esea_gen.board.sim import SimBoard
from esea_gen.targets import firmware_folder
from esea_host.simulated.moteus import TICK_S, MoteusJoint

FRAME = struct.Struct("=IBB2x64s")  # canfd_frame of linux/can.h
EXTENDED, BRS, LENGTHS = 0x80000000, 1, (8, 12, 16, 20, 24, 32, 48, 64)
# The kernel's calls as can(7) and linux/can/raw.h have them, for a system without CAN.
STAND_IN = """
static int with_frames;
#define socket(family, type, protocol) ((family) == PF_CAN && ((type) & 0xF) == SOCK_RAW && \\
    (protocol) == CAN_RAW ? THEIRS : -1)
#define ioctl(fd, request, named) ((fd) == THEIRS && (request) == SIOCGIFINDEX && \\
    strcmp((named)->ifr_name, "can3") == 0 ? ((named)->ifr_ifindex = 3, 0) : -1)
#define setsockopt(fd, level, name, value, size) ((fd) == THEIRS && (level) == SOL_CAN_RAW && \\
    (name) == CAN_RAW_FD_FRAMES && (size) == sizeof(int) && *(value) == 1 ? with_frames = 1, 0 : -1)
#define bind(fd, to, size) ((fd) == THEIRS && with_frames && \\
    (size) == sizeof(struct sockaddr_can) && (to)->sa_family == AF_CAN && \\
    ((struct sockaddr_can *)(to))->can_ifindex == 3 ? 0 : -1)
"""


class MoteusBoard(SimBoard):
    """A board whose encoders and motor are those of a drive at the other end of a line."""

    def __init__(self, device, joint: MoteusJoint, rotor_side=False, can=False):
        self.joint, self.can, self.cut, self._heard = joint, can, False, b""
        if can:
            pair = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
            self._ours, self._theirs = (end.detach() for end in pair)
        else:
            self._ours, self._theirs = pty.openpty()
            tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        at = "can:can3" if can else f"serial:{os.ttyname(self._theirs)}"
        folder = firmware_folder() / "boards" / "linux"
        header = (folder / "drive.h").read_text().replace("\\", r"\\")
        driver = re.sub('#include "drive.h"\n', header, (folder / "drive.c").read_text())
        driver = re.sub("(PATIENCE_MS) .*", r"\1 60000", driver)  # a busy computer answers late
        if can:
            stand_in = STAND_IN.replace("THEIRS", str(self._theirs))
            driver = driver.replace('#include "app.h"\n', stand_in + '#include "app.h"\n', 1)
        driver = f"""#define _GNU_SOURCE
        {driver}
        void esea_board_drivers(esea_port_t *port)
        {{
            if (!drive_open(port, "{at}", {str(rotor_side).lower()}))
                port->notice = "refused";
        }}
        """
        over = threading.Event()

        def serve():  # until the board has started
            while not over.wait(0.0005):
                self.answer()

        server = threading.Thread(target=serve)
        server.start()
        try:
            super().__init__(device, drivers=driver)
        finally:
            over.set()
            server.join()

    def answer(self) -> None:
        """The drive takes what has come."""
        try:
            while data := os.read(self._ours, 4096):
                for said in self._frame(data) if self.can else self._lines(data):
                    if not self.cut:
                        os.write(self._ours, said)
        except BlockingIOError:
            return

    def _lines(self, data: bytes) -> list[bytes]:
        *lines, self._heard = (self._heard + data).split(b"\n")
        return [self.joint.drive.line(text.decode()).encode() for text in lines]

    def _frame(self, data: bytes) -> list[bytes]:
        number, length, flags, payload = FRAME.unpack(data)
        assert (number, flags) == (0x8001 | EXTENDED, BRS)
        assert length in LENGTHS
        said = self.joint.drive.frame(payload[:length])
        padded = next(n for n in LENGTHS if n >= len(said))
        answer = FRAME.pack(0x100 | EXTENDED, padded, BRS, said.ljust(64, b"P"))
        return [FRAME.pack(0x200 | EXTENDED, 8, BRS, b"P" * 8), answer] if said else []

    def step(self) -> None:
        super().step()
        self.answer()
        self.joint.drive.advance(TICK_S)

    def show(self, counts) -> None:
        """The drive's encoders read them."""
        self.joint.show(dict(zip(("count_motor", "count_load", "count_gear"), counts, strict=True)))

    @property
    def motors_Nm(self) -> tuple[float, ...]:
        """What the drive makes of the command."""
        return (self.joint.drive.torque_Nm / self.joint.gear,)

    def close(self) -> None:
        super().close()
        os.close(self._ours)
        os.close(self._theirs)
