"""Compile a rendered System for the host and call it.

cffi works in ABI mode: no Python headers are needed, and its declarations are read from the emitted
header by the C preprocessor, never typed again.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.fixed.search import raw_tunable
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Port
from esea_gen.language.system import System, SystemSimulator

CFLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC")
Array = npt.NDArray[Any]


def find_compiler(name: str, package: str) -> str:
    """Path of a compiler.

    Parameters
    ----------
    name : str
        Command, ``gcc``.
    package : str
        Debian package that has it.

    Returns
    -------
    str
        Its path.

    Raises
    ------
    UserError
        When it is not installed, with the package to install.
    """
    path = shutil.which(name)
    if path is None:
        raise UserError(
            f"The compiler '{name}' is not installed.",
            f"Install it with: apt-get install --no-install-recommends {package}",
        )
    return path


def cache_folder() -> Path:
    """Folder of compiled libraries: ``$XDG_CACHE_HOME/esea-gen`` or ``~/.cache/esea-gen``."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(base) / "esea-gen"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        folder = Path(tempfile.gettempdir()) / f"esea-gen-{os.getuid()}"
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def compile_sources(
    files: Mapping[str, str], flags: Sequence[str] = (), link: Sequence[str] = ()
) -> Path:
    """Compile C files into a shared library, once for a given content.

    Parameters
    ----------
    files : mapping of str to str
        Relative path to text; every ``.c`` but ``main.c`` is compiled.
    flags : sequence of str
        Flags beside the project's own.
    link : sequence of str
        Linker flags.

    Returns
    -------
    Path
        The library.

    Raises
    ------
    UserError
        When there is no compiler.
    RuntimeError
        When the compiler refuses the files, with what it said.
    """
    gcc = find_compiler("gcc", "gcc libc6-dev")
    version = subprocess.run([gcc, "--version"], capture_output=True, text=True, check=True).stdout
    command = [gcc, *CFLAGS, *flags, "-shared"]
    key = hashlib.sha256("\0".join([version, *command, *link]).encode())
    for name in sorted(files):
        key.update(f"\0{name}\0{files[name]}".encode())
    target = cache_folder() / f"{key.hexdigest()[:32]}.so"
    if target.is_file():
        return target
    with tempfile.TemporaryDirectory() as scratch:
        sources = []
        for name, text in files.items():
            path = Path(scratch) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            if name.endswith(".c") and name != "main.c":
                sources.append(str(path))
        built = Path(scratch) / "library.so"
        done = subprocess.run(
            [*command, f"-I{scratch}", *sorted(sources), "-o", str(built), *link],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise RuntimeError(f"the generated C does not compile:\n{done.stderr}")
        # Copy beside the target, then rename: a second process sees all of it or none.
        partial = target.with_suffix(f".{os.getpid()}.tmp")
        shutil.copyfile(built, partial)
        partial.replace(target)
    return target


def declarations(text: str) -> str:
    """cffi declarations of a header or C text, by the C preprocessor.

    Parameters
    ----------
    text : str
        C text whose only includes are standard ones.

    Returns
    -------
    str
        Types and prototypes.
    """
    gcc = find_compiler("gcc", "gcc libc6-dev")
    bare = re.sub(r"^\s*#\s*include.*$", "", text, flags=re.MULTILINE)
    done = subprocess.run(
        [gcc, "-E", "-P", "-x", "c", "-std=c99", "-"],
        input=bare,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


class CRunner:
    """A compiled Block or task: steps and runs like its symbolic counterpart.

    Parameters
    ----------
    library : HostLibrary
        Where it lives.
    stem : str
        C name without the verb (``esea_elbow_sensor``).
    prefix : str
        C name of the owner of params, coeffs and state (the same, or the System's prefix).
    tuned : bool
        Whether it takes coefficients.
    inputs, outputs, state : tuple of Port
        Ports by C field name; the state empty for a task.
    """

    def __init__(
        self,
        library: HostLibrary,
        stem: str,
        prefix: str,
        tuned: bool,
        inputs: Sequence[tuple[str, Port]],
        outputs: Sequence[tuple[str, Port]],
        state: Sequence[Port],
    ) -> None:
        ffi = library.ffi
        self.library, self.stem, self.prefix = library, stem, prefix
        self.inputs, self.outputs, self.state_ports = inputs, outputs, state
        self._run = getattr(library.lib, f"{stem}_run")
        self._init = getattr(library.lib, f"{prefix}_init")
        self._in_type = library.dtype(f"{stem}_in_t")
        self._out_type = library.dtype(f"{stem}_out_t")
        self._state_type = library.dtype(f"{prefix}_state_t")
        self._state = np.zeros(1, self._state_type)
        self._coeffs: tuple[Any, ...] = ()
        self._params = None
        if tuned:
            self._params = ffi.new(f"{prefix}_params_t *")
            self._coeffs = (ffi.new(f"{prefix}_coeffs_t *"),)
        self.prepare({})

    def _cast(self, kind: str, array: Array) -> Any:
        return self.library.ffi.cast(f"{kind} *", array.ctypes.data)

    def prepare(self, tunables: Mapping[str, Any]) -> int:
        """Set tunables, the others at their defaults, derive the coefficients, and reset.

        Parameters
        ----------
        tunables : mapping
            For a Block ``{tunable: value}``; for a task ``{instance: {tunable: value}}``.

        Returns
        -------
        int
            0, or the number of the refused tunable (tasks only; coefficients untouched).
        """
        refused = 0
        if self._params is not None:
            refused = self.library.prepare(self, tunables)
        if not refused:
            self.reset()
        return refused

    def reset(self) -> None:
        """Return to the initial state."""
        self._init(*self._coeffs, self._cast(f"{self.prefix}_state_t", self._state))

    @property
    def state(self) -> Array:
        """The state struct, one element of a structured array (a copy)."""
        return self._state.copy()

    @state.setter
    def state(self, value: Array) -> None:
        self._state[:] = value

    def pack(self, inputs: Mapping[str, Any]) -> Array:
        """Arrange a stream as the C's input structs.

        Parameters
        ----------
        inputs : mapping of str to array
            One array per input, shape (steps,) or (steps, size).

        Returns
        -------
        ndarray
            Structured, shape (steps,).
        """
        steps = len(np.atleast_1d(next(iter(inputs.values())))) if inputs else 0
        packed = np.zeros(steps, self._in_type)
        for name, _ in self.inputs:
            packed[name] = inputs[name]
        return packed

    def run(
        self, inputs: Mapping[str, Any], trace: bool = True
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run over a stream, going on from the present state.

        Parameters
        ----------
        inputs : mapping of str to array
            One array per input, shape (steps,) or (steps, size).
        trace : bool
            Whether to record the state after every step.

        Returns
        -------
        outputs, states : dict of str to ndarray
            By name; states empty without ``trace``.
        """
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
        names = self._state_type.names or ()
        return (
            {name: out[name] for name, _ in self.outputs},
            {name: states[name] for name in names} if trace else {},
        )

    def step(self, **inputs: Any) -> dict[str, Any]:
        """One step.

        Parameters
        ----------
        **inputs : float or ndarray
            One value per input.

        Returns
        -------
        dict
            One value per output.
        """
        outputs, _ = self.run({k: np.asarray(v)[None] for k, v in inputs.items()}, trace=False)
        return {k: v[0] for k, v in outputs.items()}


class CBoard:
    """A System's compiled C, called as firmware calls it: one state, shared by all tasks.

    It has the face of :class:`esea_gen.language.system.SystemSimulator`.

    Parameters
    ----------
    library : HostLibrary
        Where it lives.
    tunables : mapping, optional
        ``{instance: {tunable: value}}`` other than the defaults.

    Raises
    ------
    ValueError
        For a tunable outside its range.
    """

    def __init__(
        self, library: HostLibrary, tunables: Mapping[str, Mapping[str, float]] | None = None
    ) -> None:
        self.library, self.system = library, library.system
        self._state = self._new("state")
        self._coeffs: tuple[Any, ...] = ()
        if library.system.tunables:
            params, coeffs = self._new("params"), self._new("coeffs")
            self._call("default_params", params)
            known = {(i, t.name): t for i, t in library.system.tunables}
            for instance, values in (tunables or {}).items():
                for key, value in values.items():
                    taken = known[instance, key].taken(value) if (instance, key) in known else value
                    setattr(getattr(params, instance), key, taken)
            refused = int(self._call("prepare", params, coeffs))
            if refused:
                instance, tunable = library.system.tunables[refused - 1]
                raise ValueError(
                    f"{instance}.{tunable.name} is outside [{tunable.low}, {tunable.high}]"
                )
            self._coeffs = (coeffs,)
        self._call("init", *self._coeffs, self._state)

    def _new(self, kind: str, values: Mapping[str, Any] | None = None) -> Any:
        return self.library.ffi.new(f"{self.library.prefix}_{kind}_t *", values or {})

    def _call(self, verb: str, *arguments: Any) -> Any:
        return getattr(self.library.lib, f"{self.library.prefix}_{verb}")(*arguments)

    def release(self, tick: int) -> None:
        """Move the latches: at every base tick, before the tasks.

        Parameters
        ----------
        tick : int
            The base tick.
        """
        if self.system.latches:
            self._call("release", self._state, tick)

    def step(self, task_name: str, **inputs: Any) -> dict[str, Any]:
        """One run of a task.

        Parameters
        ----------
        task_name : str
            Which.
        **inputs : float or sequence of float
            Its external inputs.

        Returns
        -------
        dict
            Its external outputs: float, int for a status word, ndarray for a vector.
        """
        task = self.system.task(task_name)
        given = {
            x.name: inputs[x.name] if x.port.size == 1 else list(inputs[x.name])
            for x in self.system.task_inputs(task)
        }
        out = self._new(f"{task_name}_out")
        values = self._new(f"{task_name}_in", given)
        self._call(f"{task_name}_step", *self._coeffs, self._state, values, out)
        found = {}
        for x in self.system.task_outputs(task):
            value = getattr(out, x.name)
            found[x.name] = value if x.port.size == 1 else np.array(list(value))
        return found


def run_schedule(
    board: CBoard | SystemSimulator, inputs: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Array]]:
    """Run every task of a System at its own ticks.

    Parameters
    ----------
    board : CBoard or SystemSimulator
        The C, or the symbols.
    inputs : mapping of str to mapping
        Per task, one array per external input with one element a run; for a task without inputs
        ``{"": zeros}`` of as many elements as it has runs.

    Returns
    -------
    dict of str to dict of str to ndarray
        Per task, one array per external output; float32 or uint32 from f32 C.
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
    single = isinstance(board, CBoard) and board.library.real == "f32"
    kinds = {
        x.name: np.uint32 if x.port.flags else np.float32 if single else np.float64
        for x in system.outputs
    }
    return {
        t: {n: np.asarray(v, dtype=kinds[n]) for n, v in outputs.items()}
        for t, outputs in found.items()
    }


class HostLibrary:
    """A System's generated C, compiled for the host.

    Parameters
    ----------
    system : System
        What was rendered.
    renderer : Renderer
        Its renderer.
    flags : sequence of str
        Compiler flags beside the project's own (sanitizers, coverage).
    """

    def __init__(self, system: System, renderer: Renderer, flags: Sequence[str] = ()) -> None:
        self.system = system
        self.real = renderer.fmt.name
        self.prefix = renderer.prefix
        self.files = renderer.files()
        driver = renderer.render("hostlib/driver.c.j2")
        files = {n: t for n, t in self.files.items() if not n.startswith("reference/")}
        link = ("-lm",) if renderer.fmt.needs_libm else ()
        self.path = compile_sources(files | {"driver.c": driver}, flags, link)
        self.ffi = cffi.FFI()
        # The driver's loops are declared by their own text: bodies are cut at the first brace.
        prototypes = re.sub(r"\)\s*\n\{.*?\n\}", ");", driver, flags=re.DOTALL)
        self.ffi.cdef(declarations(self.files[f"{self.prefix}.h"] + prototypes), override=True)
        self.lib: Any = self.ffi.dlopen(str(self.path))
        self._dtypes: dict[str, np.dtype[Any]] = {}

    def dtype(self, c_type: str) -> np.dtype[Any]:
        """numpy type of a C struct, field for field.

        Parameters
        ----------
        c_type : str
            Name of the struct's type.

        Returns
        -------
        numpy.dtype
            With the C's offsets and size.
        """
        if c_type not in self._dtypes:
            self._dtypes[c_type] = self._convert(self.ffi.typeof(c_type))
        return self._dtypes[c_type]

    def _convert(self, ctype: Any) -> np.dtype[Any]:
        primitive = {"double": "f8", "float": "f4", "uint32_t": "u4", "int32_t": "i4"}
        if ctype.kind == "primitive":
            return np.dtype(primitive[ctype.cname])
        if ctype.kind == "array":
            return np.dtype((self._convert(ctype.item), (ctype.length,)))
        fields = ctype.fields
        return np.dtype(
            {
                "names": [n for n, _ in fields],
                "formats": [self._convert(f.type) for _, f in fields],
                "offsets": [f.offset for _, f in fields],
                "itemsize": self.ffi.sizeof(ctype),
            }
        )

    def prepare(self, runner: CRunner, tunables: Mapping[str, Any]) -> int:
        """Fill in a runner's params and call its prepare (see :meth:`CRunner.prepare`).

        Parameters
        ----------
        runner : CRunner
            Whose params.
        tunables : mapping
            As in :meth:`CRunner.prepare`.

        Returns
        -------
        int
            0, or the number of the refused tunable.
        """
        params = runner._params

        def tunable(instance: str, key: str, value: Any) -> tuple[str, Any]:
            if self.real != "q31":
                return key, value
            return raw_tunable(self.system.blocks[instance], key, value)

        if runner.prefix == self.prefix:
            getattr(self.lib, f"{self.prefix}_default_params")(params)
            for instance, values in tunables.items():
                for key, value in values.items():
                    setattr(getattr(params, instance), *tunable(instance, key, value))
            return int(getattr(self.lib, f"{self.prefix}_prepare")(params, runner._coeffs[0]))
        block = next(b for b in self.system.kinds if runner.prefix == f"{self.prefix}_{b.name}")
        instance = next(i for i, b in self.system.blocks.items() if b is block)
        for key, value in (block.default_tunables() | dict(tunables)).items():
            setattr(params, *tunable(instance, key, value))
        getattr(self.lib, f"{runner.prefix}_prepare")(params, runner._coeffs[0])
        return 0

    def board(self, tunables: Mapping[str, Mapping[str, float]] | None = None) -> CBoard:
        """The System as firmware runs it, all tasks on one state.

        Parameters
        ----------
        tunables : mapping, optional
            ``{instance: {tunable: value}}`` other than the defaults.

        Returns
        -------
        CBoard
            Freshly initialised.
        """
        if self.real == "q31":
            from esea_gen.hostlib.fixed import FixedBoard

            return FixedBoard(self, tunables)
        return CBoard(self, tunables)

    def block(self, name: str) -> CRunner:
        """A compiled Block.

        Parameters
        ----------
        name : str
            The Block's name.

        Returns
        -------
        CRunner
            Freshly initialised.
        """
        if self.real == "q31":
            from esea_gen.hostlib.fixed import fixed_block

            return fixed_block(self, name)
        block: Block = next(b for b in self.system.kinds if b.name == name)
        stem = f"{self.prefix}_{name}"
        return CRunner(
            self,
            stem,
            stem,
            bool(block.coefficients),
            [(p.name, p) for p in block.inputs],
            [(p.name, p) for p in block.outputs],
            block.state,
        )

    def task(self, name: str) -> CRunner:
        """A compiled task.

        Parameters
        ----------
        name : str
            The task's name.

        Returns
        -------
        CRunner
            Freshly initialised, with a state of its own.
        """
        if self.real == "q31":
            from esea_gen.hostlib.fixed import fixed_task

            return fixed_task(self, name)
        task = self.system.task(name)
        return CRunner(
            self,
            f"{self.prefix}_{name}",
            self.prefix,
            bool(self.system.tunables),
            [(x.name, x.port) for x in self.system.task_inputs(task)],
            [(x.name, x.port) for x in self.system.task_outputs(task)],
            (),
        )


def compile_system(system: System, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a System that need not belong to a device.

    Parameters
    ----------
    system : System
        Any System.
    real : str
        Number format.
    flags : sequence of str
        Compiler flags beside the project's own.

    Returns
    -------
    HostLibrary
        Loaded.
    """
    return HostLibrary(system, Renderer(system, FORMATS[real], "-", "-", system.name), flags)


def compile_device(device: Device, real: str, flags: Sequence[str] = ()) -> HostLibrary:
    """Render and compile a device's C, the bytes that ``esea-gen build`` writes.

    Parameters
    ----------
    device : Device
        The device.
    real : str
        Number format.
    flags : sequence of str
        Compiler flags beside the project's own.

    Returns
    -------
    HostLibrary
        Loaded.
    """
    digest = format_hash(device, real)
    renderer = Renderer(device.system, FORMATS[real], digest, "-", device.title)
    return HostLibrary(device.system, renderer, flags)
