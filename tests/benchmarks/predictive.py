"""Cost of predictive control: bound, worst and typical instructions.

    python -m tests.benchmarks.predictive [--horizons] [--json FILE]

Instructions are counted on the object code (the bound) and in an emulator (what was seen); they are
not cycles.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.board.bound import InstructionBound, step_bound
from esea_gen.board.emulator import qemu_command
from esea_gen.control.laws.predictive import device_horizon, drive_train
from esea_gen.control.predictive.drive import predictive_controller
from esea_gen.control.predictive.horizon import Horizon
from esea_gen.emit.program_c import loop_lines
from esea_gen.hostlib.compiler import find_compiler
from esea_gen.language.ports import Array
from esea_gen.language.program import Program
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.targets import BARE_LINK, BOARDS, EXACT_FLAGS, SECTION_FLAGS, boards_for
from esea_gen.twin.controllers import controller_device
from tests.rendered_program import ProgramRenderer, render_program

from .peers import with_templates
from .predictive_loop import recorded_rows

CORES = {b.core: b.processor for b in boards_for("instructions")}
FLAGS = (*EXACT_FLAGS, *SECTION_FLAGS, "-g")
AIM_BOUND, AIM_TYPICAL = 60_000, 25_000


@dataclass(frozen=True)
class Cost:
    """Cost of a step on one core; code_bytes: the step's functions with their constants."""

    bound: InstructionBound
    code_bytes: int
    state_bytes: int


def build_program(
    renderer: ProgramRenderer, folder: Path, core: str, extra: dict[str, str]
) -> Path:
    """A program of a renderer's files and others, linked for a core."""
    gcc = find_compiler(*CORES[core].toolchain.gcc)
    files = renderer.files() | extra | {"bare.ld": renderer.render("bench/bare.ld.j2")}
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    sources = [str(folder / n) for n in files if n.endswith(".c")]
    out = folder / "program.elf"
    link = [*BARE_LINK, "--specs=nosys.specs", f"-T{folder / 'bare.ld'}"]
    command = [gcc, *CORES[core].flags, *FLAGS, f"-I{folder}", *sources, *link, "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the compiler rejects the program:\n{done.stderr}")
    return out


def entry_files(renderer: ProgramRenderer) -> dict[str, str]:
    """A caller of the step, only to be linked so that calls have their targets; never run."""
    program: Any = renderer.system.kinds[0]
    stem = f"{renderer.prefix}_{program.name}"
    coeffs = bool(program.coefficients)
    lines = [
        f'#include "{renderer.prefix}.h"',
        f"static {stem}_coeffs_t coeffs;" if coeffs else "",
        f"{stem}_state_t state;\n{stem}_in_t in;\n{stem}_out_t out;\nvoid entry(void);",
        f"void entry(void) {{ {stem}_step({'&coeffs, ' if coeffs else ''}&state, &in, &out); }}",
    ]
    return {"entry.c": "\n".join(lines) + "\n"}


def cost_on(program: Program, core: str) -> Cost:
    """Bound and memory of a program's f32 step on one core, from its object code."""
    renderer = render_program(program, "f32")
    source = f"{renderer.prefix}_{program.name}.c"
    loops = renderer.emitted[program.name].loops
    with tempfile.TemporaryDirectory() as scratch:
        elf = build_program(renderer, Path(scratch), core, entry_files(renderer))
        text = (Path(scratch) / source).read_text(encoding="utf-8")
        step = f"{renderer.prefix}_{program.name}_step"
        bound = step_bound(elf, step, source, loop_lines(text, loops), loops)
        listed = subprocess.run(
            ["arm-none-eabi-nm", "-S", str(elf)], capture_output=True, text=True, check=True
        ).stdout
    found = re.finditer(r"^\w+ (\w+) \w (\S+)$", listed, re.MULTILINE)
    sizes = {m[2]: int(m[1], 16) for m in found}
    text_bytes = sum(sizes.get(f, 0) for f in bound.by_function)
    return Cost(bound, text_bytes, sizes["state"])


def seen_on_m4f(
    program: Program, rows: Array, tunables: dict[str, float] | None = None
) -> tuple[Array, Any]:
    """Instructions and first output of each step of a stream on an emulated Cortex-M4F.

    rows: shape (steps, numbers): the inputs, port by port.
    """
    renderer = with_templates(render_program(program, "f32"))
    fmt = renderer.fmt
    renderer.env.filters["literal"] = lambda v: fmt.literal(float(np.float32(v)))
    board = renderer.render(
        "bench/predictive.c.j2",
        block=renderer.system.kinds[0],
        rows=np.asarray(rows).tolist(),
        timer="tim2",
        tunables=tunables or {},
    )
    command = qemu_command(BOARDS["netduinoplus2"], semihosting=True)
    with tempfile.TemporaryDirectory() as scratch:
        elf = build_program(renderer, Path(scratch), "Cortex-M4F", {"board.c": board})
        done = subprocess.run(
            [*command, "-icount", "shift=0", "-kernel", str(elf)],
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
    """Inputs meant to take long: every port over its whole range, memories that turn back."""
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


def horizon_rows(core: str, lengths: tuple[int, ...] = (5, 10, 20, 40)) -> list[dict[str, int]]:
    """Bound against the horizon's length, and the QP's part of it."""
    device = controller_device("mpc")
    delay_s, train = device_horizon(device).delay_s, drive_train(device)
    rows = []
    for n in lengths:
        horizon = Horizon(intervals=n, delay_s=delay_s)
        program = predictive_controller(
            device, horizon=horizon, preview=True, impedance=True, train=train
        )
        cost = cost_on(program, core)
        qp = sum(i for f, (i, _) in cost.bound.by_function.items() if "_qp_" in f)
        row = {"intervals": n, "bound": cost.bound.instructions, "qp": qp}
        rows.append(row | {"state_bytes": cost.state_bytes})
    return rows


def costs() -> dict[str, dict[str, Any]]:
    """By core: bound, memory and rates; on the Cortex-M4F what was seen too."""
    program: Any = controller_device("mpc").system.blocks["predictive"]
    found = {}
    for board in boards_for("instructions"):
        cost = cost_on(program, board.core)
        at = found[board.core] = {
            "bound_instructions": cost.bound.instructions,
            "code_bytes": cost.code_bytes,
            "state_bytes": cost.state_bytes,
        }
        if board.core == "Cortex-M4F":
            usual = []
            for experiment in ("tuning", "backdriven", "bread"):
                case = load_study(experiment, ClosedLoopStudy).cases()[0]
                free = {"load_free": 0.0 if case.trajectory.clamped else 1.0}
                usual.append(seen_on_m4f(program, recorded_rows("mpc", case, 250), free)[0])
            at["worst_seen"] = float(seen_on_m4f(program, stress_rows(program, 400))[0].max())
            at["largest_seen"] = float(np.max(usual))
            at["median_seen"] = float(np.median(usual))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--horizons", action="store_true", help="also the bound over the horizon")
    parser.add_argument("--json", type=Path, help="also write the numbers")
    chosen = parser.parse_args()
    found: dict[str, Any] = {"cores": costs()}
    if chosen.horizons:
        found["horizons"] = horizon_rows("Cortex-M4F")
    text = json.dumps(found, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text)


if __name__ == "__main__":
    main()
