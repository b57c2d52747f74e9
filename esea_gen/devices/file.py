"""Read device files.

A device file is TOML.  Every number in it is a small table with the value, a status (``published``,
``identified`` or ``assumed``) and the source; its unit is the key's suffix.  Reading one checks
every key, unit, bound and relation, and reports all errors together.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, cached_property
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from esea_gen.devices.checks import check_content
from esea_gen.devices.designed import tell_of_bandwidth, tell_of_gains
from esea_gen.devices.drive_relations import tell_of_drive
from esea_gen.devices.fields import MOST_AXES, NAME_PATTERN, SCHEMA, DeviceFile
from esea_gen.devices.numbers import Quantity, Section, Series, changed, numbers_of, toml_entry
from esea_gen.devices.rubber import Elastomer
from esea_gen.devices.scaled import scaled_to
from esea_gen.errors import UserError, nearest
from esea_gen.language.ports import UNIT_SUFFIXES, Constant, unit_of
from esea_gen.portability import check_file_name
from esea_gen.toml_file import Problem, checked, parse_toml, read_text, table_type


def render_toml(file: DeviceFile) -> str:
    lines = [
        "# Device file of esea-gen.  A number is a value in the unit of its key's suffix, a status",
        "# (published, identified or assumed) and its source.  Reports show the assumed ones.",
        f"schema = {SCHEMA}",
        f"name = {json.dumps(file.name)}",
        f"title = {json.dumps(file.title, ensure_ascii=False)}",
    ]
    for key, names in (("axes", file.axes), ("laws", file.laws)):
        if names:
            about = DeviceFile.model_fields[key].description
            lines += [f"# {about}", f"{key} = {json.dumps(list(names))}"]

    def section(name: str, model: BaseModel, first: bool = True, row: bool = False) -> None:
        # Of a row of sections the first one has the comments.
        about = [f"# {(type(model).__doc__ or '').strip()}"] if first else []
        lines.extend(["", *about, f"[[{name}]]" if row else f"[{name}]"])
        subsections = []
        for key, f in type(model).model_fields.items():
            value = getattr(model, key)
            extra: Any = f.json_schema_extra
            limits = f"Limits {extra['low']:g} to {extra['high']:g}." if extra else ""
            if value is None and extra and not row:
                lines.append(f"# Optional, {key}: {f.description}  {limits}")
            if isinstance(value, Quantity | Series):
                lines.extend([f"# {f.description}  {limits}"] if first else [])
                lines.append(toml_entry(key, value, whole=extra["whole"]))
            elif isinstance(value, str):
                lines.extend([f"# {f.description}"] if first else [])
                lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
            elif isinstance(value, BaseModel):
                subsections.append((f"{name}.{key}", value, True, False))
            elif isinstance(value, tuple) and any(isinstance(v, str) for v in value):
                lines.extend([f"# {f.description}"] if first else [])
                lines.append(f"{key} = {json.dumps(list(value))}")
            elif isinstance(value, tuple):
                subsections += [(f"{name}.{key}", v, not i, True) for i, v in enumerate(value)]
        for sub in subsections:
            section(*sub)

    for key in DeviceFile.model_fields:
        value = getattr(file, key)
        if isinstance(value, Section):
            section(key, value)
    return "\n".join(lines) + "\n"


TORQUE_MODELS = ("elastomer", "family")  # one of the two
SERIES_FORM = '{ values = [0.0, 0.001, 0.0, -0.001], status = "identified", source = "where from" }'


class DeviceData:
    """A validated device's numbers: what the models are built from."""

    def __init__(self, file: DeviceFile, origin: str) -> None:
        self.file = file
        self.origin = origin

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def title(self) -> str:
        return self.file.title

    @property
    def shipped(self) -> bool:
        """Whether it is one of the package's own files, and no other of that name."""
        return self.name in shipped_devices() and self.origin == f"{self.name}.toml"

    @property
    def argument(self) -> str:
        """What a command takes: the name of a shipped device, else the file's."""
        return self.name if self.shipped else shlex.quote(self.origin)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes; one empty name where there is a single axis."""
        return self.file.axes or ("",)

    @property
    def period_s(self) -> float:
        return 1.0 / self.file.timing.sense_rate_Hz.value

    @property
    def elastomer(self) -> Elastomer:
        """The published model's numbers; a member of the family has none."""
        if self.file.elastomer is None:
            raise UserError(
                f"{self.origin}: the torque model is [family], but this requires "
                "the published model, [elastomer].",
                "Use a device with [elastomer]: identify --model published writes one.",
            )
        return self.file.elastomer

    @property
    def rate_terms(self) -> bool:
        """Whether the torque depends on time, not on the path alone."""
        e, family = self.file.elastomer, self.file.family
        if family is not None:
            return any(t.kind == "maxwell" for t in family.terms)
        return e is not None and e.maxwell is not None

    @property
    def tau_full_scale_Nm(self) -> float:
        """Torque that counts as 100 % in error figures."""
        return self.file.domain.tau_full_scale_Nm.value

    def quantities(self) -> Iterator[tuple[str, Quantity]]:
        """Every number of the file as (dotted key, quantity), in file order."""
        return ((k, q) for k, q, _ in numbers_of(self.file) if isinstance(q, Quantity))

    def constants(self, section: str) -> tuple[Constant, ...]:
        return tuple(
            Constant(key.rsplit(".", 1)[-1], q.value, q.source, q.status)
            for key, q in self.quantities()
            if key.startswith(section + ".")
        )

    def canonical(self) -> str:
        """The content as canonical JSON: what the content hash covers."""
        content = self.file.model_dump(by_alias=True, mode="json", exclude_defaults=True)
        return json.dumps(content, sort_keys=True)

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(self.canonical().encode()).hexdigest()

    def toml(self) -> str:
        return render_toml(self.file)


