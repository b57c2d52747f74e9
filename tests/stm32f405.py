"""A model of the STM32F405's registers, and the board's drivers compiled against it.

Registers are cells of memory here; buses, pins and the converter behind them are played.  Expected
values are the reference manual's (RM0090), written out.
"""

from __future__ import annotations

import subprocess

import cffi

from esea_gen.board.chips import As5048a, BissEncoder
from esea_gen.emit.states import BOARD_FAULTS
from esea_gen.targets import BOARDS
from tests.conftest import require_tool
from tests.firmware_harness import without_processor

FAULTS = {f.name: f.value for f in BOARD_FAULTS}
LINK = """
#pragma once
#include <stdint.h>
typedef int esea_link_control_t, esea_link_in_t, esea_link_out_t;
typedef int mavlink_message_t, mavlink_status_t;
typedef int mavlink_signing_t, mavlink_signing_streams_t;
typedef struct { uint32_t mode, stop, rearm; float desired[3]; } esea_link_wanted_t;
#define ESEA_LINK_TASKS 2
#define ESEA_LINK_STREAMS 1
#define ESEA_LINK_STREAM_WORDS 1
#define ESEA_LINK_KEY_WORDS 1
#define ESEA_LINK_PARAMETERS 1u
#define MAVLINK_MAX_PACKET_LEN 280
#define ESEA_LINK_SYSTEM 1u
#define ESEA_LINK_COMPONENT 1u
#define ESEA_LINK_TICK_US 1000
#define ESEA_LINK_COUPLINGS 1u
"""
# Of one axis, of two, and of two without motors.
BOARDS_BUILT = {
    name: f"""
#define ESEA_LINK_AXES {axes}
#define ESEA_LINK_ENCODERS {2 * joints}
#define ESEA_LINK_MEASURED {(6 if axes else 4) * joints}
#define ESEA_LINK_MOTOR_ENCODERS {joints}
#define ESEA_LINK_MOTOR_COUNTS {{ {places(0)} }}
#define ESEA_LINK_LOAD_COUNTS {{ {places(2)} }}
#define ESEA_LINK_GEAR_ENCODERS {axes}
#define ESEA_LINK_GEAR_COUNTS {{ {places(4)} }}
"""
    for name, axes, joints, places in (
        ("one", 1, 1, str),
        ("two", 2, 2, lambda first: f"{first}, {first + 6}"),
        ("passive", 0, 2, lambda first: f"{first}, {first + 4}"),
    )
}
HARNESS = """
#include <stdint.h>
static volatile uint32_t *(*hook)(uint32_t);
volatile uint32_t *register_at(uint32_t address) { return hook(address); }
#include "FIRMWARE/boards/netduinoplus2/clock.c"
#include "FIRMWARE/boards/netduinoplus2/board.c"
#include "FIRMWARE/boards/netduinoplus2/drivers.c"
uint32_t esea_stack_top[1];
void esea_cortex_m_received(uint8_t byte) { (void)byte; }
void esea_reset_handler(void) {}
void esea_fault_handler(void) {}
void esea_slower_handler(void) {}
void esea_tick_handler(void) {}
static esea_port_t board_port;
void start(volatile uint32_t *(*given)(uint32_t)) { hook = given; esea_board_drivers(&board_port); }
uint32_t start_board(volatile uint32_t *(*given)(uint32_t))
{
    hook = given;
    esea_board_start();
    return esea_board_clock_MHz;
}
void at_168_MHz(void) { esea_board_clock_MHz = 168u; }
const char *notice(void) { return board_port.notice ? board_port.notice : ""; }
void sample(float *measured) { board_port.sample(measured); }
void motor_to(float u_Nm, float second_Nm, bool enable)
{
    const float both[] = { u_Nm, second_Nm };

    board_port.motor(both, enable);
}
bool stop_open(void) { return board_port.stop_open(); }
bool has_drivers(void)
{
    return board_port.sample || board_port.motor || board_port.stop_open || board_port.trouble ||
           board_port.feed;
}
bool drives(void) { return board_port.motor || board_port.stop_open; }
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
uint32_t start_board(volatile uint32_t *(*given)(uint32_t)); void at_168_MHz(void);
const char *notice(void);
void start(volatile uint32_t *(*given)(uint32_t)); void sample(float *measured);
void motor_to(float u_Nm, float second_Nm, bool enable); bool stop_open(void);
bool has_drivers(void); bool drives(void);
uint32_t trouble(void); void feed(void);
void flash_read(uint32_t area, uint32_t at, void *to, size_t n); bool flash_erase(uint32_t area);
bool flash_write(uint32_t area, uint32_t at, const void *from, size_t n);
"""
BOARD = BOARDS["netduinoplus2"]
GPIO, SPI1, SPI2, SPI3, ADC = 0x40020000, 0x40013000, 0x40003800, 0x40003C00, 0x40012000
TIM3_CCR1, TIM3_CCR4, IWDG, PWR, RCC = 0x40000434, 0x40000440, 0x40003000, 0x40007000, 0x40023800
MODER, PUPDR, IDR, BSRR, AFRL, AFRH = 0, 0x0C, 0x10, 0x18, 0x20, 0x24
FLASH_KEYR, FLASH_SR, FLASH_CR = 0x40023C04, 0x40023C0C, 0x40023C10
FLASH = range(0x080C0000, 0x08100000)
A, B, C = (GPIO + 0x400 * k for k in range(3))


