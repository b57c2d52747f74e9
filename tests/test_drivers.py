"""Drivers of the boards against models of their chips: what breaks, and how soon it is found.

A frame of an encoder is held against the chip model, a current against arithmetic written here.
"""

from __future__ import annotations

import itertools

import pytest

from esea_gen.board.chips import (
    WIRE_FAULTS,
    Amplifier,
    As5048a,
    BissEncoder,
    Drivers,
    Workbench,
)
from esea_gen.model.encoder import FrameError

from .conftest import require_tool

LINE = 3
F = FrameError


@pytest.fixture(scope="module")
def built():
    require_tool("gcc")
    return Drivers(Workbench())


@pytest.fixture
def drivers(built):
    """On an empty bench."""
    built.bench.__init__()
    return built


class Magnetic:
    """An AS5048A behind its driver."""

    def __init__(self, drivers, bits=14, magnitude_least=0):
        self.drivers, self.chip = drivers, As5048a()
        drivers.bench.lines[LINE] = self.chip.frame
        self.state = drivers.ffi.new("esea_as5048a_t *")
        self.config = drivers.ffi.new("esea_as5048a_config_t *", (LINE, bits, magnitude_least))
        drivers.lib.esea_as5048a_start(self.state)

    def read(self):
        lib = self.drivers.lib
        angle = lib.esea_as5048a_read(self.state, self.config, self.drivers.hardware)
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
    encoder = Magnetic(drivers)
    frames = encoder.settle(4)
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
    told = magnetic.settle(20)
    assert all(F.NO_ANSWER in wrong for _, wrong in told)
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
        lib = self.drivers.lib
        angle = lib.esea_biss_read(self.state, self.config, self.drivers.hardware)
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
    n = biss.length()
    for start in range(n - 6):
        for pattern in range(1, 64, 2):
            bits = [start + k for k in range(6) if pattern >> k & 1]
            assert spoilt(biss, *bits) == F.PARITY, bits


@pytest.mark.parametrize("low", range(1, 64))
def test_a_frame_that_has_not_ended_is_no_answer(biss, low):
    """The encoder waits so long that the clocks run out; nothing is read beyond them."""
    biss.chip.waits = (2, low)
    fits = 2 + low + 2 + biss.length() <= 64
    assert biss.read()[1] == (F(0) if fits else F.NO_ANSWER)


# -- motor -----------------------------------------------------------------------------------------

PWM, ENABLE, ADC = 7, 8, 9
NM_A, FULL_A, A_COUNT = 0.05, 5.0, 0.005
BOUND_NM, FOLLOW, TICKS = 0.04, 0.025, 20


class Motor:
    """An amplifier behind its driver; a millisecond a step."""

    def __init__(self, drivers, Nm_A=NM_A, A_count=A_COUNT):
        self.drivers, self.amplifier = drivers, Amplifier(FULL_A, A_COUNT)
        drivers.bench.converter = lambda channel: self.amplifier.counts if channel == ADC else None
        self.state = drivers.ffi.new("esea_escon_t *")
        self.config = drivers.ffi.new(
            "esea_escon_config_t *",
            {
                "pwm": PWM,
                "enable_pin": ENABLE,
                "adc": ADC,
                "Nm_A": Nm_A,
                "full_A": FULL_A,
                "A_count": A_count,
                "zero_counts": 2048.0,
                "least_counts": 8,
                "most_counts": 4087,
                "bound_Nm": BOUND_NM,
                "follow": FOLLOW,
                "ticks": TICKS,
            },
        )
        drivers.lib.esea_escon_start(self.state, self.config, drivers.hardware)

    def drive(self, u_Nm, enable=True):
        lib, bench = self.drivers.lib, self.drivers.bench
        lib.esea_escon_drive(self.state, self.config, self.drivers.hardware, u_Nm, enable)
        self.amplifier.enabled, self.amplifier.duty = bench.pins[ENABLE], bench.duties[PWM]

    def step(self, u_Nm):
        """A tick of driving; whether the current is a fault."""
        self.drive(u_Nm)
        self.amplifier.tick()
        lib = self.drivers.lib
        return bool(lib.esea_escon_wrong(self.state, self.config, self.drivers.hardware, u_Nm))

    def found(self, u_Nm, most=200):
        for tick in range(1, most + 1):
            if self.step(u_Nm):
                return tick
        return None


