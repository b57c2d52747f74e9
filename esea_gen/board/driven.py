"""Runs the hand-written drivers on models of their chips, with faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from esea_gen.board.chips import WIRE_FAULTS, Amplifier, As5048a, BissEncoder, Drivers, Workbench
from esea_gen.device import Device

MOTOR_SIDE, LOAD_SIDE, GEAR, ADC = range(4)
_LINES = {"motor": MOTOR_SIDE, "load": LOAD_SIDE, "gear": GEAR}
_CHIP_BITS = 14
# As the board's drivers.c has it.
CURRENT_TICKS = 20
_AMPLIFIER = {
    "pwm": 1, "enable_pin": 1, "adc": ADC, "Nm_A": 0.05, "full_A": 5.0, "A_count": 0.005,
    "zero_counts": 2048.0, "least_counts": 8, "most_counts": 4087, "bound_Nm": 0.05,
    "follow": 0.025, "ticks": CURRENT_TICKS,
}  # fmt: skip


def _one_bit(came: bytes) -> bytes:
    return bytes([came[0] ^ 1, *came[1:]])


def _magnet(what: str) -> Callable[[DrivenSensors, int], None]:
    return lambda sensors, line: setattr(sensors.chips[line], what, True)


def _wire(frames: Callable[[bytes], bytes]) -> Callable[[DrivenSensors, int], None]:
    return lambda sensors, line: sensors.bench.wires.__setitem__(line, frames)


# What breaks between a chip and the processor, or in the chip.
BUS_FAULTS: dict[str, Callable[[DrivenSensors, int], None]] = {
    "stuck low": _wire(WIRE_FAULTS["stuck_low"]),
    "stuck high": _wire(WIRE_FAULTS["stuck_high"]),
    "swapped bytes": _wire(WIRE_FAULTS["swapped"]),
    "one wrong bit": _wire(_one_bit),
    "dead bus": lambda sensors, line: sensors.bench.lines.__delitem__(line),
}
MAGNET_FAULTS = {"magnet weak": _magnet("weak"), "magnet strong": _magnet("strong")}
CURRENT_FAULTS = {"saturated low": 0, "saturated high": 4095}


class DrivenSensors:
    """Encoders and motor current as the drivers give them, a tick at a time."""

    bench: Workbench

    def __init__(self, device: Device) -> None:
        self.bits = int(device.file.encoder.resolution_bits.value)
        self.bench = Workbench()
        self.drivers = Drivers(self.bench)
        self.start()

    def start(self) -> None:
        """Power on: everything sound."""
        ffi, lib = self.drivers.ffi, self.drivers.lib
        bench = self.bench
        bench.wires.clear()
        self.chips: dict[int, As5048a | BissEncoder] = {
            MOTOR_SIDE: As5048a(),
            LOAD_SIDE: As5048a(),
            GEAR: BissEncoder(),
        }
        bench.lines = {line: chip.frame for line, chip in self.chips.items()}
        self.amplifier = Amplifier()
        bench.converter = lambda channel: self.amplifier.counts
        self._sides = {}
        for line in (MOTOR_SIDE, LOAD_SIDE):
            state = ffi.new("esea_as5048a_t *")
            lib.esea_as5048a_start(state)
            self._sides[line] = state, ffi.new("esea_as5048a_config_t *", (line, self.bits, 1))
        self._gear = ffi.new("esea_biss_t *"), ffi.new("esea_biss_config_t *", (GEAR, 17, 17, 8))
        self._motor = ffi.new("esea_escon_t *")
        self._config = ffi.new("esea_escon_config_t *", _AMPLIFIER)
        lib.esea_escon_start(self._motor, self._config, self.drivers.hardware)
        self._set_Nm = 0.0

    def read(self, true: Mapping[str, float]) -> dict[str, float]:
        """Driver readings for true counts, by the device's input names."""
        lib, hardware = self.drivers.lib, self.drivers.hardware
        found: dict[str, float] = {}
        for name, line in _LINES.items():
            count = int(true[f"count_{name}"])
            chip = self.chips[line]
            if isinstance(chip, As5048a):
                chip.angle = count << (_CHIP_BITS - self.bits)
                angle = lib.esea_as5048a_read(*self._sides[line], hardware)
            else:
                chip.position = count
                angle = lib.esea_biss_read(*self._gear, hardware)
            found |= {f"count_{name}": angle.count, f"frame_error_{name}": angle.frame_error}
        return found

    def current_wrong(self) -> bool:
        """Whether the current has differed from its command for too long; once a tick."""
        given = self._motor, self._config, self.drivers.hardware, self._set_Nm
        return bool(self.drivers.lib.esea_escon_wrong(*given))

    def drive(self, on: bool, u_Nm: float) -> None:
        """The motor's command of a tick, which then passes."""
        self._set_Nm = u_Nm
        lib = self.drivers.lib
        lib.esea_escon_drive(self._motor, self._config, self.drivers.hardware, u_Nm, on)
        self.amplifier.enabled, self.amplifier.duty = self.bench.pins[1], self.bench.duties[1]
        self.amplifier.tick()

    def break_(self, where: str, kind: str) -> None:
        """One thing breaks, from now on."""
        if where == "current":
            self.amplifier.stuck_counts = CURRENT_FAULTS[kind]
        else:
            line = _LINES[where.removeprefix("encoder ")]
            (BUS_FAULTS | MAGNET_FAULTS)[kind](self, line)
