"""What predictive control costs: bound, worst seen and typical instructions; peers beside it.

    python -m tests.benchmarks.predictive --json predictive.json

Instructions are counted on the object code (the bound) and in an emulator (what was seen); they are
not cycles.  Times are of this machine, the thread's own, in turns with each peer.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.board.bound import InstructionBound, step_bound
from esea_gen.control.laws.predictive import device_horizon, drive_train
from esea_gen.control.predictive.box_qp_program import box_qp
from esea_gen.control.predictive.drive import predictive_controller
from esea_gen.control.predictive.horizon import Horizon
from esea_gen.emit.program_c import loop_lines
from esea_gen.emit.program_render import ProgramRenderer, render_program
from esea_gen.errors import UserError
from esea_gen.files import write_json
from esea_gen.hostlib.compiler import find_compiler
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.ports import Array
from esea_gen.language.program import Program
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.targets import BARE_LINK, BOARDS, EXACT_FLAGS, SECTION_FLAGS, boards_for
from esea_gen.twin.controllers import controller_device
from tests.benchmarks.predictive_loop import recorded_rows
from tests.benchmarks.predictive_peer import step_times

CORES = {b.core: b.processor for b in boards_for("instructions")}
FLAGS = (*EXACT_FLAGS, *SECTION_FLAGS, "-g")
CYCLES_PER_INSTRUCTION = (1.0, 1.5, 2.0)
AIM_BOUND, AIM_TYPICAL = 120_000, 45_000


@dataclass(frozen=True)
class Cost:
    """Cost of a step on one core.

    code_bytes, table_bytes, state_bytes: instructions of the step's functions with their constants,
        tables, and the caller's state.
    """

    bound: InstructionBound
    code_bytes: int
    table_bytes: int
    state_bytes: int


def _build(renderer: ProgramRenderer, folder: Path, core: str, extra: dict[str, str]) -> Path:
    gcc = find_compiler(*CORES[core].toolchain.gcc)
    files = renderer.files() | extra
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    sources = [str(folder / n) for n in files if n.endswith(".c")]
    out = folder / "program.elf"
    link = [*BARE_LINK, "--specs=nosys.specs", f"-T{folder / 'bare.ld'}"]
    command = [gcc, *CORES[core].flags, *FLAGS, f"-I{folder}", *sources, *link, "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the compiler refuses the program:\n{done.stderr}")
    return out


def _board(renderer: ProgramRenderer, rows: Array, tunables: dict[str, float]) -> dict[str, str]:
    program: Any = renderer.system.kinds[0]
    fmt = renderer.fmt
    renderer.env.filters["literal"] = lambda v: fmt.literal(float(np.float32(v)))
    board = renderer.render(
        "predictive/board.c.j2",
        block=program,
        rows=np.asarray(rows).tolist(),
        timer="tim2",
        tunables=tunables,
    )
    return {"board.c": board, "bare.ld": renderer.render("bench/bare.ld.j2")}


def _entry(renderer: ProgramRenderer) -> dict[str, str]:
    # Only to be linked, so that calls have their targets; never run.
    program: Any = renderer.system.kinds[0]
    stem = f"{renderer.prefix}_{program.name}"
    coeffs = bool(program.coefficients)
    text = f'#include "{renderer.prefix}.h"\n'
    text += f"static {stem}_coeffs_t coeffs;\n" if coeffs else ""
    text += f"{stem}_state_t state;\n{stem}_in_t in;\n{stem}_out_t out;\nvoid entry(void);\n"
    text += (
        f"void entry(void) {{ {stem}_step({'&coeffs, ' if coeffs else ''}&state, &in, &out); }}\n"
    )
    return {"entry.c": text, "bare.ld": renderer.render("bench/bare.ld.j2")}


def cost_on(program: Program, core: str) -> Cost:
    """Bound, stack and memory of a program's f32 step on one core, from its object code."""
    renderer = render_program(program, "f32")
    source = f"{renderer.prefix}_{program.name}.c"
    loops = renderer.emitted[program.name].loops  # type: ignore[union-attr]
    with tempfile.TemporaryDirectory() as scratch:
        elf = _build(renderer, Path(scratch), core, _entry(renderer))
        text = (Path(scratch) / source).read_text(encoding="utf-8")
        bound = step_bound(
            elf, f"{renderer.prefix}_{program.name}_step", source, loop_lines(text, loops), loops
        )
        symbols = _sizes(elf)
    code = sum(symbols.get(f, 0) for f in bound.by_function)
    tables = sum(size for name, size in symbols.items() if name.startswith(f"{program.name}_"))
    tables -= sum(symbols.get(f, 0) for f in bound.by_function if f.startswith(program.name))
    return Cost(bound, code, tables, symbols["state"])


