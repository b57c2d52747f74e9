"""Emulated moteus drive: the register protocol, encoded by the manufacturer's codec.

The load is separate: ``torque_Nm`` out, ``show`` in.  Frames are CAN-FD's, lines fdcanusb's.
"""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from moteus import multiplex
from moteus.protocol import Mode, Register, Writer, scale_register

REGISTER_MAP = 5
EMULATED = 24154  # its model, none of the maker's: the board then says that it is simulated
LIMITED = 102  # fault code: the largest torque of the command acts
_KINDS: dict[int, Callable[[Writer, float, int], None]] = {
    Register.POSITION: Writer.write_position,
    Register.VELOCITY: Writer.write_velocity,
    Register.TORQUE: Writer.write_torque,
    Register.VOLTAGE: Writer.write_voltage,
    Register.TEMPERATURE: Writer.write_temperature,
    Register.MOTOR_TEMPERATURE: Writer.write_temperature,
    **{0x050 + 2 * slot: Writer.write_position for slot in range(3)},
}
_COMMANDS = {
    Register.COMMAND_POSITION: math.nan,
    Register.COMMAND_VELOCITY: 0.0,
    Register.COMMAND_FEEDFORWARD_TORQUE: 0.0,
    Register.COMMAND_KP_SCALE: 1.0,
    Register.COMMAND_KD_SCALE: 1.0,
    Register.COMMAND_POSITION_MAX_TORQUE: math.nan,
    Register.COMMAND_TIMEOUT: 0.0,
    Register.COMMAND_ILIMIT_SCALE: 1.0,
}


