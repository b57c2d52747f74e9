"""Drivers of the boards against models of their chips: faults and detection times.

Encoder frames are compared with the chip model, currents with arithmetic written here.
"""

from __future__ import annotations

import itertools

import pytest

from esea_gen.board.chips import WIRE_FAULTS, As5048a, BissEncoder
from esea_gen.model.encoder import FrameError

LINE = 3
F = FrameError


class Magnetic:
    """An AS5048A behind its driver."""

    def __init__(self, drivers, bits=14, magnitude_least=0):
        self.drivers, self.chip = drivers, As5048a()
        drivers.bench.lines[LINE] = self.chip.frame
        self.state = drivers.ffi.new("esea_as5048a_t *")
        self.config = drivers.ffi.new("esea_as5048a_config_t *", (LINE, bits, magnitude_least))
        drivers.lib.esea_as5048a_start(self.state)

    def read(self):
        angle = self.drivers.lib.esea_as5048a_read(self.state, self.config, self.drivers.hardware)
        return angle.count, F(angle.frame_error)

    def settle(self, ticks=6):
        return [self.read() for _ in range(ticks)]

    def until(self, wanted: F, most: int) -> int:
        """Ticks until a frame error has a bit."""
        for tick in range(1, most + 1):
            if wanted & self.read()[1]:
                return tick
        raise AssertionError(f"{wanted!r} was not told within {most} ticks")


@pytest.fixture
def magnetic(drivers):
    encoder = Magnetic(drivers)
    assert encoder.settle()[-1] == (0x1234, F(0))
    return encoder


def test_an_angle_is_that_of_its_own_tick(magnetic):
    """The answer comes a frame later; the driver asks and takes it within the tick."""
    for angle in (0, 1, 0x2AAA, 0x3FFF, 0x1555):
        magnetic.chip.angle = angle
        assert magnetic.read() == (angle, F(0))


def test_nothing_is_believed_before_the_chip_has_told_of_itself(drivers):
    frames = Magnetic(drivers).settle(4)
    assert [bool(wrong) for _, wrong in frames] == [True, False, False, False]
    assert frames[0][1] == F.NOT_READY


@pytest.mark.parametrize("bits", [8, 12, 14])
def test_the_count_has_the_bits_that_the_device_says(drivers, bits):
    encoder = Magnetic(drivers, bits=bits)
    encoder.chip.angle = 0x3FFF
    assert encoder.settle()[-1] == ((1 << bits) - 1, F(0))


@pytest.mark.parametrize("bit", range(16))
def test_one_wrong_bit_of_an_angle_spoils_that_tick_alone(magnetic, bit):
    frames = itertools.count()

    def wire(came):
        # Of each tick the second frame brings the angle.
        flipped = int.from_bytes(came, "big") ^ (1 << bit if next(frames) == 1 else 0)
        return flipped.to_bytes(2, "big")

    magnetic.drivers.bench.wires[LINE] = wire
    told = magnetic.settle(3)
    assert told[0][1] == F.PARITY
    assert [w for _, w in told[1:]] == [F(0), F(0)]


@pytest.mark.parametrize("bit", range(16))
def test_one_wrong_bit_of_a_command_is_flagged_and_cleared(magnetic, bit):
    """The chip's own check; its error flag is cleared by the driver, and the angle is back."""
    clean = magnetic.chip.frame
    frames = itertools.count()

    def broken(sent):
        flipped = int.from_bytes(sent, "big") ^ (1 << bit if next(frames) == 0 else 0)
        return clean(flipped.to_bytes(2, "big"))

    magnetic.drivers.bench.lines[LINE] = broken
    told = [w for _, w in magnetic.settle(6)]
    assert F.ERROR_FLAG in told[0]
    assert told[3:] == [F(0)] * 3
    assert magnetic.state.errors == 4
    assert not magnetic.chip.error_flag


