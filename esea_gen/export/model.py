"""What goes into an FMU: a Block, a device's whole controller, or the virtual exoskeleton.

Each is C by the one code generator, and a list of variables that stand for fields of its structs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from esea_gen.device import Device
from esea_gen.devices.file import DeviceData
from esea_gen.emit.build import build_command, format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer, content_hash
from esea_gen.errors import UserError
from esea_gen.language.ports import Port, Tunable
from esea_gen.language.system import External, System
from esea_gen.twin.hand_plant import twin_system
from esea_gen.twin.people import PlantVariant

Role = Literal["input", "tunable", "fixed", "output"]
ANGLES = ("theta_g_rad", "theta_m_rad", "theta_l_rad")


@dataclass(frozen=True)
class ModelVariable:
    """A number that the importing tool sees."""

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


class _Variables:
    # Collects them; a name that is taken gets the word for its role in front.

    def __init__(self) -> None:
        self.found: list[ModelVariable] = []

    def ports(self, role: Role, task: str, ports: Iterable[Port | External]) -> None:
        for x in ports:
            port = x.port if isinstance(x, External) else x
            for i in range(port.size):
                mark, at = (f"[{i + 1}]", f"[{i}]") if port.size > 1 else ("", "")
                self._add(x.name + mark, role, x.name + at, port, task)

    def tunables(self, prefix: str, given: Iterable[Tunable], values: Mapping[str, float]) -> None:
        for t in given:
            self._add(prefix + t.name, "tunable", prefix + t.name, t, "", values.get(t.name))

    def _add(
        self,
        name: str,
        role: Role,
        c: str,
        port: Port | Tunable,
        task: str,
        value: float | None = None,
    ) -> None:
        if any(v.name == name for v in self.found):
            name = f"out.{name}"
        start = 0.0 if isinstance(port, Port) else port.default
        if role == "input":
            start = min(max(start, port.low), port.high)
        whole = isinstance(port, Port) and bool(port.flags)
        self.found.append(
            ModelVariable(
                name,
                len(self.found),
                role,
                whole,
                start if value is None else float(value),
                port.low,
                port.high,
                "1" if whole else port.unit,
                _described(port),
                c,
                task,
            )
        )


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
    system, found = device.system, _Variables()
    for task in system.tasks:
        found.ports("input", task.name, system.task_inputs(task))
    _instances(found, system, {})
    for task in system.tasks:
        found.ports("output", task.name, system.task_outputs(task))
    return ExportedModel(
        "controller",
        renderer.prefix,
        device.title,
        renderer,
        digest,
        renderer.prefix,
        system.base_period_s,
        _tasks(renderer),
        tuple(found.found),
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
    block, found = kinds[name], _Variables()
    stem = f"{renderer.prefix}_{name}"
    found.ports("input", "step", block.inputs)
    found.tunables("", block.tunables, {})
    found.ports("output", "step", block.outputs)
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
        tuple(found.found),
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
    command = f"esea-gen export fmu {variant.device.name} --plant NAME"
    renderer = Renderer(system, fmt, content, command, title)
    found = _Variables()
    move, encode = system.tasks
    found.ports("input", "move", system.task_inputs(move))
    _instances(found, system, variant.values)
    place = len(found.found)
    angle = next(x.port for x in system.task_inputs(encode) if x.name == ANGLES[0])
    about = "angle of all bodies at the start, at rest"
    found.found.append(
        ModelVariable(
            "start_rad", place, "fixed", False, 0.0, angle.low, angle.high, "rad", about, ""
        )
    )
    for task in system.tasks:
        found.ports("output", task.name, system.task_outputs(task))
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
        tuple(found.found),
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


def _instances(found: _Variables, system: System, values: Mapping[str, float]) -> None:
    for instance, block in system.blocks.items():
        found.tunables(f"{instance}.", block.tunables, values)


def _tasks(renderer: Renderer) -> tuple[ModelTask, ...]:
    return tuple(
        ModelTask(t.name, f"{renderer.prefix}_{t.name}", t.every, t.phase)
        for t in renderer.system.tasks
    )


def _sources(renderer: Renderer) -> tuple[str, ...]:
    return tuple(n for n in renderer.files() if "/" not in n)
