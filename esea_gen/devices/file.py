"""Reading, checking and writing device files.

A device file is TOML.  Every number in it is a small table with the value, a status (``published``,
``identified`` or ``assumed``) and the source; its unit is the key's suffix.  Reading one checks
every key, unit, bound and relation, and says in one paragraph what is wrong.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from esea_gen.devices.fields import (
    MOST_AXES,
    NAME_PATTERN,
    SCHEMA,
    DeviceFile,
    Quantity,
    Section,
    Series,
    field_facts,
    models_of,
    quantities_of,
    series_of,
)
from esea_gen.errors import UserError
from esea_gen.language.ports import UNIT_SUFFIXES, Constant, unit_of
from esea_gen.toml_file import Problem, checked, nearest, parse_toml, read_text

SERIES_FORM = '{ values = [0.0, 0.001, 0.0, -0.001], status = "identified", source = "where from" }'
SAME_ORIENTATION_RAD = 0.02  # about 1 deg: an encoder's error moves little within that
MOST_CORRECTION_SLOPE = 0.25  # 1 deg with four periods a turn: 0.07
MOST_PERIODS = 2000  # of sensing in one of control, when a rate is looked for that divides
FILTER_RATE_HZ = 1000.0  # the published observers' filters were printed for this rate


# Sections that laws take their numbers from, with what else of the file they need.
LAW_SECTIONS = {"sliding_mode": ("inverse",), "predictive": ()}


class DeviceData:
    """A validated device's numbers: what the models are built from.

    origin: name of the file it was read from, for messages.
    """

    def __init__(self, file: DeviceFile, origin: str) -> None:
        self.file = file
        self.origin = origin

    @property
    def name(self) -> str:
        """Short name, prefix of the generated C."""
        return self.file.name

    @property
    def title(self) -> str:
        """One line for reports."""
        return self.file.title

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes; one empty name where there is a single axis."""
        return self.file.axes or ("",)

    @property
    def period_s(self) -> float:
        """Period of the sensing task."""
        return 1.0 / self.file.timing.sense_rate_Hz.value

    @property
    def tau_full_scale_Nm(self) -> float:
        """Torque that counts as 100 % in error figures."""
        return self.file.domain.tau_full_scale_Nm.value

    def quantities(self) -> Iterator[tuple[str, Quantity]]:
        """Every number of the file as (dotted key, quantity), in file order."""
        yield from quantities_of(self.file)

    def constants(self, section: str) -> tuple[Constant, ...]:
        """The numbers of one section, as Block constants."""
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
        """SHA-256 of :meth:`canonical`, hexadecimal."""
        return hashlib.sha256(self.canonical().encode()).hexdigest()

    def toml(self) -> str:
        """The content as a commented TOML document."""
        return render_toml(self.file)


def shipped_devices() -> dict[str, Path]:
    """Device files that come with the package, by name."""
    folder = resources.files("esea_gen") / "devices"
    return {Path(str(p)).stem: Path(str(p)) for p in folder.iterdir() if p.name.endswith(".toml")}


def read_file(name_or_path: str | Path) -> tuple[str, str]:
    """Text of a device file.

    name_or_path: name of a shipped device (``elbow``) or path of a TOML file.
    """
    shipped = shipped_devices()
    path = shipped.get(str(name_or_path), Path(name_or_path))
    if not path.is_file():
        hint = nearest(str(name_or_path), shipped)
        raise UserError(
            f"There is no device '{name_or_path}': it is neither a file nor a shipped device.",
            f"{hint}Shipped: {', '.join(sorted(shipped))}; or give the path of a TOML file.",
        )
    return read_text(path, "Check the file."), path.name


def shipped_controllers() -> dict[str, Path]:
    """Configurations of control laws that come with the package, by name."""
    folder = resources.files("esea_gen") / "devices" / "controllers"
    return {Path(str(p)).stem: Path(str(p)) for p in folder.iterdir() if p.name.endswith(".toml")}