@pytest.mark.parametrize("fault", ["stuck_low", "stuck_high"])
def test_a_stuck_bus_is_found_in_the_tick(magnetic, fault):
    magnetic.drivers.bench.wires[LINE] = WIRE_FAULTS[fault]
    assert all(F.NO_ANSWER in wrong for _, wrong in magnetic.settle(20))
    # And it comes back by itself.
    del magnetic.drivers.bench.wires[LINE]
    assert [bool(w) for _, w in magnetic.settle(8)][4:] == [False] * 4


def test_a_bus_that_does_not_end_is_no_answer(magnetic):
    del magnetic.drivers.bench.lines[LINE]
    assert F.NO_ANSWER in magnetic.read()[1]


# With these gains the diagnostics are the same either way round (0x0101, and 0x8181 with parity).
PALINDROMES = (0x01, 0x81)


def test_swapped_bytes_are_found_by_the_diagnostics(drivers):
    for gain in range(256):
        drivers.bench.wires.clear()
        encoder = Magnetic(drivers)
        encoder.chip.gain = gain
        encoder.settle()
        # A magnitude whose bytes are the same: it gives nothing away.
        encoder.chip.magnitude = 0x0D0D
        drivers.bench.wires[LINE] = WIRE_FAULTS["swapped"]
        told = [bool(w) for _, w in encoder.settle(6)]
        assert not any(told) if gain in PALINDROMES else told[2:] == [True] * 4, gain


@pytest.mark.parametrize(
    ("lost", "wanted"),
    [
        ({"weak": True}, F.FIELD_WEAK),
        ({"strong": True}, F.FIELD_STRONG),
        ({"overflow": True}, F.OVERFLOW),
        ({"compensated": False}, F.NOT_READY),
        ({"magnitude": 0}, F.NO_ANSWER),
        ({"magnitude": 99}, F.FIELD_WEAK),
    ],
    ids=str,
)
@pytest.mark.parametrize("after", [6, 7])
def test_a_magnet_that_is_lost_is_found_within_3_ticks(drivers, lost, wanted, after):
    encoder = Magnetic(drivers, magnitude_least=100)
    encoder.settle(after)
    for name, value in lost.items():
        setattr(encoder.chip, name, value)
    assert encoder.until(wanted, 3) <= 3
    if wanted != F.NO_ANSWER:
        assert all(wanted in w for _, w in encoder.settle(4))


def test_a_magnitude_at_its_least_is_believed(drivers):
    encoder = Magnetic(drivers, magnitude_least=100)
    encoder.chip.magnitude = 100
    assert encoder.settle()[-1][1] == F(0)


def test_without_diagnostics_no_angle_is_believed(magnetic):
    """Every answer of the diagnostics is corrupt, every angle good."""
    clean = magnetic.chip.frame
    asked = [0]

    def broken(sent):
        came = int.from_bytes(clean(sent), "big")
        came ^= 1 if asked[0] == 0x7FFD else 0
        asked[0] = int.from_bytes(sent, "big")
        return came.to_bytes(2, "big")

    magnetic.drivers.bench.lines[LINE] = broken
    told = [w for _, w in magnetic.settle(20)]
    assert all(F.NOT_READY in w for w in told[2:])
    assert magnetic.state.bad >= 18


def test_ticks_without_an_angle_are_counted_to_the_counter_s_end(magnetic):
    assert magnetic.state.bad == 1  # the first
    magnetic.chip.weak = True
    magnetic.settle(12)
    assert 11 <= magnetic.state.bad <= 13
    magnetic.state.bad = 2**32 - 2
    magnetic.settle(3)
    assert magnetic.state.bad == 2**32 - 1


# -- BiSS-C ----------------------------------------------------------------------------------------


