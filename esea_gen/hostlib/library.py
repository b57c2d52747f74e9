"""Compile a rendered System for the host, load it, and run its Blocks, tasks and boards.

cffi works in ABI mode: no Python headers are needed, and its declarations are read from the emitted
header by the C preprocessor, never typed again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.codec import Array, Field, block_field, external_field, struct_dtype
from esea_gen.hostlib.compiler import compile_sources, declared
from esea_gen.language.block import Block
from esea_gen.language.system import System, SystemSimulator, Task


class HostLibrary:
    """A System's generated C, compiled for the host; ``flags`` beside the project's own."""

    def __init__(self, system: System, renderer: Renderer, flags: Sequence[str] = ()) -> None:
        self.system = system
        self.real = renderer.fmt.name
        self.prefix = renderer.prefix
        self.naming = renderer.naming
        self.files = renderer.files()
        driver = renderer.render("hostlib/driver.c.j2")
        own = {n: t for n, t in self.files.items() if not n.startswith("reference/")}
        self.sources = own | {"driver.c": driver}
        self.link = ("-lm",) if renderer.fmt.needs_libm else ()
        self.path = compile_sources(self.sources, flags, self.link)
        # The driver's loops are declared by their own text: bodies are cut at the first brace.
        prototypes = re.sub(r"\)\s*\n\{.*?\n\}", ");", driver, flags=re.DOTALL)
        self.ffi = declared(self.files[f"{self.prefix}.h"] + prototypes)
        self.lib: Any = self.ffi.dlopen(str(self.path))
        self._init = renderer.init_name

    def function(self, name: str) -> Any:
        """A function of the C by the name that its header gives it."""
        return getattr(self.lib, self._init if name == f"{self.prefix}_init" else name)

    def dtype(self, c_type: str) -> np.dtype[Any]:
        """numpy type of a C struct, field for field."""
        return struct_dtype(self.ffi, c_type)

    def board(self, tunables: Mapping[str, Mapping[str, float]] | None = None) -> CBoard:
        """The System as firmware runs it, all tasks on one state.

        tunables: ``{instance: {tunable: value}}`` other than the defaults.
        """
        return CBoard(self, tunables)

    def block(self, name: str) -> CRunner:
        block: Block = next(b for b in self.system.kinds if b.name == name)
        groups = ("in", block.inputs), ("out", block.outputs), ("state", block.state)
        fields = ([block_field(self.naming, block, g, p) for p in ports] for g, ports in groups)
        return CRunner(self, name, block, *fields)

    def task(self, name: str) -> CRunner:
        return CRunner(self, name, self.system, *self.fields(self.system.task(name)), ())

    def fields(self, task: Task) -> tuple[list[Field], list[Field]]:
        """Fields of a task's input and output structs."""
        groups = self.system.task_inputs(task), self.system.task_outputs(task)
        inputs, outputs = ([external_field(self.naming, x) for x in group] for group in groups)
        return inputs, outputs


