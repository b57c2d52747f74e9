"""An emulated processor that is steered: memory and registers written, breakpoints taken away."""

from __future__ import annotations

import struct

from esea_gen.board.gdb import PC, HeldProcessor

XPSR = 25
IF_THEN = 0x0600FC00  # state of a conditional block, in xPSR
STORE_R1_AT_R0 = bytes.fromhex("0160")  # str r1, [r0]


class SteeredProcessor(HeldProcessor):
    def steps_to(self, *addresses: int) -> int:
        """How many instructions it takes to any of some addresses, no interrupt between them."""
        count = 0
        while count == 0 or self.at not in addresses:
            self.ask("s")
            self.at = self.register(PC)
            count += 1
        return count

    def write(self, address: int, data: bytes) -> None:
        """Memory; registers of the hardware do not hear of it."""
        for at in range(0, len(data), 1024):
            piece = data[at : at + 1024]
            self.ask(f"M{address + at:x},{len(piece):x}:{piece.hex()}")

    def set_register(self, number: int, value: int) -> None:
        """A core register."""
        self.ask(f"P{number:x}={struct.pack('<I', value).hex()}")

    def store(self, address: int, value: int, scratch: int) -> None:
        """A word into a register of the hardware, by the processor itself."""
        used = (0, 1, PC, XPSR)
        kept = [self.register(n) for n in used]
        self.write(scratch, STORE_R1_AT_R0)
        # Where it stands may be conditional (an IT block); the store is not.
        for number, held in zip(used, (address, value, scratch, kept[-1] & ~IF_THEN), strict=True):
            self.set_register(number, held)
        self.ask("s")
        for number, held in zip(used, kept, strict=True):
            self.set_register(number, held)

    def no_more_at(self, address: int) -> None:
        """Take it away."""
        if address not in self.breaks:
            return
        self.ask(f"z1,{address:x},2")
        self.breaks.discard(address)