class Biss:
    """A BiSS-C encoder behind its driver."""

    def __init__(self, drivers, bits=17, position_bits=17, count=8):
        self.drivers, self.chip = drivers, BissEncoder(bits=position_bits)
        drivers.bench.lines[LINE] = self.chip.frame
        self.state = drivers.ffi.new("esea_biss_t *")
        self.config = drivers.ffi.new("esea_biss_config_t *", (LINE, position_bits, bits, count))

    def read(self):
        angle = self.drivers.lib.esea_biss_read(self.state, self.config, self.drivers.hardware)
        return angle.count, F(angle.frame_error)

    def length(self):
        """Bits from the start bit's end to the CRC's."""
        return self.chip.bits + 8


@pytest.fixture
def biss(drivers):
    encoder = Biss(drivers)
    assert encoder.read() == (0x1A2B3, F(0))
    return encoder


def test_the_crc_is_that_of_a_published_frame():
    """The CRC of all zeros is all ones, inverted as it is sent; of a single one, the remainder."""
    chip = BissEncoder()
    assert chip.crc("0" * 19) == "111111"
    # x^6 = x + 1, so the remainder of a last bit alone is 000011.
    assert chip.crc("0" * 18 + "1") == "111100"


@pytest.mark.parametrize("waits", [(1, 1), (2, 3), (0, 4), (9, 17)])
@pytest.mark.parametrize("position", [0, 1, 0x1FFFF, 0x10000, 0x0AAAA])
def test_a_position_is_read_whatever_the_wait(biss, waits, position):
    biss.chip.waits, biss.chip.position = waits, position
    assert biss.read() == (position, F(0))


@pytest.mark.parametrize(("sent", "given"), [(24, 24), (24, 17), (18, 12), (8, 8)])
def test_the_highest_bits_are_given(drivers, sent, given):
    encoder = Biss(drivers, given, sent)
    encoder.chip.position = (1 << sent) - 2
    assert encoder.read() == (((1 << sent) - 2) >> (sent - given), F(0))


def spoilt(biss, *bits):
    """The driver's frame error with bits flipped, counted from the first of the position."""
    first = sum(biss.chip.waits) + 2

    def wire(came):
        value = int.from_bytes(came, "big")
        for bit in bits:
            value ^= 1 << (8 * len(came) - 1 - first - bit)
        return value.to_bytes(len(came), "big")

    biss.drivers.bench.wires[LINE] = wire
    return biss.read()[1]


@pytest.mark.parametrize("fault", ["stuck_low", "stuck_high", "swapped", "no end"])
def test_a_biss_line_that_is_wrong_is_found(biss, fault):
    if fault == "no end":
        del biss.drivers.bench.lines[LINE]
    else:
        biss.drivers.bench.wires[LINE] = WIRE_FAULTS[fault]
    found = biss.read()[1]
    assert found if fault == "swapped" else found == F.NO_ANSWER


def test_error_and_warning_bits(biss):
    biss.chip.warning = True
    assert biss.read() == (0x1A2B3, F(0))
    biss.chip.error = True
    assert biss.read()[1] == F.ERROR_FLAG
    assert (biss.state.warnings, biss.state.bad) == (2, 1)


def test_every_single_and_double_wrong_bit_is_found(biss):
    n = biss.length()
    for bits in itertools.chain(
        itertools.combinations(range(n), 1), itertools.combinations(range(n), 2)
    ):
        assert spoilt(biss, *bits) == F.PARITY, bits


def test_every_burst_of_up_to_six_bits_is_found(biss):
    for start in range(biss.length() - 6):
        for pattern in range(1, 64, 2):
            bits = [start + k for k in range(6) if pattern >> k & 1]
            assert spoilt(biss, *bits) == F.PARITY, bits


@pytest.mark.parametrize("low", range(1, 64))
def test_a_frame_that_has_not_ended_is_no_answer(biss, low):
    """The encoder waits so long that the clocks run out; nothing is read beyond them."""
    biss.chip.waits = (2, low)
    fits = 2 + low + 2 + biss.length() <= 64
    assert biss.read()[1] == (F(0) if fits else F.NO_ANSWER)
