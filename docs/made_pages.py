"""Generate the pages of the site that the program defines, at every build.

``device-file.md`` and ``mapping-file.md`` from their schemas, ``command-line.md`` from the
commands, ``api/*.md`` from the docstrings, ``hazards.md`` and ``states.md`` from their tables.
"""

from __future__ import annotations

import enum
import importlib
import inspect
import re
import textwrap
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, get_args

import typer

import esea_gen
from esea_gen.control.limits.faults import FAULT_CODES
from esea_gen.device import load_device
from esea_gen.devices.schema import json_schema
from esea_gen.emit.states import BOARD_FAULTS, EVENTS, GUARDS, STATES, TABLE, TIMES_MS
from esea_gen.identify.recording import tables as mapping_tables
from esea_gen.identify.recording.mapping import FITTABLE

# The library's face, page by page: what a program may rely on.  It is documented in full, and a
# test holds it to that; everything else says in a line what its names do not.
API_PAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "core": (
        "Blocks, Systems, devices",
        ("language.ports", "language.block", "language.system", "device", "control.law", "errors"),
    ),
    "verify": ("Verification", ("verify.equivalence", "verify.verdict")),
    "identify": (
        "Identification, twin, analysis",
        (
            "identify.identification",
            "identify.recording.tables",
            "twin.closed_loop",
            "twin.loop_run",
            *(f"analysis.{m}" for m in ("campaign", "monte_carlo")),
        ),
    ),
    "host": (
        "Host: boards and recordings",
        ("esea_host.connection.device", "esea_host.recording.log"),
    ),
    "metrics": (
        "Smoothness",
        (
            *(f"esea_host.smoothness.{m}" for m in ("spectral", "jerk", "peaks", "vibration")),
            "esea_host.smoothness.chain",
        ),
    ),
}


def loaded(name: str) -> Any:
    """A module by its name in a page: those of the generator without the package's."""
    whole = name if name.startswith("esea_host.") else f"esea_gen.{name}"
    return importlib.import_module(whole)


SECTIONS = (
    "Parameters",
    "Attributes",
    "Returns",
    "Yields",
    "Raises",
    "Notes",
    "References",
    "Examples",
)


# -- reading the program --------------------------------------------------------------------------


def _described(field: Any) -> bool:
    # By itself, or by the docstring of the section or number that it holds.
    held = (field.annotation, *get_args(field.annotation))
    return bool(field.description) or any(hasattr(a, "model_fields") for a in held)


@dataclass(frozen=True)
class Item:
    """A public class, function or method."""

    name: str  # dotted, from esea_gen on
    kind: str  # "class", "function" or "method"
    target: Any
    owner: type | None = None

    @property
    def doc(self) -> str:
        """Its own docstring; none is inherited."""
        return inspect.cleandoc(self.target.__doc__ or "")

    def parameters(self) -> list[str]:
        """Names of the parameters that a docstring has to explain."""
        target = self.target
        if self.kind == "class":
            if hasattr(target, "model_fields"):  # a field carries its own description
                return [n for n, f in target.model_fields.items() if not _described(f)]
            if issubclass(target, enum.Enum):
                return []
            if is_dataclass(target):
                return [f.name for f in fields(target) if f.init and not f.name.startswith("_")]
            if "__init__" not in vars(target) or getattr(target, "_is_protocol", False):
                return []
            target = target.__init__
        try:
            found = inspect.signature(target).parameters
        except (TypeError, ValueError):
            return []
        return [n for n in found if n not in ("self", "cls") and not n.startswith("_")]


def modules() -> Iterator[Any]:
    """The modules of the library's face."""
    yield esea_gen
    for _, names in API_PAGES.values():
        for name in names:
            yield loaded(name)