def _sizes(elf: Path) -> dict[str, int]:
    said = subprocess.run(
        ["arm-none-eabi-nm", "-S", str(elf)], capture_output=True, text=True, check=True
    ).stdout
    return {m[2]: int(m[1], 16) for m in re.finditer(r"^\w+ (\w+) \w (\S+)$", said, re.MULTILINE)}


def seen_on_m4f(
    program: Program, rows: Array, tunables: dict[str, float] | None = None
) -> tuple[Array, Any]:
    """Instructions of each step of a stream on an emulated Cortex-M4F.

    rows: shape (steps, numbers): the inputs, port by port.
    """
    from esea_gen.board.emulator import qemu_command

    qemu = qemu_command(BOARDS["netduinoplus2"], semihosting=True)
    renderer = render_program(program, "f32")
    with tempfile.TemporaryDirectory() as scratch:
        board = _board(renderer, rows, tunables or {})
        elf = _build(renderer, Path(scratch), "Cortex-M4F", board)
        done = subprocess.run(
            [*qemu, "-icount", "shift=0", "-kernel", str(elf)],
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
            stdin=subprocess.DEVNULL,
        )
    found = re.findall(r"^([0-9a-f]{8}) ([0-9a-f]{8})$", done.stdout + done.stderr, re.MULTILINE)
    if len(found) != len(rows):
        raise RuntimeError(f"the emulated board answered {len(found)} of {len(rows)} steps")
    first = np.array([int(b, 16) for _, b in found], dtype=np.uint32).view(np.float32)
    return np.array([int(a, 16) for a, _ in found], dtype=float), first


