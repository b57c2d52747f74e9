"""The complete predictive step against C that CasADi generates from the same model.

CasADi's side: the rollout over the same substeps, the stop operators in their clip form, and the
Jacobian of all residuals by its own differentiation, as one function.  Guards, condensing and the
QP are not in it, so that the comparison favours it.
"""

from __future__ import annotations

import math
import re
from types import SimpleNamespace
from typing import Any

import casadi as ca
import cffi
import numpy as np

from esea_gen.control.laws.predictive import device_horizon, drive_train
from esea_gen.control.predictive.drive import drive_model
from esea_gen.control.predictive.horizon import Horizon, Model, linearise
from esea_gen.control.predictive.program import predictive_program
from esea_gen.hostlib.compiler import compile_sources
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.ports import Array
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.controllers import controller_device
from tests.rendered_program import render_program

from .peers import medians_us
from .predictive_loop import recorded_rows


def flat_residuals(model: Model, horizon: Horizon) -> ca.Function:
    """Residuals of the whole horizon and their Jacobian as one function.

    return: ``f(inputs, coefficients, plan) -> residuals, Jacobian``; inputs port by port, errors
        before efforts.
    """
    assert model.stops is not None
    assert model.deflection is not None
    sizes = [p.size for p in model.inputs]
    given = ca.SX.sym("inputs", sum(sizes))
    ends = np.cumsum([0, *sizes])
    parts = {
        p.name: given[int(a) : int(b)]
        for p, a, b in zip(model.inputs, ends, ends[1:], strict=False)
    }
    u = SimpleNamespace(**parts)
    coefficients = ca.SX.sym("coefficients", len(model.coefficients))
    values = {p.name: coefficients[i] for i, p in enumerate(model.coefficients)} | parts
    p_all = ca.vertcat(*[values[n] for n in model.parameters])
    p = SimpleNamespace(**{n: values[n] for n in model.parameters})
    plan = ca.SX.sym("plan", horizon.intervals)
    kept: Any = model.deflection(u) - parts[model.play]
    gaps = np.diff(model.stops.r, prepend=0.0)
    stops: list[Any] = []
    last: Any = ca.SX(0)
    for i, gap in enumerate(gaps):
        last = ca.fmax(ca.fmin(kept[i], last + gap), last - gap)
        stops.append(last)

    def torque() -> Any:
        total: Any = ca.SX(0)
        for weight, stop in zip(model.stops.p, stops, strict=True):  # type: ignore[union-attr]
            total = total + weight * stop
        return total

    start = model.start(u, torque())
    x = ca.vertcat(*[start[s] for s in model.states])
    delta: Any = model.deflection(u)

    def advance(x: Any, force: Any, h: float, w: Any) -> Any:
        nonlocal stops, delta
        lin = linearise(model, h, model.u_max)
        named, ahead = lin.before.call([x, force, p_all, w])
        stops = [
            ca.fmax(ca.fmin(s + (ahead - delta), r), -r)
            for s, r in zip(stops, model.stops.r, strict=True)  # type: ignore[union-attr]
        ]
        delta = ahead
        return lin.after.call([x, force, p_all, w, named, torque(), ca.SX(0)])[0]

    def forecast(t: float) -> Any:
        return ca.vertcat(*[f(u, p, model.shape(t)) for f in model.forecasts.values()])

    for _ in range(horizon.delay_substeps):
        late = horizon.delay_s / horizon.delay_substeps
        x = advance(x, parts[model.in_force], late, forecast(0.5 * horizon.delay_s))
    errors: list[Any] = []
    efforts: list[Any] = []
    for k in range(horizon.intervals):
        force = model.u_max * plan[k]
        now = SimpleNamespace(**dict(zip(model.states, ca.vertsplit(x), strict=True)))
        length = horizon.lengths_s[k]
        weight = math.sqrt(length / horizon.interval_s)
        efforts += [weight * e for e in model.effort(now, force, p)]
        for _ in range(horizon.substeps):
            middle = horizon.ends_s[k] - 0.5 * length
            x = advance(x, force, length / horizon.substeps, forecast(middle))
        now = SimpleNamespace(**dict(zip(model.states, ca.vertsplit(x), strict=True)))
        refs = SimpleNamespace(
            **{n: parts[s][k] if many else parts[s] for n, (s, many) in model.references.items()}
        )
        errors += [weight * e for e in model.error(now, p, refs)]
    residuals = ca.vertcat(*errors, *efforts)
    jacobian = ca.densify(ca.jacobian(residuals, plan))
    outputs = ca.cse([residuals, jacobian])
    return ca.Function("flat", [given, coefficients, plan], outputs)


