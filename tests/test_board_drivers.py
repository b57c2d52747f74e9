"""STM32F405: what its drivers write to registers, and what chips behind them become above.

Registers are cells of memory here; buses, pins and the converter behind them are played.  Expected
values are the reference manual's (RM0090), written out.
"""

from __future__ import annotations

import subprocess

import cffi
import pytest

from esea_gen.emit.states import BOARD_FAULTS
from esea_gen.verify.chips import As5048a, BissEncoder

from .conftest import require_tool
from .firmware_harness import without_processor

FAULTS = {f.name: f.value for f in BOARD_FAULTS}
LINK = """
#pragma once
#include <stdint.h>
typedef int esea_link_control_t, esea_link_in_t, esea_link_out_t;
typedef int mavlink_message_t, mavlink_status_t;
typedef int mavlink_signing_t, mavlink_signing_streams_t;
typedef struct { float mode, stop, rearm; float desired[3]; } esea_link_wanted_t;
#define ESEA_LINK_TASKS 2
#define ESEA_LINK_STREAMS 1
#define ESEA_LINK_STREAM_WORDS 1
#define ESEA_LINK_KEY_WORDS 1
#define ESEA_LINK_SYSTEM 1u
#define ESEA_LINK_COMPONENT 1u
#define ESEA_LINK_MEASURED 6
#define ESEA_LINK_MEASURED_COUNT_MOTOR 0
#define ESEA_LINK_MEASURED_COUNT_LOAD 2
#define ESEA_LINK_MEASURED_COUNT_GEAR 4
#define ESEA_LINK_TICK_US 1000
#define ESEA_LINK_DRIVE 1
#define ESEA_LINK_COUPLINGS 1u
"""
HARNESS = """
#include <stdint.h>
static volatile uint32_t *(*hook)(uint32_t);
volatile uint32_t *register_at(uint32_t address) { return hook(address); }
#include "FIRMWARE/boards/netduinoplus2/drivers.c"
static esea_port_t board_port;
void start(volatile uint32_t *(*given)(uint32_t)) { hook = given; esea_board_drivers(&board_port); }
void sample(float *measured) { board_port.sample(measured); }
void motor_to(float u_Nm, bool enable) { board_port.motor(u_Nm, enable); }
bool stop_open(void) { return board_port.stop_open(); }
bool has_drivers(void)
{
    return board_port.sample || board_port.motor || board_port.stop_open || board_port.trouble ||
           board_port.feed;
}
uint32_t trouble(void) { return board_port.trouble(); }
#include "FIRMWARE/boards/netduinoplus2/flash.c"
void flash_read(uint32_t area, uint32_t at, void *to, size_t n)
{
    board_port.flash->read(area, at, to, n);
}
bool flash_write(uint32_t area, uint32_t at, const void *from, size_t n)
{
    return board_port.flash->write(area, at, from, n);
}
bool flash_erase(uint32_t area) { return board_port.flash->erase(area); }
void feed(void) { board_port.feed(); }
"""
DECLARED = """
void start(volatile uint32_t *(*given)(uint32_t)); void sample(float *measured);
void motor_to(float u_Nm, bool enable); bool stop_open(void); bool has_drivers(void);
uint32_t trouble(void); void feed(void);
void flash_read(uint32_t area, uint32_t at, void *to, size_t n); bool flash_erase(uint32_t area);
bool flash_write(uint32_t area, uint32_t at, const void *from, size_t n);
"""
GPIO, SPI1, SPI2, ADC = 0x40020000, 0x40013000, 0x40003800, 0x40012000
TIM3_CCR1, IWDG, PWR, RCC = 0x40000434, 0x40003000, 0x40007000, 0x40023800
MODER, PUPDR, IDR, BSRR, AFRL, AFRH = 0, 0x0C, 0x10, 0x18, 0x20, 0x24
FLASH_KEYR, FLASH_SR, FLASH_CR = 0x40023C04, 0x40023C0C, 0x40023C10
FLASH = range(0x080C0000, 0x08100000)
A, B, C = (GPIO + 0x400 * k for k in range(3))


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    require_tool("gcc")
    folder = tmp_path_factory.mktemp("board")
    firmware = without_processor(folder)
    faults = ", ".join(f"ESEA_FAULT_{n} = {v}" for n, v in FAULTS.items())
    (folder / "link.h").write_text(f"{LINK}typedef enum {{ {faults} }} ESEA_FAULT;\n")
    (folder / "harness.c").write_text(HARNESS.replace("FIRMWARE", str(firmware)))
    register = "volatile uint32_t *register_at(uint32_t address);"
    (folder / "register.h").write_text(f"#include <stdint.h>\n{register}\n")
    folders = [f"-I{firmware / f}" for f in ("app", "port", "drivers", "boards/netduinoplus2")]
    command = [
        *("gcc", "-std=gnu99", "-w", "-shared", "-fPIC", "-fsanitize=undefined"),
        *("-fsanitize-undefined-trap-on-error", f"-I{folder}", *folders),
        *("-include", folder / "register.h", '-DESEA_LINK_HEADER="link.h"'),
        *("-DESEA_ENCODER_BITS=12u", "-DESEA_GEAR_BITS=17u", folder / "harness.c"),
        *sorted((firmware / "drivers").glob("*.c")),
        *("-o", folder / "board.so"),
    ]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    ffi.cdef(DECLARED)
    return ffi, str(folder / "board.so"), folder


