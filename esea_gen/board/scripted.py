"""An emulated board that plays a script: what its drivers give, and the link, tick by tick."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from esea_gen.board.firmware import build_firmware
from esea_gen.board.gdb import HeldProcessor, addresses
from esea_gen.board.sim import SimBoard
from esea_gen.device import Device

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
        """What there is."""
        self._end_of_tick()
        self.tape.fault = int(self.lib.sim_fault())
        return self.tape


_DRIVERS = """
#include "app.h"
#include "cortex_m.h"

#include <string.h>

#define TICKS {ticks}u

static const uint32_t measured[TICKS][ESEA_LINK_MEASURED] = {{ {measured} }};
static const uint8_t bytes[] = {{ {bytes} }};
static const uint32_t until[TICKS + 1u] = {{ {until} }};
static const uint8_t troubles[TICKS] = {{ {troubles} }};
static bool in_tick;
static uint32_t fed, at;
static const esea_port_t *own;
/* By pointer: in the call graph one place alone receives. */
static void (*volatile receive)(uint8_t) = esea_cortex_m_received;
uint32_t script_motor[TICKS];
uint8_t script_on[TICKS];
uint32_t script_fault;
void script_mark(void);

__attribute__((noinline)) void script_mark(void)
{{
    __asm__ volatile("");
}}

static void feed(void)
{{
    while (fed < until[at])
        receive(bytes[fed++]);
}}

static void sample(float *values)
{{
    if (at >= TICKS)
        return;
    in_tick = true;
    memcpy(values, measured[at], sizeof measured[at]);
}}

static uint32_t trouble(void)
{{
    return in_tick ? troubles[at] : 0u;
}}

static bool stop_open(void)
{{
    return at >= {stop_from}u;
}}

static void motor(const float *u_Nm, bool enable)
{{
    if (!in_tick)
        return;
    in_tick = false;
    memcpy(&script_motor[at], u_Nm, sizeof *u_Nm);
    script_on[at] = enable;
    script_fault = own->blackbox->fault;
    ++at;
    feed(); /* the main loop takes it before the next tick */
    if (at % {mark}u == 0u || at == TICKS)
        script_mark();
}}

void esea_board_drivers(esea_port_t *port)
{{
    own = port;
    port->sample = sample;
    port->motor = motor;
    port->trouble = trouble;
    port->stop_open = stop_open;
}}
"""


def _drivers(tape: BoardTape) -> str:
    ticks = len(tape.measured)
    rows = (", ".join(f"0x{w:x}u" for w in _words(row)) for row in tape.measured)
    data, until = b"", []
    for k in range(ticks + 1):
        data += tape.frames.get(k, b"")
        until.append(len(data))
    stop = tape.stop_from
    return _DRIVERS.format(
        ticks=ticks,
        measured=", ".join(f"{{ {row} }}" for row in rows),
        bytes=", ".join(map(str, data)),
        until=", ".join(map(str, until)),
        troubles=", ".join(str(tape.troubles.get(k, 0)) for k in range(ticks)),
        stop_from=2**32 - 1 if stop is None else stop,
        mark=_MARK,
    )


def _words(row: Sequence[float]) -> tuple[Any, ...]:
    return struct.unpack(f"<{len(row)}I", struct.pack(f"<{len(row)}f", *row))


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
