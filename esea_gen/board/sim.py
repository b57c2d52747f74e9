"""The firmware's application as a board inside this process: clocked tick by tick, no hardware."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Collection, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import cffi

from esea_gen.board.blackbox import BlackboxRecord, read_record, record_bytes
from esea_gen.board.firmware import build_firmware
from esea_gen.device import Device
from esea_gen.emit.dialect import load_dialect
from esea_gen.emit.roles import board_roles, sensing_tasks
from esea_gen.emit.states import EVENTS, GUARDS, STATES
from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError, Transport
from esea_gen.targets import firmware_folder

_LINE_BYTES = 1 << 16


class SimTransport(Transport):
    """A serial line to a board in this process; it never waits, for nothing comes by itself."""

    def __init__(self, lib: Any, ffi: cffi.FFI) -> None:
        self._lib, self._ffi = lib, ffi
        self._bytes = ffi.new(f"uint8_t[{_LINE_BYTES}]")

    def read(self, timeout_s: float) -> bytes:
        """See :class:`esea_gen.link.transport.Transport`."""
        self._lib.sim_poll()
        count = self._lib.sim_take(self._bytes, _LINE_BYTES)
        if count == 0 and timeout_s > 0:
            raise LinkError("the board says nothing more until its clock is moved")
        return bytes(self._ffi.buffer(self._bytes, count))

    def write(self, data: bytes, timeout_s: float) -> None:
        """See :class:`esea_gen.link.transport.Transport`."""
        self._lib.sim_feed(data, len(data))
        self._lib.sim_poll()

    def close(self) -> None:
        """Nothing to let go of."""


@lru_cache(maxsize=4)
def _built(
    device: Device, board: str, control: Mapping[str, str] | None = None, drivers: str | None = None
) -> tuple[bytes, Any]:
    # The library, and what its messages are.
    with tempfile.TemporaryDirectory(prefix="esea-sim-") as folder:
        image = build_firmware(device, board, Path(folder), control, drivers)
        return image.elf.read_bytes(), load_dialect(device)


class SimBoard(Session):
    """A board in this process, powered on."""

    def __init__(
        self,
        device: Device,
        control: Mapping[str, str] | None = None,
        board: str = "sim",
        drivers: str | None = None,
    ) -> None:
        self.device = device
        self._ffi = cffi.FFI()
        source = (firmware_folder() / "boards" / "sim" / "board.c").read_text(encoding="utf-8")
        self._ffi.cdef(
            "".join(re.findall(r"^\w[\w *]*\bsim_\w+\([^)]*\);\n", source, re.MULTILINE))
        )
        build = _built if control is None else _built.__wrapped__
        built, dialect = build(device, board, control, drivers)
        with tempfile.TemporaryDirectory(prefix="esea-sim-") as folder:
            own = Path(folder) / "board.so"  # a file of its own, for memory of its own
            own.write_bytes(built)
            self.lib: Any = self._ffi.dlopen(str(own))
        roles = board_roles(device.system)
        self.inputs = [x.name for x in roles.measured]
        self._axes = range(len(roles.axes))
        self.drivers = self._ffi.new("float[]", max(1, len(self.inputs)))
        self._answer = self._ffi.new("uint8_t[]", 512)
        self._encoders = [k for k, n in enumerate(self.inputs) if n.startswith("count_")]
        system, size = device.system, 0
        self.places: dict[str, int] = {}
        for task in sensing_tasks(system):
            for x in (*system.task_inputs(task), *system.task_outputs(task)):
                self.places[x.name] = size
                size += x.port.size
        self.words = self._ffi.new("uint32_t[]", size)
        self.values = self._ffi.cast("float *", self.words)
        super().__init__(SimTransport(self.lib, self._ffi), dialect, 1.0)
        self.clock_s = lambda: float(self.lib.sim_time_ms()) * 1e-3
        self.lib.sim_start()

    def close(self) -> None:
        """Let go of the library."""
        self._ffi.dlclose(self.lib)

    @property
    def flash(self) -> list[Any]:
        """Non-volatile memory: the bytes of both areas, to read and to corrupt."""
        size = int(self.lib.sim_flash_bytes())
        return [self._ffi.buffer(self.lib.sim_flash(k), size) for k in range(2)]

    def restart(self, *, blank: bool = False) -> None:
        """Power off and on."""
        for area in self.flash if blank else ():
            area[:] = b"\xff" * len(area)
        self._ffi.buffer(self.drivers)[:] = bytes(self._ffi.sizeof(self.drivers))
        self.lib.sim_start()
        self._board_time = None
        self.pending()

    @property
    def guests(self) -> int:
        """How many who come beside the host can be heard at a time."""
        return int(self.lib.sim_guests())

    def greet(self, guest: int, commander: str) -> bytes:
        """Connect a second client; return the board's answer."""
        count = self.lib.sim_greet(guest, commander.encode("ascii"), self._answer)
        return bytes(self._ffi.buffer(self._answer, count))

    def overhear(self, guest: int, data: bytes, last: bool) -> bytes:
        """Bytes of somebody beside the host, of which a stop is taken; the board's answer."""
        count = self.lib.sim_overhear(guest, data, len(data), last, self._answer)
        return bytes(self._ffi.buffer(self._answer, count))

    def measure(self, **values: float) -> None:
        """Set the drivers' readings from now on; omitted inputs are 0."""
        unknown = set(values) - set(self.inputs)
        if unknown:
            raise ValueError(f"{sorted(unknown)} is not measured; there is {self.inputs}")
        self.drivers[0 : len(self.inputs)] = [values.get(n, 0.0) for n in self.inputs]
        self.lib.sim_measure(self.drivers)

    def show(self, counts: Iterable[float]) -> None:
        """Have the drivers read these encoders, in the order of ``inputs``."""
        for place, count in zip(self._encoders, counts, strict=False):
            self.drivers[place] = count

    def step(self) -> None:
        """A base tick with all that belongs to it, at which ``drivers`` is measured."""
        self.lib.sim_step(self.drivers, self.words)

    def ticks(self, count: int = 1, *, poll: bool = True) -> None:
        """Let so many base ticks pass."""
        for _ in range(count):
            self.lib.sim_tick(1, True)
            if poll:
                self.lib.sim_poll()

    def trouble(self, fault: int) -> None:
        """Set a driver fault, a number of the board's faults; reported at the next tick."""
        self.lib.sim_trouble(fault)

    def blackbox(self) -> list[BlackboxRecord]:
        """Content of a frozen black box, the oldest first, without corrupt records."""
        size = record_bytes(self.device)
        into = self._ffi.new("uint8_t[]", size)
        return [
            read_record(self.device, bytes(self._ffi.buffer(into, size)))
            for k in range(self.lib.sim_blackbox_count())
            if self.lib.sim_blackbox_read(k, into)
        ]

    @property
    def state_now(self) -> str:
        """The state, looked up in its memory."""
        return _STATE_NAMES.get(self.lib.sim_state(), "")

    @property
    def motor_on(self) -> bool:
        """Whether the motors are on, which they are only together."""
        return bool(self.lib.sim_motor_on())

    @property
    def motors_Nm(self) -> tuple[float, ...]:
        """Torque of each motor, in the order of the axes; empty without motors."""
        return tuple(map(self.lib.sim_motor_Nm, self._axes))

    @property
    def motor(self) -> tuple[bool, float]:
        """Whether the only motor is on, and its torque in Nm."""
        (u_Nm,) = self.motors_Nm
        return self.motor_on, u_Nm

    def follow(self, state: str, event: str, holds: Collection[str]) -> tuple[str, bool]:
        """The transition function alone: where it leads, and whether the event was taken."""
        held = self._ffi.new("uint32_t *", _STATES[state])
        guards = self._ffi.new("bool[]", [g.name in holds for g in GUARDS])
        taken = self.lib.sim_take_event(held, _EVENTS[event], guards)
        return _STATE_NAMES[held[0]], bool(taken)


_STATES = {s.name: s.value for s in STATES}
_STATE_NAMES = {s.value: s.name for s in STATES}
_EVENTS = {e.name: e.value for e in EVENTS}