def items(module: Any) -> Iterator[Item]:
    """Public classes, functions and methods that a module defines, in the order of its text.

    Of the host's rooms those that the room itself names as its own.
    """
    room, _, _ = module.__name__.rpartition(".")
    shown = importlib.import_module(room).__all__ if room.startswith("esea_host") else None
    for name, value in vars(module).items():
        if shown is not None and name not in shown:
            continue
        if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
            continue
        dotted = f"{module.__name__}.{name}"
        if inspect.isclass(value):
            yield Item(dotted, "class", value)
            for key, member in vars(value).items():
                plain = inspect.unwrap(getattr(member, "__func__", member))
                if key.startswith("_") or not inspect.isfunction(plain):
                    continue
                if plain.__module__ == module.__name__ and plain.__qualname__.startswith(name):
                    yield Item(f"{dotted}.{key}", "method", plain, value)
        elif inspect.isfunction(inspect.unwrap(value)):
            yield Item(dotted, "function", inspect.unwrap(value))


def sections(doc: str) -> dict[str, str]:
    """Cut a numpydoc docstring at its headings; what stands before the first is ``""``."""
    pattern = rf"^({'|'.join(SECTIONS)})\n-+\n"
    pieces = re.split(pattern, doc, flags=re.MULTILINE)
    return {"": pieces[0].strip()} | {
        k: v.strip("\n") for k, v in zip(pieces[1::2], pieces[2::2], strict=True)
    }


def entries(section: str) -> list[tuple[str, str]]:
    """Entries of a list section: heading line and text."""
    found: list[tuple[str, str]] = []
    for line in section.splitlines():
        if line and not line[0].isspace():
            found.append((line, ""))
        elif found:
            head, text = found[-1]
            found[-1] = head, f"{text}\n{line}" if text else line
    return [(head, textwrap.dedent(text).strip()) for head, text in found]


def documented(doc: str) -> set[str]:
    """Names that the lists of a docstring explain: ``a, b : float`` explains two."""
    found = sections(doc)
    listed = [e for kind in ("Parameters", "Attributes") for e in entries(found.get(kind, ""))]
    return {n.strip().lstrip("*") for head, _ in listed for n in head.split(" :")[0].split(",")}


# -- markdown -------------------------------------------------------------------------------------


def _inline(text: str) -> str:
    # reStructuredText of the docstrings: roles, double back quotes, references.
    text = re.sub(r":\w+:`~?\.?([^`]+)`", r"`\1`", text)
    text = re.sub(r"``(.+?)``", r"`\1`", text, flags=re.DOTALL)
    text = re.sub(r"^\.\. \[(\d+)\] *", r"[\1] ", text, flags=re.MULTILINE)
    text = re.sub(r"\[(\d+)\]_", r"[\1]", text)
    text = re.sub(r"^\* ", "- ", text, flags=re.MULTILINE)
    pieces = re.split(r"(`[^`]*`)", text)
    pieces[::2] = [re.sub(r"([*_])", r"\\\1", p).replace("<", "&lt;") for p in pieces[::2]]
    return "".join(pieces)


def _cell(text: str) -> str:
    pieces = re.split(r"(`[^`]*`)", " ".join(text.split()))
    pieces[::2] = [p.replace("|", "&#124;") for p in pieces[::2]]  # code takes no entities
    return "".join(pieces)


def api_page(key: str) -> str:
    """One page of the API reference, for mkdocstrings: each module with what it defines itself."""
    title, names = API_PAGES[key]
    lines = [f"# {title}", "", "From the docstrings of the package.", ""]
    for name in names:
        module = loaded(name)
        own = [i.name.removeprefix(f"{module.__name__}.") for i in items(module)]
        own = [n for n in own if "." not in n]
        if own:
            options = f"      members: [{', '.join(own)}]"
            lines += [f"::: {module.__name__}", "    options:", options, ""]
    return "\n".join(lines)


def _bounds(number: dict[str, Any]) -> str:
    return f"{number['minimum']:g} to {number['maximum']:g}"