def stress_rows(program: Program, count: int, seed: int = 0) -> Array:
    """Inputs meant to take long: every port over its whole range, memories that turn back.

    program: from :func:`esea_gen.control.predictive.drive.predictive_controller`.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(count):
        share = 10 ** rng.uniform(-2, 0)
        row: list[float] = []
        delta = 0.0
        for p in program.inputs:
            half = 0.5 * (p.high - p.low)
            value = 0.5 * (p.low + p.high) + share * half * rng.uniform(-1, 1, p.size)
            if p.name == "mode":
                value = np.ones(1)
            elif p.name == "delta_rad":
                value = rng.uniform(-0.25, 0.25, 1)
                delta = float(value[0])
            elif p.name == "play_rad":
                # All stops nearly saturated: a small turn lets them go, a small return ties them.
                radius = 0.0197 * np.arange(1, p.size + 1)
                value = delta - rng.choice([-1, 1]) * radius * rng.uniform(0.9, 1.0)
            elif k % 2 and p.name in ("omega_rad_s", "omega_l_rad_s"):
                value = value * 0.05
            row += [float(v) for v in value]
        rows.append(row)
    return np.array(rows)


# -- times on this machine ------------------------------------------------------------------------


def _turns(candidates: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    best: dict[str, list[float]] = {k: [] for k in candidates}
    for _ in range(rounds):
        for name, run in candidates.items():
            start = time.thread_time()
            run()
            best[name].append(time.thread_time() - start)
    return {k: float(np.median(v)) for k, v in best.items()}


def qp_rows(
    n: int = 10, count: int = 200, rounds: int = 15, into: dict[str, Any] | None = None
) -> list[str]:
    """The box QP against other solvers on the same problems, with the accuracy each reached.

    count: problems, as predictive control gives them, a third with active bounds.
    into: takes the same numbers.
    return: lines: microseconds a problem, largest error against a dense solution, ratio to ours.

    Peers are called through CasADi's generated-code-free interface, one call a problem, in a map
    over all of them, so that Python is not in the loop; their set-up of a new problem is included,
    as ours is.
    """
    rng = np.random.default_rng(1)
    problems = []
    for k in range(count):
        t = np.arange(n)
        s = np.cumsum(np.exp(-t / rng.uniform(2, 20)))
        j = 17.0 * np.array([[s[a - b] if a >= b else 0 for b in range(n)] for a in range(n)]) / n
        target = rng.normal(size=n) * (0.3 if k % 3 else 30.0)
        problems.append((j.T @ j + 0.4 * np.eye(n), -j.T @ target))
    inputs = {
        "H": np.array([[h[i, k] for i in range(n) for k in range(i + 1)] for h, _ in problems]),
        "f": np.array([f for _, f in problems]),
        "low": -np.ones((count, n)),
        "high": np.ones((count, n)),
        "start": np.zeros((count, n)),
    }
    runs: dict[str, Callable[[], Any]] = {}
    found: dict[str, Array] = {}
    for real in ("f64", "f32"):
        renderer = render_program(box_qp(n), real)
        runner = HostLibrary(renderer.system, renderer).block("box_qp")
        arrays = inputs

        def ours(runner: Any = runner, arrays: Any = arrays) -> Any:
            return runner.run(arrays, trace=False)[0]["x"]

        runs[f"ours {real}"] = ours
    h = ca.DM(np.hstack([a for a, _ in problems]))
    g = ca.DM(inputs["f"].T)
    low, high = ca.DM(inputs["low"].T), ca.DM(inputs["high"].T)
    dense = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity(0, n)}
    peers: tuple[tuple[str, dict[str, Any]], ...] = (
        ("daqp", {}),
        ("qpoases", {"printLevel": "none", "nWSR": 1000}),
        ("osqp", {"osqp": {"verbose": False, "eps_abs": 1e-5, "eps_rel": 1e-5}}),
        ("proxqp", {"proxqp": {"eps_abs": 1e-5, "verbose": False}}),
    )
    for name, options in peers:
        solver = ca.conic("peer", name, dense, {"error_on_fail": False, **options})
        mapped = solver.map(count)

        def peer(mapped: Any = mapped) -> Any:
            return np.array(mapped(h=h, g=g, lbx=low, ubx=high)["x"]).T

        runs[name] = peer
    for name, run in runs.items():
        found[name] = run()
    best = np.array([_dense_minimum(h, f) for h, f in problems])
    times = _turns(runs, rounds)
    lines = [f"{'box QP, ' + str(n) + ' variables':24} {'us':>8} {'error':>10} {'/ ours f32':>11}"]
    for name, seconds in times.items():
        error = float(np.max(np.abs(found[name] - best)))
        ratio = seconds / times["ours f32"]
        lines.append(f"{name:24} {1e6 * seconds / count:8.2f} {error:10.1e} {ratio:11.2f}")
        if into is not None:
            into[name] = {"problem_us": 1e6 * seconds / count, "error": error, "ratio": ratio}
    return lines


def _dense_minimum(h: Array, f: Array) -> Array:
    # Active set of a tight augmented-Lagrangian-free answer: coordinate descent to the end.
    x = np.zeros(len(f))
    for _ in range(20000):
        before = x.copy()
        for i in range(len(x)):
            x[i] = np.clip(x[i] - (h[i] @ x + f[i]) / h[i, i], -1, 1)
        if np.max(np.abs(x - before)) < 1e-13:
            break
    return x


def step_rows(into: dict[str, Any] | None = None) -> list[str]:
    """The whole step against CasADi's C of the same rollout and Jacobian.

    into: takes the same numbers.
    """
    seen = step_times("mpc")
    if into is not None:
        into |= asdict(seen)
    lines = [
        f"{'whole step (ours) / CasADi C, no QP':36} {'ours us':>8} {'peer us':>8} {'ratio':>6}"
    ]
    for real, ours in seen.ours_us.items():
        peer = seen.peer_us[real]
        lines.append(f"{real:36} {ours:8.2f} {peer:8.2f} {peer / ours:6.2f}")
    lines.append(
        f"Jacobians differ by {seen.difference:.1e} of the largest element; CasADi's C has "
        f"{seen.peer_bytes // 1000} kB"
    )
    return lines


def horizon_rows(
    core: str,
    lengths: Sequence[int] = (5, 10, 20, 40),
    figure: Path | None = None,
    into: list[dict[str, Any]] | None = None,
) -> list[str]:
    """Bound against the horizon's length; into: takes the same numbers."""
    device = controller_device("mpc")
    delay_s = device_horizon(device).delay_s
    parts: list[tuple[int, int]] = []
    lines = [f"{'intervals':>9}  {'bound':>9}  {'of it QP':>9}  state bytes"]
    for n in lengths:
        horizon = Horizon(intervals=n, delay_s=delay_s)
        program = predictive_controller(
            device, horizon=horizon, preview=True, impedance=True, train=drive_train(device)
        )
        c = cost_on(program, core)
        qp = sum(i for f, (i, _) in c.bound.by_function.items() if "_qp_" in f)
        lines.append(f"{n:9d}  {c.bound.instructions:9d}  {qp:9d}  {c.state_bytes}")
        parts.append((c.bound.instructions, qp))
        if into is not None:
            row = {"intervals": n, "bound": c.bound.instructions, "qp": qp}
            into.append(row | {"state_bytes": c.state_bytes})
    if figure is not None:
        _plot_horizons(np.array(lengths), np.array(parts, float), core, figure)
    return lines


