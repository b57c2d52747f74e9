"""STM32F405: register writes of its drivers, and the resulting inputs."""

from __future__ import annotations

import pytest

from tests import stm32f405 as chip


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return chip.build(tmp_path_factory.mktemp("board"), "one")


@pytest.fixture
def mcu(built):
    return chip.Mcu(built)


def test_pins_and_clocks(mcu):
    # PA4 output; PA5, PA6, PA7 alternate function 5.
    assert mcu[chip.A + chip.MODER] & 0xFF00 == 0b10_10_10_01 << 8
    assert mcu[chip.A + chip.AFRL] & 0xFFFF0000 == 0x55500000
    # PB0 output; PB13, PB14 function 5.
    assert mcu[chip.B + chip.MODER] & 0x3C000003 == 0b1010 << 26 | 0b01
    assert mcu[chip.B + chip.AFRH] & 0x0FF00000 == 0x05500000
    # PC0 analogue, PC6 function 2, PC7 output, PC8 input with pull-down.
    assert mcu[chip.C + chip.MODER] & 0x3F003 == 0b00_01_10 << 12 | 0b11
    assert mcu[chip.C + chip.AFRL] & 0xFF000000 == 0x02000000
    assert mcu[chip.C + chip.PUPDR] & 3 << 16 == 2 << 16
    assert mcu[chip.RCC + 0x30] & 7 == 7  # GPIO A, B, C
    assert mcu[chip.RCC + 0x40] & 0x10004002 == 0x10004002  # PWR, SPI 2, TIM 3
    assert mcu[chip.RCC + 0x44] & 0x1100 == 0x1100  # SPI 1, ADC 1


@pytest.mark.parametrize(
    ("clocks", "MHz", "crystal"),
    [
        (chip.Clocks(), 168, True),
        (chip.Clocks(hse=50_000, pll=5_000, switch=5_000), 168, True),  # late, all of them
        (chip.Clocks(hse=chip.NEVER), 168, False),
        (chip.Clocks(of_crystal=False), 168, False),
        (chip.Clocks(revision=0x1000), 168, True),
        (chip.Clocks(pll=chip.NEVER), 16, False),
        (chip.Clocks(hse=chip.NEVER, pll=chip.NEVER), 16, False),
        (chip.Clocks(switch=chip.NEVER), 16, False),
        (chip.Clocks(at_start=0), 168, True),
    ],
)
def test_the_clock_is_set_in_the_manuals_order_or_stays(built, clocks, MHz, crystal):
    """Whatever does not come: the board runs at 16 MHz, says so, and no such drive is armed."""
    mcu = chip.Mcu(built, clocks=clocks)
    assert mcu.failed == []
    assert (mcu.MHz, clocks.hz(mcu)) == (MHz, MHz * 1e6)
    assert chip.BOARD.clock_Hz == 168e6
    assert chip.BOARD.reset_Hz == 16e6
    bus = 84e6 if MHz == 168 else 16e6
    # Sixteen samples a bit; 5 kHz; both buses of the encoders below 10 MHz; the converter below 36.
    assert bus / mcu[0x40011008] == pytest.approx(115200, rel=0.002)
    assert bus / (mcu[0x4000042C] + 1) == 5000
    assert mcu[chip.TIM3_CCR1] == (mcu[0x4000042C] + 1) // 2
    for spi, clock in ((chip.SPI1, bus), (chip.SPI2, bus / (2 if MHz == 168 else 1))):
        assert 4e6 <= clock / 2 ** ((mcu[spi] >> 3 & 7) + 1) <= 5.25e6
    assert bus / (2 + 2 * (mcu[chip.ADC + 0x304] >> 16 & 3)) <= 36e6
    assert mcu[chip.CR] >> 16 & 1 == mcu[chip.PLLCFGR] >> 22 & mcu[chip.CR] >> 24 & 1 == crystal
    assert mcu[chip.CR] >> 19 & 1 == crystal
    if MHz == 168:
        assert mcu[chip.ACR] & ~0x100 == 0x605
        assert mcu[chip.ACR] >> 8 & 1 == (clocks.revision > 0x1000)
        assert (mcu.lib.trouble(), ffi_text(mcu)) == (0, "")
    else:
        assert (mcu[chip.CR] >> 24 & 1, mcu[chip.CFGR], mcu[chip.ACR]) == (0, 0, 0)
        assert mcu.lib.trouble() == mcu.lib.trouble() == chip.FAULTS["SLOW_CLOCK"]
        assert ffi_text(mcu) == "clock: 16 MHz, the PLL did not lock"


def ffi_text(mcu):
    return mcu.ffi.string(mcu.lib.notice()).decode()


def test_an_erasure_empties_the_data_cache_while_it_is_off(built):
    mcu = chip.Mcu(built, clocks=chip.Clocks())
    mcu.log.clear()
    assert mcu.lib.flash_erase(0)
    mcu.settle()
    assert [v & 0x1600 for a, v in mcu.log if a == chip.ACR][1:] == [0x200, 0x1200, 0x200, 0x600]
    assert mcu[chip.ACR] & 0x1600 == 0x600


