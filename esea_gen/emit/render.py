"""Render a System to C: kernels by the walker, everything round them by Jinja."""

from __future__ import annotations

import hashlib
import json
import math
import re
import tempfile
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import jinja2

from esea_gen.emit.elementary import source_paths
from esea_gen.emit.fixed.functions import source_files
from esea_gen.emit.fixed.naming import Naming
from esea_gen.emit.fixed.render import print_lowered
from esea_gen.emit.fixed.search import plan_block
from esea_gen.emit.formats import FORMATS, Q31, Format, PrintedKernel, print_kernel
from esea_gen.emit.walker import Kernel, prune, walk
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Flag, Port
from esea_gen.language.system import External, Latch, Signal, System


@cache
def template_folder() -> Path:
    """Folder of the Jinja templates: inside the wheel, or at the top of a checkout."""
    packaged = Path(__file__).parent.parent / "_templates"
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / "templates"


class _Compiled(jinja2.BytecodeCache):
    # Templates compiled in this process, for all renderers: each has an environment of its own.

    def __init__(self) -> None:
        self._held: dict[str, bytes] = {}

    def load_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        if bucket.key in self._held:
            bucket.bytecode_from_string(self._held[bucket.key])

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        self._held[bucket.key] = bucket.bytecode_to_string()


_COMPILED = _Compiled()


def environment() -> jinja2.Environment:
    """The Jinja environment: an undefined name is an error, never an empty string."""
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
        bytecode_cache=_COMPILED,
    )
    env.filters["comment"] = comment
    env.filters["number"] = lambda v: f"{v:.9g}"
    return env


def comment(text: str, indent: int = 0, width: int = 98) -> str:
    """A C comment, wrapped."""
    pad = " " * indent
    safe = " ".join(text.replace("*/", "* /").split())
    lines = textwrap.wrap(safe, width - indent - 6)
    if len(lines) <= 1:
        return f"{pad}/* {safe} */"
    return "\n".join(
        [f"{pad}/* {lines[0]}"]
        + [f"{pad} * {x}" for x in lines[1:-1]]
        + [f"{pad} * {lines[-1]} */"]
    )


# A counter of the steps in which a flag was set.
COUNTER = "{n} += (uint32_t)((out->{port} & {bit}) != 0u && {n} != UINT32_MAX);"


@dataclass(frozen=True)
class EmittedBlock:
    """A Block with its kernels printed in one number format.

    stores: per statement of the step, the state that it completes.
    """

    block: Block
    prepare: PrintedKernel | None
    init: PrintedKernel
    step: PrintedKernel
    stores: tuple[tuple[str, ...], ...]  # per statement of the step, the state that it completes
    template: str = "device/esea_block.c.j2"


def block_kernels(block: Block) -> dict[str, Kernel]:
    """The kernels of a Block, as walked."""
    kernels = {"init": walk(block.init), "step": walk(block.step)}
    if block.tunables:
        kernels["prepare"] = walk(block.prepare)
    return kernels


def _local(port: str, size: int, element: int) -> str:
    return port if size == 1 else f"{port}_{element}"


def _access(groups: list[tuple[str, tuple[Any, ...]]]) -> Callable[[int, int], tuple[str, str]]:
    flat = [(pointer, p) for pointer, ports in groups for p in ports]
    clash = {p.name for _, p in flat if [q.name for _, q in flat].count(p.name) > 1}

    def access(argument: int, element: int) -> tuple[str, str]:
        pointer, p = flat[argument]
        size = getattr(p, "size", 1)
        name = f"{pointer}_{p.name}" if p.name in clash else p.name
        index = "" if size == 1 else f"[{element}]"
        return _local(f"{name}_now" if pointer == "state" else name, size, element), (
            f"{pointer}->{p.name}{index}"
        )

    return access


def emit_block(block: Block, fmt: Format) -> EmittedBlock:
    """Print a Block's kernels."""
    emit = getattr(block, "emit", None)
    if emit is not None:  # a Program prints itself
        program: EmittedBlock = emit(fmt)
        return program
    if fmt is Q31:
        return _emit_fixed(block)
    labelled = fmt.passes(walk(block.labelled_step))
    count = block.step.n_out()
    names = dict(zip((r[0] for r in labelled.results[count:]), block.labels, strict=True))
    kernel = Kernel(labelled.name, labelled.nodes, labelled.results[:count])
    kernel, names = _prune_with(kernel, names)
    init = print_function(block, fmt, "init", fmt.passes(walk(block.init)))
    prepare = None
    if block.tunables:
        prepare = print_function(block, fmt, "prepare", fmt.passes(walk(block.prepare)))
    step = print_function(block, fmt, "step", kernel, names)
    return EmittedBlock(block, prepare, init, step, early_stores(block, step))


