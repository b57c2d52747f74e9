"""A compiled q31 Block or task: numbers in units in and out, raw numbers where they are wanted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.emit.fixed.naming import FixedNaming
from esea_gen.emit.fixed.plan import FieldPlan
from esea_gen.emit.fixed.search import plan_block, raw_tunable
from esea_gen.hostlib.library import Array, CBoard, CRunner
from esea_gen.language.block import Port

if TYPE_CHECKING:
    from esea_gen.hostlib.library import HostLibrary

INVALID = -(2**31)
"""Raw number of what is not a number or does not fit: no port takes it as valid."""


def to_raw(values: Any, fraction: int) -> Array:
    """Raw numbers of values, as the macro ``ESEA_Q31_FROM`` gives them.

    return: ``int32``, rounded half away from zero; NaN and what does not fit is ``INT32_MIN``.
    """
    with np.errstate(all="ignore"):
        scaled = np.asarray(values, dtype=np.float64) * 2.0**fraction
        fits = (scaled < 2.0**31 - 1) & (scaled > -(2.0**31 - 1))
        rounded = np.trunc(np.where(fits, scaled, 0.0) + np.where(scaled < 0, -0.5, 0.5))
    return np.where(fits, rounded, float(INVALID)).astype(np.int64).astype(np.int32)


def from_raw(raw: Array, fraction: int) -> Array:
    """Values of raw numbers; exact."""
    return np.asarray(raw, dtype=np.float64) * 2.0**-fraction


@dataclass(frozen=True)
class Field:
    """A field of a q31 struct."""

    name: str
    c_name: str
    plan: FieldPlan

    @property
    def word(self) -> bool:
        """Whether it is a status word."""
        return bool(getattr(self.plan.port, "flags", ()))


class FixedRunner(CRunner):
    """A compiled q31 Block or task, driven in the ports' units or with raw numbers.

    inputs, outputs, state: its fields; the state empty for a task.
    """

    def __init__(
        self,
        library: HostLibrary,
        stem: str,
        prefix: str,
        tuned: bool,
        inputs: Sequence[Field],
        outputs: Sequence[Field],
        state: Sequence[Field],
    ) -> None:
        self.in_fields, self.out_fields, self.state_fields = inputs, outputs, state

        def ports(fields: Sequence[Field]) -> list[tuple[str, Port]]:
            return [(f.name, f.plan.port) for f in fields if isinstance(f.plan.port, Port)]

        super().__init__(
            library,
            stem,
            prefix,
            tuned,
            ports(inputs),
            ports(outputs),
            [p for _, p in ports(state)],
        )

    def raw_inputs(self, inputs: Mapping[str, Any]) -> dict[str, Array]:
        """Raw numbers of a stream in units."""
        return {f.name: to_raw(inputs[f.name], f.plan.fraction) for f in self.in_fields}

    def pack(self, inputs: Mapping[str, Any]) -> Array:
        """Arrange a stream as the C's input structs.

        inputs: one array per input: integers are raw numbers, floats are in units.
        """
        steps = len(np.atleast_1d(next(iter(inputs.values())))) if inputs else 0
        packed = np.zeros(steps, self._in_type)
        for f in self.in_fields:
            column = np.asarray(inputs[f.name])
            raw = column if column.dtype.kind in "iu" else to_raw(column, f.plan.fraction)
            packed[f.c_name] = raw
        return packed

    def run_raw(
        self, inputs: Mapping[str, Any], trace: bool = True
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run over a stream and give raw numbers."""
        packed = self.pack(inputs)
        out = np.zeros(len(packed), self._out_type)
        states = np.zeros(len(packed) if trace else 0, self._state_type)
        self._run(
            *self._coeffs,
            self._cast(f"{self.prefix}_state_t", self._state),
            self._cast(f"{self.stem}_in_t", packed),
            self._cast(f"{self.stem}_out_t", out),
            self._cast(f"{self.prefix}_state_t", states) if trace else self.library.ffi.NULL,
            len(packed),
        )
        known = {f.c_name: f.name for f in self.state_fields}
        names = self._state_type.names or ()
        return (
            {f.name: out[f.c_name] for f in self.out_fields},
            {known.get(n, n): states[n] for n in names} if trace else {},
        )

    def run(
        self, inputs: Mapping[str, Any], trace: bool = True
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run over a stream and give numbers in units."""
        outputs, states = self.run_raw(inputs, trace)
        for fields, values in ((self.out_fields, outputs), (self.state_fields, states)):
            for f in fields:
                if f.name in values and not f.word:
                    values[f.name] = from_raw(values[f.name], f.plan.fraction)
        return outputs, states

    def put_state(self, values: Mapping[str, Any]) -> None:
        """Overwrite part of the state.

        values: by state port, in units; integers are raw numbers; counters by their C names.
        """
        state = self.state
        known = {f.name: f for f in self.state_fields}
        for name, value in values.items():
            if name in known:
                column = np.asarray(value)
                raw = (
                    column
                    if column.dtype.kind in "iu"
                    else to_raw(column, known[name].plan.fraction)
                )
                place = state[known[name].c_name]
                place[...] = raw.reshape(place.shape[1:])
            else:
                state[name] = value
        self.state = state


def fixed_block(library: HostLibrary, name: str) -> FixedRunner:
    """A compiled q31 Block."""
    block = next(b for b in library.system.kinds if b.name == name)
    stem, fields = f"{library.prefix}_{name}", plan_block(block).fields
    groups = ([Field(f.port.name, f.name, f) for f in fields[g]] for g in ("in", "out", "state"))
    return FixedRunner(library, stem, stem, bool(block.coefficients), *groups)


def fixed_task(library: HostLibrary, name: str) -> FixedRunner:
    """A compiled q31 task."""
    system, prefix = library.system, library.prefix
    task, naming = system.task(name), FixedNaming(system)
    inputs, outputs = (
        [Field(x.name, naming.external(x), naming.external_field(x)) for x in group]
        for group in (system.task_inputs(task), system.task_outputs(task))
    )
    stem = f"{prefix}_{name}"
    return FixedRunner(library, stem, prefix, bool(system.tunables), inputs, outputs, ())


class FixedBoard(CBoard):
    """A System's compiled q31 C, called as firmware calls it: one state, shared by all tasks.

    tunables: ``{instance: {tunable: value}}`` other than the defaults, in units.
    """

    def __init__(
        self, library: HostLibrary, tunables: Mapping[str, Mapping[str, float]] | None = None
    ) -> None:
        blocks, self._naming = library.system.blocks, FixedNaming(library.system)
        raw = {
            instance: dict(raw_tunable(blocks[instance], k, v) for k, v in values.items())
            for instance, values in (tunables or {}).items()
        }
        super().__init__(library, raw)

    def step(self, task_name: str, **inputs: Any) -> dict[str, Any]:
        """One run of a task.

        **inputs: its external inputs, in units; NaN and what does not fit is invalid.
        return: its external outputs in units: float, int for a status word, ndarray for a vector.
        """
        task, naming = self.system.task(task_name), self._naming
        given = {}
        for x in self.system.task_inputs(task):
            raw = to_raw(inputs[x.name], naming.external_field(x).fraction)
            given[naming.external(x)] = raw.tolist()
        out = self._new(f"{task_name}_out")
        values = self._new(f"{task_name}_in", given)
        self._call(f"{task_name}_step", *self._coeffs, self._state, values, out)
        found: dict[str, Any] = {}
        for x in self.system.task_outputs(task):
            value = getattr(out, naming.external(x))
            if x.port.flags:
                found[x.name] = int(value)
                continue
            lsb = naming.external_field(x).lsb
            found[x.name] = value * lsb if x.port.size == 1 else lsb * np.array(list(value))
        return found


__all__ = [
    "INVALID",
    "Field",
    "FixedBoard",
    "FixedRunner",
    "fixed_block",
    "fixed_task",
    "from_raw",
    "to_raw",
]
