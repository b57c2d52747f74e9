"""Render a System to C: kernels by the walker, everything round them by Jinja."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import jinja2

from esea_gen.cache import cache_folder, code_digest, scratch_folder
from esea_gen.emit.example import example, tolerance
from esea_gen.emit.fixed.kept import ROOMS
from esea_gen.emit.formats.base import Format
from esea_gen.emit.printed import DEVICE, EmittedBlock, bare, comment, field_type, number_name
from esea_gen.emit.program_c import EmittedProgram, emit_program
from esea_gen.emit.walker import Kernel, walk
from esea_gen.emit.wrapping import wrap
from esea_gen.errors import UserError
from esea_gen.files import template_folder, write_whole
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port
from esea_gen.language.system import External, Latch, Signal, System
from esea_gen.language.watch import LATE_FULL, LATE_MOST, LATE_STEP, Watched

Emitted = Mapping[str, EmittedBlock | EmittedProgram]


class _Compiled(jinja2.BytecodeCache):
    # Templates compiled once for all processes.  The checksum covers all that compiled code depends
    # on: the text, the environment's options and Jinja; a file begins with the hash of its code,
    # since a damaged one could print other C.

    def __init__(self) -> None:
        self.digest = code_digest(ROOMS)
        self.folder = cache_folder() if self.digest else Path(scratch_folder())

    def get_source_checksum(self, source: str) -> str:
        return super().get_source_checksum(f"{self.digest} {jinja2.__version__} {source}")

    def load_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        with suppress(OSError, ValueError):
            kept = (self.folder / f"{bucket.key}.template").read_bytes()
            if hashlib.sha256(kept[32:]).digest() == kept[:32]:
                bucket.bytecode_from_string(kept[32:])

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        code = bucket.bytecode_to_string()
        with suppress(UserError):  # a full disk costs the next process its time and no more
            path = self.folder / f"{bucket.key}.template"
            write_whole(path, hashlib.sha256(code).digest() + code)


_compiled = cache(_Compiled)


def environment() -> jinja2.Environment:
    """The Jinja environment: an undefined name is an error, never an empty string."""
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
        optimized=False,  # no filter is applied while compiling
        bytecode_cache=_compiled(),
    )
    env.filters["bare"] = bare
    env.filters["comment"] = comment
    env.filters["wrap"] = wrap
    env.filters["number"] = lambda v: f"{v:.9g}"
    return env


# A counter of the steps in which a flag was set.
COUNTER = "esea_count_flag(&{n}, out->{port} & {bit});"


def block_kernels(block: Block) -> dict[str, Kernel]:
    kernels = {"init": walk(block.init), "step": walk(block.step)}
    if block.tunables:
        kernels["prepare"] = walk(block.prepare)
    return kernels


_EMITTED: WeakKeyDictionary[System, dict[Format, Emitted]] = WeakKeyDictionary()


def _emitted(system: System, fmt: Format) -> Emitted:
    # Printed once: for the content hash, and again with it.
    kept = _EMITTED.setdefault(system, {})
    if fmt not in kept:
        kept[fmt] = {
            b.name: emit_program(b, fmt) if b.kind == "program" else fmt.emit(b)
            for b in system.kinds
        }
    return kept[fmt]


@lru_cache(maxsize=4)
def _without_hash(system: System, fmt: Format, title: str) -> list[tuple[str, str]]:
    # A file carries the hash, so it is taken as it is without one.
    return sorted(Renderer(system, fmt, "", "", title).folder().items())


def content_hash(system: System, device_digest: str, title: str, formats: Iterable[Format]) -> str:
    """The hash that runs through device, C, firmware, log and report.

    It covers the device file's content, the text of every emitted C file in the given number
    formats, CasADi's own C, the dialect's templates and the versions that the bytes depend on.
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
        for name, text in _without_hash(system, fmt, title):
            put(name)
            put(text)
    return h.hexdigest()[:16]


def versions() -> dict[str, str]:
    from esea_gen import __version__

    return {
        "esea-gen": __version__,
        "casadi": ca.CasadiMeta.version(),
        "jinja2": jinja2.__version__,
    }


def identity(prefix: str, fmt: Format, digest: str) -> str:
    """Symbol of one text of the C: by device, number format and content hash."""
    return f"{prefix}_{fmt.name}_{digest}".rstrip("_-")