class Mcu:
    """Registers and what hangs on them.

    log: address and value after each access, whether it read or wrote.
    """

    def __init__(self, built, before=None, keeps=True):
        ffi, _, folder = built
        # A copy of the library: its static memory is that of power-up.
        copy = folder / f"board{len(list(folder.iterdir()))}.so"
        copy.write_bytes((folder / "board.so").read_bytes())
        self.ffi, self.lib = ffi, ffi.dlopen(str(copy))
        self.cells = {}
        self.keys, self.erased, self.left, self.wrong, self.old = [], [], {}, 0, 0
        self.log, self.last, self.keeps = [], None, keeps
        self.levels, self.sent = {}, {SPI1: b"", SPI2: b""}
        self.sides = {(A, 4): As5048a(angle=0x1234), (B, 0): As5048a(angle=0x3455)}
        self.gear = BissEncoder(position=0x1A2B3)
        self.counts, self.dead, self.turns = 2048, set(), {SPI1: 0, SPI2: 0}
        for address, value in (before or {}).items():
            self[address] = value
        self.hook = ffi.callback("volatile uint32_t *(uint32_t)", self.access)
        self.lib.start(self.hook)
        self.settle()

    def cell(self, address):
        fresh = 0xFFFFFFFF if address in FLASH else 0x80000000 if address == FLASH_CR else 0
        return self.cells.setdefault(address, self.ffi.new("uint32_t[1]", [fresh]))

    def flash(self, address, value):
        """Keys open it; what is not opened, or not set to write words, is an error and stays."""
        control = self.cell(FLASH_CR)
        if address == FLASH_KEYR:
            self.keys = [*self.keys[-1:], value]
            if self.keys == [0x45670123, 0xCDEF89AB]:
                control[0] &= 0x7FFFFFFF
        elif address == FLASH_CR and value & 1 << 16 and value & 2:
            self.erased.append(value >> 3 & 15)
            first = 0x080C0000 + 0x20000 * (self.erased[-1] - 10)
            for a in [a for a in self.cells if first <= a < first + 0x20000]:
                self[a] = 0xFFFFFFFF
            self.left = {FLASH_SR: 3 if FLASH_SR not in self.dead else 10**9}
        elif address in FLASH and value != self.old:
            right = control[0] & 0x80000303 == 0x201 and FLASH_CR not in self.dead
            self[address] = self.old & value if right else self.old
            if not right:
                self.wrong = 0x80

    def __getitem__(self, address):
        self.settle()
        return self.cell(address)[0]

    def __setitem__(self, address, value):
        self.cell(address)[0] = value

    def selected(self):
        return [pin for pin in self.sides if not self.levels.get(pin, False)]

    def settle(self):
        """What the last access left."""
        if self.last is None:
            return
        address, self.last = self.last, None
        value = self.cell(address)[0]
        self.log.append((address, value))
        if address == C + MODER and not self.keeps:
            self[address] = 0
        self.flash(address, value)
        if address in (A + BSRR, B + BSRR, C + BSRR):
            self[address] = 0
            for number in range(16):
                if value >> number & 0x10001:
                    self.pin((address - BSRR, number), bool(value >> number & 1))

    def pin(self, pin, high):
        if high and not self.levels.get(pin, False) and pin in self.sides and self.sent[SPI1]:
            self.sides[pin].frame(self.sent[SPI1])
            self.sent[SPI1] = b""
        self.levels[pin] = high

    def access(self, address):
        self.settle()
        self.last, self.old = address, self.cell(address)[0]
        if address == FLASH_SR:
            busy = self.left.get(FLASH_SR, 0) > 0
            self.left[FLASH_SR] = self.left.get(FLASH_SR, 0) - 1
            self[address] = (1 << 16 if busy else 0) | self.wrong
        for spi in (SPI1, SPI2):
            if address == spi + 0x08:
                self[address] = 0x80 if spi in self.dead else 0x01 if self.turns[spi] % 2 else 0x00
                if spi not in self.dead and not self.turns[spi] % 2:
                    self[address] = 0x02
            if address == spi + 0x0C:
                self.data(spi, address)
        if address == ADC:
            self[address] = 0 if ADC in self.dead else self.cell(address)[0] | 2
        if address == ADC + 0x4C:
            self[address] = self.counts
        return self.cell(address)

    def data(self, spi, address):
        """Written, then read: at the read the byte that was sent is exchanged."""
        self.turns[spi] += 1
        if self.turns[spi] % 2 or spi in self.dead:
            return
        self.sent[spi] += bytes([self.cell(address)[0] & 0xFF])
        at = len(self.sent[spi]) - 1
        if spi == SPI1:
            (pin,) = self.selected()
            self[address] = self.sides[pin].answer.to_bytes(2, "big")[at]
        else:
            self[address] = self.gear.frame(bytes(8))[at]
            self.sent[spi] = b"" if at == 7 else self.sent[spi]

    def sample(self):
        measured = self.ffi.new("float[6]")
        self.lib.sample(measured)
        self.settle()
        return list(measured)


