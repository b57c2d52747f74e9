"""Mutation of the emitted C: a wrong operator, constant or wire must be seen."""

from __future__ import annotations

import random
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS, Format
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.verify.equivalence import chosen_blocks
from esea_gen.verify.mutation.bench import Bench
from esea_gen.verify.mutation.equivalent import Prover
from esea_gen.verify.mutation.mutants import Mutant, mutants

REQUIRED_SCORE = 0.95


@dataclass
class MutationReport:
    device: str
    real: str
    tried: int = 0
    rejected: int = 0
    killed: int = 0
    equivalent: list[tuple[Mutant, str]] = field(default_factory=list)
    survivors: list[Mutant] = field(default_factory=list)
    kinds: dict[str, tuple[int, int]] = field(default_factory=dict)
    contradicted: list[tuple[Mutant, str]] = field(default_factory=list)

    @property
    def score(self) -> float:
        """Share killed of all mutants not proven equivalent."""
        counted = self.tried - len(self.equivalent)
        return self.killed / counted if counted else 1.0

    @property
    def raw_score(self) -> float:
        """Share killed of all mutants, equivalent ones included."""
        return self.killed / self.tried if self.tried else 1.0

    def to_dict(self) -> dict[str, Any]:
        return {
            "device": self.device,
            "format": self.real,
            "tried": self.tried,
            "rejected_by_compiler": self.rejected,
            "killed": self.killed,
            "score": self.score,
            "raw_score": self.raw_score,
            "required_score": REQUIRED_SCORE,
            "equivalent": [{"mutant": str(m), "proof": p} for m, p in self.equivalent],
            "survivors": [str(m) for m in self.survivors],
            "contradicted": [{"mutant": str(m), "proof": p} for m, p in self.contradicted],
            "kinds": {k: {"killed": a, "tried": b} for k, (a, b) in sorted(self.kinds.items())},
        }


def _proof(mutant: Mutant, fmt: Format, made: dict[tuple[str, str], Prover]) -> str:
    if mutant.kernel is None or mutant.edit is None:
        return ""
    key = mutant.file, mutant.function
    if key not in made:
        block = mutant.block
        step = block if isinstance(block, Block) and mutant.function == "step" else None
        made[key] = Prover(mutant.kernel, fmt, step)
    return made[key](mutant.edit)


def _chosen(
    device: Device, real: str, sample: int | None, seed: int, files: set[str] | None
) -> list[Mutant]:
    chosen = [m for m in mutants(device, real) if files is None or m.file in files]
    if sample is not None and sample < len(chosen):
        chosen = random.Random(seed).sample(chosen, sample)
    return sorted(chosen, key=lambda m: m.file)


def run_mutation(
    device: Device,
    real: str,
    sample: int | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    blocks: Sequence[str] | None = None,
) -> MutationReport:
    """Mutate a device's emitted C and count the mutants that the comparisons catch."""
    if real not in FORMATS:
        raise UserError(f"Unknown number format '{real}'.", f"Choose from {', '.join(FORMATS)}.")
    touched = chosen_blocks(device, blocks)
    say = progress or (lambda _: None)
    report = MutationReport(device.name, real)
    kinds: Counter[str] = Counter()
    caught: Counter[str] = Counter()
    provers: dict[tuple[str, str], Prover] = {}
    files = {f"esea_{device.name}_{b.name}.c" for b in touched} if blocks else None
    chosen = _chosen(device, real, sample, seed, files)
    used = [b for b in touched if any(m.block is b for m in chosen)]
    with tempfile.TemporaryDirectory(prefix="esea-mutation-") as scratch:
        bench = Bench(device, real, Path(scratch), used)
        bench.check()
        for _, group in groupby(chosen, key=lambda m: m.file):
            for mutant, library in bench.loaded(list(group)):
                if (report.tried + report.rejected) % 50 == 0:
                    k = report.tried + report.rejected + 1
                    say(f"{device.name}, {real}: mutant {k} of {len(chosen)}")
                if library is None:
                    report.rejected += 1
                    continue
                report.tried += 1
                kinds[mutant.kind] += 1
                proof = _proof(mutant, FORMATS[real], provers)
                if bench.difference(library, mutant):
                    report.killed += 1
                    caught[mutant.kind] += 1
                    if proof and "whole" not in proof:
                        report.contradicted.append((mutant, proof))
                elif proof:
                    report.equivalent.append((mutant, proof))
                else:
                    report.survivors.append(mutant)
    report.kinds = {k: (caught[k], n) for k, n in kinds.items()}
    return report