def shipped_devices() -> dict[str, Path]:
    folder = resources.files("esea_gen") / "devices"
    return {Path(str(p)).stem: Path(str(p)) for p in folder.iterdir() if p.name.endswith(".toml")}


def read_file(name_or_path: str | Path) -> tuple[str, str]:
    shipped = shipped_devices()
    path = shipped.get(str(name_or_path), Path(name_or_path))
    if not path.is_file():
        hint = nearest(str(name_or_path), [*shipped, *(p.name for p in Path().glob("*.toml"))])
        raise UserError(
            f"There is no device '{name_or_path}': it is neither a file nor a shipped device.",
            f"{hint}Shipped: {', '.join(sorted(shipped))}; or give the path of a TOML file.",
        )
    return read_text(path, "Check the file."), path.name


def shipped_controllers() -> dict[str, Path]:
    folder = resources.files("esea_gen") / "devices" / "controllers"
    return {Path(str(p)).stem: Path(str(p)) for p in folder.iterdir() if p.name.endswith(".toml")}


def parse_file(text: str, origin: str, controllers: Iterable[str] = ()) -> DeviceFile:
    document = _resolved(text, origin, list(controllers))
    file = checked(DeviceFile, document, origin, _fix, text)
    check_content(origin, text, file)
    if file.disturbance is not None:
        tell_of_gains(origin, document, _shipped("disturbance"), ",".join(controllers))
    else:
        tell_of_bandwidth(origin, document, _shipped("velocity"))
    tell_of_drive(origin, file)
    return file


def _resolved(text: str, origin: str, over: Sequence[str] = ()) -> dict[str, Any]:
    # With what it extends filled in.  Shipped files are the only base and never extend in a circle.
    document = parse_toml(text, origin, "the shipped elbow.toml")
    base, controller = document.pop("extends", None), document.pop("controller", None)
    scaled = document.pop("scaled", False)
    controllers = () if controller is None else (str(controller),)
    if not isinstance(scaled, bool) or (scaled and base is None):
        raise UserError(
            f"{origin}: scaled = {scaled!r}{'' if base else ' without extends'}.",
            'Write scaled = true beside extends = "elbow_drive", or remove it.',
        )
    if base is None:
        return _with_controllers(_with_controllers(document, controllers), over)
    shipped = shipped_devices()
    if not isinstance(base, str) or base not in shipped:
        raise UserError(
            f"{origin}: extends = {base!r} is not a shipped device.",
            f"Shipped: {', '.join(sorted(shipped))}.",
        )
    below = _with_controllers(_resolved(*read_file(base)), controllers)
    # A zero belongs to one machine's encoder: another one has none until it is calibrated.
    for side in below.get("encoder", {}).values():
        side.pop("zero_rad", None)
    if not scaled:
        return _with_controllers(_merged(below, document), over)
    below = _with_controllers(below, over)  # whose weights are the elbow's, too
    return scaled_to(_merged(below, document), document, below, base)


@cache
def _shipped(section: str) -> dict[str, dict[str, Any]]:
    # Complete documents with a section whose gains others may have taken over.
    # A device before the controllers that extend it: of equals the first is named.
    found = {}
    files = [*sorted(shipped_devices().items()), *sorted(shipped_controllers().items())]
    for name, path in files:
        document = _resolved(read_text(path, "Check the file."), path.name)
        if section in document:
            found[name] = document
    return found


