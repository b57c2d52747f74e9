"""Instructions of QP solvers on emulated boards, on the problems of a public benchmark.

    python -m tests.benchmarks.mcu_solvers [--tinympc FOLDER] [--spread X]

As in https://github.com/RoboticExplorationLab/mcu-solver-benchmarks a random system of 10 states
and 4 inputs within +-3 tracks the path of random inputs, here over 2, 4 and 8 intervals: a box QP.
OSQP and TinyMPC have its settings and start from their last solve.  OSQP is no dependency: pip
install osqp.  FOLDER is its ``ICRA_benchmarks/teensy_tinympc2_benchmark/lib/tinympc``, which takes
C++ headers for the boards (Debian: libstdc++-arm-none-eabi-newlib).
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy import linalg, optimize, sparse

from esea_gen.hostlib.compiler import run_tool
from esea_gen.language.stream import Stream
from esea_gen.targets import boards_for
from tests.box_qp_program import box_qp
from tests.rendered_program import render_program

from .peers import CompiledPeer, looped, with_templates
from .step_count import count_step, stream_program

NX, NU, RHO, MOST, STEPS = 10, 4, 0.1, 3.0, 20
OSQP = """#include "osqp.h"
#include "mpc_workspace.h"
void peer_init(void) { }
void peer_step(const float *in, float *out)
{
    osqp_update_data_vec(&mpc_solver, in, 0, 0);
    osqp_solve(&mpc_solver);
    for (int k = 0; k < 4; ++k) out[k] = mpc_solver.solution->x[k];
}
"""
TINY = """#include "admm.cpp"
static TinyCache cache; static TinyWorkspace work;
static TinySettings settings = { 1e-4f, 1e-4f, 4000, 1, 0, 1 };
static TinySolver solver = { &settings, &cache, &work };
extern "C" void peer_init(void) { %s }
extern "C" void peer_step(const float *in, float *out)
{
    work.x.col(0) = Eigen::Map<const tiny_VectorNx>(in);
    work.Xref = Eigen::Map<const tiny_MatrixNxNh>(in + NSTATES);
    tiny_solve(&solver);
    Eigen::Map<tiny_VectorNu>(out).noalias() = work.znew.col(0);
}
"""


def problems(n: int, spread: float) -> SimpleNamespace:
    """A random system over n intervals, and problems along a path with their exact minima."""
    rng, p = np.random.default_rng(123), SimpleNamespace(n=n)
    p.Q, A, p.B = (rng.uniform(-1, 1, (NX, m)) for m in (1, NX, NU))
    p.A, p.Q, R, path = A / np.linalg.norm(A, 2), 5 + 5 * p.Q, 0.1 * np.eye(NU), [np.zeros(NX)]
    Q, x, u, found = np.diag(p.Q.ravel()), np.zeros(NX), np.zeros(NU * n), []
    p.P = linalg.solve_discrete_are(p.A, p.B, Q + RHO * np.eye(NX), R + RHO * np.eye(NU))
    p.G = np.linalg.inv(R + RHO * np.eye(NU) + p.B.T @ p.P @ p.B)
    for drive in spread * rng.normal(size=(STEPS + n, NU)):
        path.append(p.A @ path[-1] + p.B @ drive)
    powers = [np.linalg.matrix_power(p.A, k) for k in range(n + 1)]
    gamma = np.block([[powers[max(i - j, 0)] @ p.B * (i >= j) for j in range(n)] for i in range(n)])
    # TinyMPC weighs the last state by P - rho I and its reference by P.
    weight, pull = (linalg.block_diag(*[Q] * (n - 1), x) for x in (p.P - RHO * np.eye(NX), p.P))
    p.H = gamma.T @ weight @ gamma + linalg.block_diag(*[R] * n)
    root = np.linalg.cholesky(p.H).T
    for k in range(STEPS):
        ref, start = np.concatenate(path[k : k + n + 1]), np.concatenate([u[NU:], u[-NU:]])
        f = gamma.T @ (weight @ np.vstack(powers[1:]) @ x - pull @ ref[NX:])
        u = optimize.lsq_linear(root, -linalg.solve(root.T, f), (-MOST, MOST), method="bvls").x
        found.append((x, ref, f, start, u))
        x = p.A @ x + p.B @ u[:NU] + rng.uniform(-0.01, 0.01, NX)
    p.x, p.ref, p.f, p.start, p.u = (np.array(v) for v in zip(*found, strict=True))
    return p


def osqp_c(p: SimpleNamespace) -> dict[str, str]:
    """OSQP's generated C, with its step."""
    H, eye = sparse.csc_matrix(np.triu(p.H)), sparse.eye(len(p.H), format="csc")
    solver, box = importlib.import_module("osqp").OSQP(), np.full(len(p.H), MOST)
    settings: dict[str, Any] = {"alpha": 1.0, "scaling": 0, "check_termination": 1, "rho": 0.1}
    settings |= {"eps_abs": 1e-3, "eps_rel": 1e-3, "max_iter": 4000, "adaptive_rho": False}
    solver.setup(H, p.f[0], eye, -box, box, verbose=False, **settings)
    written = {"use_float": True, "extension_name": None, "force_rewrite": True, "compile": False}
    with tempfile.TemporaryDirectory() as scratch:
        solver.codegen(scratch, prefix="mpc_", **written)
        paths = [x for x in Path(scratch).rglob("*.[ch]") if x.name != "emosqp.c"]
        return {"step.c": OSQP} | {x.name: x.read_text(encoding="utf-8") for x in paths}