def print_function(
    block: Block,
    fmt: Format,
    function: str,
    kernel: Kernel,
    names: dict[int, tuple[str, str]] | None = None,
) -> PrintedKernel:
    """Print a kernel as one of a Block's functions: ``prepare``, ``init`` or ``step``."""
    if function == "prepare":
        return print_kernel(kernel, fmt, _access([("params", block.tunables)]), {})
    coefficients = [("coeffs", block.coefficients)]
    if function == "init":
        return print_kernel(kernel, fmt, _access(coefficients), {})
    access = _access([*coefficients, ("state", block.state), ("in", block.inputs)])
    return print_kernel(kernel, fmt, access, names or {}, block.flag_results)


def _emit_fixed(block: Block) -> EmittedBlock:
    plan = plan_block(block)
    step = print_lowered(plan.step)
    names = {f.port.name: f.name for f in plan.fields["state"]}
    return EmittedBlock(
        block,
        print_lowered(plan.prepare) if plan.prepare else None,
        print_lowered(plan.init),
        step,
        early_stores(block, step, names),
    )


def early_stores(
    block: Block, step: PrintedKernel, names: Mapping[str, str] | None = None
) -> tuple[tuple[str, ...], ...]:
    """Where in a step each state can be stored: as soon as the old one is read and the new known.

    Stored at the end, every new state would stay alive until there; with ten stop operators and
    sixteen registers that costs a tenth of the step.

    return: per statement, the stores that follow it; the last one takes what waits for nothing.
    """
    count = len(step.statements)
    defined = {s.name: i for i, s in enumerate(step.statements)}
    read = {s.expression: i for i, s in enumerate(step.statements)}
    after: list[list[str]] = [[] for _ in range(count)]
    for p, atoms in zip(block.state, step.results, strict=False):
        for i, atom in enumerate(atoms):
            place = f"state->{(names or {}).get(p.name, p.name)}" + (
                "" if p.size == 1 else f"[{i}]"
            )
            waits = [defined[w] for w in re.findall(r"[A-Za-z_]\w*", atom) if w in defined]
            waits.append(read.get(place, 0))
            after[max(waits)].append(f"{place} = {atom};")
    return tuple(map(tuple, after))


def _prune_with(
    kernel: Kernel, names: dict[int, tuple[str, str]]
) -> tuple[Kernel, dict[int, tuple[str, str]]]:
    # Names of values that no result needs, of inputs and of constants are dropped.
    needed = {i for r in kernel.results for i in r}
    for i in range(len(kernel.nodes) - 1, -1, -1):
        if i in needed:
            needed.update(kernel.nodes[i].args)
    order = sorted(needed)
    position = {old: new for new, old in enumerate(order)}
    kept = {
        position[i]: label
        for i, label in names.items()
        if i in needed and kernel.nodes[i].op not in ("input", "const")
    }
    return prune(kernel), kept