def parse_file(text: str, origin: str, controllers: Iterable[str] = ()) -> DeviceFile:
    """Validate the text of a device file.

    controllers: shipped controllers, or TOML files, whose sections take the place of the file's.
    """
    document = _with_controllers(_resolved(text, origin), controllers)
    file = checked(DeviceFile, document, origin, _fix)
    for key, q in quantities_of(file):
        _check_value(origin, key, q)
    for key, row in series_of(file):
        _check_series(origin, key, row)
    _check_texts(origin, file)
    _check_relations(origin, file)
    _check_control(origin, file)
    _check_inverse(origin, file)
    _check_encoder(origin, file)
    return file


def _resolved(text: str, origin: str) -> dict[str, Any]:
    # With what it extends filled in.  Shipped files are the only base and never extend in a circle.
    document = parse_toml(text, origin, "the shipped elbow.toml")
    base, controller = document.pop("extends", None), document.pop("controller", None)
    controllers = () if controller is None else (str(controller),)
    if base is None:
        return _with_controllers(document, controllers)
    shipped = shipped_devices()
    if not isinstance(base, str) or base not in shipped:
        raise UserError(
            f"{origin}: extends = {base!r} is not a shipped device.",
            f"Shipped: {', '.join(sorted(shipped))}.",
        )
    return _merged(_with_controllers(_resolved(*read_file(base)), controllers), document)


def _with_controllers(document: dict[str, Any], controllers: Iterable[str]) -> dict[str, Any]:
    # Their laws follow each other; of other keys the last one's stands.
    laws: list[str] = []
    for name in controllers:
        over = controller_document(name)
        laws += over.get("laws", [])
        document = _merged(document, over)
    return document | ({"laws": list(dict.fromkeys(laws))} if laws else {})


def controller_document(name: str) -> dict[str, Any]:
    """What a controller gives to a device: its laws and their sections.

    name: shipped controller, or path of a device file.
    """
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
    # Sections merge; a number or a row of them is replaced with its status and source.
    out = dict(base)
    for key, value in over.items():
        below = out.get(key)
        section = isinstance(value, dict) and not {"value", "values"} & set(value)
        if section and isinstance(below, dict):
            out[key] = _merged(below, value)
        else:
            out[key] = value
    return out


def _check_value(origin: str, key: str, q: Quantity) -> None:
    extra = field_facts(key)
    unit = unit_of(key)
    shown = "" if unit == "1" else f" {unit}"
    if not extra["low"] <= q.value <= extra["high"]:
        side, limit = (
            ("below", extra["low"]) if q.value < extra["low"] else ("above", extra["high"])
        )
        raise UserError(
            f"{origin}: {key} = {q.value:g}{shown} is {side} its limit {limit:g}{shown} "
            f"({extra['text']})",
            f"Give a value from {extra['low']:g} to {extra['high']:g}{shown}.",
        )
    if extra["whole"] and q.value != math.floor(q.value):
        raise UserError(
            f"{origin}: {key} = {q.value:g} is not a whole number.", "Give a whole one."
        )


def _check_series(origin: str, key: str, row: Series) -> None:
    extra = field_facts(key)
    unit = unit_of(key)
    sizes = ", ".join(map(str, extra["sizes"]))
    if len(row.values) not in extra["sizes"]:
        raise UserError(
            f"{origin}: {key} has {len(row.values)} values; it takes {sizes}. ({extra['text']})",
            "Give one of these numbers of values, at equal steps.",
        )
    for i, value in enumerate(row.values):
        if not extra["low"] <= value <= extra["high"]:
            raise UserError(
                f"{origin}: {key}: value {i} (counted from 0) is {value:g} {unit}, outside "
                f"{extra['low']:g} to {extra['high']:g} {unit}.",
                "Check its unit and sign.",
            )


def _check_texts(origin: str, file: DeviceFile) -> None:
    # These words stand in comments of the generated C.
    texts = [("title", file.title)]
    texts += [(f"{key}.source", q.source) for key, q in quantities_of(file)]
    texts += [(f"{key}.source", row.source) for key, row in series_of(file)]
    for key, text in texts:
        bad = next((b for b in ("*/", "/*", "\\") if b in text), None)
        if bad is None and not text.isprintable():
            bad = "a line break or other control character"
        if bad is not None:
            raise UserError(
                f"{origin}: {key} holds {bad}, which would end or break a comment of the C.",
                "Take it out.",
            )