def step_times(controller: str, steps: int = 200, rounds: int = 25) -> dict[str, Any]:
    """Time our whole step, inputs packed, and CasADi's part of it on inputs of the closed loop.

    return: us a step by number format, the largest relative difference of the Jacobians, and the
        size of CasADi's C.
    """
    device = controller_device(controller)
    horizon = device_horizon(device)
    train = drive_train(device)
    model = drive_model(device, horizon, preview=True, impedance=True, train=train)
    program = predictive_program(model, horizon, period_s=0.005)
    rows = recorded_rows(controller, TuningCase().cases()[0], steps)
    stream = {}
    at = 0
    for port in program.inputs:
        block = rows[:, at : at + port.size]
        stream[port.name] = block[:, 0] if port.size == 1 else block
        at += port.size
    simulator = program.simulator()
    coefficients = np.concatenate(list(simulator.coefficients.values()))
    flat = flat_residuals(model, horizon)

    # The Jacobians agree: the same model, differentiated twice.
    simulator.step(**{k: v[0] for k, v in stream.items()})
    jacobian = np.array(flat(rows[0], coefficients, np.zeros(horizon.intervals))[1])
    n = horizon.intervals
    mine = np.zeros_like(jacobian)
    for offset, name in ((0, "error_0_rows"), (n, "effort_0_rows")):
        packed = simulator.array(name)
        i, j = np.tril_indices(n)
        mine[offset + i, j] = packed
    difference = float(np.max(np.abs(mine - jacobian)) / np.max(np.abs(jacobian)))

    runs: dict[tuple[str, str], Any] = {}
    size = 0
    for real in ("f64", "f32"):
        renderer = render_program(program, real)
        runner = HostLibrary(renderer.system, renderer, ("-O2",)).block(program.name)
        runs["ours", real] = lambda runner=runner: runner.run(stream, trace=False)
        run, size = _peer(flat, rows, coefficients, n, real)
        runs["peer", real] = run
    times = medians_us(runs, rounds, steps)
    return {
        "ours_us": {r: times["ours", r] for r in ("f64", "f32")},
        "peer_us": {r: times["peer", r] for r in ("f64", "f32")},
        "jacobian_difference": difference,
        "peer_bytes": size,
    }


def _peer(
    flat: ca.Function, rows: Array, coefficients: Array, n: int, real: str
) -> tuple[Any, int]:
    c_type = "double" if real == "f64" else "float"
    generator = ca.CodeGenerator("flat.c", {"casadi_real": c_type, "casadi_int": "int"})
    generator.add(flat)
    text = generator.dump()
    # C's own single-precision functions in place of the double ones that CasADi names.
    math = "" if real == "f64" else "#include <tgmath.h>\n"
    work = flat.sz_w()
    loop = f"""
#include <stddef.h>
typedef {c_type} real;
int flat(const real **arg, real **res, int *iw, real *w, int mem);
void peer_run(const real *rows, const real *coefficients, const real *plan, real *out, int steps);
void peer_run(const real *rows, const real *coefficients, const real *plan, real *out, int steps)
{{
    static real w[{work} + 1];
    static int iw[{flat.sz_iw()} + 1];
    const real *arg[{flat.sz_arg()}];
    real *res[{flat.sz_res()}];
    int k;
    for (k = 0; k < steps; ++k) {{
        arg[0] = rows + k * {rows.shape[1]};
        arg[1] = coefficients;
        arg[2] = plan;
        res[0] = out;
        res[1] = out + {2 * n};
        flat(arg, res, iw, w, 0);
    }}
}}
"""
    text = re.sub(r"#include <math.h>\n", f"#include <math.h>\n{math}", text)
    path = compile_sources({"flat.c": text, "loop.c": loop}, ("-O2",), ("-lm",))
    ffi = cffi.FFI()
    ffi.cdef(
        f"void peer_run(const {c_type} *, const {c_type} *, const {c_type} *, {c_type} *, int);"
    )
    library: Any = ffi.dlopen(str(path))
    dtype = np.float64 if real == "f64" else np.float32
    arrays = [
        np.ascontiguousarray(a, dtype=dtype)
        for a in (rows, coefficients, np.zeros(n), np.zeros(2 * n + 2 * n * n))
    ]
    pointers = [ffi.cast(f"{c_type} *", a.ctypes.data) for a in arrays]

    def run() -> None:
        library.peer_run(*pointers, len(rows))
        arrays[0].sum()

    return run, len(text)
