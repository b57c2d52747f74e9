"""Models of a board's chips: words and bits typed by hand from their data sheets."""

from __future__ import annotations

import pytest

from esea_gen.board.chips import Amplifier, As5048a, BissEncoder, even_parity

# -- chips -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "sent"),
    [(0, 0), (1, 0x8001), (3, 3), (0x4000, 0xC000), (0x7FFF, 0xFFFF), (0x2AAA, 0xAAAA)],
)
def test_bit_15_makes_the_number_of_ones_even(word, sent):
    assert even_parity(word) == sent


READ_ANGLE, READ_NOTHING = b"\xff\xff", b"\xc0\x00"
READ_DIAGNOSTICS, READ_MAGNITUDE, READ_ERRORS = b"\x7f\xfd", b"\x7f\xfe", b"\x40\x01"


def test_an_answer_comes_in_the_frame_after_its_command():
    chip = As5048a(angle=0x1234, magnitude=0x0D00)
    assert chip.frame(READ_ANGLE) == b"\x00\x00"
    assert chip.frame(READ_MAGNITUDE) == b"\x92\x34"  # five ones, and the parity
    assert chip.frame(READ_NOTHING) == b"\x8d\x00"
    assert chip.frame(READ_ANGLE) == b"\x00\x00"


@pytest.mark.parametrize(
    ("what", "bits"),
    [({}, 0x160), ({"compensated": False}, 0x060), ({"overflow": True}, 0x360),
     ({"strong": True}, 0x560), ({"weak": True}, 0x960), ({"gain": 0x81}, 0x181)],
)  # fmt: skip
def test_diagnostics_bit_by_bit(what, bits):
    chip = As5048a(**what)
    chip.frame(READ_DIAGNOSTICS)
    assert chip.frame(READ_NOTHING) == even_parity(bits).to_bytes(2, "big")


def test_a_wrong_frame_is_told_until_its_error_is_read():
    for wrong, bit in ((b"\x7f\xff", 4), (b"\x80\x02", 2), (b"\x12\x34\x56", 1), (b"", 1)):
        chip = As5048a(angle=3)
        chip.frame(READ_ANGLE)
        assert len(chip.frame(wrong)) == len(wrong)
        if bit == 1:  # the chip was not asked: what it would have answered stays
            assert chip.frame(READ_ANGLE) == b"\x00\x03"
        else:
            assert chip.frame(READ_ANGLE) == b"\xc0\x00"
        assert chip.frame(READ_ERRORS) == even_parity(0x4003).to_bytes(2, "big")
        assert chip.frame(READ_ANGLE) == even_parity(bit).to_bytes(2, "big")
        assert chip.frame(READ_ERRORS) == b"\x00\x03"
        assert chip.frame(READ_NOTHING) == b"\x00\x00"


def test_a_biss_frame_bit_by_bit():
    chip = BissEncoder(position=0b101, bits=3, waits=(1, 2))
    # Data 101, no error, no warning; its checksum by hand: 10111 000000 mod 1000011.
    value = 0b10111 << 6
    for k in range(10, 5, -1):
        if value >> k & 1:
            value ^= 0b1000011 << (k - 6)
    line = "1" + "00" + "10" + "101" + "11" + f"{value ^ 0b111111:06b}" + "0"
    assert chip.frame(bytes(3)) == int(line.ljust(24, "1"), 2).to_bytes(3, "big")
    assert chip.frame(bytes(1)) == int(line[:8], 2).to_bytes(1, "big")
    assert chip.crc("10111") == f"{value ^ 0b111111:06b}"
    assert BissEncoder().crc("0") == "111111"
    assert BissEncoder().crc("1") == "111100"  # x^6 is x + 1
    sick = BissEncoder(position=0b101, bits=3, waits=(1, 2), error=True, warning=True)
    first = int.from_bytes(sick.frame(bytes(2)), "big")
    assert f"{first:016b}"[:10] == "1" + "00" + "10" + "101" + "00"


def test_a_motors_current_and_its_converter():
    motor = Amplifier(full_A=5.0, A_count=0.005, lag=0.25, gain=0.8, duty=7000)
    motor.tick()
    assert (motor.current_A, motor.counts) == (0.0, 2048)
    motor.enabled = True
    motor.tick()  # half of the range is 2.5 A, of which 0.8 flow, a quarter of the way
    assert motor.current_A == pytest.approx(0.5)
    assert motor.counts == 2148
    motor.tick()
    assert motor.current_A == pytest.approx(0.5 + 0.25 * 1.5)
    motor.duty = 3000
    motor.tick()
    assert motor.current_A == pytest.approx(0.875 + 0.25 * (-2.0 - 0.875))
    for current_A, counts in ((10.235, 4095), (10.3, 4095), (-10.24, 0), (-11.0, 0), (-5.0, 1048)):
        motor.current_A = current_A
        assert motor.counts == counts
    motor.stuck_counts = 0
    assert motor.counts == 0