def _section_rows(
    name: str, node: dict[str, Any], required: dict[str, Any]
) -> tuple[list[str], list[tuple[str, dict[str, Any], dict[str, Any], bool]]]:
    rows, inner = [], []
    for key, about in node["properties"].items():
        either = [k for one in required.get("oneOf", ()) for k in one["required"]]
        needed = key in (*required.get("required", ()), *either)
        properties = about.get("properties", {})
        if "value" in properties:
            number = properties["value"]
            kind = "whole number" if number["type"] == "integer" else "number"
            unit = re.search(r"in (.*)\.$", number["description"])
            cells = (kind, unit.group(1) if unit else "1", _bounds(number))
        elif "values" in properties:
            row = properties["values"]
            unit = re.search(r"in (.*)\.$", row["description"])
            sizes = f"{row['minItems']} to {row['maxItems']} values, each "
            cells = (
                "row of numbers",
                unit.group(1) if unit else "1",
                sizes + _bounds(row["items"]),
            )
        elif "properties" in about.get("items", {}):
            row = about["items"]
            inner.append(
                (f"[{name}.{key}]", row | {"description": about["description"]}, row, True)
            )
            continue
        elif properties:
            below = required.get("properties", {}).get(key, {})
            inner.append((f"{name}.{key}" if name else key, about, below, needed))
            continue
        else:
            kind = "list of text" if about["type"] == "array" else str(about["type"])
            limit = about.get("const", about.get("pattern", ", ".join(about.get("enum", ()))))
            if about["type"] == "array":
                limit = f"up to {about['maxItems']}, each `{about['items']['pattern']}`"
            elif "minLength" in about:
                limit = "not empty"
            elif "pattern" in about:
                limit = f"`{limit}`"
            cells = (kind.replace("string", "text"), "", limit)
        shown = (f"`{key}`", *map(str, cells), "yes" if needed else "no", about["description"])
        rows.append(f"| {' | '.join(_cell(c) for c in shown)} |")
    return rows, inner


def device_file_page() -> str:
    """The reference of the device file, from its JSON schema."""
    schema = json_schema()
    number = schema["properties"]["elastomer"]["properties"]["k1_Nm_rad"]["properties"]
    lines = [
        "# Device file",
        "",
        "*Made from the schema that the program checks with (`esea-gen schema` prints it).*",
        "",
        "A device file is TOML. It is the one home of every number that firmware is built from.",
        "`esea-gen new mine --from elbow` writes one to edit, with the schema beside it, so that",
        "an editor completes keys and shows limits. A wrong key, unit or value is refused with the",
        "file, the key, the value against its limit, and the fix.",
        "",
        "## A number",
        "",
        "```toml",
        'k1_Nm_rad = { value = 9.39, status = "published", source = "thesis table 3.2" }',
        "```",
        "",
        "Its unit is the suffix of its key. All three parts are needed:",
        "",
    ]
    for key, text in (
        ("value", "The number, in the unit that the key's suffix names."),
        ("status", number["status"]["description"]),
        ("source", number["source"]["description"]),
    ):
        lines += [f"`{key}`", f":   {text}", ""]
    head = ["| key | kind | unit | limits | needed | meaning |", "|---|---|---|---|---|---|"]

    def section(name: str, node: dict[str, Any], required: dict[str, Any], needed: bool) -> None:
        rows, inner = _section_rows(name, node, required)
        title = f"`[{name}]`" if name else "Top level"
        lines.extend(["", f"## {title}", ""])
        if name:
            about = node["description"]
            lines.extend([about + ("" if needed else " Optional."), ""])
        if rows:
            lines.extend(['<div class="keys" markdown>', "", *head, *rows, "", "</div>"])
        for entry in inner:
            section(*entry)

    # What must be there stands apart: only a file that extends no shipped device must have it.
    section("", schema, next(n for n in schema["anyOf"] if "properties" in n), True)
    example = load_device("elbow").toml()
    lines += ["", "## The whole elbow", "", "```toml", example.rstrip(), "```", ""]
    return "\n".join(lines)


UNITS = {
    "deflection.unit": {**mapping_tables.ANGLE, **mapping_tables.LENGTH},
    "torque.unit": {**mapping_tables.TORQUE, **mapping_tables.FORCE, **mapping_tables.VOLTAGE},
    "sampling.time_unit": mapping_tables.TIME,
}