def content_hash(
    system: System,
    device_digest: str,
    title: str,
    formats: Iterable[Format] = tuple(FORMATS.values()),
) -> str:
    """The hash that runs through device, C, firmware, log and report.

    It covers the device file's content, the text of every emitted C file in every number format,
    the reference C, the dialect's templates and the versions that the emitted bytes depend on.
    """
    h = hashlib.sha256()

    def put(text: str) -> None:
        h.update(text.encode() + b"\0")

    put(device_digest)
    put(json.dumps(versions(), sort_keys=True))
    for path in sorted((template_folder() / "dialect").glob("*.j2")):
        put(path.name)
        put(path.read_text(encoding="utf-8"))
    for fmt in formats:
        # A file carries the hash, so it is taken as it is without one.
        for name, text in sorted(Renderer(system, fmt, "", "", title).files().items()):
            put(name)
            put(text)
    return h.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions that the emitted bytes depend on."""
    from esea_gen import __version__

    return {
        "esea-gen": __version__,
        "casadi": ca.CasadiMeta.version(),
        "jinja2": jinja2.__version__,
    }


def reference_c(system: System) -> dict[str, str]:
    """CasADi's own C of every kernel, float64: the reference that ships beside ours."""
    stem = f"esea_{system.name}_casadi"
    generator = ca.CodeGenerator(
        f"{stem}.c", {"with_header": True, "prefix": f"{stem}_", "casadi_int": "int"}
    )
    for block in system.kinds:
        # A Program has no step in one piece; its kernels stand for it.
        steps = getattr(block, "kernels", None) or {"step": block.step}
        for verb, function in {"prepare": block.prepare, "init": block.init, **steps}.items():
            if verb == "prepare" and not block.tunables:
                continue
            renamed = _rename(function, f"{stem}_{block.name}_{verb}")
            generator.add(renamed)
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(folder + "/")
        return {
            f"reference/{stem}{ending}": (Path(folder) / f"{stem}{ending}").read_text()
            for ending in (".c", ".h")
        }


def _rename(function: ca.Function, name: str) -> ca.Function:
    arguments = function.sx_in()
    return ca.Function(
        name, arguments, function.call(arguments), function.name_in(), function.name_out()
    )


@dataclass(frozen=True)
class ExampleSample:
    """A sample of the example program: step, deflection in lattice counts, expected torque."""

    step: int
    expected: float