def test_pins_that_others_use_are_left_as_they_are(built):
    mcu = chip.Mcu(
        built,
        {
            chip.A + chip.MODER: 0xA80000FF,
            chip.B + chip.MODER: 0x000A0280,
            chip.B + chip.AFRL: 0x77000000,
        },
    )
    assert mcu[chip.A + chip.MODER] & 0xFFFF00FF == 0xA80000FF
    assert mcu[chip.B + chip.MODER] & 0xC3FFFFFC == 0x000A0280
    assert mcu[chip.B + chip.AFRL] & 0xFFFFFFF0 == 0x77000000


def test_nothing_is_selected_or_enabled_before_its_pin_is_an_output(mcu):
    for pin, bit in (((chip.A, 4), 1 << 4), ((chip.B, 0), 1), ((chip.C, 7), 1 << (7 + 16))):
        put = next(k for k, x in enumerate(mcu.log) if x == (pin[0] + chip.BSRR, bit))
        output = 1 << 2 * pin[1]
        mode = next(
            k
            for k, (a, v) in enumerate(mcu.log)
            if a == pin[0] + chip.MODER and v & 3 * output == output
        )
        assert put < mode


def test_where_pins_are_no_memory_there_are_no_drivers(built):
    mcu = chip.Mcu(built, keeps=False)
    assert chip.SPI1 not in mcu.cells
    assert not mcu.lib.has_drivers()
    assert chip.Mcu(built).lib.has_drivers()


def test_counts_come_from_the_chips(mcu):
    first = mcu.sample()
    assert first[1] == first[3] == 32  # not told yet that they are ready
    assert mcu.sample() == [0x1234 >> 2, 0, 0x3455 >> 2, 0, 0x1A2B3, 0]
    mcu.sides[chip.A, 4].weak = True
    mcu.sides[chip.B, 0].angle = 0x3FFF
    mcu.gear.error = True
    for _ in range(2):
        told = mcu.sample()
    assert told == [0x1234 >> 2, 4, 0x0FFF, 0, 0x1A2B3, 2]


@pytest.mark.parametrize(("dead", "wrong"), [(chip.SPI1, (64, 64, 0)), (chip.SPI2, (0, 0, 64))])
def test_a_bus_that_hangs_is_given_up(mcu, dead, wrong):
    for _ in range(3):
        mcu.sample()
    mcu.dead.add(dead)
    before = len(mcu.log)
    told = mcu.sample()
    assert tuple(int(x) & 64 for x in told[1::2]) == wrong
    # Two waits of 4000 looks an exchange, four exchanges at most.
    assert len(mcu.log) - before < 4 * 2 * 4000 + 1000
    assert mcu.selected() == []


@pytest.mark.parametrize(
    ("u_Nm", "enable", "ccr"),
    [(0.0, True, 8400), (0.125, True, 11760), (-0.125, True, 5040), (0.125, False, 8400)],
)
def test_the_motor_s_duty_and_enable_line(mcu, u_Nm, enable, ccr):
    """Half of 5 A times 0.05 Nm/A is 70 %: 11760 of 16800."""
    mcu.lib.motor_to(u_Nm, 0.0, enable)
    assert mcu[chip.TIM3_CCR1] == ccr
    assert mcu.levels[chip.C, 7] == enable


def test_the_stop_line_is_debounced(mcu):
    assert mcu.lib.stop_open()
    mcu[chip.C + chip.IDR] = 1 << 8
    for _ in range(19):
        mcu.sample()
    assert mcu.lib.stop_open()
    mcu.sample()
    assert not mcu.lib.stop_open()
    mcu[chip.C + chip.IDR] = 0xFFFF & ~(1 << 8)
    assert mcu.lib.stop_open()


def test_the_watchdog_is_started_by_the_first_feeding(mcu):
    assert not [a for a, _ in mcu.log if chip.IWDG <= a < chip.IWDG + 0x400]
    for _ in range(2):
        mcu.lib.feed()
    mcu.settle()
    told = [(a - chip.IWDG, v) for a, v in mcu.log if chip.IWDG <= a < chip.IWDG + 0x400]
    # Start, open, clock / 16, 200 of 2 kHz, feed; then feed.
    assert told == [(0, 0xCCCC), (0, 0x5555), (4, 2), (8, 200), (0, 0xAAAA), (0, 0xAAAA)]


def test_a_watchdog_s_reset_is_told_once_and_forgotten(built):
    mcu = chip.Mcu(built, {chip.RCC + 0x74: 1 << 29})
    assert mcu[chip.RCC + 0x74] & 1 << 24
    assert (mcu.lib.trouble(), mcu.lib.trouble()) == (chip.FAULTS["WATCHDOG"], 0)


def test_a_supply_that_is_too_low_is_told_as_long_as_it_is(mcu):
    assert mcu.lib.trouble() == 0
    mcu[chip.PWR + 4] = 4
    assert (mcu.lib.trouble(), mcu.lib.trouble()) == (chip.FAULTS["BROWN_OUT"],) * 2
    mcu[chip.PWR + 4] = 0
    assert mcu.lib.trouble() == 0


