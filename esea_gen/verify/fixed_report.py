"""Fixed-point report of a device: bits and errors of every Block, torque over long signals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from esea_gen.board.bare import BARE_BOARDS, BareResult, run_bare
from esea_gen.device import Device
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.language.ports import Array
from esea_gen.verify.bounds import UNTRIED
from esea_gen.verify.chain import AIM_SHARE, ChainReport, search_chain
from esea_gen.verify.fixed import bounds_of, compare_fixed
from esea_gen.verify.proof import EvaResult, prove_block
from esea_gen.verify.streams import domain_chirp, streams

CORE_STEPS = 200
CHIRP_S = 60.0
STREAM_STEPS = 300


@dataclass(frozen=True)
class BlockResult:
    block: str
    proven_for: str
    proven: float
    measured: float
    wide: int
    turned: int
    problems: list[str]


@dataclass(frozen=True)
class SignalResult:
    """The sensing task in q31 against f64 on one signal."""

    signal: str
    steps: int
    error_Nm: float
    share: float
    last_minute: float


@dataclass
class FixedReport:
    device: str
    blocks: list[BlockResult]
    signals: list[SignalResult] = field(default_factory=list)
    cores: list[BareResult] = field(default_factory=list)
    proofs: list[EvaResult] = field(default_factory=list)
    chain: ChainReport | None = None

    @property
    def passed(self) -> bool:
        return (
            not any(b.problems for b in self.blocks)
            and all(s.share <= AIM_SHARE for s in self.signals)
            and all(c.identical for c in self.cores)
            and all(p.proven for p in self.proofs)
            and (self.chain is None or self.chain.passed)
        )

    def to_dict(self) -> dict[str, Any]:
        return asdict(self) | {"aim_share": AIM_SHARE, "passed": self.passed}

    def table(self) -> list[str]:
        lines = [f"{self.device} in q31, shares of the ports' ranges"]
        lines.append(f"{'block':16} {'proven':>9} {'for':>9} {'measured':>9} {'64 bit':>7}  bits")
        for b in self.blocks:
            verdict = "equal" if not b.problems else "; ".join(b.problems[:2])
            lines.append(
                f"{b.block:16} {100 * b.proven:8.2g}% {b.proven_for:>9} "
                f"{100 * b.measured:8.2g}% {b.wide:7d}  {verdict}"
            )
        if self.signals:
            lines.append(f"torque against f64, of full scale (aim {100 * AIM_SHARE:g} %)")
        lines += [
            f"{s.signal:44} {s.steps:9d} steps {100 * s.share:9.2g}%, "
            f"last minute {100 * s.last_minute:.2g}%"
            for s in self.signals
        ]
        lines += self.chain.table() if self.chain else []
        if self.cores:
            lines.append("instructions a step (not cycles), bytes")
            lines.append(
                f"{'core':12} {'format':>6} {'mean':>8} {'largest':>8} {'flash':>7} {'RAM':>6} "
                f"{'stack':>6}  bits"
            )
        lines += [
            f"{c.core:12} {c.real:>6} {c.instructions['mean']:8.0f} {c.instructions['max']:8.0f} "
            f"{c.flash_bytes:7d} {c.ram_bytes:6d} {c.stack_bytes:6d}  "
            f"{'equal' if c.identical else c.first_difference}"
            for c in self.cores
        ]
        if self.proofs:
            lines.append("value analysis under any bit pattern of inputs and states")
        for p in self.proofs:
            verdict = "no alarm" if p.proven else "; ".join([*p.alarms, *p.unproven][:2])
            lines.append(
                f"{p.block:16} {verdict}, {p.statements} statements, "
                f"{len(p.assumptions)} assumed ranges"
            )
            lines += [f"    {a}" for a in p.assumptions]
        return lines


def published_motions(device: Device) -> Iterator[tuple[str, Array]]:
    """The excitations of thesis chapter 3, scaled to a device's domain."""
    h, most = device.period_s, device.file.domain.theta_max_rad.value
    for share, end_Hz in ((1.0, 1.0), (5.0 / 11.5, 1.5)):
        t = np.arange(round(end_Hz / (0.5 / 60) / h)) * h
        sweep = share * most * np.sin(np.pi * (0.5 / 60) * t * t)
        yield f"sweep {np.rad2deg(share * most):.1f} deg, 0 to {end_Hz:g} Hz", sweep
    t = np.arange(round(200 / h)) * h
    for share in (10.0 / 11.5, 1.0):
        slow = share * most * np.sin(2 * np.pi * 0.01 * t)
        yield f"{np.rad2deg(share * most):.1f} deg at 0.01 Hz", slow
    for share in (5.0 / 11.5, 10.0 / 11.5):
        end = share * most
        ramp = np.arange(0.0, end, np.deg2rad(20.0) * h)
        held = np.full(round(60.0 / h), end)
        yield (
            f"ramp to {np.rad2deg(end):.1f} deg, held for 60 s",
            np.concatenate([np.zeros(1000), ramp, held]),
        )