@dataclass
class MoteusDrive:
    """The drive's registers and settings; ``torque_Nm`` is that of its output."""

    settings: dict[str, str] = field(default_factory=dict)
    mode: int = Mode.STOPPED
    fault: int = 0
    torque_Nm: float = 0.0
    voltage_V: float = 24.0
    motor_C: float = 25.0
    limit_Nm: float = math.inf  # of the drive itself, as when it is hot
    silent: bool = False
    _now_s: float = 0.0
    _heard_s: float = 0.0
    _text: bytes = b""
    _partial: bytes = b""

    def __post_init__(self) -> None:
        defaults = {"servo.timeout_mode": "0", "servo.default_timeout_s": "0.1"}
        self.settings = defaults | self.settings
        self._command: dict[int, float] = dict(_COMMANDS)
        self._rev = dict.fromkeys([Register.POSITION, 0x050, 0x052, 0x054], 0.0)
        self._valid = 0

    def show(self, output_rev: float, slots_rev: Sequence[float | None]) -> None:
        """Set its encoders: the output by the rotor, and each slot (None: missing)."""
        self._rev[Register.POSITION] = output_rev
        for slot, rev in enumerate(slots_rev):
            self._rev[0x050 + 2 * slot] = rev or 0.0
            both = 3 << 2 * slot  # its angle and its speed
            self._valid = self._valid & ~both if rev is None else self._valid | both

    def advance(self, time_s: float) -> None:
        """Time passes: a command ends with its watchdog, and the drive then gives no torque."""
        self._now_s += time_s
        limit_s = self._command[Register.COMMAND_TIMEOUT] or float(
            self.settings["servo.default_timeout_s"]
        )
        if self.mode == Mode.POSITION and self._now_s - self._heard_s > limit_s:
            self.mode = Mode.TIMEOUT
        if self.mode != Mode.POSITION:
            self.torque_Nm = 0.0

    def restart(self) -> None:
        """Power off and on."""
        self.mode, self.fault, self.torque_Nm, self._now_s = Mode.STOPPED, 0, 0.0, 0.0

    def fail(self, code: int) -> None:
        """Latch a fault of the drive."""
        self.mode, self.fault, self.torque_Nm = Mode.FAULT, code, 0.0

    def frame(self, data: bytes) -> bytes:
        """Take a frame and answer it; empty where nothing was asked, or the drive is dead."""
        answer, written = io.BytesIO(), False
        if self.silent:
            return b""
        for part in multiplex.parse_frame(data):
            kind = part.type
            if kind is multiplex.SubframeType.WRITE:
                written |= self._write(part)
            elif kind is multiplex.SubframeType.READ:
                self._read(part, answer)
            elif kind is multiplex.SubframeType.STREAM_CLIENT_TO_SERVER:
                self._say(part.data)
            elif kind is multiplex.SubframeType.STREAM_CLIENT_POLL_SERVER:
                told, self._text = self._text[: part.data[0]], self._text[part.data[0] :]
                answer.write(bytes([multiplex.STREAM_SERVER_DATA, 1, len(told)]) + told)
        if written:
            self._take_command()
        return answer.getvalue()

    def line(self, text: str) -> str:
        """A line from the adapter's serial port, and the lines of its answer."""
        words = text.split()
        if words[:2] != ["can", "send"] or len(words) < 4:
            return "ERR unknown command\r\n"
        try:
            wants, answer = int(words[2], 16) & 0x8000, self.frame(bytes.fromhex(words[3]))
        except (ValueError, RuntimeError, struct.error):  # of digits; of a frame that is cut
            return "ERR bad frame\r\n"
        return "OK\r\n" + (f"rcv 100 {answer.hex()}\r\n" if wants and answer else "")

    def _write(self, part: Any) -> bool:
        value = float(scale_register(part.register, part.resolution, part.value))
        if part.register == Register.MODE:
            stops = value == Mode.STOPPED
            if stops or self.mode not in (Mode.FAULT, Mode.TIMEOUT):
                self.mode = int(value)
            self.fault = 0 if stops else self.fault
            self._command = dict(_COMMANDS)
        elif part.register in self._command:
            self._command[part.register] = value
        return True

    def _take_command(self) -> None:
        self._heard_s = self._now_s
        c = self._command
        if self.mode != Mode.POSITION:
            self.torque_Nm = 0.0
            return
        most, wanted = self.limit_Nm, c[Register.COMMAND_FEEDFORWARD_TORQUE]
        if not math.isnan(c[Register.COMMAND_POSITION_MAX_TORQUE]):
            most = min(most, c[Register.COMMAND_POSITION_MAX_TORQUE])
        self.torque_Nm = max(-most, min(most, wanted))
        self.fault = LIMITED if self.torque_Nm != wanted else 0

    def _value(self, register: int) -> float | None:
        known: dict[int, float] = {
            **self._rev,
            Register.MODE: self.mode,
            Register.VELOCITY: 0.0,
            Register.TORQUE: self.torque_Nm,
            Register.VOLTAGE: self.voltage_V,
            Register.TEMPERATURE: 30.0,
            Register.MOTOR_TEMPERATURE: self.motor_C,
            Register.FAULT: self.fault,
            Register.ENCODER_VALIDITY: self._valid,
            Register.MILLISECOND_COUNTER: round(self._now_s * 1e3) & 0x7FFFFFFF,
            Register.MODEL_NUMBER: EMULATED,
            Register.FIRMWARE_VERSION: 0,
            Register.REGISTER_MAP_VERSION: REGISTER_MAP,
        }
        return known.get(register)

    def _read(self, part: Any, answer: io.BytesIO) -> None:
        writer, value = Writer(answer), self._value(part.register)
        if value is None:
            writer.write_int8(multiplex.READ_ERROR)
            writer.write_varuint(part.register)
            writer.write_varuint(1)
            return
        writer.write_int8(multiplex.REPLY_BASE | part.resolution << 2 | 1)
        writer.write_varuint(part.register)
        _KINDS.get(part.register, Writer.write_int)(writer, value, part.resolution)

    def _say(self, data: bytes) -> None:
        *lines, self._partial = (self._partial + data).split(b"\n")
        for line in lines:
            words = line.decode(errors="replace").split()
            if words[:2] == ["conf", "get"] and words[-1] in self.settings:
                self._text += self.settings[words[-1]].encode() + b"\r\n"
            else:
                self._text += b"ERR unknown command\r\n"
