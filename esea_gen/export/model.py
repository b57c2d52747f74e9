"""Contents of an FMU: a Block, a device's controller, or the virtual exoskeleton.

Each is C by the one code generator, and a list of variables that map to fields of its structs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal

from esea_gen.device import Device
from esea_gen.devices.file import DeviceData
from esea_gen.emit.build import build_command, format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer, content_hash
from esea_gen.errors import UserError
from esea_gen.language.ports import Port, Tunable
from esea_gen.language.system import External
from esea_gen.twin.hand_plant import twin_system
from esea_gen.twin.people import PlantVariant

Role = Literal["input", "tunable", "fixed", "output"]
ANGLES = ("theta_g_rad", "theta_m_rad", "theta_l_rad")


@dataclass(frozen=True)
class ModelVariable:
    name: str
    reference: int
    role: Role  # ``tunable`` may be set between steps, ``fixed`` until initialization ends
    whole: bool
    start: float
    low: float
    high: float
    unit: str
    description: str
    c: str  # field of the C struct; of the params for a tunable
    task: str = ""  # whose ``in`` or ``out`` it stands in


@dataclass(frozen=True)
class ModelTask:
    name: str
    stem: str  # of its C names
    every: int = 1
    phase: int = 0


@dataclass(frozen=True)
class ExportedModel:
    """C with its variables, ready to be wrapped."""

    kind: Literal["block", "controller", "twin"]  # what ``model.h`` runs in a tick
    identifier: str
    title: str
    renderer: Renderer
    digest: str
    stem: str  # of the C names of params, coefficients and state
    tick_s: float
    tasks: tuple[ModelTask, ...]
    variables: tuple[ModelVariable, ...]
    tuned: bool
    latched: bool
    files: tuple[str, ...]  # names of the renderer's files that are part of it
    command: str
    bodies: int = 0  # of the virtual exoskeleton: bodies that move, and steps of a tick
    substeps: int = 0
    step_s: float = 0.0
    angles: tuple[str, ...] = ANGLES

    def of(self, role: Role) -> list[ModelVariable]:
        return [v for v in self.variables if v.role == role]

    def place(self, name: str) -> int:
        return next(v.reference for v in self.variables if v.name == name)


def _ports(role: Role, task: str, ports: Iterable[Port | External]) -> Iterator[ModelVariable]:
    for x in ports:
        port = x.port if isinstance(x, External) else x
        for i in range(port.size):
            mark, at = (f"[{i + 1}]", f"[{i}]") if port.size > 1 else ("", "")
            start = min(max(0.0, port.low), port.high) if role == "input" else 0.0
            yield _variable(x.name + mark, role, x.name + at, port, start, task)


def _tunables(
    prefix: str, given: Iterable[Tunable], values: Mapping[str, float]
) -> Iterator[ModelVariable]:
    for t in given:
        start = float(values.get(t.name, t.default))
        yield _variable(prefix + t.name, "tunable", prefix + t.name, t, start)


def _variable(
    name: str, role: Role, c: str, port: Port | Tunable, start: float, task: str = ""
) -> ModelVariable:
    whole = isinstance(port, Port) and port.whole
    unit = "1" if whole else port.unit
    about = _described(port)
    return ModelVariable(name, 0, role, whole, start, port.low, port.high, unit, about, c, task)


def _numbered(*groups: Iterable[ModelVariable]) -> tuple[ModelVariable, ...]:
    # A name that is taken gets the word for its role in front.
    found: dict[str, ModelVariable] = {}
    for v in chain(*groups):
        name = f"out.{v.name}" if v.name in found else v.name
        found[name] = replace(v, name=name, reference=len(found))
    return tuple(found.values())


def _described(port: Port | Tunable) -> str:
    text = port.meaning
    if isinstance(port, Tunable):
        return f"{text} ({port.status}{': ' + port.source if port.source else ''})"
    if port.equation:
        text += f"; eq. {port.equation}"
    if port.flags:
        text += "; " + ", ".join(f"bit {i}: {f.meaning}" for i, f in enumerate(port.flags))
    if port.codes:
        text += "; " + ", ".join(f"{c.value}: {c.cause}" for c in port.codes)
    return text


def _renderer(device: Device, real: str) -> tuple[Renderer, str]:
    fmt = FORMATS.get(real)
    if fmt is None or not fmt.floating:
        raise UserError(
            f"An FMU has no number format '{real}'.",
            f"Choose from {', '.join(n for n, f in FORMATS.items() if f.floating)}.",
        )
    digest = format_hash(device, real)
    command = f"{build_command(device)} --real {real}"
    return Renderer(device.system, fmt, digest, command, device.title), digest


def controller_model(device: Device, real: str = "f32") -> ExportedModel:
    """All tasks of a device, from encoder counts to motor command."""
    renderer, digest = _renderer(device, real)
    system = device.system
    found = _numbered(
        *(_ports("input", task.name, system.task_inputs(task)) for task in system.tasks),
        *(_tunables(f"{i}.", b.tunables, {}) for i, b in system.blocks.items()),
        *(_ports("output", task.name, system.task_outputs(task)) for task in system.tasks),
    )
    return ExportedModel(
        "controller",
        renderer.prefix,
        device.title,
        renderer,
        digest,
        renderer.prefix,
        system.base_period_s,
        _tasks(renderer),
        found,
        bool(system.tunables),
        bool(system.latches),
        _sources(renderer),
        _command(device, real),
    )


def block_model(device: Device, name: str, real: str = "f32") -> ExportedModel:
    """One Block of a device, by itself."""
    kinds = {b.name: b for b in device.system.kinds}  # Programs among them
    if name not in kinds:
        raise UserError(f"{device.name} has no Block '{name}'.", f"It has {', '.join(kinds)}.")
    renderer, digest = _renderer(device, real)
    block, stem = kinds[name], f"{renderer.prefix}_{name}"
    found = _numbered(
        _ports("input", "step", block.inputs),
        _tunables("", block.tunables, {}),
        _ports("output", "step", block.outputs),
    )
    whole = {f"{renderer.prefix}.c", *(f"{renderer.prefix}_{k}.c" for k in kinds if k != name)}
    return ExportedModel(
        "block",
        stem,
        block.title,
        renderer,
        digest,
        stem,
        block.period_s,
        (ModelTask("step", stem),),
        found,
        bool(block.coefficients),
        False,
        tuple(n for n in _sources(renderer) if n not in whole),
        f"{_command(device, real)} --block {name}",
    )


def twin_model(variant: PlantVariant, tick_s: float, title: str, digest: str) -> ExportedModel:
    """The virtual exoskeleton: simulated drive, cable, elastomer, load, person and encoders."""
    # Of a device with several axes the plant of one.
    one = DeviceData(variant.device.file.model_copy(update={"axes": ()}), variant.device.origin)
    system = twin_system(one, variant.cable, variant.step_s, tick_s)
    fmt = FORMATS["f64"]
    content = content_hash(system, digest, title, [fmt])
    command = f"esea-gen export fmu {variant.device.argument} --plant NAME"
    renderer = Renderer(system, fmt, content, command, title)
    move, encode = system.tasks  # encode gives counts: whole, as the controller takes them
    at = next(x.port for x in system.task_inputs(encode) if x.name == ANGLES[0])
    about = "angle of all bodies at the start, at rest"
    start = ModelVariable("start_rad", 0, "fixed", False, 0.0, at.low, at.high, "rad", about, "")
    found = _numbered(
        _ports("input", "move", system.task_inputs(move)),
        *(_tunables(f"{i}.", b.tunables, variant.values) for i, b in system.blocks.items()),
        [start],
        _ports("output", "move", system.task_outputs(move)),
        (replace(v, whole=True) for v in _ports("output", "encode", system.task_outputs(encode))),
    )
    state = next(p for p in system.blocks["plant"].state if p.name == "theta_rad")
    return ExportedModel(
        "twin",
        f"esea_{variant.device.name}_twin",
        f"Virtual exoskeleton (simulated): {title}",
        renderer,
        content,
        renderer.prefix,
        tick_s,
        _tasks(renderer),
        found,
        True,
        False,
        _sources(renderer),
        command,
        state.size,
        round(tick_s / variant.step_s),
        variant.step_s,
    )


def _command(device: Device, real: str) -> str:
    return build_command(device).replace("build", "export fmu", 1) + f" --real {real}"


def _tasks(renderer: Renderer) -> tuple[ModelTask, ...]:
    return tuple(
        ModelTask(t.name, f"{renderer.prefix}_{t.name}", t.every, t.phase)
        for t in renderer.system.tasks
    )


def _sources(renderer: Renderer) -> tuple[str, ...]:
    return tuple(n for n in renderer.files() if "/" not in n)