# -- two axes, and none ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    return chip.build(tmp_path_factory.mktemp("two"), "two")


def test_pins_and_peripherals_of_the_second_axis(two):
    mcu = chip.Mcu(two)
    # PC4, PC5 outputs, PC1 analogue, PC9 function 2, PC10 and PC11 function 6; PB12 output.
    assert mcu[chip.C + chip.MODER] & 0x00FC0F0C == 0b10_10_10 << 18 | 0b0101 << 8 | 0b11 << 2
    assert mcu[chip.C + chip.AFRH] & 0x0000FFF0 == 0x6620
    assert mcu[chip.C + 8] & 0x00F00000 == 0b0101 << 20
    assert mcu[chip.B + chip.MODER] >> 24 & 3 == 1
    assert mcu[chip.RCC + 0x40] & 1 << 15
    assert mcu[chip.SPI3] == mcu[chip.SPI2]
    assert (mcu[0x4000041C], mcu[0x40000420], mcu[chip.TIM3_CCR4]) == (0x6800, 0x1001, 8400)
    assert mcu[chip.ADC + 0x0C] == 0b100_100
    for pin, bit in (((chip.C, 4), 1 << 4), ((chip.C, 5), 1 << 5), ((chip.B, 12), 1 << 28)):
        put = mcu.log.index((pin[0] + chip.BSRR, bit))
        modes = [k for k, (a, v) in enumerate(mcu.log) if a == pin[0] + chip.MODER]
        assert put < next(k for k in modes if mcu.log[k][1] >> 2 * pin[1] & 3 == 1)


def test_each_count_comes_from_its_own_chip(two):
    mcu = chip.Mcu(two)
    for _ in range(2):
        told = mcu.sample(12)
    first = [0x1234 >> 2, 0, 0x3455 >> 2, 0, 0x1A2B3, 0]
    assert told == [*first, 0x0678 >> 2, 0, 0x2AAA >> 2, 0, 0x05678, 0]
    mcu.dead.add(chip.SPI3)
    assert [x for x in mcu.sample(12) if x == 64] == [64]


def test_both_motors_are_on_or_none_and_each_current_is_watched(two):
    mcu = chip.Mcu(two)
    mcu.lib.motor_to(0.125, -0.125, True)
    assert (mcu[chip.TIM3_CCR1], mcu[chip.TIM3_CCR4]) == (11760, 5040)
    assert (mcu.levels[chip.C, 7], mcu.levels[chip.B, 12]) == (True, True)
    mcu.lib.motor_to(0.125, -0.125, False)
    assert (mcu[chip.TIM3_CCR1], mcu[chip.TIM3_CCR4]) == (8400, 8400)
    assert (mcu.levels[chip.C, 7], mcu.levels[chip.B, 12]) == (False, False)
    for channel in (10, 11):
        mcu.lib.motor_to(0.0, 0.0, True)
        assert mcu.lib.trouble() == 0
        mcu.counts[channel] = 4095
        assert [mcu.lib.trouble() for _ in range(20)] == [0] * 19 + [chip.FAULTS["MOTOR_CURRENT"]]
        mcu.counts[channel] = 2048
        mcu.lib.motor_to(0.0, 0.0, False)
        assert mcu.lib.trouble() == 0


def test_a_board_without_a_motor_reads_its_encoders_and_drives_nothing(tmp_path_factory):
    mcu = chip.Mcu(chip.build(tmp_path_factory.mktemp("passive"), "passive"))
    for _ in range(2):
        told = mcu.sample(8)
    assert told == [0x1234 >> 2, 0, 0x3455 >> 2, 0, 0x0678 >> 2, 0, 0x2AAA >> 2, 0]
    assert not mcu.lib.drives()
    assert (mcu.levels[chip.C, 7], mcu.levels[chip.B, 12]) == (False, False)


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
    assert mcu[chip.FLASH_CR] == 0x80000000


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
    told = [
        (a, v) for a, v in mcu.log if a in (chip.IWDG, chip.IWDG + 4, chip.IWDG + 8, chip.FLASH_CR)
    ]
    starts = next(k for k, (a, v) in enumerate(told) if a == chip.FLASH_CR and v & 1 << 16)
    # 4095 of 500 Hz before, 200 of 2 kHz again after.
    long = [(chip.IWDG, 0x5555), (chip.IWDG + 4, 4), (chip.IWDG + 8, 0xFFF), (chip.IWDG, 0xAAAA)]
    assert [x for x in told[:starts] if x[0] != chip.FLASH_CR] == long
    short = [(chip.IWDG, 0x5555), (chip.IWDG + 4, 2), (chip.IWDG + 8, 200), (chip.IWDG, 0xAAAA)]
    assert [x for x in told[starts:] if x[0] != chip.FLASH_CR] == short
    assert mcu[chip.FLASH_CR] == 0x80000000


def test_a_flash_that_refuses_is_told(mcu):
    mcu.dead.add(chip.FLASH_CR)
    assert not mcu.lib.flash_write(0, 0, bytes(8), 8)
    assert read(mcu, 0, 0, 8) == b"\xff" * 8
    assert mcu[chip.FLASH_CR] == 0x80000000