def _plot_horizons(lengths: Array, parts: Array, core: str, path: Path) -> None:
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(6, 4), layout="constrained")
    axes = drawn.subplots()
    for name, values in (("whole step", parts[:, 0]), ("of it QP", parts[:, 1])):
        axes.loglog(lengths, values, "o-", label=name)
    # What a solver on the stages would cost, if it cost as much as this one at the default.
    start = np.interp(10, lengths, parts[:, 0])
    for power, style in ((1, ":"), (3, "--")):
        line = start * (lengths / 10.0) ** power
        axes.loglog(lengths, line, style, color="grey", label=f"intervals$^{power}$")
    axes.set(xlabel="intervals", ylabel=f"bound, instructions, {core}")
    axes.set_xticks(lengths, [str(n) for n in lengths])
    axes.minorticks_off()
    axes.legend()
    drawn.savefig(path, dpi=110)


def run_benchmarks(
    say: Callable[[str], None], horizons: bool, figure: Path | None = None
) -> tuple[list[str], dict[str, Any]]:
    """Everything that is printed, and the same numbers for a file.

    horizons: whether the bound is tabulated over the horizon's length.
    """
    found: dict[str, Any] = {"cores": {}, "box_qp": {}, "whole_step": {}, "horizons": []}
    program: Any = controller_device("mpc").system.blocks["predictive"]
    lines = []
    for board in boards_for("instructions"):
        core, clock = board.core, board.clock_Hz
        say(f"bound on {core}")
        c = cost_on(program, core)
        at = found["cores"][core] = {
            "bound_instructions": c.bound.instructions,
            "stack_bytes": c.bound.stack_bytes,
            "code_bytes": c.code_bytes,
            "state_bytes": c.state_bytes,
            "clock_Hz": clock,
        }
        rates = ", ".join(
            f"{clock / (x * c.bound.instructions):.0f} Hz at {x:g}" for x in CYCLES_PER_INSTRUCTION
        )
        lines.append(
            f"{core}: bound {c.bound.instructions} instructions, stack {c.bound.stack_bytes} B, "
            f"code {c.code_bytes} B, state {c.state_bytes} B; at {clock / 1e6:.0f} MHz {rates} "
            "cycles an instruction"
        )
        if core == "Cortex-M4F":
            say("worst and typical, emulated")
            worst, _ = seen_on_m4f(program, stress_rows(program, 400))
            usual = []
            for experiment in ("tuning", "backdriven", "bread"):
                case = load_study(experiment, ClosedLoopStudy).cases()[0]
                rows = recorded_rows("mpc", case, 250)
                free = {"load_free": 0.0 if case.trajectory.clamped else 1.0}
                usual.append(seen_on_m4f(program, rows, free)[0])
            seen = np.concatenate(usual)
            at["worst_seen"], at["largest_seen"] = float(worst.max()), float(seen.max())
            at["median_seen"] = float(np.median(seen))
            lines.append(
                f"{core}: worst of 400 stress inputs {worst.max():.0f}; in closed loop (tuning, "
                f"backdriven, bread; 250 steps each) median {np.median(seen):.0f}, largest "
                f"{seen.max():.0f}; aims {AIM_BOUND} (bound), {AIM_TYPICAL} (typical)"
            )
    say("box QP and its peers")
    lines += ["", *qp_rows(into=found["box_qp"])]
    say("the whole step and CasADi's C")
    lines += ["", *step_rows(found["whole_step"])]
    if horizons:
        say("horizons")
        lines += ["", *horizon_rows("Cortex-M4F", figure=figure, into=found["horizons"])]
    return lines, found


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--horizons", action="store_true", help="also the bound over the horizon")
    parser.add_argument("--figure", type=Path, help="plot that too: .png, .svg or .pdf")
    parser.add_argument("--json", type=Path, help="also write the numbers")
    chosen = parser.parse_args(arguments)
    horizons = chosen.horizons or chosen.figure is not None

    def say(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    try:
        lines, found = run_benchmarks(say, horizons, chosen.figure)
        write_json(chosen.json, "bench-predictive", found)
    except UserError as error:
        print(f"esea-gen: {error}", file=sys.stderr)
        return 2
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())


__all__ = ["Cost", "cost_on", "qp_rows", "seen_on_m4f", "stress_rows"]
