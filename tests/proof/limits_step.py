"""One step of the emitted limits as formulas, by the names of ports."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.language.block import Block

from .emitted_c import Reader
from .limits_numbers import Number, of_field, snapped
from .smt import TRUE, Script, every, negated, some

Change = Callable[[str, str], str]
"""``change(file name, text) -> text``: a deliberate fault."""

GROUPS = {"coeffs": "coefficients", "state": "state", "in": "inputs", "out": "outputs"}


# Control periods without a new stamp that are a fault, as docs/limits-integrity.md states it.
SILENT_PERIODS = 5


@dataclass(frozen=True)
class Compiled:
    """The largest of everything, as the device file has it."""

    u_max_Nm: Fraction
    u_step_Nm: Fraction
    tau_max_Nm: Fraction
    theta_max_rad: Fraction
    omega_max_rad_s: Fraction
    rom_min_rad: Fraction
    rom_max_rad: Fraction
    rom_margin_rad: Fraction
    energy_J: Fraction
    stale_ticks: int


def compiled(device: Device) -> Compiled:
    """Read from the device file, not from the Block."""
    file = device.file
    if file.safety is None or file.timing.control_rate_Hz is None:
        raise UserError(f"{device.name} has no limits before the motor.", "Give it [safety].")

    def number(name: str) -> Fraction:
        return Fraction(str(getattr(file.safety, name).value))

    sense = Fraction(str(file.timing.sense_rate_Hz.value))
    control = Fraction(str(file.timing.control_rate_Hz.value))
    return Compiled(
        number("u_max_Nm"),
        snapped(number("u_rate_Nm_s") / sense),
        number("tau_max_Nm"),
        number("theta_max_rad"),
        number("omega_max_rad_s"),
        number("rom_min_rad"),
        number("rom_max_rad"),
        number("rom_margin_rad"),
        number("energy_J"),
        round(SILENT_PERIODS * sense / control),
    )


class LimitsC:
    """The emitted files of a device in one format, with the Block of its limits."""

    def __init__(self, device: Device, real: str, change: Change | None = None) -> None:
        self.device, self.real, self.limit = device, real, compiled(device)
        self.block: Block = next(b for b in device.system.kinds if b.name == "limits")
        self.renderer = Renderer(
            device.system, FORMATS[real], format_hash(device, real), "-", device.title
        )
        self.files = {
            name: change(name, text) if change else text
            for name, text in self.renderer.files().items()
        }

    def function(self, verb: str) -> str:
        """Name of one of the Block's functions."""
        return f"{self.renderer.prefix}_{self.block.name}_{verb}"

    def reader(self, script: Script, free: str) -> Reader:
        """The Block's file, read."""
        with tempfile.TemporaryDirectory() as scratch:
            for name, text in self.files.items():
                (Path(scratch) / name).write_text(text, encoding="utf-8")
            return Reader(Path(scratch) / f"{self.function('step')[:-5]}.c", script, free)


class Step:
    """What one step computes from any input, any state and any coefficients."""

    def __init__(self, c: LimitsC, free: str = "") -> None:
        self.c, self.block, self.limit = c, c.block, c.limit
        self.script = Script()
        self.reader = c.reader(self.script, free)
        self.memory = self.reader.call(c.function("step"), frozenset({"coeffs", "state", "in"}))
        self.written = self.reader.terms(self.memory)

    def _port(self, group: str, name: str) -> Any:
        return next(p for p in getattr(self.block, GROUPS[group]) if p.name == name)

    def _place(self, group: str, name: str, index: int | None) -> str:
        at = "" if self._port(group, name).size == 1 else f"[{index or 0}]"
        return f"{group}.{name}{at}"

    def _number(self, group: str, name: str, index: int | None, term: str | None) -> Number:
        place = self._place(group, name, index)
        kind = self.reader.fields[place]
        unsigned = self._port(group, name).kind != "quantity"
        fraction = 0 if unsigned else self.c.renderer.naming.fraction(self.block, group, name)
        return of_field(term or self.script.unknown(place, kind.sort), fraction, unsigned)

    def coef(self, name: str) -> Number:
        """A coefficient."""
        return self._number("coeffs", name, None, None)

    def given(self, name: str) -> Number:
        """An input."""
        return self._number("in", name, None, None)

    def before(self, name: str, index: int | None = None) -> Number:
        """A state before the step."""
        return self._number("state", name, index, None)

    def after(self, name: str, index: int | None = None) -> Number:
        """A state after the step."""
        return self._number(
            "state", name, index, self.written.get(self._place("state", name, index))
        )

    def out(self, name: str) -> Number:
        """An output; it must have been written."""
        return self._number("out", name, None, self.written[self._place("out", name, None)])

    def flag(self, name: str) -> str:
        """Whether a bit of the status word is set."""
        at = [f.name for f in self._port("out", "status").flags].index(name)
        status = self.written[self._place("out", "status", None)]
        return f"(= ((_ extract {at} {at}) {status}) #b1)"

    @cached_property
    def counters(self) -> list[tuple[str, str]]:
        """The counters, before and after."""
        flags = [f for f in self._port("out", "status").flags if f.counted]
        places = [f"state.n_{f.name.lower()}" for f in flags]
        return [(self.script.unknown(p, "(_ BitVec 32)"), self.written[p]) for p in places]

    @cached_property
    def initial(self) -> list[tuple[Number, Number]]:
        """Each state before the step, and what ``init`` writes there."""
        made = self.reader.call(self.c.function("init"), frozenset({"coeffs"}))
        written = self.reader.terms(made)
        return [
            (
                self.before(p.name, i),
                self._number("state", p.name, i, written[self._place("state", p.name, i)]),
            )
            for p in self.block.state
            for i in range(p.size)
        ]

    # What the properties speak of.

    @property
    def latched(self) -> str:
        """The step leaves the latch closed, says so, and gives a reason."""
        return every(
            self.after("key").equals(0),
            self.after("fault_stored") >= 1,
            self.out("fault") >= 1,
            self.flag("FAULT_LATCHED"),
        )

    @property
    def cut(self) -> str:
        """No torque, and the latch is closed, in this very step."""
        return every(self.out("u_Nm").equals(0), self.after("u_last_Nm").equals(0), self.latched)

    @property
    def runs(self) -> str:
        """The step leaves the latch open."""
        return self.after("key").differs(0)

    @property
    def change(self) -> Number:
        """The largest change of the command: the narrowed one, at most the compiled."""
        step = self.coef("u_step_Nm")
        return step.least(step.constant(self.limit.u_step_Nm))

    @property
    def cases(self) -> list[str]:
        """What a question is split by, for speed alone: the kernel's own word for an open latch."""
        run = self.memory.get(f"{self.c.function('step')}.run")
        if run is None:
            return [TRUE]
        truth = self.reader.truth(run)
        return [truth, negated(truth)]

    def beyond(self, name: str, most: Fraction) -> str:
        """The magnitude of an input is above a limit."""
        x = self.given(name)
        return some(x > most, x < -most)

    def above(self, x: Number, y: Number) -> str:
        """A magnitude is above a number."""
        return some(x > y, x < -y)
