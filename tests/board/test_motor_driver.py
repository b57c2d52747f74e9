"""Drivers of motor amplifier and stop line: faults and detection times."""

from __future__ import annotations

import pytest

from esea_gen.board.chips import Amplifier

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
    Motor(drivers, Nm_A=turns * NM_A).drive(turns * share * NM_A * FULL_A)
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
    assert Motor(drivers, Nm_A=turns * NM_A).found(0.2) is None


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
