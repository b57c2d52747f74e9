"""Emulated board that plays a script: driver readings and link bytes, tick by tick."""

from __future__ import annotations

import struct
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from esea_gen.board.firmware import build_firmware
from esea_gen.board.gdb import HeldProcessor, addresses
from esea_gen.board.sim import SimBoard
from esea_gen.device import Device
from esea_gen.emit.render import environment

# Ticks between two looks of the debugger, which does not wait for ever.  A look moves the clock to
# the next tick at once: at none of these does the host speak.
_MARK = 100


@dataclass
class BoardTape:
    """A run, tick by tick."""

    measured: list[list[float]] = field(default_factory=list)
    frames: dict[int, bytes] = field(default_factory=dict)
    troubles: dict[int, int] = field(default_factory=dict)
    stop_from: int | None = None
    motor: list[tuple[bool, bytes]] = field(default_factory=list)
    fault: int = 0


class TapedBoard(SimBoard):
    """A board ``sim`` whose run is taped from its last start on."""

    tape: BoardTape

    def restart(self, *, blank: bool = False) -> None:
        """See :class:`SimBoard`."""
        self.lib.sim_unique(1)  # as the first start of a board whose memory is empty
        super().restart(blank=blank)
        self.tape = BoardTape()

    def measure(self, **values: float) -> None:
        """See :class:`SimBoard`; a tick follows."""
        self._end_of_tick()
        super().measure(**values)
        self.tape.measured.append([values.get(n, 0.0) for n in self.inputs])

    def send_bytes(self, data: bytes) -> None:
        """See :class:`esea_gen.link.messenger.Messenger`."""
        super().send_bytes(data)
        if hasattr(self, "tape"):
            tick = max(0, len(self.tape.measured) - 1)
            self.tape.frames[tick] = self.tape.frames.get(tick, b"") + data

    def trouble(self, fault: int) -> None:
        """See :class:`SimBoard`."""
        super().trouble(fault)
        self.tape.troubles[len(self.tape.measured) - 1] = fault

    def _end_of_tick(self) -> None:
        if len(self.tape.motor) < len(self.tape.measured):
            on, u_Nm = self.motor
            self.tape.motor.append((on, struct.pack("<f", u_Nm)))

    def taken(self) -> BoardTape:
        """Available bytes."""
        self._end_of_tick()
        self.tape.fault = int(self.lib.sim_fault())
        return self.tape


def _drivers(tape: BoardTape) -> str:
    ticks = len(tape.measured)
    frames = [tape.frames.get(k, b"") for k in range(ticks + 1)]
    return (
        environment()
        .get_template("board/scripted.c.j2")
        .render(
            ticks=ticks,
            measured=np.array(tape.measured, np.float32).view(np.uint32).tolist(),
            bytes=list(b"".join(frames)),
            until=np.cumsum([len(f) for f in frames]).tolist(),
            troubles=[tape.troubles.get(k, 0) for k in range(ticks)],
            stop_from=2**32 - 1 if tape.stop_from is None else tape.stop_from,
            mark=_MARK,
        )
    )


def play(device: Device, board: str, tape: BoardTape) -> BoardTape:
    """A tape's inputs on an emulated board: motor and fault are that board's."""
    ticks = len(tape.measured)
    with tempfile.TemporaryDirectory(prefix="esea-script-") as scratch:
        image = build_firmware(device, board, Path(scratch), drivers=_drivers(tape))
        at = addresses(image)
        with HeldProcessor(image) as held:
            held.hold_at(at["script_mark"])
            for _ in range(-(-ticks // _MARK)):
                held.run()
            torque = held.read(at["script_motor"], 4 * ticks)
            on = held.read(at["script_on"], ticks)
            fault = held.read_word(at["script_fault"])
    motor = [(bool(on[k]), torque[4 * k : 4 * k + 4]) for k in range(ticks)]
    return BoardTape(tape.measured, tape.frames, tape.troubles, tape.stop_from, motor, fault)
