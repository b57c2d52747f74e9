"""Peers: programs that take the same stream through the same step, timed in turns.

A compiled peer is a library with a loop of its own in C; all are compiled with the same flags.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import casadi as ca
import cffi
import jinja2
import numpy as np

from esea_gen.device import Device
from esea_gen.emit.elementary import exponent_q27
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.f64 import casadi_c
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.compiler import compile_sources
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream
from esea_gen.language.system import System
from esea_gen.model.elastomer import stop_grid

from .step_count import stream_program

# A call from one file to another is direct, as in a program, not through a loader's table.
LIBRARY_FLAGS = ("-O2", "-fvisibility=hidden")
CASADI, CASADI_FLOAT = "CasADi C (f64)", "CasADi C (casadi_real=float)"
HAND = "hand-written C (torque only, no guards)"
MEASURE_S = 0.0015  # one measurement; long against the clock, short against what else runs


def with_templates(renderer: Any) -> Any:
    """A renderer that finds the benchmarks' own templates too."""
    renderer.env.filters["number17"] = repr
    own = jinja2.FileSystemLoader(Path(__file__).parent / "templates")
    renderer.env.loader = jinja2.ChoiceLoader([renderer.env.loader, own])
    return renderer


def renderer_of(device: Device, system: System, real: str) -> Renderer:
    return with_templates(Renderer(system, FORMATS[real], "-", "-", device.title))


def peer_programs(
    device: Device, block: Block, stream: Stream, system: System
) -> dict[str, dict[str, str]]:
    """The C of every compiled peer: generated in both formats, and CasADi's own in both."""
    simulator = block.simulator()
    programs = {}
    for real in ("f64", "f32"):
        renderer = renderer_of(device, system, real)
        generated = stream_program(renderer, block, stream)
        clock = {"clock.c": renderer.render("bench/clock.c.j2")}
        programs[f"generated {real}"] = generated | clock
        loop = renderer.render(
            "bench/casadi.c.j2",
            block=block,
            sizes={"state": sum(p.size for p in block.state)},
            coefficients=[x for c in simulator.coefficients.values() for x in c.tolist()],
            initial=[x for s in simulator.state.values() for x in s.tolist()],
            work=(block.step.sz_iw(), block.step.sz_w()),
        )
        # CasADi's text refers to nothing of ours but the number it computes in.
        real_t = "" if real == "f64" else "#define casadi_real float\n"
        named = {n.removeprefix("reference/"): t for n, t in casadi_c(system).items()}
        own = {n: t for n, t in named.items() if n.endswith(".c")} | {"loop.c": loop}
        common = {n: generated[n] for n in ("bench.h", "stream.h")} | clock
        name = CASADI if real == "f64" else CASADI_FLOAT
        programs[name] = common | {n: real_t + t for n, t in own.items()}
    return programs


class CompiledPeer:
    """A peer in C, called through cffi once a measurement."""

    def __init__(self, name: str, files: dict[str, str], block: Block, stream: Stream) -> None:
        self.name = name
        ffi = self._ffi = cffi.FFI()
        ffi.cdef(
            "void esea_bench_load(const double *); void esea_bench_results(double *);"
            "double esea_bench_run(int);"
        )
        self._lib: Any = ffi.dlopen(str(compile_sources(files, LIBRARY_FLAGS, ("-lm",))))
        self._shape = (stream.steps, sum(p.size for p in block.outputs))
        rows = np.hstack([stream.inputs[p.name].reshape(stream.steps, -1) for p in block.inputs])
        self._lib.esea_bench_load(ffi.cast("double *", np.ascontiguousarray(rows).ctypes.data))

    def run(self, passes: int) -> float:
        """Seconds for a number of passes through the whole stream."""
        return float(self._lib.esea_bench_run(passes))

    def results(self) -> Array:
        """Outputs of the last pass, shape (steps, outputs)."""
        out = np.empty(self._shape)
        self._lib.esea_bench_results(self._ffi.cast("double *", out.ctypes.data))
        return out


