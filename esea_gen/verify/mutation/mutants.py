"""Every mutant of a device's C: kernels, their ports, Programs, the wiring."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import casadi as ca

from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS, Format
from esea_gen.emit.formats.floating import FloatingFormat
from esea_gen.emit.program_c import emit_program
from esea_gen.emit.render import COUNTER, Renderer
from esea_gen.emit.walker import Kernel, walk
from esea_gen.language.block import Block
from esea_gen.language.builder import array_name
from esea_gen.language.ports import Flag, Port
from esea_gen.language.program import Program
from esea_gen.language.statements import Call, walk_statements
from esea_gen.verify.executor import emitted_kernel
from esea_gen.verify.mutation.edits import Edit, Elements, describe, kernel_edits
from esea_gen.verify.mutation.wiring import wiring_faults

Text = Callable[[Renderer], str]
Labels = dict[int, tuple[str, str]]


@dataclass(frozen=True)
class Mutant:
    """One file of the emitted C with one fault."""

    file: str
    function: str
    kind: str
    place: str
    block: Block | Program | None
    text: Text
    kernel: Kernel | None = None
    edit: Edit | None = None

    def __str__(self) -> str:
        return f"{self.file} {self.function}: {self.kind}: {self.place}"


def _block_kernel(block: Block, function: str, fmt: Format) -> tuple[Kernel, Labels]:
    """A kernel of a Block as a format prints it, with names and comments of its values."""
    if function == "step":
        return emitted_kernel(block, fmt)
    return fmt.passes(walk(getattr(block, function))), {}


def _elements(ports: Sequence[Any], first: int = 0) -> Elements:
    return [(first + k, e) for k, p in enumerate(ports) for e in range(getattr(p, "size", 1))]


def _groups(block: Block, function: str) -> list[Elements]:
    if function != "step":
        return [_elements(block.tunables if function == "prepare" else block.coefficients)]
    groups, first = [], 0
    for ports in (block.coefficients, block.state, block.inputs):
        groups.append(_elements(ports, first))
        first += len(ports)
    return groups


def _edited(
    block: Block, function: str, kernel: Kernel, labels: Labels, edit: Edit, renderer: Renderer
) -> str:
    changed, place = edit.apply(kernel)
    names = {place[i]: label for i, label in labels.items()}
    assert isinstance(renderer.fmt, FloatingFormat)
    printed = renderer.fmt.function(block, function, changed, names)
    emitted: Any = replace(cast(Any, renderer.emitted[block.name]), **{function: printed})
    return renderer.render(emitted.template, e=emitted)


def _kernel_mutants(block: Block, file: str, fmt: Format) -> Iterator[Mutant]:
    for function in ("prepare", "init", "step") if block.tunables else ("init", "step"):
        kernel, labels = _block_kernel(block, function, fmt)
        words = block.flag_results if function == "step" else ()
        for edit in kernel_edits(kernel, fmt, _groups(block, function), words):
            place = describe(kernel, {i: name for i, (name, _) in labels.items()}, edit)
            text = partial(_edited, block, function, kernel, labels, edit)
            yield Mutant(file, function, edit.kind, place, block, text, kernel, edit)


# Which ports a function writes, and where their results begin.
_WRITTEN = (("prepare", "coefficients"), ("init", "state"), ("step", "state"), ("step", "outputs"))


def _port_mutants(block: Block, file: str, fmt: Format) -> Iterator[Mutant]:
    # Not writing a port, or writing it to another one's place.
    for function, group in _WRITTEN if block.tunables else _WRITTEN[1:]:
        ports: tuple[Any, ...] = getattr(block, group)
        first = len(block.state) if group == "outputs" else 0
        rows = _block_kernel(block, function, fmt)[0].results[first:]
        if len(ports) < 2:
            continue  # of one alone, nothing is tried
        for k, p in enumerate(ports):
            without = partial(_with_ports, block, function, group, ports, (first + k, None))
            place = f"{group} {p.name}"
            yield Mutant(file, function, "assignment dropped", place, block, without)
            others = [q for q in (*ports[k + 1 :], *ports[:k]) if q.size == p.size and not q.flags]
            if others and not p.flags:
                wrong = (*ports[:k], replace(p, name=others[0].name), *ports[k + 1 :])
                text = partial(_with_ports, block, function, group, wrong, None)
                place += f" to {others[0].name}"
                yield Mutant(file, function, "written to the wrong field", place, block, text)
            for e in (e for e in range(p.size - 1) if rows[k][e] != rows[k][e + 1]):
                text = partial(_with_ports, block, function, group, ports, (first + k, e))
                place = f"{group} {p.name}[{e}] and [{e + 1}]"
                yield Mutant(file, function, "written to the wrong element", place, block, text)


def _with_ports(
    block: Block,
    function: str,
    group: str,
    ports: tuple[Any, ...],
    result: tuple[int, int | None] | None,
    renderer: Renderer,
) -> str:
    # ``result``: the one that is not written, or of which an element and the next change places.
    emitted: Any = renderer.emitted[block.name]
    printed = getattr(emitted, function)
    rows = list(printed.results)
    if result is not None:
        k, e = result
        row = rows[k]
        rows[k] = () if e is None else (*row[:e], row[e + 1], row[e], *row[e + 2 :])
    changed = replace(printed, results=tuple(rows))
    parts: dict[str, Any] = {group: ports}
    other = replace(block, **parts)
    emitted = replace(emitted, block=other, **{function: changed})
    return renderer.render(emitted.template, e=emitted)


_COUNTERS = {
    "counter wraps": "{n} += (out->{port} & {bit}) != 0u ? 1u : 0u;",
    "counter inverted": COUNTER.replace("out->", "~out->"),
    "counter counts always": COUNTER.replace("out->{port} & {bit}", "1u"),
    "counter sticks": "{n} = (out->{port} & {bit}) != 0u ? 1u : 0u;",
}


def _counter_mutants(block: Block, file: str) -> Iterator[Mutant]:
    for port in block.outputs:
        for flag in port.flags:
            for kind, form in _COUNTERS.items() if flag.counted else ():
                text = partial(_with_counter, block, flag, form)
                yield Mutant(file, "step", kind, flag.name, block, text)


def _with_counter(block: Block, flag: Flag, form: str, renderer: Renderer) -> str:
    def line(owner: Block, port: Port, now: Flag) -> str:
        return renderer.counter(owner, port, now, form if now is flag else COUNTER)

    emitted: Any = renderer.emitted[block.name]
    return renderer.render(emitted.template, e=emitted, counter=line)


def _program_mutants(program: Program, file: str, fmt: Format) -> Iterator[Mutant]:
    words: dict[int, set[int]] = {}
    status = {array_name("out", p.name) for p in program.outputs if p.flags}
    for s in (x for part in program.parts.values() for x in walk_statements(part.body)):
        if isinstance(s, Call):
            found = words.setdefault(id(s.kernel), set())
            found |= {k for k, r in enumerate(s.results) if r.array in status}
    for name, function in program.kernels.items():
        kernel = fmt.passes(walk(function))
        sizes = [function.numel_in(k) for k in range(function.n_in())]
        group = [(k, e) for k, size in enumerate(sizes) for e in range(size)]
        for edit in kernel_edits(kernel, fmt, [group], sorted(words[id(function)])):
            place = describe(kernel, {}, edit)
            text = partial(_with_kernel, program, function, kernel, edit)
            yield Mutant(file, name, edit.kind, place, program, text, kernel, edit)


def _with_kernel(
    program: Program, function: ca.Function, kernel: Kernel, edit: Edit, renderer: Renderer
) -> str:
    changed, _ = edit.apply(kernel)
    emitted = emit_program(program, renderer.fmt, {id(function): changed})
    return renderer.render(emitted.template, e=emitted)


def mutants(device: Device, real: str) -> list[Mutant]:
    """Every mutant of a device's emitted C: its Blocks, its Programs' bodies, and the wiring."""
    fmt = FORMATS[real]
    stem = f"esea_{device.name}"
    found: list[Mutant] = []
    for block in device.system.kinds:
        file = f"{stem}_{block.name}.c"
        if isinstance(block, Program):
            found += _program_mutants(block, file, fmt)
            continue
        found += _kernel_mutants(block, file, fmt)
        found += _port_mutants(block, file, fmt)
        found += _counter_mutants(block, file)
    found += [
        Mutant(f"{stem}.c", "", kind, place, None, text)
        for kind, place, text in wiring_faults(device.system, fmt)
    ]
    return found