class Renderer:
    def __init__(self, system: System, fmt: Format, digest: str, command: str, title: str) -> None:
        self.system = system
        self.fmt = fmt
        self.prefix = f"esea_{system.name}"
        self.emitted = _emitted(system, fmt)
        self.identity = identity(self.prefix, fmt, digest)
        self.naming = fmt.naming(system)
        self.env = environment()
        self.env.globals |= {
            "fmt": fmt,
            "prefix": self.prefix,
            "PREFIX": self.prefix.upper(),
            "system": system,
            "programs": [b.name for b in system.kinds if b.kind == "program"],
            "title": title,
            "content_hash": digest,
            "identity": self.identity,
            "init_name": self.init_name,
            "late": {"step": LATE_STEP, "most": LATE_MOST, "full": LATE_FULL},
            "command": command,
            "field": self.field,
            "c_type": lambda port: field_type(port, self.fmt.c_type),
            "external_scale": self.naming.external_scale,
            "scales": self.naming,
            "literal": self.literal,
            "choice_macros": choice_macros(system),
            "tunable": lambda i, n: next(t for t in system.blocks[i].tunables if t.name == n),
            "port_text": self.port_text,
            "feed": self.feed,
            "counter": self.counter,
            "versions": versions(),
        }

    @property
    def init_name(self) -> str:
        """Name of the device's ``init`` in the object code."""
        return f"{self.prefix}_init_{self.identity[len(self.prefix) + 1 :]}"

    def field(self, port: Any) -> str:
        size = getattr(port, "size", 1)
        c_type = field_type(port, self.fmt.c_type)
        return f"{c_type} {port.name}{'' if size == 1 else f'[{size}]'};"

    def counter(self, block: Block, port: Port, flag: Flag, form: str = COUNTER) -> str:
        bit = f"{self.prefix}_{block.name}_{flag.name}".upper()
        return form.format(n=f"state->n_{flag.name.lower()}", port=port.name, bit=bit)

    def literal(self, block: Block, group: str, port: Any, value: float) -> str:
        return self.fmt.literal(self.naming.number(block, group, port.name, value))

    def port_text(self, port: Any, block: Block | None = None, group: str = "") -> str:
        return port_text(port) + self.naming.text(block, group, port)

    def feed(self, instance: str, port: Port, at: str) -> str:
        source = self.system.feed(Signal(instance, port.name))
        sink = self.system.blocks[instance], port
        if isinstance(source, External):
            text, made = f"in->{source.name}", None
        elif isinstance(source, Watched):
            text = f"state->{self.system.task_of(instance).name}_held.{source.port.name}"
            return self.naming.watched(text, port)
        elif isinstance(source, Latch):
            held = f"state->{self.system.task_of(instance).name}_held"
            text, made = f"{held}.{source.name}", source.source
        else:
            block = self.system.blocks[source.instance]
            made_port = next(p for p in block.outputs if p.name == source.port)
            text = f"{source.instance}_out.{made_port.name}"
            made = source
        return self.naming.convert(f"{text}{at}", made, *sink)

    def render(self, template: str, **context: Any) -> str:
        """One file from one template, named by its path; C with its long lines broken."""
        text = self.env.get_template(template).render(template=template, **context)
        text = text.replace(f"{DEVICE}_", f"{self.prefix}_".upper())
        return wrap(text) if template.endswith((".c.j2", ".h.j2")) else text

    def own_files(self) -> dict[str, str]:
        """The System's C alone: no example, no reference."""
        p = self.prefix
        out = {
            f"{p}.h": self.render("device/esea_device.h.j2"),
            f"{p}.c": self.render("device/esea_device.c.j2"),
            f"{p}_real.h": self.render("device/esea_real.h.j2"),
        }
        for name, emitted in self.emitted.items():
            out[f"{p}_{name}.c"] = self.render(emitted.template, e=emitted)
        return out

    def files(self) -> dict[str, str]:
        """The C with its support files, ready to compile into the caller's program."""
        out = self.own_files()
        out |= {n: self.render(t) for n, t in self.fmt.templates(self.prefix).items()}
        out |= self.fmt.casadi_c(self.system)
        return out | {path.name: path.read_text(encoding="utf-8") for path in self.fmt.sources()}

    def folder(self) -> dict[str, str]:
        """Every file of the output folder but the manifest: the example program, too."""
        return self.files() | {"main.c": self.example()}

    def example(self) -> str:
        """The example program, which compares the C with the symbolic System."""
        made = example(self.system)
        return self.render(
            made.template,
            example=made,
            tolerances=[tolerance(self.system, x, self.fmt.example_share) for x in made.checked],
            given=self.given,
            task_of=lambda x: self.system.task_of(x.signals[0].instance).name,
            tasks_of=lambda x: {self.system.task_of(s.instance).name: 0 for s in x.signals},
            from_units=self.naming.from_units,
            to_units=self.in_units,
        )

    def in_units(self, external: External, text: str) -> str:
        if self.naming.external_scale(external):
            return self.naming.to_units(external, text)
        return f"(double){text}"

    def given(self, external: External, value: float) -> str:
        if external.port.whole:
            return f"{value:.0f}u"
        if self.naming.external_scale(external):
            return self.naming.from_units(external, repr(float(value)))
        return self.fmt.literal(value)


def choice_macros(system: System) -> list[str]:
    """Macros of choices' numbers, but of those that have a text each."""
    ports = [p for b in system.kinds for p in (*b.state, *b.inputs, *b.outputs)]
    coded = {p.choices for p in ports if p.codes}
    found = (c for c in dict.fromkeys(p.choices for p in ports) if c is not None and c not in coded)
    return [f"#define {number_name(x, c)} {x.value}u" for c in found for x in c]


def whole_range(port: Port) -> str:
    if port.kind == "flag":
        return "0 or 1"
    if port.choices is not None and len(port.choices) <= 4:
        return ", ".join(f"{x.value} {x.name.lower()}".replace("_", " ") for x in port.choices)
    return f"{port.low:.0f} to {port.high:.0f}"


def port_text(port: Any) -> str:
    """Header text of a port: meaning, unit, range, equation."""
    parts = [port.meaning]
    if isinstance(port, Port) and port.size > 1:
        parts.append(f"{port.size} elements")
    if getattr(port, "flags", ()):
        parts.append("bits below")
    elif getattr(port, "whole", False):
        parts.append(whole_range(port))
    else:
        unit = "dimensionless" if port.unit == "1" else port.unit
        parts.append(f"[{unit}], range {port.low:.9g} to {port.high:.9g}")
    if getattr(port, "equation", ""):
        parts.append(f"eq. {port.equation}")
    return "; ".join(parts)
