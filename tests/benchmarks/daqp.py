"""The box QP against DAQP's own C, in one run: ratios for n = 5 to 30 in f64 and f32.

    python -m tests.benchmarks.daqp FOLDER

FOLDER holds ``src`` and ``include`` of https://github.com/darnstrom/daqp.  Both sides are compiled
with the same flags and loop over the problems in C; both are given a new Hessian and a cold start
each time, and neither allocates memory there.  Times are the thread's own, in turns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cffi
import numpy as np

from esea_gen.hostlib.compiler import compile_sources
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.ports import Array
from tests.box_qp_program import box_qp
from tests.rendered_program import render_program

from .peers import medians_us

SIZES = (5, 10, 15, 20, 25, 30)
LOOP = """
#include "api.h"
int daqp_loop(int n, int count, double *H, double *f, double *low, double *high, double *x);
int daqp_loop(int n, int count, double *H, double *f, double *low, double *high, double *x)
{
    static DAQPWorkspace work;
    static int made;
    DAQPProblem qp = {0};
    DAQPResult res;
    double lam[64], dt;
    int k, failed = 0;
    const int all = DAQP_UPDATE_Rinv | DAQP_UPDATE_M | DAQP_UPDATE_v | DAQP_UPDATE_d
        | DAQP_UPDATE_sense | DAQP_UPDATE_unconstrained;
    qp.n = qp.m = qp.ms = n; qp.bupper = high; qp.blower = low; qp.H = H; qp.f = f;
    if (made != n) { setup_daqp(&qp, &work, &dt); made = n; }
    for (k = 0; k < count; ++k) {
        qp.H = H + k * n * n; qp.f = f + k * n; qp.blower = low + k * n; qp.bupper = high + k * n;
        reset_daqp_workspace(&work);
        daqp_update_ldp(all, &work, &qp);
        res.x = x + k * n; res.lam = lam;
        daqp_solve(&res, &work);
        failed += res.exitflag != 1;
    }
    return failed;
}
"""


def problems_of(n: int, count: int) -> tuple[list[tuple[Array, Array]], dict[str, Array]]:
    """Problems (H, f) as predictive control gives them, in the box -1 to 1, and our inputs."""
    rng = np.random.default_rng(1)
    problems = []
    for k in range(count):
        s = np.cumsum(np.exp(-np.arange(n) / rng.uniform(2, 20)))
        j = 17.0 * np.array([[s[a - b] if a >= b else 0 for b in range(n)] for a in range(n)]) / n
        target = rng.normal(size=n) * (0.3 if k % 3 else 30.0)  # a third with active bounds
        problems.append((j.T @ j + 0.4 * np.eye(n), -j.T @ target))
    inputs = {
        "H": np.array([h[np.tril_indices(n)] for h, _ in problems]),
        "f": np.array([f for _, f in problems]),
        "low": -np.ones((count, n)),
        "high": np.ones((count, n)),
        "start": np.zeros((count, n)),
    }
    return problems, inputs


def daqp(folder: Path, real: str, problems: list[tuple[Array, Array]]) -> Callable[[], Array]:
    """DAQP over all problems: minima; a RuntimeError where it gives one up."""
    sources = [*(folder / "src").glob("*.c"), *(folder / "include").glob("*.h")]
    c_type = "double" if real == "f64" else "float"
    loop = LOOP.replace("double", c_type).replace('"api.h"', '"api.h"\n#include "utils.h"')
    files = {p.name: p.read_text(encoding="utf-8") for p in sources} | {"loop.c": loop}
    flags = ("-O2", *["-DDAQP_SINGLE_PRECISION"] * (real == "f32"))
    ffi = cffi.FFI()
    ffi.cdef(f"int daqp_loop(int, int, {', '.join([f'{c_type} *'] * 5)});")
    library: Any = ffi.dlopen(str(compile_sources(files, flags, ("-lm",))))
    n, count = len(problems[0][1]), len(problems)
    dtype = np.float64 if real == "f64" else np.float32
    box = [np.full((count, n), end, dtype) for end in (-1, 1)]
    arrays = [np.array([p[k] for p in problems], dtype) for k in (0, 1)] + box
    out = np.zeros((count, n), dtype)
    pointers = [ffi.from_buffer(f"{c_type}[]", a) for a in (*arrays, out)]

    def run() -> Array:
        if failed := library.daqp_loop(n, count, *pointers):
            raise RuntimeError(f"DAQP gave up {failed} of {count} problems of {n} variables")
        return out

    return run


def ours(real: str, inputs: dict[str, Array], n: int) -> Callable[[], Array]:
    renderer = render_program(box_qp(n), real)
    library = HostLibrary(renderer.system, renderer, ("-O2",))
    runner = library.block("box_qp")
    packed = runner.pack(inputs)
    out = np.zeros(len(packed), library.dtype(f"{runner.stem}_out_t"))

    def run() -> Array:
        runner.run_into(packed, out, out[:0])
        return out["x"]

    return run


def rows(folder: Path, count: int = 200, rounds: int = 41) -> list[dict[str, Any]]:
    found = []
    for n in SIZES:
        problems, inputs = problems_of(n, count)
        for real in ("f64", "f32"):
            runs = {"ours": ours(real, inputs, n), "daqp": daqp(folder, real, problems)}
            far = float(np.max(np.abs(runs["ours"]() - runs["daqp"]())))
            us = medians_us(runs, rounds, count)
            found.append({"n": n, "real": real, "ours_us": us["ours"], "daqp_us": us["daqp"]})
            found[-1] |= {"ratio": us["daqp"] / us["ours"], "apart": far}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    chosen = parser.parse_args()
    if not (chosen.folder / "src" / "api.c").is_file():
        parser.error(f"{chosen.folder} holds no src/api.c: give DAQP's source folder.")
    found = rows(chosen.folder)
    for r in found:
        print(
            "n {n:2} {real}: {ours_us:.2f} us, DAQP {daqp_us:.2f} us, DAQP over ours {ratio:.2f},"
            " minima {apart:.0e} apart".format(**r)
        )


if __name__ == "__main__":
    main()
