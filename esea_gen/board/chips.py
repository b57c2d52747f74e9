"""Models of the chips on a board's buses, by the registers and frames of their data sheets."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cffi

from esea_gen.hostlib.compiler import compiler, run_tool
from esea_gen.targets import APP_FLAGS, firmware_folder

Frames = Callable[[bytes], bytes]


def even_parity(word: int) -> int:
    """A word of 15 bits with bit 15 set so that the number of ones is even."""
    return word | (word.bit_count() & 1) << 15


@dataclass
class As5048a:
    """AS5048A: 16-bit frames, each answer in the frame after its command."""

    angle: int = 0x1234
    gain: int = 0x60
    magnitude: int = 0x0D00
    compensated: bool = True
    overflow: bool = False
    strong: bool = False
    weak: bool = False
    error_flag: bool = False
    errors: int = 0
    answer: int = 0

    def _register(self, address: int) -> int:
        diagnostics = self.gain | self.compensated << 8 | self.overflow << 9
        diagnostics |= self.strong << 10 | self.weak << 11
        known = {0x0000: 0, 0x3FFD: diagnostics, 0x3FFE: self.magnitude, 0x3FFF: self.angle}
        if address == 0x0001:
            told, self.errors, self.error_flag = self.errors, 0, False
            return told
        if address not in known:
            self._wrong(2)
            return 0
        return known[address]

    def _wrong(self, bit: int) -> None:
        self.errors |= bit
        self.error_flag = True

    def frame(self, sent: bytes) -> bytes:
        """One selection of the chip."""
        answer = self.answer
        if len(sent) != 2:
            self._wrong(1)
            return bytes(len(sent))
        command = int.from_bytes(sent, "big")
        told = 0
        if command.bit_count() & 1:
            self._wrong(4)
        else:
            told = self._register(command & 0x3FFF)
        self.answer = even_parity(told | self.error_flag << 14)
        return answer.to_bytes(2, "big")


@dataclass
class BissEncoder:
    """Encoder of the BiSS-C protocol."""

    position: int = 0x1A2B3
    bits: int = 17
    error: bool = False
    warning: bool = False
    waits: tuple[int, int] = (2, 5)

    def crc(self, data: str) -> str:
        """Six bits after the text of the others: x^6 + x + 1, inverted; by long division."""
        rest = int(data + "000000", 2)
        for k in range(len(data) + 5, 5, -1):
            if rest >> k & 1:
                rest ^= 0b1000011 << (k - 6)
        return f"{rest ^ 0x3F:06b}"

    def frame(self, sent: bytes) -> bytes:
        """One burst of clocks."""
        data = f"{self.position:0{self.bits}b}{not self.error:d}{not self.warning:d}"
        line = "1" * self.waits[0] + "0" * self.waits[1] + "10" + data + self.crc(data) + "0"
        line = line.ljust(8 * len(sent), "1")[: 8 * len(sent)]
        return int(line, 2).to_bytes(len(sent), "big")


@dataclass
class Amplifier:
    """ESCON 50/5 in current control, its motor, and the converter of its actual current."""

    full_A: float = 5.0
    A_count: float = 0.005
    lag: float = 0.03
    gain: float = 1.0
    enabled: bool = False
    duty: int = 5000
    current_A: float = 0.0
    stuck_counts: int | None = None

    def tick(self) -> None:
        """A millisecond passes."""
        wanted = (self.duty - 5000) / 4000 * self.full_A * self.gain if self.enabled else 0.0
        self.current_A += self.lag * (wanted - self.current_A)

    @property
    def counts(self) -> int:
        """Counts of a converter of 12 bits, its zero in the middle."""
        if self.stuck_counts is not None:
            return self.stuck_counts
        return min(4095, max(0, round(2048 + self.current_A / self.A_count)))


# Faults of a wire: what becomes of the bytes from the chip.
WIRE_FAULTS: dict[str, Frames] = {
    "stuck_low": lambda b: bytes(len(b)),
    "stuck_high": lambda b: b"\xff" * len(b),
    "swapped": lambda b: b[::-1],
}


@dataclass
class Workbench:
    """A processor's pins and buses, for the drivers; what is on them may break."""

    lines: dict[int, Frames] = field(default_factory=dict)
    wires: dict[int, Frames] = field(default_factory=dict)
    pins: dict[int, bool] = field(default_factory=dict)
    contacts: dict[int, bool] = field(default_factory=dict)
    duties: dict[int, int] = field(default_factory=dict)
    converter: Callable[[int], int | None] = lambda channel: None
    done: list[tuple[str, int, int]] = field(default_factory=list)

    def exchange(self, line: int, sent: bytes) -> bytes | None:
        """Received bytes; None if the bus is dead."""
        if line not in self.lines:
            return None
        return self.wires.get(line, bytes)(self.lines[line](sent))

    def put(self, what: str, number: int, value: int) -> None:
        """A pin or a duty, and the order in which they were put."""
        self.done.append((what, number, value))
        if what == "pin":
            self.pins[number] = bool(value)
        else:
            self.duties[number] = value


def declarations(*headers: Path) -> str:
    """Declarations of C headers, as cffi reads them: no comments, no preprocessor, no bodies."""
    text = "".join(h.read_text(encoding="utf-8") for h in headers)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    text = re.sub(r"^static inline .*?^\}\n", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"^#.*\n", "", text, flags=re.MULTILINE)


class Drivers:
    """The hand-written drivers, compiled for this computer, on a bench."""

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench
        folder = firmware_folder() / "drivers"
        self.ffi = cffi.FFI()
        headers = sorted(folder.glob("*.h"), key=lambda h: (h.name != "hardware.h", h.name))
        text = declarations(*headers)
        for name, number in (("ESEA_BISS_BYTES_MOST", "16"), ("ESEA_MOTEUS_SLOTS", "3")):
            text = text.replace(name, number)
        self.ffi.cdef(text)
        with tempfile.TemporaryDirectory(prefix="esea-drivers-") as scratch:
            built = Path(scratch) / "drivers.so"
            flags = [*APP_FLAGS, "-Wpedantic", "-Wshadow", "-fPIC", "-shared"]
            checks = ["-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"]
            command: list[str | Path] = [*compiler(), *flags, *checks, "-o", built]
            command += sorted(folder.glob("*.c"))
            run_tool(command, failed="the drivers do not build")
            self.lib: Any = self.ffi.dlopen(str(built))
        self.hardware = self._hardware()

    def _hardware(self) -> Any:
        ffi, bench = self.ffi, self.bench

        def spi(line: int, out: Any, into: Any, count: int) -> bool:
            came = bench.exchange(line, bytes(ffi.buffer(out, count)))
            if came is not None:
                ffi.buffer(into, count)[:] = came
            return came is not None

        def adc(channel: int, counts: Any) -> bool:
            value = bench.converter(channel)
            if value is not None:
                counts[0] = value
            return value is not None

        self._kept = (
            ffi.callback("bool(uint32_t, const uint8_t *, uint8_t *, size_t)", spi),
            ffi.callback("void(uint32_t, bool)", lambda pin, high: bench.put("pin", pin, high)),
            ffi.callback("bool(uint32_t)", lambda pin: bench.contacts.get(pin, False)),
            ffi.callback("void(uint32_t, uint32_t)", lambda c, duty: bench.put("duty", c, duty)),
            ffi.callback("bool(uint32_t, uint32_t *)", adc),
        )
        return ffi.new("esea_hardware_t *", self._kept)