@pytest.fixture
def mcu(built):
    return Mcu(built)


def test_pins_and_clocks(mcu):
    # PA4 output; PA5, PA6, PA7 alternate function 5.
    assert mcu[A + MODER] & 0xFF00 == 0b10_10_10_01 << 8
    assert mcu[A + AFRL] & 0xFFFF0000 == 0x55500000
    # PB0 output; PB13, PB14 function 5.
    assert mcu[B + MODER] & 0x3C000003 == 0b1010 << 26 | 0b01
    assert mcu[B + AFRH] & 0x0FF00000 == 0x05500000
    # PC0 analogue, PC6 function 2, PC7 output, PC8 input with pull-down.
    assert mcu[C + MODER] & 0x3F003 == 0b00_01_10 << 12 | 0b11
    assert mcu[C + AFRL] & 0xFF000000 == 0x02000000
    assert mcu[C + PUPDR] & 3 << 16 == 2 << 16
    assert mcu[RCC + 0x30] & 7 == 7  # GPIO A, B, C
    assert mcu[RCC + 0x40] & 0x10004002 == 0x10004002  # PWR, SPI 2, TIM 3
    assert mcu[RCC + 0x44] & 0x1100 == 0x1100  # SPI 1, ADC 1


def test_pins_that_others_use_are_left_as_they_are(built):
    kept = {A + MODER: 0xA80000FF, B + MODER: 0x000A0280, B + AFRL: 0x77000000}
    mcu = Mcu(built, kept)
    assert mcu[A + MODER] & 0xFFFF00FF == 0xA80000FF
    assert mcu[B + MODER] & 0xC3FFFFFC == 0x000A0280
    assert mcu[B + AFRL] & 0xFFFFFFF0 == 0x77000000


def test_nothing_is_selected_or_enabled_before_its_pin_is_an_output(mcu):
    for pin, bit in (((A, 4), 1 << 4), ((B, 0), 1), ((C, 7), 1 << (7 + 16))):
        put = next(k for k, x in enumerate(mcu.log) if x == (pin[0] + BSRR, bit))
        output = 1 << 2 * pin[1]
        mode = next(
            k
            for k, (a, v) in enumerate(mcu.log)
            if a == pin[0] + MODER and v & 3 * output == output
        )
        assert put < mode


def test_where_pins_are_no_memory_there_are_no_drivers(built):
    mcu = Mcu(built, keeps=False)
    assert SPI1 not in mcu.cells
    assert not mcu.lib.has_drivers()
    assert Mcu(built).lib.has_drivers()


