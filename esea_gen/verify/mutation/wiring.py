"""Faults of the wiring: the System changed, and its file printed again."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from esea_gen.emit.formats.base import Format
from esea_gen.emit.render import Renderer
from esea_gen.language.system import External, Latch, Signal, System, Task
from esea_gen.language.watch import WATCH, Watched

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
        found: Sequence[Source] = system.task_inputs(task)
        size = source.port.size
        return [x for x in found if x != source and x.port.size == size]  # type: ignore[union-attr]
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
