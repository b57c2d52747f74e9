"""Cost of a tick with link and drivers: ``python -m tests.benchmarks.whole_tick DEVICE``.

The image is the STM32F405's, with its drivers, in the emulator, which counts instructions.  Waiting
for a bus is time, not instructions: it is reported separately.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from esea_gen.board.firmware import build_firmware
from esea_gen.board.gdb import addresses
from esea_gen.board.scripted import TapedBoard
from esea_gen.board.sim import SimBoard
from esea_gen.device import Device, load_device
from esea_gen.targets import find_board, firmware_folder
from tests.proof.steered import SteeredProcessor

BOARD = "netduinoplus2"
RUNS = 3
_NOTHING_SENT = 200  # instructions: where no message waits
AIM = 0.15  # of the processor, at one instruction a cycle
# Two AS5048A with two frames of two bytes, a BiSS-C encoder of eight: at 5.25 MHz.
BUS_US = (2 * 2 * 2 + 8) * 8 / 5.25
_SP, _LR = 13, 14
_HANDLER, _STACKED_PC = 0xFFFFFF00, 24  # a link register that ends an exception; in its frame
_NO_PINS = "    if ((ESEA_GPIO_MODER(2u) >> 14 & 3u) != ESEA_GPIO_OUTPUT)\n        return;\n"
_FIRST = '#include "app.h"\n'
_ANSWERS = (
    '#include "stm32f405.h"\n#define esea_board_until(at, mask, bits, looks) ((looks) > 0u)\n'
)
_WRAPPED = """
static void (*own_sample)(float *);
static void (*volatile receive)(uint8_t) = esea_cortex_m_received;
static const uint8_t asked[] = {{ {asked} }};

static void sample(float *values)
{{
    static uint32_t fed;

    own_sample(values);
    while (fed < sizeof asked)
        receive(asked[fed++]);
}}

void esea_board_drivers(esea_port_t *port)
{{
    own_drivers(port);
    own_sample = port->sample;
    port->sample = sample;
}}
"""


@dataclass(frozen=True)
class WholeTick:
    """Instructions of a board's share of a base tick: of each the median and the largest."""

    device: str
    tick: tuple[int, int]  # drivers, release, sensing, limits, motor, all values into streams
    control: tuple[int, int]  # a run of the slower task, all values into streams
    message: tuple[int, int]  # made of a stream, handed to a line that is always ready
    messages_a_tick: float
    share: float  # of the processor at one instruction a cycle, the largest of everything
    flash_bytes: int
    ram_bytes: int
    blackbox_bytes: int
    stack_bytes: int
    stack_bound_bytes: int
    latency_ticks: tuple[int, ...]  # from a reading to its motor command, by control's phase
    limits_ticks: int  # and to the motor off by the limits


def _asked(device: Device) -> bytes:
    # What a host sends to have everything streamed.
    board = TapedBoard(device)
    board.restart()
    board.stream([f"{t.name}.*" for t in device.system.tasks])
    data = b"".join(board.tape.frames.values())
    board.close()
    return data


def _drivers(device: Device) -> str:
    text = (firmware_folder() / find_board(BOARD).folder / "drivers.c").read_text(encoding="utf-8")
    # The emulator has no pins, and not the board's clock; a bus answers at once.
    for find, put in (
        (_NO_PINS, ""),
        (_FIRST, _FIRST + _ANSWERS),
        ("esea_board_clock_MHz / 16u", "ESEA_CLOCK_HZ / 1000000u / 16u"),
        ("void esea_board_drivers(", "static void own_drivers("),
    ):
        if text.count(find) != 1:
            raise RuntimeError(f"drivers.c has changed: {find!r}")
        text = text.replace(find, put)
    return text + _WRAPPED.format(asked=", ".join(map(str, _asked(device))))