def _check_relations(origin: str, file: DeviceFile) -> None:
    values = dict(quantities_of(file))
    for inner, outer in (
        ("domain.theta_max_rad", "limits.theta_rad"),
        ("domain.omega_max_rad_s", "limits.omega_rad_s"),
        ("domain.tau_full_scale_Nm", "limits.tau_Nm"),
    ):
        if values[inner].value > values[outer].value:
            raise UserError(
                f"{origin}: {inner} = {values[inner].value:g} is above {outer} = "
                f"{values[outer].value:g}: the identified domain must lie inside the port's range.",
                f"Raise {outer} or lower {inner}.",
            )
    zone, reach = values.get("elastomer.dead_zone_rad"), values["domain.theta_max_rad"]
    if zone is not None and zone.value >= reach.value:
        raise UserError(
            f"{origin}: elastomer.dead_zone_rad = {zone.value:g} is not below "
            f"domain.theta_max_rad = {reach.value:g}: no torque in the whole domain.",
            "Narrow the dead zone or widen the domain.",
        )
    if len(set(file.axes)) != len(file.axes):
        raise UserError(
            f"{origin}: axes = {list(file.axes)} names an axis twice.", "Give each its own name."
        )
    e = file.elastomer
    if e.k1_Nm_rad.value == 0 and e.k3_Nm_rad3.value == 0 and e.alpha_Nm_rad.value == 0:
        raise UserError(
            f"{origin}: elastomer.k1_Nm_rad, k3_Nm_rad3 and alpha_Nm_rad are all 0: no torque.",
            "Give at least one stiffness.",
        )
    if file.velocity.bandwidth_Hz.value > 0.1 * file.timing.sense_rate_Hz.value:
        raise UserError(
            f"{origin}: velocity.bandwidth_Hz = {file.velocity.bandwidth_Hz.value:g} Hz is above "
            f"its limit, a tenth of timing.sense_rate_Hz ({0.1 * file.timing.sense_rate_Hz.value:g}"
            " Hz).",
            "Lower the bandwidth or raise the rate.",
        )


def _check_control(origin: str, file: DeviceFile) -> None:
    drive = ("actuator", "joint", "disturbance", "impedance", "safety")
    laws = [k for k in LAW_SECTIONS if getattr(file, k) is not None]
    for law in laws:
        control = (*drive, *LAW_SECTIONS[law])
        needed = [k for k in control if getattr(file, k) is None]
        if needed:
            raise UserError(
                f"{origin}: section [{needed[0]}] is missing: torque control by [{law}] needs "
                f"{', '.join(control)}.",
                'Add it, or write extends = "elbow_drive" and give what differs.',
            )
    values = {k: q.value for k, q in quantities_of(file)}
    pairs = [
        ("joint.theta_min_rad", "joint.theta_max_rad"),
        ("safety.rom_min_rad", "safety.rom_max_rad"),
        ("safety.u_max_Nm", "actuator.u_max_Nm"),
        ("safety.theta_max_rad", "limits.theta_rad"),
        ("safety.tau_max_Nm", "limits.tau_Nm"),
        ("safety.rom_max_rad", "joint.theta_max_rad"),
        ("joint.theta_min_rad", "safety.rom_min_rad"),
    ]
    for low, high in pairs:
        if low in values and high in values and values[low] > values[high]:
            raise UserError(
                f"{origin}: {low} = {values[low]:g} is above {high} = {values[high]:g}.",
                f"Lower {low} or raise {high}.",
            )
    sense = values["timing.sense_rate_Hz"]
    rate = values.get("timing.control_rate_Hz")
    if rate is None:
        if laws:
            raise UserError(
                f"{origin}: timing.control_rate_Hz is missing: torque control needs its rate.",
                "Give one that divides timing.sense_rate_Hz.",
            )
        return
    every = sense / rate
    if abs(every - round(every)) > 1e-9 or every < 1:
        raise UserError(
            f"{origin}: timing.control_rate_Hz = {rate:g} Hz does not divide "
            f"timing.sense_rate_Hz = {sense:g} Hz: {every:g} periods.",
            f"Give {_dividing(sense, every):g} Hz, or another rate that divides it.",
        )
    release = values.get("timing.control_release_s")
    if release is not None and not (
        abs(release * sense - round(release * sense)) < 1e-9 and 1 <= release * sense <= every
    ):
        raise UserError(
            f"{origin}: timing.control_release_s = {release:g} s is not a whole number of sensing "
            f"periods ({1 / sense:g} s) up to the control period ({1 / rate:g} s).",
            "Give such a number, or leave it out.",
        )