def build(folder, axes: str):
    require_tool("gcc")
    firmware = without_processor(folder)
    faults = ", ".join(f"ESEA_FAULT_{n} = {v}" for n, v in FAULTS.items())
    (folder / "link.h").write_text(
        f"{LINK}{BOARDS_BUILT[axes]}typedef enum {{ {faults} }} ESEA_FAULT;\n"
    )
    (folder / "harness.c").write_text(HARNESS.replace("FIRMWARE", str(firmware)))
    register = "volatile uint32_t *register_at(uint32_t address);"
    (folder / "register.h").write_text(f"#include <stdint.h>\n{register}\n")
    folders = [f"-I{firmware / f}" for f in ("app", "port", "drivers", "boards/netduinoplus2")]
    command = [
        *("gcc", "-std=gnu99", "-w", "-shared", "-fPIC", "-fsanitize=undefined"),
        *("-fsanitize-undefined-trap-on-error", f"-I{folder}", *folders),
        *("-include", folder / "register.h", '-DESEA_LINK_HEADER="link.h"'),
        *("-DESEA_ENCODER_BITS=12u", "-DESEA_GEAR_BITS=17u", *BOARD.clock_defines),
        *("-DESEA_NEEDS_HZ=17200000u", folder / "harness.c"),
        *sorted((firmware / "drivers").glob("*.c")),
        *("-o", folder / "board.so"),
    ]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    ffi.cdef(DECLARED)
    return ffi, str(folder / "board.so"), folder


CR, PLLCFGR, CFGR, APB1ENR, ACR, IDCODE = RCC, RCC + 4, RCC + 8, RCC + 0x40, 0x40023C00, 0xE0042000
NEVER = 10**9


