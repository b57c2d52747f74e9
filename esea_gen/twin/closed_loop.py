"""A controller's generated C in closed loop with the virtual exoskeleton's, in one C loop.

The controller is the C that ships, in its own number format, q31 included; the plant is emitted
in double precision.  Encoders, tasks, latches and the plant's steps run in C, tick by tick; Python
hands arrays in and gets arrays back.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.compiler import compile_sources, declared
from esea_gen.language.ports import Port
from esea_gen.language.system import External, System
from esea_gen.model.sensing import of_axis, zeros_missing
from esea_gen.twin.encoders import ENCODERS
from esea_gen.twin.faults import BITS, KINDS, EncoderFault
from esea_gen.twin.hand_plant import grouped, prepared, twin_system
from esea_gen.twin.loop_run import Array, ClosedLoopRun, RanAwayError
from esea_gen.twin.people import PlantVariant
from esea_gen.twin.plant import start_state

COMMAND = "u_Nm"
PATH = ("theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2", "noise")
MUSCLE = "tau_muscle_Nm"  # of a hand beside its pull to the path
STATE_REPAIRED = 2
FAULT_KINDS = ("none", *KINDS)


@dataclass(frozen=True)
class _Column:
    name: str
    size: int
    owner: str
    whole: bool


def _elements(x: External, name: str) -> list[str]:
    return [name] if x.port.size == 1 else [f"{name}[{i}]" for i in range(x.port.size)]


def _skipped(missed: npt.ArrayLike | None, delay_ticks: int, ticks: int) -> Array:
    skipped = np.zeros(ticks, np.uint8) if missed is None else np.array(missed, dtype=np.uint8)
    if delay_ticks < 0 or skipped.shape != (ticks,):
        raise UserError(
            f"delay_ticks is {delay_ticks} and missed has shape {skipped.shape} for {ticks} ticks.",
            "Give a delay from 0, and one value a tick.",
        )
    return skipped


class ClosedLoop:
    """A controller System and a plant, compiled together.

    Parameters
    ----------
    controller : System
        Its external output ``u_Nm`` is the motor command, of several axes one each
        (``u_flexion_Nm``).  Each of its external inputs is an output
        of the plant of the same name (``count_motor``, ``count_load``, ``count_gear``, true values
        such as ``tau_e_Nm``), or else a signal that every run is given.
    plant : PlantVariant
        The plant; its numbers can be changed at every run, only a cable cannot be added or taken.
    real : str
        Number format of the controller.
    """

    def __init__(self, controller: System, plant: PlantVariant, real: str = "f32") -> None:
        if real not in FORMATS:
            raise UserError(
                f"A closed loop has no number format '{real}'.",
                f"Choose from {', '.join(FORMATS)}.",
            )
        self.controller, self.variant, self.real = controller, plant, real
        self.tick_s = controller.base_period_s
        self.axes = plant.device.axes
        self.intent = tuple(
            of_axis(n, a) for a in self.axes for n in (*PATH, *([MUSCLE] if a else []))
        )
        self.plant = twin_system(plant.device, plant.cable, plant.step_s, self.tick_s)
        if controller.name == self.plant.name:
            raise UserError(f"A controller cannot be named '{controller.name}'.", "Rename it.")
        self._check_command()
        self._control = Renderer(controller, FORMATS[real], "-", "-", controller.name)
        self._columns = self._record_columns()
        self._feeds, self.signals = self._wire()
        self._compile()

    # -- wiring ----------------------------------------------------------------------------------

    def _check_command(self) -> None:
        scalars = {x.name for x in self.controller.outputs if x.port.size == 1}
        self.commands = [of_axis(COMMAND, a) for a in self.axes]
        missing = [n for n in self.commands if n not in scalars]
        if missing:
            raise UserError(
                f"The controller {self.controller.name} has no scalar output {missing[0]}: the "
                f"virtual exoskeleton has a motor for each of {self.commands}.",
                f"Name the motor command {missing[0]}, or give a device with the same axes.",
            )

    def _plant_sources(self) -> dict[str, tuple[str, Port]]:
        move, encode = self.plant.task("move"), self.plant.task("encode")
        return {
            x.name: (f"{struct}.{x.name}", x.port)
            for task, struct in ((move, "plant"), (encode, "counts"))
            for x in self.plant.task_outputs(task)
        }

    def _record_columns(self) -> list[tuple[_Column, list[str]]]:
        columns = []
        for name, (source, port) in self._plant_sources().items():
            columns.append((_Column(name, 1, "plant", port.whole), [source]))
        for task in self.controller.tasks:
            for x in self.controller.task_outputs(task):
                column = _Column(x.name, x.port.size, "controller", x.port.whole)
                columns.append((column, self._read(task.name, x)))
        return columns

    def _read(self, task: str, x: External) -> list[str]:
        # C expressions of an output's elements, in its unit.
        naming = self._control.naming
        places = [f"{task}_out.{e}" for e in _elements(x, x.name)]
        return [naming.to_units(x, p) for p in places]

    def _wire(self) -> tuple[dict[str, list[tuple[str, str]]], dict[str, int]]:
        sources, given = self._plant_sources(), self._control.naming.from_units
        feeds: dict[str, list[tuple[str, str]]] = {}
        signals: dict[str, int] = {}
        places: dict[str, int] = {}  # first column of a signal, which several tasks may read
        for task in self.controller.tasks:
            feeds[task.name] = []
            for x in self.controller.task_inputs(task):
                if x.name in sources:
                    if x.port.size != 1:
                        raise UserError(
                            f"Input {x.name} of {self.controller.name} has {x.port.size} elements, "
                            "the plant's output of that name one.",
                            "Rename it.",
                        )
                    feeds[task.name].append((x.name, given(x, sources[x.name][0])))
                    continue
                place = places.setdefault(x.name, sum(signals.values()))
                signals[x.name] = x.port.size
                for i, e in enumerate(_elements(x, x.name)):
                    feeds[task.name].append((e, given(x, f"signals[{place + i}]")))
        return feeds, signals

    def _compile(self) -> None:
        control = self._control
        plant = self._plant = Renderer(self.plant, FORMATS["f64"], "-", "-", "Virtual exoskeleton")
        files = {n: t for n, t in control.files().items() if not n.startswith("reference/")}
        parts = {}
        for name, text in plant.files().items():
            if name.startswith("reference/") or name == "main.c":
                continue
            # Included by the loop, not compiled alone.
            parts[f"{name}.inc" if name.endswith(".c") else name] = text
        sources = [s for _, group in self._columns for s in group]
        commands = {
            x.name: sources.index(self._read(t.name, x)[0])
            for t in self.controller.tasks
            for x in self.controller.task_outputs(t)
            if x.name in self.commands
        }
        self._width = len(sources)
        loop = plant.render(
            "hostlib/closed_loop.c.j2",
            controller=self.controller,
            controller_prefix=control.prefix,
            controller_header=control.fmt.header,
            plant_files=[n for n in parts if n.endswith(".inc")],
            encoders=self._encoders(),
            fault_kinds=FAULT_KINDS,
            encode_inputs=[x.name for x in self.plant.task_inputs(self.plant.task("encode"))],
            feeds=self._feeds,
            signals=[
                n if size == 1 else f"{n}[{i}]"
                for n, size in self.signals.items()
                for i in range(size)
            ],
            recorded=sources,
            columns=self._width,
            axes=[
                {n: of_axis(n, a) for n in (COMMAND, *PATH[:3])}
                | {
                    "command": commands[of_axis(COMMAND, a)],
                    "path": i * len(self.intent) // len(self.axes),
                }
                for i, a in enumerate(self.axes)
            ],
            path=self.intent,
            given=[
                (i, n)
                for i, n in enumerate(self.intent)
                if not n.startswith(("theta_p", "omega_p"))
            ],
            substeps=round(self.tick_s / self.variant.step_s),
            step_s=plant.fmt.literal(self.variant.step_s),
            tick_s=plant.fmt.literal(self.tick_s),
        )
        self.files = files | parts | {"closed_loop.c": loop}
        self.path = compile_sources(self.files, link=("-lm",))
        text = loop[loop.index("typedef struct {\n    unsigned kind") :]
        prototype = re.sub(r"\)\s*\n\{.*?\n\}", ");", text, flags=re.DOTALL)
        headers = files[f"{control.prefix}.h"] + parts[f"{plant.prefix}.h"]
        self.ffi = declared(headers + prototype)
        self._lib: Any = self.ffi.dlopen(str(self.path))

    def _encoders(self) -> list[tuple[str, str, str, str]]:
        # Count, angle, counts of a turn and counts per radian of the joint.
        actuator = self.variant.device.file.actuator
        assert actuator is not None
        literal = FORMATS["f64"].literal
        full = {x.name: x.port.high + 1 for x in self.plant.task_outputs(self.plant.task("encode"))}
        found = []
        for axis in self.axes:
            for side, angle in ENCODERS.items():
                count = of_axis(f"count_{side}", axis)
                turns = actuator.gear_ratio.value if side == "gear" else 1.0
                a_radian = full[count] * turns / (2 * math.pi)
                found.append((count, of_axis(angle, axis), literal(full[count]), literal(a_radian)))
        return found

    # -- running ---------------------------------------------------------------------------------

    def _prepared(self, of: Renderer, values: Mapping[str, Mapping[str, float]]) -> tuple[Any, ...]:
        if of.system.tunables:
            return (prepared(self.ffi, lambda name: getattr(self._lib, name), of, values),)
        if values:
            raise UserError(f"{of.system.name} has no tunables.", "Give none.")
        return ()

    def _table(self, signals: Mapping[str, Any], ticks: int) -> Array:
        columns = []
        for name, size in self.signals.items():
            a = np.asarray(signals[name], dtype=float)
            shape = (ticks,) if size == 1 else (ticks, size)
            if a.shape != shape:
                raise UserError(
                    f"Signal {name} has shape {a.shape}, not {shape}.",
                    "Give one row for each tick, as long as the other signals.",
                )
            columns.append(a.reshape(ticks, size))
        return np.ascontiguousarray(np.hstack(columns)) if columns else np.zeros((ticks, 0))

    def _path(
        self, signals: Mapping[str, Any], ticks: int, held_rad: list[float], seed: int
    ) -> Array:
        path = np.zeros((ticks, len(self.intent)))
        for i, axis in enumerate(self.axes):
            path[:, self.intent.index(of_axis("theta_p_rad", axis))] = held_rad[i]
            stream = np.random.default_rng([seed, 3, i] if i else [seed, 3])
            path[:, self.intent.index(of_axis("noise", axis))] = stream.standard_normal(ticks)
        for i, name in enumerate(self.intent):
            if name in signals:
                a = np.asarray(signals[name], dtype=float)
                if a.shape != (ticks,) or not np.all(np.isfinite(a)):
                    raise UserError(
                        f"Signal {name} must be {ticks} finite numbers, one a tick; it has shape "
                        f"{a.shape} and {np.count_nonzero(~np.isfinite(a))} that are not finite.",
                        "Give one number for each tick.",
                    )
                path[:, i] = a
        return path

    def _ticks(self, signals: Mapping[str, Any], ticks: int | None) -> int:
        missing = [n for n in self.signals if n not in signals]
        if missing:
            raise UserError(
                f"The controller's input {missing[0]} is neither an output of the plant nor among "
                "the signals.",
                f"Give it as a signal; the plant has {', '.join(self._plant_sources())}.",
            )
        allowed = [*self.signals, *self.intent]
        unknown = [n for n in signals if n not in allowed]
        if unknown:
            raise UserError(
                f"Signal {unknown[0]} feeds nothing.", f"Signals are: {', '.join(allowed)}."
            )
        if ticks is None:
            if not signals:
                raise UserError("Neither signals nor ticks are given.", "Give ticks.")
            ticks = len(next(iter(signals.values())))
        if not 1 <= ticks < 2**32:
            raise UserError(f"A run cannot have {ticks} ticks.", "Give 1 to 2**32 - 1.")
        return ticks

    def run(
        self,
        signals: Mapping[str, Any],
        plant_tunables: Mapping[str, float] | None = None,
        controller_tunables: Mapping[str, Mapping[str, float]] | None = None,
        seed: int = 0,
        ticks: int | None = None,
        fault: EncoderFault | None = None,
        axis: str = "",
        delay_ticks: int = 0,
        missed: npt.ArrayLike | None = None,
    ) -> ClosedLoopRun:
        """Run from rest.

        Parameters
        ----------
        signals : mapping of str to array
            One row a tick: the controller's inputs that the plant does not give, and the person's
            path (``theta_p_rad``, ``omega_p_rad_s``, ``alpha_p_rad_s2``; without it the person
            stays where the load starts).  ``noise`` replaces the white numbers of the seed.  Of a
            hand each has its axis in its name, and there is ``tau_muscle_..._Nm``.
        plant_tunables : mapping of str to float, optional
            In place of the variant's, by tunable.
        controller_tunables : mapping, optional
            ``{instance: {tunable: value}}`` other than the defaults.
        seed : int
            Of the person's torque noise, and of an encoder's.
        ticks : int, optional
            Length, when there is no signal to tell it.
        fault : EncoderFault, optional
            Of the encoders of an axis.
        axis : str, optional
            Whose encoders fail; default: the first.
        delay_ticks : int
            For how many ticks a command is under way to the motor.
        missed : array_like of bool, optional
            One value a tick: where true, the controller's last task is due, but does not run.

        Raises
        ------
        UserError
            For a signal or tunable that is missing, unknown or out of range.
        RanAwayError
            When the plant left its ranges and was started afresh: the run means nothing then.
        """
        n = self._ticks(signals, ticks)
        values = {**self.variant.values, **(plant_tunables or {})}
        first, sampled = self._start(signals)
        table = self._table(signals, n)
        skipped = _skipped(missed, delay_ticks, n)
        held_rad = [first[of_axis("theta_rad", a)][-1] for a in self.axes]
        path = self._path(signals, n, held_rad, seed)

        # Encoders that no calibration has zeroed: their zeros are this plant's.
        settings = {**zeros_missing(self.controller), **(controller_tunables or {})}
        coeffs = self._prepared(self._control, settings)
        plant_coeffs = self._prepared(self._plant, grouped(self.plant, values))
        state = self.ffi.new(f"{self._control.prefix}_state_t *")
        plant_state = self.ffi.new(f"{self._plant.prefix}_state_t *")
        start = self.ffi.new(f"{self._plant.prefix}_move_out_t *")
        getattr(self._lib, self._control.init_name)(*coeffs, state)
        getattr(self._lib, self._plant.init_name)(*plant_coeffs, plant_state)
        for key, vector in first.items():
            getattr(plant_state.plant, key)[0 : len(vector)] = vector
        for key, value in sampled.items():
            setattr(start, key, value)

        record = np.empty((n, self._width))
        pointer = [self.ffi.cast("double *", a.ctypes.data) for a in (table, path, record)]
        off = n, delay_ticks, self.ffi.cast("unsigned char *", skipped.ctypes.data)
        of_plant = *plant_coeffs, plant_state, start, self._fault(fault, axis, seed)
        lost = self._lib.esea_loop_run(*coeffs, state, *of_plant, *pointer, *off)
        return dataclasses.replace(self._result(record), missed_runs=int(lost))

    def _start(self, signals: Mapping[str, Any]) -> tuple[dict[str, list[float]], dict[str, float]]:
        # State of the plant, and what it shows before its first step.
        first: dict[str, list[float]] = {}
        sampled: dict[str, float] = {}
        for axis in self.axes:
            at_rad = float(np.asarray(signals.get(of_axis("theta_p_rad", axis), (0.0,)))[0])
            state, shown = start_state(self.plant.blocks["plant"], at_rad, axis)
            first |= state
            sampled |= shown
        return first, sampled

    def _fault(self, fault: EncoderFault | None, axis: str, seed: int) -> Any:
        wrong = self.ffi.new("esea_loop_fault_t *")
        if fault is not None:
            wrong.kind = FAULT_KINDS.index(fault.kind)
            wrong.start = round(fault.at_s / self.tick_s)
            wrong.amount = fault.amount
            wrong.seed = (seed + 1) % 2**32
            first = len(fault.sides) * (self.axes.index(axis) if axis else 0)
            wrong.sides[first : first + len(fault.sides)] = fault.sides
            for on, (count, _, full, _) in zip(wrong.sides, self._encoders(), strict=True):
                if on and fault.kind in BITS and 2**fault.amount >= float(full):
                    bits = f"{math.log2(float(full)):g} bits"
                    raise UserError(f"{fault}: {count} has {bits}.", "Give a lower one, from 0 on.")
        return wrong

    def _result(self, record: Array) -> ClosedLoopRun:
        found: dict[str, dict[str, Array]] = {"plant": {}, "controller": {}}
        place = 0
        for column, group in self._columns:
            a = record[:, place] if column.size == 1 else record[:, place : place + column.size]
            found[column.owner][column.name] = a.astype(np.uint32) if column.whole else a
            place += len(group)
        status = found["plant"]["plant_status"]
        repaired = np.flatnonzero(status & STATE_REPAIRED)
        if len(repaired):
            raise RanAwayError(
                f"the plant left its ranges before {repaired[0] * self.tick_s:g} s and was started "
                "afresh: its tunables make it stiffer than its step allows"
            )
        time_s, ticks = np.arange(len(record)) * self.tick_s, dict[str, int]()
        for x in self.controller.outputs:
            for k, flag in enumerate(x.port.flags):
                if flag.name == "STATE_REPAIRED":
                    bit = found["controller"][x.name] >> k & 1
                    ticks |= {x.name.removesuffix("_status"): int(bit.sum())} if bit.any() else {}
        return ClosedLoopRun(found["plant"], found["controller"], time_s, repaired=ticks)
