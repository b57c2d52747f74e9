"""q31 against soft-float f32 on the same core, and against a filter written by hand.

Instructions are counted in an emulator.  The error of a program is the largest distance of its
outputs from exact arithmetic on the same inputs, over the counted stream.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.board.bare import BARE_BOARDS, emulate, run_bare
from esea_gen.device import Device
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.values import FieldPlan
from esea_gen.emit.formats import FORMATS
from esea_gen.errors import UserError
from esea_gen.hostlib.codec import from_raw, to_raw
from esea_gen.language.ports import Array
from esea_gen.verify.streams import domain_chirp

from .peers import exact, renderer_of

STEPS = 400
CHIRP_S = 8.0
PROGRAMS = {"q31": "generated q31", "f32": "generated f32, soft float", "hand": "written by hand"}


@dataclass(frozen=True)
class FilterRun:
    """A velocity filter on a board, and its largest error of both rates."""

    program: str
    instructions: float
    flash_bytes: int
    error_rad_s: float


def _power(value: float, bits: int) -> int:
    return math.floor(value * 2.0**bits + 0.5)


def hand_constants(device: Device) -> dict[str, int]:
    """Numbers of the filter written by hand, in its own formats."""
    limits, h = device.file.limits, device.period_s
    exact = device.velocity.simulator().coefficients
    alpha, beta, gamma = (float(np.ravel(exact[n])[0]) for n in ("alpha", "beta_1_s", "gamma_1_s2"))
    theta, omega = limits.theta_rad.value, limits.omega_rad_s.value
    rate_bits = 30 - math.ceil(math.log2(1 / h))
    return {
        "theta_most": _power(theta, 31),
        "position_most": _power(2 * theta, 48),
        "rate_most": _power(4 * omega * h, 48),
        "change_most": _power(4 * omega * h, 48),
        "step_most": _power(omega * h, 48),
        "omega_most": _power(omega, 26),
        "alpha": _power(alpha, 31),
        "beta": _power(beta * h, 31),
        "gamma": _power(gamma * h * h, 31),
        "rate_scale": _power(1 / h, rate_bits),
        "rate_bits": rate_bits,
        # Q0.31 times Q.rate_bits to Q5.26.
        "rate_shift": 31 + rate_bits - 26,
    }


def _image(device: Device, program: str, theta: Array, board: str) -> dict[str, str]:
    real = "f32" if program == "f32" else "q31"
    chosen, fmt, hand = BARE_BOARDS[board], FORMATS[real], program == "hand"
    renderer = renderer_of(device, device.system, real)
    naming, block = renderer.naming, device.velocity
    tunable = block.tunables[0]

    def text(group: str, name: str, value: float) -> str:
        return fmt.literal(naming.number(block, group, name, value))

    fraction = naming.fraction(block, "in", "theta_rad")
    # What is not a number or does not fit has a raw number of its own.
    rows = (
        [fmt.literal(float(v)) for v in theta]
        if fraction is None
        else [str(int(v)) for v in to_raw(theta, fraction)]
    )
    context: dict[str, Any] = {
        "title": PROGRAMS[program],
        "hand": hand,
        "stem": f"{renderer.prefix}_{block.name}",
        "c_type": fmt.c_type,
        "rows": rows,
        "names": {
            "theta": "theta_rad",
            "omega": "omega_rad_s",
            "omega_mid": "omega_mid_rad_s",
            "bandwidth": tunable.name,
        },
        "bandwidth": text("params", tunable.name, tunable.default),
        "stack_top": 0x20000000 + chosen.ram_bytes,
        "board": chosen.machine,
        "flash_bytes": chosen.code_bytes,
        "ram_bytes": chosen.ram_bytes,
    }
    files: dict[str, str] = {}
    if hand:
        for name in ("hand_filter.c", "hand_filter.h"):
            files[name] = renderer.render(f"bench/{name}.j2", **hand_constants(device))
    else:
        skip = {"main.c"}
        files = {n: t for n, t in renderer.files().items() if n not in skip and "/" not in n}
    files["bare.c"] = renderer.render("bench/fixed.c.j2", **context)
    files["bare.ld"] = renderer.render("verify/bare.ld.j2", **context)
    return files


def run_filter(device: Device, program: str, board: str, theta_rad: Array) -> FilterRun:
    """A velocity filter on an emulated board; every program is given the same deflections."""
    plan = plan_block(device.velocity)
    fraction = plan.field("in", "theta_rad").fraction
    seen = np.asarray(np.float32(from_raw(to_raw(theta_rad, fraction), fraction)), np.float64)
    done = emulate(_image(device, program, seen, board), BARE_BOARDS[board])
    if len(done.rows) != len(seen):
        raise RuntimeError(f"{program}: {len(done.rows)} rows from the board, not {len(seen)}")
    words = np.array([[int(w, 16) for w in r] for r in done.rows], dtype=np.uint32)
    exact, _ = device.velocity.simulator().run({"theta_rad": seen})
    error = 0.0
    for k, name in enumerate(("omega_rad_s", "omega_mid_rad_s")):
        column = np.ascontiguousarray(words[:, k])
        if program == "f32":
            got = column.view(np.float32).astype(np.float64)
        else:
            f: FieldPlan = plan.field("out", name)
            # The filter written by hand gives Q5.26, whatever the device.
            got = from_raw(column.view(np.int32), 26 if program == "hand" else f.fraction)
        error = max(error, float(np.max(np.abs(got - exact[name]))))
    return FilterRun(program, done.instructions["mean"], done.flash_bytes, error)


def fixed_rows(device: Device, say: Callable[[str], None]) -> list[dict]:
    """q31 against soft float on boards without an FPU, and against a filter written by hand."""
    whole = domain_chirp(device, CHIRP_S)
    theta = whole[:: max(1, len(whole) // STEPS)][:STEPS]
    rows = []
    try:
        for board in ("m3", "m0"):
            core = BARE_BOARDS[board].core
            say(f"fixed point, {core}")
            task = device.system.tasks[0]
            inputs = {task.name: {x.name: theta for x in device.system.task_inputs(task)}}
            runs = [run_bare(device, real, board, inputs) for real in ("q31", "f32")]
            for run in runs:
                if not run.identical:
                    raise RuntimeError(f"{core}, {run.real}: {run.first_difference}")
            counts = (run.instructions["mean"] for run in runs)
            row = {"name": f"sensing task q31 vs soft-float f32, {core}"}
            rows.append(row | exact(*counts, "instructions"))
        say("fixed point, filter written by hand")
        found = {p: run_filter(device, p, "m3", whole[-STEPS:]) for p in PROGRAMS}
    except UserError as error:
        say(f"left out: {error}")
        return rows
    ours = found["q31"]
    for key in ("f32", "hand"):
        peer, name = found[key], f"velocity q31 vs {PROGRAMS[key]}, Cortex-M3"
        rows.append({"name": name} | exact(ours.instructions, peer.instructions, "instructions"))
        error = exact(ours.error_rad_s, peer.error_rad_s, "rad/s")
        rows.append({"name": f"{name}, error"} | error)
    return rows
