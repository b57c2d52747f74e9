"""Proof of the emitted C: value analysis by Frama-C, of q31 Blocks and of whole drives.

The value analysis is given every emitted file under any bit pattern in every input and state and in
every coefficient that a step itself checks, with tunables and the other coefficients inside their
declared ranges.  What it assumes is counted and listed.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.language.block import Block
from esea_gen.verify.tools import TIMEOUT_S, tool

EVA = (
    *("-machdep", "x86_32", "-eva", "-eva-precision", "4", "-warn-signed-downcast"),
    "-eva-msg-key=-initial-state,-final-states",
    # A call whose function is nowhere would be taken to do anything, or next to nothing.
    *("-kernel-warn-key", "annot:missing-spec=error"),
)
# Floats as on every target: no excess precision, which the C refuses.
SSE = ("-msse2", "-mfpmath=sse")


@dataclass(frozen=True)
class EvaResult:
    """What the value analysis said of one Block.

    alarms: possible undefined behaviour: overflow, division by zero, invalid access, a shift out of
        range, a conversion that does not fit.
    unproven: assertions that could not be shown: that ``prepare`` keeps its coefficients' ranges.
    assumptions: ranges that the caller is assumed to keep: of tunables, and of coefficients that
        the step does not check.
    """

    device: str
    block: str
    alarms: tuple[str, ...]
    unproven: tuple[str, ...]
    assumptions: tuple[str, ...]
    statements: int
    functions: int

    @property
    def proven(self) -> bool:
        """Whether there is no alarm, nothing unproven, and something was analysed."""
        return not self.alarms and not self.unproven and self.statements > 0


def _said(command: Sequence[str], folder: Path, text: str | None = None) -> str:
    done = subprocess.run(
        list(command),
        cwd=folder,
        input=text,
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT_S,
    )
    said = done.stdout + done.stderr
    if done.returncode != 0:
        raise RuntimeError(f"{Path(command[0]).name} failed:\n{said[-3000:]}")
    return said


def prove_block(
    device: Device,
    block: Block,
    change: Callable[[str, str], str] | None = None,
    narrow: bool = False,
) -> EvaResult:
    """Analyse the emitted C of one Block.

    change: ``change(file name, text) -> text``: a deliberate fault, to see that the analysis finds
        it.
    """
    renderer = Renderer(
        device.system, FORMATS["q31"], format_hash(device, "q31"), "-", device.title
    )
    driver = renderer.render("proof/eva.c.j2", block=block, fields=plan_block(block).fields)
    files = renderer.files() | {"eva.c": driver}
    sources = ("eva.c", f"{renderer.prefix}_{block.name}.c", "esea_q31.c")
    defines = ("-DESEA_Q31_PORTABLE_CLZ", *(("-DESEA_Q31_NARROW",) if narrow else ()))
    alarms, unproven, reached = analysed(files, sources, defines, (), change)
    assumed = re.findall(r"^    (\S+ = Frama_C_interval\(.*\)); /\* assumed \*/$", driver, re.M)
    return EvaResult(device.name, block.name, alarms, unproven, tuple(assumed), *reached)


def analysed(
    files: Mapping[str, str],
    sources: Sequence[str],
    defines: Sequence[str],
    options: Sequence[str],
    change: Callable[[str, str], str] | None,
    folders: Sequence[str] = (),
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[int, int]]:
    """Alarms, what is unproven, and how many statements and functions were reached."""
    frama = tool("frama-c", "frama-c-base")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name, text in files.items():
            content = change(name, text) if change else text
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(content, encoding="utf-8")
        # Whole paths: Frama-C goes by $PWD and not by where it was started.
        found = (f"-I{folder / name}" for name in ("", *folders))
        include = f"-cpp-extra-args={' '.join((*found, *SSE, *defines))}"
        paths = [str(folder / n) for n in sources]
        said = _said([frama, *EVA, *options, include, *paths], folder)
    counted = re.search(r"(\d+) functions? analyzed.*?(\d+) statements? reached", said, re.DOTALL)
    alarms: list[str] = []
    unproven: list[str] = []
    for place, text in re.findall(r"\[eva:alarm\] (\S+): Warning:\s+(\S.*(?:\n  .*)*)", said):
        words = " ".join(text.split())
        named = re.search(r"assertion '(\w+)' got status", words)
        where = place.rsplit("/", 1)[-1]
        (unproven if named else alarms).append(f"{where} {named.group(1) if named else words}")
    total = re.search(r"(\d+) alarms? generated by the analysis", said)
    if counted is None or total is None or int(total.group(1)) > len(alarms):
        raise RuntimeError(f"frama-c's report was not understood:\n{said[-3000:]}")
    return tuple(alarms), tuple(unproven), (int(counted.group(2)), int(counted.group(1)))


def prove_drive(
    device: Device,
    real: str,
    free: bool = False,
    change: Callable[[str, str], str] | None = None,
) -> EvaResult:
    """Analyse a whole device: its tasks, latches and conversions, with all its Blocks.

    free: whether all coefficients hold any bits, or only those that a step checks itself, and the
        others are as ``prepare`` leaves them.
    change: a deliberate fault in an emitted file.
    """
    fmt = FORMATS[real]
    renderer = Renderer(device.system, fmt, format_hash(device, real), "-", device.title)
    files = renderer.files()
    # The marks of a run are plain accesses here: one thread.
    own = f"{renderer.prefix}.c"
    files[own] = f"#define ESEA_FENCE() ((void)0)\n{files[own]}"
    # The compiler's own, which the analysis has neither body nor words for.
    real_h = f"{renderer.prefix}_real.h"
    files[real_h] = f"#define __builtin_fabsf(x) ((x) < 0.0f ? -(x) : (x))\n{files[real_h]}"
    sources = sorted(n for n in files if n.endswith(".c") and n != "main.c")
    units = f"{renderer.prefix}_units.h" in files
    checked = [i for i, b in device.system.blocks.items() if b.name == "limits"]
    tasks = [t.name for t in device.system.tasks]
    driver = renderer.render(
        "proof/eva_drive.c.j2", free=free, units=units, checked=checked, tasks=tasks
    )
    # Floats may be NaN and infinite: that is no undefined behaviour.
    options = ("-warn-special-float", "none")
    alarms, unproven, reached = analysed(
        files | {"eva.c": driver},
        ["eva.c", *sources],
        ("-DESEA_Q31_PORTABLE_CLZ",),
        options,
        change,
    )
    trusted = () if free else (i for i, b in device.system.blocks.items() if i not in checked)
    assumed = [
        f"coeffs.{i}.{p.name}: as prepare leaves it"
        for i in trusted
        for p in device.system.blocks[i].coefficients
    ]
    return EvaResult(device.name, real, alarms, unproven, tuple(assumed), *reached)


def prove_device(device: Device) -> list[EvaResult]:
    """Analyse every Block of a device."""
    return [prove_block(device, b) for b in device.system.kinds]


__all__ = [
    "EvaResult",
    "analysed",
    "prove_block",
    "prove_device",
    "prove_drive",
]