def _mapping_row(place: str, key: str, about: dict[str, Any], needed: bool) -> str:
    """A key of a mapping file: kind, values, default, meaning."""
    known = next((a for a in about.get("anyOf", ()) if a.get("type") != "null"), about)
    default = about.get("default")
    kinds = {"integer": "whole number", "boolean": "true or false", "array": "list"}
    kind = kinds.get(known.get("type"), known.get("type", "choice").replace("string", "text"))
    low = known.get("minimum", known.get("exclusiveMinimum"))
    high = known.get("maximum", known.get("exclusiveMaximum"))
    if "low" in about:
        kind, low, high = "number with status", about["low"], about["high"]
        default = f"{default['value']:g}" if default else None
    chosen = [f"`{x}`" for x in known.get("enum", UNITS.get(place, []))]
    if high is not None:
        chosen = [f"{low:g} to {high:g}"]
    elif low is not None:
        chosen = [f"from {low:g}"]
    if place in FITTABLE:
        chosen.append('`"fit"`')
    shown = "needed" if needed else "" if default in (None, []) else f"`{default}`"
    cells = (f"`{key}`", kind, ", ".join(chosen), shown, about["description"])
    return f"| {' | '.join(_cell(c) for c in cells)} |"


def mapping_file_page() -> str:
    """The reference of the mapping file, from its JSON schema."""
    schema = mapping_tables.Mapping.model_json_schema()
    head = ["| key | kind | values | default | meaning |", "|---|---|---|---|---|"]
    lines = [
        "# Mapping file",
        "",
        "*Made from the model that reads it.* A mapping file is TOML. It names the columns of a",
        "recording, their units and scales, and the cycles that train the model.",
        "[Identify a material](identify.md) shows a short one. A number with status is written",
        '`{ value = 1.25, status = "assumed", source = "why" }`. The status is `published`,',
        "`identified` or `assumed`.",
    ]

    def section(name: str, node: dict[str, Any], many: bool, needed: bool) -> None:
        rows, inner = [], []
        for key, about in node["properties"].items():
            must = key in node.get("required", ())
            known = next((a for a in about.get("anyOf", ()) if "$ref" in a), about)
            below = known.get("$ref") or about.get("items", {}).get("$ref")
            if below and "low" not in about:
                inner.append((key, schema["$defs"][below.split("/")[-1]], "items" in about, must))
            else:
                rows.append(_mapping_row(f"{name}.{key}", key, about, must))
            if below and name and "low" not in about:
                one = {"type": "table", "description": about["description"]}
                rows.append(_mapping_row("", key, one, must))
        title = f"`[[{name}]]`" if many else f"`[{name}]`"
        lines.extend(["", f"## {title if name else 'Top level'}", ""])
        if name:
            lines.extend([node["description"] + ("" if needed else " Optional."), ""])
        lines.extend(['<div class="keys mapping" markdown>', "", *head, *rows, "", "</div>"])
        for entry in inner if not name else ():
            section(*entry)

    section("", schema, False, True)
    return "\n".join(lines) + "\n"


def commands() -> dict[str, Any]:
    """Every command of ``esea-gen`` by what is typed, groups included."""
    from esea_gen.cli import app

    found = {}

    def walk(name: str, command: Any) -> None:
        found[name] = command
        for key, sub in getattr(command, "commands", {}).items():
            walk(f"{name} {key}", sub)

    walk("esea-gen", typer.main.get_command(app))
    return found


def command_line_page() -> str:
    """The reference of the command line, from the commands' own help."""
    lines = [
        "# Command line",
        "",
        "*Made from the program's own help.* Exit codes: 0 done; 1 a check did not pass; 2 bad",
        "input, with a message that states what is wrong, where, and the remedy.",
        "",
    ]
    for name, command in commands().items():
        context = typer.Context(command, info_name=name)
        usage = re.sub(r"[{}]", "", " ".join(command.collect_usage_pieces(context)))
        if name == "esea-gen":
            lines += ["```text", f"{name} {usage}", "```", ""]
        else:
            text = _inline(inspect.cleandoc(command.help or ""))
            lines += [f"## {name}", "", text, "", "```text", f"{name} {usage}", "```", ""]
        for p in command.get_params(context):
            head, text = p.get_help_record(context) or (p.name, p.help or "")
            if head == "--help":
                continue
            head = re.sub(r" <.*>$", "", head)  # an argument's type
            lines += [f"`{head}`", f":   {_inline(text).strip() or '.'}", ""]
    return "\n".join(lines)