def test_buses_timer_converter_supply(mcu):
    # MSTR, clock / 4, SSI and SSM, SPE; AS5048A: CPHA; BiSS: CPOL.
    assert mcu[SPI1] == 0x0004 | 0x0008 | 0x0300 | 0x0040 | 0x0001
    assert mcu[SPI2] == 0x0004 | 0x0008 | 0x0300 | 0x0040 | 0x0002
    # 16 MHz / 3200 = 5 kHz, PWM mode 1 with preload on channel 1.
    assert (mcu[0x40000428], mcu[0x4000042C], mcu[0x40000418]) == (0, 3199, 0x68)
    assert (mcu[0x40000420], mcu[0x40000400], mcu[TIM3_CCR1]) == (1, 0x81, 1600)
    assert mcu[ADC + 0x08] == 1
    assert mcu[PWR] == 0x10 | 0x7 << 5


def test_counts_come_from_the_chips(mcu):
    first = mcu.sample()
    assert first[1] == first[3] == 32  # not told yet that they are ready
    assert mcu.sample() == [0x1234 >> 2, 0, 0x3455 >> 2, 0, 0x1A2B3, 0]
    mcu.sides[A, 4].weak = True
    mcu.sides[B, 0].angle = 0x3FFF
    mcu.gear.error = True
    for _ in range(2):
        told = mcu.sample()
    assert told == [0x1234 >> 2, 4, 0x0FFF, 0, 0x1A2B3, 2]


@pytest.mark.parametrize(("dead", "wrong"), [(SPI1, (64, 64, 0)), (SPI2, (0, 0, 64))])
def test_a_bus_that_hangs_is_given_up(mcu, dead, wrong):
    for _ in range(3):
        mcu.sample()
    mcu.dead.add(dead)
    before = len(mcu.log)
    told = mcu.sample()
    assert tuple(int(x) & 64 for x in told[1::2]) == wrong
    # Two waits of 4000 looks an exchange, four exchanges at most.
    assert len(mcu.log) - before < 4 * 2 * 4000 + 1000
    assert all(mcu.levels[pin] for pin in mcu.sides)


@pytest.mark.parametrize(
    ("u_Nm", "enable", "ccr"),
    [(0.0, True, 1600), (0.125, True, 2240), (-0.125, True, 960), (0.125, False, 1600)],
)
def test_the_motor_s_duty_and_enable_line(mcu, u_Nm, enable, ccr):
    """Half of 5 A times 0.05 Nm/A is 70 %: 2240 of 3200."""
    mcu.lib.motor_to(u_Nm, enable)
    assert mcu[TIM3_CCR1] == ccr
    assert mcu.levels[C, 7] == enable


def test_the_stop_line_is_debounced(mcu):
    assert mcu.lib.stop_open()
    mcu[C + IDR] = 1 << 8
    for _ in range(19):
        mcu.sample()
    assert mcu.lib.stop_open()
    mcu.sample()
    assert not mcu.lib.stop_open()
    mcu[C + IDR] = 0xFFFF & ~(1 << 8)
    assert mcu.lib.stop_open()


def test_the_watchdog_is_started_by_the_first_feeding(mcu):
    assert not [a for a, _ in mcu.log if IWDG <= a < IWDG + 0x400]
    for _ in range(2):
        mcu.lib.feed()
    mcu.settle()
    told = [(a - IWDG, v) for a, v in mcu.log if IWDG <= a < IWDG + 0x400]
    # Start, open, clock / 16, 200 of 2 kHz, feed; then feed.
    assert told == [(0, 0xCCCC), (0, 0x5555), (4, 2), (8, 200), (0, 0xAAAA), (0, 0xAAAA)]


def test_a_watchdog_s_reset_is_told_once_and_forgotten(built):
    mcu = Mcu(built, {RCC + 0x74: 1 << 29})
    assert mcu[RCC + 0x74] & 1 << 24
    assert (mcu.lib.trouble(), mcu.lib.trouble()) == (FAULTS["WATCHDOG"], 0)


@pytest.mark.parametrize("cause", [25, 26, 27, 28, 30, 31])
def test_other_resets_are_no_fault(built, cause):
    assert Mcu(built, {RCC + 0x74: 1 << cause}).lib.trouble() == 0


def test_a_supply_that_is_too_low_is_told_as_long_as_it_is(mcu):
    assert mcu.lib.trouble() == 0
    mcu[PWR + 4] = 4
    assert (mcu.lib.trouble(), mcu.lib.trouble()) == (FAULTS["BROWN_OUT"],) * 2
    mcu[PWR + 4] = 0
    assert mcu.lib.trouble() == 0