class EvaluatorPeer:
    """CasADi's evaluator, ``Function.mapaccum``: one call a stream, so no Python in the loop."""

    name = "CasADi evaluator, one call a stream"

    def __init__(self, block: Block, stream: Stream) -> None:
        simulator, states = block.simulator(), len(block.state)
        groups = (block.coefficients, block.state, block.inputs)
        c, s, u = ([ca.SX.sym(p.name, p.size) for p in group] for group in groups)
        results = block.step.call([*c, *s, *u])
        one = ca.Function(
            "one",
            [ca.veccat(*s), ca.veccat(*u), ca.veccat(*c)],
            [ca.veccat(*results[:states]), ca.veccat(*results[states:])],
        )
        self._loop = one.mapaccum("loop", stream.steps)
        rows = np.hstack([stream.inputs[p.name].reshape(stream.steps, -1) for p in block.inputs])
        start = ca.DM(np.concatenate([*simulator.state.values()]))
        fixed = ca.DM(np.concatenate([np.zeros(0), *simulator.coefficients.values()]))
        self._arguments = [start, ca.DM(rows.T), ca.repmat(fixed, 1, stream.steps)]

    def run(self, passes: int) -> float:
        start = time.thread_time()
        for _ in range(passes):
            self._loop.call(self._arguments)
        return time.thread_time() - start


def hand_program(device: Device, renderer: Any, stream: Stream) -> dict[str, str]:
    """The torque model as one writes it in C, for a device with rate terms and no dead zone."""
    numbers = {c.name: c.value for c in device.constants("elastomer")}
    stops = [[float(x) for x in part] for part in stop_grid(numbers, int(numbers["stops"]))]
    model = {"p": numbers, "h": device.period_s, "stops": stops, "q27": exponent_q27}
    rows = np.column_stack([stream.inputs[k] for k in ("theta_rad", "omega_rad_s")])
    own = {n: text for n, text in renderer.files().items() if "esea_f32" in n}
    own |= {"hand.c": renderer.render("bench/hand_sensor.c.j2", **model)}
    return own | looped(renderer, rows, 1) | {"clock.c": renderer.render("bench/clock.c.j2")}


LOOP = """#include "bench.h"
void peer_init(void);
void peer_step(const float *in, float *out);
static float in[BENCH_STEPS][BENCH_INPUTS], out[BENCH_STEPS][BENCH_OUTPUTS];
void bench_load(const double *from)
{ for (int k = 0; k < BENCH_STEPS * BENCH_INPUTS; ++k) in[0][k] = (float)from[k]; }
void bench_pass(void)
{
    peer_init();
    for (int k = 0; k < BENCH_STEPS; ++k) peer_step(in[k], out[k]);
}
void bench_results(double *to)
{ for (int k = 0; k < BENCH_STEPS * BENCH_OUTPUTS; ++k) to[k] = (double)out[0][k]; }
"""


def looped(renderer: Any, rows: Array, outputs: int) -> dict[str, str]:
    """The loop around a peer's ``peer_init`` and ``peer_step``, and its stream."""
    sizes = {"inputs": rows.shape[1], "outputs": outputs}
    context = {"sizes": sizes, "steps": len(rows), "rows": rows.tolist()}
    named = {n: renderer.render(f"bench/{n}.j2", **context) for n in ("bench.h", "stream.h")}
    return named | {"loop.c": LOOP}


def in_turns(ours: Any, peer: Any, per_pass: float, pairs: int) -> dict[str, float]:
    """Time two programs in turns, so that what runs beside them falls on both alike.

    return: ns of each over ``per_pass``, and the quartiles of the pairs' ratios.
    """
    passes = []
    for p in (ours, peer):
        p.run(1)
        passes.append(max(1, int(MEASURE_S / max(p.run(1), 1e-9))))
    times = np.empty((pairs, 2))
    for k in range(pairs):
        for i in (0, 1) if k % 2 == 0 else (1, 0):
            times[k, i] = 1e9 * (ours, peer)[i].run(passes[i]) / (passes[i] * per_pass)
    low, ratio, high = np.quantile(times[:, 1] / times[:, 0], [0.25, 0.5, 0.75]).tolist()
    a, b = np.median(times, axis=0).tolist()
    return {"ours": a, "peer": b, "ratio": ratio, "low": low, "high": high, "unit": "ns"}


def medians_us(runs: dict[Any, Any], rounds: int, per_run: float) -> dict[Any, float]:
    """Median thread time of each in turns, in us over ``per_run``."""
    taken: dict[Any, list[float]] = {k: [] for k in runs}
    for _ in range(rounds):
        for key, run in runs.items():
            start = time.thread_time()
            run()
            taken[key].append(time.thread_time() - start)
    return {k: 1e6 * float(np.median(v)) / per_run for k, v in taken.items()}


def exact(ours: float, peer: float, unit: str) -> dict[str, Any]:
    """Two figures that do not scatter."""
    return {"ours": ours, "peer": peer, "ratio": peer / ours, "unit": unit}
