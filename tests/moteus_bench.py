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
EXTENDED, BRS, INTERFACE, FRAME_BYTES = 0x80000000, 1, "can3", (8, 12, 16, 20, 24, 32, 48, 64)
# The kernel's calls as can(7) and linux/can/raw.h have them, for a system without CAN.
STAND_IN = """
#include <string.h>
#include <net/if.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <sys/socket.h>
static int with_frames;
static int can_socket(int family, int type, int protocol)
{
    return family == PF_CAN && (type & 0xF) == SOCK_RAW && protocol == CAN_RAW ? THEIRS : -1;
}
static int can_index(int fd, unsigned long request, struct ifreq *named)
{
    if (fd != THEIRS || request != 0x8933ul || strcmp(named->ifr_name, "can3") != 0)
        return -1;
    named->ifr_ifindex = 3;
    return 0;
}
static int can_option(int fd, int level, int name, const int *value, socklen_t size)
{
    with_frames = fd == THEIRS && level == SOL_CAN_RAW && name == CAN_RAW_FD_FRAMES && *value == 1;
    return with_frames && size == sizeof *value ? 0 : -1;
}
static int can_bind(int fd, const struct sockaddr *to, socklen_t size)
{
    const struct sockaddr_can *at = (const struct sockaddr_can *)to;
    return fd == THEIRS && with_frames && size == sizeof *at && at->can_family == AF_CAN &&
        at->can_ifindex == 3 ? 0 : -1;
}
#define socket can_socket
#define ioctl can_index
#define setsockopt can_option
#define bind can_bind
"""


class MoteusBoard(SimBoard):
    """A board whose encoders and motor are those of a drive at the other end of a line."""

    def __init__(self, device, joint: MoteusJoint, rotor_side=False, can=False):
        self.joint, self.cut, self._heard = joint, False, b""
        self._ours, self._theirs = self._line(can)
        folder = firmware_folder() / "boards" / "linux"
        header = (folder / "drive.h").read_text().replace("\\", r"\\")
        driver = re.sub('#include "drive.h"\n', header, (folder / "drive.c").read_text())
        if can:
            stand_in = STAND_IN.replace("THEIRS", str(self._theirs))
            driver = driver.replace('#include "app.h"\n', stand_in + '#include "app.h"\n', 1)
        at = f"can:{INTERFACE}" if can else f"serial:{os.ttyname(self._theirs)}"
        driver = "#define _GNU_SOURCE\n" + driver
        driver += f"""
        #include <stdlib.h>
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

    def _line(self, can: bool) -> tuple[int, int]:
        if can:
            pair = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
            ours, theirs = (end.detach() for end in pair)
            self.answer = self._answer_frames
        else:
            ours, theirs = pty.openpty()
            tty.setraw(theirs)
            self.answer = self._answer_lines
        os.set_blocking(ours, False)
        return ours, theirs

    def _answer_lines(self) -> None:
        """The drive takes what has come."""
        try:
            self._heard += os.read(self._ours, 65536)
        except BlockingIOError:
            return
        *lines, self._heard = self._heard.split(b"\n")
        for text in lines:
            said = self.joint.drive.line(text.decode())
            if not self.cut:
                os.write(self._ours, said.encode())

    def _answer_frames(self) -> None:
        while True:
            try:
                data = os.read(self._ours, 128)
            except BlockingIOError:
                return
            number, length, flags, payload = FRAME.unpack(data)
            assert (number, flags) == (0x8001 | EXTENDED, BRS)
            assert length in FRAME_BYTES
            said = self.joint.drive.frame(payload[:length])
            if said and not self.cut:  # behind somebody else's frame
                os.write(self._ours, FRAME.pack(0x200 | EXTENDED, len(said), BRS, b"\x50" * 64))
                padded = next(n for n in FRAME_BYTES if n >= len(said))
                os.write(
                    self._ours, FRAME.pack(0x100 | EXTENDED, padded, BRS, said.ljust(64, b"P"))
                )

    def step(self) -> None:
        super().step()
        self.answer()
        self.joint.drive.advance(TICK_S)

    def show(self, counts) -> None:
        """The drive's encoders read them."""
        self.joint.show(tuple(counts))

    @property
    def motors_Nm(self) -> tuple[float, ...]:
        """What the drive makes of the command."""
        return (self.joint.drive.torque_Nm / self.joint.gear,)

    def close(self) -> None:
        super().close()
        os.close(self._ours)
        os.close(self._theirs)