def _dividing(sense: float, every: float) -> float:
    # The nearest rate that divides as it is printed: a third of 1000 Hz would be refused again.
    near = [n for n in range(1, MOST_PERIODS) if float(f"{sense / n:g}") * n == sense]
    return sense / min(near or [max(1, round(every))], key=lambda n: abs(n - every))


def _check_inverse(origin: str, file: DeviceFile) -> None:
    asked = file.inverse
    if asked is None:
        return
    if asked.kind == "exact" and asked.filter != "none":
        raise UserError(
            f"{origin}: inverse.filter = '{asked.filter}' has no meaning with inverse.kind = "
            "'exact': the exact inverse has no disturbance observer.",
            'Write filter = "none", or kind = "published".',
        )
    if file.elastomer.k1_Nm_rad.value == 0:
        raise UserError(
            f"{origin}: [inverse] with elastomer.k1_Nm_rad = 0: the torque has no unique inverse.",
            "Give a positive linear stiffness, or leave the section out.",
        )
    if asked.kind == "exact":
        return
    zone, rate = file.elastomer.dead_zone_rad, file.timing.sense_rate_Hz.value
    if zone is not None and zone.value > 0:
        raise UserError(
            f"{origin}: inverse.kind = 'published' with elastomer.dead_zone_rad = {zone.value:g}: "
            "the published envelope (4.13) has no dead zone.",
            'Write kind = "exact".',
        )
    if asked.filter != "none" and rate != FILTER_RATE_HZ:
        raise UserError(
            f"{origin}: inverse.filter = '{asked.filter}' is made for {FILTER_RATE_HZ:g} Hz, but "
            f"timing.sense_rate_Hz = {rate:g} Hz.",
            'Write filter = "none", or sense at that rate.',
        )
    if asked.kappa_rad is not None and asked.kappa_rad.value == 0:
        raise UserError(
            f"{origin}: inverse.kappa_rad = 0: the set-point would be 0 for every torque.",
            "Give a positive weight, or leave the key out for the published one.",
        )


def _check_encoder(origin: str, file: DeviceFile) -> None:
    for side in ("motor", "load"):
        e = getattr(file.encoder, side)
        if e is None:
            continue
        at = f"{origin}: encoder.{side}"
        if e.direction is not None and e.direction.value == 0:
            raise UserError(f"{at}.direction = 0 is neither 1 nor -1.", "Give 1 or -1.")
        table, there = e.correction_rad, e.correction_orientation_rad
        if (table is None) != (there is None):
            given, other = ("correction_rad", "correction_orientation_rad")[:: 1 if table else -1]
            raise UserError(
                f"{at}.{given} is given without {other}: a correction holds for the angle at which "
                "the encoder was mounted.",
                "Give both, or leave both out.",
            )
        if table is None:
            continue
        now = e.orientation_rad.value if e.orientation_rad else 0.0
        moved = abs(math.remainder(there.value - now, 2 * math.pi))
        if moved > SAME_ORIENTATION_RAD:
            raise UserError(
                f"{at}.correction_rad was characterised at {there.value:g} rad, but the encoder is "
                f"mounted at orientation_rad = {now:g} rad, {moved:g} rad away (limit "
                f"{SAME_ORIENTATION_RAD:g}).",
                "Characterise it again as it is mounted, or leave the correction out.",
            )
        cell = 2 * math.pi / len(table.values)
        for i, value in enumerate(table.values):
            after = table.values[(i + 1) % len(table.values)]
            if abs(after - value) > MOST_CORRECTION_SLOPE * cell:
                raise UserError(
                    f"{at}.correction_rad changes by {after - value:g} rad from value {i} to the "
                    f"next, above {MOST_CORRECTION_SLOPE:g} of their distance "
                    f"({MOST_CORRECTION_SLOPE * cell:g} rad): no encoder's error is as steep.",
                    "Check the values' unit and order.",
                )