def tiny_c(p: SimpleNamespace, folder: Path, command: list[str]) -> dict[str, str]:
    """TinyMPC as a C file of a processor's assembly."""
    K = p.G @ p.B.T @ p.P @ p.A
    places = {"cache.Kinf": K, "cache.Pinf": p.P, "cache.Quu_inv": p.G, "work.Q": p.Q}
    places |= {"cache.AmBKt": (p.A - p.B @ K).T, "work.Adyn": p.A, "work.Bdyn": p.B}
    init = [f"{k} << {', '.join(map(str, v.ravel()))};" for k, v in places.items()]
    init += [f"cache.rho = {RHO}; work.u_min.setConstant(-{MOST}); work.u_max.setConstant({MOST});"]
    sizes = {"NSTATES": NX, "NINPUTS": NU, "NHORIZON": p.n + 1}
    defined = "".join(f"#define {k} {v}\n" for k, v in sizes.items())
    with tempfile.TemporaryDirectory() as scratch:
        for name in ("types.hpp", "admm.hpp", "admm.cpp"):
            shutil.copy(folder / name, scratch)
        texts = {"glob_opts.hpp": f"typedef float tinytype;\n{defined}", "iostream": ""}
        for name, text in (texts | {"tiny.cpp": TINY % "\n".join(init)}).items():
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        command += ["-O2", "-ffp-contract=off", "-fno-exceptions", "-S", "-o-", f"-I{folder}"]
        done = run_tool([*command, f"-I{scratch}", f"{scratch}/tiny.cpp"], failed="TinyMPC")
    quoted = "\n".join(json.dumps(line + "\n") for line in done.stdout.splitlines())
    return {"step.c": f"__asm__(\n{quoted}\n);\n"}


def rows(p: SimpleNamespace, tiny: Path | None) -> None:
    """Print a line a solver and board: instructions, largest distance from the minimum."""
    n, box = len(p.H), np.full(p.f.shape, MOST)
    renderer = with_templates(render_program(box_qp(n), "f32"))
    block: Any = renderer.system.kinds[0]
    numbers = {"H": np.tile(p.H[np.tril_indices(n)], (STEPS, 1)), "f": p.f, "start": p.start}
    stream = Stream("path", numbers | {"low": -box, "high": box})
    own = stream_program(renderer, block, stream)
    alone = SimpleNamespace(inputs=block.inputs[:1], outputs=[SimpleNamespace(size=NU)])
    # OSQP's C has constants in double, which one board would compute without an FPU.
    single = ("-fsingle-precision-constant",)
    boards = [replace(b, flags=(*b.flags, *single)) for b in boards_for("instructions")]
    given = {"OSQP": p.f} | ({"TinyMPC": np.hstack([p.x, p.ref])} if tiny else {})

    def made(name: str, command: list[str]) -> dict[str, str]:
        if name == "ours":
            return own
        files = tiny_c(p, tiny, command) if tiny and name == "TinyMPC" else osqp_c(p)
        return files | looped(renderer, given[name], NU)

    for name in ("ours", *given):
        files = made(name, ["g++", "-fPIC"]) | {"clock.c": renderer.render("bench/clock.c.j2")}
        on = (block, stream) if name == "ours" else (alone, Stream("path", {"H": given[name]}))
        peer = CompiledPeer(name, files, *on)
        peer.run(1)
        apart = np.max(np.abs(peer.results()[:, :NU] - p.u[:, :NU]))
        for board in boards[:2]:
            files = made(name, ["arm-none-eabi-g++", *board.compile_flags])
            step = f"{renderer.prefix}_{block.name}_step" if name == "ours" else "peer_step"
            count = count_step(board, files, renderer, step, libm=name != "ours")
            print(
                f"n {n:2} {board.core} {name}: {count.mean:.0f} instructions, at most {count.most},"
                f" {apart:.0e} from the minimum",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tinympc", type=Path, help="folder of its admm.cpp and Eigen.h")
    parser.add_argument("--spread", type=float, default=1.0, help="of the path's inputs")
    chosen = parser.parse_args()
    if chosen.tinympc and not (chosen.tinympc / "admm.cpp").is_file():
        parser.error(f"{chosen.tinympc} has no admm.cpp: name the folder lib/tinympc.")
    if importlib.util.find_spec("osqp") is None:
        parser.error("OSQP is missing: pip install osqp.")
    for n in (2, 4, 8):
        rows(problems(n, chosen.spread), chosen.tinympc)


if __name__ == "__main__":
    main()