@pytest.mark.parametrize("counts", [0, 4095, None])
def test_a_converter_at_its_end_or_dead_is_a_fault_after_20_ticks(mcu, counts):
    mcu.lib.motor_to(0.0, True)
    for _ in range(50):
        assert mcu.lib.trouble() == 0
    assert mcu[ADC + 0x34] == 10
    if counts is None:
        mcu.dead.add(ADC)
    else:
        mcu.counts = counts
    told = [mcu.lib.trouble() for _ in range(20)]
    assert told == [0] * 19 + [FAULTS["MOTOR_CURRENT"]]
    # Off, it is not asked any more.
    mcu.lib.motor_to(0.0, False)
    assert mcu.lib.trouble() == 0


def test_a_current_of_what_was_set_is_none(mcu):
    """0.1 Nm are 2 A, 400 counts; set at once, it comes with the lag that is let pass."""
    current_A = 0.0
    for _ in range(300):
        mcu.lib.motor_to(0.1, True)
        current_A += 0.03 * (2.0 - current_A)
        mcu.counts = round(2048 + current_A / 0.005)
        assert mcu.lib.trouble() == 0
    mcu.counts = 2048
    assert FAULTS["MOTOR_CURRENT"] in [mcu.lib.trouble() for _ in range(25)]


# -- flash -----------------------------------------------------------------------------------------


def read(mcu, area, at, count):
    into = mcu.ffi.new("uint8_t[]", count)
    mcu.lib.flash_read(area, at, into, count)
    return bytes(into)


def test_words_are_written_and_read_where_they_belong(mcu):
    data = bytes(range(1, 13))
    assert mcu.lib.flash_write(1, 8, data, 12)
    assert read(mcu, 1, 8, 12) == data
    assert read(mcu, 1, 4, 5) == b"\xff\xff\xff\xff\x01"
    assert read(mcu, 0, 8, 12) == b"\xff" * 12
    assert mcu[0x080E0008] == 0x04030201
    # A write only clears bits, and the flash is locked again.
    assert mcu.lib.flash_write(1, 8, b"\xf0\xf2\xf3\xf4", 4)
    assert read(mcu, 1, 8, 4) == b"\x00\x02\x03\x04"
    assert mcu[FLASH_CR] == 0x80000000


@pytest.mark.parametrize("area", [0, 1])
def test_a_sector_is_erased_while_the_watchdog_waits(mcu, area):
    for k in (0, 1):
        assert mcu.lib.flash_write(k, 0, bytes(4), 4)
    mcu.lib.feed()
    mcu.settle()
    mcu.log.clear()
    assert mcu.lib.flash_erase(area)
    mcu.settle()
    assert mcu.erased == [10 + area]
    assert read(mcu, area, 0, 4) == b"\xff" * 4
    assert read(mcu, 1 - area, 0, 4) == bytes(4)
    told = [(a, v) for a, v in mcu.log if a in (IWDG, IWDG + 4, IWDG + 8, FLASH_CR)]
    starts = next(k for k, (a, v) in enumerate(told) if a == FLASH_CR and v & 1 << 16)
    # 4095 of 500 Hz before, 200 of 2 kHz again after.
    long = [(IWDG, 0x5555), (IWDG + 4, 4), (IWDG + 8, 0xFFF), (IWDG, 0xAAAA)]
    assert [x for x in told[:starts] if x[0] != FLASH_CR] == long
    short = [(IWDG, 0x5555), (IWDG + 4, 2), (IWDG + 8, 200), (IWDG, 0xAAAA)]
    assert [x for x in told[starts:] if x[0] != FLASH_CR] == short
    assert mcu[FLASH_CR] == 0x80000000


def test_an_erasure_starts_no_watchdog(mcu):
    assert mcu.lib.flash_erase(0)
    mcu.settle()
    assert not [a for a, _ in mcu.log if IWDG <= a < IWDG + 0x400]


def test_a_flash_that_refuses_is_told(mcu):
    mcu.dead.add(FLASH_CR)
    assert not mcu.lib.flash_write(0, 0, bytes(8), 8)
    assert read(mcu, 0, 0, 8) == b"\xff" * 8
    assert mcu[FLASH_CR] == 0x80000000