def compare_signal(device: Device, name: str, theta_rad: Array) -> SignalResult:
    task = device.system.tasks[0]
    inputs = {x.name: theta_rad for x in device.system.task_inputs(task)}
    got, exact = (
        compile_device(device, real).task(task.name).run(inputs, trace=False)[0]
        for real in ("q31", "f64")
    )
    names = [n for n in exact if n.startswith("tau") and n.endswith("_Nm")]
    error = np.max([np.abs(got[n] - exact[n]) for n in names], axis=0)
    full = device.tau_full_scale_Nm
    last = error[-round(60.0 / device.period_s) :]
    worst = float(error.max())
    return SignalResult(name, len(theta_rad), worst, worst / full, float(last.max()) / full)


def _compare_blocks(
    device: Device, library: HostLibrary, say: Callable[[str], None]
) -> Iterator[BlockResult]:
    bounds = bounds_of(device)
    for block in device.system.kinds:
        say(f"{block.name}")
        plan, bound = plan_block(block), bounds[block.name]
        runner = library.block(block.name)
        full = {p.name: max(abs(p.low), abs(p.high)) for p in block.outputs if not p.flags}
        proven = max((bound.outputs[n] / f for n, f in full.items()), default=0.0)
        measured, turned, problems, kept = 0.0, 0, list[str](), False
        for stream in streams(block, steps=STREAM_STEPS):
            found = compare_fixed(device, plan, runner, stream, bound)
            problems += [f"{stream.name}: {p}" for p in found.problems]
            turned += found.turned
            kept |= not found.beyond
            measured = max([measured, *(found.errors[n] / f for n, f in full.items())])
        if not kept:
            problems.append(UNTRIED)
        lasts = "all time" if math.isinf(bound.steps) else "one step"
        wide = len(plan.wide)
        yield BlockResult(block.name, lasts, proven, measured, wide, turned, problems)


def _cores(device: Device, say: Callable[[str], None]) -> Iterator[BareResult]:
    if device.file.joint is None:
        theta = domain_chirp(device, 2.0)
        theta = theta[:: max(1, len(theta) // CORE_STEPS)][:CORE_STEPS]
        task = device.system.tasks[0]
        inputs = {task.name: {x.name: theta for x in device.system.task_inputs(task)}}
    else:
        from esea_gen.twin.recorded import record_drive

        # What a drive is given in the virtual exoskeleton, in closed loop with its own f32 C.
        inputs = record_drive(device, CORE_STEPS).inputs
    for real, board in (("q31", "m3"), ("f32", "m3"), ("q31", "m0"), ("f32", "m0"), ("f32", "m4f")):
        say(f"{BARE_BOARDS[board].core}, {real}")
        yield run_bare(device, real, board, inputs)


def check_fixed(
    device: Device,
    minutes: float = 1.0,
    recorded: Mapping[str, Array] | None = None,
    cores: bool = False,
    prove: bool = False,
    search: int = 0,
    progress: Callable[[str], None] | None = None,
) -> FixedReport:
    """Compare a device's q31 C with everything there is to compare it with."""
    say = progress or (lambda text: None)
    library = compile_device(device, "q31")
    report = FixedReport(device.name, list(_compare_blocks(device, library, say)))
    if device.file.joint is None:
        chirps = max(1, round(60.0 * minutes / CHIRP_S))
        long = np.tile(domain_chirp(device, CHIRP_S), chirps)
        signals = [*published_motions(device), (f"chirps, {chirps * CHIRP_S / 60:g} min", long)]
        for name, theta in [*signals, *(recorded or {}).items()]:
            say(name)
            report.signals.append(compare_signal(device, name, theta))
    if search:
        report.chain = search_chain(device, trials=search, say=say)
    if cores:
        report.cores = list(_cores(device, say))
    if prove:
        for block in device.system.kinds:
            say(f"{block.name}, value analysis")
            report.proofs.append(prove_block(device, block))
    return report
