"""What is compared: programs that take the same stream through the same step.

A compiled peer is a library with a loop of its own in C; all are compiled with the same flags.  The
other peers run in Python.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

import casadi as ca
import cffi
import numpy as np

from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.f64 import casadi_c
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.compiler import compile_sources, find_compiler
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream
from esea_gen.language.system import System
from esea_gen.model.elastomer import stop_grid
from esea_gen.targets import BARE_LINK, BOARDS, EXACT_FLAGS, HOST_GCC, SECTION_FLAGS

# As in a program: a call from one file to another is direct, not through a table that a loader
# may redirect.
LIBRARY_FLAGS = ("-fvisibility=hidden",)
REALS = ("f64", "f32")
BARE_FLAGS = (*EXACT_FLAGS, *SECTION_FLAGS)


class Peer(Protocol):
    """Something that runs a stream and says how long it took."""

    name: str

    def run(self, passes: int) -> float:
        """Seconds for a number of passes through the whole stream."""

    def results(self) -> Array:
        """Outputs of the last pass, shape (steps, outputs)."""


@dataclass(frozen=True)
class Sources:
    """The C of a peer.

    name: what it is called in the table.
    libm: whether it needs the platform's libm.
    """

    name: str
    files: dict[str, str]
    libm: bool


def _columns(stream: Stream, block: Block) -> Array:
    return np.concatenate(
        [stream.inputs[p.name].reshape(stream.steps, -1) for p in block.inputs], axis=1
    )


def peer_sources(
    device: Device, block: Block, stream: Stream, system: System | None = None
) -> dict[str, Sources]:
    """The C of every compiled peer.

    system: the System that holds the Block; the device's own when not given.
    return: ``f64``, ``f32``, ``casadi f64``, ``casadi f32``, ``floor f64``, ``floor f32``.
    """
    system = system or device.system
    simulator = block.simulator()
    sizes = {
        "inputs": sum(p.size for p in block.inputs),
        "outputs": sum(p.size for p in block.outputs),
        "state": sum(p.size for p in block.state),
    }
    context: dict[str, Any] = {
        "block": block,
        "sizes": sizes,
        "steps": stream.steps,
        "rows": _columns(stream, block).tolist(),
        "coefficients": [x for c in simulator.coefficients.values() for x in c.tolist()],
        "initial": [x for s in simulator.state.values() for x in s.tolist()],
        "work": (block.step.sz_iw(), block.step.sz_w()),
    }
    out: dict[str, Sources] = {}
    for real in REALS:
        fmt = FORMATS[real]
        renderer = Renderer(system, fmt, "-", "-", device.title)
        renderer.env.filters["number17"] = repr

        def text(name: str, renderer: Renderer = renderer, **more: Any) -> str:
            return renderer.render(f"bench/{name}.j2", **context, **more)

        common = {n: text(n) for n in ("bench.h", "stream.h", "clock.c")}
        files = renderer.files()
        headers = {
            n: t for n, t in files.items() if n.endswith(".h") and not n.startswith("reference/")
        }
        own = {n: t for n, t in files.items() if not n.startswith("reference/") and n != "main.c"}
        out[real] = Sources(
            f"generated {real}",
            own | common | {"struct.c": text("struct.c", floor=False)},
            fmt.needs_libm,
        )
        out[f"floor {real}"] = Sources(
            f"moving inputs and outputs only ({real})",
            headers
            | common
            | {"struct.c": text("struct.c", floor=True), "floor.c": text("floor.c")}
            # init lives beside the step.
            | {n: files[n] for n in files if n == f"{renderer.prefix}_{block.name}.c"}
            | ({"esea_f32.c": files["esea_f32.c"]} if "esea_f32.c" in files else {}),
            fmt.needs_libm,
        )
        # CasADi's text refers to nothing of ours but the number it computes in.
        real_t = "" if real == "f64" else "#define casadi_real float\n"
        casadi = {
            n.removeprefix("reference/"): t for n, t in casadi_c(system).items() if n.endswith(".c")
        }
        out[f"casadi {real}"] = Sources(
            "CasADi C (f64)" if real == "f64" else "CasADi C (casadi_real=float)",
            common | {n: real_t + t for n, t in (casadi | {"loop.c": text("casadi.c")}).items()},
            True,
        )
    return out


class CompiledPeer:
    """A peer in C, called through cffi once a measurement."""

    def __init__(self, sources: Sources, block: Block, stream: Stream) -> None:
        self.name = sources.name
        self.path = compile_sources(sources.files, LIBRARY_FLAGS, ("-lm",) if sources.libm else ())
        self.ffi = cffi.FFI()
        self.ffi.cdef(
            "void esea_bench_load(const double *);"
            "void esea_bench_results(double *);"
            "double esea_bench_run(int);"
        )
        self._lib: Any = self.ffi.dlopen(str(self.path))
        self._shape = (stream.steps, sum(p.size for p in block.outputs))
        rows = np.ascontiguousarray(_columns(stream, block))
        self._lib.esea_bench_load(self.ffi.cast("const double *", rows.ctypes.data))

    def run(self, passes: int) -> float:
        """Seconds for a number of passes through the whole stream."""
        return float(self._lib.esea_bench_run(passes))

    def results(self) -> Array:
        """Outputs of the last pass, shape (steps, outputs)."""
        out = np.empty(self._shape)
        self._lib.esea_bench_results(self.ffi.cast("double *", out.ctypes.data))
        return out


class EvaluatorPeer:
    """CasADi's evaluator.

    whole: one call a stream (``Function.mapaccum``), so that Python is not in the loop; otherwise
        one call a step, through the buffers that CasADi keeps for that.
    """

    def __init__(self, block: Block, stream: Stream, whole: bool) -> None:
        self.name = f"CasADi evaluator, one call a {'stream' if whole else 'step'}"
        self._block, self._stream, self._whole = block, stream, whole
        self._simulator = block.simulator()
        self._out: list[Array] = []
        if whole:
            states, count = len(block.state), len(block.coefficients)
            step = block.step
            coefficients = [ca.SX.sym(p.name, p.size) for p in block.coefficients]
            s = [ca.SX.sym(p.name, p.size) for p in block.state]
            u = [ca.SX.sym(p.name, p.size) for p in block.inputs]
            results = step.call([*coefficients, *s, *u])
            one = ca.Function(
                "one",
                [ca.veccat(*s), ca.veccat(*u), ca.veccat(*coefficients)],
                [ca.veccat(*results[:states]), ca.veccat(*results[states:])],
            )
            self._loop = one.mapaccum("loop", stream.steps)
            rows = ca.DM(_columns(stream, block).T)
            start = ca.DM(np.concatenate([*self._simulator.state.values()]))
            tuned = np.concatenate([np.zeros(0), *self._simulator.coefficients.values()])
            fixed = ca.repmat(ca.DM(tuned), 1, stream.steps) if count else ca.DM(0, stream.steps)
            self._arguments = [start, rows, fixed]

    def run(self, passes: int) -> float:
        """Seconds for a number of passes through the whole stream."""
        start = time.thread_time()
        for _ in range(passes):
            if self._whole:
                self._out = [np.asarray(self._loop.call(self._arguments)[1]).T]
            else:
                self._simulator.reset()
                y, _ = self._simulator.run(self._stream.inputs)
                self._out = [y[p.name].reshape(-1, p.size) for p in self._block.outputs]
        return time.thread_time() - start

    def results(self) -> Array:
        """Outputs of the last pass, shape (steps, outputs)."""
        return np.concatenate(self._out, axis=1)


class NumpyPeer:
    """The torque model as one writes it in NumPy: a loop over time, vectors over stop operators.

    Torque only: no guard, no status, no repair, and no dead zone (see :meth:`fits`).
    """

    name = "NumPy loop (torque only, no guards)"

    @staticmethod
    def fits(device: Device) -> bool:
        """Whether a device has the parts that this peer has: rate terms, no dead zone."""
        elastomer = device.elastomer
        return elastomer.maxwell is not None and elastomer.dead_zone_rad is None

    def __init__(self, device: Device, stream: Stream) -> None:
        self._h = device.period_s
        names = {c.name: c.value for c in device.constants("elastomer")}
        self._p = SimpleNamespace(**names)
        radii, weights = stop_grid(names, int(names["stops"]))
        self._r, self._w = np.array(radii, dtype=float), np.array(weights, dtype=float)
        self._theta = stream.inputs["theta_rad"]
        self._omega = stream.inputs["omega_rad_s"]
        self._tau = np.zeros(len(self._theta))

    def run(self, passes: int) -> float:
        """Seconds for a number of passes through the whole stream."""
        start = time.thread_time()
        for _ in range(passes):
            self._pass()
        return time.thread_time() - start

    def _pass(self) -> None:
        p, h, r, w = self._p, self._h, self._r, self._w
        play = np.full(len(r), self._theta[0])
        last, tau_r = self._theta[0], 0.0
        for k, (theta, omega) in enumerate(zip(self._theta, self._omega, strict=True)):
            play = np.clip(play, theta - r, theta + r)
            tau_h = w @ (theta - play)
            eta = (p.A_Nms_rad * abs(last + 0.5 * h * omega) ** p.m + p.eps1_Nms_rad) / (
                p.B * abs(omega) ** p.n + p.eps2
            )
            x = h * p.kv_Nm_rad / eta
            series = 1 + x / 2 + x * x / 6
            tau_r = (tau_r + p.kv_Nm_rad * (theta - last) * series) / (1 + x * series)
            last = theta
            self._tau[k] = p.k3_Nm_rad3 * theta**3 + p.k1_Nm_rad * theta + tau_r + tau_h

    def results(self) -> Array:
        """Torque of the last pass, shape (steps, 1)."""
        return self._tau[:, None]


def _short(sources: Sources, steps: int) -> dict[str, str]:
    # Fewer steps are enough to count, and a board's memory is small.
    return sources.files | {"bench.h": f"#define BENCH_STEPS {steps}\n" + sources.files["bench.h"]}


def _place(files: dict[str, str], folder: Path) -> list[str]:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return sorted(str(folder / n) for n in files if n.endswith(".c") and n != "clock.c")


def count_host_instructions(sources: Sources, extra: dict[str, str], steps: int) -> float:
    """Instructions of a step on this machine, loop included.

    steps: steps of the stream to run; the difference of two numbers of passes is taken.
    """
    gcc = find_compiler(*HOST_GCC.gcc)
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        raise UserError(
            "The tool 'valgrind' is not installed.",
            "Install it with: apt-get install --no-install-recommends valgrind",
        )
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        paths = _place(_short(sources, steps) | extra, folder)
        _call([gcc, *EXACT_FLAGS, f"-I{folder}", *paths, "-o", folder / "count", "-lm"])
        seen = []
        for passes in (1, 11):
            done = _call(
                [
                    *(valgrind, "--tool=callgrind", f"--callgrind-out-file={folder}/out"),
                    *(str(folder / "count"), str(passes)),
                ]
            )
            found = re.search(r"Collected : (\d+)", done)
            if found is None:
                raise RuntimeError(f"no count in what valgrind said:\n{done}")
            seen.append(int(found.group(1)))
    return (seen[1] - seen[0]) / 10 / steps


def count_board_instructions(sources: Sources, extra: dict[str, str], steps: int) -> float:
    """Instructions of a step on an emulated Cortex-M4F, loop included."""
    from esea_gen.board.emulator import qemu_command

    board = BOARDS["netduinoplus2"]  # the one whose timer bare.c.j2 knows
    gcc = find_compiler(*board.processor.toolchain.gcc)
    qemu = qemu_command(board, semihosting=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        paths = _place(_short(sources, steps) | extra, folder)
        link = [*BARE_LINK, "--specs=nosys.specs", f"-T{folder}/bare.ld"]
        image = folder / "bare.elf"
        flags = [*board.compile_flags, *BARE_FLAGS, f"-I{folder}"]
        _call([gcc, *flags, *paths, *link, "-o", image, "-lm"])
        said = _call([*qemu, "-icount", "shift=0", "-kernel", image])
    found = re.search(r"^([0-9a-f]{8})$", said, re.MULTILINE)
    if found is None:
        raise RuntimeError(f"the emulated board did not answer:\n{said}")
    return int(found.group(1), 16) / steps


def _call(command: list[Any]) -> str:
    done = subprocess.run(
        [str(c) for c in command],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        stdin=subprocess.DEVNULL,
    )
    if done.returncode != 0:
        raise RuntimeError(f"{Path(str(command[0])).name} failed:\n{done.stderr}")
    return done.stdout + done.stderr


def finite(value: float) -> float:
    """The value itself; an error for NaN and infinity, which no row may hold."""
    if not math.isfinite(value):
        raise ValueError(f"a measurement is {value}")
    return value