def example_stream(system: System) -> dict[str, Any]:
    """The example program's input and what it must give, from the symbolic System.

    The first input is a triangle on a lattice of a power of two, so that it is exact in every
    format; the others are 0.

    return: ``shift`` (lattice 2**-shift), ``peak`` (counts), ``steps``, ``samples``, ``input``,
        ``output`` and ``others`` (the inputs held at 0).
    """
    task = system.tasks[0]
    source, *others = system.task_inputs(task)
    held = {x.name: 0.0 if x.port.size == 1 else [0.0] * x.port.size for x in others}
    result = system.task_outputs(task)[0]
    simulator = system.simulator()
    reach = 0.5 * min(source.port.high, -source.port.low)
    shift = 8 - math.frexp(reach)[1]
    peak = int(reach * 2.0**shift)
    steps = 4 * peak
    samples = []
    for k in range(steps):
        value = triangle(k, peak) * 2.0**-shift
        out = simulator.step(task.name, **{source.name: value}, **held)
        if k % (steps // 12) == steps // 24:
            samples.append(ExampleSample(k, round(out[result.name], 6)))
    return {
        "shift": shift,
        "peak": peak,
        "steps": steps,
        "samples": samples,
        # Far above float32's rounding at any torque scale, far below what a wrong number does.
        "tolerance": float(f"{1e-5 * result.port.high:.1g}"),
        "task": task,
        "input": source,
        "others": others,
        "output": result,
    }


def triangle(k: int, peak: int) -> int:
    """Whole-numbered triangle wave of period ``4 * peak``: 0, up, down through 0, back."""
    phase = k % (4 * peak)
    if phase <= peak:
        return phase
    return 2 * peak - phase if phase <= 3 * peak else phase - 4 * peak


class Renderer:
    """Renders one System in one number format.

    command: command that regenerates the files.
    """

    def __init__(self, system: System, fmt: Format, digest: str, command: str, title: str) -> None:
        self.system = system
        self.fmt = fmt
        self.prefix = f"esea_{system.name}"
        self.emitted = {b.name: emit_block(b, fmt) for b in system.kinds}
        self.naming = Naming(system, fixed=fmt is Q31)
        self.env = environment()
        self.env.globals |= {
            "fmt": fmt,
            "prefix": self.prefix,
            "PREFIX": self.prefix.upper(),
            "system": system,
            "programs": [b.name for b in system.kinds if getattr(b, "kernels", None)],
            "title": title,
            "content_hash": digest,
            "command": command,
            "field": self.field,
            "cname": self.naming.field,
            "xname": self.naming.external,
            "lname": self.naming.latch,
            "literal": self.literal,
            "port_text": self.port_text,
            "feed": self.feed,
            "counter": self.counter,
            "versions": versions(),
        }

    def field(self, port: Any, block: Block, group: str) -> str:
        """C declaration of a port as a struct field.

        group: struct: ``params``, ``coeffs``, ``state``, ``in`` or ``out``.
        """
        name = self.naming.field(block, group, port)
        if getattr(port, "flags", ()):
            return f"uint32_t {name};"
        size = getattr(port, "size", 1)
        return f"{self.fmt.c_type} {name}{'' if size == 1 else f'[{size}]'};"

    def counter(self, block: Block, port: Port, flag: Flag, form: str = COUNTER) -> str:
        """C statement that counts a flag."""
        bit = f"{self.prefix}_{block.name}_{flag.name}".upper()
        return form.format(n=f"state->n_{flag.name.lower()}", port=port.name, bit=bit)

    def literal(self, block: Block, group: str, port: Any, value: float) -> str:
        """C literal of a port's value."""
        if self.fmt is not Q31:
            return self.fmt.literal(value)
        return str(plan_block(block).field(group, port.name).raw(value))

    def port_text(self, port: Any, block: Block | None = None, group: str = "") -> str:
        """What a header says of a port."""
        return port_text(port) + self.naming.text(block, group, port)

    def feed(self, instance: str, port: Port, at: str) -> str:
        """C expression of what feeds an input port."""
        source = self.system.feed(Signal(instance, port.name))
        sink = self.system.blocks[instance], port
        if isinstance(source, External):
            text, made = f"in->{self.naming.external(source)}", None
        elif isinstance(source, Latch):
            held = f"state->{self.system.task_of(instance).name}_held"
            text, made = f"{held}.{self.naming.latch(source)}", source.source
        else:
            block = self.system.blocks[source.instance]
            made_port = next(p for p in block.outputs if p.name == source.port)
            text = f"{source.instance}_out.{self.naming.field(block, 'out', made_port)}"
            made = source
        return self.naming.convert(f"{text}{at}", made, *sink)

    def render(self, template: str, **context: Any) -> str:
        """One file from one template, named by its path."""
        return self.env.get_template(template).render(template=template, **context)

    def files(self) -> dict[str, str]:
        """Every file of the output folder but the manifest."""
        p = self.prefix
        out = {
            f"{p}.h": self.render("device/esea_device.h.j2"),
            f"{p}.c": self.render("device/esea_device.c.j2"),
            f"{p}_real.h": self.render("device/esea_real.h.j2"),
            "main.c": self.render("device/main.c.j2", example=self.example()),
        }
        for name, emitted in self.emitted.items():
            out[f"{p}_{name}.c"] = self.render(emitted.template, e=emitted)
        if self.fmt.name == "f64":
            out |= reference_c(self.system)
        else:
            sources = source_files() if self.fmt is Q31 else source_paths()
            out |= {path.name: path.read_text() for path in sources}
        return out

    def example(self) -> dict[str, Any]:
        """The example program's stream; in q31 with raw numbers.

        return: as :func:`example_stream`; in q31 ``scale`` turns a count into a raw input, and the
            samples and the tolerance are raw.
        """
        example = example_stream(self.system)
        if self.fmt is not Q31:
            return example
        source, result = example["input"], example["output"]
        fraction = self.naming.external_field(source).fraction
        if fraction < example["shift"]:
            raise UserError(
                f"{self.system.name}: the example's input cannot be exact in q31 (lattice "
                f"2^-{example['shift']}, format 2^-{fraction}).",
                "Narrow the range of the first input.",
            )
        made = self.naming.external_field(result)
        return example | {
            "scale": 1 << (fraction - example["shift"]),
            "samples": [ExampleSample(x.step, made.raw(x.expected)) for x in example["samples"]],
            # Ten times what single precision gets: half a percent of a percent of the range.
            "tolerance": made.raw(5e-5 * result.port.high),
        }


def port_text(port: Any) -> str:
    """What a header says of a port: meaning, unit, range, equation."""
    parts = [port.meaning]
    if isinstance(port, Port) and port.size > 1:
        parts.append(f"{port.size} elements")
    if getattr(port, "flags", ()):
        parts.append("bits below")
    else:
        unit = "dimensionless" if port.unit == "1" else port.unit
        parts.append(f"[{unit}], range {port.low:.9g} to {port.high:.9g}")
    if getattr(port, "equation", ""):
        parts.append(f"eq. {port.equation}")
    return "; ".join(parts)
