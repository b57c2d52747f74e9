"""Proof of the emitted C: value analysis by Frama-C, of q31 Blocks and of whole drives."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.compiler import find_compiler, run_tool, write_texts
from esea_gen.language.block import Block

TIMEOUT_S = 3600
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
    """Result of the value analysis of one Block."""

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


def prove_block(
    device: Device,
    block: Block,
    change: Callable[[str, str], str] | None = None,
    narrow: bool = False,
) -> EvaResult:
    """Analyse the emitted C of one Block."""
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


def with_conditions(text: str) -> str:
    """A Block's C in which a flag that chooses stands beside what it is the name of.

    The value analysis learns a value's range from a comparison where it is chosen, and not from a
    flag that holds the comparison's result.  Both are constants of one run, so that the program is
    the same.
    """
    if "templates/device/esea_block.c.j2" not in text:
        return text
    known: dict[str, str] = {}

    def spelled(found: re.Match[str]) -> str:
        name = found[0]
        return f"({name} && {known[name]})" if name in known else name

    def statement(found: re.Match[str]) -> str:
        kind, name, value = found.groups()
        *condition, arms = value.partition("?") if "?" in value else ("", "", value)
        test = re.sub(r"\w+", spelled, condition[0])
        if kind == "bool" and not condition[0] and "||" not in value:
            meant = re.sub(r"\w+", spelled, value)
            if "<=" in meant:
                known[name] = f"({meant})"
        return f"const {kind} {name} = {test}{condition[1]}{arms};"

    return re.sub(r"const (\w+) (\w+) = ([^;]+);", statement, text)


def analysed(
    files: Mapping[str, str],
    sources: Sequence[str],
    defines: Sequence[str],
    options: Sequence[str],
    change: Callable[[str, str], str] | None,
    folders: Sequence[str] = (),
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[int, int]]:
    """Alarms, unproven properties, and counts of reached statements and functions."""
    frama = find_compiler("frama-c", "frama-c-base")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        changed = {n: change(n, t) if change else t for n, t in files.items()}
        write_texts(folder, {n: with_conditions(t) for n, t in changed.items()})
        # Whole paths: Frama-C goes by $PWD and not by where it was started.
        found = (f"-I{folder / name}" for name in ("", *folders))
        include = f"-cpp-extra-args={' '.join((*found, *SSE, *defines))}"
        paths = [str(folder / n) for n in sources]
        command = [frama, *EVA, *options, include, *paths]
        done = run_tool(command, folder, "frama-c failed", timeout=TIMEOUT_S)
        said = done.stdout + done.stderr
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