def compile_system(system: System, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a System that need not belong to a device."""
    return HostLibrary(system, Renderer(system, FORMATS[real], "-", "-", system.name), flags)


def block_system(block: Block) -> System:
    """A System of one Block, every port an external one."""
    name = block.name
    return System(
        f"{name}_alone",
        block.period_s,
        {name: block},
        (Task("run", (name,)),),
        {},
        {p.name: (f"{name}.{p.name}",) for p in block.inputs},
        {p.name: f"{name}.{p.name}" for p in block.outputs},
    )


def compile_block(block: Block, real: str = "f64") -> CRunner:
    """Render and compile a Block by itself."""
    return compile_system(block_system(block), real).block(block.name)


def compile_device(device: Device, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a device's C, the bytes that ``esea-gen build`` writes."""
    digest = format_hash(device, real)
    renderer = Renderer(device.system, FORMATS[real], digest, "-", device.title)
    return HostLibrary(device.system, renderer, flags)


class CRunner:
    """A compiled Block or task: steps and runs like its symbolic counterpart.

    owner: whose params, coefficients and state it has, the Block's own, or the System's for a task.
    """

    def __init__(
        self,
        library: HostLibrary,
        name: str,
        owner: Block | System,
        inputs: Sequence[Field],
        outputs: Sequence[Field],
        state: Sequence[Field],
    ) -> None:
        ffi = library.ffi
        self.library, self.owner, self.stem = library, owner, f"{library.prefix}_{name}"
        self.inputs, self.outputs, self.state_fields = inputs, outputs, state
        self.prefix = library.prefix if isinstance(owner, System) else self.stem
        self._run = getattr(library.lib, f"{self.stem}_run")
        self._init = library.function(f"{self.prefix}_init")
        self._in_type = library.dtype(f"{self.stem}_in_t")
        self._out_type = library.dtype(f"{self.stem}_out_t")
        self._state_type = library.dtype(f"{self.prefix}_state_t")
        self._state = np.zeros(1, self._state_type)
        self._coeffs: tuple[Any, ...] = ()
        self._params = None
        if owner.tunables:
            self._params = ffi.new(f"{self.prefix}_params_t *")
            self._coeffs = (ffi.new(f"{self.prefix}_coeffs_t *"),)
        self.prepare({})

    def _cast(self, kind: str, array: Array) -> Any:
        return self.library.ffi.cast(f"{kind} *", array.ctypes.data)

    def prepare(self, tunables: Mapping[str, Any]) -> int:
        """Set tunables, the others at their defaults, derive the coefficients, and reset.

        Of a Block ``{tunable: value}``, of a task ``{instance: {tunable: value}}``. Returns 0, or
        the number of a refused tunable (tasks only; nothing is then changed).
        """
        refused = 0
        if self._params is not None:
            refused = self._prepare(self._params, tunables)
        if not refused:
            self.reset()
        return refused

    def _prepare(self, params: Any, tunables: Mapping[str, Any]) -> int:
        library, owner = self.library, self.owner
        if isinstance(owner, System):
            return set_tunables(library, library.function, params, self._coeffs[0], tunables)
        for key, value in (owner.default_tunables() | dict(tunables)).items():
            setattr(params, key, library.naming.tunable(owner, key, value))
        getattr(library.lib, f"{self.prefix}_prepare")(params, *self._coeffs)
        return 0

    def reset(self) -> None:
        """Return to the initial state, which every field must be set to."""
        self._state.view(np.uint8)[:] = 0xA5
        self._init(*self._coeffs, self._cast(f"{self.prefix}_state_t", self._state))

    @property
    def state(self) -> Array:
        """The state struct, one element of a structured array (a copy)."""
        return self._state.copy()

    @state.setter
    def state(self, value: Array) -> None:
        self._state[:] = value

    @property
    def coefficient_memory(self) -> Any:
        """The coefficients' bytes as the C reads them: writing there is a fault of memory."""
        return self.library.ffi.buffer(self._coeffs[0])

    def put_state(self, values: Mapping[str, Any]) -> None:
        """Overwrite part of the state: ports in units or raw whole numbers, counters by C name."""
        known = {f.name: f for f in self.state_fields}
        for name, value in values.items():
            self._state[name] = known[name].encode(value) if name in known else value

    def pack(self, inputs: Mapping[str, Any]) -> Array:
        """Arrange a stream as an array of the C's input structs.

        Per input an array (steps,) or (steps, size) in units; in q31, whole numbers are raw.
        """
        steps = len(np.atleast_1d(next(iter(inputs.values())))) if inputs else 0
        packed = np.zeros(steps, self._in_type)
        for f in self.inputs:
            packed[f.name] = f.encode(inputs[f.name])
        return packed

    def run(
        self, inputs: Mapping[str, Any], trace: bool = True, raw: bool = False
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run over a stream, going on from the present state: outputs, and with ``trace`` states.

        raw: the C's own numbers, which in q31 are no units.
        """
        packed = self.pack(inputs)
        out = np.zeros(len(packed), self._out_type)
        states = np.zeros(len(packed) if trace else 0, self._state_type)
        self.run_into(packed, out, states)
        known = {f.name: f for f in self.state_fields if not raw}
        outputs = {f.name: out[f.name] if raw else f.decode(out[f.name]) for f in self.outputs}
        names = (self._state_type.names or ()) if trace else ()
        after = {n: known[n].decode(states[n]) if n in known else states[n] for n in names}
        return outputs, after

    def run_into(self, packed: Array, out: Array, states: Array) -> None:
        """Run over packed inputs, into arrays of the C's structs; no states without elements."""
        self._run(
            *self._coeffs,
            self._cast(f"{self.prefix}_state_t", self._state),
            self._cast(f"{self.stem}_in_t", packed),
            self._cast(f"{self.stem}_out_t", out),
            self._cast(f"{self.prefix}_state_t", states) if len(states) else self.library.ffi.NULL,
            len(packed),
        )

    def step(self, **inputs: Any) -> dict[str, Any]:
        outputs, _ = self.run({k: np.asarray(v)[None] for k, v in inputs.items()}, trace=False)
        return {k: v[0] for k, v in outputs.items()}


def set_tunables(
    of: HostLibrary | Renderer,
    function: Callable[[str], Any],
    params: Any,
    coeffs: Any,
    tunables: Mapping[str, Mapping[str, float]],
) -> int:
    """Set a System's tunables, the others at their defaults: 0, or the number of one refused."""
    known = {(i, t.name): t for i, t in of.system.tunables}
    function(f"{of.prefix}_default_params")(params)
    for instance, values in tunables.items():
        for key, value in values.items():
            taken = known[instance, key].taken(value) if (instance, key) in known else value
            number = of.naming.tunable(of.system.blocks[instance], key, taken)
            setattr(getattr(params, instance), key, number)
    return int(function(f"{of.prefix}_prepare")(params, coeffs))


class CBoard:
    """A System's compiled C, called as firmware calls it: one state, shared by all tasks.

    It has the face of :class:`esea_gen.language.system.SystemSimulator`, and refuses a tunable
    outside its range with a ValueError.
    """

    def __init__(
        self, library: HostLibrary, tunables: Mapping[str, Mapping[str, float]] | None = None
    ) -> None:
        self.library, self.system = library, library.system
        system = library.system
        self._fields = {t.name: library.fields(t) for t in system.tasks}
        self.state = self._new("state")
        self.coeffs: tuple[Any, ...] = ()
        if system.tunables:
            params, coeffs = self._new("params"), self._new("coeffs")
            refused = set_tunables(library, library.function, params, coeffs, tunables or {})
            if refused:
                instance, tunable = system.tunables[refused - 1]
                raise ValueError(
                    f"{instance}.{tunable.name} is outside [{tunable.low}, {tunable.high}]"
                )
            self.coeffs = (coeffs,)
        self.call("init", *self.coeffs, self.state)

    def _new(self, kind: str, values: Mapping[str, Any] | None = None) -> Any:
        return self.library.ffi.new(f"{self.library.prefix}_{kind}_t *", values or {})

    def call(self, verb: str, *arguments: Any) -> Any:
        """Call a function of the System: ``release``, ``resume``, ``sense_step``."""
        return self.library.function(f"{self.library.prefix}_{verb}")(*arguments)

    def release(self, tick: int) -> None:
        """Move the latches: at every base tick, before the tasks."""
        if self.system.latches:
            self.call("release", self.state, tick)

    @property
    def memory(self) -> dict[str, Any]:
        """Bytes of ``coeffs`` and ``state`` as the C has them."""
        held = {"state": self.state} | ({"coeffs": self.coeffs[0]} if self.coeffs else {})
        return {name: self.library.ffi.buffer(struct) for name, struct in held.items()}

    def step(self, task_name: str, **inputs: Any) -> dict[str, Any]:
        """One run of a task, in units; in q31, NaN and values that do not fit are invalid."""
        out = self.raw_step(task_name, inputs)
        return {
            f.name: f.decode(held if f.port.size == 1 else np.array(list(held)))
            for f in self._fields[task_name][1]
            for held in [getattr(out, f.name)]
        }

    def raw_step(self, task_name: str, inputs: Mapping[str, Any]) -> Any:
        """One run of a task, its outputs as the C's struct."""
        taken, _ = self._fields[task_name]
        given = {f.name: _held(f, inputs[f.name]) for f in taken}
        out = self._new(f"{task_name}_out")
        values = self._new(f"{task_name}_in", given)
        self.call(f"{task_name}_step", *self.coeffs, self.state, values, out)
        return out


def _held(f: Field, value: Any) -> Any:
    # What the C holds for a number or several, in units whatever their type.
    if np.ndim(value) == 0:
        plain = f.fraction is None and not f.port.whole
        return float(value) if plain else f.encode(float(value))
    return f.encode(np.asarray(value, np.float64)).tolist()


def run_schedule(
    board: CBoard | SystemSimulator, inputs: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Array]]:
    """Run every task of a System at its own ticks: per task, an array per external output.

    inputs: per task, an array per external input, an element a run; of a task without inputs an
        empty name, with as many elements as it has runs.
    """
    system = board.system
    runs = {t: len(next(iter(columns.values()))) for t, columns in inputs.items()}
    ticks = max(
        system.task(t).phase + (n - 1) * system.task(t).every + 1 for t, n in runs.items() if n
    )
    found: dict[str, dict[str, list[Any]]] = {
        t: {x.name: [] for x in system.task_outputs(system.task(t))} for t in inputs
    }
    for tick in range(ticks):
        board.release(tick)
        for task in system.tasks:
            k, late = divmod(tick - task.phase, task.every)
            if task.name not in inputs or late or not 0 <= k < runs[task.name]:
                continue
            given = {n: a[k] for n, a in inputs[task.name].items() if n}
            for name, value in board.step(task.name, **given).items():
                found[task.name][name].append(value)
    number = np.float32 if isinstance(board, CBoard) and board.library.real == "f32" else float
    kinds = {x.name: np.uint32 if x.port.whole else number for x in system.outputs}
    return {
        t: {n: np.asarray(v, dtype=kinds[n]) for n, v in outputs.items()}
        for t, outputs in found.items()
    }