def _with_controllers(document: dict[str, Any], controllers: Iterable[str]) -> dict[str, Any]:
    # Their laws follow each other; of other keys the last one's stands.
    laws: list[str] = []
    for name in controllers:
        over = controller_document(name)
        if "disturbance" not in document:  # what is missing is the drive, not the rest of it
            over.pop("disturbance", None)
        laws += over.get("laws", [])
        document = _merged(document, over)
    return document | ({"laws": list(dict.fromkeys(laws))} if laws else {})


def controller_document(name: str) -> dict[str, Any]:
    """Sections that a controller supplies to a device: laws and their numbers."""
    shipped = shipped_controllers()
    path = shipped.get(name, Path(name))
    if name not in shipped and not path.is_file():
        raise UserError(
            f"There is no controller '{name}'.",
            f"{nearest(name, shipped)}Choose from {', '.join(sorted(shipped))}, or give the path "
            "of a file.",
        )
    own = ("schema", "extends", "name", "title")
    document = parse_toml(read_text(path, "Check the file."), path.name, "the shipped mpc.toml")
    return {k: v for k, v in document.items() if k not in own}


def _merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    # Sections merge; a number or a row of them is replaced with its status and source, and the
    # torque model as a whole by one of the other kind.
    other = {a for a, b in (TORQUE_MODELS, TORQUE_MODELS[::-1]) if b in over and a not in over}
    out = {k: v for k, v in base.items() if k not in other}
    for key, value in over.items():
        below = out.get(key)
        section = isinstance(value, dict) and not {"value", "values"} & set(value)
        if section and isinstance(below, dict):
            out[key] = _merged(below, value)
        else:
            out[key] = value
    return out


def _stem(key: str) -> str:
    for suffix in sorted(UNIT_SUFFIXES, key=len, reverse=True):
        if key.endswith(suffix):
            return key.removesuffix(suffix)
    return key


NAME_RULE = "Give a lower case letter, then up to 14 lower case letters, digits or underscores."


def _fix(problem: Problem) -> str | UserError:
    key, name = problem.key, str(problem.loc[-1])
    row = "correction_rad" in problem.loc or "times_s" in problem.loc
    if problem.kind == "extra_forbidden":
        same = [k for k in problem.known if _stem(k) == _stem(name)]
        if len(problem.loc) == 1 and (meant := nearest(name, ("extends", "scaled", "controller"))):
            return UserError(f"unknown key {key} = {problem.given!r}.", meant.strip())
        if not same:
            return ""
        return UserError(
            f"{key} has the unit suffix of '{unit_of(name)}'; this value is in "
            f"'{unit_of(same[0])}'.",
            f"Convert the number and name the key {same[0]}.",
        )
    if problem.kind == "missing":
        if row:
            return f"Write {SERIES_FORM}."
        if problem.within is Quantity:
            return 'Write { value = 1.0, status = "assumed", source = "why" }.'
        shipped = next(iter(_shipped(str(problem.loc[0]))), "elbow")
        return f"Add it; the shipped {shipped}.toml shows the form."
    if problem.key == "name":
        return NAME_RULE
    if problem.key == "schema":
        return "This version reads schema 1: compare the file with one from esea-gen new."
    if problem.loc[0] == "axes":
        return (
            'Axes are written ["flexion", "deviation"]: up to '
            f"{MOST_AXES} names of 1 to 12 lower case letters."
        )
    if row:
        return f"A row of numbers is written {SERIES_FORM}."
    if isinstance(problem.given, str) and re.fullmatch(r"[-+]?\d+,\d+", problem.given):
        return f"Write a decimal point and no quotes: {problem.given.replace(',', '.')}."
    if Quantity in (problem.within, table_type(problem.wanted)):
        return 'A number is written { value = 1.0, status = "published", source = "where from" }.'
    return ""  # the key's own text


def check_new_name(name: str) -> None:
    """Reject a name that a device of one's own cannot have."""
    if not re.fullmatch(NAME_PATTERN, name):
        raise UserError(
            f"'{name}' cannot be a device's name: it becomes the prefix of the C.", NAME_RULE
        )
    try:
        check_file_name(name)
    except ValueError as fault:
        raise UserError(f"'{name}' {fault}.", "Give the device another name.") from None
    if name in shipped_devices():
        raise UserError(f"'{name}' is a shipped device.", "Give the new one another name.")


def copied_file(base: DeviceData, name: str) -> DeviceFile:
    check_new_name(name)

    def assumed(number: Quantity | Series) -> Quantity | Series:
        source = f"copied from {base.name}: {number.source}"
        return number.model_copy(update={"status": "assumed", "source": source})

    title = f"{name}: new device, all numbers copied from {base.name}"
    update = {"name": name, "title": title, "encoder": base.file.encoder.unzeroed()}
    return changed(base.file.model_copy(update=update), assumed)
