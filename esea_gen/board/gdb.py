"""Debugger client for the emulated processor: breakpoints, registers, memory."""

from __future__ import annotations

import struct
from types import TracebackType
from typing import Self

from esea_gen.board.emulator import qemu_command
from esea_gen.board.firmware import FirmwareImage, symbols
from esea_gen.link.transport import LinkError, Process
from esea_gen.portability import listening_for_qemu
from esea_gen.targets import find_board

TIMEOUT_S = 30.0
PC = 15


class HeldProcessor:
    """QEMU with an image, stopped at its first instruction.  Use it as a context manager."""

    def __init__(self, image: FirmwareImage) -> None:
        with listening_for_qemu() as (server, channel):
            server.settimeout(TIMEOUT_S)
            self._process = Process(
                [
                    *qemu_command(find_board(image.board)),
                    *("-serial", "null", "-S", "-icount", "shift=0,sleep=off"),
                    *("-kernel", str(image.elf)),
                    *("-chardev", f"{channel},id=held", "-gdb", "chardev:held"),
                ]
            )
            try:
                self._link = server.accept()[0]
            except TimeoutError:
                said = self._process.said()
                self.close()
                raise LinkError(
                    "the emulator did not open its debugger's line", said=said
                ) from None
        self._link.settimeout(TIMEOUT_S)
        self._read = b""
        self.breaks: set[int] = set()
        self.at = 0  # where it stands
        # QEMU gives single registers only to who has asked what there are.
        self.ask("qXfer:features:read:target.xml:0,ffb")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._link.close()
        self.close()

    def close(self) -> None:
        """End the emulator."""
        self._process.stop()

    def _send(self, text: str) -> None:
        data = text.encode()
        self._link.sendall(b"$" + data + b"#%02x" % (sum(data) % 256))

    def _answer(self) -> str:
        while True:
            start, end = self._read.find(b"$"), self._read.find(b"#")
            if 0 <= start < end and len(self._read) >= end + 3:
                body, self._read = self._read[start + 1 : end], self._read[end + 3 :]
                self._link.sendall(b"+")
                return body.decode()
            data = self._link.recv(1 << 16)
            if not data:
                raise LinkError("the emulator has stopped", said=self._process.said())
            # Acknowledgements stand between packets.
            self._read = (self._read + data).lstrip(b"+")

    def ask(self, text: str) -> str:
        """Its answer to a command of GDB's remote protocol."""
        self._send(text)
        answer = self._answer()
        if answer.startswith("E"):
            raise LinkError(f"the emulator refuses {text[:20]}: {answer}")
        return answer

    def run(self) -> int:
        """Let it run to the next breakpoint; its address."""
        if self.at in self.breaks:
            self.ask("s")
        self.ask("c")
        self.at = self.register(PC)
        return self.at

    def register(self, number: int) -> int:
        """A core register."""
        return int(struct.unpack("<I", bytes.fromhex(self.ask(f"p{number:x}"))[:4])[0])

    def read(self, address: int, count: int) -> bytes:
        """Memory, or registers of the hardware."""
        found = b""
        while len(found) < count:
            piece = min(1024, count - len(found))
            found += bytes.fromhex(self.ask(f"m{address + len(found):x},{piece:x}"))
        return found

    def read_word(self, address: int) -> int:
        """A word."""
        return int(struct.unpack("<I", self.read(address, 4))[0])

    def hold_at(self, address: int) -> None:
        """Set a breakpoint."""
        self.ask(f"Z1,{address:x},2")
        self.breaks.add(address)


def addresses(image: FirmwareImage) -> dict[str, int]:
    """Addresses of an image's functions and objects."""
    found = symbols([image.elf])
    return {s.name: s.address & ~1 if s.kind in "tT" else s.address for s in found}