def _stem(key: str) -> str:
    for suffix in sorted(UNIT_SUFFIXES, key=len, reverse=True):
        if key.endswith(suffix):
            return key.removesuffix(suffix)
    return key


def _fix(problem: Problem) -> str | UserError:
    key, name = problem.key, str(problem.loc[-1])
    row = "correction_rad" in problem.loc
    if problem.kind == "extra_forbidden":
        same = [k for k in problem.known if _stem(k) == _stem(name)]
        if not same:
            return ""
        return UserError(
            f"{key} has the unit suffix of '{unit_of(name)}'; this value is kept in "
            f"'{unit_of(same[0])}'.",
            f"Convert the number and name the key {same[0]}.",
        )
    if problem.kind == "missing":
        if row:
            return f"Write {SERIES_FORM}."
        if problem.within is Quantity:
            return 'Write { value = 1.0, status = "assumed", source = "why" }.'
        return "Add it; the shipped elbow.toml shows the form."
    if problem.loc[0] == "axes":
        return (
            'Axes are written ["flexion", "deviation"]: up to '
            f"{MOST_AXES} names of 1 to 12 lower case letters."
        )
    if row:
        return f"A row of numbers is written {SERIES_FORM}."
    return 'A number is written { value = 1.0, status = "published", source = "where from" }.'


def render_toml(file: DeviceFile) -> str:
    """Write a device file with a comment for every key.

    return: TOML that :func:`parse_device` reads back to an equal content.
    """
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

    def section(name: str, model: BaseModel) -> None:
        lines.extend(["", f"# {(type(model).__doc__ or '').strip()}", f"[{name}]"])
        subsections = []
        for key, f in type(model).model_fields.items():
            value = getattr(model, key)
            extra: Any = f.json_schema_extra
            limits = f"Limits {extra['low']:g} to {extra['high']:g}." if extra else ""
            if value is None and extra:
                lines.append(f"# Optional, {key}: {f.description}  {limits}")
            if isinstance(value, Quantity):
                lines.append(f"# {f.description}  {limits}")
                number = int(value.value) if extra["whole"] else value.value
                lines.append(
                    f"{key} = {{ value = {number!r}, status = {json.dumps(value.status)}, "
                    f"source = {json.dumps(value.source, ensure_ascii=False)} }}"
                )
            elif isinstance(value, Series):
                row = [float(v) for v in value.values]
                lines.append(f"# {f.description}  {limits}")
                lines.append(
                    f"{key} = {{ values = {row!r}, status = {json.dumps(value.status)}, "
                    f"source = {json.dumps(value.source, ensure_ascii=False)} }}"
                )
            elif isinstance(value, str):
                lines.extend([f"# {f.description}", f"{key} = {json.dumps(value)}"])
            elif isinstance(value, BaseModel):
                subsections.append((f"{name}.{key}", value))
        for sub, value in subsections:
            section(sub, value)

    for key in DeviceFile.model_fields:
        value = getattr(file, key)
        if isinstance(value, Section):
            section(key, value)
    return "\n".join(lines) + "\n"


