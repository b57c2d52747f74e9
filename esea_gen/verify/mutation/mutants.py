"""Every mutant of a device's C: kernels, their ports, Programs, the wiring."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import casadi as ca
import numpy as np

from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS, Format
from esea_gen.emit.formats.floating import FloatingFormat
from esea_gen.emit.integers import integer_nodes
from esea_gen.emit.program_c import emit_program
from esea_gen.emit.render import COUNTER, Renderer
from esea_gen.emit.walker import Kernel, walk
from esea_gen.language.block import Block
from esea_gen.language.builder import array_name
from esea_gen.language.ports import Flag, Port
from esea_gen.language.program import Program
from esea_gen.language.statements import Call, walk_statements
from esea_gen.language.system import External, Latch, Signal, System, Task
from esea_gen.language.watch import WATCH, Watched
from esea_gen.verify.executor import emitted_kernel
from esea_gen.verify.mutation.edits import Edit, Elements, describe, kernel_edits

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
    c, s = block.coefficients, block.state
    return [_elements(c), _elements(s, len(c)), _elements(block.inputs, len(c) + len(s))]


def _edited(
    block: Block, function: str, kernel: Kernel, labels: Labels, edit: Edit, renderer: Renderer
) -> str:
    changed, place = edit.apply(kernel)
    names = {place[i]: label for i, label in labels.items()}
    assert isinstance(renderer.fmt, FloatingFormat)
    printed = renderer.fmt.function(block, function, changed, names)
    emitted: Any = replace(cast(Any, renderer.emitted[block.name]), **{function: printed})
    return renderer.render(emitted.template, e=emitted)


def _whole(block: Block, kernel: Kernel) -> set[int]:
    # What a step compares as whole numbers: those it computes, and flags as they come.
    given = (*block.coefficients, *block.state, *block.inputs)
    inputs = (i for i, n in enumerate(kernel.nodes) if n.op == "input")
    flags = {i for i in inputs if given[kernel.nodes[i].source[0]].whole}
    return flags | {*integer_nodes(kernel, given.__getitem__, (*block.state, *block.outputs))}


def _kernel_mutants(block: Block, file: str, fmt: Format) -> Iterator[Mutant]:
    for function in ("prepare", "init", "step") if block.tunables else ("init", "step"):
        kernel, labels = _block_kernel(block, function, fmt)
        words = block.flag_results if function == "step" else ()
        whole = _whole(block, kernel) if function == "step" else set()
        for edit in kernel_edits(kernel, fmt, _groups(block, function), words, whole):
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
        for edit in kernel_edits(kernel, fmt, [group], sorted(words[id(function)]), set()):
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


TEMPLATE = "device/esea_device.c.j2"
Fault = tuple[str, str, Callable[[Renderer], str]]
Source = External | Latch | Watched | Signal


def _changed(system: System, **parts: Any) -> System:
    # Without the checks: a fault need not pass them.
    other = copy.copy(system)
    for name, value in parts.items():
        setattr(other, name, value)
    other._task_of = {i: t for t in other.tasks for i in t.blocks}
    return other


def _printed(other: System) -> Callable[[Renderer], str]:
    def text(renderer: Renderer) -> str:
        # Names and sources come from the System that the renderer holds.
        changed = copy.copy(renderer)
        changed.system = other
        return changed.render(TEMPLATE, system=other, feed=changed.feed)

    return text


def _fed(system: System, feeds: dict[Signal, Source]) -> Callable[[Renderer], str]:
    # Some input ports read other sources.
    return _printed(_changed(system, feed=lambda sink: feeds.get(sink) or system.feed(sink)))


def _neighbours(system: System, sink: Signal) -> list[Source]:
    # What a wire may be taken from by mistake, in the same struct and of the same size.
    source = system.feed(sink)
    task = system.task_of(sink.instance)
    if isinstance(source, External):
        size, given = source.port.size, system.task_inputs(task)
        return [x for x in given if x != source and x.port.size == size]
    if isinstance(source, Watched):
        return [x for x in map(Watched, system.watched(task)) if x != source]
    if isinstance(source, Latch):
        latches = system.latches_read(task)
        return [x for x in latches if x != source and x.port.size == source.port.size]
    ports = system.blocks[source.instance].outputs
    size = next(p.size for p in ports if p.name == source.port)
    own = [Signal(source.instance, p.name) for p in ports if p.size == size and not p.flags]
    return [s for s in own if s != source]


def _wires(system: System) -> Iterator[Fault]:
    for name, block in system.blocks.items():
        sinks = [Signal(name, p.name) for p in block.inputs]
        for k, (sink, port) in enumerate(zip(sinks, block.inputs, strict=True)):
            source = system.feed(sink)
            others = _neighbours(system, sink)
            for other in others[:1]:
                place = f"{name}.{port.name} from {_name(other)} instead of {_name(source)}"
                yield "wire from the wrong source", place, _fed(system, {sink: other})
            for j in range(k + 1, len(sinks)):
                second = system.feed(sinks[j])
                if block.inputs[j].size == port.size and second != source:
                    feeds = {sink: second, sinks[j]: source}
                    place = f"{name}.{port.name} and {name}.{block.inputs[j].name}"
                    yield "wires swapped", place, _fed(system, feeds)
                    break
            inputs = tuple(p for p in block.inputs if p is not port)
            cut = {**system.blocks, name: replace(block, inputs=inputs)}
            yield "wire cut", f"{name}.{port.name}", _printed(_changed(system, blocks=cut))


def _name(source: Source) -> str:
    if isinstance(source, Watched):
        return f"{WATCH}.{source.port.name}"
    return f"{source.instance}.{source.port}" if isinstance(source, Signal) else source.name


def _results(system: System) -> Iterator[Fault]:
    for k, x in enumerate(system.outputs):
        (signal,) = x.signals
        ports = system.blocks[signal.instance].outputs
        same = [p for p in ports if p.size == x.port.size and p.name != signal.port]
        alone = len(system.task_outputs(system.task_of(signal.instance))) == 1
        if not alone:
            outputs = system.outputs[:k] + system.outputs[k + 1 :]
            yield "output dropped", x.name, _printed(_changed(system, outputs=outputs))
        for p in [p for p in same if bool(p.flags) == bool(x.port.flags)][:1]:
            wrong = External(x.name, p, (Signal(signal.instance, p.name),))
            outputs = (*system.outputs[:k], wrong, *system.outputs[k + 1 :])
            place = f"{x.name} from {signal.instance}.{p.name}"
            yield "output from the wrong source", place, _printed(_changed(system, outputs=outputs))


def _latches(system: System) -> Iterator[Fault]:
    # The readers are as they were.
    kept = {"feed": system.feed, "latches_read": system.latches_read}
    for k, latch in enumerate(system.latches):
        before, after = system.latches[:k], system.latches[k + 1 :]
        dropped = _changed(system, latches=before + after, **kept)
        yield "latch dropped", latch.name, _printed(dropped)
        ports = system.blocks[latch.source.instance].outputs
        same = [p for p in ports if p.size == latch.port.size and p.name != latch.source.port]
        for p in [p for p in same if bool(p.flags) == bool(latch.port.flags)][:1]:
            # Both: the C is printed from the port, the readers go by the source.
            wrong = replace(latch, source=Signal(latch.source.instance, p.name), port=p)
            changed = _changed(system, latches=(*before, wrong, *after), **kept)
            yield "latch from the wrong source", f"{latch.name} from {p.name}", _printed(changed)


def _times(system: System) -> Iterator[Fault]:
    waits = {(w.instance, r.instance) for r, w in system.wires.items()}
    for task in system.tasks:
        for k in range(len(task.blocks) - 1):
            order = list(task.blocks)
            if (order[k], order[k + 1]) not in waits:
                continue
            order[k : k + 2] = order[k + 1], order[k]
            place = f"{task.name}: {order[k]} before {order[k + 1]}"
            yield "order of Blocks", place, _with_task(system, task, blocks=tuple(order))
        writes = any(x.writer == task.name for x in system.latches)
        changes: list[tuple[str, dict[str, int]]] = []
        if writes:  # of a task at every tick, only the first release can be late
            ticks = (1,) if task.every == 1 else (-1, 1)
            changes += [("release", {"release": task.release_ticks + k}) for k in ticks]
        if writes or system.latches_read(task):
            changes.append(("period", {"every": task.every + 1, "release": task.release_ticks}))
            changes += [("phase", {"phase": task.phase + 1})] if task.every > 1 else []
        for kind, change in changes:
            yield f"{kind} of a task", f"{task.name}: {change}", _with_task(system, task, **change)


def _with_task(system: System, task: Task, **change: Any) -> Callable[[Renderer], str]:
    tasks = tuple(replace(t, **change) if t is task else t for t in system.tasks)
    return _printed(_changed(system, tasks=tasks))


def _tunables(system: System, fmt: Format) -> Iterator[Fault]:
    kind = fmt.dtype.type
    for name, block in system.blocks.items():
        for k, t in enumerate(block.tunables):
            found = []
            for end in ("default", "low", "high"):
                value = kind(getattr(t, end))
                near = np.nextafter(value, kind(np.inf)), np.nextafter(value, kind(-np.inf))
                far = value * kind(1.01) if value else kind(1)
                found += [
                    (f"tunable's {end} off by 1 %", end, far),
                    (f"tunable's {end} off by 1 ulp", end, near[end == "high"]),
                ]
                if end != "default":
                    beyond = kind(-3e38 if end == "low" else 3e38)
                    found.append(("tunable not checked", end, beyond))
            for fault, end, value in found:
                other = copy.copy(t)
                object.__setattr__(other, end, float(value))
                tunables = (*block.tunables[:k], other, *block.tunables[k + 1 :])
                blocks = {**system.blocks, name: replace(block, tunables=tunables)}
                place = f"{name}.{t.name}: {float(value)!r} instead of {getattr(t, end)!r}"
                yield fault, place, _printed(_changed(system, blocks=blocks))


def wiring_faults(system: System, fmt: Format) -> Iterator[Fault]:
    """Kind, place and C text of every fault of a System's wiring."""
    yield from _wires(system)
    yield from _results(system)
    yield from _latches(system)
    yield from _times(system)
    yield from _tunables(system, fmt)