@pytest.fixture
def motor(drivers):
    return Motor(drivers)


@pytest.mark.parametrize(
    ("share", "duty"),
    [(0, 5000), (1, 9000), (-1, 1000), (0.5, 7000), (-0.25, 4000), (2, 9000), (-9, 1000)],
)
@pytest.mark.parametrize("turns", [1, -1])
def test_duty_of_a_torque(drivers, share, duty, turns):
    motor = Motor(drivers, Nm_A=turns * NM_A)
    motor.drive(turns * share * NM_A * FULL_A)
    assert (drivers.bench.pins[ENABLE], drivers.bench.duties[PWM]) == (True, duty)


@pytest.mark.parametrize("u_Nm", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_switches_off(motor, u_Nm):
    motor.drive(0.1)
    motor.drive(u_Nm)
    assert (motor.drivers.bench.pins[ENABLE], motor.drivers.bench.duties[PWM]) == (False, 5000)


def test_off_goes_first_and_on_goes_last(motor):
    bench = motor.drivers.bench
    bench.done.clear()
    motor.drive(0.1)
    motor.drive(0.1, enable=False)
    assert bench.done == [
        ("duty", PWM, 6600),
        ("pin", ENABLE, 1),
        ("pin", ENABLE, 0),
        ("duty", PWM, 5000),
    ]


@pytest.mark.parametrize("lag", [FOLLOW, 0.1, 1.0])
def test_a_current_that_follows_is_never_a_fault(motor, lag):
    """Any lag up to the stated one, whatever is asked: steps, reversals, switching on and off."""
    motor.amplifier.lag = lag
    for k in range(3000):
        assert not motor.step((0.22, -0.22, 0.0, 0.1)[k // (7 + k // 300 * 13) % 4])
        if k % 800 == 799:
            motor.drive(0.0, enable=False)
            motor.amplifier.current_A = 0.0
            motor.state.low_Nm = motor.state.high_Nm = 0.0
    assert motor.state.measured_Nm == pytest.approx(
        motor.amplifier.current_A * NM_A, abs=A_COUNT * NM_A
    )


@pytest.mark.parametrize("turns", [1, -1])
def test_either_way_of_turning_and_counting_is_measured_alike(drivers, turns):
    motor = Motor(drivers, Nm_A=turns * NM_A)
    assert motor.found(0.2) is None


def counts_of(current_Nm):
    return round(2048 + current_Nm / NM_A / A_COUNT)


BEYOND = [counts_of(way * (BOUND_NM + 0.001)) for way in (1, -1)]
WITHIN = [counts_of(way * (BOUND_NM - 0.001)) for way in (1, -1)]


@pytest.mark.parametrize("counts", [0, 7, 4088, 4095, None, *BEYOND])
def test_a_dead_or_saturated_converter_or_a_current_beyond_its_bound_is_a_fault(motor, counts):
    motor.amplifier.stuck_counts = counts
    if counts is None:
        motor.drivers.bench.converter = lambda channel: None
    assert motor.found(0.0) == TICKS


ENDS = [(1e-6, 8), (1e-6, 4087), *((A_COUNT, w) for w in WITHIN)]


@pytest.mark.parametrize(("A_count", "counts"), ENDS)
def test_at_the_converters_ends_and_within_the_bound_is_no_fault(drivers, A_count, counts):
    motor = Motor(drivers, A_count=A_count)
    motor.amplifier.stuck_counts = counts
    assert motor.found(0.0) is None


def test_a_start_forgets_what_was_counted(motor):
    motor.amplifier.stuck_counts = 4095
    for _ in range(TICKS - 1):
        assert not motor.step(0.0)
    motor.drivers.lib.esea_escon_start(motor.state, motor.config, motor.drivers.hardware)
    assert motor.found(0.0) == TICKS


@pytest.mark.parametrize("way", [1, -1])
def test_a_current_on_its_bound_to_the_bit_is_within(drivers, way):
    motor = Motor(drivers, Nm_A=2.0**-4, A_count=2.0**-8)
    motor.config.bound_Nm = 128 * 2.0**-12
    motor.amplifier.stuck_counts = 2048 + 128 * way
    assert motor.found(0.0) is None
    motor.amplifier.stuck_counts += way
    assert motor.found(0.0) == TICKS


def test_a_motor_that_does_not_conduct_is_found(motor):
    """0.2 (1 - 0.975^n) is above the bound of 0.04 from n = 9 on: the first of the 20 ticks."""
    motor.amplifier.gain = 0.0
    assert motor.found(0.2) == 9 + TICKS - 1


def test_one_tick_in_two_beyond_the_bound_is_found_in_four_times_the_ticks(motor):
    found = None
    for tick in range(1, 200):
        motor.amplifier.stuck_counts = 4095 if tick % 2 else 2048
        if motor.step(0.0):
            found = tick
            break
    assert found == pytest.approx(4 * TICKS, abs=4)


@pytest.mark.parametrize("before", ["one tick beyond", "off"])
def test_what_has_passed_is_forgotten(drivers, before):
    """A current that is wrong now and then is found as late as by a driver just started."""
    motor = Motor(drivers)
    if before == "off":
        for _ in range(5):
            drivers.lib.esea_escon_wrong(motor.state, motor.config, drivers.hardware, 0.0)
    motor.amplifier.stuck_counts = 4095 if before == "one tick beyond" else 2048
    motor.step(0.0)
    motor.amplifier.stuck_counts = 2048
    for _ in range(10):
        assert not motor.step(0.0)
    assert motor.state.beyond == 0
    for tick in range(1, 200):  # two up, one down: 40 at the 77th
        motor.amplifier.stuck_counts = 4095 if tick % 2 else 2048
        if motor.step(0.0):
            break
    assert tick == 2 * (2 * TICKS - 2) + 1


def test_a_motor_that_is_off_is_not_asked(motor):
    motor.amplifier.stuck_counts = 4095
    lib, hardware = motor.drivers.lib, motor.drivers.hardware
    for _ in range(TICKS - 1):
        assert not motor.step(0.0)
    motor.drive(0.0, enable=False)
    for _ in range(100):
        assert not lib.esea_escon_wrong(motor.state, motor.config, hardware, 0.0)
    # And what was counted is forgotten.
    assert motor.found(0.0) == TICKS


# -- stop line -------------------------------------------------------------------------------------

STOP_PIN = 5


@pytest.fixture
def line(drivers):
    state = drivers.ffi.new("esea_stop_line_t *")
    config = drivers.ffi.new("esea_stop_line_config_t *", (STOP_PIN, 10))

    def look(closed, ticks=1):
        drivers.bench.contacts[STOP_PIN] = closed
        for _ in range(ticks):
            drivers.lib.esea_stop_line_look(state, config, drivers.hardware)
        return bool(drivers.lib.esea_stop_line_open(state, config, drivers.hardware))

    return look


def test_a_line_is_open_until_it_was_closed_ten_ticks(line):
    assert line(True, 9)
    assert not line(True, 1)
    assert not line(True, 1000)


def test_open_is_stop_at_once_even_between_two_ticks(line):
    line(True, 20)
    assert line(False, 0)
    assert not line(True, 0)  # a bounce that no tick saw is over
    assert line(False, 1)
    assert line(True, 9)
    assert not line(True, 1)


def test_a_line_that_bounces_stays_open(line):
    line(True, 20)
    for _ in range(50):
        line(False)
        assert line(True, 9)


def test_no_wire_is_open(drivers):
    state = drivers.ffi.new("esea_stop_line_t *")
    config = drivers.ffi.new("esea_stop_line_config_t *", (STOP_PIN, 10))
    for _ in range(100):
        drivers.lib.esea_stop_line_look(state, config, drivers.hardware)
        assert drivers.lib.esea_stop_line_open(state, config, drivers.hardware)