def copied_file(base: DeviceData, name: str) -> DeviceFile:
    """A new device with the numbers of another one.

    None of them is published or identified for the new device: each becomes ``assumed``, and its
    source says where it was copied from.
    """
    if not re.fullmatch(NAME_PATTERN, name):
        raise UserError(
            f"'{name}' cannot be a device's name: it becomes the prefix of the C.",
            "Give a lower case letter, then up to 14 lower case letters, digits or underscores.",
        )
    if name in shipped_devices():
        raise UserError(f"'{name}' is a shipped device.", "Give the new one another name.")

    def assumed(section: Section) -> Section:
        update: dict[str, Any] = {}
        for key in type(section).model_fields:
            value = getattr(section, key)
            if isinstance(value, Quantity):
                source = f"copied from {base.name}: {value.source}"
                update[key] = Quantity(value=value.value, status="assumed", source=source)
            elif isinstance(value, Series):
                source = f"copied from {base.name}: {value.source}"
                update[key] = Series(values=value.values, status="assumed", source=source)
            elif isinstance(value, Section):
                update[key] = assumed(value)
        return section.model_copy(update=update)

    title = f"{name}: new device, all numbers copied from {base.name}"
    file = assumed(base.file.model_copy(update={"name": name, "title": title}))
    assert isinstance(file, DeviceFile)
    return file


def json_schema() -> dict[str, Any]:
    """JSON schema of the device file, for editors.

    It is written without references, so that every editor shows a key's own description and bounds.
    """
    content = _schema_of(DeviceFile)
    content["properties"] = {
        "extends": {
            "type": "string",
            "enum": sorted(shipped_devices()),
            "description": "Shipped device whose numbers hold where this file gives none.",
        }
    } | content["properties"]
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Device file of esea-gen",
        **content,
        "anyOf": [{"required": ["extends"]}, _required_of(DeviceFile)],
    }


def _required_of(model: type[BaseModel]) -> dict[str, Any]:
    # What a file that extends none must have, apart from the properties: else each would stand
    # twice, once for files that extend one.
    keys = {f.alias or name: f for name, f in model.model_fields.items()}
    below = {
        key: _required_of(section)
        for key, f in keys.items()
        if (section := _section_of(f.annotation)) is not None
    }
    content: dict[str, Any] = {"required": [k for k, f in keys.items() if f.is_required()]}
    inner = {k: v for k, v in below.items() if v["required"] or "properties" in v}
    return content | ({"properties": inner} if inner else {})


def _section_of(annotation: Any) -> type[BaseModel] | None:
    return next((m for m in models_of(annotation) if issubclass(m, Section)), None)


def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    properties = {}
    for name, f in model.model_fields.items():
        key = f.alias or name
        section = _section_of(f.annotation)
        if Series in models_of(f.annotation):
            about = _series_schema(key, f.json_schema_extra)
        elif section is not None:
            about = _schema_of(section)
        elif Quantity in models_of(f.annotation):
            about = _quantity_schema(key, f.json_schema_extra)
        else:
            about = model.model_json_schema(by_alias=True)["properties"][key]
            about.pop("title", None)
            about.pop("default", None)
        properties[key] = about | ({"description": f.description} if f.description else {})
    return {
        "type": "object",
        "description": " ".join((model.__doc__ or "").split()),
        "properties": properties,
        "additionalProperties": False,
    }


def _quantity_schema(key: str, extra: Any) -> dict[str, Any]:
    fields = Quantity.model_fields
    unit = unit_of(key)
    return {
        "type": "object",
        "properties": {
            "value": {
                "type": "integer" if extra["whole"] else "number",
                "minimum": extra["low"],
                "maximum": extra["high"],
                "description": "The number, "
                + ("dimensionless." if unit == "1" else f"in {unit}."),
            },
            "status": {
                "enum": list(get_args(fields["status"].annotation)),
                "description": fields["status"].description,
            },
            "source": {
                "type": "string",
                "minLength": 1,
                "description": fields["source"].description,
            },
        },
        "required": list(fields),
        "additionalProperties": False,
    }


def _series_schema(key: str, extra: Any) -> dict[str, Any]:
    about = _quantity_schema(key, extra)
    number = about["properties"].pop("value")
    row = {
        "type": "array",
        "items": {k: number[k] for k in ("type", "minimum", "maximum")},
        "minItems": min(extra["sizes"]),
        "maxItems": max(extra["sizes"]),
        "description": number["description"].replace("The number", "The numbers"),
    }
    return about | {
        "properties": {"values": row} | about["properties"],
        "required": list(Series.model_fields),
    }