def hazards_page() -> str:
    """Hazards with requirement, code and tests, from hazards.toml."""
    table = tomllib.loads((Path(__file__).parent / "hazards.toml").read_text(encoding="utf-8"))
    lines = [
        "# Hazards",
        "",
        "*Made from `docs/hazards.toml`.* Hazards to the person in the robot, the requirement",
        "against each, the code that meets it, and the tests that fail if it does not. A test",
        "checks that every name exists, and that every fault of latch and board has a requirement.",
        "This is not a risk analysis by a standard: probabilities, severities and the hardware are",
        "missing, and nothing was tried on real hardware.",
        "",
    ]
    for hazard in table["hazard"]:
        lines += [f"## {hazard['id']}: {hazard['what']}", "", f"Causes: {hazard['why']}", ""]
        for r in hazard["requirement"]:
            faults = ", ".join(f"`{f}`" for f in r["faults"])
            lines += [f"### {r['id']}", "", r["says"], ""]
            lines += [f"- Fault: {faults}"] if faults else []
            lines += ["- Code: " + ", ".join(f"`{p}`" for p in r["code"])]
            lines += ["- Tests: " + ", ".join(f"`{p}`" for p in r["tests"]), ""]
    return "\n".join(lines)


def states_page() -> str:
    """States, events, times, guards and faults of the board, from their table."""
    lines = [
        "# States and faults",
        "",
        "*Made from `esea_gen/emit/states.toml`.* The board's state machine",
        "(`firmware/app/machine.c`) and every fault. [Firmware](firmware.md#states) explains them.",
        "",
        "| state | number | meaning | own clock | motor |",
        "|---|---|---|---|---|",
    ]
    for s in STATES:
        runs, motor = ("runs" if s.computes else "–"), ("on" if s.torque else "off")
        lines.append(f"| `{s.name}` | {s.value} | {s.meaning} | {runs} | {motor} |")
    lines += ["", "| event | number | from | meaning |", "|---|---|---|---|"]
    lines += [
        f"| `{e.name}` | {e.value} | {'link' if e.told else 'board'} | {e.meaning} |"
        for e in EVENTS
    ]
    lines += ["", "## Transitions", "", "| from | event | to | when |", "|---|---|---|---|"]
    for state, events in TABLE.items():
        for event, ways in events.items():
            for way in ways:
                to = "stays" if way.to == "same" else f"`{way.to}`"
                when = ", ".join(f"`{g}`" for g in way.when)
                lines.append(f"| `{state}` | `{event}` | {to} | {when} |")
    lines += ["", "| time | value | meaning |", "|---|---|---|"]
    lines += [f"| `{n}` | {v} ms | {m} |" for n, (v, m) in TIMES_MS.items()]
    lines += ["", "| guard | true if |", "|---|---|"]
    lines += [f"| `{g.name}` | {g.meaning} |" for g in GUARDS]
    lines += [
        "",
        "## Faults",
        "",
        "| fault | number | cause | what to do | motor off within |",
        "|---|---|---|---|---|",
    ]
    faults = [*BOARD_FAULTS[:1], *FAULT_CODES[1:], *BOARD_FAULTS[1:]]
    lines += [f"| `{c.name}` | {c.value} | {c.cause} | {c.cure} | {c.bound} |" for c in faults]
    return "\n".join(lines) + "\n"


def pages() -> dict[str, str]:
    """All generated pages, by path."""
    made = {
        "device-file.md": device_file_page(),
        "mapping-file.md": mapping_file_page(),
        "command-line.md": command_line_page(),
        "hazards.md": hazards_page(),
        "states.md": states_page(),
    }
    return made | {f"api/{key}.md": api_page(key) for key in API_PAGES}


def device_keys(node: dict[str, Any] | None = None) -> Iterator[str]:
    """Every key that a device file may hold."""
    for key, about in (node or json_schema())["properties"].items():
        yield key
        inner = about.get("properties", {})
        if inner and not {"value", "values"} & set(inner):
            yield from device_keys(about)


def write_pages(folder: Path) -> None:
    """Write them beside the pages that are written by hand."""
    for path, text in pages().items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    write_pages(Path(__file__).parent)

__all__ = ["commands", "device_keys", "documented", "items", "modules", "write_pages"]