def _counted(held: SteeredProcessor, entry: int, handlers: Sequence[int]) -> int:
    # Instructions of a function, from its entry until it has gone back; a handler goes back to what
    # it interrupted, or to one that waits: where it is held, the next tick is due at once.
    held.hold_at(entry)
    held.run()
    held.no_more_at(entry)
    back = held.register(_LR)
    if back >= _HANDLER:
        back = held.read_word(held.register(_SP) + _STACKED_PC)
    return held.steps_to(back & ~1, *handlers)


def latency(device: Device) -> tuple[tuple[int, ...], int]:
    # The first tick whose motor command differs when one reading does; by the phase of control.
    board = SimBoard(device)
    every = max(t.every for t in device.system.tasks)

    def flown(changed: int, wrong: float = 0.0, ticks: int = 40) -> list[tuple[bool, float]]:
        board.restart()
        angles = {"count_motor": 700.0, "count_load": 900.0, "count_gear": 5.0}
        board.measure(**angles)
        board.ticks(20)
        board.zero()
        board.ticks(230)
        board.arm()
        board.ticks(1)
        motor = []
        for k in range(80 + ticks):
            if k % 10 == 0:
                board.want(mode=1.0, tau_desired_Nm=0.2)
            now = angles | {"count_load": 900.0 + (k >= 80 + changed)}
            if wrong and k >= 80 + changed:
                now |= {"frame_error_load": wrong}
            board.measure(**now)
            board.ticks(1)
            motor.append(board.motor)
        return motor[80:]

    try:
        still = flown(10**6)
        found = []
        for phase in range(every):
            moved = flown(phase)
            found.append(next(k for k in range(40) if moved[k] != still[k]) - phase)
        lost = flown(0, wrong=64.0)
        return tuple(found), next(k for k in range(40) if not lost[k][0])
    finally:
        board.close()


def whole_tick(device: Device, runs: int = RUNS) -> WholeTick:
    """Count a drive's tick on the STM32F405."""
    with tempfile.TemporaryDirectory(prefix="esea-tick-") as scratch:
        counted = build_firmware(
            device, BOARD, Path(scratch) / "counted", drivers=_drivers(device), needs_Hz=1.0
        )
        shipped = build_firmware(device, BOARD, Path(scratch) / "shipped")
        at = addresses(counted)
        slower = at["esea_app_background"]
        with SteeredProcessor(counted) as held:
            held.hold_at(slower)
            for _ in range(20):  # until what was asked for is streamed
                held.run()
            held.no_more_at(slower)
            handlers = (at["esea_app_tick"], slower)
            tick = [_counted(held, handlers[0], handlers) for _ in range(runs)]
            control = [_counted(held, slower, handlers) for _ in range(runs)]
            calls = [_counted(held, at["esea_streams_send"], ()) for _ in range(30 * runs)]
            message = [n for n in calls if n > _NOTHING_SENT]
    per_control = max(t.every for t in device.system.tasks)
    # All values of sensing fill a message a run; control's are a fifth as often, and may share one.
    messages = 1 + 1 / per_control
    most = max(tick) + max(control) / per_control + messages * max(message)
    latencies, limits = latency(device)
    clock_Hz = find_board(BOARD).clock_Hz
    return WholeTick(
        device.name,
        (int(np.median(tick)), max(tick)),
        (int(np.median(control)), max(control)),
        (int(np.median(message)), max(message)),
        messages,
        most / (clock_Hz * device.system.base_period_s),
        shipped.flash_bytes,
        shipped.ram_bytes,
        shipped.noinit_bytes,
        shipped.stack_bytes,
        sum(shipped.stack_bounds_bytes.values()),
        latencies,
        limits,
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.whole_tick")
    parser.add_argument("device", nargs="?", default="elbow_drive")
    found = whole_tick(load_device(parser.parse_args().device))
    for name, value in vars(found).items():
        print(f"{name:20} {value}")
    print(f"waiting for buses    {BUS_US:.0f} us a tick; aim of the share {AIM:.0%}")


if __name__ == "__main__":
    main()
