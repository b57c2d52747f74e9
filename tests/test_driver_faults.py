"""A sensor breaks while the motor gives torque: the real drivers on models of their chips, the real
application above them; and how many ticks it takes until the torque is gone.

Stated: what a frame itself tells, 4 ticks (three bad frames are bridged); what only the chip knows
of its magnet, 7, for its diagnostics come every second tick.
"""

from __future__ import annotations

import pytest

from esea_gen.board.chips import (
    WIRE_FAULTS,
    Amplifier,
    As5048a,
    BissEncoder,
    Drivers,
    Workbench,
)
from esea_gen.board.sim import SimBoard
from esea_gen.device import load_device

from .conftest import require_tool

SENSING, MOTOR_CURRENT = 6, 106
MOTOR_SIDE, LOAD_SIDE, GEAR, ADC, STOP = range(5)
FRAME, MAGNET = 4, 7  # ticks


class Joint:
    """The drive's board with its drivers; the joint stands still."""

    def __init__(self, board, drivers):
        self.board, self.drivers = board, drivers
        bench = self.bench = drivers.bench
        bench.__init__()
        self.chips = {MOTOR_SIDE: As5048a(2800), LOAD_SIDE: As5048a(3600), GEAR: BissEncoder(5)}
        bench.lines = {line: chip.frame for line, chip in self.chips.items()}
        self.amplifier = Amplifier()
        bench.converter = lambda channel: self.amplifier.counts
        bench.contacts[STOP] = True
        ffi, lib = self.drivers.ffi, self.drivers.lib
        self.sides = {}
        for line in (MOTOR_SIDE, LOAD_SIDE):
            state = ffi.new("esea_as5048a_t *")
            lib.esea_as5048a_start(state)
            self.sides[line] = state, ffi.new("esea_as5048a_config_t *", (line, 12, 1))
        self.gear = ffi.new("esea_biss_t *"), ffi.new("esea_biss_config_t *", (GEAR, 17, 17, 8))
        self.motor = ffi.new("esea_escon_t *")
        self.motor_config = ffi.new(
            "esea_escon_config_t *",
            {
                "pwm": 1, "enable_pin": 1, "adc": ADC, "Nm_A": 0.05, "full_A": 5.0,
                "A_count": 0.005, "zero_counts": 2048.0, "least_counts": 8, "most_counts": 4087,
                "bound_Nm": 0.05, "follow": 0.025, "ticks": 20,
            },
        )  # fmt: skip
        self.line = ffi.new("esea_stop_line_t *"), ffi.new("esea_stop_line_config_t *", (STOP, 20))
        lib.esea_escon_start(self.motor, self.motor_config, self.drivers.hardware)
        self.set_Nm = 0.0

    def tick(self):
        """As the board's drivers.c does it."""
        lib, hardware, board = self.drivers.lib, self.drivers.hardware, self.board
        values = {}
        for line, name in ((MOTOR_SIDE, "motor"), (LOAD_SIDE, "load")):
            angle = lib.esea_as5048a_read(*self.sides[line], hardware)
            values |= {f"count_{name}": angle.count, f"frame_error_{name}": angle.frame_error}
        angle = lib.esea_biss_read(*self.gear, hardware)
        board.measure(**values, count_gear=angle.count, frame_error_gear=angle.frame_error)
        lib.esea_stop_line_look(*self.line, hardware)
        board.lib.sim_stop_line(bool(lib.esea_stop_line_open(*self.line, hardware)))
        if lib.esea_escon_wrong(self.motor, self.motor_config, hardware, self.set_Nm):
            board.trouble(MOTOR_CURRENT)
        board.ticks()
        on, self.set_Nm = board.motor
        lib.esea_escon_drive(self.motor, self.motor_config, hardware, self.set_Nm, on)
        self.amplifier.enabled, self.amplifier.duty = self.bench.pins[1], self.bench.duties[1]
        self.amplifier.tick()
        return on

    def ticks(self, count):
        for _ in range(count):
            self.tick()

    def until_off(self, most):
        """Ticks until the motor is off and its set-point none; commands go on."""
        for tick in range(1, most + 1):
            if tick % 20 == 0:
                self.board.want(mode=1.0, tau_desired_Nm=0.1)
            if not self.tick():
                assert (self.bench.pins[1], self.bench.duties[1]) == (False, 5000)
                return tick
        return None


@pytest.fixture(scope="module")
def powered():
    require_tool("gcc")
    board = SimBoard(load_device("elbow_drive"))
    yield board
    board.close()


@pytest.fixture(scope="module")
def built():
    require_tool("gcc")
    return Drivers(Workbench())


@pytest.fixture(params=[30, 31])
def joint(powered, built, request):
    """Under torque since an even or an odd number of ticks: diagnostics come every second."""
    powered.lib.sim_stop_line(False)
    powered.restart()
    made = Joint(powered, built)
    made.ticks(30)
    if powered.state_now == "STOPPED":  # the line was open until it was closed for 20 ticks
        powered.release()
    powered.zero()
    made.ticks(230)
    powered.arm()
    made.tick()
    powered.want(mode=1.0, tau_desired_Nm=0.1)
    made.ticks(request.param)
    assert powered.state_now == "ACTIVE"
    assert powered.motor[1] != 0
    return made


@pytest.mark.parametrize("line", [MOTOR_SIDE, LOAD_SIDE])
@pytest.mark.parametrize("fault", ["stuck_low", "stuck_high"])
def test_a_stuck_bus(joint, line, fault):
    joint.bench.wires[line] = WIRE_FAULTS[fault]
    assert joint.until_off(50) == FRAME
    assert joint.board.lib.sim_fault() == SENSING


@pytest.mark.parametrize("line", [MOTOR_SIDE, LOAD_SIDE])
def test_a_parity_error_that_stays(joint, line):
    joint.bench.wires[line] = lambda came: bytes([came[0] ^ 1, came[1]])
    assert joint.until_off(50) == FRAME


@pytest.mark.parametrize("line", [MOTOR_SIDE, LOAD_SIDE])
def test_swapped_bytes(joint, line):
    joint.bench.wires[line] = WIRE_FAULTS["swapped"]
    assert joint.until_off(50) <= MAGNET


@pytest.mark.parametrize("line", [MOTOR_SIDE, LOAD_SIDE])
@pytest.mark.parametrize("what", ["weak", "strong", "overflow"])
def test_a_magnet_that_is_lost(joint, line, what):
    setattr(joint.chips[line], what, True)
    assert joint.until_off(50) <= MAGNET
    assert joint.board.lib.sim_fault() == SENSING


def test_three_bad_frames_are_bridged(joint):
    joint.bench.wires[LOAD_SIDE] = WIRE_FAULTS["stuck_high"]
    joint.ticks(2)
    del joint.bench.wires[LOAD_SIDE]
    assert joint.until_off(20) is None


@pytest.mark.parametrize("fault", ["stuck_low", "stuck_high"])
def test_the_motor_s_own_encoder(joint, fault):
    """It bears only the check of the other two, which reaches the limits through control."""
    joint.bench.wires[GEAR] = WIRE_FAULTS[fault]
    assert joint.until_off(50) <= 16


@pytest.mark.parametrize("counts", [0, 4095])
def test_a_converter_that_is_saturated(joint, counts):
    joint.amplifier.stuck_counts = counts
    assert joint.until_off(50) == 20
    assert joint.board.lib.sim_fault() == MOTOR_CURRENT


def test_the_stop_line_opens(joint):
    joint.bench.contacts[STOP] = False
    assert joint.until_off(50) == 1
    assert joint.board.state_now == "STOPPED"