class Clocks:
    """Clock control, regulator and wait states; what the manual forbids fails (RM0090, 3.5, 5, 7).

    hse, pll, switch: looks until crystal, PLL, and the switch to it are there.
    """

    def __init__(self, hse=3, pll=5, switch=2, revision=0x1007, at_start=0x83, of_crystal=True):
        self.of_crystal = of_crystal  # whether the PLL locks to it
        self.after = {17: hse, 25: pll, 1: 1}  # looks, by the bit that says ready
        self.switch, self.revision, self.at_start = switch, revision, at_start
        self.waited = dict.fromkeys((1, 17, 25, "sws"), 0)

    def power_up(self, cells):
        cells[CR], cells[PLLCFGR] = self.at_start, 0x24003010
        cells[PWR] = 0x4000 if self.at_start else 0
        cells[IDCODE] = self.revision << 16 | 0x413

    def look(self, cells, address):
        """Before an access: ready bits that have come."""
        if address == CR:
            value = cells.get(CR)
            for on, ready in ((0, 1), (16, 17), (24, 25)):
                self.waited[ready] = self.waited[ready] + 1 if value >> on & 1 else 0
                there = self.waited[ready] > self.after[ready]
                there &= self.of_crystal or ready != 25 or not cells.get(PLLCFGR) >> 22 & 1
                value = value & ~(1 << ready) | there << ready
            cells[CR] = value
        if address == CFGR:
            wanted = cells.get(CFGR) & 3
            self.waited["sws"] += 1
            if wanted == 0 or self.waited["sws"] > self.switch:
                cells[CFGR] = cells.get(CFGR) & ~0xC | wanted << 2

    def hz(self, cells):
        if cells.get(CFGR) >> 2 & 3 != 2:
            return 16e6
        return self.pll_hz(cells)

    @staticmethod
    def pll_hz(cells):
        set_to = cells.get(PLLCFGR)
        m, n, p = set_to & 63, set_to >> 6 & 511, 2 * (set_to >> 16 & 3) + 2
        fed = 25e6 if set_to >> 22 & 1 else 16e6
        assert 1e6 <= fed / m <= 2e6
        assert 50 <= n <= 432
        assert 100e6 <= fed / m * n <= 432e6
        assert fed / m * n / (set_to >> 24 & 15) == 48e6
        assert set_to & ~0x0F437FFF == 0x20000000, "reserved bits stay as they were"
        return fed / m * n / p

    def wrote(self, cells, address, old, value):
        """After an access that changed something."""
        on = cells.get(CR) >> 24 & 1
        if address == PLLCFGR:
            assert not on, "the PLL is set while it is off"
        if address == CR and (value & ~old) >> 24 & 1:
            crystal = cells.get(PLLCFGR) >> 22 & 1
            assert value >> (17 if crystal else 1) & 1, "the source is ready first"
            self.pll_hz(cells)
        if address == CR and (old & ~value) & (1 << 24 | 1 << 16 | 1):
            in_use = cells.get(CFGR) >> 2 & 3 == 2
            crystal = cells.get(PLLCFGR) >> 22 & 1
            off = old & ~value
            assert not in_use or not (off >> 24 & 1 or (crystal and off >> 16 & 1))
            assert not off & 1, "the internal oscillator stays on"
        if address == PWR and (old ^ value) >> 14 & 1:
            assert not on, "the regulator's scale changes while the PLL is off"
        if address == PWR:
            assert cells.get(APB1ENR) >> 28 & 1
        if address == CFGR and (old ^ value) & 3:
            self.waited["sws"] = 0
            if value & 3 == 2:
                assert cells.get(CR) >> 25 & 1, "the PLL has locked"
        fast = cells.get(CFGR) & 3 == 2 or cells.get(CFGR) >> 2 & 3 == 2
        clock = self.pll_hz(cells) if fast else 16e6
        by = {4: 2, 5: 4, 6: 8, 7: 16}
        config = cells.get(CFGR)
        assert config >> 4 & 15 == 0
        assert clock / by.get(config >> 10 & 7, 1) <= 42e6
        assert clock / by.get(config >> 13 & 7, 1) <= 84e6
        assert clock <= 168e6
        if clock > 30e6:  # at 2.7 to 3.6 V: a wait for each 30 MHz
            assert cells.get(ACR) & 7 >= -(-clock // 30e6) - 1
            assert cells.get(PWR) >> 14 & 1 or clock <= 144e6
        if cells.get(ACR) >> 8 & 1:
            assert self.revision > 0x1000, "the first parts have no prefetch"


class Mcu:
    """Registers and what hangs on them.

    log: address and value after each access, whether it read or wrote.
    clocks: what the board's start finds; without, only the drivers are started.
    """

    def __init__(self, built, before=None, keeps=True, clocks=None):
        ffi, _, folder = built
        # A copy of the library: its static memory is that of power-up.
        copy = folder / f"board{len(list(folder.iterdir()))}.so"
        copy.write_bytes((folder / "board.so").read_bytes())
        self.ffi, self.lib = ffi, ffi.dlopen(str(copy))
        self.cells = {}
        self.keys, self.erased, self.left, self.wrong, self.old = [], [], {}, 0, 0
        self.log, self.last, self.keeps = [], None, keeps
        self.levels, self.sent = {}, {SPI1: b"", SPI2: b"", SPI3: b""}
        self.sides = {(A, 4): As5048a(angle=0x1234), (B, 0): As5048a(angle=0x3455)}
        self.sides |= {(C, 4): As5048a(angle=0x0678), (C, 5): As5048a(angle=0x2AAA)}
        self.gear = BissEncoder(position=0x1A2B3)
        self.gears = {SPI2: self.gear, SPI3: BissEncoder(position=0x05678)}
        self.counts, self.dead, self.turns = (
            {10: 2048, 11: 2048},
            set(),
            dict.fromkeys(self.sent, 0),
        )
        for address, value in (before or {}).items():
            self[address] = value
        self.hook = ffi.callback("volatile uint32_t *(uint32_t)", self.access)
        self.clocks, self.failed = clocks, []
        if clocks is not None:
            clocks.power_up(self)
            self.MHz = self.lib.start_board(self.hook)
        else:
            self.lib.at_168_MHz()
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

    def get(self, address):
        return self.cell(address)[0]

    def selected(self):
        return [pin for pin in self.sides if not self.levels.get(pin, True)]

    def settle(self):
        """What the last access left."""
        if self.last is None:
            return
        address, self.last = self.last, None
        value = self.cell(address)[0]
        self.log.append((address, value))
        if self.clocks is not None and value != self.old:
            try:
                self.clocks.wrote(self, address, self.old, value)
            except AssertionError as error:  # cffi would only print it
                self.failed.append(error)
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
        if self.clocks is not None:
            self.clocks.look(self, address)
        self.last, self.old = address, self.cell(address)[0]
        if address == FLASH_SR:
            busy = self.left.get(FLASH_SR, 0) > 0
            self.left[FLASH_SR] = self.left.get(FLASH_SR, 0) - 1
            self[address] = (1 << 16 if busy else 0) | self.wrong
        for spi in self.sent:
            if address == spi + 0x08:
                self[address] = 0x80 if spi in self.dead else 0x01 if self.turns[spi] % 2 else 0x00
                if spi not in self.dead and not self.turns[spi] % 2:
                    self[address] = 0x02
            if address == spi + 0x0C:
                self.data(spi, address)
        if address == ADC:
            self[address] = 0 if ADC in self.dead else self.cell(address)[0] | 2
        if address == ADC + 0x4C:
            self[address] = self.counts[self.get(ADC + 0x34)]
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
            self[address] = self.gears[spi].frame(bytes(8))[at]
            self.sent[spi] = b"" if at == 7 else self.sent[spi]

    def sample(self, values=6):
        measured = self.ffi.new("float[]", values)
        self.lib.sample(measured)
        self.settle()
        return list(measured)
